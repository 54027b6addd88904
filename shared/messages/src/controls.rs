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
}

impl Controls {
    /// Turns what a press turns. A set pressure that is no number is not made one.
    pub fn turn(&mut self, switch: Switch) {
        let other = |value: f32, on: f32, off: f32| if value == on { off } else { on };
        match switch {
            Switch::Loop => self.buttons ^= BUTTON_EXTENDED,
            Switch::Inflow => self.inflow_valve = other(self.inflow_valve, 1.0, 0.0),
            Switch::Outflow => self.outflow_valve = other(self.outflow_valve, OUTFLOW, 0.0),
            Switch::Light => self.light = other(self.light, 1.0, DIM),
            Switch::PressureUp => self.press_by(PRESSURE_STEP_PA),
            Switch::PressureDown => self.press_by(-PRESSURE_STEP_PA),
        }
    }

    fn press_by(&mut self, step_pa: f32) {
        if self.set_pressure_pa.is_finite() {
            self.set_pressure_pa = (self.set_pressure_pa + step_pa).clamp(PRESSURE_PA[0], PRESSURE_PA[1]);
        }
    }
}
