//! The epoch that a look at the station shows beside a process.

use hyst_exchange::{Roster, StationPage};
use hyst_messages::page::station as layout;
use hyst_messages::{Role, Slot};

/// That in which the process of a slot holds its role, as the roster says; 0 if it holds none. Of the supervisor, how often one was started.
pub(super) fn epoch_of(page: &StationPage, roster: &Roster, slot: Slot) -> u32 {
    match slot.role() {
        Role::Supervisor => page.page().load64(layout::SUPERVISOR_STARTS) as u32,
        role if role.is_stateful() => {
            let holder = roster.holder(role);
            if holder.incarnation == page.incarnation(slot) { holder.epoch } else { 0 }
        }
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::super::Viewer;
    use super::*;
    use hyst_exchange::{Station, Tenure};
    use hyst_messages::page::header;

    /// A spare was shown with the epoch of the holder.
    #[test]
    fn an_epoch_stands_beside_who_holds_the_role_and_beside_the_supervisor_how_often_one_was_started() {
        let station = Station::named(&format!("t{}-view-epoch", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let page = station.open_for_keeping().unwrap();
        page.fetch_add64(layout::SUPERVISOR_STARTS, 2);
        let tenure = Roster::open(&station).unwrap().promote(Role::Tissue, Tenure::default(), 7).unwrap();
        let [holder, spare] = [0, 1].map(|index| Slot::new(Role::Tissue, index).unwrap());
        for (slot, incarnation) in [(Slot::first(Role::Device), 6), (holder, 7), (spare, 8), (Slot::first(Role::Supervisor), 9)] {
            page.store32(layout::SLOT_PID + slot.number(), std::process::id());
            page.store32(layout::SLOT_INCARNATION + slot.number(), incarnation);
            if slot.role().is_stateful() {
                // Both say who has the role.
                station.create_slot(slot, incarnation).unwrap().store64(header::TENURE, tenure.word());
            }
        }
        let view = Viewer::open(&station).unwrap().look();
        let shown: Vec<(&str, u32)> = view.processes.iter().map(|process| (process.name.as_str(), process.epoch)).collect();
        assert_eq!(shown, [("device", 0), ("tissue:0", tenure.epoch), ("tissue:1", 0), ("supervisor", 2)]);
        station.wipe();
    }
}
