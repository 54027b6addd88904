//! Where the medium comes in and goes out: each port has cells of its own, however fine the grid.

mod scene;

use hyst_flow::{FlowInputs, FlowModel, Grid, Port, PumpInput, Solver, StateView, StepReport};

/// A box of the cells that a cavity of 34 × 16 × 56 mm has in a grid of 128 × 57 × 128, as large as two ports.
const CELLS: [usize; 3] = [26, 24, 36];
const SPACING_M: [f32; 3] = [0.27e-3, 0.28e-3, 0.44e-3];

/// The ports of a scope whose tip is in the middle of the box, 3 mm wide, and what they move.
fn inputs() -> FlowInputs {
    let mut inputs = FlowInputs { dt_s: 0.02, ..Default::default() };
    let size: [f32; 3] = std::array::from_fn(|axis| CELLS[axis] as f32 * SPACING_M[axis]);
    let centre_m = |z: f32| [0.5 * size[0], 0.5 * size[1], z];
    let port = |z: f32, inflow| Port { centre_m: centre_m(z), radius_m: 3e-3, share: 1.0, inflow, ..Default::default() };
    (inputs.ports[0], inputs.ports[1]) = (port(size[2] - 3e-3, true), port(3e-3, false));
    inputs.pump =
        PumpInput { set_pa: 9_000.0, flow_limit_ml_min: 120.0, inflow_valve: 1.0, outflow_valve: 1.0, ..Default::default() };
    inputs
}

#[test]
fn on_a_fine_grid_the_outflow_has_cells_beside_those_of_the_inflow_and_dye_is_washed_out() {
    let solver = Solver::new(FlowModel::new(Grid::new(CELLS, SPACING_M, [0.0; 3]).unwrap()), 2).unwrap();
    let inputs = inputs();
    // The pump alone, until as much leaves the cavity as enters it.
    let still = FlowInputs { dt_s: 0.25, ports: Default::default(), ..inputs };
    let mut filled = StepReport::default().pump;
    for _ in 0..60 {
        filled = solver.step_serial(&still).unwrap().pump;
    }
    assert!((filled.out_ml_s / filled.in_ml_s - 1.0).abs() < 1e-3, "{filled:?}");
    solver.set_dye(&vec![0.5; CELLS.iter().product()]).unwrap();
    for step in 0..60 {
        let report = solver.step_serial(&inputs).unwrap();
        assert_eq!(report.blind_ports, 0, "step {step}: {report:?}");
    }
    let block = scene::state(&solver);
    let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
    let cell_ml = view.grid().cell_volume_m3() * 1e6;
    let volume_ml = view.grid().cell_count() as f64 * cell_ml;
    let left_ml = view.dye().iter().map(|dye| f64::from(*dye)).sum::<f64>() * cell_ml;
    let washed_ml = view.blood().washed_ml;
    assert!(((left_ml + washed_ml) / (0.5 * volume_ml) - 1.0).abs() < 1e-4, "{left_ml} ml are left, {washed_ml} were washed out");
    // 1.2 s of 2 ml/s are three times what is in the box.
    assert!(washed_ml > 0.35 * volume_ml, "{washed_ml} of {} ml were washed out", 0.5 * volume_ml);
}

#[test]
fn a_port_in_a_solid_is_counted_while_its_valve_is_open() {
    let solver = Solver::new(FlowModel::new(Grid::new(CELLS, SPACING_M, [0.0; 3]).unwrap()), 1).unwrap();
    let layer = CELLS[0] * CELLS[1];
    // The upper half is solid, and the inflow in it.
    let solid: Vec<u8> = (0..CELLS.iter().product::<usize>()).map(|cell| u8::from(cell / layer >= CELLS[2] / 2)).collect();
    solver.set_mask(&solid).unwrap();
    let mut inputs = inputs();
    inputs.ports[0].centre_m[2] = 14e-3;
    inputs.ports[0].radius_m = 1e-3;
    assert_eq!(solver.step_serial(&inputs).unwrap().blind_ports, 1);
    inputs.pump.inflow_valve = 0.0;
    assert_eq!(solver.step_serial(&inputs).unwrap().blind_ports, 0, "it is shut");
    solver.set_mask(&vec![1; solid.len()]).unwrap();
    assert_eq!(solver.step_serial(&inputs).unwrap().blind_ports, 1, "the outflow");
}
