//! A block: what is recorded in some 200 ms, and its bytes: one chunk with its own schemas and channels, then its message indexes, then a
//! metadata record for each range of ticks that was lost. A block stands for itself, so that damage to another costs it nothing.

use crate::again::{Input, Origin, Step};
use crate::channels::{Channel, time_of_ns};
use crate::checkpoint::{Checkpoint, CheckpointMessage};
use crate::facts::sealed;
use crate::fluid::Fluid;
use crate::judged::Judged;
use crate::messages::{ControlsMessage, EventMessage, Force, Tool};
use crate::picture::{Picture, PictureMessage};
use crate::process::{Process, ProcessSpell};
use crate::scene::{self, SceneFile, SceneMessage};
use crate::sequence::skipped;
use crate::tissue::Tissue;
use crate::{Session, WriteError};
use hyst_messages::{AppliedRecord, FluidStatus, OriginRecord, StepRecord, TissueStatus};
use mcap::records::{ChunkIndex, MessageHeader, Metadata, MetadataIndex};
use mcap::write::WriteOptions;
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::Cursor;

/// Name of the metadata record with the session's facts.
pub(crate) const STATION: &str = "station";
/// Name of the metadata records that say which ticks were lost.
pub(crate) const LOST: &str = "lost";
/// Name of the metadata records that say which ticks the disk took and may not have kept: they are in the file as long as nobody finds otherwise.
pub(crate) const UNKEPT: &str = "unkept";
/// The writer's name in the file's header.
pub(crate) const LIBRARY: &str = "hysteroscopy-station";

/// Kind of an event that is a line of the supervisor's: what it saw and did, in its words.
pub const SAID: &str = "said";
/// Kind of an event that says which device is on the desk, in each of its lives.
pub const STATED: &str = "stated";

/// How bad an event is; Foxglove's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Level {
    /// As expected.
    Info = 2,
    /// A fault that was contained.
    Warning = 3,
    /// Something was lost.
    Error = 4,
}

impl Level {
    /// From the number in a file; nonsense is `Info`.
    pub fn from_number(number: u32) -> Level {
        [Level::Warning, Level::Error].into_iter().find(|level| *level as u32 == number).unwrap_or(Level::Info)
    }
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// Station tick at which the recorder saw it.
    pub tick: u64,
    /// How bad.
    pub level: Level,
    /// One word: `started`, `died`, `promoted`, `lost`, [`SAID`], [`STATED`] ….
    pub kind: String,
    /// The process, such as `haptic:1`.
    pub process: String,
    /// Its incarnation, 0 if none.
    pub incarnation: u32,
    /// A sentence for people.
    pub text: String,
}

/// Ticks from `first` to `last`, both included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickRange {
    /// First tick.
    pub first: u64,
    /// Last tick.
    pub last: u64,
}

impl TickRange {
    /// Number of ticks.
    pub fn count(&self) -> u64 {
        self.last.saturating_sub(self.first).saturating_add(1)
    }
    /// Adds a tick to the last range if it follows it, else begins a new one.
    pub fn extend(ranges: &mut Vec<TickRange>, tick: u64) {
        match ranges.last_mut() {
            Some(range) if range.last.checked_add(1) == Some(tick) => range.last = tick,
            _ => ranges.push(TickRange { first: tick, last: tick }),
        }
    }
}

/// What is written, or read, together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Block {
    /// Force and tool records, ticks ascending.
    pub applied: Vec<AppliedRecord>,
    /// What answers of the servos went on from, where that was not the usual. They are written with the block's first tick: without one they are not.
    pub origins: Vec<OriginRecord>,
    /// Steps of the tissue.
    pub steps: Vec<StepRecord>,
    /// Statuses of the tissue.
    pub tissue: Vec<TissueStatus>,
    /// Statuses of the fluid.
    pub fluid: Vec<FluidStatus>,
    /// Events.
    pub events: Vec<Event>,
    /// States of tissue and fluid.
    pub checkpoints: Vec<Checkpoint>,
    /// What a referee had judged.
    pub judged: Vec<Judged>,
    /// What the processes did.
    pub processes: Vec<ProcessSpell>,
    /// What was seen when something happened.
    pub pictures: Vec<Picture>,
    /// Files of the scene.
    pub scene: Vec<SceneFile>,
    /// Ticks that could not be had any more.
    pub lost: Vec<TickRange>,
    /// Ticks that the device never made, ascending. Written as an event, which is what a reader gives of them.
    pub unmade: Vec<TickRange>,
}

