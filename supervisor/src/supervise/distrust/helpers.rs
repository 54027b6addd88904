//! Engines that say of themselves that a thread that helps them stands still: they hand over what they do and are replaced, as those that grow are. Not as
//! long as such a thread is ready to run and is not let, or waits for the disk or for memory: that is the machine's affair, as it is where the thread of the
//! steps does not beat (`suspicion.rs`), and ends as it does there.

use super::FORGOTTEN_NS;
use crate::mischief::Charge;
use crate::proc::{self, ThreadFiles};
use crate::supervise::Supervisor;
use crate::suspicion::{SILENCE_NS, Thread};
use hyst_messages::Role;
use hyst_messages::mischief::Thread as Helper;
use std::collections::{BTreeMap, BTreeSet};

/// Between two questions to the kernel about the same engine, ns: it is asked about each of its threads.
const ASK_NS: u64 = 100_000_000;
/// A thread that has run for so long without getting on is let run, and runs in vain, ns.
const VAIN_NS: u64 = 100_000_000;
/// Since a thread could get on, its engine must have said so for so long again, ns: some rounds of the slowest helper, its work included.
const ROUNDS_NS: u64 = 300_000_000;
/// What was not said for so long is over, ns: an engine may look but once a second.
const OVER_NS: u64 = 3_000_000_000;

/// The engines that say so, by their incarnations.
#[derive(Debug, Default)]
pub struct Standing {
    told: BTreeSet<u32>,
    excused: BTreeMap<u32, Excuse>,
}

/// One that is not to blame so far.
#[derive(Clone, Copy, Debug)]
struct Excuse {
    since_ns: u64,
    asked_ns: u64,
    /// What its thread had run when it was first seen to be ready to.
    ran_ns: Option<u64>,
    /// Since when it was let run and waited for nothing.
    free_ns: Option<u64>,
}

impl Standing {
    /// Whether one that says so, and said so last at that time, is to be replaced, which is said once; `ask` tells what its threads of that name do.
    fn look(&mut self, incarnation: u32, [now_ns, last_ns]: [u64; 2], ask: impl FnOnce() -> Vec<Thread>) -> bool {
        let before = self.excused.get(&incarnation).copied();
        let is_early = before.is_some_and(|before| now_ns.saturating_sub(before.asked_ns) < ASK_NS);
        if is_early || self.told.contains(&incarnation) {
            return false;
        }
        let threads = ask();
        let ran_of = |thread: &Thread| match thread {
            Thread::Running(ran_ns) => Some(*ran_ns),
            Thread::Stopped | Thread::Sleeping | Thread::Waiting => None,
        };
        let ran_ns = threads.iter().filter_map(ran_of).max();
        let first_ns = before.and_then(|before| before.ran_ns).or(ran_ns);
        let is_starved = ran_ns.zip(first_ns).is_some_and(|(now, first)| now.saturating_sub(first) < VAIN_NS);
        let since_ns = before.map_or(now_ns, |before| before.since_ns);
        let is_excused = is_starved || threads.contains(&Thread::Waiting);
        let free_ns = if is_excused { None } else { before.and_then(|before| before.free_ns).or(Some(now_ns)) };
        // One that has got on since is named no more, and sleeps as it should.
        let stands = free_ns.is_some_and(|free_ns| last_ns.saturating_sub(free_ns) >= ROUNDS_NS);
        let is_said = now_ns.saturating_sub(last_ns) <= FORGOTTEN_NS;
        let is_too_long = is_excused && is_said && now_ns.saturating_sub(since_ns) >= SILENCE_NS;
        if !stands && !is_too_long {
            self.excused.insert(incarnation, Excuse { since_ns, asked_ns: now_ns, ran_ns: first_ns, free_ns });
            return false;
        }
        self.excused.remove(&incarnation);
        self.told.insert(incarnation)
    }
}

/// What those threads of a process do that bear a name.
fn states(process: u32, name: &str) -> Vec<Thread> {
    let comm = |thread: &i32| std::fs::read_to_string(format!("/proc/{process}/task/{thread}/comm")).unwrap_or_default();
    let named = proc::threads(process).into_iter().filter(|thread| comm(thread).trim_end() == name);
    named.filter_map(|thread| ThreadFiles::of_thread(process, thread)?.state()).collect()
}

