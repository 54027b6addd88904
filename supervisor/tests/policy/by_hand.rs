//! Single histories whose end is known: who comes back when, who is given up, who goes first.

use super::*;

pub(super) fn alive(slot: Slot) -> (World, State) {
    let mut state = State::new(&[slot]);
    let mut world = World::default();
    world.event(&mut state, Event::Started { adopted: Vec::new(), warming: Vec::new() });
    world.settle_pending(&mut state, true);
    (world, state)
}

#[test]
fn a_settled_process_comes_back_at_once_however_often_it_is_killed() {
    let slot = Slot::first(Role::Haptic);
    let (mut world, mut state) = alive(slot);
    for _ in 0..200 {
        let incarnation = world.alive[&slot].0;
        world.event(&mut state, Event::Ready { slot, incarnation });
        world.now_ns += 2 * limits(Role::Haptic).settled_ns;
        world.event(&mut state, Event::Died { slot, incarnation, exit: Exit::Signal(9) });
        assert_eq!(world.pending, [slot], "respawned in the same event");
        world.settle_pending(&mut state, true);
    }
}

#[test]
fn a_process_that_dies_of_its_input_waits_longer_each_time_and_is_given_up() {
    let slot = Slot::first(Role::Rendering);
    let (mut world, mut state) = alive(slot);
    let mut waits_ns = Vec::new();
    while world.given_up.is_empty() {
        let died_ns = world.now_ns;
        world.event(&mut state, Event::Died { slot, incarnation: world.alive[&slot].0, exit: Exit::Signal(11) });
        while world.pending.is_empty() && world.given_up.is_empty() {
            world.now_ns += 1_000_000;
            world.event(&mut state, Event::Tick);
        }
        waits_ns.push(world.now_ns - died_ns);
        world.settle_pending(&mut state, true);
    }
    let limits = limits(Role::Rendering);
    assert_eq!(waits_ns.len(), limits.most_short_lives as usize);
    let expected: Vec<u64> = (1..limits.most_short_lives).map(|lives| limits.wait_ns(lives)).collect();
    assert_eq!(waits_ns[..waits_ns.len() - 1], expected);
}

#[test]
fn an_engine_that_refuses_the_scene_ends_the_station_with_code_2_and_only_at_its_start() {
    let slot = Slot::first(Role::Tissue);
    let (mut world, mut state) = alive(slot);
    let incarnation = world.alive[&slot].0;
    let actions = step(0, Event::Died { slot, incarnation, exit: Exit::Code(2) }, &mut state);
    assert!(matches!(actions[..], [Action::MarkDead { .. }, Action::GiveUp { end: Some(2), .. }]), "{actions:?}");
    let (mut later, mut state) = alive(slot);
    later.event(&mut state, Event::Ready { slot, incarnation });
    world.now_ns += limits(Role::Tissue).settled_ns;
    let actions = step(world.now_ns, Event::Died { slot, incarnation, exit: Exit::Code(2) }, &mut state);
    assert!(matches!(actions[..], [Action::MarkDead { .. }, Action::Spawn { .. }]), "{actions:?}");
}

#[test]
fn the_same_state_that_kills_every_holder_is_left_for_an_older_one_and_then_held() {
    let slots = [Slot::new(Role::Tissue, 0).unwrap(), Slot::new(Role::Tissue, 1).unwrap()];
    let mut state = State::new(&slots);
    let mut world = World { now_ns: 100_000_000_000, ..World::default() };
    world.event(&mut state, Event::Started { adopted: Vec::new(), warming: Vec::new() });
    let mut tenures = 0;
    while world.held.is_empty() {
        while !world.pending.is_empty() {
            world.settle_pending(&mut state, true);
        }
        let Some((slot, incarnation)) = world.alive.iter().map(|(slot, (incarnation, _))| (*slot, *incarnation)).next() else {
            world.now_ns += 10_000_000;
            world.event(&mut state, Event::Tick);
            continue;
        };
        world.event(&mut state, Event::Holds { role: Role::Tissue, incarnation });
        world.now_ns += 1_000_000;
        world.event(&mut state, Event::Died { slot, incarnation, exit: Exit::Signal(11) });
        tenures += 1;
        assert!(tenures < 100, "it never ends");
    }
    assert_eq!(
        tenures,
        3 * MOST_DOOMED + 2,
        "three rungs, and of the last two the first holder was there before the ground was known"
    );
    assert_eq!(world.given_up, [], "the last of its role is not given up");
}

