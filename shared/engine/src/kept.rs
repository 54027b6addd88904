//! The station's own copies of the engines that it is given by a swap, whether a command or the operator's page asks for it. A developer who builds anew over
//! the file that he named changes nothing in a station that runs: what was verified is what starts, also after the next death, and what a swap is rolled
//! back to is what ran before it.

use crate::verify::verify;
use hyst_exchange::{PageError, Station, StationError, StationPage, system};
use hyst_messages::Role;
use rustix::fs::{OFlags, StatVfsMountFlags};
use std::fs::{File, Permissions};
use std::io::{Error, ErrorKind, Read, Write};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

/// The file that says where a copy is from, beside it.
const FROM: &str = "from";
/// The mode of a copy.
const OWNERS_MODE: u32 = 0o700;
/// Bytes that are copied at a time: between two of them it is seen that nobody wants the copy any more.
const PIECE: usize = 1 << 18;
/// How long one who removes copies is waited for, and between two looks, ns.
const REMOVED_WITHIN_NS: u64 = 5_000_000_000;
const LOOK_NS: u64 = 5_000_000;

fn folder(station: &Station) -> PathBuf {
    station.root().join("engines")
}

/// An engine that may be asked for: verified, and a copy if the station can have one. No copy is removed while one of these is there, since nobody but its
/// owner knows of it before the supervisor has written down what it is for.
#[derive(Debug)]
pub struct Kept {
    binary: PathBuf,
    _in_use: Option<File>,
}

impl Kept {
    /// What the supervisor is asked to start.
    pub fn binary(&self) -> &Path {
        &self.binary
    }
}

/// Verifies an engine and copies it into the station's root. Where nothing in there may be started it stays where it is, which the swap's record says. Given
/// up, as by a station that stops, it leaves no process of that engine but one that the system does not let end.
pub fn keep(station: &Station, binary: &Path, role: Role, given_up: &dyn Fn() -> bool) -> Result<Kept, String> {
    // An engine is asked for what this program is of. In a station of another layout it would agree with that, end in its start, and have cost the old one by
    // then where there is no spare.
    let clock = station.open();
    if let Err(StationError::Page(PageError::Foreign { .. })) = clock {
        let name = station.name();
        return Err(format!(
            "station {name} is of another build than this program, or damaged; swap with the `hystation` that runs it"
        ));
    }
    let given_up = || given_up() || clock.as_ref().is_ok_and(StationPage::stop_requested);
    verify(binary, role, &given_up)?;
    let kept = copy(station, binary, &given_up)?;
    if is_copy(&kept.binary) {
        // The file may have become another since it was looked at.
        verify(&kept.binary, role, &given_up).map_err(|reason| format!("{}, copied: {reason}", binary.display()))?;
    }
    Ok(kept)
}

fn copy(station: &Station, binary: &Path, given_up: &dyn Fn() -> bool) -> Result<Kept, String> {
    let refuse = |what: &Path, error: Error| format!("{}: {error}; look at `df /dev/shm`", what.display());
    let mounted = rustix::fs::statvfs(station.root()).map_err(|error| refuse(station.root(), error.into()))?;
    let name = binary.file_name().filter(|name| *name != FROM);
    let Some(name) = name.filter(|_| !mounted.f_flag.contains(StatVfsMountFlags::NOEXEC)) else {
        return Ok(Kept { binary: binary.to_path_buf(), _in_use: None });
    };
    let folder = folder(station);
    let in_use = open(station, &folder).map_err(|error| refuse(&folder, error))?;
    let (mut engine, bytes) = open_engine(binary)?;
    let free_bytes = system::free_bytes(station.root()).map_err(|error| refuse(station.root(), error))?;
    if !leaves_room(bytes, free_bytes) {
        return Err(format!(
            "{}: {} MiB, and of the {} MiB that /dev/shm has left a copy may take half; build it in release, or take out what a debugger alone reads \
             (`strip`)",
            binary.display(),
            bytes >> 20,
            free_bytes >> 20
        ));
    }
    // Into its place as a whole, and by that name only when it is all there. Each copies by itself.
    let next = folder.join(format!("{}-{}.next", std::process::id(), system::now_ns()));
    let from = binary.as_os_str().as_encoded_bytes();
    let mut make = || -> Result<PathBuf, Uncopied> {
        std::fs::create_dir(&next)?;
        let content = write(&mut engine, bytes, &next.join(name), given_up)?;
        std::fs::write(next.join(FROM), from)?;
        let own = folder.join(format!("{:016x}-{content:016x}", hash(NOTHING, from)));
        match std::fs::rename(&next, &own) {
            Err(error) if matches!(error.kind(), ErrorKind::DirectoryNotEmpty | ErrorKind::AlreadyExists) => {
                std::fs::remove_dir_all(&next)?; // the same is kept once
            }
            renamed => renamed?,
        }
        Ok(own.join(name))
    };
    let binary = make().map_err(|uncopied| {
        let _ = std::fs::remove_dir_all(&next); // what stays goes with the next swap, or with the station
        match uncopied {
            Uncopied::Engine(why) => format!("{} {why}", binary.display()),
            Uncopied::Copy(error) => refuse(&folder, error),
        }
    })?;
    Ok(Kept { binary, _in_use: Some(in_use) })
}

