//! The operator's page of a whole station, asked by a plain client: who may come in, what is shown, what can be changed, and what becomes of it when the
//! console dies or browsers stall.

use hyst_messages::{Role, Slot};
use rustix::process::Signal;
use serde_json::Value;
use station_tests::page::{ANSWER_LIMIT, Answer, Page};
use station_tests::shown::not_shown;
use station_tests::windows::Pairs;
use station_tests::{Folder, RECOVERY_LIMIT, Station, bad_engine, binaries, hystation, run, wait_for};
use std::cell::Cell;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;

/// Connections that stall: half as many as there are seats, and twice as many.
const STALLED: [usize; 2] = [16, 64];
/// Ticks after which a stream of events has ended by itself, and its seat is free.
const STREAM_TICKS: u64 = 15_000;
/// Memory that browsers which stall may take of the console, and what it has become when it has shown everything once, KiB.
const MOST_GROWN_KIB: u64 = 20 * 1024;
/// Windows in which browsers stall, and the ticks of each.
const WINDOWS: usize = 4;
/// See [`WINDOWS`].
const WINDOW_TICKS: u64 = 1_500;

fn pid_of(look: &Value, name: &str) -> Option<i64> {
    look["processes"].as_array()?.iter().find(|process| process["name"] == name)?["pid"].as_i64()
}

/// The figures for monitors, once the supervisor has answered.
fn metrics(page: &Page) -> Answer {
    let heard = |answer: &Answer| answer.text().contains("hystation_supervisor_answers 1.0\n");
    wait_for(RECOVERY_LIMIT, || Some(page.get("/metrics")).filter(heard)).expect("a supervisor that answers")
}

/// Whether status, terminal, page and metrics of a station say that faults may be injected: all of them, or none. What a browser makes of the page, `browser.rs` sees.
fn assert_told_of_test_mode(station: &Station, page: &Page, is_on: bool) {
    let (_, status, _) = run(hystation().args(["--name", station.name(), "status"]));
    assert_eq!(status.lines().next().is_some_and(|line| line.starts_with("*** TEST MODE: ")), is_on, "{status}");
    assert_eq!(status.contains("TEST MODE"), is_on, "{status}");
    assert_eq!(station.said().contains("*** TEST MODE: faults may be injected"), is_on, "{}", station.said());
    let look = page.event("look", |look| look["test_mode"].is_boolean()).expect("a look");
    assert_eq!(look["test_mode"], is_on, "{look}");
    let metric = format!("hystation_test_mode {:.1}\n", f64::from(u8::from(is_on)));
    let metrics = metrics(page).text();
    assert!(metrics.contains(&metric), "{metrics}");
    // The banner is hidden until a look says otherwise.
    let first = page.get("/").text();
    let banner = first.lines().find(|line| line.contains("id=\"banner\"")).unwrap_or_default();
    assert!(banner.contains(" hidden>Test mode: "), "{first}");
}

/// What the supervisor answers on its socket, where nobody else has looked at the request before.
fn asked(station: &Station, request: &str) -> Value {
    let mut stream = UnixStream::connect(station.place().control_socket()).expect("a supervisor");
    stream.set_read_timeout(Some(ANSWER_LIMIT)).expect("a limit");
    stream.write_all(format!("{request}\n").as_bytes()).expect("a request");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    serde_json::from_str(&answer).expect("an answer in JSON")
}

/// Outside of test mode: neither the page nor the socket of the supervisor takes a fault, and nobody is hurt.
fn assert_nobody_is_hurt(station: &Station, page: &Page) {
    let (before, words) = (station.pids(), "faults are refused outside of test mode");
    for target in ["recorder", "tissue:active", "haptic:spare"] {
        let answer = page.post("/fault", &format!("{{\"kind\":\"kill\",\"target\":\"{target}\"}}"));
        assert!(answer.status == 403 && answer.text().contains(words), "{target}: {answer:?}");
        let answer = asked(station, &format!("{{\"do\":\"fault\",\"kind\":\"kill\",\"target\":\"{target}\",\"tick\":0}}"));
        assert_eq!(answer["ok"], false, "{target}: {answer}");
        assert!(answer["error"].as_str().is_some_and(|error| error.contains(words)), "{target}: {answer}");
    }
    // Whoever had been hit would have been replaced, or given his role away, by then.
    station.run_ticks(1_000);
    assert_eq!(station.pids(), before, "{}", station.said());
    assert!(!station.events().contains("injected into"), "{}", station.events());
}

