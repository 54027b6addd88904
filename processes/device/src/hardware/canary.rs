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

struct Stalls {
    /// Begin and end of the last stalls, ns.
    windows: [[AtomicU64; 2]; MEMORY],
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
            let mine = Arc::new(Stalls { windows: [const { [const { AtomicU64::new(0) }; 2] }; MEMORY] });
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
        self.stalls.iter().flat_map(|stalls| &stalls.windows).any(|window| {
            let (begin, end) = (window[0].load(Ordering::Relaxed), window[1].load(Ordering::Relaxed));
            begin != 0 && begin <= to_ns && end >= from_ns
        })
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
        let stood_ns = woken_ns.saturating_sub(due_ns).saturating_sub(queued_ns);
        if stood_ns > STALL_NS {
            tell(stood_ns);
            let window = &stalls.windows[next % MEMORY];
            window[1].store(woken_ns, Ordering::Relaxed);
            window[0].store(due_ns, Ordering::Relaxed);
            next += 1;
        }
    }
}
