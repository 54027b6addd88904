//! The hardware's ledger as the supervisor keeps it: the last 40 s, tick by tick, and what was found in windows of it.
//!
//! A *miss* is a tick at which the hardware did not get a fresh force, unless the canaries saw the host itself stall (void).

mod control;
mod force;

pub use control::{AFTERMATH_TICKS, Controls, Wanted};

use force::{CONTACT_TICKS, distance, is_contact, norm};
use hyst_exchange::ReadPage;
use hyst_messages::page::hardware as layout;
use hyst_messages::{Applied, LedgerEntry};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Ticks that are kept: a control lies up to 8 s from its fault, and is judged seconds after its end.
pub const HISTORY_TICKS: usize = 40_000;
/// Ticks after the first fresh one that are still start-up.
pub const SETTLING_TICKS: u64 = 500;
/// Ticks after the first fresh one until the station is what it stays: its processes have come, its memory is mapped, its pictures are compiled. Nobody was
/// hurt before by a campaign, so that what is lost there is no control of what a fault costs.
pub const STEADY_TICKS: u64 = 5_000;
/// Ticks before a large change of the force, and after it, that are kept with a fault that broke its promise by it; of those that missed their force
/// twice as many.
const AROUND: usize = 8;
/// Of so many ticks the hardware's drifting clock makes one more or less at most (`drift_ppm`: 500 at most).
const MOST_DRIFT: u64 = 1_000;
/// No motor of such a device makes more, N; more was never meant to be applied.
const LIMIT_N: f32 = 50.0;

/// One tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tick {
    /// Tick of the hardware.
    pub hardware_tick: u64,
    /// The station's tick at that time; it never goes back.
    pub station_tick: u64,
    /// Tick that the force was computed for.
    pub force_tick: u64,
    /// Incarnation that computed it.
    pub source: u32,
    /// Force of the motors, N.
    pub force_n: [f32; 3],
    /// It is not fresh.
    pub late: bool,
    /// The host stalled: it counts in no comparison.
    pub void: bool,
    /// It is not finite, beyond any motor, or an old one.
    pub wrong: bool,
}

/// What was found in a window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Window {
    /// First station tick.
    pub from_tick: u64,
    /// Station tick after the last.
    pub to_tick: u64,
    /// Ticks that count.
    pub ticks: u64,
    /// Ticks without a fresh force.
    pub missed: u64,
    /// The same with those of the ticks that do not count.
    #[serde(default)]
    pub late: u64,
    /// Ticks that do not count because the host stalled.
    pub voided: u64,
    /// Ticks whose force was not finite, beyond any motor, or an old one.
    #[serde(default)]
    pub wrong: u64,
    /// Largest change of the force from one tick to the next, N.
    pub force_step_max_n: f64,
    /// The same of those changes that came while the hand felt no tissue, as the force just before them says; `None` where none came so, and of windows that
    /// were kept before this was noted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub open_step_max_n: Option<f64>,
    /// The same of those that came in contact.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact_step_max_n: Option<f64>,
    /// Whether the hand was in contact at its first tick; `None` of one without a tick, and of those that were kept before this was noted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact: Option<bool>,
}

impl Window {
    /// Counts a tick that had no fresh force, or had one, and in which the host stalled, or did not.
    pub fn count(&mut self, is_late: bool, is_void: bool) {
        self.voided += u64::from(is_void);
        self.ticks += u64::from(!is_void);
        self.missed += u64::from(is_late && !is_void);
        self.late += u64::from(is_late);
    }

    /// Whether it holds each of its ticks: the hardware's clock drifts against the station's, by less than one tick in a thousand. Of one that is not whole
    /// nothing can be said, neither that it missed few nor that it missed many.
    pub fn is_whole(&self) -> bool {
        let span = self.to_tick.saturating_sub(self.from_tick);
        self.ticks + self.voided + 1 + span / MOST_DRIFT >= span
    }

