//! Drivers of haptic devices: the C header says what the station's layouts are; a driver in C in the place of the simulated device moves the scope, feels the
//! tissue, and may die, hang and say nonsense; `hystation conformance driver` lets good ones pass and names the flaw of each bad one.

use hyst_messages::controls::*;
use hyst_messages::page::{ProcessState, device, hardware, header, rendering, station};
use hyst_messages::{
    DeviceStatement, ForceCommand, HardwareSample, INTERFACE_VERSION, LAYOUT_VERSION, LedgerEntry, PointerRecord, Role, Slot,
    layout_hash,
};
use hyst_recording::Recording;
use rustix::process::Signal;
use serde_json::Value;
use station_tests::shown::not_shown;
use station_tests::{Folder, RECOVERY_LIMIT, Station, binaries, hystation, run, wait_for};
use std::mem::offset_of;
use std::path::{Path, PathBuf};
use std::process::Command;

#[path = "driver/cores.rs"]
mod cores;
#[path = "driver/over.rs"]
mod over;
#[path = "driver/plug.rs"]
mod plug;
#[path = "driver/pose.rs"]
mod pose;
#[path = "driver/stated.rs"]
mod stated;
#[path = "driver/window.rs"]
mod window;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/driver");
const BEGINS: &str = "/* layout begins */\n";
const ENDS: &str = "/* layout ends */";

/// Compiles a C program beside the header, with all warnings as errors.
fn compile(folder: &Folder, name: &str, source: &Path, flags: &[&str]) -> PathBuf {
    let program = folder.as_path().join(name);
    let mut command = Command::new("cc");
    command.args(["-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", "-pthread", "-I", FOLDER]).args(flags);
    let (code, _, said) = run(command.arg(source).arg("-o").arg(&program).arg("-lm"));
    assert_eq!(code, Some(0), "cc: {said}");
    program
}

fn example(folder: &Folder, flaw: u32) -> PathBuf {
    compile(folder, &format!("driver-{flaw}"), &Path::new(FOLDER).join("example_driver.c"), &[&format!("-DFLAW={flaw}")])
}

/// The lines of the header that say where things lie, as the layouts are.
fn layout() -> String {
    use hardware::{TOTALS, Total};
    let number = |name: &str, value: usize| format!("#define HYST_{name} {value}\n");
    let own = [
        ("MAGIC_WORD", header::MAGIC),
        ("PID", header::PID),
        ("HEARTBEAT_NS", header::HEARTBEAT_NS),
        ("TICK", header::TICK),
        ("STEPS", header::STEPS),
        ("VALUE_NS", header::VALUE_NS),
        ("INVALID", header::INVALID),
        ("REAL_TIME", header::REAL_TIME),
        ("DISTRUSTED", header::DISTRUSTED),
        ("LATCH", header::LATCH),
        ("LAST_WORDS", header::LAST_WORDS),
        ("LAST_WORDS_WORDS", header::LAST_WORDS_WORDS),
        ("STATE", header::STATE),
        ("SAMPLE", hardware::SAMPLE.word),
        ("LEDGER", hardware::LEDGER.word),
        ("LEDGER_ENTRIES", hardware::LEDGER.entries),
        ("TOTALS", TOTALS),
        ("TRACE_HASH", Total::TraceHash as usize),
        ("INVALID_APPLIED", Total::InvalidApplied as usize),
        ("STALE_APPLIED", Total::StaleApplied as usize),
        ("FORCE_STEP_MAX", Total::ForceStepMax as usize),
        ("TRIPS", Total::Trips as usize),
        ("STATEMENT", hardware::STATEMENT.word),
        ("HARDWARE_WORDS", hardware::WORDS),
        ("COMMAND", device::COMMAND.word),
        ("DEVICE_WORDS", device::WORDS),
        ("STATION_WORDS", station::WORDS),
        ("T0_NS", station::T0_NS),
        ("STOP", station::STOP),
        ("SLOT_INCARNATION", station::SLOT_INCARNATION),
        ("WORDS32", hyst_messages::page::WORDS32),
        ("DISTRUST_INVALID", device::Distrust::Invalid as usize),
        ("SAMPLE_BYTES", size_of::<HardwareSample>()),
        ("COMMAND_BYTES", size_of::<ForceCommand>()),
        ("STATEMENT_BYTES", size_of::<DeviceStatement>()),
        ("LEDGER_ENTRY_BYTES", size_of::<LedgerEntry>()),
        ("POINTER", rendering::POINTER.word),
        ("POINTER_BYTES", size_of::<PointerRecord>()),
        ("RENDERING_WORDS", rendering::WORDS),
        ("WINDOW_HEAD", WINDOW_HEAD as usize),
        ("WINDOW_LOOP", WINDOW_LOOP as usize),
        ("WINDOW_CURRENT", WINDOW_CURRENT as usize),
        ("WINDOW_INFLOW", WINDOW_INFLOW as usize),
        ("WINDOW_OUTFLOW", WINDOW_OUTFLOW as usize),
        ("WINDOW_PRESSURE", WINDOW_PRESSURE as usize),
        ("WINDOW_LIGHT", WINDOW_LIGHT as usize),
        ("WINDOW_FOCUS", WINDOW_FOCUS as usize),
        ("WINDOW_COAGULATION", WINDOW_COAGULATION as usize),
    ];
    let mut text = format!(
        "#define HYST_LAYOUT_VERSION {LAYOUT_VERSION}u\n#define HYST_LAYOUT_HASH 0x{:016x}u\n#define HYST_INTERFACE_VERSION {INTERFACE_VERSION}u\n",
        layout_hash()
    );
    text.extend(own.map(|(name, value)| number(name, value)));
    for (name, role) in [("HARDWARE_SLOT", Role::Hardware), ("DEVICE_SLOT", Role::Device), ("RENDERING_SLOT", Role::Rendering)] {
        text.push_str(&format!("#define HYST_{name} {}u\n", Slot::first(role).number()));
    }
    text
}

