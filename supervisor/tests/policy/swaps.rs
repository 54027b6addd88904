//! Swaps in the random histories: what the policy may ask for, what the dice do to it, and that each swap ends.

use super::{Dice, World};
use hyst_messages::Slot;
use hyst_messages::page::Stage;
use hystation::policy::{
    ARRIVE_WITHIN_NS, Action, Cause, Event, Exit, GIVE_BACK_WITHIN_NS, LEAVE_WITHIN_NS, Left, PROVE_WITHIN_NS, Reason, State,
    TOUCH_WITHIN_NS, probation_ns,
};

/// What was seen of the swap that is under way.
#[derive(Clone, Copy)]
pub struct Seen {
    slot: Slot,
    incumbent: u32,
    agreed: bool,
    trial_ns: Option<u64>,
    tried_ns: u64,
    retreat_ns: Option<u64>,
    adopted: bool,
    adopted_ns: u64,
}

impl World {
    /// What the policy asks for because of a swap.
    pub fn check_swap(&mut self, action: &Action) {
        let seen = self.swap.as_mut().expect("an action of a swap without a swap");
        match *action {
            Action::Dismiss { slot, incarnation } => {
                let ready = |(other, (_, ready)): (&Slot, &(u32, bool))| other.role() == slot.role() && *other != slot && *ready;
                let covered = self.alive.iter().any(ready) || !slot.role().is_replicated();
                let patient = seen.retreat_ns.is_some_and(|since_ns| self.now_ns - since_ns < LEAVE_WITHIN_NS);
                let works = self.alive.get(&slot).is_some_and(|(_, ready)| *ready)
                    && (!slot.is_guest() || self.holder.get(&slot.role()) == Some(&incarnation));
                assert!(
                    covered || !works || !patient && seen.retreat_ns.is_some(),
                    "{slot} goes, and nobody is left to do its work"
                );
                assert_eq!(self.alive.get(&slot).map(|(alive, _)| *alive), Some(incarnation), "dismissed somebody else");
                if slot.is_guest() && seen.adopted {
                    let mut others = [0, 1].into_iter().filter_map(|index| Slot::new(slot.role(), index));
                    let is_back =
                        |other: &Slot| self.alive.get(other).is_some_and(|(_, ready)| *ready) || self.given_up.contains(other);
                    assert!(
                        others.all(|other| is_back(&other)) || self.now_ns - seen.adopted_ns > GIVE_BACK_WITHIN_NS,
                        "the guest goes while another place is not back"
                    );
                }
                self.dismissed.push((slot, incarnation));
            }
            Action::Told { stage: Stage::Trial, .. } => seen.trial_ns = Some(self.now_ns),
            Action::Told { stage: Stage::Shadow, .. } => {
                seen.tried_ns += seen.trial_ns.take().map_or(0, |trial_ns| self.now_ns - trial_ns);
            }
            Action::Told { .. } => {}
            Action::Adopt { role } => {
                let tried_ns = seen.tried_ns + self.now_ns - seen.trial_ns.expect("adopted without a trial");
                assert!(tried_ns >= probation_ns(role), "adopted before the end of the probation");
                assert!(seen.agreed || !role.is_replicated(), "adopted without having agreed");
                assert!(seen.retreat_ns.is_none() && !seen.adopted, "adopted twice, or in the retreat");
                (seen.adopted, seen.adopted_ns) = (true, self.now_ns);
            }
            Action::Retreat { .. } => {
                assert!(!seen.adopted && seen.retreat_ns.is_none(), "a retreat after the end, or twice");
                seen.retreat_ns = Some(self.now_ns);
            }
            Action::EndSwap { promoted, .. } => {
                assert_eq!((promoted, !promoted), (seen.adopted, seen.retreat_ns.is_some()), "it ends as it did not go");
                let is_told = |(alive, _): &(u32, bool)| self.dismissed.contains(&(seen.slot, *alive));
                let is_gone = self.alive.get(&seen.slot).is_none_or(is_told);
                assert!(!seen.slot.is_guest() || is_gone, "a guest stays behind that nobody told to go");
                self.swap = None;
            }
            _ => unreachable!("no action of a swap"),
        }
    }

    /// Whether one that is started runs the newcomer's binary.
    pub fn note_binary(&mut self, slot: Slot, incarnation: u32) {
        if self.swap.is_some_and(|seen| slot == seen.slot || seen.adopted && slot.role() == seen.slot.role()) {
            self.runs_new.insert(incarnation);
        }
    }

