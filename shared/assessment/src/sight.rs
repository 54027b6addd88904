//! What is seen through the scope: whether a point lies in the inner part of the picture, near enough and with light. What is between the lens and the point
//! is not looked at: a recording holds no shapes.

use crate::force::length;
use crate::medium::SHUT;
use crate::motion::{difference, finite};
use hyst_messages::{HardwareSample, Pose};
use hyst_scene::Sight;

/// The scope's axis, a unit vector into the uterus.
pub(crate) fn axis(pose: &Pose) -> [f64; 3] {
    let [x, y, z, w] = pose.orientation.map(f64::from);
    [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)]
}

/// Whether a point is in sight.
pub(crate) fn is_in_sight(sight: &Sight, point_m: [f64; 3], sample: &HardwareSample) -> bool {
    let pose = &sample.pose;
    let Some(tip_m) = finite(pose.position_m).filter(|_| sample.controls.light >= SHUT) else { return false };
    let away_m = difference(point_m, tip_m);
    let far_m = length(away_m);
    let [x, y, z, w] = pose.orientation.map(f64::from);
    // The scope's axis and its +y: a fore-oblique optic looks along the one, turned towards the other; the camera head turns the picture alone.
    let axis = axis(pose);
    let up = [2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)];
    let (sin, cos) = sight.optic_rad.sin_cos();
    let along_m: f64 = (0..3).map(|i| away_m[i] * (cos * axis[i] + sin * up[i])).sum();
    far_m > 0.0 && far_m <= sight.within_m && along_m >= far_m * sight.within_rad.cos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::Controls;

    const SIGHT: Sight = Sight { optic_rad: 0.5, within_rad: 0.3, within_m: 0.02 };

    /// A scope at the origin, turned about its axis.
    fn sample(roll_rad: f32) -> HardwareSample {
        let (sin, cos) = (0.5 * roll_rad).sin_cos();
        let pose = Pose { orientation: [0.0, 0.0, sin, cos], ..Pose::default() };
        HardwareSample { pose, controls: Controls { light: 1.0, ..Controls::default() }, ..HardwareSample::default() }
    }

    /// A point so far from the tip, at an angle to the axis towards +y.
    fn at(far_m: f64, angle_rad: f64) -> [f64; 3] {
        [0.0, far_m * angle_rad.sin(), far_m * angle_rad.cos()]
    }

    #[test]
    fn a_fore_oblique_optic_looks_up_and_not_straight_ahead_and_so_far() {
        let sees = |point_m| is_in_sight(&SIGHT, point_m, &sample(0.0));
        assert_eq!([0.19, 0.21, 0.5, 0.79, 0.81].map(|angle| sees(at(0.01, angle))), [false, true, true, true, false]);
        assert_eq!([0.0, 1e-4, 0.0199, 0.0201].map(|far_m| sees(at(far_m, 0.5))), [false, true, true, false]);
        assert!(!sees([f64::NAN; 3]));
    }

    #[test]
    fn the_light_post_swings_the_view_and_without_light_or_pose_nothing_is_seen() {
        let half_turn = std::f32::consts::PI;
        assert!(
            is_in_sight(&SIGHT, at(0.01, -0.5), &sample(half_turn)) && !is_in_sight(&SIGHT, at(0.01, 0.5), &sample(half_turn))
        );
        let left = [-0.01 * 0.5_f64.sin(), 0.0, 0.01 * 0.5_f64.cos()];
        assert!(is_in_sight(&SIGHT, left, &sample(0.5 * half_turn)), "a quarter turn looks to the patient's left");
        let (mut dark, mut nowhere) = (sample(0.0), sample(0.0));
        dark.controls.light = 0.01;
        nowhere.pose.position_m[1] = f32::NAN;
        assert!(!is_in_sight(&SIGHT, at(0.01, 0.5), &dark) && !is_in_sight(&SIGHT, at(0.01, 0.5), &nowhere));
        let mut wild = sample(0.0);
        wild.pose.orientation = [f32::INFINITY; 4];
        assert!(!is_in_sight(&SIGHT, at(0.01, 0.5), &wild));
    }
}