    /// The largest change of the force in the open, and in contact, N; `None` where none came so. Of a window that was kept before these were told apart, it
    /// is the largest of all, in the state in which it began.
    pub fn steps_n(&self, began_in_contact: bool) -> [Option<f64>; 2] {
        if self.open_step_max_n.is_some() || self.contact_step_max_n.is_some() {
            return [self.open_step_max_n, self.contact_step_max_n];
        }
        [false, true].map(|in_contact| (in_contact == began_in_contact).then_some(self.force_step_max_n))
    }
}

/// The history.
#[derive(Debug, Default)]
pub struct Ledger {
    ticks: VecDeque<Tick>,
    next_key: u64,
    first_fresh_tick: Option<u64>,
    newest_force_tick: u64,
    /// Keys before this were counted by a supervisor before this one.
    counted_to: u64,
    /// Ticks whose force was not finite or beyond any motor.
    pub invalid_applied: u64,
    /// Ticks whose force had been computed for an older tick than a force applied before, and for none of the last two.
    pub stale_applied: u64,
    /// Ticks that were overwritten before they were read.
    pub lost: u64,
    /// The hardware's totals as last read: its page may be gone when the report is written.
    pub totals: [u64; layout::TOTAL_COUNT],
    incarnation: u32,
}

/// What outlives the supervisor: key to which was counted, invalid, stale, lost.
pub type Counted = [u64; 4];

impl Ledger {
    /// A ledger that goes on counting where another ended; the history is read again as far as the ring holds it.
    pub fn resume([counted_to, invalid_applied, stale_applied, lost]: Counted) -> Ledger {
        Ledger { counted_to, invalid_applied, stale_applied, lost, ..Ledger::default() }
    }
    /// What a successor resumes from.
    pub fn counted(&self) -> Counted {
        [self.next_key.max(self.counted_to), self.invalid_applied, self.stale_applied, self.lost]
    }

    /// Reads what is new in the hardware's page.
    pub fn read(&mut self, page: &ReadPage) {
        if page.incarnation() != self.incarnation {
            // Another life of the hardware counts its ticks from the beginning.
            if self.incarnation != 0 {
                (self.next_key, self.counted_to, self.newest_force_tick) = (0, 0, 0);
            }
            self.incarnation = page.incarnation();
        }
        page.load64s(layout::TOTALS, &mut self.totals);
        let end = page.ring_end(layout::LEDGER);
        let oldest = end.saturating_sub(layout::LEDGER.entries as u64);
        if self.next_key < oldest {
            self.lost += if self.next_key == 0 { 0 } else { oldest - self.next_key };
            self.next_key = oldest;
        }
        if self.ticks.is_empty() {
            // Keys before the first that was ever written are not lost.
            while self.next_key < end && page.ring(layout::LEDGER, self.next_key).is_none() {
                self.next_key += 1;
            }
        }
        while self.next_key < end {
            let counts = self.next_key >= self.counted_to;
            match page.ring(layout::LEDGER, self.next_key) {
                Some(entry) => self.push(&entry, counts),
                None => self.lost += u64::from(counts),
            }
            self.next_key += 1;
        }
    }

    /// Adds a tick; `counts` is false for one that was counted before.
    pub fn push(&mut self, entry: &LedgerEntry, counts: bool) {
        let fresh = entry.kind == Applied::Fresh as u32;
        let strength_n = norm(entry.force_n);
        let invalid = !strength_n.is_finite() || strength_n > LIMIT_N;
        self.invalid_applied += u64::from(counts && invalid);
        // A device that has just been born holds what the motors make, and names no servo's force for it: tick 0.
        let goes_back = entry.force_tick != 0
            && entry.force_tick < self.newest_force_tick
            && entry.station_tick.saturating_sub(entry.force_tick) > 1;
        let stale = goes_back && entry.kind != Applied::Zero as u32 && entry.kind != Applied::Ramped as u32;
        self.stale_applied += u64::from(counts && stale);
        self.newest_force_tick = self.newest_force_tick.max(entry.force_tick);
        if fresh {
            self.first_fresh_tick.get_or_insert(entry.station_tick);
        }
        if self.ticks.len() >= HISTORY_TICKS {
            self.ticks.pop_front();
        }
        let station_tick = entry.station_tick.max(self.ticks.back().map_or(0, |tick| tick.station_tick));
        self.ticks.push_back(Tick {
            hardware_tick: entry.hardware_tick,
            station_tick,
            force_tick: entry.force_tick,
            source: entry.source_incarnation,
            force_n: entry.force_n,
            late: !fresh,
            void: entry.void != 0,
            wrong: invalid || stale,
        });
    }

