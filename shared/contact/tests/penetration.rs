//! Depth and direction lead back out through the surface where the tool came in, however deep; and never NaN.

mod common;

use common::{Capsule, Poke, block, capsule};
use glam::{Quat, Vec3};
use hyst_contact::*;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

const MM: f32 = 1e-3;

/// Thickness of the wall.
const THICK_M: f32 = 12.0 * MM;

/// A wall 24 mm wide and 12 mm thick: its free side is z = 0, the tissue lies towards +z.
fn wall() -> (Vec<[f32; 3]>, Vec<[u32; 4]>) {
    block([12, 12, 6], 2.0 * MM, [-12.0 * MM, -12.0 * MM, 0.0])
}

fn degrees(a: [f32; 3], b: Vec3) -> f32 {
    Vec3::from_array(a).angle_between(b).to_degrees()
}

fn tool_at(tip_m: [f32; 3]) -> Capsule {
    capsule(tip_m, 2.0 * MM, 30.0 * MM, 30, 16)
}

#[test]
fn a_tool_pressed_into_a_wall_leaves_through_the_side_it_came_from_at_every_depth() {
    let (positions_m, tets) = wall();
    let mut poke = Poke::new(positions_m, tets, &tool_at([0.0; 3]));
    for depth_mm in [0.3f32, 1.0, 3.0, 6.0, 9.0, 11.5] {
        let tool = tool_at([0.3 * MM, 0.1 * MM, depth_mm * MM]);
        let out = poke.depths(&tool.points_m, [0.0, 0.0, -1.0]);
        assert!(!out.is_empty());
        for p in &out {
            let true_depth_m = tool.points_m[p.point as usize][2];
            assert!(degrees(p.direction, Vec3::NEG_Z) < 3.0, "at {depth_mm} mm: {p:?}");
            assert!((p.depth_m - true_depth_m).abs() < 0.03 * true_depth_m + 2e-5, "at {depth_mm} mm: {p:?}");
            assert_ne!(p.source, Source::Fallback as u32);
        }
    }
}

#[test]
fn a_shaft_lying_sideways_in_the_wall_is_pushed_sideways_deep_too() {
    let (positions_m, tets) = wall();
    let upright = capsule([0.0; 3], 2.0 * MM, 16.0 * MM, 30, 16);
    let mut poke = Poke::new(positions_m, tets, &upright);
    for depth_mm in [0.5f32, 2.0, 3.5] {
        // The axis along +x, the shaft's lower side `depth_mm` below the free side.
        let lay = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2);
        let shift = Vec3::new(8.0 * MM, 0.15 * MM, (depth_mm - 2.0) * MM);
        let points_m: Vec<[f32; 3]> = upright.points_m.iter().map(|p| (lay * Vec3::from_array(*p) + shift).to_array()).collect();
        let out = poke.depths(&points_m, [-1.0, 0.0, 0.0]);
        assert!(!out.is_empty());
        let sum: Vec3 = out.iter().map(|p| Vec3::from_array(p.direction) * p.depth_m).sum();
        assert!(degrees(sum.to_array(), Vec3::NEG_Z) < 1.0, "at {depth_mm} mm: {sum}");
        for p in &out {
            let true_depth_m = points_m[p.point as usize][2];
            assert!(degrees(p.direction, Vec3::NEG_Z) < 5.0, "at {depth_mm} mm: {p:?}");
            assert!((p.depth_m - true_depth_m).abs() < 0.05 * true_depth_m + 2e-5, "at {depth_mm} mm: {p:?}");
        }
    }
}

#[test]
fn a_tip_pushed_slowly_through_the_far_side_is_still_pulled_back_out() {
    let (positions_m, tets) = wall();
    let mut poke = Poke::new(positions_m, tets, &tool_at([0.0; 3]));
    for step in 0..48 {
        let tool = tool_at([0.3 * MM, 0.1 * MM, (-1.0 + 0.35 * step as f32) * MM]);
        let out = poke.depths(&tool.points_m, [0.0, 0.0, -1.0]);
        for p in &out {
            assert!(degrees(p.direction, Vec3::NEG_Z) < 5.0, "step {step}: {p:?}");
        }
    }
}

