//! The force loop closed through a hand with mass: stable, passive, continuous, and the same after every interruption.

#[allow(dead_code)] // each test file uses its part
mod bench;

use bench::{Bench, DT_S, Tissue, cavity, corner, wall};
use glam::Vec3;
use hyst_coupling::*;

const TISSUES: [(&str, Tissue); 3] = [("wall", wall), ("cavity", cavity), ("corner", corner)];
const CADENCES: [u64; 3] = [1, 4, 20];
/// The range that is promised; stiffer tissue is felt as 1 080 N/m (0.9 of the coupling).
const STIFFNESSES_N_M: [f32; 5] = [100.0, 300.0, 600.0, 1000.0, 5000.0];

/// Peak to peak of the force along z over the last half second of 2.5 s of steady pressing, N, and its mean.
fn buzz_n(mut bench: Bench) -> (f32, f32) {
    // The hand goes in within 0.9 s and then stays there.
    bench.script = HandScript { rest: bench.script.into, ..bench.script };
    bench.run(2000);
    let (mut low, mut high, mut sum) = (f32::MAX, f32::MIN, 0.0);
    for _ in 0..500 {
        bench.tick([true; 2]);
        (low, high, sum) = (low.min(bench.force.z), high.max(bench.force.z), sum + bench.force.z);
    }
    (high - low, sum / 500.0)
}

#[test]
fn pressing_steadily_does_not_buzz_at_any_promised_stiffness_and_age() {
    for (name, tissue) in TISSUES {
        for stiffness_n_m in STIFFNESSES_N_M {
            for cadence in CADENCES {
                let (buzz, mean) = buzz_n(Bench::new(Hand::Press, tissue, stiffness_n_m, cadence));
                let what = format!("{name}, {stiffness_n_m} N/m, {cadence} ms: {buzz} N about {mean} N");
                assert!(buzz < 2e-3, "{what}");
                assert!(mean < -0.3, "{what}: no contact");
            }
        }
    }
}

#[test]
fn a_wall_beyond_the_passivity_bound_does_buzz_so_that_the_test_above_means_something() {
    let mut bench = Bench::new(Hand::Press, wall, 50_000.0, 1);
    bench.servo_params.coupling_stiffness_n_m = 50_000.0;
    bench.servo_params.device_damping_n_s_m = 1000.0; // a lie
    bench.servo_params.controller_damping_n_s_m = 0.0;
    bench.script.into.insertion_m = 0.065; // pressed with 1.5 N, for a saturated force cannot buzz
    let buzz = buzz_n(bench).0;
    assert!(buzz > 0.5, "only {buzz} N");
}

#[test]
fn the_coupling_obeys_colgates_bound() {
    let params = ServoParams { coupling_stiffness_n_m: 1e5, ..ServoParams::default() };
    let limit = params.coupling_limit_n_m(1e-3);
    // With the bristle of friction, a tenth of the coupling.
    let needed = 1.1 * limit * 1e-3 * (0.5 + params.loop_delay_ticks) + params.max_damping_n_s_m;
    assert!(needed <= params.device_damping_n_s_m * 1.0001 && needed > 0.99 * params.device_damping_n_s_m);
}

#[test]
fn device_and_servo_together_never_give_energy_to_the_hand() {
    // Energy given by the motors less what the damping b, on which the bound relies, takes: at most a rounding error at
    // any time after contact has ended again.
    for (name, tissue) in TISSUES {
        for stiffness_n_m in STIFFNESSES_N_M {
            for cadence in CADENCES {
                let mut bench = Bench::new(Hand::Press, tissue, stiffness_n_m, cadence);
                let damping = bench.servo_params.device_damping_n_s_m;
                let mut given_j = 0.0f64;
                for _ in 0..6000 {
                    let force = bench.force;
                    let (moved, _) = bench.tick([true; 2]);
                    if force != Vec3::ZERO {
                        given_j += f64::from(force.dot(moved) - damping * moved.length_squared() / DT_S);
                    }
                    let free = force == Vec3::ZERO;
                    assert!(!free || given_j < 1e-6, "{name}, {stiffness_n_m} N/m, {cadence} ms: {given_j} J given");
                }
                assert!(given_j < -1e-5, "{name}: no contact");
            }
        }
    }
}

#[test]
fn the_force_is_continuous_in_time() {
    for (name, tissue) in TISSUES {
        for hand in [Hand::Press, Hand::Explore, Hand::Polyp] {
            for cadence in CADENCES {
                let mut bench = Bench::new(hand, tissue, 1000.0, cadence);
                let (step_n, _) = bench.run(12_000);
                assert!(step_n < 0.2, "{name}, {hand:?}, {cadence} ms: a step of {step_n} N");
            }
        }
    }
}

