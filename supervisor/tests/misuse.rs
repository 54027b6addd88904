//! What does not come from a well-meaning operator: a flood on the control socket, damaged pages, engines that leak or print without end, a state that kills whoever
//! goes on from it.

mod place;
mod shown;

use hyst_messages::page::{header, roster, station as layout};
use hyst_messages::{Role, Slot};
use place::{PATIENCE, Place, pid_of, text};
use rustix::process::Signal;
use std::io::Write;
use std::os::unix::net::UnixStream;
use std::process::Stdio;
use std::time::Instant;

fn station(place: &Place) -> hyst_exchange::Station {
    hyst_exchange::Station::named(&place.name).unwrap()
}

fn events(place: &Place) -> String {
    std::fs::read_to_string(station(place).root().join("events.log")).unwrap_or_default()
}

/// Waits until the station's events say something.
fn wait_said(place: &Place, what: &str) {
    let since = Instant::now();
    while !events(place).contains(what) {
        assert!(since.elapsed() < PATIENCE, "{what:?} was not said:\n{}", events(place));
        std::thread::yield_now();
    }
}

fn report_of(place: &Place) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(place.report()).unwrap()).unwrap()
}

fn threads_and_memory(pid: u64) -> (usize, f64) {
    let threads = hystation::proc::threads(pid as u32).len();
    (threads, hystation::proc::resident_mib(pid as u32).unwrap())
}

/// Connections of the flood.
const FLOOD: usize = 10_000;
/// Of which so many are open at a time: as many as this test may have files.
const OPEN: usize = 500;

#[test]
fn ten_thousand_connections_and_garbage_hold_nobody_and_cost_no_memory() {
    let place = Place::new("flood");
    let child = place.start(&[]);
    let supervisor = pid_of(&place.wait_ready(), "supervisor");
    let before = threads_and_memory(supervisor);
    let path = station(&place).control_socket();
    let garbage: [&[u8]; 6] =
        [b"", b"{\"do\":", b"\xff\xfe\x00\n", b"{\"do\":\"status\",\"x\":1}\n", b"[[[[[[[[[[[[\n", &[b'x'; 70_000]];
    let mut open = std::collections::VecDeque::new();
    let mut answered = 0;
    for index in 0..FLOOD {
        let mut stream = UnixStream::connect(&path).unwrap();
        let _ = stream.write_all(garbage[index % garbage.len()]); // a line that is too long is cut off in the middle
        open.push_back(stream);
        if open.len() > OPEN {
            open.pop_front();
        }
        if index % (FLOOD / 10) == 0 {
            let asked = hystation::control::ask(&station(&place), &hystation::control::Request::Status);
            answered += usize::from(asked.is_ok());
            assert!(asked.is_ok(), "in the flood, after {index}: {asked:?}");
        }
    }
    assert_eq!(answered, 10);
    let after = threads_and_memory(supervisor);
    assert_eq!(after.0, before.0, "no thread for a client");
    assert!(after.1 < before.1 + 16.0, "memory: {before:?}, {after:?} MiB");
    drop(open);
    let rows = place.wait_ready();
    assert_eq!(pid_of(&rows, "supervisor"), supervisor, "it lived through it");
    assert!(place.call(&["stop"]).status.success());
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(0));
}

