//! The threads that help an engine (usher, drain, keeper, clerk), watched by the thread of its steps, whose own heartbeat the supervisor watches. One that
//! stands still is named in the engine's page, and the supervisor has the process hand over what it does and replaces it. When one could last open nothing stands
//! there, too.
//!
//! Promise: a look costs two loads for each helper, takes no lock, allocates nothing and waits for nobody. Time counts only while the engine itself comes to
//! look: one that was stopped, or whose host stalled, blames nobody for that time.

use crate::life::Life;
use hyst_exchange::{Rounds, system};
use hyst_messages::mischief::Thread;
use hyst_messages::page::header;

/// A helper that has not got on for so long, as far as it counts, stands still, ns. The slowest comes round ten times a second, and the longest that one was
/// seen to take for a single thing is 138 ms, for a newcomer's 50 MB on full cores; an ordinary thread gets its turn there many times in so long a time.
pub const STANDSTILL_NS: u64 = 5_000_000_000;
/// Most of the time between two looks that counts, ns: no more than the slowest helper's round. An engine that looks more seldom finds it after 50 looks.
const MOST_COUNTED_NS: u64 = 100_000_000;

/// A thread that helps an engine.
#[derive(Clone, Debug)]
pub struct Helper {
    /// Which.
    pub thread: Thread,
    /// How often it has got on.
    pub rounds: Rounds,
}

impl Helper {
    /// A helper of this name with these rounds.
    pub fn new(thread: Thread, rounds: Rounds) -> Helper {
        Helper { thread, rounds }
    }

    /// An usher, which each engine has.
    pub fn usher(rounds: Rounds) -> Helper {
        Helper::new(Thread::Usher, rounds)
    }
}

/// All that help one engine.
#[derive(Debug, Default)]
pub struct Helpers {
    watched: Vec<Watched>,
    looked_ns: Option<u64>,
    /// When one of them could last open nothing, as far as it was told, ns.
    without_file_ns: u64,
}

#[derive(Debug)]
struct Watched {
    helper: Helper,
    /// Its rounds at the last look.
    seen: u64,
    /// For how long it has not got on since, as far as it counts, ns.
    stood_ns: u64,
}

impl Helpers {
    /// Those of an engine; they are not watched before the first look.
    pub fn of(helpers: impl IntoIterator<Item = Helper>) -> Helpers {
        let watched = |helper: Helper| Watched { seen: helper.rounds.count(), stood_ns: 0, helper };
        Helpers { watched: helpers.into_iter().map(watched).collect(), ..Helpers::default() }
    }

    /// To be called in each step: says in the page which of them stands still, as long as it does, and when one could open nothing.
    pub fn look(&mut self, life: &Life) {
        if let Some(thread) = self.standing(system::now_ns()) {
            life.name_helper(thread);
        }
        if let Some(at_ns) = self.without_file() {
            life.page.store64(header::UNOPENED_NS, at_ns);
        }
    }

    /// When one of them could last open nothing, if that is news, ns.
    fn without_file(&mut self) -> Option<u64> {
        let newest_ns = self.watched.iter().map(|watched| watched.helper.rounds.without_file_ns()).max().unwrap_or(0);
        let before_ns = std::mem::replace(&mut self.without_file_ns, newest_ns);
        (newest_ns > before_ns).then_some(newest_ns)
    }

