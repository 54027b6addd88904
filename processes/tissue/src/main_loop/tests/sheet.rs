//! Promise of the Main Loop about thin parts: a sheet of one layer of tets is not passed through, neither by a tool that comes fast nor by one that stays and
//! presses.

use super::lattice::{self, Lattice};
use super::*;

/// Sides and thickness of the sheet, m, and its tets' edge along the sides.
const SIDE_M: f32 = 0.024;
const THICK_M: f32 = 1e-3;
const EDGE_M: f32 = 2e-3;
/// Where its near face is, m, before the tip, which comes along +z.
const FACE_M: f32 = 0.03;
/// From where to where the tip goes, m beyond the near face.
const WAY_M: [f32; 2] = [-0.006, 0.008];
/// Ticks in which the tip stays there.
const STAY: u64 = 150;
/// Nodes that are nearer than this to the axis are before the tip, m.
const BEFORE_M: f32 = 1.5e-3;
/// How deep the tip may lie in the face that it presses on, m.
const DEEP_M: f32 = 0.8e-3;

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

/// What came of a run.
struct Met {
    /// Force on the tip back along its way at the end, N.
    back_n: f32,
    /// How far the hindmost of the nodes near the axis is before the tip at the end, m; negative behind it.
    before_m: f32,
}

/// So many ticks with the tip at a place and with a speed along z, m and m/s.
fn run(name: &str, ticks: u64, tip: impl Fn(u64) -> (f32, f32)) -> Met {
    let folder = sheet(name);
    let (station, pages) = founded(name, &format!("workers = 0\nscene = {:?}", folder.scene()));
    let life = Life::begin(station.name(), Slot::first(Role::Tissue), 1).unwrap();
    let mut inbox = usher(&station, None, 1, Vec::new()).unwrap();
    let mut main = engine(&station, &life, &mut inbox);
    let mut now = first_state(&mut main);
    let nodes = main.world.model.node_count();
    let is_near = |rest: &[f32; 3]| rest[0].hypot(rest[1]) < BEFORE_M && rest[2] < FACE_M + 0.5 * THICK_M;
    let near: Vec<usize> = (0..nodes).filter(|node| is_near(&main.world.model.rest_m()[*node])).collect();
    assert!(!near.is_empty());
    let mut met = Met { back_n: 0.0, before_m: f32::MAX };
    for tick in 1..=ticks {
        let (z, speed_m_s) = tip(tick);
        let mut record = InputRecord { tick, pressure_pa: main.world.case.rest_pressure_pa, ..InputRecord::default() };
        record.sample.pose = Pose { position_m: [1e-4, 2e-4, z], orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
        record.sample.velocity_m_s = [0.0, 0.0, speed_m_s];
        now = fed(&mut main, &pages[1], &now, &record);
        assert!(main.accepts(bytemuck::cast_slice(&now)), "{name}: the state of tick {tick} is none");
        met.back_n = -core_of(&now).force_n[2];
        met.before_m = near.iter().map(|node| positions(&now)[*node][2] - z).fold(f32::MAX, f32::min);
    }
    met
}

#[test]
fn a_sheet_of_one_layer_is_not_passed_through_however_fast_the_tool_comes() {
    let mut slow_n = None;
    for speed_m_s in [0.02f32, 0.5, 2.0] {
        let way = ((WAY_M[1] - WAY_M[0]) / (speed_m_s * 1e-3)).ceil() as u64;
        let met = run(&format!("fast{}", 1e3 * speed_m_s), way + STAY, |tick| {
            let share = tick.min(way) as f32 / way as f32;
            (FACE_M + WAY_M[0] + share * (WAY_M[1] - WAY_M[0]), if tick <= way { speed_m_s } else { 0.0 })
        });
        println!("{speed_m_s} m/s: {:.3} N back, the face {:.2} mm before the tip", met.back_n, 1e3 * met.before_m);
        assert!(met.before_m > -DEEP_M, "{speed_m_s} m/s: the tip is {} m beyond the face that it met", -met.before_m);
        // However it came there, the sheet that it has stretched pulls as much.
        let slow_n = *slow_n.get_or_insert(met.back_n);
        assert!(met.back_n > 0.1 && (met.back_n / slow_n - 1.0).abs() < 0.2, "{speed_m_s} m/s: {} N, not {slow_n}", met.back_n);
    }
}