#[test]
fn another_user_is_refused_even_if_the_folder_is_open_to_him() {
    use std::os::unix::fs::PermissionsExt;
    use std::os::unix::process::CommandExt;
    let place = Place::new("stranger");
    let child = place.start(&[]);
    place.wait_ready();
    let path = station(&place).control_socket();
    let mode = |path: &std::path::Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
    assert_eq!((mode(station(&place).root()), mode(&path)), (0o700, 0o600));
    let own = UnixStream::connect(&path).unwrap();
    assert!(hystation::control::is_own(&own));
    // Only root can become somebody else; any other user has shown the modes above.
    if hyst_exchange::system::user_id() == 0 {
        std::fs::set_permissions(station(&place).root(), std::fs::Permissions::from_mode(0o711)).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o666)).unwrap();
        let script = "import socket,sys\ns=socket.socket(socket.AF_UNIX)\ns.connect(sys.argv[1])\ntry:\n s.sendall(b'{\"do\":\"stop\"}\\n')\nexcept OSError:\n pass\nprint(s.recv(500))";
        let output = std::process::Command::new("python3").args(["-c", script]).arg(&path).uid(65_534).output();
        match output {
            Ok(output) => {
                assert!(text(&output.stdout).contains("another user"), "{}{}", text(&output.stdout), text(&output.stderr));
            }
            Err(error) => eprintln!("NOT TRIED: another user at the control socket needs python3: {error}"),
        }
    } else {
        eprintln!("NOT TRIED: another user at the control socket, for only root can become one");
    }
    let rows = place.wait_ready();
    assert!(!rows.is_empty(), "it was not stopped");
    assert!(place.call(&["stop"]).status.success());
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(0));
}

#[test]
fn a_roster_with_nonsense_is_mended_and_said() {
    let place = Place::new("roster");
    let child = place.start(&[]);
    place.wait_ready();
    let page = hyst_exchange::OwnedPage::open(&station(&place).roster_page(), roster::WORDS).unwrap();
    let word = roster::OWNER + Role::Tissue as usize;
    let good = page.load64(word);
    let living = good & 0xffff_ffff;
    let holds_since = |epoch: u64| {
        let since = Instant::now();
        // Above all that were used, and with room for promotions.
        while page.load64(word) & 0xffff_ffff != living || !(epoch + 1..epoch + 100).contains(&(page.load64(word) >> 32)) {
            assert!(since.elapsed() < PATIENCE, "{:x} stays", page.load64(word));
            std::thread::yield_now();
        }
    };
    // Nobody can be that, nobody was born as that, an epoch without a holder and a holder without one; the last epoch that there is, under a living
    // holder; one that goes back, under the same; nobody at all.
    for nonsense in [u64::MAX, 77 << 32 | 9_999, 5, 5 << 32, 0x7fff_ffff << 32 | living, 1 << 32 | living, 0] {
        let epoch = page.load64(word) >> 32;
        page.store64(word, nonsense);
        holds_since(epoch);
    }
    wait_said(&place, "which cannot be");
    // Again and again, as fast as it is mended: a station that says each of them fills its own folder.
    let said = || events(&place).matches("which cannot be").count();
    for _ in 0..200 {
        let epoch = page.load64(word) >> 32;
        page.store64(word, 0x7fff_ffff << 32 | living);
        holds_since(epoch);
    }
    assert!(said() < 50, "{}", events(&place));
    page.store64(header::MAGIC, 1);
    wait_said(&place, "damaged header");
    assert!(hyst_exchange::Roster::open(&station(&place)).is_ok());
    // While no supervisor lives: its successor must be able to begin.
    let rows = place.wait_ready();
    let (guardian, supervisor) = (pid_of(&rows, "guardian"), pid_of(&rows, "supervisor"));
    place::send(guardian, Signal::STOP); // or it would start one at once
    place::kill(supervisor);
    let stat = format!("/proc/{supervisor}/stat"); // its parent is stopped, and reaps nobody
    while std::fs::read_to_string(&stat).is_ok_and(|text| !text.contains(") Z")) {
        std::thread::yield_now();
    }
    page.store64(header::MAGIC, 2);
    place::send(guardian, Signal::CONT);
    place.wait("another supervisor", |rows| rows.iter().any(|(name, pid, _)| name == "supervisor" && *pid != supervisor));
    assert!(hyst_exchange::Roster::open(&station(&place)).is_ok());
    assert!(place.call(&["stop"]).status.success());
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(0));
}

