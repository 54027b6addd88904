//! What the summary of a recording that was closed tells of it: where it ends, and where its blocks lie, so that nobody has to read up to there.
//!
//! Promise: nothing is believed of a summary that has not its checksum, or that does not name everything that lies before it without a gap; such a file
//! has to be read. What is damaged within a block is not seen from here.

use crate::block::{LOST, STATION, TickRange};
use crate::channels::Channel;
use crate::decode;
use crate::error::ReadError;
use crate::frame::{DATA_END_BYTES, Frame, HEAD_BYTES, MAX_RECORD_BYTES};
use crate::reader::Reader;
use crate::summary::{CHECKSUM_BYTES, FOOTER_BYTES};
use crate::unpack::Records;
use mcap::records::{ChunkIndex, MetadataIndex, Record, op};
use std::io::{Read, Seek};
use std::path::Path;

/// Largest summary that is read, in parts of which size: that of some weeks.
const MOST_SUMMARY_BYTES: u64 = 1 << 30;
const PART_BYTES: u64 = 1 << 20;

/// What is known of a whole recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outline {
    /// The last tick of the device.
    pub last_tick: u64,
    /// Ticks that the recorder says are lost, in the file's order.
    pub lost: Vec<TickRange>,
}

/// The outline of a file; `None` of one that was not closed, that an older version closed, whose device made no tick, or that is damaged where it is looked at.
pub fn outline(path: &Path) -> Result<Option<Outline>, ReadError> {
    Reader::open(path)?.outline()
}

/// Where a chunk lies, and what is in it: of a long recording there are some millions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Place {
    at: u64,
    /// Bytes of the chunk, and of its message indexes behind it.
    length: u64,
    indexes_length: u64,
    /// Times of the first and the last message, ns.
    pub(crate) first_ns: u64,
    pub(crate) last_ns: u64,
    /// A bit for each channel's id.
    channels: u32,
}

impl Place {
    fn of(chunk: &ChunkIndex) -> Place {
        let bit = |id: &u16| 1u32.checked_shl(u32::from(*id)).unwrap_or(0);
        Place {
            at: chunk.chunk_start_offset,
            length: chunk.chunk_length,
            indexes_length: chunk.message_index_length,
            first_ns: chunk.message_start_time,
            last_ns: chunk.message_end_time,
            channels: chunk.message_index_offsets.keys().map(bit).fold(0, |all, bit| all | bit),
        }
    }

    /// The chunk's record.
    pub(crate) fn frame(&self) -> Frame {
        Frame { at: self.at, opcode: op::CHUNK, length: self.length.saturating_sub(HEAD_BYTES) }
    }

    /// Whether it has a message of a channel.
    pub(crate) fn has(&self, channel: Channel) -> bool {
        self.channels & (1 << channel as u32) != 0
    }
}

/// Where the chunks and the metadata lie, each in the file's order.
#[derive(Default)]
pub(crate) struct Index {
    pub(crate) chunks: Vec<Place>,
    metadata: Vec<MetadataIndex>,
}

impl Index {
    /// Takes the records of a part of the summary; how many bytes they have, for the last may be cut. `None` if one of them is none.
    fn take(&mut self, part: &[u8]) -> Option<usize> {
        let mut records = Records { rest: part };
        for (opcode, body) in records.by_ref() {
            if opcode != op::CHUNK_INDEX && opcode != op::METADATA_INDEX {
                continue; // schemas, channels and counts
            }
            match mcap::parse_record(opcode, body).ok()? {
                Record::ChunkIndex(chunk) => self.chunks.push(Place::of(&chunk)),
                Record::MetadataIndex(metadata) => self.metadata.push(metadata),
                _ => return None,
            }
        }
        Some(part.len() - records.rest.len())
    }

    /// Whether it names the session's facts and all that follows them up to a byte.
    fn reaches(&self, end: u64) -> bool {
        let of_chunk = |chunk: &Place| Some((chunk.at, chunk.length.checked_add(chunk.indexes_length)?));
        let of_metadata = |metadata: &MetadataIndex| Some((metadata.offset, metadata.length));
        let spans: Option<Vec<(u64, u64)>> =
            self.metadata.iter().map(of_metadata).chain(self.chunks.iter().map(of_chunk)).collect();
        let Some(mut spans) = spans else { return false };
        spans.sort_unstable();
        let begins = self.metadata.first().filter(|first| first.name == STATION).map(|first| first.offset);
        let follow = |at: u64, (start, length): &(u64, u64)| if *start == at { at.checked_add(*length) } else { None };
        begins.and_then(|begin| spans.iter().try_fold(begin, follow)) == Some(end)
    }
}

