//! The hand's four degrees of freedom about the pivot, and the scripted hands that move through them.

use crate::file::{Hand, HandPose, LoopUse, ScriptLeg};
use crate::fluid::PumpChange;
use glam::{Quat, Vec3};

/// A pose of the instrument about the pivot.
///
/// The orientation is R_y(yaw) · R_x(pitch) · R_z(roll); the instrument's axis is its local +z, pointing inwards. Positive pitch
/// lowers the tip (−y, posterior), positive yaw moves it to +x (the patient's right).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pose {
    /// About x.
    pub pitch_rad: f32,
    /// About y.
    pub yaw_rad: f32,
    /// About the instrument's axis.
    pub roll_rad: f32,
    /// From pivot to tip.
    pub insertion_m: f32,
}

impl Pose {
    /// A straight pose at this insertion.
    pub fn straight(insertion_m: f32) -> Pose {
        Pose { insertion_m, ..Pose::default() }
    }

    /// The unit quaternion (x, y, z, w) from the instrument's frame to the scene's.
    pub fn orientation(&self) -> [f32; 4] {
        self.quat().to_array()
    }

    /// The instrument's axis in the scene's frame, a unit vector.
    pub fn axis(&self) -> [f32; 3] {
        (self.quat() * Vec3::Z).to_array()
    }

    /// Where the tip is.
    pub fn tip_m(&self, pivot_m: [f32; 3]) -> [f32; 3] {
        self.place(pivot_m, [0.0; 3])
    }

    /// A point of the instrument's frame (tip at the origin, shaft along −z) in the scene's frame.
    pub fn place(&self, pivot_m: [f32; 3], point_m: [f32; 3]) -> [f32; 3] {
        self.placer(pivot_m)(point_m)
    }

    /// [`Pose::place`] for many points.
    pub fn placer(&self, pivot_m: [f32; 3]) -> impl Fn([f32; 3]) -> [f32; 3] + use<> {
        let (turn, insertion_m) = (self.quat(), self.insertion_m);
        move |point_m| (Vec3::from(pivot_m) + turn * (Vec3::from(point_m) + Vec3::Z * insertion_m)).to_array()
    }

    /// The pose, without roll, whose axis passes through a point, the tip in that point. `None` if the point is at the pivot.
    pub fn aim(pivot_m: [f32; 3], point_m: [f32; 3]) -> Option<Pose> {
        let away = Vec3::from(point_m) - Vec3::from(pivot_m);
        let insertion_m = away.length();
        if !insertion_m.is_finite() || insertion_m < 1e-6 {
            return None;
        }
        let axis = away / insertion_m;
        Some(Pose { pitch_rad: (-axis.y).clamp(-1.0, 1.0).asin(), yaw_rad: axis.x.atan2(axis.z), roll_rad: 0.0, insertion_m })
    }

    /// The pose rolled so that the instrument's +y points to the side to which a direction does.
    pub fn facing(&self, direction: [f32; 3]) -> Pose {
        let turn = Pose { roll_rad: 0.0, ..*self }.quat();
        let along = |side: Vec3| (turn * side).dot(direction.into());
        Pose { roll_rad: (-along(Vec3::X)).atan2(along(Vec3::Y)), ..*self }
    }

    /// On the straight line, in the four coordinates, from this pose (0) to another (1).
    pub fn towards(&self, other: &Pose, share: f32) -> Pose {
        let mix = |a: f32, b: f32| a + (b - a) * share;
        Pose {
            pitch_rad: mix(self.pitch_rad, other.pitch_rad),
            yaw_rad: mix(self.yaw_rad, other.yaw_rad),
            roll_rad: mix(self.roll_rad, other.roll_rad),
            insertion_m: mix(self.insertion_m, other.insertion_m),
        }
    }

    fn quat(&self) -> Quat {
        Quat::from_rotation_y(self.yaw_rad) * Quat::from_rotation_x(self.pitch_rad) * Quat::from_rotation_z(self.roll_rad)
    }
}

impl From<&ScriptLeg> for HandLeg {
    fn from(leg: &ScriptLeg) -> HandLeg {
        HandLeg {
            to: Pose::from(&leg.to),
            time_s: leg.time_s,
            is_extended: leg.electrode != LoopUse::In,
            is_energized: leg.electrode == LoopUse::Cut,
            is_coagulating: leg.electrode == LoopUse::Coagulate,
            is_rinsing: false,
        }
    }
}

impl From<&HandPose> for Pose {
    fn from(pose: &HandPose) -> Pose {
        Pose {
            pitch_rad: pose.pitch_deg.to_radians() as f32,
            yaw_rad: pose.yaw_deg.to_radians() as f32,
            roll_rad: pose.roll_deg.to_radians() as f32,
            insertion_m: pose.insertion_m as f32,
        }
    }
}

/// A part of what a hand does: it goes from where it rests to a pose, and rests there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandLeg {
    /// Where it ends.
    pub to: Pose,
    /// Time that it takes.
    pub time_s: f64,
    /// Whether the loop electrode is to be out.
    pub is_extended: bool,
    /// Whether it is to cut.
    pub is_energized: bool,
    /// Whether it is to coagulate.
    pub is_coagulating: bool,
    /// Whether the outflow valve is to be wide open.
    pub is_rinsing: bool,
}

