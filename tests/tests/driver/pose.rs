//! What becomes of the place that a driver in C measures: its tip is about the scene's pivot, wherever that is.

use super::window::Empty;
use super::{FOLDER, compile, example};
use hyst_recording::Recording;
use hyst_scene::Pose;
use station_tests::{Folder, RECOVERY_LIMIT, Station, hystation, run, wait_for};
use std::path::Path;
use std::process::Command;

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

/// A driver that says which poses it makes of the tips at some points, with a roll.
const MAKES: &str = r#"#define _GNU_SOURCE
#include "hystation_driver.h"
int main(void) {
    static const float points_m[][3] = {POINTS};
    for (size_t i = 0; i < sizeof points_m / sizeof *points_m; i++) {
        hyst_pose it = hyst_pose_at(points_m[i], ROLL);
        printf("%.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g\n", it.position_m[0], it.position_m[1], it.position_m[2], it.pitch_rad, it.yaw_rad,
               it.roll_rad, it.insertion_m, it.orientation[0], it.orientation[1], it.orientation[2], it.orientation[3]);
    }
    return 0;
}
"#;
const ROLL_RAD: f32 = 0.3;
/// Straight ahead, to each side, far off the axis, deep, and at the pivot.
const POINTS_M: [[f32; 3]; 8] = [
    [0.0, 0.0, 0.045],
    [0.01, 0.0, 0.045],
    [-0.01, 0.0, 0.045],
    [0.0, 0.01, 0.045],
    [0.0, -0.01, 0.045],
    [0.03, -0.02, 0.01],
    [0.05, 0.02, 0.4],
    [0.0, 0.0, 0.0],
];

/// How far two points may be apart by rounding, m.
const ROUNDING_M: f32 = 1e-6;
/// And two angles, rad, or parts of a unit quaternion.
const ROUNDING: f32 = 1e-5;

fn is_near(found_m: [f32; 3], wanted_m: [f32; 3]) -> bool {
    found_m.iter().zip(wanted_m).all(|(found, wanted)| (found - wanted).abs() < ROUNDING_M)
}

#[test]
fn the_header_makes_of_where_a_tip_is_the_pose_of_a_scope_through_the_pivot() {
    let folder = Folder::new("driver-pose");
    let row = |point_m: [f32; 3]| format!("{{{}}}", point_m.map(|c| format!("{c:?}f")).join(", "));
    let source =
        MAKES.replace("{POINTS}", &format!("{{{}}}", POINTS_M.map(row).join(", "))).replace("ROLL", &format!("{ROLL_RAD:?}f"));
    let program = compile(&folder, "makes", Path::new(&folder.write("makes.c", &source)), &[]);
    let (code, out, said) = run(&mut Command::new(program));
    assert_eq!((code, out.lines().count()), (Some(0), POINTS_M.len()), "{out}{said}");
    for (point_m, line) in POINTS_M.into_iter().zip(out.lines()) {
        let found: Vec<f32> = line.split(' ').map(|word| word.parse().expect("a number")).collect();
        // At the pivot itself a tip has no direction.
        let aimed = Pose::aim([0.0; 3], point_m).unwrap_or_default();
        let wanted = Pose { roll_rad: ROLL_RAD, ..aimed };
        let [x, y, z] = wanted.tip_m([0.0; 3]);
        let [qx, qy, qz, qw] = wanted.orientation();
        let all = [x, y, z, wanted.pitch_rad, wanted.yaw_rad, ROLL_RAD, wanted.insertion_m, qx, qy, qz, qw];
        let is_it = found.len() == all.len() && found.iter().zip(all).all(|(found, wanted)| (found - wanted).abs() < ROUNDING);
        assert!(is_it, "{point_m:?}: {found:?} is not {all:?}");
        assert!(is_near([found[0], found[1], found[2]], point_m), "{point_m:?}: {found:?}");
    }
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

/// The free side and the polyp's are balls of 5 mm, 6 mm to either side of the middle; what else is asked for lies ahead, or may be farther off.
#[test]
fn what_a_case_asks_for_beyond_the_workspace_that_a_driver_states_is_said_at_the_start() {
    let folder = Folder::new("driver-reach");
    let driver = compile(&folder, "narrow", &Path::new(FOLDER).join("example_driver.c"), &["-DYAW_RAD=0.0f"]);
    let case = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/cases/navigation.toml");
    let station = Station::start("reach", &[case, "--driver", &driver.to_string_lossy()]);
    let told = wait_for(RECOVERY_LIMIT, || station.said().contains("ends short of what the case asks for").then_some(()));
    let said = station.said();
    assert!(told.is_some() && said.contains("free side (1 mm), polyp's side (1 mm)"), "{said}");
    station.stop();
}
