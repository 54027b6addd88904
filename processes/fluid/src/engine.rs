//! The Flow Engine: Navier–Stokes over the cavity in the paper's order, pump and cavity volume, with walls from the deforming tissue and the
//! scope as a moving obstacle. Its state is a message like every other engine's, so that a kill loses no millilitre of the deficit.

mod inputs;
mod pace;
#[cfg(test)]
mod tests;
mod tissues;

use crate::afford::{is_step, moved_s};
use crate::cavity::{Cavity, Tissue};
use crate::coarse::cells_on;
use crate::crew::Crew;
use crate::heard::Heard;
use crate::holes::Holes;
use crate::lens::Gaze;
use crate::pieces::Pieces;
use crate::removed::Removed;
use crate::seals::{self, Seals};
use crate::status::{Head, alarms_of, hash_of, is_of, is_sane, status_of};
use crate::tools::Instrument;
use crate::wounds::Wounds;
use hyst_engine::{Failure, Lies, Life, Stateful, StepContext};
use hyst_exchange::system;
use hyst_exchange::usher::{Arrival, Departure, Inbox, Port as UsherPort, Wanted};
use hyst_flow::{FlowModel, Grid, MAX_BANDS, Medium, PumpModel, Solver, StateView};
use hyst_messages::page::{fluid, header, station};
use hyst_messages::stream::message_bytes;
use hyst_messages::{FluidStatus, Kind, MAX_SEALS, Message, MessageMut, Refusal, Role, SealRecord, StreamHeader};
use hyst_messages::{WALLS_KEPT, WALLS_OPEN, WALLS_REPLACED};
use hyst_scene::LoadedScene;
use std::cell::Cell;
use std::path::Path;
use tissues::Tissues;

/// Sections of a fluid state: head, the solver's block, share of blood in each cell (x fastest), parcels of gas, vessels that are coagulated.
const SECTIONS: usize = seals::SECTION + 1;

/// The engine.
pub struct FlowEngine<'a> {
    life: &'a Life,
    crew: Crew,
    cavity: Cavity,
    pieces: Pieces,
    wounds: Wounds,
    /// Of the state that a step goes on from, and then of the one that it makes.
    seals: Seals,
    holes: Holes,
    removed: Removed,
    instrument: Instrument,
    /// Where its lens looks in the step.
    gaze: Option<Gaze>,
    /// It was said that the tissue does not close the cavity.
    has_said_open: bool,
    /// It was said that the tissue leaves nothing of it; to be said again when it has left something in between.
    has_said_kept: bool,
    seed_m: [f32; 3],
    /// Step that the scene asks for, ticks.
    scene_ticks: u64,
    /// How many times the scene's grid is halved along each axis.
    halvings: u32,
    /// That of the session: the scene's, or what the machine affords.
    step_ticks: Cell<u64>,
    /// Epoch, tick and writer of the state that the solver holds.
    holds: Option<(u32, u64, u32)>,
    tissues: Tissues,
    heard: Heard,
    /// What it mended of walls and sample for the step, bits of [`hyst_messages::FLOW_FLAWS`].
    flaws: u32,
    status: FluidStatus,
    lies: Lies,
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
    let vessels = &figures.vessels;
    model.blood.vessel_pa = vessels.pressure_pa;
    model.blood.conductance_ml_s_pa = vessels.conductance_ml_s_pa;
    model.blood.seed = vessels.seed;
    let (pump, cavity) = (&figures.pump, &figures.cavity);
    model.pump = PumpModel {
        container_ml: figures.container_ml.into(),
        deficit_alarm_ml: figures.deficit_alarm_ml,
        max_flow_ml_s: pump.max_flow_ml_min / 60.0,
        inflow_ml_s_pa: pump.inflow_ml_s_pa,
        outflow_ml_s_pa: pump.outflow_ml_s_pa,
        suction_pa: pump.suction_pa,
        leak_ml_s_pa: pump.leak_ml_s_pa,
        volume_150_mmhg_ml: cavity.volume_ml,
        parting_pa: cavity.parting_pa,
        parting_ml: cavity.parting_ml,
        ..model.pump
    };
    Ok(model)
}

