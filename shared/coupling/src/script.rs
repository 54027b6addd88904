//! Scripted hands: where the trainee's hand wants to be, as a pure function of time.
//!
//! They promise trajectories that are twice continuously differentiable and periodic with `period_s` (explore after its entry), so
//! that a step in the force never comes from the hand. Between two resting poses the path is that of least jerk (Flash and
//! Hogan 1985): `10u³ − 15u⁴ + 6u⁵`. What the hand wants is not where the scope is: see [`crate::hand`].

use crate::pose::Pose4;

/// Button bit of [`HandPose::buttons`]: the electrode cuts while it is set.
pub const BUTTON_ENERGIZED: u32 = 1;
/// Button bit of [`HandPose::buttons`]: the loop electrode is extended while it is set.
pub const BUTTON_EXTENDED: u32 = 1 << 1;
/// Button bit of [`HandPose::buttons`]: the electrode coagulates while it is set.
pub const BUTTON_COAGULATING: u32 = 1 << 2;

/// The scripts that always exist.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hand {
    /// Rests at `rest`.
    Idle = 0,
    /// From `rest` into the wall at `into` and out, again and again.
    Press = 1,
    /// A tour round the cavity: Lissajous of pitch and yaw, slow roll, insertion between `rest` and `into`.
    Explore = 2,
    /// Approach, extend the loop, touch the polyp at `into`, energize, sweep, release, retract. For where there is no room to draw the loop along the
    /// polyp, which takes [`hand_along`].
    Polyp = 3,
}

impl Hand {
    /// All scripts by the name that the command line uses.
    pub const NAMES: [(&'static str, Hand); 4] =
        [("idle", Hand::Idle), ("press", Hand::Press), ("explore", Hand::Explore), ("polyp", Hand::Polyp)];

    /// The script of that name, `None` if there is none.
    pub fn by_name(name: &str) -> Option<Hand> {
        Self::NAMES.iter().find(|(known, _)| *known == name).map(|(_, hand)| *hand)
    }
}

/// A script with the poses of the scene. All poses must lie inside the scope's limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandScript {
    /// Which script.
    pub hand: Hand,
    /// In the free cavity.
    pub rest: Pose4,
    /// Press: behind the wall, as deep as the hand wants to press. Polyp: at the stalk.
    pub into: Pose4,
    /// Amplitude of Explore's tour (pitch, yaw, roll) and of Polyp's sweep (all four).
    pub sweep: Pose4,
    /// Duration of one round, s; not above 0 counts as the script's own default.
    pub period_s: f32,
}

impl HandScript {
    /// A script with its default period (press 2 s, explore 12 s, polyp 10 s) and sweep.
    pub fn new(hand: Hand, rest: Pose4, into: Pose4) -> Self {
        let sweep = match hand {
            Hand::Explore => Pose4 { pitch_rad: 0.15, yaw_rad: 0.25, roll_rad: 0.6, insertion_m: 0.0 },
            _ => Pose4 { pitch_rad: 0.06, yaw_rad: 0.06, roll_rad: 0.0, insertion_m: -0.002 },
        };
        Self { hand, rest, into, sweep, period_s: default_period_s(hand) }
    }
}

/// Where the hand wants the scope, and what it presses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandPose {
    /// Wanted pose.
    pub pose: Pose4,
    /// `BUTTON_…` bits.
    pub buttons: u32,
    /// Whether it holds the outflow valve wide open.
    pub is_rinsing: bool,
}

impl HandPose {
    /// With nothing pressed, and the valves as they are.
    fn cold(pose: Pose4) -> HandPose {
        HandPose { pose, buttons: 0, is_rinsing: false }
    }
}

