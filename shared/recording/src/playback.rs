//! A recording by its ticks, for a replay: what the device made of each, and the step of the tissue that counted.
//!
//! Blocks are read a few seconds ahead, because the recorder learns of a step by another way than of the device's tick, and may hear of it
//! later. Memory does not grow with the recording. Every step that was made is recorded, also a spare's substitute that nobody went on from; those
//! count from which the newest one known descends.

use crate::Session;
use crate::error::ReadError;
use crate::reader::Reader;
use hyst_messages::{AppliedRecord, FluidStatus, OriginRecord, Replayed, StepRecord};
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;

/// Ticks of the device that are read ahead: as many as the rings hold from which a recorder that comes late takes them.
const AHEAD_TICKS: u64 = 4_200;

/// One tick of a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moment {
    /// What the device did in it; `None` if it made no tick, or if that is not in the recording.
    pub applied: Option<AppliedRecord>,
    /// The step of the tissue to the state of this tick, if there was one that later ones went on from.
    pub step: Option<StepRecord>,
    /// What the fluid said of its state of this tick, if that was recorded.
    pub fluid: Option<FluidStatus>,
    /// What each servo's answer of this tick went on from, if that was not the usual.
    pub origins: [Option<OriginRecord>; 2],
}

impl Moment {
    /// What each servo is told of that.
    pub fn replayed(&self) -> [Replayed; 2] {
        self.origins.map(|origin| origin.map_or_else(Replayed::default, |origin| origin.replayed()))
    }
}

/// A recording that is read tick by tick.
pub struct Playback<R> {
    reader: Reader<R>,
    applied: VecDeque<AppliedRecord>,
    steps: BTreeMap<u64, Vec<StepRecord>>,
    /// Of each tick the step that counts.
    line: BTreeMap<u64, StepRecord>,
    fluid: BTreeMap<u64, FluidStatus>,
    origins: BTreeMap<u64, [Option<OriginRecord>; 2]>,
    /// The newest step that was given as due.
    done_tick: u64,
    has_ended: bool,
}

impl Playback<File> {
    /// Opens a file.
    pub fn open(path: &Path) -> Result<Playback<File>, ReadError> {
        Ok(Playback::new(Reader::open(path)?))
    }
}

impl<R: Read + Seek> Playback<R> {
    /// Of what a reader gives.
    pub fn new(reader: Reader<R>) -> Playback<R> {
        Playback {
            reader,
            applied: VecDeque::new(),
            steps: BTreeMap::new(),
            line: BTreeMap::new(),
            fluid: BTreeMap::new(),
            origins: BTreeMap::new(),
            done_tick: 0,
            has_ended: false,
        }
    }

    /// The session's facts.
    pub fn session(&self) -> &Session {
        self.reader.session()
    }

    /// Begins at `tick` instead of the beginning; before anything else is asked for.
    pub fn skip_to(&mut self, tick: u64) -> Result<(), ReadError> {
        self.done_tick = tick.saturating_sub(1);
        self.reader.skip_to(tick)
    }

    /// What the device did in the first tick that it made; `None` if it made none. Before anything else is asked for.
    pub fn first_applied(&mut self) -> Result<Option<AppliedRecord>, ReadError> {
        self.read_ahead(0)?;
        Ok(self.applied.front().copied())
    }

    /// The first tick in which anything happened: the device's, or the first step of a tissue that was there before it; `None` if the device made no tick.
    pub fn first_tick(&mut self) -> Result<Option<u64>, ReadError> {
        let device = self.first_applied()?.map(|record| record.tick);
        let tissue = self.line.first_key_value().map(|(tick, _)| *tick);
        Ok(device.map(|device| tissue.map_or(device, |tissue| tissue.min(device))))
    }

    /// The steps of the tissue that were made before the device made `tick` of what it read, after those that were given before; asked once [`Playback::at`]
    /// has given that tick. A device that was held up in the middle of a tick took the contact model of a later state: the steps to that one come
    /// before the tick, unless they were made from the tick's own input record, as none can be.
    pub fn due(&mut self, tick: u64) -> Vec<StepRecord> {
        let record = self.applied.front().filter(|record| record.tick == tick && record.model_epoch > 0);
        let reach = record.map_or(tick, |record| record.model_tick.max(tick).min(tick.saturating_add(AHEAD_TICKS)));
        let can_be = |step: &StepRecord| step.tick <= tick || step.input_tick < tick;
        let to_come = self.line.range(self.done_tick.saturating_add(1)..).map(|(_, step)| *step);
        let due: Vec<_> = to_come.take_while(|step| step.tick <= reach && can_be(step)).collect();
        self.done_tick = due.last().map_or(self.done_tick, |step| step.tick);
        due
    }

