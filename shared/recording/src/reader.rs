//! The reader: block by block, without a summary, so that a file that was cut reads like a whole one up to the cut.
//!
//! Promise: what is damaged is named with its byte and left out, what follows it is read; a record that is given is what was written.

use crate::again::{Input, Step};
use crate::block::{Block, LOST, STATION, UNKEPT};
use crate::channels::Channel;
use crate::checkpoint::CheckpointMessage;
use crate::error::{ReadError, version};
use crate::fluid::Fluid;
use crate::frame::{DATA_END_BYTES, Frame, INDEX_HEAD_BYTES, Walk, messages, metadata};
use crate::messages::{ControlsMessage, EventMessage, Force, Tool, applied};
use crate::picture::PictureMessage;
use crate::process::Process;
use crate::scene::SceneMessage;
use crate::tissue::Tissue;
use crate::{Session, recover};
use hyst_messages::{AppliedRecord, Controls};
use mcap::records::op;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Most blocks that are decoded at once, and bytes of them in the file, so that memory does not grow with it: a block of the recorder's
/// has some 0.1 MB there and some 1 MB decoded.
const BATCH_BLOCKS: usize = 16;
const BATCH_BYTES: usize = 4 << 20;
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
    /// Reads from `source`; `path` is for messages.
    pub fn new(mut source: R, path: &Path) -> Result<Reader<R>, ReadError> {
        let refused = |source| ReadError::File { path: path.to_path_buf(), source };
        let foreign = |what: String| ReadError::Foreign { path: path.to_path_buf(), what };
        let length = source.seek(SeekFrom::End(0)).map_err(refused)?;
        let Some(mut walk) = Walk::begin(source).map_err(refused)? else {
            let empty = if length == 0 { ": it is empty, nothing was recorded in it" } else { "" };
            return Err(foreign(format!("is not an MCAP file{empty}")));
        };
        let mut head = |opcode: u8, what: &str| match walk.next().map_err(refused)? {
            Some(frame) if frame.opcode == opcode => walk.body(&frame, u64::MAX).map_err(refused),
            Some(_) => Err(foreign(format!("{what}: it is of something else than a station"))),
            None => Err(foreign(format!("{what}: it ends at byte {length}, before anything was recorded in it"))),
        };
        head(op::HEADER, "has no header")?;
        let facts = metadata(&head(op::METADATA, "has no facts of a session")?).map_err(foreign)?;
        if facts.name != STATION {
            return Err(foreign(format!("is of something else than a station ({:?})", facts.name)));
        }
        version(path, &facts.metadata)?;
        Ok(Reader { walk, path: path.to_path_buf(), session: facts.metadata, damage: Vec::new(), ending: None })
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
        while let Some(raw) = self.next_raw()? {
            match raw.decode() {
                Ok(block) => return Ok(Some(block)),
                Err(reason) => self.damaged(raw.frame.at, reason),
            }
        }
        Ok(None)
    }

    /// Gives every block to `take` in the file's order, whatever the number of threads that decode them. After an error everything before it was
    /// given.
    pub fn each_block(&mut self, threads: usize, mut take: impl FnMut(Block)) -> Result<(), ReadError> {
        loop {
            let (batch, more) = self.batch();
            for (raw, decoded) in batch.iter().zip(decode(&batch, threads)) {
                match decoded {
                    Ok(block) => take(block),
                    Err(reason) => self.damaged(raw.frame.at, reason),
                }
            }
            self.damage.sort_by_key(|damage| damage.at);
            if !more? {
                return Ok(());
            }
        }
    }

    /// Some blocks as they stand in the file, and whether there may be more.
    fn batch(&mut self) -> (Vec<Raw>, Result<bool, ReadError>) {
        let (mut batch, mut bytes) = (Vec::new(), 0);
        while batch.len() < BATCH_BLOCKS && bytes < BATCH_BYTES {
            match self.next_raw() {
                Ok(Some(raw)) => {
                    bytes += raw.body.len();
                    batch.push(raw);
                }
                Ok(None) => return (batch, Ok(false)),
                Err(error) => return (batch, Err(error)),
            }
        }
        (batch, Ok(true))
    }

    /// The next record that may hold a block; what cannot be one is noted as damage.
    fn next_raw(&mut self) -> Result<Option<Raw>, ReadError> {
        let path = self.path.clone();
        let refused = move |source| ReadError::File { path: path.clone(), source };
        while self.ending.is_none() {
            let at = self.walk.at();
            let Some(frame) = self.walk.next().map_err(&refused)? else {
                self.ending = Some(Ending::Cut { at });
                break;
            };
            if frame.at > at {
                self.damaged(at, format!("is none; nothing can be read up to byte {}", frame.at));
            }
            match frame.opcode {
                op::MESSAGE_INDEX if self.is_index(&frame).map_err(&refused)? => {}
                op::DATA_END if frame.length == DATA_END_BYTES => self.ending = Some(self.close().map_err(&refused)?),
                op::CHUNK | op::METADATA => {
                    let body = self.walk.body(&frame, u64::MAX).map_err(&refused)?;
                    return Ok(Some(Raw { frame, body }));
                }
                _ => self.damaged(frame.at, "is of a kind that no recorder writes".into()),
            }
        }
        Ok(None)
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

    /// Gives a record once more, or one that is known to lie elsewhere.
    pub(crate) fn back_to(&mut self, frame: &Frame) {
        self.walk.back_to(frame);
    }

    /// Length of the file, bytes.
    pub(crate) fn length(&self) -> u64 {
        self.walk.length()
    }

    /// The block of a chunk, or what is wrong with it.
    pub(crate) fn block_at(&mut self, frame: &Frame) -> Result<Result<Block, String>, ReadError> {
        Ok(chunk(&self.body(frame, u64::MAX)?))
    }

    /// Whether a message index says the length that it has; a chunk whose opcode was flipped does not.
    fn is_index(&mut self, frame: &Frame) -> io::Result<bool> {
        let head = self.walk.body(frame, INDEX_HEAD_BYTES)?;
        let said = head.get(2..6).and_then(|bytes| bytes.try_into().ok()).map(u32::from_le_bytes);
        Ok(said.is_some_and(|said| said as u64 + INDEX_HEAD_BYTES == frame.length))
    }

    fn damaged(&mut self, at: u64, reason: String) {
        if self.damage.len() < MOST_DAMAGE {
            self.damage.push(Damage { at, reason });
        }
    }

    /// Goes through the summary to the footer.
    fn close(&mut self) -> io::Result<Ending> {
        while let Some(frame) = self.walk.next()? {
            if frame.opcode == op::FOOTER {
                let is_end = self.walk.length() - self.walk.at() == mcap::MAGIC.len() as u64;
                return Ok(if is_end { Ending::Complete } else { Ending::Cut { at: frame.end() } });
            }
        }
        Ok(Ending::Cut { at: self.walk.at() })
    }
}

