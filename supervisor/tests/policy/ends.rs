//! Ends that do not come, and an end that is said: an engine that a disk keeps, and a driver whose device stays away.

use super::by_hand::alive;
use super::*;
use hyst_messages::page::Stage;
use hystation::policy::{ARRIVE_WITHIN_NS, Cause, Left, Reason, VACATE_WITHIN_NS, probation_ns};

/// A device that was pulled out and stayed away ended the station as a driver that crashes does.
#[test]
fn a_driver_that_says_at_last_that_it_cannot_work_ends_the_station_with_code_3_and_one_that_crashes_with_1() {
    let slot = Slot::first(Role::Hardware);
    for (exit, code) in [(Exit::Code(2), 3), (Exit::Code(1), 1), (Exit::Signal(11), 1)] {
        let (mut world, mut state) = alive(slot);
        world.event(&mut state, Event::Ready { slot, incarnation: world.alive[&slot].0 });
        world.now_ns += limits(Role::Hardware).settled_ns;
        world.event(&mut state, Event::Died { slot, incarnation: world.alive[&slot].0, exit: Exit::Code(1) });
        for short_lives in 1..=limits(Role::Hardware).most_short_lives {
            while world.pending.is_empty() {
                world.now_ns += 10_000_000;
                world.event(&mut state, Event::Tick);
            }
            world.settle_pending(&mut state, true);
            let incarnation = world.alive.remove(&slot).unwrap().0;
            let actions = step(world.now_ns, Event::Died { slot, incarnation, exit }, &mut state);
            let end = actions.iter().find_map(|action| if let Action::GiveUp { end, .. } = action { Some(*end) } else { None });
            let is_last = short_lives == limits(Role::Hardware).most_short_lives;
            assert_eq!(end, is_last.then_some(Some(code)), "{exit:?} in life {short_lives}: {actions:?}");
        }
    }
}

/// A swap waited for ever for an old engine that a disk keeps, and no other could begin.
#[test]
fn an_engine_that_does_not_end_keeps_its_place_and_its_swap_is_over() {
    let slot = Slot::first(Role::Recorder);
    let mut state = State::new(&[slot]);
    step(0, Event::Started { adopted: vec![(slot, 1)], warming: Vec::new() }, &mut state);
    let asked = step(1, Event::SwapAsked { slot, incumbent: 1 }, &mut state);
    assert_eq!(asked, [Action::Dismiss { slot, incarnation: 1 }]);
    assert_eq!(step(1 + VACATE_WITHIN_NS, Event::Tick, &mut state), []);
    let undone = step(2 + VACATE_WITHIN_NS, Event::Tick, &mut state);
    let is_undone = match &undone[..] {
        [Action::Retreat { reason, .. }, Action::EndSwap { promoted: false, .. }] => reason.cause == Cause::NoTime,
        _ => false,
    };
    assert!(is_undone && state.may_swap(slot).is_ok(), "{undone:?}");
    let died = step(3 + VACATE_WITHIN_NS, Event::Died { slot, incarnation: 1, exit: Exit::Signal(9) }, &mut state);
    assert_eq!(died, [Action::MarkDead { slot, incarnation: 1 }, Action::Spawn { slot }], "another of its own kind");
    // Its newcomer, which is told to go and does not.
    step(4 + VACATE_WITHIN_NS, Event::Spawned { slot, incarnation: 2 }, &mut state);
    let mut now_ns = 5 + VACATE_WITHIN_NS;
    step(now_ns, Event::Ready { slot, incarnation: 2 }, &mut state);
    step(now_ns, Event::SwapAsked { slot, incumbent: 2 }, &mut state);
    step(now_ns, Event::Died { slot, incarnation: 2, exit: Exit::Signal(9) }, &mut state);
    step(now_ns, Event::Spawned { slot, incarnation: 3 }, &mut state);
    step(now_ns, Event::Ready { slot, incarnation: 3 }, &mut state);
    let told = step(now_ns, Event::Doubted { incarnation: 3, reason: Reason::new(Cause::Refused, "off") }, &mut state);
    assert_eq!(told.last(), Some(&Action::Dismiss { slot, incarnation: 3 }));
    now_ns += LEAVE_WITHIN_NS + VACATE_WITHIN_NS;
    assert_eq!(step(now_ns, Event::Tick, &mut state), []);
    assert_eq!(step(now_ns + 1, Event::Tick, &mut state), [Action::EndSwap { role: Role::Recorder, promoted: false }]);
}

const TISSUE: Role = Role::Tissue;
/// What the kernel does with one that it has kept, once it lets it go.
const KILLED: Exit = Exit::Signal(9);

