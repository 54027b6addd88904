//! Bytes that flip in shared memory, as a bug in any process or a bad bit could flip them: written with ordinary file I/O into the files that the
//! processes have mapped, so that each sees them at once.
//!
//! Which bytes, and to what, follows from a seed alone, as far as the files are the same. Holes are left alone: what was never written is read by
//! nobody.
//!
//! Promise: whoever asks is not held up by how many there are. The main loop of the supervisor, for which each death waits, flips the first ones, with two system
//! calls for each at most; the rest is a thread's, an ordinary one, which comes after all that is real time.

use crate::campaign::draw::Draw;
use crate::faultfile::{DEFAULT_BYTES, Injection, Place};
use hyst_exchange::{Station, checkpoint, mappings, system};
use hyst_messages::Slot;
use rustix::fs::SeekFrom;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::channel;
use std::thread::{Builder, JoinHandle};

/// Extents of one file that are looked at: a segment's used messages lie together.
const MOST_EXTENTS: usize = 4_096;

/// Most bytes whose fate is followed.
const MOST_FOLLOWED: usize = 64;
/// Most that are flipped before the answer: two system calls of half a microsecond each are 4 ms, less than the main loop's period.
const AT_ONCE: u32 = 4_096;
/// Flips that are brought into the order of their places together: 1.5 MiB.
const BATCH: u32 = 1 << 16;
/// Stack of the thread that flips the last, bytes: a supervisor with locked memory has all of it brought in at once.
const STACK: usize = 256 << 10;

/// A byte that was flipped.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Flip {
    path: PathBuf,
    at: u64,
    /// What it became.
    byte: u8,
}

impl Flip {
    /// Whether it lies in this file.
    pub(crate) fn is_in(&self, file: &Path) -> bool {
        self.path == file
    }
}

/// What became of the bytes that were flipped, the first of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Remains {
    /// Their owner has written something else there.
    pub written_over: u32,
    /// They are as they were flipped.
    pub still_there: u32,
    /// Their file is gone.
    pub gone: u32,
}

/// Looks what became of bytes that were flipped.
pub(crate) fn remains(flips: &[Flip]) -> Remains {
    let mut found = Remains::default();
    for flip in flips {
        let mut byte = [0u8];
        match File::open(&flip.path).and_then(|file| file.read_exact_at(&mut byte, flip.at)) {
            Ok(()) if byte[0] == flip.byte => found.still_there += 1,
            Ok(()) => found.written_over += 1,
            Err(_) => found.gone += 1,
        }
    }
    found
}

/// Flips the bytes of an injection; gives what was done, in words, and the first of them.
pub(crate) fn corrupt(
    station: &Station,
    slot: Slot,
    incarnation: u32,
    pid: u32,
    injection: &Injection,
) -> Result<(String, Vec<Flip>), String> {
    let place = injection.place.unwrap_or(Place::Page);
    let files = match place {
        Place::Page => vec![station.slot_page(slot, incarnation)],
        Place::Station => vec![station.station_page()],
        Place::Roster => vec![station.roster_page()],
        Place::Checkpoint => vec![checkpoint::path(station, slot)],
        Place::Stream => mapped(pid, &station.prefix(), ".data", "rw-s"),
        Place::Link => mapped(pid, &station.prefix(), ".connection", "rw-s"),
    };
    if files.is_empty() {
        return Err(format!("{slot} has no segment of that kind mapped now; wait until its readers are there"));
    }
    // Another one each time that none is named: the same bytes, flipped once more, would be as they were before.
    let (bytes, seed) = (injection.bytes.unwrap_or(DEFAULT_BYTES), injection.seed.unwrap_or_else(system::now_ns));
    let (flips, rest) = flip(&files, seed, bytes).map_err(|(path, error)| format!("{}: {error}", path.display()))?;
    let clock_waits = station.open().is_ok_and(|page| page.is_lockstep()); // and nobody is late meanwhile
    rest.into_iter().filter(|_| clock_waits).for_each(|rest| drop(rest.join()));
    let Some(first) = flips.first().map(|flip| described(&flip.path, flip.at)) else {
        return Err(format!("{slot} has nothing there yet that was ever written; wait until it has"));
    };
    Ok((format!("{bytes} bytes of seed {seed} in {} files, the first at {first}", files.len()), flips))
}

