//! A fault that is for two, where one of them has just gone, or cannot be hurt so: what was done to the other is taken back or told, and never refused as if
//! it had not been.

use super::{Deed, Faults, Victim};
use crate::faultfile::Injection;
use crate::struck::NotDone;
use crate::{mischief, shortage};

impl Faults {
    /// Some were struck, and the others had just gone: what was done to the first is a fault of theirs.
    pub(super) fn note_half(&mut self, hit: &[Victim], missed: &[Victim], injection: &Injection, now_ns: u64) -> NotDone {
        let names = |them: &[Victim]| them.iter().map(|victim| victim.slot.to_string()).collect::<Vec<_>>().join(", ");
        for victim in hit {
            self.begin(victim, injection, now_ns, Deed::default());
        }
        self.keep_open();
        let alone = if hit.is_empty() { String::new() } else { format!("; {} was hit alone", names(hit)) };
        let reason = format!("{}: {} is not alive now; wait until it is back{alone}", injection.target, names(missed));
        NotDone { reason, is_half: !hit.is_empty() }
    }

    /// Does what is done beside the signal, to all of them or to none, as far as it can be taken back; and notes it.
    pub(super) fn do_to_all(
        &mut self,
        victims: &[Victim],
        injection: &Injection,
        now_ns: u64,
        together: bool,
    ) -> Result<(), NotDone> {
        let hinders = injection.kind.mischief().is_some_and(|what| what.is_of_start());
        let mut deeds = Vec::with_capacity(victims.len());
        for (index, victim) in victims.iter().enumerate() {
            let deed = if hinders { Ok(Deed::default()) } else { self.deed(victim, injection, now_ns, index == 0) };
            match deed {
                Ok(deed) => deeds.push(deed),
                Err(reason) => return Err(self.take_back(victims, deeds, injection, now_ns, reason)),
            }
        }
        self.displace(victims, injection.kind, now_ns); // not before: who is refused ends nothing
        for (victim, deed) in victims.iter().zip(deeds) {
            self.begin(victim, injection, now_ns, deed).together = together;
        }
        self.keep_open();
        Ok(())
    }

    /// Takes back what was done to the first of them; bytes that were flipped stay so, and are a fault of theirs.
    fn take_back(&mut self, victims: &[Victim], deeds: Vec<Deed>, injection: &Injection, now_ns: u64, reason: String) -> NotDone {
        let mut alone = Vec::new();
        for (victim, deed) in victims.iter().zip(deeds) {
            if injection.kind.mischief().is_some() {
                mischief::end(&self.page, victim.slot);
            }
            if let Some(lowered) = deed.lowered {
                shortage::restore(victim.pid, lowered);
            }
            if let Some(ballast) = &deed.ballast {
                shortage::relieve(ballast);
            }
            if !deed.flips.is_empty() {
                alone.push(victim.slot.to_string());
                self.begin(victim, injection, now_ns, deed);
            }
        }
        self.keep_open();
        match alone.is_empty() {
            true => reason.into(),
            false => NotDone { reason: format!("{reason}; it was done to {} alone", alone.join(", ")), is_half: true },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faultfile::{FaultKind, Place};
    use crate::faults::tests::book;
    use hyst_exchange::system;
    use hyst_messages::{Role, Slot};

    /// The first of both was done to, and the answer was that it had been refused.
    #[test]
    fn what_cannot_be_done_to_both_is_taken_back_and_what_cannot_be_taken_back_is_told() {
        let (station, mut faults) = book("by-half");
        let [first, second] = [0, 1].map(|index| Slot::new(Role::Tissue, index).unwrap());
        let mut child = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        let limits = |child: &std::process::Child| std::fs::read_to_string(format!("/proc/{}/limits", child.id())).unwrap();
        let before = limits(&child);
        let of = |slot: Slot, pid: u32| Victim { slot, incarnation: 1, pid, done: 0 };
        let victims = [of(first, child.id()), of(second, 0)]; // nobody has the process id 0
        let (for_s, allowed_misses) = (Some(9.0), Some(40));
        let no_files = Injection { for_s, allowed_misses, ..Injection::now(FaultKind::NoFiles, "tissue:both") };
        let refused = faults.do_to_all(&victims, &no_files, system::now_ns(), true).unwrap_err();
        assert_eq!((refused.is_half, limits(&child), faults.all().count()), (false, before.clone(), 0), "{refused:?}");
        // Twice at once it would be put back to what the first had made of it.
        let alone = |faults: &mut Faults| faults.do_to_all(&victims[..1], &no_files, system::now_ns(), false);
        assert!(alone(&mut faults).is_ok() && limits(&child) != before);
        assert!(alone(&mut faults).unwrap_err().reason.contains("no-files of tissue:0 is under way already"));
        assert_eq!(faults.all().map(|fault| fault.may_cost_ticks).collect::<Vec<_>>(), [Some(40)], "it is judged by that");
        faults.open.faults.clear();
        child.kill().unwrap();
        child.wait().unwrap();
        // Only the first has a page of which bytes can be flipped.
        let _own = station.create_slot(first, 1).unwrap();
        let flips = Injection { place: Some(Place::Page), seed: Some(1), ..Injection::now(FaultKind::Corrupt, "tissue:both") };
        let half = faults.do_to_all(&victims, &flips, system::now_ns(), true).unwrap_err();
        assert!(half.is_half && half.reason.ends_with("it was done to tissue:0 alone"), "{half:?}");
        let told: Vec<_> = faults.all().map(|fault| (fault.kind.as_str(), fault.target.as_str())).collect();
        assert_eq!(told, [("corrupt", "tissue:0")]);
        let half = faults.note_half(&victims[..1], &victims[1..], &Injection::now(FaultKind::Kill, "tissue:both"), 1_000);
        assert!(
            half.is_half && half.reason.contains("tissue:1 is not alive now") && half.reason.contains("tissue:0 was hit alone")
        );
        assert!(!faults.note_half(&[], &victims, &Injection::now(FaultKind::Kill, "tissue:both"), 1_000).is_half);
        let kept = std::fs::read_to_string(station.root().join("open.json")).unwrap();
        assert!(kept.contains("\"kill\"") && kept.contains("\"corrupt\""), "a supervisor after this one knows of them: {kept}");
    }
}
