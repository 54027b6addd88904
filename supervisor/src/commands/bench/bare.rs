//! A bare loop of the device's period and priority: what the machine by itself makes of such a loop. It runs while nothing of ours does, between
//! the windows of the stations, so that neither disturbs the other; all its windows are one histogram.

use hyst_engine::realtime;
use hyst_exchange::system;
use hyst_messages::{LATENCY_BUCKETS, Role, TICK_NS, bucket_of_ns};

/// Length of one window, ticks.
const TICKS: u64 = 1_000;

/// What all windows together counted.
#[derive(Clone, Debug)]
pub struct Bare {
    /// SCHED_FIFO was granted.
    pub real_time: bool,
    /// Windows.
    pub windows: u32,
    /// Wake-ups, and the time that they took, s.
    pub steps: u64,
    /// Time, s.
    pub seconds: f64,
    /// Histogram of wake-up latencies.
    pub wakeup: Vec<u64>,
    /// Histogram of loop latencies: two readings of the clock and one addition.
    pub looping: Vec<u64>,
}

impl Default for Bare {
    fn default() -> Bare {
        let empty = vec![0; LATENCY_BUCKETS];
        Bare { real_time: true, windows: 0, steps: 0, seconds: 0.0, wakeup: empty.clone(), looping: empty }
    }
}

impl Bare {
    /// Runs one window, on a thread of its own, since real time is a thread's for good.
    pub fn measure(&mut self) {
        std::thread::scope(|scope| {
            // A panic in the loop is a panic here.
            let _ = scope.spawn(|| self.window()).join();
        });
    }

    fn window(&mut self) {
        system::lock_memory(); // as the device does; refused: then both do without
        self.real_time &= realtime::priority(Role::Device).is_some_and(system::become_fifo);
        self.windows += 1;
        let begun_ns = system::now_ns();
        let end_ns = begun_ns + TICKS * TICK_NS;
        let mut next_ns = begun_ns + TICK_NS;
        while next_ns <= end_ns {
            system::sleep_until_ns(next_ns);
            let woken_ns = system::now_ns();
            self.wakeup[bucket_of_ns(woken_ns.saturating_sub(next_ns))] += 1;
            self.steps += 1;
            // Periods that have passed are skipped, as the engines' loop skips them.
            next_ns += TICK_NS * (1 + woken_ns.saturating_sub(next_ns) / TICK_NS);
            self.looping[bucket_of_ns(system::now_ns() - woken_ns)] += 1;
        }
        self.seconds += (system::now_ns() - begun_ns) as f64 * 1e-9;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_window_counts_every_wake_up_once() {
        let mut bare = Bare::default();
        bare.measure();
        bare.measure();
        assert_eq!((bare.windows, bare.wakeup.iter().sum::<u64>()), (2, bare.steps));
        assert!(bare.steps <= 2 * TICKS && bare.steps > 0 && bare.seconds >= 2.0 * TICKS as f64 * 1e-3 - 2e-3, "{bare:?}");
    }
}
