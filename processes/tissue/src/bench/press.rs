//! A Main Loop step without its station: the same parts in the same order on the same model, while the scripted hand presses into the wall
//! and comes out again. Only the carriers differ: own memory instead of the exchange, threads instead of collision workers.

use crate::contacts::{self, Contacts, Stuck, ToolMotion};
use crate::through::Passage;
use crate::tool::Stand;
use crate::world::{Otherwise, Workshop, World};
use hyst_contact::{
    Cull, HashMut, HashRef, HashSizes, Hit, Layout, Memory, PlaneSet, Points, Share, Split, Tissue, intersect, intersect_brute,
    merge,
};
use hyst_exchange::synchronized::{SharedWork, SynchronizedThreads};
use hyst_exchange::system;
use hyst_messages::Pose;
use hyst_scene::{LoadedHand, LoadedScene};
use hyst_tissue::{BoundSurface, Isa, Scratch, StateMut, StateRef, StepInput, pressure_forces, step};
use parking_lot::{Mutex, RwLock};
use std::sync::Arc;

/// Parts of a step, in the order of the Main Loop.
pub const PHASES: [&str; 6] = ["hash", "intersection", "response", "deformation", "surface", "planes"];
/// Indices of [`PHASES`].
pub const INTERSECTION: usize = 1;
/// Index of the deformation.
pub const DEFORMATION: usize = 3;
/// Step, s, as the Main Loop's shortest.
const DT_S: f32 = 1e-3;
/// Most steps of a run: two of the longest presses that the built-in hands make.
const MAX_STEPS: usize = 8_000;
/// Passes of brute force and of the bare pass, of which the fastest counts.
const PASSES: usize = 7;

/// What the threads of the intersection test share.
struct Shared {
    world: World,
    input: RwLock<Input>,
    shares: Vec<Mutex<(Vec<Hit>, usize, Cull)>>,
    /// Whether each share looks for the tets near points among all of them in each step, and does not remember them as in the station.
    searches: bool,
}

struct Input {
    positions_m: Vec<[f32; 3]>,
    table: Vec<u32>,
}

impl SharedWork for Shared {
    fn step(&self, _phase: u32, index: usize, count: usize) {
        let input = self.input.read();
        let mut share = self.shares[index].lock();
        let (hits, found, cull) = &mut *share;
        let part = Share { index: index as u32, count: count as u32, split: Split::Tets };
        let (points, tissue) =
            (self.world.points.view(&self.world.body.rest.positions_m), contacts::tissue(&self.world, &input.positions_m));
        let cull = if self.searches { cull } else { cull.of(self.world.version) };
        let tested = HashRef::in_words(&input.table).and_then(|hash| intersect(part, &hash, &points, &tissue, cull, hits));
        *found = tested.map_or(0, |found| found.count);
    }
}

/// What a run measured.
#[derive(Default)]
pub struct Record {
    /// Time of each phase in each step, ns.
    pub phases_ns: [Vec<u64>; PHASES.len()],
    /// Substeps of a step.
    pub substeps: u32,
    /// Most contacts in a step.
    pub contacts: usize,
    /// What the tool felt after the last step, N, wherever it acts.
    pub force_n: [f32; 3],
    /// What the hand is told then, N: the force of the planes at the tip.
    pub told_n: [f32; 3],
    /// Elastic energy before the last step, J.
    #[cfg(test)]
    pub energy_j: f64,
}

impl Record {
    /// Time of each step, ns, counting the phases that are chosen.
    pub fn steps_ns(&self, counts: impl Fn(usize) -> bool) -> Vec<u64> {
        let sum = |step: usize| (0..PHASES.len()).filter(|phase| counts(*phase)).map(|phase| self.phases_ns[phase][step]).sum();
        (0..self.phases_ns[0].len()).map(sum).collect()
    }

    /// Time of a phase in all steps, ns.
    pub fn total_ns(&self, phase: usize) -> u64 {
        self.phases_ns[phase].iter().sum()
    }
}