    /// A supervisor that died in the middle of a swap has left its file, and who runs which binary can be seen.
    pub fn resume_swap(&mut self, state: &mut State) {
        let Some(seen) = &mut self.swap else { return };
        let (slot, incumbent, proven) = (seen.slot, seen.incumbent, seen.adopted);
        seen.retreat_ns = None; // what was proven is finished, the rest is undone, from the beginning
        let runs_new = |incarnation: &u32| self.runs_new.contains(incarnation);
        let incarnation = self.alive.get(&slot).map_or(0, |(alive, _)| *alive);
        let incarnation = if slot.is_guest() || runs_new(&incarnation) { incarnation } else { 0 };
        let others = self.alive.iter().filter(|(other, _)| other.role() == slot.role() && **other != slot);
        let old = others.filter(|(_, (alive, _))| !runs_new(alive)).map(|(other, (alive, _))| (*other, *alive)).collect();
        self.event(state, Event::SwapLeft(Left { slot, incarnation, incumbent, proven, old }));
    }

    /// Whoever was dismissed dies; true if there was one.
    fn bury_dismissed(&mut self, state: &mut State) -> bool {
        let Some((slot, incarnation)) = self.dismissed.pop() else { return false };
        if self.alive.get(&slot).is_some_and(|(alive, _)| *alive == incarnation) {
            self.leaving.remove(&incarnation);
            self.event(state, Event::Died { slot, incarnation, exit: Exit::Signal(9) });
        }
        true
    }

    /// One roll of the dice that concerns swaps.
    pub fn play_swap(&mut self, state: &mut State, dice: &mut Dice, slot: Slot) {
        let newcomer = self.swap.and_then(|seen| self.alive.get(&seen.slot)).map_or(0, |(alive, _)| *alive);
        match dice.below(5) {
            0 if state.may_swap(slot).is_ok() => {
                assert!(self.swap.is_none(), "two swaps at a time");
                let incumbent = self.holder.get(&slot.role()).copied().unwrap_or(0);
                self.swap = Some(Seen {
                    slot,
                    incumbent,
                    agreed: false,
                    trial_ns: None,
                    tried_ns: 0,
                    retreat_ns: None,
                    adopted: false,
                    adopted_ns: 0,
                });
                self.runs_new.clear();
                self.event(state, Event::SwapAsked { slot, incumbent });
            }
            0 | 1 => {
                if let Some(seen) = &mut self.swap {
                    seen.agreed = true;
                }
                self.event(state, Event::Agreed { incarnation: newcomer });
                if dice.below(2) == 0 {
                    self.event(state, Event::Touched { incarnation: newcomer });
                }
            }
            2 => self.event(state, Event::Doubted { incarnation: newcomer, reason: Reason::new(Cause::Refused, "the dice") }),
            3 if dice.below(2) == 0 => self.event(state, super::pauses::one_of(newcomer, dice.below(2))),
            _ => drop(self.bury_dismissed(state)),
        }
    }

    /// Left alone, every swap ends: whoever was told to go, or was killed, dies.
    pub fn end_swap(&mut self, state: &mut State) {
        for _ in 0..400 {
            if self.stopped || self.swap.is_none() {
                return;
            }
            while !self.pending.is_empty() {
                self.settle_pending(state, true);
            }
            let killed = self.alive.iter().filter(|(_, (alive, _))| self.killed.contains(alive));
            self.dismissed.extend(killed.map(|(slot, (alive, _))| (*slot, *alive)));
            while self.bury_dismissed(state) {}
            let waiting: Vec<(Slot, u32)> =
                self.alive.iter().filter(|(_, (_, ready))| !ready).map(|(slot, (alive, _))| (*slot, *alive)).collect();
            for (slot, incarnation) in waiting {
                self.make_ready(state, slot, incarnation);
            }
            self.now_ns += 1_000_000_000;
            self.event(state, Event::Tick);
        }
        panic!("the swap never ends");
    }
}

mod by_hand {
    use super::*;
    use hyst_messages::Role;
    use hystation::policy::step;

    fn tissues() -> [Slot; 3] {
        [0, 1, 2].map(|index| Slot::new(Role::Tissue, index).unwrap())
    }

