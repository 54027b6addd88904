//! A recorded session is done again to the bit: one in lock-step, one in real time while engines died, lied and something was cut, and again while
//! engines die and lie in the replay itself. And what cannot be replayed is refused, or done as far as it goes.

use hyst_messages::Role;
use serde_json::Value;
use station_tests::shown::not_shown;
use station_tests::{Folder, hystation, run};
use std::ops::Range;
use std::path::Path;
use std::time::{Duration, Instant};

#[path = "replay/refused.rs"]
mod refused;
#[path = "replay/servos.rs"]
mod servos;

const ROLES: &str = "hardware,device,haptic,tissue,fluid,collision-worker,recorder";

/// Records a session.
fn record(name: &str, file: &str, arguments: &[&str]) -> String {
    let station = format!("w{}-{name}", std::process::id());
    let mut command = hystation();
    command.args(["--name", &station, "run", "--headless", "--roles", ROLES, "--record", file]).args(arguments);
    let (code, _, said) = run(&mut command);
    // What its faults cost the hand in real time is another matter: a machine that is busy may let no device come back in 20 ms.
    let is_hurt = arguments.contains(&"--faults") && code == Some(1) && said.contains("a promise was broken: ");
    assert!(code == Some(0) || is_hurt, "{name}: {code:?} {said}");
    said
}

/// Exit code, verdict and messages of `replay --verify`.
fn verify(name: &str, file: &str, arguments: &[&str]) -> (Option<i32>, String, String) {
    let station = format!("v{}-{name}", std::process::id());
    run(hystation().args(["--name", &station, "replay", file, "--verify"]).args(arguments))
}

/// How many forces and states were the same.
fn same(said: &str) -> (u64, u64) {
    let line = said.lines().find(|line| line.starts_with("the same to the bit")).unwrap_or_else(|| panic!("{said}"));
    let numbers: Vec<u64> = line.split(|c: char| !c.is_ascii_digit()).filter_map(|word| word.parse().ok()).collect();
    (numbers[0], numbers[1])
}

fn faults(folder: &Folder, faults: &[(u64, &str, &str)]) -> String {
    let path = folder.path("faults.toml");
    let tables = faults.iter().map(|(tick, kind, target)| {
        let forth = match *kind {
            "stop" => "for = 0.3\n",
            "block" => "for = 0.005\n",
            _ => "",
        };
        format!("[[fault]]\nkind = \"{kind}\"\ntarget = \"{target}\"\ntick = {tick}\n{forth}")
    });
    std::fs::write(&path, format!("seed = 1\n{}", tables.collect::<String>())).unwrap();
    path
}