    /// The newest station tick that was read; `None` before the first.
    pub fn newest_tick(&self) -> Option<u64> {
        self.ticks.back().map(|tick| tick.station_tick)
    }

    /// The first tick of the history that lies so long after the first fresh one; `None` while nothing fresh has been applied.
    pub fn since_start(&self, ticks: u64) -> Option<u64> {
        let first = self.first_fresh_tick? + ticks;
        self.ticks.front().map(|tick| tick.station_tick.max(first))
    }

    fn range(&self, from_tick: u64, to_tick: u64) -> (usize, usize) {
        let first = self.ticks.partition_point(|tick| tick.station_tick < from_tick);
        (first, self.ticks.partition_point(|tick| tick.station_tick < to_tick))
    }

    /// What happened in `from_tick..to_tick`.
    pub fn window(&self, from_tick: u64, to_tick: u64) -> Window {
        let (first, end) = self.range(from_tick, to_tick);
        let contact = self.ticks.get(first).filter(|_| first < end).map(|tick| is_contact(tick.force_n));
        let mut window = Window { from_tick, to_tick, contact, ..Window::default() };
        let mut steps_n: [Option<f64>; 2] = [None; 2];
        let mut before = first.checked_sub(1).and_then(|at| self.ticks.get(at));
        for (at, tick) in (first..).zip(self.ticks.range(first..end)) {
            window.count(tick.late, tick.void);
            window.wrong += u64::from(tick.wrong);
            if let Some(before) = before.filter(|before| !before.void && !tick.void) {
                let most_n = &mut steps_n[usize::from(self.is_in_contact_before(at))];
                *most_n = Some(most_n.unwrap_or(0.0).max(f64::from(distance(before.force_n, tick.force_n))));
            }
            before = Some(tick);
        }
        [window.open_step_max_n, window.contact_step_max_n] = steps_n;
        window.force_step_max_n = steps_n.into_iter().flatten().fold(0.0, f64::max);
        window
    }

    /// Whether the hand was in contact in each of the [`CONTACT_TICKS`] ticks before one: a kick in the open that takes two ticks makes no contact by its first.
    fn is_in_contact_before(&self, at: usize) -> bool {
        at.checked_sub(CONTACT_TICKS).is_some_and(|from| self.ticks.range(from..at).all(|tick| is_contact(tick.force_n)))
    }

    /// The ticks around the largest change of the force in a window, of those in the open or of those in contact; none where nothing changes.
    pub fn around_step(&self, window: &Window, in_contact: bool) -> Vec<Tick> {
        let (first, end) = self.range(window.from_tick, window.to_tick);
        let step_n = |at: &usize| {
            let (before, tick) = (&self.ticks[*at - 1], &self.ticks[*at]);
            let counts = !before.void && !tick.void && self.is_in_contact_before(*at) == in_contact;
            if counts { f64::from(distance(before.force_n, tick.force_n)) } else { 0.0 }
        };
        let most_n = window.steps_n(in_contact)[usize::from(in_contact)].unwrap_or(0.0);
        let found = (first.max(1)..end).find(|at| step_n(at) > 0.0 && step_n(at) >= most_n);
        let around = found.map_or(0..0, |at| at.saturating_sub(AROUND)..(at + AROUND).min(self.ticks.len()));
        self.ticks.range(around).copied().collect()
    }

    /// The first ticks of a window that missed their force, with those that do not count.
    pub fn late(&self, window: &Window) -> Vec<Tick> {
        let (first, end) = self.range(window.from_tick, window.to_tick);
        self.ticks.range(first..end).filter(|tick| tick.late).take(2 * AROUND).copied().collect()
    }

