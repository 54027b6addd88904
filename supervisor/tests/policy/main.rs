//! The policy against two million random histories: a small world that starts, kills, hangs and bloats processes as the policy's actions and the
//! dice say, and looks after each event whether a promise was broken. A history that breaks one is named by its seed.

mod by_hand;
mod ends;
mod pauses;
mod swaps;

use hyst_messages::{Role, Slot};
use hystation::campaign::draw::Draw;
use hystation::policy::{
    Action, Event, Exit, Ground, LEAVE_WITHIN_NS, Ladder, MOST_DOOMED, Record, State, TRY_AGAIN_NS, limits, sources, step,
};
use std::collections::{BTreeMap, BTreeSet};

/// Histories that are played.
const HISTORIES: u64 = 2_000_000;
/// Threads that play them.
const THREADS: u64 = 2;

/// The stations that histories are played in: between them every role.
fn stations() -> [Vec<Slot>; 2] {
    let hand = [(Role::Hardware, 1), (Role::Device, 1), (Role::Haptic, 2)];
    let of = |others: &[(Role, usize)]| {
        let counts = hand.iter().chain(others);
        counts.flat_map(|(role, count)| (0..*count).filter_map(|index| Slot::new(*role, index))).collect()
    };
    let others = [(Role::Fluid, 2), (Role::CollisionWorker, 2), (Role::Recorder, 1), (Role::Console, 1)];
    [of(&[(Role::Tissue, 2), (Role::Rendering, 1)]), of(&others)]
}

/// The slot of a newcomer on trial: of the role with a state that there is.
fn guest(slots: &[Slot]) -> Slot {
    let role = slots.iter().map(|slot| slot.role()).find(|role| role.is_stateful()).expect("a role with a state");
    Slot::guest(role).expect("its guest's slot")
}

/// A campaign's generator: a seed names a history.
struct Dice(Draw);

impl Dice {
    fn below(&mut self, bound: u64) -> u64 {
        self.0.bits() % bound
    }
}

#[derive(Default)]
struct World {
    now_ns: u64,
    next_incarnation: u32,
    alive: BTreeMap<Slot, (u32, bool)>,
    pending: Vec<Slot>,
    spawns_ns: BTreeMap<Slot, Vec<u64>>,
    given_up: Vec<Slot>,
    holder: BTreeMap<Role, u32>,
    held: Vec<Role>,
    /// The time from before which a role's founders go on, ns.
    ground: BTreeMap<Role, u64>,
    /// Those that are to leave, since when.
    leaving: BTreeMap<u32, u64>,
    /// Those that were killed and are not dead yet.
    killed: BTreeSet<u32>,
    /// Those whose readers died of them again and again.
    harmful: BTreeSet<u32>,
    /// Those whose work may be used: a servo that is ready has its shadow before it.
    serves: BTreeSet<u32>,
    /// What comes is the answer to a hang.
    hangs: bool,
    swap: Option<swaps::Seen>,
    /// Those that run the binary of the last swap.
    runs_new: BTreeSet<u32>,
    dismissed: Vec<(Slot, u32)>,
    stopped: bool,
    events: u64,
}

impl World {
    fn event(&mut self, state: &mut State, event: Event) {
        self.events += 1;
        self.hangs = matches!(event, Event::HeartbeatLate { .. });
        for action in step(self.now_ns, event, state) {
            if let Action::Kill { slot, incarnation } = action {
                self.check_relieved(slot, incarnation, state);
            }
            let unfit = if let Action::Mistrust { slot, incarnation, .. } = action { Some((slot, incarnation)) } else { None };
            let handed = if let Action::HandOver { role, incarnation } = action { Some((role, incarnation)) } else { None };
            self.check(action);
            // The roster's word is seen at once.
            if let Some((role, incarnation)) = handed {
                self.event(state, Event::Holds { role, incarnation });
            }
            if let Some((slot, incarnation)) = unfit {
                self.leaving.entry(incarnation).or_insert(self.now_ns);
                self.event(state, Event::Unfit { slot, incarnation, reason: "its readers die" });
            }
        }
    }

    /// One that is replaced because it is unfit has another beside it that stays, unless it waited too long for that, or the other dies of it.
    fn check_relieved(&self, slot: Slot, incarnation: u32, state: &State) {
        let dies = |(other, record): (Slot, Record)| {
            other.role() == slot.role() && other != slot && record.short_lives >= limits(slot.role()).mistrust_after()
        };
        if self.harmful.contains(&incarnation) && state.records().any(dies) {
            return;
        }
        let is_late = self.leaving.get(&incarnation).is_none_or(|since_ns| self.now_ns - since_ns >= LEAVE_WITHIN_NS);
        let stays = |(other, (alive, ready)): (&Slot, &(u32, bool))| {
            let works = *ready && self.serves.contains(alive) && !self.killed.contains(alive);
            other.role() == slot.role() && *other != slot && works
        };
        let alone = !self.alive.iter().any(stays);
        assert!(self.hangs || is_late || !slot.role().is_replicated() || !alone, "{slot} is replaced while nobody else can work");
    }

