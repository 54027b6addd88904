//! The keeper with processes that do nothing but beat: it starts them, brings them back, stops them, and leaves nothing.

mod place;

use place::{HYSTATION, PROCESSES, Place, kill, pid_of, text};
use std::process::Command;

#[test]
fn a_killed_engine_comes_back_and_the_report_says_so_and_nothing_is_left() {
    let place = Place::new("kill");
    let report = place.report();
    let child = place.start(&["--report", report.to_str().unwrap()]);
    let rows = place.wait_ready();
    let victim = pid_of(&rows, "haptic:0");
    kill(victim);
    place.wait("haptic:0 is back", |rows| {
        rows.iter().any(|(name, pid, state)| name == "haptic:0" && *pid != victim && state == "live")
    });
    let second = place.call(&["run", "--headless", "--binaries", place.folder.to_str().unwrap()]);
    assert_eq!(second.status.code(), Some(2), "a second station of one name");
    assert!(text(&second.stderr).contains("is running"));
    assert_eq!(place.call(&["fault", "inject", "kill", "haptic:1"]).status.code(), Some(2), "faults are for test mode");
    assert!(place.call(&["stop"]).status.success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    let fault = &report["faults"][0];
    assert_eq!(
        (fault["kind"].as_str(), fault["target"].as_str(), fault["active"].as_bool()),
        (Some("external"), Some("haptic:0"), Some(true))
    );
    assert!(fault["recovered_us"].as_f64().unwrap() > 0.0);
    assert_eq!(report["processes"]["haptic:0"]["incarnations"], 2);
    assert_eq!(report["leftovers"], serde_json::json!({ "processes": 0, "shared_memory": 0, "files": 0 }));
    for key in [
        "device",
        "copies",
        "invalid_applied",
        "stale_applied",
        "force_trace_hash",
        "state_hash",
        "fluid_deficit_ml",
        "fluid_bled_ml",
        "fluid_open_vessels",
        "fluid_sealed_vessels",
        "removed_volume_ml",
        "healthy_removed_ml",
        "cuts",
        "cut_limits",
        "corrections",
    ] {
        assert!(!report[key].is_null(), "{key}");
    }
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn engines_outlive_the_supervisor_and_their_deaths_are_not_forgotten() {
    let place = Place::new("adopt");
    let report = place.report();
    let child = place.start(&["--report", report.to_str().unwrap()]);
    let before = place.wait_ready();
    let supervisor = pid_of(&before, "supervisor");
    kill(supervisor);
    let after = place.wait("a new supervisor", |rows| {
        rows.iter().any(|(name, pid, state)| name == "supervisor" && *pid != supervisor && state == "live")
    });
    for (name, pid, _) in before.iter().filter(|(name, _, _)| name != "supervisor") {
        assert_eq!(pid_of(&after, name), *pid, "{name} was not touched");
    }
    let fluid = pid_of(&after, "fluid:1");
    kill(fluid);
    place.wait("an adopted engine is replaced", |rows| {
        rows.iter().any(|(name, pid, state)| name == "fluid:1" && *pid != fluid && state == "spare")
    });
    assert!(place.call(&["stop"]).status.success());
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(0));
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    let targets: Vec<&str> = report["faults"].as_array().unwrap().iter().filter_map(|fault| fault["target"].as_str()).collect();
    assert!(targets.contains(&"supervisor") && targets.contains(&"fluid:1"), "{targets:?}");
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn a_hanging_engine_is_found_by_its_heartbeat_and_replaced() {
    let place = Place::new("hang");
    let report = place.report();
    let child = place.start(&["--test-mode", "--report", report.to_str().unwrap()]);
    let victim = pid_of(&place.wait_ready(), "tissue:0");
    assert!(place.call(&["fault", "inject", "stop", "tissue:active"]).status.success());
    // The other one has the role by then.
    place.wait("tissue:0 is back", |rows| {
        let well = |state: &str| state == "spare" || state == "live";
        rows.iter().any(|(name, pid, state)| name == "tissue:0" && *pid != victim && well(state))
    });
    assert!(place.call(&["stop"]).status.success());
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(0));
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    assert_eq!(
        (report["faults"][0]["kind"].as_str(), report["faults"][0]["detected_by"].as_str()),
        (Some("stop"), Some("heartbeat"))
    );
}

/// What was done to the one that a swap ended went on in the book for 40 s, as if nobody had come after it.
#[test]
fn a_fault_of_one_that_a_swap_asks_to_go_is_over_with_it() {
    let place = Place::new("asked-to-go");
    let report = place.report();
    let child = place.start(&["--test-mode", "--report", report.to_str().unwrap()]);
    let before = place.wait_ready();
    assert!(place.call(&["fault", "inject", "leak-memory", "console"]).status.success());
    let folder = place.folder.join("new");
    std::fs::create_dir_all(&folder).unwrap();
    let binary = folder.join("console");
    std::fs::copy(std::fs::canonicalize(place.folder.join("console")).unwrap(), &binary).unwrap();
    // It has no page to look at, for which it may go again: what it came for was ended all the same.
    let swapped = place.call(&["swap", "console", binary.to_str().unwrap()]);
    assert!(matches!(swapped.status.code(), Some(0 | 1)), "{}{}", text(&swapped.stdout), text(&swapped.stderr));
    assert_ne!(pid_of(&place.wait_ready(), "console"), pid_of(&before, "console"));
    assert!(place.call(&["stop"]).status.success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    let leak = report["faults"].as_array().unwrap().iter().find(|fault| fault["kind"] == "leak-memory").unwrap();
    assert!(leak["target"] == "console" && leak["recovered_us"].is_number(), "{leak:#}");
    assert_eq!(report["promises_broken"], serde_json::json!([]));
}

#[test]
fn an_engine_that_refuses_the_scene_ends_the_run_with_its_words_and_code_2() {
    let place = Place::new("refuse");
    std::fs::write(place.folder.join("fake"), "refuse tissue").unwrap();
    let output = place.start(&[]).wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("the cavity is inside out"), "{}", text(&output.stderr));
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn what_a_dead_station_left_is_removed_and_its_living_engines_are_stopped() {
    let place = Place::new("remains");
    let mut child = place.start(&[]);
    for (_, pid, _) in place.wait_ready().iter().filter(|(name, _, _)| name == "guardian" || name == "supervisor") {
        kill(*pid);
    }
    child.wait().unwrap();
    assert!(place.call(&["stop"]).status.success(), "stop does the dead guardian's work");
    assert_eq!(place.leftovers(), Vec::<String>::new());
    let mut child = place.start(&[]);
    for (_, pid, _) in place.wait_ready().iter().rev() {
        kill(*pid); // the guardian and the supervisor first
    }
    child.wait().unwrap();
    place::gone(&place, "engines that were killed end");
    assert!(!place.leftovers().is_empty());
    let child = place.start(&[]);
    place.wait_ready();
    assert!(place.call(&["stop"]).status.success());
    let output = child.wait_with_output().unwrap();
    assert!(text(&output.stderr).contains("removing what a dead station"), "{}", text(&output.stderr));
    assert_eq!(place.call(&["stop"]).status.code(), Some(2), "nothing to stop");
}

/// Whether all of a station that records are well.
fn is_whole(rows: &[(String, u64, String)]) -> bool {
    let well = |(_, _, state): &(String, u64, String)| state == "live" || state == "spare";
    rows.len() == PROCESSES + 1 && rows.iter().all(well)
}

#[test]
fn a_recording_named_by_its_folder_has_one_file_whoever_takes_the_station_over_and_each_station_has_its_own() {
    let place = Place::new("folder");
    let sessions = place.folder.join("sessions");
    let folder = format!("{}/", sessions.display());
    let words = ["--record", &folder, "--set", "trainee=Ana Müller"];
    let files = || {
        let names = std::fs::read_dir(&sessions).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.collect::<Vec<String>>()
    };
    let mut child = place.start(&words);
    let rows = place.wait("ready", is_whole);
    let keepers = ["guardian", "supervisor"].map(|keeper| pid_of(&rows, keeper));
    keepers.iter().for_each(|pid| kill(*pid));
    child.wait().unwrap();
    keepers.iter().for_each(|pid| place::ended(*pid)); // until then they have the station's name
    let child = place.start(&words);
    let after = place.wait("others keep it", |rows| {
        is_whole(rows) && rows.iter().all(|(name, pid, _)| name != "guardian" || !keepers.contains(pid))
    });
    assert_eq!(pid_of(&after, "recorder"), pid_of(&rows, "recorder"), "it was taken over");
    assert!(place.call(&["stop"]).status.success());
    let said = text(&child.wait_with_output().unwrap().stderr);
    let first = files();
    assert!(first.len() == 1 && first[0].ends_with("-default-ana-muller.mcap"), "{first:?}");
    assert!(said.contains(&format!("recording into {}", sessions.join(&first[0]).display())), "{said}");

    let child = place.start(&words);
    place.wait("ready", is_whole);
    assert!(place.call(&["stop"]).status.success());
    child.wait_with_output().unwrap();
    assert!(files().len() == 2 && files().contains(&first[0]), "{:?}", files());
}

/// The whole station was started, and ended when its recorder was given up.
#[test]
fn a_file_that_is_there_already_is_refused_before_anything_is_started_and_who_takes_a_station_over_goes_on_with_its_own() {
    let place = Place::new("named");
    let file = place.folder.join("monday.mcap");
    let words = ["--record", file.to_str().unwrap()];
    let mut child = place.start(&words);
    let rows = place.wait("ready", is_whole);
    std::fs::write(&file, "ticks").unwrap(); // as a recorder does, which none of these is
    let keepers = ["guardian", "supervisor"].map(|keeper| pid_of(&rows, keeper));
    keepers.iter().for_each(|pid| kill(*pid));
    child.wait().unwrap();
    keepers.iter().for_each(|pid| place::ended(*pid)); // until then they have the station's name
    let child = place.start(&words);
    let after = place.wait("others keep it", |rows| {
        is_whole(rows) && rows.iter().all(|(name, pid, _)| name != "guardian" || !keepers.contains(pid))
    });
    assert_eq!(pid_of(&after, "recorder"), pid_of(&rows, "recorder"), "it was taken over");
    assert!(place.call(&["stop"]).status.success());
    child.wait_with_output().unwrap();

    let output = place.start(&[words[0], words[1], "--for", "100ms"]).wait_with_output().unwrap();
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.lines().count() == 1 && said.contains("monday.mcap: it is there already"), "{said}");
    assert_eq!(place.leftovers(), Vec::<String>::new());
    assert_eq!(std::fs::read(&file).unwrap(), b"ticks");
}

/// Whoever was born while a keeper's limit was lowered kept that for its whole life.
#[test]
fn who_is_started_by_keepers_of_lowered_limits_has_those_that_the_station_began_with() {
    use rustix::process::{Pid, Resource, Rlimit, getrlimit, prlimit};
    let place = Place::new("limits");
    let child = place.start(&[]);
    let rows = place.wait_ready();
    let files = |pid: u64| -> Option<String> {
        let text = std::fs::read_to_string(format!("/proc/{pid}/limits")).ok()?;
        text.lines().find(|line| line.starts_with("Max open files")).map(str::to_string)
    };
    let [supervisor, servo] = ["supervisor", "haptic:0"].map(|name| pid_of(&rows, name));
    let begun = files(servo);
    // By one, so that nobody is short of anything.
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    let lowered = Rlimit { current: Some(current.map_or(4_096, |soft| soft - 1)), maximum };
    for keeper in ["guardian", "supervisor"].map(|name| pid_of(&rows, name)) {
        prlimit(Pid::from_raw(keeper as i32), Resource::Nofile, lowered).unwrap();
        assert!(begun.is_some() && files(keeper) != begun, "{begun:?}");
    }
    for (name, old) in [("haptic:0", servo), ("supervisor", supervisor)] {
        kill(old);
        place.wait(&format!("another {name} of {begun:?}"), |rows| {
            rows.iter().any(|(known, pid, _)| known == name && *pid != old && files(*pid) == begun)
        });
    }
    assert!(place.call(&["stop"]).status.success());
    child.wait_with_output().unwrap();
}

/// A script that asked for JSON found nothing on stdout.
#[test]
fn what_is_refused_is_json_for_whoever_asks_for_that_and_a_message_all_the_same() {
    let nobody = format!("t{}-json", std::process::id());
    let cases: [&[&str]; 9] = [
        &["swap", "liver", "./x"],
        &["swap", "fluid", "./x"],
        &["conformance", "fluid", "/absent"],
        &["conformance", "driver", "/absent"],
        &["fault", "inject", "melt", "tissue"],
        &["fault", "inject", "kill", "tissue"],
        &["fault", "campaign", "/absent.toml"],
        &["fault", "compare", "/absent", "/absent"],
        &["status"],
    ];
    for words in cases {
        let output = Command::new(HYSTATION).args(["--name", &nobody]).args(words).arg("--json").output().unwrap();
        let (told, said) = (text(&output.stdout), text(&output.stderr));
        let told: serde_json::Value = serde_json::from_str(&told).unwrap_or_else(|error| panic!("{words:?}: {error}: {told}"));
        assert_eq!((output.status.code(), told["exit_code"].as_u64()), (Some(2), Some(2)), "{words:?}: {said}");
        assert!(told["error"].as_str().is_some_and(|error| said.contains(error)), "{words:?}: {told:#}\n{said}");
        let plain = Command::new(HYSTATION).args(["--name", &nobody]).args(words).output().unwrap();
        assert!(plain.stdout.is_empty() && !plain.stderr.is_empty(), "{words:?}: {}", text(&plain.stdout));
    }
    // Its option names a file, which may be stdout.
    let report = |file: &str| Command::new(HYSTATION).args(["report", "/absent.mcap", "--json", file]).output().unwrap();
    let output = report("-");
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    assert_eq!((output.status.code(), told["exit_code"].as_u64()), (Some(2), Some(2)), "{told:#}");
    assert!(told["error"].as_str().is_some_and(|error| error.contains("/absent.mcap")), "{told:#}");
    assert!(report("/absent.json").stdout.is_empty(), "nobody asked for it there");
}

/// Of a campaign that was killed right after it had started a station the system told that station nothing: it ran on for half an hour.
#[test]
fn a_station_whose_parent_is_gone_before_it_is_bound_to_it_ends_at_once_and_one_whose_parent_is_there_runs() {
    let place = Place::new("parent");
    // That of this test is not that of the station.
    let option = format!("--with-parent={}", std::os::unix::process::parent_id());
    let output = place.start(&[&option, "--for", "100ms"]).wait_with_output().unwrap();
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.lines().count() == 1 && said.contains(&option) && said.contains("nothing was started"), "{said}");
    assert_eq!(place.leftovers(), Vec::<String>::new());
    let option = format!("--with-parent={}", std::process::id());
    let output = place.start(&[&option, "--for", "100ms"]).wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
}

