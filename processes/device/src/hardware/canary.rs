//! The canaries: one thread on each core, above everything of the station, that sleeps for a part of a tick and looks how late it was woken.
//! What wakes it late is the host, which did not run this machine: its timer came late. Ticks in that time are void in both arms of every comparison.
//! Where the timer came in time and the canary then waited for its core, the kernel was busy for somebody or gave the core to ordinary tasks (its fair
//! server), and that may be the station's own doing: the wait in the kernel's queue is subtracted, and such ticks count.

use hyst_engine::{Failure, Life, realtime};
use hyst_exchange::system;
use hyst_messages::page::hardware::{TOTALS, Total};
use hyst_messages::{Role, Slot, TICK_NS};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Lateness above which the host is said to have stalled, ns: four times the p99 of an idle machine (measured: 52 µs), and what a tick has to
/// spare. Of 25 misses in 500 s and 200 faults that stalls of 0.5 ms did not explain, 24 had a canary late by 0.2 to 0.5 ms at most 2 ms before them. Of 25
/// deaths of rendering 99 late ticks had a canary that waited in the kernel's queue, and 1 in their controls: those are no stalls of the host.
pub const STALL_NS: u64 = 200_000;
/// Between two looks, ns: a stall that begins and ends in a canary's sleep is seen only by what it exceeds it. To be woken so often takes 5 % of
/// a core of a virtual machine.
const SLEEP_NS: u64 = TICK_NS / 4;
/// The same where no fault is injected, and less depends on what is void.
const LONG_SLEEP_NS: u64 = TICK_NS / 2;
/// Stalls that one canary remembers: for the 64 ticks that an entry of the ledger waits.
const MEMORY: usize = 256;

/// The stalls that one canary remembers. Its thread writes them while that of the ledger reads: neither waits for the other.
struct Stalls {
    /// Begin and end of the last stalls, ns; a begin of 0 is none.
    windows: [[AtomicU64; 2]; MEMORY],
}

impl Stalls {
    fn none() -> Stalls {
        Stalls { windows: [const { [const { AtomicU64::new(0) }; 2] }; MEMORY] }
    }

    /// Remembers the stall of this number, in the place of the one [`MEMORY`] before it; for the canary's thread alone.
    fn remember(&self, number: usize, begin_ns: u64, end_ns: u64) {
        let [begin, end] = &self.windows[number % MEMORY];
        begin.store(0, Ordering::Relaxed); // before the end: who reads the new end finds that the old begin is gone
        end.store(end_ns, Ordering::Release);
        begin.store(begin_ns, Ordering::Release); // after the end: who reads the new begin reads no older end
    }

    /// Whether one of them meets a time. One that is being written is none: its begin is 0, or another than it was before the end was read.
    fn meet(&self, from_ns: u64, to_ns: u64) -> bool {
        self.windows.iter().any(|[begin, end]| {
            let begin_ns = begin.load(Ordering::Acquire);
            let end_ns = end.load(Ordering::Acquire);
            begin_ns != 0 && begin_ns <= to_ns && end_ns >= from_ns && begin.load(Ordering::Relaxed) == begin_ns
        })
    }
}

/// The canaries of all cores.
pub struct Canaries {
    stalls: Vec<Arc<Stalls>>,
    stop: Arc<AtomicBool>,
}

impl Canaries {
    /// Starts one for each core. Without the right to real time there is none: an ordinary thread's lateness proves nothing.
    pub fn start(life: &Life) -> Result<Canaries, Failure> {
        let stop = Arc::new(AtomicBool::new(false));
        let mut stalls = Vec::new();
        let wanted = life.settings.switch("realtime", true)?;
        let sleep_ns = if life.clock.test_mode() { SLEEP_NS } else { LONG_SLEEP_NS };
        let cores = system::places();
        for core in 0..cores.min(if wanted { 64 } else { 0 }) {
            let mine = Arc::new(Stalls::none());
            stalls.push(Arc::clone(&mine));
            let stop = Arc::clone(&stop);
            let of_device = (realtime::core(Slot::first(Role::Device), cores) == Some(core)).then(|| Arc::clone(&life.page));
            let tell = move |stood_ns| of_device.iter().for_each(|page| page.add64(TOTALS + Total::Stood as usize, stood_ns));
            std::thread::Builder::new()
                .name(format!("canary-{core}"))
                .spawn(move || watch(core, sleep_ns, &mine, &stop, tell))?;
        }
        Ok(Canaries { stalls, stop })
    }

    /// Whether any core stalled within a time.
    pub fn stalled(&self, from_ns: u64, to_ns: u64) -> bool {
        self.stalls.iter().any(|stalls| stalls.meet(from_ns, to_ns))
    }
}

impl Drop for Canaries {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
    }
}

/// What a thread has waited for a core while it was ready to run, so far.
struct Queue(Option<File>);

impl Queue {
    fn of_this_thread() -> Queue {
        Queue(File::open("/proc/thread-self/schedstat").ok())
    }

    /// ns; 0 where the kernel does not say.
    fn waited_ns(&self) -> u64 {
        let mut bytes = [0u8; 96];
        let Some(length) = self.0.as_ref().and_then(|file| file.read_at(&mut bytes, 0).ok()) else { return 0 };
        let text = std::str::from_utf8(&bytes[..length]).unwrap_or("");
        text.split_whitespace().nth(1).and_then(|number| number.parse().ok()).unwrap_or(0)
    }
}

