//! The Main Loop, in the paper's order (Tuchschmid et al. 2006, section 3.1): rigid objects and their points, collision, response,
//! deformation with the visual surface in the same step, forces to the device, synchronization with the slower engines. It reads the state of
//! t and writes the state of t + step straight into shared memory.
//!
//! A step depends on the state of t and on the input record that the device published for the tick before t, and on nothing else; so a
//! substitute computes the same bits.

#[cfg(test)]
mod tests;

use crate::afford::{LONGEST_STEP, affordable_step};
use crate::clerk::Clerk;
use crate::collision::Collision;
use crate::contacts::{Contacts, ToolMotion};
use crate::world::World;
use bytemuck::{Pod, Zeroable};
use hyst_contact::{Memory, PlaneSet};
use hyst_engine::{Failure, Lies, Life, Stateful, StepContext};
use hyst_exchange::usher::{Arrival, Departure, Inbox, Port, Wanted};
use hyst_exchange::{Links, ReadPage, Roster, system};
use hyst_messages::page::{device, header, station, tissue};
use hyst_messages::stream::message_bytes;
use hyst_messages::{
    ContactModel, ContactPlane, InputRecord, Kind, Message, MessageMut, Pose, Role, StreamHeader, TissueStatus, fnv_words,
};
use hyst_tissue::{Scratch, StateMut, StateRef, StepInput, pressure_forces, step, surface_update};
use std::cell::Cell;

/// How far back an input record is looked for when the one for the tick is missing, ticks: as long as the device's own hold and ramp.
const INPUT_REACH: u64 = 22;
/// Distension about the rest shape that the wall follows, Pa. The scene's rest shape is the cavity at its set pressure; farther from it the
/// wall would need the stress-free shape, which no mesh of a distended cavity holds.
const MAX_DISTENSION_PA: f32 = 2_000.0;
/// No node of a patient's organ is farther from the pivot, m.
const FARTHEST_M: f32 = 10.0;
/// And none is faster, m/s.
const MOST_M_S: f32 = 1_000.0;

/// First section of a tissue state.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Core {
    /// The tool in the step that made the state.
    pub pose: Pose,
    /// Velocity of its tip, m/s.
    pub velocity_m_s: [f32; 3],
    /// Force of the tissue on it, N.
    pub force_n: [f32; 3],
    /// Removed so far, ml.
    pub removed_volume_ml: f64,
    /// Pressure in the cavity to be used by the next step, Pa.
    pub pressure_pa: f32,
    /// Contacts in the step.
    pub contact_count: u32,
}

/// Sections of a tissue state, in order: core, positions, velocities, surface vertices, memory of the tool's points.
pub const SECTIONS: usize = 5;

/// The engine.
pub struct MainLoop<'a> {
    life: &'a Life,
    world: World,
    scratch: Scratch,
    contacts: Contacts,
    collision: Collision,
    clerk: Option<Clerk>,
    device: Option<ReadPage>,
    points_m: Vec<[f32; 3]>,
    owner: Vec<u32>,
    pressure_pa: Vec<f32>,
    step_ticks: Cell<u64>,
    planes: PlaneSet,
    status: TissueStatus,
    lies: Lies,
}

