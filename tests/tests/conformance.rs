//! `hystation conformance`: a good engine conforms, a bad one is told why not, what is no engine is refused; the private station ends with the command, however that
//! ends.

use serde_json::Value;
use station_tests::shown::not_shown;
use station_tests::{Folder, RECOVERY_LIMIT, bad_engine, binaries, hystation, run, wait_for};
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
        // Its author is not told that the machine is too busy.
        ("fluid", bad_engine(folder.as_path(), "fluid", "slow"), 1, Some(false), "missed its steps"),
        ("haptic", bad_engine(folder.as_path(), "haptic", "slow"), 1, Some(false), ""),
        ("rendering", binaries().join("example-picture"), 0, Some(true), ""),
        ("rendering", bad_engine(folder.as_path(), "rendering", "black"), 1, Some(false), "all of one colour"),
    ];
    for (role, binary, expected, conforms, why) in cases {
        if !can_be_tried(role) {
            continue;
        }
        let (code, told, said) = tried(role, &binary);
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

/// One of a role with a state and a spare, one whose work others can do, and those that are replaced by a restart. The rest are tried above.
#[test]
fn the_stations_own_engines_conform() {
    let roles = ["tissue", "collision-worker", "device", "rendering", "recorder", "console"];
    for role in roles.into_iter().filter(|role| can_be_tried(role)) {
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
    }
}

#[test]
fn a_conformance_that_is_killed_leaves_no_station_behind() {
    let mut command = hystation();
    command.args(["conformance", "fluid"]).arg(binaries().join("fluid")).stdout(Stdio::null()).stderr(Stdio::null());
    let mut begun = command.spawn().expect("hystation");
    let name = format!("conformance-{}", begun.id());
    assert!(wait_for(RECOVERY_LIMIT, || (leftovers(&name).len() > 3).then_some(())).is_some(), "no private station");
    begun.kill().expect("it is ours");
    begun.wait().expect("it is ours");
    let gone = wait_for(RECOVERY_LIMIT, || leftovers(&name).is_empty().then_some(()));
    assert!(gone.is_some(), "left: {:?}", leftovers(&name));
    let _ = std::fs::remove_dir_all(std::env::temp_dir().join(&name)); // nobody was left to do it
}
