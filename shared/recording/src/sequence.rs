//! Each tick once: puts together what the force streams bring and what the rings of the device's lives still hold, says which ticks the
//! device never made and which are lost. Computes only; pages and streams are the caller's.

use crate::block::{Event, Level, TickRange};
use hyst_messages::AppliedRecord;
use hyst_messages::page::device::APPLIED;
use std::collections::BTreeMap;

/// Ticks that a device's ring holds.
pub const RING_TICKS: u64 = APPLIED.entries as u64;
/// Records of the streams that wait for their turn.
const MAX_PENDING: usize = 2 * APPLIED.entries;
/// Ticks that are judged in one call, so that a call has an end: about 50 ms of reading.
const MAX_TICKS: usize = 1 << 20;

/// The ring of one life of the device.
pub trait History {
    /// The first tick that this life made, as far as the ring shows; `None` if it has made none.
    fn began(&self) -> Option<u64>;
    /// The tick after the newest.
    fn end(&self) -> u64;
    /// The record of a tick.
    fn read(&self, tick: u64) -> Option<AppliedRecord>;
}

/// What one call gives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Taken {
    /// Records, ticks ascending, each tick once in the life of the collector.
    pub records: Vec<AppliedRecord>,
    /// Ticks that could not be had any more.
    pub lost: Vec<TickRange>,
    /// Ticks that the device skipped or was not there for.
    pub unmade: Vec<TickRange>,
}

/// Kind of the event that says which ticks the device never made.
const SKIPPED: &str = "skipped";

/// What is said at a tick of those that are lost, if there are any.
pub fn lost(tick: u64, ranges: &[TickRange]) -> Option<Event> {
    say(tick, Level::Error, "lost", "the recording has lost", ranges)
}

/// What is said of ticks that were never made, which is all that a file has of them.
pub(crate) fn skipped(ranges: &[TickRange]) -> Option<Event> {
    say(ranges.last()?.last, Level::Warning, SKIPPED, "the device made no tick", ranges)
}

fn say(tick: u64, level: Level, kind: &str, what: &str, ranges: &[TickRange]) -> Option<Event> {
    let (first, last) = (ranges.first()?.first, ranges.last()?.last);
    let count: u64 = ranges.iter().map(TickRange::count).sum();
    let text = format!("{what}: {count} in {} ranges from tick {first} to {last}", ranges.len());
    Some(Event { tick, level, kind: kind.into(), process: "recorder".into(), incarnation: 0, text })
}

