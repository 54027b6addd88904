//! What is asked of a spare and comes about in steps alone. The spare of a role with a state makes only the steps that its holder misses, so that nothing may
//! come of it: whoever asks is told so at once. It is no refusal, for the next step may be the spare's, and so may the role.

use super::{Faults, Victim};
use crate::faultfile::Injection;
use crate::view::Viewer;

impl Faults {
    /// What whoever asks is to know before nothing has come of it; `None` of what comes about at its victim in any case.
    pub(super) fn caution(&self, victims: &[Victim], injection: &Injection, viewer: &mut Viewer) -> Option<String> {
        let [Victim { slot, .. }] = *victims else { return None }; // of both one has the role
        let role = slot.role();
        // A newcomer in its shadow and who keeps the old state beside one on trial send what they compute, too.
        let steps_beside = slot.is_guest() || viewer.page().swap(role).keeps_line();
        if !injection.is_of_steps() || !role.is_stateful() || steps_beside {
            return None;
        }
        let holder = self.of_role(role, true, viewer).filter(|holder| *holder != slot)?;
        let kind = injection.kind.name();
        Some(format!(
            "{slot} is a spare: it makes only the steps that {holder} misses, and until there is one nothing comes of {kind}"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faultfile::{FaultKind, Output};
    use crate::faults::tests::{begin, book};
    use hyst_messages::page::{Stage, Swap, station as layout};
    use hyst_messages::{Role, Slot};

    /// It was said to have been done, and that nothing had come of it stood in the report, in the end.
    #[test]
    fn whoever_asks_a_spare_for_what_steps_alone_bring_about_is_told_at_once() {
        let (station, faults) = book("spare");
        let page = station.open_for_keeping().unwrap();
        let of = |role: Role| [0, 1].map(|index| Slot::new(role, index).unwrap());
        let ([holder, spare], [followed, other]) = (of(Role::Tissue), of(Role::Haptic));
        let lives = [(holder, 4), (spare, 5), (followed, 6), (other, 7)];
        let _pages = lives.map(|(slot, incarnation)| begin(&station, &page, slot, incarnation));
        let mut viewer = Viewer::open(&station).unwrap();
        let mut asked = |faults: &Faults, slots: &[Slot], kind: FaultKind, output: Option<Output>| {
            let victims: Vec<Victim> = slots.iter().map(|slot| Victim { slot: *slot, incarnation: 1, pid: 0, done: 0 }).collect();
            let injection = Injection { output, ..Injection::now(kind, "tissue:spare") };
            faults.caution(&victims, &injection, &mut viewer)
        };
        assert_eq!(asked(&faults, &[spare], FaultKind::Nan, None), None, "nobody has the role yet");
        faults.roster.promote(Role::Tissue, faults.roster.holder(Role::Tissue), 4).unwrap();
        let of_steps =
            [FaultKind::Nan, FaultKind::Frozen, FaultKind::Ahead, FaultKind::Slow, FaultKind::Poison, FaultKind::LeakLoans];
        for kind in of_steps {
            let said = asked(&faults, &[spare], kind, None).unwrap_or_default();
            let whom = "tissue:1 is a spare: it makes only the steps that tissue:0 misses";
            assert!(said.starts_with(whom) && said.ends_with(kind.name()), "{said}");
            assert_eq!(asked(&faults, &[holder], kind, None), None, "{kind:?}: it makes each step");
            assert_eq!(asked(&faults, &[holder, spare], kind, None), None, "{kind:?}: one of them does");
            assert_eq!(asked(&faults, &[other], kind, None), None, "{kind:?}: both servos compute");
        }
        for kind in [FaultKind::Kill, FaultKind::Spin, FaultKind::Block, FaultKind::Panic, FaultKind::Doom, FaultKind::LeakMemory]
        {
            assert_eq!(asked(&faults, &[spare], kind, None), None, "{kind:?}: whoever steps");
        }
        assert_eq!(asked(&faults, &[spare], FaultKind::Nan, Some(Output::Topology)), None, "its clerk says that");
        assert!(asked(&faults, &[spare], FaultKind::Nan, Some(Output::State)).is_some());
        let trial = Swap { stage: Stage::Trial, guest: 9 };
        page.store64(layout::SWAP + Role::Tissue as usize, trial.word());
        assert_eq!(asked(&faults, &[spare], FaultKind::Nan, None), None, "it keeps the old state beside a newcomer");
    }
}
