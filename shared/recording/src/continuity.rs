//! Whether a recording holds each tick once: what is not there, and neither lost nor unmade by the recorder's own words, and what is there twice.

use crate::block::{Block, TickRange};
use crate::sequence::unmade_in;

/// What has been seen of a recording, block by block in the file's order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Continuity {
    newest: Option<u64>,
    gaps: Vec<TickRange>,
    lost: Vec<TickRange>,
    /// Ticks that are there.
    pub ticks: u64,
    /// Ticks that are there twice, or behind a later one.
    pub repeated: u64,
    /// Ticks that were never made, as the recorder says.
    pub unmade: u64,
}

impl Continuity {
    /// Of a whole recording.
    pub fn of(content: &Block) -> Continuity {
        let mut all = Continuity::default();
        all.follow(content);
        all
    }

    /// Adds the next block.
    pub fn follow(&mut self, block: &Block) {
        for record in &block.applied {
            self.ticks += 1;
            match self.newest {
                Some(newest) if record.tick <= newest => self.repeated += 1,
                Some(newest) if record.tick > newest + 1 => {
                    self.gaps.push(TickRange { first: newest + 1, last: record.tick - 1 });
                }
                _ => {}
            }
            self.newest = self.newest.max(Some(record.tick));
        }
        // Whatever a damaged file says adds up.
        self.unmade = block.events.iter().filter_map(unmade_in).fold(self.unmade, u64::saturating_add);
        self.lost.extend(&block.lost);
    }

    /// Ticks that the recorder says are lost.
    pub fn lost(&self) -> u64 {
        self.lost.iter().map(TickRange::count).fold(0, u64::saturating_add)
    }

    /// Ticks between the first and the last that are not there, beyond those that are named as lost and as many as were never made. Whoever makes a recorder
    /// that drops ticks without a word is found by them.
    pub fn missing(&self) -> u64 {
        let mut lost = self.lost.clone();
        lost.sort_by_key(|range| range.first);
        let absent: u64 = self.gaps.iter().map(|gap| gap.count() - named(gap, &lost)).sum();
        absent.saturating_sub(self.unmade)
    }
}

/// Ticks of a gap that lie in one of these ranges, which ascend by their first tick.
fn named(gap: &TickRange, lost: &[TickRange]) -> u64 {
    let (mut from, mut named) = (gap.first, 0);
    for range in lost.iter().take_while(|range| range.first <= gap.last) {
        let (first, end) = (range.first.max(from), range.last.min(gap.last) + 1);
        if end > first {
            named += end - first;
            from = end;
        }
    }
    named
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sequence::skipped;
    use hyst_messages::AppliedRecord;

    fn block(ticks: &[u64]) -> Block {
        let applied = ticks.iter().map(|tick| AppliedRecord { tick: *tick, ..AppliedRecord::default() }).collect();
        Block { applied, ..Block::default() }
    }

    #[test]
    fn what_is_not_there_is_missing_unless_it_is_named_as_lost_or_was_never_made() {
        let whole = Continuity::of(&block(&[5, 6, 7]));
        assert_eq!((whole.ticks, whole.missing(), whole.repeated, whole.lost()), (3, 0, 0, 0));
        let mut gaps = Continuity::of(&block(&[5, 6, 10]));
        gaps.follow(&block(&[11, 15]));
        assert_eq!((gaps.missing(), gaps.repeated), (6, 0), "also between two blocks");
        // Two ranges that overlap name each tick once; one that comes after the gap counts, and one that lies elsewhere does not.
        let range = |first, last| TickRange { first, last };
        gaps.follow(&Block { lost: vec![range(8, 9), range(7, 8), range(1, 2)], ..Block::default() });
        assert_eq!((gaps.missing(), gaps.lost()), (3, 6));
        let events = skipped(&[range(12, 12), range(13, 13)]).into_iter().collect();
        gaps.follow(&Block { events, ..Block::default() });
        assert_eq!((gaps.unmade, gaps.missing()), (2, 1));
    }

    #[test]
    fn the_largest_numbers_that_a_damaged_file_can_name_are_added_too() {
        let most = TickRange { first: 0, last: u64::MAX };
        let skipped: Vec<_> = skipped(&[most]).into_iter().collect();
        let mut all = Continuity::of(&block(&[0, u64::MAX]));
        for _ in 0..2 {
            all.follow(&Block { lost: vec![most, most], events: skipped.clone(), ..Block::default() });
        }
        assert_eq!((all.lost(), all.unmade, all.missing()), (u64::MAX, u64::MAX, 0));
    }

    #[test]
    fn a_tick_that_comes_twice_or_late_is_repeated_and_leaves_no_gap() {
        let twice = Continuity::of(&block(&[5, 6, 6, 7, 5, 8]));
        assert_eq!((twice.repeated, twice.missing(), twice.ticks), (2, 0, 6));
    }
}
