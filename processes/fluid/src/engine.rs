//! The Flow Engine: Navier–Stokes over the cavity in the paper's order, pump and cavity volume, with walls from the deforming tissue and the
//! scope as a moving obstacle. Its state is a message like every other engine's, so that a kill loses no millilitre of the deficit.

use crate::cavity::Cavity;
use crate::crew::Crew;
use bytemuck::{Pod, Zeroable};
use hyst_engine::{Failure, Life, Stateful, StepContext};
use hyst_exchange::usher::{Arrival, Departure, Inbox, Port as UsherPort, Wanted};
use hyst_exchange::{Held, Links, ReadPage, Subscriber};
use hyst_flow::{Capsule, FlowInputs, FlowModel, Grid, Medium, Port, PumpInput, Solver, StateView, StepReport};
use hyst_messages::page::{fluid, hardware, header};
use hyst_messages::stream::message_bytes;
use hyst_messages::{FluidStatus, HardwareSample, Kind, Message, MessageMut, Role, StreamHeader};
use hyst_scene::LoadedScene;
use std::path::Path;

/// Sections of a fluid state: head, the solver's block, optical density of each cell (x fastest).
const SECTIONS: usize = 3;
/// Length of the scope behind its tip that displaces fluid, m.
const SHAFT_M: f32 = 0.06;
/// Radius of the ports at the scope's tip, m.
const PORT_M: f32 = 0.003;
/// Limit of the pump's flow, ml/min: the upper end of a hysteroscopy pump's range (WOM: 50 to 800).
const MAX_FLOW_ML_MIN: f32 = 800.0;
/// Tissues whose streams are read.
const TISSUES: usize = 2;

/// First section of a fluid state.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Head {
    /// What the page says too.
    pub status: FluidStatus,
    /// Lowest corner of the grid, m.
    pub origin_m: [f32; 3],
    /// Edges of a cell, m.
    pub spacing_m: [f32; 3],
    /// Cells along x, y, z.
    pub cells: [u32; 3],
    /// Padding, zero.
    pub reserved: u32,
}

#[derive(Default)]
struct TissueSource {
    states: Option<Subscriber>,
    topology: Option<Subscriber>,
}

/// The engine.
pub struct FlowEngine<'a> {
    life: &'a Life,
    crew: Crew,
    cavity: Cavity,
    radius_m: f32,
    seed_m: [f32; 3],
    period_ticks: u64,
    /// Epoch and tick of the state that the solver holds.
    holds: Option<(u32, u64)>,
    sources: [TissueSource; TISSUES],
    state: Option<Held>,
    topology: Option<Held>,
    hardware: Option<ReadPage>,
    status: FluidStatus,
}

/// The scene of the settings.
pub fn load_scene(path: Option<&Path>) -> Result<LoadedScene, Failure> {
    hyst_scene::load_or_embedded(path).map_err(|error| Failure::Input(error.to_string()))
}

/// The solver's model of a scene's cavity, with so many cells along x, y, z.
pub fn model_of(scene: &LoadedScene, cells: [usize; 3]) -> Result<FlowModel, hyst_flow::FlowError> {
    let figures = &scene.fluid;
    let spacing_m = std::array::from_fn(|axis| (figures.box_max_m[axis] - figures.box_min_m[axis]) / cells[axis] as f32);
    let isotonic = matches!(figures.medium, hyst_scene::Medium::Saline);
    let named = if isotonic { Medium::SALINE } else { Medium::GLYCINE };
    let mut model = FlowModel::new(Grid::new(cells, spacing_m, figures.box_min_m)?);
    model.medium =
        Medium { density_kg_m3: figures.density_kg_m3, viscosity_m2_s: figures.viscosity_pa_s / figures.density_kg_m3, ..named };
    Ok(model)
}

