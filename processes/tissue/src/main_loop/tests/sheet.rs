//! Promise of the Main Loop about thin parts: a sheet of one layer of tets is not passed through, neither by a tool that comes fast nor by one that stays and
//! presses, in steps of each length; and what the tool has gone through holds it also where it lies in another object behind that.

use super::lattice::{self, Lattice};
use super::*;
use glam::Vec3;
use hyst_contact::Memory;
use hyst_tissue::PlaneSpring;

/// Sides and thickness of the sheet, m, and its tets' edge along the sides.
const SIDE_M: f32 = 0.024;
const THICK_M: f32 = 1e-3;
const EDGE_M: f32 = 2e-3;
/// Where its near face is, m, before the tip, which comes along +z.
const FACE_M: f32 = 0.03;
/// From where to where the tip goes, m beyond the near face.
const WAY_M: [f32; 2] = [-0.006, 0.008];
/// Steps in which the tip stays there: what has passed through is brought back by so much in each, however long they are.
const STAY: u64 = 150;
/// Ticks after it has come out again, and how far from its place a node may be then, m.
const AFTER: u64 = 500;
const LEFT_M: f32 = 0.2e-3;
/// Nodes that are nearer than this to the axis are before the tip, m.
const BEFORE_M: f32 = 1.5e-3;
/// How deep the tip may lie in the face that it presses on, m.
const DEEP_M: f32 = 0.8e-3;
/// Layers of cells of a sheet, of nothing behind it, and of a block behind that.
const LAYERS: usize = 8;
/// How far the block is behind the sheet, m: not at all where they lie in each other.
const GAPS_M: [f32; 2] = [0.2e-3, -0.5e-3];
/// From where to where the tip goes then, m beyond the place of the sheet's near face at rest: from before the sheet into the block.
const INTO_BLOCK_M: [f32; 2] = [-0.5e-3, 3.4e-3];
/// By how much what a point remembers may differ from where it is, m: roundings.
const EXACT_M: f32 = 1e-5;

/// A sheet whose rim is held, as a scene.
fn sheet(name: &str) -> lattice::Folder {
    let cells = (SIDE_M / EDGE_M).round() as usize;
    let half = SIDE_M / 2.0;
    let lattice = Lattice { cells: [cells, cells, 1], edge_m: [EDGE_M, EDGE_M, THICK_M], low_m: [-half, -half, FACE_M] };
    let (inner, outer) = (half - 1e-4, half + 1e-4);
    let rim = |[low_x, low_y]: [f32; 2], [high_x, high_y]: [f32; 2]| {
        format!("{{ box = {{ min_m = [{low_x:.4}, {low_y:.4}, 0.0], max_m = [{high_x:.4}, {high_y:.4}, 0.1] }} }}")
    };
    let held = [
        rim([-outer, -outer], [-inner, outer]),
        rim([inner, -outer], [outer, outer]),
        rim([-outer, -outer], [outer, -inner]),
        rim([-outer, inner], [outer, outer]),
    ];
    lattice::scene(name, &lattice, |_| true, &held.join(", "))
}

/// A sheet and a block behind it that hang apart: two organs, of which nothing moves but the far side of the block. So all is where geometry says.
fn sheet_and_block(name: &str) -> lattice::Folder {
    let (cells, half) = ((SIDE_M / EDGE_M).round() as usize, SIDE_M / 2.0);
    let lattice = Lattice { cells: [cells, cells, LAYERS], edge_m: [EDGE_M, EDGE_M, THICK_M], low_m: [-half, -half, FACE_M] };
    let fixed = format!("{{ below_z_m = {:.4} }}", FACE_M + (LAYERS as f32 - 0.5) * THICK_M);
    lattice::scene(name, &lattice, |[_, _, z]| z != 1, &fixed)
}

/// Whether a node that is there at rest is one of the sheet.
fn is_of_sheet(rest: &[f32; 3]) -> bool {
    rest[2] < FACE_M + 1.5 * THICK_M
}

/// A tissue with a sheet before a tool, and the tool.
struct Bench<'a> {
    main: MainLoop<'a>,
    device: &'a OwnedPage,
    now: Vec<u64>,
    tick: u64,
    tip_m: [f32; 3],
}