#[test]
fn a_page_whose_header_is_damaged_is_mended_and_said() {
    let place = Place::new("headers");
    let child = place.start(&[]);
    place.wait_ready();
    let (root, slot) = (station(&place), Slot::first(Role::Tissue));
    let incarnation = root.open().unwrap().incarnation(slot);
    root.own_slot(slot, incarnation).unwrap().store64(header::MAGIC, 1);
    wait_said(&place, &format!("the page of {slot} had a damaged header"));
    assert!(root.read_slot(slot, incarnation).is_ok());
    root.open_for_keeping().unwrap().store64(header::MAGIC, 1);
    wait_said(&place, "the station's page had a damaged header");
    assert!(root.open().is_ok());
    assert!(place.call(&["stop"]).status.success());
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(0));
}

/// By a flipped bit one who lived was nobody's holder, reader or victim for as long as it lived.
#[test]
fn one_who_lives_and_is_said_to_be_dead_is_said_to_live_again_and_its_death_is_seen_as_ever() {
    let place = Place::new("said-dead");
    let child = place.start(&[]);
    let before = place.wait_ready();
    let (root, slot) = (station(&place), Slot::first(Role::Console));
    root.open_for_keeping().unwrap().store32(layout::SLOT_DEAD + slot.number(), 1 << 20);
    wait_said(&place, &format!("said that {slot} is dead"));
    assert!(!root.open().unwrap().is_dead(slot));
    let pids = |rows: &[(String, u64, String)]| rows.iter().map(|(name, pid, _)| (name.clone(), *pid)).collect::<Vec<_>>();
    assert_eq!(pids(&place.wait_ready()), pids(&before), "{}", events(&place));
    let name = slot.to_string();
    place::kill(pid_of(&before, &name));
    place.wait("its successor", |rows| {
        let is_new = |(known, pid, state): &(String, u64, String)| {
            *known == name && *pid != pid_of(&before, &name) && (state == "live" || state == "spare")
        };
        rows.iter().any(is_new)
    });
    assert!(place.call(&["stop"]).status.success());
    child.wait_with_output().unwrap();
}

#[test]
fn a_state_that_kills_every_holder_ends_in_a_tissue_held_still_and_the_station_goes_on() {
    let place = Place::new("doomed");
    std::fs::write(place.folder.join("fake"), "doomed tissue\n").unwrap();
    let child = place.start(&["--report", place.report().to_str().unwrap()]);
    wait_said(&place, "tissue is held still from now on");
    let page = station(&place).open().unwrap();
    assert!(page.is_held(Role::Tissue) && !page.is_held(Role::Fluid) && page.ground_tick(Role::Tissue) < u64::MAX);
    let rows = place.wait_ready(); // all of it, the tissue too
    assert!(rows.iter().any(|(name, _, state)| name == "tissue:0" && (state == "live" || state == "spare")));
    let supervisor = pid_of(&rows, "supervisor");
    place::kill(supervisor);
    place.wait("a new supervisor", |rows| pid_of(rows, "supervisor") != supervisor);
    assert!(page.is_held(Role::Tissue), "its successor knows");
    assert!(place.call(&["stop"]).status.success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", text(&output.stderr));
    let report = report_of(&place);
    assert_eq!(report["held"], serde_json::json!(["tissue"]));
    let deaths =
        report["faults"].as_array().unwrap().iter().filter(|fault| fault["target"].as_str().unwrap().starts_with("tissue"));
    let deaths = deaths.count();
    assert!((9..=30).contains(&deaths), "the promotions are bounded: {deaths}");
}

#[test]
fn an_engine_that_leaks_hands_over_and_is_replaced_before_the_system_kills_it() {
    let place = Place::new("leak");
    std::fs::write(place.folder.join("fake"), "leak tissue\nfiles fluid\n").unwrap();
    let child = place.start(&["--report", place.report().to_str().unwrap()]);
    let rows = place.wait_ready();
    let (memory, files) = (pid_of(&rows, "tissue:0"), pid_of(&rows, "fluid:0"));
    wait_said(&place, "tissue is handed over");
    wait_said(&place, "fluid is handed over");
    let after = place.wait("both are replaced", |rows| {
        let back = |name: &str, old: u64| {
            rows.iter().any(|(known, pid, state)| known == name && *pid != old && (state == "live" || state == "spare"))
        };
        back("tissue:0", memory) && back("fluid:0", files)
    });
    assert_eq!(pid_of(&after, "tissue:1"), pid_of(&rows, "tissue:1"), "the spare took the role and lives");
    std::fs::write(place.folder.join("fake"), "").unwrap();
    assert!(events(&place).contains("its memory has grown") && events(&place).contains("its open files have grown"));
    assert!(place.call(&["stop"]).status.success());
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(0));
    let report = report_of(&place);
    let found: Vec<&str> =
        report["faults"].as_array().unwrap().iter().filter_map(|fault| fault["detected_by"].as_str()).collect();
    assert!(found.iter().filter(|by| **by == "growth").count() >= 2, "{found:?}");
}

