//! Promise of the Main Loop about the medium: its pressure beyond that of the rest shape holds the walls apart, less of it lets them come together, what is far
//! beyond moves them no farther than the mesh can follow, and where its force is held for a step it pushes as where it is a law.

use super::*;

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
    let (station, pages) = founded("medium", "workers = 0");
    let life = Life::begin(station.name(), Slot::first(Role::Tissue), 1).unwrap();
    let mut inbox = usher(&station, None, 1, Vec::new()).unwrap();
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
    let (station, pages) = founded("alike", "workers = 0");
    let life = Life::begin(station.name(), Slot::first(Role::Tissue), 1).unwrap();
    let mut inbox = usher(&station, None, 1, Vec::new()).unwrap();
    let mut main = engine(&station, &life, &mut inbox);
    // The last two are on the two sides of what is held.
    let [rest_m, held_m, law_m] = [(0, 0.0), (1, 190.0), (2, 210.0)].map(|round| apart_m(&mut main, &pages[1], round));
    let ratio = (law_m - rest_m) / (held_m - rest_m);
    assert!((1.0..1.25).contains(&ratio), "{law_m} m as a law, {held_m} m held, {rest_m} m at rest");
}
