//! What the supervisor decides, as a pure function `(now, event, state) → actions`. It reads no clock and has no effect of its own, so
//! every sequence of events can be tried in a test.
//!
//! Promises: never two incarnations alive in one slot; never a spawn after a stop was asked for; restarts are bounded in any window of
//! time; every death is followed by a spawn unless the slot was given up or the station stops.
//!
//! Restart intensity follows Erlang/OTP's supervisors, with one change. There, a count of restarts in a window decides alone. Here the
//! count of *short lives in a row* decides how long to wait and when to give up, because a station in test mode is killed from outside
//! hundreds of times and must come back each time, while a process that dies of its own input dies soon after it became ready. An
//! incarnation that served for [`SETTLED_NS`] wipes the count: it showed that the slot can live.

use hyst_messages::page::ProcessState;
use hyst_messages::{Role, Slot};
use std::collections::{BTreeMap, VecDeque};

/// An incarnation that was ready for this long has settled. A fault that its input causes shows within a few steps (1 ms each for the
/// real-time roles, 33 ms for the slowest), and a campaign of kills leaves each slot at least twice as long.
pub const SETTLED_NS: u64 = 100_000_000;
/// First wait after a short life, doubled by each further one. The first restart of a settled incarnation does not wait at all: the
/// trainee's hand waits for it. Two periods of the slowest engine are enough for a passing cause (a full disk, a late peer) to pass.
pub const BACKOFF_FIRST_NS: u64 = 50_000_000;
/// Longest wait: a person at the table still sees that the station tries.
pub const BACKOFF_MOST_NS: u64 = 3_200_000_000;
/// Short lives in a row before the slot is given up: with the waits above, about 9 seconds of trying.
pub const MOST_SHORT_LIVES: u32 = 8;
/// Window of the second bound, which holds for settled incarnations too.
pub const WINDOW_NS: u64 = 10_000_000_000;
/// Deaths of one slot within the window before it is given up. A campaign kills a slot at most five times a second.
pub const MOST_DEATHS: usize = 60;
/// A real-time role whose heartbeat is older than this hangs. The spare took over long before; this only ends the hung process. Hosts
/// stall by up to 34 ms.
pub const LATE_REAL_TIME_NS: u64 = 100_000_000;
/// The same for the other roles: some sixty frames.
pub const LATE_NS: u64 = 2_000_000_000;
/// A start-up that takes longer hangs: graphics in software need some seconds on a busy machine.
pub const LATE_START_NS: u64 = 30_000_000_000;

/// How a process ended, as far as its parent can know.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// Exit code.
    Code(i32),
    /// Signal.
    Signal(i32),
    /// The process was adopted: nobody but its parent learns how it ended.
    Unknown,
}

impl std::fmt::Display for Exit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Exit::Code(code) => write!(f, "exit code {code}"),
            Exit::Signal(signal) => write!(f, "signal {signal}"),
            Exit::Unknown => f.write_str("unknown end"),
        }
    }
}

/// What happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// The supervisor runs; these incarnations live already.
    Started {
        /// Slots and incarnations that were adopted.
        adopted: Vec<(Slot, u32)>,
    },
    /// A spawn that was asked for succeeded.
    Spawned {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
    },
    /// A spawn that was asked for failed.
    SpawnFailed {
        /// Where.
        slot: Slot,
    },
    /// An incarnation became warm or live.
    Ready {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
    },
    /// An incarnation died.
    Died {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
        /// How.
        exit: Exit,
    },
    /// An incarnation lives but no longer beats.
    HeartbeatLate {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
    },
    /// Somebody asked the station to stop.
    StopRequested,
    /// Time has passed.
    Tick,
}

