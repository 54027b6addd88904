//! What the policy is told, and what it asks for.

use super::{Ground, Reason};
use hyst_messages::page::Stage;
use hyst_messages::{Role, Slot};

/// How a process ended, as far as its parent can know.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// Exit code.
    Code(i32),
    /// Signal.
    Signal(i32),
    /// SIGKILL by the kernel, because memory was short.
    OutOfMemory,
    /// The process was adopted, and reaped before anybody could ask.
    Unknown,
}

impl Exit {
    /// Whether somebody killed it.
    pub fn is_kill(self) -> bool {
        self == Exit::Signal(9)
    }
}

impl std::fmt::Display for Exit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Exit::Code(code) => write!(f, "exit code {code}"),
            Exit::Signal(signal) => write!(f, "signal {signal}"),
            Exit::OutOfMemory => f.write_str("signal 9 by the kernel, for want of memory"),
            Exit::Unknown => f.write_str("unknown end"),
        }
    }
}

/// What happened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// The supervisor runs; these incarnations live already.
    Started {
        /// Slots and incarnations that were adopted, and are ready.
        adopted: Vec<(Slot, u32)>,
        /// Likewise of those that are not yet.
        warming: Vec<(Slot, u32)>,
    },
    /// One that was adopted had been ready since before.
    Lived {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
        /// Since when, ns.
        ready_ns: u64,
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
        /// There is no room for it.
        no_room: bool,
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
    /// What a servo makes may be used from now on: it has left its shadow.
    Serves {
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
        /// Its last beat, ns: what it did, it had done by then.
        beat_ns: u64,
    },
    /// An incarnation took a stateful role.
    Holds {
        /// Which.
        role: Role,
        /// Who.
        incarnation: u32,
    },
    /// An incarnation works and is to be replaced, as soon as another can do its work.
    Unfit {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
        /// Why.
        reason: &'static str,
    },
    /// Somebody asked for a swap that begins in this slot: a guest's, or that of the first process to be replaced.
    SwapAsked {
        /// Where the newcomer starts.
        slot: Slot,
        /// Who does the role's work now.
        incumbent: u32,
    },
    /// A supervisor before this one died in the middle of a swap.
    SwapLeft(Left),
    /// The newcomer was compared with the incumbent for long enough, and agrees.
    Agreed {
        /// Who.
        incarnation: u32,
    },
    /// The hand has felt something for a while since a newcomer is on probation.
    Touched {
        /// The newcomer.
        incarnation: u32,
    },
    /// There is current in the electrode while a newcomer is on probation.
    Cuts {
        /// The newcomer.
        incarnation: u32,
    },
    /// The state of a newcomer on probation and that of the old engine have gone different ways, as those of two good ones may.
    Parted {
        /// The newcomer.
        incarnation: u32,
        /// Why it is undone if it does so again and again.
        reason: Reason,
    },
    /// Somebody has a reason not to trust an incarnation; it counts only for a newcomer.
    Doubted {
        /// Whom.
        incarnation: u32,
        /// Why.
        reason: Reason,
    },
    /// Somebody asked the station to stop.
    StopRequested,
    /// Time has passed.
    Tick,
}

/// A swap that a supervisor before this one did not end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Left {
    /// Where the newcomer started.
    pub slot: Slot,
    /// The newcomer, 0 if it was not started.
    pub incarnation: u32,
    /// Who did the role's work before.
    pub incumbent: u32,
    /// Its probation was over.
    pub proven: bool,
    /// Slots in which an old engine still runs, with its incarnation.
    pub old: Vec<(Slot, u32)>,
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
    /// Kill a process that does its work, because a swap puts another in its place or undoes it. That is no fault.
    Dismiss {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
    },
    /// Say to the processes of a role how far the newcomer is.
    Told {
        /// Which.
        role: Role,
        /// How far.
        stage: Stage,
        /// The newcomer.
        incarnation: u32,
    },
    /// The newcomer's binary is the role's from now on.
    Adopt {
        /// Which.
        role: Role,
    },
    /// The swap is undone: the role's binary is the old one, and a servo that was to be followed no longer is.
    Retreat {
        /// Which.
        role: Role,
        /// Who did the role's work before.
        to: u32,
        /// Why.
        reason: Reason,
    },
    /// The swap is over.
    EndSwap {
        /// Which.
        role: Role,
        /// Whether the newcomer has the role.
        promoted: bool,
    },
    /// A guest that had stayed behind when its swap was over has ended: nobody is in its slot any more.
    Vacate {
        /// Where.
        slot: Slot,
    },
    /// Whoever reads this incarnation's messages dies again and again: it may be what they read, so it is unfit.
    Mistrust {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
        /// Who dies.
        reader: Slot,
    },
    /// Give the role to this incarnation, which is its warm spare.
    HandOver {
        /// Which.
        role: Role,
        /// To whom.
        incarnation: u32,
    },
    /// From now on founders of the role start from here.
    GoBack {
        /// Which.
        role: Role,
        /// From what.
        ground: Ground,
    },
    /// A slot that was given up is tried again, since the other one of its role died, or enough time has passed.
    TryAgain {
        /// Where.
        slot: Slot,
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
