//! What the person at the station sees: the live table in a terminal, and the window under a display of its own.

use hyst_messages::{BUTTON_ENERGIZED, BUTTON_EXTENDED};
use rustix::process::Signal;
use station_tests::display::Display;
use station_tests::{Folder, RECOVERY_LIMIT, START_LIMIT, STOP_LIMIT, Station, binaries, hystation, run, wait_for};
use std::collections::BTreeSet;
use std::io::Write;
use std::process::{Child, Command, Stdio};

/// The columns of the table, in their order.
const COLUMNS: [&str; 9] = ["process", "incarn", "pid", "state", "epoch", "rate/Hz", "p99 wake/us", "age/ms", "binary"];
/// The colour of text over the picture.
const INK: [u8; 3] = [219, 242, 230];
/// Pixels of it that the help has at least: a dozen lines of some thirty letters with some ten each.
const HELP_INK: usize = 2_400;
/// Black pixels about the round picture of 640 × 480, of which the view from outside has none: a third of those that there are.
const ROUND_BLACK: usize = 40_000;
/// The colour of the sign, and pixels of it that a sign has at least: a dozen letters with some ten each.
const AMBER: [u8; 3] = [255, 189, 51];
/// See [`AMBER`].
const SIGN_INK: usize = 80;

/// A station in a terminal of its own: `script` makes the pseudo-terminal and keeps what is drawn there.
struct Terminal {
    name: String,
    script: Child,
    folder: Folder,
}

impl Terminal {
    fn start(name: &str, arguments: &str) -> Terminal {
        let folder = Folder::new(name);
        let name = format!("{name}-{}", std::process::id());
        let (program, session) = (binaries().join("hystation"), folder.path("session.mcap"));
        // In place of the shell: one that waits for it would answer Ctrl-C with a status of its own (dash does, bash does not).
        let run = format!("exec {} --name {name} run --headless --record {session} {arguments}", program.display());
        let mut command = Command::new("script");
        let script = command
            .args(["-qefc", &run, &folder.path("drawn")])
            .env("SHELL", "/bin/sh")
            .env("TERM", "xterm") // whoever runs this may have none that one can draw on
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("script, of Debian's bsdutils");
        Terminal { name, script, folder }
    }

    /// The screens that were drawn so far, whole ones, without the codes of the terminal.
    fn screens(&self) -> Vec<String> {
        let drawn = String::from_utf8_lossy(&std::fs::read(self.folder.path("drawn")).unwrap_or_default()).into_owned();
        let whole = drawn.split("\x1b[H").skip(1).filter(|screen| screen.contains("\x1b[J"));
        whole.map(|screen| screen.replace("\x1b[K", "").replace('\r', "")).collect()
    }

    /// Waits for a screen that has what is looked for.
    fn wait<T>(&self, what: &str, found: impl Fn(&str) -> Option<T>) -> T {
        let it = wait_for(START_LIMIT, || self.screens().iter().rev().find_map(|screen| found(screen)));
        it.unwrap_or_else(|| panic!("no screen shows {what}; the last:\n{}", self.screens().last().cloned().unwrap_or_default()))
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        if !matches!(self.script.try_wait(), Ok(Some(_))) {
            let _ = run(hystation().args(["--name", &self.name, "stop"]));
            let _ = self.script.kill();
            let _ = self.script.wait();
        }
    }
}

/// The fields of the table's row of a process.
fn row<'a>(screen: &'a str, process: &str) -> Option<Vec<&'a str>> {
    let fields = |line: &'a str| line.split_whitespace().collect::<Vec<_>>();
    screen.lines().map(fields).find(|fields| fields.first() == Some(&process) && fields.len() == COLUMNS.len())
}

