//! The flow against solutions that somebody else knows: Poiseuille, Couette with its return flow, Taylor–Green, and the lid-driven
//! cavity of Ghia et al. 1982.

use hyst_flow::{Capsule, FlowInputs, FlowModel, Grid, Medium, Port, PumpInput, Solver, StateView, StepReport, Wall};

/// The state of a solver in aligned memory.
fn state(solver: &Solver) -> Vec<u64> {
    let mut block = vec![0u64; solver.state_bytes() / 8];
    solver.store(bytemuck::cast_slice_mut(&mut block)).unwrap();
    block
}

fn flat(cells: [usize; 2], h: f32, viscosity_m2_s: f32) -> FlowModel {
    let grid = Grid::new([cells[0], cells[1], 1], [h; 3], [0.0; 3]).unwrap();
    let mut model = FlowModel::new(grid);
    model.medium = Medium { viscosity_m2_s, ..Medium::SALINE };
    (model.walls[4], model.walls[5]) = (Wall::Slip, Wall::Slip);
    model
}

#[test]
fn flow_between_plates_is_the_parabola_of_its_discharge() {
    let (nx, ny, h) = (64, 16, 0.5e-3f32);
    let mut model = flat([nx, ny], h, 1e-5);
    model.pump.lift_ml = 0.0; // a steady flow is compared
    let solver = Solver::new(model, 1).unwrap();
    let mut inputs = FlowInputs { dt_s: 5e-3, ..Default::default() };
    inputs.pump =
        PumpInput { set_pa: 15_000.0, flow_limit_ml_min: 1.2, inflow_valve: 1.0, outflow_valve: 0.5, ..Default::default() };
    let port = |x: f32, inflow| Port { centre_m: [x, 4e-3, 0.25e-3], radius_m: 2e-3, share: 1.0, inflow, ..Default::default() };
    inputs.ports[0] = port(2e-3, true);
    inputs.ports[1] = port(30e-3, false);
    let mut report = Default::default();
    for _ in 0..1_200 {
        report = solver.step_serial(&inputs).unwrap();
    }
    assert!((report.pump.out_ml_s / report.pump.in_ml_s - 1.0).abs() < 0.01, "the cavity is in balance: {:?}", report.pump);
    let height = ny as f32 * h;
    let mean = (report.pump.out_ml_s * 1e-6) as f32 / (height * h);
    let block = state(&solver);
    let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
    let top = 1.5 * mean;
    for j in 0..ny {
        let y = (j as f32 + 0.5) * h;
        let exact = 6.0 * mean * y * (height - y) / (height * height);
        let u = view.velocity_m_s(0)[j * nx + nx / 2];
        assert!((u - exact).abs() < 0.008 * top, "row {j}: {u} against {exact} (0.8 % of the maximum {top} allowed)");
    }
}

/// Couette flow by hand: a plate that slides over a closed trough drags medium along (U·η), and as much returns below in a Poiseuille
/// flow C·η·(1 − η), with C such that the rows together carry nothing. A capsule of 1 m radius is the plate.
#[test]
fn an_obstacle_that_slides_drags_the_medium_and_as_much_returns() {
    let (nx, ny, gap, h, speed) = (64, 24, 20, 0.4e-3f32, 0.01f32);
    let solver = Solver::new(flat([nx, ny], h, 5e-5), 1).unwrap();
    // A projection leaves a slip of dt·∇p/ρ at the walls: at this step 0.2 % of the plate's speed.
    let mut inputs = FlowInputs { dt_s: 5e-4, ..Default::default() };
    let (surface_m, middle_m) = (gap as f32 * h, 0.5 * h);
    inputs.tools[0] = Capsule {
        a_m: [-1.0, surface_m + 1.0, middle_m],
        b_m: [1.0, surface_m + 1.0, middle_m],
        radius_m: 1.0,
        velocity_a_m_s: [speed, 0.0, 0.0],
        velocity_b_m_s: [speed, 0.0, 0.0],
    };
    for _ in 0..1_000 {
        solver.step_serial(&inputs).unwrap();
    }
    let block = state(&solver);
    let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
    let eta = |row: usize| (row as f32 + 0.5) / gap as f32;
    let dragged: f32 = (0..gap).map(eta).sum();
    let back = dragged / (0..gap).map(|row| eta(row) * (1.0 - eta(row))).sum::<f32>();
    let mut net = 0.0;
    for row in 0..gap {
        let exact = speed * (eta(row) - back * eta(row) * (1.0 - eta(row)));
        let u = view.velocity_m_s(0)[row * nx + nx / 2];
        net += u;
        assert!((u - exact).abs() < 0.005 * speed, "row {row}: {u} against {exact} (0.5 % of the plate's {speed} allowed)");
    }
    assert!(net.abs() < 1e-4 * speed * gap as f32, "as much returns as is dragged along: {net}");
}