impl Bench<'_> {
    /// The tip goes straight to a place with a speed, m/s, and stays there for so many ticks.
    fn go(&mut self, to_m: [f32; 3], speed_m_s: f32, stay: u64) {
        let from = Vec3::from(self.tip_m);
        let way = Vec3::from(to_m) - from;
        let ticks = (way.length() / (speed_m_s * 1e-3)).ceil().max(1.0) as u64;
        for tick in 1..=ticks + stay {
            let share = tick.min(ticks) as f32 / ticks as f32;
            self.tip_m = (from + share * way).to_array();
            self.tick += 1;
            if !is_read(&self.main, self.tick) {
                continue;
            }
            let mut record =
                InputRecord { tick: self.tick, pressure_pa: self.main.world.case.rest_pressure_pa, ..InputRecord::default() };
            record.sample.pose = Pose { position_m: self.tip_m, orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
            record.sample.velocity_m_s = if tick <= ticks { (way / (ticks as f32 * 1e-3)).to_array() } else { [0.0; 3] };
            self.now = fed(&mut self.main, self.device, &self.now, &record);
            assert!(self.main.accepts(bytemuck::cast_slice(&self.now)), "the state of tick {} is none", self.tick);
        }
    }

    /// Force on the tip, N.
    fn force_n(&self) -> [f32; 3] {
        core_of(&self.now).force_n
    }

    /// How far the hindmost of the nodes before the tip is in front of it, m; negative behind it.
    fn before_m(&self) -> f32 {
        let is_before = |rest: &[f32; 3]| rest[0].hypot(rest[1]) < BEFORE_M && rest[2] < FACE_M + 0.5 * THICK_M;
        let nodes = positions(&self.now).iter().zip(self.main.world.model.rest_m());
        let before_m = nodes.filter(|(_, rest)| is_before(rest)).map(|(place, _)| place[2] - self.tip_m[2]);
        before_m.reduce(f32::min).expect("nodes before the tip")
    }

    /// The sheet is so far from the block, wherever it was.
    fn part(&mut self, gap_m: f32) {
        let range = place_of(&self.now, 1);
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(&mut self.now);
        let places: &mut [[f32; 3]] = bytemuck::cast_slice_mut(&mut bytes[range]);
        let nodes = places.iter_mut().zip(self.main.world.model.rest_m());
        nodes.filter(|(_, rest)| is_of_sheet(rest)).for_each(|(place, rest)| place[2] = rest[2] + THICK_M - gap_m);
    }

    /// What the points of the tool remember.
    fn memory(&self) -> &[Memory] {
        Message::parse(bytemuck::cast_slice(&self.now), Kind::TissueState).unwrap().section(4).unwrap()
    }

    /// Each point beyond the near face of a sheet so far from the block knows the sheet, the way back and how long that is, and is one contact with the sheet,
    /// wherever else it lies; no other point knows anything. How many are beyond that face, and how many of them beyond that of the block.
    fn held(&self, gap_m: f32) -> [usize; 2] {
        let (world, rest_m) = (&self.main.world, self.main.world.model.rest_m());
        let (near_m, block_m) = (FACE_M + THICK_M - gap_m, FACE_M + 2.0 * THICK_M);
        let sheet = world.body.owners().into_iter().zip(rest_m).find(|(_, rest)| is_of_sheet(rest));
        let sheet = sheet.and_then(|(owner, _)| owner).expect("a sheet");
        let there = self.main.points_m.iter().zip(self.memory()).filter(|(place, _)| place[2].is_finite());
        let (beyond, before): (Vec<_>, Vec<_>) = there.partition(|(place, _)| place[2] > near_m);
        assert!(before.iter().all(|(_, memory)| **memory == Memory::default()), "a point that is in nothing knows something");
        for (place, memory) in &beyond {
            let is_exact = (memory.depth_m - (place[2] - near_m)).abs() < EXACT_M && memory.direction[2] < -0.999;
            assert!(memory.owner == sheet && is_exact, "{gap_m} m: {place:?} knows {memory:?}");
        }
        let is_of_it = |spring: &&PlaneSpring| spring.nodes.iter().all(|node| is_of_sheet(&rest_m[*node as usize]));
        let contacts = self.main.contacts.springs().iter().filter(is_of_it).count();
        assert_eq!(contacts, beyond.len(), "{gap_m} m: contacts with the sheet");
        [beyond.len(), beyond.iter().filter(|(place, _)| place[2] > block_m).count()]
    }
}

