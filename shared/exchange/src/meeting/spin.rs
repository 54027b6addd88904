//! A wait that looks for a while before it sleeps: a wake across cores costs 16 µs, which is longer than many a part of a phase. How long it looks follows
//! from whether looking helped: on full cores, where the other side does not run, it soon sleeps at once.

use crate::system;
use std::hint::spin_loop;

/// Longest look, ns: a serial phase of the Flow Engine between two parallel ones ends within it.
const MOST_NS: u64 = 300_000;
const LEAST_NS: u64 = 5_000;
/// Looks between two readings of the clock.
const LOOKS: u32 = 16;

#[derive(Debug)]
pub(super) struct Spin {
    look_ns: u64,
    /// With a core alone the other side cannot run meanwhile.
    alone: bool,
}

impl Default for Spin {
    fn default() -> Spin {
        Spin { look_ns: MOST_NS, alone: system::cores() < 2 }
    }
}

impl Spin {
    /// Looks until it is there, for a bounded time, and no longer than until the deadline (CLOCK_MONOTONIC ns).
    pub fn until(&mut self, deadline_ns: u64, is_there: impl Fn() -> bool) {
        if is_there() || self.alone {
            return;
        }
        let until_ns = (system::now_ns() + self.look_ns).min(deadline_ns);
        loop {
            for _ in 0..LOOKS {
                if is_there() {
                    self.look_ns = (2 * self.look_ns).min(MOST_NS);
                    return;
                }
                spin_loop();
            }
            if system::now_ns() >= until_ns {
                self.look_ns = (self.look_ns / 2).max(LEAST_NS);
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    #[test]
    fn looking_that_does_not_help_is_shortened_and_what_helps_is_done_again() {
        let mut spin = Spin { look_ns: MOST_NS, alone: false };
        for _ in 0..20 {
            spin.until(u64::MAX, || false);
        }
        assert_eq!(spin.look_ns, LEAST_NS);
        for _ in 0..20 {
            let looks = AtomicU32::new(0);
            spin.until(u64::MAX, || looks.fetch_add(1, Ordering::Relaxed) > 2);
        }
        assert_eq!(spin.look_ns, MOST_NS);
        let mut alone = Spin { look_ns: MOST_NS, alone: true };
        let looks = AtomicU32::new(0);
        alone.until(u64::MAX, || looks.fetch_add(1, Ordering::Relaxed) > 2);
        assert_eq!(looks.into_inner(), 1, "nobody else can run");
    }
}