/// The files in shared memory that a process has mapped with these rights, in the order of their names.
fn mapped(pid: u32, prefix: &str, ending: &str, rights: &str) -> Vec<PathBuf> {
    let files = mappings::of_process(pid, prefix, ending).into_iter().filter(|mapping| mapping.rights == rights);
    files.map(|mapping| mapping.path).collect::<BTreeSet<_>>().into_iter().collect()
}

/// What was ever written of some files, one part behind the other, as if it were one.
#[derive(Default)]
struct Written {
    files: Vec<(PathBuf, File)>,
    /// In the order of their beginnings.
    parts: Vec<Part>,
    /// Bytes of all of them.
    total: u64,
}

/// A part of a file that was ever written.
struct Part {
    /// Where it begins in all of them together.
    begin: u64,
    /// In which file it lies.
    file: usize,
    /// Where it begins there.
    start: u64,
}

/// A file that cannot be read or written.
type Failed = (PathBuf, std::io::Error);

impl Written {
    fn of(paths: &[PathBuf]) -> Result<Written, Failed> {
        let mut written = Written::default();
        for path in paths {
            let failed = |error| (path.clone(), error);
            let file = File::options().read(true).write(true).open(path).map_err(failed)?;
            for extent in extents(&file).map_err(failed)? {
                written.parts.push(Part { begin: written.total, file: written.files.len(), start: extent.start });
                written.total += extent.end - extent.start;
            }
            written.files.push((path.clone(), file));
        }
        Ok(written)
    }

    /// The next byte that is flipped: in which file, where, and by what; `None` if nothing was ever written.
    fn draw(&self, draw: &mut Draw) -> Option<(usize, u64, u8)> {
        let (at, change) = (draw.between(0, self.total.saturating_sub(1)), draw.between(1, 255) as u8);
        let part = self.parts[..self.parts.partition_point(|part| part.begin <= at)].last()?;
        Some((part.file, part.start + (at - part.begin), change))
    }

    /// Flips those that are drawn next, a batch after the other, each in the order of their places: what lies side by side is read and written at once. What
    /// cannot be any more has gone with its owner.
    fn flip(&self, draw: &mut Draw, mut left: u32) {
        let mut bytes = Vec::new();
        while left > 0 {
            let count = left.min(BATCH);
            left -= count;
            let mut batch: Vec<(usize, u64, u8)> = (0..count).filter_map(|_| self.draw(draw)).collect();
            batch.sort_unstable();
            for run in batch.chunk_by(|(file, at, _), (next_file, next, _)| file == next_file && *next <= at + 1) {
                let ((index, start, _), (_, last, _)) = (run[0], run[run.len() - 1]);
                let file = &self.files[index].1;
                bytes.resize((last - start + 1) as usize, 0u8);
                if file.read_exact_at(&mut bytes, start).is_ok() {
                    run.iter().for_each(|(_, at, change)| bytes[(at - start) as usize] ^= change);
                    let _ = file.write_all_at(&bytes, start); // likewise
                }
            }
        }
    }
}

