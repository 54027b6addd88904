//! When the session of a case begins: with the first tick at which the hand has moved something, and at the latest thirty seconds after the station began, at
//! its tick 0, so that the session of a hand that rests ends, too. Before that engines start, shaders are compiled, and nobody holds the scope: what is counted
//! over the time would tell how fast somebody sat down. One function of what a recording holds, by which a session is judged and its report is made.
//!
//! Promise: who comes late has the same latest begin as who has seen all, for it hangs on no tick that was seen; what trembles, and what is no number, begins
//! nothing; it is plain data, so a judge hands it on.

use crate::force::length;
use crate::judge::Judge;
use crate::motion::{difference, finite, wrapped};
use hyst_messages::{AppliedRecord, HardwareSample};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// With this tick the session begins whatever the hand does: ticks count from when the station began.
const LATEST_TICK: u64 = 30_000;
/// From here on the tip has moved, m, or the loop or the jaws have: twenty times what the encoders of a common device tell apart (assumption).
const MOVED_M: f64 = 1e-3;
/// From here on an axis has turned, rad: 2 degrees (assumption).
const TURNED_RAD: f64 = PI / 90.0;
/// From here on a valve or the light has been set, share of all, and the pressure, Pa; a press makes at least 0.3 of the one and 660 Pa of the other.
const SET_SHARE: f64 = 0.02;
const SET_PA: f64 = 100.0;
/// From here on the focus has been set, m; a press makes at least 0.4 mm.
const FOCUSED_M: f64 = 2e-4;

/// What the hand held when it was first seen, and when it had changed that.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Begin {
    tip_m: Option<[f64; 3]>,
    buttons: Option<u32>,
    /// Pitch, yaw, roll, camera head.
    turned_rad: [Option<f64>; 4],
    /// Valves, light, pressure, loop, focus.
    set: [Option<f64>; 6],
    /// The tick with which the session begins.
    tick: Option<u64>,
}

impl Begin {
    /// Takes a tick; they come in their order.
    pub(crate) fn take(&mut self, record: &AppliedRecord) {
        if self.tick.is_some() {
            return;
        }
        // Before the hardware has spoken there is no orientation, and nothing to have been moved from.
        let has_spoken = record.sample.pose.orientation != [0.0; 4];
        let has_moved = has_spoken && self.has_moved(&record.sample);
        if has_moved || record.tick >= LATEST_TICK {
            self.tick = Some(record.tick.min(LATEST_TICK));
        }
    }

    /// Whether anything is elsewhere than where it was first seen.
    fn has_moved(&mut self, sample: &HardwareSample) -> bool {
        let (pose, controls) = (&sample.pose, &sample.controls);
        let mut has_moved = *self.buttons.get_or_insert(controls.buttons) != controls.buttons;
        if let Some(tip_m) = finite(pose.position_m) {
            let from_m = *self.tip_m.get_or_insert(tip_m);
            has_moved |= length(difference(tip_m, from_m)) >= MOVED_M;
        }
        let angles = [pose.pitch_rad, pose.yaw_rad, pose.roll_rad, pose.camera_roll_rad].map(f64::from);
        for (first_rad, angle_rad) in self.turned_rad.iter_mut().zip(angles) {
            has_moved |= change(first_rad, angle_rad).is_some_and(|change_rad| wrapped(change_rad).abs() >= TURNED_RAD);
        }
        let set = [
            (controls.inflow_valve, SET_SHARE),
            (controls.outflow_valve, SET_SHARE),
            (controls.light, SET_SHARE),
            (controls.set_pressure_pa, SET_PA),
            (controls.loop_extension_m, MOVED_M),
            (controls.focus_or(f32::NAN), FOCUSED_M), // 0 is none
        ];
        for (first, (value, least)) in self.set.iter_mut().zip(set) {
            has_moved |= change(first, f64::from(value)).is_some_and(|change| change.abs() >= least);
        }
        has_moved
    }
}

/// By how much a number is another one than when it was first seen; `None` of what is no number.
fn change(first: &mut Option<f64>, value: f64) -> Option<f64> {
    value.is_finite().then(|| value - *first.get_or_insert(value))
}

impl Judge {
    /// Seconds from the first tick to this one: where it stands on the axis of the recording's time.
    pub fn since_start_s(&self, tick: u64) -> f64 {
        tick.saturating_sub(self.first_tick.unwrap_or(tick)) as f64 * 1e-3
    }

    /// The tick with which the session began; `None` before it.
    pub fn began_tick(&self) -> Option<u64> {
        self.begin.tick
    }

    /// Seconds from the first tick to that; `None` before it.
    pub fn began_s(&self) -> Option<f64> {
        self.began_tick().map(|tick| self.since_start_s(tick))
    }

    /// Ticks of the session up to this one, 0 before it has begun.
    pub(crate) fn elapsed_ticks(&self, tick: u64) -> u64 {
        self.began_tick().map_or(0, |began_tick| tick.saturating_sub(began_tick))
    }

    /// The same in seconds.
    pub fn elapsed_s(&self, tick: u64) -> f64 {
        self.elapsed_ticks(tick) as f64 * 1e-3
    }

    /// How long a session was that was over at a tick, s: one that came to its end before anything was moved is counted from the first tick.
    pub(crate) fn lasted_s(&self, tick: u64) -> f64 {
        if self.began_tick().is_some() { self.elapsed_s(tick) } else { self.since_start_s(tick) }
    }
}
