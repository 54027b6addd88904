//! The control of a fault's window: as many ticks of the same run to which nobody did anything.
//!
//! What a fault does to the hand may come after its recovery. A control that lay there would take that harm for what is lost without a fault, and the fault
//! for one that spared some: so none begins before [`AFTERMATH_TICKS`] after a window. Nor does one lie in the station's first seconds.

use super::{Ledger, STEADY_TICKS, Window};

/// Ticks after the window of a fault, or a swap, in which no control lies. What came later than a fault's window came 130 to 170 ms after it on machines that
/// have time for the station (`docs/faults.md`).
pub const AFTERMATH_TICKS: u64 = 300;
/// Between two tries for a control window, ticks.
const STEP_TICKS: u64 = 20;
/// How far from the fault, or from the swap that it fell into, its control may lie, ticks: the same breath of the scripted hand, and the same load of the machine.
const REACH_TICKS: u64 = 8_000;

/// What a control is wanted for.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// Its length, ticks.
    pub length: u64,
    /// First tick, and the one after the last, of the fault's window with the swap that it fell into.
    pub around: (u64, u64),
    /// Whether it is to begin in contact; `None`: whatever it begins in.
    pub contact: Option<bool>,
    /// Whether it may lie in the station's first seconds.
    pub early: bool,
}

/// Where controls may lie.
#[derive(Clone, Copy, Debug)]
pub struct Controls<'a> {
    /// The ticks.
    pub ledger: &'a Ledger,
    /// Windows of faults and swaps.
    pub hurt: &'a [(u64, u64)],
    /// Controls of other faults.
    pub used: &'a [(u64, u64)],
}

impl Controls<'_> {
    /// The nearest to the fault, before it or after it, of those that are there; `None` if there is none yet.
    pub fn nearest(&self, wanted: Wanted) -> Option<Window> {
        let (length, (from_tick, to_tick)) = (wanted.length, wanted.around);
        let least = self.ledger.since_start(if wanted.early { super::SETTLING_TICKS } else { STEADY_TICKS })?;
        let newest = self.ledger.newest_tick()?;
        let is_free = |start: u64| {
            let end = start + length;
            let meets_none = self.used.iter().all(|(from, to)| end <= *from || start >= *to);
            meets_none && self.hurt.iter().all(|(from, to)| end <= *from || start >= *to + AFTERMATH_TICKS)
        };
        let is_alike = |start: u64| wanted.contact.is_none_or(|contact| self.ledger.in_contact(start) == contact);
        (0..REACH_TICKS / STEP_TICKS)
            .flat_map(|step| {
                let before = from_tick.checked_sub(length + step * STEP_TICKS);
                [before, Some(to_tick + AFTERMATH_TICKS + step * STEP_TICKS)]
            })
            .flatten()
            .filter(|start| *start >= least && start + length <= newest)
            .find(|start| is_free(*start) && is_alike(*start))
            .map(|start| self.ledger.window(start, start + length))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ledger::tests::ledger;

    const WANTED: Wanted = Wanted { length: 200, around: (8_600, 8_800), contact: Some(true), early: false };

    fn nearest(ledger: &Ledger, wanted: Wanted, hurt: &[(u64, u64)], used: &[(u64, u64)]) -> Option<(u64, u64)> {
        Controls { ledger, hurt, used }.nearest(wanted).map(|window| (window.from_tick, window.to_tick))
    }

    #[test]
    fn it_has_the_same_length_and_state_and_is_the_nearest_that_meets_no_fault() {
        let ledger = ledger(12_000, &[], &[]);
        let own = [(8_600, 8_800)];
        assert_eq!(
            nearest(&ledger, WANTED, &own, &[]),
            Some((9_500, 9_700)),
            "the first that begins in contact, 400 ticks from the earliest"
        );
        assert_eq!(nearest(&ledger, WANTED, &own, &[(9_500, 9_700)]), Some((7_980, 8_180)), "another's control is its own");
        assert_eq!(nearest(&ledger, Wanted { contact: None, ..WANTED }, &own, &[]), Some((8_400, 8_600)));
        let others = [(8_600, 8_800), (5_000, 8_600)];
        assert_eq!(nearest(&ledger, WANTED, &others, &[]), Some((9_500, 9_700)), "after it");
        assert_eq!(nearest(&ledger, WANTED, &[(0, 12_000)], &[]), None);
    }

    #[test]
    fn none_lies_where_a_fault_may_still_do_harm() {
        let ledger = ledger(12_000, &[], &[]);
        let wanted = Wanted { contact: None, ..WANTED };
        // Another fault ended 400 ticks before this one: 300 of them are its aftermath, and 100 hold no control.
        let hurt = [(8_600, 8_800), (8_000, 8_200)];
        assert_eq!(nearest(&ledger, wanted, &hurt, &[]), Some((9_100, 9_300)), "{AFTERMATH_TICKS} ticks after its own");
        assert_eq!(nearest(&ledger, wanted, &[(8_600, 8_800), (7_900, 8_100)], &[]), Some((8_400, 8_600)));
    }

    #[test]
    fn none_lies_in_the_first_seconds_unless_it_may() {
        let ledger = ledger(6_000, &[], &[]);
        let wanted = Wanted { around: (5_100, 5_300), contact: None, ..WANTED };
        assert_eq!(nearest(&ledger, wanted, &[(5_100, 5_300)], &[]), Some((5_600, 5_800)));
        assert_eq!(nearest(&ledger, Wanted { early: true, ..wanted }, &[(5_100, 5_300)], &[]), Some((4_900, 5_100)));
        let wanted = Wanted { around: (5_800, 6_000), ..wanted };
        assert_eq!(nearest(&ledger, wanted, &[(5_800, 6_000)], &[]), Some((5_600, 5_800)));
    }

    #[test]
    fn a_tick_that_is_void_is_missed_neither_in_the_window_of_a_fault_nor_in_its_control() {
        let (from_tick, to_tick) = WANTED.around;
        let wanted = Wanted { contact: None, ..WANTED };
        let arms = |missed: &[u64], void: &[u64]| {
            let ledger = ledger(12_000, missed, void);
            let controls = Controls { ledger: &ledger, hurt: &[(from_tick, to_tick)], used: &[] };
            let control = controls.nearest(wanted).expect("a control");
            assert_eq!((control.from_tick, control.to_tick), (8_400, 8_600));
            [ledger.window(from_tick, to_tick), control].map(|arm| (arm.ticks, arm.missed, arm.late, arm.voided))
        };
        let late = [8_450, 8_451, 8_650, 8_651, 8_652];
        assert_eq!(arms(&late, &[]), [(200, 3, 3, 0), (200, 2, 2, 0)]);
        assert_eq!(arms(&late, &[8_451, 8_652]), [(199, 2, 3, 1), (199, 1, 2, 1)]);
        assert_eq!(arms(&late, &late), [(197, 0, 3, 3), (198, 0, 2, 2)]);
    }
}
