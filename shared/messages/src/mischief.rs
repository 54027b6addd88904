//! What an engine may be asked to do wrong, in test mode alone. The supervisor writes the request of a slot into the station's page, the engine
//! in it looks there in each step. A request names the incarnation that it is meant for, so that a successor does not inherit it; one about the
//! start names whom its victims come after.

use crate::page::station as layout;

/// What is done wrong. The first ones concern the thread that makes the steps, the others what it publishes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Mischief {
    /// The thread runs on for ever, at its own priority.
    Spin = 1,
    /// The thread waits for ever.
    Block = 2,
    /// Each step takes longer.
    Slow = 3,
    /// The process ends with code 0, unasked.
    ExitZero = 4,
    /// The process ends with code 1.
    ExitOne = 5,
    /// The thread panics.
    Panic = 6,
    /// Numbers that are none.
    Nan = 7,
    /// Infinite numbers.
    Inf = 8,
    /// Numbers and indices far out of range.
    Range = 9,
    /// The same content again and again, while its stamp goes on.
    Frozen = 10,
    /// The stamp stands still, while the content goes on.
    Stamp = 11,
    /// An old output again and again, as it was.
    Replay = 12,
    /// An epoch that is over.
    Epoch = 13,
    /// Messages of another layout.
    Layout = 14,
    /// Stamps far ahead of their time: an epoch that nobody has won, a tick that is long to come.
    Ahead = 15,
    /// Its states are flawed from now on, and so is what follows from them: whoever else takes the role with one of them dies of it.
    Poison = 16,
    /// Whoever holds the role dies in its next step, whatever state it goes on from.
    Doom = 17,
    /// The process takes memory at a rate, and gives it back only at the end of the request.
    LeakMemory = 18,
    /// It opens files at a rate, and closes them only at the end of the request.
    LeakFiles = 19,
    /// It loans a block of its stream in each step and never sends it.
    LeakLoans = 20,
    /// It takes all the memory that it is allowed.
    Exhaust = 21,
    /// Whoever comes after it in its slot hangs in its start.
    HangStart = 22,
    /// Whoever comes after it in its slot ends with code 1 in its start.
    CrashStart = 23,
}

impl Mischief {
    /// All of them.
    pub const ALL: [Mischief; 23] = [
        Mischief::Spin,
        Mischief::Block,
        Mischief::Slow,
        Mischief::ExitZero,
        Mischief::ExitOne,
        Mischief::Panic,
        Mischief::Nan,
        Mischief::Inf,
        Mischief::Range,
        Mischief::Frozen,
        Mischief::Stamp,
        Mischief::Replay,
        Mischief::Epoch,
        Mischief::Layout,
        Mischief::Ahead,
        Mischief::Poison,
        Mischief::Doom,
        Mischief::LeakMemory,
        Mischief::LeakFiles,
        Mischief::LeakLoans,
        Mischief::Exhaust,
        Mischief::HangStart,
        Mischief::CrashStart,
    ];

    /// Whether it concerns what is published, and not the thread.
    pub fn is_lie(self) -> bool {
        (Mischief::Nan as u8..=Mischief::Ahead as u8).contains(&(self as u8))
    }

    /// Whether it concerns a role, and so the successors of whom is asked.
    pub fn is_lasting(self) -> bool {
        matches!(self, Mischief::Poison | Mischief::Doom)
    }

    /// Whether it takes what the system lends, at a rate or at once: done by an ordinary thread of the process.
    pub fn is_waste(self) -> bool {
        matches!(self, Mischief::LeakMemory | Mischief::LeakFiles | Mischief::Exhaust)
    }

    /// Whether it concerns the start of those who come after the one that is named.
    pub fn is_of_start(self) -> bool {
        matches!(self, Mischief::HangStart | Mischief::CrashStart)
    }
}

/// By which of its outputs a process lies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum Outlet {
    /// All that its steps publish: the message and the cells.
    #[default]
    Steps = 0,
    /// The message of its steps alone: a state, a worker's share.
    State = 1,
    /// What stands in its page for others, alone: a contact model, what a fluid says of the medium, a servo's force, a device's command.
    Cell = 2,
    /// The topology.
    Topology = 3,
    /// The jobs of the collision workers.
    Job = 4,
    /// The stream of what was applied, for the recorder.
    Force = 5,
    /// The answer to who asks how the objects look.
    Appearance = 6,
}

