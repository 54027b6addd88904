//! `fault inject` of those who keep the station: in test mode alone, told by the report, and no engine is touched.

mod place;

use place::{Place, ended, pid_of, text};

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
