//! What the supervisor decides, as a pure function `(now, event, state) → actions`. It reads no clock and has no effect of its own, so
//! every sequence of events can be tried in a test.
//!
//! Promises: never two incarnations alive in one slot; never a spawn after a stop was asked for; restarts are bounded in any window of
//! time; every death is followed by a spawn, after a bounded wait, unless the slot was given up or the station stops; the last slot of a role
//! with a spare is never given up; a slot that was is tried again after [`TRY_AGAIN_NS`], and when the other of its role dies.
//!
//! Restart intensity follows Erlang/OTP's supervisors, with one change. There, a count of restarts in a window decides alone. Here the
//! count of *short lives in a row* decides how long to wait and when to give up, because a station in test mode is killed from outside
//! hundreds of times and must come back each time, while a process that dies of its own input dies soon after it became ready. An
//! incarnation that served for [`Limits::settled_ns`] wipes the count: it showed that the slot can live.

mod event;
mod ladder;
mod limits;
mod reason;
mod record;
mod state;
mod swap;

pub use event::{Action, Event, Exit, Left};
pub use ladder::{DOOMED_NS, FIRST_HOLD_NS, Ground, Ladder, MOST_DOOMED, MOST_HOLD_NS, TROUBLE_OVER_NS};
pub use limits::{Limits, is_judged, limits, sources};
pub use reason::{Cause, Reason};
pub use record::Record;
pub use state::State;
pub use swap::{
    ARRIVE_WITHIN_NS, GIVE_BACK_WITHIN_NS, PROVE_WITHIN_NS, SHADOW_WITHIN_NS, Swap, TOUCH_WITHIN_NS, VACATE_WITHIN_NS,
    probation_ns,
};

use hyst_messages::{Role, Slot};
use state::{Life, Place};

/// How long a process that has grown too large waits for a spare to take its work, ns.
pub const LEAVE_WITHIN_NS: u64 = 10_000_000_000;
/// How long a slot that was given up stays empty, ns: what ended one after the other may be over, and a try costs one short life in this time.
pub const TRY_AGAIN_NS: u64 = 30_000_000_000;
/// How often a role with a state goes back before those are replaced whose streams it reads: an older state costs its work since then, a fresh one of
/// those others costs nothing, but helps only where a process, and not its state, makes what kills its readers.
const MISTRUST_AFTER_BACK: usize = 2;

/// Takes an event, changes the state, says what to do.
pub fn step(now_ns: u64, event: Event, state: &mut State) -> Vec<Action> {
    let actions = decide(now_ns, event, state);
    for action in &actions {
        if let Action::Kill { slot, incarnation } | Action::Dismiss { slot, incarnation } = action
            && let Some(place) = state.places.get_mut(slot)
        {
            place.killed = *incarnation;
        }
    }
    actions
}

fn decide(now_ns: u64, event: Event, state: &mut State) -> Vec<Action> {
    match event {
        Event::Started { adopted, warming } => {
            begin(now_ns, adopted, warming, state);
            spawn_due(now_ns, state)
        }
        Event::Lived { slot, incarnation, ready_ns: since_ns } => {
            if let Some(Place { life: Life::Alive { incarnation: alive, ready_ns: Some(ready_ns) }, .. }) =
                state.places.get_mut(&slot)
                && *alive == incarnation
            {
                *ready_ns = since_ns.min(*ready_ns);
            }
            Vec::new()
        }
        Event::Spawned { slot, incarnation } => {
            if let Some(place) = state.places.get_mut(&slot).filter(|place| place.life == Life::Spawning) {
                place.life = Life::Alive { incarnation, ready_ns: None };
            }
            swap::spawned(now_ns, slot, incarnation, state)
        }
        Event::SpawnFailed { slot, no_room } => match state.places.get_mut(&slot).filter(|place| place.life == Life::Spawning) {
            Some(_) => swap::spawn_failed(slot, no_room, state).unwrap_or_else(|| bereave(now_ns, slot, End::NotStarted, state)),
            None => Vec::new(),
        },
        Event::Ready { slot, incarnation } => ready(now_ns, slot, incarnation, state),
        Event::Serves { slot, incarnation } => {
            if let Some(place) = state.places.get_mut(&slot)
                && matches!(place.life, Life::Alive { incarnation: alive, .. } if alive == incarnation)
            {
                place.serves = incarnation;
                // Who is to be replaced serves until its end.
                place.hands_over &= place.killed == incarnation || place.leaving.is_some_and(|leaving| leaving.0 == incarnation);
            }
            Vec::new()
        }
        Event::Died { slot, incarnation, exit } => died(now_ns, slot, incarnation, exit, state),
        Event::HeartbeatLate { slot, incarnation, beat_ns } => match state.places.get_mut(&slot) {
            Some(place) if matches!(place.life, Life::Alive { incarnation: alive, .. } if alive == incarnation) => {
                place.hung = (incarnation, beat_ns);
                vec![Action::Kill { slot, incarnation }]
            }
            _ => Vec::new(),
        },
        Event::Holds { role, incarnation } => {
            if let Some(ladder) = state.ladders.get_mut(&role) {
                ladder.holds(now_ns, incarnation);
            }
            let mut actions = swap::holds(now_ns, role, incarnation, state);
            actions.extend(relieve(now_ns, state));
            actions
        }
        Event::Unfit { slot, incarnation, reason } => unfit(now_ns, slot, incarnation, reason, state),
        Event::SwapAsked { slot, incumbent } => swap::begin(now_ns, slot, incumbent, state),
        Event::SwapLeft(left) => swap::resume(now_ns, &left, state),
        Event::Agreed { incarnation } => swap::agreed(now_ns, incarnation, state),
        Event::Touched { incarnation } => swap::touched(incarnation, state),
        Event::Cuts { incarnation } => swap::cuts(now_ns, incarnation, state),
        Event::Parted { incarnation, reason } => swap::parted(now_ns, incarnation, reason, state),
        Event::Doubted { incarnation, reason } => swap::doubted(now_ns, incarnation, reason, state),
        Event::StopRequested => {
            state.stopping = true;
            Vec::new()
        }
        Event::Tick => tick(now_ns, state),
    }
}

