//! The writer: appends blocks to one file, goes on in a file that a predecessor left, and closes it with a summary over everything.
//!
//! Promise: whatever is refused (full disk, failed write), the file stays as long as its last whole block; the same block may be tried again.
//! One writer at a time: the file is locked while it is open, so that a recorder that was stopped and goes on later finds nothing changed
//! under it, and its successor waits.

use crate::block::{self, Block};
use crate::channels::Channel;
use crate::recover::{Found, recover};
use crate::summary::{self, Contents};
use crate::{FORMAT, Session};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// Why something cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The file cannot be made or opened.
    #[error("recording {path}: {source}; give --record a path in a folder that exists and may be written")]
    Open {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Another process writes it.
    #[error("recording {path} is being written by another process; stop it, or give --record another file")]
    Locked {
        /// The file.
        path: PathBuf,
    },
    /// The file holds something else.
    #[error("recording {path} exists and {holds}; move it away, or give --record another file")]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What it holds.
        holds: &'static str,
    },
    /// No room: the disk, the quota or the limit.
    #[error("recording {path}: no room for {bytes} bytes more; make room, the recorder tries again")]
    Full {
        /// The file.
        path: PathBuf,
        /// Bytes that did not fit.
        bytes: usize,
    },
    /// The write failed otherwise.
    #[error("recording {path}: {source}; look at the disk")]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A block cannot be put into bytes.
    #[error("a block of the recording cannot be encoded: {0}")]
    Encode(String),
}

impl WriteError {
    pub(crate) fn encode(error: mcap::McapError) -> WriteError {
        WriteError::Encode(error.to_string())
    }
}

/// A recording that is being written.
#[derive(Debug)]
pub struct Writer {
    path: PathBuf,
    file: File,
    end: u64,
    limit_bytes: u64,
    contents: Contents,
    last_tick: Option<u64>,
    lost: u64,
    continued: bool,
}

impl Writer {
    /// Begins the recording of `session`, or goes on in a file that has its `session` fact: what follows the last whole block (a torn
    /// block, a summary) is cut away. A file with anything else is refused and left as it is.
    pub fn open(path: &Path, session: &Session) -> Result<Writer, WriteError> {
        let refused = |source| WriteError::Open { path: path.to_path_buf(), source };
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path).map_err(refused)?;
        if !file.metadata().map_err(refused)?.is_file() {
            return Err(refused(io::Error::new(ErrorKind::InvalidInput, "not a regular file")));
        }
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(WriteError::Locked { path: path.to_path_buf() });
            }
            Err(TryLockError::Error(source)) => return Err(refused(source)),
        }
        let mut facts = session.clone();
        facts.insert("format".into(), FORMAT.into());
        let (head, index) = block::head(&facts)?;
        let found = inherit(path, &file, &facts, &head)?;
        let mut writer = Writer {
            path: path.to_path_buf(),
            file,
            end: found.end,
            limit_bytes: u64::MAX,
            contents: found.contents,
            last_tick: found.last_tick,
            lost: found.lost,
            continued: found.session.is_some(),
        };
        writer.file.set_len(writer.end).map_err(refused)?;
        if !writer.continued {
            writer.put(&head)?;
            writer.contents.metadata.push(index);
        }
        Ok(writer)
    }

    /// Lets the file grow to at most this many bytes; what would be longer is refused as [`WriteError::Full`].
    pub fn set_limit(&mut self, limit_bytes: u64) {
        self.limit_bytes = limit_bytes;
    }

    /// Appends a block; an empty one writes nothing. After an error the file is as before, and the block may be tried again.
    pub fn append(&mut self, block: &Block) -> Result<(), WriteError> {
        if block.is_empty() {
            return Ok(());
        }
        let mut encoded = block::encode(block)?;
        let base = self.end;
        self.put(&encoded.bytes)?;
        block::move_chunk(&mut encoded.chunk, |offset| offset + base);
        encoded.metadata.iter_mut().for_each(|index| index.offset += base);
        self.contents.chunks.push(encoded.chunk);
        self.contents.metadata.append(&mut encoded.metadata);
        for (id, count) in encoded.counts {
            *self.contents.counts.entry(id).or_insert(0) += count;
        }
        self.last_tick = block.applied.iter().map(|record| record.tick).max().max(self.last_tick);
        self.lost += block.lost.iter().map(|range| range.count()).sum::<u64>();
        Ok(())
    }

    /// Writes the summary over all blocks of all writers, and unlocks the file. Without it the file is readable too.
    pub fn finish(mut self) -> Result<u64, WriteError> {
        let bytes = summary::encode(&self.contents, self.end);
        self.put(&bytes)?;
        Ok(self.end)
    }

    /// Newest tick on disk.
    pub fn last_tick(&self) -> Option<u64> {
        self.last_tick
    }
    /// Ticks on disk.
    pub fn ticks(&self) -> u64 {
        self.contents.counts.get(&(Channel::Force as u16)).copied().unwrap_or(0)
    }
    /// Ticks that the file says are lost.
    pub fn lost(&self) -> u64 {
        self.lost
    }
    /// Bytes on disk.
    pub fn bytes(&self) -> u64 {
        self.end
    }
    /// Whether the file was begun by a predecessor.
    pub fn is_continued(&self) -> bool {
        self.continued
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), WriteError> {
        let full = || WriteError::Full { path: self.path.clone(), bytes: bytes.len() };
        if self.end.saturating_add(bytes.len() as u64) > self.limit_bytes {
            return Err(full());
        }
        if let Err(source) = self.file.write_all_at(bytes, self.end) {
            // The torn block goes. If even that fails, the next write begins at the same byte, and a reader stops before it.
            let _ = self.file.set_len(self.end);
            let is_full = matches!(source.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge);
            return Err(if is_full { full() } else { WriteError::Write { path: self.path.clone(), source } });
        }
        self.end += bytes.len() as u64;
        Ok(())
    }
}

/// What there is to go on from; nothing for a new file or one that a predecessor of the same kind was cut off in at once.
fn inherit(path: &Path, file: &File, facts: &Session, head: &[u8]) -> Result<Found, WriteError> {
    let refused = |source| WriteError::Open { path: path.to_path_buf(), source };
    let foreign = |holds| WriteError::Foreign { path: path.to_path_buf(), holds };
    let length = file.metadata().map_err(refused)?.len();
    let mut start = vec![0; length.min(head.len() as u64) as usize];
    file.read_exact_at(&mut start, 0).map_err(refused)?;
    if length < head.len() as u64 && same_kind(&start, head) {
        return Ok(Found::default());
    }
    let found = recover(file).map_err(refused)?.ok_or(foreign("is not an MCAP file"))?;
    let session = found.session.as_ref().ok_or(foreign("is not a recording of a station"))?;
    if session.get("format") != facts.get("format") {
        return Err(foreign("is a recording of another version"));
    }
    if session.get("session") != facts.get("session") {
        return Err(foreign("holds another session"));
    }
    Ok(found)
}

/// Whether a short file is the beginning of a head: the same bytes up to the facts, which another version may order otherwise.
fn same_kind(start: &[u8], head: &[u8]) -> bool {
    const BEFORE_FACTS: usize = mcap::MAGIC.len() + 9 + 4 + 4 + block::LIBRARY.len();
    let common = start.len().min(BEFORE_FACTS);
    start[..common] == head[..common]
}