#[test]
fn one_that_grows_too_large_hands_over_first_and_is_killed_then() {
    let slots = [Slot::new(Role::Tissue, 0).unwrap(), Slot::new(Role::Tissue, 1).unwrap()];
    let mut state = State::new(&slots);
    step(0, Event::Started { adopted: vec![(slots[0], 1), (slots[1], 2)], warming: Vec::new() }, &mut state);
    step(0, Event::Holds { role: Role::Tissue, incarnation: 1 }, &mut state);
    let actions = step(1, Event::Unfit { slot: slots[0], incarnation: 1, reason: "it grows" }, &mut state);
    assert_eq!(actions, [Action::HandOver { role: Role::Tissue, incarnation: 2 }]);
    assert_eq!(step(2, Event::Tick, &mut state), [], "it waits for the spare");
    let actions = step(3, Event::Holds { role: Role::Tissue, incarnation: 2 }, &mut state);
    assert_eq!(actions, [Action::Kill { slot: slots[0], incarnation: 1 }]);
    // Alone, it waits for a spare, but not for ever.
    step(4, Event::Died { slot: slots[0], incarnation: 1, exit: Exit::Signal(9) }, &mut state);
    assert_eq!(step(5, Event::Unfit { slot: slots[1], incarnation: 2, reason: "it grows" }, &mut state), []);
    let actions = step(5 + LEAVE_WITHIN_NS, Event::Tick, &mut state);
    assert!(actions.contains(&Action::Kill { slot: slots[1], incarnation: 2 }), "{actions:?}");
}

/// A tester waits for it: it is over within a blink, or after seconds where nobody is there who could take the role.
#[test]
fn a_role_is_handed_over_from_when_its_holder_is_to_be_replaced_until_somebody_is_ready_in_its_place() {
    let slots = [Slot::new(Role::Tissue, 0).unwrap(), Slot::new(Role::Tissue, 1).unwrap()];
    let begin = || {
        let mut state = State::new(&slots);
        step(0, Event::Started { adopted: vec![(slots[0], 1), (slots[1], 2)], warming: Vec::new() }, &mut state);
        step(0, Event::Holds { role: Role::Tissue, incarnation: 1 }, &mut state);
        state
    };
    let grows = |slot, incarnation| Event::Unfit { slot, incarnation, reason: "it grows" };
    let handed = |state: &State| slots.map(|slot| state.records().any(|(of, record)| of == slot && record.hands_over));
    let (mut spare, mut state) = (begin(), begin());
    step(1, grows(slots[1], 2), &mut spare);
    assert_eq!([handed(&spare), handed(&state)], [[false; 2]; 2], "a spare hands nothing over");
    step(1, grows(slots[0], 1), &mut state);
    step(2, Event::Holds { role: Role::Tissue, incarnation: 2 }, &mut state);
    let now_ns = 2 * limits(Role::Tissue).settled_ns;
    step(now_ns, Event::Died { slot: slots[0], incarnation: 1, exit: Exit::Signal(9) }, &mut state);
    step(now_ns, Event::Spawned { slot: slots[0], incarnation: 3 }, &mut state);
    assert_eq!(handed(&state), [true, false], "who had the role is not back");
    // The next supervisor knows it by the station's page.
    let mut next = State::new(&slots);
    state.records().filter(|(slot, _)| slots.contains(slot)).for_each(|(slot, record)| {
        assert_eq!(Record::of_word(record.word()), record);
        next.set_record(now_ns, slot, record);
    });
    step(now_ns, Event::Started { adopted: vec![(slots[1], 2)], warming: vec![(slots[0], 3)] }, &mut next);
    assert_eq!(handed(&next), [true, false]);
    for state in [&mut state, &mut next] {
        step(now_ns, Event::Ready { slot: slots[0], incarnation: 3 }, state);
        assert_eq!(handed(state), [false; 2]);
    }
}

