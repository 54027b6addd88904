//! File systems without room: that of the recording, and /dev/shm. Each in a mount namespace of its own, so that nobody else's is full. What comes back costs
//! the recording nothing; what does not is said, while it lasts and at the end.

use hyst_messages::{Applied, AppliedRecord};
use serde_json::Value;
use station_tests::shown::{Promise, not_shown};
use station_tests::{Folder, binaries, hystation, run};
use std::collections::BTreeSet;
use std::ops::Range;
use std::process::Command;

/// How long a station runs: on a busy machine a file system may take seconds until it is full, and a process as long until it is back.
const SECONDS: u32 = 20;

/// Ticks that the host may take from a window of 2 s and not from its control, beyond what is void: one stall. A hand that waited for the file system would miss
/// hundreds.
const STALL_TICKS: u64 = 40;

/// Ticks of each window in which a disk stands still, and of its control after that.
const WINDOW_TICKS: u64 = 1_000;
/// Ticks between the two, in which what had to wait is written.
const SETTLE_TICKS: u64 = 1_000;
/// Windows that it takes to judge.
const LEAST_WINDOWS: usize = 4;
/// Ticks of a window that the hand may miss beyond those of its control, in the mean: one that waited for the disk would miss all of them.
const ALLOWED_TICKS: f64 = 10.0;

/// Runs a station in a namespace with a small file system at a place; gives its report and what it said. `None` where this user may not.
fn run_on_small(name: &str, folder: &Folder, mount: &str, record: &str, faults: &str) -> Option<(Value, String)> {
    let faults = folder.write("faults.toml", faults);
    let (_, report, said) = run_in(name, folder, mount, record, &format!("--test-mode --faults {faults}"))?;
    Some((report, said))
}

/// The same with some options, and its exit code before the rest.
fn run_in(name: &str, folder: &Folder, mount: &str, record: &str, options: &str) -> Option<(i32, Value, String)> {
    let (code, _, said) = run(Command::new("unshare").args(["-m", "true"]));
    assert!(code == Some(0) || !rustix::process::geteuid().is_root(), "root may not unshare: {said}");
    if code != Some(0) {
        eprintln!("NOT TRIED: full file systems need the right to make a mount namespace ({})", said.trim());
        return None;
    }
    let report = folder.path("report.json");
    let script = format!(
        "{mount} && \"{}\" --name {name}-{} run --headless --for {SECONDS}s --hand script:press {options} --record {record} \
         --report {report}; code=$?; cp {record} {} 2>/dev/null; ls $(dirname {record}) >&2; exit $code",
        binaries().join("hystation").display(),
        std::process::id(),
        folder.path("copy.mcap"),
    );
    let (code, _, said) = run(Command::new("unshare").args(["-m", "sh", "-c", &script]));
    let code = code.filter(|code| matches!(code, 0 | 1 | 3)).unwrap_or_else(|| panic!("{code:?}: {said}"));
    let report = serde_json::from_str(&folder.read("report.json")).unwrap_or_else(|error| panic!("{error}\n{said}"));
    Some((code, report, said))
}

/// The one fault of a kind: it came about, and was over when its time was.
fn assert_over<'a>(report: &'a Value, kind: &str, said: &str) -> &'a Value {
    let faults = report["faults"].as_array().expect("faults");
    let of_kind: Vec<&Value> = faults.iter().filter(|fault| fault["kind"] == kind).collect();
    assert_eq!(of_kind.len(), 1, "{said}");
    let fault = of_kind[0];
    let missed = |window: &str| fault[window]["missed"].as_u64();
    println!("{kind}: missed {:?} and {:?} in the control", missed("window"), missed("control"));
    match missed("window").zip(missed("control")) {
        Some((window, control)) => assert!(window <= control + STALL_TICKS, "the hand noticed: {fault:#}\n{said}"),
        None => not_shown(&format!("what {kind} costs the hand: it has no control")),
    }
    assert!(fault["manifested"] == true && fault["recovered_us"].is_number(), "{fault:#}\n{said}");
    for key in ["invalid_applied", "stale_applied"] {
        assert_eq!(report[key], 0, "{key}\n{said}");
    }
    assert_eq!(report["leftovers"], serde_json::json!({ "processes": 0, "shared_memory": 0, "files": 0 }), "{said}");
    fault
}