impl Block {
    /// Whether there is nothing in it.
    pub fn is_empty(&self) -> bool {
        self.applied.is_empty()
            && self.steps.is_empty()
            && self.tissue.is_empty()
            && self.fluid.is_empty()
            && self.events.is_empty()
            && self.checkpoints.is_empty()
            && self.judged.is_empty()
            && self.processes.is_empty()
            && self.pictures.is_empty()
            && self.scene.is_empty()
            && self.lost.is_empty()
            && self.unmade.is_empty()
    }

    /// Puts what came before it to its front.
    pub fn precede(&mut self, mut before: Block) {
        before.applied.append(&mut self.applied);
        before.origins.append(&mut self.origins);
        before.steps.append(&mut self.steps);
        before.tissue.append(&mut self.tissue);
        before.fluid.append(&mut self.fluid);
        before.events.append(&mut self.events);
        before.checkpoints.append(&mut self.checkpoints);
        before.judged.append(&mut self.judged);
        before.processes.append(&mut self.processes);
        before.pictures.append(&mut self.pictures);
        before.scene.append(&mut self.scene);
        before.lost.append(&mut self.lost);
        before.unmade.append(&mut self.unmade);
        *self = before;
    }
}

/// Bytes that can be appended to a file, with what the summary will say of them.
pub(crate) struct Encoded {
    pub(crate) bytes: Vec<u8>,
    pub(crate) chunk: ChunkIndex,
    pub(crate) metadata: Vec<MetadataIndex>,
    pub(crate) counts: BTreeMap<u16, u64>,
}

type Memory = mcap::Writer<Cursor<Vec<u8>>>;

fn memory() -> Result<Memory, WriteError> {
    let options = WriteOptions::new()
        .chunk_size(None) // one chunk for each block
        .compression_threads(0) // no threads of the library's own beside real-time processes
        .library(LIBRARY);
    options.create(Cursor::new(Vec::new())).map_err(WriteError::encode)
}

/// Magic, header and session facts: the first bytes of every recording, and the index of the facts.
pub(crate) fn head(session: &Session) -> Result<(Vec<u8>, MetadataIndex), WriteError> {
    let mut writer = memory()?;
    writer.write_metadata(&Metadata { name: STATION.into(), metadata: sealed(session) }).map_err(WriteError::encode)?;
    let summary = writer.finish().map_err(WriteError::encode)?;
    let index = summary.metadata_indexes.into_iter().next().ok_or(WriteError::Encode("no metadata index".into()))?;
    let mut bytes = writer.into_inner().into_inner();
    bytes.truncate((index.offset + index.length) as usize);
    Ok((bytes, index))
}

/// A channel's messages on their way into the chunk, through one buffer.
struct Pen {
    writer: Memory,
    buffer: Vec<u8>,
    sequence: [u32; Channel::ALL.len() + 1],
}

impl Pen {
    fn put<T: Serialize>(&mut self, channel: Channel, tick: u64, message: &T) -> Result<(), WriteError> {
        self.buffer.clear();
        serde_json::to_writer(&mut self.buffer, message).map_err(|e| WriteError::Encode(e.to_string()))?;
        let sequence = &mut self.sequence[channel as usize];
        *sequence = sequence.wrapping_add(1);
        let time_ns = time_of_ns(tick);
        let header = MessageHeader { channel_id: channel as u16, sequence: *sequence, log_time: time_ns, publish_time: time_ns };
        self.writer.write_to_known_channel(&header, &self.buffer).map_err(WriteError::encode)
    }