    /// A look at a time: one that stands still.
    fn standing(&mut self, now_ns: u64) -> Option<Thread> {
        let before_ns = self.looked_ns.replace(now_ns).unwrap_or(now_ns);
        let counted_ns = now_ns.saturating_sub(before_ns).min(MOST_COUNTED_NS);
        for watched in &mut self.watched {
            let rounds = watched.helper.rounds.count();
            let stands = rounds == watched.seen;
            watched.seen = rounds;
            watched.stood_ns = if stands { watched.stood_ns.saturating_add(counted_ns) } else { 0 };
        }
        self.watched.iter().find(|watched| watched.stood_ns >= STANDSTILL_NS).map(|watched| watched.helper.thread)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK_NS: u64 = 1_000_000;

    /// An engine with two helpers, its clock, and who was said to stand still at its last look.
    struct Engine {
        rounds: [Rounds; 2],
        helpers: Helpers,
        now_ns: u64,
        said: Option<Thread>,
    }

    impl Engine {
        fn new() -> Engine {
            let rounds = [Rounds::default(), Rounds::default()];
            let helpers =
                [(Thread::Usher, &rounds[0]), (Thread::Keeper, &rounds[1])].map(|(thread, own)| Helper::new(thread, own.clone()));
            Engine { helpers: Helpers::of(helpers), rounds, now_ns: 7_000_000_000, said: None }
        }

        /// So many looks, so far apart, before each of which those helpers get on.
        fn looks(&mut self, count: u64, apart_ns: u64, get_on: &[usize]) -> Option<Thread> {
            for _ in 0..count {
                self.now_ns += apart_ns;
                get_on.iter().for_each(|index| self.rounds[*index].pass());
                self.said = self.helpers.standing(self.now_ns);
            }
            self.said
        }
    }

    #[test]
    fn a_helper_that_stands_still_is_named_after_the_bound_and_for_as_long_as_it_does() {
        for (index, thread) in [Thread::Usher, Thread::Keeper].into_iter().enumerate() {
            let mut engine = Engine::new();
            let others = [1 - index];
            assert_eq!(engine.looks(STANDSTILL_NS / TICK_NS, TICK_NS, &others), None, "{thread:?}");
            assert_eq!(engine.looks(1, TICK_NS, &others), Some(thread));
            assert_eq!(engine.looks(3_000, TICK_NS, &others), Some(thread));
            assert_eq!(engine.looks(1, TICK_NS, &[0, 1]), None, "it has got on");
            assert_eq!(engine.looks(STANDSTILL_NS / TICK_NS - 1, TICK_NS, &others), None, "and begins anew");
        }
    }

    #[test]
    fn helpers_that_get_on_now_and_then_are_never_named_however_often_one_looks() {
        for apart_ns in [50_000, TICK_NS, 33 * TICK_NS, MOST_COUNTED_NS] {
            let mut engine = Engine::new();
            for _ in 0..20 {
                let most = STANDSTILL_NS / apart_ns - 1;
                assert_eq!(engine.looks(most, apart_ns, &[]), None, "{apart_ns}");
                assert_eq!(engine.looks(1, apart_ns, &[0, 1]), None, "{apart_ns}");
            }
        }
    }

    /// SIGSTOP, a debugger, a host that stalls: nobody has got on, because nobody could.
    #[test]
    fn time_in_which_the_engine_itself_did_not_run_counts_for_nobody() {
        let mut engine = Engine::new();
        engine.looks(100, TICK_NS, &[0, 1]);
        assert_eq!(engine.looks(1, 3_600_000_000_000, &[]), None, "an hour");
        assert_eq!(engine.looks(1, TICK_NS, &[0, 1]), None);
        // It is stopped for a second again and again, and its helpers get on each time that it is not.
        for _ in 0..100 {
            assert_eq!(engine.looks(1, 1_000_000_000, &[]), None);
            assert_eq!(engine.looks(5, TICK_NS, &[0, 1]), None);
        }
        // A clock that goes back is none of theirs.
        engine.now_ns -= 1_000_000_000;
        assert_eq!(engine.looks(10, TICK_NS, &[]), None);
    }

    /// Pictures of a slow driver come once in a second: a tenth of that counts, and who stands still is found all the same.
    #[test]
    fn an_engine_that_looks_seldom_finds_it_later() {
        let mut engine = Engine::new();
        let looks = STANDSTILL_NS / MOST_COUNTED_NS;
        assert_eq!(engine.looks(looks, 1_000_000_000, &[0]), None);
        assert_eq!(engine.looks(1, 1_000_000_000, &[0]), Some(Thread::Keeper));
    }

    #[test]
    fn an_engine_without_helpers_names_nobody() {
        let mut helpers = Helpers::default();
        assert_eq!([1, STANDSTILL_NS, 9 * STANDSTILL_NS].map(|now_ns| helpers.standing(now_ns)), [None; 3]);
        assert_eq!(helpers.without_file(), None);
    }

    /// Who could open no file met no newcomer meanwhile, and nobody was told.
    #[test]
    fn that_a_helper_could_open_nothing_is_told_once_each_time() {
        let mut engine = Engine::new();
        assert_eq!(engine.helpers.without_file(), None);
        engine.rounds[1].want_file(70);
        engine.rounds[0].want_file(50);
        assert_eq!([(); 2].map(|()| engine.helpers.without_file()), [Some(70), None]);
        engine.rounds[0].want_file(90);
        assert_eq!(engine.helpers.without_file(), Some(90));
    }
}
