//! What runs short on request: the memory and the files that a process may have (its soft limits are lowered to what it uses), and the room on the
//! disk of the recording or in /dev/shm (a ballast file takes what is free).
//!
//! Promise: a file system with much room is never filled; the ballast is topped up only while its file is there, and
//! what was lowered is remembered, so that it can be put back. Only soft limits are touched: putting one back needs no right that lowering it did not need.

use crate::faultfile::FaultKind;
use hyst_engine::Settings;
use hyst_exchange::{Station, system};
use rustix::fs::FallocateFlags;
use rustix::io::Errno;
use rustix::process::{Resource, Rlimit};
use serde::{Deserialize, Serialize};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// A file system with more room than this is not filled, bytes: it is somebody's disk, and filling it would take the machine with it.
pub const MOST_FREE_BYTES: u64 = 1 << 30;
/// A file system with less room than this is full, bytes: nothing that an engine writes fits.
const FULL_BYTES: u64 = 64 << 10;
/// The ballast is made of pieces of these sizes, bytes, the large ones first.
const PIECES_BYTES: [u64; 2] = [1 << 20, 4 << 10];
/// Most pieces of one helping: the large ones, and the small ones of the last large one.
const MOST_PIECES: u64 = (MOST_FREE_BYTES >> 20) + 512;
/// Between two helpings, ns: what others free meanwhile is taken again.
const HELPING_NS: u64 = 20_000_000;
/// A file system that has not become full after so long, ns, is not held full for the time that was asked for: who fills it is an ordinary thread, behind
/// all that is real time.
pub const FILL_WITHIN_NS: u64 = 10_000_000_000;

/// A soft limit that was lowered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lowered {
    /// That of files, not of memory.
    files: bool,
    /// What it was; `None` is no limit.
    soft: Option<u64>,
}

/// Lowers a limit of a process to what it uses now: its memory (`oom`) or its files (`no-files`). One that is as low already is another fault's, which puts it
/// back: who remembered it as it is would leave it so for ever.
pub fn lower(pid: u32, kind: FaultKind) -> Result<Lowered, String> {
    let files = kind == FaultKind::NoFiles;
    let used = if files { lowest_free_file(pid) } else { address_space(pid) };
    let (used, (soft, hard)) = used.zip(limits(pid, files)).ok_or_else(|| format!("process {pid} is gone"))?;
    if soft.is_some_and(|soft| soft <= used) {
        return Err(already(kind, format!("process {pid}")));
    }
    set(pid, files, Rlimit { current: Some(used), maximum: hard })
        .map_err(|error| format!("its limit cannot be lowered: {error}"))?;
    Ok(Lowered { files, soft })
}

/// Why a limit that was lowered is not lowered once more.
pub fn already(kind: FaultKind, whom: impl std::fmt::Display) -> String {
    format!("{} of {whom} is under way already; undo that fault, or wait for its end", kind.name())
}

/// Puts a limit back; a process that is gone needs none.
pub fn restore(pid: u32, lowered: Lowered) {
    if let Some((_, hard)) = limits(pid, lowered.files) {
        let _ = set(pid, lowered.files, Rlimit { current: lowered.soft, maximum: hard });
    }
}

fn set(pid: u32, files: bool, limit: Rlimit) -> Result<(), Errno> {
    let pid = crate::proc::pid(pid).ok_or(Errno::SRCH)?;
    rustix::process::prlimit(Some(pid), if files { Resource::Nofile } else { Resource::As }, limit).map(|_| ())
}

/// Soft and hard limit; the inner `None` is no limit.
fn limits(pid: u32, files: bool) -> Option<(Option<u64>, Option<u64>)> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/limits")).ok()?;
    let name = if files { "Max open files" } else { "Max address space" };
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    let mut words = line.split_whitespace().map(|word| word.parse().ok());
    Some((words.next()?, words.next()?))
}

/// Size of its address space, bytes.
fn address_space(pid: u32) -> Option<u64> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/statm")).ok()?;
    let pages: u64 = text.split_whitespace().next()?.parse().ok()?;
    Some(pages * rustix::param::page_size() as u64)
}