#[test]
fn the_header_says_where_things_lie_in_the_stations_pages() {
    let path = Path::new(FOLDER).join("hystation_driver.h");
    let text = std::fs::read_to_string(&path).expect("the header");
    let (front, rest) = text.split_once(BEGINS).expect("where the layout begins");
    let (found, back) = rest.split_once(ENDS).expect("where it ends");
    if std::env::var("HYSTATION_HEADER").is_ok_and(|word| word == "write") {
        std::fs::write(&path, format!("{front}{BEGINS}{}{ENDS}{back}", layout())).expect("the header can be written");
    } else {
        assert_eq!(found, layout(), "HYSTATION_HEADER=write writes these lines anew; LAYOUT_VERSION must have been raised");
    }
    let [warming, live, stopping, failed] =
        [ProcessState::Warming, ProcessState::Live, ProcessState::Stopping, ProcessState::Failed].map(|state| state as u32);
    assert_eq!([warming, live, stopping, failed], [1, 3, 4, 5], "the header says so");
}

/// Each field of what C and Rust share, with its place in Rust.
fn fields() -> Vec<(&'static str, usize)> {
    macro_rules! places {
        ($kind:ty, $c:literal: $($field:ident)*) => { vec![$((concat!($c, ", ", stringify!($field)), offset_of!($kind, $field))),*] };
    }
    let mut all = places!(HardwareSample, "hyst_sample": hardware_tick time_ns pose velocity_m_s force_n controls from_window);
    all.extend(
        places!(hyst_messages::Pose, "hyst_pose": position_m pitch_rad orientation yaw_rad roll_rad insertion_m camera_roll_rad),
    );
    all.extend(places!(hyst_messages::Controls, "hyst_controls": buttons inflow_valve outflow_valve set_pressure_pa light loop_extension_m focus_m));
    all.extend(places!(PointerRecord, "hyst_pointer": sequence target controls));
    all.extend(places!(ForceCommand, "hyst_command": tick force_tick force_n kind source_incarnation device_incarnation));
    all.extend(places!(DeviceStatement, "hyst_statement": version measured_dof driven_dof rate_hz continuous_force_n resolution_m device_damping_n_s_m pitch_rad yaw_rad roll_rad
        insertion_m maker name));
    let limits = offset_of!(DeviceStatement, limits);
    all.extend(
        places!(hyst_messages::DeviceLimits, "hyst_statement": max_force_n max_stiffness_n_m max_damping_n_s_m)
            .into_iter()
            .map(|(name, at)| (name, limits + at)),
    );
    all.extend(
        places!(LedgerEntry, "hyst_ledger_entry": hardware_tick time_ns station_tick force_tick force_n kind source_incarnation),
    );
    all
}

