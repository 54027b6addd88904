//! What leaves the cavity and does not come back, and what vessels give: each is a sink or a source where it is, and takes its blood along.

mod scene;

use hyst_flow::{BloodSource, FlowInputs, FlowModel, Grid, Port, PumpInput, Solver, StateView, StepReport, Way};

fn ml_of_dye(solver: &Solver) -> f64 {
    let block = scene::state(solver);
    let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
    view.dye().iter().map(|dye| f64::from(*dye)).sum::<f64>() * view.grid().cell_volume_m3() * 1e6
}

/// Medium comes in evenly and leaks evenly, so that all is mixed at each moment: by hand c(t) = c(0)·exp(−Q·t/V).
#[test]
fn what_leaks_as_fast_as_it_comes_in_dilutes_blood_with_the_outflow_shut() {
    let mut model = FlowModel::new(Grid::new([4; 3], [5e-3; 3], [0.0; 3]).unwrap());
    model.pump.leak_ml_s_pa = 2e-4;
    let solver = Solver::new(model, 1).unwrap();
    let (middle_m, whole_m) = ([0.01; 3], 0.02);
    let mut inputs = FlowInputs { dt_s: 0.02, ..Default::default() };
    inputs.pump = PumpInput { set_pa: 8_000.0, flow_limit_ml_min: 60.0, inflow_valve: 1.0, ..Default::default() };
    inputs.ports[0] = Port { centre_m: middle_m, radius_m: whole_m, share: 1.0, inflow: true, ..Default::default() };
    inputs.leak = Way { centre_m: middle_m, radius_m: whole_m };
    for _ in 0..100 {
        solver.step_serial(&FlowInputs { dt_s: 0.25, ..inputs }).unwrap();
    }
    solver.set_dye(&[0.5; 64]).unwrap();
    for step in 1..=400 {
        let pump = solver.step_serial(&inputs).unwrap().pump;
        assert!((pump.in_ml_s - 1.0).abs() < 1e-3 && (pump.leak_ml_s - 1.0).abs() < 1e-3 && pump.out_ml_s == 0.0, "{pump:?}");
        let (t_s, volume_ml) = (f64::from(step) * 0.02, 8.0);
        let (left_ml, exact_ml) = (ml_of_dye(&solver), 0.5 * volume_ml * (-t_s / volume_ml).exp());
        assert!((left_ml / exact_ml - 1.0).abs() < 0.005, "after {t_s} s: {left_ml} ml are left of 4, exact {exact_ml}");
    }
    let (left_ml, blood) = (ml_of_dye(&solver), solver.counters().unwrap().1);
    assert!((left_ml + blood.lost_ml - 4.0).abs() < 1e-3 && blood.washed_ml == 0.0, "{left_ml} ml, {blood:?}");
}

/// A box of 12 × 12 × 24 mm in cells of 1.5 mm; its upper third is solid.
fn ended_by_a_solid(change: impl Fn(&mut FlowModel)) -> Solver {
    let mut model = FlowModel::new(Grid::new([8, 8, 16], [1.5e-3; 3], [0.0; 3]).unwrap());
    change(&mut model);
    let solver = Solver::new(model, 2).unwrap();
    let solid: Vec<u8> = (0..1_024).map(|cell| u8::from(cell / 64 >= 11)).collect();
    solver.set_mask(&solid).unwrap();
    solver
}

/// A fifth of blood in all cells of its medium.
fn evenly() -> [f32; 1_024] {
    std::array::from_fn(|cell| if cell / 64 < 11 { 0.2 } else { 0.0 })
}