impl<R: Read + Seek> Reader<R> {
    fn outline(&mut self) -> Result<Option<Outline>, ReadError> {
        let Some(index) = self.index()? else { return Ok(None) };
        let Some(last_tick) = self.last_tick(&index)? else { return Ok(None) };
        let mut lost = Vec::new();
        for metadata in index.metadata.iter().filter(|metadata| metadata.name == LOST) {
            let length = metadata.length.saturating_sub(HEAD_BYTES);
            let body = self.body(&Frame { at: metadata.offset, opcode: op::METADATA, length }, u64::MAX)?;
            let Ok(block) = decode::noted(&body) else { return Ok(None) };
            lost.extend(block.into_iter().flat_map(|block| block.lost));
        }
        Ok(Some(Outline { last_tick, lost }))
    }

    /// The last tick of the device; `None` if there is none, or the block that has it is damaged.
    fn last_tick(&mut self, index: &Index) -> Result<Option<u64>, ReadError> {
        let mut newest_first = index.chunks.iter().rev();
        let Some(chunk) = newest_first.find(|chunk| chunk.has(Channel::Force)) else { return Ok(None) };
        let block = self.block_at(&chunk.frame())?;
        Ok(block.ok().and_then(|block| block.applied.last().map(|record| record.tick)))
    }

    /// What the summary names, if that is everything. The next record stays the same.
    pub(crate) fn index(&mut self) -> Result<Option<Index>, ReadError> {
        let Some(footer_at) = self.length().checked_sub(HEAD_BYTES + FOOTER_BYTES + mcap::MAGIC.len() as u64) else {
            return Ok(None);
        };
        let length = self.length();
        let tail = self.bytes(footer_at, length)?;
        let word = |at: usize| tail.get(at..at + 8).and_then(|bytes| bytes.try_into().ok()).map(u64::from_le_bytes);
        let is_footer = tail.first() == Some(&op::FOOTER) && word(1) == Some(FOOTER_BYTES) && tail.ends_with(mcap::MAGIC);
        let start = word(HEAD_BYTES as usize).filter(|start| is_footer && (HEAD_BYTES..footer_at).contains(start));
        let Some(start) = start.filter(|start| footer_at - start <= MOST_SUMMARY_BYTES) else { return Ok(None) };
        let (mut index, mut checksum) = (Index::default(), crc32fast::Hasher::new());
        let (mut at, mut part) = (start, Vec::new());
        while at < footer_at && part.len() as u64 <= MAX_RECORD_BYTES {
            let to = footer_at.min(at + PART_BYTES);
            let read = self.bytes(at, to)?;
            checksum.update(&read);
            part.extend(read);
            let Some(taken) = index.take(&part) else { return Ok(None) };
            part.drain(..taken);
            at = to;
        }
        let (told, rest) = tail.split_at((HEAD_BYTES + FOOTER_BYTES - CHECKSUM_BYTES) as usize);
        checksum.update(told);
        if !part.is_empty() || !rest.starts_with(&checksum.finalize().to_le_bytes()) {
            return Ok(None);
        }
        index.chunks.sort_by_key(|chunk| chunk.at);
        index.metadata.sort_by_key(|metadata| metadata.offset);
        let end = start.checked_sub(HEAD_BYTES + DATA_END_BYTES);
        Ok(Some(index).filter(|index| end.is_some_and(|end| index.reaches(end))))
    }

    /// The bytes from one place in the file, behind the first nine, up to another.
    fn bytes(&mut self, from: u64, to: u64) -> Result<Vec<u8>, ReadError> {
        // What a record would have whose body that is.
        let at = from.saturating_sub(HEAD_BYTES);
        self.body(&Frame { at, opcode: op::FOOTER, length: to.saturating_sub(from) }, u64::MAX)
    }
}
