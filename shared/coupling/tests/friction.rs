//! Friction of the planes, as the hand feels it: Coulomb's law by hand arithmetic, a tip at rest that stays, a canal, a corner, no energy for the hand, and
//! nothing of it where a model says none.

#[allow(dead_code)] // each test file uses its part
mod bench;

use bench::{Bench, DT_S, Tissue, cavity, corner, wall};
use glam::Vec3;
use hyst_coupling::*;

/// Stiffness of a wall, N/m, and how deep the tip is in it, m: 1 N.
const STIFFNESS_N_M: f32 = 400.0;
const DEEP_M: f32 = 0.002_5;
/// Coefficient of friction: of 1 N 0.2 N.
const FRICTION: f32 = 0.2;
/// Stiffness of the bristle, N/m: a tenth of the coupling.
const BRISTLE_N_M: f32 = 120.0;

fn plane(point_m: [f32; 3], normal: [f32; 3]) -> Plane {
    Plane { point_m, normal, stiffness_n_m: STIFFNESS_N_M, damping_n_s_m: 0.0 }
}

fn rubbing(planes: &[Plane], friction: f32) -> ContactModel {
    ContactModel { friction, ..ContactModel::new(planes) }
}

/// A floor at z = 0 whose free side is up.
fn floor(friction: f32) -> ContactModel {
    rubbing(&[plane([0.0; 3], [0.0, 0.0, 1.0])], friction)
}

/// A servo and where its tip is.
#[derive(Clone, Copy)]
struct Tip {
    state: ServoState,
    place_m: Vec3,
}

impl Tip {
    /// In its place for a while, in a model.
    fn resting(place_m: Vec3, model: &ContactModel) -> Tip {
        let mut tip = Tip { state: ServoState::default(), place_m };
        tip.slide(Vec3::ZERO, 600, model);
        tip
    }

    /// So many ticks at a speed, m/s; gives the energy that the force gave the hand, J.
    fn slide(&mut self, velocity_m_s: Vec3, ticks: u64, model: &ContactModel) -> f64 {
        let mut given_j = 0.0;
        for _ in 0..ticks {
            let way_m = velocity_m_s * DT_S;
            given_j += f64::from(Vec3::from(self.state.force_n).dot(way_m));
            self.place_m += way_m;
            let input = ServoInput {
                tick: self.state.tick + 1,
                position_m: self.place_m.to_array(),
                velocity_m_s: velocity_m_s.to_array(),
                dt_s: DT_S,
                model,
                model_age_ticks: 1,
                applied_n: None,
                medium_n: [0.0; 3],
            };
            self.state = servo_step(&ServoParams::default(), &self.state, &input).0;
        }
        given_j
    }

    fn force_n(&self) -> Vec3 {
        Vec3::from(self.state.force_n)
    }
}

fn near(found_n: Vec3, expected_n: Vec3) -> bool {
    found_n.distance(expected_n) < 2e-3
}

#[test]
fn a_tip_that_slides_is_held_back_by_the_coefficient_times_the_push_and_one_that_turns_back_is_first_let_go_of() {
    let model = floor(FRICTION);
    let mut tip = Tip::resting(Vec3::new(0.0, 0.0, -DEEP_M), &model);
    assert!(near(tip.force_n(), Vec3::Z), "{:?}", tip.force_n());
    let along = Vec3::new(0.6, 0.8, 0.0);
    // Half a millimetre before it slides: a spring.
    tip.slide(along * 0.01, 50, &model);
    assert!(near(tip.force_n(), Vec3::Z - along * BRISTLE_N_M * 0.000_5), "{:?}", tip.force_n());
    // 0.2 N over 120 N/m: after 1.7 mm it slides.
    for speed_m_s in [0.01, 0.05, 0.3] {
        tip.slide(along * speed_m_s, (0.01 / speed_m_s / DT_S) as u64, &model);
        assert!(near(tip.force_n(), Vec3::Z - along * FRICTION), "{speed_m_s} m/s: {:?}", tip.force_n());
    }
    // Back by as far as the bristle is bent it is straight; by twice as far it holds with all it has, the other way.
    let bent_m = FRICTION / BRISTLE_N_M;
    let ticks = (bent_m / 0.01 / DT_S).round() as u64;
    tip.slide(-along * 0.01, ticks, &model);
    assert!(near(tip.force_n(), Vec3::Z), "{:?}", tip.force_n());
    tip.slide(-along * 0.01, ticks + 1, &model);
    assert!(near(tip.force_n(), Vec3::Z + along * FRICTION), "{:?}", tip.force_n());
}

