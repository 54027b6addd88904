//! The hand that holds the scope: a mass on a spring and a damper, pulled to where the script wants it, pushed by the force
//! that the device applies. It closes the force loop: a wall that is too stiff makes it buzz, a force step makes it jump.
//!
//! It promises stability for any time step, stiffness and target (implicit Euler in spring and damper), and a tip that never
//! leaves the limits of the four degrees of freedom. The dynamics run on the tip position in three dimensions; the result is
//! projected back to pitch, yaw and insertion. Roll has no force and follows its target with a first-order lag.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

use crate::pose::{DofLimits, Pose4, dof_from_pose, pose_from_dof};
use crate::vector::{clamp_length, is_finite, sane};

/// A force beyond this does not come from a haptic device, N; longer ones are shortened to it.
const MAX_FORCE_N: f32 = 100.0;
/// Lag of the roll, s.
const ROLL_LAG_S: f64 = 0.03;

/// The hand, and where it holds the scope. Stiffness 300 N/m and 0.15 kg are a light grip, critically damped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandModel {
    /// Pull to the wanted position, N/m.
    pub stiffness_n_m: f32,
    /// Mass of hand and scope at the tip, kg.
    pub mass_kg: f32,
    /// Damping against the room, N·s/m.
    pub damping_n_s_m: f32,
    /// Pivot, m, station frame.
    pub pivot_m: [f32; 3],
    /// Where the scope can be.
    pub limits: DofLimits,
}

impl Default for HandModel {
    fn default() -> Self {
        let (stiffness_n_m, mass_kg) = (300.0f32, 0.15f32);
        let damping_n_s_m = 2.0 * (stiffness_n_m * mass_kg).sqrt();
        Self { stiffness_n_m, mass_kg, damping_n_s_m, pivot_m: [0.0; 3], limits: DofLimits::default() }
    }
}

/// Where the scope is and how fast.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct HandState {
    /// Tip position, m, station frame; always that of `pose`.
    pub tip_m: [f32; 3],
    /// Tip velocity, m/s.
    pub velocity_m_s: [f32; 3],
    /// Orientation of the scope, unit quaternion (x, y, z, w).
    pub orientation: [f32; 4],
    /// The same as degrees of freedom.
    pub pose: Pose4,
}

impl HandState {
    /// At rest at `pose` (clamped to the model's limits).
    pub fn at_rest(model: &HandModel, pose: &Pose4) -> Self {
        let pose = model.limits.clamp(pose);
        let (tip_m, orientation) = pose_from_dof(model.pivot_m, &pose);
        Self { tip_m, velocity_m_s: [0.0; 3], orientation, pose }
    }
}

