//! The whole state of a role at one tick, as the message of its stream: what a replay begins with that does not begin at the beginning, and how the
//! newest ones before a tick are found without reading what lies before them: by the summary, or, where there is none, from record to record.

use crate::channels::{Channel, time_of_ns};
use crate::error::ReadError;
use crate::frame::{DATA_END_BYTES, Frame};
use crate::outline::{frame_of, has};
use crate::reader::Reader;
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use hyst_messages::Role;
use mcap::records::{ChunkIndex, op};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::io::{Read, Seek};
use std::path::Path;

/// Blocks with checkpoints that are looked into from the newest back: one that is damaged costs its interval.
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
        if let Some(chunk) = index.iter().flat_map(|index| &index.chunks).find(|chunk| chunk.message_end_time >= time_ns) {
            self.back_to(&frame_of(chunk));
            return Ok(());
        }
        while let Some(frame) = self.next_frame()? {
            if frame.opcode == op::CHUNK && self.times(&frame)?.1 >= time_ns {
                self.back_to(&frame);
                return Ok(());
            }
        }
        Ok(())
    }

    fn checkpoints(&mut self, up_to_tick: u64) -> Result<Vec<Checkpoint>, ReadError> {
        let mut newest: Vec<Checkpoint> = Vec::new();
        for frame in self.blocks_with_checkpoints(up_to_tick)? {
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

    /// The last blocks that have a checkpoint and begin up to a tick, in the file's order.
    fn blocks_with_checkpoints(&mut self, up_to_tick: u64) -> Result<VecDeque<Frame>, ReadError> {
        if let Some(index) = self.index()? {
            let begins = |chunk: &&ChunkIndex| chunk.message_start_time <= time_of_ns(up_to_tick);
            let kept = index.chunks.iter().filter(begins).filter(|chunk| has(chunk, Channel::Checkpoints));
            let mut newest_first: VecDeque<Frame> = kept.rev().take(BLOCKS).map(frame_of).collect();
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
                    let is_kept = head[..] == (Channel::Checkpoints as u16).to_le_bytes();
                    if let Some(chunk) = chunk.take_if(|_| is_kept) {
                        blocks.push_back(chunk);
                        blocks.drain(..blocks.len().saturating_sub(BLOCKS));
                    }
                }
                op::DATA_END if frame.length == DATA_END_BYTES => break,
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
