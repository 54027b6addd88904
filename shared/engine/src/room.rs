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
//! How much of a period that is left the others have, who are real time too, is known by how long the thread waits for its core when it wants to run: where a
//! slow machine gave them half of it, an eighth of a second held less than the kernel asks for, and the hand lost 50 to 52 ticks three times in 280 faults
//! (2-core VM, 2026-11-27).
//!
//! Nor is the time theirs in which the thread waits within its step: those that it waits for are real time too, and on two cores one of them has its core then.
//! Counted as left it was most of what was to be left, and while the electrode cut the hand lost 24 and 32 ticks in 2 of 168 faults (the same day).
//!
//! Promise: of each second ordinary threads of its core can have [`SHARE`] at least, beside what they were saved in 20 ms; while they have had nothing for
//! [`STARVED_NS`] the thread runs in every second period at most, and never in fewer than half of them for that.

use hyst_exchange::system;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Part of the time that is left to ordinary threads: the kernel asks for a twentieth.
pub const SHARE: f64 = 0.08;
/// Part that others who are real time are taken to have where the kernel does not say.
const USUAL_OTHERS: f64 = 1.0 / 3.0;
/// What a period counts for after the next one, when it is judged how much others have: a tenth of a second back.
const MEMORY: f64 = 0.99;
/// So much beyond the share is remembered, ns: a burst of 0.2 s is paid from it.
const MOST_SAVED_NS: f64 = 20e6;
/// So much that is lacking is remembered, ns: one step that took very long is no reason to leave many periods.
const MOST_OWED_NS: f64 = 3e6;
/// Periods that are left in a row, at most. Where others have nearly all of the core, what is left is theirs and hardly ever enough: by the account of one who
/// waits for 0.95 of each period 32 in a row were left, and 50 that are missing cost a tissue its role.
const MOST_IN_A_ROW: u32 = 8;
/// How often the sentinel runs where it may, ns.
const LOOK_NS: u64 = 20_000_000;
/// Ordinary threads that have not run on a core for so long are starved, ns.
pub const STARVED_NS: u64 = 60_000_000;
/// Niceness of the sentinel: it tells whether any ordinary thread may run, and not when its turn would be.
const SENTINEL_NICE: i32 = -20;

/// What a thread has had of its core, and waited for it while it wanted to run, so far, ns; the second where the kernel says it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Ran {
    on_core_ns: u64,
    queued_ns: Option<u64>,
}

/// The account of what a thread leaves of its core.
#[derive(Debug, Default)]
pub struct Room {
    woken_ns: u64,
    /// When the last turn ended; 0 where nobody has said it.
    rested_ns: u64,
    before: Ran,
    /// What it had and what it waited for, periods of long ago counting less.
    lately_ns: [f64; 2],
    saved_ns: f64,
    /// The last period was left because ordinary threads were starved.
    left: bool,
    /// Periods in a row that were left, up to now.
    row: u32,
    /// Where the kernel says what the calling thread has had.
    ledger: Option<File>,
    sentinel: Option<Sentinel>,
}

impl Room {
    /// For the calling thread, which is real time and tied to its core.
    pub fn of_this_core() -> Self {
        Self { sentinel: Sentinel::start(), ..Self::of_this_thread() }
    }

    /// For the calling thread, without a sentinel.
    pub fn of_this_thread() -> Self {
        Self { ledger: File::open("/proc/thread-self/schedstat").ok(), ..Self::default() }
    }

    /// Takes the time of a wake-up; gives whether the period that begins is to be left to ordinary threads.
    pub fn woken(&mut self, now_ns: u64) -> bool {
        let ran = self.ledger.as_ref().and_then(ran);
        self.account(now_ns, ran.unwrap_or_else(|| Ran { on_core_ns: system::thread_ns(), queued_ns: None }))
    }