#[test]
fn depth_grows_without_a_leap_as_the_tool_goes_in() {
    let (positions_m, tets) = wall();
    let mut poke = Poke::new(positions_m, tets, &tool_at([0.0; 3]));
    let mut before = 0.0;
    for step in 0..200 {
        let tool = tool_at([0.3 * MM, 0.1 * MM, 0.05 * MM * step as f32 - 0.5 * MM]);
        let out = poke.depths(&tool.points_m, [0.0, 0.0, -1.0]);
        let deepest = out.iter().map(|p| p.depth_m).fold(0.0, f32::max);
        assert!((deepest - before).abs() < 0.08 * MM, "step {step}: {before} to {deepest}");
        before = deepest;
    }
    assert!(before > 8.0 * MM);
}

#[test]
fn a_ball_in_a_bent_wall_is_pushed_along_the_bend() {
    let (mut positions_m, tets) = wall();
    // Bend the free side to a cylinder of 30 mm: the wall of an organ, seen from inside its cavity.
    let centre = Vec3::new(0.0, 0.0, -30.0 * MM);
    for p in &mut positions_m {
        let angle = p[0] / (30.0 * MM);
        let r = 30.0 * MM + p[2];
        *p = [r * angle.sin(), p[1], centre.z + r * angle.cos()];
    }
    let mut poke = Poke::new(positions_m, tets, &tool_at([0.0; 3]));
    for angle in [-0.15f32, 0.0, 0.1] {
        let turn = Quat::from_rotation_y(angle);
        let tip = tool_at([0.0, 0.2 * MM, 34.0 * MM]);
        let points_m: Vec<[f32; 3]> = tip.points_m.iter().map(|p| (turn * Vec3::from_array(*p) + centre).to_array()).collect();
        let out = poke.depths(&points_m, (turn * Vec3::NEG_Z).to_array());
        let sum: Vec3 = out.iter().map(|p| Vec3::from_array(p.direction) * p.depth_m).sum();
        assert!(degrees(sum.to_array(), turn * Vec3::NEG_Z) < 2.0, "at {angle}: {sum}");
    }
}

#[test]
fn a_body_wholly_inside_leaves_along_its_retreat_else_by_the_shortest_way() {
    let (positions_m, tets) = wall();
    let ball = capsule([0.2 * MM, 0.1 * MM, 7.0 * MM], 1.0 * MM, 2.0 * MM, 4, 8);
    let mut poke = Poke::new(positions_m, tets, &ball);
    for p in poke.depths(&ball.points_m, [0.0, 0.0, -1.0]) {
        assert_eq!((p.source, p.direction), (Source::Fallback as u32, [0.0, 0.0, -1.0]));
        assert!((p.depth_m - ball.points_m[p.point as usize][2]).abs() < 1e-5);
    }
    // Its ring of eight points in the middle of the wall may go either way; those above and below it may not.
    let mut sides = [0usize; 2];
    for p in poke.depths(&ball.points_m, [0.0; 3]) {
        let z_m = ball.points_m[p.point as usize][2];
        let ways = [(z_m, -1.0), (THICK_M - z_m, 1.0)];
        let shortest_m = ways[0].0.min(ways[1].0);
        assert!((p.depth_m - shortest_m).abs() < 1e-5, "{p:?} at {z_m} m");
        let taken = ways.map(|(way_m, side)| p.direction == [0.0, 0.0, side] && way_m - shortest_m < 1e-5);
        assert!(taken.contains(&true), "{p:?} at {z_m} m: the shortest way out is {shortest_m} m");
        for (side, is_taken) in sides.iter_mut().zip(taken) {
            *side += usize::from(is_taken);
        }
    }
    println!("{sides:?} of {} points leave to either side", ball.points_m.len());
    assert!(sides[0] >= 16 && sides[1] >= 9, "{sides:?}: not all points were looked at");
}

