//! How the scope was moved: path of the tip, turning of the camera head, speed, rest.
//!
//! A path is measured in strides: what moves less than a stride from where the last one ended is taken for the noise of the encoders, which
//! at 1 kHz would add up to metres. A straight path is exact to one stride. Where ticks are missing the straight way counts, a lower bound.
//!
//! How the camera head was held is told only of who held it: not where the station keeps the horizon level however the scope turns, as the simulated device
//! does for whoever turns it, and not where the scope was not turned, so that there was nothing to keep. Both are seen by what the two angles do.

use crate::force::length;
use hyst_messages::HardwareSample;
use std::f64::consts::{PI, TAU};

/// A stride of the tip: the resolution of a common device is 0.05 mm, and a tick at 50 mm/s moves as much (assumption).
const STRIDE_M: f64 = 1e-4;
/// A stride of the camera head, half a degree (assumption).
const STRIDE_RAD: f64 = PI / 360.0;
/// The scope turns about its axis in a tick in which it does so by this, rad: 6 degrees a second (assumption).
const TURNING_RAD: f64 = 1e-4;
/// The horizon stands still in such a tick where it turns by less than this share of that: two hands do not make up for each other so well.
const LEVEL_SHARE: f64 = 0.02;
/// With so large a share of such ticks the head is held level by something that is no hand (assumption).
const LEVELLED_SHARE: f64 = 0.1;
/// The scope was turned where that was by so much in all, rad: by as much as the usual optic looks aside.
const TURNED_RAD: f64 = PI / 6.0;
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
    /// Roll and horizon in the tick before, rad.
    rolled_from_rad: Option<[f64; 2]>,
    /// By how much the scope was turned in all, rad; the ticks in which it was, and of them those in which the horizon stood still.
    rolled_rad: f64,
    rolling_ticks: u64,
    level_ticks: u64,
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
            self.roll(f64::from(pose.roll_rad), head_rad);
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

    fn roll(&mut self, roll_rad: f64, head_rad: f64) {
        let Some([roll_from_rad, head_from_rad]) = self.rolled_from_rad.replace([roll_rad, head_rad]) else { return };
        let rolled_rad = wrapped(roll_rad - roll_from_rad).abs();
        if rolled_rad >= TURNING_RAD {
            self.rolled_rad += rolled_rad;
            self.rolling_ticks += 1;
            self.level_ticks += u64::from(wrapped(head_rad - head_from_rad).abs() < LEVEL_SHARE * rolled_rad);
        }
    }

    /// Whether the camera head was held by a hand that had a horizon to keep.
    fn is_head_held(&self) -> bool {
        self.rolled_rad >= TURNED_RAD && (self.level_ticks as f64) < LEVELLED_SHARE * self.rolling_ticks as f64
    }

    /// Path of the tip, m; `None` without a pose.
    pub fn path_m(&self) -> Option<f64> {
        self.stride_from_m.map(|_| self.path_m)
    }

    /// Diagonal of the box that holds the path over its length: 1 for one straight stroke; `None` if nothing was moved.
    pub fn economy(&self) -> Option<f64> {
        (self.path_m > 0.0).then(|| length(difference(self.high_m, self.low_m)) / self.path_m)
    }

    /// Angle by which the camera head was turned in all, rad; `None` where nobody held it.
    pub fn turned_rad(&self) -> Option<f64> {
        self.is_head_held().then_some(self.turned_rad)
    }

    /// Mean angle of the camera head to the upright, rad; `None` where nobody held it.
    pub fn tilt_rad(&self) -> Option<f64> {
        self.is_head_held().then(|| self.tilt_sum_rad / self.tilt_ticks as f64)
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

    /// A scope that turns by so much in each tick, from 0 on, in a head that turns by so much of that against it.
    fn turning(by_rad: f32, against: f32, ticks: usize) -> Motion {
        let mut motion = Motion::default();
        for tick in 0..=ticks {
            let mut sample = at([0.0; 3], tick as f32 * by_rad);
            sample.pose.camera_roll_rad = -against * sample.pose.roll_rad;
            motion.tick(&sample);
        }
        motion
    }

    #[test]
    fn a_head_that_turns_with_the_scope_tilts_the_horizon_and_the_short_way_counts() {
        let mut motion = turning(0.002, 0.0, 1_000); // to 2 rad
        assert!((motion.turned_rad().unwrap() - 2.0).abs() < 0.01 && (motion.tilt_rad().unwrap() - 1.0).abs() < 1e-3);
        let before_rad = motion.turned_rad().unwrap();
        [3.0, -3.0].iter().for_each(|roll_rad| motion.tick(&at([0.0; 3], *roll_rad))); // over π
        assert!((motion.turned_rad().unwrap() - before_rad - (1.0 + TAU - 6.0)).abs() < 0.01, "{motion:?}");
        let held = turning(0.002, 0.9, 1_000); // a hand that makes up for nine tenths
        assert!((held.turned_rad().unwrap() - 0.2).abs() < 0.01 && (held.tilt_rad().unwrap() - 0.1).abs() < 1e-3, "{held:?}");
    }

    /// Who never touched the camera head had the best score for it.
    #[test]
    fn of_a_head_that_is_held_level_for_the_hand_and_of_a_scope_that_is_not_turned_nothing_is_told() {
        let untold = [turning(0.002, 1.0, 1_000), turning(0.002, 0.0, 200), turning(0.0, 0.0, 1_000)];
        for motion in &untold {
            assert_eq!((motion.turned_rad(), motion.tilt_rad()), (None, None), "{motion:?}");
        }
        // Somebody turns the level head by a quarter on the way.
        let mut turned = turning(0.002, 1.0, 1_000);
        for tick in 0..1_000 {
            let mut sample = at([0.0; 3], 2.0);
            sample.pose.camera_roll_rad = -2.0 + 0.0015 * tick as f32;
            turned.tick(&sample);
        }
        assert_eq!((turned.turned_rad(), turned.tilt_rad()), (None, None));
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