fn ready(now_ns: u64, slot: Slot, incarnation: u32, state: &mut State) -> Vec<Action> {
    let Some(place) = state.places.get_mut(&slot).filter(|place| place.life == (Life::Alive { incarnation, ready_ns: None }))
    else {
        return Vec::new();
    };
    place.life = Life::Alive { incarnation, ready_ns: Some(now_ns) };
    place.was_ready = true;
    // Of a servo in its shadow nothing is taken: the other one is alone.
    place.hands_over &= slot.role() == Role::Haptic;
    place.serves = if slot.role() == Role::Haptic { place.serves } else { incarnation };
    swap::ready(now_ns, slot, incarnation, state)
}

/// Time has passed.
fn tick(now_ns: u64, state: &mut State) -> Vec<Action> {
    let mut actions = spawn_due(now_ns, state);
    actions.extend(relieve(now_ns, state));
    if !state.stopping {
        let ground = |(role, ladder): (&Role, &mut Ladder)| Some(Action::GoBack { role: *role, ground: ladder.wait(now_ns)? });
        actions.extend(state.ladders.iter_mut().filter_map(ground));
    }
    actions.extend(swap::tend(now_ns, state));
    actions
}

/// Takes over those who live already, ready or not yet.
fn begin(now_ns: u64, adopted: Vec<(Slot, u32)>, warming: Vec<(Slot, u32)>, state: &mut State) {
    // A station of which anybody lives has run: it is not ended by one that refuses what was edited since.
    let has_run = !adopted.is_empty();
    state.places.values_mut().for_each(|place| place.was_ready |= has_run);
    let ready = adopted.into_iter().map(|found| (found, Some(now_ns)));
    for ((slot, incarnation), ready_ns) in ready.chain(warming.into_iter().map(|found| (found, None))) {
        if let Some(place) = state.places.get_mut(&slot) {
            place.life = Life::Alive { incarnation, ready_ns };
            // Who is to be replaced is told of again, and of a servo that it has left its shadow.
            place.hands_over &= ready_ns.is_none() || slot.role() == Role::Haptic;
            // Whether a servo has left its shadow is told at the first look.
            place.serves = if ready_ns.is_some() && slot.role() != Role::Haptic { incarnation } else { 0 };
        }
    }
}

fn unfit(now_ns: u64, slot: Slot, incarnation: u32, reason: &str, state: &mut State) -> Vec<Action> {
    let undone = swap::doubted(now_ns, incarnation, Reason::new(Cause::Unfit, reason), state);
    if !undone.is_empty() || slot.is_guest() && !swap::is_proven(slot, state) {
        return undone;
    }
    // Of two servos, which compute side by side, it is not known here whom the device follows.
    let does_the_work = state.ladders.get(&slot.role()).is_none_or(|ladder| ladder.holder() == incarnation);
    if let Some(place) = state.places.get_mut(&slot)
        && place.leaving.is_none()
        && matches!(place.life, Life::Alive { incarnation: alive, .. } if alive == incarnation)
    {
        place.leaving = Some((incarnation, now_ns, false));
        place.hands_over = slot.role().is_replicated() && does_the_work;
    }
    relieve(now_ns, state)
}

