//! One step of the Main Loop: the state of t in, the state of t+1 out.
//!
//! Promises: no allocation, no panic, no NaN in the output whatever the input holds; every correction is counted.
//! Rotations are sought once, at the positions of t, and kept for all substeps.

use crate::bed;
use crate::forces::BoundSurface;
use crate::isa::Isa;
use crate::kernel::{self, Constants, Frame, NodeRows, TetSums};
use crate::lanes::Lanes;
use crate::layout::{self, Corners, LANES, Nodes, Row, ShortNodes};
use crate::links::{
    ContactLaw, Grip, Hold, Links, PairSpring, PlaneSpring, Push, READY_MAX, Ready, known, of_hold, of_pair, of_plane,
};
use crate::model::{Model, SUBSTEPS_MAX};
use crate::state::{StateMut, StateRef, StepError, StepInput, StepReport};

/// Largest force per axis that is taken from outside, N: far above any contact, far below the end of single precision.
pub(crate) const EXTERNAL_FORCE_MAX_N: f32 = 1e12;
/// Longest step, s: beyond it nothing about the hand's contact is true any more.
const STEP_MAX_S: f32 = 0.02;

/// Working memory of a step, made once per model. No step depends on what is left in it.
#[derive(Debug, Clone)]
pub struct Scratch {
    position: Vec<Row>,
    velocity: Vec<Row>,
    force: Vec<Row>,
    external: Vec<Row>,
    frames: Vec<Frame>,
    /// Pressures of nodes that hold the volume of tets; none for a model without such.
    bulk: Vec<Row>,
    /// Sum of spring stiffness per node, N/m.
    load_n_m: Vec<f32>,
    /// What was weighed of the springs of the last step, of as many as there is room for.
    ready: Vec<Option<Ready>>,
    /// Substep of the last step, s.
    substep_s: f32,
}

impl Scratch {
    /// Working memory for `model`.
    pub fn new(model: &Model) -> Self {
        let mut scratch = Scratch {
            position: Vec::new(),
            velocity: Vec::new(),
            force: Vec::new(),
            external: Vec::new(),
            frames: Vec::new(),
            bulk: Vec::new(),
            load_n_m: Vec::new(),
            ready: vec![None; READY_MAX],
            substep_s: 0.0,
        };
        scratch.fit(model);
        scratch
    }

    /// Goes on as working memory for another model, with what memory there is: what tets are looked up in is half a MiB twice, or three times where nodes hold
    /// volume, whatever of it a model uses.
    pub fn fit(&mut self, model: &Model) {
        let nodes = model.node_count();
        let (rows, looked_up) = (layout::node_rows(nodes), layout::looked_up_rows(nodes, &model.corners));
        let Scratch { position, velocity, force, external, .. } = self;
        for (part, length) in [(position, looked_up), (velocity, rows), (force, looked_up), (external, rows)] {
            part.resize(length, Row::ZERO);
            part[..rows].fill(Row::ZERO);
        }
        // Frames and what was weighed are written by each step before it reads them.
        self.frames.resize(model.blocks.len(), Frame::ZERO);
        self.bulk.resize(if model.bulk.is_some() { looked_up } else { 0 }, Row::ZERO);
        self.load_n_m.clear();
        self.load_n_m.resize(nodes, 0.0);
        self.substep_s = 0.0;
    }

    /// What a contact that was in the last step does at the state that the step wrote: what the tissue feels of it there, and so what the other side
    /// is to feel. Nothing if the step ignored it.
    pub fn push(&self, model: &Model, law: &ContactLaw, spring: &PlaneSpring, at: &StateRef<'_>) -> Push {
        let ready = self.grip(model, at).and_then(|grip| spring.ready(&grip));
        ready.map_or(Push::default(), |ready| of_plane(&law.sane(), spring, &ready, at.position_m, at.velocity_m_s))
    }

