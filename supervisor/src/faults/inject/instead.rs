//! A process does one thing at a time that it is asked to, and a second request takes the place of the first: whose time is over with that, and so the book
//! says. Two testers, or one who forgot, would else read that the first lasted for as long as it was to.

use super::{Faults, Victim};
use crate::fault::Fault;
use crate::faultfile::FaultKind;
use crate::journal;

impl Faults {
    /// Ends what these processes, and whoever starts in their places, are asked to do so far, if they are asked for something else now.
    pub(super) fn displace(&mut self, victims: &[Victim], by: FaultKind, now_ns: u64) {
        if by.mischief().is_none() {
            return;
        }
        let goes_on = |fault: &Fault, victim: &Victim| {
            let is_asked = FaultKind::from_name(&fault.kind).is_some_and(|kind| kind.mischief().is_some());
            let lasts = fault.asked.is_some_and(|(until_ns, _)| until_ns == 0 || until_ns > now_ns);
            is_asked && lasts && !fault.dead && fault.incarnation == victim.incarnation
        };
        for victim in victims {
            let of_slot = |fault: &&mut Fault| fault.slot == victim.slot.number() && fault.recovered_us.is_none();
            for fault in self.open.faults.iter_mut().filter(of_slot) {
                let hinders = fault.starts_left.is_some_and(|left| left > 0);
                if !hinders && !goes_on(fault, victim) {
                    continue;
                }
                fault.asked = fault.asked.map(|(_, done)| (now_ns, done));
                fault.starts_left = fault.starts_left.map(|_| 0);
                let line = format!("fault {} of {} is over: {} is asked for instead", fault.kind, victim.slot, by.name());
                journal::say(&self.station, &line);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::tests::book;
    use hyst_messages::{Role, Slot};

    #[test]
    fn what_a_process_is_asked_for_ends_what_it_was_asked_for_before_and_nothing_else() {
        let (station, mut faults) = book("instead");
        let [slot, other] = [Role::Tissue, Role::Fluid].map(Slot::first);
        for (kind, slot, incarnation) in
            [("slow", slot, 7), ("slow", slot, 6), ("slow", other, 7), ("no-files", slot, 7), ("nan", slot, 7)]
        {
            faults.start(kind, slot, incarnation, 1_000).asked = Some((0, 3));
        }
        let last = faults.open.faults.last_mut().unwrap();
        (last.asked, last.recovered_us) = (Some((1_500, 3)), Some(0.5)); // that is over
        let loops = faults.start("crash-loop", slot, 5, 1_000);
        (loops.dead, loops.starts_left) = (true, Some(2));
        let victim = Victim { slot, incarnation: 7, pid: 0, done: 0 };
        let mut displaced = |by: FaultKind| {
            faults.displace(&[victim], by, 2_000);
            faults.all().map(|fault| (fault.asked.map_or(0, |(until_ns, _)| until_ns), fault.starts_left)).collect::<Vec<_>>()
        };
        let before = displaced(FaultKind::Kill);
        assert_eq!(before, [(0, None), (0, None), (0, None), (0, None), (1_500, None), (0, Some(2))], "nobody is asked for that");
        let after = displaced(FaultKind::Nan);
        assert_eq!(after, [(2_000, None), (0, None), (0, None), (0, None), (1_500, None), (0, Some(0))]);
        let said = std::fs::read_to_string(station.events()).unwrap();
        assert!(said.contains("fault slow of tissue:0 is over: nan is asked for instead"), "{said}");
    }
}