fn spawn_due(now_ns: u64, state: &mut State) -> Vec<Action> {
    if state.stopping {
        return Vec::new();
    }
    let due = |place: &Place| matches!(place.life, Life::Vacant { due_ns } if due_ns <= now_ns);
    let mut actions = Vec::new();
    for (slot, place) in &mut state.places {
        if let Life::GivenUp { again_ns } = place.life
            && again_ns <= now_ns
        {
            place.life = Life::Vacant { due_ns: again_ns };
            actions.push(Action::TryAgain { slot: *slot });
        }
        if due(place) {
            place.life = Life::Spawning;
            actions.push(Action::Spawn { slot: *slot });
        }
    }
    actions
}

/// Lets those go that are unfit, each as soon as somebody else can do its work, or after a bounded wait. Two replicas that are unfit at the same
/// instant, as two that leak alike, go one after the other. Whoever's readers die of it, its spare among them, is not waited for.
fn relieve(now_ns: u64, state: &mut State) -> Vec<Action> {
    if state.stopping {
        return Vec::new();
    }
    let leaving = |(slot, place): (&Slot, &Place)| Some((*slot, place.leaving?));
    let leaving: Vec<(Slot, (u32, u64, bool))> = state.places.iter().filter_map(leaving).collect();
    let mut actions = Vec::new();
    for (slot, (incarnation, since_ns, told)) in leaving {
        let other = state.sibling(slot).and_then(|sibling| state.lasting(sibling));
        let is_holder = state.ladders.get(&slot.role()).is_some_and(|ladder| ladder.holder() == incarnation);
        let in_vain = state.ends_its_spare(slot, incarnation);
        let patient = slot.role().is_replicated() && now_ns.saturating_sub(since_ns) < LEAVE_WITHIN_NS && !in_vain;
        let action = match other {
            Some(incarnation) if is_holder && patient && !told => Action::HandOver { role: slot.role(), incarnation },
            Some(_) if is_holder && patient => continue,
            None if patient => continue,
            _ => Action::Kill { slot, incarnation },
        };
        if let Some(place) = state.places.get_mut(&slot) {
            let is_handed = matches!(action, Action::HandOver { .. });
            place.leaving = is_handed.then_some((incarnation, since_ns, true));
            place.killed = if is_handed { place.killed } else { incarnation };
        }
        actions.push(action);
    }
    actions
}

fn died(now_ns: u64, slot: Slot, incarnation: u32, exit: Exit, state: &mut State) -> Vec<Action> {
    let stopping = state.stopping;
    let Some(place) = state.places.get_mut(&slot) else {
        return Vec::new();
    };
    let Life::Alive { incarnation: alive, ready_ns } = place.life else {
        return Vec::new();
    };
    if alive != incarnation {
        return Vec::new();
    }
    let mut actions = vec![Action::MarkDead { slot, incarnation }];
    place.leaving = None;
    let hung = place.hung.0 == incarnation;
    // What hung was at its end with its last beat: a bound on hangs that is longer than a doomed tenure makes none last.
    let ended_ns = if hung { place.hung.1.min(now_ns) } else { now_ns };
    if stopping {
        place.life = Life::Vacant { due_ns: u64::MAX };
        return actions;
    }
    if let Some(more) = swap::died(now_ns, slot, incarnation, hung, state) {
        actions.extend(more);
        return actions;
    }
    let Some(place) = state.places.get_mut(&slot) else { return actions };
    if slot.is_guest() {
        place.life = Life::Closed;
        actions.push(Action::Vacate { slot });
        return actions;
    }
    if exit == Exit::Code(2) && !place.was_ready {
        place.life = Life::GivenUp { again_ns: u64::MAX };
        let reason = "it refused the scene or the settings";
        actions.push(Action::GiveUp { slot, reason, end: Some(2) });
        return actions;
    }
    // SIGKILL comes from outside, unless it was a supervisor's answer to a hang; and nobody is blamed for an end of which nothing is known.
    let by_itself = hung || !matches!(exit, Exit::Signal(9) | Exit::Unknown);
    let role = slot.role();
    if let Some(ladder) = state.ladders.get_mut(&role).filter(|ladder| ladder.holder() == incarnation)
        && let Some(ground) = ladder.holder_died(now_ns, ended_ns, by_itself, ready_ns.is_some())
    {
        actions.push(Action::GoBack { role, ground });
        let may_mistrust = place.was_ready && ladder.went_back() >= MISTRUST_AFTER_BACK && !ladder.mistrusted;
        // What killed them is the state; the slots begin anew with another one.
        for (_, place) in state.places.iter_mut().filter(|(slot, _)| slot.role() == role) {
            place.short_lives = 0;
        }
        // That was no help: it may be what they read. Once in a trouble, or later where nobody could be replaced then.
        let mistrusted = if may_mistrust { mistrust(slot, state) } else { Vec::new() };
        if let Some(ladder) = state.ladders.get_mut(&role) {
            ladder.mistrusted |= !mistrusted.is_empty();
        }
        actions.extend(mistrusted);
    }
    let settled = ready_ns.is_some_and(|ready_ns| ended_ns.saturating_sub(ready_ns) >= limits(role).settled_ns);
    let end = match (settled, by_itself) {
        (true, _) => End::Settled,
        (false, true) if exit == Exit::Code(2) => End::Refused,
        (false, true) => End::OfItself,
        (false, false) => End::Killed,
    };
    actions.extend(bereave(now_ns, slot, end, state));
    actions.extend(spawn_due(now_ns, state));
    actions
}

