//! How far the sequencer of a lock-step station may run: to the tick of the next fault of the schedule, or to the end of the run. The faults
//! of a tick are injected while the sequencer holds there, so they hit the same state in every run.
//!
//! The word in the station page is all there is to know; a supervisor that was restarted reads it and goes on.

use crate::faults::Faults;
use crate::view::Viewer;
use hyst_exchange::OwnedPage;
use hyst_messages::page::station as layout;
use hyst_messages::{Role, Slot};
use std::sync::Arc;

/// How long a hold lasts at most until every process is ready, ns: for the start of the run, and for a fault that must not meet the
/// recovery from the one before. As long as a start-up may take.
const WHOLE_WITHIN_NS: u64 = 30_000_000_000;

/// What moves the sequencer on.
#[derive(Debug)]
pub struct Permit {
    page: Arc<OwnedPage>,
    end_tick: Option<u64>,
    holds_since_ns: Option<u64>,
}

impl Permit {
    /// The permit of a station; `None` if it does not run in lock-step.
    pub fn new(page: &Arc<OwnedPage>, end_tick: Option<u64>) -> Option<Permit> {
        let is_lockstep = page.load32(layout::LOCKSTEP) != 0;
        is_lockstep.then(|| Permit { page: Arc::clone(page), end_tick, holds_since_ns: None })
    }

    /// If the sequencer holds and every process is ready: injects what is due, and lets it run on.
    pub fn tend(&mut self, now_ns: u64, slots: &[Slot], faults: &mut Faults, viewer: &mut Viewer) {
        let ended = self.page.load64(layout::ENDED_TICK);
        if ended < self.page.load64(layout::RUN_TO) {
            self.holds_since_ns = None;
            return;
        }
        let since_ns = *self.holds_since_ns.get_or_insert(now_ns);
        let is_over = self.end_tick.is_some_and(|end_tick| ended >= end_tick);
        if is_over || (now_ns - since_ns < WHOLE_WITHIN_NS && !is_whole(slots, viewer)) {
            return;
        }
        faults.inject_due(ended, viewer);
        let next = faults.next_tick().unwrap_or(u64::MAX).min(self.end_tick.unwrap_or(u64::MAX));
        self.page.store64(layout::RUN_TO, next);
    }
}

/// Whether every slot has a living process that is warm or live. Rendering steps with nobody, and is ready only once there is a picture.
fn is_whole(slots: &[Slot], viewer: &mut Viewer) -> bool {
    slots.iter().filter(|slot| slot.role() != Role::Rendering).all(|slot| viewer.is_well(*slot))
}
