//! How the scope was moved: path of the tip, turning of the camera head, speed, rest.
//!
//! A path is measured in strides: what moves less than a stride from where the last one ended is taken for the noise of the encoders, which
//! at 1 kHz would add up to metres. A straight path is exact to one stride. Where ticks are missing the straight way counts, a lower bound.

use crate::force::length;
use hyst_messages::HardwareSample;
use std::f64::consts::{PI, TAU};

/// A stride of the tip: the resolution of a common device is 0.05 mm, and a tick at 50 mm/s moves as much (assumption).
const STRIDE_M: f64 = 1e-4;
/// A stride of the camera head, half a degree (assumption).
const STRIDE_RAD: f64 = PI / 360.0;
/// A tip that is slower than this rests: it takes a second for 1 mm (assumption).
const IDLE_M_S: f64 = 1e-3;

/// The movement so far.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motion {
    stride_from_m: Option<[f64; 3]>,
    stride_from_rad: Option<f64>,
    low_m: [f64; 3],
    high_m: [f64; 3],
    path_m: f64,
    turned_rad: f64,
    tilt_sum_rad: f64,
    tilt_ticks: u64,
    speed_sum_m_s: f64,
    speed_ticks: u64,
    idle_ticks: u64,
    fastest_m_s: f64,
}

impl Motion {
    /// Takes the sample of one tick; what is not finite in it is left out.
    pub fn tick(&mut self, sample: &HardwareSample) {
        let pose = &sample.pose;
        if let Some(tip_m) = finite(pose.position_m) {
            self.step(tip_m);
        }
        // The horizon stays with the camera head: it turns with the scope, and against it.
        let head_rad = f64::from(pose.roll_rad) + f64::from(pose.camera_roll_rad);
        if head_rad.is_finite() {
            self.turn(head_rad);
        }
        if let Some(velocity_m_s) = finite(sample.velocity_m_s) {
            let speed_m_s = length(velocity_m_s);
            self.speed_sum_m_s += speed_m_s;
            self.speed_ticks += 1;
            self.idle_ticks += u64::from(speed_m_s < IDLE_M_S);
            self.fastest_m_s = self.fastest_m_s.max(speed_m_s);
        }
    }

    fn step(&mut self, tip_m: [f64; 3]) {
        let Some(from_m) = self.stride_from_m else {
            (self.low_m, self.high_m, self.stride_from_m) = (tip_m, tip_m, Some(tip_m));
            return;
        };
        self.low_m = std::array::from_fn(|axis| self.low_m[axis].min(tip_m[axis]));
        self.high_m = std::array::from_fn(|axis| self.high_m[axis].max(tip_m[axis]));
        let gone_m = length(difference(tip_m, from_m));
        if gone_m >= STRIDE_M {
            self.path_m += gone_m;
            self.stride_from_m = Some(tip_m);
        }
    }

    fn turn(&mut self, head_rad: f64) {
        self.tilt_sum_rad += wrapped(head_rad).abs();
        self.tilt_ticks += 1;
        let turned_rad = self.stride_from_rad.map(|from_rad| wrapped(head_rad - from_rad).abs());
        if turned_rad.is_none_or(|turned_rad| turned_rad >= STRIDE_RAD) {
            self.turned_rad += turned_rad.unwrap_or(0.0);
            self.stride_from_rad = Some(head_rad);
        }
    }

    /// Path of the tip, m; `None` without a pose.
    pub fn path_m(&self) -> Option<f64> {
        self.stride_from_m.map(|_| self.path_m)
    }

    /// Diagonal of the box that holds the path over its length: 1 for one straight stroke; `None` if nothing was moved.
    pub fn economy(&self) -> Option<f64> {
        (self.path_m > 0.0).then(|| length(difference(self.high_m, self.low_m)) / self.path_m)
    }

    /// Angle by which the camera head was turned in all, rad.
    pub fn turned_rad(&self) -> Option<f64> {
        self.stride_from_rad.map(|_| self.turned_rad)
    }

    /// Mean angle of the camera head to the upright, rad.
    pub fn tilt_rad(&self) -> Option<f64> {
        (self.tilt_ticks > 0).then_some(self.tilt_sum_rad / self.tilt_ticks as f64)
    }

