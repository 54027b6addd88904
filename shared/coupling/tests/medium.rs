//! What the hand feels of the medium: no click when the fluid says something new, nothing once nothing is said, no more energy than is promised, and the tissue
//! beside it as ever.

use glam::Vec3;
use hyst_coupling::{
    ContactModel, EnergyParams, EnergyState, Plane, ServoInput, ServoParams, ServoState, energy_step, felt_of_medium_n,
    servo_step,
};

/// One tick of a servo whose tip is on its way along z, in the medium.
fn tick(state: &ServoState, tick: u64, (z_m, speed_m_s): (f32, f32), model: &ContactModel, medium_n: [f32; 3]) -> ServoState {
    let input = ServoInput {
        tick,
        position_m: [0.0, 0.0, z_m],
        velocity_m_s: [0.0, 0.0, speed_m_s],
        dt_s: 1e-3,
        model,
        model_age_ticks: 1,
        applied_n: None,
        medium_n,
    };
    servo_step(&ServoParams::default(), state, &input).0
}

#[test]
fn what_the_fluid_says_anew_is_felt_within_some_periods_and_never_as_a_click() {
    let free = ContactModel::new(&[]);
    let (said_n, mut state, mut largest_n) = ([0.0, 0.03, -0.04], ServoState::default(), 0.0f32);
    for now in 1..=1_000 {
        // Said as by a fluid of 30 Hz: nothing, then 0.05 N, then nothing again, or what is no number.
        let medium_n = match now {
            34..=400 => said_n,
            701.. => [f32::NAN; 3],
            _ => [0.0; 3],
        };
        let next = tick(&state, now, (0.05, 0.0), &free, medium_n);
        largest_n = largest_n.max(Vec3::from(next.force_n).distance(Vec3::from(state.force_n)));
        state = next;
        let felt_n = Vec3::from(state.force_n).length();
        match now {
            1..34 => assert_eq!(state.force_n, [0.0; 3]),
            // A 32nd of the way in each tick: 1 − (31/32)^33 after a period, and all but a part in 10⁵ in the end.
            66 => assert!((felt_n / 0.05 - 0.649).abs() < 0.005, "{felt_n} N after a period"),
            400 => assert!(Vec3::from(state.force_n).distance(Vec3::from(said_n)) < 2e-6, "{:?} N", state.force_n),
            800.. => assert_eq!(state.force_n, [0.0; 3], "tick {now}: what is over leaves nothing"),
            _ => {}
        }
    }
    // By hand 0.05 / 32 N, where the usual gate of small forces is at 0.2 N.
    assert!((largest_n - 0.05 / 32.0).abs() < 1e-5, "{largest_n} N in a tick");
}

#[test]
fn the_largest_force_that_is_believed_comes_by_two_millinewtons_a_tick() {
    let free = ContactModel::new(&[]);
    let mut state = ServoState::default();
    for now in 1..=200 {
        let next = tick(&state, now, (0.05, 0.0), &free, [9.0, 0.0, 0.0]);
        let step_n = next.force_n[0] - state.force_n[0];
        assert!((0.001_99..0.002_001).contains(&step_n), "tick {now}: {step_n} N");
        state = next;
    }
    let end = (201..=2_000).fold(state, |state, now| tick(&state, now, (0.05, 0.0), &free, [9.0, 0.0, 0.0]));
    assert!((end.force_n[0] - 0.5).abs() < 1e-5, "{end:?}");
}