#[test]
fn the_headers_records_lie_in_memory_as_the_stations_do() {
    let folder = Folder::new("driver-layout");
    let fields = fields();
    let prints: String = fields.iter().map(|(name, _)| format!("    printf(\"%zu\\n\", offsetof({name}));\n")).collect();
    let check = "    uint64_t record[3] = {1, 2, 3};\n    printf(\"%llu\\n\", (unsigned long long)hyst_hash(8, record, 3));\n";
    let source = format!(
        "#define _GNU_SOURCE\n#include \"hystation_driver.h\"\n#include <stddef.h>\nint main(void) {{\n{prints}{check}    return 0;\n}}\n"
    );
    let program = compile(&folder, "places", Path::new(&folder.write("places.c", &source)), &[]);
    let (code, said, _) = run(&mut Command::new(program));
    let numbers: Vec<u64> = said.lines().filter_map(|line| line.parse().ok()).collect();
    assert_eq!((code, numbers.len()), (Some(0), fields.len() + 1), "{said}");
    for ((name, at), found) in fields.iter().zip(&numbers) {
        assert_eq!(*found as usize, *at, "{name}");
    }
    assert_eq!(numbers.last(), Some(&hyst_messages::fnv_words(8, [1, 2, 3])), "the checksum");
}

/// Exit code, the checks that failed as `what: why`, and all that was said.
fn tried(driver: &Path) -> (Option<i32>, Vec<String>, String) {
    let (code, text, said) = run(hystation().args(["conformance", "driver", "--json"]).arg(driver));
    let told: Value = serde_json::from_str(&text).unwrap_or(Value::Null);
    let bad = told["checks"].as_array().into_iter().flatten().filter(|check| check["good"] == false);
    let line = |check: &Value| format!("{}: {}", check["what"].as_str().unwrap_or(""), check["why"].as_str().unwrap_or(""));
    (code, bad.map(line).collect(), format!("{told:#}\n{said}"))
}

#[test]
fn a_good_driver_conforms_and_of_each_bad_one_its_flaw_is_said() {
    let folder = Folder::new("driver-conformance");
    let flaws = [
        (1, "states what it can do: max_force_n is NaN"),
        (2, "  that can be: sample"),
        (3, "gives samples at its rate: "), // 500 Hz, or what a busy machine leaves of them, in place of 1000
        (4, "  stamped when they were taken: "),
        (5, "makes the force it is told: told to make"),
        (6, "makes the force it is told: told to make"),
        (7, "lets go when nobody commands: 60 ms after the last command it still makes"),
        (8, "follows the next device engine: told to make"),
        (9, "stops when it is told: it does not end within 2 s"),
        (10, "  that can be: sample"),
        (11, "  that can be: sample"),
        (12, "states what it can do: its statement has not come within 25 s"),
        (13, "  that can be: sample"),
        (14, "moves the way it is pushed: pushed along "),
        (15, "moves the way it is pushed: pushed along "),
        (16, "says how fast it goes: along "),
        (17, "follows the next device engine: of a command that was 100 ms old"),
    ];
    // With a library that has a servo loop of its own the driver's loop runs in a thread beside `main`; and a device may be faster than the servos.
    let source = Path::new(FOLDER).join("example_driver.c");
    let [in_a_callback, fast] = [("callback", "-DCALLBACK=1"), ("fast", "-DRATE_HZ=2000")]
        .map(|(name, flag)| compile(&folder, &format!("driver-{name}"), &source, &[flag]));
    let good = [binaries().join("hardware"), example(&folder, 0), in_a_callback, fast];
    for driver in &good {
        match tried(driver) {
            (Some(3), ..) => not_shown(&format!("whether {} conforms: the machine was too busy", driver.display())),
            (code, bad, told) => assert_eq!((code, bad), (Some(0), vec![]), "{}: {told}", driver.display()),
        }
    }
    for (flaw, expected) in flaws {
        let (code, bad, told) = tried(&example(&folder, flaw));
        if code == Some(3) {
            not_shown(&format!("whether flaw {flaw} is found: the machine was too busy"));
            continue;
        }
        assert_eq!(code, Some(1), "flaw {flaw}: {told}");
        assert!(bad.iter().any(|line| line.starts_with(expected)), "flaw {flaw}: {bad:#?}\n{told}");
    }
    let left: Vec<PathBuf> = std::fs::read_dir("/dev/shm").expect("a folder").flatten().map(|entry| entry.path()).collect();
    let own = format!("-driver-{}", std::process::id());
    assert!(!left.iter().any(|path| path.to_string_lossy().ends_with(&own)), "{left:?}");
}

