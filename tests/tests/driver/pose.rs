//! What becomes of the place that a driver in C measures: its tip is about the scene's pivot, wherever that is.

use super::window::Empty;
use super::{FOLDER, compile, example};
use hyst_messages::{DeviceLimits, DeviceStatement, HardwareSample};
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

/// A driver that says which poses it makes of the tips at some points, with a roll: of each as it is, and within what it states.
const MAKES: &str = r#"#define _GNU_SOURCE
#include "hystation_driver.h"
int main(void) {
    static const float points_m[][3] = {POINTS};
    static hyst_driver driver = {.stated = {
        .pitch_rad = {-STOP, STOP}, .yaw_rad = {-STOP, STOP}, .roll_rad = {-3.0f, 3.0f}, .insertion_m = {0.0f, DEEPEST},
    }};
    for (size_t i = 0; i < 2 * (sizeof points_m / sizeof *points_m); i++) {
        hyst_pose it = hyst_pose_at(points_m[i / 2], ROLL);
        if (i % 2 == 1) it = hyst_within(&driver, it);
        printf("%.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g %.9g\n", it.position_m[0], it.position_m[1], it.position_m[2], it.pitch_rad, it.yaw_rad,
               it.roll_rad, it.insertion_m, it.orientation[0], it.orientation[1], it.orientation[2], it.orientation[3]);
    }
    return 0;
}
"#;
const ROLL_RAD: f32 = 0.3;
/// What it states: how far it tilts to each side, rad, and how deep it goes, m.
const STOP_RAD: f32 = 0.6;
const DEEPEST_M: f32 = 0.1;
/// Straight ahead, to each side, far off the axis, deep, at the pivot, behind it, and beside it.
const POINTS_M: [[f32; 3]; 11] = [
    [0.0, 0.0, 0.045],
    [0.01, 0.0, 0.045],
    [-0.01, 0.0, 0.045],
    [0.0, 0.01, 0.045],
    [0.0, -0.01, 0.045],
    [0.03, -0.02, 0.01],
    [0.05, 0.02, 0.4],
    [0.0, 0.0, 0.0],
    [0.0, 0.0, -0.02],
    [0.005, 0.002, -0.01],
    [0.02, 0.0, 0.0],
];

/// How far two points may be apart by rounding, m.
const ROUNDING_M: f32 = 1e-6;
/// And two angles, rad, or parts of a unit quaternion.
const ROUNDING: f32 = 1e-5;

fn is_near(found_m: [f32; 3], wanted_m: [f32; 3]) -> bool {
    found_m.iter().zip(wanted_m).all(|(found, wanted)| (found - wanted).abs() < ROUNDING_M)
}

/// What a driver in C makes of the tips at some points: of each the pose as it is, and within what it states.
fn made(folder: &Folder, points_m: &[[f32; 3]]) -> Vec<[hyst_messages::Pose; 2]> {
    let row = |point_m: &[f32; 3]| format!("{{{}}}", point_m.map(|c| format!("{c:?}f")).join(", "));
    let rows: Vec<String> = points_m.iter().map(row).collect();
    let mut source = MAKES.replace("{POINTS}", &format!("{{{}}}", rows.join(", ")));
    for (word, value) in [("ROLL", ROLL_RAD), ("STOP", STOP_RAD), ("DEEPEST", DEEPEST_M)] {
        source = source.replace(word, &format!("{value:?}f"));
    }
    let program = compile(folder, "makes", Path::new(&folder.write("makes.c", &source)), &[]);
    let (code, out, said) = run(&mut Command::new(program));
    let pose = |line: &str| {
        let word: Vec<f32> = line.split(' ').map(|word| word.parse().expect("a number")).collect();
        let [x, y, z, pitch_rad, yaw_rad, roll_rad, insertion_m, qx, qy, qz, qw] = word[..] else { panic!("{line}") };
        let (position_m, orientation) = ([x, y, z], [qx, qy, qz, qw]);
        hyst_messages::Pose { position_m, pitch_rad, orientation, yaw_rad, roll_rad, insertion_m, camera_roll_rad: 0.0 }
    };
    let poses: Vec<hyst_messages::Pose> = out.lines().map(pose).collect();
    assert_eq!((code, poses.len()), (Some(0), 2 * points_m.len()), "{out}{said}");
    poses.chunks(2).map(|two| [two[0], two[1]]).collect()
}

