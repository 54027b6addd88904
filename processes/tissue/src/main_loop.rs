//! The Main Loop, in the paper's order (Tuchschmid et al. 2006, section 3.1): rigid objects and their points, collision, response,
//! deformation with the visual surface in the same step, forces to the device, synchronization with the slower engines. It reads the state of
//! t and writes the state of t + step straight into shared memory.
//!
//! A step depends on the state of t and on the input record that the device published for the tick before t, and on nothing else; so a
//! substitute computes the same bits.

mod cutting;
mod grasping;
mod hand;
mod medium;
mod telling;
#[cfg(test)]
mod tests;

use crate::afford::{LONGEST_STEP, affordable_step};
use crate::clerk::Clerk;
use crate::collision::Collision;
use crate::contacts::{Contacts, LAW};
use crate::grasp::Grasp;
use crate::knife::Knife;
use crate::site::SiteManager;
use crate::state::{Core, flaw_of, hash, is_sound, is_sound_own, most_bytes, sections, stuck_of, write_body};
use crate::through::Passage;
use crate::world::{Workshop, World};
pub(crate) use cutting::fit;
use hyst_contact::PlaneSet;
use hyst_engine::{Failure, Helper, Lies, Life, Stateful, StepContext};
use hyst_exchange::usher::{Arrival, Departure, Inbox, Port, Wanted};
use hyst_exchange::{Links, ReadPage, Roster, system};
use hyst_messages::page::{device, header, station, tissue};
use hyst_messages::stream::message_bytes;
use hyst_messages::{
    BUTTON_ENERGIZED, ContactModel, Kind, Message, MessageMut, Pose, Refusal, Role, StepRecord, StreamHeader, TissueStatus,
};
use hyst_tissue::{BoundSurface, Scratch, StateMut, StateRef, StepInput, step, surface_update};
use medium::medium_forces;
use std::cell::Cell;
use std::sync::Arc;

/// The engine.
pub struct MainLoop<'a> {
    life: &'a Life,
    workshop: Workshop,
    world: Arc<World>,
    site: SiteManager,
    knife: Knife,
    grasp: Grasp,
    /// Whether a cut was refused, which is said once.
    has_refused: bool,
    /// Whether a cut met a limit of the mesh, likewise.
    has_met_limit: bool,
    /// Most substeps of 1 ms that a world of this life asked for.
    most_substeps: u32,
    scratch: Scratch,
    surface: BoundSurface,
    contacts: Contacts,
    collision: Collision,
    clerk: Option<Clerk>,
    device: Option<ReadPage>,
    points_m: Vec<[f32; 3]>,
    pressure_pa: Vec<f32>,
    step_ticks: Cell<u64>,
    /// Somebody asked for this step.
    is_asked: bool,
    planes: PlaneSet,
    status: TissueStatus,
    lies: Lies,
}

