//! A hand-over that is under way when a fault comes: it is waited for from the fault on for which a role is handed over, for that is found after seconds, and
//! nobody knows before in which tick.

use super::{Session, Trouble};
use crate::campaign::cell::{Cell, State};
use crate::campaign::draw::Entry;
use crate::campaign::outcome::Outcome;
use crate::doing;
use crate::faultfile::{Target, Which};
use hyst_messages::{Role, TICK_NS};

/// How long a hand-over is waited for, ns: four times what growth takes to be found at most.
const HANDED_NS: u64 = 64_000_000_000;
/// How much longer than the ticks after it it is waited for the fault's, ns, and for whoever starts in the place of who had the role.
const SPARE_NS: u64 = 1_000_000_000;

impl Session {
    /// The tick of a cell's fault where the one beside it, if there is one, was asked for at this tick: so long after it, or 0, which is at once, so long after
    /// its hand-over was seen. `None` if no role was handed over.
    pub(super) fn second_tick(
        &mut self,
        outcome: &mut Outcome,
        entry: &Entry,
        cell: &Cell,
        tick: u64,
    ) -> Result<Option<u64>, Trouble> {
        let Some(with) = &cell.with else { return Ok(Some(tick)) };
        let handed = Target::parse(&with.target).filter(|_| cell.state == State::Handover);
        let Some(Target { role, .. }) = handed else { return Ok(Some(tick + entry.with_ticks)) };
        let is_handed = |session: &mut Session| {
            let viewer = session.viewer.as_ref()?;
            doing::is_handed_over(role, viewer).then(|| session.tick())
        };
        let Some(handed_tick) = self.wait(HANDED_NS, is_handed)? else { return Ok(None) };
        outcome.handed_tick = Some(handed_tick);
        let of_spare = Target { role, which: Which::Spare };
        let needs_both = Target::parse(&cell.injection.target) == Some(of_spare);
        let is_time = |session: &mut Session| {
            let is_there = !needs_both || session.are_there(role);
            (is_there && session.tick() >= handed_tick + entry.with_ticks).then_some(())
        };
        self.wait(entry.with_ticks * TICK_NS + SPARE_NS, is_time)?;
        Ok(Some(0))
    }

    /// Whether there is a process in each place of a role, be it in its start.
    fn are_there(&self, role: Role) -> bool {
        let Some(viewer) = &self.viewer else { return false };
        let mut of_role = self.slots.iter().filter(|slot| slot.role() == role);
        of_role.all(|slot| viewer.page().pid(*slot) != 0 && !viewer.page().is_dead(*slot))
    }
}
