//! Which control a fault gets, how long it is waited for, and what the hand lost right after the fault's window.

use crate::fault::Fault;
use crate::ledger::{AFTERMATH_TICKS, Controls, Ledger, Wanted, Window};

/// How long a window, or the swap that it lies in, is over when it waits no longer for a control in its own state, ticks; then any will do.
const ALIKE_WAIT_TICKS: u64 = 1_000;
/// The same for a control of its own; then it shares another fault's.
const OWN_WAIT_TICKS: u64 = 3_000;

/// A fault in search of its control.
#[derive(Clone, Copy, Debug)]
pub(super) struct Search<'a> {
    pub ledger: &'a Ledger,
    /// Windows of faults and swaps, its own among them.
    pub hurt: &'a [(u64, u64)],
    /// Its window.
    pub window: (u64, u64),
    /// The same with the swap that it fell into.
    pub whole: (u64, u64),
    /// Whether it began in contact.
    pub contact: bool,
}

impl Search<'_> {
    fn length(&self) -> u64 {
        self.window.1 - self.window.0
    }

    /// Ticks since the end of the window, and of the swap.
    fn waited_ticks(&self) -> u64 {
        self.ledger.newest_tick().map_or(0, |tick| tick.saturating_sub(self.whole.1))
    }

    /// Whether the window is over, and what comes right after it.
    pub fn is_over(&self) -> bool {
        self.ledger.newest_tick().is_some_and(|tick| tick >= self.window.1 + AFTERMATH_TICKS)
    }

    /// Whether a control of its own is waited for no longer: a long window has a long one.
    pub fn has_waited(&self) -> bool {
        let patience_ticks = OWN_WAIT_TICKS.max(self.length() + OWN_WAIT_TICKS / 3);
        self.waited_ticks() >= AFTERMATH_TICKS + patience_ticks
    }

    fn nearest(&self, used: &[(u64, u64)], contact: Option<bool>, early: bool) -> Option<Window> {
        let wanted = Wanted { length: self.length(), around: self.whole, contact, early };
        let is_there = self.ledger.newest_tick().is_some_and(|tick| tick >= self.window.1);
        Controls { ledger: self.ledger, hurt: self.hurt, used }.nearest(wanted).filter(|_| is_there)
    }

    /// A control of its own: in the same state, and in any once that has been waited for.
    pub fn own(&self, used: &[(u64, u64)]) -> Option<Window> {
        let alike = self.nearest(used, Some(self.contact), false);
        let any = || (self.waited_ticks() >= ALIKE_WAIT_TICKS).then(|| self.nearest(used, None, false)).flatten();
        alike.or_else(any)
    }

    /// The best that there is when nothing is waited for any more, and what is wrong with it.
    pub fn any(&self, used: &[(u64, u64)], fault: &mut Fault) -> Option<Window> {
        for (early, shared) in [(false, false), (false, true), (true, false), (true, true)] {
            let used = if shared { &[] } else { used };
            let found = [Some(self.contact), None].into_iter().find_map(|contact| self.nearest(used, contact, early));
            if found.is_some() {
                (fault.control_early, fault.control_shared) = (early, shared);
                return found;
            }
        }
        None
    }

    /// The ticks right after the window, up to the next fault or swap; `None` where one is under way.
    pub fn aftermath(&self) -> Option<Window> {
        let end = self.window.1;
        let next = self.hurt.iter().filter(|(_, to)| *to > end).map(|(from, _)| *from).min().unwrap_or(u64::MAX);
        let to_tick = next.min(end + AFTERMATH_TICKS);
        (to_tick > end).then(|| self.ledger.window(end, to_tick))
    }
}
