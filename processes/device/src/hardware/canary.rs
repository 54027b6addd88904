//! The canaries: one thread on each core, above everything of the station, that sleeps for a quarter of a tick and looks how late it was woken.
//! What delays a canary is not the station but the host, or the kernel; ticks in that time are void in both arms of every comparison.
//! A kernel that tears down or starts a large process delays it too, so that misses are also counted with the void ticks
//! (`Window::late` of the supervisor), and a campaign shows both.

use hyst_engine::{Failure, Life};
use hyst_exchange::system;
use hyst_messages::TICK_NS;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Lateness above which the host is said to have stalled, ns: four times the p99 of an idle machine (measured: 52 µs), and what a tick has to
/// spare. Of 25 misses in 500 s and 200 faults that stalls of 0.5 ms did not explain, 24 had a canary late by 0.2 to 0.5 ms at most 2 ms before them.
pub const STALL_NS: u64 = 200_000;
/// Between two looks, ns: a stall that begins and ends in a canary's sleep is seen only by what it exceeds it.
const SLEEP_NS: u64 = TICK_NS / 4;
/// Priority of the canaries: above the hardware, below the supervisor's watch, which works for microseconds.
const PRIORITY: i32 = 88;
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
        for core in 0..system::cores().min(if wanted { 64 } else { 0 }) {
            let mine = Arc::new(Stalls { windows: [const { [const { AtomicU64::new(0) }; 2] }; MEMORY] });
            stalls.push(Arc::clone(&mine));
            let stop = Arc::clone(&stop);
            std::thread::Builder::new().name(format!("canary-{core}")).spawn(move || watch(core, &mine, &stop))?;
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

fn watch(core: usize, stalls: &Stalls, stop: &AtomicBool) {
    if !(system::pin_to_core(core) && system::become_fifo(PRIORITY)) {
        return;
    }
    let mut next = 0;
    while !stop.load(Ordering::Acquire) {
        let due_ns = system::now_ns() + SLEEP_NS;
        system::sleep_until_ns(due_ns);
        let woken_ns = system::now_ns();
        if woken_ns > due_ns + STALL_NS {
            let window = &stalls.windows[next % MEMORY];
            window[1].store(woken_ns, Ordering::Relaxed);
            window[0].store(due_ns, Ordering::Relaxed);
            next += 1;
        }
    }
}
