//! Room for ordinary threads on the core of a real-time thread that takes most of it.
//!
//! Where ordinary threads that want to run had less than 50 ms of a core within a second, the kernel (its fair server, Linux 6.12 and later) runs them
//! before everything that is real time there, until they had that. Device and servos lost up to 46 ticks in a row so on the core that they share with
//! a tissue which fills it (2-core VM, 2026-11-23). So who takes most of such a core leaves single periods of its own, before the kernel takes
//! them from everybody.
//!
//! Beside another station, or on a machine that is not let run, the time in which it sleeps is not theirs: other real-time threads have it. So an
//! ordinary thread on the same core, the sentinel, says when it last ran, and until it does every second period is left.
//!
//! Promise: over a second the thread sleeps for [`SHARE`] of the time at least, beside what it has saved in 20 ms; while ordinary threads of its core
//! have had nothing for [`STARVED_NS`] it runs in every second period at most, and never in fewer than half of them for that.

use hyst_exchange::system;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Part of the time in which the thread is to sleep: other real-time threads, which are short, take a third of it.
pub const SHARE: f64 = 0.12;
/// So much sleep beyond its share is remembered, ns: a burst of 0.2 s is paid from it.
const MOST_SAVED_NS: f64 = 20e6;
/// So much sleep that is lacking is remembered, ns: one step that took very long is no reason to leave many.
const MOST_OWED_NS: f64 = 3e6;
/// How often the sentinel runs where it may, ns.
const LOOK_NS: u64 = 20_000_000;
/// Ordinary threads that have not run on a core for so long are starved, ns.
pub const STARVED_NS: u64 = 60_000_000;
/// Niceness of the sentinel: it tells whether any ordinary thread may run, and not when its turn would be.
const SENTINEL_NICE: i32 = -20;

/// The account of a thread's sleep.
#[derive(Debug, Default)]
pub struct Room {
    woken_ns: u64,
    ended_ns: u64,
    saved_ns: f64,
    /// The last period was left because ordinary threads were starved.
    left: bool,
    sentinel: Option<Sentinel>,
}

impl Room {
    /// For the calling thread, which is real time and tied to its core.
    pub fn of_this_core() -> Self {
        Self { sentinel: Sentinel::start(), ..Self::default() }
    }

    /// Takes the time of a wake-up; gives whether the period that begins is to be left to ordinary threads.
    pub fn woken(&mut self, now_ns: u64) -> bool {
        if self.woken_ns != 0 {
            let (slept_ns, period_ns) = (now_ns.saturating_sub(self.ended_ns), now_ns.saturating_sub(self.woken_ns));
            self.saved_ns += slept_ns as f64 - SHARE * period_ns as f64;
            self.saved_ns = self.saved_ns.clamp(-MOST_OWED_NS, MOST_SAVED_NS);
        }
        self.woken_ns = now_ns;
        let starved = self.sentinel.as_ref().is_some_and(|sentinel| sentinel.is_starved(now_ns));
        self.left = starved && !self.left;
        self.left || self.saved_ns < 0.0
    }

    /// Takes the time at which the thread goes to sleep.
    pub fn ended(&mut self, now_ns: u64) {
        self.ended_ns = now_ns;
    }
}

/// An ordinary thread on the core of the one that started it, which says when it last ran.
#[derive(Debug)]
struct Sentinel(Arc<AtomicU64>);

impl Sentinel {
    /// `None` where the system gives no more threads: then nobody tells.
    fn start() -> Option<Self> {
        let ran_ns = Arc::new(AtomicU64::new(system::now_ns()));
        let of_thread = Arc::clone(&ran_ns);
        let body = move || {
            system::be_nice(SENTINEL_NICE); // refused without rights: then it speaks for the others
            // Until nobody listens any more.
            while Arc::strong_count(&of_thread) > 1 {
                of_thread.store(system::now_ns(), Ordering::Relaxed);
                system::sleep_ns(LOOK_NS);
            }
        };
        std::thread::Builder::new().name("sentinel".into()).spawn(body).ok().map(|_| Self(ran_ns))
    }

    fn is_starved(&self, now_ns: u64) -> bool {
        now_ns.saturating_sub(self.0.load(Ordering::Relaxed)) > STARVED_NS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    /// Runs so many periods of 1 ms whose steps take this share of them; gives how many were left.
    fn run(room: &mut Room, periods: usize, busy: f64) -> usize {
        let mut now_ns = room.ended_ns.div_ceil(MS).max(1) * MS;
        let mut left = 0;
        for _ in 0..periods {
            let is_left = room.woken(now_ns);
            left += usize::from(is_left);
            room.ended(now_ns + if is_left { 2_000 } else { (busy * MS as f64) as u64 });
            now_ns = room.ended_ns.div_ceil(MS) * MS; // who is late begins with the period after the one in which it ends
        }
        left
    }

    #[test]
    fn who_leaves_enough_leaves_no_period_and_who_fills_its_core_leaves_some() {
        assert_eq!(run(&mut Room::default(), 10_000, 0.85), 0);
        let left = run(&mut Room::default(), 10_000, 0.97);
        // 0.97 of n steps and nothing of the left ones is 0.88 of all: 1 − 0.88/0.97.
        assert!((900..=960).contains(&left), "{left}");
        let left = run(&mut Room::default(), 10_000, 1.0);
        assert!((1_150..=1_250).contains(&left), "{left}");
    }

    #[test]
    fn while_ordinary_threads_are_starved_every_second_period_is_left() {
        let starved = || Sentinel(Arc::new(AtomicU64::new(0)));
        let mut room = Room { sentinel: Some(starved()), ended_ns: 10 * STARVED_NS, ..Room::default() };
        assert_eq!(run(&mut room, 1_000, 0.5), 500);
        let left = run(&mut room, 1_000, 1.0);
        assert!((500..=502).contains(&left), "what is left for them counts as sleep: {left}");
        let fed = Sentinel(Arc::new(AtomicU64::new(u64::MAX)));
        assert_eq!(run(&mut Room { sentinel: Some(fed), ..Room::default() }, 1_000, 0.5), 0);
    }

    #[test]
    fn a_sentinel_that_may_run_is_not_starved_and_ends_with_who_listens_to_it() {
        let room = Room::of_this_core();
        let ran_ns = &room.sentinel.as_ref().expect("a thread").0;
        let (first_ns, limit_ns) = (ran_ns.load(Ordering::Relaxed), system::now_ns() + 10_000_000_000);
        while ran_ns.load(Ordering::Relaxed) < first_ns + STARVED_NS && system::now_ns() < limit_ns {
            std::thread::yield_now();
        }
        assert!(ran_ns.load(Ordering::Relaxed) >= first_ns + STARVED_NS, "it does not run");
        let of_thread = Arc::downgrade(ran_ns);
        drop(room);
        while of_thread.strong_count() > 0 && system::now_ns() < limit_ns {
            std::thread::yield_now();
        }
        assert_eq!(of_thread.strong_count(), 0, "it goes on");
    }

    #[test]
    fn a_burst_is_paid_from_what_was_saved_and_one_long_step_leaves_few_periods() {
        let mut room = Room::default();
        assert_eq!(run(&mut room, 1_000, 0.5), 0);
        assert_eq!(run(&mut room, 150, 0.99), 0, "20 ms last for 180 periods");
        assert!(run(&mut room, 300, 0.99) > 20);
        let mut room = Room::default();
        run(&mut room, 10, 0.88);
        run(&mut room, 1, 500.0);
        assert!(run(&mut room, 100, 0.5) <= 4, "half a second is not made up for");
    }
}
