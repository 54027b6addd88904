//! Recordings that are longer than memory: no more than a batch of blocks is read ahead, and a place in a file needs more than 32 bits.

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{Folder, block, session, ticks, write};
use hyst_recording::{Ending, Playback, Reader, Recording, Writer};
use std::cell::Cell;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::os::unix::fs::FileExt;
use std::rc::Rc;

/// Blocks of the long file, and ticks of each.
const BLOCKS: u64 = 320;
const TICKS: u64 = 50;
/// Most blocks that a reader holds at once, which is its own bound.
const BATCH: usize = 16;

/// A file that counts what is read of it.
struct Counted {
    file: File,
    read_bytes: Rc<Cell<u64>>,
}

impl Read for Counted {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(into)?;
        self.read_bytes.set(self.read_bytes.get() + read as u64);
        Ok(read)
    }
}

impl Seek for Counted {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

#[test]
fn a_long_file_is_read_to_its_end_and_never_more_than_a_batch_ahead_of_what_was_given() {
    let folder = Folder::new("ahead");
    let mut writer = Writer::open(&folder.file(), &session()).unwrap();
    let ends: Vec<u64> = (0..BLOCKS)
        .map(|part| {
            writer.append(&block(1 + part * TICKS..1 + (part + 1) * TICKS)).unwrap();
            writer.bytes()
        })
        .collect();
    writer.finish().unwrap();
    // The heads of the summary's records, each of which the reader looks at.
    let closing_bytes = 64 << 10;
    assert!(ends[2 * BATCH] + closing_bytes < ends[BLOCKS as usize - 1] / 4, "a file that is read as a whole would not be found");
    for threads in [1, 4] {
        let read_bytes = Rc::new(Cell::new(0));
        let source = Counted { file: File::open(folder.file()).unwrap(), read_bytes: read_bytes.clone() };
        let mut reader = Reader::new(source, &folder.file()).unwrap();
        let (mut given, mut next_tick) = (0, 1);
        reader
            .each_block(threads, |block| {
                let most_bytes = ends[(given + BATCH).min(ends.len() - 1)] + closing_bytes;
                assert!(read_bytes.get() <= most_bytes, "{} bytes were read for block {given}", read_bytes.get());
                assert!(block.applied.iter().map(|record| record.tick).eq(next_tick..next_tick + TICKS), "block {given}");
                (given, next_tick) = (given + 1, next_tick + TICKS);
            })
            .unwrap();
        assert_eq!((given as u64, reader.ending(), reader.damage().len()), (BLOCKS, Some(Ending::Complete), 0));
    }
}

/// A file with holes, so that it takes no room: between two blocks lie records of a kind that no recorder writes, one after the other for 100 GB.
#[test]
fn a_block_behind_100_gb_is_found_read_and_gone_on_from() {
    const HOLE_BYTES: u64 = 60 << 20;
    const ATTACHMENT: u8 = 9;
    let folder = Folder::new("far");
    let [first, _] = [1u64, 4].map(|first| write(&folder.file(), &[block(first..first + 3)]).bytes());
    let bytes = std::fs::read(folder.file()).unwrap();
    let (before, behind) = bytes.split_at(first as usize);
    let file = File::create(folder.file()).unwrap();
    file.write_all_at(before, 0).unwrap();
    let (mut at, mut records) = (first, 0);
    while at < 100_000_000_000 {
        file.write_all_at(&[ATTACHMENT], at).unwrap();
        file.write_all_at(&HOLE_BYTES.to_le_bytes(), at + 1).unwrap();
        (at, records) = (at + 9 + HOLE_BYTES, records + 1);
    }
    file.write_all_at(behind, at).unwrap();
    drop(file);
    let recording = Recording::read(&folder.file()).unwrap();
    let end = at + behind.len() as u64;
    assert_eq!((ticks(&recording), recording.ending), ((1..7).collect::<Vec<_>>(), Ending::Cut { at: end }));
    assert!(records > 1_000 && recording.damage.len() == 1_000, "the first thousand of {records} are told");

    let mut writer = Writer::open(&folder.file(), &session()).unwrap();
    assert_eq!((writer.last_tick(), writer.bytes()), (Some(6), end));
    writer.append(&block(7..10)).unwrap();
    writer.finish().unwrap();
    let recording = Recording::read(&folder.file()).unwrap();
    assert_eq!((ticks(&recording), recording.ending), ((1..10).collect::<Vec<_>>(), Ending::Complete));
    let mut playback = Playback::open(&folder.file()).unwrap();
    playback.skip_to(7).unwrap();
    let moment = playback.at(7).unwrap().unwrap();
    assert_eq!(moment.applied.map(|record| record.tick), Some(7));
}