#[test]
fn a_disk_that_is_full_for_two_seconds_costs_the_recording_nothing() {
    let folder = Folder::new("diskfull");
    let (small, mount) = small(&folder);
    let fault = "[[fault]]\nkind = \"disk-full\"\ntarget = \"recorder\"\ntick = 5000\nfor = 2.0\n";
    let Some((report, said)) = run_on_small("diskfull", &folder, &mount, &format!("{small}/session.mcap"), fault) else { return };
    let fault = assert_over(&report, "disk-full", &said);
    assert!(fault["detected_by"] == "recorder" && fault["detected_us"].is_number(), "{fault:#}\n{said}");
    assert!(!said.contains("ballast"), "it is gone: {said}");
    assert_eq!((&report["recording"]["lost"], report["recording"]["stands_still"].is_null()), (&0.into(), true), "{said}");
    let recording = hyst_recording::Recording::read(folder.as_path().join("copy.mcap").as_path()).expect("a recording");
    assert!(recording.content.lost.is_empty(), "{:?}", recording.content.lost);
    let room = &report["recording"];
    assert!(room["free_bytes"].as_u64().is_some_and(|bytes| bytes <= 64 << 20), "of its disk, and no other: {room}");
    assert!(room["lasts_s"].as_f64().is_some_and(|time_s| time_s < 3_600.0), "{room}");
    let log = recording.applied().len();
    assert!(log > 8_000, "{log} ticks");
}

/// A folder with a file system of its own, small and in memory: its path, and how it is mounted.
fn small(folder: &Folder) -> (String, String) {
    let small = folder.path("small");
    std::fs::create_dir(&small).expect("a folder to mount on");
    let mount = format!("mount -t tmpfs -o size=64m small {small}");
    (small, mount)
}

/// Writes what stays, until there is room for nothing.
fn fill(small: &str) -> String {
    format!("cat /dev/zero > {small}/other 2>/dev/null")
}

/// Ended with 0: a class went home, and nobody knew that what it did since the disk was full was nowhere.
#[test]
fn a_disk_that_stays_full_to_the_end_is_said_while_it_is_and_ends_with_lost_data_and_what_there_is_can_be_read() {
    let folder = Folder::new("diskstays");
    let (small, mount) = small(&folder);
    let (record, fill) = (format!("{small}/session.mcap"), fill(&small));
    // The table is asked for when the second in which the keeper looks is long over.
    let status = format!("\"{}\" --name diskstays-{} status >&2", binaries().join("hystation").display(), std::process::id());
    let later = format!("{mount} && {{ (sleep 10; {fill}; sleep 6; {status}) & }}");
    let Some((code, report, said)) = run_in("diskstays", &folder, &later, &record, "") else { return };
    let recording = &report["recording"];
    let number = |key: &str| recording[key].as_u64().unwrap_or_else(|| panic!("{key}: {recording}\n{said}"));
    println!("{recording:#}");
    assert!(code == 3 && number("lost") > 1_000 && number("ticks") > 1_000, "{code}: {recording}\n{said}");
    assert!(said.contains(&format!("the recording stands still: recording {record}: no room for")), "{said}");
    assert!(said.contains("THE RECORDING STANDS STILL, ") && !said.contains("the recording goes on"), "{said}");
    let lost = format!("{} ticks are lost", number("lost"));
    let is_end = |line: &str| line.contains(&format!("the recording {record} is not whole (no room for")) && line.contains(&lost);
    assert!(said.lines().any(is_end), "{said}");
    let copy = folder.path("copy.mcap");
    let (code, told, complained) = run(hystation().args(["report", &copy]));
    assert!(code == Some(3) && !told.is_empty() && complained.contains("not everything is there"), "{code:?} {told}{complained}");
    let read = hyst_recording::Recording::read(folder.as_path().join("copy.mcap").as_path()).expect("a recording");
    let continuity = hyst_recording::Continuity::of(&read.content);
    assert!(read.damage.is_empty(), "{:?}", read.damage);
    assert_eq!((continuity.ticks, continuity.repeated, continuity.missing()), (number("ticks"), 0, 0), "{said}");
}