impl<'a> FlowEngine<'a> {
    /// An engine for the settings' scene.
    pub fn new(life: &'a Life) -> Result<FlowEngine<'a>, Failure> {
        let input = |error: hyst_flow::FlowError| Failure::Input(error.to_string());
        let scene = load_scene(life.settings.scene.as_deref())?;
        let figures = &scene.fluid;
        let model = model_of(&scene, figures.grid.map(|count| count as usize)).map_err(input)?;
        let (grid, cells) = (model.grid, model.grid.cells());
        let bands = life.settings.number("fluid_threads", 1.0, 1.0..=16.0, "a whole number from 1 to 16")? as usize;
        let crew = Crew::new(Solver::new(model, bands.min(cells[2]).min(8)).map_err(input)?)?;
        Ok(FlowEngine {
            life,
            crew,
            cavity: Cavity::new(grid),
            radius_m: scene.rigid.first().map_or(0.0025, |rigid| rigid.radius_m),
            seed_m: scene.rest.tip_m(scene.workspace.pivot_m),
            period_ticks: (1_000.0 / figures.rate_hz).round().max(1.0) as u64,
            holds: None,
            sources: Default::default(),
            state: None,
            topology: None,
            hardware: None,
            status: FluidStatus::default(),
        })
    }

    fn sections(&self) -> [usize; SECTIONS] {
        let solver = self.crew.solver();
        [size_of::<Head>(), solver.state_bytes(), solver.model().grid.cell_count() * 4]
    }

    /// Takes the tissue's newest state and makes the mask from it; without one the mask stays as it is.
    fn update_walls(&mut self) -> Result<u64, Failure> {
        let mut key = self.state.as_ref().and_then(key_of);
        for source in &self.sources {
            if let Some(held) = source.states.as_ref().and_then(|stream| stream.newest().ok()?)
                && key_of(&held) > key
            {
                key = key_of(&held);
                self.state = Some(held);
            }
            if let Some(held) = source.topology.as_ref().and_then(|stream| stream.newest().ok()?) {
                self.topology = Some(held);
            }
        }
        let (Some(state), Some(topology)) = (&self.state, &self.topology) else { return Ok(0) };
        let state = Message::parse(state.bytes(), Kind::TissueState)?;
        let topology = Message::parse(topology.bytes(), Kind::Topology)?;
        if self.cavity.update(state.section(1)?, topology.section(1)?, self.seed_m) {
            self.crew.solver().set_mask(self.cavity.mask()).map_err(|error| Failure::Broken(error.to_string()))?;
        }
        Ok(state.header().tick)
    }

    fn inputs(&self, dt_s: f32) -> FlowInputs {
        let sample = self.hardware.as_ref().and_then(|page| page.cell(hardware::SAMPLE)).map(|(_, sample)| sample);
        sample.map_or(FlowInputs { dt_s, ..FlowInputs::default() }, |sample| inputs_of(&sample, self.radius_m, dt_s))
    }

    fn write(&mut self, header: StreamHeader, status: FluidStatus, next: &mut [u8]) -> Result<(), Failure> {
        let broken = |error: hyst_flow::FlowError| Failure::Broken(error.to_string());
        let sections = self.sections();
        let [head, block, density, ..] = MessageMut::format(next, Kind::FluidState, header, &sections)?.split();
        let solver = self.crew.solver();
        solver.store(block).map_err(broken)?;
        let view = StateView::new(block).map_err(broken)?;
        let density: &mut [f32] = bytemuck::cast_slice_mut(density);
        for (out, value) in density.iter_mut().zip(view.density()) {
            *out = *value;
        }
        let grid = &solver.model().grid;
        let says = Head {
            status,
            origin_m: grid.origin_m(),
            spacing_m: grid.spacing_m(),
            cells: grid.cells().map(|count| count as u32),
            reserved: 0,
        };
        head.copy_from_slice(bytemuck::bytes_of(&says));
        self.status = status;
        Ok(())
    }
}

/// Epoch and tick of a held state.
fn key_of(held: &Held) -> Option<(u32, u64)> {
    Message::parse(held.bytes(), Kind::TissueState).ok().map(|message| (message.header().epoch, message.header().tick))
}

/// What a step gets from the hardware: the scope as an obstacle, its ports, valves and pump.
pub fn inputs_of(sample: &HardwareSample, radius_m: f32, dt_s: f32) -> FlowInputs {
    let mut inputs = FlowInputs { dt_s, ..FlowInputs::default() };
    let axis = axis_of(sample);
    let tip = sample.pose.position_m;
    let along = |from: f32| std::array::from_fn(|i| tip[i] + from * axis[i]);
    inputs.tools[0] = Capsule {
        a_m: along(-radius_m),
        b_m: along(-SHAFT_M),
        radius_m,
        velocity_a_m_s: sample.velocity_m_s,
        velocity_b_m_s: [0.0; 3],
    };
    // Inflow at the tip, along the axis; outflow through the outer sheath, one diameter behind it.
    inputs.ports[0] = Port { centre_m: along(PORT_M), radius_m: PORT_M, direction: axis, share: 1.0, inflow: true, dye: 0.0 };
    inputs.ports[1] = Port { centre_m: along(-4.0 * radius_m), radius_m: 2.0 * radius_m, share: 1.0, ..Port::default() };
    inputs.pump = PumpInput {
        inflow_valve: sample.controls.inflow_valve,
        outflow_valve: sample.controls.outflow_valve,
        set_pa: sample.controls.set_pressure_pa,
        flow_limit_ml_min: MAX_FLOW_ML_MIN,
        ..PumpInput::default()
    };
    inputs
}

fn axis_of(sample: &HardwareSample) -> [f32; 3] {
    (glam::Quat::from_array(sample.pose.orientation) * glam::Vec3::Z).to_array()
}

fn status_of(report: &StepReport, deficit_ml: f64, cavity_ml: f64) -> FluidStatus {
    let alarms = &report.pump.alarms;
    FluidStatus {
        state_tick: 0,
        deficit_ml,
        cavity_volume_ml: cavity_ml,
        pressure_pa: report.pump.pressure_pa as f32,
        inflow_ml_min: (report.pump.in_ml_s * 60.0) as f32,
        outflow_ml_min: (report.pump.out_ml_s * 60.0) as f32,
        alarms: u32::from(alarms.pressure) | u32::from(alarms.deficit) << 1 | u32::from(alarms.abnormal_loss) << 2,
    }
}

impl Stateful for FlowEngine<'_> {
    fn kind(&self) -> Kind {
        Kind::FluidState
    }

