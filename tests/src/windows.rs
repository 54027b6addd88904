//! Windows with a load against windows without one, interleaved in the same run, so that the host's noise falls on both; and the load.

use crate::{Station, lower95_of_mean};
use std::process::{Child, Command, Stdio};

/// Ticks of each window. Windows with and without the load alternate, so that the host's noise falls on both.
const WINDOW_TICKS: u64 = 1_500;
/// Pairs of windows.
const PAIRS: usize = 4;
/// Share of the ticks that the load may cost more than the control windows lose: a starved servo loses all of them.
const ALLOWED: f64 = 0.01;

/// Ordinary processes that spin, ended when dropped.
pub struct Spinners(Vec<Child>);

impl Spinners {
    /// Starts so many.
    pub fn start(count: usize) -> Spinners {
        let spin = || Command::new("sh").args(["-c", "while :; do :; done"]).stdin(Stdio::null()).spawn().expect("sh");
        Spinners((0..count).map(|_| spin()).collect())
    }
}

impl Drop for Spinners {
    fn drop(&mut self) {
        for child in &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// Ticks that count, and those of them without a fresh force.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ticks(pub u64, pub u64);

impl Ticks {
    /// Adds what a station's ledger has gained.
    pub fn add(&mut self, before: (u64, u64), after: (u64, u64)) {
        (self.0, self.1) = (self.0 + after.0 - before.0, self.1 + after.1 - before.1);
    }
    /// Both together.
    fn and(self, other: Ticks) -> Ticks {
        Ticks(self.0 + other.0, self.1 + other.1)
    }
    /// Share of the ticks without a fresh force.
    pub fn share(self) -> f64 {
        self.1 as f64 / self.0.max(1) as f64
    }
    /// Adds a window.
    pub fn watch(&mut self, station: &Station) {
        let before = station.ledger();
        station.run_ticks(WINDOW_TICKS);
        self.add(before, station.ledger());
    }
}

/// Asserts that what begins and ends with `begin` and `end` costs no ticks.
pub fn compare(station: &Station, mut begin: impl FnMut(&Station), mut end: impl FnMut(&Station)) {
    let (mut control, mut load, mut differences) = (Ticks::default(), Ticks::default(), Vec::new());
    for _ in 0..PAIRS {
        let (mut without, mut with) = (Ticks::default(), Ticks::default());
        without.watch(station);
        begin(station);
        with.watch(station);
        end(station);
        differences.push(with.1 as f64 - without.1 as f64);
        (control, load) = (control.and(without), load.and(with));
    }
    println!("control: {} of {} ticks missed; with the load: {} of {}", control.1, control.0, load.1, load.0);
    let enough = PAIRS as u64 * WINDOW_TICKS / 2;
    assert!(control.0 > enough && load.0 > enough, "more than half is void: {control:?} {load:?}\n{}", station.said());
    // What the load costs at least, whatever the host took from either window of a pair.
    let least = lower95_of_mean(&differences) / WINDOW_TICKS as f64;
    assert!(least <= ALLOWED, "control {control:?}, load {load:?}, {differences:?}\n{}", station.said());
}
