//! Lock-step: a run with faults leaves the same forces, the same tissue and the same deficit as one without, to the bit, whoever dies and
//! whatever the number of collision workers. Everything here is compared with a run of the same station, so nothing depends on the machine.

use serde_json::Value;
use station_tests::{Folder, hystation, run, wait_for};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::Duration;

/// Virtual time of a run: the hand rests for 1 s, then presses into the wall and comes back.
const FOR: &str = "2500ms";
/// Tick from which a fluid makes no further state in that time, and one more of its periods.
const LAST_PERIOD: u64 = 2_430;
/// Ticks of a run.
const TICKS: u64 = 2_500;
/// Nothing else is needed for what is compared; the whole station is the business of the last test.
const ROLES: &str = "hardware,device,haptic,tissue,fluid,collision-worker";

/// A run takes some seconds.
const LIMIT: Duration = Duration::from_secs(180);

/// What must be equal.
#[derive(Debug, PartialEq)]
struct Trace {
    force: String,
    tissue: String,
    fluid: String,
    deficit_ml: u64,
}

/// Runs a station to its end and gives its report.
fn report(name: &str, arguments: &[&str]) -> Value {
    report_of(name, arguments, None)
}

/// The same with a supervisor that dies at this point of its work.
fn report_of(name: &str, arguments: &[&str], supervisor_dies_at: Option<&str>) -> Value {
    let folder = Folder::new(&format!("lockstep-{name}"));
    let path = folder.as_path().join("report.json");
    let station = format!("l{}-{name}", std::process::id());
    let mut command = hystation();
    command.args(["--name", &station, "run", "--headless", "--lockstep", "--for", FOR, "--report"]).arg(&path).args(arguments);
    command.envs(supervisor_dies_at.map(|point| ("HYSTATION_SUPERVISOR_DIES_AT", point)));
    let (code, _, said) = run(&mut command);
    assert_eq!(code, Some(0), "{name}: {said}");
    let report: Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
    assert_eq!(report["device"]["ticks"], TICKS, "{name}: {said}");
    // The first tick has no command yet; after it, no tick is lost to a fault.
    assert_eq!(report["device"]["fresh"], TICKS - 1, "{name}: {said}");
    for left in ["processes", "shared_memory", "files"] {
        assert_eq!(report["leftovers"][left], 0, "{name}: {left}");
    }
    report
}

fn trace(report: &Value) -> Trace {
    let word = |key: &str| report[key].as_str().expect("a hash").to_string();
    let deficit_ml = report["fluid_deficit_ml"].as_f64().expect("a deficit").to_bits();
    Trace { force: word("force_trace_hash"), tissue: word("state_hash"), fluid: word("fluid_state_hash"), deficit_ml }
}

/// The trace of a run without faults and with the default hand, made once for all tests.
fn quiet() -> &'static Trace {
    static QUIET: OnceLock<Trace> = OnceLock::new();
    QUIET.get_or_init(|| trace_of("quiet", &[]))
}

fn trace_of(name: &str, arguments: &[&str]) -> Trace {
    trace(&report(name, &[&["--roles", ROLES], arguments].concat()))
}

/// Each of what is promised: worker, tissue, fluid and servo, the active one and the spare, several at once, and one more in the tick after.
/// All while the hand is in contact.
const KILLS: [(u64, &str); 14] = [
    (1_500, "collision-worker:0"),
    (1_550, "fluid:active"),
    (1_600, "fluid:spare"),
    (1_650, "tissue:active"),
    (1_700, "tissue:spare"),
    (1_750, "haptic:active"),
    (1_800, "haptic:spare"),
    (1_900, "tissue:active"),
    (1_900, "haptic:active"),
    (1_900, "fluid:active"),
    (1_900, "collision-worker:0"),
    (1_901, "tissue:active"),
    (1_902, "haptic:active"),
    (1_903, "fluid:active"),
];

fn faults(kind: &str, kills: &[(u64, &str)]) -> String {
    kills.iter().map(|(tick, target)| format!("[[fault]]\nkind = \"{kind}\"\ntarget = \"{target}\"\ntick = {tick}\n")).collect()
}

#[test]
fn the_same_run_is_the_same_to_the_bit_and_another_hand_is_not() {
    let first = quiet();
    assert_eq!(trace_of("second", &[]), *first);
    let other = trace_of("other", &["--hand", "script:explore"]);
    assert!(
        other.force != first.force && other.tissue != first.tissue,
        "a hand that goes elsewhere leaves another trace: {other:?}"
    );
    let folder = Folder::new("lockstep-scene");
    let scene = folder.as_path().join("uterus.toml");
    let meshes = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../assets/meshes");
    let text = std::fs::read_to_string(meshes.join("../scenes/default.toml")).unwrap();
    let text =
        text.replace("../meshes", meshes.to_str().unwrap()).replace("set_pressure_pa = 9333.0", "set_pressure_pa = 8000.0");
    std::fs::write(&scene, text).unwrap();
    let softer = trace_of("softer", &[scene.to_str().unwrap()]);
    assert_ne!(softer.deficit_ml, first.deficit_ml, "another pressure leaves another deficit");
}