/// A record as it stands in the file: a chunk, or a range of ticks that were lost, or may not have been kept.
struct Raw {
    frame: Frame,
    body: Vec<u8>,
}

impl Raw {
    fn decode(&self) -> Result<Block, String> {
        if self.frame.opcode == op::CHUNK { chunk(&self.body) } else { lost(&self.body) }
    }
}

/// Decodes each of a batch, by up to so many threads with a share each; the results have the batch's order.
fn decode(batch: &[Raw], threads: usize) -> Vec<Result<Block, String>> {
    let share = batch.len().div_ceil(threads.max(1)).max(1);
    if share >= batch.len() {
        return in_turn(batch);
    }
    std::thread::scope(|scope| {
        let workers: Vec<_> = batch.chunks(share).map(|part| scope.spawn(move || in_turn(part))).collect();
        let mut decoded = Vec::with_capacity(batch.len());
        for worker in workers {
            decoded.extend(worker.join().unwrap_or_else(|cause| std::panic::resume_unwind(cause)));
        }
        decoded
    })
}

fn in_turn(batch: &[Raw]) -> Vec<Result<Block, String>> {
    batch.iter().map(Raw::decode).collect()
}

/// The block of a range of ticks that were lost, or what is wrong with it. Of ticks that the disk may not have kept there is nothing in it: whoever reads sees
/// whether they are there.
pub(crate) fn lost(body: &[u8]) -> Result<Block, String> {
    let record = metadata(body)?;
    let range = recover::range(&record.metadata).filter(|range| range.first <= range.last);
    match (record.name.as_str(), range) {
        (LOST, Some(range)) => Ok(Block { lost: vec![range], ..Block::default() }),
        (UNKEPT, Some(_)) => Ok(Block::default()),
        _ => Err("names no range of lost ticks".into()),
    }
}

fn json<T: DeserializeOwned>(data: &[u8]) -> Result<T, String> {
    serde_json::from_slice(data).map_err(|e| e.to_string())
}

/// The messages of one tick on their way to one record.
#[derive(Default)]
struct Tick {
    tool: Option<Tool>,
    force: Option<Force>,
}

fn chunk(body: &[u8]) -> Result<Block, String> {
    let mut block = Block::default();
    let mut ticks: BTreeMap<u64, Tick> = BTreeMap::new();
    let mut controls: BTreeMap<u64, Controls> = BTreeMap::new();
    let mut inputs: BTreeMap<u64, Input> = BTreeMap::new();
    messages(body, |id, _, data| {
        match Channel::from_id(id).ok_or_else(|| format!("has a message of an unknown channel {id}"))? {
            Channel::Tool => {
                let tool: Tool = json(data)?;
                let tick = tool.tick;
                ticks.entry(tick).or_default().tool = Some(tool);
            }
            Channel::Force => {
                let force: Force = json(data)?;
                let tick = force.tick;
                ticks.entry(tick).or_default().force = Some(force);
            }
            Channel::Controls => {
                let message: ControlsMessage = json(data)?;
                controls.insert(message.tick, message.controls());
            }
            Channel::Events => block.events.push(json::<EventMessage>(data)?.event()),
            Channel::Tissue => block.tissue.push(json::<Tissue>(data)?.status()),
            Channel::Fluid => block.fluid.push(json::<Fluid>(data)?.status()),
            Channel::Input => {
                let input: Input = json(data)?;
                inputs.insert(input.tick, input);
            }
            Channel::Steps => block.steps.push(json::<Step>(data)?.record()?),
            Channel::Checkpoints => block.checkpoints.push(json::<CheckpointMessage>(data)?.checkpoint()?),
            Channel::Processes => block.processes.push(json::<Process>(data)?.spell()),
            Channel::Pictures => block.pictures.push(json::<PictureMessage>(data)?.picture()?),
            Channel::Scene => block.scene.push(json::<SceneMessage>(data)?.file()?),
        }
        Ok(())
    })?;
    for (tick, messages) in &ticks {
        let (Some(tool), Some(force)) = (&messages.tool, &messages.force) else {
            return Err(format!("has half of tick {tick}"));
        };
        let controls = controls.range(..=tick).next_back().ok_or_else(|| format!("has no controls for tick {tick}"))?;
        block.applied.push(applied(tool, force, *controls.1));
    }
    Input::complete(&mut block.applied, &inputs);
    Ok(block)
}

/// A whole recording in memory: about 200 bytes for each tick.
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
