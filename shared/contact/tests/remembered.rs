//! What is remembered from step to step spares searches and changes no hit: brute force to the last bit, however nodes and points move.

mod common;

use common::{TOOL, block, brute, capsule, hits_by, table};
use hyst_contact::*;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

const CELL_M: f32 = 0.003;

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, rng_seed: RngSeed::Fixed(17), failure_persistence: None, ..ProptestConfig::default() }
}

/// A scene that moves: tissue of two objects, and a tool.
struct Scene {
    positions_m: Vec<[f32; 3]>,
    rest_m: Vec<[f32; 3]>,
    tets: Vec<[u32; 4]>,
    tet_owner: Vec<u32>,
    /// Those of the tool, then all nodes.
    points_m: Vec<[f32; 3]>,
    owner: Vec<u32>,
    node: Vec<u32>,
    tool: usize,
    only_from: u32,
    topology: u32,
}

impl Scene {
    /// A block on another one, a tenth of a cube in it, and a tool whose tip is a cube and a half deep in it.
    fn new() -> Scene {
        let (mut positions_m, mut tets) = block([4, 4, 2], CELL_M, [0.0; 3]);
        let first = positions_m.len() as u32;
        let (upper_m, upper) = block([2, 2, 2], CELL_M, [CELL_M, CELL_M, 1.9 * CELL_M]);
        let mut tet_owner = vec![0; tets.len()];
        tet_owner.extend(upper.iter().map(|_| 1));
        positions_m.extend(upper_m);
        tets.extend(upper.iter().map(|tet| tet.map(|node| node + first)));
        let tool = capsule([2.0 * CELL_M, 2.0 * CELL_M, 2.4 * CELL_M], 0.7 * CELL_M, 4.0 * CELL_M, 8, 10).points_m;
        let count = positions_m.len();
        let of_node = |node: usize| u32::from(node >= first as usize);
        Scene {
            rest_m: positions_m.clone(),
            owner: tool.iter().map(|_| TOOL).chain((0..count).map(of_node)).collect(),
            node: tool.iter().map(|_| NONE).chain(0..count as u32).collect(),
            points_m: tool.iter().chain(&positions_m).copied().collect(),
            only_from: (tool.len() + count) as u32 - 20,
            tool: tool.len(),
            positions_m,
            tets,
            tet_owner,
            topology: 0,
        }
    }

    fn tissue(&self) -> Tissue<'_> {
        Tissue { positions_m: &self.positions_m, tets: &self.tets, tet_owner: &self.tet_owner }
    }

    fn points(&self) -> Points<'_> {
        let own = OwnContact { rest_m: &self.rest_m, beyond_m: CELL_M, only_from: self.only_from };
        Points { owner: &self.owner, node: &self.node, own: Some(own) }
    }

    /// Moves everything so far along all axes, m.
    fn move_all(&mut self, way_m: f32) {
        self.positions_m.iter_mut().chain(&mut self.points_m).flatten().for_each(|place| *place += way_m);
    }

    /// Moves each node and each point of the tool by up to so much on each axis, m.
    fn move_by(&mut self, most_m: f32, random: &mut Random) {
        let tool = self.tool;
        for place in self.positions_m.iter_mut().chain(&mut self.points_m[..tool]).flatten() {
            *place += most_m * random.sign();
        }
        self.points_m[tool..].copy_from_slice(&self.positions_m);
    }
}

/// One of each step's own.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 33
    }

    /// From -1 to 1.
    fn sign(&mut self) -> f32 {
        (self.next() % 20_001) as f32 / 10_000.0 - 1.0
    }

    fn below(&mut self, count: usize) -> usize {
        self.next() as usize % count
    }
}

/// A row of shares that remember, of points in a table of this layout.
struct Searches(Vec<Cull>, Layout);

impl Searches {
    fn of(shares: u32) -> Searches {
        Searches((0..shares).map(|_| Cull::remembering(128, 512, 256)).collect(), Layout::Auto)
    }

    /// The hits by all of them.
    fn hits(&mut self, points_m: &[[f32; 3]], points: &Points, tissue: &Tissue, (cell_m, topology): (f32, u32)) -> Vec<Hit> {
        let culls = self.0.iter_mut().map(|cull| cull.of(topology));
        hits_by(points_m, points, tissue, (cell_m, self.1), Split::Tets, culls)
    }

    fn hits_of(&mut self, scene: &Scene) -> Vec<Hit> {
        self.hits(&scene.points_m, &scene.points(), &scene.tissue(), (CELL_M, scene.topology))
    }