    fn check(&mut self, action: Action) {
        match action {
            Action::Dismiss { .. }
            | Action::Told { .. }
            | Action::Adopt { .. }
            | Action::Retreat { .. }
            | Action::EndSwap { .. } => self.check_swap(&action),
            Action::Spawn { slot } => {
                assert!(!self.stopped, "a spawn after the stop");
                assert!(!self.alive.contains_key(&slot) && !self.pending.contains(&slot), "two incarnations in {slot}");
                assert!(!self.given_up.contains(&slot), "a spawn in {slot}, which was given up");
                let limits = limits(slot.role());
                let spawns = self.spawns_ns.entry(slot).or_default();
                spawns.push(self.now_ns);
                let recent = spawns.iter().rev().take_while(|spawn_ns| self.now_ns - **spawn_ns <= limits.window_ns).count();
                assert!(recent <= limits.most_deaths + 4, "{recent} spawns in {slot} within the window");
                self.pending.push(slot);
            }
            Action::MarkDead { slot, incarnation } => {
                assert_eq!(
                    self.alive.remove(&slot).map(|(alive, _)| alive),
                    Some(incarnation),
                    "marked dead but not the one that died"
                );
            }
            Action::Kill { slot, incarnation } => {
                assert_eq!(self.alive.get(&slot).map(|(alive, _)| *alive), Some(incarnation), "kill of somebody else");
                self.killed.insert(incarnation);
                if !self.hangs {
                    self.leaving.remove(&incarnation);
                }
            }
            Action::Mistrust { slot, incarnation, reader } => {
                assert_eq!(self.alive.get(&slot), Some(&(incarnation, true)), "mistrust of one that is not there");
                assert!(sources(reader.role()).contains(&slot.role()), "{reader} does not read {slot}");
                self.harmful.insert(incarnation);
            }
            Action::HandOver { role, incarnation } => {
                let spare = self.alive.iter().find(|(slot, (alive, _))| slot.role() == role && *alive == incarnation);
                assert!(spare.is_some_and(|(_, (_, ready))| *ready), "handed over to one that is not ready");
                assert!(!self.killed.contains(&incarnation), "handed over to one that was killed");
                assert_ne!(self.holder.insert(role, incarnation), Some(incarnation), "handed over to the holder");
            }
            Action::GoBack { role, ground } => {
                let tried = matches!(ground, Ground::Again(_));
                assert!(role.is_stateful() && self.held.contains(&role) == tried, "{role:?}: {ground:?}, held {:?}", self.held);
                self.held.retain(|held| *held != role);
                self.ground.remove(&role);
                if let Ground::Before(time_ns) | Ground::Hold(time_ns) | Ground::Again(time_ns) = ground {
                    assert!(time_ns <= self.now_ns, "goes back to the future");
                    self.ground.insert(role, time_ns);
                }
                if matches!(ground, Ground::Hold(_)) {
                    self.held.push(role);
                }
            }
            Action::Vacate { slot } => assert!(slot.is_guest() && !self.alive.contains_key(&slot), "{slot} is not empty"),
            Action::TryAgain { slot } => {
                let at = self.given_up.iter().position(|known| *known == slot);
                self.given_up.swap_remove(at.expect("tried again without having been given up"));
            }
            Action::GiveUp { slot, .. } => {
                let sibling =
                    |(other, (_, ready)): (&Slot, &(u32, bool))| other.role() == slot.role() && *other != slot && *ready;
                let alone = !self.alive.iter().any(sibling);
                assert!(!slot.role().is_replicated() || !alone, "{slot}, the last of its role, is given up");
                self.given_up.push(slot);
            }
        }
    }

    fn settle_pending(&mut self, state: &mut State, succeeds: bool) {
        let Some(slot) = self.pending.pop() else { return };
        if succeeds {
            self.next_incarnation += 1;
            self.alive.insert(slot, (self.next_incarnation, false));
            self.note_binary(slot, self.next_incarnation);
            self.event(state, Event::Spawned { slot, incarnation: self.next_incarnation });
        } else {
            self.event(state, Event::SpawnFailed { slot, no_room: false });
        }
    }