/// The Flow Engine's layers are computed by Synchronized Threads: as many as there may be, and none of them leaves a trace, nor does its death.
#[test]
fn one_and_three_threads_of_the_fluid_make_the_same_fluid() {
    let folder = Folder::new("lockstep-threads");
    let file = folder.as_path().join("kills.toml");
    std::fs::write(&file, faults("kill", &[(1_550, "fluid:active"), (1_900, "fluid:active")])).unwrap();
    for threads in [1, 3] {
        let set = format!("fluid_threads={threads}");
        let arguments = ["--set", &set, "--test-mode", "--faults", file.to_str().unwrap()];
        assert_eq!(trace_of(&format!("threads-{threads}"), &arguments), *quiet(), "{threads} threads");
    }
}

#[test]
fn kills_leave_no_trace_for_1_2_3_and_8_workers() {
    let folder = Folder::new("lockstep-kills");
    let file = folder.as_path().join("kills.toml");
    std::fs::write(&file, faults("kill", &KILLS)).unwrap();
    for workers in ["1", "2", "3", "8"] {
        let name = format!("kills-{workers}");
        let arguments =
            ["--roles", ROLES, "--workers", workers, "--hand", "script:press", "--test-mode", "--faults", file.to_str().unwrap()];
        let report = report(&name, &arguments);
        let injected = report["faults"].as_array().unwrap();
        let died = injected.iter().filter(|fault| fault["kind"] == "kill" && fault["exit"] == "signal 9").count();
        assert_eq!(died, KILLS.len(), "{workers} workers: {injected:?}");
        for fault in injected {
            let moved = fault["window"]["force_step_max_n"].as_f64().unwrap_or(0.0);
            assert!(moved > 0.0, "the hand was not in contact: {fault}");
        }
        assert_eq!(trace(&report), *quiet(), "{workers} workers");
    }
}

/// The sequencer's own faults come while everybody rests. These come from outside, at any moment: in a step, before it is sent, while another is not
/// back. One of a role at a time: what both replicas took with them is gone.
#[test]
fn kills_at_any_moment_leave_no_trace() {
    let mut died = BTreeMap::<String, usize>::new();
    for workers in [1, 2, 8] {
        for fault in killed_at_any_moment(workers) {
            let target = fault["target"].as_str().unwrap_or_default();
            *died.entry(target.split(':').next().unwrap_or_default().into()).or_default() += 1;
        }
    }
    println!("killed: {died:?}");
    for role in VICTIMS {
        assert!(died.get(role).is_some_and(|count| *count >= 2), "{role}: {died:?}");
    }
}

/// Those who are killed.
const VICTIMS: [&str; 4] = ["collision-worker", "fluid", "tissue", "haptic"];