#[test]
fn two_servos_that_grow_at_the_same_instant_go_one_after_the_other() {
    let slots = [Slot::new(Role::Haptic, 0).unwrap(), Slot::new(Role::Haptic, 1).unwrap()];
    let mut state = State::new(&slots);
    step(0, Event::Started { adopted: vec![(slots[0], 1), (slots[1], 2)], warming: Vec::new() }, &mut state);
    for (slot, incarnation) in [(slots[0], 1), (slots[1], 2)] {
        assert_eq!(step(0, Event::Serves { slot, incarnation }, &mut state), []);
    }
    let grows = |slot, incarnation| Event::Unfit { slot, incarnation, reason: "it grows" };
    let now_ns = 2 * limits(Role::Haptic).settled_ns;
    assert_eq!(step(now_ns, grows(slots[0], 1), &mut state), [Action::Kill { slot: slots[0], incarnation: 1 }]);
    assert_eq!(step(now_ns, grows(slots[1], 2), &mut state), [], "it is the last one");
    let actions = step(now_ns, Event::Died { slot: slots[0], incarnation: 1, exit: Exit::Signal(9) }, &mut state);
    assert!(actions.contains(&Action::Spawn { slot: slots[0] }), "{actions:?}");
    step(now_ns, Event::Spawned { slot: slots[0], incarnation: 3 }, &mut state);
    assert_eq!(step(now_ns, Event::Tick, &mut state), [], "its successor is not ready");
    step(now_ns, Event::Ready { slot: slots[0], incarnation: 3 }, &mut state);
    let is_handed = |state: &State| state.records().any(|(slot, record)| slot == slots[0] && record.hands_over);
    assert!(is_handed(&state), "the other one is alone");
    assert_eq!(step(now_ns, Event::Tick, &mut state), [], "its successor is in its shadow: the device takes nothing of it");
    step(now_ns, Event::Serves { slot: slots[0], incarnation: 3 }, &mut state);
    assert!(!is_handed(&state));
    assert_eq!(step(now_ns, Event::Tick, &mut state), [Action::Kill { slot: slots[1], incarnation: 2 }]);
}

/// A worker dies again and again, each time in this way; gives the deaths in a row at which the tissue that it reads was mistrusted.
fn mistrusted_at(exit_of: impl Fn(u32) -> Exit) -> Vec<u32> {
    let tissue = [Slot::new(Role::Tissue, 0).unwrap(), Slot::new(Role::Tissue, 1).unwrap()];
    let reader = Slot::first(Role::CollisionWorker);
    let mut state = State::new(&[tissue[0], tissue[1], reader]);
    step(0, Event::Started { adopted: vec![(tissue[0], 1), (tissue[1], 2), (reader, 3)], warming: Vec::new() }, &mut state);
    step(0, Event::Holds { role: Role::Tissue, incarnation: 1 }, &mut state);
    let limits = limits(Role::CollisionWorker);
    let (mut now_ns, mut incarnation, mut mistrusted) = (0, 3, Vec::new());
    for lives in 1..limits.most_short_lives {
        let actions = step(now_ns, Event::Died { slot: reader, incarnation, exit: exit_of(lives) }, &mut state);
        if actions.iter().any(|action| matches!(action, Action::Mistrust { .. })) {
            assert!(actions.contains(&Action::Mistrust { slot: tissue[0], incarnation: 1, reader }), "{actions:?}");
            assert!(!actions.iter().any(|action| matches!(action, Action::Mistrust { slot, .. } if *slot == tissue[1])));
            mistrusted.push(lives);
        }
        now_ns += limits.most_wait_ns;
        step(now_ns, Event::Tick, &mut state);
        incarnation += 1;
        step(now_ns, Event::Spawned { slot: reader, incarnation }, &mut state);
    }
    mistrusted
}

#[test]
fn whose_readers_die_again_and_again_is_replaced_before_they_are_given_up() {
    let after = limits(Role::CollisionWorker).mistrust_after();
    assert_eq!(mistrusted_at(|_| Exit::Signal(11)), [after], "once in a row of short lives");
    let killed = |lives| if lives == after { Exit::Signal(9) } else { Exit::Signal(11) };
    assert_eq!(mistrusted_at(killed), [after + 1], "that death told nothing; the next one does");
    assert_eq!(mistrusted_at(|_| Exit::Unknown), Vec::<u32>::new(), "nobody knows what they died of");
}