    /// The same for a contact within the model: what its node feels there, of which the tet feels the opposite. `number` is its place among the contacts of
    /// that step, of which those with what is not of the model come first.
    pub fn press(&self, model: &Model, law: &ContactLaw, (number, pair): (usize, &PairSpring), at: &StateRef<'_>) -> Push {
        let grip = self.grip(model, at).filter(|grip| pair.usable(grip.load_n_m.len()));
        let ready = grip.and_then(|grip| known(&self.ready, number, || pair.ready(&grip)));
        ready.map_or(Push::default(), |ready| of_pair(&law.sane(), pair, &ready, at.position_m, at.velocity_m_s))
    }

    /// The same for what was held in the last step.
    pub fn pull(&self, model: &Model, law: &ContactLaw, hold: &Hold, at: &StateRef<'_>) -> Push {
        let ready = self.grip(model, at).and_then(|grip| hold.ready(&grip));
        ready.map_or(Push::default(), |ready| of_hold(&law.sane(), hold, &ready, at.position_m, at.velocity_m_s))
    }

    /// Moves a surface that is bound to the model to where the last step has put the nodes, as [`surface_update`](crate::surface_update) does with the state
    /// that it wrote. Returns how many vertices were left as they are.
    pub fn move_surface(&self, surface: &BoundSurface, out_m: &mut [[f32; 3]]) -> usize {
        let nodes: &[[f32; 4]] = bytemuck::cast_slice(&self.position);
        surface.update(&nodes[..self.load_n_m.len()], out_m)
    }

    /// How the springs of the last step held on to a model; `None` if this is not its scratch, or the state is of another one.
    fn grip<'a>(&'a self, model: &'a Model, at: &StateRef<'_>) -> Option<Grip<'a>> {
        let is_of_it = [model.node_count(), at.position_m.len(), at.velocity_m_s.len()] == [self.load_n_m.len(); 3];
        is_of_it.then_some(Grip { model, load_n_m: &self.load_n_m, substep_s: self.substep_s })
    }
}

/// Advances the object by `input.dt_s`: reads `now`, writes all of `next`.
///
/// Errors: arrays of another length than the model's nodes, a scratch of another model, a step out of range.
pub fn step(
    model: &Model,
    scratch: &mut Scratch,
    now: StateRef<'_>,
    input: &StepInput<'_>,
    next: StateMut<'_>,
) -> Result<StepReport, StepError> {
    check(model, scratch, &now, input, &next)?;
    let substeps = model.substeps(f64::from(input.dt_s));
    if substeps > SUBSTEPS_MAX {
        return Err(StepError::Substeps { dt_s: input.dt_s, substeps });
    }
    let mut report = StepReport { substeps, ..StepReport::default() };
    read(model, scratch, &now, input, &mut report);
    let substep_s = input.dt_s / substeps as f32;
    scratch.substep_s = substep_s;
    let StepInput { springs, pairs, holds, attachments, pressure, law, .. } = *input;
    let links = Links { springs, pairs, holds, attachments, pressure, law: law.sane(), substep_s };
    (report.softened_springs, report.ignored_springs) = links.weigh(model, &mut scratch.load_n_m, &mut scratch.ready);
    let job = Job { model, scratch, links, substep_s, substeps };
    let sums = match model.options.isa {
        Isa::Baseline => run(pulp::Scalar::new(), job),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => match pulp::x86::V3::try_new() {
            Some(simd) => simd.vectorize(Run { simd, job }),
            None => run(pulp::Scalar::new(), job),
        },
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => match pulp::x86::V4::try_new() {
            Some(simd) => simd.vectorize(Run { simd, job }),
            None => run(pulp::Scalar::new(), job),
        },
        #[cfg(not(target_arch = "x86_64"))]
        _ => run(pulp::Scalar::new(), job),
    };
    report.elastic_energy_j = sums.energy_j.0.iter().map(|&lane| f64::from(lane)).sum();
    report.inverted_tets = sums.inverted.0.iter().map(|&lane| lane as u32).sum();
    write(model, scratch, &now, input, next, &mut report);
    Ok(report)
}

