//! Whatever comes from outside: refused with a typed error where a solver is made, made harmless and counted where it steps.

mod scene;

use hyst_flow::{Capsule, FlowError, FlowInputs, FlowModel, Grid, MAX_SPEED_M_S, Solver, StateView, Wall};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

#[test]
fn absurd_grids_are_refused() {
    let grid = |cells| Grid::new(cells, [1e-3; 3], [0.0; 3]);
    assert!(matches!(grid([0, 8, 8]), Err(FlowError::GridSize(0, 8, 8))));
    assert!(matches!(grid([1_000, 1_000, 1_000]), Err(FlowError::GridSize(..))));
    assert!(matches!(grid([512, 512, 512]), Err(FlowError::GridSize(..))), "each axis is good, the product is not");
    assert!(matches!(grid([usize::MAX; 3]), Err(FlowError::GridSize(..))));
    for bad in [0.0, -1e-3, f32::NAN, f32::INFINITY, 1e9] {
        assert!(matches!(Grid::new([8; 3], [1e-3, bad, 1e-3], [0.0; 3]), Err(FlowError::GridGeometry { axis: 1, .. })));
    }
    assert!(matches!(Grid::new([8; 3], [1e-3; 3], [0.0, 0.0, f32::NAN]), Err(FlowError::GridGeometry { axis: 2, .. })));
}

#[test]
fn absurd_models_are_refused_and_the_error_names_the_parameter() {
    let good = scene::model([8, 8, 6]);
    let refused = |change: &dyn Fn(&mut FlowModel), what: &str| {
        let mut model = good;
        change(&mut model);
        match Solver::new(model, 1) {
            Err(error @ FlowError::Parameter { .. }) => {
                assert!(error.to_string().contains(what), "{error}")
            }
            Err(error) => panic!("{what}: {error}"),
            Ok(_) => panic!("{what} was accepted"),
        }
    };
    refused(&|m| m.medium.viscosity_m2_s = f32::NAN, "viscosity_m2_s");
    refused(&|m| m.medium.density_kg_m3 = 0.0, "density_kg_m3");
    refused(&|m| m.residual_relative = 0.0, "residual_relative");
    refused(&|m| m.blood.capacity = 0, "capacity");
    refused(&|m| m.blood.capacity = usize::MAX, "capacity");
    refused(&|m| m.pump.volume_150_mmhg_ml = 0.0, "volume_150_mmhg_ml");
    refused(&|m| m.pump.band_pa = f64::NAN, "band_pa");
    refused(&|m| m.pump.container_ml = 0.0, "container_ml");
    refused(&|m| m.pump.container_ml = f64::INFINITY, "container_ml");
    refused(&|m| m.pump.hole_alarm_ml_s = -1.0, "hole_alarm_ml_s");
    refused(&|m| m.pump.stroke_ml = 0.0, "stroke_ml");
    refused(&|m| m.pump.lift_ml = 0.51 * m.pump.stroke_ml, "lift_ml");
    refused(&|m| m.pump.lift_ml = f64::NAN, "lift_ml");
    refused(&|m| m.pump.tube_ml_pa = -1e-4, "tube_ml_pa");
    refused(&|m| m.walls[0] = Wall::NoSlip([f32::INFINITY, 0.0, 0.0]), "walls");
    assert!(matches!(Solver::new(good, 0), Err(FlowError::Bands { .. })));
    assert!(matches!(Solver::new(good, 7), Err(FlowError::Bands { most: 6, .. })));
    assert!(matches!(Solver::new(good, 1).unwrap().set_mask(&[0; 3]), Err(FlowError::Length { .. })));
}

#[test]
fn every_value_that_is_not_a_number_is_neutralised_and_counted() {
    let nan = f32::NAN;
    let solver = scene::cavity([12, 12, 8], 1);
    let mut inputs = scene::inputs(0);
    inputs.tools[1] = Capsule { a_m: [nan; 3], b_m: [nan; 3], radius_m: nan, velocity_a_m_s: [nan; 3], velocity_b_m_s: [nan; 3] };
    inputs.ports[2].centre_m = [nan; 3];
    inputs.ports[2].share = nan;
    inputs.blood[3].opening = nan;
    inputs.pump.set_pa = nan;
    inputs.acceleration_m_s2 = [f32::INFINITY; 3];
    for _ in 0..5 {
        let report = solver.step_serial(&inputs).unwrap();
        assert_eq!(report.neutralised, 13 + 4 + 1 + 1 + 3);
    }
    let block = scene::state(&solver);
    assert!(StateView::new(bytemuck::cast_slice(&block)).is_ok(), "the state is finite");
    let block = scene::state(&solver);
    assert_eq!(solver.step_serial(&FlowInputs { dt_s: nan, ..inputs }).unwrap().neutralised, 23);
    assert!(scene::state(&solver) == block, "a step of unknown length is no step");
    let mut noise = vec![0.0; 12 * 12 * 8];
    noise[700] = nan;
    assert_eq!(solver.set_velocity_m_s(0, &noise).unwrap(), 1);
}

