//! How a fault is over whose victim is not the one who ends it: a successor is there, a place is empty on purpose, the keepers are whole again.

use super::{Faults, begin_ns};
use crate::fault::{EXTERNAL, Fault, finder};
use crate::faultfile::{FaultKind, Keepers};
use crate::journal;
use crate::keepers::Suffered;
use crate::policy::{Cause, Exit};
use hyst_exchange::system;
use hyst_messages::{Role, Slot};
use std::path::Path;

impl Faults {
    /// The guardian is found dead at a time, and was well when it was last looked at; whoever takes its place is awaited by [`Faults::guardian_back`].
    pub fn guardian_died(&mut self, well_ns: u64, found_ns: u64) {
        let since_ns = begin_ns(well_ns, found_ns);
        let fault = self.start(EXTERNAL, Slot::first(Role::Guardian), 0, since_ns);
        (fault.manifested, fault.dead) = (true, true);
        fault.found_by("supervisor", found_ns);
        self.keep_open();
    }

    /// The supervisor before this one died after its last heartbeat, was found by the guardian when that started this one, and is replaced now.
    pub fn supervisor_died(&mut self, beat_ns: u64, found_ns: u64, now_ns: u64) {
        let since_ns = begin_ns(beat_ns, now_ns);
        let fault = self.start(EXTERNAL, Slot::first(Role::Supervisor), 0, since_ns);
        (fault.manifested, fault.dead) = (true, true);
        fault.found_by("guardian", found_ns);
        fault.over_at(now_ns);
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
        let opens = kind == FaultKind::NoFiles && role == Role::Supervisor;
        let noticed_ns = self.without_file_ns.filter(|at_ns| opens && (since_ns..=until_ns).contains(at_ns));
        let fault = self.start(kind.name(), Slot::first(role), 0, since_ns);
        fault.manifested = kind != FaultKind::Oom;
        if let Some(at_ns) = noticed_ns {
            fault.found_by(role.name(), at_ns);
        }
        fault.over_at(until_ns);
        self.keep_open();
        Ok(())
    }

    /// Somebody could not be started, because the supervisor had no file descriptor left.
    pub fn want_file(&mut self, now_ns: u64) {
        self.without_file_ns = Some(now_ns);
    }

    /// The supervisor has written anew what was wrong in a file: by that the bytes that were flipped there are noticed.
    pub fn mended(&mut self, file: &Path) {
        let now_ns = system::now_ns();
        let is_of = |fault: &&mut Fault| fault.detected_us.is_none() && fault.flips.iter().any(|flip| flip.is_in(file));
        self.open.faults.iter_mut().filter(is_of).for_each(|fault| fault.found_by(Role::Supervisor.name(), now_ns));
    }

    /// A successor is warm or live.
    pub fn ready(&mut self, slot: Slot, incarnation: u32, at_ns: u64) {
        for fault in &mut self.open.faults {
            if fault.slot == slot.number() && fault.dead && fault.incarnation < incarnation && fault.recovered_us.is_none() {
                fault.over_at(at_ns);
            }
        }
        self.keep_open();
    }

    /// The newcomer of a swap goes: what was done to it is over with whoever has its place, and is found by that where the cause speaks of the newcomer.
    /// Whether it did what it was asked to, its own count says.
    pub fn doubted(&mut self, incarnation: u32, cause: Cause, at_ns: u64) {
        let of = |fault: &&mut Fault| fault.incarnation == incarnation && fault.recovered_us.is_none();
        let speaks_of_it = cause.speaks_of_newcomer();
        for fault in self.open.faults.iter_mut().filter(of) {
            fault.manifested |= is_done_with_its_signal(fault) || cause == Cause::Died && fault.starts_left.is_none();
            // Bytes that were flipped and files that cannot be opened end nobody who goes for another reason, and are over by themselves.
            let is_beside_it = [FaultKind::Corrupt, FaultKind::NoFiles].iter().any(|kind| fault.is(*kind));
            fault.dead |= speaks_of_it || !is_beside_it;
            if fault.detected_us.is_none() && speaks_of_it {
                fault.found_by(finder::SWAP, at_ns);
            }
        }
        self.keep_open();
    }

