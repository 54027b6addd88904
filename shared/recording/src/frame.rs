//! The records of a file one after the other, by their frames (opcode, length, body) alone, with the byte at which each begins. Nothing is
//! believed beyond the file's length, nothing longer than [`MAX_RECORD_BYTES`] is read, and a length is believed only where what else the record says of
//! itself agrees: one flipped bit costs no more than the block that it hit. Behind what is no record the walk goes on at the next chunk, which is known by its
//! compression's name and by the two lengths in it that agree.

use crate::summary::FOOTER_BYTES;
use mcap::records::{Record, op};
use std::io::{self, Read, Seek, SeekFrom};

/// Longest record that is read, before and after decompression: a block of a second has less than 1 MB.
pub(crate) const MAX_RECORD_BYTES: u64 = 64 << 20;
/// The opcode that no record has.
const NO_RECORD: u8 = 0;
/// Bytes of opcode and length.
pub(crate) const HEAD_BYTES: u64 = 9;

/// Bytes of a message index before its entries: channel and length of the entries.
pub(crate) const INDEX_HEAD_BYTES: u64 = 6;
/// Bytes of a data end.
pub(crate) const DATA_END_BYTES: u64 = 4;

/// What stands in the head of every chunk that a recorder writes, and where: the compression's name with its length.
pub(crate) const COMPRESSION: &[u8] = b"\x04\0\0\0zstd";
const COMPRESSION_AT: usize = HEAD_BYTES as usize + COMPRESSION_IN_BODY as usize;
/// Where it stands in the body: behind two times, size and checksum.
const COMPRESSION_IN_BODY: u64 = 28;
/// Bytes of a chunk's head, up to the blocks' messages: opcode and length, two times, size, checksum, compression, compressed size.
const CHUNK_HEAD_BYTES: usize = COMPRESSION_AT + 16;
/// Bytes of a record from which it is known: those of a chunk's head, or of a metadata record up to the length of its facts, whose name is a word.
const LOOK_BYTES: usize = 64;
/// Bytes of the length of a text, or of facts, before it, and of a size.
const TEXT_HEAD_BYTES: u64 = 4;
const SIZE_BYTES: u64 = 8;
/// Bytes in which the next chunk is looked for at once.
const WINDOW_BYTES: usize = 1 << 20;

/// Place of a record.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) at: u64,
    pub(crate) opcode: u8,
    pub(crate) length: u64,
}

impl Frame {
    /// The byte after the record.
    pub(crate) fn end(&self) -> u64 {
        self.at + HEAD_BYTES + self.length
    }
}

/// A walk over the frames of a file.
pub(crate) struct Walk<R> {
    inner: R,
    at: u64,
    length: u64,
    /// Bytes that are read at once where fewer are asked for.
    ahead_bytes: usize,
    /// What was read of the file so, and where that begins.
    held: Vec<u8>,
    held_at: u64,
}

impl<R: Read + Seek> Walk<R> {
    /// A walk that begins after the magic; `None` if the file does not begin with it.
    pub(crate) fn begin(mut inner: R) -> io::Result<Option<Walk<R>>> {
        let length = inner.seek(SeekFrom::End(0))?;
        let at = mcap::MAGIC.len() as u64;
        if length < at {
            return Ok(None);
        }
        let mut magic = [0; mcap::MAGIC.len()];
        inner.seek(SeekFrom::Start(0))?;
        inner.read_exact(&mut magic)?;
        Ok((magic == mcap::MAGIC).then_some(Walk { inner, at, length, ahead_bytes: 0, held: Vec::new(), held_at: 0 }))
    }

    /// From now on so many bytes are read at once, as far as the file had them when the walk began: who goes from record to record asks the system for each
    /// head otherwise, some nine times for a block. 0: no more than is asked for.
    pub(crate) fn read_ahead(&mut self, bytes: usize) {
        self.ahead_bytes = bytes;
    }

    /// The next record that lies in the file as a whole, here or behind what is none. Zeros are none: what a power cut or a hole left of a file is
    /// not walked through nine bytes at a time.
    pub(crate) fn next(&mut self) -> io::Result<Option<Frame>> {
        let frame = match self.frame_at(self.at)? {
            Some(frame) => Some(frame),
            None => self.chunk_behind(self.at)?,
        };
        self.at = frame.map_or(self.at, |frame| frame.end());
        Ok(frame)
    }