/// The number that its next file would have: a limit of files is one of their numbers.
fn lowest_free_file(pid: u32) -> Option<u64> {
    let entries = std::fs::read_dir(format!("/proc/{pid}/fd")).ok()?;
    let mut numbers: Vec<u64> = entries.flatten().filter_map(|entry| entry.file_name().to_string_lossy().parse().ok()).collect();
    numbers.sort_unstable();
    Some(numbers.iter().zip(0..).take_while(|(number, at)| **number == *at).count() as u64)
}

/// Where the ballast of a kind lies; `None` if the kind has none, or the station records nothing.
pub fn ballast(station: &Station, kind: FaultKind) -> Option<PathBuf> {
    match kind {
        FaultKind::ShmFull => Some(station.root().join("ballast")),
        FaultKind::DiskFull => {
            let settings = std::fs::read_to_string(station.settings()).ok()?;
            let mut name = toml::from_str::<Settings>(&settings).ok()?.record?.into_os_string();
            name.push(".ballast");
            Some(name.into())
        }
        _ => None,
    }
}

/// Whether a station's file system has little enough room to be filled for a kind; whatever has no ballast may be. Who else has it is asked by whoever asks for the
/// fault (`neighbours::check_for`), since the supervisor has no time for it.
pub fn check(station: &Station, kind: FaultKind) -> Result<(), String> {
    if !matches!(kind, FaultKind::DiskFull | FaultKind::ShmFull) {
        return Ok(());
    }
    let path = ballast(station, kind).ok_or("disk-full: this station records nothing; start it with --record")?;
    check_folder(path.parent().unwrap_or(Path::new("/")), kind)
}

/// Whether the file system of a folder has little enough room to be filled.
pub fn check_folder(folder: &Path, kind: FaultKind) -> Result<(), String> {
    let free = free_bytes(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    if free <= MOST_FREE_BYTES {
        return Ok(());
    }
    Err(format!(
        "{}: {} has {} MiB free, and at most {} MiB are filled; {}",
        kind.name(),
        folder.display(),
        free >> 20,
        MOST_FREE_BYTES >> 20,
        cure(kind)
    ))
}

/// How a station is given a file system that may be filled.
pub fn cure(kind: FaultKind) -> &'static str {
    match kind {
        FaultKind::ShmFull => {
            "give the station a small one of its own: unshare -m sh -c 'mount -t tmpfs -o size=768m none /dev/shm; exec hystation run …'"
        }
        _ => "record onto a small one: mount -t tmpfs -o size=256m none FOLDER, and --record FOLDER/session.mcap",
    }
}

fn free_bytes(folder: &Path) -> Result<u64, Errno> {
    rustix::fs::statvfs(folder).map(|found| found.f_bfree * found.f_frsize)
}

/// Whether the file system on which the ballast lies has no room left.
pub fn is_full(ballast: &Path) -> bool {
    ballast.is_file() && free_bytes(ballast).is_ok_and(|free| free < FULL_BYTES)
}

/// Begins to fill; goes on until the ballast is removed.
pub fn fill(ballast: &Path) -> Result<(), String> {
    let failed = |error: std::io::Error| match error.kind() {
        ErrorKind::AlreadyExists => format!("{} fills it already; undo that fault, or wait for its end", ballast.display()),
        _ => format!("{}: {error}", ballast.display()),
    };
    let file = std::fs::OpenOptions::new().write(true).create_new(true).open(ballast).map_err(failed)?;
    let path = ballast.to_path_buf();
    let body = move || {
        let mut bytes = 0;
        while path.is_file() {
            bytes = helping(&file, &path, bytes);
            system::sleep_ns(HELPING_NS);
        }
    };
    let filling = std::thread::Builder::new().name("ballast".into()).spawn(body);
    filling.map(drop).map_err(|error| {
        relieve(ballast); // else it would fill nothing, and stand in the way of the next
        failed(error)
    })
}

/// Makes the file as long as it can be; gives its length.
fn helping(file: &std::fs::File, path: &Path, mut bytes: u64) -> u64 {
    let mut left = MOST_PIECES;
    for piece in PIECES_BYTES {
        while left > 0 && path.is_file() && take(file, bytes, piece).is_ok() {
            bytes += piece;
            left -= 1;
        }
    }
    bytes
}