impl<'a> FlowEngine<'a> {
    /// An engine for a scene, on its grid halved so many times along each axis.
    fn on_grid(life: &'a Life, scene: &LoadedScene, halvings: u32) -> Result<FlowEngine<'a>, Failure> {
        let input = |error: hyst_flow::FlowError| Failure::Input(error.to_string());
        let figures = &scene.fluid;
        let model = model_of(scene, cells_on(scene, halvings)).map_err(input)?;
        let (grid, cells) = (model.grid, model.grid.cells());
        // Half of the machine at most, so that the threads of the layers leave room for whatever is real time.
        let default = (system::cores() / 2).clamp(1, 4) as f64;
        let bands =
            life.settings.number("fluid_threads", default, 1.0..=MAX_BANDS as f64, "a whole number from 1 to 8")? as usize;
        let crew = Crew::new(Solver::new(model, bands.min(cells[2])).map_err(input)?)?;
        Ok(FlowEngine {
            life,
            crew,
            cavity: Cavity::new(grid),
            pieces: Pieces::new(grid.cell_count()),
            wounds: Wounds::new(&figures.vessels),
            seals: Seals::new(),
            holes: Holes::new(scene),
            removed: Removed::new(scene),
            instrument: Instrument::of(scene),
            gaze: None,
            has_said_open: false,
            has_said_kept: false,
            seed_m: scene.rest.tip_m(scene.workspace.pivot_m),
            scene_ticks: figures.period_ticks(),
            halvings,
            step_ticks: Cell::new(figures.period_ticks()),
            holds: None,
            tissues: Tissues::new(life)?,
            heard: Heard::new(life.is_lockstep()),
            flaws: 0,
            status: FluidStatus::default(),
            lies: Lies::new(life, size_of::<FluidStatus>()),
        })
    }

    fn sections(&self) -> [usize; SECTIONS] {
        let solver = self.crew.solver();
        let gas = hyst_flow::MAX_BUBBLES * size_of::<hyst_flow::Particle>();
        let seals = MAX_SEALS * size_of::<SealRecord>();
        [size_of::<Head>(), solver.state_bytes(), solver.model().grid.cell_count() * 4, gas, seals]
    }

    /// Whether a state's sections are those of this grid. An engine in this one's place may know of no vessels.
    fn has_sections(&self, message: &Message<'_>) -> bool {
        let sections = self.sections();
        let fits = |index: usize| message.section::<u8>(index).is_ok_and(|bytes| bytes.len() == sections[index]);
        (0..seals::SECTION).all(fits)
    }

    /// Takes the tissue's newest state and topology.
    fn receive(&mut self) {
        self.tissues.receive(self.life, self.step_ticks.get());
    }

    /// Makes the walls from the tissue's newest state that can be, and finds what floats; without one, and where it leaves nothing of the cavity, the walls
    /// stay as they are, at rest. They move if the state is newer than that which they were made from, of `last_tick`; the fluid's mask was `before`.
    /// Gives the tick of the state that they are of now: walls that stay grow old.
    fn update_walls(&mut self, last_tick: u64, before: &[u8]) -> Result<u64, Failure> {
        let broken = |error: hyst_flow::FlowError| Failure::Broken(error.to_string());
        self.receive();
        // Who has kept his own fields forgets how the walls went, as who has loaded them knows nothing of it.
        self.crew.solver().set_mask(before).map_err(broken)?;
        let Some((state, topology)) = self.tissues.newest() else { return Ok(last_tick) };
        let owner: &[u32] = topology.section(2)?;
        let velocities_m_s: &[[f32; 3]] = if state.header().tick > last_tick { state.section(2)? } else { &[] };
        let tissue = Tissue { positions_m: state.section(1)?, velocities_m_s, tets: topology.section(1)? };
        self.pieces.set_objects(topology.section(0)?);
        let is_wall = |tet: usize| !owner.get(tet).is_some_and(|object| self.pieces.is_free(*object));
        self.cavity.go_on_from(before);
        let tick = state.header().tick;
        let walls_tick = if self.cavity.update(&tissue, is_wall, self.seed_m) {
            self.has_said_kept = false;
            let set = self.crew.solver().set_walls(self.cavity.mask(), self.cavity.velocities_m_s());
            self.flaws |= flaws_of(set.map_err(broken)?, self.cavity.is_open());
            if !self.has_said_open && self.cavity.is_open() {
                self.has_said_open = true;
                self.life.say(
                    "the tissue does not close the cavity: medium reaches the side of the fluid's box, which is a wall to it",
                );
            }
            tick
        } else {
            self.flaws |= WALLS_KEPT;
            if !std::mem::replace(&mut self.has_said_kept, true) {
                self.life
                    .say(&format!("the tissue leaves nothing of the cavity: its walls stay as they were at tick {last_tick}"));
            }
            last_tick
        };
        self.pieces.locate(&self.cavity, &tissue, owner);
        self.wounds.take(&topology)?;
        self.holes.take(&topology)?;
        self.removed.take(&topology);
        self.wounds.locate(state.section(3)?);
        self.holes.locate(state.section(3)?);
        self.seals.settle(self.wounds.vessels());
        Ok(walls_tick)
    }

    /// A status that also says the step and the grid.
    fn told(&self, step_ticks: u64, status: FluidStatus) -> FluidStatus {
        let (step_ticks, scene_step_ticks) = (step_ticks as u32, self.scene_ticks as u32);
        FluidStatus { step_ticks, scene_step_ticks, halvings: self.halvings, ..status }
    }

    fn write(&mut self, header: StreamHeader, status: FluidStatus, next: &mut [u8]) -> Result<(), Failure> {
        let broken = |error: hyst_flow::FlowError| Failure::Broken(error.to_string());
        let sections = self.sections();
        let [head, block, density, gas, seals, ..] = MessageMut::format(next, Kind::FluidState, header, &sections)?.split();
        let solver = self.crew.solver();
        solver.store(block).map_err(broken)?;
        let view = StateView::new(block).map_err(broken)?;
        let density: &mut [f32] = bytemuck::cast_slice_mut(density);
        for (out, value) in density.iter_mut().zip(view.density()) {
            *out = *value;
        }
        gas.copy_from_slice(bytemuck::cast_slice(view.bubbles()));
        self.seals.store(seals);
        let (open_vessels, sealed_vessels) = (self.wounds.open_count(), self.seals.sealed());
        let transmittance = self.gaze.map_or(0.0, |gaze| gaze.told(&view));
        let status = FluidStatus { pieces: self.pieces.flows(&view), open_vessels, sealed_vessels, transmittance, ..status };
        head.copy_from_slice(bytemuck::bytes_of(&Head::of(status, &solver.model().grid)));
        self.status = status;
        Ok(())
    }
}

/// Whether the numbers of a state can be.
fn has_sane_numbers(message: &Message<'_>) -> bool {
    seals::are_sane(message)
        && message.section::<u8>(1).is_ok_and(|block| StateView::new(block).is_ok())
        && message.record::<Head>(0).is_ok_and(|head| is_sane(&head.status))
        && message.section::<f32>(2).is_ok_and(|density| density.iter().fold(true, |all, value| all & value.is_finite()))
}

/// The flaws of walls of which so many numbers were replaced.
fn flaws_of(replaced: u32, is_open: bool) -> u32 {
    (if replaced > 0 { WALLS_REPLACED } else { 0 }) | (if is_open { WALLS_OPEN } else { 0 })
}

impl Stateful for FlowEngine<'_> {
    fn kind(&self) -> Kind {
        Kind::FluidState
    }