/// Ended with 0 and an empty file.
#[test]
fn a_disk_that_is_full_from_the_start_to_the_end_ends_with_lost_data_and_the_words_that_nothing_was_recorded() {
    let folder = Folder::new("diskempty");
    let (small, mount) = small(&folder);
    let record = format!("{small}/session.mcap");
    let full = format!("{mount} && {{ {} || true; }}", fill(&small));
    let Some((code, report, said)) = run_in("diskempty", &folder, &full, &record, "") else { return };
    let recording = &report["recording"];
    assert!(code == 3 && recording["ticks"] == 0 && recording["lost"].as_u64() > Some(5_000), "{code}: {recording}\n{said}");
    assert!(said.contains("the recording stands still: "), "{said}");
    assert!(said.contains(&format!("the recording {record} holds no tick (no room for")), "{said}");
}

/// Was recorded from where there was room, as if nothing had been before.
#[test]
fn what_was_made_while_a_disk_was_full_at_the_start_is_named_as_lost_when_there_is_room() {
    let folder = Folder::new("disklate");
    let (small, mount) = small(&folder);
    let record = format!("{small}/session.mcap");
    let full = format!("{mount} && {{ {} || true; }} && {{ (sleep 13; rm {small}/other) & }}", fill(&small));
    let Some((code, report, said)) = run_in("disklate", &folder, &full, &record, "") else { return };
    let read = hyst_recording::Recording::read(folder.as_path().join("copy.mcap").as_path()).expect("a recording");
    let continuity = hyst_recording::Continuity::of(&read.content);
    let lost = report["recording"]["lost"].as_u64();
    if lost == Some(0) {
        return not_shown("what a disk that is full at the start costs: the device had made too few ticks");
    }
    assert!(code == 3 && said.contains(" ticks are lost; `hystation report`"), "{code}: {said}");
    assert_eq!((lost, continuity.missing()), (Some(continuity.lost()), 0), "the file names what is lost\n{said}");
    let first = said.find("the recording stands still").unwrap_or_else(|| panic!("{said}"));
    assert!(said[first..].contains("the recording goes on, "), "{said}");
}

/// The tick of a station's status that was said behind a word.
fn tick_behind(word: &str, said: &str) -> Option<u64> {
    let status = said.lines().find_map(|line| line.trim().strip_prefix(word))?;
    serde_json::from_str::<Value>(status).ok()?["tick"].as_u64()
}

/// What the hand missed in each window of these ticks, less what it missed in as long a window after them: ticks that have no fresh force, or no force.
fn excesses(applied: &[AppliedRecord], stood: Range<u64>) -> Vec<f64> {
    let fresh = applied.iter().filter(|record| record.command.kind == Applied::Fresh as u32);
    let fresh: BTreeSet<u64> = fresh.map(|record| record.tick).collect();
    let missed = |from: u64| WINDOW_TICKS as f64 - fresh.range(from..from + WINDOW_TICKS).count() as f64;
    let (after, last) = (stood.end + SETTLE_TICKS, applied.last().map_or(0, |record| record.tick));
    (0..)
        .map(|window| (stood.start + window * WINDOW_TICKS, after + window * WINDOW_TICKS))
        .take_while(|(with, control)| with + WINDOW_TICKS <= stood.end && control + WINDOW_TICKS <= last)
        .map(|(with, control)| missed(with) - missed(control))
        .collect()
}

#[test]
fn a_hand_that_waits_for_a_disk_is_seen_in_its_recording() {
    let record = |tick: u64, kind: Applied| {
        let mut record = AppliedRecord { tick, ..AppliedRecord::default() };
        record.command.kind = kind as u32;
        record
    };
    // Two windows and some in which the disk stands; held in the first hundred of the second, not there in the next hundred.
    let kind = |tick: u64| if (2_100..2_200).contains(&tick) { Applied::Held } else { Applied::Fresh };
    let made = (1..=7_000).filter(|tick| !(2_200..2_300).contains(tick));
    let applied: Vec<AppliedRecord> = made.map(|tick| record(tick, kind(tick))).collect();
    assert_eq!(excesses(&applied, 1_100..3_500), [0.0f64, 200.0]);
    assert_eq!(excesses(&applied, 1_100..6_900), Vec::<f64>::new(), "there is no control");
    assert_eq!(tick_behind("it stands ", "ready\n it stands {\"tick\": 70}\n"), Some(70));
}

