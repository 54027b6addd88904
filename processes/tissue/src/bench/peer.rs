//! The peer of the intersection test: parry's bounding volume hierarchy over the tets, refitted to where they are in each step and asked for each point of the tool
//! and of the tissue whether it lies in a tet that it may hit, with our own test in its leaves. It stops at the first, of which ours finds the lowest of
//! each object. Ours keeps from step to step what is near, and so may it: beside boxes that fit, there are such with a margin, within which it changes nothing.

use hyst_contact::{Hit, Points, TetTest, Tissue, intersect_brute};
use hyst_engine::bench::usual_ns;
use hyst_exchange::system;
use parry3d::bounding_volume::Aabb;
use parry3d::math::Vec3;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhWorkspace};

/// The margin of the second one, as a share of the mean edge of the tets.
const MARGIN_EDGES: f32 = 0.1;
/// Brute force is asked in one of so many steps.
const ASKED_EVERY: usize = 250;

/// The hierarchies, and what they took in each step.
pub struct Peer {
    kinds: [Kind; 2],
    steps: usize,
}

struct Kind {
    bvh: Bvh,
    space: BvhWorkspace,
    margin_m: f32,
    refit_ns: Vec<u64>,
    query_ns: Vec<u64>,
}

/// What a hierarchy took for a step, ns.
#[derive(Clone, Copy)]
pub struct Took {
    /// With which margin, m.
    pub margin_m: f32,
    /// For the refit, the mean of all but the slowest thousandth.
    pub refit_ns: f64,
    /// For all queries, likewise.
    pub query_ns: f64,
}

fn aabb(tissue: &Tissue<'_>, tet: usize) -> Aabb {
    Aabb::from_points(tissue.tets[tet].map(|node| Vec3::from_array(tissue.positions_m[node as usize])))
}

impl Kind {
    fn of(tissue: &Tissue<'_>, margin_m: f32) -> Kind {
        let all = (0..tissue.tets.len()).map(|tet| (tet, aabb(tissue, tet)));
        Kind {
            bvh: Bvh::from_iter(BvhBuildStrategy::Binned, all),
            space: BvhWorkspace::default(),
            margin_m,
            refit_ns: Vec::new(),
            query_ns: Vec::new(),
        }
    }

    /// One step; tells how many points are inside.
    fn step(&mut self, tissue: &Tissue<'_>, points: &Points<'_>, points_m: &[[f32; 3]]) -> usize {
        let begun_ns = system::now_ns();
        for tet in 0..tissue.tets.len() {
            self.bvh.insert_or_update_partially(aabb(tissue, tet), tet as u32, self.margin_m);
        }
        self.bvh.refit(&mut self.space);
        let refitted_ns = system::now_ns();
        let is_inside = |(point, place_m): &(u32, &[f32; 3])| {
            let at = Aabb::new(Vec3::from_array(**place_m), Vec3::from_array(**place_m));
            let node = points.node_of(*point);
            let holds = |tet: u32| {
                let nodes = &tissue.tets[tet as usize];
                // Most points of tissue lie in the tets that they are corners of, which is seen sooner than computed.
                if node.is_some_and(|node| nodes.contains(&node)) {
                    return false;
                }
                let corners = nodes.map(|node| tissue.positions_m[node as usize]);
                let weights = TetTest::new(&corners).and_then(|test| test.weights(**place_m));
                weights.is_some_and(|weights| points.may_hit(*point, nodes, tissue.tet_owner[tet as usize], &weights))
            };
            self.bvh.intersect_aabb(&at).any(holds)
        };
        // Some points are nowhere, for they can meet no fold.
        let are_somewhere = (0..).zip(points_m).filter(|(_, place_m)| place_m.iter().all(|coordinate| coordinate.is_finite()));
        let inside = are_somewhere.filter(is_inside).count();
        self.refit_ns.push(refitted_ns - begun_ns);
        self.query_ns.push(system::now_ns() - refitted_ns);
        inside
    }
}

impl Peer {
    /// Of tissue whose tets have such edges in the mean, m.
    pub fn of(tissue: &Tissue<'_>, edge_m: f32) -> Peer {
        Peer { kinds: [0.0, MARGIN_EDGES * edge_m].map(|margin_m| Kind::of(tissue, margin_m)), steps: 0 }
    }

    /// One step of both.
    ///
    /// # Errors
    /// If one finds other points inside than the other, or than brute force does.
    pub fn step(&mut self, tissue: &Tissue<'_>, points: &Points<'_>, points_m: &[[f32; 3]]) -> Result<(), String> {
        let [inside, other] = self.kinds.each_mut().map(|kind| kind.step(tissue, points, points_m));
        self.steps += 1;
        let expected = if self.steps.is_multiple_of(ASKED_EVERY) { brute(tissue, points, points_m)? } else { inside };
        if inside == expected && other == expected {
            Ok(())
        } else {
            Err(format!("parry finds {inside} and {other} points inside, brute force {expected}"))
        }
    }

    /// What each took.
    pub fn took(&mut self) -> [Took; 2] {
        self.kinds.each_mut().map(|kind| Took {
            margin_m: kind.margin_m,
            refit_ns: usual_ns(&mut kind.refit_ns),
            query_ns: usual_ns(&mut kind.query_ns),
        })
    }
}

fn brute(tissue: &Tissue<'_>, points: &Points<'_>, points_m: &[[f32; 3]]) -> Result<usize, String> {
    let mut hits = vec![Hit::default(); 8 * points_m.len()];
    let found = intersect_brute(points_m, points, tissue, &mut hits).map_err(|error| error.to_string())?;
    let mut found: Vec<u32> = hits[..found.count].iter().map(|hit| hit.point).collect();
    found.dedup();
    Ok(found.len())
}