fn check(
    model: &Model,
    scratch: &Scratch,
    now: &StateRef<'_>,
    input: &StepInput<'_>,
    next: &StateMut<'_>,
) -> Result<(), StepError> {
    let expected = model.node_count();
    let optional = |length: usize| if length == 0 { expected } else { length };
    let lengths = [
        ("now.position_m", now.position_m.len()),
        ("now.velocity_m_s", now.velocity_m_s.len()),
        ("next.position_m", next.position_m.len()),
        ("next.velocity_m_s", next.velocity_m_s.len()),
        ("external_force_n", optional(input.external_force_n.len())),
        ("targets_m", optional(input.targets_m.len())),
        ("scratch", scratch.load_n_m.len()),
    ];
    if let Some(&(what, found)) = lengths.iter().find(|(_, found)| *found != expected) {
        return Err(StepError::Length { what, expected, found });
    }
    if scratch.frames.len() != model.blocks.len() {
        return Err(StepError::Length { what: "scratch (tets)", expected, found: scratch.frames.len() * LANES });
    }
    if model.bulk.is_some() && scratch.bulk.is_empty() {
        return Err(StepError::Length { what: "scratch (volumes)", expected, found: 0 });
    }
    if input.dt_s > 0.0 && input.dt_s <= STEP_MAX_S { Ok(()) } else { Err(StepError::Step(input.dt_s)) }
}

fn finite(vector: [f32; 3]) -> bool {
    vector.iter().all(|x| x.is_finite())
}

/// Whether a position is finite and within reach of its place at rest.
fn in_reach(model: &Model, node: usize, position_m: [f32; 3]) -> bool {
    position_m.iter().zip(model.rest_m[node]).all(|(x, rest)| (x - rest).abs() <= model.reach_m)
}

/// The position of `now`, or that at rest where it cannot be used.
fn sane_position(model: &Model, now: &StateRef<'_>, node: usize) -> ([f32; 3], bool) {
    let position = now.position_m[node];
    if in_reach(model, node, position) { (position, true) } else { (model.rest_m[node], false) }
}

/// Whether all positions are finite and within reach of their places at rest. Without an early end, as [`each`].
fn all_in_reach(model: &Model, position_m: &[[f32; 3]]) -> bool {
    let (numbers, reach_m) = (position_m.as_flattened().iter().zip(model.rest_m.as_flattened()), model.reach_m);
    numbers.fold(true, |all, (x, rest)| all & ((x - rest).abs() <= reach_m))
}

/// Whether each number of some vectors is fine. Without an early end, so that it is a few instructions for four of them.
fn each(vectors: &[[f32; 3]], is_fine: impl Fn(f32) -> bool) -> bool {
    vectors.as_flattened().iter().fold(true, |all, number| all & is_fine(*number))
}

