//! One tick of contact, timed beside brute force and parry's bounding volume hierarchy on the same bodies in the same run.
//!
//! 1 000 points of a cloud half inside a block of 3 456 or 10 368 tets, all of which move between two ticks; then a capsule of
//! about 500 points pressed into the block, step by step of the tick. Times are medians; ratios travel, absolute times do not.
//! `cargo run --release -p hyst-contact --example contact_bench`

#[path = "../tests/common/mod.rs"]
mod common;

use common::tick::Tick;
use common::{TOOL, block};
use hyst_contact::*;
use parry3d::bounding_volume::Aabb;
use parry3d::math::Vec3;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhWorkspace};
use std::hint::black_box;
use std::time::Instant;

/// Median of several runs, microseconds.
fn median_us(runs: usize, mut work: impl FnMut()) -> f64 {
    let mut times: Vec<f64> = (0..runs)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64() * 1e6
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[runs / 2]
}

fn cloud(count: usize, half_in: [f32; 3], size_m: f32) -> Vec<[f32; 3]> {
    let mut state = 41u64;
    let mut random = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 40) as f32 / (1u64 << 24) as f32 - 0.5
    };
    (0..count).map(|_| std::array::from_fn(|a| half_in[a] + size_m * random())).collect()
}

struct Clouds {
    positions_m: Vec<[f32; 3]>,
    tets: Vec<[u32; 4]>,
    points_m: Vec<[f32; 3]>,
    owner: Vec<u32>,
    tet_owner: Vec<u32>,
}

impl Clouds {
    fn tissue(&self) -> Tissue<'_> {
        Tissue { positions_m: &self.positions_m, tets: &self.tets, tet_owner: &self.tet_owner }
    }

    fn points(&self) -> Points<'_> {
        Points { owner: &self.owner, node: &[], own: None }
    }

    fn ours(&self, cell_m: f32, layout: Layout, count: u32, split: Split) -> (f64, f64, usize) {
        let sizes = HashSizes::for_points(self.points_m.len());
        let mut words = vec![0u32; sizes.words()];
        let build = median_us(400, || {
            let mut table = HashMut::in_words(&mut words, sizes).unwrap();
            table.build(black_box(&self.points_m), cell_m, layout).unwrap();
        });
        let mut out = vec![Hit::default(); 2 * self.points_m.len()];
        let (mut cull, mut found) = (Cull::for_nodes(self.positions_m.len()), 0);
        // The slowest share is what a tick waits for.
        let query = (0..count).map(|index| {
            median_us(400, || {
                let hash = HashRef::in_words(&words).unwrap();
                let share = Share { index, count, split };
                found = intersect(share, &hash, &self.points(), &self.tissue(), &mut cull, &mut out).unwrap().count;
                black_box(&out);
            })
        });
        let slowest = query.fold(0.0, f64::max);
        (build, slowest, found)
    }

    fn brute(&self) -> (f64, usize) {
        let mut out = vec![Hit::default(); 2 * self.points_m.len()];
        let mut count = 0;
        let us = median_us(9, || {
            count = intersect_brute(&self.points_m, &self.points(), &self.tissue(), &mut out).unwrap().count;
        });
        (us, count)
    }

    fn aabb(&self, tet: usize) -> Aabb {
        Aabb::from_points(self.tets[tet].map(|n| Vec3::from_array(self.positions_m[n as usize])))
    }

    /// Refit of all leaves, then one point query after the other; our own test in the leaves.
    fn parry(&self) -> (f64, f64, usize) {
        let mut bvh = Bvh::from_iter(BvhBuildStrategy::Binned, (0..self.tets.len()).map(|t| (t, self.aabb(t))));
        let mut space = BvhWorkspace::default();
        let refit = median_us(60, || {
            for t in 0..self.tets.len() {
                bvh.insert_or_update_partially(self.aabb(t), t as u32, 0.0);
            }
            bvh.refit(&mut space);
        });
        let mut count = 0;
        let query = median_us(60, || {
            count = 0;
            for p in &self.points_m {
                let at = Aabb::new(Vec3::from_array(*p), Vec3::from_array(*p));
                let inside = bvh
                    .intersect_aabb(&at)
                    .any(|t| TetTest::new(&self.tissue().corners_of(t)).is_some_and(|test| test.weights(*p).is_some()));
                count += usize::from(inside);
            }
        });
        (refit, query, count)
    }
}

trait Corners {
    fn corners_of(&self, tet: u32) -> [[f32; 3]; 4];
}

impl Corners for Tissue<'_> {
    fn corners_of(&self, tet: u32) -> [[f32; 3]; 4] {
        self.tets[tet as usize].map(|n| self.positions_m[n as usize])
    }
}

fn clouds(cubes: [usize; 3], points: usize, size_m: f32) {
    let h_m = 2e-3;
    let (positions_m, tets) = block(cubes, h_m, [0.0; 3]);
    // Around the middle of the upper side: half of the cloud is inside.
    let top = [0.5 * h_m * cubes[0] as f32, 0.5 * h_m * cubes[1] as f32, h_m * cubes[2] as f32];
    let points_m = cloud(points, top, size_m);
    let (owner, tet_owner) = (vec![TOOL; points], vec![0; tets.len()]);
    let scene = Clouds { positions_m, tets, points_m, owner, tet_owner };
    println!("\n{} tets, {points} points in a cloud of {} mm", scene.tets.len(), size_m * 1e3);
    let (brute, inside) = scene.brute();
    let (refit, query, parry_inside) = scene.parry();
    assert_eq!(inside, parry_inside);
    println!("  brute force       {brute:8.1} us   ({inside} points inside)");
    println!("  parry refit+query {:8.1} us   ({refit:.1} + {query:.1})", refit + query);
    for cell in [0.5, 1.0, 1.5, 2.0] {
        let (build, test, count) = scene.ours(cell * h_m, Layout::Auto, 1, Split::Points);
        assert_eq!(count, inside);
        let ratio = (refit + query) / (build + test);
        println!("  cell {cell:.1} h by place  {:8.1} us   ({build:.1} + {test:.1}), parry x {ratio:.1}", build + test);
    }
    let (build, test, _) = scene.ours(1.5 * h_m, Layout::Hashed, 1, Split::Points);
    println!("  cell 1.5 h hashed    {:8.1} us   ({build:.1} + {test:.1})", build + test);
    for split in [Split::Points, Split::Tets] {
        let times = [1, 2, 4].map(|count| scene.ours(h_m, Layout::Auto, count, split).1);
        let [one, two, four] = times;
        println!("  by {split:?}: 1, 2, 4 shares, the slowest {one:.1} {two:.1} {four:.1} us");
    }
}

fn tick(cubes: [usize; 3]) {
    let mut tick = Tick::new(cubes);
    let mut line = String::new();
    let mut together = 0.0;
    for (name, step) in Tick::STEPS {
        let us = median_us(400, || step(black_box(&mut tick)));
        together += us;
        line += &format!("{name} {us:.1}  ");
    }
    let (tets, points) = (tick.body.tets.len(), tick.tool.points_m.len());
    println!("\n{tets} tets, capsule of {points} points, {} of them inside, its tip 4 mm deep", tick.found);
    println!("  {line} together {together:.1} us");
}

fn main() {
    for cubes in [[12, 12, 4], [12, 12, 12]] {
        clouds(cubes, 1000, 12e-3);
        clouds(cubes, 1000, 24e-3);
        tick(cubes);
    }
}