impl Supervisor {
    /// Replaces those whose helpers stand still: what they make is as good as ever, so that there is time to hand a role over.
    pub(super) fn heed_helpers(&mut self, standstills: Vec<(Charge, Helper)>, now_ns: u64) {
        for (charge, thread) in standstills {
            let (slot, incarnation, name) = (charge.by, charge.incarnation, thread.name());
            if now_ns.saturating_sub(charge.last_ns) > OVER_NS {
                self.distrusted.helpers.excused.remove(&incarnation); // it has got on
                continue;
            }
            let pid = self.viewer.page().pid(slot);
            let times_ns = [now_ns, charge.last_ns];
            if slot.role() == Role::Hardware || !self.distrusted.helpers.look(incarnation, times_ns, || states(pid, name)) {
                continue;
            }
            let (why, reason) = (format!("its {name} stands still"), "a thread that helps it stands still");
            self.replace_unfit(now_ns, (slot, incarnation), &why, name, reason);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Looks ten times a second for so long, s, while the threads do what is said; when it was to be replaced, s.
    fn replaced_after(seconds: u64, threads: impl Fn(u64) -> Vec<Thread>) -> Option<f64> {
        replaced_of(seconds, u64::MAX, threads)
    }

    /// The same of one that says so for so many tenths of a second alone.
    fn replaced_of(seconds: u64, said_for: u64, threads: impl Fn(u64) -> Vec<Thread>) -> Option<f64> {
        let mut standing = Standing::default();
        let at_ns = |tenth: u64| 5_000_000_000 + tenth * ASK_NS;
        let looks = |tenth: u64| {
            let times_ns = [at_ns(tenth), at_ns(tenth.min(said_for))];
            standing.look(7, times_ns, || threads(tenth)).then_some(tenth as f64 / 10.0)
        };
        let said: Vec<f64> = (0..10 * seconds).filter_map(looks).collect();
        assert!(said.len() <= 1, "it is said once: {said:?}");
        said.first().copied()
    }

    #[test]
    fn one_whose_helper_sleeps_or_is_gone_is_replaced_after_some_rounds_and_told_of_once() {
        for threads in [vec![Thread::Sleeping], vec![Thread::Stopped], vec![], vec![Thread::Sleeping, Thread::Sleeping]] {
            assert_eq!(replaced_after(60, |_| threads.clone()), Some(0.3), "{threads:?}");
        }
    }

    #[test]
    fn one_whose_helper_is_not_let_run_or_waits_for_the_machine_is_not_to_blame_for_long() {
        let silence_s = SILENCE_NS as f64 / 1e9;
        assert_eq!(replaced_after(60, |_| vec![Thread::Running(9_000_000)]), Some(silence_s), "ready, and not let run");
        assert_eq!(replaced_after(60, |_| vec![Thread::Waiting]), Some(silence_s));
        // Of two that bear the name, one sleeps as it should.
        assert_eq!(replaced_after(19, |_| vec![Thread::Sleeping, Thread::Running(9_000_000)]), None);
        // It waited, and then slept.
        assert_eq!(replaced_after(60, |tenth| vec![if tenth < 30 { Thread::Waiting } else { Thread::Sleeping }]), Some(3.3));
    }

    /// Its engine names it no more once it gets on, and half a second later that is known.
    #[test]
    fn one_whose_helper_was_starved_and_gets_on_is_not_replaced() {
        let threads = |tenth: u64| vec![if tenth < 30 { Thread::Running(9_000_000) } else { Thread::Sleeping }];
        for said_for in [29, 30, 31] {
            assert_eq!(replaced_of(60, said_for, threads), None, "{said_for}");
        }
    }

    #[test]
    fn one_whose_helper_runs_in_vain_is_replaced_once_that_is_known() {
        // It has half of a core; for the first second it had none, and had run for long before.
        let ran = |tenth: u64| vec![Thread::Running(77_000_000_000 + 50_000_000 * tenth.saturating_sub(10))];
        assert_eq!(replaced_after(60, ran), Some(1.5));
    }

    #[test]
    fn the_kernel_is_asked_no_more_often_than_is_needed() {
        let mut standing = Standing::default();
        let asked = std::cell::Cell::new(0);
        let ask = || {
            asked.set(asked.get() + 1);
            vec![Thread::Waiting]
        };
        for look in 0..1_000 {
            assert!(!standing.look(7, [look * 1_000_000; 2], ask), "within a second");
        }
        assert_eq!(asked.get(), 10);
    }

    #[test]
    fn the_threads_of_a_name_are_found() {
        let (begun, begins) = std::sync::mpsc::channel();
        let (end, ends) = std::sync::mpsc::channel::<()>();
        let body = move || {
            begun.send(()).unwrap();
            let _ = ends.recv(); // until the other end is gone
        };
        let helper = std::thread::Builder::new().name("a-helper".into()).spawn(body).unwrap();
        begins.recv().unwrap();
        let me = std::process::id();
        assert_eq!((states(me, "a-helper").len(), states(me, "nobody").len()), (1, 0));
        drop(end);
        helper.join().unwrap();
    }
}