/// How many ticks an event says were never made; `None` if it speaks of something else.
pub(crate) fn unmade_in(event: &Event) -> Option<u64> {
    let count = event.text.split_once(": ")?.1.split(' ').next()?;
    count.parse().ok().filter(|_| event.kind == SKIPPED)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Absence {
    NotYet,
    Unmade,
    Lost,
}

/// The next tick that is expected, and what came early.
#[derive(Debug, Default)]
pub struct Collector {
    next: Option<u64>,
    pending: BTreeMap<u64, AppliedRecord>,
}

impl Collector {
    /// A collector that goes on after `last_tick`; with `None` it begins with the oldest tick that can be had.
    pub fn after(last_tick: Option<u64>) -> Collector {
        Collector { next: last_tick.map(|tick| tick.saturating_add(1)), pending: BTreeMap::new() }
    }

    /// The next tick that is expected.
    pub fn next(&self) -> Option<u64> {
        self.next
    }

    /// Takes a record from a stream; several replicas bring the same one. A zeroed record is a tick that the device skipped.
    pub fn offer(&mut self, record: AppliedRecord) {
        if record.tick == 0 || self.next.is_some_and(|next| record.tick < next) || self.pending.len() >= MAX_PENDING {
            return;
        }
        self.pending.insert(record.tick, record);
    }

    /// Everything up to the newest tick of the newest life. `lives` are the lives of the device that are known, oldest first.
    pub fn collect<H: History>(&mut self, lives: &[H]) -> Taken {
        let mut taken = Taken::default();
        let Some(mut tick) = self.next.or_else(|| self.first(lives)) else {
            return taken;
        };
        for _ in 0..MAX_TICKS {
            match self.find(tick, lives).map_or_else(|| self.absence(tick, lives), Ok) {
                Ok(record) => taken.records.push(record),
                Err(Absence::NotYet) => break,
                Err(Absence::Unmade) => TickRange::extend(&mut taken.unmade, tick),
                Err(Absence::Lost) => TickRange::extend(&mut taken.lost, tick),
            }
            tick += 1;
        }
        self.next = Some(tick);
        self.pending = self.pending.split_off(&tick);
        taken
    }

    /// The oldest tick that can be had.
    fn first<H: History>(&self, lives: &[H]) -> Option<u64> {
        let life = lives.iter().find(|life| life.began().is_some())?;
        let ring = life.began()?.max((life.end() + 1).saturating_sub(RING_TICKS));
        Some(self.pending.keys().next().map_or(ring, |tick| ring.min(*tick)))
    }

    /// Why a tick that was not found is not there; or its record, if it was written after the look and before the judgement. What is there now and was
    /// overwritten in that time is lost, and no longer found.
    fn absence<H: History>(&self, tick: u64, lives: &[H]) -> Result<AppliedRecord, Absence> {
        match judge(tick, lives) {
            Absence::Unmade => self.find(tick, lives).ok_or_else(|| judge(tick, lives)),
            other => Err(other),
        }
    }

    fn find<H: History>(&self, tick: u64, lives: &[H]) -> Option<AppliedRecord> {
        for life in lives.iter().rev() {
            if let Some(record) = life.read(tick) {
                return Some(record);
            }
            // An older life counts only for what came before the newer one: what a zombie writes later was never felt.
            if life.began().is_some_and(|began| tick >= began) {
                break;
            }
        }
        self.pending.get(&tick).copied()
    }
}

/// Why a tick is not there.
fn judge<H: History>(tick: u64, lives: &[H]) -> Absence {
    let Some((newest, older)) = lives.split_last() else {
        return Absence::NotYet;
    };
    // Read after the record was looked for, so that a tick that was overwritten meanwhile is not taken for one that never was.
    let end = newest.end();
    if tick >= end {
        return Absence::NotYet;
    }
    if tick + RING_TICKS <= end {
        return Absence::Lost;
    }
    if newest.began().is_some_and(|began| tick >= began) {
        return Absence::Unmade;
    }
    for life in older.iter().rev() {
        let end = life.end();
        if tick >= end {
            return Absence::Unmade; // between two lives
        }
        if tick + RING_TICKS <= end {
            return Absence::Lost;
        }
        if life.began().is_some_and(|began| tick >= began) {
            return Absence::Unmade;
        }
    }
    Absence::Lost // before all lives that are known
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ring as the device keeps it.
    #[derive(Default)]
    struct Ring {
        ticks: Vec<u64>,
    }
    impl Ring {
        fn of(ticks: impl IntoIterator<Item = u64>) -> Ring {
            Ring { ticks: ticks.into_iter().collect() }
        }
    }
    impl History for Ring {
        fn began(&self) -> Option<u64> {
            self.ticks.iter().copied().find(|tick| tick + RING_TICKS >= self.end())
        }
        fn end(&self) -> u64 {
            self.ticks.last().map_or(0, |tick| tick + 1)
        }
        fn read(&self, tick: u64) -> Option<AppliedRecord> {
            (tick + RING_TICKS >= self.end() && self.ticks.contains(&tick)).then(|| record(tick))
        }
    }
    fn record(tick: u64) -> AppliedRecord {
        AppliedRecord { tick, ..Default::default() }
    }
    /// A ring into which the device writes a tick, and the next, right after somebody looked for it.
    struct Busy(std::cell::RefCell<Ring>);
    impl History for Busy {
        fn began(&self) -> Option<u64> {
            self.0.borrow().began()
        }
        fn end(&self) -> u64 {
            self.0.borrow().end()
        }
        fn read(&self, tick: u64) -> Option<AppliedRecord> {
            let found = self.0.borrow().read(tick);
            let mut ring = self.0.borrow_mut();
            if tick == ring.end() && tick.is_multiple_of(10) {
                ring.ticks.extend([tick, tick + 1]);
            }
            found
        }
    }
    fn ticks(taken: &Taken) -> Vec<u64> {
        taken.records.iter().map(|record| record.tick).collect()
    }
    fn range(first: u64, last: u64) -> TickRange {
        TickRange { first, last }
    }

    #[test]
    fn each_tick_comes_once_and_in_order_whatever_the_streams_repeat() {
        let mut collector = Collector::after(None);
        for tick in [12, 11, 12, 0, 13] {
            collector.offer(record(tick));
        }
        let taken = collector.collect(&[Ring::of(10..15)]);
        assert_eq!(ticks(&taken), [10, 11, 12, 13, 14]);
        collector.offer(record(13));
        let taken = collector.collect(&[Ring::of(10..18)]);
        assert_eq!(ticks(&taken), [15, 16, 17]);
        assert_eq!(collector.collect(&[Ring::of(10..18)]), Taken::default());
    }

    #[test]
    fn a_tick_that_the_device_skipped_is_not_called_lost() {
        let mut collector = Collector::after(Some(9));
        let taken = collector.collect(&[Ring::of([10, 11, 14, 15, 17])]);
        assert_eq!(ticks(&taken), [10, 11, 14, 15, 17]);
        assert_eq!((taken.unmade, taken.lost), (vec![range(12, 13), range(16, 16)], vec![]));
    }

    #[test]
    fn a_tick_that_is_made_while_it_is_looked_for_is_neither_skipped_nor_lost() {
        let mut collector = Collector::after(Some(7));
        let busy = [Busy(Ring::of(5..10).into())];
        let taken = collector.collect(&busy);
        assert_eq!((ticks(&taken), taken.unmade, taken.lost), ((8..12).collect(), vec![], vec![]));
        busy[0].0.borrow_mut().ticks.extend(12..20);
        let taken = collector.collect(&busy);
        assert_eq!((ticks(&taken), taken.unmade, taken.lost), ((12..22).collect(), vec![], vec![]));
    }

    #[test]
    fn what_left_the_ring_comes_from_the_stream_or_is_lost_and_counted() {
        let mut collector = Collector::after(Some(99));
        (100..150).for_each(|tick| collector.offer(record(tick)));
        let end = 200 + RING_TICKS;
        let taken = collector.collect(&[Ring::of(50..end)]);
        assert_eq!(taken.lost, [range(150, 199)]);
        assert_eq!(taken.records.len() as u64, 50 + RING_TICKS);
        assert_eq!(collector.next(), Some(end));
    }

    #[test]
    fn a_restart_of_the_device_leaves_no_loss_and_what_its_zombie_writes_is_not_taken() {
        let mut collector = Collector::after(None);
        assert_eq!(ticks(&collector.collect(&[Ring::of(10..20)])), (10..20).collect::<Vec<_>>());
        // The successor's page is there but empty: the rest of the old life comes first.
        let taken = collector.collect(&[Ring::of(10..23), Ring::default()]);
        assert_eq!(ticks(&taken), [20, 21, 22]);
        let taken = collector.collect(&[Ring::of((10..23).chain(30..35)), Ring::of(28..33)]);
        assert_eq!(ticks(&taken), [28, 29, 30, 31, 32]);
        assert_eq!((taken.unmade.clone(), taken.lost.clone()), (vec![range(23, 27)], vec![]));
    }

    #[test]
    fn ticks_before_every_known_life_are_lost_because_somebody_may_have_made_them() {
        let mut collector = Collector::after(Some(4));
        let taken = collector.collect(&[Ring::of(8..10)]);
        assert_eq!((ticks(&taken), taken.lost), (vec![8, 9], vec![range(5, 7)]));
    }
}
