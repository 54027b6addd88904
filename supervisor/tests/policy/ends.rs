//! Ends that do not come, and an end that is said: an engine that a disk keeps, and a driver whose device stays away.

use super::by_hand::alive;
use super::*;
use hystation::policy::{Cause, Reason, VACATE_WITHIN_NS};

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