/// It had /dev/shm full within a second, and whoever needed memory there died.
#[test]
fn an_engine_that_floods_its_log_hands_over_and_is_replaced() {
    let place = Place::new("floods");
    std::fs::write(place.folder.join("fake"), "floods fluid\n").unwrap();
    let child = place.start(&["--report", place.report().to_str().unwrap()]);
    wait_said(&place, "is replaced: it floods its log");
    wait_said(&place, "fluid is handed over");
    std::fs::write(place.folder.join("fake"), "").unwrap();
    place.wait_ready();
    let is_of_spare = |line: &&str| line.contains("fluid:1 ") && line.contains("is replaced");
    assert_eq!(events(&place).lines().filter(is_of_spare).count(), 0, "{}", events(&place));
    assert!(place.call(&["stop"]).status.success());
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(0));
    let report = report_of(&place);
    assert!(report["faults"].as_array().unwrap().iter().any(|fault| fault["detected_by"] == "flood"), "{report:#}");
}

/// A newcomer that refused whatever it read had the old engines replaced, one after the other, before anybody knew what it is worth itself.
#[test]
fn what_a_newcomer_says_of_others_costs_nobody_his_place_before_it_is_proven() {
    let place = Place::new("accuses");
    let child = place.start(&[]);
    let before = place.wait_ready();
    let folder = place.folder.join("new");
    std::fs::create_dir_all(&folder).unwrap();
    let binary = folder.join("fluid");
    std::fs::copy(std::fs::canonicalize(place.folder.join("fluid")).unwrap(), &binary).unwrap();
    std::fs::write(folder.join("fake"), "accuses fluid\n").unwrap();
    let mut command = place.command(&["swap", "fluid", binary.to_str().unwrap()]);
    let swapping = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let rows = place.wait("the newcomer", |rows| rows.iter().any(|(name, _, state)| name == "fluid:2" && state == "spare"));
    let guest = Slot::guest(Role::Fluid).unwrap();
    let page = station(&place).read_slot(guest, station(&place).open().unwrap().incarnation(guest)).unwrap();
    let since = Instant::now();
    while page.load64(header::STEPS) < 1_000 {
        assert!(since.elapsed() < PATIENCE, "it makes no steps"); // and says in each of them that the holder is not to be trusted
        std::thread::yield_now();
    }
    place::kill(pid_of(&rows, "fluid:2"));
    let swapped = swapping.wait_with_output().unwrap();
    assert_eq!(swapped.status.code(), Some(1), "{}{}", text(&swapped.stdout), text(&swapped.stderr));
    let pids = |rows: &[(String, u64, String)]| rows.iter().map(|(name, pid, _)| (name.clone(), *pid)).collect::<Vec<_>>();
    assert_eq!(pids(&place.wait_ready()), pids(&before), "{}", events(&place));
    assert!(!events(&place).contains("is distrusted by"), "{}", events(&place));
    assert!(place.call(&["stop"]).status.success());
    child.wait_with_output().unwrap();
}