#[test]
fn the_table_lives_says_who_died_and_ctrl_c_ends_it() {
    let mut terminal = Terminal::start("table", "--hand script:press");
    let names = ["hardware", "device", "haptic:0", "haptic:1", "tissue:0", "tissue:1", "fluid:0", "fluid:1"];
    let others = ["collision-worker:0", "collision-worker:1", "rendering", "recorder", "console", "supervisor"];
    let is_whole = |screen: &str| {
        let well = |name: &&str| row(screen, name).is_some_and(|row| row[3] == "live" || row[3] == "spare");
        names.iter().chain(&others).all(well).then(|| screen.to_string())
    };
    let whole = terminal.wait("every process live or a spare", is_whole);
    assert!(!whole.contains("TEST MODE"), "without --test-mode: {whole}");
    let head = whole.lines().find(|line| line.starts_with("process")).expect("a line of headings");
    let places: Vec<Option<usize>> = COLUMNS.iter().map(|column| head.find(column)).collect();
    assert!(places.iter().all(Option::is_some) && places.is_sorted(), "{head}");
    // What it says is what the station's pages say.
    let says_the_same = || {
        let (_, status, _) = run(hystation().args(["--name", &terminal.name, "status", "--json"]));
        let status: serde_json::Value = serde_json::from_str(&status).ok()?;
        let screen = terminal.screens().pop()?;
        let agrees = |process: &serde_json::Value| {
            let row = row(&screen, process["name"].as_str().unwrap_or_default());
            let number = |key: &str| process[key].as_u64();
            row.is_some_and(|row| row[1].parse().ok() == number("incarnation") && row[2].parse().ok() == number("pid"))
        };
        status["processes"].as_array().is_some_and(|all| all.len() > others.len() && all.iter().all(agrees)).then_some(())
    };
    let agrees = wait_for(RECOVERY_LIMIT, says_the_same);
    assert!(agrees.is_some(), "the table says something else than the pages:\n{}", terminal.folder.read("drawn"));
    // It is drawn anew, with new figures.
    let ages = |screens: &[String]| -> BTreeSet<String> {
        screens.iter().filter_map(|screen| Some(row(screen, "tissue:0")?[7].to_string())).collect()
    };
    let is_alive = wait_for(RECOVERY_LIMIT, || (ages(&terminal.screens()).len() >= 3).then_some(()));
    assert!(is_alive.is_some(), "the age of the tissue's newest value is always {:?}", ages(&terminal.screens()));
    let rate: f64 = terminal.wait("the device's rate", |screen| row(screen, "device")?[5].parse().ok());
    assert!(rate > 100.0, "the device makes {rate} ticks a second");

    let victim = terminal.wait("the recorder", |screen| Some(row(screen, "recorder")?[2].to_string()));
    let pid = rustix::process::Pid::from_raw(victim.parse().expect("a process id")).expect("a process id");
    rustix::process::kill_process(pid, Signal::KILL).expect("the process is ours");
    let says_so =
        |screen: &str| screen.lines().find(|line| line.contains("recorder") && line.contains("died")).map(str::to_string);
    let line = terminal.wait("that the recorder died", says_so);
    assert!(line.contains("signal 9"), "{line}");
    terminal.wait("the recorder's successor", |screen| (row(screen, "recorder")?[2] != victim).then_some(()));

    terminal.script.stdin.as_mut().expect("it is piped").write_all(b"\x03").expect("Ctrl-C is typed");
    let ended = wait_for(STOP_LIMIT, || terminal.script.try_wait().ok().flatten());
    // 1: the death of the recorder fell together with a stall of the host that cost ticks.
    let code = ended.and_then(|status| status.code());
    assert!(matches!(code, Some(0 | 1)), "{code:?}: {}", terminal.folder.read("drawn"));
    assert!(terminal.folder.read("drawn").contains(" void; 1 fault"), "one line sums it up");
    let place = hyst_exchange::Station::named(&terminal.name).expect("a name");
    assert!(place.leftovers().is_empty(), "left: {:?}", place.leftovers());
}