#[test]
fn a_tip_that_stops_stays_where_it_is_and_one_that_is_lifted_off_is_held_by_nothing() {
    let model = floor(FRICTION);
    let mut tip = Tip::resting(Vec3::new(0.0, 0.0, -DEEP_M), &model);
    tip.slide(Vec3::X * 0.02, 300, &model);
    let held_n = tip.force_n();
    assert!(near(held_n, Vec3::Z - Vec3::X * FRICTION), "{held_n}");
    tip.slide(Vec3::ZERO, 5_000, &model);
    assert!(tip.force_n().distance(held_n) < 1e-6, "it does not creep: {:?}", tip.force_n());
    // Half as deep: half of the push, half of the friction.
    tip.slide(Vec3::Z * 0.01, 125, &model);
    assert!(near(tip.force_n(), Vec3::Z * 0.5 - Vec3::X * FRICTION * 0.5), "{:?}", tip.force_n());
    tip.slide(Vec3::Z * 0.01, 200, &model);
    assert_eq!((tip.force_n(), tip.state.bristle_m), (Vec3::ZERO, [0.0; 3]));
}

#[test]
fn around_a_path_the_hand_loses_what_friction_takes() {
    let model = floor(FRICTION);
    let mut tip = Tip::resting(Vec3::new(0.0, 0.0, -DEEP_M), &model);
    tip.slide(Vec3::X * 0.02, 200, &model);
    // To and fro over 10 mm: 0.2 N all the way, but for twice the bristle after each turn, in which it is a spring.
    let lost_j = -(tip.slide(Vec3::X * -0.02, 500, &model) + tip.slide(Vec3::X * 0.02, 500, &model));
    let bent_m = f64::from(FRICTION / BRISTLE_N_M);
    let expected_j = 2.0 * f64::from(FRICTION) * (0.01 - 2.0 * bent_m);
    assert!((lost_j - expected_j).abs() < 0.02 * expected_j, "{lost_j} J, {expected_j} J by hand");
}

/// Planes about a press are never quite parallel: the tip is held by all of the friction on them, however slowly it goes, and does not creep when it stops.
#[test]
fn a_tip_that_creeps_over_two_planes_that_are_not_parallel_is_held_back_in_full_and_stays_where_it_stops() {
    for tilt_rad in [0.0f32, 0.17, 0.35] {
        let (sine, cosine) = tilt_rad.sin_cos();
        let model = rubbing(&[plane([0.0; 3], [sine, 0.0, cosine]), plane([0.0; 3], [-sine, 0.0, cosine])], FRICTION);
        // Along the valley between them, along which each of them lets it go, and across it, where they differ by less than friction over 0.1 mm.
        for (along, speed_m_s) in [(Vec3::Y, 0.002), (Vec3::Y, 0.01), (Vec3::new(0.1, 0.995, 0.0), 0.002)] {
            let mut tip = Tip::resting(Vec3::new(0.0, 0.0, -DEEP_M), &model);
            let resting_n = tip.force_n();
            tip.slide(along * speed_m_s, (0.006 / speed_m_s / DT_S) as u64, &model);
            let all_n = resting_n.length() / cosine;
            let held_n = -tip.force_n().y;
            assert!(
                (held_n - FRICTION * all_n).abs() < 0.05 * FRICTION * all_n,
                "{tilt_rad} rad, {along}, {speed_m_s} m/s: {held_n} N"
            );
            let stopped_n = tip.force_n();
            tip.slide(Vec3::ZERO, 5_000, &model);
            assert!(tip.force_n().distance(stopped_n) < 1e-3, "{tilt_rad} rad: {stopped_n}, then {}", tip.force_n());
        }
    }
}

/// By hand: walls that push against each other leave no force of their own, and each rubs.
#[test]
fn a_canal_holds_the_scope_along_its_axis_although_its_walls_push_each_other_out() {
    let sides = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]];
    // The free side of each is beyond the tip.
    let walls = sides.map(|normal| plane(normal.map(|part: f32| part * 0.001), normal));
    let model = rubbing(&walls, FRICTION);
    let mut tip = Tip::resting(Vec3::ZERO, &model);
    assert!(tip.force_n().length() < 1e-6, "{:?}", tip.force_n());
    tip.slide(Vec3::Z * 0.02, 500, &model);
    // Four walls of 400 N/m, each 1 mm deep.
    assert!(near(tip.force_n(), Vec3::NEG_Z * 4.0 * 0.4 * FRICTION), "{:?}", tip.force_n());
    tip.slide(Vec3::Z * -0.02, 500, &model);
    assert!(near(tip.force_n(), Vec3::Z * 4.0 * 0.4 * FRICTION), "{:?}", tip.force_n());
}

#[test]
fn what_says_no_friction_or_none_that_can_be_makes_no_force_along_the_planes() {
    for friction in [0.0, -1.0, f32::NAN, f32::NEG_INFINITY] {
        let model = floor(friction);
        let mut tip = Tip::resting(Vec3::new(0.0, 0.0, -DEEP_M), &model);
        tip.slide(Vec3::X * 0.05, 200, &model);
        assert_eq!((tip.force_n().x, tip.state.bristle_m), (0.0, [0.0; 3]), "{friction}");
    }
    let model = floor(1e9);
    let mut tip = Tip::resting(Vec3::new(0.0, 0.0, -DEEP_M), &model);
    tip.slide(Vec3::X * 0.05, 600, &model);
    assert!(near(tip.force_n(), Vec3::new(-MAX_FRICTION, 0.0, 1.0)), "no more than the push: {:?}", tip.force_n());
}