#[test]
fn both_replicas_compute_the_same_bits() {
    let mut bench = Bench::new(Hand::Explore, cavity, 700.0, 4);
    for _ in 0..8000 {
        bench.tick([true; 2]);
        assert_eq!(bytemuck::bytes_of(&bench.servos[0]), bytemuck::bytes_of(&bench.servos[1]));
    }
}

#[test]
fn a_replica_that_is_given_the_state_continues_identically() {
    let mut whole = Bench::new(Hand::Press, cavity, 700.0, 4);
    let mut killed = Bench::new(Hand::Press, cavity, 700.0, 4);
    for tick in 0..5000 {
        // Replica 0 is dead for 200 ticks in every 500; its successor is given the bytes of the other's state.
        let dead = tick % 500 >= 300;
        if tick % 500 == 0 {
            killed.servos[0] = bytemuck::pod_read_unaligned(bytemuck::bytes_of(&killed.servos[1]));
        }
        whole.tick([true; 2]);
        killed.tick([!dead, true]);
        assert_eq!(whole.force.to_array().map(f32::to_bits), killed.force.to_array().map(f32::to_bits), "tick {tick}");
    }
}

/// Lets a bench that was interrupted while buried go on, and checks that the hand is not kicked: no step of the force beyond
/// what this wall makes of the tip's motion, plus the 0.05 N that a fault may add; and the hand is not thrown out.
/// Returns the largest step, the highest speed outwards and the force at the end.
fn goes_on_without_a_kick(bench: &mut Bench, what: &str) -> (f32, f32, f32) {
    let (mut step_n, mut out_m_s) = (0.0f32, 0.0f32);
    for tick in 0..1500 {
        let before = bench.force;
        let speed = Vec3::from_array(bench.hand.velocity_m_s).length();
        bench.tick([true; 2]);
        let step = (bench.force - before).length();
        // 1 000 N/m and 0.5 N·s/m of damping, whose onset is felt within half a millimetre.
        let explained = 1000.0 * speed * DT_S + 0.5 * speed * (speed * DT_S / 0.5e-3).min(1.0);
        assert!(step < explained + 0.05, "{what}: a step of {step} N at {speed} m/s, tick {tick}");
        step_n = step_n.max(step);
        out_m_s = out_m_s.max(-bench.hand.velocity_m_s[2]);
    }
    assert!(out_m_s < 0.06, "{what}: thrown out at {out_m_s} m/s");
    (step_n, out_m_s, bench.force.z)
}

/// A bench that presses steadily on a wall of 1 000 N/m.
fn buried() -> Bench {
    let mut bench = Bench::new(Hand::Press, wall, 1000.0, 1);
    bench.script.rest = bench.script.into;
    bench.run(1000);
    bench
}

#[test]
fn a_servo_suspended_while_buried_comes_back_without_a_kick() {
    let undisturbed = buried().force.z;
    let cases = [1, 2, 3, 5, 10, 22, 50, 500].map(|suspended| [(suspended, true), (suspended, false)]);
    for (suspended, tells_applied) in cases.into_iter().flatten() {
        let mut bench = buried();
        bench.tells_applied = tells_applied;
        for missing in 1..=suspended {
            let before = bench.force.length();
            let (_, kind) = bench.tick([false; 2]);
            let expected = match missing {
                1..=2 => AppliedKind::Held,
                3..=21 => AppliedKind::Ramped,
                _ => AppliedKind::Zero,
            };
            assert_eq!(kind, expected, "missing tick {missing}");
            assert!(before - bench.force.length() <= 3.3 / 20.0);
        }
        let (step_n, out_m_s, force) = goes_on_without_a_kick(&mut bench, &format!("{suspended} ms"));
        println!("{suspended} ms: largest step {step_n:.3} N, outwards {out_m_s:.3} m/s, back at {force:.3} N");
        assert!((force - undisturbed).abs() < 0.02, "{suspended} ms: back at {force} N, not {undisturbed} N");
    }
}

#[test]
fn a_servo_that_starts_with_no_state_while_buried_does_not_kick() {
    let mut bench = buried();
    let undisturbed = bench.force.z;
    for _ in 0..60 {
        bench.tick([false; 2]);
    }
    bench.servos = [ServoState::default(); 2];
    let (_, _, force) = goes_on_without_a_kick(&mut bench, "cold start");
    assert!((force - undisturbed).abs() < 0.02, "back at {force} N");
}

