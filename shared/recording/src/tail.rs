//! The end of a file that somebody else writes: what comes to it from some moment on. What was there before is not read, so that a file of days costs no more
//! than a new one.
//!
//! Promise: what is given is as it stands in the file, in a block with its checksum, and comes once; nothing is given of what lies behind a block that cannot be
//! read; and a look has an end, whatever is written.

use crate::before::Before;
use crate::block::Block;
use crate::decode::{States, chunk};
use crate::error::ReadError;
use crate::frame::Walk;
use crate::reader::open_file;
use crate::unpack::Unpacker;
use mcap::records::op;
use std::path::{Path, PathBuf};

/// After so many bytes of the file, or so many ticks, a look is over: a recorder writes 1 MB in a second at most, in 4 s half of these bytes.
const MOST_BYTES: u64 = 8 << 20;
const MOST_TICKS: usize = 60_000;
/// Bytes that are read at once.
const AT_ONCE_BYTES: usize = 16 << 10;

/// The end of a file.
pub struct Tail {
    path: PathBuf,
    /// Where the next record begins.
    at: u64,
    unpacker: Unpacker,
}

impl Tail {
    /// What comes to a file from now on; of a block that is being written just now nothing is given. A file that is not there yet is read from its beginning.
    pub fn of(path: &Path) -> Tail {
        let at = std::fs::metadata(path).map_or(0, |file| file.len());
        Tail { path: path.to_path_buf(), at, unpacker: Unpacker::default() }
    }

    /// What comes behind that which a file held, and its last two blocks of then, which may not have been all there.
    pub fn behind(path: &Path, before: &Before) -> Tail {
        Tail { path: path.to_path_buf(), at: before.end(), unpacker: Unpacker::default() }
    }

    /// What has come since the last look, in the file's order, but for states. Where the file has become shorter, as by whoever goes on in it and cuts its
    /// summary away, what comes behind its new end.
    pub fn look(&mut self) -> Result<Block, ReadError> {
        let refused = |source| ReadError::File { path: self.path.clone(), source };
        let mut come = Block::default();
        let Some(mut walk) = Walk::begin(open_file(&self.path)?).map_err(refused)? else { return Ok(come) };
        walk.read_ahead(AT_ONCE_BYTES);
        let first = self.at.min(walk.length()).max(walk.at());
        walk.back_to(first);
        let mut at = first;
        while at - first < MOST_BYTES
            && come.applied.len() < MOST_TICKS
            && let Some(frame) = walk.next().map_err(refused)?
        {
            if frame.opcode == op::CHUNK {
                let body = walk.body(&frame, u64::MAX).map_err(refused)?;
                // It is looked at again: that it is not all there yet is as likely.
                let Ok(mut block) = chunk(&mut self.unpacker, &body, States::Checked) else { break };
                block.precede(come);
                come = block;
            }
            at = walk.at();
        }
        self.at = at;
        Ok(come)
    }
}