    fn message_bytes(&self) -> usize {
        message_bytes(&self.sections())
    }

    fn step_ticks(&self) -> u64 {
        self.step_ticks.get()
    }

    fn take_step(&self, step_ticks: u64) {
        if is_step(self.scene_ticks, step_ticks) && !self.life.is_lockstep() {
            self.step_ticks.set(step_ticks);
        }
    }

    /// A step takes no more than 0.6 of a period ([`crate::afford`]), so that an ordinary process which waited for a core catches up soon. What it
    /// skips beyond that is in the step after it ([`moved_s`]).
    fn backlog(&self) -> u64 {
        2
    }

    fn interests(&self) -> Vec<(Role, Wanted)> {
        vec![
            (Role::Hardware, Wanted::Page),
            (Role::Tissue, Wanted::Stream(Kind::TissueState)),
            (Role::Tissue, Wanted::Stream(Kind::Topology)),
        ]
    }

    fn initial(&mut self, header: StreamHeader, state: &mut [u8]) -> Result<(), Failure> {
        self.seals.clear();
        self.gaze = None;
        self.write(header, self.told(self.step_ticks.get(), FluidStatus::default()), state)
    }

    fn accepts(&self, state: &[u8]) -> bool {
        let Ok(message) = Message::parse(state, Kind::FluidState) else { return false };
        self.has_sections(&message)
            && message.record::<Head>(0).is_ok_and(|head| is_of(&head.status, message.header()))
            && has_sane_numbers(&message)
    }

