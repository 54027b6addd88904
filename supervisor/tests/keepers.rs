//! `fault inject` of those who keep the station: in test mode alone, told by the report, and no engine is touched.

mod place;

use place::{Place, await_that, ended, pid_of, send, text};
use rustix::process::Signal;
use std::process::{Child, Stdio};

#[test]
fn keepers_are_hurt_in_test_mode_and_replaced_and_the_report_tells_of_it() {
    let place = Place::new("keepers");
    let report = place.report();
    let arguments = ["--test-mode", "--report", report.to_str().unwrap()];
    let mut child = place.start(&arguments);
    let first = place.wait_ready();
    let inject = |words: &[&str]| {
        let output = place.call(&[&["fault", "inject"], words].concat());
        assert!(output.status.success(), "{words:?}: {}", text(&output.stderr));
    };
    for kind in ["kill", "segfault", "abort", "stop"] {
        let old = pid_of(&place.wait_ready(), "supervisor");
        inject(&[kind, "supervisor"]);
        place.wait("another supervisor", |rows| rows.iter().any(|(name, pid, _)| name == "supervisor" && *pid != old));
    }
    let said = std::fs::read_to_string(hyst_exchange::Station::named(&place.name).unwrap().events()).unwrap();
    assert!(said.contains("the supervisor hangs (silent for 3"), "{said}");
    let mut rows = place.wait_ready();
    let supervisor = pid_of(&rows, "supervisor");
    inject(&["stop", "supervisor", "--for", "20ms"]);
    assert_eq!(pid_of(&place.wait_ready(), "supervisor"), supervisor, "continued before it was missed");
    inject(&["kill", "guardian"]);
    child.wait().unwrap();
    let old = pid_of(&rows, "guardian");
    rows = place.wait("a stand-in", |rows| rows.len() == place::PROCESSES && pid_of(rows, "guardian") != old);
    inject(&["kill", "supervisor+guardian"]);
    ["supervisor", "guardian"].iter().for_each(|name| ended(pid_of(&rows, name)));
    let child = place.start(&arguments);
    let last = place.wait_ready();
    for (name, pid, _) in &first {
        assert!(name == "supervisor" || name == "guardian" || pid_of(&last, name) == *pid, "{name} was touched");
    }
    assert!(place.call(&["stop"]).status.success());
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(0));
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    let of = |target: &str| report["faults"].as_array().unwrap().iter().filter(|fault| fault["target"] == target).count();
    // One that was continued before it was missed suffered it, too.
    assert_eq!((of("supervisor"), of("guardian")), (6, 1), "{:#}", report["faults"]);
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn outside_of_test_mode_nobody_hurts_a_keeper() {
    let place = Place::new("unhurt");
    let child = place.start(&[]);
    let before = place.wait_ready();
    for target in ["supervisor", "guardian", "supervisor+guardian"] {
        let output = place.call(&["fault", "inject", "kill", target]);
        assert_eq!(output.status.code(), Some(2), "as for an engine");
        assert!(text(&output.stderr).contains("--test-mode"), "{}", text(&output.stderr));
    }
    let pids = |rows: &[(String, u64, String)]| rows.iter().map(|(_, pid, _)| *pid).collect::<Vec<u64>>();
    assert_eq!(pids(&place.wait_ready()), pids(&before));
    assert!(place.call(&["stop"]).status.success());
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(0));
}

/// The first word that a file of a process says after some words; nothing if the process is gone.
fn said(pid: u64, file: &str, after: &str) -> String {
    let text = std::fs::read_to_string(format!("/proc/{pid}/{file}")).unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix(after)).unwrap_or_default();
    line.split_whitespace().next().unwrap_or_default().to_string()
}

fn most_files(pid: u64) -> String {
    said(pid, "limits", "Max open files")
}

fn is_stopped(pid: u64) -> bool {
    said(pid, "status", "State:") == "T"
}

/// Ctrl-C at `fault inject no-files guardian --for 60s` left the guardian without files for good, and at `stop` both keepers standing.
#[test]
fn whoever_interrupts_what_lasts_for_a_time_ends_it() {
    let place = Place::new("cut-short");
    let report = place.report();
    let mut child = place.start(&["--test-mode", "--report", report.to_str().unwrap()]);
    let rows = place.wait_ready();
    let [guardian, supervisor] = ["guardian", "supervisor"].map(|name| pid_of(&rows, name));
    let begin = |words: &[&str]| -> Child {
        let mut command = place.command(&[&["fault", "inject"], words, &["--for", "60s"]].concat());
        command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    };
    let interrupt = |client: Child, signal: Signal| {
        send(client.id().into(), signal);
        let output = client.wait_with_output().unwrap();
        let words = text(&output.stderr);
        assert!(output.status.code() == Some(3) && words.contains("interrupted"), "{signal:?}: {:?} {words}", output.status);
    };
    let as_started = most_files(guardian);
    for signal in [Signal::INT, Signal::TERM, Signal::HUP] {
        let client = begin(&["no-files", "guardian"]);
        await_that("a limit that is lowered", || most_files(guardian) != as_started);
        interrupt(client, signal);
        assert_eq!(most_files(guardian), as_started, "{signal:?}: it stays lowered");
    }
    let client = begin(&["stop", "supervisor+guardian"]);
    await_that("two that stand", || is_stopped(guardian) && is_stopped(supervisor));
    interrupt(client, Signal::INT);
    await_that("that both go on", || !is_stopped(guardian) && !is_stopped(supervisor));
    place.wait_ready();
    assert!(place.call(&["stop"]).status.success());
    child.wait().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    let faults = report["faults"].as_array().unwrap();
    let told = faults.iter().filter(|fault| fault["kind"] == "no-files" && fault["target"] == "guardian").count();
    assert_eq!(told, 3, "each was suffered, for the time that it lasted: {:#}", report["faults"]);
}

/// Pages of its program had been taken back, and it hung for as long as the disk that has them was busy.
#[test]
fn the_memory_of_the_supervisor_is_locked_where_no_limit_binds_it() {
    let place = Place::new("locked");
    let child = place.start(&[]);
    let supervisor = pid_of(&place.wait_ready(), "supervisor");
    let locked = said(supervisor, "status", "VmLck:");
    assert!(locked != "0" || !hyst_exchange::locking::is_exempt(), "nothing of it is");
    assert!(place.call(&["stop"]).status.success());
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(0));
}
