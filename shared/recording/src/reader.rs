//! The reader: block by block, without a summary, so that a file that was cut reads like a whole one up to the cut.
//!
//! Promise: what is damaged is named with its byte and left out, what follows it is read; a record that is given is what was written.

use crate::Session;
use crate::block::Block;
use crate::decode::{Raw, States, chunk};
use crate::error::{ReadError, version};
use crate::facts;
use crate::frame::{Frame, Walk};
use crate::unpack::Unpacker;
use hyst_messages::AppliedRecord;
use mcap::records::op;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Most damaged records that are told one by one; a file that is all damage has no end of them.
const MOST_DAMAGE: usize = 1_000;

/// A part of the file that was left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// Byte at which the damaged record begins.
    pub at: u64,
    /// What is wrong with it.
    pub reason: String,
}

/// How the file ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// It was closed by its writer.
    Complete,
    /// The last whole record ends at this byte; its writer died, still writes, or the file was cut.
    Cut {
        /// The byte.
        at: u64,
    },
}

/// A recording that is read block by block; `R` is a file or bytes in memory.
pub struct Reader<R> {
    walk: Walk<R>,
    path: PathBuf,
    session: Session,
    damage: Vec<Damage>,
    ending: Option<Ending>,
    unpacker: Unpacker,
}

/// Opens a file that is to be read as a recording. What is no file is refused: it may wait for a writer, or have no end.
pub fn open_file(path: &Path) -> Result<File, ReadError> {
    let refused = |source| ReadError::File { path: path.to_path_buf(), source };
    if !std::fs::metadata(path).map_err(refused)?.is_file() {
        return Err(ReadError::Foreign { path: path.to_path_buf(), what: "is not a file".into() });
    }
    File::open(path).map_err(refused)
}

impl Reader<File> {
    /// Opens a file, as [`open_file`] does, and reads its session's facts.
    pub fn open(path: &Path) -> Result<Reader<File>, ReadError> {
        Reader::new(open_file(path)?, path)
    }
}

impl<R: Read + Seek> Reader<R> {
    /// Reads from `source`; `path` is for messages. Where the facts at the head are damaged, the first whole ones behind them are taken; where there are none,
    /// they are taken as they are, and are damage.
    pub fn new(mut source: R, path: &Path) -> Result<Reader<R>, ReadError> {
        let refused = |source| ReadError::File { path: path.to_path_buf(), source };
        let foreign = |what: String| ReadError::Foreign { path: path.to_path_buf(), what };
        let length = source.seek(SeekFrom::End(0)).map_err(refused)?;
        let Some(mut walk) = Walk::begin(source).map_err(refused)? else {
            let empty = if length == 0 { ": it is empty, nothing was recorded in it" } else { "" };
            return Err(foreign(format!("is not an MCAP file{empty}")));
        };
        let (session, damage) = match facts::at_head(&mut walk).map_err(refused)? {
            Ok((session, true)) => (session, None),
            damaged => {
                let again = facts::behind(&mut walk).map_err(refused)?;
                facts::past_head(&mut walk).map_err(refused)?;
                match (again, damaged) {
                    (Some(session), _) => (session, None), // nothing is missing
                    (None, Ok((session, _))) => (session, Some(Damage { at: facts::HEAD_AT, reason: facts::DAMAGED.into() })),
                    (None, Err(what)) => return Err(foreign(what)),
                }
            }
        };
        version(path, &session)?;
        Ok(Reader {
            walk,
            path: path.to_path_buf(),
            session,
            damage: damage.into_iter().collect(),
            ending: None,
            unpacker: Unpacker::default(),
        })
    }

    /// The session's facts: station, scene hash, versions, settings.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// What was left out so far: the first thousand of it.
    pub fn damage(&self) -> &[Damage] {
        &self.damage
    }

    /// How the file ends; known after the last block.
    pub fn ending(&self) -> Option<Ending> {
        self.ending
    }

    /// The next block; `None` after the last.
    pub fn next_block(&mut self) -> Result<Option<Block>, ReadError> {
        self.next_with(States::Given)
    }

    /// The next block, with what is made of the states in it.
    pub(crate) fn next_with(&mut self, states: States) -> Result<Option<Block>, ReadError> {
        loop {
            let mut before = Vec::new();
            let raw = self.next_raw(&mut before);
            self.note(before);
            let Some(raw) = raw? else { return Ok(None) };
            match raw.decode(&mut self.unpacker, states) {
                Ok(Some(block)) => return Ok(Some(block)),
                Ok(None) => {}
                Err(reason) => self.note([Damage { at: raw.frame.at, reason }]),
            }
        }
    }

