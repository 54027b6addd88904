//! The writer: appends blocks to one file, goes on in a file that a predecessor left, and closes it with a summary over everything.
//!
//! Promise: whatever is refused (full disk, failed write), the file stays as long as its last whole block; the same block may be tried again. What a sync has
//! found kept outlives a power cut; what a disk took and did not keep is counted, and named in the file for whoever goes on in it.
//! One writer at a time: the file is locked while it is open, so that a recorder that was stopped and goes on later finds nothing changed
//! under it, and its successor waits.

use crate::block::{self, Block, TickRange};
use crate::channels::Channel;
use crate::error::WriteError;
use crate::recover::{Found, recover};
use crate::summary::{self, Contents};
use crate::sync::Disk;
use crate::{FORMAT, Session};
use mcap::records::MetadataIndex;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind};
use std::os::unix::fs::FileExt;
use std::path::Path;

/// Ticks at the end of a predecessor's file about which it may not have asked the disk: as many as it writes between two times.
const NEWEST_TICKS: u64 = 5_000;

/// A recording that is being written.
#[derive(Debug)]
pub struct Writer {
    disk: Disk,
    end: u64,
    limit_bytes: u64,
    contents: Contents,
    last_tick: Option<u64>,
    lost: u64,
    continued: bool,
    /// Bytes about which the disk was asked.
    synced_end: u64,
    /// Ticks in what is behind them.
    unsynced: Vec<TickRange>,
    /// Ticks that the disk did not keep, which the file does not name yet.
    unnoted: Vec<TickRange>,
    /// The record with the session's facts, and whether it stands behind the file's head once more.
    facts: Vec<u8>,
    is_repeated: bool,
}

/// A recording that has its summary, or was refused it: nothing is appended to it any more.
#[derive(Debug)]
pub struct Closed {
    writer: Writer,
    blocks_end: u64,
}

impl Closed {
    /// As [`Writer::ask`].
    pub fn ask(&mut self) -> Vec<TickRange> {
        self.writer.ask()
    }

    /// As [`Writer::heed`].
    pub fn heed(&mut self, answer: Result<(), WriteError>) -> Result<(), WriteError> {
        self.writer.heed(answer)
    }

    /// Names in the file what the disk did not keep, as [`Writer::note`], and writes the summary again behind it.
    pub fn note(&mut self) -> Result<(), WriteError> {
        let Writer { disk, unnoted, end, .. } = &mut self.writer;
        if unnoted.is_empty() {
            return Ok(());
        }
        disk.file.set_len(self.blocks_end).map_err(|source| WriteError::Write { path: disk.path.clone(), source })?;
        *end = self.blocks_end;
        let noted = self.writer.note();
        self.blocks_end = self.writer.end;
        let summary = self.writer.summarize();
        noted.and(summary)
    }

    /// Has the disk keep it, as [`Writer::sync`], and unlocks the file; gives its length, bytes.
    pub fn sync(mut self) -> Result<u64, WriteError> {
        let kept = self.writer.sync();
        let _ = self.note(); // what is told is worse
        kept.map(|()| self.writer.end)
    }
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
        let unsynced = newest(&found);
        let known = found.session.as_ref().filter(|_| found.facts > 0);
        let (mut record, at) = block::head(known.unwrap_or(&facts))?;
        record.drain(..at.offset as usize);
        let mut writer = Writer {
            disk: Disk { path: path.to_path_buf(), file, sync_data: File::sync_data },
            end: found.end,
            limit_bytes: u64::MAX,
            contents: found.contents,
            last_tick: found.last_tick,
            lost: found.lost,
            continued: found.session.is_some(),
            synced_end: 0,
            unsynced,
            unnoted: Vec::new(),
            facts: record,
            is_repeated: found.facts > 1,
        };
        writer.disk.file.set_len(writer.end).map_err(refused)?;
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

    /// Lets this stand for the system's `fdatasync`: a disk that refuses it, or takes its time, cannot be had in a test otherwise.
    pub fn set_sync(&mut self, sync_data: fn(&File) -> io::Result<()>) {
        self.disk.sync_data = sync_data;
    }