/// The newest statement and the largest force of the ticks so far, of the station's hardware.
fn most_n(station: &Station, ticks: u64) -> f64 {
    let end = station.status()["tick"].as_u64().unwrap_or(0) + ticks;
    let mut most_n = 0.0f64;
    let over = wait_for(RECOVERY_LIMIT, || {
        most_n = most_n.max(station.force_n());
        (station.status()["tick"].as_u64()? >= end).then_some(())
    });
    assert!(over.is_some(), "the station's clock stands still");
    most_n
}

#[test]
fn a_driver_in_c_moves_the_scope_feels_the_tissue_dies_hangs_and_is_there_again() {
    let folder = Folder::new("driver-station");
    let driver = example(&folder, 0);
    let station = Station::start("driver", &["--driver", &driver.to_string_lossy()]);
    let most = most_n(&station, 4_000);
    assert!(
        (0.2..=2.0).contains(&most),
        "the hand goes into the wall and feels it, no more than is stated: {most} N\n{}",
        station.said()
    );
    let depth = |station: &Station| station.sample().pose.pitch_rad;
    let before = depth(&station);
    assert!(wait_for(RECOVERY_LIMIT, || (depth(&station) - before).abs().gt(&0.02).then_some(())).is_some(), "the scope moves");

    // It dies: another life of it is there, by the same file, and the force comes back.
    let pid = station.pid("hardware", true);
    station.signal(pid, Signal::KILL);
    station.wait_until_gone(pid);
    station.recover();
    let most = most_n(&station, 4_500);
    assert!((0.2..=2.0).contains(&most), "after its death: {most} N\n{}", station.said());

    // It hangs: it is not killed, since it stands for what is on the desk, and the station goes on when it does.
    let pid = station.pid("hardware", true);
    let applied = || {
        let newest = newest_command(&station);
        newest.force_n.iter().map(|c| f64::from(*c).powi(2)).sum::<f64>().sqrt()
    };
    assert!(wait_for(RECOVERY_LIMIT, || (applied() > 0.2).then_some(())).is_some(), "no force\n{}", station.said());
    station.signal(pid, Signal::STOP);
    let gone = wait_for(RECOVERY_LIMIT, || (applied() == 0.0).then_some(()));
    assert!(gone.is_some(), "a hand that nobody knows of is still told to be pushed by {} N", applied());
    let told = wait_for(RECOVERY_LIMIT, || station.said().contains("it is not killed").then_some(()));
    assert!(told.is_some(), "nobody says that it hangs: {}", station.said());
    assert_eq!(applied(), 0.0);
    station.signal(pid, Signal::CONT);
    let back = wait_for(RECOVERY_LIMIT, || (applied() > 0.2).then_some(()));
    assert!(back.is_some() && station.has_process(pid), "it goes on\n{}", station.said());
    let ended = station.stop();
    assert!(ended.said.lines().any(|line| line.contains("hardware") && line.contains("died")), "{}", ended.said);
    assert_eq!(ended.number("invalid_applied"), 0.0, "{}", ended.report);
    assert!(ended.number("device.ticks") > 5_000.0 && ended.number("device.fresh") > 4_000.0, "{}", ended.report["device"]);
}

/// The wall pushes the example without a flaw back with more than the 0.4 N that this one states.
#[test]
fn a_weaker_device_is_never_asked_for_more_than_it_states_and_a_replay_makes_the_same_forces() {
    let folder = Folder::new("driver-weak");
    let driver = compile(&folder, "weak", &Path::new(FOLDER).join("example_driver.c"), &["-DFORCE_N=0.4f"]);
    let (name, file) = (format!("driver-weak-{}", std::process::id()), folder.path("session.mcap"));
    let words = ["--name", &name, "run", "--headless", "--quiet", "--for", "6s", "--record", &file, "--driver"];
    let (code, out, said) = run(hystation().args(words).arg(driver));
    assert!(matches!(code, Some(0 | 3)), "{code:?} {out}{said}");
    let recording = Recording::read(Path::new(&file)).expect("the recording");
    let force_n = |force_n: [f32; 3]| force_n.iter().map(|c| f64::from(*c).powi(2)).sum::<f64>().sqrt();
    let most_n = recording.applied().iter().map(|record| force_n(record.command.force_n)).fold(0.0, f64::max);
    assert!((0.38..=0.4001).contains(&most_n), "{most_n} N");
    let (code, out, said) = run(hystation().args(["--name", &name, "replay", &file, "--verify"]));
    assert!(code == Some(0) && format!("{out}{said}").contains("the same to the bit"), "{code:?} {out}{said}");
}

