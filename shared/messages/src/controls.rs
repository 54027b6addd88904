//! What a hand sets with one press, whatever it presses: a key of the window or a button of a pad.

use crate::record::{BUTTON_EXTENDED, Controls};

/// What a press changes the set pressure by: 5 mmHg, Pa.
const PRESSURE_STEP_PA: f32 = 5.0 * 133.322;
/// Within what it does: 15 to 150 mmHg, the range of such pumps, Pa.
pub const PRESSURE_PA: [f32; 2] = [15.0 * 133.322, 150.0 * 133.322];
/// Opening of the outflow valve, share.
pub const OUTFLOW: f32 = 0.3;
/// A light that is dimmed, share.
pub const DIM: f32 = 0.3;
/// Where the focus of the camera head is set as a rule, m from the lens: with it a cavity is sharp from 12 mm on.
pub const FOCUS_M: f32 = 0.020;
/// How near and how far it can be set, m.
pub const FOCUS_RANGE_M: [f32; 2] = [0.003, 0.1];
/// What a press makes of it, as a share: a turn of the ring that one sees.
const FOCUS_STEP: f32 = 1.15;

/// What a press turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switch {
    /// The loop, out or in.
    Loop,
    /// The inflow valve.
    Inflow,
    /// The outflow valve.
    Outflow,
    /// The light, full or dim.
    Light,
    /// The set pressure, 5 mmHg up.
    PressureUp,
    /// The set pressure, 5 mmHg down.
    PressureDown,
    /// The focus, nearer.
    FocusNear,
    /// The focus, farther.
    FocusFar,
}

impl Controls {
    /// Turns what a press turns. A set pressure or a focus that is no number is not made one.
    pub fn turn(&mut self, switch: Switch) {
        let other = |value: f32, on: f32, off: f32| if value == on { off } else { on };
        match switch {
            Switch::Loop => self.buttons ^= BUTTON_EXTENDED,
            Switch::Inflow => self.inflow_valve = other(self.inflow_valve, 1.0, 0.0),
            Switch::Outflow => self.outflow_valve = other(self.outflow_valve, OUTFLOW, 0.0),
            Switch::Light => self.light = other(self.light, 1.0, DIM),
            Switch::PressureUp => self.press_by(PRESSURE_STEP_PA),
            Switch::PressureDown => self.press_by(-PRESSURE_STEP_PA),
            Switch::FocusNear => self.focus_by(1.0 / FOCUS_STEP),
            Switch::FocusFar => self.focus_by(FOCUS_STEP),
        }
    }

    fn press_by(&mut self, step_pa: f32) {
        if self.set_pressure_pa.is_finite() {
            self.set_pressure_pa = (self.set_pressure_pa + step_pa).clamp(PRESSURE_PA[0], PRESSURE_PA[1]);
        }
    }

    fn focus_by(&mut self, share: f32) {
        if self.focus_m.is_finite() {
            self.focus_m = (self.focus_or(FOCUS_M) * share).clamp(FOCUS_RANGE_M[0], FOCUS_RANGE_M[1]);
        }
    }

    /// Whether the focus is one that can be set, or none is stated.
    pub fn has_focus_in_range(&self) -> bool {
        self.focus_m == 0.0 || (FOCUS_RANGE_M[0]..=FOCUS_RANGE_M[1]).contains(&self.focus_m) // not with a NaN
    }

    /// Distance from the lens that is sharp, m: another one where none is stated, or one that cannot be.
    pub fn focus_or(&self, otherwise_m: f32) -> f32 {
        if self.focus_m != 0.0 && self.has_focus_in_range() { self.focus_m } else { otherwise_m }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_focus_goes_by_its_presses_within_its_range_from_the_usual_one_where_none_is_stated() {
        let mut controls = Controls::default();
        controls.turn(Switch::FocusNear);
        assert!((controls.focus_m - 0.0174).abs() < 1e-4, "{controls:?}");
        controls.turn(Switch::FocusFar);
        assert!((controls.focus_m - FOCUS_M).abs() < 1e-6, "{controls:?}");
        for (switch, end_m) in [(Switch::FocusNear, FOCUS_RANGE_M[0]), (Switch::FocusFar, FOCUS_RANGE_M[1])] {
            (0..40).for_each(|_| controls.turn(switch));
            assert_eq!(controls.focus_m, end_m, "{switch:?}");
        }
        controls.focus_m = f32::NAN;
        controls.turn(Switch::FocusNear);
        assert!(controls.focus_m.is_nan(), "what is no number is not made one: the device refuses it");
    }

    #[test]
    fn a_focus_that_is_not_stated_or_cannot_be_is_the_other_one() {
        for (focus_m, is_in_range, expected_m) in [
            (0.008, true, 0.008),
            (0.1, true, 0.1),
            (0.0, true, 0.03),
            (8.0, false, 0.03),
            (f32::NAN, false, 0.03),
            (-0.02, false, 0.03),
        ] {
            let controls = Controls { focus_m, ..Controls::default() };
            assert_eq!((controls.has_focus_in_range(), controls.focus_or(0.03)), (is_in_range, expected_m), "{focus_m}");
        }
    }
}