#[test]
fn a_device_process_that_starts_anew_while_buried_does_not_kick() {
    for dead_ticks in [5, 20, 200] {
        let mut bench = buried();
        let undisturbed = bench.force.z;
        for _ in 0..dead_ticks {
            // No device: no input record, no force command; the firmware holds, then ramps.
            let target = bench.script.into;
            bench.hand = hand_dynamics(&bench.hand_model, &bench.hand, &target, bench.force.to_array(), DT_S);
            let (hardware, force) = hardware_step(&HardwareParams::default(), &bench.hardware, None);
            bench.hardware = hardware;
            bench.force = Vec3::from_array(force);
            bench.pass_tick();
        }
        bench.hop = LastHopState::born(bench.hardware.force_n, true);
        let (_, _, force) = goes_on_without_a_kick(&mut bench, &format!("device dead for {dead_ticks} ms"));
        assert!((force - undisturbed).abs() < 0.02, "{dead_ticks} ms: back at {force} N");
    }
}

/// The servo alone, its tip held `depth_m` behind the wall.
fn held(state: &ServoState, tick: u64, model: &ContactModel, age: u32, depth_m: f32) -> (ServoState, ServoOutput) {
    drawn(state, tick, model, age, (depth_m, 0.0))
}

/// The servo alone, its tip `depth_m` behind the wall and on its way deeper, m/s.
fn drawn(
    state: &ServoState,
    tick: u64,
    model: &ContactModel,
    age: u32,
    (depth_m, deeper_m_s): (f32, f32),
) -> (ServoState, ServoOutput) {
    let input = ServoInput {
        tick,
        position_m: [0.0, 0.0, 0.06 + depth_m],
        velocity_m_s: [0.0, 0.0, deeper_m_s],
        dt_s: DT_S,
        model,
        model_age_ticks: age,
        applied_n: None,
        medium_n: [0.0; 3],
    };
    servo_step(&ServoParams::default(), state, &input)
}

/// A servo that has felt the wall at `depth_m` in full for a while.
fn pressing(model: &ContactModel, depth_m: f32) -> ServoState {
    (1..=500).fold(ServoState::default(), |state, tick| held(&state, tick, model, 1, depth_m).0)
}

#[test]
fn a_model_is_felt_in_full_for_100_ms_then_fades_to_nothing_in_200() {
    let model = wall(Vec3::ZERO, 1000.0);
    let mut state = pressing(&model, 0.002);
    let full = state.force_n[2];
    assert!((full + 2.0).abs() < 1e-3, "{full}");
    let mut last = full;
    for age in 2..400u32 {
        let (next, output) = held(&state, 500 + u64::from(age), &model, age, 0.002);
        let force = output.force_n[2];
        match age {
            0..=100 => assert_eq!(force.to_bits(), full.to_bits(), "age {age}"),
            101..300 => assert!(force > last && force - last < 0.02, "age {age}: {last} to {force} N"),
            _ => assert_eq!(force, 0.0, "age {age}"),
        }
        (state, last) = (next, force);
    }
    // A fresh model arrives: back in full, as fast as the surface returns (1 000 N/m · 0.03 m/s = 0.03 N per tick).
    for tick in 1000..1300 {
        let (next, output) = held(&state, tick, &model, 1, 0.002);
        // The first of these ticks follows a gap; nothing was applied, nothing may jump.
        assert!((output.force_n[2] - last).abs() < 0.05, "tick {tick}");
        (state, last) = (next, output.force_n[2]);
    }
    assert_eq!(last, full);
}

#[test]
fn planes_that_jump_in_mid_contact_are_blended() {
    let near = wall(Vec3::ZERO, 1000.0);
    let mut far = near;
    far.planes[0].point_m[2] -= 0.002;
    let mut state = pressing(&near, 0.0005);
    for (tick, model) in (501..700).map(|tick| (tick, if tick / 40 % 2 == 0 { &near } else { &far })) {
        let before = state.force_n[2];
        let (next, output) = held(&state, tick, model, 1, 0.0005);
        assert!((next.force_n[2] - before).abs() <= 0.1 + 1e-6, "tick {tick}: {before} to {:?}", output.force_n);
        state = next;
    }
    let none = ContactModel::default();
    let (_, output) = held(&state, 700, &none, 1, 0.0005);
    assert!((output.force_n[2] - state.force_n[2]).abs() <= 0.1 + 1e-6, "planes that vanish are blended too");
}

#[test]
fn another_tissue_that_comes_back_in_the_middle_of_the_fade_is_blended() {
    let (near, none) = (wall(Vec3::ZERO, 1000.0), ContactModel::default());
    let mut far = near;
    far.planes[0].point_m[2] += 0.0018;
    for (what, model) in [("a wall farther away", &far), ("no wall", &none)] {
        // 2 N, half faded; the tissue that began anew knows nothing of the dent.
        let faded =
            (2..=200u32).fold(pressing(&near, 0.002), |state, age| held(&state, 500 + u64::from(age), &near, age, 0.002).0);
        assert!((faded.force_n[2] + 1.0).abs() < 0.1, "{:?}", faded.force_n);
        let (mut state, most_n) = (faded, ServoParams::default().model_step_n + 1e-6);
        for tick in 701..800 {
            let (next, output) = held(&state, tick, model, 1, 0.002);
            let step_n = (output.force_n[2] - state.force_n[2]).abs();
            assert!(step_n <= most_n, "{what}, tick {tick}: a step of {step_n} N");
            state = next;
        }
        assert!(state.force_n[2].abs() < 0.21, "{what}: {:?}", state.force_n);
    }
}

