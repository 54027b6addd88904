//! How little an engine's author has to write: a Flow Engine that knows nothing of the tissue, so that its walls stand still. It steps the solver of
//! `hyst-flow` from one state to the next; following, substituting, promotion, swap and rollback are `hyst_engine::run_stateful`.
//! `hystation swap fluid target/release/example-engine` puts it in the place of the real one.

use fluid::{Head, Instrument, broken, cells_of, load_scene, model_of};
use hyst_engine::{Failure, Life, Stateful, StepContext};
use hyst_exchange::ReadPage;
use hyst_exchange::usher::{Arrival, Departure, Inbox, Port, Wanted};
use hyst_flow::{FlowInputs, MAX_BUBBLES, Particle, Solver, StateView};
use hyst_messages::page::{fluid as layout, hardware};
use hyst_messages::stream::message_bytes;
use hyst_messages::{FluidStatus, Kind, Message, MessageMut, Role, StreamHeader};
use std::cell::Cell;

struct Still<'a> {
    life: &'a Life,
    solver: Solver,
    instrument: Instrument,
    step_ticks: Cell<u64>,
    hardware: Option<ReadPage>,
    status: FluidStatus,
}

impl Still<'_> {
    fn sections(&self) -> [usize; 4] {
        let gas = MAX_BUBBLES * size_of::<Particle>();
        [size_of::<Head>(), self.solver.state_bytes(), self.solver.model().grid.cell_count() * 4, gas]
    }

    fn write(&self, header: StreamHeader, next: &mut [u8]) -> Result<(), Failure> {
        let [head, block, density, gas, ..] = MessageMut::format(next, Kind::FluidState, header, &self.sections())?.split();
        self.solver.store(block).map_err(broken)?;
        let (view, grid) = (StateView::new(block).map_err(broken)?, &self.solver.model().grid);
        bytemuck::cast_slice_mut::<u8, f32>(density).iter_mut().zip(view.density()).for_each(|(out, value)| *out = *value);
        gas.copy_from_slice(bytemuck::cast_slice(view.bubbles()));
        let cells = grid.cells().map(|count| count as u32);
        let says = Head { status: self.status, origin_m: grid.origin_m(), spacing_m: grid.spacing_m(), cells, ..Head::default() };
        head.copy_from_slice(bytemuck::bytes_of(&says));
        Ok(())
    }
}

impl Stateful for Still<'_> {
    fn kind(&self) -> Kind {
        Kind::FluidState
    }
    fn message_bytes(&self) -> usize {
        message_bytes(&self.sections())
    }
    fn step_ticks(&self) -> u64 {
        self.step_ticks.get()
    }
    fn interests(&self) -> Vec<(Role, Wanted)> {
        vec![(Role::Hardware, Wanted::Page)]
    }
    fn initial(&mut self, header: StreamHeader, state: &mut [u8]) -> Result<(), Failure> {
        self.write(header, state)
    }
    fn accepts(&self, state: &[u8]) -> bool {
        let Ok(message) = Message::parse(state, Kind::FluidState) else { return false };
        let fits = |block: &[u8]| block.len() == self.solver.state_bytes() && StateView::new(block).is_ok();
        message.section::<u8>(1).is_ok_and(fits) && fluid::has_possible_step(message.header())
    }
    fn take_step(&self, step_ticks: u64) {
        self.step_ticks.set(step_ticks);
    }
    fn step(&mut self, context: &StepContext, now: &[u8], next: &mut [u8]) -> Result<(), Failure> {
        let message = Message::parse(now, Kind::FluidState)?;
        self.solver.load(message.section(1)?).map_err(broken)?;
        let dt_s = fluid::moved_s(message.header(), context);
        let sample = self.hardware.as_ref().and_then(|page| page.cell(hardware::SAMPLE)).map(|(_, sample)| sample);
        let inputs = sample.map_or(FlowInputs { dt_s, ..FlowInputs::default() }, |sample| self.instrument.inputs(&sample, dt_s));
        let report = self.solver.step_serial(&inputs).map_err(broken)?;
        self.status = fluid::status_of(&report, &self.solver.counters().map_err(broken)?.0);
        (self.status.state_tick, self.status.on_scope_n) = (context.next_tick, self.instrument.felt_n(&inputs, &report));
        self.write(*message.header(), next)
    }
    fn finished(&mut self, _context: &StepContext, _state: &[u8]) {
        self.life.page.write(layout::STATUS, &self.status);
    }
    fn arrival(&mut self, arrival: Arrival, inbox: &mut Inbox) {
        let Port::Page(page) = arrival.port else { return };
        if let Some(before) = self.hardware.replace(page) {
            inbox.retire(Departure::Page(before));
        }
    }
}

fn run(life: &Life) -> Result<(), Failure> {
    let scene = load_scene(life.scene().as_deref())?;
    let model = model_of(&scene, cells_of(&life.station, &scene)).map_err(broken)?;
    let (solver, status) = (Solver::new(model, 1).map_err(broken)?, FluidStatus::default());
    let (instrument, step_ticks) = (Instrument::of(&scene), Cell::new(scene.fluid.period_ticks()));
    hyst_engine::run_stateful(life, Still { life, solver, instrument, step_ticks, hardware: None, status })
}

fn main() -> std::process::ExitCode {
    hyst_engine::run(Role::Fluid, run)
}
