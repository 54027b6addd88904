//! What is no recording that can be read is refused in one line, and leaves nothing; an older one is read as it was.

use super::{record, same, verify};
use station_tests::{Folder, hystation, run};
use std::path::{Path, PathBuf};

/// A copy of a recording that says that it is of another format, without what a recorder of that did not write: nor had it a checksum of its facts.
fn of_format(from: &str, to: &str, format: &str, keep: impl Fn(&mut hyst_recording::Block)) {
    let mut reader = hyst_recording::Reader::open(Path::new(from)).unwrap();
    let mut writer = hyst_recording::Writer::open(Path::new(to), reader.session()).unwrap();
    while let Some(mut block) = reader.next_block().unwrap() {
        keep(&mut block);
        writer.append(&block).unwrap();
    }
    writer.finish().unwrap();
    let mut bytes = std::fs::read(to).unwrap();
    // Of each fact the key, and the length of its value; wherever they stand.
    for (fact, at, new) in [(&b"format\x01\0\0\0"[..], 10usize, format.as_bytes()[0]), (&b"\x03\0\0\0crc\x08\0\0\0"[..], 4, b'C')]
    {
        let found: Vec<usize> =
            bytes.windows(fact.len()).enumerate().filter(|(_, window)| *window == fact).map(|(at, _)| at).collect();
        assert!(found.len() > 1, "{fact:?} is there {} times", found.len());
        found.iter().for_each(|begin| bytes[begin + at] = new);
    }
    std::fs::write(to, bytes).unwrap();
}

/// What this process' stations have in shared memory and in the folders for what is temporary.
fn traces(station: &str) -> Vec<String> {
    let folders = ["/dev/shm", "/var/tmp"].map(PathBuf::from).into_iter().chain([std::env::temp_dir()]);
    let entries = folders.filter(|folder| folder.is_dir()).flat_map(|folder| std::fs::read_dir(folder).unwrap().flatten());
    let names = entries.map(|entry| entry.path().display().to_string());
    // As a whole: another checkout's may begin with it.
    names.filter(|name| name.split(['-', '.']).any(|part| part == station)).collect()
}

/// Refuses in one line that says these words, with exit code 2, whoever is asked to read the file, and leaves nothing.
fn refused(file: &str, words: &[&str], is_report_made: bool) {
    let station = format!("q{}", std::process::id());
    let recorded = format!("replay:{file}");
    let played = ["run", "--headless", "--for", "1s", "--hand", &recorded];
    let ways: [(&str, &[&str]); 4] = [
        ("replay", &["replay", file, "--headless"]),
        ("verify", &["replay", file, "--verify"]),
        ("report", &["report", file]),
        ("hand", &played),
    ];
    for (way, arguments) in ways {
        let (code, told, said) = run(hystation().args(["--name", &station]).args(arguments));
        if is_report_made && way == "report" {
            assert_eq!(code, Some(0), "{file}: {said}");
            continue;
        }
        if is_report_made && way == "hand" {
            continue; // an older one has poses, too
        }
        assert_eq!(code, Some(2), "{way} {file}: {told}{said}");
        assert_eq!(said.trim().lines().count(), 1, "{way} {file}: {said}");
        for word in words.iter().chain(&["recording ", file]) {
            assert!(said.contains(word), "{way} {file} does not say {word:?}: {said}");
        }
        assert_eq!(traces(&station), Vec::<String>::new(), "{way} {file}");
    }
}