/// For how long the host stood, ns: so long after it was due a canary was woken, but for what of that it waited for its core in the kernel's queue.
/// `None` of what is no stall.
fn stood_ns(due_ns: u64, woken_ns: u64, queued_ns: u64) -> Option<u64> {
    let stood_ns = woken_ns.saturating_sub(due_ns).saturating_sub(queued_ns);
    (stood_ns > STALL_NS).then_some(stood_ns)
}

fn watch(core: usize, sleep_ns: u64, stalls: &Stalls, stop: &AtomicBool, tell: impl Fn(u64)) {
    if !(system::pin_to_core(core) && system::become_fifo(realtime::CANARY_PRIORITY)) {
        return;
    }
    let queue = Queue::of_this_thread();
    let (mut next, mut waited_ns) = (0, queue.waited_ns());
    while !stop.load(Ordering::Acquire) {
        let due_ns = system::now_ns() + sleep_ns;
        system::sleep_until_ns(due_ns);
        let woken_ns = system::now_ns();
        let queued_ns = queue.waited_ns().saturating_sub(waited_ns);
        waited_ns += queued_ns;
        if let Some(stood_ns) = stood_ns(due_ns, woken_ns, queued_ns) {
            tell(stood_ns);
            stalls.remember(next, due_ns, woken_ns);
            next += 1;
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A canary for each of these lists of stalls, begin and end, ns; no thread.
    pub(crate) fn canaries(seen: &[&[(u64, u64)]]) -> Canaries {
        let of_core = |seen: &&[(u64, u64)]| {
            let stalls = Stalls::none();
            seen.iter().enumerate().for_each(|(number, (begin_ns, end_ns))| stalls.remember(number, *begin_ns, *end_ns));
            Arc::new(stalls)
        };
        Canaries { stalls: seen.iter().map(of_core).collect(), stop: Arc::new(AtomicBool::new(false)) }
    }

    #[test]
    fn what_a_canary_waited_in_the_kernels_queue_is_no_stall_of_the_host() {
        const DUE_NS: u64 = 7_000_000;
        let stood = |late_ns: u64, queued_ns: u64| stood_ns(DUE_NS, DUE_NS + late_ns, queued_ns);
        assert_eq!([0, STALL_NS, STALL_NS + 1].map(|late_ns| stood(late_ns, 0)), [None, None, Some(STALL_NS + 1)]);
        assert_eq!(stood(34_000_000, 34_000_000), None, "its timer came in time, and others had the core");
        assert_eq!(stood(34_000_000, 34_000_000 - STALL_NS), None);
        assert_eq!(stood(34_000_000, 33_999_999 - STALL_NS), Some(STALL_NS + 1), "what is left of it was the host");
        assert_eq!(stood_ns(DUE_NS, DUE_NS - 1, 0), None, "woken early");
        assert_eq!(stood(300_000, 400_000), None, "it waited in the queue before it was due, too");
    }

    #[test]
    fn a_time_is_stalled_if_a_stall_of_any_core_touches_it() {
        let both = canaries(&[&[(1_000, 2_000), (9_000, 9_500)], &[(5_000, 6_000)]]);
        let stalled = |times: &[(u64, u64)]| times.iter().map(|(from, to)| both.stalled(*from, *to)).collect::<Vec<_>>();
        assert_eq!(stalled(&[(0, 1_000), (2_000, 3_000), (1_400, 1_500), (0, 3_000)]), [true; 4], "its ends, in it, around it");
        assert_eq!(stalled(&[(0, 999), (2_001, 4_999), (6_001, 8_999), (9_501, u64::MAX)]), [false; 4]);
        assert_eq!(stalled(&[(5_000, 5_000), (6_000, 6_000), (9_500, 9_500)]), [true; 3], "of the other core; another");
        assert!(!canaries(&[]).stalled(0, u64::MAX) && !canaries(&[&[], &[]]).stalled(0, u64::MAX), "nobody saw one");
    }

    #[test]
    fn the_last_stalls_are_remembered_and_those_before_them_forgotten() {
        let seen: Vec<(u64, u64)> = (1..=MEMORY as u64 + 1).map(|number| (1_000 * number, 1_000 * number + 10)).collect();
        let (full, one_more) = (canaries(&[&seen[..MEMORY]]), canaries(&[&seen]));
        let is_known = |canaries: &Canaries, number: u64| canaries.stalled(1_000 * number, 1_000 * number + 10);
        assert_eq!([1, MEMORY as u64].map(|number| is_known(&full, number)), [true; 2]);
        assert_eq!([1, 2, MEMORY as u64 + 1].map(|number| is_known(&one_more, number)), [false, true, true]);
    }

    /// Of the old begin and the new end it would take all that lies between the two for a stall.
    #[test]
    fn who_looks_while_a_stall_is_written_over_another_takes_none_of_it_for_one() {
        const ROUNDS: u64 = 300_000;
        let stalls = Stalls::none();
        stalls.remember(0, 1, u64::MAX);
        assert!(stalls.meet(5, 5));
        stalls.windows[0][0].store(0, Ordering::Relaxed);
        assert!(!stalls.meet(5, 5), "it has no begin yet");
        std::thread::scope(|scope| {
            // One long before the time that is asked for, and one long after it, in one place; no two begin at once.
            let canary = scope.spawn(|| {
                for number in 1..=ROUNDS {
                    stalls.remember(0, number, number);
                    stalls.remember(0, 3 * ROUNDS + number, 3 * ROUNDS + number);
                }
            });
            while !canary.is_finished() {
                assert!(!stalls.meet(ROUNDS + 1, 3 * ROUNDS), "the begin of one and the end of the other");
            }
        });
    }
}
