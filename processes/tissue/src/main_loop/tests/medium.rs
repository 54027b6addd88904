//! Promise of the Main Loop about the medium: its pressure beyond that of the rest shape holds the walls apart, less of it lets them come together, and what is far
//! beyond moves them no farther than the mesh can follow.

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
