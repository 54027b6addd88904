//! Windows with a load against windows without one, interleaved in the same run, so that the host's noise falls on both; and the load.

use crate::Station;
use crate::paired::beside_control;
use crate::shown::Promise;
use hystation::campaign::judge::pairs::Window;
use std::process::{Child, Command, Stdio};

/// Ticks of each window of [compare]. Windows with and without the load alternate, so that the host's noise falls on both.
const WINDOW_TICKS: u64 = 1_500;
/// Pairs of windows that must count, and tries to come by them.
const PAIRS: usize = 6;
const MOST_PAIRS: usize = 9;
/// Share of a window that must not be void for its pair to count.
const LEAST_SHARE: f64 = 0.3;
/// Ticks of a thousand that a load, or what is done, may cost more than the control windows lose: a starved servo loses all of them.
const ALLOWED: f64 = 10.0;
/// What one window alone may lose of a thousand ticks beyond its control: no host takes half of those that are not void.
const MOST_OF_ONE: f64 = 500.0;
/// Of a thousand ticks so many may be lost to stalls of the host beyond what is void, in a window by itself.
const STALLS_OF_A_THOUSAND: f64 = 50.0;

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
    /// What the station's ledger gains, and the share of the ticks that is not void, while something is done.
    fn of<T>(station: &Station, done: impl FnOnce() -> T) -> (Ticks, f64, T) {
        let (tick, before) = (station.clock().present_tick(), station.ledger());
        let result = done();
        let (ticks, after) = (station.clock().present_tick() - tick, station.ledger());
        let gained = Ticks(after.0 - before.0, after.1 - before.1);
        (gained, gained.0 as f64 / ticks.max(1) as f64, result)
    }
    /// Those of a thousand without a fresh force.
    fn per_mille(self) -> f64 {
        1e3 * self.1 as f64 / self.0.max(1) as f64
    }
    fn and(self, other: Ticks) -> Ticks {
        Ticks(self.0 + other.0, self.1 + other.1)
    }
}

/// Quiet windows and windows in which something is done, in turn.
#[derive(Debug, Default)]
pub struct Pairs {
    control: Ticks,
    with: Ticks,
    /// What was lost of a thousand ticks, less what the control before it lost.
    excesses: Vec<f64>,
    /// The same in ticks: how many more were lost than so long a control loses.
    missed: Vec<f64>,
    /// Ticks of each that count.
    counted: Vec<f64>,
    /// What the worst of the controls lost of a thousand ticks.
    worst_control: f64,
    /// The windows of those whose control is as long, and these.
    as_long: Vec<[Window; 2]>,
}

impl Pairs {
    /// A quiet window of so many ticks, and then what is done.
    pub fn around<T>(&mut self, station: &Station, ticks: u64, done: impl FnOnce() -> T) -> T {
        let (control, quiet_share, ()) = Ticks::of(station, || station.run_ticks(ticks));
        let (with, share, result) = Ticks::of(station, done);
        self.take(control, with, quiet_share.min(share));
        result
    }

    /// What is done, until the station is whole and what may come of it later has come, and then a quiet window that is as long.
    pub fn beside<T>(&mut self, station: &Station, done: impl FnOnce() -> T) -> T {
        let (pair, result) = beside_control(station, done);
        let [with, control] = pair.map(|window| Ticks(window.ticks, window.missed));
        let share = |window: &Window| window.ticks as f64 / (window.to_tick - window.from_tick).max(1) as f64;
        self.take(control, with, share(&pair[0]).min(share(&pair[1])));
        self.as_long.push(pair);
        result
    }

    /// Adds a pair, of the windows of which such a share at least is not void.
    fn take(&mut self, control: Ticks, with: Ticks, share: f64) {
        (self.control, self.with) = (self.control.and(control), self.with.and(with));
        if share >= LEAST_SHARE {
            let excess = with.per_mille() - control.per_mille();
            self.excesses.push(excess);
            self.missed.push(excess * 1e-3 * with.0 as f64);
            self.counted.push(with.0 as f64);
            self.worst_control = self.worst_control.max(control.per_mille());
        }
    }

    /// The windows of those whose control is as long, and these.
    pub fn as_long(&self) -> &[[Window; 2]] {
        &self.as_long
    }

    /// Adds the pairs of others.
    pub fn add(&mut self, other: &Pairs) {
        (self.control, self.with) = (self.control.and(other.control), self.with.and(other.with));
        self.excesses.extend(&other.excesses);
        self.missed.extend(&other.missed);
        self.counted.extend(&other.counted);
        self.as_long.extend(&other.as_long);
        self.heed_controls_of(other);
    }

    /// What the host took from the controls of others in the same run, it may take from these windows too.
    pub fn heed_controls_of(&mut self, other: &Pairs) {
        self.worst_control = self.worst_control.max(other.worst_control);
    }

    /// Fails if what was done costs so many ticks each time, beyond doubt, or one time more than the host explains.
    pub fn judge_each(&self, what: &str, allowed: f64, least: usize, station: &Station) {
        self.assert_each(what, allowed, station);
        let longest = self.counted.iter().copied().fold(0.0, f64::max);
        let promise = self.promise(allowed, least, longest);
        promise.judge(&format!("{what}, ticks lost each time"), &self.missed, || station.said());
    }

    /// Fails if what was done costs one time more than so many ticks and than the host explains.
    pub fn assert_each(&self, what: &str, allowed: f64, station: &Station) {
        for (missed, counted) in self.missed.iter().zip(&self.counted) {
            let promise = self.promise(allowed, 1, *counted);
            promise.assert_one(&format!("{what}, ticks lost each time"), *missed, || station.said());
        }
    }

    /// One about windows of so many ticks that count: what the host takes grows with the window.
    fn promise(&self, allowed: f64, least: usize, counted: f64) -> Promise {
        Promise::of_ticks(allowed, least, 1e-3 * self.worst_control.max(STALLS_OF_A_THOUSAND) * counted)
    }

    /// How many count.
    pub fn count(&self) -> usize {
        self.excesses.len()
    }

    /// Fails if what was done costs ticks.
    pub fn judge(&self, what: &str, least: usize, station: &Station) {
        println!(
            "{what}: control: {} of {} ticks missed; else {} of {}",
            self.control.1, self.control.0, self.with.1, self.with.0
        );
        assert!(self.control.0 > 0 && self.with.0 > 0, "no tick counts\n{}", station.said());
        let promise = Promise { allowed: ALLOWED, least, most: MOST_OF_ONE };
        promise.judge(&format!("{what}, ticks lost of a thousand"), &self.excesses, || station.said());
    }
}

/// Asserts that what begins and ends with `begin` and `end` costs no ticks.
pub fn compare(what: &str, station: &Station, mut begin: impl FnMut(&Station), mut end: impl FnMut(&Station)) {
    let mut pairs = Pairs::default();
    for _ in 0..MOST_PAIRS {
        if pairs.count() < PAIRS {
            pairs.around(station, WINDOW_TICKS, || {
                begin(station);
                station.run_ticks(WINDOW_TICKS);
                end(station);
            });
        }
    }
    pairs.judge(what, PAIRS, station);
}
