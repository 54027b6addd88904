//! What a file that somebody else began already holds: its session, its blocks, and the byte after the last whole one. Reads frames and
//! message indexes; only the last chunk is decompressed.

use crate::block::{LOST, STATION, UNKEPT};
use crate::channels::Channel;
use crate::facts::opened;
use crate::frame::{Frame, INDEX_HEAD_BYTES, Walk, metadata};
use crate::summary::Contents;
use crate::unpack::Unpacker;
use crate::{Session, TickRange};
use hyst_messages::TICK_NS;
use mcap::records::{ChunkIndex, MetadataIndex, op};
use std::collections::BTreeMap;
use std::io::{self, Read, Seek};

/// Bytes of a chunk's header before its records, with room for the compression's name.
const CHUNK_HEAD_BYTES: u64 = 128;
/// Bytes that are read at once: what lies between the messages of two blocks has some ten thousand, in some nine records, of which each asked the system twice.
/// A recorder that follows has to be through a file of days before the device's ring has lost what was made meanwhile.
const AT_ONCE_BYTES: usize = 16 << 10;
/// Bytes of an entry of a message index: when, and where in the chunk.
const INDEX_ENTRY_BYTES: usize = 16;

/// What was found.
#[derive(Debug, Default)]
pub(crate) struct Found {
    /// The session's facts, the first that are whole; `None` if the file was cut before them.
    pub(crate) session: Option<Session>,
    /// How often they are there as a whole.
    pub(crate) facts: u64,
    /// The byte after the last whole block.
    pub(crate) end: u64,
    pub(crate) contents: Contents,
    /// Ticks that are named as lost or not kept.
    pub(crate) lost: u64,
    /// Where they are.
    pub(crate) named: Vec<TickRange>,
    /// Newest tick in `/force`.
    pub(crate) last_tick: Option<u64>,
}

/// A chunk with its indexes, and the byte after them.
struct Whole {
    index: ChunkIndex,
    counts: BTreeMap<u16, u64>,
    frame: Frame,
    last_tick: Option<u64>,
    /// Something that is damaged follows: the indexes behind that are another chunk's.
    is_followed: bool,
}

/// Looks through a file; `None` if it is not MCAP.
pub(crate) fn recover<R: Read + Seek>(inner: R) -> io::Result<Option<Found>> {
    let Some(mut walk) = Walk::begin(inner)? else {
        return Ok(None);
    };
    walk.read_ahead(AT_ONCE_BYTES);
    let mut found = Found { end: walk.at(), ..Default::default() };
    let mut open: Option<Whole> = None;
    let mut last: Option<Whole> = None;
    while let Some(frame) = walk.next()? {
        match frame.opcode {
            op::HEADER => found.end = frame.end(),
            op::MESSAGE_INDEX => {
                if let Some(chunk) = open.as_mut().filter(|chunk| !chunk.is_followed) {
                    index(&mut walk, &frame, chunk)?;
                }
            }
            op::CHUNK => {
                settle(&mut found, &mut last, open.take());
                open = chunk(&mut walk, &frame)?;
            }
            op::METADATA => {
                settle(&mut found, &mut last, open.take());
                facts(&mut walk, &frame, &mut found)?;
            }
            op::DATA_END => break,
            // Damaged: what follows it counts.
            _ => open.iter_mut().for_each(|chunk| chunk.is_followed = true),
        }
    }
    // The chunk at the end may have been cut between its indexes, which the frames do not show.
    if let Some(tail) = open.take()
        && is_whole(&mut walk, &tail)?
    {
        settle(&mut found, &mut last, Some(tail));
    }
    found.last_tick = last.and_then(|chunk| chunk.last_tick);
    Ok(Some(found))
}

fn settle(found: &mut Found, last: &mut Option<Whole>, chunk: Option<Whole>) {
    let Some(chunk) = chunk else { return };
    found.end = chunk.frame.end() + chunk.index.message_index_length;
    for (id, count) in &chunk.counts {
        *found.contents.counts.entry(*id).or_insert(0) += count;
    }
    found.contents.add(&chunk.index);
    if chunk.last_tick.is_some() || last.is_none() {
        *last = Some(chunk);
    }
}

fn chunk<R: Read + Seek>(walk: &mut Walk<R>, frame: &Frame) -> io::Result<Option<Whole>> {
    let head = walk.body(frame, CHUNK_HEAD_BYTES)?;
    let word = |at: usize| head.get(at..at + 8).and_then(|b| b.try_into().ok()).map(u64::from_le_bytes);
    let name_bytes = head.get(28..32).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    let parse = || {
        let name_end = 32usize.checked_add(name_bytes? as usize)?;
        let compression = String::from_utf8(head.get(32..name_end)?.to_vec()).ok()?;
        Some(ChunkIndex {
            message_start_time: word(0)?,
            message_end_time: word(8)?,
            chunk_start_offset: frame.at,
            chunk_length: frame.end() - frame.at,
            message_index_offsets: BTreeMap::new(),
            message_index_length: 0,
            compression,
            compressed_size: word(name_end)?,
            uncompressed_size: word(16)?,
        })
    };
    Ok(parse().map(|index| Whole { index, counts: BTreeMap::new(), frame: *frame, last_tick: None, is_followed: false }))
}

