//! Promise of the tissue of a scene as the station steps it, with its substeps, the mass that is added, the contact that it bears and what ties its objects,
//! whole or cut: from a start with tets that are inverted it comes back, and gains nothing on the way.

use super::*;
use crate::contacts::LAW;
use hyst_tissue::{Scratch, StateMut, StateRef, StepInput, StepReport, step};

/// Of every so many tets one corner goes through the opposite face, where none of the four is a corner of one that was chosen before.
const EVERY: usize = 40;
/// How far beyond that face it is then, as a share of the tet's height, and how fast it flies, whichever way, m/s. Just as far beyond as it was before, a tet
/// that hangs alone would be in balance.
const BEYOND: f32 = 0.5;
const FLIES_M_S: f32 = 1.0;
/// How many strokes go through the tissue that is cut: the thin tets of more would cost as much again.
const SOME_STROKES: u32 = 2;
/// Steps of 1 ms.
const STEPS: usize = 2_000;
/// What a swing takes at most of what moves at first, of modes as fast as a substep h bears (ω·h = 1.95): they go 1/(1 − (ω·h/2)²) times as far as their energy
/// says. What is drawn at first swings no farther than that.
const SWINGS: f64 = 1.0 / (1.0 - 0.975 * 0.975);
/// What rounding may add, and what of the energy may be left after all steps: half of the energy is gone in 0.1 s.
const ROUNDING: f64 = 1e-3;
const LEFT: f64 = 0.01;

/// Tissue that nobody touches.
struct Alone<'a> {
    world: &'a World,
    scratch: Scratch,
    positions_m: Vec<[f32; 3]>,
    velocities_m_s: Vec<[f32; 3]>,
    next_m: Vec<[f32; 3]>,
    next_m_s: Vec<[f32; 3]>,
}

