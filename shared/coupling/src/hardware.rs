//! The firmware of the simulated device: what real hardware does when its driver dies.
//!
//! It promises: the last command is kept for `watchdog_ticks`, then the motors ramp to exactly zero in `ramp_ticks`, whatever
//! happened to every process of the station. CHAI3D arms such a watchdog at 31.9 ms; ours is shorter. The motors saturate
//! at `max_force_n` and do not follow a command that is not a number.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::vector::{clamp_length, is_finite, sane};

/// Parameters of the firmware.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct HardwareParams {
    /// Where the motors saturate, N.
    pub max_force_n: f32,
    /// Ticks without a command after which the watchdog trips.
    pub watchdog_ticks: u32,
    /// Ticks of its ramp to zero (20 ms).
    pub ramp_ticks: u32,
}

impl Default for HardwareParams {
    fn default() -> Self {
        Self { max_force_n: 3.3, watchdog_ticks: 8, ramp_ticks: 20 }
    }
}

impl HardwareParams {
    /// The share of the last command that the motors still make after so many ticks without another, 0 to 1.
    pub fn left(&self, silent_ticks: u32) -> f32 {
        let ramped = silent_ticks.saturating_sub(self.watchdog_ticks);
        1.0 - (ramped as f32 / self.ramp_ticks.max(1) as f32).min(1.0)
    }
}

/// State of the firmware. All zero is powered up, no command yet.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct HardwareState {
    /// Force of the motors, N, on the hand.
    pub force_n: [f32; 3],
    /// Last command, N.
    pub command_n: [f32; 3],
    /// Ticks since the last command.
    pub silent_ticks: u32,
    /// How often the watchdog tripped.
    pub trips: u32,
}

/// One tick of the firmware. `command` is a command that arrived since the last tick, N. Returns the next state and the force of
/// the motors, N on the hand.
pub fn hardware_step(params: &HardwareParams, state: &HardwareState, command: Option<[f32; 3]>) -> (HardwareState, [f32; 3]) {
    let mut next = *state;
    let limit = sane(params.max_force_n, 0.0, 1e3, 0.0);
    let arrived = command.filter(|force| is_finite(*force));
    next.silent_ticks = if arrived.is_some() { 0 } else { next.silent_ticks.saturating_add(1) };
    let command = Some(arrived.unwrap_or(state.command_n)).filter(|force| is_finite(*force)).unwrap_or_default();
    next.command_n = clamp_length(Vec3::from_array(command), limit).to_array();
    if next.silent_ticks.checked_sub(params.watchdog_ticks) == Some(1) {
        next.trips = next.trips.saturating_add(1);
    }
    let left = params.left(next.silent_ticks);
    next.force_n = next.command_n.map(|f| f * left);
    (next, next.force_n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_is_held_for_the_watchdog_and_then_ramped_to_zero_in_20_ticks() {
        let params = HardwareParams::default();
        let (mut state, _) = hardware_step(&params, &HardwareState::default(), Some([0.0, 0.0, 2.0]));
        for silent in 1..=40u32 {
            let (next, force) = hardware_step(&params, &state, None);
            let left = 1.0 - silent.saturating_sub(8).min(20) as f32 / 20.0;
            assert_eq!(force, [0.0, 0.0, 2.0 * left], "tick {silent}");
            state = next;
        }
        assert_eq!(state.trips, 1);
        assert_eq!(hardware_step(&params, &state, Some([0.0, 0.0, 0.5])).1, [0.0, 0.0, 0.5]);
    }

    #[test]
    fn motors_saturate_and_ignore_what_is_not_a_number() {
        let params = HardwareParams::default();
        let (state, force) = hardware_step(&params, &HardwareState::default(), Some([0.0, 0.0, 9.0]));
        assert!((force[2] - 3.3).abs() < 1e-4 && force[2] <= 3.3);
        let (next, held) = hardware_step(&params, &state, Some([f32::NAN, 0.0, 0.0]));
        assert_eq!((held, next.silent_ticks), (force, 1));
    }
}