    /// How often tets were looked for, by all of them.
    fn searches(&self) -> u64 {
        self.0.iter().map(Cull::searches).sum()
    }
}

fn words(hits: &[Hit]) -> &[u32] {
    bytemuck::cast_slice(hits)
}

/// Something that happens beside the motion.
fn happen(scene: &mut Scene, random: &mut Random) {
    let nodes = scene.positions_m.len();
    match random.below(12) {
        0 => scene.points_m[random.below(nodes)] = [f32::NAN; 3],
        1 => (0..20).for_each(|_| scene.points_m[random.below(nodes)] = [f32::NAN; 3]),
        2 => scene.positions_m[random.below(nodes)][0] = f32::NAN,
        3 => scene.positions_m[random.below(nodes)] = [1e30, -1e30, 0.0],
        // A node that is thrown, and everything.
        4 => scene.positions_m[random.below(nodes)][2] += 2.0 * CELL_M,
        5 => scene.positions_m.iter_mut().for_each(|place| place[0] += CELL_M),
        6 => {
            let tet = random.below(scene.tets.len());
            scene.tets[tet].swap(0, 1);
            scene.tet_owner[tet] ^= 1;
            scene.topology += 1;
        }
        7 => {
            scene.tets.pop();
            scene.tet_owner.pop();
            scene.topology += 1;
        }
        8 => scene.owner[random.below(nodes)] = 1,
        9 => scene.node.rotate_right(1),
        10 => scene.only_from = random.below(scene.points_m.len()) as u32,
        _ => {}
    }
}

proptest! {
    #![proptest_config(config(120))]

    /// Everything moves at some speed, which changes, and now and then something happens.
    #[test]
    fn a_scene_that_moves_is_brute_force_in_each_step(
        seed in any::<u64>(), shares in 1u32..4, happens in any::<bool>(), is_hashed in any::<bool>(),
        far_m in prop_oneof![Just(0.0f32), Just(0.1), Just(50.0)],
    ) {
        let (mut scene, mut searches, mut random) = (Scene::new(), Searches::of(shares), Random(seed));
        scene.move_all(far_m);
        searches.1 = if is_hashed { Layout::Hashed } else { Layout::Auto };
        let (mut most_m, mut sound) = (0.0, (Vec::new(), Vec::new()));
        for step in 0..60 {
            if step % 12 == 0 {
                most_m = CELL_M * [0.0, 1e-4, 1e-3, 5e-3, 2e-2, 8e-2][random.below(6)];
            }
            scene.move_by(most_m, &mut random);
            if scene.positions_m.iter().chain(&scene.points_m).flatten().all(|place| place.abs() < 60.0) {
                sound = (scene.positions_m.clone(), scene.points_m.clone());
            } else if random.below(2) == 0 {
                // What was nowhere comes back.
                (scene.positions_m, scene.points_m) = sound.clone();
            }
            if happens && random.below(4) == 0 {
                happen(&mut scene, &mut random);
            }
            let (found, wanted) = (searches.hits_of(&scene), brute(&scene.points_m, &scene.points(), &scene.tissue()));
            prop_assert!(words(&found) == words(&wanted), "step {step}: {} hits, not {}", found.len(), wanted.len());
        }
    }

    /// Tets of any shape, inverted and flat ones among them, whose corners and points go as far as a list reaches, or nearly, or a little farther. Few points,
    /// and many; those of a rigid object, and nodes, of which all was far away at rest.
    #[test]
    fn tets_of_any_shape_are_brute_force_when_they_move(
        nodes in prop::collection::vec(prop::array::uniform3((-4i32..5).prop_map(|at| at as f32 * 0.25)), 4..24),
        corners in prop::collection::vec(prop::array::uniform4(0u32..24), 1..50),
        seed in any::<u64>(),
        least in 0usize..3,
        count in prop_oneof![1usize..4, Just(60)],
        own in any::<bool>(),
    ) {
        let (mut nodes, mut random) = (nodes, Random(seed));
        let rest_m: Vec<[f32; 3]> = nodes.iter().map(|node| node.map(|at| 100.0 * at)).collect();
        // Beside the faces of tets, and of their boxes.
        let mut beside = || 0.25 * (random.below(9) as f32 - 4.0) + 0.01 * random.sign();
        let mut tool: Vec<[f32; 3]> = (0..count).map(|_| [(); 3].map(|()| beside())).collect();
        let of_tissue = if own { nodes.len() } else { 0 };
        let owner: Vec<u32> = (0..count + of_tissue).map(|point| if point < count { TOOL } else { 0 }).collect();
        let node: Vec<u32> = (0..count).map(|_| NONE).chain(0..of_tissue as u32).collect();
        let tet_owner = vec![0; corners.len()];
        let own = own.then_some(OwnContact { rest_m: &rest_m, beyond_m: 0.2, only_from: count as u32 });
        let points = Points { owner: &owner, node: &node, own };
        let mut searches = Searches::of(1);
        let most_m = [0.002, 0.008, 0.02][least];
        for step in 0..25 {
            for place in nodes.iter_mut().chain(&mut tool).flatten() {
                // In three ways at once: to one side, back and forth, and any.
                *place += most_m * if step % 5 == 0 { random.sign().signum() } else { 0.3 * random.sign() };
            }
            let points_m: Vec<[f32; 3]> = tool.iter().chain(&nodes[..of_tissue]).copied().collect();
            let tissue = Tissue { positions_m: &nodes, tets: &corners, tet_owner: &tet_owner };
            let found = searches.hits(&points_m, &points, &tissue, (0.5, 7));
            let wanted = brute(&points_m, &points, &tissue);
            prop_assert!(words(&found) == words(&wanted), "step {step}: {} hits, not {}", found.len(), wanted.len());
        }
    }
}

