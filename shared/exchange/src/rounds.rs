//! Rounds: how often a thread that helps an engine has got on with its work, so that its engine sees whether it stands still, and when it could last open
//! nothing. Such a thread comes round by itself, whether there is something to do or not.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// The rounds of one thread. Clones count the same ones; they order nothing else between the threads.
#[derive(Clone, Debug, Default)]
pub struct Rounds(Arc<Told>);

#[derive(Debug, Default)]
struct Told {
    rounds: AtomicU64,
    /// See [`Rounds::without_file_ns`].
    without_file_ns: AtomicU64,
}

impl Rounds {
    /// The thread has got on.
    pub fn pass(&self) {
        self.0.rounds.fetch_add(1, Ordering::Relaxed);
    }

    /// How often it has: one load, which a real-time thread may make.
    pub fn count(&self) -> u64 {
        self.0.rounds.load(Ordering::Relaxed)
    }

    /// At this time (CLOCK_MONOTONIC, ns) it was to open something, and its process had no file descriptor left.
    pub fn want_file(&self, now_ns: u64) {
        self.0.without_file_ns.store(now_ns, Ordering::Relaxed);
    }

    /// When that was last, ns; 0 if it never was. One load.
    pub fn without_file_ns(&self) -> u64 {
        self.0.without_file_ns.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clones_count_the_same_rounds() {
        let (rounds, other) = (Rounds::default(), Rounds::default());
        let same = rounds.clone();
        rounds.pass();
        same.pass();
        assert_eq!([&rounds, &same, &other].map(Rounds::count), [2, 2, 0]);
        same.want_file(70);
        assert_eq!([&rounds, &same, &other].map(Rounds::without_file_ns), [70, 70, 0]);
    }
}