    /// The next record of the summary, by its length alone: behind one that is damaged nothing can be known.
    pub(crate) fn next_of_summary(&mut self) -> io::Result<Option<Frame>> {
        let mut head = [0; HEAD_BYTES as usize];
        if self.length.saturating_sub(self.at) < HEAD_BYTES {
            return Ok(None);
        }
        self.read(self.at, &mut head)?;
        let frame = self.fitting(self.at, &head);
        self.at = frame.map_or(self.at, |frame| frame.end());
        Ok(frame)
    }

    /// The record at a byte, if there is one. One of a kind that no recorder writes says nothing of itself but its length, which is believed where another
    /// record, or nothing, follows.
    fn frame_at(&mut self, at: u64) -> io::Result<Option<Frame>> {
        let Some((frame, is_known)) = self.look(at)? else { return Ok(None) };
        let is_one = is_known || frame.end() == self.length || self.look(frame.end())?.is_some();
        Ok(Some(frame).filter(|_| is_one))
    }

    /// What can be a record at a byte, and whether it is known to be one.
    fn look(&mut self, at: u64) -> io::Result<Option<(Frame, bool)>> {
        let mut head = [0; LOOK_BYTES];
        let rest = self.length.saturating_sub(at);
        let head = &mut head[..rest.min(LOOK_BYTES as u64) as usize];
        if rest < HEAD_BYTES {
            return Ok(None);
        }
        self.read(at, head)?;
        let Some(frame) = self.fitting(at, head) else { return Ok(None) };
        let own = own_length(head);
        Ok(Some((frame, own.is_some())).filter(|_| own.is_none_or(|own| own == frame.length)))
    }

    /// The record whose opcode and length these are, if it lies in the file as a whole.
    fn fitting(&self, at: u64, head: &[u8]) -> Option<Frame> {
        let ([opcode, length @ ..], _) = head.split_first_chunk::<{ HEAD_BYTES as usize }>()?;
        let frame = Frame { at, opcode: *opcode, length: u64::from_le_bytes(*length) };
        let longest = MAX_RECORD_BYTES.min(self.length.checked_sub(at)?.checked_sub(HEAD_BYTES)?);
        (frame.opcode != NO_RECORD && frame.length <= longest).then_some(frame)
    }

    /// The first chunk behind a byte, as far as a record may reach.
    fn chunk_behind(&mut self, at: u64) -> io::Result<Option<Frame>> {
        let end = self.length.min(at + MAX_RECORD_BYTES);
        let mut window = Vec::new();
        let mut from = at + 1;
        while from + CHUNK_HEAD_BYTES as u64 <= end {
            window.resize(WINDOW_BYTES.min((end - from) as usize), 0);
            self.read(from, &mut window)?;
            for name in memchr::memmem::find_iter(&window, COMPRESSION) {
                let head = name.checked_sub(COMPRESSION_AT).and_then(|first| window.get(first..first + CHUNK_HEAD_BYTES));
                if head.and_then(chunk_length).is_some()
                    && let Some(frame) = self.frame_at(from + (name - COMPRESSION_AT) as u64)?
                {
                    return Ok(Some(frame));
                }
            }
            // A head may lie across the border.
            from += (window.len() - CHUNK_HEAD_BYTES + 1) as u64;
        }
        Ok(None)
    }

    /// Goes on with the record at a byte.
    pub(crate) fn back_to(&mut self, at: u64) {
        self.at = at;
    }

    /// Where the next record begins.
    pub(crate) fn at(&self) -> u64 {
        self.at
    }

    /// Length of the file.
    pub(crate) fn length(&self) -> u64 {
        self.length
    }

    /// The first `most` bytes of a record's body.
    pub(crate) fn body(&mut self, frame: &Frame, most: u64) -> io::Result<Vec<u8>> {
        let mut body = vec![0; frame.length.min(most).min(MAX_RECORD_BYTES) as usize];
        self.read(frame.at + HEAD_BYTES, &mut body)?;
        Ok(body)
    }

