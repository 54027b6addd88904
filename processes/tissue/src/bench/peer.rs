//! The peer of the intersection test: parry's bounding volume hierarchy over the tets, refitted to where they are and asked for each point, with our own test in
//! its leaves.

use hyst_contact::{Hit, NONE, Points, TetTest, Tissue, intersect_brute};
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
pub fn parry_ns(tissue: &Tissue<'_>, points_m: &[[f32; 3]]) -> Result<[u64; 2], String> {
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
        let is_inside = |point: &&[f32; 3]| {
            let at = Aabb::new(Vec3::from_array(**point), Vec3::from_array(**point));
            let holds = |tet: u32| TetTest::new(&corners(tet as usize)).is_some_and(|test| test.weights(**point).is_some());
            bvh.intersect_aabb(&at).any(holds)
        };
        inside = points_m.iter().filter(is_inside).count();
    });
    let owner = vec![NONE; points_m.len()];
    let mut hits = vec![Hit::default(); 8 * points_m.len()];
    let points = Points { owner: &owner, node: &[], own: None };
    let found = intersect_brute(points_m, &points, tissue, &mut hits).map_err(|error| error.to_string())?;
    let mut found: Vec<u32> = hits[..found.count].iter().map(|hit| hit.point).collect();
    found.dedup();
    if found.len() == inside {
        Ok([refit_ns, query_ns])
    } else {
        Err(format!("parry finds {inside} points inside, brute force {}", found.len()))
    }
}
