//! The facts of a session as they stand in the file: with a checksum over all of them, and more than once, because a case is judged by them.
//!
//! Promise: facts that are not those that were written are known as such, but in recordings of before they had a checksum; and where one record of them is
//! damaged, another serves.

use crate::Session;
use crate::block::STATION;
use crate::frame::{Walk, metadata};
use mcap::records::op;
use std::io::{self, Read, Seek};

/// The fact that is the checksum of all others: CRC-32, hexadecimal.
const CHECKSUM: &str = "crc";
/// Where the head begins, and what is said of one whose facts are damaged and stand nowhere else as a whole.
pub(crate) const HEAD_AT: u64 = mcap::MAGIC.len() as u64;
pub(crate) const DAMAGED: &str = "has facts of the session that are not those that were written, and they stand nowhere else";
/// Formats whose facts have none.
const UNCHECKED: [&str; 4] = ["1", "2", "3", "4"];

/// Facts, and whether they are those that were written.
pub(crate) type Opened = (Session, bool);

/// The facts with their checksum.
pub(crate) fn sealed(facts: &Session) -> Session {
    let mut sealed = facts.clone();
    sealed.remove(CHECKSUM);
    let checksum = checksum(&sealed);
    sealed.insert(CHECKSUM.into(), checksum);
    sealed
}

/// The facts without it.
pub(crate) fn opened(mut facts: Session) -> Opened {
    let is_whole = match facts.remove(CHECKSUM) {
        Some(said) => said == checksum(&facts),
        None => facts.get("format").is_some_and(|format| UNCHECKED.contains(&format.as_str())),
    };
    (facts, is_whole)
}

/// The facts at the head of a file, or why there are none.
pub(crate) fn at_head<R: Read + Seek>(walk: &mut Walk<R>) -> io::Result<Result<Opened, String>> {
    let mut body = Vec::new();
    for (opcode, what) in [(op::HEADER, "has no header"), (op::METADATA, "has no facts of a session")] {
        body = match walk.next()? {
            Some(frame) if frame.opcode == opcode => walk.body(&frame, u64::MAX)?,
            Some(_) => return Ok(Err(format!("{what}: it is of something else than a station"))),
            None => {
                return Ok(Err(format!("{what}: it ends at byte {}, before anything was recorded in it", walk.length())));
            }
        };
    }
    Ok(read(&body))
}

/// The first whole facts from here on; `None` if there are none.
pub(crate) fn behind<R: Read + Seek>(walk: &mut Walk<R>) -> io::Result<Option<Session>> {
    while let Some(frame) = walk.next()? {
        match frame.opcode {
            op::METADATA => {
                if let Ok((session, true)) = read(&walk.body(&frame, u64::MAX)?) {
                    return Ok(Some(session));
                }
            }
            op::DATA_END => break,
            _ => {}
        }
    }
    Ok(None)
}

/// Goes to the first block.
pub(crate) fn past_head<R: Read + Seek>(walk: &mut Walk<R>) -> io::Result<()> {
    walk.back_to(HEAD_AT);
    while let Some(frame) = walk.next()? {
        if frame.opcode == op::CHUNK {
            walk.back_to(frame.at);
            break;
        }
    }
    Ok(())
}

/// The facts of a metadata record, or what else it is.
fn read(body: &[u8]) -> Result<Opened, String> {
    let record = metadata(body)?;
    if record.name != STATION {
        return Err(format!("is of something else than a station ({:?})", record.name));
    }
    Ok(opened(record.metadata))
}

/// Over name and value of each fact in the order of the names, with the length of each before it.
fn checksum(facts: &Session) -> String {
    let mut checksum = crc32fast::Hasher::new();
    for text in facts.iter().flat_map(|(name, value)| [name, value]) {
        checksum.update(&(text.len() as u64).to_le_bytes());
        checksum.update(text.as_bytes());
    }
    format!("{:08x}", checksum.finalize())
}