    /// The bytes at a place in the file, as far as they are held from there.
    fn read(&mut self, at: u64, into: &mut [u8]) -> io::Result<()> {
        let held = at.checked_sub(self.held_at).and_then(|from| self.held.get(from as usize..)).unwrap_or_default();
        let known = held.len().min(into.len());
        into[..known].copy_from_slice(&held[..known]);
        let rest = &mut into[known..];
        if rest.is_empty() {
            return Ok(());
        }
        self.inner.seek(SeekFrom::Start(at + known as u64))?;
        if rest.len() >= self.ahead_bytes {
            return self.inner.read_exact(rest);
        }
        self.hold(at, known, rest.len())?;
        rest.copy_from_slice(&self.held[known..known + rest.len()]);
        Ok(())
    }

    /// Reads at least so many bytes from where the file stands, and holds them behind those, the last that are held, which are known from a byte on.
    fn hold(&mut self, at: u64, known: usize, least: usize) -> io::Result<()> {
        let most = self.length.saturating_sub(at + known as u64).min(self.ahead_bytes as u64) as usize;
        let mut held = std::mem::take(&mut self.held); // nothing is held of what cannot be read
        held.drain(..held.len() - known);
        held.resize(known + most.max(least), 0);
        let count = match self.inner.read(&mut held[known..]) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => 0,
            read => read?,
        };
        if count < least {
            self.inner.read_exact(&mut held[known + count..known + least])?;
        }
        held.truncate(known + count.max(least));
        (self.held, self.held_at) = (held, at);
        Ok(())
    }
}

/// The length that a record has to have by what else its head says; `None` of a kind that no recorder writes before its summary. What cannot be read is no length
/// that any record has.
fn own_length(head: &[u8]) -> Option<u64> {
    let text_bytes = |at: u64| {
        let at = usize::try_from(HEAD_BYTES + at).ok()?;
        head.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes).map(u64::from)
    };
    let size = |at: u64| {
        let at = usize::try_from(HEAD_BYTES + at).ok()?;
        head.get(at..at + 8)?.try_into().ok().map(u64::from_le_bytes)
    };
    let length = match *head.first()? {
        // Of what is compressed, behind the compression's name, which is another where somebody has rewritten the file.
        op::CHUNK => text_bytes(COMPRESSION_IN_BODY).and_then(|name| {
            let before = COMPRESSION_IN_BODY + TEXT_HEAD_BYTES + name;
            size(before)?.checked_add(before + SIZE_BYTES)
        }),
        // Of its entries, behind the channel.
        op::MESSAGE_INDEX => text_bytes(INDEX_HEAD_BYTES - TEXT_HEAD_BYTES).map(|entries| INDEX_HEAD_BYTES + entries),
        // Profile and library; name and facts.
        op::HEADER | op::METADATA => {
            text_bytes(0).and_then(|first| Some(2 * TEXT_HEAD_BYTES + first + text_bytes(TEXT_HEAD_BYTES + first)?))
        }
        op::DATA_END => Some(DATA_END_BYTES),
        op::FOOTER => Some(FOOTER_BYTES),
        _ => return None,
    };
    Some(length.unwrap_or(u64::MAX))
}

/// The length that the head of a chunk says twice; `None` if it does not.
fn chunk_length(head: &[u8]) -> Option<u64> {
    let word = |at: usize| head.get(at..at + 8)?.try_into().ok().map(u64::from_le_bytes);
    let length = word(1)?;
    let compressed = word(COMPRESSION_AT + COMPRESSION.len())?;
    (head.first() == Some(&op::CHUNK) && compressed.checked_add((CHUNK_HEAD_BYTES as u64) - HEAD_BYTES)? == length)
        .then_some(length)
}

/// A metadata record's name and facts.
pub(crate) fn metadata(body: &[u8]) -> Result<mcap::records::Metadata, String> {
    match mcap::parse_record(mcap::records::op::METADATA, body).map_err(|e| e.to_string())? {
        Record::Metadata(metadata) => Ok(metadata),
        _ => Err("not a metadata record".into()),
    }
}
