//! A way out of the tissue is found behind tets that are too flat for weights, and along a body of many tets. A point that lost its way left by another one, or
//! had no contact.

mod common;

use common::{Capsule, Poke, block};
use glam::Vec3;
use hyst_contact::*;

const MM: f32 = 1e-3;

/// Side of the square of which the sliver is, and height of the tissue above and below its middle.
const SIDE_M: f32 = 4.0 * MM;
/// How much higher two of its corners lie than the other two: it has a volume, and none that weights could be made of.
const SLIVER_M: f32 = 1e-5 * SIDE_M;

/// A square that is divided along one diagonal from below, with its tip at −z, and along the other from above, with its tip at +z; between these a sliver,
/// which is inside out for a height below 0.
fn with_sliver(height_m: f32) -> (Vec<[f32; 3]>, Vec<[u32; 4]>) {
    let half_m = SIDE_M / 2.0;
    let positions_m = vec![
        [-half_m, -half_m, height_m],
        [half_m, -half_m, 0.0],
        [half_m, half_m, height_m],
        [-half_m, half_m, 0.0],
        [0.0, 0.0, -SIDE_M],
        [0.0, 0.0, SIDE_M],
    ];
    let sliver = [0, 1, 2, 3].map(|node: usize| positions_m[node]);
    assert!(TetTest::new(&sliver).is_none(), "it has weights");
    (positions_m, vec![[0, 1, 3, 4], [1, 2, 3, 4], [0, 1, 2, 3], [0, 1, 2, 5], [0, 2, 3, 5]])
}

/// Points of a tool, of which each is joined to the next, or none to any other.
fn points(points_m: Vec<[f32; 3]>, are_joined: bool) -> Capsule {
    let count = points_m.len() as u32;
    let edges = (1..count).filter(|_| are_joined).map(|point| [point - 1, point]).collect();
    Capsule { area_m2: vec![1e-7; points_m.len()], edges, points_m }
}

#[test]
fn a_column_of_points_behind_a_sliver_leaves_along_its_retreat() {
    for height_m in [SLIVER_M, -SLIVER_M] {
        // One column through each of the quarters into which the two diagonals divide the sliver.
        for [x, y] in [[0.3f32, 0.5], [0.5, -0.3], [-0.3, -0.6], [-0.5, 0.2]] {
            let (positions_m, tets) = with_sliver(height_m);
            let column = points([-0.5, -1.0, -2.0].map(|z| [x * MM, y * MM, z * MM]).to_vec(), false);
            let out = Poke::new(positions_m, tets, &column).depths(&column.points_m, [0.0, 0.0, 1.0]);
            assert_eq!(out.len(), 3, "{height_m}: {x}, {y}");
            let top_m = SIDE_M - 2.0 * MM * f32::max(x.abs(), y.abs());
            for (p, [_, _, z_m]) in out.iter().zip(&column.points_m) {
                assert_eq!((p.source, p.direction), (Source::Fallback as u32, [0.0, 0.0, 1.0]), "{height_m}: {p:?}");
                assert!((p.depth_m - (top_m - z_m)).abs() < 1e-6, "{height_m}: {p:?}, the surface is at {top_m} m");
            }
        }
    }
}

#[test]
fn a_tool_that_went_in_through_a_sliver_leaves_where_it_came_in() {
    let column = points([4.5, -0.5, -1.0, -1.5].map(|z| [0.3 * MM, 0.5 * MM, z * MM]).to_vec(), true);
    for height_m in [SLIVER_M, -SLIVER_M] {
        let (positions_m, tets) = with_sliver(height_m);
        let out = Poke::new(positions_m, tets, &column).depths(&column.points_m, [0.0; 3]);
        let sources: Vec<u32> = out.iter().map(|p| p.source).collect();
        assert_eq!(sources, [Source::Border, Source::Inward, Source::Inward].map(|source| source as u32), "{height_m}");
        assert!(out.iter().all(|p| p.direction[2] > 0.3 && p.depth_m > 1.0 * MM), "{height_m}: {out:?}");
    }
}

#[test]
fn a_sliver_at_the_surface_has_its_outside_where_the_way_leads_out() {
    let (mut positions_m, mut tets) = with_sliver(SLIVER_M);
    tets.truncate(3);
    positions_m.truncate(5);
    let column = points([0.5, -0.5].map(|z| [0.3 * MM, 0.5 * MM, z * MM]).to_vec(), true);
    let out = Poke::new(positions_m, tets, &column).depths(&column.points_m, [0.0; 3]);
    assert_eq!((out.len(), out[0].source), (1, Source::Border as u32));
    assert!(out[0].direction[2] > 0.9 && (out[0].depth_m / (0.5 * MM * out[0].direction[2]) - 1.0).abs() < 1e-3, "{out:?}");
}

/// A sliver that is seen from its edge says nothing of how far the way has come: it was taken for up to its length of it.
#[test]
fn a_way_in_the_plane_of_a_sliver_ends_where_the_tissue_does() {
    for height_m in [SLIVER_M, 0.1 * SLIVER_M] {
        for [y, tilt] in [[0.2f32, 0.0], [-0.4, 0.0], [0.1, 2e-5], [-0.3, 2e-5], [-0.3, 2e-3]] {
            let (positions_m, tets) = with_sliver(height_m);
            let (point, retreat) = ([0.0, y * MM, -1e-8], Vec3::new(1.0, 0.0, tilt).normalize());
            let tool = points(vec![point], false);
            let out = Poke::new(positions_m, tets, &tool).depths(&tool.points_m, retreat.to_array());
            let side_m = SIDE_M / 2.0;
            let is_at_side = |found: &Penetration| found.direction[0] > 0.99 && (found.depth_m / side_m - 1.0).abs() < 0.01;
            assert!(out.len() == 1 && out.iter().all(is_at_side), "{height_m}, {y} mm, {tilt}: {out:?}");
        }
    }
}

/// Three tets in each of 80 cubes: ways ended after 192, and the point left to a side.
#[test]
fn a_way_along_a_long_body_comes_to_its_end() {
    let (positions_m, tets) = block([6, 6, 80], 0.5 * MM, [-1.5 * MM, -1.5 * MM, 0.0]);
    let point = points(vec![[0.13 * MM, 0.21 * MM, 39.8 * MM]], false);
    let out = Poke::new(positions_m, tets, &point).depths(&point.points_m, [0.0, 0.0, -1.0]);
    assert_eq!((out.len(), out[0].direction, out[0].depth_m), (1, [0.0, 0.0, -1.0], 0.015));
}
