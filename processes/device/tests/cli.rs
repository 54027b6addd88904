//! Promise of the two processes: arguments that it cannot use are one message on stderr, nothing on stdout, and exit code 2.

use std::process::Command;

fn refused(binary: &str, arguments: &[&str], word: &str) {
    let output = Command::new(binary).args(arguments).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
    assert!(said.contains(word) && !said.contains("panicked"), "{arguments:?}: {said}");
    assert!(output.stdout.is_empty());
}

fn engine(binary: &str, slot: &str, name: &str) {
    refused(binary, &[], "--station");
    refused(binary, &["--station", "x"], "--slot");
    refused(binary, &["--station", "x", "--slot", "recorder", "--incarnation", "1"], &format!("this binary is a {name}"));
    refused(binary, &["--station", "NO SUCH", "--slot", slot, "--incarnation", "1"], "station name");
    let absent = format!("t{}-absent", std::process::id());
    refused(binary, &["--station", &absent, "--slot", slot, "--incarnation", "1"], "hystation run");
}

#[test]
fn bad_arguments_of_the_device_are_refused() {
    engine(env!("CARGO_BIN_EXE_device"), "device", "device");
}

#[test]
fn bad_arguments_of_the_hardware_are_refused() {
    engine(env!("CARGO_BIN_EXE_hardware"), "hardware", "hardware");
}
