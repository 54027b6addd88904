//! The records of a file one after the other, by their frames (opcode, length, body) alone, with the byte at which each begins. Nothing is
//! believed beyond the file's length, and nothing longer than [`MAX_RECORD_BYTES`] is read. Behind what is no record the walk goes on at the next
//! chunk, which is known by its compression's name and by the two lengths in it that agree.

use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
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
const COMPRESSION: &[u8] = b"\x04\0\0\0zstd";
const COMPRESSION_AT: usize = HEAD_BYTES as usize + 28;
/// Bytes of a chunk's head, up to the blocks' messages: opcode and length, two times, size, checksum, compression, compressed size.
const CHUNK_HEAD_BYTES: usize = COMPRESSION_AT + 16;
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
        Ok((magic == mcap::MAGIC).then_some(Walk { inner, at, length }))
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

    /// The record at a byte, if there can be one.
    fn frame_at(&mut self, at: u64) -> io::Result<Option<Frame>> {
        if self.length - at < HEAD_BYTES {
            return Ok(None);
        }
        let mut head = [0; HEAD_BYTES as usize];
        self.inner.seek(SeekFrom::Start(at))?;
        self.inner.read_exact(&mut head)?;
        let [opcode, length @ ..] = head;
        let frame = Frame { at, opcode, length: u64::from_le_bytes(length) };
        let longest = MAX_RECORD_BYTES.min(self.length - at - HEAD_BYTES);
        Ok((opcode != NO_RECORD && frame.length <= longest).then_some(frame))
    }

    /// The first chunk behind a byte, as far as a record may reach.
    fn chunk_behind(&mut self, at: u64) -> io::Result<Option<Frame>> {
        let end = self.length.min(at + MAX_RECORD_BYTES);
        let mut window = Vec::new();
        let mut from = at + 1;
        while from + CHUNK_HEAD_BYTES as u64 <= end {
            window.resize(WINDOW_BYTES.min((end - from) as usize), 0);
            self.inner.seek(SeekFrom::Start(from))?;
            self.inner.read_exact(&mut window)?;
            for name in memchr::memmem::find_iter(&window, COMPRESSION) {
                let head = name.checked_sub(COMPRESSION_AT).and_then(|first| window.get(first..first + CHUNK_HEAD_BYTES));
                if let Some(length) = head.and_then(chunk_length)
                    && let Some(frame) = self.frame_at(from + (name - COMPRESSION_AT) as u64)?
                    && frame.length == length
                {
                    return Ok(Some(frame));
                }
            }
            // A head may lie across the border.
            from += (window.len() - CHUNK_HEAD_BYTES + 1) as u64;
        }
        Ok(None)
    }

    /// Gives a record once more.
    pub(crate) fn back_to(&mut self, frame: &Frame) {
        self.at = frame.at;
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
        self.inner.seek(SeekFrom::Start(frame.at + HEAD_BYTES))?;
        self.inner.read_exact(&mut body)?;
        Ok(body)
    }
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

/// Gives every message of a chunk to `take` as (channel, log time ns, JSON), after the chunk's checksum was found right.
pub(crate) fn messages(body: &[u8], mut take: impl FnMut(u16, u64, &[u8]) -> Result<(), String>) -> Result<(), String> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(MAX_RECORD_BYTES as usize);
    let mut head = [mcap::records::op::CHUNK; HEAD_BYTES as usize];
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
            LinearReadEvent::Record { opcode: mcap::records::op::MESSAGE, data } => {
                match mcap::parse_record(mcap::records::op::MESSAGE, data).map_err(|e| e.to_string())? {
                    Record::Message { header, data } => take(header.channel_id, header.log_time, &data)?,
                    _ => return Err("not a message".into()),
                }
            }
            LinearReadEvent::Record { .. } => {} // schemas and channels: their ids are fixed
        }
    }
    Ok(())
}
