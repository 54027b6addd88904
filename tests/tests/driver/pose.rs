//! What becomes of the place that a driver in C measures: its tip is about the scene's pivot, wherever that is.

use super::window::Empty;
use super::{compile, example};
use hyst_recording::Recording;
use hyst_scene::Pose;
use station_tests::{Folder, hystation, run};
use std::path::Path;

/// A driver that gives the same sample twice.
const GIVES: &str = r#"#define _GNU_SOURCE
#include "hystation_driver.h"
int main(int argc, char **argv) {
    static hyst_driver driver;
    int code = hyst_begin(&driver, argc, argv);
    if (code >= 0) return code;
    hyst_statement statement = {.version = HYST_STATEMENT_VERSION, .rate_hz = 1000.0f, .max_force_n = 1.0f};
    hyst_state(&driver, &statement);
    hyst_sample sample = {.pose = hyst_pose_of(0.1f, 0.2f, 0.3f, 0.04f)};
    hyst_give(&driver, &sample);
    hyst_give(&driver, &sample);
    return hyst_end(&driver);
}
"#;

/// How far two points may be apart by rounding, m.
const ROUNDING_M: f32 = 1e-6;

fn is_near(found_m: [f32; 3], wanted_m: [f32; 3]) -> bool {
    found_m.iter().zip(wanted_m).all(|(found, wanted)| (found - wanted).abs() < ROUNDING_M)
}

#[test]
fn a_driver_in_c_gives_its_tip_about_the_pivot_that_the_scene_has() {
    let folder = Folder::new("driver-pivot");
    let program = compile(&folder, "gives", Path::new(&folder.write("gives.c", GIVES)), &[]);
    let about_m = Pose { pitch_rad: 0.1, yaw_rad: 0.2, roll_rad: 0.3, insertion_m: 0.04 }.tip_m([0.0; 3]);
    let mut empty = Empty::new("pivot");
    empty.live(&program);
    let found_m = empty.sample().pose.position_m;
    assert!(is_near(found_m, about_m), "without a scene: {found_m:?}");

    let pivot_m = [0.25f32, -0.5, 1.0];
    std::fs::write(empty.station.pivot(), pivot_m.map(f32::to_ne_bytes).concat()).expect("a file");
    empty.live(&program);
    let found_m = empty.sample().pose.position_m;
    assert!(is_near(found_m, std::array::from_fn(|axis| about_m[axis] + pivot_m[axis])), "{found_m:?}");

    std::fs::write(empty.station.pivot(), [0u8; 7]).expect("a file");
    let (code, _, said) = empty.run(&program);
    assert!(code == Some(2) && said.contains("pivot"), "of one that is cut off: {code:?} {said}");
}

/// There the tip was as far beside its place as the pivot lies beside the origin.
#[test]
fn a_station_tells_its_driver_where_the_scene_has_its_pivot() {
    const BACK_M: f32 = 0.002;
    let folder = Folder::new("driver-moved");
    let (scene, driver) = (folder.scene(), example(&folder, 0));
    let text = std::fs::read_to_string(&scene).expect("a scene");
    let at_origin = "pivot_m = [0.0, 0.0, 0.0]";
    assert!(text.contains(at_origin), "{text}");
    std::fs::write(&scene, text.replace(at_origin, &format!("pivot_m = [0.0, 0.0, -{BACK_M}]"))).expect("the scene");
    let (name, file) = (format!("moved-{}", std::process::id()), folder.path("session.mcap"));
    let words = ["--name", &name, "run", &scene, "--headless", "--quiet", "--for", "2s", "--record", &file, "--driver"];
    let (code, out, said) = run(hystation().args(words).arg(driver));
    assert!(matches!(code, Some(0 | 3)), "{code:?} {out}{said}");
    let recording = Recording::read(Path::new(&file)).expect("the recording");
    let poses: Vec<_> =
        recording.applied().iter().map(|record| record.sample.pose).filter(|pose| pose.insertion_m > 0.0).collect();
    assert!(poses.len() > 1_000, "{} ticks", poses.len());
    for pose in poses {
        let about = Pose { pitch_rad: pose.pitch_rad, yaw_rad: pose.yaw_rad, roll_rad: 0.0, insertion_m: pose.insertion_m };
        assert!(is_near(pose.position_m, about.tip_m([0.0, 0.0, -BACK_M])), "{pose:?}");
    }
}
