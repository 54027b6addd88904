//! What is no engine, and swaps that cannot be: refused with exit code 2 and a reason, and nobody is disturbed. And a station that may start nothing of what it
//! keeps: it swaps in the file itself, and says so.

use serde_json::Value;
use station_tests::swapped::{assert_left_nobody, got_no_time, swap};
use station_tests::{Folder, RECOVERY_LIMIT, Station, bad_engine, binaries, hystation, run, wait_for};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A real engine of another layout: the fluid, with another hash wherever its own stands in it. Both its description and its start go by that.
fn of_another_layout(folder: &Path) -> PathBuf {
    let own = hyst_messages::layout_hash().to_le_bytes();
    let mut bytes = std::fs::read(binaries().join("fluid")).expect("an engine");
    let places: Vec<usize> = (0..bytes.len() - own.len()).filter(|at| bytes[*at..].starts_with(&own)).collect();
    assert!(!places.is_empty(), "the hash of the layout is not in the engine");
    places.into_iter().for_each(|at| bytes[at] ^= 1);
    let path = folder.join("another-layout");
    std::fs::write(&path, bytes).expect("an engine of another layout");
    path
}

#[test]
fn a_swap_to_what_is_no_engine_is_refused_and_disturbs_nothing() {
    let station = Station::start("refuse", &["--hand", "script:press"]);
    let pids = station.pids();
    let folder = station.folder().clone();
    let script = folder.join("script");
    std::fs::write(&script, "#!/bin/sh\necho '{}'\n").expect("a script");
    let truncated = folder.join("truncated");
    let whole = std::fs::read(binaries().join("fluid")).expect("an engine");
    std::fs::write(&truncated, &whole[..whole.len() / 3]).expect("a part of it");
    let layout = of_another_layout(&folder);
    let (pipe, circle) = (folder.join("pipe"), folder.join("circle"));
    let (made, _, said) = run(Command::new("mkfifo").arg(&pipe));
    assert_eq!(made, Some(0), "mkfifo, of coreutils: {said}");
    std::os::unix::fs::symlink(&circle, &circle).expect("a link to itself");
    for file in [&script, &truncated, &layout] {
        use std::os::unix::fs::PermissionsExt;
        std::fs::set_permissions(file, std::fs::Permissions::from_mode(0o755)).expect("its rights");
    }
    let cases = [
        ("fluid", script, "no ELF file"),
        ("fluid", truncated, "is truncated"),
        ("fluid", layout, "has layout"),
        ("fluid", folder.clone(), "is no file"),
        ("fluid", folder.join("absent"), "No such file"),
        // Nobody ever writes into the pipe, the zeros have no end, and the link leads nowhere.
        ("fluid", pipe, "is no file"),
        ("fluid", PathBuf::from("/dev/zero"), "is no file"),
        ("fluid", circle, "symbolic links"),
        // It neither says anything nor ends; it says too much, and does not end either; it says that it does something else.
        ("fluid", bad_engine(&folder, "fluid", "silent"), "did not end within"),
        ("fluid", bad_engine(&folder, "fluid", "flood"), "did not end within"),
        ("fluid", bad_engine(&folder, "fluid", "foreign"), "has interface"),
        ("fluid", binaries().join("tissue"), "is a tissue, not a fluid"),
        // It says what it is, and leaves a process.
        ("tissue", bad_engine(&folder, "fluid", "forks"), "is a fluid, not a tissue"),
        ("fluid", binaries().join("hystation"), "is it an engine?"),
        ("hardware", binaries().join("hardware"), "is no engine"),
        ("supervisor", binaries().join("hystation"), "is no engine"),
        ("liver", binaries().join("fluid"), "is no role"),
    ];
    for (role, binary, reason) in cases {
        let (code, _, said) = swap(&station, role, &binary);
        assert_eq!(code, Some(2), "{role} {}: {said}", binary.display());
        assert!(said.contains(reason), "{role} {}: {said}", binary.display());
        assert_left_nobody(&binary);
    }
    interrupt_while_asked(&station, &bad_engine(&folder, "fluid", "silent"));
    let nobody = run(hystation().args(["--name", "no-such-station", "swap", "fluid"]).arg(binaries().join("fluid")));
    assert_eq!(nobody.0, Some(2), "{}", nobody.2);
    assert_eq!(station.pids(), pids, "somebody was disturbed\n{}", station.said());
    station.stop().assert_clean();
}