/// A medium that pushes the hand along with 0.5 N wherever it goes.
#[test]
fn a_medium_that_drives_the_hand_on_gives_what_is_promised_and_the_last_hop_withholds_nothing() {
    let (free, speed_m_s) = (ContactModel::new(&[]), 0.1f32);
    let (mut state, mut hop, mut given_j, mut z_m) = (ServoState::default(), EnergyState::default(), 0.0f64, 0.0f32);
    for now in 1..=2_000u64 {
        // To and fro over 50 mm.
        let way = if (now / 500).is_multiple_of(2) { 1.0 } else { -1.0 };
        let before_n = state.force_n;
        let before_m = z_m;
        z_m += way * speed_m_s * 1e-3;
        given_j += f64::from(before_n[2] * (z_m - before_m));
        let (next, share) = energy_step(&EnergyParams::default(), &hop, [0.0, 0.0, z_m], before_n, 1e-3);
        assert_eq!(share, 1.0, "tick {now}: {next:?}");
        hop = next;
        state = tick(&state, now, (z_m, way * speed_m_s), &free, [0.0, 0.0, way * 0.5]);
    }
    // Two seconds: 1 mJ in debt, 2 mW that leak, and what is given while a force goes down; 0.5 N all the way would be 100 mJ.
    assert!((1e-3..8e-3).contains(&given_j), "{given_j} J");
}

#[test]
fn a_medium_is_felt_beside_the_tissue_and_is_not_booked_as_the_tissues() {
    let wall = Plane { point_m: [0.0, 0.0, 0.06], normal: [0.0, 0.0, -1.0], stiffness_n_m: 300.0, damping_n_s_m: 0.0 };
    let model = ContactModel::new(&[wall]);
    let (mut with, mut without) = (ServoState::default(), ServoState::default());
    for now in 1..=600u64 {
        let (z_m, speed_m_s) = if now < 400 { (0.058 + 1e-5 * now as f32, 0.01) } else { (0.062, 0.0) };
        with = tick(&with, now, (z_m, speed_m_s), &model, [0.0, 0.02, -0.01]);
        without = tick(&without, now, (z_m, speed_m_s), &model, [0.0; 3]);
        assert!((with.energy_j - without.energy_j).abs() < 1e-6, "tick {now}: {} J, {} J", with.energy_j, without.energy_j);
    }
    let beyond_n = Vec3::from(with.force_n) - Vec3::from(without.force_n);
    assert!(without.force_n[2] < -0.1 && beyond_n.distance(Vec3::new(0.0, 0.02, -0.01)) < 1e-4, "{beyond_n} N");
    assert_eq!(without.medium_n, [0.0; 3]);
}

#[test]
fn after_missing_ticks_the_medium_comes_back_from_nothing() {
    let free = ContactModel::new(&[]);
    let at = |state: &ServoState, now: u64| tick(state, now, (0.05, 0.0), &free, [0.03, 0.0, 0.0]);
    let state = (1..=300).fold(ServoState::default(), |state, now| at(&state, now));
    assert!((state.force_n[0] - 0.03).abs() < 1e-4, "{state:?}");
    // A hundred ticks are missing: the last hop has let the force go, and none jumps back.
    let back = at(&state, 401);
    assert!(back.medium_n[0] > 0.0 && back.force_n[0] < 0.002, "{back:?}");
}

#[test]
fn what_no_hand_feels_is_no_force_and_there_is_no_step_where_it_begins() {
    assert_eq!([felt_of_medium_n([0.0; 3]), felt_of_medium_n([0.001, -0.001, 0.001])], [[0.0; 3]; 2]);
    let felt_n = felt_of_medium_n([0.0, 0.003, -0.004]);
    assert!(Vec3::from(felt_n).distance(Vec3::new(0.0, 0.0018, -0.0024)) < 1e-8, "3 mN of 5: {felt_n:?}");
    assert!(Vec3::from(felt_of_medium_n([0.002_000_1, 0.0, 0.0])).length() < 2e-7);
    assert!(felt_of_medium_n([f32::NAN, 0.0, 0.0])[0].is_nan(), "the step takes it for nothing");
}

/// Whoever watches takes a force that stays for one that stands still.
#[test]
fn a_force_of_the_medium_does_not_stay_what_it_was_within_ten_periods_of_the_fluid() {
    let free = ContactModel::new(&[]);
    let mut state = ServoState::default();
    for now in 1..=330 {
        let next = tick(&state, now, (0.05, 0.0), &free, [0.0, 0.004, -0.003]);
        assert_ne!(next.force_n, state.force_n, "tick {now}");
        state = next;
    }
}