    /// The next record that may hold a block; what cannot be one before it goes to `before`.
    pub(crate) fn next_raw(&mut self, before: &mut Vec<Damage>) -> Result<Option<Raw>, ReadError> {
        let path = self.path.clone();
        let refused = move |source| ReadError::File { path: path.clone(), source };
        let mut damaged = |at: u64, reason: String| {
            if before.len() < MOST_DAMAGE {
                before.push(Damage { at, reason });
            }
        };
        while self.ending.is_none() {
            let at = self.walk.at();
            let Some(frame) = self.walk.next().map_err(&refused)? else {
                self.ending = Some(Ending::Cut { at });
                break;
            };
            if frame.at > at {
                damaged(at, format!("is none; nothing can be read up to byte {}", frame.at));
            }
            match frame.opcode {
                op::MESSAGE_INDEX => {}
                op::DATA_END => self.ending = Some(self.close().map_err(&refused)?),
                op::CHUNK | op::METADATA => {
                    let body = self.walk.body(&frame, u64::MAX).map_err(&refused)?;
                    return Ok(Some(Raw { frame, body }));
                }
                _ => damaged(frame.at, "is of a kind that no recorder writes".into()),
            }
        }
        Ok(None)
    }

    /// Tells of damage, which comes in the file's order.
    pub(crate) fn note(&mut self, found: impl IntoIterator<Item = Damage>) {
        let room = MOST_DAMAGE.saturating_sub(self.damage.len());
        self.damage.extend(found.into_iter().take(room));
    }

    /// From now on so many bytes are read at once, up to the end of the blocks.
    pub(crate) fn read_ahead(&mut self, bytes: usize) {
        self.walk.read_ahead(bytes);
    }

    fn refused(&self, source: io::Error) -> ReadError {
        ReadError::File { path: self.path.clone(), source }
    }

    /// The next record, whatever it is.
    pub(crate) fn next_frame(&mut self) -> Result<Option<Frame>, ReadError> {
        self.walk.next().map_err(|source| self.refused(source))
    }

    /// The first `most` bytes of a record.
    pub(crate) fn body(&mut self, frame: &Frame, most: u64) -> Result<Vec<u8>, ReadError> {
        self.walk.body(frame, most).map_err(|source| self.refused(source))
    }

    /// Where the next record begins.
    pub(crate) fn next_at(&self) -> u64 {
        self.walk.at()
    }

    /// Gives the record at a byte next.
    pub(crate) fn back_to(&mut self, at: u64) {
        self.walk.back_to(at);
    }

    /// Length of the file, bytes.
    pub(crate) fn length(&self) -> u64 {
        self.walk.length()
    }

    /// The block of a chunk, or what is wrong with it.
    pub(crate) fn block_at(&mut self, frame: &Frame) -> Result<Result<Block, String>, ReadError> {
        let body = self.body(frame, u64::MAX)?;
        Ok(chunk(&mut self.unpacker, &body, States::Given))
    }

    /// Goes through the summary to the footer, of whose records the heads are enough.
    fn close(&mut self) -> io::Result<Ending> {
        self.walk.read_ahead(0);
        while let Some(frame) = self.walk.next_of_summary()? {
            if frame.opcode == op::FOOTER {
                let is_end = self.walk.length() - self.walk.at() == mcap::MAGIC.len() as u64;
                return Ok(if is_end { Ending::Complete } else { Ending::Cut { at: frame.end() } });
            }
        }
        Ok(Ending::Cut { at: self.walk.at() })
    }
}

/// A whole recording in memory: some 420 bytes for each tick with its step.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// The session's facts.
    pub session: Session,
    /// Everything that was recorded, in the file's order.
    pub content: Block,
    /// What was left out: the first thousand of it.
    pub damage: Vec<Damage>,
    /// How the file ends.
    pub ending: Ending,
}

impl Recording {
    /// Reads a file.
    pub fn read(path: &Path) -> Result<Recording, ReadError> {
        Recording::collect(Reader::open(path)?)
    }

    /// Reads everything that a reader gives.
    pub fn collect<R: Read + Seek>(mut reader: Reader<R>) -> Result<Recording, ReadError> {
        let mut content = Block::default();
        while let Some(block) = reader.next_block()? {
            let before = std::mem::replace(&mut content, block);
            content.precede(before);
        }
        let ending = reader.ending.unwrap_or(Ending::Cut { at: reader.walk.at() });
        Ok(Recording { session: reader.session, content, damage: reader.damage, ending })
    }

    /// Forces and poses by tick.
    pub fn applied(&self) -> &[AppliedRecord] {
        &self.content.applied
    }
}