impl<'a> MainLoop<'a> {
    /// An engine for a world.
    pub fn new(life: &'a Life, world: World) -> Result<MainLoop<'a>, Failure> {
        let contacts = Contacts::new(&world);
        let points = world.tool.points_m.len();
        let owner = contacts.points().owner.to_vec();
        // In lock-step the step must not depend on the machine.
        let default = if life.is_lockstep() { 1.0 } else { 0.0 };
        let asked = life.settings.number("tissue_step_ticks", default, 0.0..=4.0, "1, 2 or 4")? as u64;
        if asked == 3 {
            return Err(Failure::Input("--set tissue_step_ticks=3: expected 1, 2 or 4".into()));
        }
        let engine = MainLoop {
            life,
            scratch: Scratch::new(&world.model),
            collision: Collision::new(life, &world),
            contacts,
            clerk: None,
            device: None,
            points_m: vec![[0.0; 3]; points],
            owner,
            pressure_pa: vec![0.0; world.wall.len()],
            step_ticks: Cell::new(asked.max(1)),
            planes: PlaneSet::default(),
            status: TissueStatus::default(),
            lies: Lies::new(life, size_of::<ContactModel>()),
            world,
        };
        if asked == 0 {
            let has_begun = Roster::open(&life.station)?.holder(Role::Tissue).epoch > 0;
            // A session that has begun goes on with the step of its states, also where the machine is busier now than it was.
            let step = affordable_step(&engine.world).or_else(|error| if has_begun { Ok(LONGEST_STEP) } else { Err(error) })?;
            engine.step_ticks.set(step);
            life.say(&format!("steps of {} ms", engine.step_ticks.get()));
        }
        Ok(engine)
    }

    fn sections(&self) -> [usize; SECTIONS] {
        let nodes = self.world.model.node_count();
        [
            size_of::<Core>(),
            nodes * 12,
            nodes * 12,
            self.world.bindings.len() * 12,
            self.world.tool.points_m.len() * size_of::<Memory>(),
        ]
    }

    /// The input for the step from `tick`: the record of the tick before, or the newest one within reach.
    fn input(&self, tick: u64) -> Option<InputRecord> {
        let page = self.device.as_ref()?;
        (1..=INPUT_REACH).find_map(|back| page.ring(device::INPUTS, tick.checked_sub(back)?))
    }

    /// Whether a state was computed from the input that it names: one that stands still while its stamp goes on was not. What is older than
    /// the device's ring cannot be known.
    fn is_of_its_input(&self, message: &Message<'_>) -> bool {
        let Ok(core) = message.record::<Core>(0) else { return false };
        let named = self.device.as_ref().and_then(|page| page.ring(device::INPUTS, message.header().input_tick));
        let finite = core.removed_volume_ml.is_finite() && core.pressure_pa.is_finite();
        finite && named.is_none_or(|input| input.sample.pose.hash() == core.pose.hash())
    }

    fn first_core(&self) -> Core {
        let rest = &self.world.rest;
        Core {
            pose: Pose {
                position_m: rest.tip_m(self.world.pivot_m),
                orientation: rest.orientation(),
                insertion_m: rest.insertion_m,
                ..Pose::default()
            },
            pressure_pa: self.world.rest_pressure_pa,
            ..Core::default()
        }
    }
}

impl Stateful for MainLoop<'_> {
    fn kind(&self) -> Kind {
        Kind::TissueState
    }

    fn message_bytes(&self) -> usize {
        message_bytes(&self.sections())
    }

    fn step_ticks(&self) -> u64 {
        self.step_ticks.get()
    }

    /// A step takes half a period: who makes up for one is late for many. The hand has moved on.
    fn backlog(&self) -> u64 {
        0
    }

    fn interests(&self) -> Vec<(Role, Wanted)> {
        let registered = [Role::Device, Role::Fluid, Role::Haptic, Role::Rendering, Role::Recorder];
        let mut interests = registered.map(|role| (role, Wanted::Page)).to_vec();
        if self.life.settings.workers > 0 {
            interests.push((Role::CollisionWorker, Wanted::Page));
            interests.push((Role::CollisionWorker, Wanted::Stream(Kind::Contacts)));
        }
        interests
    }

    fn open(&mut self, links: &Links) -> Result<(), Failure> {
        self.collision.open(self.life, links, self.points_m.len())?;
        self.clerk = Some(Clerk::start(self.life, links, &self.world)?);
        Ok(())
    }

    fn initial(&mut self, header: StreamHeader, state: &mut [u8]) -> Result<(), Failure> {
        let sections = self.sections();
        let header = StreamHeader { topology_version: self.world.site.version(), ..header };
        let parts = MessageMut::format(state, Kind::TissueState, header, &sections)?.split();
        let [core, positions, velocities, surface, memory, ..] = parts;
        core.copy_from_slice(bytemuck::bytes_of(&self.first_core()));
        let positions: &mut [[f32; 3]] = bytemuck::cast_slice_mut(positions);
        positions.copy_from_slice(self.world.model.rest_m());
        velocities.fill(0);
        memory.fill(0);
        surface_update(&self.world.bindings, self.world.model.tets(), positions, bytemuck::cast_slice_mut(surface));
        Ok(())
    }