    /// Appends a block, behind what is to be noted; an empty one writes nothing. After an error nothing of it is in the file, and it may be tried again. Before
    /// the second block the session's facts are written once more: a file that is never closed has them twice, too, with a block between them.
    pub fn append(&mut self, block: &Block) -> Result<(), WriteError> {
        if block.is_empty() {
            return Ok(());
        }
        self.note()?;
        if !self.is_repeated && !self.contents.is_empty() {
            self.repeat()?;
        }
        let mut encoded = block::encode(block)?;
        let base = self.end;
        self.put(&encoded.bytes)?;
        block::move_chunk(&mut encoded.chunk, |offset| offset + base);
        encoded.metadata.iter_mut().for_each(|index| index.offset += base);
        self.contents.add(&encoded.chunk);
        self.contents.metadata.append(&mut encoded.metadata);
        for (id, count) in encoded.counts {
            *self.contents.counts.entry(id).or_insert(0) += count;
        }
        self.last_tick = block.applied.iter().map(|record| record.tick).max().max(self.last_tick);
        block.applied.iter().for_each(|record| TickRange::extend(&mut self.unsynced, record.tick));
        self.lost = block.lost.iter().map(TickRange::count).fold(self.lost, u64::saturating_add);
        Ok(())
    }

    /// Whether something was written of which the disk has not said that it keeps it.
    pub fn is_unsynced(&self) -> bool {
        self.end != self.synced_end
    }

    /// The file for a thread that asks the disk to keep what was written, while this one goes on: [`Writer::ask`] says of what, [`Disk::keep`] asks, and
    /// [`Writer::heed`] takes the answer.
    pub fn disk(&self) -> io::Result<Disk> {
        self.disk.share()
    }

    /// The ticks in what was written since the disk was last asked; it counts as asked now.
    pub fn ask(&mut self) -> Vec<TickRange> {
        self.synced_end = self.end;
        std::mem::take(&mut self.unsynced)
    }

    /// Takes what the disk answered and gives it back. The system tells of a failure once, which may be of what was written after it was asked: that counts as
    /// not kept, too, and the next time is of what is written later.
    pub fn heed(&mut self, mut answer: Result<(), WriteError>) -> Result<(), WriteError> {
        if let Err(WriteError::Unsynced { ranges, .. }) = &mut answer {
            ranges.append(&mut self.unsynced);
            self.unnoted.extend_from_slice(ranges);
        }
        answer
    }

    /// Names in the file what the disk did not keep, so that whoever goes on in it knows; what is refused is tried again with the next block.
    pub fn note(&mut self) -> Result<(), WriteError> {
        if self.unnoted.is_empty() {
            return Ok(());
        }
        let (bytes, mut indexes) = block::unkept(&self.unnoted)?;
        let base = self.end;
        self.put(&bytes)?;
        indexes.iter_mut().for_each(|index| index.offset += base);
        self.contents.metadata.append(&mut indexes);
        self.unnoted.clear();
        Ok(())
    }

    /// Has the disk keep what was written, as [`Disk::keep`]; that takes as long as the disk does.
    pub fn sync(&mut self) -> Result<(), WriteError> {
        let ranges = self.ask();
        let answer = self.disk.keep(ranges);
        self.heed(answer)
    }

    /// Writes the session's facts once more and the summary over all blocks of all writers, and says what became of that; without it the file is readable too.
    pub fn close(mut self) -> (Closed, Result<(), WriteError>) {
        let _ = self.note(); // whoever asked the disk knows it
        let _ = self.repeat(); // the summary is refused, too
        let blocks_end = self.end;
        let summary = self.summarize();
        (Closed { writer: self, blocks_end }, summary)
    }

    /// Writes the summary, has the disk keep all of it, and unlocks the file; gives its length, bytes. Where the summary is refused, the rest is to be kept.
    pub fn finish(self) -> Result<u64, WriteError> {
        let (closed, summary) = self.close();
        let bytes = closed.sync()?; // what is not kept is worse
        summary.map(|()| bytes)
    }

