//! The end of a file: data end, summary, footer, magic, over all blocks of all writers. The `mcap` crate writes a summary only of what
//! the same writer wrote, so this one is written here, record by record of <https://mcap.dev/spec>. The checksum of the data section is 0, "not
//! given": every chunk has its own. The summary has its own, so that whoever reads it instead of the file knows it for whole.

use crate::channels::Channel;
use mcap::records::{ChunkIndex, MetadataIndex, op};
use std::collections::BTreeMap;

/// Bytes of a footer: where the summary begins, where its offsets do, and the checksum of everything from its beginning up to there.
pub(crate) const FOOTER_BYTES: u64 = 20;
/// Of them the checksum's.
pub(crate) const CHECKSUM_BYTES: u64 = 4;

/// What the summary says.
#[derive(Debug, Default)]
pub(crate) struct Contents {
    pub(crate) chunks: Vec<ChunkIndex>,
    pub(crate) metadata: Vec<MetadataIndex>,
    pub(crate) counts: BTreeMap<u16, u64>,
}

fn text(out: &mut Vec<u8>, text: &str) {
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(text.as_bytes());
}

fn words(out: &mut Vec<u8>, words: &[u64]) {
    words.iter().for_each(|word| out.extend(word.to_le_bytes()));
}

fn record(out: &mut Vec<u8>, opcode: u8, body: &[u8]) {
    out.push(opcode);
    out.extend((body.len() as u64).to_le_bytes());
    out.extend(body);
}

fn counts(out: &mut Vec<u8>, counts: &BTreeMap<u16, u64>) {
    out.extend((counts.len() as u32 * 10).to_le_bytes()); // bytes, not entries
    for (id, count) in counts {
        out.extend(id.to_le_bytes());
        out.extend(count.to_le_bytes());
    }
}

fn schemas(out: &mut Vec<u8>) {
    for channel in Channel::ALL {
        let mut body = (channel as u16).to_le_bytes().to_vec();
        text(&mut body, channel.schema_name());
        text(&mut body, "jsonschema");
        text(&mut body, &channel.schema().to_string());
        record(out, op::SCHEMA, &body);
    }
}

fn channels(out: &mut Vec<u8>) {
    for channel in Channel::ALL {
        let mut body = [(channel as u16).to_le_bytes(); 2].concat(); // its id, its schema's id
        text(&mut body, channel.topic());
        text(&mut body, "json");
        body.extend(0u32.to_le_bytes()); // no metadata
        record(out, op::CHANNEL, &body);
    }
}

fn statistics(out: &mut Vec<u8>, contents: &Contents) {
    let mut body = Vec::new();
    words(&mut body, &[contents.counts.values().sum()]);
    body.extend((Channel::ALL.len() as u16).to_le_bytes());
    for count in [Channel::ALL.len(), 0, contents.metadata.len(), contents.chunks.len()] {
        body.extend((count as u32).to_le_bytes());
    }
    let filled = || contents.chunks.iter().filter(|chunk| chunk.message_end_time > 0);
    let start = filled().map(|chunk| chunk.message_start_time).min().unwrap_or(0);
    let end = filled().map(|chunk| chunk.message_end_time).max().unwrap_or(0);
    words(&mut body, &[start, end]);
    counts(&mut body, &contents.counts);
    record(out, op::STATISTICS, &body);
}

fn chunk_indexes(out: &mut Vec<u8>, contents: &Contents) {
    for chunk in &contents.chunks {
        let mut body = Vec::new();
        words(&mut body, &[chunk.message_start_time, chunk.message_end_time, chunk.chunk_start_offset, chunk.chunk_length]);
        counts(&mut body, &chunk.message_index_offsets);
        words(&mut body, &[chunk.message_index_length]);
        text(&mut body, &chunk.compression);
        words(&mut body, &[chunk.compressed_size, chunk.uncompressed_size]);
        record(out, op::CHUNK_INDEX, &body);
    }
}

fn metadata_indexes(out: &mut Vec<u8>, contents: &Contents) {
    for index in &contents.metadata {
        let mut body = Vec::new();
        words(&mut body, &[index.offset, index.length]);
        text(&mut body, &index.name);
        record(out, op::METADATA_INDEX, &body);
    }
}

/// Writes all records of one kind.
type Group<'a> = &'a dyn Fn(&mut Vec<u8>);

/// The bytes from the end of the last block, at `end`, to the end of the file.
pub(crate) fn encode(contents: &Contents, end: u64) -> Vec<u8> {
    let mut out = Vec::new();
    record(&mut out, op::DATA_END, &0u32.to_le_bytes());
    let summary_start = end + out.len() as u64;
    let groups: [(u8, Group); 5] = [
        (op::SCHEMA, &|out| schemas(out)),
        (op::CHANNEL, &|out| channels(out)),
        (op::STATISTICS, &|out| statistics(out, contents)),
        (op::CHUNK_INDEX, &|out| chunk_indexes(out, contents)),
        (op::METADATA_INDEX, &|out| metadata_indexes(out, contents)),
    ];
    let mut offsets = Vec::new();
    for (opcode, write) in groups {
        let start = out.len();
        write(&mut out);
        if out.len() > start {
            let mut body = vec![opcode];
            words(&mut body, &[end + start as u64, (out.len() - start) as u64]);
            record(&mut offsets, op::SUMMARY_OFFSET, &body);
        }
    }
    let offsets_start = end + out.len() as u64;
    out.extend(offsets);
    out.push(op::FOOTER);
    words(&mut out, &[FOOTER_BYTES, summary_start, offsets_start]);
    let checksum = crc32fast::hash(&out[(summary_start - end) as usize..]);
    out.extend(checksum.to_le_bytes());
    out.extend(mcap::MAGIC);
    out
}