    /// One was asked to go, for a swap, and is gone: it died of nothing that was done to it, and nobody has found anything out by that. What was done to it is
    /// over as soon as whoever comes after it is ready.
    pub fn dismissed(&mut self, slot: Slot, incarnation: u32, exit: Exit, at_ns: u64) {
        self.suspects.remove(&(slot.number(), incarnation));
        self.end_of_victim(slot, incarnation, exit, at_ns, "was asked to go");
        self.keep_open();
    }

    /// One has died of a fault of this kind: whatever else was done to it is over with that, found by nobody who had not found it before.
    pub(super) fn end_with(&mut self, slot: Slot, incarnation: u32, exit: Exit, at_ns: u64, kind: &str) {
        self.end_of_victim(slot, incarnation, exit, at_ns, &format!("died of {kind}"));
        self.keep_open();
    }

    /// Nobody is left to whom something is done: that is over with its victim, which a successor ends.
    fn end_of_victim(&mut self, slot: Slot, incarnation: u32, exit: Exit, at_ns: u64, how: &str) {
        let of = |fault: &&mut Fault| (fault.slot, fault.incarnation, fault.dead) == (slot.number(), incarnation, false);
        for fault in self.open.faults.iter_mut().filter(of).filter(|fault| fault.recovered_us.is_none()) {
            match FaultKind::from_name(&fault.kind) {
                // Bytes stay as they are, and a file system stays full, whoever goes: each is over by itself.
                Some(FaultKind::Corrupt | FaultKind::DiskFull | FaultKind::ShmFull) => continue,
                // Nobody who can open no file dies of that: it is over now, as if its time were.
                Some(FaultKind::NoFiles) => {
                    let end_ns = |until_ns: u64| if until_ns == 0 { at_ns } else { until_ns.min(at_ns) };
                    fault.asked = fault.asked.map(|(until_ns, done)| (end_ns(until_ns), done));
                }
                _ => {
                    fault.manifested |= is_done_with_its_signal(fault);
                    (fault.dead, fault.exit) = (true, exit.to_string());
                }
            }
            journal::say(&self.station, &format!("fault {} of {slot} is over: it {how}", fault.kind));
        }
    }

    /// The slot is given up on purpose: nobody is missed there, whether it died of its fault or was ended for it.
    pub fn vacated(&mut self, slot: Slot, at_ns: u64) {
        for fault in self.open.faults.iter_mut().filter(|fault| fault.slot == slot.number() && fault.recovered_us.is_none()) {
            fault.over_at(at_ns);
        }
        self.keep_open();
    }
}