    /// The supervisor dies, and another one takes over with what is left in the station's page: who lives, what it remembers of each slot, what is held.
    fn restart_supervisor(&mut self, state: &mut State, slots: &[Slot]) {
        let mut next = State::new(slots);
        for (slot, record) in state.records().filter(|(slot, _)| slots.contains(slot)) {
            next.set_record(self.now_ns, slot, record);
        }
        for (role, word) in state.ladders() {
            let (before_ns, is_held) = (self.ground.get(&role).copied(), self.held.contains(&role));
            next.set_ladder(role, Ladder::resumed(word, before_ns, is_held, self.now_ns));
        }
        *state = next;
        // What it had begun is undone; whom it killed died while nobody watched; who grows is found again.
        self.pending.clear();
        let killed = std::mem::take(&mut self.killed);
        self.alive.retain(|slot, (alive, _)| !slot.is_guest() || !killed.contains(alive));
        let unseen = self.alive.iter().map(|(slot, (alive, _))| (*slot, *alive)).filter(|(_, alive)| killed.contains(alive));
        let unseen: Vec<(Slot, u32)> = unseen.collect();
        self.leaving.clear();
        let here = self.alive.iter().map(|(slot, (alive, ready))| ((*slot, *alive), *ready));
        let (ready, warming): (Vec<_>, Vec<_>) = here.partition(|(_, ready)| *ready);
        let of = |found: Vec<((Slot, u32), bool)>| found.into_iter().map(|(found, _)| found).collect();
        self.event(state, Event::Started { adopted: of(ready), warming: of(warming) });
        self.tell_who_serves(state);
        for (role, incarnation) in self.holder.clone() {
            self.event(state, Event::Holds { role, incarnation });
        }
        for (slot, incarnation) in unseen {
            self.event(state, Event::Died { slot, incarnation, exit: Exit::Unknown });
        }
        self.resume_swap(state);
    }

    /// One that is ready: of a servo it is told apart when its work may be used.
    fn make_ready(&mut self, state: &mut State, slot: Slot, incarnation: u32) {
        self.alive.insert(slot, (incarnation, true));
        if slot.role() != Role::Haptic {
            self.serves.insert(incarnation);
        }
        self.event(state, Event::Ready { slot, incarnation });
    }

    /// The watch tells of every servo that has left its shadow.
    fn tell_who_serves(&mut self, state: &mut State) {
        let here: Vec<(Slot, u32)> = self.alive.iter().map(|(slot, (incarnation, _))| (*slot, *incarnation)).collect();
        for (slot, incarnation) in here {
            if slot.role() == Role::Haptic && self.serves.contains(&incarnation) {
                self.event(state, Event::Serves { slot, incarnation });
            }
        }
    }

    /// One roll of the dice.
    fn play(&mut self, state: &mut State, dice: &mut Dice, slots: &[Slot]) {
        // The guest's slot beside the others.
        let slot = slots.get(dice.below(slots.len() as u64 + 1) as usize).copied().unwrap_or_else(|| guest(slots));
        let living = self.alive.get(&slot).copied();
        match (dice.below(16), living) {
            (15, _) if dice.below(4) == 0 && !self.stopped => self.restart_supervisor(state, slots),
            (12..=14, _) => self.play_swap(state, dice, slot),
            (0..=2, _) => {
                let succeeds = dice.below(8) != 0;
                self.settle_pending(state, succeeds);
            }
            (3, Some((incarnation, true))) if slot.role() == Role::Haptic => {
                self.serves.insert(incarnation);
                self.event(state, Event::Serves { slot, incarnation });
            }
            (3 | 4, Some((incarnation, _))) => self.make_ready(state, slot, incarnation),
            (5 | 6, Some((incarnation, ready))) => {
                let exit = match dice.below(6) {
                    // An engine that refuses its scene at the start ends the station; that has a test of its own.
                    code @ (1 | 2) if code == 1 || ready => Exit::Code(code as i32),
                    3 => Exit::Unknown,
                    4 => Exit::Signal(11),
                    _ => Exit::Signal(9),
                };
                self.leaving.remove(&incarnation);
                self.event(state, Event::Died { slot, incarnation, exit });
            }
            (7, Some((incarnation, _))) => {
                let beat_ns = self.now_ns - dice.below(4_000_000_000);
                self.event(state, Event::HeartbeatLate { slot, incarnation, beat_ns });
            }
            (8, Some((incarnation, true))) if slot.role().is_stateful() => {
                self.holder.insert(slot.role(), incarnation);
                self.event(state, Event::Holds { role: slot.role(), incarnation });
            }
            (9, Some((incarnation, true))) => {
                self.leaving.entry(incarnation).or_insert(self.now_ns);
                self.event(state, Event::Unfit { slot, incarnation, reason: "it grows" });
            }
            (10, _) => {
                let stranger = living.map_or(0, |(incarnation, _)| incarnation) + 1_000;
                self.event(state, Event::Died { slot, incarnation: stranger, exit: Exit::Unknown });
                self.event(state, Event::HeartbeatLate { slot, incarnation: stranger, beat_ns: self.now_ns });
                self.event(state, Event::Serves { slot, incarnation: stranger });
                self.event(state, Event::Ready { slot, incarnation: stranger });
                self.event(state, Event::Unfit { slot, incarnation: stranger, reason: "it grows" });
            }
            _ => self.event(state, Event::Tick),
        }
    }

