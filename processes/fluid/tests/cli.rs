//! Promise of the process: arguments that it cannot use are one message on stderr, nothing on stdout, and exit code 2.

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
fn bad_arguments_of_the_engine_are_refused() {
    engine(env!("CARGO_BIN_EXE_fluid"), "fluid:0", "fluid");
}

#[test]
fn bad_arguments_of_the_benchmark_are_refused() {
    let binary = env!("CARGO_BIN_EXE_fluid");
    for words in [&["bench"][..], &["bench", "none"], &["bench", "flow", "--fast"], &["bench", "flow", "more"]] {
        refused(binary, words, "expected flow");
    }
    refused(binary, &["bench", "flow", "--mesh", "x.msh"], "--mesh");
}