/// The hand at `t_s` seconds since the start. Time that is negative or not a number counts as 0.
pub fn hand_pose(script: &HandScript, t_s: f64) -> HandPose {
    let t_s = if t_s.is_finite() { t_s.max(0.0) } else { 0.0 };
    let period_s = f64::from(script.period_s);
    let period_s = if period_s > 0.0 && period_s < 1e6 { period_s } else { f64::from(default_period_s(script.hand)) };
    let u = (t_s / period_s).fract();
    let (rest, into) = (script.rest, script.into);
    match script.hand {
        Hand::Idle => HandPose::cold(rest),
        Hand::Press => along(&[(0.1, rest, 0), (0.45, into, 0), (0.6, into, 0), (0.95, rest, 0), (1.0, rest, 0)], u),
        Hand::Explore => HandPose::cold(tour(script, t_s / period_s)),
        Hand::Polyp => polyp(script, u),
    }
}

/// A part of what a hand does: it goes from where it rests to a pose, and rests there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// Where it ends.
    pub to: Pose4,
    /// Time that it takes, s; what is not above 0 counts as 0, and what is not a number.
    pub time_s: f64,
    /// `BUTTON_…` bits during it.
    pub buttons: u32,
    /// Whether the outflow valve is wide open during it.
    pub is_rinsing: bool,
}

/// The hand at `t_s` seconds since the start: along the legs one after the other, from where the last one ends, again and again. Time that is negative
/// or not a number counts as 0; without a leg that takes time the hand rests where the last one ends.
pub fn hand_along(legs: &[Leg], t_s: f64) -> HandPose {
    let Some(last) = legs.last() else { return HandPose::cold(Pose4::default()) };
    let time_s = |leg: &Leg| if leg.time_s.is_finite() { leg.time_s.max(0.0) } else { 0.0 };
    let period_s: f64 = legs.iter().map(time_s).sum();
    let resting = HandPose::cold(last.to);
    if period_s <= 0.0 {
        return resting;
    }
    let mut left_s = if t_s.is_finite() { t_s.max(0.0) % period_s } else { 0.0 };
    let mut from = last.to;
    for leg in legs {
        let leg_s = time_s(leg);
        if left_s < leg_s {
            let pose = from.blend(&leg.to, least_jerk(left_s / leg_s));
            return HandPose { pose, buttons: leg.buttons, is_rinsing: leg.is_rinsing };
        }
        (left_s, from) = (left_s - leg_s, leg.to);
    }
    resting
}

/// The period that suits a script, s.
fn default_period_s(hand: Hand) -> f32 {
    match hand {
        Hand::Idle | Hand::Press => 2.0,
        Hand::Explore => 12.0,
        Hand::Polyp => 10.0,
    }
}

/// One removal of a polyp.
fn polyp(script: &HandScript, u: f64) -> HandPose {
    const CUT: u32 = BUTTON_EXTENDED | BUTTON_ENERGIZED;
    let (rest, into, sweep) = (script.rest, script.into, &script.sweep);
    let near = rest.blend(&into, 0.8);
    let keys = [
        (0.05, rest, 0),
        (0.20, near, 0),
        (0.25, near, BUTTON_EXTENDED),
        (0.38, into, BUTTON_EXTENDED),
        (0.42, into, CUT),
        (0.54, into.shifted(sweep, 1.0), CUT),
        (0.72, into.shifted(sweep, -1.0), CUT),
        (0.80, into, CUT),
        (0.84, into, BUTTON_EXTENDED),
        (0.90, near, 0),
        (1.00, rest, 0),
    ];
    along(&keys, u)
}

/// The pose at share `u` of a round through resting poses: each key is (end of its segment, pose there, buttons during
/// it). The first segment rests at the first pose; the last pose must be the first one.
fn along(keys: &[(f64, Pose4, u32)], u: f64) -> HandPose {
    let (mut from_u, mut from) = (0.0, keys[0].1);
    for (to_u, to, buttons) in keys {
        if u <= *to_u {
            let share = least_jerk((u - from_u) / (to_u - from_u));
            return HandPose { pose: from.blend(to, share), buttons: *buttons, is_rinsing: false };
        }
        (from_u, from) = (*to_u, *to);
    }
    HandPose::cold(from)
}