#[test]
fn the_page_shows_the_station_to_who_has_the_token_and_to_nobody_else() {
    let station = Station::start("page", &["--hand", "script:press"]);
    let page = Page::of(&station);
    let said = format!("operator's page: http://127.0.0.1:{}/?token={}", page.port, page.token);
    let printed = wait_for(RECOVERY_LIMIT, || station.said().contains(&said).then_some(()));
    assert!(printed.is_some(), "{}", station.said());

    let with_token = format!("GET /?token={} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n\r\n", page.token, page.port);
    let first = page.exchange(&with_token).expect("an answer");
    assert!(first.status == 200 && first.text().contains("id=\"processes\""), "{first:?}");
    assert_eq!(first.header("set-cookie"), None, "a browser would send it to other ports too");
    assert!(first.header("content-security-policy").is_some_and(|policy| policy.starts_with("default-src 'none'")), "{first:?}");
    for (from, to, status) in [
        (page.token.as_str(), "0000", 401),
        ("?token=", "?tokem=", 401),
        ("Host: 127.0.0.1", "Host: station.example", 403),
        ("Host: ", "Hest: ", 403),
    ] {
        let answer = page.exchange(&with_token.replace(from, to)).expect("an answer");
        assert_eq!(answer.status, status, "{to}: {answer:?}");
        assert!(!answer.text().contains(&page.token), "{answer:?}");
    }

    let look = page.event("look", |look| look["processes"].as_array().is_some_and(|all| all.len() > 10)).expect("a look");
    assert_eq!((look["test_mode"].as_bool(), look["state"].as_str()), (Some(false), Some("running")));
    assert!(look["console"].is_null(), "the token is not said again");
    let rate = |look: &Value| -> Option<f64> {
        look["processes"].as_array()?.iter().find(|process| process["name"] == "device")?["rate_hz"].as_f64()
    };
    let fast = page.event("look", |look| rate(look).is_some_and(|rate| rate > 100.0) && look["pump"]["pressure_mmhg"].is_f64());
    assert!(fast.is_some(), "{look}");
    let metrics = metrics(&page);
    assert_eq!(metrics.header("content-type"), Some("application/openmetrics-text; version=1.0.0; charset=utf-8"));
    assert!(metrics.text().contains("hystation_process_up{process=\"device\",role=\"device\"} 1.0\n"), "{}", metrics.text());
    assert!(metrics.text().ends_with("# EOF\n"));
    let recorded = |line: &str| line.strip_prefix("hystation_recorder_bytes ").is_some_and(|bytes| bytes.parse::<f64>().is_ok());
    assert!(metrics.text().lines().any(recorded), "{}", metrics.text());
    assert!(page.get("/history").text().contains("\"tissue:1\":["));
    assert_told_of_test_mode(&station, &page, false);
    assert_nobody_is_hurt(&station, &page);

    if std::env::var_os("HYSTATION_NO_GPU").is_none() {
        let picture = wait_for(RECOVERY_LIMIT, || Some(page.get("/picture.jpg?after=0")).filter(|answer| answer.status == 200));
        let picture = picture.unwrap_or_else(|| panic!("no picture\n{}", station.said()));
        assert!(picture.body.starts_with(&[0xff, 0xd8]) && picture.body.ends_with(&[0xff, 0xd9]), "{}", picture.head);
        let tick = picture.header("x-picture-tick").expect("a tick").to_string();
        let next = wait_for(RECOVERY_LIMIT, || {
            Some(page.get(&format!("/picture.jpg?after={tick}"))).filter(|answer| answer.status == 200)
        });
        assert!(next.is_some_and(|next| next.header("x-picture-tick") != Some(tick.as_str())), "the picture stands");
        let drawn = || Some(page.get("/metrics").text()).filter(|told| told.contains("hystation_rendering_scale_ratio "));
        let told = wait_for(RECOVERY_LIMIT, drawn).expect("figures of the pictures");
        let figure = |name: &str| told.lines().find_map(|line| line.strip_prefix(name)?.trim().parse::<f64>().ok());
        let of_pictures = ["pictures_total", "picture_age_seconds", "aim_hertz", "scale_ratio", "width_pixels"]
            .map(|name| figure(&format!("hystation_rendering_{name} ")));
        assert!(of_pictures.iter().all(|value| value.is_some_and(|value| value > 0.0)), "{of_pictures:?}\n{told}");
    }
    station.stop().assert_clean();
}