/// Searches in 200 steps, each way by up to so much, m.
fn searches_of_steps(most_m: f32) -> (u64, usize) {
    let (mut scene, mut searches, mut random) = (Scene::new(), Searches::of(1), Random(3));
    let mut hits = 0;
    for _ in 0..200 {
        scene.move_by(most_m, &mut random);
        hits = searches.hits_of(&scene).len();
    }
    (searches.searches(), hits)
}

#[test]
fn tets_are_looked_for_the_more_rarely_the_slower_all_moves() {
    let (still, hits) = searches_of_steps(0.0);
    assert!(hits > 20, "{hits} hits");
    assert_eq!(still, 4, "anew after 64 steps at the latest");
    let (slow, _) = searches_of_steps(2e-4 * CELL_M);
    assert!((4..20).contains(&slow), "{slow} searches");
    let (usual, _) = searches_of_steps(5e-3 * CELL_M);
    assert!((10..67).contains(&usual), "{usual} searches");
    let (fast, _) = searches_of_steps(0.3 * CELL_M);
    assert_eq!(fast, 200, "no list would serve for a second step");
}

#[test]
fn who_is_told_no_number_of_a_topology_remembers_nothing() {
    let scene = Scene::new();
    let words = table(&scene.points_m, CELL_M, Layout::Auto);
    let hash = HashRef::in_words(&words).unwrap();
    let (mut cull, mut out) = (Cull::for_nodes(128), vec![Hit::default(); 4096]);
    for split in [Split::Tets, Split::Points] {
        let share = Share { split, ..Share::ALL };
        let found = intersect(share, &hash, &scene.points(), &scene.tissue(), &mut cull, &mut out).unwrap();
        assert!(out[..found.count] == brute(&scene.points_m, &scene.points(), &scene.tissue()) && cull.searches() == 0);
    }
    // Of a share of the points, which are others in each step, nothing is remembered either.
    for index in 0..2 {
        let share = Share { index, count: 2, split: Split::Points };
        let found = intersect(share, &hash, &scene.points(), &scene.tissue(), cull.of(1), &mut out).unwrap();
        assert!(found.count > 0 && cull.searches() == 0);
    }
}

#[test]
fn a_single_point_is_met_in_the_step_in_which_it_comes_in_from_whichever_side() {
    let (positions_m, tets) = block([2, 2, 2], 1.0, [0.0; 3]);
    let tet_owner = vec![0; tets.len()];
    let (tissue, points) = (
        Tissue { positions_m: &positions_m, tets: &tets, tet_owner: &tet_owner },
        Points { owner: &[TOOL], node: &[], own: None },
    );
    for side in 0..6 {
        let (mut searches, mut met) = (Searches::of(1), 0);
        for step in 0..40 {
            let mut point_m = [0.4, 0.7, 1.3];
            let out_m = 0.1 - 0.005 * step as f32;
            point_m[side / 2] = if side % 2 == 0 { -out_m } else { 2.0 + out_m };
            let found = searches.hits(&[point_m], &points, &tissue, (1.0, 0));
            assert_eq!(words(&found), words(&brute(&[point_m], &points, &tissue)), "side {side}, step {step}");
            met += found.len();
        }
        assert!((18..21).contains(&met) && searches.searches() < 15, "met {met} times, {} searches", searches.searches());
    }
}