    /// A station whose tissue:0 (incarnation 1) holds the role; a newcomer (3) in the shadow.
    fn shadowing() -> State {
        let slots = tissues();
        let mut state = State::new(&slots[..2]);
        step(0, Event::Started { adopted: vec![(slots[0], 1), (slots[1], 2)], warming: Vec::new() }, &mut state);
        step(0, Event::Holds { role: Role::Tissue, incarnation: 1 }, &mut state);
        assert_eq!(step(1, Event::SwapAsked { slot: slots[2], incumbent: 1 }, &mut state), [Action::Spawn { slot: slots[2] }]);
        step(2, Event::Spawned { slot: slots[2], incarnation: 3 }, &mut state);
        let told = step(3, Event::Ready { slot: slots[2], incarnation: 3 }, &mut state);
        assert_eq!(told, [Action::Told { role: Role::Tissue, stage: Stage::Shadow, incarnation: 3 }]);
        state
    }

    fn on_probation() -> State {
        let mut state = shadowing();
        let told = step(4, Event::Agreed { incarnation: 3 }, &mut state);
        assert_eq!(told, [Action::Told { role: Role::Tissue, stage: Stage::Trial, incarnation: 3 }]);
        assert_eq!(step(5, Event::Holds { role: Role::Tissue, incarnation: 3 }, &mut state), []);
        assert_eq!(step(5, Event::Touched { incarnation: 3 }, &mut state), []);
        state
    }

    /// Whether it was tried in touch, if it is settled by then.
    fn settled_in_touch(now_ns: u64, state: &mut State) -> Option<bool> {
        let is_settled = step(now_ns, Event::Tick, state).contains(&Action::Adopt { role: Role::Tissue });
        is_settled.then(|| state.swap().expect("it goes on until all are settled").was_tried_in_touch())
    }

    #[test]
    fn what_was_tried_in_the_open_alone_is_waited_for_and_then_taken_and_known_for_it() {
        let (role, newcomer) = (Role::Tissue, Event::Touched { incarnation: 3 });
        let mut state = shadowing();
        step(4, newcomer.clone(), &mut state); // the old engine felt that
        step(4, Event::Agreed { incarnation: 3 }, &mut state);
        step(5, Event::Holds { role, incarnation: 3 }, &mut state);
        step(5 + probation_ns(role), Event::Agreed { incarnation: 3 }, &mut state);
        assert_eq!(settled_in_touch(5 + probation_ns(role), &mut state), None);
        let mut touched = state.clone();
        step(5 + probation_ns(role), newcomer, &mut touched);
        assert_eq!(settled_in_touch(6 + probation_ns(role), &mut touched), Some(true));
        assert_eq!(settled_in_touch(4 + TOUCH_WITHIN_NS, &mut state), None);
        assert_eq!(settled_in_touch(5 + TOUCH_WITHIN_NS, &mut state), Some(false));
    }

    #[test]
    fn a_newcomer_that_nobody_doubts_has_all_slots_in_the_end_and_its_guest_gives_the_role_back() {
        let ([first, second, guest], role) = (tissues(), Role::Tissue);
        let mut state = on_probation();
        let mut now_ns = 5 + probation_ns(role);
        assert_eq!(step(now_ns, Event::Tick, &mut state.clone()), [], "not before it was compared");
        assert_eq!(step(now_ns - 1, Event::Agreed { incarnation: 3 }, &mut state), []);
        assert_eq!(step(now_ns - 1, Event::Tick, &mut state), [], "still on probation");
        assert_eq!(step(now_ns, Event::Tick, &mut state), [], "it may hang since then");
        assert_eq!(step(now_ns, Event::Agreed { incarnation: 3 }, &mut state), []);
        let actions = step(now_ns, Event::Tick, &mut state);
        let settled = Action::Told { role, stage: Stage::Settled, incarnation: 3 };
        assert_eq!(
            actions,
            [Action::Adopt { role }, settled, Action::Dismiss { slot: second, incarnation: 2 }],
            "the spare first"
        );
        for (slot, old, new, then) in [
            (second, 2, 4, Action::Dismiss { slot: first, incarnation: 1 }),
            (first, 1, 5, Action::HandOver { role, incarnation: 5 }),
        ] {
            now_ns += 1;
            let actions = step(now_ns, Event::Died { slot, incarnation: old, exit: Exit::Signal(9) }, &mut state);
            assert_eq!(
                actions,
                [Action::MarkDead { slot, incarnation: old }, Action::Spawn { slot }],
                "at once, and no death is booked"
            );
            step(now_ns, Event::Spawned { slot, incarnation: new }, &mut state);
            assert_eq!(step(now_ns, Event::Tick, &mut state), [], "not before it is ready");
            step(now_ns, Event::Ready { slot, incarnation: new }, &mut state);
            assert_eq!(step(now_ns, Event::Tick, &mut state), [then]);
        }
        step(now_ns, Event::Holds { role, incarnation: 5 }, &mut state);
        assert_eq!(step(now_ns, Event::Tick, &mut state), [Action::Dismiss { slot: guest, incarnation: 3 }]);
        let actions = step(now_ns, Event::Died { slot: guest, incarnation: 3, exit: Exit::Signal(9) }, &mut state);
        assert_eq!(actions, [Action::MarkDead { slot: guest, incarnation: 3 }, Action::EndSwap { role, promoted: true }]);
        assert!(state.swap().is_none());
    }