    /// What happened in `tick`; asked for ascending ticks. `None` after the last tick of the device.
    pub fn at(&mut self, tick: u64) -> Result<Option<Moment>, ReadError> {
        self.read_ahead(tick)?;
        while self.applied.front().is_some_and(|record| record.tick < tick) {
            self.applied.pop_front();
        }
        if self.applied.is_empty() {
            return Ok(None);
        }
        self.steps = self.steps.split_off(&tick);
        self.fluid = self.fluid.split_off(&tick);
        self.origins = self.origins.split_off(&tick);
        let applied = self.applied.front().filter(|record| record.tick == tick).copied();
        let (step, fluid) = (self.line.get(&tick).copied(), self.fluid.get(&tick).copied());
        let origins = self.origins.get(&tick).copied().unwrap_or_default();
        Ok(Some(Moment { applied, step, fluid, origins }))
    }

    /// Reads until the device's newest tick is far enough after `tick`.
    fn read_ahead(&mut self, tick: u64) -> Result<(), ReadError> {
        let mut has_read = false;
        while !self.has_ended && self.applied.back().is_none_or(|newest| newest.tick < tick.saturating_add(AHEAD_TICKS)) {
            let Some(block) = self.reader.next_block()? else {
                self.has_ended = true;
                break;
            };
            // A recorder that went on in the file of another may have written a tick again.
            for record in block.applied {
                if self.applied.back().is_none_or(|newest| newest.tick < record.tick) {
                    self.applied.push_back(record);
                }
            }
            for step in block.steps.into_iter().filter(|step| step.tick >= tick) {
                let known = self.steps.entry(step.tick).or_default();
                if !known.contains(&step) {
                    known.push(step);
                }
            }
            // A recorder that went on may have written an answer again, and a servo that was born anew may have answered a tick once more: the later one counts.
            for origin in block.origins.into_iter().filter(|origin| origin.tick >= tick) {
                if let Some(place) = self.origins.entry(origin.tick).or_default().get_mut(origin.servo as usize) {
                    *place = Some(origin);
                }
            }
            self.fluid.extend(block.fluid.into_iter().map(|status| (status.state_tick, status)));
            has_read = true;
        }
        if has_read {
            self.draw_line();
        }
        Ok(())
    }

