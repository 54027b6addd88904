//! What a file that somebody writes holds at a moment, as far as that tells later whether it still does: sums of a few parts of it, so that a file of days costs
//! no more than a new one.
//!
//! Promise: whoever goes on in the file as a [`Writer`](crate::Writer) does leaves all of it as it was, also where the one before died within a block. Nothing is
//! said of a file whose newest blocks were damaged by then.

use crate::block::Block;
use crate::decode::{States, chunk};
use crate::error::ReadError;
use crate::frame::{Frame, Walk};
use crate::reader::open_file;
use crate::unpack::Unpacker;
use mcap::records::op;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, ErrorKind};
use std::os::unix::fs::FileExt;
use std::path::Path;

/// Bytes at the end of the file in which its newest blocks are looked for: the largest that is usual, a state, has one million.
const LAST_BYTES: u64 = 4 << 20;
/// Blocks that are read of them: those of a second and a half, or more states than come between two with ticks.
const NEWEST_BLOCKS: usize = 8;
/// Parts of which there is a sum, from the first byte to the last, and bytes of each.
const PARTS: u64 = 16;
const PART_BYTES: u64 = 64 << 10;
/// Bytes that are read at once where frames are looked at.
const AT_ONCE_BYTES: usize = 16 << 10;

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Part {
    at: u64,
    bytes: u64,
    sum: u32,
}

/// What a file held.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Before {
    /// Where the last block but one begins: what follows the last may be torn, and is cut away then.
    end: u64,
    parts: Vec<Part>,
}

impl Before {
    /// What a file holds now, and what the newest blocks in that have; `None` of one that is no recording, has no such blocks within its last 4 MiB, or has some
    /// that are damaged.
    pub fn of(path: &Path) -> Result<Option<(Before, Block)>, ReadError> {
        let refused = |source| ReadError::File { path: path.to_path_buf(), source };
        let file = open_file(path)?;
        let Some(mut walk) = Walk::begin(&file).map_err(refused)? else { return Ok(None) };
        walk.read_ahead(AT_ONCE_BYTES);
        let begin = walk.at();
        let from = walk.length().saturating_sub(LAST_BYTES).max(begin);
        walk.back_to(from);
        let mut frames: VecDeque<Frame> = VecDeque::new();
        while let Some(frame) = walk.next().map_err(refused)?.filter(|frame| frame.opcode != op::DATA_END) {
            if frame.opcode == op::CHUNK {
                frames.push_back(frame);
                if frames.len() > NEWEST_BLOCKS {
                    frames.pop_front();
                }
            }
        }
        let end = match frames.len() {
            0 | 1 if from > begin => return Ok(None),
            0 | 1 => begin,
            count => frames[count - 2].at,
        };
        let (mut unpacker, mut newest) = (Unpacker::default(), Block::default());
        for frame in &frames {
            let body = walk.body(frame, u64::MAX).map_err(refused)?;
            match chunk(&mut unpacker, &body, States::Checked) {
                Ok(mut block) if frame.at < end => {
                    block.precede(newest);
                    newest = block;
                }
                Ok(_) => {}
                Err(_) if frame.at > end => {} // the last one may not be all there yet
                Err(_) => return Ok(None),
            }
        }
        let part = |(at, bytes): (u64, u64)| sum(&file, at, bytes).map(|sum| Part { at, bytes, sum });
        let parts = places(end).map(part).collect::<io::Result<Vec<Part>>>().map_err(refused)?;
        Ok(Some((Before { end, parts }, newest)))
    }

    /// Whether a file has all of that still, as far as the sums tell.
    pub fn is_in(&self, path: &Path) -> Result<bool, ReadError> {
        let file = open_file(path)?;
        for part in &self.parts {
            match sum(&file, part.at, part.bytes) {
                Ok(sum) if sum == part.sum => {}
                Ok(_) => return Ok(false),
                Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(false),
                Err(source) => return Err(ReadError::File { path: path.to_path_buf(), source }),
            }
        }
        Ok(true)
    }

    /// The byte from which on the file may have become another.
    pub(crate) fn end(&self) -> u64 {
        self.end
    }
}

/// Where the parts of so many bytes lie, and their lengths: without a gap between them if all of it fits in.
fn places(bytes: u64) -> impl Iterator<Item = (u64, u64)> {
    let last = bytes.saturating_sub(PART_BYTES);
    (0..PARTS).map(move |part| (last * part / (PARTS - 1), PART_BYTES.min(bytes)))
}

fn sum(file: &File, at: u64, bytes: u64) -> io::Result<u32> {
    let mut part = vec![0; bytes as usize];
    file.read_exact_at(&mut part, at)?;
    Ok(crc32fast::hash(&part))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_reach_from_the_first_byte_to_the_last_and_leave_none_out_of_a_megabyte() {
        for bytes in [0, 8, PART_BYTES - 1, PART_BYTES, PART_BYTES + 1, 100_003, PARTS * PART_BYTES, 7_000_000_001] {
            let places: Vec<(u64, u64)> = places(bytes).collect();
            assert!(places[0].0 == 0 && places[PARTS as usize - 1].0 + places[PARTS as usize - 1].1 == bytes, "{bytes}");
            let is_whole = places.windows(2).all(|pair| pair[1].0 <= pair[0].0 + pair[0].1);
            assert_eq!(is_whole, bytes <= PARTS * PART_BYTES, "{bytes}");
        }
    }
}
