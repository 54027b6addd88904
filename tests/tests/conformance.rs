//! `hystation conformance`: a good engine conforms, a bad one is told why not, what is no engine is refused; the private station ends with the command, however that
//! ends.

use rustix::process::Signal;
use serde_json::Value;
use station_tests::shown::not_shown;
use station_tests::swapped::{assert_left_nobody, got_no_time, swap};
use station_tests::{Folder, RECOVERY_LIMIT, Station, bad_engine, binaries, hystation, run, wait_for};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Stdio;

/// What the command says of an engine: exit code, and its JSON.
fn tried(role: &str, binary: &Path) -> (Option<i32>, Value, String) {
    let (code, text, said) = run(hystation().args(["conformance", role, "--json"]).arg(binary));
    (code, serde_json::from_str(&text).unwrap_or(Value::Null), said)
}

/// Whether this machine can tell of a role: without a Vulkan driver nobody draws anything.
fn can_be_tried(role: &str) -> bool {
    let can = role != "rendering" || std::env::var_os("HYSTATION_NO_GPU").is_none();
    if !can {
        not_shown("whether a rendering conforms: there is no Vulkan driver");
    }
    can
}

fn leftovers(name: &str) -> Vec<PathBuf> {
    hyst_exchange::Station::named(name).expect("a name").leftovers()
}

#[test]
fn a_good_engine_conforms_a_bad_one_is_told_why_not_and_what_is_none_is_refused() {
    let folder = Folder::new("conformance");
    let script = folder.write("script", "#!/bin/sh\necho '{}'\n");
    std::fs::set_permissions(&script, std::fs::Permissions::from_mode(0o755)).expect("its rights");
    let cases = [
        ("fluid", binaries().join("example-engine"), 0, Some(true), ""),
        ("fluid", bad_engine(folder.as_path(), "fluid", "off"), 1, Some(false), "out of tolerance"),
        ("fluid", bad_engine(folder.as_path(), "fluid", "garbage"), 1, Some(false), ""),
        ("fluid", bad_engine(folder.as_path(), "fluid", "panic"), 1, Some(false), ""),
        // Its author is not told that the machine is too busy.
        ("fluid", bad_engine(folder.as_path(), "fluid", "slow"), 1, Some(false), "missed its steps"),
        ("tissue", bad_engine(folder.as_path(), "tissue", "leak"), 1, Some(false), "it grows"),
        ("tissue", bad_engine(folder.as_path(), "tissue", "epoch"), 1, Some(false), ""),
        ("haptic", bad_engine(folder.as_path(), "haptic", "slow"), 1, Some(false), ""),
        ("collision-worker", bad_engine(folder.as_path(), "collision-worker", "forks"), 1, Some(false), ""),
        ("rendering", binaries().join("example-picture"), 0, Some(true), ""),
        ("rendering", bad_engine(folder.as_path(), "rendering", "black"), 1, Some(false), "all of one colour"),
    ];
    for (role, binary, expected, conforms, why) in cases {
        if !can_be_tried(role) {
            continue;
        }
        let (code, told, said) = tried(role, &binary);
        assert_left_nobody(&binary);
        if code == Some(3) {
            not_shown(&format!("whether {} conforms: the machine was too busy", binary.display()));
            continue;
        }
        assert_eq!(code, Some(expected), "{}: {told:#}\n{said}", binary.display());
        assert_eq!(told["conforms"].as_bool(), conforms, "{told:#}");
        let checks = told["checks"].as_array().cloned().unwrap_or_default();
        let is_said = |check: &Value| check["good"] == false && check["why"].as_str().is_some_and(|text| text.contains(why));
        assert_eq!(checks.iter().any(is_said), expected == 1, "{told:#}");
        assert!(checks.iter().any(|check| check["what"] == "  tolerance"), "{told:#}");
        let is_good = |what: &str| checks.iter().any(|check| check["what"] == what && check["good"] == true);
        assert!(is_good("leaves nothing behind") && is_good("comes back after its death") == (expected == 0), "{told:#}");
        // Its own words, which were in a station that is gone.
        let log = told["log"].as_array().cloned().unwrap_or_default();
        assert!(log.is_empty() == (expected == 0) && log.len() <= 20, "{told:#}");
        let is_panic = |line: &Value| line.as_str().is_some_and(|line| line.contains("a broken invariant"));
        assert!(!binary.ends_with("bad.fluid.panic") || log.iter().any(is_panic), "{told:#}");
    }
    // A servo of the station's own, in another scene and under another hand; and a scene that is none.
    let own = binaries().join("haptic");
    let with_hand =
        |scene: &str| run(hystation().args(["conformance", "haptic", "--hand", "script:polyp", "--scene", scene]).arg(&own));
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/cases/polyp.toml");
    let (code, told, said) = with_hand(scene);
    assert!(matches!(code, Some(0 | 3)), "{code:?} {told}\n{said}");
    let (code, _, said) = with_hand(&script);
    assert!(code == Some(2) && said.contains("hystation check"), "{code:?} {said}");
    for (role, binary, words) in [("fluid", Path::new(&script), "ELF"), ("tissue", &binaries().join("fluid"), "is a fluid")] {
        let (code, _, said) = tried(role, binary);
        assert!(code == Some(2) && said.contains(words) && said.lines().count() == 1, "{code:?} {said}");
    }
}