#[test]
fn what_is_changed_is_changed_by_a_post_of_the_page_alone() {
    let station = Station::start("change", &["--hand", "script:press", "--test-mode"]);
    let page = Page::of(&station);
    assert_told_of_test_mode(&station, &page, true);
    let before = station.pid("recorder", true);
    let kill = "{\"kind\":\"kill\",\"target\":\"recorder\"}";
    for path in ["/fault", "/swap"] {
        assert_eq!(page.get(path).status, 405, "{path}");
        let foreign = page.request(&format!("POST {path}"), "Origin: http://station.example\r\n", kill);
        assert_eq!(page.exchange(&foreign).map(|answer| answer.status), Some(403), "{path}");
        let without = page.request(&format!("POST {path}"), "", kill);
        assert_eq!(page.exchange(&without).map(|answer| answer.status), Some(403), "{path}");
        for (body, status) in [("", 400), ("{\"kind\":1}", 400), ("{\"do\":\"stop\"}", 400), (&"[".repeat(9_000)[..], 413)] {
            assert_eq!(page.post(path, body).status, status, "{path} {}", &body[..body.len().min(20)]);
        }
    }
    for (body, status, word) in [
        ("{\"kind\":\"melt\",\"target\":\"recorder\"}", 409, "melt"),
        ("{\"kind\":\"kill\",\"target\":\"guardian\"}", 409, "from outside"),
        ("{\"kind\":\"slow\",\"target\":\"fluid\"}", 409, "duration"),
    ] {
        let answer = page.post("/fault", body);
        assert!(answer.status == status && answer.text().contains(word), "{body}: {answer:?}");
    }
    let swap = |role: &str, binary: &str| page.post("/swap", &format!("{{\"role\":\"{role}\",\"binary\":\"{binary}\"}}"));
    for (role, binary, status, word) in [
        ("liver", "/bin/true", 400, "no role"),
        ("recorder", "recorder", 400, "whole path"),
        ("recorder", "/nowhere/recorder", 409, "No such file"),
        ("recorder", "/bin/true", 409, "is it an engine?"),
        ("hardware", "/bin/true", 409, ""),
    ] {
        let answer = swap(role, binary);
        assert!(answer.status == status && answer.text().contains(word), "{role} {binary}: {answer:?}");
    }
    assert_eq!(station.pid("recorder", true), before, "nothing of that did anything\n{}", station.said());
    assert!(page.get("/kinds").text().contains("\"name\":\"kill\""));

    assert_eq!(page.post("/fault", kill).status, 200);
    let dead = page.event("said", |line| line.as_str().is_some_and(|line| line.contains("recorder") && line.contains("died")));
    assert!(dead.is_some(), "{}", station.said());
    let replaced = page.event("look", |look| pid_of(look, "recorder").is_some_and(|pid| pid != i64::from(before)));
    assert!(replaced.is_some(), "{}", station.said());
    station.recover();
    let answer = swap("recorder", &binaries().join("recorder").display().to_string());
    assert!(answer.status == 200 && answer.text().contains("\"number\":1"), "{answer:?}");
    let proven = wait_for(RECOVERY_LIMIT, || station.events().contains("its probation is over").then_some(()));
    assert!(proven.is_some(), "{}", station.events());
    station.recover();
    station.stop().assert_clean();
}

/// Each of the two times that it is asked what it is it answers in time, and both together are more than the page waits for.
#[test]
fn an_engine_that_takes_too_long_to_be_verified_is_answered_before_the_browser_is_cut_off_and_is_not_swapped_in() {
    let station = Station::start("reluctant", &["--hand", "script:press"]);
    let page = Page::of(&station);
    let before = station.pid("fluid", true);
    let engine = bad_engine(station.folder(), "fluid", "reluctant");
    let answer = page.post("/swap", &format!("{{\"role\":\"fluid\",\"binary\":{engine:?}}}"));
    assert!(answer.status == 503 && answer.text().contains("nothing was swapped"), "{answer:?}");
    // What was begun ends by itself, and the supervisor does not hear of it.
    station.run_ticks(5_000);
    assert_eq!(page.get("/").status, 200);
    assert!(!station.events().contains("is to run"), "{}", station.events());
    assert_eq!(station.pid("fluid", true), before, "{}", station.said());
    station.stop().assert_clean();
}

