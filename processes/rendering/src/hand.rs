//! The hand in the window: mouse and keys become targets for the simulated hardware, in the page's pointer cell.
//!
//! Promise: the first record repeats where the scope is, so that a restarted window does not move it; a target stays within reach of the
//! scope, so that nothing is wound up while the tissue or the workspace holds it.

use hyst_messages::{BUTTON_ENERGIZED, BUTTON_EXTENDED, Controls, PointerRecord, Pose};
use rendering::{Key, PointerInput};
use std::f32::consts::PI;

/// How far a target may be from the scope: rad, rad, rad, m. A hand's lead over an instrument that is held.
const REACH: [f32; 4] = [0.25, 0.25, 0.6, 0.012];
/// Bounds of a target whatever the scope says: rad, rad, rad, m.
const BOUNDS: [(f32, f32); 4] = [(-1.2, 1.2), (-1.2, 1.2), (-PI, PI), (0.0, 0.2)];
/// 70 mmHg, the usual set pressure, Pa.
const SET_PRESSURE_PA: f32 = 9_333.0;
/// Opening of the outflow valve, share.
const OUTFLOW: f32 = 0.3;

/// Adds up what the hand does.
#[derive(Debug)]
pub struct Hand {
    record: PointerRecord,
}

impl Default for Hand {
    fn default() -> Hand {
        let controls = Controls {
            inflow_valve: 1.0,
            outflow_valve: OUTFLOW,
            set_pressure_pa: SET_PRESSURE_PA,
            light: 1.0,
            ..Controls::default()
        };
        Hand { record: PointerRecord { controls, ..PointerRecord::default() } }
    }
}

impl Hand {
    /// The next record; `scope` is where the hardware says the scope is.
    pub fn follow(&mut self, input: &PointerInput, scope: &Pose) -> PointerRecord {
        let at = [scope.pitch_rad, scope.yaw_rad, scope.roll_rad, scope.insertion_m];
        if self.record.sequence == 0 {
            self.record.target = at;
        }
        // A view that goes up is a negative turn about +x; one that goes right is a negative turn about +y.
        let moved = [-input.pitch_rad, -input.yaw_rad, input.roll_rad, input.insertion_m];
        for (axis, target) in self.record.target.iter_mut().enumerate() {
            let wanted = *target + moved[axis];
            let (low, high) = BOUNDS[axis];
            if wanted.is_finite() && at[axis].is_finite() {
                *target = wanted.clamp(at[axis] - REACH[axis], at[axis] + REACH[axis]).clamp(low, high);
            }
        }
        let controls = &mut self.record.controls;
        let turned = |key: Key, value: f32, on: f32, off: f32| match input.was_pressed(key) {
            true if value == on => off,
            true => on,
            false => value,
        };
        controls.inflow_valve = turned(Key::Inflow, controls.inflow_valve, 1.0, 0.0);
        controls.outflow_valve = turned(Key::Outflow, controls.outflow_valve, OUTFLOW, 0.0);
        controls.light = turned(Key::Light, controls.light, 1.0, 0.3);
        controls.buttons &= !BUTTON_ENERGIZED;
        controls.buttons |= if input.is_held(Key::Energize) { BUTTON_ENERGIZED } else { 0 };
        controls.buttons ^= if input.was_pressed(Key::LoopOut) { BUTTON_EXTENDED } else { 0 };
        self.record.sequence += 1;
        self.record
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scope() -> Pose {
        Pose { pitch_rad: 0.1, yaw_rad: -0.2, roll_rad: 0.3, insertion_m: 0.04, ..Pose::default() }
    }

    #[test]
    fn the_first_record_leaves_the_scope_where_it_is() {
        let record = Hand::default().follow(&PointerInput::default(), &scope());
        assert_eq!((record.sequence, record.target), (1, [0.1, -0.2, 0.3, 0.04]));
    }

    #[test]
    fn a_view_that_goes_up_and_right_turns_the_scope_about_minus_x_and_minus_y() {
        let input = PointerInput { pitch_rad: 0.01, yaw_rad: 0.02, insertion_m: 0.001, ..PointerInput::default() };
        let record = Hand::default().follow(&input, &scope());
        assert!((record.target[0] - 0.09).abs() < 1e-6 && (record.target[1] + 0.22).abs() < 1e-6, "{record:?}");
        assert!((record.target[3] - 0.041).abs() < 1e-6);
    }

    #[test]
    fn nothing_is_wound_up_against_an_obstacle_and_no_number_gets_through() {
        let mut hand = Hand::default();
        let push = PointerInput { insertion_m: 0.005, roll_rad: f32::NAN, ..PointerInput::default() };
        for _ in 0..100 {
            let record = hand.follow(&push, &scope());
            assert!(record.target[3] <= 0.04 + REACH[3] + 1e-6 && record.target.iter().all(|angle| angle.is_finite()));
        }
        let back = hand.follow(&PointerInput { insertion_m: -0.02, ..push }, &scope());
        assert!(back.target[3] < 0.04, "{back:?}");
        let lost = hand.follow(&push, &Pose { insertion_m: f32::NAN, ..scope() });
        assert_eq!(lost.target[3], back.target[3]);
    }

    #[test]
    fn keys_turn_valves_and_loop() {
        let mut hand = Hand::default();
        let press = |key: Key| PointerInput { pressed: key.bit(), held: key.bit(), ..PointerInput::default() };
        assert_eq!(hand.follow(&press(Key::Inflow), &scope()).controls.inflow_valve, 0.0);
        assert_eq!(hand.follow(&press(Key::Inflow), &scope()).controls.inflow_valve, 1.0);
        assert_eq!(hand.follow(&press(Key::LoopOut), &scope()).controls.buttons, BUTTON_EXTENDED);
        assert_eq!(hand.follow(&press(Key::Energize), &scope()).controls.buttons, BUTTON_EXTENDED | BUTTON_ENERGIZED);
        assert_eq!(hand.follow(&PointerInput::default(), &scope()).controls.buttons, BUTTON_EXTENDED);
    }
}