#[test]
fn a_session_in_lock_step_is_done_again_also_while_engines_die_in_the_replay() {
    let folder = Folder::new("replay-locked");
    let file = folder.path("session.mcap");
    // Its scene is in the recording: what was named is gone when it is done again.
    let scene = folder.scene();
    record("locked", &file, &["--lockstep", "--for", "2500ms", &scene]);
    std::fs::remove_file(&scene).unwrap();
    let (code, said, complained) = verify("locked", &file, &[]);
    assert_eq!(code, Some(0), "{said}{complained}");
    assert_eq!(same(&said), (2_500, 2_500), "{said}");
    assert!(said.contains("figures of the pump"), "{said}");

    let kills = [(1_300, "tissue:active"), (1_500, "haptic:active"), (1_800, "collision-worker:0"), (2_000, "fluid:active")];
    let kills = kills.map(|(tick, target)| (tick, "kill", target));
    let hurt = faults(&folder, &[&kills[..], &[(2_200, "nan", "haptic:active")]].concat());
    let (code, said, complained) = verify("hurt", &file, &["--test-mode", "--faults", &hurt, "--workers", "1"]);
    assert_eq!((code, same(&said)), (Some(0), (2_500, 2_500)), "{said}{complained}");

    // Its force was another: found at that tick.
    let lie = folder.path("lie.mcap");
    change_one_force(&file, &lie, 2_000, None);
    let (code, said, complained) = verify("lie", &lie, &[]);
    assert_eq!(code, Some(1), "{said}{complained}");
    assert!(said.contains("tick 2000: force") && !said.contains("recorded by build"), "{said}");
    // By other programs: whoever reads that it differs is told that these do.
    std::fs::remove_file(&lie).unwrap();
    change_one_force(&file, &lie, 2_000, Some("another"));
    let (code, said, complained) = verify("other", &lie, &[]);
    assert!(code == Some(1) && said.contains("recorded by build 0.1.0 another, this is 0.1.0 "), "{code:?} {said}{complained}");

    // Half of it is done again as far as it goes, and that is said: with 0 whoever asked took it for all of the session.
    let bytes = std::fs::read(&file).unwrap();
    let cut = folder.path("cut.mcap");
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let (code, said, complained) = verify("cut", &cut, &[]);
    let (forces, _) = same(&said);
    // How many ticks lie in half of the bytes follows from how far the recorder was behind when it wrote its blocks.
    assert!(code == Some(3) && (1..2_500).contains(&forces), "{code:?} {said}{complained}");
    let of_cut = |said: &str| said.lines().find(|line| line.contains("is not whole: it was cut at byte")).map(str::to_string);
    let shown = |name: &str, file: &str| {
        let station = format!("v{}-{name}", std::process::id());
        let mut command = hystation();
        run(command.args(["--name", &station, "replay", file, "--headless", "--speed", "1", "--workers", "1"]))
    };
    let (code, _, told) = shown("half", &cut);
    assert!(code == Some(3) && of_cut(&told).is_some(), "{code:?} {told}");
    assert_eq!(of_cut(&told), of_cut(&complained), "shown and verified it ends at the same tick");
    let mut damaged = bytes;
    let block = block_in_the_middle(&damaged);
    damaged[block].fill(0x55);
    std::fs::write(&cut, damaged).unwrap();
    let (code, said, complained) = verify("damaged", &cut, &[]);
    assert!(code == Some(3) && complained.contains("was not done again"), "{code:?} {said}{complained}");

    // Shown, it begins without having been read, and what is damaged is met ahead of what is shown: the same is said of it.
    let of = |said: &str| said.lines().find(|line| line.contains("was not done again")).map(str::to_string);
    let (code, _, told) = shown("met", &cut);
    assert_eq!((code, of(&told)), (Some(3), of(&complained)), "{told}");
    let (code, _, told) = shown("whole", &file);
    assert_eq!((code, of(&told)), (Some(0), None), "{told}");
}

/// Where the content of the block lies that the file's middle is in, or of the next.
fn block_in_the_middle(bytes: &[u8]) -> Range<usize> {
    // MCAP: eight bytes of magic, then records of an opcode, a length and so many bytes.
    const CHUNK: u8 = 6;
    let mut at = 8;
    loop {
        let content = at + 9..at + 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        if bytes[at] == CHUNK && content.end > bytes.len() / 2 {
            return content;
        }
        at = content.end;
    }
}