/// Ctrl-C while a file was asked what it is left its process, which leads a group of its own.
fn interrupt_while_asked(station: &Station, silent: &Path) {
    let begins = [silent.as_os_str().as_encoded_bytes(), b"\0--describe"].concat();
    let is_asked = || {
        let folders = std::fs::read_dir("/proc").expect("what runs").flatten();
        folders.filter_map(|folder| std::fs::read(folder.path().join("cmdline")).ok()).any(|line| line.starts_with(&begins))
    };
    let mut command = hystation();
    command.args(["--name", station.name(), "swap", "fluid", "--json"]).arg(silent);
    let begun = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("hystation");
    assert!(wait_for(RECOVERY_LIMIT, || is_asked().then_some(())).is_some(), "it is never asked");
    let pid = rustix::process::Pid::from_raw(begun.id() as i32).expect("a process id");
    rustix::process::kill_process(pid, rustix::process::Signal::INT).expect("it is ours");
    let ended = begun.wait_with_output().expect("hystation");
    let (told, said) = (String::from_utf8_lossy(&ended.stdout), String::from_utf8_lossy(&ended.stderr));
    assert!(ended.status.code() == Some(3) && said.contains("interrupted: no swap of fluid was begun"), "{told}{said}");
    let told: Value = serde_json::from_str(&told).expect("nothing but JSON");
    assert!(told["exit_code"] == 3 && told["error"].as_str().is_some_and(|error| said.contains(error)), "{told:#}");
    assert!(!is_asked(), "its process was left");
}

/// Exit code and words of one swap, as it is answered at once.
fn asked(name: &str, role: &str, binary: &Path) -> (Option<i32>, String) {
    let (code, _, said) = run(hystation().args(["--name", name, "swap", role]).arg(binary));
    (code, said)
}

/// Kinds and processes that there are none of: one line that says which word it is, and nobody is hurt.
fn refuse_nonsense(station: &Station) {
    let before = (station.pids(), station.events().matches("injected").count());
    for (kind, target, words) in [
        ("melt", "tissue:active", "\"melt\" is no kind of fault; see `hystation fault list`"),
        ("KILL", "recorder", "\"KILL\" is no kind of fault"),
        ("", "recorder", "\"\" is no kind of fault"),
        ("kill", "liver", "target \"liver\": write PROCESS"),
        ("kill", "liver:active", "target \"liver:active\""),
        ("kill", "tissue:9", "target \"tissue:9\""),
        ("nan", "tissue:", "target \"tissue:\""),
        ("kill", "hardware", "hardware stands for the device on the desk"),
    ] {
        let (code, out, said) = run(hystation().args(["--name", station.name(), "fault", "inject", kind, target]));
        let is_clear = out.is_empty() && said.lines().count() == 1 && said.contains(words);
        assert!(code == Some(2) && is_clear, "{kind:?} {target:?}: {code:?} {out:?} {said}");
    }
    // What only the supervisor knows to be impossible.
    for (kind, target, words) in [
        ("undo", "recorder", "nothing is being done to it that could end"),
        ("cont", "recorder", "recorder is not stopped"),
        ("cont", "supervisor+guardian", "is not stopped"),
    ] {
        let (code, _, said) = run(hystation().args(["--name", station.name(), "fault", "inject", kind, target]));
        assert!(code == Some(2) && said.contains(words), "{kind} {target}: {code:?} {said}");
    }
    assert_eq!((station.pids(), station.events().matches("injected").count()), before, "{}", station.said());
    station.run_ticks(200);
    assert!(station.is_whole(), "{}\n{}", station.status(), station.said());
}

#[test]
fn a_second_swap_and_faults_of_what_is_not_there_are_refused() {
    let station = Station::start("second", &["--hand", "script:press", "--test-mode"]);
    refuse_nonsense(&station);
    let newcomer = || run(hystation().args(["--name", station.name(), "fault", "inject", "kill", "rendering:newcomer"]));
    let (code, _, said) = newcomer();
    assert!(code == Some(2) && said.contains("no swap of rendering is under way"), "{code:?} {said}");
    // The longest of all probations.
    let mut command = hystation();
    command.args(["--name", station.name(), "swap", "rendering"]).arg(binaries().join("rendering"));
    let mut first = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("hystation");
    let is_there = || station.events().contains("on probation in the old engine's place").then_some(());
    assert!(wait_for(RECOVERY_LIMIT, is_there).is_some(), "{}\n{}", station.status(), station.said());
    let (code, said) = asked(station.name(), "console", &binaries().join("console"));
    assert!(code == Some(2) && said.contains("a swap of rendering is under way"), "{code:?} {said}");
    let (code, _, said) = newcomer();
    assert_eq!(code, Some(0), "now it is there: {said}");
    assert_eq!(first.wait().expect("hystation").code(), Some(1), "{}", station.said());
    station.recover();
    station.stop().assert_clean();
}

