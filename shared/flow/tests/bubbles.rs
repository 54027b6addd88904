//! Gas: it rises at the speed worked out by hand, gathers under the ceiling, is sucked to the outflow, and none of it is forgotten.

mod scene;

use hyst_flow::{
    BubbleModel, FlowError, FlowInputs, FlowModel, GasSource, Grid, MAX_BUBBLES, Particle, PumpInput, Solver, StateView,
};

const DT_S: f32 = 1.0 / 60.0;

fn bubbles(solver: &Solver) -> Vec<Particle> {
    let block = scene::state(solver);
    let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
    view.bubbles().iter().filter(|bubble| bubble.volume_ml > 0.0).copied().collect()
}

/// Gas from one place in a medium at rest, with everything else shut.
fn still(position_m: [f32; 3], flow_ml_s: f32) -> FlowInputs {
    FlowInputs { dt_s: DT_S, gas: GasSource { position_m, flow_ml_s }, ..Default::default() }
}

fn cell_of(grid: &Grid, place_m: [f32; 3]) -> [usize; 3] {
    std::array::from_fn(|a| ((place_m[a] - grid.origin_m()[a]) / grid.spacing_m()[a]) as usize)
}

#[test]
fn a_bubble_rises_at_the_speed_of_a_sphere_and_slower_beside_a_wall() {
    // 0.5 mm in 0.7 mm²/s: g·D² = 2.4517e-6; 18·ν = 1.26e-5; √(0.3·g·D³) = 1.9177e-5; 2.4517e-6 / 3.1777e-5 = 0.077153 m/s.
    let model = BubbleModel::default();
    assert!((model.rise_m_s(0.7e-6) - 0.077_153).abs() < 1e-5, "{}", model.rise_m_s(0.7e-6));
    // 20 µm: Stokes, g·D²/(18·ν) = 3.9227e-9/1.26e-5 = 3.113e-4 m/s, of which the drag of a wake takes 1.2 %.
    let small = BubbleModel { diameter_m: 2e-5, ..model };
    assert!((small.rise_m_s(0.7e-6) / 3.113e-4 - 0.988).abs() < 2e-3, "{}", small.rise_m_s(0.7e-6));
    let rise = |walls_m: f32| {
        let mut model =
            FlowModel::new(Grid::new([9, 40, 9], [walls_m, 1e-3, walls_m], [-4.5 * walls_m, 0.0, -4.5 * walls_m]).unwrap());
        model.blood.capacity = 1;
        let solver = Solver::new(model, 1).unwrap();
        // Walls around the column of the middle cells.
        let mask: Vec<u8> = (0..9 * 40 * 9).map(|c| u8::from(c % 9 != 4 || c / 360 != 4)).collect();
        solver.set_mask(&mask).unwrap();
        solver.step_serial(&still([0.0, 5.5e-3, 0.0], 1.1e-3 / DT_S)).unwrap();
        let before = bubbles(&solver);
        (0..12).for_each(|_| {
            solver.step_serial(&still([0.0; 3], 0.0)).unwrap();
        });
        let after = bubbles(&solver);
        assert_eq!((before.len(), after.len()), (1, 1));
        assert_eq!([before[0].position_m[0], before[0].position_m[2]], [after[0].position_m[0], after[0].position_m[2]]);
        (after[0].position_m, (after[0].position_m[1] - before[0].position_m[1]) / (12.0 * DT_S))
    };
    // Cells of a metre, then of 1.2 mm: a parcel is as near to a wall, s, as the scatter made it, and loses 9/16·a/s.
    for (cell_m, slowed) in [(1.0, false), (1.2e-3, true)] {
        let (place_m, speed_m_s) = rise(cell_m);
        let nearest_m = [place_m[0], place_m[2]].map(|x| 0.5 * cell_m - x.abs()).into_iter().fold(1.0, f32::min).max(0.25e-3);
        let exact = 0.077_153 * (1.0 - 9.0 / 16.0 * 0.25e-3 / nearest_m);
        assert!((speed_m_s / exact - 1.0).abs() < 1e-3, "{speed_m_s} against {exact} m/s at {nearest_m} m");
        assert_eq!(speed_m_s < 0.07, slowed, "{speed_m_s}");
    }
}

#[test]
fn gas_gathers_under_the_ceiling_where_it_is_highest_and_enters_no_wall() {
    let solver = scene::cavity([24, 24, 14], 1);
    let (grid, mask) = (solver.model().grid, scene::ellipsoid(solver.model().grid));
    for step in 0..600 {
        solver.step_serial(&still([0.012, -0.005, 0.002], if step < 120 { 0.02 } else { 0.0 })).unwrap();
        for bubble in bubbles(&solver) {
            let [i, j, k] = cell_of(&grid, bubble.position_m);
            assert_eq!(mask[(k * 24 + j) * 24 + i], 0, "step {step}: {bubble:?}");
        }
    }
    let gathered = bubbles(&solver);
    assert!(gathered.len() > 30, "{} parcels", gathered.len());
    for bubble in &gathered {
        // The ellipsoid is 24 mm high; the highest cells end there, and none of them lies above another place in the ceiling.
        assert!(bubble.position_m[1] > 0.021, "{bubble:?}");
    }
}