/// Why there is no copy.
#[derive(Debug)]
enum Uncopied {
    /// Of the file that was to be copied, in words.
    Engine(String),
    /// What the system said of the copy.
    Copy(Error),
}

impl From<Error> for Uncopied {
    fn from(error: Error) -> Uncopied {
        Uncopied::Copy(error)
    }
}

/// Opens an engine that is to be copied; gives its length, too. What has come into its place since it was verified may be a pipe or a device, which would be
/// waited for, or have no end.
fn open_engine(binary: &Path) -> Result<(File, u64), String> {
    let opened = File::options().read(true).custom_flags(OFlags::NONBLOCK.bits() as i32).open(binary);
    let found = opened.and_then(|file| file.metadata().map(|about| (file, about)));
    let (file, about) = found.map_err(|error| format!("{}: {error}", binary.display()))?;
    match about.is_file() {
        true => Ok((file, about.len())),
        false => Err(format!("{} is no file; name the engine's binary", binary.display())),
    }
}

/// Whether a copy leaves a station that works beside it room to go on: where /dev/shm is full whoever wants memory there ends, and a program with all that a
/// debugger reads may be larger than the station.
fn leaves_room(bytes: u64, free_bytes: u64) -> bool {
    bytes <= free_bytes / 2
}

/// Opens the folder of the copies for one who is about to need one, after what nobody needs was removed.
fn open(station: &Station, folder: &Path) -> std::io::Result<File> {
    std::fs::create_dir_all(folder)?;
    let opened = File::open(folder)?;
    if opened.try_lock().is_ok() {
        forget(station);
        opened.unlock()?;
    }
    let deadline_ns = system::now_ns() + REMOVED_WITHIN_NS;
    while opened.try_lock_shared().is_err() {
        if system::now_ns() >= deadline_ns {
            return Err(Error::other("another swap holds it; try again"));
        }
        system::sleep_ns(LOOK_NS);
    }
    Ok(opened)
}

/// Copies a program of so many bytes, for which there is room; gives the hash of what is in the copy, whatever the file is by now. The copy has a mode of its own:
/// who runs the station alone may run it, or write into it, and it runs as nobody else, whatever the file's bits of user and group say.
fn write(engine: &mut File, bytes: u64, to: &Path, given_up: &dyn Fn() -> bool) -> Result<u64, Uncopied> {
    let (mut copy, mut content, mut piece, mut left) = (File::create_new(to)?, NOTHING, vec![0; PIECE], bytes);
    while !given_up() {
        let count = engine.read(&mut piece).map_err(|error| Uncopied::Engine(format!("cannot be read: {error}")))?;
        if count == 0 && left == 0 {
            copy.set_permissions(Permissions::from_mode(OWNERS_MODE))?;
            return Ok(content);
        }
        let Some(rest) = left.checked_sub(count as u64).filter(|_| count > 0) else {
            let text = format!("is being written: it had {bytes} bytes when its copy began; swap it in once it is built");
            return Err(Uncopied::Engine(text));
        };
        left = rest;
        copy.write_all(&piece[..count])?;
        content = hash(content, &piece[..count]);
    }
    Err(Uncopied::Engine("was given up before it was copied".into()))
}

/// The hash of no bytes.
const NOTHING: u64 = 0xcbf2_9ce4_8422_2325;

/// FNV-1a, from the hash of what came before.
fn hash(before: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(before, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3))
}

/// Whether a binary is a station's copy.
pub fn is_copy(path: &Path) -> bool {
    path.ancestors().nth(2).is_some_and(|above| above.ends_with("engines")) && path.with_file_name(FROM).is_file()
}

/// The file that a copy is from; the path itself if it is no copy.
pub fn name_of(path: &Path) -> PathBuf {
    let from = is_copy(path).then(|| std::fs::read_to_string(path.with_file_name(FROM)).ok()).flatten();
    from.map_or_else(|| path.to_path_buf(), PathBuf::from)
}

