//! A recording whose summary names a million blocks, as one of some days has it: it is sought in by its summary as a short one is.

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{Folder, block, write};
use hyst_messages::Role;
use hyst_recording::{Outline, checkpoints, outline};
use mcap::records::{ChunkIndex, MetadataIndex, op};
use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::os::unix::fs::FileExt;

/// Blocks between the first and the second that are there, and bytes of each, which are a hole: nobody who walks over the records comes past them.
const HOLES: u64 = 1_000_000;
const HOLE_BYTES: u64 = 100;
/// More than any record has that is read at once.
const LARGE_BYTES: usize = 64 << 20;

fn record(out: &mut Vec<u8>, opcode: u8, body: &[u8]) {
    out.push(opcode);
    out.extend((body.len() as u64).to_le_bytes());
    out.extend(body);
}

fn words(out: &mut Vec<u8>, words: &[u64]) {
    words.iter().for_each(|word| out.extend(word.to_le_bytes()));
}

fn text(out: &mut Vec<u8>, text: &str) {
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(text.as_bytes());
}

/// A record of the summary, as <https://mcap.dev/spec> has it.
fn chunk_index(out: &mut Vec<u8>, chunk: &ChunkIndex) {
    let mut body = Vec::new();
    words(&mut body, &[chunk.message_start_time, chunk.message_end_time, chunk.chunk_start_offset, chunk.chunk_length]);
    body.extend((chunk.message_index_offsets.len() as u32 * 10).to_le_bytes());
    for (id, offset) in &chunk.message_index_offsets {
        body.extend(id.to_le_bytes());
        words(&mut body, &[*offset]);
    }
    words(&mut body, &[chunk.message_index_length]);
    text(&mut body, &chunk.compression);
    words(&mut body, &[chunk.compressed_size, chunk.uncompressed_size]);
    record(out, op::CHUNK_INDEX, &body);
}

fn metadata_index(out: &mut Vec<u8>, index: &MetadataIndex) {
    let mut body = Vec::new();
    words(&mut body, &[index.offset, index.length]);
    text(&mut body, &index.name);
    record(out, op::METADATA_INDEX, &body);
}

/// Data end, summary, footer and magic of a file whose blocks end at a byte.
fn closing(end: u64, summary: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    record(&mut out, op::DATA_END, &0u32.to_le_bytes());
    let summary_start = end + out.len() as u64;
    out.extend(summary);
    let mut footer = vec![op::FOOTER];
    words(&mut footer, &[20, summary_start, 0]);
    let mut checksum = crc32fast::Hasher::new();
    checksum.update(summary);
    checksum.update(&footer);
    out.extend(footer);
    out.extend(checksum.finalize().to_le_bytes());
    out.extend(mcap::MAGIC);
    out
}

#[test]
fn a_summary_that_is_larger_than_any_record_finds_the_end_and_the_last_states() {
    let folder = Folder::new("large");
    write(&folder.file(), &[block(1..4), block(4..7)]).finish().unwrap();
    let bytes = std::fs::read(folder.file()).unwrap();
    let known = mcap::Summary::read(&bytes).unwrap().unwrap();
    let first = &known.chunk_indexes[0];
    let gap_at = first.chunk_start_offset + first.chunk_length + first.message_index_length;
    let end = known.metadata_indexes.iter().map(|index| index.offset + index.length).max().unwrap();
    let moved = |at: u64| if at < gap_at { at } else { at + HOLES * HOLE_BYTES };
    let mut summary = Vec::new();
    for chunk in &known.chunk_indexes {
        let mut chunk = chunk.clone();
        chunk.chunk_start_offset = moved(chunk.chunk_start_offset);
        chunk.message_index_offsets.values_mut().for_each(|at| *at = moved(*at));
        chunk_index(&mut summary, &chunk);
    }
    for hole in 0..HOLES {
        let hole = ChunkIndex {
            message_start_time: 3_000_000,
            message_end_time: 3_000_000,
            chunk_start_offset: gap_at + hole * HOLE_BYTES,
            chunk_length: HOLE_BYTES,
            message_index_offsets: BTreeMap::new(),
            message_index_length: 0,
            compression: "zstd".into(),
            compressed_size: 0,
            uncompressed_size: 0,
        };
        chunk_index(&mut summary, &hole);
    }
    for index in &known.metadata_indexes {
        metadata_index(&mut summary, &MetadataIndex { offset: moved(index.offset), ..index.clone() });
    }
    assert!(summary.len() > LARGE_BYTES && HOLES * HOLE_BYTES > LARGE_BYTES as u64);
    let file = OpenOptions::new().write(true).open(folder.file()).unwrap();
    file.set_len(gap_at).unwrap();
    file.write_all_at(&bytes[gap_at as usize..end as usize], moved(gap_at)).unwrap();
    file.write_all_at(&closing(moved(end), &summary), moved(end)).unwrap();
    assert_eq!(outline(&folder.file()).unwrap(), Some(Outline { last_tick: 6, lost: Vec::new() }));
    let states: Vec<_> = checkpoints(&folder.file(), u64::MAX).unwrap().iter().map(|kept| (kept.role, kept.tick)).collect();
    assert_eq!(states, [(Role::Fluid, 4)]);
}
