//! Promise of the Main Loop about thin parts: a sheet of one layer of tets is not passed through, neither by a tool that comes fast nor by one that stays and
//! presses.

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

/// A folder that is gone, however its test ends.
struct Folder(std::path::PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A sheet whose rim is held, as a scene.
fn sheet(name: &str) -> Folder {
    let folder = Folder(std::env::temp_dir().join(format!("t{}-sheet-{name}", std::process::id())));
    std::fs::create_dir_all(&folder.0).unwrap();
    let cells = (SIDE_M / EDGE_M).round() as usize;
    let node = |x: usize, y: usize, z: usize| (z * (cells + 1) + y) * (cells + 1) + x;
    let mut mesh = "# vtk DataFile Version 3.0\nsheet\nASCII\nDATASET UNSTRUCTURED_GRID\n".to_owned();
    mesh += &format!("POINTS {} float\n", 2 * (cells + 1) * (cells + 1));
    for (z, y, x) in (0..2).flat_map(|z| (0..=cells).flat_map(move |y| (0..=cells).map(move |x| (z, y, x)))) {
        let at = |cell: usize| cell as f32 * EDGE_M - SIDE_M / 2.0;
        mesh += &format!("{} {} {}\n", at(x), at(y), FACE_M + z as f32 * THICK_M);
    }
    // Six tets about the diagonal of each cell, all of one handedness.
    let tets = 6 * cells * cells;
    mesh += &format!("CELLS {tets} {}\n", 5 * tets);
    for (x, y) in (0..cells).flat_map(|y| (0..cells).map(move |x| (x, y))) {
        for order in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [1, 0, 2], [0, 2, 1], [2, 1, 0]] {
            let mut at = [x, y, 0];
            let mut tet = vec![node(at[0], at[1], at[2])];
            for axis in order {
                at[axis] += 1;
                tet.push(node(at[0], at[1], at[2]));
            }
            if [[1, 0, 2], [0, 2, 1], [2, 1, 0]].contains(&order) {
                tet.swap(2, 3);
            }
            mesh += &format!("4 {} {} {} {}\n", tet[0], tet[1], tet[2], tet[3]);
        }
    }
    mesh += &format!("CELL_TYPES {tets}\n{}", "10\n".repeat(tets));
    std::fs::write(folder.0.join("sheet.vtk"), mesh).unwrap();
    let half = SIDE_M / 2.0;
    let rim = |low: [f32; 2], high: [f32; 2]| {
        let [low, high] = [low, high].map(|[x, y]| format!("[{:.4}, {:.4}", x, y));
        format!("{{ box = {{ min_m = {low}, 0.0], max_m = {high}, 0.1] }} }}")
    };
    let (inner, outer) = (half - 1e-4, half + 1e-4);
    let held = [
        rim([-outer, -outer], [-inner, outer]),
        rim([inner, -outer], [outer, outer]),
        rim([-outer, -outer], [outer, -inner]),
        rim([-outer, inner], [outer, outer]),
    ];
    let scene = format!(
        "version = 1\nname = \"A sheet\"\n[[deformable]]\nname = \"sheet\"\nmesh = \"sheet.vtk\"\nscale_to_m = 1.0\nfixed = [{}]\n\
         [[rigid]]\nname = \"hysteroscope\"\nkind = \"hysteroscope\"\n",
        held.join(", ")
    );
    std::fs::write(folder.0.join("scene.toml"), scene).unwrap();
    folder
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
    let (station, pages) = founded(name, &format!("workers = 0\nscene = {:?}", folder.0.join("scene.toml")));
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