    /// Who holds the role dies while the last slot is in its start: of those that have the state nobody but the guest is left.
    #[test]
    fn a_guest_stays_until_every_other_slot_is_ready_and_not_for_ever() {
        let ([first, second, guest], role) = (tissues(), Role::Tissue);
        let mut state = on_probation();
        let mut now_ns = 5 + probation_ns(role);
        step(now_ns, Event::Agreed { incarnation: 3 }, &mut state);
        step(now_ns, Event::Tick, &mut state);
        for (slot, old, new) in [(second, 2, 4), (first, 1, 5)] {
            step(now_ns, Event::Died { slot, incarnation: old, exit: Exit::Signal(9) }, &mut state);
            step(now_ns, Event::Spawned { slot, incarnation: new }, &mut state);
            step(now_ns, Event::Ready { slot, incarnation: new }, &mut state);
            if slot == second {
                step(now_ns, Event::Holds { role, incarnation: new }, &mut state); // the guest was late
                step(now_ns, Event::Tick, &mut state);
            }
        }
        let mut handed = state.clone();
        assert_eq!(step(now_ns, Event::Tick, &mut handed), [], "returning");
        assert_eq!(
            step(now_ns, Event::Tick, &mut handed),
            [Action::Dismiss { slot: guest, incarnation: 3 }],
            "the role is where it belongs"
        );
        step(now_ns, Event::Died { slot: second, incarnation: 4, exit: Exit::Signal(9) }, &mut state);
        for at_ns in [now_ns, now_ns + 1_000_000_000, now_ns + GIVE_BACK_WITHIN_NS / 2] {
            let actions = step(at_ns, Event::Tick, &mut state.clone());
            assert!(
                !actions.iter().any(|action| matches!(action, Action::Dismiss { .. } | Action::HandOver { .. })),
                "{actions:?}"
            );
        }
        for _ in 0..20 {
            now_ns += ARRIVE_WITHIN_NS / 4;
            let actions = step(now_ns, Event::Tick, &mut state);
            if actions.contains(&Action::Dismiss { slot: guest, incarnation: 3 }) {
                return;
            }
        }
        panic!("it never leaves: {:?}", state.swap());
    }

    #[test]
    fn one_that_is_doubted_gives_the_role_to_whom_it_had_it_from_and_goes() {
        let ([_, _, guest], role) = (tissues(), Role::Tissue);
        let mut state = on_probation();
        let actions = step(6, Event::Doubted { incarnation: 3, reason: Reason::new(Cause::Refused, "off") }, &mut state);
        let dismiss = Action::Dismiss { slot: guest, incarnation: 3 };
        assert_eq!(
            actions,
            [
                Action::Retreat { role, to: 1, reason: Reason::new(Cause::Refused, "off") },
                Action::HandOver { role, incarnation: 1 },
                dismiss
            ]
        );
        let again = Event::Doubted { incarnation: 3, reason: Reason::new(Cause::Refused, "again") };
        assert_eq!(step(7, again, &mut state), [], "told once");
        let actions = step(8, Event::Died { slot: guest, incarnation: 3, exit: Exit::Signal(9) }, &mut state);
        assert_eq!(actions.last(), Some(&Action::EndSwap { role, promoted: false }));
    }