#[test]
fn a_workspace_that_was_another_meshs_finds_what_a_new_one_finds() {
    let (large, small) = (tool_at([0.3 * MM, 0.1 * MM, 3.0 * MM]), capsule([0.0, 0.0, 2.0 * MM], 1.0 * MM, 6.0 * MM, 4, 8));
    let pokes = || {
        let (wall, cube) = (wall(), block([4, 4, 4], 2.0 * MM, [-4.0 * MM, -4.0 * MM, 0.0]));
        [(Poke::new(wall.0, wall.1, &large), &large), (Poke::new(cube.0, cube.1, &small), &small)]
    };
    let depths = |(mut poke, tool): (Poke, &Capsule)| (poke.depths(&tool.points_m, [0.0, 0.0, -1.0]), poke.work);
    let new = pokes().map(|poke| depths(poke).0);
    assert!(new.iter().all(|found| found.len() > 4));
    let mut work = Workspace::default();
    for ((mut poke, tool), new) in pokes().into_iter().chain(pokes()).zip(new.iter().cycle()) {
        work.fit(tool.points_m.len(), 2 * tool.points_m.len(), poke.positions_m.len());
        poke.work = work;
        let (found, used) = depths((poke, tool));
        assert_eq!(&found, new);
        work = used;
    }
}

/// The wall and a slab of another object, 2 mm thick, whose free side is so far beyond that of the wall, and the tool. The wall has the lower tets.
fn poke_with_slab(beyond_m: f32) -> Poke {
    let (mut positions_m, mut tets) = wall();
    let (of_slab_m, of_slab) = block([12, 12, 1], 2.0 * MM, [-12.0 * MM, -12.0 * MM, beyond_m]);
    let (first, of_wall) = (positions_m.len() as u32, tets.len());
    positions_m.extend(of_slab_m);
    tets.extend(of_slab.iter().map(|tet| tet.map(|node| node + first)));
    let mut poke = Poke::new(positions_m, tets, &tool_at([0.0; 3]));
    poke.tet_owner[of_wall..].fill(2);
    poke.topology = Topology::new(&poke.tets, &poke.tet_owner, &poke.positions_m).unwrap();
    poke
}

/// Of a tip that is at some places one after the other the objects that it is in, the one that it remembers, and how deep it says that it is in that.
fn known(beyond_m: f32, tips_m: &[f32]) -> Vec<(usize, u32, f32)> {
    let mut poke = poke_with_slab(beyond_m);
    let at = |tip_m: &f32| {
        let tool = tool_at([0.3 * MM, 0.1 * MM, *tip_m]);
        let out = poke.depths(&tool.points_m, [0.0, 0.0, -1.0]);
        (out.iter().filter(|found| found.point == 0).count(), poke.memory[0].owner, poke.memory[0].depth_m)
    };
    tips_m.iter().map(at).collect()
}

#[test]
fn of_two_objects_a_point_remembers_the_one_that_it_came_into_first() {
    let is_like = |known: &(usize, u32, f32), (objects, owner, depth_m): (usize, u32, f32)| {
        known.0 == objects && known.1 == owner && (known.2 - depth_m).abs() < 0.05 * MM
    };
    // Through the slab into the wall; out of the slab's far side; and into it again by that, which the wall's depth does not make the first.
    let before = known(-1.5 * MM, &[-MM, 0.3 * MM, 1.0 * MM, 0.3 * MM]);
    let wanted = [(1, 2, 0.5 * MM), (2, 2, 1.8 * MM), (1, 1, 1.0 * MM), (2, 2, 1.8 * MM)];
    assert!(before.iter().zip(wanted).all(|(known, wanted)| is_like(known, wanted)), "{before:?}");
    // Into both in one step, and through the wall into a slab within it.
    let [at_once, within] = [known(-1.5 * MM, &[0.3 * MM]), known(1.0 * MM, &[0.5 * MM, 2.1 * MM])];
    assert!(is_like(&at_once[0], (2, 2, 1.8 * MM)), "{at_once:?}");
    assert!(is_like(&within[0], (1, 1, 0.5 * MM)) && is_like(&within[1], (2, 1, 2.1 * MM)), "{within:?}");
}

