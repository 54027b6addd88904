//! A process that goes on after a stop because it is told to, before it is ended for it: nobody else is, and what had stopped it is over with that.

use super::{Faults, Victim};
use crate::faultfile::FaultKind;
use crate::remains;

/// Refuses to continue one that is not stopped: nothing would come of it, and it would be told of as a fault that came about.
pub(super) fn check(victims: &[Victim]) -> Result<(), String> {
    match victims.iter().find(|victim| !remains::is_stopped(victim.pid)) {
        Some(Victim { slot, .. }) => Err(format!(
            "{slot} is not stopped, and there is nothing to continue; whoever stands stopped is ended and replaced, most within milliseconds"
        )),
        None => Ok(()),
    }
}

impl Faults {
    /// The stop that is over with this: it was held against its victim for 40 s that it did not recover.
    pub(super) fn end_stop(&mut self, victim: &Victim, now_ns: u64) {
        let of = (victim.slot.number(), victim.incarnation, false);
        let stops = self.open.faults.iter_mut().filter(|fault| fault.is(FaultKind::Stop));
        for fault in stops.filter(|fault| (fault.slot, fault.incarnation, fault.dead) == of && fault.recovered_us.is_none()) {
            fault.continue_ns = Some(now_ns);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Deed;
    use super::*;
    use crate::faultfile::Injection;
    use crate::faults::tests::book;
    use crate::view::Viewer;
    use hyst_exchange::system;
    use hyst_messages::{Role, Slot};
    use rustix::process::Signal;

    #[test]
    fn one_that_is_not_stopped_is_not_continued_and_one_that_is_has_its_stop_behind_it() {
        let (station, mut faults) = book("again");
        let mut child = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        let slot = Slot::first(Role::Recorder);
        let victim = Victim { slot, incarnation: 7, pid: child.id(), done: 0 };
        assert!(check(&[victim]).unwrap_err().contains("recorder is not stopped"));
        assert!(crate::proc::signal(child.id(), Signal::STOP));
        while check(&[victim]).is_err() {
            system::sleep_ns(1_000_000); // until it has taken that
        }
        let now_ns = system::now_ns();
        for (slot, incarnation) in [(slot, 6), (slot, 7), (Slot::first(Role::Console), 7)] {
            faults.start("stop", slot, incarnation, now_ns);
        }
        faults.begin(&victim, &Injection::now(FaultKind::Cont, "recorder"), now_ns, Deed::default());
        faults.tend(now_ns + 1, &mut Viewer::open(&station).unwrap());
        let over: Vec<bool> = faults.all().map(|fault| fault.manifested && fault.recovered_us.is_some()).collect();
        assert_eq!(over, [false, true, false, true], "that of this process alone, and that it was continued");
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(check(&[victim]).is_err(), "it is gone");
    }
}