/// Model, state and buffers of a run.
pub struct Press {
    /// Steps of a tick, and ticks of a step.
    finer: usize,
    step_ticks: usize,
    shared: Arc<Shared>,
    threads: SynchronizedThreads<Shared>,
    hand: Option<LoadedHand>,
    scratch: Scratch,
    surface: BoundSurface,
    contacts: Contacts,
    planes: PlaneSet,
    sizes: HashSizes,
    hits: Vec<Hit>,
    memory: Vec<Memory>,
    stuck: Vec<Stuck>,
    pressure_pa: Vec<f32>,
    points_m: Vec<[f32; 3]>,
    velocities_m_s: Vec<[f32; 3]>,
    next_m: Vec<[f32; 3]>,
    next_m_s: Vec<[f32; 3]>,
    surface_m: Vec<[f32; 3]>,
}

/// An error as a bench says it.
pub fn text(error: impl std::fmt::Display) -> String {
    error.to_string()
}

impl Press {
    /// At rest; the intersection test is shared among `threads` threads, the caller's included.
    pub fn new(scene: &LoadedScene, isa: Isa, threads: usize) -> Result<Press, String> {
        Press::with(scene, isa, threads, Otherwise::default())
    }

    /// The same with a test that looks for the tets near points among all of them in each step.
    pub fn searching(scene: &LoadedScene, isa: Isa, threads: usize) -> Result<Press, String> {
        Press::with(scene, isa, threads, Otherwise { searches: true, ..Otherwise::default() })
    }

    /// The same with what is not as in the station.
    pub fn with(scene: &LoadedScene, isa: Isa, threads: usize, otherwise: Otherwise) -> Result<Press, String> {
        let (_, world) = Workshop::open_other(scene, isa, otherwise).map_err(text)?;
        Press::of(world, scene, threads, otherwise)
    }

    /// The same of a world that was made of a scene so, whatever has been cut of it.
    pub fn of(world: World, scene: &LoadedScene, threads: usize, otherwise: Otherwise) -> Result<Press, String> {
        let Otherwise { finer, step_ticks, stiffer, searches, .. } = otherwise;
        let (points, nodes, tets) = (world.points.len(), world.model.node_count(), world.model.tets().len());
        let contacts = Contacts::stiffer(&world, stiffer);
        let room = contacts::max_hits(&world);
        let sizes = world.points.table_sizes();
        let input = Input { positions_m: world.model.rest_m().to_vec(), table: vec![0; sizes.words()] };
        let shared = Arc::new(Shared {
            input: RwLock::new(input),
            shares: (0..threads)
                .map(|_| Mutex::new((vec![Hit::default(); room], 0, Cull::remembering(nodes, tets, points))))
                .collect(),
            world,
            searches,
        });
        Ok(Press {
            finer: finer.max(1) as usize,
            step_ticks: step_ticks.max(1) as usize,
            threads: SynchronizedThreads::new(Arc::clone(&shared), threads, "share").map_err(text)?,
            hand: scene.hand("press").cloned(),
            scratch: Scratch::new(&shared.world.model),
            surface: BoundSurface::new(&shared.world.body.skin.bindings, shared.world.model.tets()),
            contacts,
            planes: PlaneSet::default(),
            sizes,
            hits: vec![Hit::default(); room],
            memory: vec![Memory::default(); shared.world.points.tool],
            stuck: vec![Stuck::default(); nodes],
            pressure_pa: vec![0.0; shared.world.wall.len()],
            points_m: vec![[0.0; 3]; points],
            velocities_m_s: vec![[0.0; 3]; nodes],
            next_m: vec![[0.0; 3]; nodes],
            next_m_s: vec![[0.0; 3]; nodes],
            surface_m: vec![[0.0; 3]; shared.world.body.skin.bindings.len()],
            shared,
        })
    }

    /// Number of tets.
    pub fn tets(&self) -> usize {
        self.shared.world.model.tets().len()
    }

    /// Substeps of a step.
    pub fn substeps(&self) -> u32 {
        self.shared.world.model.substeps(f64::from(DT_S) * self.step_ticks as f64 / self.finer as f64)
    }

    /// Number of points: of the shaft, and of tissue; the loop stays in its sheath.
    pub fn points(&self) -> [usize; 2] {
        [self.shared.world.case.tool.shaft, self.points_m.len() - self.shared.world.points.tool]
    }

