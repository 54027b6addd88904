//! Supervisor and guardian die, alone, together and in the middle of their work: the engines keep their pids and their ticks, and the station can
//! be stopped afterwards.

mod place;

use place::{Place, await_that, kill, pid_of, send, text};
use rustix::process::Signal;
use std::process::{Child, Stdio};

/// Kills of each kind; `HYSTATION_KILLS=100` makes a hundred.
fn kills() -> u64 {
    std::env::var("HYSTATION_KILLS").ok().and_then(|count| count.parse().ok()).unwrap_or(10)
}

type Rows = Vec<(String, u64, String)>;

fn is_keeper(name: &str) -> bool {
    name == "supervisor" || name == "guardian"
}

/// The engines with their pids.
fn engines(rows: &Rows) -> Vec<(String, u64)> {
    rows.iter().filter(|(name, ..)| !is_keeper(name)).map(|(name, pid, _)| (name.clone(), *pid)).collect()
}

/// Steps of each engine so far, from its page.
fn steps(place: &Place) -> Vec<u64> {
    use hyst_messages::page::header;
    let station = hyst_exchange::Station::named(&place.name).unwrap();
    let page = station.open().unwrap();
    let slots = (0..hyst_messages::SLOTS).filter_map(hyst_messages::Slot::from_number);
    let page_of = |slot| station.read_slot(slot, page.incarnation(slot)).ok();
    slots.filter_map(page_of).map(|page| page.load64(header::STEPS)).collect()
}

/// Kills those, and waits until others have taken their place.
fn kill_and_wait(place: &Place, before: &Rows, victims: &[&str]) -> Rows {
    let old: Vec<u64> = victims.iter().map(|name| pid_of(before, name)).collect();
    for pid in &old {
        kill(*pid);
    }
    let replaced = |rows: &[(String, u64, String)], name: &str, old: u64| {
        rows.iter().any(|(known, pid, state)| known == name && *pid != old && state == "live")
    };
    place.wait(&format!("others for {victims:?}"), |rows| victims.iter().zip(&old).all(|(name, old)| replaced(rows, name, *old)))
}

/// Kills keepers again and again, and looks each time that no engine was touched and each goes on.
fn kill_often(name: &str, victims: &[&str], mut revive: impl FnMut(&Place) -> Option<Child>) {
    let place = Place::new(name);
    let mut child = place.start(&[]);
    let first = place.wait_ready();
    let mut rows = first.clone();
    let mut runs = Vec::new();
    for round in 0..kills() {
        let before = steps(&place);
        for victim in victims {
            kill(pid_of(&rows, victim));
        }
        victims.iter().for_each(|victim| place::ended(pid_of(&rows, victim))); // until then it has the station's name
        runs.extend(revive(&place));
        let old: Vec<u64> = victims.iter().map(|victim| pid_of(&rows, victim)).collect();
        rows = place.wait(&format!("round {round}: others for {victims:?}"), |rows| {
            let new = |(victim, old): (&&str, &u64)| {
                rows.iter().any(|(name, pid, state)| name == victim && pid != old && state == "live")
            };
            victims.iter().zip(&old).all(new)
        });
        assert_eq!(engines(&rows), engines(&first), "round {round}: engines were touched");
        let go_on = || before.iter().zip(steps(&place)).all(|(before, after)| after > *before);
        await_that(&format!("round {round}: each goes on from {before:?}"), go_on);
    }
    let stopped = place.call(&["stop"]);
    assert!(stopped.status.success(), "{}", text(&stopped.stderr));
    assert_eq!(place.leftovers(), Vec::<String>::new());
    let _ = child.wait();
    for mut run in runs {
        let _ = run.wait();
    }
}

#[test]
fn a_supervisor_killed_again_and_again_costs_no_engine_a_step() {
    kill_often("many-s", &["supervisor"], |_| None);
}

#[test]
fn a_guardian_killed_again_and_again_has_stand_ins_and_the_station_can_be_stopped() {
    kill_often("many-g", &["guardian"], |_| None);
}

