//! When swaps were under way. In a swap more processes run than otherwise, and a role goes from one to another: a control that lies in one says nothing of
//! ticks without a fault, and that of a fault in a swap would share what the swap itself costs. So no control lies in any swap.

use super::Faults;
use crate::ledger::HISTORY_TICKS;
use serde::{Deserialize, Serialize};

/// One swap.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Swap {
    /// Station tick at which it was asked for.
    from_tick: u64,
    /// The one after its end; `None` while it goes on.
    to_tick: Option<u64>,
}

impl Faults {
    /// A swap was asked for at this time; told again by a supervisor that goes on with one.
    pub(super) fn swap_begun(&mut self, begun_ns: u64) {
        let from_tick = self.tick_at(begun_ns);
        match self.open.swaps.iter_mut().find(|swap| swap.from_tick == from_tick) {
            Some(known) => known.to_tick = None,
            None => self.open.swaps.push(Swap { from_tick, to_tick: None }),
        }
        self.keep_open();
    }

    /// No swap is under way any more.
    pub fn swap_ended(&mut self, ended_ns: u64) {
        let to_tick = self.tick_at(ended_ns) + 1;
        let mut open = self.open.swaps.iter_mut().filter(|swap| swap.to_tick.is_none()).peekable();
        if open.peek().is_some() {
            open.for_each(|swap| swap.to_tick = Some(to_tick));
            self.keep_open();
        }
    }

    /// The swaps as far as the ledger reaches, as station ticks; the one under way has no end before the newest tick.
    pub(super) fn swaps(&mut self, newest_tick: u64) -> Vec<(u64, u64)> {
        let is_kept = |swap: &Swap| swap.to_tick.is_none_or(|to_tick| to_tick + HISTORY_TICKS as u64 > newest_tick);
        self.open.swaps.retain(is_kept);
        let end = |swap: &Swap| swap.to_tick.unwrap_or(newest_tick.max(swap.from_tick) + 1);
        self.open.swaps.iter().map(|swap| (swap.from_tick, end(swap))).collect()
    }
}

/// A window with the swaps that it lies in.
pub(super) fn around(window: (u64, u64), swaps: &[(u64, u64)]) -> (u64, u64) {
    let touching = swaps.iter().filter(|(from, to)| *from < window.1 && window.0 < *to);
    touching.fold(window, |whole, (from, to)| (whole.0.min(*from), whole.1.max(*to)))
}