/// A scripted hand, ready to be followed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LoadedHand {
    /// Its name in the scene: `press`, `explore`, `polyp`, or the author's.
    pub name: String,
    /// Where it starts, what it passes, where it turns: at least two poses.
    pub way: Vec<Pose>,
    /// What it does with the loop, from `way[0]` and back to it, once per period; empty for a hand that goes there and back along its way.
    pub legs: Vec<HandLeg>,
    /// Time there and back, or that of all legs.
    pub period_s: f64,
    /// Index of the object that it is meant to touch.
    pub target: Option<usize>,
    /// It moves for one period and then rests where it began.
    pub is_once: bool,
    /// What it sets at the pump instead of what the scene says, in the order of its time.
    pub changes: Vec<PumpChange>,
}

impl LoadedHand {
    /// A hand that moves by itself, of which the checks have shown that it has a way or legs.
    pub(crate) fn from_file(name: &str, hand: &Hand, target: Option<usize>) -> LoadedHand {
        let common =
            LoadedHand { name: name.to_owned(), target, is_once: hand.once, changes: hand.change.clone(), ..Default::default() };
        if let (Some(first), Some(last)) = (hand.leg.first(), hand.leg.last()) {
            let legs: Vec<HandLeg> = hand.leg.iter().map(HandLeg::from).collect();
            let way = vec![Pose::from(&last.to), Pose::from(&first.to)];
            return LoadedHand { way, period_s: legs.iter().map(|leg| leg.time_s).sum(), legs, ..common };
        }
        let way = hand.from.iter().chain(&hand.through).chain(&hand.into).map(Pose::from).collect();
        LoadedHand { way, period_s: hand.period_s.unwrap_or(1.0), ..common }
    }

    /// A hand that moves like this one.
    pub(crate) fn like(&self, name: &str, hand: &Hand) -> LoadedHand {
        LoadedHand { name: name.to_owned(), is_once: hand.once, changes: hand.change.clone(), ..self.clone() }
    }

    /// The pose at a time: there and back along the way, once per period, at rest at both ends. A pure function of the time; a time
    /// that is not finite counts as 0. (Legs are followed by hyst-coupling's `hand_along`.)
    pub fn pose_at(&self, time_s: f64) -> Pose {
        let phase = if time_s.is_finite() { (time_s / self.period_s).rem_euclid(1.0) } else { 0.0 };
        let along = 0.5 - 0.5 * (phase * std::f64::consts::TAU).cos();
        let last = self.way.len() - 1;
        let position = along * last as f64;
        let segment = (position as usize).min(last - 1);
        self.way[segment].towards(&self.way[segment + 1], (position - segment as f64) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: [f32; 3], b: [f32; 3]) -> bool {
        Vec3::from(a).distance(Vec3::from(b)) < 1e-6
    }

    #[test]
    fn positive_pitch_lowers_the_tip_and_positive_yaw_moves_it_to_the_patients_right() {
        let quarter = std::f32::consts::FRAC_PI_2;
        let pitched = Pose { pitch_rad: quarter, insertion_m: 0.05, ..Pose::default() };
        assert!(near(pitched.tip_m([0.0; 3]), [0.0, -0.05, 0.0]));
        let yawed = Pose { yaw_rad: quarter, insertion_m: 0.05, ..Pose::default() };
        assert!(near(yawed.tip_m([0.0, 0.0, 1.0]), [0.05, 0.0, 1.0]));
    }

    #[test]
    fn aiming_at_a_point_puts_the_tip_there() {
        let pivot_m = [0.01, -0.02, 0.005];
        for point_m in [[0.03, 0.01, 0.06], [-0.02, -0.03, 0.04], [0.01, -0.02, 0.05]] {
            assert!(near(Pose::aim(pivot_m, point_m).unwrap().tip_m(pivot_m), point_m));
        }
        assert_eq!(Pose::aim(pivot_m, pivot_m), None);
    }

    #[test]
    fn a_pose_that_faces_a_direction_has_its_y_axis_there() {
        for direction in [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [-0.6, 0.8, 0.0], [0.0, 1.0, 0.5]] {
            let pose = Pose { pitch_rad: 0.2, yaw_rad: -0.4, roll_rad: 1.0, insertion_m: 0.05 }.facing(direction);
            let y = Vec3::from(pose.place([0.0; 3], [0.0, 1.0, 0.0])) - Vec3::from(pose.tip_m([0.0; 3]));
            let across = Vec3::from(direction).reject_from_normalized(pose.axis().into());
            assert!(y.distance(across.normalize()) < 1e-5, "{direction:?}: {y}");
        }
    }

    #[test]
    fn a_hand_goes_there_and_back_and_repeats_exactly() {
        let way = vec![Pose::straight(0.01), Pose::straight(0.02), Pose::straight(0.05)];
        let hand = LoadedHand { name: "x".to_owned(), way, period_s: 2.0, ..LoadedHand::default() };
        assert_eq!(hand.pose_at(0.0), Pose::straight(0.01));
        assert_eq!(hand.pose_at(1.0), Pose::straight(0.05));
        assert_eq!(hand.pose_at(0.5), Pose::straight(0.02));
        assert_eq!(hand.pose_at(0.25), hand.pose_at(4.25));
        assert_eq!(hand.pose_at(f64::NAN), Pose::straight(0.01));
    }
}
