//! What tissue and fluid of a campaign's station say of themselves, read from their pages.

use super::{Session, Trouble};
use crate::campaign::outcome::Counters;
use hyst_messages::page::{fluid, header};
use hyst_messages::{Role, Slot};

/// A fluid that has just taken its role says something after its first step.
const TOLD_NS: u64 = 2_000_000_000;

impl Session {
    /// The same once both say something, or as it is after a while.
    pub(super) fn told_counters(&mut self) -> Result<Counters, Trouble> {
        let told = self.wait(TOLD_NS, |session| Some(session.counters()).filter(Counters::are_told))?;
        Ok(told.unwrap_or_else(|| self.counters()))
    }

    /// What tissue and fluid say of themselves: the newest of either, whoever wrote it.
    pub(super) fn counters(&mut self) -> Counters {
        let mut found = Counters { tick: self.tick(), ..Counters::default() };
        let mut fluid_key = (0, 0);
        let Some(viewer) = &mut self.viewer else { return found };
        if let Some(status) = viewer.tissue_status() {
            found.tissue_tick = status.state_tick;
            (found.contacts, found.removed_volume_ml) = (status.contact_count, status.removed_volume_ml);
            (found.cuts, found.is_cutting) = (status.cuts, status.is_cutting != 0);
            found.left = status.washed_out.saturating_add(status.taken_out);
            found.topology_version = status.topology_version;
        }
        // The last one is a guest's, who has the role in the midst of a swap.
        for index in 0..Role::Tissue.slots().1.max(Role::Fluid.slots().1) {
            for role in Role::STATEFUL {
                let founded = Slot::new(role, index)
                    .and_then(|slot| viewer.slot_page(slot))
                    .map_or(0, |page| page.load64(header::FOUNDED_TICK));
                found.founded_tick = found.founded_tick.max(founded);
            }
            let status = Slot::new(Role::Fluid, index).and_then(|slot| viewer.slot_page(slot)?.cell(fluid::STATUS));
            // By epoch: one that goes on from an older state has a smaller tick than what is over.
            if let Some((_, status)) = status.filter(|(_, status)| (status.epoch, status.state_tick) >= fluid_key) {
                fluid_key = (status.epoch, status.state_tick);
                (found.fluid_tick, found.deficit_ml) = (status.state_tick, status.deficit_ml);
            }
        }
        found
    }
}
