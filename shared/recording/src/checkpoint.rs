//! The whole state of a role at one tick, as the message of its stream: what a replay begins with that does not begin at the beginning, and how the
//! newest ones before a tick are found without reading what lies before them: by the summary, or, where there is none, from record to record.

use crate::channels::{Channel, time_of_ns};
use crate::decode::{States, json};
use crate::error::ReadError;
use crate::frame::Frame;
use crate::outline::Place;
use crate::reader::Reader;
use crate::scan::Scan;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use hyst_messages::Role;
use mcap::records::op;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::io::{Read, Seek};
use std::path::Path;

/// Blocks with checkpoints, or with what was judged, that are looked into from the newest back: one that is damaged costs its interval.
const BLOCKS: usize = 8;
/// Blocks that begin later than what is sought, after which the search ends.
const LATER: usize = 64;
/// Bytes of a chunk with the times of its first and last message, and of a message index with its channel.
const TIMES_BYTES: u64 = 16;
pub(crate) const CHANNEL_BYTES: u64 = 2;

/// A state.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Whose.
    pub role: Role,
    /// Tick of the state.
    pub tick: u64,
    /// The message, padded to whole words.
    pub state: Vec<u8>,
}

/// Message of `/checkpoints`.
#[derive(Serialize, Deserialize)]
pub(crate) struct CheckpointMessage {
    tick: u64,
    role: String,
    state: String,
}

impl CheckpointMessage {
    pub(crate) fn of(checkpoint: &Checkpoint) -> CheckpointMessage {
        let Checkpoint { role, tick, state } = checkpoint;
        CheckpointMessage { tick: *tick, role: role.name().into(), state: BASE64_STANDARD.encode(state) }
    }
    pub(crate) fn checkpoint(&self) -> Result<Checkpoint, String> {
        let role = Role::ALL.into_iter().find(|role| role.name() == self.role);
        let role = role.ok_or_else(|| format!("has a state of {:?}, which is no role", self.role))?;
        let state = BASE64_STANDARD.decode(&self.state).map_err(|error| format!("has a state that is none: {error}"))?;
        Ok(Checkpoint { role, tick: self.tick, state })
    }