    /// Newest tick on disk.
    pub fn last_tick(&self) -> Option<u64> {
        self.last_tick
    }
    /// Ticks on disk.
    pub fn ticks(&self) -> u64 {
        self.contents.counts.get(&(Channel::Force as u16)).copied().unwrap_or(0)
    }
    /// Ticks that the file says are lost, or that the disk did not keep of what a predecessor wrote; what it did not keep since is told with the answer.
    pub fn lost(&self) -> u64 {
        self.lost
    }
    /// Files of the scene on disk; more than it has if several writers began with them.
    pub fn scene_files(&self) -> u64 {
        self.contents.counts.get(&(Channel::Scene as u16)).copied().unwrap_or(0)
    }
    /// Bytes on disk.
    pub fn bytes(&self) -> u64 {
        self.end
    }
    /// Whether the file was begun by a predecessor.
    pub fn is_continued(&self) -> bool {
        self.continued
    }

    /// Writes the session's facts once more.
    fn repeat(&mut self) -> Result<(), WriteError> {
        let (offset, length) = (self.end, self.facts.len() as u64);
        self.put(&self.facts.clone())?;
        self.contents.metadata.push(MetadataIndex { offset, length, name: block::STATION.into() });
        self.is_repeated = true;
        Ok(())
    }

    fn summarize(&mut self) -> Result<(), WriteError> {
        let contents = std::mem::take(&mut self.contents);
        let [before, behind] = summary::encode(&contents, self.end);
        let put = self.put_all(&[&before, contents.chunk_indexes(), &behind]);
        self.contents = contents;
        put
    }

    fn put(&mut self, bytes: &[u8]) -> Result<(), WriteError> {
        self.put_all(&[bytes])
    }

    /// Writes all parts one behind the other, or nothing.
    fn put_all(&mut self, parts: &[&[u8]]) -> Result<(), WriteError> {
        let bytes = parts.iter().map(|part| part.len()).sum::<usize>();
        let full = || WriteError::Full { path: self.disk.path.clone(), bytes };
        if self.end.saturating_add(bytes as u64) > self.limit_bytes {
            return Err(full());
        }
        let write = |at: u64, part: &&[u8]| self.disk.file.write_all_at(part, at).map(|()| at + part.len() as u64);
        if let Err(source) = parts.iter().try_fold(self.end, write) {
            // The torn block goes. If even that fails, the next write begins at the same byte, and a reader stops before it.
            let _ = self.disk.file.set_len(self.end);
            let is_full = matches!(source.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge);
            return Err(if is_full { full() } else { WriteError::Write { path: self.disk.path.clone(), source } });
        }
        self.end += bytes as u64;
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

/// The newest ticks of a file that somebody else began, but for those that it names itself: nobody knows whether the disk was asked for them.
fn newest(found: &Found) -> Vec<TickRange> {
    let ticks = found.contents.counts.get(&(Channel::Force as u16)).copied().unwrap_or(0).min(NEWEST_TICKS);
    let (Some(last), true) = (found.last_tick, ticks > 0) else { return Vec::new() };
    let first = last.saturating_sub(ticks - 1);
    let named: Vec<&TickRange> = found.named.iter().filter(|range| range.last >= first).collect();
    let is_named = |tick: &u64| named.iter().any(|range| (range.first..=range.last).contains(tick));
    let mut newest = Vec::new();
    (first..=last).filter(|tick| !is_named(tick)).for_each(|tick| TickRange::extend(&mut newest, tick));
    newest
}

/// Whether a short file is the beginning of a head: the same bytes up to the facts, which another version may order otherwise.
fn same_kind(start: &[u8], head: &[u8]) -> bool {
    const BEFORE_FACTS: usize = mcap::MAGIC.len() + 9 + 4 + 4 + block::LIBRARY.len();
    let common = start.len().min(BEFORE_FACTS);
    start[..common] == head[..common]
}
