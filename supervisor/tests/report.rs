//! `hystation report` as a user calls it: files and exit codes, the same bytes each time, what is damaged or no recording at all.

mod shown;

use hyst_messages::{AppliedRecord, ForceCommand, HardwareSample, Pose};
use hyst_recording::{Block, SceneFile, Session, Writer};
use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A folder that goes when the test ends.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("hystation-report-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }
    fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.file(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }
    /// A recording of so many ticks, the tip moving along z by 10 µm a tick.
    fn record(&self, name: &str, ticks: u64) -> PathBuf {
        let mut writer = self.writer(name);
        for first in (0..ticks).step_by(200) {
            writer.append(&block(first..ticks.min(first + 200))).unwrap();
        }
        writer.finish().unwrap();
        self.file(name)
    }
    fn writer(&self, name: &str) -> Writer {
        let session = Session::from([("session".to_string(), name.to_string())]);
        Writer::open(&self.file(name), &session).unwrap()
    }
}

/// These ticks, the tip moving along z by 10 µm in each.
fn block(ticks: Range<u64>) -> Block {
    let record = |tick: u64| {
        let position_m = [0.0, 0.0, 1e-5 * tick as f32];
        let sample = HardwareSample { pose: Pose { position_m, ..Pose::default() }, ..HardwareSample::default() };
        let command = ForceCommand { tick, force_n: [0.0, 0.5, 0.0], ..ForceCommand::default() };
        AppliedRecord { tick, command, sample, ..AppliedRecord::default() }
    };
    Block { applied: ticks.map(record).collect(), ..Block::default() }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn report(words: &[&Path]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hystation")).arg("report").args(words).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Exit code 2, one message, and no panic.
fn refused(words: &[&Path], why: &str) {
    let output = report(words);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{words:?}: {said}");
    assert!(said.contains(why) && !said.contains("panicked") && output.stdout.is_empty(), "{words:?}: {said}");
}

#[test]
fn a_recording_gives_text_page_json_and_csv_and_the_same_bytes_again() {
    let folder = Folder::new("whole");
    let session = folder.record("session.mcap", 3_001);
    let write = |run: &str| {
        let files = ["html", "json", "csv"].map(|kind| folder.file(&format!("{run}.{kind}")));
        let [html, json, csv] = &files;
        let output = report(&[&session, Path::new("--html"), html, Path::new("--json"), json, Path::new("--csv"), csv]);
        assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()));
        (text(&output.stdout), files.map(|file| std::fs::read_to_string(file).unwrap()))
    };
    let first = write("first");
    assert!(first == write("second"));
    let (shown, [page, json, csv]) = first;
    // 3 000 ticks of 10 µm are 30 mm; 0.5 N all the time.
    let path = shown.lines().find(|line| line.contains("path of the tip")).unwrap_or_else(|| panic!("{shown}"));
    assert!(path.contains("0.030 m") && path.contains("100 %"), "{path}");
    assert!(page.starts_with("<!doctype html>") && page.contains("path of the tip") && !page.contains("<script"));
    assert_eq!(csv.lines().count(), 1 + 31);
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((json["station"]["ticks"].as_u64(), json["length_s"].as_f64()), (Some(3_001), Some(3.001)));
}

/// `--html` alone was refused, for it wanted a value.
#[test]
fn a_page_for_which_no_file_is_named_lies_beside_the_recording_and_never_in_its_place() {
    let folder = Folder::new("beside");
    let session = folder.record("session.mcap", 400);
    let output = report(&[&session, Path::new("--html")]);
    assert_eq!((output.status.code(), text(&output.stderr)), (Some(0), String::new()));
    assert!(folder.read("session.html").starts_with("<!doctype html>"));
    let named = folder.record("named.html", 200);
    refused(&[&named, Path::new("--html")], "is a recording");
    refused(&[Path::new("--html"), &session], "<FILE>"); // so named it would be the page
}