    /// Mean speed of the tip, m/s.
    pub fn speed_m_s(&self) -> Option<f64> {
        (self.speed_ticks > 0).then_some(self.speed_sum_m_s / self.speed_ticks as f64)
    }

    /// Highest speed of the tip, m/s.
    pub fn fastest_m_s(&self) -> Option<f64> {
        (self.speed_ticks > 0).then_some(self.fastest_m_s)
    }

    /// Ticks in which the tip rested, and ticks whose speed is known.
    pub fn idle_ticks(&self) -> (u64, u64) {
        (self.idle_ticks, self.speed_ticks)
    }
}

/// The vector, if every part of it is a number.
pub(crate) fn finite(vector: [f32; 3]) -> Option<[f64; 3]> {
    vector.iter().all(|part| part.is_finite()).then(|| vector.map(f64::from))
}

/// `to` − `from`.
pub(crate) fn difference(to: [f64; 3], from: [f64; 3]) -> [f64; 3] {
    [to[0] - from[0], to[1] - from[1], to[2] - from[2]]
}

/// The same angle between −π and π.
pub(crate) fn wrapped(angle_rad: f64) -> f64 {
    (angle_rad + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::Pose;

    fn at(position_m: [f32; 3], roll_rad: f32) -> HardwareSample {
        HardwareSample { pose: Pose { position_m, roll_rad, ..Pose::default() }, ..HardwareSample::default() }
    }

    #[test]
    fn a_square_of_ten_millimetres_is_forty_long_and_its_box_has_the_diagonal() {
        let mut motion = Motion::default();
        let side: Vec<f32> = (0..=10).map(|step| step as f32 * 1e-3).collect();
        side.iter().for_each(|x| motion.tick(&at([*x, 0.0, 0.05], 0.0)));
        side.iter().for_each(|y| motion.tick(&at([0.01, *y, 0.05], 0.0)));
        side.iter().rev().for_each(|x| motion.tick(&at([*x, 0.01, 0.05], 0.0)));
        side.iter().rev().for_each(|y| motion.tick(&at([0.0, *y, 0.05], 0.0)));
        assert!((motion.path_m().unwrap() - 0.04).abs() < 1e-8);
        assert!((motion.economy().unwrap() - 2f64.sqrt() / 4.0).abs() < 1e-6);
    }

    #[test]
    fn noise_of_the_encoders_is_no_path() {
        let mut motion = Motion::default();
        for tick in 0..10_000 {
            motion.tick(&at([if tick % 2 == 0 { 0.0 } else { 5e-5 }, 0.0, 0.05], 0.0));
        }
        assert_eq!((motion.path_m(), motion.economy()), (Some(0.0), None));
    }

    #[test]
    fn the_camera_head_turns_the_short_way_and_against_the_scope_too() {
        let mut motion = Motion::default();
        motion.tick(&at([0.0; 3], 3.0));
        motion.tick(&at([0.0; 3], -3.0)); // over π
        assert!((motion.turned_rad().unwrap() - (TAU - 6.0)).abs() < 1e-6);
        let mut still = at([0.0; 3], 0.5);
        still.pose.camera_roll_rad = -0.5;
        let mut motion = Motion::default();
        (0..5).for_each(|_| motion.tick(&still));
        assert_eq!((motion.turned_rad(), motion.tilt_rad()), (Some(0.0), Some(0.0)));
    }

    #[test]
    fn speeds_by_hand_and_what_is_no_number_is_left_out() {
        let mut motion = Motion::default();
        for speed_m_s in [0.0, 0.03, f32::NAN] {
            let mut sample = at([f32::NAN, 0.0, 0.0], f32::NAN);
            sample.velocity_m_s = [0.0, speed_m_s, 0.0];
            motion.tick(&sample);
        }
        assert!((motion.speed_m_s().unwrap() - 0.015).abs() < 1e-8 && (motion.fastest_m_s().unwrap() - 0.03).abs() < 1e-8);
        assert_eq!(motion.idle_ticks(), (1, 2));
        assert_eq!((motion.path_m(), motion.turned_rad(), motion.tilt_rad()), (None, None, None));
    }
}