/// What the device engine has told the motors last.
fn newest_command(station: &Station) -> ForceCommand {
    let place = hyst_exchange::Station::named(station.name()).expect("a name");
    let slot = Slot::first(Role::Device);
    let incarnation = place.open().expect("the station's page").incarnation(slot);
    let page = place.read_slot(slot, incarnation).expect("the device's page");
    page.cell(device::COMMAND).map(|(_, command)| command).unwrap_or_default()
}

#[test]
fn what_a_driver_says_that_cannot_be_is_not_used_and_the_operator_is_told() {
    let folder = Folder::new("driver-nonsense");
    // One that states so little damping that the coupling is to be no stiffer than (0.6 − 0.3) N·s/m / 1.5 ms, and one of ample damping.
    for (flaw, what, damping, most_n_m) in [(10, "no number", "0.6f", 181.82), (11, "a jump", "13.4f", 800.0)] {
        let flags = [format!("-DFLAW={flaw}"), format!("-DDAMPING_N_S_M={damping}")];
        let source = Path::new(FOLDER).join("example_driver.c");
        let driver = compile(&folder, &format!("driver-{flaw}"), &source, &flags.each_ref().map(String::as_str));
        let station = Station::start(&format!("driver-{flaw}"), &["--driver", &driver.to_string_lossy()]);
        let most = most_n(&station, 4_500);
        assert!((0.2..=2.0).contains(&most), "{what}: the hand is felt all the same: {most} N\n{}", station.said());
        let input = {
            let place = hyst_exchange::Station::named(station.name()).expect("a name");
            let slot = Slot::first(Role::Device);
            let page = place.read_slot(slot, place.open().expect("its page").incarnation(slot)).expect("the device's page");
            let end = page.ring_end(device::INPUTS);
            (end.saturating_sub(60)..end).filter_map(|tick| page.ring(device::INPUTS, tick)).collect::<Vec<_>>()
        };
        // In its hand the tip is at 45 mm, and the wall pushes it by some: the jump is to 80 mm.
        let is_sound =
            |sample: &HardwareSample| (0.03..0.06).contains(&sample.pose.insertion_m) && sample.pose.position_m[1].is_finite();
        assert!(input.len() > 30 && input.iter().all(|input| is_sound(&input.sample)), "{what}");
        assert!(input.iter().all(|input| input.limits.max_force_n == 2.0), "the servos know what the device can do");
        let is_carried = |stiffness_n_m: f32| (stiffness_n_m - most_n_m).abs() < 0.1;
        assert!(input.iter().all(|input| is_carried(input.limits.max_stiffness_n_m)), "{what}: {:?}", input[0].limits);
        let ended = station.stop();
        assert!(ended.said.contains("hardware is distrusted by device"), "{what}: {}", ended.said);
        assert_eq!(ended.said.matches("is distrusted by device").count(), 1, "once: {}", ended.said);
    }
}

#[test]
fn a_driver_that_is_none_or_states_what_cannot_be_is_refused_in_one_clear_line() {
    let folder = Folder::new("driver-refused");
    let script = folder.write("script", "#!/bin/sh\n");
    let name = format!("driver-refused-{}", std::process::id());
    let started = |words: &[&str]| run(hystation().args(["--name", &name, "run", "--headless", "--quiet"]).args(words));
    let good = example(&folder, 0).to_string_lossy().into_owned();
    let device = binaries().join("device").to_string_lossy().into_owned();
    let cases: [(&[&str], &str); 5] = [
        (&["--driver", "/bin/true"], "docs/driver.md"),
        (&["--driver", &script], "chmod +x"),
        (&["--driver", &device], "is a device, not a hardware"),
        (&["--driver", &good, "--lockstep"], "virtual clock"),
        (&["--driver", "/absent"], "No such file"),
    ];
    for (words, why) in cases {
        let (code, _, said) = started(words);
        assert!(code == Some(2) && said.contains(why) && said.lines().count() == 1, "{words:?}: {code:?} {said}");
    }
    let (code, _, said) = started(&["--driver", &good, "--hand", "idle"]);
    assert!(code == Some(2) && said.contains("--hand"), "{code:?} {said}");
    let (code, out, said) = started(&["--driver", &example(&folder, 1).to_string_lossy(), "--for", "60s"]);
    let told = format!("{out}{said}");
    assert!(code == Some(2) && told.contains("max_force_n is NaN; it must be 0.1 to 100"), "{code:?} {told}");
    let (code, out, said) = run(hystation().args(["conformance", "driver", &script]));
    assert!(code == Some(2) && out.is_empty() && said.lines().count() == 1, "{code:?} {said}");
}