#[test]
fn flow_far_beyond_the_courant_limit_is_swept_and_stays_bounded() {
    let solver = scene::cavity([24, 24, 14], 1);
    let fast = vec![MAX_SPEED_M_S; 24 * 24 * 14];
    for axis in 0..3 {
        solver.set_velocity_m_s(axis, &fast).unwrap();
    }
    let mut slowed = false;
    for step in 0..40 {
        let mut inputs = scene::inputs(step);
        inputs.dt_s = 0.05;
        inputs.pump.flow_limit_ml_min = 1e4;
        let report = solver.step_serial(&inputs).unwrap();
        slowed |= report.slowed;
        assert!(report.sweeps >= 1 && report.speed_m_s <= 2.0 * MAX_SPEED_M_S, "{report:?}");
    }
    assert!(slowed, "20 m/s over 0.05 s is 500 cells: the report says so");
}

#[test]
fn a_cavity_without_any_fluid_cell_steps_and_stays_at_rest() {
    let solver = scene::cavity([8, 8, 6], 1);
    solver.set_mask(&[1; 8 * 8 * 6]).unwrap();
    for step in 0..10 {
        let report = solver.step_serial(&scene::inputs(step)).unwrap();
        assert_eq!(report.components, 0);
    }
    let block = scene::state(&solver);
    let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
    assert!(view.pressure_pa().iter().all(|&p| p == 0.0));
}

#[test]
fn more_than_eight_separate_pockets_are_solved_or_made_solid() {
    let solver = Solver::new(scene::model([24, 24, 3]), 1).unwrap();
    // 12 × 12 pockets of one cell column each, walls between.
    let mask: Vec<u8> = (0..24 * 24 * 3).map(|c| u8::from(c % 24 % 2 == 1 || c / 24 % 24 % 2 == 1)).collect();
    solver.set_mask(&mask).unwrap();
    let report = solver.step_serial(&scene::inputs(3)).unwrap();
    assert_eq!(report.components, 8);
    assert!(report.residual_relative <= 1e-4, "{report:?}");
}

/// The next numbers of a list.
fn take<const N: usize>(next: &mut impl Iterator<Item = f32>) -> [f32; N] {
    std::array::from_fn(|_| next.next().unwrap_or(0.0))
}

fn capsule(next: &mut impl Iterator<Item = f32>) -> Capsule {
    let ([radius_m], a_m, b_m) = (take(next), take(next), take(next));
    Capsule { a_m, b_m, radius_m, velocity_a_m_s: take(next), velocity_b_m_s: take(next) }
}

/// Inputs of which each kind of number is any.
fn wild_inputs(step: u32, next: &mut impl Iterator<Item = f32>) -> FlowInputs {
    let mut inputs = scene::inputs(step);
    (inputs.tools[1], inputs.wires[0], inputs.wires[1]) = (capsule(next), capsule(next), capsule(next));
    for port in &mut inputs.ports[..3] {
        (port.centre_m, port.direction) = (take(next), take(next));
        [port.radius_m, port.share, port.dye] = take(next);
    }
    for source in &mut inputs.blood[..3] {
        source.position_m = take(next);
        [source.opening] = take(next);
    }
    (inputs.hole.centre_m, inputs.leak.centre_m, inputs.gas.position_m) = (take(next), take(next), take(next));
    [inputs.hole.radius_m, inputs.leak.radius_m, inputs.gas.flow_ml_s, inputs.dt_s] = take(next);
    inputs.acceleration_m_s2 = take(next);
    let pump = &mut inputs.pump;
    [pump.set_pa, pump.flow_limit_ml_min] = take(next);
    [pump.inflow_valve, pump.outflow_valve, pump.open_veins, pump.perforation] = take(next);
    [pump.displaced_ml] = take(next);
    inputs
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, rng_seed: RngSeed::Fixed(5), failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn any_bits_as_inputs_leave_a_valid_state(
        numbers in prop::collection::vec(prop_oneof![any::<u32>().prop_map(f32::from_bits), -2.0f32..2.0, -0.03f32..0.03], 509),
        solid in prop::collection::vec(any::<bool>(), 10 * 9 * 7),
    ) {
        let mut model = scene::model([10, 9, 7]);
        model.pump.leak_ml_s_pa = 1e-4;
        let solver = Solver::new(model, 1).unwrap();
        let mask: Vec<u8> = solid.iter().map(|&s| u8::from(s)).collect();
        // A number of them that has no factor in common with what a step takes.
        let mut next = numbers.iter().copied().cycle();
        for step in 0..4 {
            let velocities_m_s: Vec<[f32; 3]> = mask.iter().map(|_| take(&mut next)).collect();
            solver.set_walls(&mask, &velocities_m_s).unwrap();
            solver.step_serial(&wild_inputs(step, &mut next)).unwrap();
            let block = scene::state(&solver);
            let view = StateView::new(bytemuck::cast_slice(&block));
            prop_assert!(view.is_ok(), "step {}: {:?}", step, view.err());
        }
    }
}
