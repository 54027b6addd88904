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

/// What the summary says. It is there for as long as the recording is written: some 160 bytes of each block.
#[derive(Debug, Default)]
pub(crate) struct Contents {
    /// The indexes of the chunks as the summary has them, record after record, and how many they are.
    chunk_indexes: Vec<u8>,
    chunks: u64,
    /// Times of the first and the last message, ns.
    span_ns: Option<(u64, u64)>,
    pub(crate) metadata: Vec<MetadataIndex>,
    pub(crate) counts: BTreeMap<u16, u64>,
}

impl Contents {
    /// Adds the next chunk.
    pub(crate) fn add(&mut self, chunk: &ChunkIndex) {
        chunk_index(&mut self.chunk_indexes, chunk);
        self.chunks += 1;
        let (start, end) = (chunk.message_start_time, chunk.message_end_time);
        // Of none that there are no messages in; those of a station's first tick have the time 0.
        if !chunk.message_index_offsets.is_empty() {
            let (first, last) = self.span_ns.unwrap_or((start, end));
            self.span_ns = Some((first.min(start), last.max(end)));
        }
    }

    /// Whether there is no chunk.
    pub(crate) fn is_empty(&self) -> bool {
        self.chunks == 0
    }

    /// The indexes of the chunks, record after record: what lies between the two parts of the file's end.
    pub(crate) fn chunk_indexes(&self) -> &[u8] {
        &self.chunk_indexes
    }
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
    for count in [Channel::ALL.len() as u64, 0, contents.metadata.len() as u64, contents.chunks] {
        body.extend((count as u32).to_le_bytes());
    }
    let (start, end) = contents.span_ns.unwrap_or((0, 0));
    words(&mut body, &[start, end]);
    counts(&mut body, &contents.counts);
    record(out, op::STATISTICS, &body);
}

fn chunk_index(out: &mut Vec<u8>, chunk: &ChunkIndex) {
    let mut body = Vec::new();
    words(&mut body, &[chunk.message_start_time, chunk.message_end_time, chunk.chunk_start_offset, chunk.chunk_length]);
    counts(&mut body, &chunk.message_index_offsets);
    words(&mut body, &[chunk.message_index_length]);
    text(&mut body, &chunk.compression);
    words(&mut body, &[chunk.compressed_size, chunk.uncompressed_size]);
    record(out, op::CHUNK_INDEX, &body);
}

fn metadata_indexes(out: &mut Vec<u8>, contents: &Contents) {
    for index in &contents.metadata {
        let mut body = Vec::new();
        words(&mut body, &[index.offset, index.length]);
        text(&mut body, &index.name);
        record(out, op::METADATA_INDEX, &body);
    }
}

/// Where the records of one kind are, if there are any.
fn offset(out: &mut Vec<u8>, opcode: u8, start: u64, length: usize) {
    if length > 0 {
        let mut body = vec![opcode];
        words(&mut body, &[start, length as u64]);
        record(out, op::SUMMARY_OFFSET, &body);
    }
}

/// Writes all records of one kind.
type Group<'a> = &'a dyn Fn(&mut Vec<u8>);

/// The bytes from the end of the last block, at `end`, to the end of the file: what comes before the indexes of the chunks, and what comes behind them.
pub(crate) fn encode(contents: &Contents, end: u64) -> [Vec<u8>; 2] {
    let (mut before, mut behind, mut offsets) = (Vec::new(), Vec::new(), Vec::new());
    record(&mut before, op::DATA_END, &0u32.to_le_bytes());
    let data_end_bytes = before.len();
    let groups: [(u8, Group); 3] = [
        (op::SCHEMA, &|out| schemas(out)),
        (op::CHANNEL, &|out| channels(out)),
        (op::STATISTICS, &|out| statistics(out, contents)),
    ];
    for (opcode, write) in groups {
        let start = before.len();
        write(&mut before);
        offset(&mut offsets, opcode, end + start as u64, before.len() - start);
    }
    let chunks_start = end + before.len() as u64;
    offset(&mut offsets, op::CHUNK_INDEX, chunks_start, contents.chunk_indexes.len());
    let behind_start = chunks_start + contents.chunk_indexes.len() as u64;
    metadata_indexes(&mut behind, contents);
    offset(&mut offsets, op::METADATA_INDEX, behind_start, behind.len());
    let offsets_start = behind_start + behind.len() as u64;
    behind.extend(offsets);
    behind.push(op::FOOTER);
    words(&mut behind, &[FOOTER_BYTES, end + data_end_bytes as u64, offsets_start]);
    let mut checksum = crc32fast::Hasher::new();
    for part in [&before[data_end_bytes..], contents.chunk_indexes(), behind.as_slice()] {
        checksum.update(part);
    }
    behind.extend(checksum.finalize().to_le_bytes());
    behind.extend(mcap::MAGIC);
    [before, behind]
}
