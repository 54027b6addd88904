//! The policy against thousands of random histories: a small world that starts, kills and hangs processes as the policy's actions and
//! the dice say, and looks after each event whether a promise was broken.

use hyst_messages::{Role, Slot};
use hystation::policy::{
    Action, BACKOFF_MOST_NS, Event, Exit, MOST_DEATHS, MOST_SHORT_LIVES, SETTLED_NS, State, WINDOW_NS, step,
};
use proptest::prelude::*;
use std::collections::BTreeMap;

fn slots() -> Vec<Slot> {
    [(Role::Hardware, 0), (Role::Device, 0), (Role::Haptic, 0), (Role::Haptic, 1), (Role::Fluid, 0)]
        .into_iter()
        .filter_map(|(role, index)| Slot::new(role, index))
        .collect()
}

#[derive(Default)]
struct World {
    now_ns: u64,
    next_incarnation: u32,
    alive: BTreeMap<Slot, u32>,
    pending: Vec<Slot>,
    spawns_ns: BTreeMap<Slot, Vec<u64>>,
    given_up: Vec<Slot>,
    stopped: bool,
}

impl World {
    fn event(&mut self, state: &mut State, event: Event) {
        for action in step(self.now_ns, event, state) {
            match action {
                Action::Spawn { slot } => {
                    assert!(!self.stopped, "a spawn after the stop");
                    assert!(!self.alive.contains_key(&slot) && !self.pending.contains(&slot), "two incarnations in {slot}");
                    assert!(!self.given_up.contains(&slot), "a spawn in {slot}, which was given up");
                    let spawns = self.spawns_ns.entry(slot).or_default();
                    spawns.push(self.now_ns);
                    let recent = spawns.iter().filter(|spawn_ns| self.now_ns - **spawn_ns <= WINDOW_NS).count();
                    assert!(recent <= MOST_DEATHS + 1, "{recent} spawns in {slot} within the window");
                    self.pending.push(slot);
                }
                Action::MarkDead { slot, incarnation } => {
                    assert_eq!(self.alive.remove(&slot), Some(incarnation), "marked dead but not the one that died");
                }
                Action::Kill { slot, incarnation } => {
                    assert_eq!(self.alive.get(&slot), Some(&incarnation), "kill of somebody else")
                }
                Action::GiveUp { slot, .. } => self.given_up.push(slot),
            }
        }
    }

    fn settle_pending(&mut self, state: &mut State, succeeds: bool) {
        let Some(slot) = self.pending.pop() else {
            return;
        };
        if succeeds {
            self.next_incarnation += 1;
            self.alive.insert(slot, self.next_incarnation);
            self.event(state, Event::Spawned { slot, incarnation: self.next_incarnation });
        } else {
            self.event(state, Event::SpawnFailed { slot });
        }
    }