#[test]
fn one_that_had_served_for_long_and_died_unseen_comes_back_at_once() {
    let slot = Slot::first(Role::Device);
    let now_ns = 3 * limits(Role::Device).settled_ns;
    for (lived_ns, lives) in [(2 * limits(Role::Device).settled_ns, 0), (1, 5)] {
        let mut state = State::new(&[slot]);
        state.set_record(0, slot, Record { short_lives: 4, ..Record::default() });
        step(now_ns, Event::Started { adopted: vec![(slot, 7)], warming: Vec::new() }, &mut state);
        step(now_ns, Event::Lived { slot, incarnation: 7, ready_ns: now_ns - lived_ns }, &mut state);
        let actions = step(now_ns, Event::Died { slot, incarnation: 7, exit: Exit::Signal(11) }, &mut state);
        assert_eq!(state.records().find(|(of, _)| *of == slot).unwrap().1.short_lives, lives);
        assert_eq!(actions.contains(&Action::Spawn { slot }), lives == 0, "{actions:?}");
    }
}

/// A death that takes the supervisor along, or that nobody saw, counts in the row as any other.
#[test]
fn deaths_that_nobody_saw_count() {
    let slot = Slot::first(Role::Rendering);
    let mut record = Record::default();
    for lives in 1..=limits(Role::Rendering).most_short_lives {
        let mut state = State::new(&[slot]);
        state.set_record(0, slot, record);
        step(0, Event::Started { adopted: Vec::new(), warming: vec![(slot, lives)] }, &mut state);
        step(0, Event::Died { slot, incarnation: lives, exit: Exit::Signal(11) }, &mut state);
        record = state.records().find(|(of, _)| *of == slot).unwrap().1;
        assert_eq!((record.short_lives, record.given_up), (lives, lives == limits(Role::Rendering).most_short_lives));
    }
}

/// However the deaths of its holders and of its spares fall: by their number alone, the tissue was replaced or not as the machine had time.
#[test]
fn a_role_with_a_state_goes_back_before_it_mistrusts_what_it_reads_and_does_that_once() {
    let (tissue, fluid) = (Slot::first(Role::Tissue), [Slot::new(Role::Fluid, 0).unwrap(), Slot::new(Role::Fluid, 1).unwrap()]);
    for spares_die in [false, true] {
        let mut state = State::new(&[tissue, fluid[0], fluid[1]]);
        step(0, Event::Started { adopted: vec![(tissue, 1), (fluid[0], 2), (fluid[1], 3)], warming: Vec::new() }, &mut state);
        step(0, Event::Holds { role: Role::Tissue, incarnation: 1 }, &mut state);
        let (mut now_ns, mut newest, mut of_slot, mut story) = (0, 3, [2, 3], Vec::new());
        for death in 0..40 {
            let (holder, spare) = (death % 2, (death + 1) % 2);
            step(now_ns, Event::Holds { role: Role::Fluid, incarnation: of_slot[holder] }, &mut state);
            for dies in [Some(holder), spares_die.then_some(spare)].into_iter().flatten() {
                let actions = step(
                    now_ns,
                    Event::Died { slot: fluid[dies], incarnation: of_slot[dies], exit: Exit::Signal(11) },
                    &mut state,
                );
                story.extend(
                    actions.into_iter().filter(|action| matches!(action, Action::GoBack { .. } | Action::Mistrust { .. })),
                );
                now_ns += limits(Role::Fluid).most_wait_ns;
                step(now_ns, Event::Tick, &mut state);
                newest += 1;
                of_slot[dies] = newest;
                step(now_ns, Event::Spawned { slot: fluid[dies], incarnation: newest }, &mut state);
                step(now_ns, Event::Ready { slot: fluid[dies], incarnation: newest }, &mut state);
            }
        }
        let told = |action: &Action| match action {
            Action::GoBack { ground: Ground::Before(_), .. } => "back",
            Action::GoBack { ground: Ground::Hold(_), .. } => "held",
            Action::Mistrust { slot, incarnation: 1, .. } if *slot == tissue => "mistrust",
            _ => "else",
        };
        let story: Vec<&str> = story.iter().map(told).collect();
        assert_eq!(story, ["back", "back", "mistrust", "held"], "spares die: {spares_die}");
    }
}