    /// Role, tick and base64 of a message as [`CheckpointMessage::of`] makes it.
    fn scan(data: &[u8]) -> Option<(Role, u64, &[u8])> {
        let mut scan = Scan::of(data);
        let tick = scan.count(br#"{"tick":"#)?;
        scan.past(br#","role":""#)?;
        let rest = scan.up_to(br#""}"#)?;
        let (name, rest) = rest.split_at(memchr::memchr(b'"', rest)?);
        let role = Role::ALL.into_iter().find(|role| role.name().as_bytes() == name)?;
        Some((role, tick, rest.strip_prefix(br#"","state":""#)?))
    }
}

/// The checkpoint of a message, if its state is asked for.
pub(crate) fn read(data: &[u8], states: States) -> Result<Option<Checkpoint>, String> {
    let scanned = CheckpointMessage::scan(data);
    if states == States::Checked && scanned.is_some_and(|(_, _, state)| is_base64(state)) {
        return Ok(None);
    }
    let decoded = scanned.and_then(|(role, tick, state)| Some((role, tick, BASE64_STANDARD.decode(state).ok()?)));
    let checkpoint = match decoded {
        Some((role, tick, state)) => Checkpoint { role, tick, state },
        None => json::<CheckpointMessage>(data)?.checkpoint()?,
    };
    Ok(Some(checkpoint).filter(|_| states == States::Given))
}

/// Whether a text can be decoded: letter by letter, and its last four by who decodes, because padding is there alone.
fn is_base64(text: &[u8]) -> bool {
    let (most, last) = text.split_at(text.len().saturating_sub(4));
    // Without a branch, so that many are looked at in one instruction.
    let is_letter = |byte: u8| {
        let (is_latin, is_digit) = ((byte | 0x20).wrapping_sub(b'a') < 26, byte.wrapping_sub(b'0') < 10);
        is_latin | is_digit | (byte == b'+') | (byte == b'/')
    };
    let are_letters = most.iter().fold(true, |are, byte| are & is_letter(*byte));
    text.len().is_multiple_of(4) && are_letters && BASE64_STANDARD.decode(last).is_ok()
}

/// The newest checkpoint of each role of a file up to a tick; none where none was recorded by then, or none is whole.
pub fn checkpoints(path: &Path, up_to_tick: u64) -> Result<Vec<Checkpoint>, ReadError> {
    Reader::open(path)?.checkpoints(up_to_tick)
}

impl<R: Read + Seek> Reader<R> {
    /// Goes on at the first block that reaches `tick`, without reading those before it.
    pub fn skip_to(&mut self, tick: u64) -> Result<(), ReadError> {
        let time_ns = time_of_ns(tick);
        let index = self.index()?;
        if let Some(chunk) = index.iter().flat_map(|index| &index.chunks).find(|chunk| chunk.last_ns >= time_ns) {
            self.back_to(chunk.frame().at);
            return Ok(());
        }
        while let Some(frame) = self.next_frame()? {
            if frame.opcode == op::CHUNK && self.times(&frame)?.1 >= time_ns {
                self.back_to(frame.at);
                return Ok(());
            }
        }
        Ok(())
    }

    fn checkpoints(&mut self, up_to_tick: u64) -> Result<Vec<Checkpoint>, ReadError> {
        let mut newest: Vec<Checkpoint> = Vec::new();
        for frame in self.blocks_with(Channel::Checkpoints, up_to_tick)? {
            let Ok(block) = self.block_at(&frame)? else { continue }; // damaged: an older one serves
            for found in block.checkpoints.into_iter().filter(|found| found.tick <= up_to_tick) {
                match newest.iter_mut().find(|known| known.role == found.role) {
                    Some(known) if known.tick >= found.tick => {}
                    Some(known) => *known = found,
                    None => newest.push(found),
                }
            }
        }
        Ok(newest)
    }

    /// The last blocks that have something of a channel, which has something now and then, and begin up to a tick, in the file's order.
    pub(crate) fn blocks_with(&mut self, channel: Channel, up_to_tick: u64) -> Result<VecDeque<Frame>, ReadError> {
        if let Some(index) = self.index()? {
            let begins = |chunk: &&Place| chunk.first_ns <= time_of_ns(up_to_tick);
            let kept = index.chunks.iter().filter(begins).filter(|chunk| chunk.has(channel));
            let mut newest_first: VecDeque<Frame> = kept.rev().take(BLOCKS).map(Place::frame).collect();
            newest_first.make_contiguous().reverse();
            return Ok(newest_first);
        }
        let (mut blocks, mut chunk, mut later) = (VecDeque::new(), None, 0);
        while let Some(frame) = self.next_frame()? {
            match frame.opcode {
                // A time that was damaged, or a block that waited, is no end.
                op::CHUNK if self.times(&frame)?.0 > time_of_ns(up_to_tick) => {
                    later += 1;
                    chunk = None;
                    if later > LATER {
                        break;
                    }
                }
                op::CHUNK => chunk = Some(frame),
                op::MESSAGE_INDEX => {
                    let head = self.body(&frame, CHANNEL_BYTES)?;
                    let is_kept = head[..] == (channel as u16).to_le_bytes();
                    if let Some(chunk) = chunk.take_if(|_| is_kept) {
                        blocks.push_back(chunk);
                        blocks.drain(..blocks.len().saturating_sub(BLOCKS));
                    }
                }
                op::DATA_END => break,
                _ => {}
            }
        }
        Ok(blocks)
    }

    /// Times of the first and the last message of a chunk, ns.
    fn times(&mut self, chunk: &Frame) -> Result<(u64, u64), ReadError> {
        let head = self.body(chunk, TIMES_BYTES)?;
        let word = |at: usize| head.get(at..at + 8).and_then(|bytes| bytes.try_into().ok()).map_or(0, u64::from_le_bytes);
        Ok((word(0), word(8)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_that_is_only_looked_at_is_refused_as_one_that_is_decoded() {
        let message = |state: &str| format!("{{\"tick\":7,\"role\":\"fluid\",\"state\":\"{state}\"}}");
        let bytes: Vec<u8> = (0..=255).collect();
        for length in 0..70 {
            let text = message(&BASE64_STANDARD.encode(&bytes[bytes.len() - length..]));
            let given = read(text.as_bytes(), States::Given).unwrap().unwrap();
            assert_eq!((given.role, given.tick, &given.state[..]), (Role::Fluid, 7, &bytes[bytes.len() - length..]));
            assert_eq!(read(text.as_bytes(), States::Checked), Ok(None));
        }
        // Each byte at each place, escapes and broken UTF-8 among them.
        let whole = message("QUJDREVGR0g=").into_bytes();
        for (at, byte) in (0..whole.len()).flat_map(|at| (0..=255).map(move |byte| (at, byte))) {
            let mut other = whole.clone();
            other[at] = byte;
            let [given, checked] = [States::Given, States::Checked].map(|states| read(&other, states));
            assert_eq!(checked.as_ref().err(), given.as_ref().err(), "{byte} at {at}");
            assert!(given.is_err() || checked == Ok(None), "{byte} at {at}");
            let as_ever = json::<CheckpointMessage>(&other).and_then(|message| message.checkpoint());
            assert_eq!(given, as_ever.map(Some), "{byte} at {at}");
        }
    }
}