    fn put_all(&mut self, block: &Block) -> Result<(), WriteError> {
        let mut controls = None;
        let mut before = None;
        let mut origins: Vec<Origin> = block.origins.iter().map(Origin::of).collect();
        for record in &block.applied {
            if let Some(mut input) = Input::of(record, before.replace(record)) {
                input.origins = std::mem::take(&mut origins);
                self.put(Channel::Input, record.tick, &input)?;
            }
            if controls != Some(record.sample.controls) {
                controls = Some(record.sample.controls);
                self.put(Channel::Controls, record.tick, &ControlsMessage::of(record.tick, &record.sample.controls))?;
            }
            self.put(Channel::Tool, record.tick, &Tool::of(record))?;
            self.put(Channel::Force, record.tick, &Force::of(record))?;
        }
        for step in &block.steps {
            self.put(Channel::Steps, step.tick, &Step::of(step))?;
        }
        for status in &block.tissue {
            self.put(Channel::Tissue, status.state_tick, &Tissue::of(status))?;
        }
        for status in &block.fluid {
            self.put(Channel::Fluid, status.state_tick, &Fluid::of(status))?;
        }
        for event in block.events.iter().chain(&skipped(&block.unmade)) {
            self.put(Channel::Events, event.tick, &EventMessage::of(event))?;
        }
        for checkpoint in &block.checkpoints {
            self.put(Channel::Checkpoints, checkpoint.tick, &CheckpointMessage::of(checkpoint))?;
        }
        for judged in &block.judged {
            self.put(Channel::Judged, judged.tick, judged)?;
        }
        for spell in &block.processes {
            self.put(Channel::Processes, spell.tick, &Process::of(spell))?;
        }
        for picture in &block.pictures {
            self.put(Channel::Pictures, picture.tick, &PictureMessage::of(picture))?;
        }
        for file in &block.scene {
            self.put(Channel::Scene, scene::TICK, &SceneMessage::of(file))?;
        }
        Ok(())
    }
}

/// The bytes of a block, with offsets from its first byte.
pub(crate) fn encode(block: &Block) -> Result<Encoded, WriteError> {
    let mut pen = Pen { writer: memory()?, buffer: Vec::with_capacity(1024), sequence: Default::default() };
    for channel in Channel::ALL {
        let (id, schema) = (channel as u16, channel.schema().to_string());
        pen.writer
            .add_schema_with_id(id, channel.schema_name(), "jsonschema", schema.as_bytes())
            .and_then(|schema| pen.writer.add_channel_with_id(id, schema, channel.topic(), "json", &BTreeMap::new()))
            .map_err(WriteError::encode)?;
    }
    pen.put_all(block)?;
    let mut writer = pen.writer;
    for range in &block.lost {
        writer.write_metadata(&named(LOST, range)).map_err(WriteError::encode)?;
    }
    let summary = writer.finish().map_err(WriteError::encode)?;
    let mut chunk = summary.chunk_indexes.into_iter().next().ok_or(WriteError::Encode("no chunk".into()))?;
    let mut metadata = summary.metadata_indexes;
    let start = chunk.chunk_start_offset;
    let end = chunk.chunk_start_offset + chunk.chunk_length + chunk.message_index_length;
    let end = metadata.iter().map(|index| index.offset + index.length).fold(end, u64::max);
    let mut bytes = writer.into_inner().into_inner();
    bytes.truncate(end as usize);
    bytes.drain(..start as usize);
    move_chunk(&mut chunk, |offset| offset - start);
    metadata.iter_mut().for_each(|index| index.offset -= start);
    let counts = summary.stats.map(|stats| stats.channel_message_counts).unwrap_or_default();
    Ok(Encoded { bytes, chunk, metadata, counts })
}

/// The metadata record that names a range of ticks.
fn named(name: &str, range: &TickRange) -> Metadata {
    let metadata = BTreeMap::from([("first".into(), range.first.to_string()), ("last".into(), range.last.to_string())]);
    Metadata { name: name.into(), metadata }
}

/// The bytes of what names ticks that the disk may not have kept, and its indexes with offsets from the first byte.
pub(crate) fn unkept(ranges: &[TickRange]) -> Result<(Vec<u8>, Vec<MetadataIndex>), WriteError> {
    let mut writer = memory()?;
    for range in ranges {
        writer.write_metadata(&named(UNKEPT, range)).map_err(WriteError::encode)?;
    }
    let mut indexes = writer.finish().map_err(WriteError::encode)?.metadata_indexes;
    let start = indexes.first().map_or(0, |index| index.offset);
    let end = indexes.last().map_or(0, |index| index.offset + index.length);
    let mut bytes = writer.into_inner().into_inner();
    bytes.truncate(end as usize);
    bytes.drain(..start as usize);
    indexes.iter_mut().for_each(|index| index.offset -= start);
    Ok((bytes, indexes))
}

/// Changes every offset of a chunk's index.
pub(crate) fn move_chunk(chunk: &mut ChunkIndex, to: impl Fn(u64) -> u64) {
    chunk.chunk_start_offset = to(chunk.chunk_start_offset);
    chunk.message_index_offsets.values_mut().for_each(|offset| *offset = to(*offset));
}