    /// Ticks of `from_tick..to_tick` at which a fresh force of this servo was applied.
    pub fn fresh_of(&self, source: u32, from_tick: u64, to_tick: u64) -> impl Iterator<Item = &Tick> {
        let (first, end) = self.range(from_tick, to_tick);
        self.ticks.range(first..end.max(first)).filter(move |tick| !tick.late && tick.source == source)
    }

    /// Of the same those at which the force was that of the two before it, to the bit, while the hand was in contact.
    pub fn repeated(&self, source: u32, from_tick: u64, to_tick: u64) -> u64 {
        let (mut before, mut run, mut repeated) = ([0.0; 3], 0, 0);
        for tick in self.fresh_of(source, from_tick, to_tick) {
            run = if tick.force_n.map(f32::to_bits) == before.map(f32::to_bits) { run + 1 } else { 1 };
            before = tick.force_n;
            repeated += u64::from(run > 2 && is_contact(tick.force_n));
        }
        repeated
    }

    /// The last tick of `from_tick..to_tick` that missed its force and counts. It costs as much as the ledger holds of them, however long they are.
    pub fn last_miss(&self, from_tick: u64, to_tick: u64) -> Option<u64> {
        let (first, end) = self.range(from_tick, to_tick);
        self.ticks.range(first..end.max(first)).rev().find(|tick| tick.late && !tick.void).map(|tick| tick.station_tick)
    }