/// What no probation asks about.
#[test]
fn an_engine_that_passes_its_probation_is_told_what_else_is_wrong_with_it() {
    let folder = Folder::new("conformance-own");
    let cases = [
        ("fluid", "wasteful", "allocates nothing in a step", ""),
        ("fluid", "late", "makes its steps in time", ""),
        ("fluid", "honest", "lies when it is asked to", ""),
        ("fluid", "deaf", "ends with the station", ""),
        ("rendering", "headstrong", "hangs when it is asked to", ""),
        // It refuses the NaN of the same tissue, and takes the epoch that is over.
        ("device", "unfenced", "withstands what is wrong", "in its contact model: device refused nothing of it"),
    ];
    for (role, kind, what, why) in cases.into_iter().filter(|(role, ..)| can_be_tried(role)) {
        let (code, told, said) = tried(role, &bad_engine(folder.as_path(), role, kind));
        if code == Some(3) {
            not_shown(&format!("whether a {role} that is {kind} conforms: the machine was too busy"));
            continue;
        }
        assert!(code == Some(1) && told["conforms"] == false, "{role} {kind}: {code:?} {told:#}\n{said}");
        let checks = told["checks"].as_array().cloned().unwrap_or_default();
        let is = |what: &str, good: bool| checks.iter().any(|check| check["what"] == what && check["good"] == good);
        assert!(is("passes its probation", true) && is(what, false), "{role} {kind}: {told:#}");
        let is_it = |check: &Value| check["what"] == what && check["why"].as_str().is_some_and(|text| text.contains(why));
        assert!(checks.iter().any(is_it), "{role} {kind}: {told:#}");
        let of_epoch = |check: &Value| check["why"].as_str().is_some_and(|text| text.starts_with("epoch of tissue:"));
        assert!(kind != "unfenced" || checks.iter().any(of_epoch), "{role} {kind}: {told:#}");
    }
}