/// A spare that dies of what the holder writes will not relieve it: the holder goes as soon as that is known, and not after ten seconds.
#[test]
fn whom_its_own_spare_dies_of_is_not_waited_for_and_only_then() {
    let fluid = Slot::first(Role::Fluid);
    let tissue = [Slot::new(Role::Tissue, 0).unwrap(), Slot::new(Role::Tissue, 1).unwrap()];
    let after = limits(Role::Tissue).mistrust_after();
    for (short_lives, is_harmful) in [(after, true), (after - 1, true), (after, false)] {
        let mut state = State::new(&[fluid, tissue[0], tissue[1]]);
        state.set_record(0, tissue[1], Record { short_lives, ..Record::default() });
        state.set_record(0, fluid, Record { short_lives: after - 1, ..Record::default() });
        step(0, Event::Started { adopted: vec![(tissue[0], 1), (fluid, 2)], warming: Vec::new() }, &mut state);
        step(0, Event::Holds { role: Role::Tissue, incarnation: 1 }, &mut state);
        state.set_ladder(Role::Fluid, Ladder::resumed(2 | (MOST_DOOMED - 1) << 8, Some(1), false, 1));
        step(0, Event::Holds { role: Role::Fluid, incarnation: 2 }, &mut state);
        if is_harmful {
            let actions = step(1, Event::Died { slot: fluid, incarnation: 2, exit: Exit::Signal(11) }, &mut state);
            assert!(actions.contains(&Action::Mistrust { slot: tissue[0], incarnation: 1, reader: fluid }), "{actions:?}");
        }
        let actions = step(2, Event::Unfit { slot: tissue[0], incarnation: 1, reason: "for a reason" }, &mut state);
        let is_killed = actions.contains(&Action::Kill { slot: tissue[0], incarnation: 1 });
        assert_eq!(is_killed, short_lives == after && is_harmful, "{short_lives}, {is_harmful}: {actions:?}");
    }
}

/// A place that stays empty costs the station its next fault: it is filled again now and then, and a try that fails costs one life.
#[test]
fn a_slot_that_was_given_up_is_tried_again_with_one_life_each_time() {
    let slot = Slot::first(Role::Rendering);
    let (mut world, mut state) = alive(slot);
    let die = |world: &mut World, state: &mut State| {
        world.event(state, Event::Died { slot, incarnation: world.alive[&slot].0, exit: Exit::Signal(11) });
    };
    while world.given_up.is_empty() {
        die(&mut world, &mut state);
        world.now_ns += if world.given_up.is_empty() { limits(Role::Rendering).most_wait_ns } else { 0 };
        world.event(&mut state, Event::Tick);
        world.settle_pending(&mut state, true);
    }
    for _ in 0..3 {
        world.now_ns += TRY_AGAIN_NS - 1;
        world.event(&mut state, Event::Tick);
        assert!(world.pending.is_empty() && state.is_given_up(slot));
        world.now_ns += 1;
        world.event(&mut state, Event::Tick);
        assert!(!world.pending.is_empty() && !state.is_given_up(slot));
        world.settle_pending(&mut state, true);
        die(&mut world, &mut state);
        assert!(state.is_given_up(slot), "one life, and it is given up again");
    }
    world.now_ns += TRY_AGAIN_NS;
    world.event(&mut state, Event::Tick);
    world.settle_pending(&mut state, true);
    let incarnation = world.alive[&slot].0;
    world.event(&mut state, Event::Ready { slot, incarnation });
    world.now_ns += limits(Role::Rendering).settled_ns;
    world.event(&mut state, Event::Died { slot, incarnation, exit: Exit::Signal(11) });
    assert_eq!(world.pending, [slot], "it showed that it can live");
}

