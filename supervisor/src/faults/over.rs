//! How a fault is over whose victim is not the one who ends it: a successor is there, a place is empty on purpose, the keepers are whole again.

use super::Faults;
use crate::fault::{Fault, us};
use crate::faultfile::{FaultKind, Keepers};
use crate::keepers::Suffered;
use hyst_exchange::system;
use hyst_messages::{Role, Slot};

impl Faults {
    /// The guardian died; whoever takes its place is awaited by [`Faults::guardian_back`].
    pub fn guardian_died(&mut self, at_ns: u64) {
        let fault = self.start("external", Slot::first(Role::Guardian), 0, at_ns);
        (fault.manifested, fault.dead, fault.detected_by, fault.detected_us) = (true, true, "supervisor".into(), Some(0.0));
        self.keep_open();
    }

    /// The station has a guardian again.
    pub fn guardian_back(&mut self, at_ns: u64) {
        self.vacated(Slot::first(Role::Guardian), at_ns);
    }

    /// One who keeps the station was hurt for a time, and outlived it: over when that was. A limit of memory that was lowered is noticed by a death alone.
    pub fn suffered(&mut self, suffered: &Suffered) -> Result<(), String> {
        let Suffered { kind, keepers, since_ns, until_ns } = *suffered;
        if since_ns > until_ns || until_ns > system::now_ns() {
            return Err(format!("{} from {since_ns} to {until_ns} ns: that has not been", kind.name()));
        }
        // Of both it is the supervisor's, as their death is.
        let role = if keepers == Keepers::Guardian { Role::Guardian } else { Role::Supervisor };
        let fault = self.start(kind.name(), Slot::first(role), 0, since_ns);
        (fault.manifested, fault.recovered_us) = (kind != FaultKind::Oom, Some(us(until_ns, since_ns)));
        self.keep_open();
        Ok(())
    }

    /// A successor is warm or live.
    pub fn ready(&mut self, slot: Slot, incarnation: u32, at_ns: u64) {
        for fault in &mut self.open.faults {
            if fault.slot == slot.number() && fault.dead && fault.incarnation < incarnation && fault.recovered_us.is_none() {
                fault.recovered_us = Some(us(at_ns, fault.injected_ns));
            }
        }
        self.keep_open();
    }

    /// The newcomer of a swap goes: what was done to it is found by that, and is over with whoever has its place.
    pub fn doubted(&mut self, incarnation: u32, at_ns: u64) {
        let of = |fault: &&mut Fault| fault.incarnation == incarnation && fault.recovered_us.is_none();
        for fault in self.open.faults.iter_mut().filter(of) {
            (fault.manifested, fault.dead) = (true, true);
            if fault.detected_us.is_none() {
                (fault.detected_by, fault.detected_us) = ("swap".into(), Some(us(at_ns, fault.injected_ns)));
            }
        }
        self.keep_open();
    }

    /// The slot is given up on purpose: nobody is missed there, whether it died of its fault or was ended for it.
    pub fn vacated(&mut self, slot: Slot, at_ns: u64) {
        for fault in self.open.faults.iter_mut().filter(|fault| fault.slot == slot.number() && fault.recovered_us.is_none()) {
            fault.recovered_us = Some(us(at_ns, fault.injected_ns));
        }
        self.keep_open();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fault::Death;
    use crate::policy::Exit;
    use hyst_exchange::Station;

    #[test]
    fn what_a_keeper_suffered_is_over_when_it_was_and_what_has_not_been_is_refused() {
        let station = Station::named(&format!("t{}-suffered", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let mut faults = Faults::new(&station, &[]).unwrap();
        let now_ns = system::now_ns();
        let stop = Suffered { kind: FaultKind::Stop, keepers: Keepers::Guardian, since_ns: now_ns - 500_000, until_ns: now_ns };
        assert_eq!(faults.suffered(&stop), Ok(()));
        for other in
            [Suffered { until_ns: now_ns + 3_600_000_000_000, ..stop.clone() }, Suffered { since_ns: now_ns + 1, ..stop }]
        {
            assert!(faults.suffered(&other).is_err(), "{other:?}");
        }
        let found: Vec<_> = faults.all().map(|fault| (fault.target.as_str(), fault.manifested, fault.recovered_us)).collect();
        assert_eq!(found, [("guardian", true, Some(500.0))]);
        station.wipe();
    }

    #[test]
    fn a_fault_of_a_newcomer_that_is_rolled_back_is_over_with_the_swap() {
        let station = Station::named(&format!("t{}-vacated", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let mut faults = Faults::new(&station, &[]).unwrap();
        let (guest, other) = (Slot::guest(Role::Fluid).unwrap(), Slot::first(Role::Fluid));
        for (slot, incarnation) in [(guest, 7), (other, 8)] {
            faults.start("nan", slot, incarnation, 1_000);
        }
        faults.doubted(7, 2_000); // found out, and ended on purpose: it did not die
        let death = Death { at_ns: 2_500, open_ns: Some(1_500), beat_ns: 900 };
        faults.died(guest, 7, Exit::Signal(9), death); // told of after what followed from it: it is no other's
        faults.vacated(guest, 5_000);
        let found: Vec<_> = faults.all().map(|fault| (fault.dead, fault.detected_by.as_str())).collect();
        assert_eq!(found, [(true, "swap"), (false, "")]);
        let recovered: Vec<_> = faults.all().map(|fault| (fault.slot, fault.recovered_us.is_some())).collect();
        assert_eq!(recovered, [(guest.number(), true), (other.number(), false)]);
        station.wipe();
    }
}