    fn message_bytes(&self) -> usize {
        message_bytes(&self.sections())
    }

    fn step_ticks(&self) -> u64 {
        self.period_ticks
    }

    fn interests(&self) -> Vec<(Role, Wanted)> {
        vec![
            (Role::Hardware, Wanted::Page),
            (Role::Tissue, Wanted::Stream(Kind::TissueState)),
            (Role::Tissue, Wanted::Stream(Kind::Topology)),
        ]
    }

    fn open(&mut self, _links: &Links) -> Result<(), Failure> {
        Ok(())
    }

    fn initial(&mut self, header: StreamHeader, state: &mut [u8]) -> Result<(), Failure> {
        self.write(header, FluidStatus::default(), state)
    }

    fn accepts(&self, state: &[u8]) -> bool {
        let Ok(message) = Message::parse(state, Kind::FluidState) else { return false };
        let sections = self.sections();
        let fits = |index: usize| message.section::<u8>(index).is_ok_and(|bytes| bytes.len() == sections[index]);
        (0..SECTIONS).all(fits)
            && message.section::<u8>(1).is_ok_and(|block| StateView::new(block).is_ok())
            && message.record::<Head>(0).is_ok_and(|head| head.status.deficit_ml.is_finite())
    }

    fn step(&mut self, context: &StepContext, now: &[u8], next: &mut [u8]) -> Result<(), Failure> {
        let broken = |error: hyst_flow::FlowError| Failure::Broken(error.to_string());
        let message = Message::parse(now, Kind::FluidState)?;
        let key = (message.header().epoch, message.header().tick);
        if self.holds != Some(key) {
            self.crew.solver().load(message.section(1)?).map_err(broken)?;
        }
        self.holds = None; // until this step has ended
        let input_tick = self.update_walls()?;
        let inputs = self.inputs(context.step_ticks as f32 * 1e-3);
        let report = self.crew.step(&inputs)?;
        let (pump, _) = self.crew.solver().counters().map_err(broken)?;
        let status = status_of(&report, pump.deficit_ml(), pump.cavity_ml);
        let header = StreamHeader { input_tick, ..*message.header() };
        self.write(header, FluidStatus { state_tick: context.next_tick, ..status }, next)
    }

    fn finished(&mut self, context: &StepContext, _state: &[u8]) {
        self.holds = Some((context.tenure.epoch, context.next_tick));
        let page = &self.life.page;
        page.write(fluid::STATUS, &self.status);
        let sections = self.sections();
        // The solver computes in its own layered fields; its block and the density are then copied into the loan.
        page.add64(header::COPIED_BYTES, (sections[1] + sections[2]) as u64);
    }

    fn arrival(&mut self, arrival: Arrival, inbox: &mut Inbox) {
        let index = arrival.slot.index();
        let before = match (arrival.slot.role(), arrival.port) {
            (Role::Hardware, UsherPort::Page(page)) => self.hardware.replace(page).map(Departure::Page),
            (Role::Tissue, UsherPort::Stream(kind, stream)) => self.sources.get_mut(index).and_then(|source| {
                let place = if kind == Kind::TissueState { &mut source.states } else { &mut source.topology };
                place.replace(stream).map(Departure::Stream)
            }),
            _ => None,
        };
        if let Some(before) = before {
            inbox.retire(before);
        }
    }
}