/// Presses keys or the mouse again and again until the hand has gone where it is to go.
fn until_moved(station: &Station, what: &str, press: impl Fn(), has_moved: impl Fn() -> bool) {
    let moved = wait_for(RECOVERY_LIMIT, || {
        press();
        has_moved().then_some(())
    });
    assert!(moved.is_some(), "{what}: the hand did not move: {:?}\n{}", station.sample().pose, station.said());
}

/// The wheel goes in and out, the right button turns the scope, the arrow keys tilt it.
fn move_by_the_rest(display: &Display, station: &Station) {
    let pose = || station.sample().pose;
    let press = |words: &[&str]| {
        display.xdotool(words);
    };
    let before = pose().insertion_m;
    let wheel = || press(&["click", "--repeat", "2", "5"]);
    until_moved(station, "the wheel", wheel, || (pose().insertion_m - before).abs() > 1e-3);
    let before = pose().roll_rad;
    let twist = || {
        press(&["mousemove", "300", "240", "mousedown", "3", "sleep", "0.1"]);
        press(&["mousemove", "360", "240", "sleep", "0.2", "mouseup", "3"]);
    };
    until_moved(station, "right button", twist, || (pose().roll_rad - before).abs() > 0.05);
    let before = pose().pitch_rad;
    let tilt = || press(&["keydown", "Down", "sleep", "0.3", "keyup", "Down"]);
    until_moved(station, "arrow down", tilt, || (pose().pitch_rad - before).abs() > 0.02);
}

/// I and O shut and open a valve, L brings the loop out and in, T dims the light; each is pressed twice, so that all stand as before.
fn turn_by_keys(display: &Display, station: &Station) {
    let is_turned = |key: &str| {
        let controls = station.sample().controls;
        match key {
            "i" => controls.inflow_valve == 0.0,
            "o" => controls.outflow_valve == 0.0,
            "l" => controls.buttons & BUTTON_EXTENDED != 0,
            _ => controls.light < 0.5,
        }
    };
    for key in ["i", "o", "l", "t"] {
        let before = is_turned(key);
        display.press(station, key, "it turns nothing", || is_turned(key) != before);
        display.press(station, key, "it turns nothing back", || is_turned(key) == before);
    }
}

/// That a process was replaced is signed in the picture, in amber, and some seconds later no more.
fn assert_a_replacement_is_signed(display: &Display, station: &Station) {
    let (before, recorder) = (display.count(AMBER), station.pid("recorder", true));
    station.signal_if_alive(recorder, Signal::KILL); // dead of another cause is as good
    let signed = wait_for(RECOVERY_LIMIT, || (display.count(AMBER) >= before + SIGN_INK).then_some(()));
    assert!(signed.is_some(), "no sign of a recorder that was replaced\n{}", station.said());
    let gone = wait_for(RECOVERY_LIMIT, || (display.count(AMBER) < before + SIGN_INK / 2).then_some(()));
    assert!(gone.is_some(), "the sign stays\n{}", station.said());
    station.recover();
}

/// F1 brings the help and takes it away, V shows the view from outside and the one from inside again, F a nearer focus, Home a higher pressure, which is given, Pa.
fn switch_by_keys(display: &Display, station: &Station) -> f32 {
    let before = display.count(INK);
    assert!(before > 0, "no strip of text");
    display.press(station, "F1", "no help", || display.count(INK) > before + HELP_INK);
    display.press(station, "F1", "the help stays", || display.count(INK) < before + HELP_INK / 2);
    let round = display.count([0; 3]);
    display.press(station, "v", "no view from outside", || display.count([0; 3]) + ROUND_BLACK < round);
    display.press(station, "v", "no view from inside", || display.count([0; 3]) + ROUND_BLACK / 2 > round);
    let focus_m = || station.sample().controls.focus_m;
    display.press(station, "f", "no nearer focus", || (0.003..0.019).contains(&focus_m()));
    let set_pa = || station.sample().controls.set_pressure_pa;
    let before_pa = set_pa();
    display.press(station, "Home", "no higher pressure", || set_pa() > before_pa + 600.0);
    set_pa()
}