    /// Whether the hand was in contact at a tick.
    pub fn in_contact(&self, tick: u64) -> bool {
        let at = self.ticks.partition_point(|entry| entry.station_tick < tick);
        self.ticks.get(at).is_some_and(|tick| is_contact(tick.force_n))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A ledger in which every other half second is in contact.
    pub(super) fn ledger(ticks: u64, missed: &[u64], void: &[u64]) -> Ledger {
        let mut ledger = Ledger::default();
        for tick in 0..ticks {
            let kind = if missed.contains(&tick) { Applied::Held } else { Applied::Fresh } as u32;
            let contact = (tick / 500) % 2 == 1;
            let entry = LedgerEntry {
                hardware_tick: tick,
                station_tick: tick,
                force_tick: tick,
                force_n: [if contact { 1.0 } else { 0.0 }, 0.0, 0.0],
                kind,
                void: u32::from(void.contains(&tick)),
                ..Default::default()
            };
            ledger.push(&entry, true);
        }
        ledger
    }

    #[test]
    fn misses_are_counted_and_void_ticks_count_in_neither() {
        let ledger = ledger(2_000, &[1_000, 1_001, 1_500], &[1_001, 1_002]);
        let window = ledger.window(990, 1_010);
        assert_eq!((window.ticks, window.missed, window.late, window.voided), (18, 1, 2, 2));
        assert_eq!(ledger.window(990, 1_001).force_step_max_n, 1.0, "the force falls from 1 N to 0 at tick 1000");
        assert_eq!(ledger.window(1_100, 1_200).force_step_max_n, 0.0);
        assert_eq!(ledger.window(5_000, 6_000).ticks, 0);
        let around = ledger.around_step(&ledger.window(990, 1_010), true);
        let at = |tick: u64| around.iter().position(|entry| entry.station_tick == tick);
        assert_eq!((around.len(), at(999), at(1_000)), (2 * AROUND, Some(AROUND - 1), Some(AROUND)), "{around:?}");
        let none = [(990, 1_010, false), (1_100, 1_200, false), (1_100, 1_200, true)];
        assert!(none.iter().all(|(from, to, touches)| ledger.around_step(&ledger.window(*from, *to), *touches).is_empty()));
        let late: Vec<u64> = ledger.late(&ledger.window(990, 1_400)).iter().map(|tick| tick.station_tick).collect();
        assert_eq!(late, [1_000, 1_001]);
        let last = |from, to| ledger.last_miss(from, to);
        assert_eq!(
            [last(0, u64::MAX), last(0, 1_500), last(0, 1_000), last(1_501, 9_000)],
            [Some(1_500), Some(1_000), None, None]
        );
    }

    /// A window was told by the state in which it began, and a stroke that it met later was held against the open.
    #[test]
    fn a_change_of_the_force_is_in_the_open_or_in_contact_by_the_force_just_before_it() {
        let ledger = ledger(2_000, &[], &[1_501]);
        let steps_n = |from_tick, to_tick| {
            let window = ledger.window(from_tick, to_tick);
            (window.steps_n(false), window.force_step_max_n)
        };
        assert_eq!(steps_n(400, 600), ([Some(1.0), Some(0.0)], 1.0), "the tool comes to the wall at tick 500");
        assert_eq!(steps_n(900, 1_100), ([Some(0.0), Some(1.0)], 1.0), "and leaves it at 1000");
        assert_eq!([steps_n(100, 200), steps_n(600, 700)], [([Some(0.0), None], 0.0), ([None, Some(0.0)], 0.0)]);
        assert_eq!(steps_n(1_501, 1_502), ([Some(0.0), None], 0.0), "nothing in it counts, and it is taken for one in the open");
        let mut kicked = self::ledger(100, &[], &[]);
        for (tick, x) in (100..).zip([0.02, 1.0, 1.0, 1.0, 1.0, 1.0, 1.5]) {
            kicked
                .push(&LedgerEntry { station_tick: tick, force_tick: tick, force_n: [x, 0.0, 0.0], ..Default::default() }, true);
        }
        let steps_n = kicked.window(90, 107).steps_n(false).map(|step_n| step_n.map(|step_n| (100.0 * step_n).round()));
        assert_eq!(steps_n, [Some(98.0), Some(50.0)], "a kick that takes two ticks is one in the open");
        let text = "{\"from_tick\":1,\"to_tick\":9,\"ticks\":8,\"missed\":0,\"voided\":0,\"force_step_max_n\":0.3}";
        let old: Window = serde_json::from_str(text).unwrap();
        assert_eq!([true, false].map(|began| old.steps_n(began)), [[None, Some(0.3)], [Some(0.3), None]]);
    }

    #[test]
    fn a_window_that_the_history_no_longer_holds_is_not_whole_and_a_drifting_clock_leaves_it_so() {
        let short = ledger(HISTORY_TICKS as u64 + 10_000, &[], &[12_000]);
        assert!(short.window(11_000, 31_000).is_whole(), "with its void tick");
        assert!(!short.window(9_900, 30_000).is_whole(), "its first 100 ticks are gone");
        let window = |ticks, to_tick| Window { ticks, to_tick, ..Window::default() };
        assert_eq!([199, 198].map(|ticks| window(ticks, 200).is_whole()), [true, false]);
        assert_eq!([29_969, 29_968].map(|ticks| window(ticks, 30_000).is_whole()), [true, false]);
    }

    #[test]
    fn a_force_that_goes_back_or_is_no_number_is_counted() {
        let mut ledger = ledger(10, &[], &[]);
        let entry =
            |station_tick, force_tick, x| LedgerEntry { station_tick, force_tick, force_n: [x, 0.0, 0.0], ..Default::default() };
        ledger.push(&entry(10, 9, 1.0), true);
        ledger.push(&entry(11, 10, 1.0), true);
        assert_eq!((ledger.stale_applied, ledger.invalid_applied), (0, 0));
        ledger.push(&entry(12, 7, 1.0), true);
        ledger.push(&entry(13, 12, f32::NAN), true);
        ledger.push(&entry(14, 13, 500.0), true);
        ledger.push(&entry(15, 14, 500.0), false);
        assert_eq!((ledger.stale_applied, ledger.invalid_applied), (1, 2));
        ledger.push(&LedgerEntry { kind: Applied::Held as u32, ..entry(16, 0, 1.0) }, true);
        assert_eq!(ledger.stale_applied, 1, "what a newborn device holds is no servo's old force");
    }
}
