//! A cavity with a moving sheath, in- and outflow and bleeding, for several tests.
#![allow(dead_code)] // each test file uses its part

use hyst_flow::{BloodSource, Capsule, FlowInputs, FlowModel, GasSource, Grid, Port, PumpInput, Solver};

/// A box of 48×48×27 mm around the origin.
pub const SIZE_M: [f32; 3] = [0.048, 0.048, 0.027];

pub fn model(cells: [usize; 3]) -> FlowModel {
    let spacing = std::array::from_fn(|a| SIZE_M[a] / cells[a] as f32);
    let mut model = FlowModel::new(Grid::new(cells, spacing, SIZE_M.map(|s| -0.5 * s)).unwrap());
    model.blood.capacity = 256;
    model.blood.conductance_ml_s_pa = 1e-4;
    model
}

/// A solver whose cavity is the ellipsoid in the box.
pub fn cavity(cells: [usize; 3], bands: usize) -> Solver {
    let solver = Solver::new(model(cells), bands).unwrap();
    solver.set_mask(&ellipsoid(solver.model().grid)).unwrap();
    solver
}

pub fn ellipsoid(grid: Grid) -> Vec<u8> {
    let [nx, ny, nz] = grid.cells();
    let mut solid = Vec::new();
    for c in 0..nx * ny * nz {
        let centre = grid.centre_m([c % nx, c / nx % ny, c / (nx * ny)]);
        let r: f32 = (0..3).map(|a| (2.0 * centre[a] / SIZE_M[a]).powi(2)).sum();
        solid.push(u8::from(r > 1.0));
    }
    solid
}

/// Inputs of step `step`: the sheath circles, medium jets out of its tip, blood wells up at the wall, gas before the tip.
pub fn inputs(step: u32) -> FlowInputs {
    let angle = step as f32 * 0.05;
    let tip = [0.005 * angle.sin(), 0.005 * angle.cos(), 0.0];
    let mut inputs = FlowInputs { dt_s: 1.0 / 60.0, ..Default::default() };
    inputs.pump =
        PumpInput { set_pa: 9_000.0, flow_limit_ml_min: 300.0, inflow_valve: 1.0, outflow_valve: 0.5, ..Default::default() };
    inputs.tools[0] = Capsule {
        a_m: [0.0, 0.0, -0.02],
        b_m: tip,
        radius_m: 0.0025,
        velocity_a_m_s: [0.0; 3],
        velocity_b_m_s: [0.015 * angle.cos(), -0.015 * angle.sin(), 0.0],
    };
    let front = [tip[0], tip[1], 0.004];
    inputs.ports[0] = Port { centre_m: front, radius_m: 0.003, direction: [0.0, 0.0, 1.0], share: 1.0, inflow: true, dye: 0.0 };
    inputs.ports[1] = Port { centre_m: [0.0, 0.0, -0.008], radius_m: 0.004, share: 1.0, ..Default::default() };
    inputs.blood[0] = BloodSource { position_m: [0.012, 0.004, 0.002], opening: 1.0 };
    inputs.gas = GasSource { position_m: front, flow_ml_s: 0.05 };
    inputs.blood[1] = BloodSource { position_m: [-0.01, 0.0, -0.003], opening: 0.5 };
    inputs
}

/// The state in aligned memory.
pub fn state(solver: &Solver) -> Vec<u64> {
    let mut block = vec![0u64; solver.state_bytes() / 8];
    solver.store(bytemuck::cast_slice_mut(&mut block)).unwrap();
    block
}