impl Outlet {
    /// All of them.
    pub const ALL: [Outlet; 7] =
        [Outlet::Steps, Outlet::State, Outlet::Cell, Outlet::Topology, Outlet::Job, Outlet::Force, Outlet::Appearance];

    /// Whether who is asked to lie by this one lies by that one.
    pub fn covers(self, by: Outlet) -> bool {
        self == by || self == Outlet::Steps && matches!(by, Outlet::State | Outlet::Cell)
    }
}

/// A thread of an engine that is asked to wait: that of its steps, or one that helps it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum Thread {
    /// That of its steps.
    #[default]
    Steps = 0,
    /// The one that opens the pages and streams of newcomers.
    Usher = 1,
    /// A servo's: it publishes what was applied.
    Drain = 2,
    /// Of who has a state: it writes checkpoints.
    Keeper = 3,
    /// A tissue's: it sends the topology, and says how the objects look.
    Clerk = 4,
}

impl Thread {
    /// All of them.
    pub const ALL: [Thread; 5] = [Thread::Steps, Thread::Usher, Thread::Drain, Thread::Keeper, Thread::Clerk];

    /// What it is called.
    pub fn name(self) -> &'static str {
        match self {
            Thread::Steps => "steps",
            Thread::Usher => "usher",
            Thread::Drain => "drain",
            Thread::Keeper => "keeper",
            Thread::Clerk => "clerk",
        }
    }

    /// Why a process distrusts itself: this thread, which helps it, stands still.
    pub fn standstill(self) -> u64 {
        STANDSTILL + self as u64
    }

    /// The thread that stands still, if that is why.
    pub fn of_standstill(why: u64) -> Option<Thread> {
        let mut helpers = Thread::ALL.into_iter().filter(|thread| *thread != Thread::Steps);
        helpers.find(|thread| thread.standstill() == why)
    }
}

/// Beyond the numbers of [`Distrust`]; a thread's own is added to it.
const STANDSTILL: u64 = 16;

/// Why one process distrusts another's output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Distrust {
    /// Not finite, out of range, or for another input.
    Invalid = 1,
    /// Its stamp stands still.
    Still = 2,
    /// Its force stands still although the tip moves against it.
    Frozen = 3,
    /// It differs from the other replica and is farther from the force last applied.
    Differs = 4,
    /// It did not answer in time.
    Missing = 5,
}

/// A request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    /// What.
    pub what: Mischief,
    /// For whom.
    pub incarnation: u32,
    /// Until when, CLOCK_MONOTONIC ns; 0 is for ever.
    pub until_ns: u64,
    /// [`Mischief::Slow`]: a step takes so many times as long, in hundredths.
    pub factor_percent: u16,
    /// [`Mischief::Slow`]: and so much longer, µs.
    pub extra_us: u32,
    /// [`Mischief::Slow`]: what is added varies by this share of it up and down, in hundredths.
    pub jitter_percent: u16,
    /// [`Mischief::LeakMemory`]: KiB per second; [`Mischief::LeakFiles`]: files per second.
    pub rate_per_s: u32,
    /// What is a lie: by which output.
    pub outlet: Outlet,
    /// [`Mischief::Block`]: which thread.
    pub thread: Thread,
}

impl Request {
    /// One without an end, and without anything that only some take.
    pub fn of(what: Mischief, incarnation: u32) -> Request {
        let (outlet, thread) = (Outlet::Steps, Thread::Steps);
        let (factor_percent, extra_us, jitter_percent, rate_per_s) = (0, 0, 0, 0);
        Request { what, incarnation, until_ns: 0, factor_percent, extra_us, jitter_percent, rate_per_s, outlet, thread }
    }

    /// The words of a request: [`layout::MISCHIEF`], [`layout::MISCHIEF_UNTIL_NS`], [`layout::MISCHIEF_EXTENT`].
    pub fn words(&self) -> [u64; layout::MISCHIEF_WORDS] {
        let what = (self.incarnation as u64) << 32 | self.what as u64;
        let low = match self.what {
            what if what.is_waste() => self.rate_per_s,
            what if what.is_lie() => self.outlet as u32,
            Mischief::Block => self.thread as u32,
            _ => self.extra_us,
        };
        let extent = low as u64 | (self.factor_percent as u64) << 32 | (self.jitter_percent as u64) << 48;
        [what, self.until_ns, extent]
    }

    /// The request in these words that outlasts the one it was made to, if it is one.
    pub fn lasting(words: [u64; layout::MISCHIEF_WORDS]) -> Option<Request> {
        Request::from_words(words, (words[0] >> 32) as u32).filter(|request| request.what.is_lasting())
    }