/// Kills one role after the other, each as soon as it is whole, for a whole run; gives the faults of those who died of it. The dice say which of the role: while
/// they also said the role, a machine on which the run was over soon had one fluid killed of nineteen.
fn killed_at_any_moment(workers: usize) -> Vec<Value> {
    let folder = Folder::new(&format!("lockstep-moments-{workers}"));
    let path = folder.as_path().join("report.json");
    let station = format!("l{}-moments-{workers}", std::process::id());
    let mut command = hystation();
    command.args(["--name", &station, "run", "--headless", "--lockstep", "--roles", ROLES, "--for", FOR, "--report"]).arg(&path);
    command.args(["--workers", &workers.to_string()]);
    let log = std::fs::File::create(folder.as_path().join("said")).unwrap();
    let mut child = command.stdout(std::process::Stdio::null()).stderr(log).spawn().unwrap();
    let (mut dice, mut killed) = (workers as u64, BTreeSet::new());
    let code = wait_for(LIMIT, || {
        dice = dice.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let (_, status, _) = run(hystation().args(["--name", &station, "status", "--json"]));
        let status: Value = serde_json::from_str(&status).unwrap_or_default();
        let processes = status["processes"].as_array().map(Vec::as_slice).unwrap_or_default();
        let of = |process: &Value, role: &str| process["name"].as_str().is_some_and(|name| name.starts_with(role));
        let role = VICTIMS[killed.len() % VICTIMS.len()];
        let members = if role == "collision-worker" { workers } else { 2 };
        let victims: Vec<&Value> = processes.iter().filter(|process| of(process, role)).collect();
        // Whom this test has killed may still be listed as living: then nobody has seen it yet.
        let pid = |process: &Value| process["pid"].as_i64().unwrap_or(0) as i32;
        let whole = victims.len() == members && victims.iter().all(|process| is_well(process) && !killed.contains(&pid(process)));
        let victim =
            rustix::process::Pid::from_raw(victims.get((dice >> 40) as usize % members).map_or(0, |process| pid(process)));
        if let Some(victim) = victim.filter(|_| whole) {
            let _ = rustix::process::kill_process(victim, rustix::process::Signal::KILL); // gone is as good
            killed.insert(victim.as_raw_nonzero().get());
        }
        child.try_wait().unwrap().map(|status| status.code())
    });
    let said = folder.read("said");
    assert_eq!(code, Some(Some(0)), "{said}");
    let report: Value = serde_json::from_str(&folder.read("report.json")).unwrap();
    let mut found = trace(&report);
    // The report has what living fluids have told: nothing, where one died in its last period and the other has not made a step yet.
    let died_last = |fault: &Value| {
        fault["target"].as_str().is_some_and(|target| target.starts_with("fluid")) && fault["tick"].as_u64() > Some(LAST_PERIOD)
    };
    if found.fluid == "0000000000000000" && report["faults"].as_array().unwrap().iter().any(died_last) {
        (found.fluid, found.deficit_ml) = (quiet().fluid.clone(), quiet().deficit_ml);
    }
    assert_eq!(found, *quiet(), "{workers} workers\n{said}");
    report["faults"].as_array().unwrap().iter().filter(|fault| fault["exit"] == "signal 9").cloned().collect()
}

fn is_well(process: &Value) -> bool {
    matches!(process["state"].as_str(), Some("live" | "spare"))
}

/// What hangs is found by its heartbeat, killed, and leaves no trace either; nor do the rendering and the recorder beside.
#[test]
fn what_hangs_leaves_no_trace() {
    let folder = Folder::new("lockstep-hangs");
    let (file, session) = (folder.as_path().join("hangs.toml"), folder.as_path().join("session.mcap"));
    std::fs::write(&file, faults("stop", &[(1_600, "tissue:active"), (1_800, "haptic:active")])).unwrap();
    let arguments = ["--test-mode", "--faults", file.to_str().unwrap(), "--record", session.to_str().unwrap()];
    let report = report("hangs", &arguments);
    let late = report["faults"].as_array().unwrap().iter().filter(|fault| fault["detected_by"] == "heartbeat").count();
    assert_eq!(late, 2, "{}", report["faults"]);
    assert_eq!(trace(&report), *quiet());
}

/// The one servo that knows the hand is still in its shadow when the other dies, and the tick lasts long enough for a successor to be born within it:
/// that one is not taken for the one that was followed, whose seat it has.
#[test]
fn a_servo_born_within_a_long_tick_leaves_no_trace() {
    let folder = Folder::new("lockstep-born");
    let file = folder.as_path().join("born.toml");
    let kills = [1_700, 1_902, 1_904].map(|tick| (tick, "haptic:active"));
    std::fs::write(&file, faults("kill", &kills) + &faults("stop", &[(1_904, "tissue:active")])).unwrap();
    let report = report("born", &["--roles", ROLES, "--test-mode", "--faults", file.to_str().unwrap()]);
    let faults = report["faults"].as_array().unwrap();
    let [_, _, servo, tissue] = &faults[..] else { panic!("{faults:#?}") };
    let whole_us = |fault: &Value| fault["recovered_us"].as_f64().expect("it is back");
    assert!(servo["target"] == "haptic:0" && tissue["detected_by"] == "heartbeat", "{faults:#?}");
    // The tick lasted until then: the tissue is waited for before anybody is asked for a force.
    if whole_us(servo) > tissue["detected_us"].as_f64().unwrap() {
        station_tests::shown::not_shown("a servo born within a long tick: it took longer than the tick");
    }
    assert_eq!(trace(&report), *quiet());
}

