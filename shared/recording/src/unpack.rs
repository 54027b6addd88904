//! Chunks as they are unpacked, one after the other with the same room: at once, if they stand as this recorder writes them and are whole; else record by
//! record by the library, which says what is wrong with them.
//!
//! Promise: what is unpacked at once is what the library would give, with its checksum; and whatever it refuses is refused in its words.

use crate::frame::{COMPRESSION, HEAD_BYTES, MAX_RECORD_BYTES};
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::io::Read;
use zstd::bulk::Decompressor;

/// Bytes of a chunk's body before what is compressed: two times, size, checksum, compression, compressed size.
const CHUNK_HEAD: usize = 44;
/// Bytes of a record's opcode and length.
const RECORD_HEAD: usize = HEAD_BYTES as usize;
/// Bytes of a message before its JSON: channel, number, two times.
const MESSAGE_HEAD: usize = 22;
/// The base-2 logarithms of the smallest window of zstd, and of the largest that the library takes for sure (RFC 8878, 3.1.1.1.2).
const LEAST_WINDOW: u8 = 10;
const MOST_WINDOW: u8 = 26;
/// The bit of a frame of zstd that is one piece: its window is all of it.
const ONE_PIECE: u8 = 0x20;

/// What unpacks chunks.
#[derive(Default)]
pub(crate) struct Unpacker {
    zstd: Option<Decompressor<'static>>,
    /// The records of the last chunk.
    records: Vec<u8>,
}

impl Unpacker {
    /// Gives every message of a chunk to `take` as (channel, log time ns, JSON), after the chunk's checksum was found right.
    pub(crate) fn messages(
        &mut self,
        body: &[u8],
        mut take: impl FnMut(u16, u64, &[u8]) -> Result<(), String>,
    ) -> Result<(), String> {
        if self.unpack(body).is_none() {
            return one_by_one(body, take);
        }
        let messages = Records { rest: &self.records }.filter(|(opcode, _)| *opcode == op::MESSAGE);
        for (channel, time_ns, data) in messages.filter_map(|(_, message)| parts(message)) {
            take(channel, time_ns, data)?;
        }
        Ok(())
    }

    /// Unpacks a chunk at once; `None` if it is to be looked at more closely: its checksum is another or none, it is no sequence of records, or nobody of ours
    /// has written it.
    fn unpack(&mut self, body: &[u8]) -> Option<()> {
        let (head, frame) = body.split_first_chunk::<CHUNK_HEAD>()?;
        let size = u64::from_le_bytes(*head[16..].first_chunk()?);
        let checksum = u32::from_le_bytes(*head[24..].first_chunk()?);
        let packed = u64::from_le_bytes(*head[36..].first_chunk()?);
        let is_ours = head[28..].starts_with(COMPRESSION) && packed == frame.len() as u64 && checksum != 0;
        if !is_ours || !(1..=MAX_RECORD_BYTES).contains(&size) || !is_within_window(frame, size) {
            return None;
        }
        let zstd = match &mut self.zstd {
            Some(zstd) => zstd,
            None => self.zstd.insert(Decompressor::new().ok()?),
        };
        self.records.clear();
        self.records.reserve(size as usize);
        let written = zstd.decompress_to_buffer(frame, &mut self.records).ok()?;
        let is_whole = written as u64 == size && crc32fast::hash(&self.records) == checksum && are_records(&self.records);
        is_whole.then_some(())
    }
}

/// Whether a frame of zstd says that its window has room for all of so many bytes: then it is the same whether it is unpacked at once or bit by bit, also if a
/// bit of its head was flipped.
fn is_within_window(frame: &[u8], size: u64) -> bool {
    let [0x28, 0xb5, 0x2f, 0xfd, descriptor, window, ..] = frame else { return false };
    let window = LEAST_WINDOW + (*window >> 3);
    *descriptor & ONE_PIECE != 0 || (window <= MOST_WINDOW && 1u64 << window >= size)
}

/// The records of a chunk, or of a part of the summary, opcode and body, up to what is none.
pub(crate) struct Records<'a> {
    pub(crate) rest: &'a [u8],
}

impl<'a> Iterator for Records<'a> {
    type Item = (u8, &'a [u8]);

    fn next(&mut self) -> Option<(u8, &'a [u8])> {
        let (head, rest) = self.rest.split_first_chunk::<RECORD_HEAD>()?;
        let [opcode, length @ ..] = *head;
        let (body, rest) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(length)).ok()?)?;
        self.rest = rest;
        Some((opcode, body))
    }
}

/// Whether that is one record after the other to its end, and each message one.
fn are_records(bytes: &[u8]) -> bool {
    let mut records = Records { rest: bytes };
    records.all(|(opcode, body)| opcode != op::MESSAGE || body.len() >= MESSAGE_HEAD) && records.rest.is_empty()
}