#[test]
fn nobody_is_mistrusted_for_kills_from_outside_or_for_starts_that_fail() {
    let tissue = Slot::first(Role::Tissue);
    let reader = Slot::first(Role::CollisionWorker);
    for killed in [true, false] {
        let mut state = State::new(&[tissue, reader]);
        step(0, Event::Started { adopted: vec![(tissue, 1), (reader, 2)], warming: Vec::new() }, &mut state);
        step(0, Event::Holds { role: Role::Tissue, incarnation: 1 }, &mut state);
        step(0, Event::Died { slot: reader, incarnation: 2, exit: Exit::Signal(9) }, &mut state);
        for life in 1..2 * u64::from(limits(Role::CollisionWorker).most_short_lives) {
            let (now_ns, incarnation) = (life * limits(Role::CollisionWorker).most_wait_ns, 2 + life as u32);
            step(now_ns, Event::Tick, &mut state);
            let end = if killed {
                step(now_ns, Event::Spawned { slot: reader, incarnation }, &mut state);
                Event::Died { slot: reader, incarnation, exit: Exit::Signal(9) }
            } else {
                Event::SpawnFailed { slot: reader, no_room: false }
            };
            let actions = step(now_ns, end, &mut state);
            assert!(!actions.iter().any(|action| matches!(action, Action::Mistrust { .. })), "{actions:?}");
        }
        assert!(state.is_given_up(reader));
    }
}

#[test]
fn a_restart_of_the_supervisor_is_no_way_around_the_back_off_and_the_end_of_a_slot() {
    let slot = Slot::first(Role::Rendering);
    let (mut world, mut state) = alive(slot);
    let limits = limits(Role::Rendering);
    for lives in 1..=limits.most_short_lives {
        // Each death is one that a new supervisor finds.
        world.event(&mut state, Event::Died { slot, incarnation: world.alive[&slot].0, exit: Exit::Signal(11) });
        let record = state.records().find(|(of, _)| *of == slot).unwrap().1;
        assert_eq!(record, Record { short_lives: lives, given_up: lives == limits.most_short_lives, hands_over: false });
        let restarted_ns = world.now_ns;
        state = State::new(&[slot]);
        state.set_record(restarted_ns, slot, record);
        world.event(&mut state, Event::Started { adopted: Vec::new(), warming: Vec::new() });
        while world.pending.is_empty() && !record.given_up {
            assert!(world.now_ns <= restarted_ns + limits.most_wait_ns, "nobody comes");
            world.now_ns += 1_000_000;
            world.event(&mut state, Event::Tick);
        }
        if !record.given_up {
            assert_eq!(world.now_ns - restarted_ns, limits.wait_ns(lives), "after {lives} short lives");
        }
        world.settle_pending(&mut state, true);
    }
    assert!(state.is_given_up(slot) && !state.anyone_alive());
}

#[test]
fn one_that_still_warms_when_it_is_adopted_takes_no_role_and_a_station_that_ran_is_not_ended_by_an_edited_scene() {
    let slots = [Slot::new(Role::Tissue, 0).unwrap(), Slot::new(Role::Tissue, 1).unwrap(), Slot::first(Role::Rendering)];
    let mut state = State::new(&slots);
    step(0, Event::Started { adopted: vec![(slots[0], 1)], warming: vec![(slots[1], 2)] }, &mut state);
    assert_eq!((state.ready(slots[0]), state.ready(slots[1])), (Some(1), None));
    step(0, Event::Holds { role: Role::Tissue, incarnation: 1 }, &mut state);
    let unfit = Event::Unfit { slot: slots[0], incarnation: 1, reason: "it grows" };
    assert!(step(1, unfit, &mut state).is_empty(), "nobody could take over");
    let ready = step(2, Event::Ready { slot: slots[1], incarnation: 2 }, &mut state);
    let told: Vec<Action> = ready.into_iter().chain(step(3, Event::Tick, &mut state)).collect();
    assert!(told.contains(&Action::HandOver { role: Role::Tissue, incarnation: 2 }), "{told:?}");
    // Rendering was dead when the supervisor came back, and its successor finds another scene.
    step(4, Event::Spawned { slot: slots[2], incarnation: 3 }, &mut state);
    let died = step(5, Event::Died { slot: slots[2], incarnation: 3, exit: Exit::Code(2) }, &mut state);
    assert!(!died.iter().any(|action| matches!(action, Action::GiveUp { end: Some(_), .. })), "{died:?}");
}