#[test]
fn friction_comes_back_from_nothing_after_missing_ticks_and_fades_with_the_planes() {
    let model = floor(FRICTION);
    let mut tip = Tip::resting(Vec3::new(0.0, 0.0, -DEEP_M), &model);
    tip.slide(Vec3::X * 0.02, 300, &model);
    let input = ServoInput {
        tick: tip.state.tick + 1,
        position_m: tip.place_m.to_array(),
        velocity_m_s: [0.0; 3],
        dt_s: DT_S,
        model: &model,
        model_age_ticks: 1,
        applied_n: None,
        medium_n: [0.0; 3],
    };
    let (gone, _) = servo_step(&ServoParams::default(), &tip.state, &ServoInput { tick: input.tick + 100, ..input });
    assert_eq!(gone.bristle_m, [0.0; 3]);
    // 200 ticks of age: half of the fade.
    let aged = ServoInput { model_age_ticks: 200, ..input };
    let mut state = tip.state;
    for later in 0..400 {
        state = servo_step(&ServoParams::default(), &state, &ServoInput { tick: aged.tick + later, ..aged }).0;
    }
    assert!(near(Vec3::from(state.force_n), Vec3::new(-FRICTION, 0.0, 1.0) * 0.5), "{:?}", state.force_n);
}

/// A tissue that rubs with a coefficient far above any of wet mucosa.
fn rough(tissue: Tissue) -> impl Fn(Vec3, f32) -> ContactModel {
    move |tip, stiffness_n_m| ContactModel { friction: 0.5, ..tissue(tip, stiffness_n_m) }
}

fn rough_wall(tip: Vec3, stiffness_n_m: f32) -> ContactModel {
    rough(wall)(tip, stiffness_n_m)
}

fn rough_cavity(tip: Vec3, stiffness_n_m: f32) -> ContactModel {
    rough(cavity)(tip, stiffness_n_m)
}

fn rough_corner(tip: Vec3, stiffness_n_m: f32) -> ContactModel {
    rough(corner)(tip, stiffness_n_m)
}

const ROUGH: [(&str, Tissue); 3] = [("wall", rough_wall), ("cavity", rough_cavity), ("corner", rough_corner)];

/// The hand that slides, sticks and turns back: no energy beyond the damping that the bound relies on, no step, and both replicas as one.
#[test]
fn a_hand_that_slides_over_rough_walls_is_given_no_energy_and_feels_no_step() {
    for (name, tissue) in ROUGH {
        for stiffness_n_m in [100.0, 300.0, 1_000.0] {
            for (hand, cadence) in [(Hand::Press, 1), (Hand::Press, 4), (Hand::Press, 20), (Hand::Explore, 4)] {
                let mut bench = Bench::new(hand, tissue, stiffness_n_m, cadence);
                let damping_n_s_m = bench.servo_params.device_damping_n_s_m;
                let (mut given_j, mut step_n, mut most_m) = (0.0f64, 0.0f32, 0.0f32);
                let what = format!("{name}, {hand:?}, {stiffness_n_m} N/m, {cadence} ms");
                for tick in 0..6_000 {
                    let before = bench.force;
                    let (moved, _) = bench.tick([true; 2]);
                    step_n = step_n.max(bench.force.distance(before));
                    if before != Vec3::ZERO {
                        given_j += f64::from(before.dot(moved) - damping_n_s_m * moved.length_squared() / DT_S);
                    }
                    most_m = most_m.max(Vec3::from(bench.servos[0].bristle_m).length());
                    assert!(bytemuck::bytes_of(&bench.servos[0]) == bytemuck::bytes_of(&bench.servos[1]), "{what}, tick {tick}");
                    assert!(before != Vec3::ZERO || given_j < 1e-6, "{what}, tick {tick}: {given_j} J given");
                }
                assert!(step_n < 0.2, "{what}: a step of {step_n} N");
                assert!(most_m > 1e-4 || matches!(hand, Hand::Explore), "{what}: it rubs on nothing");
            }
        }
    }
}

#[test]
fn pressing_steadily_on_rough_walls_does_not_buzz() {
    for (name, tissue) in ROUGH {
        for stiffness_n_m in [100.0, 600.0, 5_000.0] {
            for cadence in [1, 4, 20] {
                let mut bench = Bench::new(Hand::Press, tissue, stiffness_n_m, cadence);
                bench.script = HandScript { rest: bench.script.into, ..bench.script };
                bench.run(2_000);
                let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
                for _ in 0..500 {
                    bench.tick([true; 2]);
                    (low, high) = (low.min(bench.force), high.max(bench.force));
                }
                let what = format!("{name}, {stiffness_n_m} N/m, {cadence} ms: {low} to {high}");
                assert!((high - low).max_element() < 4e-3, "{what}");
                assert!(bench.servos[0].bristle_m != [0.0; 3], "{what}: it rubs on nothing");
            }
        }
    }
}