#[test]
fn bad_arguments_give_one_message_and_code_2_and_start_nothing() {
    let place = Place::new("bad");
    let binaries = place.folder.to_str().unwrap().to_string();
    let missing = place.folder.join("nowhere").to_str().unwrap().to_string();
    let cases: [&[&str]; 19] = [
        &["run", "--set", "colour=red"],
        &["run", "--record", "/nowhere/at/all/"],
        &["run", "--record", "/proc"],
        &["run", "--set", "tissue_step_ticks=3"],
        &["run", "--workers", "99"],
        &["run", "--hand", "juggle"],
        &["run", "--headless", "--hand", "mouse"],
        &["run", "--lockstep", "--hand", "mouse"],
        &["run", "--lockstep", "--hand", "gamepad"],
        &["run", "--hand", "gamepad:x"],
        &["run", "--lockstep", "--set", "realtime=on"],
        &["run", "--faults", "/dev/null"],
        &["run", "--test-mode", "--faults", &missing],
        &["run", "--binaries", &missing],
        &["run", &missing],
        &["run", "--for", "yesterday"],
        &["replay", "x.mcap"],
        &["swap", "liver", "./x"],
        &["status"],
    ];
    for words in cases {
        let mut words = words.to_vec();
        if words[0] == "run" && !words.contains(&"--binaries") {
            words.extend(["--binaries", &binaries]);
        }
        let output = place.call(&words);
        assert_eq!(output.status.code(), Some(2), "{words:?}: {}", text(&output.stderr));
        assert!(!output.stderr.is_empty() && !text(&output.stderr).contains("panicked"), "{words:?}");
        assert_eq!(place.leftovers(), Vec::<String>::new(), "{words:?}");
    }
    assert_eq!(Command::new(HYSTATION).args(["--name", "Not A Name", "status"]).output().unwrap().status.code(), Some(2));
}