    /// Finds the steps that count, from the newest one back. A state that no step made (a founder's, or one that was sent again by who took the role)
    /// is that of the newest step before it.
    fn draw_line(&mut self) {
        self.line.clear();
        let newest = |steps: &[StepRecord]| steps.iter().rev().max_by_key(|step| step.epoch).copied();
        let mut next = self.steps.values().next_back().and_then(|steps| newest(steps));
        while let Some(step) = next {
            self.line.insert(step.tick, step);
            // A step that says it was made from its own future is damage.
            let before = self.steps.range(..=step.from_tick.min(step.tick.saturating_sub(1))).next_back().map(|(_, steps)| steps);
            let named = |steps: &Vec<StepRecord>| {
                steps.iter().find(|other| (other.tick, other.incarnation) == (step.from_tick, step.from_incarnation)).copied()
            };
            next = before.and_then(|steps| named(steps).or_else(|| newest(steps))).filter(|other| other.tick < step.tick);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Block, Writer};

    fn applied(tick: u64) -> AppliedRecord {
        let mut record = AppliedRecord { tick, lag: 1, ..Default::default() };
        record.command.tick = tick;
        record
    }

    fn step(tick: u64, incarnation: u32, from: (u64, u32)) -> StepRecord {
        let (from_tick, from_incarnation) = from;
        let state_hash = tick << 8 | u64::from(incarnation);
        StepRecord { tick, state_hash, from_tick, from_incarnation, incarnation, epoch: 1, step_ticks: 1, ..Default::default() }
    }

    fn playback(name: &str, blocks: &[Block]) -> Playback<std::io::Cursor<Vec<u8>>> {
        let path = std::env::temp_dir().join(format!("hyst-playback-{}-{name}.mcap", std::process::id()));
        let mut writer = Writer::open(&path, &Session::from([("session".into(), "p".into())])).unwrap();
        blocks.iter().for_each(|block| writer.append(block).unwrap());
        writer.finish().unwrap();
        let bytes = std::fs::read(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        Playback::new(Reader::new(std::io::Cursor::new(bytes), &path).unwrap())
    }

    #[test]
    fn a_tick_has_what_the_device_did_and_the_step_that_counted_although_that_was_heard_of_later() {
        // 7 made tick 3; its spare 8 had made it too, and its state was gone on from. 8 leapt over tick 5, for which 7 had made a state that nobody went on
        // from. The device skipped tick 4.
        let steps = vec![step(3, 7, (2, 7)), step(3, 8, (2, 7)), step(4, 8, (3, 8)), step(5, 7, (3, 7)), step(6, 8, (4, 8))];
        let first = Block { applied: [2, 3, 5, 6].map(applied).to_vec(), steps: vec![step(2, 7, (1, 7))], ..Block::default() };
        let second = Block { applied: vec![applied(7)], steps, ..Block::default() };
        let mut playback = playback("late", &[first, second]);
        assert_eq!(playback.first_tick().unwrap(), Some(2));
        let mut seen = Vec::new();
        for tick in 1.. {
            let Some(moment) = playback.at(tick).unwrap() else { break };
            seen.push((moment.applied.map(|record| record.tick), moment.step.map(|step| (step.tick, step.incarnation))));
        }
        let device = [None, Some(2), Some(3), None, Some(5), Some(6), Some(7)];
        let tissue = [None, Some((2, 7)), Some((3, 8)), Some((4, 8)), None, Some((6, 8)), None];
        assert_eq!(seen, device.into_iter().zip(tissue).collect::<Vec<_>>());
    }

    /// The tissue began before the device, which was held up in tick 4 until the state of 7 was there, and took the model of that. 8 was made from what it did then.
    #[test]
    fn steps_are_due_before_the_tick_of_the_device_that_read_what_they_made_and_none_is_due_twice() {
        let of_input = |tick, input_tick| StepRecord { input_tick, ..step(tick, 7, (tick - 1, 7)) };
        let steps =
            [(2, 0), (3, 0), (4, 2), (5, 3), (6, 3), (7, 3), (8, 4), (9, 8)].map(|(tick, from)| of_input(tick, from)).to_vec();
        let of_model = |tick, model_tick| AppliedRecord { model_tick, model_epoch: 1, ..applied(tick) };
        for late_model in [7, 8, u64::MAX] {
            let device = [of_model(3, 2), of_model(4, late_model), of_model(8, 8), of_model(9, 9)].to_vec();
            let mut playback =
                playback(&format!("due-{late_model}"), &[Block { applied: device, steps: steps.clone(), ..Block::default() }]);
            assert_eq!(playback.first_applied().unwrap().map(|record| record.tick), Some(3));
            assert_eq!(playback.first_tick().unwrap(), Some(2));
            let due: Vec<Vec<u64>> = (2..=9)
                .map(|tick| {
                    playback.at(tick).unwrap().unwrap();
                    playback.due(tick).iter().map(|step| step.tick).collect()
                })
                .collect();
            let none = Vec::new;
            assert_eq!(due, vec![vec![2], vec![3], vec![4, 5, 6, 7], none(), none(), none(), vec![8], vec![9]], "{late_model}");
        }
    }

    /// The recorder hears of a late answer after its tick; one that goes on tells what the one before has told; the successor of a servo answers a tick again.
    #[test]
    fn a_tick_has_what_each_servo_went_on_from_although_that_was_heard_of_later_or_twice() {
        let origin = |tick, servo, from_tick| OriginRecord { tick, from_tick, servo, from_servo: servo };
        let first = Block { applied: [2, 3, 4].map(applied).to_vec(), origins: vec![origin(3, 1, 1)], ..Block::default() };
        let origins = vec![origin(3, 1, 1), origin(2, 0, 1), origin(6, 0, 4), origin(6, 0, 5), origin(5, 7, 4)];
        let second = Block { applied: [5, 6].map(applied).to_vec(), origins, ..Block::default() };
        let mut playback = playback("origins", &[first, second]);
        let mut from = |tick| playback.at(tick).unwrap().unwrap().origins.map(|origin| origin.map(|origin| origin.from_tick));
        let seen: Vec<_> = (2..=6).map(&mut from).collect();
        assert_eq!(seen, [[Some(1), None], [None, Some(1)], [None; 2], [None; 2], [Some(5), None]]);
    }

    #[test]
    fn a_long_recording_is_held_a_few_seconds_at_a_time() {
        let block = |first: u64| Block {
            applied: (first..first + 200).map(applied).collect(),
            steps: (first..first + 200).map(|tick| step(tick, 7, (tick - 1, 7))).collect(),
            ..Block::default()
        };
        let blocks: Vec<Block> = (0..100).map(|part| block(1 + 200 * part)).collect();
        let mut playback = playback("long", &blocks);
        let mut most = 0;
        for tick in 1..=20_000 {
            let moment = playback.at(tick).unwrap().unwrap();
            assert_eq!((moment.applied.unwrap().tick, moment.step.unwrap().tick), (tick, tick));
            most = most.max(playback.applied.len()).max(playback.steps.len());
        }
        assert!(playback.at(20_001).unwrap().is_none());
        assert!(most <= AHEAD_TICKS as usize + 400, "{most}");
    }
}