/// Flips so many bytes of all of them together; gives the first ones, and who flips the last.
fn flip(paths: &[PathBuf], seed: u64, bytes: u32) -> Result<(Vec<Flip>, Option<JoinHandle<()>>), Failed> {
    let written = Arc::new(Written::of(paths)?);
    let mut draw = Draw::new(seed);
    let (followed, at_once) = (bytes.min(MOST_FOLLOWED as u32), bytes.min(AT_ONCE));
    // There before anything is flipped: a fault that cannot be done as a whole is not begun.
    let (go_on, gate) = channel::<Draw>();
    let rest = (bytes > at_once).then(|| {
        let written = Arc::clone(&written);
        let body = move || gate.recv().into_iter().for_each(|mut draw| written.flip(&mut draw, bytes - at_once));
        Builder::new().name("flips".into()).stack_size(STACK).spawn(body)
    });
    let rest = rest.transpose().map_err(|error| (paths.first().cloned().unwrap_or_default(), error))?;
    let mut flips = Vec::new();
    for _ in 0..followed {
        let Some((index, at, change)) = written.draw(&mut draw) else { break };
        let (path, file) = &written.files[index];
        let byte = flip_byte(file, at, change).map_err(|error| (path.clone(), error))?;
        flips.push(Flip { path: path.clone(), at, byte });
    }
    written.flip(&mut draw, at_once - followed);
    let _ = go_on.send(draw); // nobody waits for it if these are all
    Ok((flips, rest))
}

fn described(path: &Path, place: u64) -> String {
    format!("{place} of {}", path.file_name().unwrap_or_default().to_string_lossy())
}

/// Gives what it became.
fn flip_byte(file: &File, place: u64, change: u8) -> std::io::Result<u8> {
    let mut byte = [0u8];
    file.read_exact_at(&mut byte, place)?;
    file.write_all_at(&[byte[0] ^ change], place)?;
    Ok(byte[0] ^ change)
}