    fn accepts(&self, state: &[u8]) -> bool {
        let Ok(message) = Message::parse(state, Kind::TissueState) else { return false };
        let sections = self.sections();
        let fits = |index: usize| message.section::<u8>(index).is_ok_and(|bytes| bytes.len() == sections[index]);
        if !(0..SECTIONS).all(fits) || message.header().topology_version != self.world.site.version() {
            return false;
        }
        // Without an early end, so that it is a few instructions for each line of memory.
        let within = |index: usize, most: f32| {
            let numbers: &[f32] = message.section(index).unwrap_or(&[]);
            numbers.iter().fold(true, |all, value| all & (value.abs() <= most))
        };
        if !within(1, FARTHEST_M) || !within(2, MOST_M_S) || !self.is_of_its_input(&message) {
            return false;
        }
        if let step @ (1 | 2 | 4) = message.header().step_ticks {
            self.step_ticks.set(step as u64);
        }
        true
    }

    /// The input record of the tick before, if the device made one.
    fn is_supplied(&mut self, tick: u64, _next_tick: u64) -> bool {
        let Some(wanted) = tick.checked_sub(1).filter(|wanted| *wanted > 0) else { return true };
        let made = self.life.clock.page().load64(station::INPUT_TICK);
        made < wanted || self.device.as_ref().is_some_and(|page| page.ring(device::INPUTS, wanted).is_some())
    }

    fn step(&mut self, context: &StepContext, now: &[u8], next: &mut [u8]) -> Result<(), Failure> {
        let begun_ns = system::now_ns();
        let message = Message::parse(now, Kind::TissueState)?;
        let before: Core = message.record(0)?;
        let (positions, velocities): (&[[f32; 3]], &[[f32; 3]]) = (message.section(1)?, message.section(2)?);
        let input = self.input(context.tick);
        // What the next step uses is part of this state, so that a substitute for it uses the same.
        let told_pa = input.map_or(0.0, |input| input.pressure_pa);
        let next_pressure_pa = if told_pa > 0.0 { told_pa } else { before.pressure_pa };
        let (pose, velocity_m_s) = input.map_or((before.pose, [0.0; 3]), |input| (input.sample.pose, input.sample.velocity_m_s));
        let sections = self.sections();
        let mut header = *message.header();
        header.input_tick = input.map_or(0, |input| input.tick);
        let [core, next_positions, next_velocities, surface, memory, ..] =
            MessageMut::format(next, Kind::TissueState, header, &sections)?.split();
        memory.copy_from_slice(message.section::<u8>(4)?);
        let memory: &mut [Memory] = bytemuck::cast_slice_mut(memory);

        // Rigid objects and their points, then the intersection test.
        self.world.tool.place(&pose, &mut self.points_m);
        let job = self.collision.hash(context, &self.points_m, &self.owner, self.world.cell_m)?;
        let points = hyst_contact::Points { owner: &self.owner, node: &[], self_contact: false };
        self.collision.test(self.life, context, job, (&self.points_m, &points), &self.world, positions)?;
        let tested_ns = system::now_ns();

        // Response: springs for the deformation, friction and the fluid's pressure as forces.
        let pivot = self.world.pivot_m;
        let tool = ToolMotion {
            points_m: &self.points_m,
            velocity_m_s,
            tip_m: pose.position_m,
            back: std::array::from_fn(|axis| pivot[axis] - pose.position_m[axis]),
        };
        self.contacts.meet(&self.world, self.collision.hits(), &tool, positions, velocities, memory)?;
        let distension_pa = before.pressure_pa - self.world.rest_pressure_pa;
        self.pressure_pa.fill(distension_pa.clamp(-MAX_DISTENSION_PA, MAX_DISTENSION_PA));
        pressure_forces(&self.world.wall, positions, &self.pressure_pa, self.contacts.node_force_n());
        let answered_ns = system::now_ns();

        // Deformation of all objects, and the surfaces for the eye.
        let next_positions: &mut [[f32; 3]] = bytemuck::cast_slice_mut(next_positions);
        let state = StateMut { position_m: next_positions, velocity_m_s: bytemuck::cast_slice_mut(next_velocities) };
        let input = StepInput {
            external_force_n: self.contacts.forces_n(),
            targets_m: &[],
            springs: self.contacts.springs(),
            attachments: &self.world.attachments,
            dt_s: context.step_ticks as f32 * 1e-3,
        };
        let from = StateRef { position_m: positions, velocity_m_s: velocities };
        step(&self.world.model, &mut self.scratch, from, &input, state).map_err(|error| Failure::Broken(error.to_string()))?;
        let deformed_ns = system::now_ns();
        surface_update(&self.world.bindings, self.world.model.tets(), next_positions, bytemuck::cast_slice_mut(surface));

        // Forces to the device.
        let (planes, force_n) = self.contacts.planes(&self.world, &self.collision.table()?, &tool, next_positions)?;
        self.planes = planes;
        let core_now = Core {
            pose,
            velocity_m_s,
            force_n,
            removed_volume_ml: before.removed_volume_ml,
            pressure_pa: next_pressure_pa,
            contact_count: self.contacts.count() as u32,
        };
        core.copy_from_slice(bytemuck::bytes_of(&core_now));
        let times_ns = [begun_ns, tested_ns, answered_ns, deformed_ns, system::now_ns()];
        self.status = status_of(self.status, &core_now, before.pressure_pa, self.collision.missing(), times_ns);
        Ok(())
    }