/// The tour: `rounds` is time in periods. It begins at `rest` and swells to full amplitude over the first quarter round.
fn tour(script: &HandScript, rounds: f64) -> Pose4 {
    let swell = least_jerk(rounds * 4.0);
    let angle = std::f64::consts::TAU * rounds;
    let inward = f64::from(script.into.insertion_m) - f64::from(script.rest.insertion_m);
    let sweep = &script.sweep;
    let offset = Pose4 {
        pitch_rad: (f64::from(sweep.pitch_rad) * (3.0 * angle).sin()) as f32,
        yaw_rad: (f64::from(sweep.yaw_rad) * (2.0 * angle).sin()) as f32,
        roll_rad: (f64::from(sweep.roll_rad) * angle.sin()) as f32,
        insertion_m: (inward * 0.5 * (1.0 - angle.cos())) as f32,
    };
    script.rest.shifted(&offset, swell)
}

/// From 0 to 1 with no speed and no acceleration at either end; outside it stays at the ends.
fn least_jerk(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u * u * u * (10.0 + u * (-15.0 + 6.0 * u))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::DofLimits;

    fn script(hand: Hand) -> HandScript {
        let rest = Pose4 { pitch_rad: 0.02, yaw_rad: -0.05, roll_rad: 0.1, insertion_m: 0.045 };
        let into = Pose4 { pitch_rad: -0.1, yaw_rad: 0.2, roll_rad: 0.0, insertion_m: 0.068 };
        HandScript::new(hand, rest, into)
    }

    fn dofs(pose: Pose4) -> [f64; 4] {
        [pose.pitch_rad, pose.yaw_rad, pose.roll_rad, pose.insertion_m].map(f64::from)
    }

    fn legs() -> [Leg; 5] {
        let pose = |pitch_rad, yaw_rad, roll_rad, insertion_m| Pose4 { pitch_rad, yaw_rad, roll_rad, insertion_m };
        let leg = |to, time_s, buttons| Leg { to, time_s, buttons, is_rinsing: buttons == 0 };
        const CUT: u32 = BUTTON_EXTENDED | BUTTON_ENERGIZED;
        [
            leg(pose(0.0, 0.0, 0.0, 0.02), 0.5, 0),
            leg(pose(0.02, 0.1, -0.9, 0.03), 2.0, BUTTON_EXTENDED),
            leg(pose(0.02, 0.14, -0.9, 0.03), 0.8, CUT),
            leg(pose(0.02, 0.14, -0.9, 0.02), 1.7, CUT),
            leg(pose(0.0, 0.0, 0.0, 0.02), 2.0, 0),
        ]
    }

    /// A kink in position, speed or acceleration of size s shows as s/h², s/h or s in the second difference of step h; a smooth one changes it
    /// by jerk · h between neighbours.
    fn assert_smooth(name: &str, pose: impl Fn(f64) -> Pose4) {
        let h = 0.004;
        let second = |n: i32| {
            let at = |k: i32| dofs(pose(f64::from(n + k) * h));
            let (a, b, c) = (at(-1), at(0), at(1));
            std::array::from_fn::<f64, 4, _>(|d| (a[d] - 2.0 * b[d] + c[d]) / (h * h))
        };
        for n in 1..6000 {
            let (now, next) = (second(n), second(n + 1));
            let change = (0..4).map(|d| (now[d] - next[d]).abs()).fold(0.0, f64::max);
            assert!(change < 0.35, "{name} at {} s: acceleration changes by {change}", f64::from(n) * h);
        }
    }

    #[test]
    fn every_script_is_twice_continuously_differentiable() {
        for (name, hand) in Hand::NAMES {
            assert_smooth(name, |t_s| hand_pose(&script(hand), t_s).pose);
        }
        assert_smooth("legs", |t_s| hand_along(&legs(), t_s).pose);
    }

    #[test]
    fn legs_end_at_their_poses_with_their_buttons_and_begin_anew_where_the_last_one_ended() {
        let (legs, mut end_s) = (legs(), 0.0);
        for (index, leg) in legs.iter().enumerate() {
            let middle = hand_along(&legs, end_s + leg.time_s / 2.0);
            end_s += leg.time_s;
            let end = hand_along(&legs, end_s - 1e-9);
            assert_eq!((middle.buttons, end.buttons), (leg.buttons, leg.buttons), "leg {index}");
            assert_eq!((middle.is_rinsing, end.is_rinsing), (leg.is_rinsing, leg.is_rinsing), "leg {index}");
            for (a, b) in dofs(end.pose).into_iter().zip(dofs(leg.to)) {
                assert!((a - b).abs() < 1e-7, "leg {index}: {end:?}");
            }
        }
        assert_eq!(hand_along(&legs, 0.0).pose, legs[4].to);
        assert_eq!(hand_along(&legs, 3.0 + 8.0 * end_s).buttons, hand_along(&legs, 3.0).buttons);
    }

    #[test]
    fn legs_without_time_or_with_time_that_is_none_are_rested_at() {
        let resting = HandPose::cold(legs()[4].to);
        for time_s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let timeless = legs().map(|leg| Leg { time_s, ..leg });
            assert_eq!(hand_along(&timeless, 2.0), resting, "{time_s}");
            let mut one = legs();
            one[2].time_s = time_s;
            let expected = one[2].to.blend(&one[3].to, least_jerk(0.1 / 1.7));
            assert!((hand_along(&one, 2.6).pose.insertion_m - expected.insertion_m).abs() < 1e-7, "{time_s}");
        }
        assert_eq!(hand_along(&legs(), f64::NAN), hand_along(&legs(), 0.0));
        assert_eq!(hand_along(&[], 1.0), HandPose::cold(Pose4::default()));
    }

    #[test]
    fn press_reaches_the_wall_and_comes_back_every_period() {
        let script = script(Hand::Press);
        for round in [0.0, 1.0, 500.0] {
            let at = |u: f64| hand_pose(&script, (round + u) * 2.0).pose;
            assert_eq!((at(0.0), at(0.5), at(0.97)), (script.rest, script.into, script.rest));
        }
    }

    #[test]
    fn explore_stays_within_the_limits_and_covers_its_sweep() {
        let script = script(Hand::Explore);
        let limits = DofLimits::default();
        let poses: Vec<_> = (0..24_000).map(|ms| hand_pose(&script, f64::from(ms) * 1e-3).pose).collect();
        assert!(poses.iter().all(|p| limits.clamp(p) == *p));
        let most = poses.iter().map(|p| p.yaw_rad - script.rest.yaw_rad).fold(0.0, f32::max);
        assert!((most - script.sweep.yaw_rad).abs() < 1e-3);
        assert_eq!(poses[0], script.rest);
    }

    #[test]
    fn polyp_extends_before_it_energizes_and_energizes_only_at_the_polyp() {
        let script = script(Hand::Polyp);
        let (mut cut_ticks, mut swept) = (0, 0.0f32);
        for ms in 0..10_000 {
            let hand = hand_pose(&script, f64::from(ms) * 1e-3);
            if hand.buttons & BUTTON_ENERGIZED != 0 {
                assert_ne!(hand.buttons & BUTTON_EXTENDED, 0);
                assert!((hand.pose.insertion_m - script.into.insertion_m).abs() < 0.003);
                cut_ticks += 1;
                swept = swept.max((hand.pose.yaw_rad - script.into.yaw_rad).abs());
            }
        }
        assert!(cut_ticks > 3000 && swept > 0.05, "{cut_ticks} ticks, {swept} rad");
    }

    #[test]
    fn time_that_is_no_time_gives_the_start() {
        let broken = HandScript { period_s: f32::NAN, ..script(Hand::Press) };
        for t_s in [f64::NAN, -1.0, f64::NEG_INFINITY] {
            assert_eq!(hand_pose(&broken, t_s).pose, broken.rest);
        }
    }
}
