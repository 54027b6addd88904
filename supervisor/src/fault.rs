//! One fault: what is known of it, and its verdict.
//!
//! The window of a fault runs from its injection to the recovery (a successor is warm or live) and 20 ms beyond, at least 200 ms. The
//! promise is judged as in the design: no more misses than in the control, and no force step larger than a fault-free tick makes +
//! 0.05 N. For the device itself: at most 20 misses.

use crate::ledger::{Ledger, Window};
use hyst_messages::{Role, TICK_NS};
use serde::{Deserialize, Serialize};

/// Shortest window, ticks.
pub const WINDOW_TICKS: u64 = 200;
/// Ticks after the recovery that still belong to the window.
pub const AFTER_TICKS: u64 = 20;
/// Force step that is allowed beyond what fault-free ticks make, N.
pub const STEP_MARGIN_N: f64 = 0.05;
/// Misses that the death of the device itself may cost: 20 ms.
pub const DEVICE_TICKS: u64 = 20;
/// Fault-free ticks that a force step is compared with.
const QUIET_TICKS: u64 = 10_000;

/// One fault.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Fault {
    /// `kill`, `stop` …, or `external`.
    pub kind: String,
    /// The slot that it hit.
    pub target: String,
    /// It hit the one that did the role's work.
    pub active: bool,
    /// Station tick of the injection; for one from outside, of the last heartbeat.
    pub tick: u64,
    /// CLOCK_MONOTONIC of the same, ns.
    pub injected_ns: u64,
    /// The process died, hung or was continued.
    pub manifested: bool,
    /// `pidfd`, `heartbeat` or `guardian`.
    pub detected_by: String,
    /// From the injection to the word in the station page, µs.
    pub detected_us: Option<f64>,
    /// From the injection to the end of the last tick that missed its force because of it, µs; 0 if the device never noticed.
    pub contained_us: Option<f64>,
    /// From the injection to a successor that is warm or live, µs.
    pub recovered_us: Option<f64>,
    /// See the module's text; `None` if it could not be judged.
    pub promise_held: Option<bool>,
    /// How the process ended.
    pub exit: String,
    /// The fault's window.
    pub window: Option<Window>,
    /// Its control.
    pub control: Option<Window>,
    pub(crate) slot: usize,
    pub(crate) incarnation: u32,
    pub(crate) dead: bool,
    pub(crate) continue_ns: Option<u64>,
}

pub(crate) fn us(at_ns: u64, since_ns: u64) -> f64 {
    at_ns.saturating_sub(since_ns) as f64 * 1e-3
}

/// The window of a fault, as station ticks.
pub(crate) fn bounds(fault: &Fault) -> (u64, u64) {
    let recovery_ticks = fault.recovered_us.map_or(0, |us| (us * 1e3) as u64 / TICK_NS + 1);
    (fault.tick, fault.tick + (recovery_ticks + AFTER_TICKS).max(WINDOW_TICKS))
}

pub(crate) fn judge(fault: &mut Fault, control: Option<Window>, ledger: &Ledger, taken: &[(u64, u64)]) {
    let (from_tick, to_tick) = bounds(fault);
    let window = ledger.window(from_tick, to_tick);
    if window.ticks + window.voided == 0 {
        return; // no ledger: nothing can be judged
    }
    let last_miss = (from_tick..to_tick).rev().find(|tick| ledger.window(*tick, tick + 1).missed > 0);
    fault.contained_us = Some(last_miss.map_or(0.0, |tick| (tick + 1 - from_tick) as f64 * TICK_NS as f64 * 1e-3));
    if let Some(control) = control {
        let quiet_n = quiet_step_max_n(ledger, from_tick, taken).max(control.force_step_max_n);
        let smooth = window.force_step_max_n <= quiet_n + STEP_MARGIN_N;
        let allowed = control.missed + if fault.target == Role::Device.name() { DEVICE_TICKS } else { 0 };
        fault.promise_held = Some(fault.recovered_us.is_some() && window.missed <= allowed && smooth);
    }
    (fault.window, fault.control) = (Some(window), control);
}

/// Largest force step in the fault-free ticks before a fault.
fn quiet_step_max_n(ledger: &Ledger, before_tick: u64, taken: &[(u64, u64)]) -> f64 {
    let Some(settled) = ledger.settled_tick() else {
        return 0.0;
    };
    let mut quiet_n: f64 = 0.0;
    let mut tick = before_tick.saturating_sub(QUIET_TICKS).max(settled);
    while tick < before_tick {
        let next = (tick + WINDOW_TICKS).min(before_tick);
        if taken.iter().all(|(from, to)| next <= *from || tick >= *to) {
            quiet_n = quiet_n.max(ledger.window(tick, next).force_step_max_n);
        }
        tick = next;
    }
    quiet_n
}