/// One for which the temporary folder had no room was a page without an organ, with no word of it and exit code 0.
#[test]
fn a_page_without_the_organ_says_why_and_what_the_system_refuses_costs_exit_code_3() {
    let folder = Folder::new("organ");
    let record = |name: &str, hash: u64, scene: Vec<SceneFile>| {
        let facts = [("session", name.to_string()), ("scene_hash", format!("{hash:016x}"))];
        let session: Session = facts.into_iter().map(|(key, value)| (key.to_string(), value)).collect();
        let mut writer = Writer::open(&folder.file(name), &session).unwrap();
        writer.append(&Block { scene, ..block(0..200) }).unwrap();
        writer.finish().unwrap();
        folder.file(name)
    };
    let page = |recording: &Path, temporary: &Path| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hystation"));
        let output = command.arg("report").arg(recording).arg("--html").env("TMPDIR", temporary).output().unwrap();
        (output.status.code(), text(&output.stderr), std::fs::read_to_string(recording.with_extension("html")).unwrap())
    };
    let built_in = record("built-in.mcap", hyst_scene::load_embedded().unwrap().hash, Vec::new());
    let without = record("without.mcap", 1, Vec::new());
    let file = SceneFile { index: 0, count: 1, name: "scene.toml".into(), bytes: b"What a build of next year reads".to_vec() };
    let later = record("later.mcap", 1, vec![file]);
    for (recording, why) in [
        (&built_in, None),
        (&without, Some("the recording does not hold its scene")),
        (&later, Some("this build does not read the scene that was recorded")),
    ] {
        let (code, said, page) = page(recording, &folder.0);
        assert_eq!((code, said.as_str()), (Some(0), ""), "{why:?}");
        assert_eq!(page.contains("<path class=\"organ\""), why.is_none(), "{why:?}");
        assert!(why.is_none_or(|why| page.contains(&format!("The organ is not drawn behind it: {why}."))), "{why:?}");
    }
    let (code, said, page) = page(&later, &folder.file("nowhere"));
    assert!(code == Some(3) && said.contains("no organ") && said.contains("TMPDIR"), "{code:?} {said}");
    assert!(page.contains("The organ is not drawn behind it: the recorded scene cannot be laid down in "));
}

#[test]
fn json_goes_to_stdout_and_an_earlier_session_is_a_column() {
    let folder = Folder::new("compare");
    let (session, earlier) = (folder.record("session.mcap", 400), folder.record("earlier.mcap", 200));
    let output = report(&[&session, Path::new("--json"), Path::new("-"), Path::new("--compare"), &earlier]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((json["session"]["session"].as_str(), json["length_s"].as_f64()), (Some("session.mcap"), Some(0.4)));
    assert_eq!(
        (json["compared"][0]["session"]["session"].as_str(), json["compared"][0]["length_s"].as_f64()),
        (Some("earlier.mcap"), Some(0.2))
    );
    let shown = text(&report(&[&session, Path::new("--compare"), &earlier]).stdout);
    let time = shown.lines().find(|line| line.trim_start().starts_with("time  ")).unwrap_or_else(|| panic!("{shown}"));
    assert!(time.contains("0.400 s") && time.trim_end().ends_with("0.200"), "{time}");
}

#[test]
fn a_recording_that_was_cut_is_reported_as_far_as_it_goes_with_exit_code_3() {
    let folder = Folder::new("cut");
    let session = folder.record("session.mcap", 2_000);
    let bytes = std::fs::read(&session).unwrap();
    std::fs::write(&session, &bytes[..bytes.len() / 2]).unwrap();
    let page = folder.file("page.html");
    let output = report(&[&session, Path::new("--html"), &page]);
    assert_eq!(output.status.code(), Some(3));
    assert!(text(&output.stderr).contains("not everything is there"), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("Missing of the recording") && text(&output.stdout).contains("path of the tip"));
    assert!(folder.read("page.html").contains("Not everything of the recording is there"));
}

/// The file of `shared/recording/tests/long.rs`, with holes, so that it takes no room: what lies between its two blocks is 100 GB of what no recorder writes.
#[test]
fn a_recording_of_100_gb_is_reported_from_its_first_block_to_its_last_with_exit_code_3() {
    const LENGTH_BYTES: u64 = 100_000_000_000;
    const HOLE_BYTES: u64 = 60 << 20;
    const ATTACHMENT: u8 = 9;
    let folder = Folder::new("far");
    let mut writer = folder.writer("session.mcap");
    writer.append(&block(0..400)).unwrap();
    let first_bytes = writer.bytes();
    writer.append(&block(400..800)).unwrap();
    drop(writer);
    let session = folder.file("session.mcap");
    let bytes = std::fs::read(&session).unwrap();
    let (before, behind) = bytes.split_at(first_bytes as usize);
    let file = File::create(&session).unwrap();
    if let Err(error) = file.set_len(LENGTH_BYTES) {
        let what = format!("the report of a recording of 100 GB: the file system takes no file with holes ({error})");
        return shown::not_shown(&what);
    }
    file.write_all_at(before, 0).unwrap();
    let mut at = first_bytes;
    while at < LENGTH_BYTES {
        file.write_all_at(&[ATTACHMENT], at).unwrap();
        file.write_all_at(&HOLE_BYTES.to_le_bytes(), at + 1).unwrap();
        at += 9 + HOLE_BYTES;
    }
    file.write_all_at(behind, at).unwrap();
    // So that one that reads the holes, which takes minutes, ends; coreutils' own code is 124.
    let mut command = Command::new("timeout");
    command.args(["300", env!("CARGO_BIN_EXE_hystation"), "report"]).arg(&session).args(["--json", "-"]);
    let output = command.output().unwrap();
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("not everything is there"), "{said}");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((json["station"]["ticks"].as_u64(), json["length_s"].as_f64()), (Some(800), Some(0.8)));
}