/// Nobody found it: its checkpoints grew old, and both of a role that died then went on from an older state.
#[test]
fn an_engine_of_which_a_helper_stands_still_hands_over_and_is_replaced() {
    let place = Place::new("stands");
    std::fs::write(place.folder.join("fake"), "stands tissue\n").unwrap();
    let child = place.start(&["--report", place.report().to_str().unwrap()]);
    wait_said(&place, "is replaced: its keeper stands still");
    wait_said(&place, "tissue is handed over");
    place.wait("the spare has the role, and another is its spare", |rows| {
        let is = |name: &str, wanted: &str| rows.iter().any(|(known, _, state)| known == name && state == wanted);
        is("tissue:1", "live") && is("tissue:0", "spare")
    });
    assert!(place.call(&["stop"]).status.success());
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(0));
    let report = report_of(&place);
    let of_it = report["faults"].as_array().unwrap().iter().filter(|fault| fault["detected_by"] == "keeper");
    let of_it: Vec<_> = of_it.map(|fault| (fault["kind"].as_str(), fault["target"].as_str())).collect();
    assert_eq!(of_it, [(Some("external"), Some("tissue:0"))], "once: {:#}", report["faults"]);
}

#[test]
fn systemd_is_told_when_the_station_is_ready_that_it_lives_and_that_it_stops() {
    let place = Place::new("notify");
    let path = place.folder.join("notify.sock");
    let socket = std::os::unix::net::UnixDatagram::bind(&path).unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut command = place.command(&["run", "--headless", "--binaries", place.folder.to_str().unwrap()]);
    command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "200000");
    let child = command.stdout(std::process::Stdio::null()).stderr(std::process::Stdio::piped()).spawn().unwrap();
    let mut said = String::new();
    let mut wait = |what: &str, times: usize| {
        let mut bytes = [0u8; 512];
        while said.matches(what).count() < times {
            let length = socket.recv(&mut bytes).unwrap_or_else(|error| panic!("{what} {times} times: {error}; {said}"));
            said.push_str(std::str::from_utf8(&bytes[..length]).unwrap());
        }
    };
    wait("READY=1\n", 1);
    wait("WATCHDOG=1\n", 5);
    let supervisor = pid_of(&place.wait_ready(), "supervisor");
    place::kill(supervisor);
    wait("WATCHDOG=1\n", 10); // another supervisor beats
    assert!(place.call(&["stop"]).status.success());
    wait("STOPPING=1\n", 1);
    assert_eq!(child.wait_with_output().unwrap().status.code(), Some(0));
}

/// By systemd's own reader, where there is one: an unknown key or a wrong unit of time would be ignored at run time, with the watchdog.
#[test]
fn the_units_file_is_one_that_systemd_takes_as_it_is() {
    let folder = std::env::temp_dir().join(format!("unit-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let unit = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/systemd/hystation.service")).unwrap();
    assert!(unit.contains("ExecStart=/opt/hystation/bin/hystation "), "{unit}");
    let path = folder.join("hystation.service");
    std::fs::write(&path, unit.replace("/opt/hystation/bin/hystation", env!("CARGO_BIN_EXE_hystation"))).unwrap();
    let verified = std::process::Command::new("systemd-analyze").args(["verify", "--man=no"]).arg(&path).output();
    std::fs::remove_dir_all(&folder).unwrap();
    match verified {
        Ok(output) => {
            // Without a running systemd it may speak of other units of the machine; of this one it has nothing to say.
            let said = format!("{}{}", text(&output.stdout), text(&output.stderr));
            assert!(!said.contains("hystation.service"), "{said}");
        }
        Err(error) => shown::not_shown(&format!("whether systemd takes the unit's file: systemd-analyze: {error}")),
    }
}