/// A recorder, 9, and tissues: 1 has had the role, 2 is its spare, and 3, the guest, has it on probation since 5 ns and was touched.
fn with_a_guest() -> (State, [Slot; 3], Slot) {
    let slots @ [first, second, guest] = [0, 1, 2].map(|index| Slot::new(TISSUE, index).unwrap());
    let recorder = Slot::first(Role::Recorder);
    let mut state = State::new(&[first, second, recorder]);
    step(0, Event::Started { adopted: vec![(first, 1), (second, 2), (recorder, 9)], warming: Vec::new() }, &mut state);
    step(0, Event::Holds { role: TISSUE, incarnation: 1 }, &mut state);
    step(1, Event::SwapAsked { slot: guest, incumbent: 1 }, &mut state);
    step(2, Event::Spawned { slot: guest, incarnation: 3 }, &mut state);
    step(3, Event::Ready { slot: guest, incarnation: 3 }, &mut state);
    step(4, Event::Agreed { incarnation: 3 }, &mut state);
    step(5, Event::Holds { role: TISSUE, incarnation: 3 }, &mut state);
    step(5, Event::Touched { incarnation: 3 }, &mut state);
    (state, slots, recorder)
}

/// The guest was told to go and has stayed behind: its role is not swapped before it is gone, and another one is.
fn assert_it_keeps_its_place_alone(now_ns: u64, state: &mut State, guest: Slot, recorder: Slot) {
    assert!(state.swap().is_none() && state.lingering(TISSUE) == Some((guest, 3)));
    let refused = state.may_swap(guest).unwrap_err();
    assert!(refused.starts_with("tissue:2, which a swap had brought, was told to go"), "{refused}");
    assert_eq!(step(now_ns, Event::SwapAsked { slot: guest, incumbent: 1 }, state), [], "two in one place");
    assert_eq!(state.may_swap(recorder), Ok(()));
    let asked = step(now_ns, Event::SwapAsked { slot: recorder, incumbent: 9 }, state);
    assert_eq!(asked, [Action::Dismiss { slot: recorder, incarnation: 9 }]);
    let gone = step(now_ns, Event::Died { slot: guest, incarnation: 3, exit: KILLED }, state);
    assert_eq!(gone, [Action::MarkDead { slot: guest, incarnation: 3 }, Action::Vacate { slot: guest }]);
    assert!(state.lingering(TISSUE).is_none() && state.swap().is_some_and(|swap| swap.role() == Role::Recorder));
    step(now_ns + 1 + VACATE_WITHIN_NS, Event::Tick, state);
    assert_eq!(state.may_swap(guest), Ok(()));
}

/// Its swap went on for the rest of the session, every other one was refused, and the command waited for ten minutes.
#[test]
fn a_guest_that_is_undone_and_does_not_end_keeps_its_place_and_its_swap_is_over() {
    let (mut state, [.., guest], recorder) = with_a_guest();
    let told = step(6, Event::Doubted { incarnation: 3, reason: Reason::new(Cause::Refused, "off") }, &mut state);
    assert_eq!(told.last(), Some(&Action::Dismiss { slot: guest, incarnation: 3 }));
    step(7, Event::Holds { role: TISSUE, incarnation: 1 }, &mut state);
    let last_ns = 6 + LEAVE_WITHIN_NS + VACATE_WITHIN_NS;
    assert_eq!(step(last_ns, Event::Tick, &mut state), []);
    assert_eq!(step(last_ns + 1, Event::Tick, &mut state), [Action::EndSwap { role: TISSUE, promoted: false }]);
    // The next supervisor finds it there, too.
    let mut next = State::new(&[Slot::first(TISSUE), Slot::new(TISSUE, 1).unwrap(), recorder]);
    let adopted = vec![(Slot::first(TISSUE), 1), (Slot::new(TISSUE, 1).unwrap(), 2), (guest, 3), (recorder, 9)];
    step(last_ns + 2, Event::Started { adopted, warming: Vec::new() }, &mut next);
    for mut state in [state, next] {
        assert_it_keeps_its_place_alone(last_ns + 3, &mut state, guest, recorder);
    }
}

#[test]
fn a_guest_whose_work_is_done_and_that_does_not_end_keeps_its_place_and_its_swap_is_done() {
    let (mut state, [first, second, guest], recorder) = with_a_guest();
    let now_ns = 5 + probation_ns(TISSUE);
    step(now_ns, Event::Agreed { incarnation: 3 }, &mut state);
    step(now_ns, Event::Tick, &mut state);
    for (slot, old, new) in [(second, 2, 4), (first, 1, 5)] {
        step(now_ns, Event::Died { slot, incarnation: old, exit: KILLED }, &mut state);
        step(now_ns, Event::Spawned { slot, incarnation: new }, &mut state);
        step(now_ns, Event::Ready { slot, incarnation: new }, &mut state);
        step(now_ns, Event::Tick, &mut state);
    }
    step(now_ns, Event::Holds { role: TISSUE, incarnation: 5 }, &mut state);
    assert_eq!(step(now_ns, Event::Tick, &mut state), [Action::Dismiss { slot: guest, incarnation: 3 }]);
    assert_eq!(step(now_ns + VACATE_WITHIN_NS, Event::Tick, &mut state), []);
    let done = step(now_ns + VACATE_WITHIN_NS + 1, Event::Tick, &mut state);
    assert_eq!(done, [Action::EndSwap { role: TISSUE, promoted: true }]);
    assert_it_keeps_its_place_alone(now_ns + VACATE_WITHIN_NS + 2, &mut state, guest, recorder);
}

