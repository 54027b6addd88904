//! What every engine promises of its command line, for the `tests/cli.rs` of each process: arguments that it cannot use are one message on
//! stderr that says what is wrong, nothing on stdout, and exit code 2.

use std::process::Command;

/// Starts a program with arguments that it must refuse with a word in its message; gives the message.
pub fn refused(binary: &str, arguments: &[&str], word: &str) -> String {
    let output = Command::new(binary).args(arguments).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
    assert!(said.contains(word) && !said.contains("panicked"), "{arguments:?}: {said}");
    assert!(output.stdout.is_empty(), "{arguments:?}");
    said
}

/// Bad starts of the engine of a role, whose name its binary bears; `slot` is one of its own.
pub fn engine(binary: &str, slot: &str, role: &str) {
    refused(binary, &[], "--station");
    refused(binary, &["--station", "x"], "--slot");
    refused(binary, &["--station", "x", "--slot", slot, "--incarnation", "many"], "many");
    refused(binary, &["--station", "x", "--slot", slot, "--incarnation", "1", "--colour"], "--colour");
    let foreign = if role == "recorder" { "device" } else { "recorder" };
    for other in [foreign, "nonsense", "rendering:7"] {
        let said =
            refused(binary, &["--station", "x", "--slot", other, "--incarnation", "1"], &format!("this binary is a {role}"));
        assert!(said.starts_with(&format!("{role}: ")) && said.contains(other) && said.lines().count() == 1, "{said}");
    }
    refused(binary, &["--station", "NO SUCH", "--slot", slot, "--incarnation", "1"], "station name");
    let absent = format!("t{}-absent", std::process::id());
    let said = refused(binary, &["--station", &absent, "--slot", slot, "--incarnation", "1"], "hystation run");
    assert_eq!(said.lines().count(), 1, "{said}");
}
