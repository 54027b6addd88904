//! What a referee has judged of a session's case up to a tick, as text of its own: whoever begins there goes on from it, and has not to read what was before.

use crate::channels::Channel;
use crate::error::ReadError;
use crate::reader::Reader;
use serde::{Deserialize, Serialize};
use std::io::{Read, Seek};

/// What was judged, as the message of `/judged` has it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Judged {
    /// The newest tick that the referee has seen.
    pub tick: u64,
    /// Tick of the newest status of the tissue that it has seen, 0 before the first.
    pub tissue_tick: u64,
    /// The referee: JSON that only its own program reads.
    pub judge: String,
}

impl<R: Read + Seek> Reader<R> {
    /// The newest judgement of a file up to a tick; `None` where none was recorded by then, or none is whole. The next block stays the same.
    pub fn judged(&mut self, up_to_tick: u64) -> Result<Option<Judged>, ReadError> {
        let next_at = self.next_at();
        let mut newest: Option<Judged> = None;
        for frame in self.blocks_with(Channel::Judged, up_to_tick)? {
            let Ok(block) = self.block_at(&frame)? else { continue }; // damaged: an older one serves
            let found = block.judged.into_iter().filter(|found| found.tick <= up_to_tick);
            newest = newest.into_iter().chain(found).max_by_key(|judged| judged.tick);
        }
        self.back_to(next_at);
        Ok(newest)
    }
}