/// Whether nothing is left to come about once its signal was sent: it neither asks its victim for anything nor hinders those who come after it.
fn is_done_with_its_signal(fault: &Fault) -> bool {
    fault.asked.is_none() && fault.starts_left.is_none()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::corrupt::corrupt;
    use crate::fault::Death;
    use crate::faultfile::{Injection, Place};
    use crate::faults::tests::book;
    use crate::view::Viewer;

    #[test]
    fn what_a_keeper_suffered_is_over_when_it_was_and_what_has_not_been_is_refused() {
        let (_station, mut faults) = book("suffered");
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
    }

    /// 72 times those who keep the station could open no file for a while, and nobody said whether they had wanted to.
    #[test]
    fn a_supervisor_without_files_is_noticed_if_it_could_start_nobody_for_that() {
        let (_station, mut faults) = book("keeper-files");
        let until_ns = system::now_ns();
        let suffers = |faults: &mut Faults, kind: FaultKind, keepers: Keepers, for_ns: u64| {
            faults.suffered(&Suffered { kind, keepers, since_ns: until_ns - for_ns, until_ns }).unwrap();
            faults.all().last().map(|fault| (fault.detected_by.clone(), fault.detected_us))
        };
        let nobody = Some((String::new(), None));
        assert_eq!(suffers(&mut faults, FaultKind::NoFiles, Keepers::Supervisor, 500_000), nobody);
        faults.want_file(until_ns - 200_000);
        let itself = Some(("supervisor".to_string(), Some(300.0)));
        assert_eq!(suffers(&mut faults, FaultKind::NoFiles, Keepers::Supervisor, 500_000), itself);
        assert_eq!(suffers(&mut faults, FaultKind::NoFiles, Keepers::Supervisor, 100_000), nobody, "that was before");
        assert_eq!(suffers(&mut faults, FaultKind::NoFiles, Keepers::Guardian, 500_000), nobody, "it starts no engine");
        assert_eq!(suffers(&mut faults, FaultKind::Stop, Keepers::Supervisor, 500_000), nobody);
    }

    /// The supervisor put right what had flipped, and the fault was noticed by nobody.
    #[test]
    fn bytes_that_flipped_are_noticed_where_the_supervisor_mends_what_they_were_in() {
        let (station, mut faults) = book("mended");
        let flips = |place: Place| {
            let injection = Injection { place: Some(place), seed: Some(3), ..Injection::now(FaultKind::Corrupt, "tissue:0") };
            corrupt(&station, Slot::first(Role::Tissue), 7, 0, &injection).unwrap().1
        };
        let now_ns = system::now_ns();
        for place in [Place::Roster, Place::Station] {
            faults.start("corrupt", Slot::first(Role::Tissue), 7, now_ns - 1_000_000).flips = flips(place);
        }
        faults.start("kill", Slot::first(Role::Tissue), 7, now_ns);
        let mut found = |file: &Path| {
            faults.mended(file);
            faults.all().map(|fault| fault.detected_by.clone()).collect::<Vec<_>>()
        };
        assert_eq!(found(&station.link_config()), ["", "", ""]);
        assert_eq!(found(&station.station_page()), ["", "supervisor", ""]);
        assert_eq!(found(&station.roster_page()), ["supervisor", "supervisor", ""]);
        assert!(faults.all().take(2).all(|fault| fault.detected_us.is_some_and(|us| us >= 1_000.0)));
    }

    #[test]
    fn a_fault_of_a_newcomer_that_is_rolled_back_is_over_with_the_swap() {
        let (_station, mut faults) = book("vacated");
        let (guest, other) = (Slot::guest(Role::Fluid).unwrap(), Slot::first(Role::Fluid));
        for (slot, incarnation) in [(guest, 7), (other, 8)] {
            faults.start("nan", slot, incarnation, 1_000);
        }
        faults.doubted(7, Cause::Refused, 2_000); // found out, and ended on purpose: it did not die
        let death = Death { at_ns: 2_500, open_ns: Some(1_500), beat_ns: 900 };
        faults.died(guest, 7, Exit::Signal(9), death); // told of after what followed from it: it is no other's
        faults.vacated(guest, 5_000);
        let found: Vec<_> = faults.all().map(|fault| (fault.dead, fault.detected_by.as_str())).collect();
        assert_eq!(found, [(true, "swap"), (false, "")]);
        let recovered: Vec<_> = faults.all().map(|fault| (fault.slot, fault.recovered_us.is_some())).collect();
        assert_eq!(recovered, [(guest.number(), true), (other.number(), false)]);
    }

    #[test]
    fn a_swap_that_had_no_time_found_nobody_and_no_swap_says_that_it_was_done_as_asked() {
        let (_station, mut faults) = book("no-time");
        let guest = Slot::guest(Role::Fluid).unwrap();
        let causes = [Cause::NoTime, Cause::Interrupted, Cause::Slow, Cause::Died];
        for (incarnation, cause) in (1..).zip(causes) {
            faults.start("nan", guest, incarnation, 1_000).asked = Some((0, 0));
            faults.start("stop", guest, incarnation, 1_000);
            let corrupt = faults.start("corrupt", guest, incarnation, 1_000);
            (corrupt.manifested, corrupt.asked) = (true, Some((9_000, 0)));
            faults.doubted(incarnation, cause, 2_000);
        }
        let seen: Vec<_> = faults.all().map(|fault| (fault.manifested, fault.detected_us.is_some(), fault.dead)).collect();
        let of_no_time = [(false, false, true), (true, false, true), (true, false, false)];
        assert_eq!([&seen[..3], &seen[3..6]], [of_no_time; 2]);
        assert_eq!(seen[6..9], [(false, true, true), (true, true, true), (true, true, true)]);
        assert_eq!(seen[9], (true, true, true), "who died has done it");
    }

    /// A recorder that leaked was swapped, and its leak closed after 40 s as one that it had not recovered from.
    #[test]
    fn what_was_done_to_one_that_was_asked_to_go_is_over_with_it_and_found_by_nobody() {
        let (station, mut faults) = book("dismissed");
        let (slot, other) = (Slot::first(Role::Recorder), Slot::first(Role::Console));
        let now_ns = system::now_ns();
        let since_ns = now_ns - 1_000_000;
        // Its signal was sent before it was asked to go, and its death is told of after that.
        for (kind, slot, incarnation, until_ns) in [
            ("leak-memory", slot, 7, Some(0)),
            ("spin", slot, 7, Some(now_ns + 9_000_000_000)),
            ("kill", slot, 7, None),
            ("no-files", slot, 7, Some(now_ns + 9_000_000_000)),
            ("leak-memory", slot, 6, Some(0)),
            ("leak-memory", other, 7, Some(0)),
        ] {
            faults.start(kind, slot, incarnation, since_ns).asked = until_ns.map(|until_ns| (until_ns, 0));
        }
        faults.dismissed(slot, 7, Exit::Signal(9), now_ns);
        let gone: Vec<_> = faults.all().map(|fault| (fault.dead, fault.manifested, fault.exit.is_empty())).collect();
        let (nobodys, kept) = ((true, false, false), (false, false, true));
        assert_eq!(gone, [nobodys, nobodys, (true, true, false), kept, kept, kept]);
        faults.ready(slot, 8, now_ns + 1_000_000);
        faults.tend(now_ns + 2_000_000_000, &mut Viewer::open(&station).unwrap());
        let over: Vec<_> = faults.all().map(|fault| fault.recovered_us).collect();
        let (with_the_next, with_it) = (Some(2_000.0), Some(1_000.0));
        assert_eq!(over, [with_the_next, with_the_next, with_the_next, with_it, None, None]);
        assert!(faults.all().all(|fault| fault.detected_us.is_none() && fault.kind != EXTERNAL), "nobody mourns it");
        let said = std::fs::read_to_string(station.events()).unwrap();
        assert!(said.contains("fault leak-memory of recorder is over: it was asked to go"), "{said}");
    }

    #[test]
    fn a_keeper_is_hurt_when_it_was_last_well_and_found_later() {
        let (_station, mut faults) = book("keeper-struck");
        let now_ns = 500_000_000_000;
        faults.guardian_died(now_ns - 3_050_000_000, now_ns);
        faults.guardian_died(0, now_ns); // nobody has seen it well
        faults.supervisor_died(now_ns - 40_000_000, now_ns - 15_000_000, now_ns);
        faults.guardian_back(now_ns + 1_000_000_000);
        let ms = |us: Option<f64>| us.map(|us| us * 1e-3);
        let of = |fault: &Fault| ((now_ns - fault.injected_ns) / 1_000_000, ms(fault.detected_us), ms(fault.recovered_us));
        let found: Vec<_> = faults.all().map(of).collect();
        assert_eq!(found, [(3_050, Some(3_050.0), Some(4_050.0)), (0, Some(0.0), Some(1_000.0)), (40, Some(25.0), Some(40.0))]);
    }
}