impl<'a> Alone<'a> {
    fn at_rest(world: &'a World) -> Alone<'a> {
        let (rest_m, still) = (world.model.rest_m().to_vec(), vec![[0.0; 3]; world.model.node_count()]);
        Alone {
            world,
            scratch: Scratch::new(&world.model),
            positions_m: rest_m.clone(),
            velocities_m_s: still.clone(),
            next_m: rest_m,
            next_m_s: still,
        }
    }

    /// Pushes corners through their tets; gives how many.
    fn distort(&mut self, random: &mut impl FnMut() -> f32) -> usize {
        let model = &self.world.model;
        let (mut is_taken, mut pushed) = (vec![false; model.node_count()], 0);
        for tet in model.tets().iter().step_by(EVERY) {
            let corners = tet.map(|node| node as usize);
            if model.is_held(corners[0]) || corners.iter().any(|node| is_taken[*node]) {
                continue;
            }
            corners.iter().for_each(|node| is_taken[*node] = true);
            let [a, b, c, d] = corners.map(|node| Vec3::from(model.rest_m()[node]));
            let upright = (c - b).cross(d - b).normalize_or_zero();
            let height = (a - b).dot(upright) * upright;
            self.positions_m[corners[0]] = (a - (1.0 + BEYOND) * height).to_array();
            self.velocities_m_s[corners[0]] = (FLIES_M_S * direction(random)).to_array();
            pushed += 1;
        }
        pushed
    }

    /// Energy of what moves, J.
    fn moving_j(&self) -> f64 {
        let squared = |velocity: &[f32; 3]| velocity.iter().map(|speed| f64::from(*speed).powi(2)).sum::<f64>();
        let of_nodes = self.velocities_m_s.iter().zip(self.world.model.mass_kg());
        of_nodes.map(|(velocity, mass_kg)| 0.5 * f64::from(*mass_kg) * squared(velocity)).sum()
    }

    /// Energy of what ties objects, J, as if none of it were softened.
    fn tied_j(&self) -> f64 {
        let at = |node: u32| Vec3::from(self.positions_m[node as usize]);
        let of_tie = |tie: &Attachment| {
            let place: Vec3 = tie.tet.iter().zip(tie.weights).map(|(node, weight)| weight * at(*node)).sum();
            0.5 * f64::from(tie.stiffness_n_m) * f64::from(place.distance_squared(at(tie.node)))
        };
        self.world.attachments.iter().map(of_tie).sum()
    }

    /// One step; what it says is said of the state before it.
    fn step(&mut self) -> StepReport {
        let now = StateRef { position_m: &self.positions_m, velocity_m_s: &self.velocities_m_s };
        let next = StateMut { position_m: &mut self.next_m, velocity_m_s: &mut self.next_m_s };
        let input = StepInput { attachments: &self.world.attachments, law: LAW, ..StepInput::default() };
        let report = step(&self.world.model, &mut self.scratch, now, &input, next).unwrap();
        std::mem::swap(&mut self.positions_m, &mut self.next_m);
        std::mem::swap(&mut self.velocities_m_s, &mut self.next_m_s);
        report
    }
}

/// Lets go of a distorted world.
fn comes_back(what: &str, world: &World, seed: u64) {
    let at_rest = Alone::at_rest(world).step();
    let mut tissue = Alone::at_rest(world);
    let pushed = tissue.distort(&mut noise(seed));
    let (moving_j, tied_j) = (tissue.moving_j(), tissue.tied_j());
    let (mut first_j, mut inverted, mut most_j, mut last_j) = (0.0f64, 0, 0.0f64, 0.0f64);
    let (mut capped, mut recovered, mut inverted_until) = (0, 0, 0);
    for tick in 0..STEPS {
        let of_motion_j = tissue.moving_j();
        let report = tissue.step();
        last_j = report.elastic_energy_j + of_motion_j;
        assert!(last_j.is_finite(), "{what}, tick {tick}: {report:?}");
        if tick == 0 {
            (first_j, inverted) = (report.elastic_energy_j, report.inverted_tets);
        }
        most_j = most_j.max(last_j);
        (capped, recovered) = (capped + report.capped_nodes, recovered + report.recovered_nodes);
        if report.inverted_tets > at_rest.inverted_tets {
            inverted_until = tick;
        }
    }
    let end = tissue.step();
    let most_allowed_j = (1.0 + ROUNDING) * (first_j + tied_j) + SWINGS * moving_j;
    println!(
        "{what}: {} tets, {} substeps, {pushed} corners pushed through; {inverted} tets inverted until tick {inverted_until}, {} at the end, {} at rest; \
         {first_j:.3e} J drawn, {tied_j:.3e} J tied and {moving_j:.3e} J moving at first, {most_j:.3e} J at most of {most_allowed_j:.3e} J, \
         {last_j:.3e} J at the end; {capped} times a node at the cap, {recovered} put back",
        world.model.tets().len(),
        end.substeps,
        end.inverted_tets,
        at_rest.inverted_tets
    );
    let are_numbers = |vectors: &[[f32; 3]]| vectors.as_flattened().iter().all(|number| number.is_finite());
    assert!(are_numbers(&tissue.positions_m) && are_numbers(&tissue.velocities_m_s), "{what}: not all are numbers");
    assert!(pushed > 20 && inverted as usize >= pushed, "{what}: {pushed} corners pushed through, {inverted} tets inverted");
    assert_eq!(recovered, 0, "{what}: nodes were put back");
    assert!(most_j <= most_allowed_j, "{what}: {most_j} J, {most_allowed_j} J allowed");
    assert!(last_j < LEFT * (first_j + moving_j), "{what}: {last_j} J of {first_j} and {moving_j} J are left");
    assert!(end.inverted_tets <= at_rest.inverted_tets, "{what}: {} tets stay inverted", end.inverted_tets);
}

#[test]
fn the_default_scenes_tissue_comes_back_from_a_start_with_inverted_tets() {
    let (_, world) = Workshop::open(&hyst_scene::load_embedded().unwrap(), Isa::detect()).unwrap();
    comes_back("whole", &world, 3);
}

#[test]
fn so_does_what_some_strokes_through_it_leave() {
    let (mut workshop, mut world) = Workshop::open(&hyst_scene::load_embedded().unwrap(), Isa::detect()).unwrap();
    let (whole, mut random, mut all) = (world.body.rest.tets.len(), noise(1), 0);
    for _ in 0..SOME_STROKES {
        let wires = through(&world, &mut random);
        let (next, sweeps) = drawn(&mut workshop, world, &wires, |_| ());
        (world, all) = (next, all + sweeps);
    }
    assert!(all > 2 && world.body.rest.tets.len() > whole + 10, "{all} sweeps: hardly anything is cut");
    comes_back(&format!("after {all} sweeps"), &world, 4);
}