/// What is to be done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// Start a new incarnation.
    Spawn {
        /// Where.
        slot: Slot,
    },
    /// Say in the station page that the incarnation is dead, then drop its services and its page.
    MarkDead {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
    },
    /// Demote and kill a process that hangs.
    Kill {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
    },
    /// Start nothing more in this slot.
    GiveUp {
        /// Where.
        slot: Slot,
        /// Why.
        reason: &'static str,
        /// The station ends with this code; `None`: it goes on without the slot.
        end: Option<u8>,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Life {
    Vacant { due_ns: u64 },
    Spawning,
    Alive { incarnation: u32, ready_ns: Option<u64> },
    GivenUp,
}

#[derive(Clone, Debug)]
struct Place {
    life: Life,
    /// An incarnation of it was ready before: the scene and the settings were good.
    was_ready: bool,
    short_lives: u32,
    deaths_ns: VecDeque<u64>,
}

/// What the policy remembers.
#[derive(Clone, Debug)]
pub struct State {
    places: BTreeMap<Slot, Place>,
    stopping: bool,
}

impl State {
    /// The slots that must be occupied.
    pub fn new(slots: &[Slot]) -> State {
        let vacant = Place { life: Life::Vacant { due_ns: 0 }, was_ready: false, short_lives: 0, deaths_ns: VecDeque::new() };
        State { places: slots.iter().map(|slot| (*slot, vacant.clone())).collect(), stopping: false }
    }
    /// Whether a stop was asked for.
    pub fn is_stopping(&self) -> bool {
        self.stopping
    }
    /// Slots that were given up.
    pub fn given_up(&self) -> impl Iterator<Item = Slot> + '_ {
        self.places.iter().filter(|(_, place)| place.life == Life::GivenUp).map(|(slot, _)| *slot)
    }
    /// Whether any incarnation is alive or being spawned.
    pub fn anyone_alive(&self) -> bool {
        self.places.values().any(|place| matches!(place.life, Life::Alive { .. } | Life::Spawning))
    }
    /// Whether the slot has an incarnation that is ready.
    pub fn is_ready(&self, slot: Slot) -> bool {
        self.places.get(&slot).is_some_and(|place| matches!(place.life, Life::Alive { ready_ns: Some(_), .. }))
    }
}

/// Takes an event, changes the state, says what to do.
pub fn step(now_ns: u64, event: Event, state: &mut State) -> Vec<Action> {
    match event {
        Event::Started { adopted } => {
            for (slot, incarnation) in adopted {
                if let Some(place) = state.places.get_mut(&slot) {
                    place.life = Life::Alive { incarnation, ready_ns: Some(now_ns) };
                    place.was_ready = true;
                }
            }
            spawn_due(now_ns, state)
        }
        Event::Spawned { slot, incarnation } => {
            if let Some(place) = state.places.get_mut(&slot).filter(|place| place.life == Life::Spawning) {
                place.life = Life::Alive { incarnation, ready_ns: None };
            }
            Vec::new()
        }
        Event::SpawnFailed { slot } => match state.places.get_mut(&slot).filter(|place| place.life == Life::Spawning) {
            Some(place) => bereave(now_ns, slot, place, false).into_iter().collect(),
            None => Vec::new(),
        },
        Event::Ready { slot, incarnation } => {
            if let Some(place) = state.places.get_mut(&slot)
                && place.life == (Life::Alive { incarnation, ready_ns: None })
            {
                place.life = Life::Alive { incarnation, ready_ns: Some(now_ns) };
                place.was_ready = true;
            }
            Vec::new()
        }
        Event::Died { slot, incarnation, exit } => died(now_ns, slot, incarnation, exit, state),
        Event::HeartbeatLate { slot, incarnation } => match state.places.get(&slot).map(|place| place.life) {
            Some(Life::Alive { incarnation: alive, .. }) if alive == incarnation => vec![Action::Kill { slot, incarnation }],
            _ => Vec::new(),
        },
        Event::StopRequested => {
            state.stopping = true;
            Vec::new()
        }
        Event::Tick => spawn_due(now_ns, state),
    }
}