    /// What [`Self::woken`] does, with what the thread has had.
    fn account(&mut self, now_ns: u64, ran: Ran) -> bool {
        let before = std::mem::replace(&mut self.before, ran);
        if self.woken_ns != 0 {
            let since = |now: u64, before: u64| now.saturating_sub(before) as f64;
            let (period_ns, on_core_ns) = (since(now_ns, self.woken_ns), since(ran.on_core_ns, before.on_core_ns));
            let queued_ns = ran.queued_ns.zip(before.queued_ns).map(|(now, before)| since(now, before));
            if let Some(queued_ns) = queued_ns {
                let [had_ns, waited_ns] = self.lately_ns;
                self.lately_ns = [MEMORY * had_ns + on_core_ns, MEMORY * waited_ns + queued_ns];
            }
            let turn_ns = since(self.rested_ns, self.woken_ns);
            let idle_ns = (period_ns - turn_ns.max(on_core_ns + queued_ns.unwrap_or(0.0))).max(0.0);
            self.saved_ns += idle_ns * (1.0 - self.others()) - SHARE * period_ns;
            self.saved_ns = self.saved_ns.clamp(-MOST_OWED_NS, MOST_SAVED_NS);
        }
        self.woken_ns = now_ns;
        let starved = self.sentinel.as_ref().is_some_and(|sentinel| sentinel.is_starved(now_ns));
        self.left = starved && !self.left;
        let leaves = self.left || self.saved_ns < 0.0 && self.row < MOST_IN_A_ROW;
        self.row = if leaves { self.row + 1 } else { 0 };
        leaves
    }

    /// The thread has another core from now on, on which others may have less or more.
    pub fn moves(&mut self) {
        self.lately_ns = [0.0; 2];
    }

    /// The turn that began with the last wake-up has ended: from now on nobody works for the thread.
    pub fn rests(&mut self, now_ns: u64) {
        self.rested_ns = now_ns;
    }

    /// Part of its core that others have who go before it: of the time in which it wanted to run, that in which it waited.
    fn others(&self) -> f64 {
        let [on_core_ns, queued_ns] = self.lately_ns;
        let wanted_ns = on_core_ns + queued_ns;
        if wanted_ns > 0.0 { queued_ns / wanted_ns } else { USUAL_OTHERS }
    }
}

