//! The peer of the intersection test: parry's bounding volume hierarchy over the tets, refitted to where they are and asked for each point of the tool and of the
//! tissue whether it lies in a tet that it may hit, with our own test in its leaves. It stops at the first, of which ours finds the lowest of each object.

use hyst_contact::{Hit, Points, TetTest, Tissue, intersect_brute};
use hyst_exchange::system;
use parry3d::bounding_volume::Aabb;
use parry3d::math::Vec3;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhWorkspace};

/// Runs of which the middle one counts.
const RUNS: usize = 15;

fn middle_ns(mut run: impl FnMut()) -> u64 {
    let mut times_ns: Vec<u64> = (0..RUNS)
        .map(|_| {
            let begun_ns = system::now_ns();
            run();
            system::now_ns() - begun_ns
        })
        .collect();
    times_ns.sort_unstable();
    times_ns[RUNS / 2]
}

/// Time of a refit and of a query, ns.
///
/// # Errors
/// If it finds other points inside than brute force does.
pub fn parry_ns(tissue: &Tissue<'_>, points: &Points<'_>, points_m: &[[f32; 3]]) -> Result<[u64; 2], String> {
    let corners = |tet: usize| tissue.tets[tet].map(|node| tissue.positions_m[node as usize]);
    let aabb = |tet: usize| Aabb::from_points(corners(tet).map(Vec3::from_array));
    let tets = tissue.tets.len();
    let mut bvh = Bvh::from_iter(BvhBuildStrategy::Binned, (0..tets).map(|tet| (tet, aabb(tet))));
    let mut space = BvhWorkspace::default();
    let refit_ns = middle_ns(|| {
        for tet in 0..tets {
            bvh.insert_or_update_partially(aabb(tet), tet as u32, 0.0);
        }
        bvh.refit(&mut space);
    });
    let mut inside = 0;
    let query_ns = middle_ns(|| {
        let is_inside = |(point, place_m): &(u32, &[f32; 3])| {
            let at = Aabb::new(Vec3::from_array(**place_m), Vec3::from_array(**place_m));
            let node = points.node_of(*point);
            let holds = |tet: u32| {
                let nodes = &tissue.tets[tet as usize];
                // Most points of tissue lie in the tets that they are corners of, which is seen sooner than computed.
                if node.is_some_and(|node| nodes.contains(&node)) {
                    return false;
                }
                let weights = TetTest::new(&corners(tet as usize)).and_then(|test| test.weights(**place_m));
                weights.is_some_and(|weights| points.may_hit(*point, nodes, tissue.tet_owner[tet as usize], &weights))
            };
            bvh.intersect_aabb(&at).any(holds)
        };
        // Some points are nowhere, for they can meet no fold.
        let are_somewhere = (0..).zip(points_m).filter(|(_, place_m)| place_m.iter().all(|coordinate| coordinate.is_finite()));
        inside = are_somewhere.filter(is_inside).count();
    });
    let mut hits = vec![Hit::default(); 8 * points_m.len()];
    let found = intersect_brute(points_m, points, tissue, &mut hits).map_err(|error| error.to_string())?;
    let mut found: Vec<u32> = hits[..found.count].iter().map(|hit| hit.point).collect();
    found.dedup();
    if found.len() == inside {
        Ok([refit_ns, query_ns])
    } else {
        Err(format!("parry finds {inside} points inside, brute force {}", found.len()))
    }
}