/// Removes the copies that neither the plan nor the newest swap names; none, if one of the two cannot be read.
fn forget(station: &Station) {
    let mut named = String::new();
    for file in [station.plan(), station.swap()] {
        match std::fs::read_to_string(file) {
            Ok(text) => named.push_str(&text),
            Err(error) if error.kind() == ErrorKind::NotFound => {} // nothing was swapped yet
            Err(_) => return,
        }
    }
    for entry in std::fs::read_dir(folder(station)).into_iter().flatten().flatten() {
        if entry.file_name().to_str().is_none_or(|name| !named.contains(name)) {
            let _ = std::fs::remove_dir_all(entry.path()); // what stays goes with the station
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A station with a folder for a developer's files.
    fn station(name: &str) -> (Station, PathBuf) {
        let station = Station::named(&format!("t{}-{name}", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let work = station.root().join("work");
        std::fs::create_dir(&work).unwrap();
        (station, work)
    }

    fn copied(station: &Station, binary: &Path) -> PathBuf {
        copy(station, binary, &|| false).unwrap().binary
    }

    /// Whether a copy goes with a swap. A child of another test has this one's files, their locks too, until it has become another program: then the next swap
    /// removes it.
    fn is_removed_by_swap(station: &Station, binary: &Path, copy: &Path) -> bool {
        let deadline_ns = system::now_ns() + 60_000_000_000;
        loop {
            copied(station, binary);
            if !copy.exists() || system::now_ns() >= deadline_ns {
                return !copy.exists();
            }
            system::sleep_ns(LOOK_NS);
        }
    }

    #[test]
    fn a_copy_stays_what_it_was_is_called_by_its_first_name_and_goes_when_nobody_needs_it() {
        let (station, work) = station("kept");
        let mine = work.join("my-fluid");
        std::fs::write(&mine, "good").unwrap();
        let good = copied(&station, &mine);
        assert_eq!(copied(&station, &mine), good, "the same is kept once");
        std::fs::write(station.plan(), format!("swapped.fluid = {good:?}")).unwrap();
        std::fs::write(&mine, "bad").unwrap();
        let bad = copied(&station, &mine);
        assert_ne!(good, bad);
        assert_eq!([&good, &bad].map(|copy| std::fs::read_to_string(copy).unwrap()), ["good", "bad"]);
        assert_eq!([&good, &bad].map(|copy| name_of(copy)), [mine.clone(), mine.clone()]);
        assert!(is_copy(&good) && !is_copy(&mine) && name_of(&mine) == mine);
        std::fs::write(station.swap(), format!("{{\"binary\":{bad:?}}}")).unwrap();
        std::fs::write(&mine, "better").unwrap();
        let better = copied(&station, &mine);
        assert!(good.exists() && bad.exists(), "the plan names one, and the newest swap the other");
        std::fs::write(station.plan(), "").unwrap();
        std::fs::write(&mine, "best").unwrap();
        assert!(is_removed_by_swap(&station, &mine, &good), "nobody runs the first any more");
        assert!(bad.exists() && !better.exists(), "of the third no swap came");
        assert!(copy(&station, &work.join("absent"), &|| false).unwrap_err().contains("absent"));
        station.wipe();
    }

    /// It had the file's: a copy of what runs as its owner ran as its owner, too.
    #[test]
    fn a_copy_is_its_owners_whatever_mode_the_file_has() {
        let (station, work) = station("mode");
        let mine = work.join("mine");
        for mode in [0o6755, 0o4711, 0o777, 0o500] {
            std::fs::write(&mine, format!("of mode {mode:o}")).unwrap();
            std::fs::set_permissions(&mine, Permissions::from_mode(mode)).unwrap();
            let copy = copied(&station, &mine);
            assert_eq!(std::fs::metadata(&copy).unwrap().permissions().mode() & 0o7777, OWNERS_MODE, "{mode:o}");
            std::fs::remove_file(&mine).unwrap();
        }
        station.wipe();
    }

    #[test]
    fn a_copy_stays_for_as_long_as_its_owner_has_not_been_answered_whoever_else_swaps() {
        let (station, work) = station("asks");
        let (mine, other) = (work.join("mine"), work.join("other"));
        std::fs::write(&mine, "mine").unwrap();
        std::fs::write(&other, "other").unwrap();
        let unfinished = folder(&station).join("1-1.next");
        std::fs::create_dir_all(&unfinished).unwrap();
        let asks = copy(&station, &mine, &|| false).unwrap();
        assert!(!unfinished.exists(), "of one that was cut off");
        let first = copied(&station, &other);
        let second = copied(&station, &other);
        assert!(asks.binary().exists() && first == second);
        let gone = asks.binary().to_path_buf();
        drop(asks);
        assert!(is_removed_by_swap(&station, &other, &gone), "he asked, and no swap came of it");
        station.wipe();
    }

    /// It was copied until there was no room left, beside a trainee.
    #[test]
    fn what_takes_most_of_the_room_that_a_station_has_is_refused_and_nothing_of_it_copied() {
        assert!(leaves_room(500, 1_000) && !leaves_room(501, 1_000));
        let (station, work) = station("large");
        let large = work.join("large");
        let bytes = system::free_bytes(station.root()).unwrap() / 4 * 3;
        File::create(&large).unwrap().set_len(bytes).unwrap(); // a hole, which takes none itself
        let refused = copy(&station, &large, &|| false).unwrap_err();
        assert!(refused.contains("a copy may take half") && refused.contains("strip"), "{refused}");
        assert_eq!(std::fs::read_dir(folder(&station)).unwrap().count(), 0);
        station.wipe();
    }

    /// What came into the place of a verified file was copied until /dev/shm was full, or waited for until somebody wrote into it.
    #[test]
    fn what_is_no_file_any_more_is_neither_waited_for_nor_copied() {
        let (station, work) = station("exchanged");
        let pipe = work.join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.is_ok_and(|status| status.success()), "mkfifo, of coreutils");
        let (tell, told) = std::sync::mpsc::channel();
        for binary in [pipe, PathBuf::from("/dev/zero"), work] {
            let (station, tell) = (station.clone(), tell.clone());
            std::thread::spawn(move || tell.send(copy(&station, &binary, &|| false).unwrap_err()));
            let refused = told.recv_timeout(std::time::Duration::from_secs(60)).expect("it waits for a writer");
            assert!(refused.contains("is no file"), "{refused}");
        }
        assert_eq!(std::fs::read_dir(folder(&station)).unwrap().count(), 0);
        station.wipe();
    }

    /// One to which a linker still wrote was copied as far as it came, and so was one that had become larger than there was room for. Ctrl-C did nothing meanwhile.
    #[test]
    fn a_copy_has_as_many_bytes_as_there_was_room_for_and_ends_when_it_is_given_up() {
        let (station, work) = station("length");
        let (mine, whole) = (work.join("mine"), 2 * PIECE as u64 + 1);
        std::fs::write(&mine, vec![7; 2 * PIECE + 1]).unwrap();
        let written = |to: &str, bytes: u64, most_looks: u32| {
            let (looks, to) = (std::cell::Cell::new(0), work.join(to));
            let given_up = || looks.replace(looks.get() + 1) >= most_looks;
            let written = write(&mut File::open(&mine).unwrap(), bytes, &to, &given_up);
            let why = written.err().map(|uncopied| match uncopied {
                Uncopied::Engine(why) => why,
                Uncopied::Copy(error) => panic!("{error}"),
            });
            (why.unwrap_or_default(), std::fs::metadata(&to).unwrap().len())
        };
        assert_eq!(written("whole", whole, 9), (String::new(), whole));
        let piece = PIECE as u64;
        for (to, bytes, copied) in [("longer", whole + 1, whole), ("shorter", piece, piece), ("empty", 0, 0)] {
            let (why, length) = written(to, bytes, 9);
            let is_said = why.starts_with(&format!("is being written: it had {bytes} bytes"));
            assert!(is_said && length == copied, "{to}: {why}, {length}");
        }
        assert_eq!(written("given-up", whole, 1), ("was given up before it was copied".into(), piece));
        let refused = copy(&station, &mine, &|| true).unwrap_err();
        assert!(refused.ends_with("mine was given up before it was copied"), "{refused}");
        assert_eq!(std::fs::read_dir(folder(&station)).unwrap().count(), 0);
        station.wipe();
    }

    /// What both programs agreed on was not the station's.
    #[test]
    fn a_station_of_another_layout_is_asked_for_no_swap() {
        let (station, _) = station("foreign");
        let mut page = std::fs::read(station.station_page()).unwrap();
        page.iter_mut().for_each(|byte| *byte ^= 0x55);
        std::fs::write(station.station_page(), page).unwrap();
        let refused = keep(&station, Path::new("/bin/true"), Role::Fluid, &|| false).unwrap_err();
        assert!(refused.contains("another build than this program"), "{refused}");
        station.wipe();
    }

    #[test]
    fn what_is_no_engine_is_refused_and_not_copied() {
        let (station, work) = station("none");
        let script = work.join("script");
        std::fs::write(&script, "#!/bin/sh\n").unwrap();
        assert!(keep(&station, &script, Role::Fluid, &|| false).unwrap_err().contains("chmod +x"));
        assert!(keep(&station, Path::new("/bin/true"), Role::Fluid, &|| false).unwrap_err().contains("is it an engine?"));
        assert!(!folder(&station).exists());
        station.wipe();
    }
}