/// What a developer does all day, who swaps from the page: the file that he named is his own again.
#[test]
fn an_engine_that_the_page_named_stays_what_it_was_when_another_is_built_over_its_file() {
    let station = Station::start("over", &["--hand", "script:press", "--test-mode"]);
    let page = Page::of(&station);
    let (mine, worse) = (station.folder().join("my-recorder"), station.folder().join("worse"));
    std::fs::copy(binaries().join("recorder"), &mine).expect("a copy of an engine");
    let good = std::fs::read(&mine).expect("the engine");
    let answer = page.post("/swap", &format!("{{\"role\":\"recorder\",\"binary\":{mine:?}}}"));
    assert_eq!(answer.status, 200, "{answer:?}");
    let proven = wait_for(RECOVERY_LIMIT, || station.events().contains("its probation is over").then_some(()));
    assert!(proven.is_some(), "{}", station.events());
    station.recover();
    std::fs::copy("/bin/true", &worse).expect("no engine");
    std::fs::rename(&worse, &mine).expect("another in its place");
    for _ in 0..2 {
        station.kill("recorder", true);
        station.recover();
    }
    let process = &station.processes("recorder")[0];
    assert_eq!(process["binary"].as_str(), mine.to_str(), "called as it was called");
    let runs = std::fs::read(format!("/proc/{}/exe", process["pid"])).expect("what it runs");
    assert!(runs == good, "{process:#}\n{}", station.said());
    station.stop().assert_clean();
}

/// Memory of its own that a process has, KiB.
fn anonymous_kib(pid: i32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).expect("it lives");
    let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:")).expect("its memory");
    line.trim().trim_end_matches(" kB").parse().expect("a number")
}

/// Browsers that say nothing, half of something, a swap of which the rest never comes, or ask for the live view, its events or its pictures, and never read.
fn stall(page: &Page, count: usize) -> Vec<TcpStream> {
    let asked = ["/events", "/picture.jpg?after=0"].map(|path| page.request(&format!("GET {path}"), "", ""));
    let origin = format!("Origin: http://127.0.0.1:{}\r\n", page.port);
    let swap = page.request("POST /swap", &origin, "").replace("Content-Length: 0", "Content-Length: 4096");
    let words = [String::new(), "GET / HTTP/1.1\r\nHost: ".into(), swap].into_iter().chain(asked);
    let one = |words: String| {
        let mut stream = page.connect().expect("a connection");
        let _ = stream.write_all(words.as_bytes()); // one that has to wait for a seat is not read yet
        stream
    };
    words.cycle().take(count).map(one).collect()
}

/// While some browsers stall, others read the page and its live events, and the console becomes no larger for it.
fn assert_stalled_browsers_are_nothing_to_others(station: &Station, page: &Page) {
    let pid = station.pid("console", true);
    let is_look = |look: &Value| look["processes"].is_array();
    assert!(page.event("look", is_look).is_some() && page.get("/").status == 200, "{}", station.said());
    page.get("/picture.jpg?after=0"); // or none, on a machine that draws nothing
    let (before_kib, began) = (anonymous_kib(pid), station.clock().present_tick());
    let stalled = stall(page, STALLED[0]);
    for _ in 0..5 {
        assert!(page.event("look", is_look).is_some() && page.get("/").status == 200, "{}", station.said());
        station.run_ticks(500);
    }
    if station.clock().present_tick() - began > STREAM_TICKS {
        not_shown("whether the page is read beside browsers that stall: they had been sent away by then");
    }
    drop(stalled);
    let more = stall(page, STALLED[1]);
    // All of them get a seat, each for its time, and then whoever comes gets one.
    let answered =
        wait_for(RECOVERY_LIMIT, || page.exchange(&page.request("GET /", "", "")).filter(|answer| answer.status == 200));
    assert!(answered.is_some(), "stalled browsers hold the page\n{}", station.said());
    assert_eq!(station.pid("console", true), pid, "it lived through it\n{}", station.said());
    let after_kib = anonymous_kib(pid);
    println!("the console had {before_kib} KiB before browsers stalled, and then {after_kib}");
    assert!(after_kib < before_kib + MOST_GROWN_KIB, "{before_kib} KiB before, {after_kib} after\n{}", station.said());
    drop(more);
}

/// Browsers that stall in window after window, more of them than there are seats, cost the hand no tick.
fn assert_stalled_browsers_are_not_felt(station: &Station, page: &Page) {
    let mut pairs = Pairs::default();
    for _ in 0..WINDOWS {
        pairs.around(station, WINDOW_TICKS, || {
            let stalled = stall(page, STALLED[1]);
            station.run_ticks(WINDOW_TICKS);
            drop(stalled);
        });
    }
    pairs.judge("browsers that stall", WINDOWS, station);
}