/// The supervisor lets the sequencer run on and injects the faults; it dies in the middle of that, and its successor goes on with both.
#[test]
fn a_supervisor_that_dies_between_two_faults_leaves_no_trace() {
    let folder = Folder::new("lockstep-supervisor");
    let file = folder.as_path().join("kills.toml");
    std::fs::write(&file, faults("kill", &KILLS[..7])).unwrap();
    let arguments = ["--roles", ROLES, "--test-mode", "--faults", file.to_str().unwrap()];
    for (name, point) in [("reaped", "reaped:3"), ("started", "spawn-started:12")] {
        let report = report_of(name, &arguments, Some(point));
        let of = |kind: &str, target: &str| {
            let all = report["faults"].as_array().unwrap().iter();
            all.filter(|fault| fault["kind"] == kind && fault["target"].as_str().unwrap().starts_with(target)).count()
        };
        assert_eq!(of("external", "supervisor"), 1, "{point}: {}", report["faults"]);
        assert_eq!(of("kill", ""), 7, "{point}: {}", report["faults"]);
        let kills = report["faults"].as_array().unwrap().iter().filter(|fault| fault["kind"] == "kill");
        // Also of whom the second supervisor adopted, and the guardian reaped.
        assert!(kills.clone().all(|fault| fault["exit"] == "signal 9"), "{point}: {}", report["faults"]);
        assert_eq!(trace(&report), *quiet(), "{point}");
    }
}

/// Two leaves of an object that hang together at one end, the far one held: a hand presses the near one on it. Lengths in mm, cells of 2 mm with six tets each.
fn leaves(folder: &Folder) -> PathBuf {
    let [nx, ny, nz] = [11, 6, 6];
    let number = |[x, y, z]: [usize; 3]| (z * ny + y) * nx + x;
    let places = (0..nx * ny * nz).map(|node| [node % nx * 2, node / nx % ny * 2, node / nx / ny * 2]);
    let places: String = places.map(|[x, y, z]| format!("{} {} {}\n", x as i32 - 10, y as i32 - 5, z + 30)).collect();
    let cells = (0..nz - 1).flat_map(|z| (0..ny - 1).flat_map(move |y| (0..nx - 1).map(move |x| [x, y, z])));
    let mut tets = Vec::new();
    for cell in cells.filter(|[x, _, z]| *x == 0 || *z == 0 || *z == nz - 2) {
        for order in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [1, 0, 2], [0, 2, 1], [2, 1, 0]] {
            let mut at = cell;
            let mut tet = vec![number(at)];
            tet.extend(order.map(|axis| {
                at[axis] += 1;
                number(at)
            }));
            tets.push(tet);
        }
    }
    let count = tets.len();
    let corners: String = tets.iter().map(|tet| format!("4 {} {} {} {}\n", tet[0], tet[1], tet[2], tet[3])).collect();
    let mesh = format!(
        "# vtk DataFile Version 3.0\nleaves\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {} float\n{places}CELLS {count} {}\n{corners}CELL_TYPES {count}\n{}",
        nx * ny * nz,
        5 * count,
        "10\n".repeat(count)
    );
    let scene = "version = 1\nname = \"leaves\"\n[[deformable]]\nname = \"leaves\"\nmesh = \"leaves.vtk\"\nscale_to_m = 0.001\n\
                 fixed = [{ above_z_m = 0.0398 }]\n[[rigid]]\nname = \"hysteroscope\"\nkind = \"hysteroscope\"\n\
                 [workspace]\npivot_m = [0.0, 0.0, 0.0]\ninsertion_m = [0.0, 0.07]\n[hand.fold]\nfrom = { yaw_deg = 6.9, insertion_m = 0.0275 }\n\
                 into = { yaw_deg = 6.9, insertion_m = 0.0385 }\nperiod_s = 2.5\n";
    std::fs::write(folder.as_path().join("leaves.vtk"), mesh).unwrap();
    let path = folder.as_path().join("scene.toml");
    std::fs::write(&path, scene).unwrap();
    path
}

/// What meets its own object is found by the workers as by the tissue itself: no number of them and no death leaves a trace, and none is refused.
#[test]
fn a_fold_that_is_pressed_on_another_is_the_same_for_0_1_and_3_workers() {
    let folder = Folder::new("lockstep-leaves");
    let scene = leaves(&folder);
    let file = folder.as_path().join("kills.toml");
    std::fs::write(&file, faults("kill", &[(1_300, "tissue:active"), (1_320, "collision-worker:0")])).unwrap();
    let of = |workers: &str, faults: &[&str]| {
        let arguments = [scene.to_str().unwrap(), "--roles", ROLES, "--workers", workers, "--hand", "script:fold"];
        let report = report(&format!("leaves-{workers}-{}", faults.len()), &[&arguments[..], faults].concat());
        let injected = if faults.is_empty() { 0 } else { 2 };
        assert_eq!(report["faults"].as_array().map(Vec::len), Some(injected), "{workers} workers: {}", report["faults"]);
        assert_eq!(report["invalid_applied"], 0);
        trace(&report)
    };
    let alone = of("0", &[]);
    for workers in ["1", "3"] {
        assert_eq!(of(workers, &[]), alone, "{workers} workers");
    }
    assert_eq!(of("1", &["--test-mode", "--faults", file.to_str().unwrap()]), alone, "with deaths");
}
