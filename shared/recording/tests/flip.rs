//! One flipped bit costs at most the block that it hits, also where a length is hit that then reaches over many blocks of a long file; and whoever goes on in that
//! file cuts nothing of it away.

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{Folder, block, session, ticks, write};
use hyst_messages::Role;
use hyst_recording::{Checkpoint, Ending, Reader, Recording, TickRange, Writer};
use mcap::records::{ChunkIndex, op};
use std::fs::OpenOptions;
use std::io::Cursor;
use std::os::unix::fs::FileExt;
use std::path::Path;

/// Blocks of the file, ticks of each, and the one that is hit: before it and behind it are some megabytes.
const BLOCKS: u64 = 60;
const TICKS: u64 = 2;
const HIT: u64 = 20;
/// Bits of a record's opcode and length.
const HEAD_BITS: usize = 72;
/// Bytes of a chunk's body before its compression's name, and before what is compressed by one of four letters.
const NAME_AT: usize = 28;
const PACKED_AT: usize = 44;

/// A state that no compression makes smaller.
fn noise(seed: u64) -> Vec<u8> {
    let mut state = seed + 1;
    let mut word = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    (0..10_000).flat_map(|_| word().to_le_bytes()).collect()
}

/// The byte of the first record of a kind from one place on.
fn first_of(opcode: u8, bytes: &[u8], from: usize) -> usize {
    let mut at = from;
    while bytes[at] != opcode {
        at += 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    at
}

#[test]
fn a_flipped_bit_in_an_opcode_or_a_length_costs_its_block_alone_and_whoever_goes_on_cuts_nothing_away() {
    let folder = Folder::new("flip-long");
    let ticks_of = |part: u64| 1 + part * TICKS..1 + (part + 1) * TICKS;
    let mut writer = Writer::open(&folder.file(), &session()).unwrap();
    let ends: Vec<u64> = (0..BLOCKS)
        .map(|part| {
            let mut block = block(ticks_of(part));
            block.checkpoints.push(Checkpoint { role: Role::Tissue, tick: block.applied[0].tick, state: noise(part) });
            block.lost.extend((part == HIT).then_some(TickRange { first: 900, last: 901 }));
            writer.append(&block).unwrap();
            writer.bytes()
        })
        .collect();
    drop(writer);
    let whole = std::fs::read(folder.file()).unwrap();
    assert!(whole.len() > 4 << 20, "{} bytes: a length that reaches far would be beyond the end", whole.len());
    let file = OpenOptions::new().write(true).open(folder.file()).unwrap();
    let all: Vec<u64> = (1..1 + BLOCKS * TICKS).collect();
    let others: Vec<u64> = all.iter().copied().filter(|tick| !ticks_of(HIT).contains(tick)).collect();
    for opcode in [op::CHUNK, op::MESSAGE_INDEX, op::METADATA] {
        let at = first_of(opcode, &whole, ends[HIT as usize - 1] as usize);
        assert!((at as u64) < ends[HIT as usize]);
        for bit in 0..HEAD_BITS {
            let byte = at + bit / 8;
            file.write_all_at(&[whole[byte] ^ (1 << (bit % 8))], byte as u64).unwrap();
            let mut reader = Reader::open(&folder.file()).unwrap();
            let mut found: Vec<u64> = Vec::new();
            reader.each_block(1, |block| found.extend(block.applied.iter().map(|record| record.tick))).unwrap();
            assert!(found == all || found == others, "opcode {opcode}, bit {bit}: {} of {} ticks", found.len(), all.len());
            assert_eq!(reader.ending(), Some(Ending::Cut { at: whole.len() as u64 }), "opcode {opcode}, bit {bit}");
            assert!(reader.damage().len() == 1, "opcode {opcode}, bit {bit}: {:?}", reader.damage());
            let writer = Writer::open(&folder.file(), &session()).unwrap();
            let found = (writer.bytes(), writer.last_tick());
            assert_eq!(found, (whole.len() as u64, all.last().copied()), "opcode {opcode}, bit {bit}");
            file.write_all_at(&whole[byte..byte + 1], byte as u64).unwrap();
        }
    }
}

/// The indexes of a chunk that was not known for one any more were taken for those of the chunk before.
#[test]
fn what_follows_a_block_that_is_damaged_is_not_named_as_a_part_of_the_block_before() {
    let folder = Folder::new("flip-index");
    let ends = [1u64, 4, 7, 10].map(|first| write(&folder.file(), &[block(first..first + 3)]).bytes() as usize);
    let mut bytes = std::fs::read(folder.file()).unwrap();
    let named = |bytes: &[u8]| -> Vec<ChunkIndex> {
        std::fs::write(folder.file(), bytes).unwrap();
        write(&folder.file(), &[]).finish().unwrap();
        mcap::Summary::read(&std::fs::read(folder.file()).unwrap()).unwrap().unwrap().chunk_indexes
    };
    let whole = named(&bytes);
    assert_eq!(bytes[ends[1]], op::CHUNK);
    bytes[ends[1]] ^= op::CHUNK ^ op::CHANNEL; // one bit
    assert_eq!(named(&bytes), [0, 1, 3].map(|number: usize| whole[number].clone()));
}

#[test]
fn a_file_whose_chunks_somebody_has_unpacked_is_read_as_ever() {
    let folder = Folder::new("flip-unpacked");
    drop(write(&folder.file(), &[block(1..4), block(4..7)]));
    let bytes = std::fs::read(folder.file()).unwrap();
    let word = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    let (mut unpacked, mut at) = (mcap::MAGIC.to_vec(), mcap::MAGIC.len());
    while at < bytes.len() {
        let (body, end) = (at + 9, at + 9 + word(at + 1));
        match bytes[at] {
            op::MESSAGE_INDEX => {} // of another place
            op::CHUNK => {
                let records = zstd::bulk::decompress(&bytes[body + PACKED_AT..end], word(body + 16)).unwrap();
                unpacked.push(op::CHUNK);
                unpacked.extend(((NAME_AT + 4 + 8 + records.len()) as u64).to_le_bytes());
                unpacked.extend(&bytes[body..body + NAME_AT]);
                unpacked.extend(0u32.to_le_bytes()); // no name
                unpacked.extend((records.len() as u64).to_le_bytes());
                unpacked.extend(records);
            }
            _ => unpacked.extend(&bytes[at..end]),
        }
        at = end;
    }
    let recording = Recording::collect(Reader::new(Cursor::new(&unpacked), Path::new("memory")).unwrap()).unwrap();
    assert_eq!((ticks(&recording), recording.damage.len()), ((1..7).collect::<Vec<_>>(), 0));
}