    /// Left alone, every slot is occupied again within the longest wait, unless it was given up or the station stops.
    fn rest(&mut self, state: &mut State, slots: &[Slot]) {
        self.end_swap(state);
        for _ in 0..2 {
            while !self.pending.is_empty() {
                self.settle_pending(state, true);
            }
            self.now_ns += slots.iter().map(|slot| limits(slot.role()).most_wait_ns).max().unwrap_or(0);
            self.event(state, Event::Tick);
        }
        while !self.pending.is_empty() {
            self.settle_pending(state, true);
        }
        for slot in slots {
            assert!(self.stopped || self.given_up.contains(slot) || self.alive.contains_key(slot), "{slot} stays empty");
        }
        self.now_ns += LEAVE_WITHIN_NS;
        self.event(state, Event::Tick);
        self.event(state, Event::Tick);
        // Who was dismissed is killed: one that does not end then is the kernel's affair.
        let is_here = |incarnation: u32| self.alive.values().any(|(alive, _)| *alive == incarnation);
        let is_dismissed = |incarnation: u32| self.dismissed.iter().any(|(_, dismissed)| *dismissed == incarnation);
        let stays = |incarnation: &u32| is_here(*incarnation) && !is_dismissed(*incarnation);
        assert!(self.stopped || !self.leaving.keys().any(stays), "one that grew too large stays for ever");
        let mut given_up: Vec<Slot> = state.given_up().collect();
        self.given_up.sort();
        given_up.sort();
        assert_eq!(given_up, self.given_up);
        assert_eq!(state.held().collect::<Vec<_>>(), self.held);
        for role in slots.iter().map(|slot| slot.role()).filter(|role| role.is_replicated()) {
            let all_gone = slots.iter().filter(|slot| slot.role() == role).all(|slot| self.given_up.contains(slot));
            assert!(!all_gone, "{role:?} has nobody left");
        }
    }
}

/// Plays the history of a seed; gives the number of its events.
fn history(seed: u64, slots: &[Slot]) -> u64 {
    let mut dice = Dice(Draw::new(seed));
    let mut state = State::new(slots);
    let mut world = World { next_incarnation: 10, now_ns: 20_000_000_000, ..World::default() };
    let mut adopted = Vec::new();
    for (index, slot) in slots.iter().enumerate() {
        if dice.below(4) == 0 {
            world.alive.insert(*slot, (index as u32 + 1, true));
            world.serves.insert(index as u32 + 1);
            adopted.push((*slot, index as u32 + 1));
        }
    }
    world.event(&mut state, Event::Started { adopted, warming: Vec::new() });
    world.tell_who_serves(&mut state);
    let length = 1 + dice.below(120);
    let stop_at = dice.below(4 * length);
    // Some histories are slow, some quick: lives that settle, and lives that do not.
    let pace_ns = [1_000_000, 50_000_000, 400_000_000, 3_000_000_000][dice.below(4) as usize];
    for index in 0..length {
        world.now_ns += dice.below(pace_ns);
        if index == stop_at {
            world.event(&mut state, Event::StopRequested);
            world.stopped = true;
        }
        world.play(&mut state, &mut dice, slots);
    }
    world.rest(&mut state, slots);
    world.events
}

#[test]
fn no_history_breaks_a_promise() {
    let stations = stations();
    let began = std::time::Instant::now();
    let events: u64 = std::thread::scope(|scope| {
        let play = |thread: u64| {
            let stations = &stations;
            move || {
                let mut events = 0;
                for seed in (thread..HISTORIES).step_by(THREADS as usize) {
                    let slots = &stations[(seed / THREADS) as usize % stations.len()];
                    let played = std::panic::catch_unwind(|| history(seed, slots));
                    events += played.unwrap_or_else(|_| panic!("the history of seed {seed} breaks a promise"));
                }
                events
            }
        };
        let threads: Vec<_> = (0..THREADS).map(|thread| scope.spawn(play(thread))).collect();
        threads.into_iter().map(|thread| thread.join().expect("a thread")).sum()
    });
    println!("{HISTORIES} histories, {events} events, {:.1} s", began.elapsed().as_secs_f64());
    assert!(events > HISTORIES);
}