    /// What the hand does.
    pub fn hand(&self) -> &'static str {
        if self.hand.is_some() { "press" } else { "at rest (the scene has no hand `press`)" }
    }

    fn pose(&self, tick: usize) -> Pose {
        let world = &self.shared.world;
        let pose = self.hand.as_ref().map_or(world.case.rest, |hand| hand.pose_at(tick as f64 * f64::from(DT_S)));
        world.case.pose_of(&pose)
    }

    /// One period of the hand from where the tissue is, or as much of it as fits into the time.
    pub fn run(&mut self, budget_ns: u64) -> Result<Record, String> {
        self.run_beside(budget_ns, |_| Ok(()))
    }

    /// The same with something else after each step, which takes its time from the same.
    pub fn run_beside(&mut self, budget_ns: u64, mut each: impl FnMut(&Press) -> Result<(), String>) -> Result<Record, String> {
        let period_s = self.hand.as_ref().map_or(1.0, |hand| hand.period_s);
        let steps = ((period_s / f64::from(DT_S)).ceil() as usize).clamp(1, MAX_STEPS);
        let mut record = Record::default();
        for of_phase in &mut record.phases_ns {
            of_phase.reserve(steps);
        }
        let begun_ns = system::now_ns();
        for tick in 0..steps {
            self.tick(tick, &mut record)?;
            each(self)?;
            if system::now_ns() - begun_ns > budget_ns {
                break;
            }
        }
        Ok(record)
    }

    /// Where the nodes are, m.
    pub fn positions_m(&self) -> Vec<[f32; 3]> {
        self.shared.input.read().positions_m.clone()
    }

    /// Where they are at rest, m.
    pub fn rest_m(&self) -> &[[f32; 3]] {
        self.shared.world.model.rest_m()
    }

    /// Whether a step begins in a tick.
    pub fn has_step(&self, tick: usize) -> bool {
        tick.is_multiple_of(self.step_ticks)
    }

    /// One tick of the hand, in so many steps as it was made for; where none begins the hand is told what the planes of the last one are where the tip is now.
    pub fn tick(&mut self, tick: usize, record: &mut Record) -> Result<(), String> {
        if !self.has_step(tick) {
            record.told_n = self.planes.force_n(self.pose(tick).position_m);
            return Ok(());
        }
        (0..self.finer).try_for_each(|_| self.step(tick, record))
    }

    fn step(&mut self, tick: usize, record: &mut Record) -> Result<(), String> {
        let shared = Arc::clone(&self.shared);
        let world = &shared.world;
        let (pose, before) = (self.pose(tick), self.pose(tick.saturating_sub(self.step_ticks)));
        let since_s = DT_S * self.step_ticks as f32;
        let mut laps = Laps { last_ns: system::now_ns(), phase: 0, record };
        {
            let mut input = shared.input.write();
            let places = (&input.positions_m[..], &world.body.rest.positions_m[..]);
            world.points.place(&world.case.tool, (&pose, Stand::default()), places, &mut self.points_m);
            let mut hash = HashMut::in_words(&mut input.table, self.sizes).map_err(text)?;
            hash.build(&self.points_m, world.case.cell_m, Layout::Auto).map_err(text)?;
        }
        laps.lap();

        self.threads.run(tick as u32);
        let input = shared.input.read();
        let found = self.merge(&input.positions_m);
        laps.lap();

        let tool = ToolMotion {
            points_m: &self.points_m,
            before: (&before, Stand::default()),
            since_s,
            way_share: 1.0 / self.finer as f32,
            tip_m: pose.position_m,
            back: std::array::from_fn(|axis| world.case.pivot_m[axis] - pose.position_m[axis]),
            orientation: pose.orientation,
            spared: &[],
            soft_m: 0.0,
        };
        let (positions_m, velocities_m_s, hits) = (&input.positions_m, &self.velocities_m_s, &self.hits[..found]);
        let (table, dt_s) = (HashRef::in_words(&input.table).map_err(text)?, since_s / self.finer as f32);
        let passage = Passage { hash: &table, velocities_m_s, dt_s };
        self.contacts.meet(world, hits, (&tool, &passage), positions_m, (&mut self.memory, &self.stuck)).map_err(text)?;
        pressure_forces(&world.wall, positions_m, &self.pressure_pa, self.contacts.node_force_n());
        laps.lap();

        let from = StateRef { position_m: positions_m, velocity_m_s: velocities_m_s };
        let forces = StepInput {
            external_force_n: self.contacts.forces_n(),
            springs: self.contacts.springs(),
            pairs: self.contacts.pairs(),
            attachments: &world.attachments,
            law: contacts::LAW,
            dt_s,
            ..StepInput::default()
        };
        let to = StateMut { position_m: &mut self.next_m, velocity_m_s: &mut self.next_m_s };
        let report = step(&world.model, &mut self.scratch, from, &forces, to).map_err(text)?;
        laps.lap();
        self.scratch.move_surface(&self.surface, &mut self.surface_m);
        laps.lap();
        let after = StateRef { position_m: &self.next_m, velocity_m_s: &self.next_m_s };
        let sticks = (&mut self.memory[..], &mut self.stuck[..]);
        (self.planes, laps.record.force_n) =
            self.contacts.planes(world, &table, (&tool, &[]), sticks, &after, &self.scratch).map_err(text)?;
        laps.lap();
        laps.record.told_n = self.planes.force_n(pose.position_m);
        drop(input);
        record.substeps = report.substeps;
        #[cfg(test)]
        {
            record.energy_j = report.elastic_energy_j;
        }
        record.contacts = record.contacts.max(self.contacts.count());
        std::mem::swap(&mut shared.input.write().positions_m, &mut self.next_m);
        std::mem::swap(&mut self.velocities_m_s, &mut self.next_m_s);
        Ok(())
    }

    fn merge(&mut self, positions_m: &[[f32; 3]]) -> usize {
        let tissue = contacts::tissue(&self.shared.world, positions_m);
        let held: Vec<_> = self.shared.shares.iter().map(Mutex::lock).collect();
        let parts: Vec<&[Hit]> = held.iter().map(|share| &share.0[..share.1]).collect();
        merge(&parts, &tissue, &mut self.hits).count
    }

    /// Testing every point against every tet without any table, where the tissue is now, ns: the fastest of a few.
    pub fn brute_ns(&mut self) -> Result<u64, String> {
        let shared = Arc::clone(&self.shared);
        let input = shared.input.read();
        let tissue = contacts::tissue(&shared.world, &input.positions_m);
        let mut least_ns = u64::MAX;
        for _ in 0..PASSES {
            let begun_ns = system::now_ns();
            let points = shared.world.points.view(&shared.world.body.rest.positions_m);
            let found = intersect_brute(&self.points_m, &points, &tissue, &mut self.hits).map_err(text)?;
            let _ = std::hint::black_box(found); // only the time is asked for
            least_ns = least_ns.min(system::now_ns() - begun_ns);
        }
        Ok(least_ns)
    }

    /// Tissue and points as they were tested last, but for the tissue's way since then.
    pub fn tested<T>(&self, look: impl FnOnce(&Tissue<'_>, &Points<'_>, &[[f32; 3]]) -> T) -> T {
        let world = &self.shared.world;
        let input = self.shared.input.read();
        let (tissue, points) = (contacts::tissue(world, &input.positions_m), world.points.view(&world.body.rest.positions_m));
        look(&tissue, &points, &self.points_m)
    }

    /// Mean edge of the tets, m.
    pub fn edge_m(&self) -> f32 {
        self.shared.world.case.edge_m
    }

    /// Reading the corners of every tet once, one after the other by their numbers, ns: the fastest of a few. A yardstick and no bound: what holds the corners
    /// side by side, as the deformation does, may take less.
    pub fn pass_ns(&self) -> u64 {
        let input = self.shared.input.read();
        let tets = self.shared.world.model.tets();
        let pass = || {
            let begun_ns = system::now_ns();
            let mut low = [f32::INFINITY; 3];
            for tet in tets {
                for node in tet {
                    let corner = input.positions_m[*node as usize];
                    low = std::array::from_fn(|axis| low[axis].min(corner[axis]));
                }
            }
            std::hint::black_box(low);
            system::now_ns() - begun_ns
        };
        (0..PASSES * PASSES).map(|_| pass()).min().unwrap_or(1).max(1)
    }
}

struct Laps<'a> {
    last_ns: u64,
    phase: usize,
    record: &'a mut Record,
}

impl Laps<'_> {
    /// Ends a phase.
    fn lap(&mut self) {
        let now_ns = system::now_ns();
        self.record.phases_ns[self.phase].push(now_ns - self.last_ns);
        self.phase += 1;
        self.last_ns = now_ns;
    }
}

#[cfg(test)]
mod tests;
