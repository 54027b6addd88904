//! The scope's pose in its four degrees of freedom about the pivot in the cervix, and as position and orientation.
//!
//! The orientation is `R_y(yaw) · R_x(pitch) · R_z(roll)`, right-handed, applied to a scope whose axis is +z. So positive
//! pitch moves the tip to −y (posterior), positive yaw moves it to +x (the patient's right), and the tip lies at
//! `pivot + insertion · (sin yaw cos pitch, −sin pitch, cos yaw cos pitch)`.
//! Sines are computed in f64 by the platform.

use bytemuck::{Pod, Zeroable};
use glam::{DQuat, DVec3, EulerRot};

use crate::vector::{is_finite, sane};

/// Distance tip to pivot under which the direction of the tip is noise and the orientation's axis is used instead, m.
const MIN_LEVER_M: f64 = 1e-4;

/// The four degrees of freedom.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Pose4 {
    /// About +x, rad; positive moves the tip to −y (posterior).
    pub pitch_rad: f32,
    /// About +y, rad; positive moves the tip to +x (patient's right).
    pub yaw_rad: f32,
    /// About the scope's axis, rad, right-handed about the inward axis.
    pub roll_rad: f32,
    /// Pivot to tip, m.
    pub insertion_m: f32,
}

impl Pose4 {
    /// `self + (to − self) · share`, each degree of freedom on its own; `share` is not limited.
    pub fn blend(&self, to: &Pose4, share: f64) -> Pose4 {
        let mix = |a: f32, b: f32| (f64::from(a) + (f64::from(b) - f64::from(a)) * share) as f32;
        Pose4 {
            pitch_rad: mix(self.pitch_rad, to.pitch_rad),
            yaw_rad: mix(self.yaw_rad, to.yaw_rad),
            roll_rad: mix(self.roll_rad, to.roll_rad),
            insertion_m: mix(self.insertion_m, to.insertion_m),
        }
    }

    /// `self + by · share`, each degree of freedom on its own.
    pub fn shifted(&self, by: &Pose4, share: f64) -> Pose4 {
        let add = |a: f32, b: f32| (f64::from(a) + f64::from(b) * share) as f32;
        Pose4 {
            pitch_rad: add(self.pitch_rad, by.pitch_rad),
            yaw_rad: add(self.yaw_rad, by.yaw_rad),
            roll_rad: add(self.roll_rad, by.roll_rad),
            insertion_m: add(self.insertion_m, by.insertion_m),
        }
    }
}

/// How far the scope can be moved: the cervix and the device's workspace.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct DofLimits {
    /// |pitch| and |yaw|, rad, below π/2.
    pub tilt_rad: f32,
    /// |roll|, rad.
    pub roll_rad: f32,
    /// Least insertion, m; above 0, for at the pivot itself the tip has no direction.
    pub min_insertion_m: f32,
    /// Greatest insertion, m.
    pub max_insertion_m: f32,
}

impl Default for DofLimits {
    fn default() -> Self {
        Self { tilt_rad: 0.9, roll_rad: std::f32::consts::PI, min_insertion_m: 0.005, max_insertion_m: 0.12 }
    }
}

impl DofLimits {
    /// `pose` inside the limits; what is not a number becomes 0, or the least insertion. Limits that are not numbers or are
    /// the wrong way round count as 0 width.
    pub fn clamp(&self, pose: &Pose4) -> Pose4 {
        let tilt = sane(self.tilt_rad, 0.0, 1.5, 0.0);
        let roll = sane(self.roll_rad, 0.0, std::f32::consts::PI, 0.0);
        let least = sane(self.min_insertion_m, 1e-3, 1.0, 1e-3);
        let greatest = sane(self.max_insertion_m, least, 1.0, least);
        Pose4 {
            pitch_rad: sane(pose.pitch_rad, -tilt, tilt, 0.0),
            yaw_rad: sane(pose.yaw_rad, -tilt, tilt, 0.0),
            roll_rad: sane(pose.roll_rad, -roll, roll, 0.0),
            insertion_m: sane(pose.insertion_m, least, greatest, least),
        }
    }
}

/// Tip position, m, and orientation, unit quaternion (x, y, z, w) whose local +z is the scope's axis, of `pose` about
/// `pivot_m`. Expects finite numbers; give poses of unknown origin through [`DofLimits::clamp`] first.
pub fn pose_from_dof(pivot_m: [f32; 3], pose: &Pose4) -> ([f32; 3], [f32; 4]) {
    let (yaw, pitch, roll) = (f64::from(pose.yaw_rad), f64::from(pose.pitch_rad), f64::from(pose.roll_rad));
    let turn = DQuat::from_rotation_y(yaw) * DQuat::from_rotation_x(pitch) * DQuat::from_rotation_z(roll);
    let axis = DVec3::new(yaw.sin() * pitch.cos(), -pitch.sin(), yaw.cos() * pitch.cos());
    let tip = DVec3::from_array(pivot_m.map(f64::from)) + axis * f64::from(pose.insertion_m);
    (tip.as_vec3().to_array(), turn.as_quat().normalize().to_array())
}