/// What the kernel says of a thread: time on a core, time in its queue.
fn ran(ledger: &File) -> Option<Ran> {
    let mut bytes = [0u8; 96];
    let length = ledger.read_at(&mut bytes, 0).ok()?;
    let mut numbers =
        std::str::from_utf8(&bytes[..length]).ok()?.split_ascii_whitespace().map_while(|number| number.parse().ok());
    Some(Ran { on_core_ns: numbers.next()?, queued_ns: Some(numbers.next()?) })
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

    /// A thread with a period of 1 ms.
    struct Thread {
        room: Room,
        now_ns: u64,
        ran: Ran,
    }

    impl Thread {
        fn of(room: Room) -> Thread {
            Thread { room, now_ns: 10 * STARVED_NS, ran: Ran { on_core_ns: 0, queued_ns: Some(0) } }
        }

        /// So many periods whose steps take these shares of them, on the core and waiting for it; gives how many were left.
        fn run(&mut self, periods: usize, [busy, queued]: [f64; 2]) -> usize {
            let ns = |share: f64| (share * MS as f64) as u64;
            let mut left = 0;
            for _ in 0..periods {
                let is_left = self.room.account(self.now_ns, self.ran);
                left += usize::from(is_left);
                let [on_core_ns, queued_ns] = if is_left { [2_000, 0] } else { [ns(busy), ns(queued)] };
                self.ran.on_core_ns += on_core_ns;
                self.ran.queued_ns = self.ran.queued_ns.map(|before| before + queued_ns);
                // Who is late begins with the period after the one in which it ends.
                self.now_ns += (on_core_ns + queued_ns).div_ceil(MS).max(1) * MS;
            }
            left
        }
    }

    #[test]
    fn who_leaves_enough_leaves_no_period_and_who_fills_its_core_leaves_some() {
        let left = |busy: f64| Thread::of(Room::default()).run(10_000, [busy, 0.0]);
        assert_eq!(left(0.85), 0);
        // 0.97 of n steps and nothing of the left ones is 0.92 of all: 1 − 0.92/0.97.
        assert!((490..=545).contains(&left(0.97)), "{}", left(0.97));
        assert!((770..=830).contains(&left(1.0)), "{}", left(1.0));
    }

    #[test]
    fn what_others_have_of_a_left_period_is_not_left_to_ordinary_threads() {
        let left = |shares: [f64; 2]| Thread::of(Room::default()).run(10_000, shares);
        assert_eq!(left([0.88, 0.0]), 0);
        assert_eq!(left([0.60, 0.28]), 0, "of the 0.12 that are left they have a third");
        // They have half: of n periods of which L are left 0.12 (n − L) + L are idle, and half of that is 0.08 n. L = 0.04 n / 0.88.
        assert!((430..=480).contains(&left([0.44, 0.44])), "{}", left([0.44, 0.44]));
        let all = left([0.50, 0.50]);
        assert!((1_560..=1_640).contains(&all), "{all}");
    }

    #[test]
    fn who_waited_for_nearly_all_of_a_core_is_not_kept_from_his_turns_by_that() {
        let rows = |moves: bool| {
            let mut thread = Thread::of(Room::default());
            thread.run(1_000, [0.05, 0.95]);
            if moves {
                thread.room.moves();
            }
            let left: Vec<usize> = (0..500).map(|_| thread.run(1, [0.6, 0.0])).collect();
            let longest = left.split(|left| *left == 0).map(<[usize]>::len).max();
            (longest.unwrap_or(0), left.iter().sum::<usize>())
        };
        let ((longest, left), (longest_moved, left_moved)) = (rows(false), rows(true));
        assert_eq!(longest, MOST_IN_A_ROW as usize, "{left} of 500");
        assert!(longest_moved <= longest && left_moved < left, "{longest_moved} in a row, {left_moved} beside {left}");
    }

    #[test]
    fn a_wait_within_a_turn_leaves_nothing_to_ordinary_threads() {
        let left = |turn: f64| {
            let (mut room, mut ran, mut now_ns, mut left) = (Room::default(), Ran { on_core_ns: 0, queued_ns: Some(0) }, MS, 0);
            for _ in 0..10_000 {
                let is_left = room.account(now_ns, ran);
                left += usize::from(is_left);
                // Two thirds of its turn are its own.
                let turn_ns = if is_left { 0.0 } else { turn * MS as f64 };
                ran.on_core_ns += (turn_ns / 1.5) as u64;
                room.rests(now_ns + turn_ns as u64);
                now_ns += MS;
            }
            left
        };
        assert_eq!(left(0.85), 0);
        assert!((490..=545).contains(&left(0.97)), "as one that works all the time: {}", left(0.97));
    }

    #[test]
    fn where_the_kernel_does_not_say_others_are_taken_to_have_a_third_and_no_more_periods_are_left_than_that_asks_for() {
        let left = |busy: f64| {
            let ran = Ran { on_core_ns: 0, queued_ns: None };
            Thread { ran, ..Thread::of(Room::default()) }.run(10_000, [busy, 0.0])
        };
        assert_eq!(left(0.85), 0);
        assert!((1_150..=1_250).contains(&left(1.0)), "0.08 is two thirds of 0.12: {}", left(1.0));
    }

    #[test]
    fn the_kernel_says_what_a_thread_has_had() {
        let ledger = File::open("/proc/thread-self/schedstat").expect("a kernel that keeps it");
        let first = ran(&ledger).expect("two numbers");
        while ran(&ledger) == Some(first) {}
        assert!(ran(&ledger).unwrap().on_core_ns > first.on_core_ns);
    }

    #[test]
    fn while_ordinary_threads_are_starved_every_second_period_is_left() {
        let starved = || Sentinel(Arc::new(AtomicU64::new(0)));
        let mut thread = Thread::of(Room { sentinel: Some(starved()), ..Room::default() });
        assert_eq!(thread.run(1_000, [0.5, 0.0]), 500);
        let left = thread.run(1_000, [1.0, 0.0]);
        assert!((500..=502).contains(&left), "what is left for them counts: {left}");
        let fed = Sentinel(Arc::new(AtomicU64::new(u64::MAX)));
        assert_eq!(Thread::of(Room { sentinel: Some(fed), ..Room::default() }).run(1_000, [0.5, 0.0]), 0);
    }

    #[test]
    fn a_sentinel_that_may_run_is_not_starved_and_ends_with_who_listens_to_it() {
        let room = Room::of_this_core();
        let ran_ns = &room.sentinel.as_ref().expect("a thread").0;
        let (first_ns, limit_ns) = (ran_ns.load(Ordering::Relaxed), system::now_ns() + 60_000_000_000);
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
        let mut thread = Thread::of(Room::default());
        assert_eq!(thread.run(1_000, [0.5, 0.0]), 0);
        assert_eq!(thread.run(250, [0.99, 0.0]), 0, "20 ms last for 280 periods");
        assert!(thread.run(500, [0.99, 0.0]) > 20);
        let mut thread = Thread::of(Room::default());
        thread.run(10, [0.92, 0.0]);
        thread.run(1, [500.0, 0.0]);
        assert!(thread.run(100, [0.5, 0.0]) <= 4, "half a second is not made up for");
    }
}