fn index<R: Read + Seek>(walk: &mut Walk<R>, frame: &Frame, chunk: &mut Whole) -> io::Result<()> {
    let body = walk.body(frame, u64::MAX)?;
    chunk.index.message_index_length += frame.end() - frame.at;
    let Some((channel_id, entries)) = entries(&body) else { return Ok(()) };
    chunk.index.message_index_offsets.insert(channel_id, frame.at);
    chunk.counts.insert(channel_id, entries.len() as u64);
    if channel_id == Channel::Force as u16 {
        let time_ns = |entry: &[u8; INDEX_ENTRY_BYTES]| entry.first_chunk::<8>().copied().map_or(0, u64::from_le_bytes);
        chunk.last_tick = entries.iter().map(|entry| time_ns(entry) / TICK_NS).max();
    }
    Ok(())
}

/// Channel and entries of a message index; `None` of what is none. An hour has some ten million entries, which are counted and not read one by one.
fn entries(body: &[u8]) -> Option<(u16, &[[u8; INDEX_ENTRY_BYTES]])> {
    let ([low, high, length @ ..], rest) = body.split_first_chunk::<{ INDEX_HEAD_BYTES as usize }>()?;
    let (entries, left) = rest.as_chunks::<INDEX_ENTRY_BYTES>();
    let is_whole = left.is_empty() && u32::from_le_bytes(*length) as usize == rest.len();
    is_whole.then_some((u16::from_le_bytes([*low, *high]), entries))
}

fn facts<R: Read + Seek>(walk: &mut Walk<R>, frame: &Frame, found: &mut Found) -> io::Result<()> {
    let body = walk.body(frame, u64::MAX)?;
    found.end = frame.end();
    let Ok(record) = metadata(&body) else {
        return Ok(());
    };
    found.contents.metadata.push(MetadataIndex { offset: frame.at, length: frame.end() - frame.at, name: record.name.clone() });
    if record.name == STATION {
        let (session, is_whole) = opened(record.metadata);
        if is_whole && found.facts == 0 {
            found.session = None; // what was damaged
        }
        found.facts += u64::from(is_whole);
        found.session.get_or_insert(session);
    } else if record.name == LOST || record.name == UNKEPT {
        let named = range(&record.metadata);
        found.lost = found.lost.saturating_add(named.map_or(0, |range| range.count())); // whatever a damaged file says
        found.named.extend(named);
    }
    Ok(())
}

/// The range that a metadata record of ticks that are lost, or not kept, names.
pub(crate) fn range(facts: &Session) -> Option<TickRange> {
    let number = |key: &str| facts.get(key)?.parse().ok();
    Some(TickRange { first: number("first")?, last: number("last")? })
}

/// Whether the chunk has its checksum and an index entry for each message.
fn is_whole<R: Read + Seek>(walk: &mut Walk<R>, chunk: &Whole) -> io::Result<bool> {
    let body = walk.body(&chunk.frame, u64::MAX)?;
    let mut counts = BTreeMap::new();
    let sound = Unpacker::default().messages(&body, |id, _, _| {
        *counts.entry(id).or_insert(0u64) += 1;
        Ok(())
    });
    Ok(sound.is_ok() && counts == chunk.counts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Block, Writer};
    use hyst_messages::AppliedRecord;
    use std::cell::Cell;
    use std::io::SeekFrom;

    /// Bytes, and how often somebody asked for some of them.
    struct Asked<'a> {
        bytes: io::Cursor<&'a [u8]>,
        times: &'a Cell<u64>,
    }

    impl Read for Asked<'_> {
        fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
            self.times.set(self.times.get() + 1);
            self.bytes.read(into)
        }
    }

    impl Seek for Asked<'_> {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.bytes.seek(to)
        }
    }

    /// Each record of a block was asked for by itself, and its body once more.
    #[test]
    fn who_goes_on_in_a_file_asks_for_a_few_parts_of_each_block() {
        const BLOCKS: u64 = 200;
        const TICKS: u64 = 200;
        let path = std::env::temp_dir().join(format!("hyst-recover-{}.mcap", std::process::id()));
        let mut writer = Writer::open(&path, &Session::from([("session".into(), "s".into())])).unwrap();
        for part in 0..BLOCKS {
            let ticks = 1 + TICKS * part..1 + TICKS * (part + 1);
            let applied = ticks.map(|tick| AppliedRecord { tick, ..AppliedRecord::default() }).collect();
            writer.append(&Block { applied, ..Block::default() }).unwrap();
        }
        drop(writer); // as in a death: no summary
        let bytes = std::fs::read(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        let times = Cell::new(0);
        let found = recover(Asked { bytes: io::Cursor::new(bytes.as_slice()), times: &times }).unwrap().unwrap();
        assert_eq!((found.last_tick, found.end), (Some(TICKS * BLOCKS), bytes.len() as u64));
        assert_eq!(found.contents.counts.get(&(Channel::Force as u16)), Some(&(TICKS * BLOCKS)));
        assert!(times.get() <= 3 * BLOCKS, "{} times for {BLOCKS} blocks", times.get());
    }
}