#[test]
fn a_console_that_is_killed_or_stalled_by_its_browsers_is_there_again_at_its_address() {
    let station = Station::start("again", &["--hand", "script:press"]);
    let page = Page::of(&station);
    let before = station.census();
    let console = station.pid("console", true);
    station.kill("console", true);
    let again = Page::of(&station);
    assert_eq!((again.port, &again.token), (page.port, &page.token));
    assert_eq!(page.get("/").status, 200, "the token of before is good");
    let looks = page.event("look", |look| pid_of(look, "console").is_some());
    assert!(looks.is_some(), "{}", station.said());

    assert_stalled_browsers_are_nothing_to_others(&station, &page);
    assert_stalled_browsers_are_not_felt(&station, &page);
    let log = std::fs::read_to_string(station.place().log(Slot::first(Role::Console))).unwrap_or_default();
    assert!(log.contains("all 32 seats of the operator's page are taken"), "nobody says why others wait:\n{log}");

    // One that hangs is found by its heartbeat as any other.
    let pid = station.pid("console", true);
    station.signal(pid, Signal::STOP);
    station.wait_until_gone(pid);
    station.recover();
    assert_eq!(page.get("/metrics").status, 200);
    before.assert_untouched(&station, "beside the console", &[console]);
    station.stop().assert_clean();
}

/// Pump and alarms stood on the page for as long as the supervisor did, and the page called itself connected.
#[test]
fn the_pump_goes_on_on_the_page_while_the_supervisor_stands() {
    let station = Station::start("unled", &["--hand", "script:press"]);
    let page = Page::of(&station);
    let (starts, supervisor) = (station.supervisor_starts(), station.keeper(Role::Supervisor).expect("a supervisor"));
    station.signal(supervisor.pid, Signal::STOP);
    // Two looks at the same answer of the supervisor, of which the later one has another pressure.
    let before: Cell<Option<(u64, f64)>> = Cell::new(None);
    let goes_on = |look: &Value| {
        let now = look["tick"].as_u64().zip(look["pump"]["pressure_mmhg"].as_f64());
        let before = before.replace(now);
        now.zip(before).is_some_and(|((tick, mmhg), (at, was))| tick == at && mmhg != was)
    };
    let look = page.event("look", goes_on).unwrap_or_else(|| panic!("{}", station.said()));
    assert!(look["silence"].is_null(), "it goes on only when the supervisor has gone: {look}");
    station.wait_for_supervisor(starts);
    station.recover();
    station.stop().assert_clean();
}

/// A goal that any hand reaches, and a warning that falls a second after the hand has moved.
const CASE: &str = r#"version = 1
name = "A press"
rung = "distension"
task = "Do something."
scene = "SCENE"
[[goal]]
pressure = { from_pa = 1000.0, to_pa = 13000.0, for_s = 1.0 }
[[goal]]
removed = { percent = 100.0 }
[[warning]]
time_above_s = 1.0
"#;

#[test]
fn the_page_tells_of_the_case_as_it_goes_and_a_new_console_goes_on_with_it() {
    let scene = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes/default.toml");
    let folder = Folder::new("console-case");
    let case = folder.write("case.toml", &CASE.replace("SCENE", &scene.display().to_string()));
    let station = Station::start("case", &[&case, "--hand", "script:press"]);
    let page = Page::of(&station);
    let reached = |told: &Value| told["goals"][0]["state"] == "reached" && told["warnings"][2]["count"] == 1;
    let told = page.event("case", reached).unwrap_or_else(|| panic!("{}", station.said()));
    assert_eq!((told["name"].as_str(), told["task"].as_str()), (Some("A press"), Some("Do something.")), "{told}");
    assert_eq!((told["goals"][1]["state"].as_str(), told["ended"].is_null()), (Some("open"), true), "{told}");
    assert_eq!(told["goals"][1]["called_off"], false, "nothing called for a stop: {told}");
    let first_s = told["goals"][0]["at_s"].as_f64().unwrap();
    assert!(first_s >= 1.0, "{told}");

    station.kill("console", true);
    let page = Page::of(&station);
    let again = page.event("case", |told| told["goals"][0]["state"] == "reached").expect("the case");
    assert_eq!(again["goals"][0]["at_s"].as_f64(), Some(first_s), "reached then, and not once more: {again}");
    assert_eq!(again["warnings"][2]["at_s"], told["warnings"][2]["at_s"], "{again}");
    station.stop().assert_clean();
}
