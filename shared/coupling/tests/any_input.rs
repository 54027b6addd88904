//! Whatever bytes arrive, what leaves is finite and within its limits.

use glam::Vec3;
use hyst_coupling::*;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

/// Numbers as faults produce them: any bits, but often zero, huge, or not a number.
fn any_f32() -> impl Strategy<Value = f32> {
    prop_oneof![
        4 => -0.1..0.1f32,
        2 => any::<u32>().prop_map(f32::from_bits),
        1 => prop_oneof![Just(0.0), Just(f32::NAN), Just(f32::INFINITY), Just(f32::MAX), Just(f32::MIN_POSITIVE)],
    ]
}

fn any_vector() -> impl Strategy<Value = [f32; 3]> {
    prop::array::uniform3(any_f32())
}

fn any_plane() -> impl Strategy<Value = Plane> {
    let direction = prop_oneof![prop::array::uniform3(-1.0..1.0f32), any_vector()];
    let stiffness = prop_oneof![1.0..1e5f32, any_f32()];
    (any_vector(), direction, stiffness, any_f32()).prop_map(|(point_m, normal, stiffness_n_m, damping_n_s_m)| Plane {
        point_m,
        normal,
        stiffness_n_m,
        damping_n_s_m,
    })
}

fn any_model() -> impl Strategy<Value = ContactModel> {
    let count = prop_oneof![0..10u32, any::<u32>()];
    (prop::collection::vec(any_plane(), 8), count, any_f32()).prop_map(|(planes, count, friction)| {
        let mut model = ContactModel::new(&planes);
        (model.count, model.friction) = (count, friction);
        model
    })
}

/// A value of plain data from any bytes.
fn from_bytes<T: bytemuck::Pod>(seed: &[u8]) -> T {
    let mut value = T::zeroed();
    for (byte, from) in bytemuck::bytes_of_mut(&mut value).iter_mut().zip(seed) {
        *byte = *from;
    }
    value
}

fn length(force: [f32; 3]) -> f64 {
    Vec3::from_array(force).as_dvec3().length()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, rng_seed: RngSeed::Fixed(2), ..ProptestConfig::default() })]

    #[test]
    fn the_servo_never_gives_a_force_over_its_limit(
        steps in prop::collection::vec((any_model(), any_vector(), any_vector(), 0..40u64, any::<u32>()), 1..12),
        dt_s in prop_oneof![9 => Just(1e-3f32), 1 => any_f32()],
    ) {
        let params = ServoParams::default();
        let (mut state, mut tick) = (ServoState::default(), 0);
        for (model, position_m, velocity_m_s, gap, age) in &steps {
            tick += gap;
            let input = ServoInput {
                tick,
                position_m: *position_m,
                velocity_m_s: *velocity_m_s,
                dt_s,
                model,
                model_age_ticks: age % 300,
                applied_n: (age % 2 == 0).then_some(*velocity_m_s),
                medium_n: *position_m,
            };
            let (next, output) = servo_step(&params, &state, &input);
            prop_assert!(length(output.force_n) <= 3.3, "{output:?}");
            state = next;
        }
    }

    #[test]
    fn a_corrupt_state_or_corrupt_parameters_give_no_bad_force(
        bytes in prop::collection::vec(any::<u8>(), 128),
        model in any_model(),
        position_m in any_vector(),
        tick in any::<u64>(),
    ) {
        let mut state: ServoState = from_bytes(&bytes);
        state.running %= 2;
        let input = ServoInput { tick, position_m, velocity_m_s: [0.1; 3], dt_s: 1e-3, model: &model, model_age_ticks: 0, applied_n: Some(position_m), medium_n: position_m };
        let (_, output) = servo_step(&ServoParams::default(), &state, &input);
        prop_assert!(length(output.force_n) <= 3.3);
        let wild: ServoParams = from_bytes(&bytes);
        let (_, output) = servo_step(&wild, &ServoState::default(), &input);
        prop_assert!(length(output.force_n) <= 100.0);
    }

    #[test]
    fn the_last_hop_never_exceeds_its_limits_nor_its_slew(
        candidates in prop::collection::vec(prop::option::of(prop_oneof![any_vector(), prop::array::uniform3(-4.0..4.0f32)]), 1..80),
        engaged in 0..2u32,
        slew in 0.2..2.0f32,
    ) {
        let params = LastHopParams { max_slew_n_per_tick: slew, ..LastHopParams::default() };
        let mut state = LastHopState { engaged, ..LastHopState::default() };
        for candidate in candidates {
            let (next, applied, kind) = last_hop_step(&params, &state, candidate);
            prop_assert!(length(applied) <= 3.3 * (1.0 + 1e-5), "{applied:?}");
            let step = (Vec3::from_array(applied).as_dvec3() - Vec3::from_array(state.applied_n).as_dvec3()).length();
            prop_assert!(step <= f64::from(params.slew_n()), "a step of {step} N");
            let valid = candidate.is_some_and(|c| length(c) <= 3.3 * (1.0 + 1e-5));
            prop_assert!(valid || kind != AppliedKind::Fresh, "{candidate:?} is {kind:?}");
            state = next;
        }
    }

    #[test]
    fn the_last_hop_and_the_hardware_survive_any_state(
        bytes in prop::collection::vec(any::<u8>(), 48),
        candidate in prop::option::of(any_vector()),
    ) {
        let state: LastHopState = from_bytes(&bytes);
        let (_, applied, _) = last_hop_step(&LastHopParams::default(), &state, candidate);
        prop_assert!(length(applied) <= 3.3 * (1.0 + 1e-5), "{applied:?}");
        let wild: LastHopParams = from_bytes(&bytes);
        let (_, applied, _) = last_hop_step(&wild, &LastHopState::default(), candidate);
        prop_assert!(length(applied).is_finite());
        let hardware: HardwareState = from_bytes(&bytes);
        let (_, force) = hardware_step(&HardwareParams::default(), &hardware, candidate);
        prop_assert!(length(force) <= 3.3 * (1.0 + 1e-5), "{force:?}");
    }

    #[test]
    fn the_watch_and_the_choice_survive_anything(
        bytes in prop::collection::vec(any::<u8>(), 64),
        forces in prop::array::uniform3(any_vector()),
        ticks in prop::array::uniform2(any::<u64>()),
    ) {
        let state: WatchState = from_bytes(&bytes);
        let input = WatchInput {
            record_tick: ticks[0], force_n: forces[0], position_m: forces[1], digest: 1, expected_digest: 1,
        };
        watch_step(&WatchParams::default(), &state, &input);
        let choice = choose(forces[0], Some(forces[1]), Some(forces[2]), ticks[0] as usize);
        prop_assert!(choice.force_n.is_none_or(|f| f.iter().all(|c| c.is_finite())) && choice.index < 2);
        let valid = valid_force(ticks[0], ticks[1], forces[0], &ForceLimits::default()).is_ok();
        prop_assert!(!valid || (length(forces[0]) <= 3.3 * (1.0 + 1e-5) && ticks[0] - ticks[1] <= 1));
    }
}
