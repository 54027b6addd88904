//! Bleeding: only against a lower pressure, the same drops for the same seed, carried by the flow and washed out.

mod scene;

use hyst_flow::{FlowInputs, Particle, Solver, StateView};

fn bleeding(step: u32) -> FlowInputs {
    let mut inputs = scene::inputs(step);
    inputs.tools = Default::default();
    inputs
}

fn drops(solver: &Solver) -> Vec<Particle> {
    let block = scene::state(solver);
    let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
    view.particles().to_vec()
}

#[test]
fn vessels_bleed_below_their_pressure_and_stay_dry_above() {
    let solver = scene::cavity([16, 16, 10], 1);
    for step in 0..60 {
        solver.step_serial(&bleeding(step)).unwrap();
    }
    let wet = solver.counters().unwrap().1.emitted_ml;
    assert!(wet > 0.1, "9 kPa in the cavity, 12 kPa in the vessel: {wet} ml");
    let mut model = scene::model([16, 16, 10]);
    model.blood.vessel_pa = 0.0;
    let dry = Solver::new(model, 1).unwrap();
    for step in 0..60 {
        dry.step_serial(&bleeding(step)).unwrap();
    }
    assert_eq!(dry.counters().unwrap().1.emitted, 0);
}

#[test]
fn first_drop_has_the_volume_that_flowed() {
    // An empty cavity is at 0 Pa: 1e-4 ml/(s·Pa) · 12 000 Pa · 1/60 s = 0.02 ml = 20 units of 1e-3 ml less a rounding:
    // 19 whole units in 16 drops (the bound per step), the rest waits.
    let solver = scene::cavity([16, 16, 10], 1);
    let mut inputs = bleeding(0);
    inputs.blood[1] = Default::default();
    inputs.pump = Default::default();
    solver.step_serial(&inputs).unwrap();
    let (_, blood) = solver.counters().unwrap();
    assert!(
        blood.emitted == 16 && (blood.emitted_ml + blood.pending_ml[0] - 0.02).abs() < 1e-8 && blood.pending_ml[0] < 1.001e-3,
        "{blood:?}"
    );
}

#[test]
fn drops_lie_near_their_source_and_the_seed_decides_where() {
    let first = |seed: u64| {
        let mut model = scene::model([16, 16, 10]);
        model.blood.seed = seed;
        let solver = Solver::new(model, 1).unwrap();
        solver.step_serial(&bleeding(0)).unwrap();
        drops(&solver)
    };
    let (a, b, c) = (first(1), first(1), first(2));
    assert!(a == b && a != c);
    let source = bleeding(0).blood[0].position_m;
    for drop in a.iter().take(8) {
        let far = (0..3).any(|n| (drop.position_m[n] - source[n]).abs() > 0.004);
        assert!(drop.volume_ml > 0.0 && !far, "{drop:?}");
    }
}

#[test]
fn drops_never_enter_solid_cells_and_are_washed_out_after_the_vessel_closes() {
    let solver = scene::cavity([24, 24, 14], 1);
    let grid = solver.model().grid;
    let mask = scene::ellipsoid(grid);
    for step in 0..60 {
        solver.step_serial(&bleeding(step)).unwrap();
    }
    let count = |drops: &[Particle]| drops.iter().filter(|d| d.volume_ml > 0.0).count();
    let before = drops(&solver);
    assert!(count(&before) > 100);
    for drop in before.iter().filter(|d| d.volume_ml > 0.0) {
        let [i, j, k]: [usize; 3] =
            std::array::from_fn(|a| ((drop.position_m[a] - grid.origin_m()[a]) / grid.spacing_m()[a]) as usize);
        assert_eq!(mask[(k * 24 + j) * 24 + i], 0, "{drop:?}");
    }
    for step in 60..1_260 {
        let mut inputs = bleeding(step);
        inputs.blood = Default::default();
        solver.step_serial(&inputs).unwrap();
    }
    let after = drops(&solver);
    assert!(count(&after) < count(&before) / 2, "{} drops before, {} after 20 s of rinsing", count(&before), count(&after));
}
