//! A recording that is decoded ahead of who takes it is the one that is read block by block: the same messages in the same order, the same damage, the same end,
//! whole or cut, with bytes flipped, full of what is nobody's, and from a disk that fails.

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{Folder, block, write};
use hyst_recording::{Block, Damage, Ending, Reader, TickRange};
use std::io::{self, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

/// What is told of a file, and why that is not all.
#[derive(Debug, PartialEq)]
struct Told {
    blocks: Vec<Block>,
    damage: Vec<Damage>,
    ending: Option<Ending>,
    refused: Option<String>,
}

fn told<R: Read + Seek>(source: R, read: impl FnOnce(&mut Reader<R>, &mut Vec<Block>) -> Option<String>) -> Told {
    let mut reader = Reader::new(source, Path::new("memory")).unwrap();
    let mut blocks = Vec::new();
    let refused = read(&mut reader, &mut blocks);
    // States are looked at and not given where blocks are decoded ahead.
    blocks.iter_mut().for_each(|block: &mut Block| block.checkpoints.clear());
    Told { blocks, damage: reader.damage().to_vec(), ending: reader.ending(), refused }
}

fn one_by_one(source: impl Read + Seek) -> Told {
    told(source, |reader, blocks| {
        loop {
            match reader.next_block() {
                Ok(Some(block)) => blocks.push(block),
                Ok(None) => return None,
                Err(error) => return Some(error.to_string()),
            }
        }
    })
}

fn ahead(source: impl Read + Seek, threads: usize) -> Told {
    told(source, |reader, blocks| reader.each_block(threads, |block| blocks.push(block)).err().map(|error| error.to_string()))
}

/// Compares the two; what was told.
fn is_the_same<R: Read + Seek>(source: impl Fn() -> R, what: &str) -> Told {
    let expected = one_by_one(source());
    for threads in [0, 1, 2, 5] {
        let found = ahead(source(), threads);
        assert!(found == expected, "{what}, {threads} threads: {found:?} and not {expected:?}");
    }
    expected
}

/// The bytes of a recording of so many blocks, one of which names ticks that were lost.
fn bytes(name: &str, count: u64) -> Vec<u8> {
    let folder = Folder::new(name);
    let mut blocks: Vec<Block> = (0..count).map(|part| block(1 + 4 * part..5 + 4 * part)).collect();
    blocks[count as usize / 2].lost.push(TickRange { first: 2, last: 3 });
    write(&folder.file(), &blocks).finish().unwrap();
    std::fs::read(folder.file()).unwrap()
}

#[test]
fn a_whole_recording_is_the_same() {
    let whole = bytes("ahead-whole", 60);
    let told = is_the_same(|| Cursor::new(&whole), "whole");
    assert_eq!((told.blocks.len(), told.damage.len(), told.ending), (61, 0, Some(Ending::Complete)));
    assert!(told.blocks.iter().flat_map(|block| &block.applied).map(|record| record.tick).eq(1..=240));
}

#[test]
fn a_recording_that_was_cut_is_the_same() {
    let whole = bytes("ahead-cut", 20);
    // Its facts are there.
    for length in (whole.len() / 8..whole.len()).step_by(211).chain([whole.len() - 1]) {
        let told = is_the_same(|| Cursor::new(&whole[..length]), &format!("cut at {length}"));
        assert!(matches!(told.ending, Some(Ending::Cut { .. })), "{length}: {:?}", told.ending);
    }
}

#[test]
fn a_recording_with_flipped_bytes_is_the_same() {
    let whole = bytes("ahead-flip", 20);
    let mut damaged = 0;
    for at in (whole.len() / 8..whole.len()).step_by(101) {
        let mut bad = whole.clone();
        bad[at] ^= 1 << (at % 8);
        damaged += usize::from(!is_the_same(|| Cursor::new(&bad), &format!("byte {at}")).damage.is_empty());
    }
    assert!(damaged > 20, "{damaged}");
}

#[test]
fn of_more_damage_than_is_told_it_is_the_same_thousand() {
    const ATTACHMENT: [u8; 10] = [9, 1, 0, 0, 0, 0, 0, 0, 0, 7];
    let folder = Folder::new("ahead-odd");
    let ends: Vec<usize> =
        (0..20u64).map(|part| write(&folder.file(), &[block(1 + 4 * part..5 + 4 * part)]).bytes() as usize).collect();
    let whole = std::fs::read(folder.file()).unwrap();
    let mut odd = whole[..ends[0]].to_vec();
    for pair in ends.windows(2) {
        odd.extend(ATTACHMENT.repeat(97));
        let begin = odd.len();
        odd.extend(&whole[pair[0]..pair[1]]);
        odd[begin + 200] ^= 4; // in what is compressed of the chunk
    }
    let told = is_the_same(|| Cursor::new(&odd), "odd");
    assert_eq!((told.blocks.len(), told.damage.len()), (1, 1_000));
    let is_of_a_block = |damage: &Damage| !damage.reason.contains("no recorder writes");
    assert!(told.damage.is_sorted_by_key(|damage| damage.at) && told.damage.iter().any(is_of_a_block));
}

/// A disk that gives nothing from a byte on.
struct Failing<'a>(Cursor<&'a [u8]>, u64);

impl Read for Failing<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let room = self.1.saturating_sub(self.0.position());
        if room == 0 {
            return Err(io::Error::other("the disk is gone"));
        }
        let most = buffer.len().min(room as usize);
        self.0.read(&mut buffer[..most])
    }
}

impl Seek for Failing<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.0.seek(to)
    }
}

#[test]
fn before_a_disk_that_fails_it_is_the_same() {
    let whole = bytes("ahead-failing", 40);
    for from in (whole.len() / 8..whole.len() * 3 / 4).step_by(997) {
        let told = is_the_same(|| Failing(Cursor::new(&whole[..]), from as u64), &format!("from {from}"));
        let refused = told.refused.unwrap_or_default();
        assert!(refused.contains("the disk is gone") && !told.blocks.is_empty(), "{from}: {refused}");
    }
}

#[test]
fn who_has_had_enough_is_given_no_more() {
    let whole = bytes("ahead-enough", 40);
    let all = one_by_one(Cursor::new(&whole)).blocks;
    let first = &all[..5];
    for threads in [0, 1, 2, 5] {
        let mut given = Vec::new();
        let mut reader = Reader::new(Cursor::new(&whole), Path::new("memory")).unwrap();
        let read = reader.each_block_while(threads, |mut block| {
            block.checkpoints.clear();
            given.push(block);
            given.len() < first.len()
        });
        assert!(read.is_ok() && given == first, "{threads} threads: {} blocks", given.len());
    }
}

#[test]
#[should_panic(expected = "who takes it has had enough")]
fn a_panic_of_who_takes_a_block_is_theirs_and_no_thread_waits_for_ever() {
    let whole = bytes("ahead-panic", 40);
    let mut reader = Reader::new(Cursor::new(&whole), Path::new("memory")).unwrap();
    let mut given = 0;
    let _ = reader.each_block(2, |_| {
        given += 1;
        assert!(given < 5, "who takes it has had enough");
    });
}