/// Half a page was left of one that a disk was full for, in the place of the one before, and the exit code was 1.
#[test]
fn a_page_that_the_disk_does_not_take_is_not_there_and_the_one_before_is() {
    let folder = Folder::new("full");
    let session = folder.record("session.mcap", 3_001);
    for kind in ["--html", "--json", "--csv"] {
        let place = folder.file("given");
        std::fs::write(&place, "the one before").unwrap();
        // No file grows beyond half a kilobyte, as on a disk that has no more; whoever writes is told so, and not ended.
        let mut command = Command::new("sh");
        command.args(["-c", "trap '' XFSZ; ulimit -f 1; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_hystation"), "report"]);
        let output = command.arg(&session).arg(kind).arg(&place).output().unwrap();
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{kind}: {said}");
        assert!(said.contains("is the disk full?") && said.lines().count() == 1, "{kind}: {said}");
        assert_eq!(folder.read("given"), "the one before", "{kind}");
        assert_eq!(std::fs::read_dir(&folder.0).unwrap().count(), 2, "{kind}: something is left beside it");
    }
    let output = report(&[&session, Path::new("--html"), Path::new("/dev/full")]);
    assert_eq!(output.status.code(), Some(3), "{}", text(&output.stderr));
}

#[test]
fn what_is_no_recording_is_refused_with_one_message_and_nothing_is_written() {
    let folder = Folder::new("bad");
    let good = folder.record("good.mcap", 200);
    let bytes = std::fs::read(&good).unwrap();
    let written = |name: &str, bytes: &[u8]| {
        std::fs::write(folder.file(name), bytes).unwrap();
        folder.file(name)
    };
    // Another version, wherever the file says of which it is: the value of the fact `format`, after its key and its length.
    let mut other = bytes.clone();
    let fact = [&b"format\x01\0\0\0"[..], hyst_recording::FORMAT.as_bytes()].concat();
    let said: Vec<usize> =
        bytes.windows(fact.len()).enumerate().filter(|(_, window)| *window == fact).map(|(at, _)| at).collect();
    assert_eq!(said.len(), 2, "at its head and at its end");
    said.iter().for_each(|at| other[at + fact.len() - 1] = b'9');
    let cases = [
        (folder.file("missing.mcap"), "No such file"),
        (folder.0.clone(), "is not a file"),
        (PathBuf::from("/dev/null"), "is not a file"),
        (written("empty.mcap", b""), "is not an MCAP file"),
        (written("text.mcap", b"What the trainee did on Monday"), "is not an MCAP file"),
        (written("head.mcap", &bytes[..20]), "has no header"),
        (written("other.mcap", &other), "not a recording of this version"),
        (folder.record("idle.mcap", 0), "holds no tick"),
    ];
    let (page, csv) = (folder.file("page.html"), folder.file("rows.csv"));
    for (file, why) in &cases {
        refused(&[file, Path::new("--html"), &page, Path::new("--csv"), &csv], why);
        refused(&[&good, Path::new("--compare"), file], why);
        assert!(!page.exists() && !csv.exists(), "{}", file.display());
    }
}

#[test]
fn outputs_that_cannot_be_are_refused_before_anything_is_read_and_no_recording_is_overwritten() {
    let folder = Folder::new("outputs");
    let session = folder.record("session.mcap", 200);
    let bytes = std::fs::read(&session).unwrap();
    let (nowhere, page) = (folder.file("nowhere/page.html"), folder.file("page.html"));
    refused(&[&session, Path::new("--html"), &nowhere], "folder does not exist");
    refused(&[&session, Path::new("--csv"), &folder.0], "is a folder");
    refused(&[&session, Path::new("--csv"), Path::new("-")], "only --json");
    refused(&[&session, Path::new("--html"), &page, Path::new("--json"), &page], "another option");
    for detour in [session.clone(), folder.file("./session.mcap")] {
        refused(&[&session, Path::new("--json"), &detour], "is a recording");
    }
    let mut many: Vec<&Path> = vec![session.as_path()];
    (0..9).for_each(|_| many.extend([Path::new("--compare"), session.as_path()]));
    refused(&many, "at most 8");
    refused(&[], "report");
    assert!(std::fs::read(&session).unwrap() == bytes && !page.exists());
}