    fn play(&mut self, state: &mut State, die: u8, which: usize, code: i32) {
        let slot = slots()[which % slots().len()];
        let incarnation = self.alive.get(&slot).copied();
        match (die % 10, incarnation) {
            (0..=2, _) => self.settle_pending(state, die % 10 != 2),
            (3 | 4, Some(incarnation)) => self.event(state, Event::Ready { slot, incarnation }),
            (5 | 6, Some(incarnation)) => {
                let exit = if code < 3 { Exit::Code(code) } else { Exit::Signal(9) };
                self.event(state, Event::Died { slot, incarnation, exit });
            }
            (7, Some(incarnation)) => self.event(state, Event::HeartbeatLate { slot, incarnation }),
            (8, _) => {
                let stranger = incarnation.unwrap_or(0) + 1_000;
                self.event(state, Event::Died { slot, incarnation: stranger, exit: Exit::Unknown });
                self.event(state, Event::HeartbeatLate { slot, incarnation: stranger });
                self.event(state, Event::Ready { slot, incarnation: stranger });
            }
            _ => self.event(state, Event::Tick),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_history_breaks_a_promise(
        history in prop::collection::vec((0u8..=255, 0usize..5, 0i32..6, 0u64..400_000_000), 1..300),
        stop_at in prop::option::of(0usize..300),
        adopted in prop::collection::vec(0usize..5, 0..3),
    ) {
        let mut state = State::new(&slots());
        let mut world = World { next_incarnation: 10, ..World::default() };
        let mut found = Vec::new();
        for (number, which) in adopted.into_iter().enumerate() {
            if world.alive.insert(slots()[which], number as u32 + 1).is_none() {
                found.push((slots()[which], number as u32 + 1));
            } else {
                world.alive.insert(slots()[which], found.iter().find(|(slot, _)| *slot == slots()[which]).unwrap().1);
            }
        }
        world.event(&mut state, Event::Started { adopted: found });
        for (index, (die, which, code, wait_ns)) in history.into_iter().enumerate() {
            world.now_ns += wait_ns;
            if stop_at == Some(index) {
                world.event(&mut state, Event::StopRequested);
                world.stopped = true;
            }
            world.play(&mut state, die, which, code);
        }
        // Left alone, every slot is occupied again, unless it was given up or the station stops.
        while !world.pending.is_empty() {
            world.settle_pending(&mut state, true);
        }
        world.now_ns += BACKOFF_MOST_NS;
        world.event(&mut state, Event::Tick);
        while !world.pending.is_empty() {
            world.settle_pending(&mut state, true);
        }
        for slot in slots() {
            prop_assert!(world.stopped || world.given_up.contains(&slot) || world.alive.contains_key(&slot), "{slot} stays empty");
        }
        prop_assert_eq!(state.given_up().collect::<Vec<_>>().len(), world.given_up.len());
    }
}

fn alive(slot: Slot) -> (World, State) {
    let mut state = State::new(&[slot]);
    let mut world = World::default();
    world.event(&mut state, Event::Started { adopted: Vec::new() });
    world.settle_pending(&mut state, true);
    (world, state)
}

#[test]
fn a_settled_process_comes_back_at_once_however_often_it_is_killed() {
    let slot = Slot::first(Role::Haptic);
    let (mut world, mut state) = alive(slot);
    for _ in 0..200 {
        let incarnation = world.alive[&slot];
        world.event(&mut state, Event::Ready { slot, incarnation });
        world.now_ns += 2 * SETTLED_NS;
        world.event(&mut state, Event::Died { slot, incarnation, exit: Exit::Signal(9) });
        assert_eq!(world.pending, [slot], "respawned in the same event");
        world.settle_pending(&mut state, true);
    }
}

#[test]
fn a_process_that_dies_of_its_input_waits_longer_each_time_and_is_given_up() {
    let slot = Slot::first(Role::Fluid);
    let (mut world, mut state) = alive(slot);
    let mut waits_ns = Vec::new();
    while world.given_up.is_empty() {
        let died_ns = world.now_ns;
        world.event(&mut state, Event::Died { slot, incarnation: world.alive[&slot], exit: Exit::Signal(11) });
        while world.pending.is_empty() && world.given_up.is_empty() {
            world.now_ns += 1_000_000;
            world.event(&mut state, Event::Tick);
        }
        waits_ns.push(world.now_ns - died_ns);
        world.settle_pending(&mut state, true);
    }
    assert_eq!(waits_ns.len(), MOST_SHORT_LIVES as usize);
    assert!(waits_ns[..waits_ns.len() - 1].windows(2).all(|pair| pair[1] == 2 * pair[0]), "{waits_ns:?}");
}

#[test]
fn an_engine_that_refuses_the_scene_ends_the_station_with_code_2_and_only_at_its_start() {
    let slot = Slot::first(Role::Tissue);
    let (mut world, mut state) = alive(slot);
    let incarnation = world.alive[&slot];
    let actions = step(0, Event::Died { slot, incarnation, exit: Exit::Code(2) }, &mut state);
    assert!(matches!(actions[..], [Action::MarkDead { .. }, Action::GiveUp { end: Some(2), .. }]), "{actions:?}");
    let (mut later, mut state) = alive(slot);
    later.event(&mut state, Event::Ready { slot, incarnation });
    world.now_ns += SETTLED_NS;
    let actions = step(world.now_ns, Event::Died { slot, incarnation, exit: Exit::Code(2) }, &mut state);
    assert!(matches!(actions[..], [Action::MarkDead { .. }, Action::Spawn { .. }]), "{actions:?}");
}