/// A disk that lets nobody write for longer than the device's ring lasts: the file system is frozen, as a snapshot or a sleeping drive does it.
#[test]
fn a_disk_that_stands_still_for_six_seconds_costs_the_recording_nothing() {
    let folder = Folder::new("diskfrozen");
    let [image, disk] = ["disk.img", "disk"].map(|name| folder.path(name));
    std::fs::create_dir(&disk).expect("a folder to mount on");
    let mount = format!("truncate -s 128M {image} && mkfs.ext4 -q {image} && mount -o loop {image} {disk}");
    let freeze = format!("{mount} && fsfreeze -f {disk} && fsfreeze -u {disk}");
    let (code, _, said) = run(Command::new("unshare").args(["-m", "sh", "-c", &freeze]));
    if code != Some(0) {
        return not_shown(&format!("a disk that stands still: no file system can be mounted and frozen here ({})", said.trim()));
    }
    let name = format!("diskfrozen-{}", std::process::id());
    let status =
        format!("\"$(timeout 5 \"{}\" --name {name} status --json | tr -d '\\n')\"", binaries().join("hystation").display());
    let stands = format!(
        "{mount} && {{ (sleep 6; fsfreeze -f {disk} && printf 'it stands %s\\n' {status} >&2; sleep 6; \
         printf 'it goes on %s\\n' {status} >&2; fsfreeze -u {disk}) & }}"
    );
    let fault = "[[fault]]\nkind = \"kill\"\ntarget = \"console\"\ntick = 3000\n";
    let Some((report, said)) = run_on_small("diskfrozen", &folder, &stands, &format!("{disk}/session.mcap"), fault) else {
        return;
    };
    assert!(said.contains("it stands"), "{said}");
    assert_eq!((&report["invalid_applied"], &report["stale_applied"]), (&0.into(), &0.into()), "{said}");
    let faults = report["faults"].as_array().expect("faults");
    assert!(faults.iter().all(|fault| fault["target"] != "recorder"), "it was waited for, not ended: {said}");
    let recording = hyst_recording::Recording::read(folder.as_path().join("copy.mcap").as_path()).expect("a recording");
    let continuity = hyst_recording::Continuity::of(&recording.content);
    assert_eq!((continuity.lost(), continuity.missing(), continuity.repeated), (0, 0, 0), "{said}");
    assert!(recording.applied().len() > 15_000, "{} ticks", recording.applied().len());
    let stood = tick_behind("it stands ", &said).zip(tick_behind("it goes on ", &said));
    match stood {
        Some((from, to)) => {
            // A recording does not say which ticks are void: of one window alone a stall of the host may take any share.
            let promise = Promise { allowed: ALLOWED_TICKS, least: LEAST_WINDOWS, most: f64::INFINITY };
            promise
                .judge("a disk that stands still, ticks lost of a thousand", &excesses(recording.applied(), from..to), || said);
        }
        None => not_shown(&format!("what a disk that stands still costs the hand: nobody said when it stood ({said})")),
    }
}

/// What has no room then is not there for a while: a successor is started again until it is.
#[test]
fn a_shared_memory_that_is_full_for_two_seconds_applies_no_wrong_force_and_who_died_in_it_comes_back() {
    let folder = Folder::new("shmfull");
    let mount = "mount -t tmpfs -o size=672m none /dev/shm";
    let fault = "[[fault]]\nkind = \"shm-full\"\ntarget = \"recorder\"\ntick = 5000\nfor = 2.0\n\
                 [[fault]]\nkind = \"kill\"\ntarget = \"fluid:active\"\ntick = 5500\n";
    let Some((report, said)) = run_on_small("shmfull", &folder, mount, &folder.path("session.mcap"), fault) else { return };
    assert_over(&report, "shm-full", &said);
    let kill = report["faults"].as_array().and_then(|all| all.iter().find(|fault| fault["kind"] == "kill")).expect("the kill");
    assert!(kill["recovered_us"].is_number(), "{kill:#}\n{said}");
    let is_refused = |line: &str| line.contains("cannot start fluid:") && line.contains(" MiB free, and it takes 40; ");
    assert!(said.lines().any(is_refused), "nobody is started into a memory that is full\n{said}");
}