#[test]
fn a_point_that_was_nowhere_is_added_with_the_way_that_tissue_may_come_back() {
    let (rest_m, tets) = block([2, 2, 2], 1.0, [0.0; 3]);
    let (tet_owner, owner) = (vec![0; tets.len()], vec![TOOL; 17]);
    let points = Points { owner: &owner, node: &[], own: None };
    let mut searches = Searches::of(1);
    // The first list is made for 0.02. The tissue goes down by nearly all of that; a point comes, farther above it than a list reaches; the tissue comes back,
    // and it comes in.
    for (down_m, height_m, is_met) in [(0.0, f32::NAN, false), (0.018, 2.015, false), (0.0, 1.9995, true), (0.0, 1.9995, true)] {
        let positions_m: Vec<[f32; 3]> = rest_m.iter().map(|[x, y, z]| [*x, *y, z - down_m]).collect();
        let tissue = Tissue { positions_m: &positions_m, tets: &tets, tet_owner: &tet_owner };
        let mut points_m: Vec<[f32; 3]> = (0..16).map(|at| [0.3 + 0.1 * at as f32, 0.7, 1.0]).collect();
        points_m.push([0.4, 0.7, height_m]);
        let found = searches.hits(&points_m, &points, &tissue, (1.0, 0));
        assert_eq!(words(&found), words(&brute(&points_m, &points, &tissue)), "at {height_m}");
        assert_eq!(found.iter().any(|hit| hit.point == 16), is_met, "at {height_m}");
    }
    assert_eq!(searches.searches(), 2, "one for all, and one for the newcomer");
}

#[test]
fn another_share_of_the_tets_is_another_search() {
    let scene = Scene::new();
    let words = table(&scene.points_m, CELL_M, Layout::Auto);
    let hash = HashRef::in_words(&words).unwrap();
    let (mut cull, all) = (Cull::default(), brute(&scene.points_m, &scene.points(), &scene.tissue()));
    for (searches, (index, count)) in (1..).zip([(0, 2), (1, 2), (0, 3), (2, 3), (0, 1), (1, 2)]) {
        let mut out = vec![Hit::default(); 4096];
        let share = Share { index, count, split: Split::Tets };
        for _ in 0..2 {
            let found = intersect(share, &hash, &scene.points(), &scene.tissue(), cull.of(1), &mut out).unwrap();
            let is_of_share = |hit: &&Hit| hit.tet / 16 % count == index;
            let told: Vec<&Hit> = out[..found.count].iter().filter(|hit| all.contains(hit)).collect();
            assert!(all.iter().filter(is_of_share).all(|hit| told.contains(&hit)), "share {index} of {count}");
            assert_eq!(cull.searches(), searches);
        }
    }
}

/// A tet that was whole is nearly flat now, and the point beside it: where single precision would put it in, nothing is found with or without a list.
#[test]
fn rounding_puts_no_point_in_a_tet_that_became_nearly_flat() {
    let then = [
        [0.877_908_4, 0.886_385_74, 1.190_755_5],
        [0.403_785_83, 0.024_466_59, 0.452_391_86],
        [0.892_671_2, -0.531_280_94, 0.730_202_44],
        [-0.010_578_439, 0.340_070_07, 1.746_864_6],
    ];
    let now = [
        [0.677_908_4, 1.086_385_7, 0.990_755_44],
        [0.603_785_8, -0.175_533_41, 0.652_391_85],
        [0.692_671_24, -0.331_280_95, 0.530_202_45],
        [-0.210_578_44, 0.540_070_06, 1.546_864_5],
    ];
    let points = Points { owner: &[TOOL], node: &[], own: None };
    let mut searches = Searches::of(1);
    // Two steps as fast as that, so that a list is made for as far as one is made at most.
    let before = then.map(|corner: [f32; 3]| corner.map(|at| at - 0.1));
    let steps = [
        (before, [-0.15, 0.75, 1.5]),
        (then, [-0.135_243_62, 0.758_282_8, 1.501_442]),
        (now, [-0.100_243_62, 0.793_282_8, 1.536_442]),
    ];
    for (positions_m, point_m) in steps {
        let tissue = Tissue { positions_m: &positions_m, tets: &[[0, 1, 2, 3]], tet_owner: &[0] };
        let found = searches.hits(&[point_m], &points, &tissue, (1.0, 0));
        assert_eq!(words(&found), words(&brute(&[point_m], &points, &tissue)));
    }
    let corners = now.map(|corner| glam::DVec3::from_array(corner.map(f64::from)));
    let volume = (corners[1] - corners[0]).cross(corners[2] - corners[0]).dot(corners[3] - corners[0]);
    assert!(volume.abs() < 1e-4 && TetTest::new(&now).is_none(), "{volume}");
}