fn spawn_due(now_ns: u64, state: &mut State) -> Vec<Action> {
    if state.stopping {
        return Vec::new();
    }
    let due = |place: &Place| matches!(place.life, Life::Vacant { due_ns } if due_ns <= now_ns);
    let mut actions = Vec::new();
    for (slot, place) in state.places.iter_mut().filter(|(_, place)| due(place)) {
        place.life = Life::Spawning;
        actions.push(Action::Spawn { slot: *slot });
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
    if stopping {
        place.life = Life::Vacant { due_ns: u64::MAX };
        return actions;
    }
    if exit == Exit::Code(2) && !place.was_ready {
        place.life = Life::GivenUp;
        let reason = "it refused the scene or the settings";
        actions.push(Action::GiveUp { slot, reason, end: Some(2) });
        return actions;
    }
    let settled = ready_ns.is_some_and(|ready_ns| now_ns.saturating_sub(ready_ns) >= SETTLED_NS);
    actions.extend(bereave(now_ns, slot, place, settled));
    actions.extend(spawn_due(now_ns, state));
    actions
}

/// Books a death and says when the next incarnation is due, or that there will be none.
fn bereave(now_ns: u64, slot: Slot, place: &mut Place, settled: bool) -> Option<Action> {
    place.short_lives = if settled { 0 } else { place.short_lives + 1 };
    place.deaths_ns.push_back(now_ns);
    while place.deaths_ns.front().is_some_and(|death_ns| now_ns.saturating_sub(*death_ns) > WINDOW_NS) {
        place.deaths_ns.pop_front();
    }
    if place.short_lives >= MOST_SHORT_LIVES || place.deaths_ns.len() >= MOST_DEATHS {
        place.life = Life::GivenUp;
        // Without the hardware there is nothing to feel, and without the device nobody feels it.
        let end = matches!(slot.role(), Role::Hardware | Role::Device).then_some(1);
        return Some(Action::GiveUp { slot, reason: "it died again and again", end });
    }
    let wait_ns = match place.short_lives {
        0 => 0,
        lives => (BACKOFF_FIRST_NS << (lives - 1).min(16)).min(BACKOFF_MOST_NS),
    };
    place.life = Life::Vacant { due_ns: now_ns + wait_ns };
    None
}

/// Age up to which a real-time process is given an ordinary one's time: while a whole station starts, a dozen processes map and lock their
/// memory on the same cores, and a process that has just become real time was seen to stand still for 0.1 s in a page fault behind them. Its
/// spare or its other replica does the work meanwhile.
const YOUNG_NS: u64 = 2_000_000_000;

/// Whether a role has deadlines of a millisecond.
pub fn is_real_time(role: Role) -> bool {
    matches!(role, Role::Hardware | Role::Device | Role::Haptic | Role::Tissue | Role::CollisionWorker)
}

/// Whether a process hangs: by its state, its last heartbeat and the time of its spawn. `awake_since_ns` is since when the watcher
/// itself has run without a stall, so that a stall of the host is not taken for a hang of everyone.
pub fn is_late(role: Role, state: ProcessState, now_ns: u64, spawned_ns: u64, beat_ns: u64, awake_since_ns: u64) -> bool {
    match state {
        ProcessState::Empty | ProcessState::Warming => now_ns.saturating_sub(spawned_ns.max(awake_since_ns)) > LATE_START_NS,
        ProcessState::Stopping | ProcessState::Failed => now_ns.saturating_sub(beat_ns.max(awake_since_ns)) > LATE_NS,
        ProcessState::Warm | ProcessState::Live => {
            let young = now_ns.saturating_sub(spawned_ns) < YOUNG_NS;
            let bound_ns = if is_real_time(role) && !young { LATE_REAL_TIME_NS } else { LATE_NS };
            now_ns.saturating_sub(beat_ns.max(awake_since_ns)) > bound_ns
        }
    }
}