/// The degrees of freedom of a tip position, m, and an orientation (x, y, z, w): the inverse of [`pose_from_dof`] for insertions
/// above 0 and tilts below π/2. Pitch and yaw follow the line from pivot to tip (the scope passes through the pivot), roll the
/// orientation. Numbers that are not finite give the pose 0.
pub fn dof_from_pose(pivot_m: [f32; 3], tip_m: [f32; 3], orientation: [f32; 4]) -> Pose4 {
    let turn = DQuat::from_array(orientation.map(f64::from));
    let length = turn.length();
    if !(is_finite(pivot_m) && is_finite(tip_m) && length.is_finite() && length > 1e-6) {
        return Pose4::default();
    }
    let turn = turn / length;
    let lever = DVec3::from_array(tip_m.map(f64::from)) - DVec3::from_array(pivot_m.map(f64::from));
    let insertion_m = lever.length() as f32;
    let axis = if lever.length() > MIN_LEVER_M { lever.normalize() } else { turn * DVec3::Z };
    let yaw = axis.x.atan2(axis.z);
    let pitch = (-axis.y).atan2(axis.x.hypot(axis.z));
    let tilt = DQuat::from_rotation_y(yaw) * DQuat::from_rotation_x(pitch);
    let (roll, _, _) = (tilt.conjugate() * turn).to_euler(EulerRot::ZYX);
    Pose4 { pitch_rad: pitch as f32, yaw_rad: yaw as f32, roll_rad: roll as f32, insertion_m }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Quat, Vec3};
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    fn pose(pitch_rad: f32, yaw_rad: f32, roll_rad: f32, insertion_m: f32) -> Pose4 {
        Pose4 { pitch_rad, yaw_rad, roll_rad, insertion_m }
    }

    #[test]
    fn signs_are_as_documented() {
        let (straight, turn) = pose_from_dof([0.0; 3], &pose(0.0, 0.0, 0.3, 0.06));
        assert_eq!(straight, [0.0, 0.0, 0.06]);
        assert!((Quat::from_array(turn) * Vec3::Z - Vec3::Z).length() < 1e-6);
        assert!(pose_from_dof([0.0; 3], &pose(0.1, 0.0, 0.0, 0.06)).0[1] < 0.0);
        assert!(pose_from_dof([0.0; 3], &pose(0.0, 0.1, 0.0, 0.06)).0[0] > 0.0);
    }

    #[test]
    fn limits_turn_anything_into_a_pose_within_them() {
        let limits = DofLimits::default();
        let wild = limits.clamp(&pose(f32::NAN, 9.0, f32::NEG_INFINITY, -3.0));
        assert_eq!(wild, pose(0.0, 0.9, 0.0, 0.005));
        let upside_down = DofLimits { min_insertion_m: 0.2, max_insertion_m: 0.1, tilt_rad: f32::NAN, ..limits };
        assert_eq!(upside_down.clamp(&pose(1.0, 1.0, 0.0, 0.5)), pose(0.0, 0.0, 0.0, 0.2));
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, rng_seed: RngSeed::Fixed(2), ..ProptestConfig::default() })]

        #[test]
        fn the_inverse_gives_back_the_pose(
            pitch in -1.2..1.2f32, yaw in -1.2..1.2f32, roll in -3.1..3.1f32, insertion in 0.005..0.12f32,
        ) {
            let given = pose(pitch, yaw, roll, insertion);
            let pivot = [0.001, -0.002, 0.003];
            let (tip, turn) = pose_from_dof(pivot, &given);
            let axis = Quat::from_array(turn) * Vec3::Z;
            prop_assert!((Vec3::from_array(pivot) + axis * insertion - Vec3::from_array(tip)).length() < 1e-7);
            let back = dof_from_pose(pivot, tip, turn);
            prop_assert!((back.pitch_rad - pitch).abs() < 2e-6 && (back.yaw_rad - yaw).abs() < 4e-6);
            prop_assert!((back.roll_rad - roll).abs() < 4e-6 && (back.insertion_m - insertion).abs() < 1e-7);
        }

        #[test]
        fn the_inverse_of_any_bits_is_finite(bits in prop::array::uniform10(any::<u32>())) {
            let f = bits.map(f32::from_bits);
            let back = dof_from_pose([f[0], f[1], f[2]], [f[3], f[4], f[5]], [f[6], f[7], f[8], f[9]]);
            prop_assert!(back.pitch_rad.is_finite() && back.yaw_rad.is_finite() && back.roll_rad.is_finite());
        }
    }
}