    /// The request in these words that an incarnation finds in its start, made to one that was in its slot before.
    pub fn of_start(words: [u64; layout::MISCHIEF_WORDS], incarnation: u32) -> Option<Request> {
        let meant = (words[0] >> 32) as u32;
        Request::from_words(words, meant).filter(|request| request.what.is_of_start() && meant < incarnation)
    }

    /// The request in these words, if it is one for this incarnation.
    pub fn from_words(words: [u64; layout::MISCHIEF_WORDS], incarnation: u32) -> Option<Request> {
        let [what, until_ns, extent] = words;
        let what = (what >> 32 == incarnation as u64)
            .then(|| Mischief::ALL.into_iter().find(|known| *known as u64 == what & u32::MAX as u64))??;
        let (low, factor_percent, jitter_percent) = (extent as u32, (extent >> 32) as u16, (extent >> 48) as u16);
        let request = Request { until_ns, factor_percent, jitter_percent, ..Request::of(what, incarnation) };
        Some(match what {
            _ if what.is_waste() => Request { rate_per_s: low, ..request },
            _ if what.is_lie() => Request { outlet: Outlet::ALL.into_iter().find(|outlet| *outlet as u32 == low)?, ..request },
            Mischief::Block => Request { thread: Thread::ALL.into_iter().find(|thread| *thread as u32 == low)?, ..request },
            _ => Request { extra_us: low, ..request },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_is_read_by_whom_it_is_meant_for_and_by_nobody_else() {
        for what in Mischief::ALL {
            let request = Request { until_ns: 9, factor_percent: 450, jitter_percent: 50, ..Request::of(what, 7) };
            let request = match what {
                _ if what.is_waste() => Request { rate_per_s: 70_000, ..request },
                _ if what.is_lie() => Request { outlet: Outlet::Appearance, ..request },
                Mischief::Block => Request { thread: Thread::Clerk, ..request },
                _ => Request { extra_us: 70_000, ..request },
            };
            assert_eq!(Request::from_words(request.words(), 7), Some(request));
            assert_eq!(Request::from_words(request.words(), 8), None);
            assert_eq!(Request::lasting(request.words()).is_some(), matches!(what, Mischief::Poison | Mischief::Doom));
            let first_and_last = [Mischief::Nan, Mischief::Ahead].map(|lie| lie as u8);
            assert_eq!(what.is_lie(), (first_and_last[0]..=first_and_last[1]).contains(&(what as u8)));
            // What concerns a start is read by those who come after, and not by the one that was there.
            let after = [7, 8, 60].map(|incarnation| Request::of_start(request.words(), incarnation).is_some());
            assert_eq!(after, [false, what.is_of_start(), what.is_of_start()]);
        }
        assert_eq!(Request::from_words([0; 3], 0), None);
        assert_eq!(Request::from_words([7 << 32 | 99, 0, 0], 7), None);
        let lie = Request::of(Mischief::Nan, 7).words();
        assert_eq!(Request::from_words([lie[0], 0, 99], 7), None, "by no output that there is");
    }

    #[test]
    fn a_standstill_names_the_thread_and_is_no_distrust_of_another() {
        let helpers = [Thread::Usher, Thread::Drain, Thread::Keeper, Thread::Clerk];
        assert_eq!(helpers.map(|thread| Thread::of_standstill(thread.standstill())), helpers.map(Some));
        assert_eq!(Thread::of_standstill(Thread::Steps.standstill()), None, "that one has a heartbeat");
        for why in [Distrust::Invalid, Distrust::Still, Distrust::Frozen, Distrust::Differs, Distrust::Missing] {
            assert_eq!(Thread::of_standstill(why as u64), None, "{why:?}");
        }
        assert_eq!([0, 7, u64::MAX].map(Thread::of_standstill), [None; 3]);
    }

    #[test]
    fn who_lies_by_its_steps_lies_by_state_and_cell_and_who_lies_by_one_output_by_no_other() {
        for outlet in Outlet::ALL {
            let covered: Vec<Outlet> = Outlet::ALL.into_iter().filter(|by| outlet.covers(*by)).collect();
            match outlet {
                Outlet::Steps => assert_eq!(covered, [Outlet::Steps, Outlet::State, Outlet::Cell]),
                _ => assert_eq!(covered, [outlet]),
            }
        }
    }
}
