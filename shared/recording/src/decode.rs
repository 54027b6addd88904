//! From a record of the file to a block. What comes with each tick is read as it is written (`scan`), and as any JSON where it stands otherwise.
//!
//! Promise: the block, or what is wrong with it, is the same either way.

use crate::again::{Input, Origin, Step};
use crate::block::{Block, LOST, STATION, UNKEPT};
use crate::channels::Channel;
use crate::checkpoint;
use crate::fluid::Fluid;
use crate::frame::{Frame, metadata};
use crate::messages::{ControlsMessage, EventMessage, Force, Tool, applied};
use crate::picture::PictureMessage;
use crate::process::Process;
use crate::recover;
use crate::scene::SceneMessage;
use crate::tissue::Tissue;
use crate::unpack::Unpacker;
use hyst_messages::Controls;
use mcap::records::op;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;

/// What is made of the states of tissue and fluid, which have 0.7 MB each in the default scene: three tenths of all that is unpacked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum States {
    /// They are in the block.
    Given,
    /// That they can be decoded is seen, and they are not in the block.
    Checked,
}

/// A record as it stands in the file: a chunk, or the session's facts, or a range of ticks that were lost, or may not have been kept.
pub(crate) struct Raw {
    pub(crate) frame: Frame,
    pub(crate) body: Vec<u8>,
}

impl Raw {
    /// Its block, if it has one, or what is wrong with it.
    pub(crate) fn decode(&self, unpacker: &mut Unpacker, states: States) -> Result<Option<Block>, String> {
        if self.frame.opcode == op::CHUNK { chunk(unpacker, &self.body, states).map(Some) } else { noted(&self.body) }
    }
}

/// The block of a range of ticks that were lost, or what is wrong with it. Ticks that the disk may not have kept have none: whoever reads sees whether they are
/// there; nor have the session's facts once more: who has opened the file has whole ones, or has said that there are none.
pub(crate) fn noted(body: &[u8]) -> Result<Option<Block>, String> {
    let record = metadata(body)?;
    let range = recover::range(&record.metadata).filter(|range| range.first <= range.last);
    match (record.name.as_str(), range) {
        (LOST, Some(range)) => Ok(Some(Block { lost: vec![range], ..Block::default() })),
        (UNKEPT, Some(_)) | (STATION, _) => Ok(None),
        _ => Err("names no range of lost ticks".into()),
    }
}

/// A message, or what is wrong with its JSON.
pub(crate) fn json<T: DeserializeOwned>(data: &[u8]) -> Result<T, String> {
    serde_json::from_slice(data).map_err(|e| e.to_string())
}

/// The messages of one tick on their way to one record.
#[derive(Default)]
struct Tick {
    tick: u64,
    tool: Option<Tool>,
    force: Option<Force>,
}

/// The ticks of a block so far. They come in their order; if they do not, they are brought into it in the end.
#[derive(Default)]
struct Ticks {
    ticks: Vec<Tick>,
    is_mixed: bool,
}

impl Ticks {
    /// Where the messages of a tick go.
    fn at(&mut self, tick: u64) -> &mut Tick {
        let newest = self.ticks.last().map(|newest| newest.tick);
        if newest != Some(tick) {
            self.is_mixed |= newest > Some(tick);
            self.ticks.push(Tick { tick, ..Tick::default() });
        }
        let last = self.ticks.len() - 1;
        &mut self.ticks[last]
    }

    /// All of them, ascending, each once; of two messages for the same the later one.
    fn ascending(mut self) -> Vec<Tick> {
        if self.is_mixed {
            self.ticks.sort_by_key(|tick| tick.tick); // those of the same stay in their order
            self.ticks.dedup_by(|later, kept| {
                let is_same = later.tick == kept.tick;
                if is_same {
                    kept.tool = later.tool.take().or(kept.tool.take());
                    kept.force = later.force.take().or(kept.force.take());
                }
                is_same
            });
        }
        self.ticks
    }
}

/// The block of a chunk, or what is wrong with it.
pub(crate) fn chunk(unpacker: &mut Unpacker, body: &[u8], states: States) -> Result<Block, String> {
    let mut block = Block::default();
    let mut ticks = Ticks::default();
    let mut controls: BTreeMap<u64, Controls> = BTreeMap::new();
    let mut inputs: BTreeMap<u64, Input> = BTreeMap::new();
    unpacker.messages(body, |id, _, data| {
        match Channel::from_id(id).ok_or_else(|| format!("has a message of an unknown channel {id}"))? {
            Channel::Tool => {
                let tool = Tool::scan(data).map_or_else(|| json(data), Ok)?;
                let tick = tool.tick;
                ticks.at(tick).tool = Some(tool);
            }
            Channel::Force => {
                let force = Force::scan(data).map_or_else(|| json(data), Ok)?;
                let tick = force.tick;
                ticks.at(tick).force = Some(force);
            }
            Channel::Controls => {
                let message: ControlsMessage = json(data)?;
                controls.insert(message.tick, message.controls());
            }
            Channel::Events => block.events.push(json::<EventMessage>(data)?.event()),
            Channel::Tissue => block.tissue.push(json::<Tissue>(data)?.status()),
            Channel::Fluid => block.fluid.push(json::<Fluid>(data)?.status()),
            Channel::Input => {
                let mut input: Input = json(data)?;
                block.origins.extend(std::mem::take(&mut input.origins).into_iter().map(Origin::record));
                inputs.insert(input.tick, input);
            }
            Channel::Steps => block.steps.push(Step::scan(data).map_or_else(|| json::<Step>(data)?.record(), Ok)?),
            Channel::Checkpoints => block.checkpoints.extend(checkpoint::read(data, states)?),
            Channel::Processes => block.processes.push(json::<Process>(data)?.spell()),
            Channel::Pictures => block.pictures.push(json::<PictureMessage>(data)?.picture()?),
            Channel::Judged => block.judged.push(json(data)?),
            Channel::Scene => block.scene.push(json::<SceneMessage>(data)?.file()?),
        }
        Ok(())
    })?;
    let ticks = ticks.ascending();
    block.applied.reserve(ticks.len());
    for Tick { tick, tool, force } in &ticks {
        let (Some(tool), Some(force)) = (tool, force) else {
            return Err(format!("has half of tick {tick}"));
        };
        let controls = controls.range(..=tick).next_back().ok_or_else(|| format!("has no controls for tick {tick}"))?;
        block.applied.push(applied(tool, force, *controls.1));
    }
    Input::complete(&mut block.applied, &inputs);
    Ok(block)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_come_ascending_and_the_later_of_two_messages_counts_whatever_their_order() {
        let force = |tick: u64, kind: u32| {
            let mut record = hyst_messages::AppliedRecord { tick, ..Default::default() };
            (record.command.tick, record.command.kind) = (tick, kind);
            Force::of(&record)
        };
        let mut ticks = Ticks::default();
        for (tick, kind) in [(5, 1), (7, 2), (6, 3), (7, 4), (5, 5)] {
            ticks.at(tick).force = Some(force(tick, kind));
        }
        ticks.at(6).tool = Some(Tool::of(&hyst_messages::AppliedRecord { tick: 6, ..Default::default() }));
        let kind = |force: &Force| serde_json::to_value(force).unwrap()["kind"].as_u64();
        let told = |tick: Tick| (tick.tick, tick.force.as_ref().and_then(kind), tick.tool.is_some());
        let told: Vec<_> = ticks.ascending().into_iter().map(told).collect();
        assert_eq!(told, [(5, Some(5), false), (6, Some(3), true), (7, Some(4), false)]);
    }
}
