//! A session is hours of pictures: a frame must leave nothing behind, neither memory nor code. Alone in its process, whose memory it counts.
mod stand;

use rendering::{FluidField, Material, Overlay, shapes};
use stand::*;

const TOOL: u64 = 9;
/// Frames until everything has been compiled and allocated.
const WARM: usize = 30;
const FRAMES: usize = 60;

/// Mappings that hold code and belong to no file: what a driver has compiled.
fn compiled() -> usize {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    maps.lines().filter(|line| line.split_whitespace().nth(1) == Some("r-xp") && line.split_whitespace().count() == 5).count()
}

fn anonymous_kib() -> i64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:")).unwrap();
    line.split_whitespace().next().unwrap().parse().unwrap()
}

#[test]
fn a_frame_leaves_neither_memory_nor_code_behind() {
    let Some((mut r, cavity)) = in_cavity() else { return };
    let tool = shapes::scope(0.003, 0.3, 0.2);
    put(&mut r, TOOL, &tool, Material::Metal);
    let density = [0.5; 384];
    let mut draw = |frames: std::ops::Range<usize>| {
        for frame in frames {
            let mut view = if frame % 3 == 2 { from_outside() } else { through_scope() };
            view.overlay = Overlay { lines: vec![format!("P {frame}")], sign: ["", "!"][frame % 2].into() };
            view.quality.scale = [1.0, 0.5][frame / 10 % 2];
            view.quality.focus = frame % 5 != 0;
            let field = FluidField {
                dims: [8, 8, 6],
                min_m: [-0.02, -0.02, 0.0],
                max_m: [0.02, 0.02, 0.06],
                density: &density,
                extinction_per_m: 60.0,
            };
            r.set_fluid((frame % 4 != 0).then_some(field)).unwrap();
            r.stage().update_positions(CAVITY, &cavity.positions_m).unwrap();
            r.render(&view).unwrap();
        }
    };
    draw(0..WARM);
    let before = (compiled(), anonymous_kib());
    draw(WARM..WARM + FRAMES);
    let after = (compiled(), anonymous_kib());
    assert_eq!(after.0, before.0, "the driver compiles while it draws");
    assert!(after.1 - before.1 < 50 * FRAMES as i64, "{} KiB in {FRAMES} frames", after.1 - before.1);
}