#[test]
fn a_station_in_lock_step_refuses_every_swap() {
    let (folder, name) = (Folder::new("steps"), format!("steps-{}", std::process::id()));
    let mut command = hystation();
    command.args(["--name", &name, "run", "--headless", "--lockstep", "--for", "600s", "--hand", "script:press"]);
    let log = std::fs::File::create(folder.path("said")).expect("a file");
    let mut child = command.stdout(log.try_clone().expect("the same")).stderr(log).spawn().expect("hystation");
    let refused = wait_for(RECOVERY_LIMIT, || {
        let (code, said) = asked(&name, "fluid", &binaries().join("fluid"));
        said.contains("lock-step").then_some((code, said))
    });
    let stopped = run(hystation().args(["--name", &name, "stop"]));
    let ended = child.wait().expect("hystation");
    assert!(
        refused.as_ref().is_some_and(|(code, _)| *code == Some(2)),
        "{refused:?}\n{ended} {stopped:?}\n{}",
        folder.read("said")
    );
}

/// Says to this program that it runs where /dev/shm is mounted noexec.
const WITHIN: &str = "HYSTATION_TEST_NOEXEC";

/// In a mount namespace of its own, so that nobody else's /dev/shm changes.
#[test]
fn a_station_that_may_start_nothing_of_what_it_keeps_swaps_in_the_file_itself_and_says_so() {
    if std::env::var_os(WITHIN).is_some() {
        return swap_where_copies_cannot_run();
    }
    let (code, _, said) = run(Command::new("unshare").args(["-m", "true"]));
    assert!(code == Some(0) || !rustix::process::geteuid().is_root(), "root may not unshare: {said}");
    if code != Some(0) {
        eprintln!("NOT TRIED: another /dev/shm needs the right to make a mount namespace ({})", said.trim());
        return;
    }
    let own = std::env::current_exe().expect("this program");
    let script = "mount -t tmpfs -o size=1g,noexec none /dev/shm && exec \"$0\" --exact --nocapture \"$1\"";
    let name = "a_station_that_may_start_nothing_of_what_it_keeps_swaps_in_the_file_itself_and_says_so";
    let (code, out, said) = run(Command::new("unshare").args(["-m", "sh", "-c", script]).arg(own).arg(name).env(WITHIN, "1"));
    assert!(code == Some(0) && out.contains("1 passed"), "{code:?}\n{out}\n{said}");
}

fn swap_where_copies_cannot_run() {
    let folder = Folder::new("noexec");
    let (code, told, said) = run(hystation().arg("doctor"));
    assert!(told.contains("/dev/shm is mounted noexec"), "{code:?} {told}\n{said}");
    let name = format!("noexec-{}", std::process::id());
    // One that records nothing.
    let mut command = hystation();
    command.args(["--name", &name, "run", "--headless", "--hand", "script:press"]);
    let log = std::fs::File::create(folder.path("said")).expect("a file");
    let mut child = command.stdout(log.try_clone().expect("the same")).stderr(log).spawn().expect("hystation");
    let own = folder.as_path().join("my-console");
    std::fs::copy(binaries().join("console"), &own).expect("a copy of an engine");
    let record = wait_for(RECOVERY_LIMIT, || {
        let (code, out, _) = run(hystation().args(["--name", &name, "swap", "console", "--json"]).arg(&own));
        let record: Value = serde_json::from_str(&out).unwrap_or(Value::Null);
        (matches!(code, Some(0 | 1)) && !got_no_time(&record)).then_some(record)
    });
    let refused = asked(&name, "recorder", &binaries().join("recorder"));
    let (_, status, _) = run(hystation().args(["--name", &name, "status", "--json"]));
    let stopped = run(hystation().args(["--name", &name, "stop"]));
    let ended = child.wait().expect("hystation");
    let (record, said) = (record.expect("a swap"), folder.read("said"));
    assert_eq!(record["promoted"], true, "{record:#}\n{said}");
    assert_eq!(record["binary"].as_str(), own.to_str(), "no copy of it: {record:#}");
    let first = record["steps"][0]["what"].as_str().unwrap_or_default();
    assert!(first.contains("of which the station has no copy"), "{record:#}");
    let status: Value = serde_json::from_str(&status).unwrap_or(Value::Null);
    let runs = |process: &Value| process["name"] == "console" && process["binary"].as_str() == own.to_str();
    assert!(status["processes"].as_array().is_some_and(|all| all.iter().any(runs)), "{status:#}");
    assert!(refused.0 == Some(2) && refused.1.contains("this station has no recorder"), "{refused:?}");
    assert!(ended.success(), "{ended} {stopped:?}\n{said}");
}
