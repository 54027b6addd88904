//! Promises of the process's command line: what cannot be used is one message on stderr and exit code 2, and nothing is drawn.

use std::process::{Command, Output};

fn rendering(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rendering")).args(arguments).output().expect("the binary is built with its tests")
}

fn refused(arguments: &[&str]) -> String {
    let output = rendering(arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {output:?}");
    assert!(output.stdout.is_empty(), "{output:?}");
    let text = String::from_utf8(output.stderr).expect("messages are UTF-8");
    assert!(text.starts_with("rendering: ") && !text.contains("panicked"), "{text}");
    text
}

#[test]
fn arguments_that_are_missing_or_unknown_are_named() {
    assert!(refused(&[]).contains("--station"));
    assert!(refused(&["--station", "x", "--slot", "rendering", "--incarnation", "1", "--colour"]).contains("--colour"));
    assert!(refused(&["--station", "x", "--slot", "rendering", "--incarnation", "many"]).contains("many"));
}

#[test]
fn a_slot_of_another_role_is_refused() {
    for slot in ["haptic:0", "nonsense", "rendering:7"] {
        let text = refused(&["--station", "x", "--slot", slot, "--incarnation", "1"]);
        assert!(text.contains(slot) && text.lines().count() == 1, "{text}");
    }
}

#[test]
fn a_station_that_does_not_run_says_how_to_start_one() {
    let name = format!("t{}-nowhere", std::process::id());
    let text = refused(&["--station", &name, "--slot", "rendering", "--incarnation", "1"]);
    assert!(text.contains("hystation run") && text.lines().count() == 1, "{text}");
}
