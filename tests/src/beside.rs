//! Faults and quiet windows of the same length beside each other, as the ledger of the simulated hardware has them: what the host takes falls on
//! both alike. For faults that the report cannot judge, because who would write it is what is killed.

use crate::Station;
use crate::ended::MOST_VOID;
use crate::shown::Promise;

/// Shortest window, ticks, and those after the recovery that still belong to it: as the report's own windows.
const LEAST_TICKS: u64 = 200;
const AFTER_TICKS: u64 = 20;
/// Ticks between a fault's window and its control, in which whoever came back does its first work.
const SETTLE_TICKS: u64 = 300;

/// What the faults of one kind cost beyond their controls.
#[derive(Debug, Default)]
pub struct Beside {
    /// Misses of each fault that counts, less those of as many ticks beside it.
    pub excesses: Vec<f64>,
    /// Faults that tell nothing.
    pub void: usize,
    /// Misses of the worst control.
    worst_control: f64,
}

/// A moment: the station's tick, and its ledger so far.
fn mark(station: &Station) -> (u64, (u64, u64)) {
    (station.clock().present_tick(), station.ledger())
}

/// What the ledger gained between two moments.
struct Window {
    ticks: u64,
    counted: u64,
    missed: u64,
}

impl Window {
    fn since(station: &Station, (tick, before): (u64, (u64, u64))) -> Window {
        let (end, after) = mark(station);
        Window { ticks: end - tick, counted: after.0 - before.0, missed: after.1 - before.1 }
    }

    fn is_void(&self) -> bool {
        (self.counted as f64) < (1.0 - MOST_VOID) * self.ticks as f64
    }
}

impl Beside {
    /// Runs a fault to its recovery and compares its window with as many ticks some time after it.
    pub fn compare(&mut self, station: &mut Station, fault: impl FnOnce(&mut Station)) {
        let begin = mark(station);
        fault(station);
        let lasted = station.clock().present_tick() - begin.0;
        station.pass_ticks(AFTER_TICKS.max(LEAST_TICKS.saturating_sub(lasted)));
        let window = Window::since(station, begin);
        station.pass_ticks(SETTLE_TICKS);
        let begin = mark(station);
        station.pass_ticks(window.ticks);
        let control = Window::since(station, begin);
        if window.is_void() || control.is_void() {
            self.void += 1;
        } else {
            // The two end where a look happens to be: not quite as long.
            let scale = window.counted as f64 / control.counted.max(1) as f64;
            let control = scale * control.missed as f64;
            self.excesses.push(window.missed as f64 - control);
            self.worst_control = self.worst_control.max(control);
        }
    }

    /// Fails if the faults of a kind cost more than so many misses each in the mean, or one of them more than the host explains.
    pub fn judge(&self, what: &str, allowed: f64, least: usize, station: &Station) {
        println!("{what}: {} windows are void; {:.1?}", self.void, self.excesses);
        let promise = Promise::of_ticks(allowed, least, self.worst_control);
        promise.judge(&format!("{what}, excess misses"), &self.excesses, || station.events());
    }
}