/// A copy of a recording in which the force of one tick is another.
fn change_one_force(from: &str, to: &str, tick: u64, build: Option<&str>) {
    let mut reader = hyst_recording::Reader::open(Path::new(from)).unwrap();
    let mut session = reader.session().clone();
    session.extend(build.map(|build| ("build".to_string(), build.to_string())));
    let mut writer = hyst_recording::Writer::open(Path::new(to), &session).unwrap();
    while let Some(mut block) = reader.next_block().unwrap() {
        for record in block.applied.iter_mut().filter(|record| record.tick == tick) {
            record.command.force_n[0] += 1e-6;
        }
        writer.append(&block).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn a_session_in_real_time_with_faults_and_cuts_is_done_again_to_the_bit() {
    let folder = Folder::new("replay-real");
    let [file, report] = ["session.mcap", "report.json"].map(|name| folder.path(name));
    let hurt = [
        (3_000, "kill", "tissue:active"),
        (4_500, "kill", "haptic:active"),
        // Held up in the middle of a tick, it takes the contact model of a later state in it.
        (5_000, "block", "device"),
        (5_500, "block", "device"),
        (6_000, "stop", "tissue:active"),
        (7_000, "kill", "device"),
        // It lies, and the other's force is taken.
        (8_000, "nan", "haptic:active"),
        (8_600, "kill", "fluid:active"),
    ];
    let hurt = faults(&folder, &hurt);
    let arguments = ["--for", "10s", "--hand", "script:polyp", "--test-mode", "--faults", &hurt, "--report", &report];
    let said = record("real", &file, &arguments);
    let report: Value = serde_json::from_str(&folder.read("report.json")).unwrap();
    assert!(report["cuts"].as_u64() > Some(0), "nothing was cut: {said}");
    let (code, said, complained) = verify("real", &file, &[]);
    // 3: this machine did not let the device of the replay run.
    assert!(matches!(code, Some(0 | 3)), "{code:?} {said}{complained}");
    let (forces, states) = same(&said);
    assert!(forces > 5_000 && states > 1_000, "{said}");
}

#[test]
fn a_session_is_shown_from_the_checkpoint_before_the_time_that_was_asked_for() {
    let folder = Folder::new("replay-from");
    let [file, was] = ["session.mcap", "was.json"].map(|name| folder.path(name));
    record("from", &file, &["--lockstep", "--for", "12s", "--hand", "script:polyp", "--report", &was]);
    assert_shown_from(&folder, "f", 11, 10.0, [0.1, 0.2, 0.2]);
    assert_shown_slowly(&folder, &file);
}

/// A trainer shows what was in real time. Its pump had moments that nobody wrote down, and the steps of its tissue the lengths that the machine left them.
#[test]
fn a_session_in_real_time_is_shown_from_a_checkpoint_too() {
    let folder = Folder::new("replay-timed");
    let [file, was] = ["session.mcap", "was.json"].map(|name| folder.path(name));
    record("timed", &file, &["--for", "11s", "--hand", "script:polyp", "--report", &was]);
    assert_shown_from(&folder, "t", 10, 0.0, [0.3, 0.4, 0.4]);
}

/// The landmarks were looked at, and the first places visited, before what is shown: nobody does so again. A console that begins to judge there has goals that
/// stay open, and a session that never ends.
#[test]
fn a_case_that_is_shown_from_a_time_on_is_judged_by_all_of_what_was_done_before_it() {
    let folder = Folder::new("replay-judged");
    let file = folder.path("session.mcap");
    let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/cases/navigation.toml").display().to_string();
    record("judged", &file, &[&case, "--lockstep", "--for", "25s", "--hand", "script:visits", "--set", "spares=off"]);
    let (code, report, said) = run(hystation().args(["report", &file, "--json", "-"]));
    assert_eq!(code, Some(0), "{said}");
    let report: Value = serde_json::from_str(&report).unwrap();
    let lasted_s = report["case"]["ended"]["after_s"].as_f64().unwrap_or_else(|| panic!("it does not end: {}", report["case"]));
    let kept = hyst_recording::Reader::open(Path::new(&file)).unwrap().judged(16_000).unwrap();
    let tick = kept.expect("nothing is kept of what was judged").tick;
    assert!((10_000..=16_000).contains(&tick), "a referee's {tick}: there is one every five seconds");
    let station = format!("j{}", std::process::id());
    let mut command = hystation();
    command.args(["--name", &station, "replay", &file, "--from", "16s", "--headless", "--set", "console_port=0"]);
    let (code, _, said) = run(&mut command);
    let over = format!("the session is over after {lasted_s:.1} s: all goals were reached; 2 of 2 goals reached");
    assert!(code == Some(0) && said.contains(&over), "not {over:?}: {code:?} {said}");
}

/// Shows the end of the session in a folder from a time on, and compares what came of it with what its report says: cuts, of which there are more than some, what
/// is removed, and what the patient kept of the medium.
fn assert_shown_from(folder: &Folder, name: &str, from_s: u64, few_cuts: f64, bounds: [f64; 3]) {
    let [file, is] = ["session.mcap", "is.json"].map(|name| folder.path(name));
    let kept = hyst_recording::checkpoints(Path::new(&file), from_s * 1_000).unwrap();
    let begin_tick = kept.iter().find(|kept| kept.role == Role::Tissue).unwrap().tick;
    assert!((3_000..=from_s * 1_000).contains(&begin_tick), "{begin_tick}");
    let (station, from) = (format!("{name}{}", std::process::id()), format!("{from_s}s"));
    let mut command = hystation();
    command.args(["--name", &station, "replay", &file, "--from", &from, "--speed", "20"]);
    let (code, _, said) = run(command.args(["--headless", "--report", &is]));
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains(&format!("begins at the checkpoint of {:.3} s", begin_tick as f64 * 1e-3)), "{said}");
    assert!(said.contains("times the recorded speed, not at 20: "), "no machine computes so fast: {said}");
    let [was, is]: [Value; 2] = ["was.json", "is.json"].map(|name| serde_json::from_str(&folder.read(name)).unwrap());
    let of = |report: &Value, key: &str| report[key].as_f64().unwrap_or_else(|| panic!("{key}: {report}"));
    assert!(of(&was, "cuts") > few_cuts, "{said}");
    for (key, most) in ["cuts", "removed_volume_ml", "fluid_deficit_ml"].into_iter().zip(bounds) {
        let (was, is) = (of(&was, key), of(&is, key));
        assert!((is - was).abs() <= most * was.abs(), "{key}: {was} recorded, {is} now");
    }
}

/// The last two seconds at half the speed, with pictures where there is a driver.
fn assert_shown_slowly(folder: &Folder, file: &str) {
    let (pictures, began) = (folder.path("pictures"), Instant::now());
    let mut command = hystation();
    command.args(["--name", &format!("g{}", std::process::id()), "replay", file, "--from", "10s", "--speed", "0.5"]);
    let (code, _, said) = run(command.args(["--headless", "--pictures", &pictures, "--set", "picture_every_s=0.2"]));
    assert_eq!(code, Some(0), "{said}");
    assert!(began.elapsed() >= Duration::from_millis(3_800), "two seconds took {:?}", began.elapsed());
    if std::env::var_os("HYSTATION_NO_GPU").is_some() {
        return not_shown("pictures of a replay: there is no Vulkan driver");
    }
    let files = std::fs::read_dir(&pictures).unwrap().map(|entry| entry.unwrap().metadata().unwrap().len());
    assert!(files.filter(|bytes| *bytes > 10_000).count() >= 2, "no pictures of what was done again");
}

#[test]
fn a_recorded_hand_is_played_in_a_station_of_another_kind_and_what_is_no_recording_is_refused() {
    let folder = Folder::new("replay-hand");
    let [first, second, none] = ["first.mcap", "second.mcap", "none.mcap"].map(|name| folder.path(name));
    record("first", &first, &["--lockstep", "--for", "2s"]);
    record("second", &second, &["--lockstep", "--for", "2s", "--hand", &format!("replay:{first}")]);
    let poses = |file: &str| {
        let recording = hyst_recording::Recording::read(Path::new(file)).unwrap();
        recording.applied().iter().map(|record| record.sample.pose.position_m.map(f32::to_bits)).collect::<Vec<_>>()
    };
    let (was, is) = (poses(&first), poses(&second));
    // The hand rests for its first second, wherever it is.
    assert!(is[1_000..1_900] == was[..900], "another way");

    std::fs::write(&none, "not MCAP").unwrap();
    let missing = folder.path("missing.mcap");
    for (arguments, word) in [
        (vec!["replay", none.as_str()], "is not an MCAP file"),
        (vec!["replay", missing.as_str()], "missing.mcap"),
        (vec!["replay", first.as_str(), "--from", "1h"], "--from"),
        (vec!["replay", first.as_str(), "--speed", "0"], "between 0.01 and 100"),
        (vec!["replay", first.as_str(), "--verify", "--scene", "assets/scenes/myoma.toml"], "another scene"),
        (vec!["run", "--headless", "--hand", "replay:/nowhere.mcap"], "/nowhere.mcap"),
    ] {
        let station = format!("n{}", std::process::id());
        let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
        let (code, _, said) = run(hystation().current_dir(root).args(["--name", &station]).args(&arguments));
        assert!(code == Some(2) && said.contains(word), "{arguments:?}: {code:?} {said}");
    }
}