#[test]
fn a_file_that_is_empty_or_no_recording_or_of_a_newer_version_is_refused_in_one_line_and_an_older_one_is_read() {
    let folder = Folder::new("replay-refused");
    let [good, new, old, first] = ["good.mcap", "new.mcap", "old.mcap", "first.mcap"].map(|name| folder.path(name));
    record("good", &good, &["--lockstep", "--for", "1s"]);
    let bytes = std::fs::read(&good).unwrap();
    let written = |name: &str, bytes: &[u8]| {
        std::fs::write(folder.as_path().join(name), bytes).unwrap();
        folder.path(name)
    };
    let give = "give a file that `hystation run --record` wrote";
    refused(&written("empty.mcap", b""), &["it is empty, nothing was recorded in it", give], false);
    refused(&written("text.mcap", b"What the trainee did on Monday"), &["is not an MCAP file", give], false);
    refused(&written("head.mcap", &bytes[..40]), &["ends at byte 40, before anything was recorded", give], false);
    refused(&written("magic.mcap", &bytes[..8]), &["has no header", "ends at byte 8", give], false);
    refused(&folder.path(""), &["is not a file", give], false);
    refused(&folder.path("gone.mcap"), &["No such file", "check the path and its rights"], false);
    let pipe = folder.path("pipe.mcap");
    let (code, _, said) = run(std::process::Command::new("mkfifo").arg(&pipe));
    assert_eq!(code, Some(0), "{said}");
    refused(&pipe, &["is not a file", give], false); // nobody will ever write into it

    of_format(&good, &new, "9", |_| {});
    refused(&new, &["it is of format 9, and 1 to 5 are read", "a newer hystation wrote it", "install that one"], false);
    of_format(&good, &first, "1", |block| {
        (block.steps, block.checkpoints, block.pictures, block.scene) = Default::default();
    });
    refused(&first, &["does not say what each step was made from", "`hystation report` reads it"], true);
    // Without pictures, without its scene, which is the one in the binary, and without a word of whose state a servo went on from.
    of_format(&good, &old, "3", |block| {
        (block.pictures, block.scene, block.origins) = Default::default();
        block.applied.iter_mut().for_each(|record| record.followed = 0);
    });
    let (code, said, complained) = verify("old", &old, &[]);
    assert_eq!((code, same(&said)), (Some(0), (1_000, 1_000)), "{said}{complained}");
}

#[test]
fn a_recording_that_was_closed_before_its_first_tick_or_that_may_not_be_read_is_refused_with_what_to_do() {
    let folder = Folder::new("replay-closed");
    let [file, shut] = ["closed.mcap", "shut.mcap"].map(|name| folder.path(name));
    let session = hyst_recording::Session::from([("session".into(), "closed".into())]);
    hyst_recording::Writer::open(Path::new(&file), &session).unwrap().finish().unwrap();
    let station = format!("c{}", std::process::id());
    for arguments in [&["replay", &file, "--headless"][..], &["replay", &file, "--verify"], &["report", &file]] {
        let (code, _, said) = run(hystation().args(["--name", &station]).args(arguments));
        assert_eq!((code, said.trim().lines().count()), (Some(2), 1), "{arguments:?}: {said}");
        assert!(said.contains("holds no tick of a session") && said.contains("recorded for longer"), "{arguments:?}: {said}");
        assert_eq!(traces(&station), Vec::<String>::new());
    }
    std::fs::copy(&file, &shut).unwrap();
    let closed = std::os::unix::fs::PermissionsExt::from_mode(0o000);
    std::fs::set_permissions(&shut, closed).unwrap();
    // Root's right to read everything has to be taken away.
    let is_root = rustix::process::geteuid().is_root();
    let lesser = ["setpriv", "--bounding-set=-dac_override,-dac_read_search", "--inh-caps=-dac_override,-dac_read_search"];
    for arguments in [["replay", &shut], ["report", &shut]] {
        let mut command = std::process::Command::new(if is_root { lesser[0] } else { "env" });
        command.args(lesser[1..].iter().filter(|_| is_root)).arg(station_tests::binaries().join("hystation")).args(arguments);
        let (code, _, said) = run(&mut command);
        assert_eq!((code, said.trim().lines().count()), (Some(2), 1), "{arguments:?}: {said}");
        assert!(said.contains("Permission denied") && said.contains("check the path and its rights"), "{said}");
    }
}