/// Makes the window larger, and waits until that is known to whoever opens the next one.
fn enlarge(display: &Display, station: &Station, window: &str) {
    assert!(display.xdotool(&["windowsize", window, "800", "600"]).is_some(), "the window takes no size");
    let file = station.place().root().join("window-size");
    let kept = || std::fs::read_to_string(&file).ok().filter(|size| size.trim() == "800x600");
    assert!(wait_for(RECOVERY_LIMIT, kept).is_some(), "{:?}\n{}", std::fs::read_to_string(&file), station.said());
}

#[test]
fn mouse_and_keys_in_the_window_move_the_hand_also_in_the_window_of_a_successor() {
    let Some(display) = Display::start() else { return };
    let station = Station::start_shown(&display.name, "window", &[]);
    let window = display.window(&station);
    let geometry = display.xdotool(&["getwindowgeometry", &window]).unwrap_or_default();
    assert!(geometry.contains("640x480"), "{geometry}");
    let pose = || station.sample().pose;
    let far = |from: [f32; 3], to: [f32; 3]| from.iter().zip(to).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt();

    // Nobody has touched anything: the hand stands, but for what the medium does to the scope.
    let began = pose();
    station.run_ticks(300);
    let drift_m = far(pose().position_m, began.position_m);
    assert!(drift_m < 1e-6, "the hand goes by itself: {drift_m} m");
    let pull = || {
        display.xdotool(&["keydown", "Next", "sleep", "0.3", "keyup", "Next"]);
    };
    until_moved(&station, "page down", pull, || far(began.position_m, pose().position_m) > 1e-3);
    let turned = |from: [f32; 4], to: [f32; 4]| from.iter().zip(to).map(|(a, b)| a * b).sum::<f32>().abs() < 0.9998;
    let before = pose();
    let drag = || {
        display.xdotool(&[
            "mousemove",
            "300",
            "240",
            "mousedown",
            "1",
            "sleep",
            "0.1",
            "mousemove",
            "340",
            "240",
            "sleep",
            "0.2",
            "mouseup",
            "1",
        ]);
    };
    until_moved(&station, "left button", drag, || turned(before.orientation, pose().orientation));

    move_by_the_rest(&display, &station);
    assert_a_replacement_is_signed(&display, &station);
    turn_by_keys(&display, &station);
    let set_pa = switch_by_keys(&display, &station);
    enlarge(&display, &station, &window);

    station.kill("rendering", true);
    let next = display.window(&station);
    let geometry = display.xdotool(&["getwindowgeometry", &next]).unwrap_or_default();
    assert!(geometry.contains("800x600"), "a successor's window has another size: {geometry}");
    station.run_ticks(300);
    assert_eq!(station.sample().controls.set_pressure_pa, set_pa, "a successor's window sets the pump otherwise");
    let before = pose();
    let turn = || {
        display.xdotool(&["keydown", "e", "sleep", "0.3", "keyup", "e"]);
    };
    until_moved(&station, "the key E in the second window", turn, || turned(before.orientation, pose().orientation));

    // Who takes the window away gets no other; the station goes on.
    assert!(display.xdotool(&["windowclose", &next]).is_some());
    let gone = wait_for(RECOVERY_LIMIT, || display.xdotool(&["search", "--name", "hysteroscopy: "]).is_none().then_some(()));
    assert!(gone.is_some(), "the window stays\n{}", station.said());
    station.run_ticks(300);
    station.recover();
    station.stop().assert_clean();
}

/// Whether the hand wants current in the loop.
fn is_energized(station: &Station) -> bool {
    station.sample().controls.buttons & BUTTON_ENERGIZED != 0
}

/// Holds the space bar down in the station's window, and waits until there is current.
fn hold_space(display: &Display, station: &Station) -> String {
    let window = display.window(station);
    assert!(display.xdotool(&["keydown", "space"]).is_some());
    let flows = wait_for(RECOVERY_LIMIT, || is_energized(station).then_some(()));
    assert!(flows.is_some(), "no current under the key\n{}", station.said());
    window
}