#[test]
fn gas_is_sucked_to_the_outflow_and_all_of_it_is_known() {
    // Bubbles of 50 µm rise 1.9 mm/s; 6 mm beside an outflow of 4 ml/s the medium flows 9 mm/s towards it.
    let run = |outflow_valve: f32| {
        let mut model = scene::model([24, 24, 14]);
        model.bubbles.diameter_m = 5e-5;
        let solver = Solver::new(model, 1).unwrap();
        solver.set_mask(&scene::ellipsoid(solver.model().grid)).unwrap();
        for step in 0..900 {
            let mut inputs = scene::inputs(step);
            (inputs.blood, inputs.tools) = Default::default();
            inputs.gas = GasSource { position_m: [0.006, -0.001, -0.008], flow_ml_s: if step < 600 { 0.3 } else { 0.0 } };
            (inputs.pump.outflow_valve, inputs.pump.flow_limit_ml_min) = (outflow_valve, 800.0);
            solver.step_serial(&inputs).unwrap();
        }
        let gas = solver.gas().unwrap();
        let left_ml: f64 = bubbles(&solver).iter().map(|bubble| f64::from(bubble.volume_ml)).sum();
        assert!((gas.made_ml - left_ml - gas.vented_ml - gas.dissolved_ml).abs() < 1e-6, "{left_ml} ml left of {gas:?}");
        assert!((gas.made_ml + gas.pending_ml[0] - 3.0).abs() < 1e-4, "0.3 ml/s for 10 s: {gas:?}");
        assert!(gas.made > MAX_BUBBLES as u64, "the ring went round: {gas:?}");
        gas
    };
    let (open, shut) = (run(1.0), run(0.0));
    assert!(open.vented_ml > 1.0 && shut.vented_ml < 0.1, "open {open:?}, shut {shut:?}");
}

#[test]
fn a_new_container_brings_air_in_once() {
    let mut model = scene::model([16, 16, 10]);
    model.pump.container_ml = 100.0;
    let solver = Solver::new(model, 1).unwrap();
    let mut inputs = scene::inputs(0);
    (inputs.blood, inputs.gas, inputs.tools) = Default::default();
    inputs.pump =
        PumpInput { set_pa: 15_000.0, flow_limit_ml_min: 800.0, inflow_valve: 1.0, outflow_valve: 1.0, ..Default::default() };
    let mut made = 0;
    for step in 0..3_000 {
        let before_ml = solver.counters().unwrap().0.in_ml;
        solver.step_serial(&inputs).unwrap();
        let (pump, _) = solver.counters().unwrap();
        let gas = solver.gas().unwrap();
        if (before_ml / 100.0).floor() < (pump.in_ml / 100.0).floor() {
            made += 1;
            let port_m = inputs.ports[0].centre_m;
            let near = |bubble: &&Particle| (0..3).all(|a| (bubble.position_m[a] - port_m[a]).abs() < 0.01);
            assert!(bubbles(&solver).iter().filter(near).count() >= 10, "step {step}");
        }
        // 0.05 ml in parcels of 1e-3 ml, less what rounding leaves waiting.
        let came_ml = gas.made_ml + gas.pending_ml[1];
        assert!(gas.containers == made && (came_ml - 0.05 * made as f64).abs() < 1e-6 && gas.pending_ml[1] < 2e-3, "{gas:?}");
        if made == 2 {
            return;
        }
    }
    panic!("{made} containers in 50 s: {:?}", solver.counters().unwrap().0);
}

#[test]
fn gas_that_is_no_number_is_none_and_nonsense_in_the_model_is_refused() {
    let solver = scene::cavity([12, 12, 8], 1);
    for bad in [
        GasSource { position_m: [f32::NAN, 0.0, 0.0], flow_ml_s: 0.1 },
        GasSource { position_m: [0.0; 3], flow_ml_s: f32::INFINITY },
    ] {
        let report = solver.step_serial(&FlowInputs { gas: bad, dt_s: DT_S, ..Default::default() }).unwrap();
        assert_eq!((report.neutralised, solver.gas().unwrap().made), (1, 0));
    }
    type Change = fn(&mut BubbleModel);
    let refused: [(&str, Change); 4] = [
        ("bubbles.up", |model| model.up = [0.0; 3]),
        ("bubbles.diameter_m", |model| model.diameter_m = f32::NAN),
        ("bubbles.parcel_ml", |model| model.parcel_ml = 0.0),
        ("bubbles.change_ml", |model| model.change_ml = -1.0),
    ];
    for (name, change) in refused {
        let mut model = scene::model([8, 8, 6]);
        change(&mut model.bubbles);
        assert!(matches!(Solver::new(model, 1), Err(FlowError::Parameter { name: found, .. }) if found == name), "{name}");
    }
}