    #[test]
    fn one_that_leaves_nothing_to_compare_is_undone_and_what_it_agreed_in_before_it_lost_the_role_does_not_count() {
        let role = Role::Tissue;
        let mut state = on_probation();
        let lost_ns = 5 + probation_ns(role);
        step(lost_ns, Event::Agreed { incarnation: 3 }, &mut state);
        step(lost_ns, Event::Holds { role, incarnation: 1 }, &mut state);
        step(lost_ns + 1, Event::Holds { role, incarnation: 3 }, &mut state);
        assert_eq!(step(lost_ns + 1 + probation_ns(role), Event::Tick, &mut state), []);
        let actions = step(lost_ns + 2 + PROVE_WITHIN_NS, Event::Tick, &mut state);
        assert!(
            matches!(&actions[..], [Action::Retreat { reason, .. }, ..] if reason.cause == Cause::NotCompared),
            "{actions:?}"
        );
    }

    /// Without spares it was said that the station had no servo.
    #[test]
    fn a_servo_beside_which_there_is_no_other_is_not_swapped_and_it_is_said_why() {
        let [first, second] = [0, 1].map(|index| Slot::new(Role::Haptic, index).unwrap());
        let refused = |slots: &[Slot]| State::new(slots).may_swap(second).unwrap_err();
        assert!(refused(&[first]).contains("swapped beside another one"), "{}", refused(&[first]));
        assert!(refused(&tissues()[..1]).contains("this station has no haptic"));
    }

    #[test]
    fn one_that_dies_in_any_state_leaves_nothing_to_do_and_nobody_in_its_slot() {
        let ([_, _, guest], role) = (tissues(), Role::Tissue);
        for mut state in [shadowing(), on_probation()] {
            let actions = step(6, Event::Died { slot: guest, incarnation: 3, exit: Exit::Signal(11) }, &mut state);
            let retreat = Action::Retreat { role, to: 1, reason: Reason::new(Cause::Died, "it died") };
            let expected = [Action::MarkDead { slot: guest, incarnation: 3 }, retreat, Action::EndSwap { role, promoted: false }];
            assert_eq!(actions, expected);
            for now_ns in [7, 1_000_000_000, 100_000_000_000] {
                assert_eq!(step(now_ns, Event::Tick, &mut state), [], "nobody is started in the guest's slot");
            }
            assert_eq!(state.may_swap(guest), Ok(()), "the next one may come");
        }
    }

    #[test]
    fn one_that_takes_the_role_unasked_or_loses_it_again_and_again_is_undone() {
        let role = Role::Tissue;
        let mut state = shadowing();
        let actions = step(4, Event::Holds { role, incarnation: 3 }, &mut state);
        assert!(matches!(&actions[..], [Action::Retreat { reason, .. }, ..] if reason.cause == Cause::Unasked), "{actions:?}");
        let mut state = on_probation();
        let mut losses = 0;
        loop {
            let actions = step(10, Event::Holds { role, incarnation: 1 }, &mut state);
            if let [Action::Retreat { reason, .. }, ..] = &actions[..] {
                assert_eq!(reason.cause, Cause::Missed, "{reason:?}");
                break;
            }
            losses += 1;
            assert!(losses < 10, "it never ends");
            step(11, Event::Holds { role, incarnation: 3 }, &mut state);
        }
        assert_eq!(losses, 3);
    }

    #[test]
    fn what_a_dead_supervisor_left_is_finished_if_it_was_proven_and_undone_if_not() {
        let ([first, second, guest], role) = (tissues(), Role::Tissue);
        for proven in [false, true] {
            let mut state = State::new(&[first, second]);
            step(0, Event::Started { adopted: vec![(first, 1), (second, 4), (guest, 3)], warming: Vec::new() }, &mut state);
            step(0, Event::Holds { role, incarnation: 3 }, &mut state);
            let old = vec![(first, 1)];
            let left = hystation::policy::Left { slot: guest, incarnation: 3, incumbent: 1, proven, old };
            let actions = step(1, Event::SwapLeft(left), &mut state);
            let (slot, incarnation) = if proven { (first, 1) } else { (guest, 3) };
            assert_eq!(actions.last(), Some(&Action::Dismiss { slot, incarnation }), "{actions:?}");
            assert_eq!(actions.contains(&Action::HandOver { role, incarnation: 1 }), !proven);
            let settled = Action::Told { role, stage: Stage::Settled, incarnation: 3 };
            assert_eq!(actions.contains(&settled), proven, "the elders leave their line only when they are told");
        }
    }
}