/// Channel, log time and JSON of a message.
fn parts(message: &[u8]) -> Option<(u16, u64, &[u8])> {
    let (head, data) = message.split_first_chunk::<MESSAGE_HEAD>()?;
    let channel = u16::from_le_bytes(*head.first_chunk()?);
    let time_ns = u64::from_le_bytes(*head[6..].first_chunk()?);
    Some((channel, time_ns, data))
}

/// The same messages as the library reads them, and its word where it does not.
fn one_by_one(body: &[u8], mut take: impl FnMut(u16, u64, &[u8]) -> Result<(), String>) -> Result<(), String> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(MAX_RECORD_BYTES as usize);
    let mut head = [op::CHUNK; RECORD_HEAD];
    head[1..].copy_from_slice(&(body.len() as u64).to_le_bytes());
    let mut source = head.chain(body);
    let mut reader = LinearReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event.map_err(|e| e.to_string())? {
            LinearReadEvent::ReadRequest(need) => {
                let need = need.min(MAX_RECORD_BYTES as usize);
                let read = source.read(reader.insert(need)).map_err(|e| e.to_string())?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { opcode: op::MESSAGE, data } => {
                match mcap::parse_record(op::MESSAGE, data).map_err(|e| e.to_string())? {
                    Record::Message { header, data } => take(header.channel_id, header.log_time, &data)?,
                    _ => return Err("not a message".into()),
                }
            }
            LinearReadEvent::Record { .. } => {} // schemas and channels: their ids are fixed
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::block::{Block, encode};
    use crate::checkpoint::Checkpoint;
    use hyst_messages::{AppliedRecord, FluidStatus, Role, StepRecord, TissueStatus};

    /// The body of a chunk as it is written.
    fn body() -> Vec<u8> {
        let record = |tick: u64| {
            let mut record = AppliedRecord { tick, pressure_pa: tick as f32, ..AppliedRecord::default() };
            record.command.force_n = [0.1 * tick as f32, -1e-9, 0.0];
            record
        };
        let block = Block {
            applied: (1..20).map(record).collect(),
            steps: (1..20).map(|tick| StepRecord { tick, state_hash: u64::MAX / tick, ..StepRecord::default() }).collect(),
            tissue: vec![TissueStatus::default()],
            fluid: vec![FluidStatus::default()],
            checkpoints: vec![Checkpoint { role: Role::Fluid, tick: 5, state: (0..=255).collect() }],
            ..Block::default()
        };
        let bytes = encode(&block).unwrap().bytes;
        let length = u64::from_le_bytes(bytes[1..9].try_into().unwrap()) as usize;
        assert_eq!(bytes[0], op::CHUNK);
        bytes[RECORD_HEAD..RECORD_HEAD + length].to_vec()
    }

    type Told = (Vec<(u16, u64, Vec<u8>)>, Result<(), String>);

    type Take<'a> = &'a mut dyn FnMut(u16, u64, &[u8]) -> Result<(), String>;

    fn told(give: impl FnOnce(Take<'_>) -> Result<(), String>) -> Told {
        let mut messages = Vec::new();
        let result = give(&mut |channel: u16, time_ns: u64, data: &[u8]| {
            messages.push((channel, time_ns, data.to_vec()));
            Ok(())
        });
        (messages, result)
    }

    #[test]
    fn what_is_unpacked_at_once_is_what_the_library_gives_whatever_bit_was_flipped_and_wherever_it_was_cut() {
        let whole = body();
        let mut unpacker = Unpacker::default();
        assert!(unpacker.unpack(&whole).is_some(), "a chunk of ours is unpacked at once");
        let mut is_the_same = |body: &[u8], what: &str| {
            let (is, was) = (told(|take| unpacker.messages(body, take)), told(|take| one_by_one(body, take)));
            assert!(is == was, "{what}: {} messages, {:?}, and not {}, {:?}", is.0.len(), is.1, was.0.len(), was.1);
            is.1.is_ok()
        };
        assert!(is_the_same(&whole, "whole"));
        let mut refused = 0;
        for at in 0..whole.len() {
            let mut bad = whole.clone();
            bad[at] ^= 1 << (at % 8);
            refused += usize::from(!is_the_same(&bad, &format!("byte {at}")));
            // Nothing at all is a chunk without messages.
            if at % 16 == 0 && at > 0 {
                assert!(!is_the_same(&whole[..at], &format!("cut at {at}")));
            }
        }
        assert!(refused > whole.len() / 2, "{refused} of {}", whole.len());
        // All of its head, and of the head of what is compressed.
        for at in 0..64 {
            for byte in [0xff, 0x00, 0x55] {
                let mut bad = whole.clone();
                bad[at] = byte;
                is_the_same(&bad, &format!("byte {at} is {byte}"));
            }
        }
    }

    #[test]
    fn what_was_unpacked_before_is_not_seen_again() {
        let whole = body();
        let mut unpacker = Unpacker::default();
        assert!(told(|take| unpacker.messages(&whole, take)).1.is_ok());
        let (messages, result) = told(|take| unpacker.messages(&whole[..100], take));
        assert!(messages.is_empty() && result.is_err());
    }
}
