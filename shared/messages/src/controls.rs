//! What a hand sets with one press, whatever it presses: a key of the window or a button of a pad.

use crate::record::{BUTTON_COAGULATING, BUTTON_ENERGIZED, BUTTON_EXTENDED, BUTTONS_CURRENT, Controls};

/// Bit of [`HardwareSample::from_window`](crate::HardwareSample::from_window): the window moves the scope.
pub const WINDOW_POSE: u32 = 1;
/// It turns the camera head.
pub const WINDOW_HEAD: u32 = 1 << 1;
/// It wants the loop out, or the jaws open.
pub const WINDOW_LOOP: u32 = 1 << 2;
/// It wants the current that cuts.
pub const WINDOW_CURRENT: u32 = 1 << 3;
/// It sets the inflow valve.
pub const WINDOW_INFLOW: u32 = 1 << 4;
/// It sets the outflow valve.
pub const WINDOW_OUTFLOW: u32 = 1 << 5;
/// It sets the pressure.
pub const WINDOW_PRESSURE: u32 = 1 << 6;
/// It sets the light.
pub const WINDOW_LIGHT: u32 = 1 << 7;
/// It sets the focus.
pub const WINDOW_FOCUS: u32 = 1 << 8;
/// It wants the current that coagulates.
pub const WINDOW_COAGULATION: u32 = 1 << 9;
/// All of them: the hand is the window's.
pub const WINDOW_ALL: u32 = (1 << 10) - 1;
/// Beside [`WINDOW_HEAD`]: the camera head goes along with the scope, so that what the window turns is how far it is turned on that, and not the horizon.
pub const WINDOW_HEAD_FREE: u32 = 1 << 10;
/// No set pressure is higher, Pa: more than any pump can make.
pub const MOST_SET_PRESSURE_PA: f32 = 100_000.0;

/// Pascal per millimetre of mercury.
pub const PA_PER_MMHG: f64 = 133.322;
/// What a press changes the set pressure by: 5 mmHg, Pa.
const PRESSURE_STEP_PA: f32 = 5.0 * PA_PER_MMHG as f32;
/// Within what it does: 15 to 150 mmHg, the range of such pumps, Pa.
pub const PRESSURE_PA: [f32; 2] = [15.0 * PA_PER_MMHG as f32, 150.0 * PA_PER_MMHG as f32];
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

impl Switch {
    /// The bit of [`WINDOW_ALL`] under which the window turns it.
    pub fn window_bit(self) -> u32 {
        match self {
            Switch::Loop => WINDOW_LOOP,
            Switch::Inflow => WINDOW_INFLOW,
            Switch::Outflow => WINDOW_OUTFLOW,
            Switch::Light => WINDOW_LIGHT,
            Switch::PressureUp | Switch::PressureDown => WINDOW_PRESSURE,
            Switch::FocusNear | Switch::FocusFar => WINDOW_FOCUS,
        }
    }
}

impl Controls {
    /// Takes of another what some bits of [`WINDOW_ALL`] name, but for numbers that cannot be set. How far the loop is out follows what is wanted, and
    /// is nobody's to take.
    pub fn take(&mut self, other: &Controls, bits: u32) {
        let numbers = [
            (WINDOW_INFLOW, &mut self.inflow_valve, other.inflow_valve, [0.0, 1.0]),
            (WINDOW_OUTFLOW, &mut self.outflow_valve, other.outflow_valve, [0.0, 1.0]),
            (WINDOW_PRESSURE, &mut self.set_pressure_pa, other.set_pressure_pa, [0.0, MOST_SET_PRESSURE_PA]),
            (WINDOW_LIGHT, &mut self.light, other.light, [0.0, 1.0]),
            (WINDOW_FOCUS, &mut self.focus_m, other.focus_m, FOCUS_RANGE_M),
        ];
        for (bit, own, value, [least, most]) in numbers {
            if bits & bit != 0 && (least..=most).contains(&value) {
                *own = value; // not with a NaN
            }
        }
        let pressed =
            [(WINDOW_LOOP, BUTTON_EXTENDED), (WINDOW_CURRENT, BUTTON_ENERGIZED), (WINDOW_COAGULATION, BUTTON_COAGULATING)];
        for (bit, button) in pressed {
            if bits & bit != 0 {
                self.buttons = (self.buttons & !button) | (other.buttons & button);
            }
        }
    }

    /// Whether the hand wants current in the loop, of whichever kind.
    pub fn has_current(&self) -> bool {
        self.buttons & BUTTONS_CURRENT != 0
    }

    /// Whether the loop cuts, as far as the hand goes: it is to be out, and there is the current that cuts.
    pub fn cuts(&self) -> bool {
        const CUTS: u32 = BUTTON_ENERGIZED | BUTTON_EXTENDED;
        self.buttons & CUTS == CUTS
    }