/// What is left of a Taylor–Green vortex of speed 1 in a box of edge 1 after a second in so many steps, and what is to be left; the report of
/// the first step.
fn taylor_green(steps: u16) -> (f64, f64, StepReport) {
    let n = 32;
    let (h, viscosity, pi) = (1.0 / n as f32, 0.01f32, std::f32::consts::PI);
    let mut model = flat([n, n], h, viscosity);
    model.walls = [Wall::Slip; 6];
    let solver = Solver::new(model, 1).unwrap();
    let (mut u, mut v) = (vec![0.0; n * n], vec![0.0; n * n]);
    for j in 0..n {
        for i in 0..n {
            let (x, y) = (i as f32 * h, j as f32 * h);
            u[j * n + i] = (pi * x).sin() * (pi * (y + 0.5 * h)).cos();
            v[j * n + i] = -(pi * (x + 0.5 * h)).cos() * (pi * y).sin();
        }
    }
    solver.set_velocity_m_s(0, &u).unwrap();
    solver.set_velocity_m_s(1, &v).unwrap();
    let inputs = FlowInputs { dt_s: 1.0 / f32::from(steps), ..Default::default() };
    let reports: Vec<StepReport> = (0..steps).map(|_| solver.step_serial(&inputs).unwrap()).collect();
    let block = state(&solver);
    let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
    let energy = |a: &[f32]| a.iter().map(|x| f64::from(x * x)).sum::<f64>();
    let left = (energy(view.velocity_m_s(0)) / energy(&u)).sqrt();
    (left, f64::from(-2.0 * pi * pi * viscosity).exp(), reports[0])
}

#[test]
fn taylor_green_vortex_decays_at_the_viscous_rate() {
    let (left, exact, _) = taylor_green(100);
    assert!((left / exact - 1.0).abs() < 0.025, "amplitude {left:.4} left, exact {exact:.4}, 2.5 % allowed");
}

#[test]
fn steps_beyond_the_courant_limit_are_made_of_sweeps_and_are_wrong_by_their_length_and_no_more() {
    // A speed of 1 crosses 32 cells of 1/32 in a second: 1.3 in a step of 1/25 s, 3.2 in a tenth, 8 in a quarter. The splitting of the operators is of
    // first order: it takes up to two parts in each second of a step's length, and never adds any.
    for (steps, sweeps) in [(50, 1), (25, 2), (10, 4), (4, 8)] {
        let (left, exact, first) = taylor_green(steps);
        assert!(first.sweeps == sweeps && !first.slowed, "{steps} steps: {first:?}");
        let (off, dt_s) = (left / exact - 1.0, 1.0 / f64::from(steps));
        assert!(
            (-2.0 * dt_s..=0.0).contains(&off),
            "steps of {dt_s} s: amplitude {left:.4} left, exact {exact:.4}, off by {off:.4}"
        );
    }
}

/// Position on a centreline and the velocity there, in units of the lid's length and speed.
type Profile = &'static [(f32, f32)];