/// The role went to an old engine that had been told to go, and that a disk kept.
#[test]
fn nobody_gives_the_role_to_one_that_was_killed_and_has_not_ended() {
    let (mut state, [first, second, guest], _) = with_a_guest();
    let killed = [Action::Kill { slot: first, incarnation: 1 }];
    let mut undone = state.clone();
    assert_eq!(step(6, Event::HeartbeatLate { slot: first, incarnation: 1, beat_ns: 5 }, &mut undone), killed);
    let actions = step(7, Event::Doubted { incarnation: 3, reason: Reason::new(Cause::Refused, "off") }, &mut undone);
    let to = |incarnation: u32| Action::HandOver { role: TISSUE, incarnation };
    assert_eq!(actions[1..], [to(2), Action::Dismiss { slot: guest, incarnation: 3 }], "although the other had it before");
    let mut now_ns = 5 + probation_ns(TISSUE);
    step(now_ns, Event::Agreed { incarnation: 3 }, &mut state);
    step(now_ns, Event::Tick, &mut state);
    step(now_ns, Event::Died { slot: second, incarnation: 2, exit: KILLED }, &mut state);
    step(now_ns, Event::Spawned { slot: second, incarnation: 4 }, &mut state);
    step(now_ns, Event::Ready { slot: second, incarnation: 4 }, &mut state);
    assert_eq!(step(now_ns, Event::Tick, &mut state), [Action::Dismiss { slot: first, incarnation: 1 }]);
    for given in [vec![], vec![to(4)]] {
        now_ns += 1 + ARRIVE_WITHIN_NS; // it does not end
        assert_eq!(step(now_ns, Event::Tick, &mut state), given);
    }
}

#[test]
fn a_servo_is_not_told_to_go_for_one_that_was_killed_and_has_not_ended() {
    let servos @ [followed, newcomer] = [0, 1].map(|index| Slot::new(Role::Haptic, index).unwrap());
    let mut state = State::new(&servos);
    step(0, Event::Started { adopted: vec![(followed, 1), (newcomer, 2)], warming: Vec::new() }, &mut state);
    step(0, Event::HeartbeatLate { slot: newcomer, incarnation: 2, beat_ns: 0 }, &mut state);
    let left = Left { slot: newcomer, incarnation: 2, incumbent: 1, proven: true, old: vec![(followed, 1)] };
    let settled = Action::Told { role: Role::Haptic, stage: Stage::Settled, incarnation: 2 };
    assert_eq!(step(1, Event::SwapLeft(left), &mut state), [settled]);
}

/// It was said that a guest which grew was replaced, and nobody replaced it; and of one that had died the swap went on.
#[test]
fn a_guest_in_whose_role_nobody_else_comes_to_be_ready_has_the_role_until_it_is_unfit_and_with_its_end_the_swap_is_done() {
    let (mut state, [first, second, guest], _) = with_a_guest();
    let mut now_ns = 5 + probation_ns(TISSUE);
    step(now_ns, Event::Agreed { incarnation: 3 }, &mut state);
    step(now_ns, Event::Tick, &mut state);
    for (slot, old, new) in [(second, 2, 4), (first, 1, 5)] {
        step(now_ns, Event::Died { slot, incarnation: old, exit: KILLED }, &mut state);
        step(now_ns, Event::Spawned { slot, incarnation: new }, &mut state);
        now_ns += 1 + ARRIVE_WITHIN_NS;
        step(now_ns, Event::Tick, &mut state);
    }
    for _ in 0..20 {
        now_ns += 1 + ARRIVE_WITHIN_NS;
        assert_eq!(step(now_ns, Event::Tick, &mut state), [], "it has the only state");
    }
    let mut covered = state.clone();
    step(now_ns, Event::Ready { slot: second, incarnation: 4 }, &mut covered);
    assert_eq!(step(now_ns, Event::Tick, &mut covered), [Action::HandOver { role: TISSUE, incarnation: 4 }]);
    assert_eq!(step(now_ns, Event::Unfit { slot: guest, incarnation: 3, reason: "it grows" }, &mut state), []);
    assert_eq!(step(now_ns + LEAVE_WITHIN_NS - 1, Event::Tick, &mut state), []);
    now_ns += LEAVE_WITHIN_NS;
    assert_eq!(step(now_ns, Event::Tick, &mut state), [Action::Kill { slot: guest, incarnation: 3 }]);
    let died = step(now_ns, Event::Died { slot: guest, incarnation: 3, exit: KILLED }, &mut state);
    let done = Action::EndSwap { role: TISSUE, promoted: true };
    assert_eq!(died, [Action::MarkDead { slot: guest, incarnation: 3 }, done]);
}