/// One of each role: those with a spare, those whose work others can do, and those that are replaced by a restart.
#[test]
fn the_stations_own_engines_conform() {
    let computed_from = ["tissue", "fluid", "haptic", "collision-worker", "device"];
    let roles = computed_from.into_iter().chain(["rendering", "recorder", "console"]);
    for role in roles.filter(|role| can_be_tried(role)) {
        let (code, told, said) = tried(role, &binaries().join(role));
        if code == Some(3) {
            not_shown(&format!("whether the station's own {role} conforms: the machine was too busy"));
            continue;
        }
        assert!(code == Some(0) && told["conforms"] == true && told["role"] == role, "{role}: {code:?} {told:#}\n{said}");
        let checks = told["checks"].as_array().cloned().unwrap_or_default();
        assert!(checks.iter().all(|check| check["good"] == true), "{role}: {told:#}");
        for what in ["refuses bad arguments", "  tolerance", "passes its probation", "comes back after its death"] {
            assert!(checks.iter().any(|check| check["what"] == what), "{role}: {what:?} was not tried: {told:#}");
        }
        let is_tried = |what: &str| checks.iter().any(|check| check["what"] == what);
        assert!(is_tried("hangs when it is asked to") && is_tried("ends with the station"), "{role}: {told:#}");
        for what in ["allocates nothing in a step", "lies when it is asked to"] {
            assert_eq!(is_tried(what), computed_from.contains(&role), "{role}: {what:?}: {told:#}");
        }
        let of_lies = checks.iter().find(|check| check["what"] == "withstands what is wrong");
        assert_eq!(of_lies.is_some(), role != "haptic", "{role}: {told:#}");
        let has_refused = of_lies.and_then(|check| check["why"].as_str()).is_some_and(|why| why.contains("refused after"));
        let refuses = ["tissue", "fluid", "collision-worker", "device"];
        assert_eq!(has_refused, refuses.contains(&role), "{role}: {told:#}");
    }
}

/// The example is for scenes in which nothing is cut: it would leave each vessel that is open then without blood, and each that is coagulated open again.
#[test]
fn an_engine_that_knows_of_no_vessels_conforms_where_there_is_none_and_is_rolled_back_where_one_is_open() {
    let station = Station::start("no-vessels", &["--hand", "script:polyp", "--test-mode"]);
    let open = wait_for(RECOVERY_LIMIT, || (station.fluid_status().open_vessels > 0).then_some(()));
    assert!(open.is_some(), "the hand has opened no vessel: {}", station.said());
    let (code, record, said) = swap(&station, "fluid", &binaries().join("example-engine"));
    if got_no_time(&record) {
        not_shown("whether an engine that knows of no vessels is rolled back: the machine gave it no time");
        return;
    }
    assert!(code == Some(1) && record["cause"] == "out-of-tolerance", "{code:?} {record:#}\n{said}");
    assert!(record["reason"].as_str().is_some_and(|reason| reason.contains("vessels")), "{record:#}");
    station.stop().assert_clean();
}

/// Ctrl-C left the folder with the recording of the private station, and ended the command without a word.
#[test]
fn a_conformance_that_is_ended_leaves_no_station_and_no_folder_behind_and_says_so_if_it_can() {
    for (role, signal, code) in [("fluid", Signal::KILL, None), ("recorder", Signal::INT, Some(3))] {
        let mut command = hystation();
        command.args(["conformance", role]).arg(binaries().join(role)).stdout(Stdio::null()).stderr(Stdio::piped());
        let begun = command.spawn().expect("hystation");
        let name = format!("conformance-{}", begun.id());
        let folder = std::env::temp_dir().join(&name);
        let runs = || (leftovers(&name).len() > 3 && folder.is_dir()).then_some(());
        assert!(wait_for(RECOVERY_LIMIT, runs).is_some(), "no private station");
        let pid = rustix::process::Pid::from_raw(begun.id() as i32).expect("a process id");
        rustix::process::kill_process(pid, signal).expect("it is ours");
        let ended = begun.wait_with_output().expect("it is ours");
        let said = String::from_utf8_lossy(&ended.stderr);
        assert_eq!((ended.status.code(), said.contains("interrupted")), (code, code.is_some()), "{signal:?}: {said}");
        let gone = wait_for(RECOVERY_LIMIT, || (leftovers(&name).is_empty() && !folder.exists()).then_some(()));
        assert!(gone.is_some(), "{signal:?} left: {:?}, {}: {}", leftovers(&name), folder.display(), folder.exists());
    }
}