    /// Whether the loop coagulates, if it is out: of both pedals at once the one that cuts wins (assumed; of generators some give no current at all
    /// then, as Eschmann's TD 830, operator's manual, 5.57).
    pub fn coagulates(&self) -> bool {
        self.buttons & BUTTONS_CURRENT == BUTTON_COAGULATING
    }

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

    /// The set pressure as a pump obeys it, Pa: none above its range; what is no number stays none.
    pub fn obeyed_pressure_pa(&self) -> f32 {
        if self.set_pressure_pa > PRESSURE_PA[1] { PRESSURE_PA[1] } else { self.set_pressure_pa }
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
    fn no_pump_obeys_a_set_pressure_above_its_range() {
        let obeyed = |set_pressure_pa: f32| Controls { set_pressure_pa, ..Controls::default() }.obeyed_pressure_pa();
        assert_eq!([0.0, 9_333.0, 50_000.0, f32::INFINITY].map(obeyed), [0.0, 9_333.0, PRESSURE_PA[1], PRESSURE_PA[1]]);
        assert!(obeyed(f32::NAN).is_nan());
    }

    #[test]
    fn of_another_hand_is_taken_what_is_named_and_no_number_that_cannot_be_set() {
        let before = Controls {
            buttons: BUTTON_EXTENDED,
            inflow_valve: 1.0,
            outflow_valve: 0.3,
            set_pressure_pa: 9_333.0,
            light: 1.0,
            loop_extension_m: 0.004,
            focus_m: 0.020,
        };
        let other = Controls {
            buttons: BUTTONS_CURRENT,
            inflow_valve: 0.0,
            outflow_valve: 0.9,
            set_pressure_pa: 5_000.0,
            light: DIM,
            loop_extension_m: 0.012,
            focus_m: 0.008,
        };
        let after = |bits: u32| {
            let mut controls = before;
            controls.take(&other, bits);
            controls
        };
        assert_eq!(after(0), before);
        assert_eq!(after(WINDOW_POSE | WINDOW_HEAD), before, "those are no controls");
        assert_eq!(after(WINDOW_ALL), Controls { loop_extension_m: 0.004, ..other });
        for (bit, expected) in [
            (WINDOW_LOOP, Controls { buttons: 0, ..before }),
            (WINDOW_CURRENT, Controls { buttons: BUTTON_EXTENDED | BUTTON_ENERGIZED, ..before }),
            (WINDOW_COAGULATION, Controls { buttons: BUTTON_EXTENDED | BUTTON_COAGULATING, ..before }),
            (WINDOW_INFLOW, Controls { inflow_valve: 0.0, ..before }),
            (WINDOW_OUTFLOW, Controls { outflow_valve: 0.9, ..before }),
            (WINDOW_PRESSURE, Controls { set_pressure_pa: 5_000.0, ..before }),
            (WINDOW_LIGHT, Controls { light: DIM, ..before }),
            (WINDOW_FOCUS, Controls { focus_m: 0.008, ..before }),
        ] {
            assert_eq!(after(bit), expected, "{bit:#x}");
        }
        let (mut controls, none) = (before, f32::NAN);
        let nonsense = [(none, none), (-1.0, -5.0), (9.0, f32::INFINITY)];
        for (share, number) in nonsense {
            let (inflow_valve, outflow_valve, light) = (share, share, share);
            let other = Controls { inflow_valve, outflow_valve, light, set_pressure_pa: number, focus_m: number, ..before };
            controls.take(&other, WINDOW_ALL);
            assert_eq!(controls, before, "{share}, {number}");
        }
    }

    #[test]
    fn of_both_pedals_at_once_the_one_that_cuts_wins() {
        let of = |buttons: u32| {
            let controls = Controls { buttons, ..Controls::default() };
            (controls.has_current(), controls.coagulates())
        };
        assert_eq!((of(BUTTON_EXTENDED), of(BUTTON_ENERGIZED)), ((false, false), (true, false)));
        assert_eq!(of(BUTTON_COAGULATING | BUTTON_EXTENDED), (true, true));
        assert_eq!(of(BUTTONS_CURRENT), (true, false));
    }

    #[test]
    fn a_loop_cuts_that_is_to_be_out_under_its_current_and_in_no_other_case() {
        let cuts = |buttons: u32| Controls { buttons, ..Controls::default() }.cuts();
        assert!(cuts(BUTTON_EXTENDED | BUTTON_ENERGIZED) && cuts(BUTTON_EXTENDED | BUTTONS_CURRENT));
        for buttons in [0, BUTTON_EXTENDED, BUTTON_ENERGIZED, BUTTON_EXTENDED | BUTTON_COAGULATING] {
            assert!(!cuts(buttons), "{buttons}");
        }
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