    /// One of another grid has other sections.
    fn why_refused(&self, state: &[u8]) -> Refusal {
        let Ok(message) = Message::parse(state, Kind::FluidState) else { return Refusal::Unreadable };
        match () {
            () if !self.has_sections(&message) => Refusal::Sections,
            () if !has_sane_numbers(&message) => Refusal::Numbers,
            () => Refusal::OtherTick,
        }
    }

    /// The tissue's state that the sequencer has seen finished, or that it was refused; and the hardware's sample of this tick.
    fn is_supplied(&mut self, _tick: u64, next_tick: u64) -> bool {
        self.receive();
        let tissue_tick = self.life.clock.page().load64(station::TISSUE_TICK);
        self.tissues.have_reached(tissue_tick) && self.heard.newest_tick() == Some(next_tick)
    }

    /// Where the newest state of the tissue is refused the one before is in use: a spare that takes the role has the same one as the holder had.
    fn look(&mut self) {
        self.receive();
    }

    fn is_connected(&mut self) -> bool {
        self.receive();
        let lives = |role: Role| self.life.clock.occupied(role).any(|(slot, _)| !self.life.clock.is_dead(slot));
        (self.heard.is_connected() || !lives(Role::Hardware)) && (self.tissues.newest().is_some() || !lives(Role::Tissue))
    }

    fn step(&mut self, context: &StepContext, now: &[u8], next: &mut [u8]) -> Result<(), Failure> {
        let broken = |error: hyst_flow::FlowError| Failure::Broken(error.to_string());
        let message = Message::parse(now, Kind::FluidState)?;
        let key = (message.header().epoch, message.header().tick, message.header().incarnation);
        if self.holds != Some(key) {
            self.crew.solver().load(message.section(1)?).map_err(broken)?;
        }
        self.seals.load(&message)?;
        self.holds = None; // until this step has ended
        self.flaws = 0;
        let before = StateView::framed(message.section(1)?).map_err(broken)?;
        let input_tick = self.update_walls(message.header().input_tick, before.mask())?;
        let inputs = self.inputs(moved_s(message.header(), context));
        let mut report = self.crew.step(&inputs)?;
        report.pump.alarms = report.pump.alarms_after(&alarms_of(&message.record::<Head>(0)?.status));
        let (pump, _) = self.crew.solver().counters().map_err(broken)?;
        let mut status = self.told(context.step_ticks, status_of(&report, &pump));
        status.flaws |= self.flaws;
        let on_scope_n = self.instrument.felt_n(&inputs, &report);
        let header = StreamHeader { input_tick, ..*message.header() };
        self.write(header, FluidStatus { state_tick: context.next_tick, on_scope_n, ..status }, next)
    }

    fn finished(&mut self, context: &StepContext, state: &[u8]) {
        self.holds = Some((context.tenure.epoch, context.next_tick, self.life.incarnation));
        let state_hash = if self.life.is_lockstep() { hash_of(state) } else { 0 };
        let (epoch, incarnation) = (context.tenure.epoch, context.tenure.incarnation);
        let mut told = FluidStatus { epoch, incarnation, state_hash, ..self.status };
        self.lies.tell(self.life, &mut told);
        let page = &self.life.page;
        page.write(fluid::STATUS, &told);
        let sections = self.sections();
        // The solver computes in its own layered fields; its block, density and gas are then copied into the loan.
        page.add64(header::COPIED_BYTES, (sections[1] + sections[2] + sections[3]) as u64);
    }

    fn arrival(&mut self, arrival: Arrival, inbox: &mut Inbox) {
        let index = arrival.slot.index();
        let before = match (arrival.slot.role(), arrival.port) {
            (Role::Hardware, UsherPort::Page(page)) => self.heard.replace(page).map(Departure::Page),
            (Role::Tissue, UsherPort::Stream(kind, stream)) => self.tissues.replace(index, kind, stream),
            _ => None,
        };
        if let Some(before) = before {
            inbox.retire(before);
        }
    }
}