/// How a life ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// After it had served for long enough.
    Settled,
    /// Soon, by a crash or a hang.
    OfItself,
    /// Soon, and it has said that it cannot work as things are.
    Refused,
    /// Soon, by somebody else.
    Killed,
    /// It never began.
    NotStarted,
}

/// Books a death and says when the next incarnation is due, or that there will be none.
fn bereave(now_ns: u64, slot: Slot, end: End, state: &mut State) -> Vec<Action> {
    let limits = limits(slot.role());
    let sibling = state.sibling(slot);
    let alone = sibling.is_some_and(|sibling| state.lasting(sibling).is_none());
    let Some(place) = state.places.get_mut(&slot) else {
        return Vec::new();
    };
    place.short_lives = if end == End::Settled { 0 } else { (place.short_lives + 1).min(limits.most_short_lives) };
    place.deaths_ns.push_back(now_ns);
    while place.deaths_ns.front().is_some_and(|death_ns| now_ns.saturating_sub(*death_ns) > limits.window_ns) {
        place.deaths_ns.pop_front();
    }
    let too_many = place.deaths_ns.len() >= limits.most_deaths;
    if (place.short_lives >= limits.most_short_lives || too_many) && !alone {
        // Without the hardware there is nothing to feel, and without the device nobody feels it. A driver whose device was pulled out says so, and what was
        // done until then is kept.
        let (reason, code) = match (slot.role(), end) {
            (Role::Hardware, End::Refused) => ("it could not begin again", Some(3)),
            (Role::Hardware | Role::Device, _) => ("it died again and again", Some(1)),
            _ => ("it died again and again", None),
        };
        place.life = Life::GivenUp { again_ns: if code.is_some() { u64::MAX } else { now_ns + TRY_AGAIN_NS } };
        return vec![Action::GiveUp { slot, reason, end: code }];
    }
    // One that never was ready died of itself: of its driver, of its disk. A role with a state is tried with older ones first: see `died`.
    let with_state = slot.role().is_stateful();
    place.mistrusted &= place.short_lives > 0;
    let is_enough = place.short_lives >= limits.mistrust_after() && !place.mistrusted;
    let of_itself = matches!(end, End::OfItself | End::Refused);
    let mistrusts = of_itself && place.was_ready && !with_state && is_enough;
    let wait_ns = if too_many { limits.most_wait_ns } else { limits.wait_ns(place.short_lives) };
    place.life = Life::Vacant { due_ns: now_ns + wait_ns };
    // Once in such a row, or at a later death where nobody could be replaced at this one.
    let mut actions = if mistrusts { mistrust(slot, state) } else { Vec::new() };
    if let Some(place) = state.places.get_mut(&slot) {
        place.mistrusted |= !actions.is_empty();
    }
    if let Some((slot, other)) = sibling.and_then(|sibling| Some((sibling, state.places.get_mut(&sibling)?)))
        && matches!(other.life, Life::GivenUp { .. })
    {
        other.life = Life::Vacant { due_ns: now_ns + limits.most_wait_ns };
        actions.push(Action::TryAgain { slot });
    }
    actions
}

/// What one process after the other dies of in a slot may be what they read, and then a fresh one of those who wrote it helps: of a role with a
/// state whoever holds it, of the others all. Not during a swap, which has its own judge.
fn mistrust(reader: Slot, state: &mut State) -> Vec<Action> {
    if state.swap.is_some() {
        return Vec::new();
    }
    let of_source = |slot: &&Slot| limits::sources(reader.role()).contains(&slot.role()) && !slot.is_guest();
    let suspect = |slot: &Slot| {
        let incarnation = state.ready(*slot)?;
        let writes = state.ladders.get(&slot.role()).is_none_or(|ladder| ladder.holder() == incarnation);
        writes.then_some(Action::Mistrust { slot: *slot, incarnation, reader })
    };
    let actions: Vec<Action> = state.places.keys().filter(of_source).filter_map(suspect).collect();
    for action in &actions {
        if let Action::Mistrust { slot, incarnation, .. } = action
            && let Some(place) = state.places.get_mut(slot)
        {
            place.harmful = *incarnation;
        }
    }
    actions
}
