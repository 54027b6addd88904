//! Prints milliseconds per step and cells per second of the Flow Engine on one thread, at a residual of 1e-4:
//! a cavity with an ellipsoidal wall, a moving sheath, in- and outflow, and blood.
//!
//! `cargo run --release -p hyst-flow --example flow_bench`

use std::collections::BTreeMap;
use std::time::Instant;

use hyst_flow::{BloodSource, Capsule, FlowError, FlowInputs, FlowModel, Grid, Port, PumpInput, Solver, StepReport};

fn main() -> Result<(), FlowError> {
    println!("grid, scene, ms per step, Hz, Hz in the best 30 steps, million cells per s, iterations, residual, sweeps");
    for cells in [[32, 32, 18], [64, 64, 28]] {
        for ellipsoid in [false, true] {
            bench(cells, ellipsoid)?;
        }
    }
    Ok(())
}

fn bench(cells: [usize; 3], ellipsoid: bool) -> Result<(), FlowError> {
    let size = [0.048f32, 0.048, 0.027];
    let spacing = std::array::from_fn(|a| size[a] / cells[a] as f32);
    let grid = Grid::new(cells, spacing, size.map(|s| -0.5 * s))?;
    let solver = Solver::new(FlowModel::new(grid), 1)?;
    if ellipsoid {
        solver.set_mask(&cavity(&grid, size))?;
    }
    let (mut ms, mut iterations, mut sweeps, mut residual) = (0.0, 0, 0, 0.0f64);
    let (warm, steps) = (60u32, 240u32);
    let mut shares = BTreeMap::new();
    let (mut window, mut best) = (0.0, f64::INFINITY);
    for step in 0..warm + steps {
        let inputs = inputs(step);
        let begin = Instant::now();
        let report = timed_step(&solver, &inputs, &mut shares)?;
        if step >= warm {
            let passed = begin.elapsed().as_secs_f64() * 1e3;
            ms += passed;
            window += passed;
            if step % 30 == 29 {
                best = best.min(window / 30.0);
                window = 0.0;
            }
            iterations += report.iterations;
            sweeps += report.sweeps;
            residual = residual.max(report.residual_relative);
        }
    }
    let ms = ms / f64::from(steps);
    let rate = 1e3 / ms;
    let scene = if ellipsoid { "cavity" } else { "box" };
    let n = f64::from(steps);
    println!(
        "{}×{}×{}, {scene}, {ms:.3}, {rate:.0}, {:.0}, {:.2}, {:.1}, {residual:.1e}, {:.1}",
        cells[0],
        cells[1],
        cells[2],
        1e3 / best,
        grid.cell_count() as f64 * rate * 1e-6,
        f64::from(iterations) / n,
        f64::from(sweeps) / n
    );
    let mut block = vec![0u64; solver.state_bytes() / 8];
    for (name, load) in [("store", false), ("load", true)] {
        let begin = Instant::now();
        for _ in 0..20 {
            if load {
                solver.load(bytemuck::cast_slice(&block))?;
            } else {
                solver.store(bytemuck::cast_slice_mut(&mut block))?;
            }
        }
        println!("    {name:<20} {:.3} ms for {} bytes", begin.elapsed().as_secs_f64() * 50.0, block.len() * 8);
    }
    for (phase, seconds) in shares {
        println!("    {phase:<20} {:.3} ms", seconds * 1e3 / f64::from(warm + steps));
    }
    Ok(())
}

/// Inputs of a step: the sheath circles, medium jets out of its tip and leaves behind it, blood wells up.
fn inputs(step: u32) -> FlowInputs {
    let mut inputs = FlowInputs { dt_s: 1.0 / 120.0, ..Default::default() };
    inputs.pump =
        PumpInput { set_pa: 10_000.0, flow_limit_ml_min: 400.0, inflow_valve: 1.0, outflow_valve: 0.4, ..Default::default() };
    inputs.blood[0] = BloodSource { position_m: [0.008, 0.004, 0.0], opening: 1.0 };
    let angle = step as f32 * 0.02;
    let tip = [0.005 * angle.sin(), 0.005 * angle.cos(), 0.0];
    let velocity = [0.005 * 2.4 * angle.cos(), -0.005 * 2.4 * angle.sin(), 0.0];
    inputs.tools[0] =
        Capsule { a_m: [0.0, 0.0, -0.02], b_m: tip, radius_m: 0.0025, velocity_a_m_s: [0.0; 3], velocity_b_m_s: velocity };
    let mut front = tip;
    front[2] += 0.004;
    inputs.ports[0] = Port { centre_m: front, radius_m: 0.0025, direction: [0.0, 0.0, 1.0], share: 1.0, inflow: true, dye: 0.0 };
    inputs.ports[1] = Port { centre_m: [0.0, 0.0, -0.008], radius_m: 0.005, share: 1.0, ..Default::default() };
    inputs
}

/// A step on this thread, with the time of each phase added to `shares`.
fn timed_step(solver: &Solver, inputs: &FlowInputs, shares: &mut BTreeMap<String, f64>) -> Result<StepReport, FlowError> {
    let mut begin = Instant::now();
    solver.begin(inputs)?;
    let mut lap = |name: &str, begin: &mut Instant| {
        *shares.entry(name.to_string()).or_insert(0.0) += begin.elapsed().as_secs_f64();
        *begin = Instant::now();
    };
    lap("begin", &mut begin);
    while let Some(phase) = solver.next_phase()? {
        lap("between phases", &mut begin);
        solver.run_phase(phase, 0)?;
        lap(&format!("{phase:?}"), &mut begin);
    }
    lap("between phases", &mut begin);
    solver.report()
}

/// Solid outside the ellipsoid that fills the box.
fn cavity(grid: &Grid, size: [f32; 3]) -> Vec<u8> {
    let [nx, ny, nz] = grid.cells();
    let mut solid = Vec::with_capacity(grid.cell_count());
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                let c = grid.centre_m([i, j, k]);
                let r: f32 = (0..3).map(|a| (2.0 * c[a] / size[a]).powi(2)).sum();
                solid.push(u8::from(r > 1.0));
            }
        }
    }
    solid
}