/// Copies the inputs into rows, with everything that is not finite or out of reach replaced and counted. All numbers are looked at together first; one
/// by one, which is several times the work, only where not all can be taken as they are.
fn read(model: &Model, scratch: &mut Scratch, now: &StateRef<'_>, input: &StepInput<'_>, report: &mut StepReport) {
    let cap = model.options.velocity_cap_m_s as f32;
    let is_sane = all_in_reach(model, now.position_m)
        & each(now.velocity_m_s, |v| v.abs() <= cap)
        & each(input.external_force_n, |f| f.abs() <= EXTERNAL_FORCE_MAX_N);
    let position: &mut [[f32; 4]] = bytemuck::cast_slice_mut(&mut scratch.position);
    let velocity: &mut [[f32; 4]] = bytemuck::cast_slice_mut(&mut scratch.velocity);
    let external: &mut [[f32; 4]] = bytemuck::cast_slice_mut(&mut scratch.external);
    let nodes = now.position_m.iter().zip(now.velocity_m_s).zip(&model.held).enumerate();
    let places = position.iter_mut().zip(velocity).zip(external);
    for ((node, ((x, v), is_held)), ((position, velocity), external)) in nodes.zip(places) {
        let force = input.external_force_n.get(node).copied().unwrap_or([0.0; 3]);
        let as_it_is = (*x, *v, force, true);
        let (x, mut v, force, mut good) = if is_sane { as_it_is } else { mended(model, now, (node, force), cap) };
        if *is_held {
            let target = input.targets_m.get(node).copied().unwrap_or(x);
            let target_good = in_reach(model, node, target);
            good &= target_good;
            let way_there = |axis: usize| ((target[axis] - x[axis]) / input.dt_s).clamp(-cap, cap);
            v = if target_good { [0, 1, 2].map(way_there) } else { [0.0; 3] };
        }
        *position = [x[0], x[1], x[2], 0.0];
        *velocity = [v[0], v[1], v[2], 0.0];
        *external = [force[0], force[1], force[2], 0.0];
        report.neutralised_inputs += u32::from(!good);
    }
    let rows = scratch.external.len();
    scratch.force[..rows].copy_from_slice(&scratch.external);
}

/// What a step takes of a node and the force on it, looked at one by one: position, velocity, force, and whether none of them was replaced.
fn mended(model: &Model, now: &StateRef<'_>, (node, force): (usize, [f32; 3]), cap: f32) -> ([f32; 3], [f32; 3], [f32; 3], bool) {
    let (x, position_good) = sane_position(model, now, node);
    let v = now.velocity_m_s[node];
    let (moves, is_pushed) = (position_good && finite(v), finite(force));
    let v = if moves { v.map(|v| v.clamp(-cap, cap)) } else { [0.0; 3] };
    let most_n = EXTERNAL_FORCE_MAX_N;
    let force = if is_pushed { force.map(|f| f.clamp(-most_n, most_n)) } else { [0.0; 3] };
    (x, v, force, moves && is_pushed)
}

/// The part of a step that runs in the chosen instruction set.
struct Job<'a> {
    model: &'a Model,
    scratch: &'a mut Scratch,
    links: Links<'a>,
    substep_s: f32,
    substeps: u32,
}

struct Run<'a, S> {
    simd: S,
    job: Job<'a>,
}

impl<S: Lanes> pulp::NullaryFnOnce for Run<'_, S> {
    type Output = TetSums;
    #[inline(always)]
    fn call(self) -> TetSums {
        run(self.simd, self.job)
    }
}

/// The step with the numbers that the model's blocks name nodes by.
#[inline(always)]
fn run<S: Lanes>(simd: S, job: Job<'_>) -> TetSums {
    let model = job.model;
    match &model.corners {
        Corners::Short(corners) => integrate::<S, ShortNodes>(simd, job, corners),
        Corners::Long(corners) => integrate::<S, [[f32; 4]]>(simd, job, corners),
    }
}

