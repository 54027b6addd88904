//! Where the hand is told other forces in two runs of a press, what these are made of there, and what the servo makes of the planes: printed by the tests that
//! compare the two.

use super::TICKS;
use crate::bench::press::parts::Parts;
use crate::bench::press::{Press, Record};
use glam::Vec3;
use hyst_contact::PlaneSet;
use hyst_coupling::{ContactModel, Plane, ServoInput, ServoParams, ServoState, servo_step};

/// Ticks of which a mean is taken: what swings is gone from it.
const MEAN_OF: usize = 20;
/// Ticks after which a servo that has just begun feels planes in full.
const WARM_TICKS: u64 = 1_000;
/// How far the parts of a force may be from it by rounding, N.
const ROUNDING_N: f32 = 1e-3;

/// A run in a tick.
#[derive(Clone, Copy)]
struct Seen {
    parts: Parts,
    force_n: Vec3,
    told_n: Vec3,
    planes: PlaneSet,
    tip_m: [f32; 3],
}

impl Seen {
    fn of((press, record): &(Press, Record), tick: usize) -> Seen {
        let (parts, (planes, tip_m)) = (press.parts(), press.planes(tick));
        let (force_n, told_n) = (Vec3::from(record.force_n), Vec3::from(record.told_n));
        let sum_n = parts.force_n();
        assert!(sum_n.distance(force_n) < ROUNDING_N, "tick {tick}: the parts make {sum_n} of {force_n} N: {parts:?}");
        Seen { parts, force_n, told_n, planes, tip_m }
    }

    /// What the servo makes of the planes for a hand that holds the tip where they were made, N.
    fn served_n(&self) -> Vec3 {
        let used = &self.planes.planes[..self.planes.count as usize];
        let planes: Vec<Plane> = used
            .iter()
            .map(|plane| Plane {
                point_m: plane.point_m,
                normal: plane.normal,
                stiffness_n_m: plane.stiffness_n_m,
                damping_n_s_m: plane.damping_n_s_m,
            })
            .collect();
        let (params, model) = (ServoParams::default(), ContactModel::new(&planes));
        let mut state = ServoState::default();
        for tick in 1..=WARM_TICKS {
            let input = ServoInput {
                tick,
                position_m: self.tip_m,
                velocity_m_s: [0.0; 3],
                dt_s: 1e-3,
                model: &model,
                model_age_ticks: 1,
                applied_n: None,
                medium_n: [0.0; 3],
            };
            state = servo_step(&params, &state, &input).0;
        }
        Vec3::from(state.force_n)
    }

    fn print(&self, whose: &str) {
        let Seen { parts, force_n, told_n, .. } = self;
        let Parts { pushed_n, damped_n, rubbed_n, pressed_n, friction_n, stiffness_n_m, count } = parts;
        let served_n = self.served_n();
        println!("    {whose}: force {force_n:.4} N of {count} contacts, {stiffness_n_m:.0} N/m together;");
        println!("      springs {pushed_n:.4}, their amounts {pressed_n:.4}; damping {damped_n:.4};");
        println!("      friction {rubbed_n:.4}, its amounts {friction_n:.4};");
        let [told, served] = [told_n, &served_n].map(|force_n| force_n.length());
        println!("      told {told_n:.4}, {told:.4} long; the servo makes {served_n:.4} of that, {served:.4} long");
    }
}

/// What is looked at while two runs press.
#[derive(Default)]
pub struct Told {
    /// How far apart the two are told in each tick, N.
    apart_n: Vec<Vec3>,
    /// The tick in which that is most, and the last one.
    worst: Option<(usize, [Seen; 2])>,
    last: Option<(usize, [Seen; 2])>,
}

impl Told {
    /// A tick of both.
    pub fn look(&mut self, tick: usize, runs: &[(Press, Record); 2]) {
        let [one_n, other_n] = runs.each_ref().map(|(_, record)| Vec3::from(record.told_n));
        let is_worst = |before: &Vec3| before.length() < one_n.distance(other_n);
        let seen = || Some((tick, runs.each_ref().map(|run| Seen::of(run, tick))));
        if one_n != other_n && self.apart_n.iter().all(is_worst) {
            self.worst = seen();
        }
        if tick + 1 == TICKS {
            self.last = seen();
        }
        self.apart_n.push(one_n - other_n);
    }

    /// Says what was seen.
    pub fn print(&self, what: &str) {
        let mean_n = |some: &[Vec3]| (some.iter().sum::<Vec3>() / MEAN_OF as f32).length();
        let most_n = self.apart_n.windows(MEAN_OF).map(mean_n).fold(0.0, f32::max);
        println!("{what}: told apart by {:.1} mN at most where {MEAN_OF} ticks are one", 1e3 * most_n);
        for (tick, [station, converged]) in self.worst.iter().chain(&self.last) {
            let apart_mn = |of: fn(&Seen) -> Vec3| 1e3 * of(station).distance(of(converged));
            let [told, force] = [apart_mn(|seen| seen.told_n), apart_mn(|seen| seen.force_n)];
            let [springs, damping] = [apart_mn(|seen| seen.parts.pushed_n), apart_mn(|seen| seen.parts.damped_n)];
            let friction = apart_mn(|seen| seen.parts.rubbed_n);
            println!("  tick {tick}, apart by, mN: told {told:.1}, force {force:.1};");
            println!("    of that springs {springs:.1}, damping {damping:.1}, friction {friction:.1}");
            station.print("the station's steps");
            converged.print("the converged");
        }
    }
}