#[test]
fn a_tissue_that_settles_after_a_fade_is_felt_in_small_steps_and_then_as_any_other() {
    let near = wall(Vec3::ZERO, 1000.0);
    let mut far = near;
    far.planes[0].point_m[2] += 0.0018;
    let params = ServoParams::default();
    let faded = (2..=400u32).fold(pressing(&near, 0.002), |state, age| held(&state, 500 + u64::from(age), &near, age, 0.002).0);
    assert_eq!((faded.force_n[2], faded.return_ticks), (0.0, 0));
    // Begun anew about the scope: its model is another one at each tick, for longer than 0.2 s.
    let (mut state, mut most_n) = (faded, [0.0f32; 2]);
    for tick in 901..1_701u64 {
        let model = if tick % 2 == 0 { &near } else { &far };
        let next = held(&state, tick, model, 1, 0.002).0;
        assert_eq!(next.return_ticks > 0, tick < 1_301, "tick {tick}");
        let most = &mut most_n[usize::from(next.return_ticks == 0)];
        *most = most.max((next.force_n[2] - state.force_n[2]).abs());
        state = next;
    }
    assert!(most_n[0] <= params.return_step_n + 1e-6, "{most_n:?}");
    assert!(most_n[1] > 3.0 * params.return_step_n && most_n[1] <= params.model_step_n + 1e-6, "{most_n:?}");
}

/// What pushes the tip out of a tissue that settles is no excuse for what the model jumps by: the way explains what these planes make of it.
#[test]
fn a_tip_that_is_pushed_out_of_a_tissue_that_settles_feels_small_steps_too() {
    let near = wall(Vec3::ZERO, 400.0);
    let mut far = near;
    far.planes[0].point_m[2] += 0.001;
    let params = ServoParams::default();
    let mut state =
        (2..=400u32).fold(pressing(&near, 0.018), |state, age| held(&state, 500 + u64::from(age), &near, age, 0.018).0);
    assert_eq!((state.force_n[2], state.return_ticks), (0.0, 0));
    let (way_m, mut most_n) = (40e-6, 0.0f32);
    for tick in 901..1_301u64 {
        let model = if tick % 2 == 0 { &near } else { &far };
        let depth_m = 0.018 - way_m * (tick - 900) as f32;
        let next = drawn(&state, tick, model, 1, (depth_m, -way_m / DT_S)).0;
        assert!(next.return_ticks > 0, "tick {tick}");
        most_n = most_n.max((next.force_n[2] - state.force_n[2]).abs());
        state = next;
    }
    // 400 N/m, and 0.5 N·s/m that come and go with the plane.
    let of_motion_n = 400.0 * way_m + params.max_damping_n_s_m * (way_m / DT_S) * (way_m / params.damping_depth_m);
    assert!(most_n > params.return_step_n, "{most_n} N: nothing jumps");
    assert!(most_n < of_motion_n + params.return_step_n + 1e-5, "a step of {most_n} N, {of_motion_n} of them by motion");
}

#[test]
fn a_model_that_was_late_by_little_is_soon_followed_as_any_other() {
    let near = wall(Vec3::ZERO, 1000.0);
    let late = held(&pressing(&near, 0.002), 501, &near, 110, 0.002).0;
    let back = held(&late, 502, &near, 1, 0.002).0;
    assert!((1..=20).contains(&back.return_ticks), "{}", back.return_ticks);
    let gap = held(&back, 600, &near, 1, 0.002).0;
    assert_eq!(gap.return_ticks, ServoParams::default().return_ticks);
}

#[test]
fn the_wall_pushes_towards_its_free_side_and_never_pulls() {
    let model = wall(Vec3::ZERO, 500.0);
    let mut bench = Bench::new(Hand::Press, wall, 500.0, 1);
    for _ in 0..4000 {
        bench.tick([true; 2]);
        // The passivity controller may damp, which on the way out is a pull; the planes may not.
        if bench.servos[0].energy_j >= 0.0 {
            assert!(bench.force.z <= 1e-6, "{}", bench.force);
        }
    }
    assert!((pressing(&model, 0.002).force_n[2] + 1.0).abs() < 1e-3, "F = k · depth");
}