/// Ghia, Ghia and Shin 1982, tables I and II, Re = 100: (y, u on the vertical centreline), (x, v on the horizontal one).
const GHIA_100: [Profile; 2] = [
    &[
        (0.0547, -0.03717),
        (0.1016, -0.06434),
        (0.1719, -0.10150),
        (0.2813, -0.15662),
        (0.4531, -0.21090),
        (0.5000, -0.20581),
        (0.6172, -0.13641),
        (0.7344, 0.00332),
        (0.8516, 0.23151),
        (0.9531, 0.68717),
        (0.9688, 0.78871),
    ],
    &[
        (0.0625, 0.09233),
        (0.0938, 0.12317),
        (0.1563, 0.16077),
        (0.2266, 0.17507),
        (0.5000, 0.05454),
        (0.8047, -0.24533),
        (0.8594, -0.22445),
        (0.9063, -0.16914),
        (0.9531, -0.08864),
    ],
];
/// The same tables, Re = 400. Their v at x = 0.9063 is left out: it lies off the curve of its neighbours.
const GHIA_400: [Profile; 2] = [
    &[
        (0.0547, -0.08186),
        (0.0703, -0.10338),
        (0.1016, -0.14612),
        (0.1719, -0.24299),
        (0.2813, -0.32726),
        (0.4531, -0.17119),
        (0.5000, -0.11477),
        (0.6172, 0.02135),
        (0.7344, 0.16256),
        (0.8516, 0.29093),
        (0.9531, 0.55892),
        (0.9688, 0.68439),
        (0.9766, 0.75837),
    ],
    &[
        (0.0625, 0.18360),
        (0.0781, 0.20920),
        (0.0938, 0.22965),
        (0.1563, 0.28124),
        (0.2266, 0.30203),
        (0.5000, 0.05186),
        (0.8047, -0.38598),
        (0.8594, -0.44993),
        (0.9531, -0.19254),
        (0.9688, -0.12146),
    ],
];

/// Steady flow under a lid of speed 1 over an n×n cavity of length 1, against both profiles.
fn lid_driven(n: usize, reynolds: f32, steps: u32, dt_s: f32, [along_y, along_x]: [Profile; 2], allowed: f32) {
    let h = 1.0 / n as f32;
    let mut model = flat([n, n], h, 1.0 / reynolds);
    model.walls[3] = Wall::NoSlip([1.0, 0.0, 0.0]);
    let solver = Solver::new(model, 1).unwrap();
    for _ in 0..steps {
        solver.step_serial(&FlowInputs { dt_s, ..Default::default() }).unwrap();
    }
    let block = state(&solver);
    let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
    let between = |at: f32, value: &dyn Fn(usize) -> f32| {
        let x = (at / h - 0.5).clamp(0.0, n as f32 - 1.001);
        let t = x - x.floor();
        value(x as usize) * (1.0 - t) + value(x as usize + 1) * t
    };
    let u = |at: f32| between(at, &|j| view.velocity_m_s(0)[j * n + n / 2]);
    let v = |at: f32| between(at, &|i| view.velocity_m_s(1)[n / 2 * n + i]);
    let off = along_y
        .iter()
        .map(|(y, exact)| (u(*y) - exact, 'u', *y))
        .chain(along_x.iter().map(|(x, exact)| (v(*x) - exact, 'v', *x)));
    let worst = off.max_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).unwrap();
    assert!(worst.0.abs() < allowed, "(off by, component, at) {worst:?}; {allowed} of the lid's speed allowed on {n}²");
}

#[test]
fn lid_driven_cavity_follows_ghia_at_re_100() {
    lid_driven(32, 100.0, 2_000, 0.012, GHIA_100, 0.012);
}

#[test]
fn lid_driven_cavity_follows_ghia_at_re_400() {
    lid_driven(64, 400.0, 3_300, 0.012, GHIA_400, 0.04);
}
