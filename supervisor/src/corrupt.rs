//! Bytes that flip in shared memory, as a bug in any process or a bad bit could flip them: written with ordinary file I/O into the files that the
//! processes have mapped, so that each sees them at once.
//!
//! Which bytes, and to what, follows from a seed alone, as far as the files are the same. Holes are left alone: what was never written is read by
//! nobody.

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

/// Extents of one file that are looked at: a segment's used messages lie together.
const MOST_EXTENTS: usize = 4_096;

/// Most bytes whose fate is followed.
const MOST_FOLLOWED: usize = 64;

/// A byte that was flipped.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Flip {
    path: PathBuf,
    at: u64,
    /// What it became.
    byte: u8,
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
    let flips = flip(&files, seed, bytes).map_err(|(path, error)| format!("{}: {error}", path.display()))?;
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

/// Flips so many bytes of all of them together; gives the first ones.
fn flip(files: &[PathBuf], seed: u64, bytes: u32) -> Result<Vec<Flip>, (PathBuf, std::io::Error)> {
    let mut open = Vec::new();
    for path in files {
        let failed = |error| (path.clone(), error);
        let file = std::fs::OpenOptions::new().read(true).write(true).open(path).map_err(failed)?;
        let extents = extents(&file).map_err(failed)?;
        open.extend(extents.into_iter().map(|extent| (path, file.try_clone(), extent)));
    }
    let total: u64 = open.iter().map(|(_, _, extent)| extent.end - extent.start).sum();
    let (mut draw, mut flips) = (Draw::new(seed), Vec::new());
    for _ in 0..bytes {
        let (mut at, change) = (draw.between(0, total.saturating_sub(1)), draw.between(1, 255) as u8);
        for (path, file, extent) in &open {
            let length = extent.end - extent.start;
            if at >= length {
                at -= length;
                continue;
            }
            let place = extent.start + at;
            let file = file.as_ref().map_err(|error| ((*path).clone(), error.kind().into()))?;
            let byte = flip_byte(file, place, change).map_err(|error| ((*path).clone(), error))?;
            flips.push(Flip { path: (*path).clone(), at: place, byte });
            break;
        }
    }
    flips.truncate(MOST_FOLLOWED);
    Ok(flips)
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

    fn changed(before: &[u8], after: &[u8]) -> Vec<(usize, u8)> {
        let pairs = before.iter().zip(after).enumerate();
        pairs.filter(|(_, (old, new))| old != new).map(|(at, (old, new))| (at, old ^ new)).collect()
    }

    #[test]
    fn a_seed_flips_the_same_bytes_and_each_seed_others() {
        let path = file("seed");
        let flipped = |seed: u64| {
            std::fs::write(&path, vec![7u8; 60_000]).unwrap();
            flip(std::slice::from_ref(&path), seed, 20).unwrap();
            changed(&vec![7u8; 60_000], &std::fs::read(&path).unwrap())
        };
        let first = flipped(5);
        assert!((15..=20).contains(&first.len()), "two may have hit one byte: {first:?}");
        assert_eq!(first, flipped(5));
        assert_ne!(first, flipped(6));
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn a_byte_is_still_there_or_written_over_or_gone_with_its_file() {
        let path = file("fate");
        std::fs::write(&path, vec![7u8; 1 << 20]).unwrap();
        let flips = flip(std::slice::from_ref(&path), 5, 100).unwrap();
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
        flip(&paths, 1, 200).unwrap();
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