#[test]
fn both_killed_again_and_again_are_replaced_by_a_run_of_the_same_name() {
    kill_often("many-b", &["guardian", "supervisor"], |place| Some(place.start(&[])));
}

/// Nobody would keep the supervisor, and a stand-in cannot take the name that the stopped one holds.
#[test]
fn a_guardian_that_stands_stopped_is_replaced_and_one_that_is_asked_to_pause_goes_on() {
    let place = Place::new("stopped-g");
    let mut child = place.start(&[]);
    let rows = place.wait_ready();
    let guardian = pid_of(&rows, "guardian");
    send(guardian, Signal::TSTP);
    let supervisor = pid_of(&rows, "supervisor");
    kill(supervisor);
    place.wait("another supervisor", |rows| rows.iter().any(|(name, pid, _)| name == "supervisor" && *pid != supervisor));
    assert_eq!(pid_of(&place.wait_ready(), "guardian"), guardian, "Ctrl-Z stops no guardian");
    send(guardian, Signal::STOP);
    let after = place.wait("a stand-in", |rows| rows.iter().any(|(name, pid, _)| name == "guardian" && *pid != guardian));
    child.wait().unwrap();
    assert_eq!(engines(&after), engines(&rows), "engines were touched");
    assert!(place.call(&["stop"]).status.success());
    place::ended(pid_of(&after, "guardian"));
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// A pipe that is full: whoever writes to it stands until somebody reads.
fn full_pipe() -> (std::io::PipeReader, std::io::PipeWriter) {
    let (reader, mut writer) = std::io::pipe().unwrap();
    rustix::fs::fcntl_setfl(&writer, rustix::fs::OFlags::NONBLOCK).unwrap();
    while std::io::Write::write(&mut writer, &[b'.'; 4_096]).is_ok() {}
    rustix::fs::fcntl_setfl(&writer, rustix::fs::OFlags::empty()).unwrap();
    (reader, writer)
}

#[test]
fn a_guardian_whose_words_nobody_reads_keeps_the_station_and_ends_it() {
    let place = Place::new("unheard");
    let (_reader, writer) = full_pipe();
    let mut command = place.command(&["run", "--headless", "--binaries", place.folder.to_str().unwrap()]);
    let mut child = command.stdout(Stdio::null()).stderr(writer).spawn().unwrap();
    let mut rows = place.wait_ready();
    let guardian = pid_of(&rows, "guardian");
    for _ in 0..3 {
        rows = kill_and_wait(&place, &rows, &["supervisor"]); // a line each
    }
    assert_eq!(pid_of(&rows, "guardian"), guardian);
    assert!(place.call(&["stop"]).status.success());
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn a_run_of_the_same_settings_takes_over_from_a_stand_in_and_another_is_refused() {
    let place = Place::new("attach");
    let report = place.report();
    let mut child = place.start(&[]);
    let rows = kill_and_wait(&place, &place.wait_ready(), &["guardian"]);
    child.wait().unwrap();
    let other = place.call(&["run", "--headless", "--workers", "0", "--binaries", place.folder.to_str().unwrap()]);
    assert_eq!(other.status.code(), Some(2));
    assert!(text(&other.stderr).contains("with other settings"), "{}", text(&other.stderr));
    let run = place.start(&["--report", report.to_str().unwrap()]);
    let after = place.wait("the new run is the guardian", |rows| pid_of(rows, "guardian") == u64::from(run.id()));
    assert_eq!(engines(&after), engines(&rows), "engines were touched");
    assert!(place.call(&["stop"]).status.success());
    let output = run.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(report.is_file(), "its report is written where the new run wants it");
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

/// What an engine has started: whoever else is in the group that it leads.
fn started_by(engine: u64) -> Vec<u64> {
    let is_in_group = |pid: &u32| u64::from(*pid) != engine && hystation::proc::group(*pid).map(u64::from) == Some(engine);
    hystation::proc::of_user().filter(is_in_group).map(u64::from).collect()
}

/// Whoever had become another program by then lived on, at the stop too: nobody but its engine had known of it.
#[test]
fn what_an_engine_has_started_ends_with_it_whoever_keeps_the_station_and_reaps_it() {
    let place = Place::new("forks");
    std::fs::write(place.folder.join("fake"), "forks fluid\nforks tissue\n").unwrap();
    let mut child = place.start(&[]);
    let mut rows = place.wait_ready();
    let end_one = |rows: &Rows, name: &str| {
        let victim = pid_of(rows, name);
        let started = started_by(victim);
        assert_eq!(started.len(), 1, "{name}");
        kill(victim);
        place::ended(started[0]);
        let is_back = |(_, pid, state): &(String, u64, String)| *pid != victim && (state == "live" || state == "spare");
        place.wait(&format!("another {name}"), |rows| rows.len() == place::PROCESSES && rows.iter().all(is_back))
    };
    rows = end_one(&rows, "fluid:1"); // the supervisor's child
    kill_and_wait(&place, &rows, &["supervisor"]);
    rows = place.wait_ready();
    rows = end_one(&rows, "tissue:1"); // the guardian's
    kill_and_wait(&place, &rows, &["guardian"]);
    child.wait().unwrap();
    rows = place.wait_ready();
    kill_and_wait(&place, &rows, &["supervisor"]);
    rows = place.wait_ready();
    rows = end_one(&rows, "fluid:0"); // that of none of them
    let keepers = ["guardian", "supervisor"].map(|name| pid_of(&rows, name));
    let started: Vec<u64> = engines(&rows).iter().flat_map(|(_, pid)| started_by(*pid)).collect();
    assert_eq!(started.len(), 4);
    keepers.into_iter().for_each(kill);
    keepers.into_iter().for_each(place::ended);
    let stopped = place.call(&["stop"]);
    assert!(stopped.status.success(), "{}", text(&stopped.stderr));
    started.into_iter().for_each(place::ended);
    assert_eq!(place.leftovers(), Vec::<String>::new());
}

#[test]
fn a_stand_in_ends_the_run_in_time_and_writes_the_report() {
    let place = Place::new("endure");
    let report = place.report();
    let mut child = place.start(&["--for", "10s", "--report", report.to_str().unwrap()]);
    let rows = place.wait_ready();
    kill(pid_of(&rows, "guardian"));
    child.wait().unwrap();
    let since = std::time::Instant::now();
    // Whole: it is written when everything else is gone.
    let whole = || -> Option<serde_json::Value> { serde_json::from_slice(&std::fs::read(&report).ok()?).ok() };
    let report = loop {
        match whole() {
            Some(report) if place.leftovers().is_empty() => break report,
            _ => assert!(since.elapsed() < place::PATIENCE, "no end: {:?}", place.leftovers()),
        }
        std::thread::yield_now();
    };
    assert_eq!(report["leftovers"], serde_json::json!({ "processes": 0, "shared_memory": 0, "files": 0 }));
}

/// The supervisor is killed at a point of its work, at the start or when an engine is replaced that was killed.
fn dies_at(point: &str, pass: u32) {
    let place = Place::new(&format!("at-{pass}"));
    let report = place.report();
    let binaries = place.folder.to_str().unwrap();
    let words = ["run", "--headless", "--test-mode", "--binaries", binaries, "--report", report.to_str().unwrap()];
    let mut command = place.command(&words);
    command.env(hystation::intent::DIES_AT, format!("{point}:{pass}"));
    let child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let rows = place.wait_ready();
    let victim = pid_of(&rows, "fluid:1");
    kill(victim);
    let back = |rows: &[(String, u64, String)]| {
        let well = |(_, _, state): &(String, u64, String)| state == "live" || state == "spare";
        rows.len() == place::PROCESSES && rows.iter().all(well) && rows.iter().all(|(_, pid, _)| *pid != victim)
    };
    let rows = place.wait(&format!("{point}:{pass}: whole again"), back);
    let station = hyst_exchange::Station::named(&place.name).unwrap();
    let page = station.open().unwrap();
    assert!(page.page().load64(hyst_messages::page::station::SUPERVISOR_STARTS) >= 2, "{point}:{pass}: nobody died");
    // No process, page or slot is left half-way.
    let known: Vec<u64> = rows.iter().map(|(_, pid, _)| *pid).collect();
    let strangers: Vec<u32> =
        hystation::proc::of_station(&station).into_iter().filter(|pid| !known.contains(&u64::from(*pid))).collect();
    let helper = |pid: &u32| match std::fs::read_to_string(format!("/proc/{pid}/cmdline")) {
        Ok(words) => words.is_empty() || words.contains("clean"), // empty: it is ending
        Err(_) => true,                                           // it has ended
    };
    assert!(strangers.iter().all(helper), "{point}:{pass}: {strangers:?}");
    let pages = std::fs::read_dir(station.root().join("pages")).unwrap().flatten();
    let of_slots = pages.filter(|page| page.file_name().to_string_lossy().starts_with(|c: char| c.is_ascii_digit())).count();
    assert_eq!(of_slots, place::PROCESSES - 2, "{point}:{pass}: a page for each life");
    assert!(place.call(&["stop"]).status.success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{point}:{pass}: {}", text(&output.stderr));
    // One that died before its first heartbeat has not been dead since the machine was started.
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    let of_supervisor = |fault: &&serde_json::Value| fault["target"] == "supervisor";
    let faults: Vec<_> = report["faults"].as_array().unwrap().iter().filter(of_supervisor).collect();
    let found_us: Vec<f64> = faults.iter().map(|fault| fault["detected_us"].as_f64().unwrap()).collect();
    let sane = |us: &f64| *us < place::PATIENCE.as_secs_f64() * 1e6;
    assert!(!found_us.is_empty() && found_us.iter().all(sane), "{point}:{pass}: {found_us:?}");
    assert_eq!(place.leftovers(), Vec::<String>::new(), "{point}:{pass}");
}

#[test]
fn a_supervisor_that_dies_in_the_middle_of_a_start_has_it_finished_or_undone() {
    for point in ["spawn-declared", "spawn-paged", "spawn-served", "spawn-started", "spawn-entered"] {
        dies_at(point, 3); // of the starts of the station's engines
        dies_at(point, place::PROCESSES as u32 - 1); // when one of them is replaced
    }
}

#[test]
fn a_supervisor_that_dies_in_the_middle_of_a_burial_has_it_finished() {
    for point in ["reaped", "bury-declared", "bury-done"] {
        dies_at(point, 1);
    }
}

/// A swap is begun, and the supervisor dies at a point of it: the next one finishes what was proven and undoes the rest. The worker's predecessor is
/// killed for its guest, and by nobody else than the supervisor: one that hangs is killed by the watch thread too, and is often dead before.
#[test]
fn a_supervisor_that_dies_in_the_middle_of_a_swap_has_it_finished_or_undone() {
    for (point, role, proven) in [
        ("swap-declared", "fluid", false),
        ("swap-told", "fluid", false),
        ("kill-declared", "collision-worker", false),
        ("kill-done", "collision-worker", false),
        ("swap-adopted", "collision-worker", true),
    ] {
        let place = Place::new(point);
        let folder = place.folder.join("new");
        std::fs::create_dir_all(&folder).unwrap();
        let binary = folder.join(role);
        std::fs::copy(std::fs::canonicalize(place.folder.join(role)).unwrap(), &binary).unwrap();
        let mut command = place.command(&["run", "--headless", "--test-mode", "--binaries", place.folder.to_str().unwrap()]);
        let child = command.env(hystation::intent::DIES_AT, point).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let before = place.wait_ready();
        let swapped = place.call(&["swap", role, binary.to_str().unwrap()]);
        let said = format!("{point}: {}{}", text(&swapped.stdout), text(&swapped.stderr));
        // Also where its end is known from what the next one wrote down alone: undone is 1, and never 2, since the newcomer was there.
        assert_eq!(swapped.status.code(), Some(i32::from(!proven)), "{said}");
        assert!(text(&swapped.stdout).contains(" of "), "{said}: the steps of the swap were not told");
        let rows = place.wait_ready(); // nobody in the guest's slot
        let station = hyst_exchange::Station::named(&place.name).unwrap();
        let starts = station.open().unwrap().page().load64(hyst_messages::page::station::SUPERVISOR_STARTS);
        assert!(starts >= 2, "{said}: nobody died");
        let runs_new = |pid: u64| {
            std::fs::read_link(format!("/proc/{pid}/exe")).is_ok_and(|runs| hyst_engine::kept::name_of(&runs) == binary)
        };
        for (name, pid, _) in &rows {
            assert_eq!(runs_new(*pid), proven && name.starts_with(role), "{said}: {name}");
            let is_engine = !name.starts_with(role) && name != "supervisor";
            assert!(!is_engine || pid_of(&before, name) == *pid, "{said}: {name} was touched");
        }
        assert!(place.call(&["stop"]).status.success());
        let ended = child.wait_with_output().unwrap();
        assert_eq!(ended.status.code(), Some(0), "{said}");
        assert_eq!(place.leftovers(), Vec::<String>::new(), "{said}");
        let told = text(&ended.stderr);
        let is_death = |line: &&str| line.contains(") died, ");
        assert_eq!(told.lines().find(is_death), None, "{said}: whom the dead one had told to go is mourned by nobody: {told}");
    }
}

/// A guest that has stayed behind when its swap was over, as one that the kernel keeps does: the next supervisor knows whose it is.
#[test]
fn a_guest_whose_swap_is_over_is_told_to_go_by_the_next_supervisor_and_is_mourned_by_nobody() {
    let place = Place::new("stays");
    let child = place.start(&[]);
    let before = place.wait_ready();
    let folder = place.folder.join("new");
    std::fs::create_dir_all(&folder).unwrap();
    let binary = folder.join("fluid");
    std::fs::copy(std::fs::canonicalize(place.folder.join("fluid")).unwrap(), &binary).unwrap();
    let mut command = place.command(&["swap", "fluid", binary.to_str().unwrap()]);
    let mut swapping = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let rows = place.wait("the newcomer", |rows| rows.iter().any(|(name, _, state)| name == "fluid:2" && state == "spare"));
    // Nobody else writes while it is written down that the swap is over.
    let supervisor = pid_of(&rows, "supervisor");
    send(supervisor, Signal::STOP);
    let is_stopped = || std::fs::read_to_string(format!("/proc/{supervisor}/stat")).is_ok_and(|stat| stat.contains(") T "));
    await_that("the supervisor stands", is_stopped);
    let path = hyst_exchange::Station::named(&place.name).unwrap().swap();
    let mut record: serde_json::Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    record["promoted"] = false.into();
    hyst_exchange::whole::write(&path, record.to_string().as_bytes()).unwrap();
    kill(supervisor);
    assert_eq!(swapping.wait().unwrap().code(), Some(1));
    let after = place.wait_ready(); // nobody in the guest's slot
    assert_eq!(engines(&after), engines(&before), "engines were touched");
    assert!(place.call(&["stop"]).status.success());
    let told = text(&child.wait_with_output().unwrap().stderr);
    assert_eq!(told.lines().find(|line| line.contains(") died, ")), None, "{told}");
    assert!(told.contains("fluid:2, which had been told to go, has ended"), "{told}");
}

#[test]
fn outside_of_test_mode_nobody_can_make_the_supervisor_die() {
    let place = Place::new("mortal");
    let mut command = place.command(&["run", "--headless", "--binaries", place.folder.to_str().unwrap()]);
    let output = command.env(hystation::intent::DIES_AT, "reaped").output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("--test-mode"), "{}", text(&output.stderr));
}