    fn finished(&mut self, context: &StepContext, state: &[u8]) {
        let Ok(message) = Message::parse(state, Kind::TissueState) else { return };
        let mut model = ContactModel {
            epoch: context.tenure.epoch,
            incarnation: self.life.incarnation,
            state_tick: context.next_tick,
            input_tick: message.header().input_tick,
            plane_count: self.planes.count,
            pose_hash: message.record::<Core>(0).map_or(0, |core| core.pose.hash()),
            ..ContactModel::default()
        };
        for (to, from) in model.planes.iter_mut().zip(&self.planes.planes[..self.planes.count as usize]) {
            *to = ContactPlane {
                point_m: from.point_m,
                stiffness_n_m: from.stiffness_n_m,
                normal: from.normal,
                damping_n_s_m: from.damping_n_s_m,
            };
        }
        self.lies.tell(self.life, &mut model);
        let page = &self.life.page;
        page.write(tissue::MODEL, &model);
        self.status.state_tick = context.next_tick;
        self.status.state_hash = state_hash(&message);
        self.status.step_ticks = context.step_ticks as u32;
        page.write(tissue::STATUS, &self.status);
        page.store64(header::COPIED_BYTES, page.load64(header::COPIED_BYTES) + self.collision.copied_bytes());
    }

    fn arrival(&mut self, arrival: Arrival, inbox: &mut Inbox) {
        let is_registered = self.world.site.register_engine(arrival.slot, arrival.incarnation);
        self.status.objects = self.world.site.objects().len() as u32;
        self.status.engines = self.world.site.engines();
        // At once: a spare makes no step that could say whom it knows.
        self.life.page.write(tissue::STATUS, &self.status);
        match (arrival.slot.role(), arrival.port) {
            (Role::Device, Port::Page(page)) if is_registered => {
                if let Some(before) = self.device.replace(page) {
                    inbox.retire(Departure::Page(before));
                }
            }
            (Role::CollisionWorker, port) if is_registered => self.collision.arrival(Arrival { port, ..arrival }, inbox),
            // Whoever else registers asks for his data by himself, or sends them with the input record.
            (_, Port::Page(page)) => {
                inbox.retire(Departure::Page(page));
            }
            (_, Port::Stream(_, stream)) => {
                inbox.retire(Departure::Stream(stream));
            }
            (_, Port::Client(..)) => {}
        }
    }
}

/// The status of a step after the one before; `times_ns`: when it began, and when test, response, deformation and all had ended.
fn status_of(
    before: TissueStatus,
    core: &Core,
    cavity_pressure_pa: f32,
    shares_missing: u32,
    times_ns: [u64; 5],
) -> TissueStatus {
    let us = |part: usize| (times_ns[part + 1] - times_ns[part]) as f32 * 1e-3;
    TissueStatus {
        removed_volume_ml: core.removed_volume_ml,
        cavity_pressure_pa,
        contact_count: core.contact_count,
        tool_force_n: core.force_n,
        shares_missing,
        phase_us: [us(2), us(0), us(1), us(3)],
        ..before
    }
}

/// Hash of what the next step depends on: positions and velocities.
fn state_hash(message: &Message<'_>) -> u64 {
    let words = |index: usize| message.section::<u32>(index).unwrap_or(&[]).iter().map(|word| *word as u64);
    fnv_words(message.header().tick, words(1).chain(words(2)))
}