fn take(file: &std::fs::File, at: u64, piece: u64) -> std::io::Result<()> {
    use std::os::unix::fs::FileExt;
    match rustix::fs::fallocate(file, FallocateFlags::empty(), at, piece) {
        Err(Errno::OPNOTSUPP) => file.write_all_at(&vec![0; piece as usize], at),
        other => other.map_err(Into::into),
    }
}

/// Removes a ballast; absent is as good. There is room again at once: whoever fills has the file open, and may not be let run for long.
pub fn relieve(ballast: &Path) {
    let file = std::fs::OpenOptions::new().write(true).open(ballast);
    let _ = std::fs::remove_file(ballast);
    let _ = file.and_then(|file| file.set_len(0)); // it has no name any more, so that nobody makes it grow
}

/// Removes what a supervisor that died may have left of the kinds that nobody remembers.
pub fn relieve_all(station: &Station, is_known: impl Fn(FaultKind) -> bool) {
    let kinds = [FaultKind::DiskFull, FaultKind::ShmFull];
    kinds.into_iter().filter(|kind| !is_known(*kind)).filter_map(|kind| ballast(station, kind)).for_each(|path| relieve(&path));
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::{Command, Stdio};

    /// A shell that tries to open a file for each line that it is sent, and says what came of it.
    const OPENER: &str = "while read line; do (exec 9</dev/null) 2>/dev/null && echo yes || echo no; done";

    #[test]
    fn a_process_whose_files_are_lowered_opens_none_until_they_are_put_back() {
        use std::io::{BufRead, BufReader, Write};
        let mut child = Command::new("sh").args(["-c", OPENER]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let (mut to, mut from) = (child.stdin.take().unwrap(), BufReader::new(child.stdout.take().unwrap()));
        let mut opens = || {
            to.write_all(b"\n").unwrap();
            let mut answer = String::new();
            from.read_line(&mut answer).unwrap();
            answer.trim() == "yes"
        };
        assert!(opens());
        let before = limits(child.id(), true).unwrap();
        let lowered = lower(child.id(), FaultKind::NoFiles).unwrap();
        assert!(!opens() && limits(child.id(), true).unwrap().0 < before.0);
        assert!(lower(child.id(), FaultKind::NoFiles).unwrap_err().contains("under way already"), "it would be put back to that");
        restore(child.id(), lowered);
        assert!(opens() && limits(child.id(), true).unwrap() == before);
        let lowered = lower(child.id(), FaultKind::Oom).unwrap();
        assert_eq!(limits(child.id(), false).unwrap().0, address_space(child.id()));
        restore(child.id(), lowered);
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(lower(child.id(), FaultKind::Oom).is_err());
    }

    #[test]
    fn a_ballast_grows_to_its_bound_and_no_file_without_a_name_grows() {
        let path = std::env::temp_dir().join(format!("ballast-{}", std::process::id()));
        let file = std::fs::File::create(&path).unwrap();
        take(&file, 0, 1 << 20).unwrap();
        assert_eq!(file.metadata().unwrap().len(), 1 << 20);
        relieve(&path);
        assert_eq!(file.metadata().unwrap().len(), 0, "it takes no room, though it is open still");
        assert_eq!(helping(&file, &path, 1 << 20), 1 << 20, "its name is gone");
        assert!(!is_full(&path));
        std::fs::write(&path, "").unwrap();
        let refused = fill(&path).unwrap_err();
        assert!(refused.contains("fills it already") && path.is_file(), "{refused}");
        relieve(&path);
    }

    #[test]
    fn a_file_system_with_much_room_is_not_filled_and_the_cure_is_named() {
        let station = Station::named(&format!("t{}-room", std::process::id())).unwrap();
        assert!(check(&station, FaultKind::Kill).is_ok());
        assert!(check(&station, FaultKind::DiskFull).unwrap_err().contains("--record"), "no such station records");
        station.wipe();
        station.found().unwrap();
        if free_bytes(station.root()).unwrap() > MOST_FREE_BYTES {
            let refused = check(&station, FaultKind::ShmFull).unwrap_err();
            assert!(refused.contains("unshare -m") && refused.contains("MiB free"), "{refused}");
        }
        station.wipe();
    }
}