/// Waits until there is no current, lets go of the space bar, which nobody hears any more, and looks whether it stays so.
fn assert_let_go(display: &Display, station: &Station, what: &str) {
    let ends = wait_for(RECOVERY_LIMIT, || (!is_energized(station)).then_some(()));
    assert!(ends.is_some(), "{what}: the current stays\n{}", station.said());
    assert!(display.xdotool(&["keyup", "space"]).is_some());
    station.recover();
    station.run_ticks(300);
    assert!(!is_energized(station), "{what}: the current comes again\n{}", station.said());
}

/// Current stayed on to the end of the session when the window went while its key was held, and until a successor's window spoke when the process died.
#[test]
fn current_ends_with_the_window_that_wants_it_whether_its_process_hangs_or_dies_or_it_is_closed() {
    let Some(display) = Display::start() else { return };
    let station = Station::start_shown(&display.name, "pedal", &[]);
    hold_space(&display, &station);
    station.run_ticks(1_000);
    assert!(is_energized(&station), "a key that is held for a second is held\n{}", station.said());
    let rendering = station.pid("rendering", true);
    station.signal(rendering, Signal::STOP);
    let ends = wait_for(RECOVERY_LIMIT, || (!is_energized(&station)).then_some(()));
    assert!(ends.is_some(), "who hangs has its finger on the current\n{}", station.said());
    station.signal_if_alive(rendering, Signal::KILL);
    station.wait_until_gone(rendering);
    assert_let_go(&display, &station, "its process died");

    let window = hold_space(&display, &station);
    assert!(display.xdotool(&["windowclose", &window]).is_some());
    assert_let_go(&display, &station, "it was closed");
    station.stop();
}

/// The example of a driver measures where its tip is, 45 mm deep, and nothing else: what there is besides the keys set, and the keys that move a scope move nothing.
#[test]
fn beside_a_driver_the_keys_of_the_window_set_what_its_device_lacks_also_in_the_window_of_a_successor() {
    let Some(display) = Display::start() else { return };
    let folder = Folder::new("beside");
    let (sources, driver) = (concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/driver"), folder.path("driver"));
    let mut command = Command::new("cc");
    command.args(["-std=c11", "-O2", "-pthread", "-I", sources, "-o", &driver, &format!("{sources}/example_driver.c"), "-lm"]);
    let (code, _, said) = run(&mut command);
    assert_eq!(code, Some(0), "cc: {said}");
    let station = Station::start_shown(&display.name, "beside", &["--driver", &driver]);
    display.window(&station);
    let controls = || station.sample().controls;
    display.press(&station, "t", "the light is not dimmed", || controls().light < 0.5);
    display.press(&station, "i", "the inflow is open", || controls().inflow_valve == 0.0);
    display.press(&station, "l", "the loop is in", || controls().loop_extension_m > 0.011);
    display.press(&station, "Home", "no higher pressure", || controls().set_pressure_pa > 9_333.0 + 600.0);
    assert!(display.xdotool(&["keydown", "Next", "sleep", "0.3", "keyup", "Next"]).is_some());
    station.run_ticks(300);
    // With the inflow shut the cavity closes about the scope, and its walls push the driver's hand by half a millimetre; those keys go some millimetres.
    let insertion_m = station.sample().pose.insertion_m;
    assert!((insertion_m - 0.045).abs() < 1.5e-3, "the scope is the driver's: {insertion_m} m");

    let set = controls();
    station.kill("rendering", true);
    display.window(&station);
    station.run_ticks(300);
    assert_eq!(controls(), set, "a successor's window sets it otherwise");
    display.press(&station, "i", "the inflow is shut", || controls().inflow_valve == 1.0);
    let ended = station.stop();
    assert_eq!(ended.number("invalid_applied"), 0.0, "{}", ended.report);
}