#[test]
fn the_header_makes_of_where_a_tip_is_the_pose_of_a_scope_through_the_pivot() {
    let folder = Folder::new("driver-pose");
    for (point_m, [found, _]) in POINTS_M.into_iter().zip(made(&folder, &POINTS_M)) {
        // Beside and behind the pivot the scope is drawn out; at the pivot itself a tip has no direction.
        let tip_m = if point_m[2] > 0.0 { point_m } else { [0.0; 3] };
        let wanted = Pose { roll_rad: ROLL_RAD, ..Pose::aim([0.0; 3], tip_m).unwrap_or_default() };
        let all = |position_m: [f32; 3], angles: [f32; 4], orientation: [f32; 4]| {
            [&position_m[..], &angles[..], &orientation[..]].concat()
        };
        let wanted_angles = [wanted.pitch_rad, wanted.yaw_rad, ROLL_RAD, wanted.insertion_m];
        let wanted = all(wanted.tip_m([0.0; 3]), wanted_angles, wanted.orientation());
        let found_angles = [found.pitch_rad, found.yaw_rad, found.roll_rad, found.insertion_m];
        let numbers = all(found.position_m, found_angles, found.orientation);
        let is_it = numbers.iter().zip(&wanted).all(|(found, wanted)| (found - wanted).abs() < ROUNDING);
        assert!(is_it, "{point_m:?}: {numbers:?} is not {wanted:?}");
        assert!(is_near(found.position_m, tip_m), "{point_m:?}: {found:?}");
    }
}

/// Real devices have no stop there: each sample was refused, and the picture stood.
#[test]
fn a_tip_that_goes_beyond_what_a_driver_states_is_kept_within_and_does_not_jump() {
    const STEPS: usize = 200;
    // Half a millimetre or less from one point to the next: drawn out behind the pivot on the axis, beside it and far beside it; aside; too deep; past
    // the pivot, behind it.
    let ways_m: [[[f32; 3]; 2]; 6] = [
        [[0.0, 0.0, 0.05], [0.0, 0.0, -0.05]],
        [[0.005, 0.002, 0.05], [0.005, 0.002, -0.05]],
        [[0.03, -0.03, 0.05], [0.03, -0.03, -0.05]],
        [[-0.04, 0.0, 0.045], [0.06, 0.0, 0.045]],
        [[0.01, 0.0, 0.05], [0.01, 0.0, 0.15]],
        [[0.04, 0.03, -0.01], [-0.05, 0.0, -0.01]],
    ];
    let along = |[from_m, to_m]: [[f32; 3]; 2]| {
        (0..=STEPS).map(move |step| -> [f32; 3] {
            let share = step as f32 / STEPS as f32;
            std::array::from_fn(|axis| from_m[axis] + share * (to_m[axis] - from_m[axis]))
        })
    };
    let points_m: Vec<[f32; 3]> = ways_m.into_iter().flat_map(along).collect();
    let folder = Folder::new("driver-within");
    let angle = [-STOP_RAD, STOP_RAD];
    let stated = DeviceStatement {
        limits: DeviceLimits { max_force_n: 1.0, ..DeviceLimits::default() },
        pitch_rad: angle,
        yaw_rad: angle,
        roll_rad: [-3.0, 3.0],
        insertion_m: [0.0, DEEPEST_M],
        ..DeviceStatement::default()
    };
    let mut beyond = 0;
    for way in made(&folder, &points_m).chunks(STEPS + 1) {
        for [at, within] in way {
            let is_in = |value: f32, [least, most]: [f32; 2]| (least..=most).contains(&value);
            let tilts_within = |pose: &hyst_messages::Pose| is_in(pose.pitch_rad, angle) && is_in(pose.yaw_rad, angle);
            let is_within = |pose: &hyst_messages::Pose| tilts_within(pose) && is_in(pose.insertion_m, stated.insertion_m);
            assert!(is_within(within), "{within:?}");
            assert_eq!(stated.admits(&HardwareSample { pose: *within, ..HardwareSample::default() }), Ok(()), "{within:?}");
            assert!(!is_within(at) || at == within, "{at:?} became {within:?}");
            beyond += usize::from(!is_within(at));
        }
        for two in way.windows(2) {
            let [before_m, after_m] = [two[0][1], two[1][1]].map(|pose| pose.position_m);
            let moved_m = before_m.iter().zip(after_m).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt();
            assert!(moved_m < 1e-3, "{before_m:?} to {after_m:?}");
        }
    }
    assert!(beyond > 100, "{beyond} points are beyond");
    // At its stop it is as deep as the hand, and behind the pivot it is drawn out.
    let [[_, aside], [_, behind]] = made(&folder, &[[0.06, 0.0, 0.045], [0.03, -0.03, -0.02]])[..] else { panic!("two points") };
    assert!(is_near(aside.position_m, [0.045 * STOP_RAD.tan(), 0.0, 0.045]), "{aside:?}");
    assert!(is_near(behind.position_m, [0.0; 3]) && behind.roll_rad == ROLL_RAD, "{behind:?}");
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