/// One time step of `dt_s` (clamped to 0–0.1 s): the hand wants `target`, `force_n` pushes it, N on the hand (not a number
/// counts as zero). A state that is not finite becomes rest at the target.
pub fn hand_dynamics(model: &HandModel, state: &HandState, target: &Pose4, force_n: [f32; 3], dt_s: f32) -> HandState {
    let target = model.limits.clamp(target);
    if !(is_finite(state.tip_m) && is_finite(state.velocity_m_s) && state.pose.roll_rad.is_finite()) {
        return HandState::at_rest(model, &target);
    }
    let dt = f64::from(sane(dt_s, 0.0, 0.1, 0.0));
    let force = if is_finite(force_n) { clamp_length(Vec3::from_array(force_n), MAX_FORCE_N) } else { Vec3::ZERO };
    let tip = DVec3::from_array(state.tip_m.map(f64::from));
    let speed = DVec3::from_array(state.velocity_m_s.map(f64::from));
    let wanted = DVec3::from_array(pose_from_dof(model.pivot_m, &target).0.map(f64::from));

    // m (v' − v)/dt = k (wanted − tip − dt v') − c v' + F, solved for v'.
    let mass = f64::from(sane(model.mass_kg, 1e-3, 100.0, 0.15));
    let stiffness = f64::from(sane(model.stiffness_n_m, 0.0, 1e6, 300.0));
    let damping = f64::from(sane(model.damping_n_s_m, 0.0, 1e4, 13.4));
    let push = (wanted - tip) * stiffness + force.as_dvec3();
    let next_speed = (speed * mass + push * dt) / (mass + dt * damping + dt * dt * stiffness);
    let next_tip = tip + next_speed * dt;

    let follow = dt / (ROLL_LAG_S + dt);
    let roll = f64::from(state.pose.roll_rad) + (f64::from(target.roll_rad) - f64::from(state.pose.roll_rad)) * follow;
    let free = dof_from_pose(model.pivot_m, next_tip.as_vec3().to_array(), [0.0, 0.0, 0.0, 1.0]);
    let pose = model.limits.clamp(&Pose4 { roll_rad: roll as f32, ..free });
    let (tip_m, orientation) = pose_from_dof(model.pivot_m, &pose);
    let stopped = pose.pitch_rad != free.pitch_rad || pose.yaw_rad != free.yaw_rad;
    // At a limit the motion that was taken away takes its speed with it.
    let velocity_m_s = if stopped || pose.insertion_m != free.insertion_m {
        let moved = DVec3::from_array(tip_m.map(f64::from)) - tip;
        (moved / dt.max(1e-6)).clamp_length_max(next_speed.length()).as_vec3().to_array()
    } else {
        next_speed.as_vec3().to_array()
    };
    HandState { tip_m, velocity_m_s, orientation, pose }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(pitch_rad: f32, yaw_rad: f32, insertion_m: f32) -> Pose4 {
        Pose4 { pitch_rad, yaw_rad, roll_rad: 0.0, insertion_m }
    }

    #[test]
    fn a_steady_force_moves_the_hand_by_force_over_stiffness() {
        let model = HandModel::default();
        let target = pose(0.0, 0.0, 0.06);
        let mut state = HandState::at_rest(&model, &target);
        for _ in 0..1000 {
            state = hand_dynamics(&model, &state, &target, [0.3, 0.0, -1.5], 1e-3);
        }
        assert!((state.tip_m[0] - 0.001).abs() < 1e-6 && (state.tip_m[2] - 0.055).abs() < 1e-6, "{:?}", state.tip_m);
    }

    #[test]
    fn the_hand_reaches_its_target_without_overshoot() {
        let model = HandModel::default();
        let mut state = HandState::at_rest(&model, &pose(0.0, 0.0, 0.04));
        for _ in 0..1000 {
            state = hand_dynamics(&model, &state, &pose(0.0, 0.0, 0.06), [0.0; 3], 1e-3);
            assert!(state.tip_m[2] < 0.06 + 1e-6);
        }
        assert!((state.tip_m[2] - 0.06).abs() < 1e-6);
    }

    #[test]
    fn any_step_and_any_force_leave_the_hand_finite_and_inside_its_limits() {
        let model = HandModel::default();
        let mut state = HandState::at_rest(&model, &pose(0.0, 0.0, 0.06));
        let forces = [[f32::MAX, 0.0, 0.0], [f32::NAN; 3], [0.0, -1e9, 1e9], [0.0, 0.0, f32::INFINITY]];
        for n in 0..400usize {
            let dt_s = [1e-3, 0.1, f32::NAN, 50.0][n / 4 % 4];
            state = hand_dynamics(&model, &state, &pose(9.0, -9.0, 9.0), forces[n % 4], dt_s);
            assert_eq!(model.limits.clamp(&state.pose), state.pose);
            assert!(is_finite(state.velocity_m_s), "{state:?}");
        }
        let broken = HandState { tip_m: [f32::NAN; 3], ..state };
        assert!(is_finite(hand_dynamics(&model, &broken, &pose(0.0, 0.0, 0.05), [0.0; 3], 1e-3).tip_m));
    }
}
