//! The chain of a role's states: holder, spare and a successor, and the supervisor that gives the role to one of them (`engine::stateful`: `roster`,
//! `chain.rs`, in lock-step `locked.rs`), and a consumer that reads their streams. What is modelled of a state is its key and its content: the content
//! follows from the state that it was computed from and the key that it was computed for, so two ways to one key show whether they agree.
//!
//! Promises: one content for each epoch and tick, whoever publishes it, zombies included; no reader takes a lower epoch or an earlier tick after a
//! higher one; one winner for each epoch; nobody waits without end.

mod checks;
mod world;

use crate::search::{Model, Sights};
use hyst_exchange::succession::{Key, Turn, holder_turn, spare_turn, supersedes};

/// The holder at the beginning, its spare, and the successor of whoever dies first.
const PROCESSES: usize = 3;
/// What a founder begins with.
const CHECKPOINT: State = State { key: (0, 0), content: 7 };

/// What could be written instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Flaw {
    None,
    /// The holder leaps over ticks without a new epoch.
    HolderLeaps,
    /// The spare computes a substitute for the first state of an epoch.
    SpareBegins,
    /// The winner of an epoch begins it at the tick of its last wake-up.
    OldClock,
    /// Promotion stores its word without a look at what is there.
    Store,
    /// A consumer takes whatever is new in a stream.
    Anything,
    /// Who was made the holder by the supervisor begins at the tick of its last wake-up, with the states that it knew.
    Trusting,
    /// What was computed is sent without a last look at the roster. Harmless: a lower epoch is refused by every reader.
    Unfenced,
    /// In lock-step the role is taken with what was received before the death was known.
    Hasty,
    /// The spare waits for the first state of an epoch also if its winner is dead.
    Patient,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct State {
    key: (u8, u8),
    content: u16,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum At {
    /// `Pace::wait`.
    Idle,
    /// `Chain::receive`, one stream after another; `won`: the epoch that was just won, or 0.
    Receive {
        stream: u8,
        won: u8,
    },
    /// `run`: who holds the role; what is to be done.
    Look,
    /// `Roster::promote`: the compare-and-swap, and from whom.
    Promote {
        epoch: u8,
        holder: u8,
    },
    /// `make`: the state is computed; the last look at the roster.
    Fence {
        epoch: u8,
        holder: u8,
        next: u8,
    },
    /// `make`: the message is sent.
    Send {
        epoch: u8,
        next: u8,
    },
    /// `between` in lock-step: it knows of the holder's death, and receives what was sent until then, one stream after another.
    Inherit {
        stream: u8,
        epoch: u8,
        holder: u8,
    },
    /// `send_again` in lock-step: the newest state, under the epoch that was just won.
    Again {
        epoch: u8,
    },
    Dead,
    /// Not born yet.
    Unborn,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Process {
    at: At,
    tick: u8,
    misses: u8,
    newest: Option<State>,
    /// Newest message of its stream.
    stream: Option<State>,
    /// The supervisor's word that it is dead.
    known_dead: bool,
    /// The epoch under which it last took its turn as the holder.
    stepped: u8,
    /// Streams that it can never open, one bit each: their writers were known to be dead when it was born.
    closed: u8,
}

#[derive(Clone, Debug, Hash)]
struct World {
    clock: u8,
    /// The roster's word: epoch and holder.
    roster: (u8, u8),
    processes: [Process; PROCESSES],
    consumer: Option<State>,
    deaths: u8,
    handed: u8,
    /// Every state that was ever published, in the order of their keys: remembered for the properties.
    published: Vec<State>,
    seen: Sights,
}

impl World {
    /// Whether the role's holder is known to be dead, and somebody lives who could take it.
    fn is_orphaned(&self) -> bool {
        self.processes[self.roster.1 as usize].known_dead && self.processes.iter().any(|p| !matches!(p.at, At::Dead | At::Unborn))
    }
}

type Step = Result<World, String>;

struct Chain {
    flaw: Flaw,
    /// Ticks that pass.
    ticks: u8,
    /// Processes that may die.
    deaths: u8,
    /// Times that the supervisor gives the role to one who follows, as for a swap.
    handed: u8,
    /// Misses in a row after which the spare promotes itself: three in the code; with two as much happens in less time.
    misses: u32,
    /// The role is taken from the dead alone, and the newest state sent again before anything else.
    lockstep: bool,
}

const SUBSTITUTE: u64 = 1;
const LEAP: u64 = 2;
const TAKEOVER: u64 = 4;
const ZOMBIE: u64 = 8;
const FENCED: u64 = 16;
const SUCCESSOR: u64 = 32;
const FOUNDER: u64 = 64;
const HANDED: u64 = 128;
const AGAIN: u64 = 256;

fn wide(key: (u8, u8)) -> Key {
    (key.0 as u32, key.1 as u64)
}

/// The content of a state that is computed from another one.
fn content(from: State, key: (u8, u8)) -> u16 {
    // Odd multipliers, so that different pasts stay different; a step's content depends on the tick, not on the epoch or on who computes.
    from.content.wrapping_mul(31).wrapping_add(from.key.1 as u16).wrapping_mul(17).wrapping_add(key.1 as u16).wrapping_mul(5)
}

impl Chain {
    fn take(&self, newest: Option<State>, found: State) -> bool {
        supersedes(wide(found.key), newest.map(|newest| wide(newest.key)))
    }

    fn receive(&self, process: &mut Process, writer: &Process, stream: u8) {
        if process.closed & 1 << stream == 0
            && let Some(found) = writer.stream
            && self.take(process.newest, found)
        {
            process.newest = Some(found);
        }
    }

    /// `run`, `step`, `follow`.
    fn turn(&self, world: &World, me: u8) -> (At, u8) {
        let process = &world.processes[me as usize];
        let (epoch, holder) = world.roster;
        let Some(newest) = process.newest else {
            // `warm`: whoever has no state begins with the checkpoint if the holder is dead, and waits for the holder's otherwise.
            let is_orphaned = world.processes[holder as usize].known_dead;
            return (if is_orphaned { At::Promote { epoch, holder } } else { At::Idle }, 0);
        };
        let (tick, key) = (process.tick as u64, wide(newest.key));
        if holder == me {
            return (self.holder(tick, key, epoch, me), 0);
        }
        let misses = if key.1 >= tick { 0 } else { process.misses + 1 };
        let lives = !world.processes[holder as usize].known_dead;
        if self.lockstep {
            let inherit =
                if self.flaw == Flaw::Hasty { At::Promote { epoch, holder } } else { At::Inherit { stream: 0, epoch, holder } };
            return (if lives { At::Idle } else { inherit }, 0);
        }
        let mut turn = spare_turn(tick, key, epoch as u32, 1, lives, misses as u32, self.misses);
        if self.flaw == Flaw::SpareBegins && turn == Turn::Rest && key.1 < tick {
            turn = Turn::Substitute(key.1 + 1);
        }
        if self.flaw == Flaw::Patient && key.0 != epoch as u32 {
            turn = Turn::Rest;
        }
        let at = match turn {
            Turn::Promote => At::Promote { epoch, holder },
            Turn::Substitute(next) => At::Fence { epoch, holder, next: next as u8 },
            _ => At::Idle,
        };
        (at, misses)
    }

    fn holder(&self, tick: u64, newest: Key, epoch: u8, me: u8) -> At {
        match holder_turn(tick, newest, epoch as u32, 1) {
            Turn::Step(next) => At::Fence { epoch, holder: me, next: next as u8 },
            Turn::Leap if self.flaw == Flaw::HolderLeaps => At::Fence { epoch, holder: me, next: tick as u8 + 1 },
            Turn::Leap => At::Promote { epoch, holder: me },
            _ => At::Idle,
        }
    }

    /// One step of a process: what it learns.
    fn step(&self, world: &World, me: u8) -> Option<(&'static str, Step)> {
        let mut next = World { seen: Sights::default(), ..world.clone() };
        let process = &mut next.processes[me as usize];
        let names = match process.at {
            At::Dead | At::Unborn => return None,
            At::Idle if world.clock <= process.tick => return None,
            At::Idle => {
                process.tick = world.clock;
                process.at = At::Receive { stream: 0, won: 0 };
                ["wakes 0", "wakes 1", "wakes 2"]
            }
            At::Inherit { stream, epoch, holder } => {
                self.receive(process, &world.processes[stream as usize], stream);
                let is_last = stream as usize + 1 == PROCESSES;
                process.at =
                    if is_last { At::Promote { epoch, holder } } else { At::Inherit { stream: stream + 1, epoch, holder } };
                ["inherits 0", "inherits 1", "inherits 2"]
            }
            At::Receive { stream, won } => {
                self.receive(process, &world.processes[stream as usize], stream);
                let newest = process.newest.map(|newest| wide(newest.key));
                process.at = match (stream as usize + 1 < PROCESSES, won, newest) {
                    (true, ..) => At::Receive { stream: stream + 1, won },
                    (false, 0, _) => At::Look,
                    (false, _, Some(newest)) => self.holder(process.tick as u64, newest, won, me),
                    // `found`: not fenced, for nobody but its winner publishes in an epoch that has no state yet.
                    (false, _, None) => At::Send { epoch: won, next: process.tick + 1 },
                };
                next.seen.0 |= if newest.is_none() && won > 0 { FOUNDER } else { 0 };
                ["receives 0", "receives 1", "receives 2"]
            }
            // `tick_of`: a tenure that it did not win itself.
            At::Look if world.roster.1 == me && world.roster.0 != process.stepped && self.flaw != Flaw::Trusting => {
                (process.stepped, process.tick) = (world.roster.0, world.clock);
                process.at = At::Receive { stream: 0, won: world.roster.0 };
                next.seen.0 |= HANDED;
                ["is told 0", "is told 1", "is told 2"]
            }
            At::Look => {
                (process.at, process.misses) = self.turn(world, me);
                let substitutes = matches!(process.at, At::Fence { holder, .. } if holder != me);
                next.seen.0 |= if substitutes { SUBSTITUTE } else { 0 };
                ["looks 0", "looks 1", "looks 2"]
            }
            At::Promote { .. } | At::Fence { .. } | At::Send { .. } | At::Again { .. } => return Some(self.act(next, world, me)),
        };
        Some((names[me as usize], Ok(next)))
    }

    /// One step of a process: what it does.
    fn act(&self, mut next: World, world: &World, me: u8) -> (&'static str, Step) {
        let process = &mut next.processes[me as usize];
        let at = std::mem::replace(&mut process.at, At::Idle);
        let names = match at {
            At::Promote { epoch, holder } if world.roster == (epoch, holder) || self.flaw == Flaw::Store => {
                // `begin_epoch`: what was known before may be old by now, the clock too.
                process.tick = if self.flaw == Flaw::OldClock { process.tick } else { world.clock };
                process.at = match process.newest {
                    Some(_) if self.lockstep && holder != me => At::Again { epoch: epoch + 1 },
                    _ => At::Receive { stream: 0, won: epoch + 1 },
                };
                process.stepped = epoch + 1;
                next.roster = (epoch + 1, me);
                next.seen.0 |= if holder == me { LEAP } else { TAKEOVER };
                ["promotes 0", "promotes 1", "promotes 2"]
            }
            At::Fence { epoch, holder, next: tick } => {
                let is_fenced = world.roster != (epoch, holder);
                next.seen.0 |= if is_fenced { FENCED } else { 0 };
                if !is_fenced || self.flaw == Flaw::Unfenced {
                    process.at = At::Send { epoch, next: tick };
                }
                ["looks again 0", "looks again 1", "looks again 2"]
            }
            At::Send { epoch, next: tick } => {
                let from = process.newest.unwrap_or(CHECKPOINT);
                let sent = State { key: (epoch, tick), content: content(from, (epoch, tick)) };
                // It is read back at the next wake-up here, at once in the code: newest is the highest of all streams either way.
                process.stream = Some(sent);
                next.seen.0 |= if world.roster.0 > epoch { ZOMBIE } else { 0 };
                return (["sends 0", "sends 1", "sends 2"][me as usize], publish(next, sent));
            }
            At::Again { epoch } => {
                let newest = process.newest.unwrap_or(CHECKPOINT);
                let sent = State { key: (epoch, newest.key.1), ..newest };
                // Read back at once: the next step goes on from it.
                (process.stream, process.newest) = (Some(sent), Some(sent));
                next.seen.0 |= AGAIN | if world.roster.0 > epoch { ZOMBIE } else { 0 };
                return (["sends again 0", "sends again 1", "sends again 2"][me as usize], publish(next, sent));
            }
            _ => ["is too late 0", "is too late 1", "is too late 2"],
        };
        (names[me as usize], Ok(next))
    }
}

/// Remembers a state that was published; another content under its key is a broken promise.
fn publish(mut world: World, sent: State) -> Step {
    match world.published.binary_search_by_key(&sent.key, |state| state.key) {
        Ok(at) if world.published[at].content != sent.content => Err(format!("two states for {:?}", sent.key)),
        Ok(_) => Ok(world),
        Err(at) => {
            world.published.insert(at, sent);
            Ok(world)
        }
    }
}

impl Model for Chain {
    type State = World;

    fn first(&self) -> World {
        let first = State { key: (1, 0), content: 1 };
        let process = Process {
            at: At::Idle,
            tick: 0,
            misses: 0,
            newest: Some(first),
            stream: None,
            known_dead: false,
            stepped: 1,
            closed: 0,
        };
        let holder = Process { stream: Some(first), ..process };
        let unborn = Process { at: At::Unborn, newest: None, ..process };
        World {
            clock: 0,
            roster: (1, 0),
            processes: [holder, process, unborn],
            consumer: Some(first),
            deaths: 0,
            handed: 0,
            published: vec![first],
            seen: Sights::default(),
        }
    }

    fn steps(&self, state: &World, out: &mut Vec<(&'static str, Step)>) {
        out.extend((0..PROCESSES as u8).filter_map(|me| self.step(state, me)));
        let read = |stream: usize| self.consume(state, stream).map(|next| (["reads 0", "reads 1", "reads 2"][stream], next));
        out.extend((0..PROCESSES).filter_map(read));
        self.world(state, out);
    }

    /// Its promises are broken by steps, not by states.
    fn holds(&self, _: &World, _: &[&'static str]) -> Result<(), String> {
        Ok(())
    }

    /// All time has passed, whoever lives sleeps, and somebody who lives has the role, or nobody could take it.
    fn is_end(&self, state: &World) -> bool {
        let sleeps = |p: &Process| matches!(p.at, At::Dead | At::Unborn | At::Idle);
        state.clock >= self.ticks && state.processes.iter().all(sleeps) && !state.is_orphaned()
    }

    fn sights(&self, state: &World) -> u64 {
        state.seen.0
    }
}