/// Jaws that lie in what they hold and in the wall behind it knew what they held alone, and rubbed on nothing.
#[test]
fn what_a_point_does_not_meet_it_does_not_remember() {
    let remembered = |spared: &[u32]| {
        let mut poke = poke_with_slab(-1.5 * MM);
        poke.spared = spared.to_vec();
        let tool = tool_at([0.3 * MM, 0.1 * MM, 0.3 * MM]);
        let out = poke.depths(&tool.points_m, [0.0, 0.0, -1.0]);
        assert_eq!(out.iter().filter(|found| found.point == 0).count(), 2, "it lies in both");
        poke.memory[0]
    };
    assert_eq!([&[][..], &[2], &[1]].map(|spared| remembered(spared).owner), [2, 1, 2]);
    assert_eq!(remembered(&[1, 2]), Memory::default());
}

#[test]
fn topology_joins_all_inner_faces_and_bounds_the_block() {
    let (positions_m, tets) = wall();
    let topology = Topology::new(&tets, &vec![0; tets.len()], &positions_m).unwrap();
    assert_eq!(topology.boundary.len(), 2 * 2 * (12 * 12 + 12 * 6 + 12 * 6));
    for (t, four) in topology.neighbours.iter().enumerate() {
        for &n in four.iter().filter(|&&n| n != NONE) {
            assert!(topology.neighbours[n as usize].contains(&(t as u32)));
        }
    }
    let at = |n: u32| Vec3::from_array(positions_m[n as usize]);
    let volume: f32 = topology.boundary.iter().map(|&[a, b, c]| at(a).dot(at(b).cross(at(c))) / 6.0).sum();
    assert!((volume / (24.0 * 24.0 * 12.0 * 1e-9) - 1.0).abs() < 1e-4, "outward faces enclose the volume: {volume}");
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 60, rng_seed: RngSeed::Fixed(7), failure_persistence: None, ..ProptestConfig::default()
    })]

    /// Scrambled, flattened and NaN tissue: unit directions, bounded depths, no panic.
    #[test]
    fn broken_tissue_gives_bounded_depths(
        scale in 0.0f32..0.02, seed in any::<u64>(), bad in prop::collection::vec((0usize..1183, 0usize..5), 0..6),
        depth_mm in -1.0f32..14.0, retreat in prop::array::uniform3(-1.0f32..1.0),
    ) {
        let (mut positions_m, tets) = wall();
        let tool = tool_at([0.3 * MM, 0.1 * MM, depth_mm * MM]);
        let mut poke = Poke::new(positions_m.clone(), tets, &tool);
        let mut state = seed | 1;
        for v in positions_m.iter_mut().flatten() {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            *v += scale * ((state >> 40) as f32 / (1u64 << 24) as f32 - 0.5);
        }
        for (n, kind) in bad {
            let at = n % positions_m.len();
            positions_m[at] = [[f32::NAN; 3], [1e30; 3], [0.0; 3], [f32::INFINITY; 3], [-1e-40; 3]][kind];
        }
        poke.positions_m = positions_m;
        for _ in 0..2 {
            for p in poke.depths(&tool.points_m, retreat) {
                prop_assert!((0.0..=0.015).contains(&p.depth_m), "{:?}", p);
                prop_assert!((Vec3::from_array(p.direction).length() - 1.0).abs() < 1e-4, "{:?}", p);
            }
        }
    }
}
