//! Promise of the Main Loop about the medium: its pressure beyond that of the rest shape holds the walls apart, less of it lets them come together, what is far
//! beyond moves them no farther than the mesh can follow, and where its force is held for a step it pushes as where it is a law. It presses on what it wets.

use super::lattice::{self, Lattice};
use super::pieces::{middle_m, part};
use super::*;
use crate::body::Body;
use glam::Vec3;
use hyst_tissue::{Isa, pressure_forces};
use std::collections::BTreeSet;

/// Ticks in which the walls come to rest.
const TICKS: u64 = 400;

/// How far the two walls of the thin cavity are farther apart than at rest, in the mean of their nodes, m, at a pressure beyond that of the rest shape.
fn apart_m(main: &mut MainLoop<'_>, device: &OwnedPage, (round, beyond_pa): (u64, f32)) -> f32 {
    let pressure_pa = main.world.case.rest_pressure_pa + beyond_pa;
    let mut now = first_state(main);
    // Each round has ticks of its own: the device's ring has the inputs of the others.
    for tick in 1 + round * TICKS..1 + (round + 1) * TICKS {
        let mut record = InputRecord { tick, pressure_pa, ..InputRecord::default() };
        record.sample.pose = Pose { position_m: [0.0, 0.0, -0.2], orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
        now = fed(main, device, &now, &record);
    }
    let rest_m = main.world.model.rest_m();
    let mut nodes: Vec<usize> = main.world.wall.as_flattened().iter().map(|node| *node as usize).collect();
    nodes.sort_unstable();
    nodes.dedup();
    // y is the thin axis of the default scene's cavity, and 0 its middle.
    let outward_m = |node: &usize| (positions(&now)[*node][1] - rest_m[*node][1]) * rest_m[*node][1].signum();
    2.0 * nodes.iter().map(outward_m).sum::<f32>() / nodes.len() as f32
}

#[test]
fn the_walls_go_apart_with_the_pressure_and_together_without_it_and_never_beyond_what_the_mesh_can_follow() {
    let (station, pages, life, mut inbox) = begun("medium");
    let mut main = engine(&station, &life, &mut inbox);
    let device = &pages[1];
    let rounds = (0..).zip([-2_000.0, -1_000.0, 0.0, 1_000.0, 2_000.0, 9_000.0]);
    let found_m: Vec<f32> = rounds.map(|round| apart_m(&mut main, device, round)).collect();
    println!("{found_m:?}");
    assert!(found_m.windows(2).take(4).all(|pair| pair[1] > pair[0] + 5e-5), "more pressure, farther apart: {found_m:?}");
    assert!(found_m[2].abs() < 2e-5, "at rest nothing moves: {found_m:?}");
    assert!((found_m[5] - found_m[4]).abs() < 1e-6, "9 kPa are as much as 2: {found_m:?}");
}

#[test]
fn a_little_pressure_whose_force_is_held_for_a_step_pushes_as_one_does_that_is_a_law() {
    let (station, pages, life, mut inbox) = begun("alike");
    let mut main = engine(&station, &life, &mut inbox);
    // The last two are on the two sides of what is held.
    let [rest_m, held_m, law_m] = [(0, 0.0), (1, 190.0), (2, 210.0)].map(|round| apart_m(&mut main, &pages[1], round));
    let ratio = (law_m - rest_m) / (held_m - rest_m);
    assert!((1.0..1.25).contains(&ratio), "{law_m} m as a law, {held_m} m held, {rest_m} m at rest");
}

/// Cells of a hollow cube along each edge, the outermost of them its wall, and the edge of one, m.
const CELLS: usize = 6;
const CELL_M: f32 = 5e-3;
/// A cell of its wall at an edge of the cube: it has no face in the cavity, and is joined to others by some of which each node lies outside.
const AT_EDGE: [usize; 3] = [0, CELLS - 1, 3];

/// The world of that cube, whose lowest nodes alone are held.
fn cube() -> (Workshop, World) {
    let cells = Lattice { cells: [CELLS; 3], edge_m: [CELL_M; 3], low_m: [0.0; 3] };
    let is_wall = |cell: [usize; 3]| cell.iter().any(|at| *at == 0 || *at + 1 == CELLS);
    let files = lattice::scene("hollow", &cells, is_wall, "{ below_z_m = 0.0001 }");
    let scene = hyst_scene::load(&files.scene()).unwrap();
    assert!(scene.objects[0].hollow && scene.objects[0].fixed.contains(&true));
    Workshop::open(&scene, Isa::detect()).unwrap()
}

/// The tets of its cell at an edge.
fn at_edge(body: &Body) -> Vec<usize> {
    let low_m = Vec3::from(AT_EDGE.map(|at| at as f32 * CELL_M));
    let is_in = |tet: &usize| (middle_m(body, *tet) - low_m).to_array().iter().all(|along_m| (0.0..CELL_M).contains(along_m));
    (0..body.rest.tets.len()).filter(is_in).collect()
}

/// What 1 kPa beyond the pressure of the rest shape does to each node, N.
fn pushed_n(world: &World) -> Vec<[f32; 3]> {
    let mut force_n = vec![[0.0; 3]; world.model.node_count()];
    pressure_forces(&world.wall, world.model.rest_m(), &vec![1e3; world.wall.len()], &mut force_n);
    force_n
}

/// Triangles by their nodes, whichever comes first.
fn triangles(of: &[[u32; 3]]) -> BTreeSet<[u32; 3]> {
    let sorted = |triangle: &[u32; 3]| {
        let mut nodes = *triangle;
        nodes.sort_unstable();
        nodes
    };
    of.iter().map(sorted).collect()
}

#[test]
fn the_medium_presses_on_the_cavity_and_on_wounds_and_on_nothing_of_the_outside_however_little_of_it_is_held() {
    const ASH: u32 = u32::MAX;
    let (mut workshop, world) = cube();
    let far_m = CELLS as f32 * CELL_M;
    let is_outside = |node: usize| world.body.rest.positions_m[node].iter().any(|at| *at < 1e-6 || *at > far_m - 1e-6);
    let pushed = pushed_n(&world);
    let (outside, inside): (Vec<usize>, Vec<usize>) = (0..pushed.len()).partition(|node| is_outside(*node));
    assert!(outside.iter().all(|node| pushed[*node] == [0.0; 3]), "the outside is pressed");
    assert!(inside.iter().all(|node| pushed[*node] != [0.0; 3]) && !inside.is_empty(), "the cavity's wall is not");
    assert_eq!(world.wall.len(), 12 * (CELLS - 2).pow(2), "all of the cavity's wall");

    // A cell is burnt: what that lays open is wet, also where each node of it was outside.
    let (cell, mut marked) = (at_edge(&world.body), world.body.clone());
    assert_eq!(cell.len(), 6);
    cell.iter().for_each(|tet| marked.rest.regions[*tet] = ASH);
    let wounded = workshop.make(marked.without(ASH)).unwrap();
    let [before, after] = [&world, &wounded].map(|world| triangles(&world.topology.boundary));
    let laid_open: Vec<[u32; 3]> = after.difference(&before).copied().collect();
    assert!(laid_open.iter().any(|triangle| triangle.iter().all(|node| is_outside(*node as usize))), "{laid_open:?}");
    let wall = triangles(&wounded.wall);
    assert!(laid_open.iter().all(|triangle| wall.contains(triangle)), "a wound is dry");
    assert_eq!(wounded.wall.len(), world.wall.len() + laid_open.len(), "and nothing else is wet");

    // What has come free swims in the medium, and is pressed from all sides.
    let mut apart = world.body.clone();
    let pieces = part(&world, &mut apart, &cell);
    assert!(pieces.len() == 1 && !pieces[0].is_held, "{pieces:?}");
    let chipped = workshop.make(apart).unwrap();
    assert_eq!(chipped.wall.len(), wounded.wall.len() + 12, "and all sides of the chip");
    let on_chip = pushed_n(&chipped).into_iter().zip(chipped.body.owners()).filter(|(_, of)| *of == Some(pieces[0].object));
    let on_chip_n: Vec3 = on_chip.map(|(force_n, _)| Vec3::from(force_n)).sum();
    assert!(on_chip_n.length() < 1e-6, "it is pushed with {on_chip_n} N");
}

/// About its waist it lies deeper under the hull of all than what its scene fixes.
#[test]
fn the_outside_of_the_default_organ_is_not_pressed_where_nothing_holds_it() {
    let (_, world) = Workshop::open(&hyst_scene::load_embedded().unwrap(), Isa::detect()).unwrap();
    let is_waist = |node: &u32| {
        let [x, y, z] = world.body.rest.positions_m[*node as usize];
        (0.0..0.019).contains(&z) && x.hypot(y) > 0.01
    };
    let held = world.case.held_nodes(&world.body);
    let is_loose = |triangle: &&[u32; 3]| triangle.iter().all(|node| is_waist(node) && !held[*node as usize]);
    let loose = world.topology.boundary.iter().filter(is_loose).count();
    assert!(loose > 30, "{loose} triangles about the waist are held by nothing");
    assert!(!world.wall.as_flattened().iter().any(is_waist), "the medium presses on the waist from outside");
}