#[test]
fn a_hole_far_outside_of_the_medium_takes_it_where_it_is_nearest() {
    let solver = ended_by_a_solid(|_| {});
    let mut inputs = FlowInputs { dt_s: 0.03, ..Default::default() };
    inputs.pump =
        PumpInput { set_pa: 8_000.0, flow_limit_ml_min: 120.0, inflow_valve: 1.0, perforation: 0.5, ..Default::default() };
    inputs.ports[0] = Port { centre_m: [6e-3, 6e-3, 3e-3], radius_m: 3e-3, share: 1.0, inflow: true, ..Default::default() };
    inputs.hole = Way { centre_m: [6e-3, 6e-3, 23e-3], radius_m: 2e-3 };
    for _ in 0..60 {
        solver.step_serial(&FlowInputs { dt_s: 0.25, ports: Default::default(), hole: Way::default(), ..inputs }).unwrap();
    }
    solver.set_dye(&evenly()).unwrap();
    let before_ml = 0.2 * 704.0 * 1.5f64.powi(3) * 1e-3;
    for _ in 0..40 {
        let pump = solver.step_serial(&inputs).unwrap().pump;
        assert!((pump.perforation_ml_s - 2.0).abs() < 0.01, "{pump:?}");
    }
    let (left_ml, blood) = (ml_of_dye(&solver), solver.counters().unwrap().1);
    // 2.4 ml went through 2.4 ml: half of the dye at least is gone, through the hole.
    assert!(blood.lost_ml > 0.5 * before_ml && blood.washed_ml == 0.0, "{} of {before_ml} ml: {blood:?}", blood.lost_ml);
    assert!(((left_ml + blood.lost_ml + blood.buried_ml) / before_ml - 1.0).abs() < 1e-4, "{left_ml} ml, {blood:?}");
}

#[test]
fn open_veins_take_dye_in_and_no_drop_at_its_source() {
    let solver = ended_by_a_solid(|model| model.blood.conductance_ml_s_pa = 1e-6);
    let mut inputs = FlowInputs { dt_s: 0.03, ..Default::default() };
    inputs.pump =
        PumpInput { set_pa: 8_000.0, flow_limit_ml_min: 60.0, inflow_valve: 1.0, open_veins: 0.5, ..Default::default() };
    inputs.ports[0] = Port { centre_m: [6e-3, 6e-3, 3e-3], radius_m: 3e-3, share: 1.0, inflow: true, ..Default::default() };
    inputs.blood[0] = BloodSource { position_m: [6e-3, 6e-3, 16e-3], opening: 1.0 };
    for _ in 0..60 {
        solver.step_serial(&inputs).unwrap();
    }
    solver.set_dye(&evenly()).unwrap();
    for _ in 0..40 {
        solver.step_serial(&inputs).unwrap();
    }
    let blood = solver.counters().unwrap().1;
    assert!(blood.lost_ml > 0.05 && blood.washed_ml == 0.0 && blood.emitted > 0, "{blood:?}");
    let block = scene::state(&solver);
    let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
    let drops = view.particles().iter().filter(|drop| drop.volume_ml > 0.0).count();
    assert_eq!(drops as u64, blood.emitted, "each floats still");
}

/// A vessel at one end and the outflow at the other: all that bleeds flows from one to the other.
#[test]
fn what_bleeds_pushes_the_medium_away_from_its_vessel() {
    let mut model = FlowModel::new(Grid::new([6, 6, 16], [2e-3; 3], [0.0; 3]).unwrap());
    model.blood.conductance_ml_s_pa = 1e-4;
    let solver = Solver::new(model, 1).unwrap();
    let mut inputs = FlowInputs { dt_s: 0.03, ..Default::default() };
    inputs.pump = PumpInput { outflow_valve: 1.0, ..Default::default() };
    inputs.ports[0] = Port { centre_m: [6e-3, 6e-3, 29e-3], radius_m: 4e-3, share: 1.0, ..Default::default() };
    inputs.blood[0] = BloodSource { position_m: [6e-3, 6e-3, 3e-3], opening: 1.0 };
    let mut pump = StepReport::default().pump;
    for _ in 0..300 {
        pump = solver.step_serial(&inputs).unwrap().pump;
    }
    // By hand: 1e-4·(12 000 − p) = 5e-4·p, p = 2 kPa, 1 ml/s.
    assert!((pump.out_ml_s - 1.0).abs() < 0.01, "{pump:?}");
    let block = scene::state(&solver);
    let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
    let up_ml_s: f64 = view.velocity_m_s(2)[8 * 36..9 * 36].iter().map(|w| f64::from(*w)).sum::<f64>() * 4.0;
    assert!((up_ml_s - 1.0).abs() < 0.03, "{up_ml_s} ml/s through the middle");
}