/// Velocity Verlet with the rotations of the start: half a kick, then drifts and kicks in turn, and half a kick with the same
/// rotations at the end. So positions and velocities belong to one time when the rotations change, and the change cannot feed
/// the fast modes; one more evaluation of the forces per step is its price.
#[inline(always)]
fn integrate<S: Lanes, N: Nodes + ?Sized>(simd: S, job: Job<'_>, corners: &[[[N::Number; LANES]; 4]]) -> TetSums {
    let Job { model, scratch, links, substep_s, substeps } = job;
    let Scratch { position, velocity, force, external, frames, bulk, load_n_m, ready, .. } = scratch;
    let (grip, rows) = (Grip { model, load_n_m, substep_s }, external.len());
    let (blocks, rest) = (&model.blocks[..], &model.rest_blocks[..]);
    let mut sums =
        kernel::rotations_and_forces(simd, corners, (blocks, rest), N::of(position), (&mut frames[..], N::of_mut(force)));
    for substep in 0..=substeps {
        // Those of the first came with the rotations.
        if substep > 0 {
            kernel::element_forces(simd, corners, (blocks, &frames[..]), N::of(position), N::of_mut(force));
        }
        if let Some(held) = &model.bulk {
            held.find_pressures(simd, corners, (rest, &frames[..]), N::of(position), bulk);
            if substep == 0 {
                sums.energy_j.0[0] += held.energy_j(bulk);
                held.brake::<S, N>(simd, corners, blocks, bulk, frames);
            }
            held.add_forces(simd, corners, &frames[..], bulk, N::of_mut(force));
        }
        let (at, rate): (&[[f32; 4]], &[[f32; 4]]) = (bytemuck::cast_slice(position), bytemuck::cast_slice(velocity));
        let sum: &mut [[f32; 4]] = bytemuck::cast_slice_mut(force);
        links.add_forces(&grip, ready, (at, rate), sum);
        bed::add_forces(&model.beds, &model.rest_m, at, sum);
        let constants = Constants {
            kick_s: if substep == 0 || substep == substeps { 0.5 * substep_s } else { substep_s },
            drift_s: if substep == substeps { 0.0 } else { substep_s },
            velocity_cap_m_s: model.options.velocity_cap_m_s as f32,
        };
        let (inv_mass, damping_per_s) = (&model.inv_mass, &model.damping_per_s);
        let (position, force) = (&mut position[..rows], &mut force[..rows]);
        let mut moving = NodeRows { inv_mass, damping_per_s, external, position, velocity, force };
        kernel::move_nodes(simd, &constants, &mut moving);
    }
    sums
}

/// Writes the next state, and its positions into the rows too; what is not finite or out of reach goes back to where it was, at rest. As in [`read`], nodes are
/// looked at one by one only where not all can stay as they are.
fn write(
    model: &Model,
    scratch: &mut Scratch,
    now: &StateRef<'_>,
    input: &StepInput<'_>,
    next: StateMut<'_>,
    report: &mut StepReport,
) {
    let cap = model.options.velocity_cap_m_s as f32;
    let position: &mut [[f32; 4]] = bytemuck::cast_slice_mut(&mut scratch.position);
    let velocity: &[[f32; 4]] = bytemuck::cast_slice(&scratch.velocity);
    let StateMut { position_m, velocity_m_s } = next;
    let places = position_m.iter_mut().zip(velocity_m_s.iter_mut());
    for ((at, v), (position, velocity)) in places.zip(position.iter().zip(velocity)) {
        (*at, *v) = ([position[0], position[1], position[2]], [velocity[0], velocity[1], velocity[2]]);
    }
    if input.targets_m.is_empty() && all_in_reach(model, position_m) && each(velocity_m_s, |v| v.abs() < cap) {
        return;
    }
    for node in 0..model.node_count() {
        let ([x, y, z, _], [vx, vy, vz, _]) = (position[node], velocity[node]);
        let (mut at, mut v) = ([x, y, z], [vx, vy, vz]);
        if !in_reach(model, node, at) || !finite(v) {
            (at, v) = (sane_position(model, now, node).0, [0.0; 3]);
            report.recovered_nodes += 1;
        } else if v.iter().any(|v| v.abs() >= cap) {
            // No tissue is so fast: what shakes so goes on until somebody takes its energy.
            v = [0.0; 3];
            report.capped_nodes += 1;
        } else if model.held[node] && in_reach(model, node, input.targets_m.get(node).copied().unwrap_or([f32::NAN; 3])) {
            at = input.targets_m[node]; // free of the rounding of the substeps
        }
        position[node] = [at[0], at[1], at[2], 0.0];
        (position_m[node], velocity_m_s[node]) = (at, v);
    }
}

#[cfg(test)]
mod tests;