/// A tool and a sheet, in steps of so many ticks.
fn with_sheet(step_ticks: u64, name: &str, tip_m: [f32; 3], try_it: impl FnOnce(&mut Bench<'_>)) {
    with_scene(step_ticks, (name, &sheet(name)), tip_m, try_it);
}

/// The same with a sheet of a scene.
fn with_scene(step_ticks: u64, (name, folder): (&str, &lattice::Folder), tip_m: [f32; 3], try_it: impl FnOnce(&mut Bench<'_>)) {
    let (station, pages, life, mut inbox) = begun_with(step_ticks, name, &format!("workers = 0\nscene = {:?}", folder.scene()));
    let mut main = engine(&station, &life, &mut inbox);
    let now = first_state(&mut main);
    let mut bench = Bench { main, device: &pages[1], now, tick: 0, tip_m };
    // What lies between the tool's place in the first state and its way here is no way that it came. That takes a step.
    bench.go(tip_m, 1.0, step_ticks - 1);
    try_it(&mut bench);
}

/// Comes at the sheet with some speeds, in steps of so many ticks.
fn is_not_passed_in_steps_of(step_ticks: u64) {
    let [from_m, to_m] = WAY_M.map(|beyond_m| [1e-4, 2e-4, FACE_M + beyond_m]);
    let mut slow_n = None;
    for speed_m_s in [0.02f32, 0.5, 2.0] {
        with_sheet(step_ticks, &format!("f{step_ticks}-{}", 1e3 * speed_m_s), from_m, |bench| {
            bench.go(to_m, speed_m_s, STAY);
            let soon_m = bench.before_m();
            bench.go(to_m, speed_m_s, STAY * (step_ticks - 1));
            let (back_n, before_m) = (-bench.force_n()[2], bench.before_m());
            // Out again as fast as it came, the sheet is let go.
            bench.go(from_m, speed_m_s, AFTER);
            let (left_n, left_m) = (Vec3::from(bench.force_n()).length(), displaced_m(&bench.main, &bench.now));
            println!(
                "{speed_m_s} m/s, steps of {step_ticks}: {back_n:.3} N back, the face {:.2} mm before the tip ({:.2} after {STAY} ticks); \
                 out again {left_n:.3} N, {:.2} mm from rest",
                1e3 * before_m,
                1e3 * soon_m,
                1e3 * left_m
            );
            assert!(before_m > -DEEP_M, "{speed_m_s} m/s: the tip is {} m beyond the face that it met", -before_m);
            // However it came there, the sheet that it has stretched pulls as much.
            let slow_n = *slow_n.get_or_insert(back_n);
            assert!(back_n > 0.1 && (back_n / slow_n - 1.0).abs() < 0.2, "{speed_m_s} m/s: {back_n} N, not {slow_n}");
            assert!(left_n == 0.0 && left_m < LEFT_M, "{speed_m_s} m/s: {left_n} N and {left_m} m are left");
        });
    }
}

#[test]
fn a_sheet_of_one_layer_is_not_passed_through_however_fast_the_tool_comes() {
    is_not_passed_in_steps_of(1);
}

#[test]
fn nor_is_it_in_steps_of_two_ticks() {
    is_not_passed_in_steps_of(2);
}

/// Between two of them the fastest tip goes eight times as far as the sheet is thick.
#[test]
fn nor_is_it_in_steps_of_four_ticks() {
    is_not_passed_in_steps_of(4);
}

/// What is not held any more: a tool that has come beside the sheet by way of its rim, though it lay in it until then, and one that was always beside it.
#[test]
fn a_tool_that_slides_off_the_rim_is_let_go_and_one_beside_it_meets_nothing() {
    let off_m = SIDE_M / 2.0 + 6e-3;
    with_sheet(1, "rim", [6e-3, 2e-4, FACE_M - 4e-3], |bench| {
        bench.go([8e-3, 2e-4, FACE_M + DEEP_M], 0.1, 50);
        assert!(core_of(&bench.now).contact_count > 0 && bench.force_n()[2] < 0.0, "{:?} N: it is not met", bench.force_n());
        bench.go([off_m, 2e-4, FACE_M + DEEP_M], 0.2, 0);
        bench.go([off_m, 2e-4, FACE_M + 8e-3], 2.0, 20);
        assert_eq!(bench.force_n(), [0.0; 3], "beside the sheet");
    });
}

/// Slowly, so that each step sees a point in the sheet before it is in the block; and so fast that none does.
#[test]
fn what_is_passed_holds_the_tool_also_where_that_lies_in_another_object_behind() {
    let [from_m, to_m] = INTO_BLOCK_M.map(|beyond_m| [1e-4, 2e-4, FACE_M + beyond_m]);
    for (step_ticks, speed_m_s) in [(1, 0.02f32), (1, 2.0), (4, 2.0)] {
        let name = format!("b{step_ticks}-{}", 1e3 * speed_m_s);
        with_scene(step_ticks, (name.as_str(), &sheet_and_block(&name)), from_m, |bench| {
            assert_eq!(bench.main.world.points.organs, vec![0u32, 1]);
            for gap_m in GAPS_M {
                bench.part(gap_m);
                bench.go(to_m, speed_m_s, 2 * step_ticks);
                let [beyond, deep] = bench.held(gap_m);
                println!("{name}, {gap_m} m apart: {beyond} points are beyond the near face, {deep} of them in the block");
                assert!(deep > 50 && beyond > deep, "{deep} of {beyond} points are in the block");
                bench.go(from_m, speed_m_s, 2 * step_ticks);
                assert_eq!(bench.held(gap_m), [0; 2]);
                assert_eq!(bench.force_n(), [0.0; 3], "{name}: it is out again");
            }
        });
    }
}