/// The parts of a file that were ever written.
fn extents(file: &File) -> std::io::Result<Vec<Range<u64>>> {
    let mut found = Vec::new();
    let mut at = 0;
    while found.len() < MOST_EXTENTS {
        let Ok(start) = rustix::fs::seek(file, SeekFrom::Data(at)) else { break }; // no data behind it
        let end = rustix::fs::seek(file, SeekFrom::Hole(start))?;
        found.push(start..end);
        at = end;
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("corrupt-{}-{name}", std::process::id()))
    }

    /// All of them, whoever flips which; gives the first.
    fn flip_all(paths: &[PathBuf], seed: u64, bytes: u32) -> Vec<Flip> {
        let (flips, rest) = flip(paths, seed, bytes).unwrap();
        assert_eq!(rest.is_some(), bytes > AT_ONCE, "who flips the last");
        rest.into_iter().for_each(|rest| rest.join().unwrap());
        flips
    }

    fn changed(before: &[u8], after: &[u8]) -> Vec<(usize, u8)> {
        let pairs = before.iter().zip(after).enumerate();
        pairs.filter(|(_, (old, new))| old != new).map(|(at, (old, new))| (at, old ^ new)).collect()
    }

    #[test]
    fn a_seed_flips_the_same_bytes_and_each_seed_others() {
        let path = file("seed");
        let flipped = |seed: u64| {
            std::fs::write(&path, vec![7u8; 60_000]).unwrap();
            flip_all(std::slice::from_ref(&path), seed, 20);
            changed(&vec![7u8; 60_000], &std::fs::read(&path).unwrap())
        };
        let first = flipped(5);
        assert!((15..=20).contains(&first.len()), "two may have hit one byte: {first:?}");
        assert_eq!(first, flipped(5));
        assert_ne!(first, flipped(6));
        std::fs::remove_file(&path).unwrap();
    }

    /// The supervisor's main loop flipped a mebibyte byte by byte, for seconds in which a death waited for it.
    #[test]
    fn however_many_bytes_a_seed_flips_they_are_those_that_it_flips_one_by_one() {
        let (paths, sizes) = ([file("first"), file("second")], [90_112usize, 28_672]);
        let total = sizes[0] + sizes[1];
        for bytes in [MOST_FOLLOWED as u32, AT_ONCE, AT_ONCE + 1, AT_ONCE + 2 * BATCH + 70_000] {
            paths.iter().zip(sizes).for_each(|(path, size)| std::fs::write(path, vec![7u8; size]).unwrap());
            let flips = flip_all(&paths, 5, bytes);
            let (mut draw, mut expected, mut first) = (Draw::new(5), vec![7u8; total], Vec::new());
            for _ in 0..bytes {
                let (at, change) = (draw.between(0, total as u64 - 1) as usize, draw.between(1, 255) as u8);
                expected[at] ^= change;
                first.push(if at < sizes[0] { (&paths[0], at as u64) } else { (&paths[1], (at - sizes[0]) as u64) });
            }
            first.truncate(MOST_FOLLOWED);
            assert_eq!(flips.iter().map(|flip| (&flip.path, flip.at)).collect::<Vec<_>>(), first);
            let found: Vec<u8> = paths.iter().flat_map(|path| std::fs::read(path).unwrap()).collect();
            assert!(found == expected && found != vec![7u8; total], "{bytes}");
        }
        paths.iter().for_each(|path| std::fs::remove_file(path).unwrap());
    }

    #[test]
    fn a_byte_is_still_there_or_written_over_or_gone_with_its_file() {
        let path = file("fate");
        std::fs::write(&path, vec![7u8; 1 << 20]).unwrap();
        let flips = flip_all(std::slice::from_ref(&path), 5, 100);
        assert_eq!((flips.len(), remains(&flips)), (MOST_FOLLOWED, Remains { still_there: 64, ..Remains::default() }));
        File::options().write(true).open(&path).unwrap().write_all_at(&[7], flips[0].at).unwrap();
        assert_eq!(remains(&flips), Remains { written_over: 1, still_there: 63, gone: 0 });
        std::fs::remove_file(&path).unwrap();
        assert_eq!(remains(&flips), Remains { gone: 64, ..Remains::default() });
    }

    #[test]
    fn holes_are_left_alone_and_two_files_are_hit_by_their_size() {
        let paths = [file("large"), file("small")];
        let large = File::create(&paths[0]).unwrap();
        large.set_len(64 << 20).unwrap();
        large.write_all_at(&[1; 40_960], 32 << 20).unwrap();
        std::fs::write(&paths[1], vec![1u8; 4_096]).unwrap();
        let used: u64 = extents(&File::open(&paths[0]).unwrap()).unwrap().iter().map(|extent| extent.end - extent.start).sum();
        assert!((40_960..=81_920).contains(&used), "{used} of 64 MiB");
        flip_all(&paths, 1, 200);
        let small = changed(&[1; 4_096], &std::fs::read(&paths[1]).unwrap()).len();
        assert!((5..=40).contains(&small), "{small} of 200 in a tenth or less");
        for path in paths {
            std::fs::remove_file(path).unwrap();
        }
    }

    /// By the same seed for whoever named none the second fault put right what the first had done.
    #[test]
    fn who_names_no_seed_flips_other_bytes_each_time_and_what_is_empty_is_refused() {
        let station = Station::named(&format!("t{}-seedless", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let slot = Slot::first(hyst_messages::Role::Fluid);
        let _own = station.create_slot(slot, 1).unwrap();
        let page = || std::fs::read(station.slot_page(slot, 1)).unwrap();
        let twice = |place: Place, seed: Option<u64>| {
            let injection =
                Injection { place: Some(place), seed, ..Injection::now(crate::faultfile::FaultKind::Corrupt, "fluid:0") };
            let said = || corrupt(&station, slot, 1, 0, &injection).map(|(said, _)| said);
            (said(), said())
        };
        let before = page();
        assert!(twice(Place::Page, Some(3)).0.is_ok_and(|said| said.starts_with("16 bytes of seed 3 in 1 files")));
        assert_eq!(page(), before, "as they were");
        let (first, second) = twice(Place::Page, None);
        assert!(first.is_ok() && second.is_ok() && page() != before);
        std::fs::write(checkpoint::path(&station, slot), "").unwrap();
        assert!(twice(Place::Checkpoint, None).0.unwrap_err().contains("ever written"));
        station.wipe();
    }

    #[test]
    fn only_the_own_segments_of_a_process_are_found() {
        let prefix = format!("corrupt{}_", std::process::id());
        assert_eq!(mapped(std::process::id(), &prefix, ".data", "rw-s"), Vec::<PathBuf>::new());
        assert_eq!(mapped(0, "", "", "rw-s"), Vec::<PathBuf>::new());
    }
}