impl<'a> MainLoop<'a> {
    /// An engine for the world of a scene, and for those that cuts make of it.
    pub fn new(life: &'a Life, workshop: Workshop, world: World) -> Result<MainLoop<'a>, Failure> {
        let contacts = Contacts::new(&world);
        // In lock-step the step must not depend on the machine.
        let default = if life.is_lockstep() { 1.0 } else { 0.0 };
        let asked = life.settings.number("tissue_step_ticks", default, 0.0..=4.0, "1, 2 or 4")? as u64;
        if asked == 3 {
            return Err(Failure::Input("--set tissue_step_ticks=3: expected 1, 2 or 4".into()));
        }
        let mut site = SiteManager::default();
        site.register_objects(&world.objects);
        let engine = MainLoop {
            life,
            workshop,
            site,
            knife: Knife::default(),
            grasp: Grasp::default(),
            has_refused: false,
            has_met_limit: false,
            most_substeps: world.model.substeps(1e-3),
            scratch: Scratch::new(&world.model),
            surface: BoundSurface::new(&world.body.skin.bindings, world.model.tets()),
            collision: Collision::new(life, &world)?,
            contacts,
            clerk: None,
            device: None,
            points_m: vec![[0.0; 3]; world.points.len()],
            pressure_pa: vec![0.0; world.wall.len()],
            step_ticks: Cell::new(asked.max(1)),
            is_asked: asked > 0,
            planes: PlaneSet::default(),
            status: TissueStatus::default(),
            lies: Lies::new(life, size_of::<ContactModel>()),
            world: Arc::new(world),
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

    /// Whether a state was computed from the input that it names: one that stands still while its stamp goes on was not. What is older than
    /// the device's ring cannot be known.
    fn is_of_its_input(&self, message: &Message<'_>) -> bool {
        let Ok(core) = message.record::<Core>(0) else { return false };
        let tick = Some(message.header().input_tick).filter(|tick| *tick > 0); // 0 names none
        let named = self.device.as_ref().and_then(|page| page.ring(device::INPUTS, tick?)).filter(hand::is_fit);
        core.is_sane() && named.is_none_or(|input| input.sample.pose.hash() == core.pose.hash())
    }

    fn first_core(&self) -> Core {
        let (rest, case) = (&self.world.case.rest, &self.world.case);
        Core {
            pose: Pose {
                position_m: rest.tip_m(case.pivot_m),
                orientation: rest.orientation(),
                insertion_m: rest.insertion_m,
                ..Pose::default()
            },
            pressure_pa: case.rest_pressure_pa,
            ..Core::default()
        }
    }
}

impl Stateful for MainLoop<'_> {
    fn kind(&self) -> Kind {
        Kind::TissueState
    }

    fn message_bytes(&self) -> usize {
        most_bytes(&self.world)
    }

    /// As many as the state before has, unless something may be cut: that is settled here, and a record that comes before the step cuts in the one after it.
    fn next_bytes(&self, now: &[u8]) -> usize {
        let energized = self.input_of(now).is_some_and(|input| input.sample.controls.buttons & BUTTON_ENERGIZED != 0);
        let is_of_world =
            Message::parse(now, Kind::TissueState).is_ok_and(|now| now.header().topology_version == self.world.version);
        if energized || !is_of_world { self.message_bytes() } else { message_bytes(&sections(&self.world, 0)) }
    }

    fn step_ticks(&self) -> u64 {
        self.step_ticks.get()
    }

    fn take_step(&self, step_ticks: u64) {
        if matches!(step_ticks, 1 | 2 | 4) {
            self.step_ticks.set(step_ticks);
        }
    }

    fn lengthen(&self) {
        if !self.is_asked {
            self.step_ticks.set((2 * self.step_ticks.get()).min(LONGEST_STEP));
        }
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
        self.collision.open(self.life, links, &self.world)?;
        self.clerk = Some(Clerk::start(self.life, links, Arc::clone(&self.world))?);
        Ok(())
    }

    fn helpers(&self) -> Vec<Helper> {
        self.clerk.iter().map(Clerk::helper).collect()
    }

    fn initial(&mut self, header: StreamHeader, state: &mut [u8]) -> Result<(), Failure> {
        let world = &self.world;
        let header = StreamHeader { topology_version: world.version, ..header };
        let parts = MessageMut::format(state, Kind::TissueState, header, &sections(world, 0))?.split();
        let [core, positions, velocities, surface, memory, body, _, grasp, stuck, ..] = parts;
        core.copy_from_slice(bytemuck::bytes_of(&self.first_core()));
        let positions: &mut [[f32; 3]] = bytemuck::cast_slice_mut(positions);
        positions.copy_from_slice(world.model.rest_m());
        velocities.fill(0);
        memory.fill(0);
        grasp.fill(0);
        stuck.fill(0);
        body.copy_from_slice(bytemuck::cast_slice(&world.words));
        surface_update(&world.body.skin.bindings, world.model.tets(), positions, bytemuck::cast_slice_mut(surface));
        Ok(())
    }

    fn accepts(&self, state: &[u8]) -> bool {
        let Ok(message) = Message::parse(state, Kind::TissueState) else { return false };
        is_sound(&message, &self.world) && self.is_of_its_input(&message)
    }

    fn accepts_own(&self, state: &[u8]) -> bool {
        let Ok(message) = Message::parse(state, Kind::TissueState) else { return false };
        is_sound_own(&message, &self.world) && self.is_of_its_input(&message)
    }

    fn why_refused(&self, state: &[u8]) -> Refusal {
        let Ok(message) = Message::parse(state, Kind::TissueState) else { return Refusal::Unreadable };
        let is_sane = message.record::<Core>(0).is_ok_and(|core| core.is_sane());
        flaw_of(&message, &self.world).unwrap_or(if is_sane { Refusal::Input } else { Refusal::Numbers })
    }

    /// The input record of the tick before, or the one that a replay names, if the device made it.
    fn is_supplied(&mut self, tick: u64, _next_tick: u64) -> bool {
        let page = self.life.clock.page();
        let mut wanted = tick.saturating_sub(1);
        if self.life.is_replay() {
            self.step_ticks.set(page.load64(station::REPLAY_STEP_TICKS).clamp(1, LONGEST_STEP));
            wanted = page.load64(station::REPLAY_INPUT_TICK);
        }
        // What the device made before a replay began is in no ring of this station.
        if wanted <= self.life.settings.replay.map_or(0, |replay| replay.begin_tick) {
            return true;
        }
        let made = page.load64(station::INPUT_TICK);
        made < wanted || self.device.as_ref().is_some_and(|page| page.ring(device::INPUTS, wanted).is_some())
    }

    fn prepare(&mut self, newest: &[u8]) -> Result<(), Failure> {
        let message = Message::parse(newest, Kind::TissueState)?;
        self.adopt(&message)?;
        if message.record::<Core>(0).is_ok_and(|core| core.closed > 0.0) {
            self.world.shut_n();
        }
        Ok(())
    }

    fn step(&mut self, context: &StepContext, now: &[u8], next: &mut [u8]) -> Result<(), Failure> {
        let begun_ns = system::now_ns();
        let message = Message::parse(now, Kind::TissueState)?;
        self.adopt(&message)?;
        let before: Core = message.record(0)?;
        let (positions, velocities): (&[[f32; 3]], &[[f32; 3]]) = (message.section(1)?, message.section(2)?);
        let hand = self.hand(context, &before, next.len());
        let [stood, stands] = self.stands(&message, &before, &hand, positions)?;
        // Deformation pauses where something is cut, and goes on from what is left. The workers have the mesh that it was until then.
        let change = self.change(&message, &hand, (positions, velocities))?;
        let context = &StepContext { holding: context.holding && !change.is_any(), ..*context };
        let (positions, velocities) = if change.is_cut { self.knife.moved() } else { (positions, velocities) };
        let world = &*self.world;
        let spared = self.grasp.keep_tissue(world);
        let header = StreamHeader { input_tick: hand.input_tick, topology_version: world.version, ..*message.header() };
        let sections = sections(world, self.knife.stroke_bytes());
        let [core, next_positions, next_velocities, surface, memory, body, next_stroke, next_grasp, next_stuck, ..] =
            MessageMut::format(next, Kind::TissueState, header, &sections)?.split();
        write_body(&world.words, body);
        self.knife.write_stroke(next_stroke);
        memory.copy_from_slice(message.section::<u8>(4)?);

        // Rigid objects and their points, those of tissue that may meet other tissue, then the intersection test.
        let (tool, rest) = (&world.case.tool, &world.body.rest.positions_m[..]);
        world.points.place(tool, (&hand.pose, stands), (positions, rest), &mut self.points_m);
        let job = self.collision.hash(context, &self.points_m, &world.points, world.case.cell_m)?;
        self.collision.test(self.life, context, job, &self.points_m, world, positions)?;
        let tested_ns = system::now_ns();

        // Response: contacts as springs for the deformation, the fluid's pressure as forces or as a law.
        let (table, dt_s, hits) = (self.collision.table()?, context.step_ticks as f32 * 1e-3, self.collision.hits());
        let tool = hand.motion(world, (&self.points_m, &spared), (&before.pose, stood, message.header().input_tick), dt_s);
        let passage = Passage { hash: &table, velocities_m_s: velocities, dt_s };
        self.contacts.meet(world, hits, (&tool, &passage), positions, (bytemuck::cast_slice_mut(memory), stuck_of(&message)))?;
        self.grasp.act(world, hits, ([&before.pose, &hand.pose], tool.since_s), next_grasp);
        let (medium, nodes) = ((&before, hand.draw.as_ref()), (positions, velocities));
        let pressure = medium_forces(world, medium, nodes, dt_s, &mut self.pressure_pa, self.contacts.node_force_n());
        let answered_ns = system::now_ns();

        // Deformation of all objects, and the surfaces for the eye.
        let next_positions: &mut [[f32; 3]] = bytemuck::cast_slice_mut(next_positions);
        let from = StateRef { position_m: positions, velocity_m_s: velocities };
        let input = StepInput {
            external_force_n: self.contacts.forces_n(),
            springs: self.contacts.springs(),
            pairs: self.contacts.pairs(),
            holds: self.grasp.holds(),
            attachments: &world.attachments,
            pressure,
            law: LAW,
            dt_s,
            ..StepInput::default()
        };
        let to = StateMut { position_m: next_positions, velocity_m_s: bytemuck::cast_slice_mut(next_velocities) };
        let report = step(&world.model, &mut self.scratch, from, &input, to).map_err(|why| Failure::Broken(why.to_string()))?;
        let deformed_ns = system::now_ns();
        self.scratch.move_surface(&self.surface, bytemuck::cast_slice_mut(surface));

        // Forces to the device.
        let after = StateRef { position_m: next_positions, velocity_m_s: bytemuck::cast_slice(next_velocities) };
        let kept = (bytemuck::cast_slice_mut(memory), bytemuck::cast_slice_mut(next_stuck));
        let (planes, force_n) = self.contacts.planes(world, &table, (&tool, self.grasp.holds()), kept, &after, &self.scratch)?;
        self.planes = planes;
        let core_now = hand.core(&before, force_n, (self.contacts.count(), self.grasp.held()), (&change, &report));
        core.copy_from_slice(bytemuck::bytes_of(&core_now));
        let times_ns = [begun_ns, tested_ns, answered_ns, deformed_ns, system::now_ns()];
        self.account(&core_now, before.pressure_pa, report.substeps, times_ns);
        Ok(())
    }

    fn finished(&mut self, context: &StepContext, state: &[u8]) {
        let Ok(message) = Message::parse(state, Kind::TissueState) else { return };
        self.publish_model(context, &message);
        let page = &self.life.page;
        self.status.state_tick = context.next_tick;
        self.status.state_hash = hash(&message);
        self.status.step_ticks = context.step_ticks as u32;
        self.status.topology_version = message.header().topology_version;
        page.write(tissue::STATUS, &self.status);
        // What nobody goes on from, because it is computed beside the role, is nobody's step.
        if context.tenure.epoch > 0 {
            let step = StepRecord {
                tick: context.next_tick,
                state_hash: self.status.state_hash,
                input_tick: message.header().input_tick,
                from_tick: context.tick,
                from_incarnation: context.state_writer,
                epoch: context.tenure.epoch,
                incarnation: self.life.incarnation,
                step_ticks: context.step_ticks as u32,
            };
            page.push(tissue::STEPS, step.tick, &step);
        }
        page.store64(header::COPIED_BYTES, page.load64(header::COPIED_BYTES) + self.collision.copied_bytes());
    }

    fn finished_beside(&mut self, context: &StepContext, state: &[u8]) {
        if let Ok(message) = Message::parse(state, Kind::TissueState) {
            self.publish_model(context, &message);
        }
    }

    fn arrival(&mut self, arrival: Arrival, inbox: &mut Inbox) {
        let is_registered = self.site.register_engine(arrival.slot, arrival.incarnation);
        self.status.objects = self.site.present();
        self.status.engines = self.site.engines();
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
