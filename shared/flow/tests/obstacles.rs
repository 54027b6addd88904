//! What solids and wires do to the medium, along each axis and in cells that are no cubes: ducts, sliding walls, pistons, cylinders.

use hyst_flow::{Capsule, FlowInputs, FlowModel, Grid, MAX_WIRES, Medium, Port, PumpInput, Solver, StateView, Wall};

/// The velocity of a solver along an axis, on the low face of each cell.
fn velocity(solver: &Solver, axis: usize) -> Vec<f32> {
    let mut block = vec![0u64; solver.state_bytes() / 8];
    solver.store(bytemuck::cast_slice_mut(&mut block)).unwrap();
    StateView::new(bytemuck::cast_slice(&block)).unwrap().velocity_m_s(axis).to_vec()
}

/// A box whose axes are turned: what is said of x, y, z holds of the axes `turn`, `turn` + 1, `turn` + 2.
struct Turned {
    turn: usize,
    cells: [usize; 3],
    spacing_m: [f32; 3],
}

impl Turned {
    fn own<T: Copy>(&self, of: [T; 3]) -> [T; 3] {
        std::array::from_fn(|axis| of[(axis + 3 - self.turn) % 3])
    }

    fn model(&self, viscosity_m2_s: f32) -> FlowModel {
        let mut model = FlowModel::new(Grid::new(self.own(self.cells), self.own(self.spacing_m), [0.0; 3]).unwrap());
        model.medium = Medium { viscosity_m2_s, ..Medium::SALINE };
        model.pump.lift_ml = 0.0; // a steady flow is compared
        model
    }

    fn index(&self, at: [usize; 3]) -> usize {
        let ([i, j, k], [nx, ny, _]) = (self.own(at), self.own(self.cells));
        (k * ny + j) * nx + i
    }

    fn places(&self) -> impl Iterator<Item = [usize; 3]> + use<> {
        let [nx, ny, nz] = self.cells;
        (0..nx * ny * nz).map(move |at| [at % nx, at / nx % ny, at / (nx * ny)])
    }

    fn middle_m(&self, at: [usize; 3]) -> [f32; 3] {
        std::array::from_fn(|axis| (at[axis] as f32 + 0.5) * self.spacing_m[axis])
    }
}

/// Speed in a long rectangular duct of height `a` and width `b` at y and z from its middle, in parts of the mean: the series (White, Viscous Fluid Flow, 3-48).
fn in_a_duct(a: f64, b: f64, y: f64, z: f64) -> f64 {
    let pi = std::f64::consts::PI;
    let odd = || (0..40).map(|n| f64::from(2 * n + 1));
    let sign = |n: f64| if (n - 1.0) / 2.0 % 2.0 == 0.0 { 1.0 } else { -1.0 };
    let shape = |n: f64| {
        let (w, wall) = (n * pi * z / a, n * pi * b / (2.0 * a));
        sign(n) * (1.0 - (w - wall).exp() * (1.0 + (-2.0 * w).exp()) / (1.0 + (-2.0 * wall).exp())) * (n * pi * y / a).cos()
            / n.powi(3)
    };
    let mean = 1.0 - 192.0 * a / (pi.powi(5) * b) * odd().map(|n| (n * pi * b / (2.0 * a)).tanh() / n.powi(5)).sum::<f64>();
    48.0 / pi.powi(3) * odd().map(shape).sum::<f64>() / mean
}

/// The largest difference of the flow through a duct of `10·fine` × `12·fine` cells among solids from its series, in parts of the largest speed.
fn off_in_a_duct(turn: usize, fine: usize) -> f64 {
    let [dy, dz] = [0.4e-3, 0.3e-3].map(|h| h / fine as f32);
    let duct = Turned { turn, cells: [48, 10 * fine + 4, 12 * fine + 6], spacing_m: [0.6e-3, dy, dz] };
    let is_open = |[_, j, k]: [usize; 3]| (2..10 * fine + 2).contains(&j) && (3..12 * fine + 3).contains(&k);
    let solver = Solver::new(duct.model(1e-5), 2).unwrap();
    let mut solid = vec![0; duct.cells.iter().product()];
    duct.places().filter(|at| !is_open(*at)).for_each(|at| solid[duct.index(at)] = 1);
    solver.set_mask(&solid).unwrap();
    let middle = [2.0 * dy + 2e-3, 3.0 * dz + 1.8e-3];
    let port = |x: f32, inflow| {
        let centre_m = duct.own([x, middle[0], middle[1]]);
        Port { centre_m, radius_m: 3e-3, share: 1.0, inflow, ..Default::default() }
    };
    // The projection leaves a slip of dt·∇p/ρ at the walls: at this step 1 % of the mean.
    let mut inputs = FlowInputs { dt_s: 5e-4, ..Default::default() };
    inputs.pump =
        PumpInput { set_pa: 15_000.0, flow_limit_ml_min: 12.0, inflow_valve: 1.0, outflow_valve: 0.5, ..Default::default() };
    (inputs.ports[0], inputs.ports[1]) = (port(1e-3, true), port(28e-3, false));
    let filling = FlowInputs { dt_s: 0.05, ..inputs };
    for step in 0..960 {
        solver.step_serial(if step < 160 { &filling } else { &inputs }).unwrap();
    }
    let u = velocity(&solver, turn);
    let across: Vec<[usize; 3]> = duct.places().filter(|at| at[0] == 24 && is_open(*at)).collect();
    let mean = across.iter().map(|at| f64::from(u[duct.index(*at)])).sum::<f64>() / across.len() as f64;
    assert!(mean > 1e-3, "it flows: {mean} m/s");
    let off = across.iter().map(|at| {
        let [_, y, z] = duct.middle_m(*at);
        let exact = in_a_duct(4e-3, 3.6e-3, f64::from(y - middle[0]), f64::from(z - middle[1]));
        (f64::from(u[duct.index(*at)]) / mean - exact).abs() / in_a_duct(4e-3, 3.6e-3, 0.0, 0.0)
    });
    off.fold(0.0, f64::max)
}

/// Of second order: ten cells across are wrong by two parts in a hundred, twenty by a quarter of that. A wall half a cell off would be wrong by twelve.
#[test]
fn the_flow_through_a_duct_of_solids_is_that_of_its_series_along_each_axis() {
    for (turn, fine, allowed) in [(0, 1, 0.025), (1, 1, 0.025), (2, 1, 0.025), (0, 2, 0.0075)] {
        let off = off_in_a_duct(turn, fine);
        assert!(off < allowed, "axis {turn}, {} cells: off by {off}, {allowed} allowed", 10 * fine);
    }
}

/// A wall slides over a trough of solids that is closed at its ends: what it drags along returns below it (see `oracles.rs`).
#[test]
fn a_wall_that_slides_drags_the_medium_along_each_axis() {
    for turn in 0..3 {
        let trough = Turned { turn, cells: [64, 18, 3], spacing_m: [0.4e-3, 0.3e-3, 0.5e-3] };
        let (low, high, speed) = (2, 14, 0.01f32);
        let mut model = trough.model(2e-5);
        let side = (turn + 2) % 3;
        (model.walls[2 * side], model.walls[2 * side + 1]) = (Wall::Slip, Wall::Slip);
        let solver = Solver::new(model, 1).unwrap();
        let cells = trough.cells.iter().product();
        let (mut solid, mut slides) = (vec![0; cells], vec![[0.0; 3]; cells]);
        for at in trough.places().filter(|[_, j, _]| !(low..high).contains(j)) {
            solid[trough.index(at)] = 1;
            if at[1] >= high {
                slides[trough.index(at)] = trough.own([speed, 0.0, 0.0]);
            }
        }
        solver.set_walls(&solid, &slides).unwrap();
        for _ in 0..1_200 {
            solver.step_serial(&FlowInputs { dt_s: 5e-4, ..Default::default() }).unwrap();
        }
        let u = velocity(&solver, turn);
        let eta = |row: usize| (row as f32 + 0.5) / (high - low) as f32;
        let rows = 0..high - low;
        let back = rows.clone().map(eta).sum::<f32>() / rows.clone().map(|row| eta(row) * (1.0 - eta(row))).sum::<f32>();
        for row in rows {
            let exact = speed * (eta(row) - back * eta(row) * (1.0 - eta(row)));
            let found = u[trough.index([32, low + row, 1])];
            assert!((found - exact).abs() < 0.005 * speed, "axis {turn}, row {row}: {found} against {exact}");
        }
    }
}

/// Two pistons go the same way, one at each end of a duct without friction: all between them goes along.
#[test]
fn walls_that_push_and_draw_carry_the_medium_between_them() {
    for turn in 0..3 {
        let duct = Turned { turn, cells: [20, 5, 4], spacing_m: [1e-3, 1.5e-3, 0.8e-3] };
        let mut model = duct.model(1e-6);
        model.walls = [Wall::Slip; 6];
        let solver = Solver::new(model, 2).unwrap();
        let cells = duct.cells.iter().product();
        let (mut solid, mut pushes) = (vec![0; cells], vec![[f32::NAN; 3]; cells]);
        for at in duct.places() {
            if !(3..17).contains(&at[0]) {
                solid[duct.index(at)] = 1;
                pushes[duct.index(at)] = duct.own([0.02, 0.0, 0.0]);
            }
        }
        assert_eq!(solver.set_walls(&solid, &pushes).unwrap(), 0, "what is said of cells of medium counts for nothing");
        let inputs = FlowInputs { dt_s: 1e-2, ..Default::default() };
        for _ in 0..5 {
            let report = solver.step_serial(&inputs).unwrap();
            assert!(!report.unconverged, "{report:?}");
        }
        let u = velocity(&solver, turn);
        for at in duct.places().filter(|at| (3..=17).contains(&at[0])) {
            let found = u[duct.index(at)];
            assert!((found - 0.02).abs() < 2e-5, "axis {turn}, {at:?}: {found} m/s");
        }
        // At rest again: what moved before is forgotten.
        solver.set_mask(&solid).unwrap();
        solver.step_serial(&inputs).unwrap();
        assert!(velocity(&solver, turn).iter().all(|u| u.abs() < 1e-6));
    }
}

/// A box of still medium with a wire through its middle that goes across itself at 0.1 m/s, turned like the rest.
fn with_a_wire(turn: usize, cells: [usize; 3], spacing_m: [f32; 3]) -> (Turned, FlowInputs) {
    let tank = Turned { turn, cells, spacing_m };
    let size: [f32; 3] = std::array::from_fn(|axis| cells[axis] as f32 * spacing_m[axis]);
    let end = |z: f32| tank.own([0.5 * size[0], 0.5 * size[1], 0.5 * size[2] + z]);
    let mut inputs = FlowInputs { dt_s: 1e-3, ..Default::default() };
    let velocity = tank.own([0.1, 0.0, 0.03]); // along itself nothing drags
    inputs.wires[0] =
        Capsule { a_m: end(-5e-3), b_m: end(5e-3), radius_m: 0.2e-3, velocity_a_m_s: velocity, velocity_b_m_s: velocity };
    (tank, inputs)
}

#[test]
fn a_wire_drags_as_a_cylinder_in_a_cross_flow() {
    // By hand: Re = 0.1 · 0.4e-3 / 0.7e-6 = 57.1, C = 1 + 10 · 57.1^(−2/3) = 1.674; ½ · 1 000 · 1.674 · 0.4e-3 · 0.01 · 0.1² = 33.5 µN; and a hundredth less,
    // for within the step the medium comes to 1.4 % of the wire's speed.
    for turn in 0..3 {
        let (tank, inputs) = with_a_wire(turn, [24, 20, 28], [1e-3, 1.2e-3, 0.8e-3]);
        let solver = Solver::new(tank.model(0.7e-6), 1).unwrap();
        let report = solver.step_serial(&inputs).unwrap();
        let expected = tank.own([-33.2e-6, 0.0, 0.0]);
        for axis in 0..3 {
            let found = report.wires.force_n;
            assert!((found[axis] - expected[axis]).abs() < 0.3e-6, "turn {turn}: {found:?} against {expected:?}");
        }
        let u = velocity(&solver, turn);
        let (beside, far) = (u[tank.index([12, 10, 14])], u[tank.index([2, 2, 2])]);
        assert!(beside > 1e-4 && far.abs() < 0.1 * beside, "what is beside it goes along: {beside}, far away {far} m/s");
    }
}

#[test]
fn wires_never_drag_the_medium_beyond_their_own_speed_however_many_and_however_long_the_step() {
    let (tank, mut inputs) = with_a_wire(0, [16, 16, 16], [0.5e-3; 3]);
    inputs.wires = [Capsule { radius_m: 2e-3, ..inputs.wires[0] }; MAX_WIRES];
    inputs.dt_s = 0.2;
    let solver = Solver::new(tank.model(0.7e-6), 3).unwrap();
    for _ in 0..10 {
        let report = solver.step_serial(&inputs).unwrap();
        assert!(report.wild == 0 && report.speed_m_s < 0.2, "{report:?}");
    }
    inputs.wires[3].a_m[1] = f32::NAN;
    inputs.wires[4].velocity_b_m_s[0] = f32::INFINITY;
    let report = solver.step_serial(&inputs).unwrap();
    assert!(report.neutralised == 2 && report.wires.force_n.iter().all(|force| force.is_finite()), "{report:?}");
}

#[test]
fn a_wire_outside_of_the_grid_or_at_the_mediums_own_speed_drags_nothing() {
    let (tank, inputs) = with_a_wire(0, [8, 8, 8], [1e-3; 3]);
    let solver = Solver::new(tank.model(0.7e-6), 1).unwrap();
    let mut outside = inputs;
    (outside.wires[0].a_m, outside.wires[0].b_m) = ([0.1; 3], [0.2; 3]);
    let mut still = inputs;
    (still.wires[0].velocity_a_m_s, still.wires[0].velocity_b_m_s) = ([0.0; 3], [0.0; 3]);
    for inputs in [outside, still] {
        assert_eq!(solver.step_serial(&inputs).unwrap().wires.force_n, [0.0; 3]);
    }
    assert_ne!(solver.step_serial(&inputs).unwrap().wires.force_n, [0.0; 3]);
}

#[test]
fn walls_of_another_number_of_cells_are_refused_and_what_is_no_speed_of_a_wall_is_counted() {
    let solver = Solver::new(FlowModel::new(Grid::new([4, 4, 4], [1e-3; 3], [0.0; 3]).unwrap()), 1).unwrap();
    assert!(solver.set_walls(&[0; 64], &[[0.0; 3]; 63]).is_err());
    assert!(solver.set_walls(&[0; 63], &[[0.0; 3]; 64]).is_err());
    let mut wild = [[0.5, -1.0, 1.0]; 64];
    assert_eq!(solver.set_walls(&[1; 64], &wild).unwrap(), 0, "as fast as walls may be");
    (wild[0][1], wild[5][0], wild[63][2], wild[63][0]) = (f32::NAN, 1.1, f32::NEG_INFINITY, -3.0);
    assert_eq!(solver.set_walls(&[1; 64], &wild).unwrap(), 4);
    assert_eq!(solver.set_walls(&[1; 64], &[[f32::INFINITY; 3]; 64]).unwrap(), 192);
    let report = solver.step_serial(&FlowInputs { dt_s: 0.01, ..Default::default() }).unwrap();
    assert!(report.wild == 0, "{report:?}");
}

/// What lies within a solid is mirrored from the medium that flows the other way, and is no speed of the medium: it costs no sweeps.
#[test]
fn what_faces_within_solids_show_costs_no_sweeps() {
    let trough = Turned { turn: 0, cells: [32, 12, 3], spacing_m: [1e-3; 3] };
    let solver = Solver::new(trough.model(5e-5), 1).unwrap();
    let (mut solid, mut slides) = (vec![0; 32 * 12 * 3], vec![[0.0; 3]; 32 * 12 * 3]);
    for at in trough.places().filter(|[_, j, _]| *j >= 9) {
        (solid[trough.index(at)], slides[trough.index(at)]) = (1, [0.09, 0.0, 0.0]);
    }
    solver.set_walls(&solid, &slides).unwrap();
    for step in 0..40 {
        // 0.9 cells in a step.
        let report = solver.step_serial(&FlowInputs { dt_s: 0.01, ..Default::default() }).unwrap();
        assert!(report.sweeps == 1 && report.speed_m_s <= 0.09, "step {step}: {report:?}");
    }
}

/// A wall beside a shear flow goes back by a cell. What it uncovers went with the wall, and neither with the flow nor, mirrored in the wall, against it: in a
/// closed trough six rows then carry nothing together, so that each has a sixth of the wall's speed less.
#[test]
fn what_a_wall_uncovers_starts_from_the_walls_own_velocity_whoever_goes_on() {
    let fastest = 0.02f32;
    for (turn, share) in [(0, 0.0), (1, 0.0), (2, 0.0), (0, 0.5), (1, -0.5)] {
        let trough = Turned { turn, cells: [30, 9, 3], spacing_m: [1e-3; 3] };
        let mut model = trough.model(1e-6);
        model.walls = [Wall::Slip; 6];
        let (solver, spare) = (Solver::new(model, 1).unwrap(), Solver::new(model, 2).unwrap());
        let walls = |open: usize| {
            let (mut solid, mut slides) = (vec![0; 30 * 9 * 3], vec![[0.0; 3]; 30 * 9 * 3]);
            for at in trough.places().filter(|[_, j, _]| *j >= open) {
                (solid[trough.index(at)], slides[trough.index(at)]) = (1, trough.own([share * fastest, 0.0, 0.0]));
            }
            (solid, slides)
        };
        let (solid, slides) = walls(5);
        solver.set_walls(&solid, &slides).unwrap();
        let mut shear = vec![0.0; 30 * 9 * 3];
        for at in trough.places().filter(|[_, j, _]| *j < 5) {
            shear[trough.index(at)] = fastest * (at[1] as f32 - 2.0) / 2.0;
        }
        solver.set_velocity_m_s(turn, &shear).unwrap();
        let inputs = FlowInputs { dt_s: 1e-3, ..Default::default() };
        solver.step_serial(&inputs).unwrap();
        let mut block = vec![0u64; solver.state_bytes() / 8];
        solver.store(bytemuck::cast_slice_mut(&mut block)).unwrap();
        spare.load(bytemuck::cast_slice(&block)).unwrap();
        let (solid, slides) = walls(6);
        for solver in [&solver, &spare] {
            solver.set_walls(&solid, &slides).unwrap();
            solver.step_serial(&inputs).unwrap();
        }
        let u = velocity(&solver, turn);
        let found = [4, 5].map(|row| u[trough.index([15, row, 1])] / fastest);
        let expected = [1.0 - share / 6.0, share - share / 6.0];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.1), "axis {turn}: {found:?} against {expected:?}");
        assert!((0..3).all(|axis| velocity(&solver, axis) == velocity(&spare, axis)), "a spare has the same bits");
    }
}

/// Walls and tools as fast as any may be named, one against the other: what comes of it is a state that a spare goes on from.
#[test]
fn the_fastest_walls_and_tools_leave_a_state_that_can_be_gone_on_from() {
    let box_of = Turned { turn: 0, cells: [16, 12, 8], spacing_m: [1e-3; 3] };
    let solver = Solver::new(box_of.model(1e-6), 2).unwrap();
    let spare = Solver::new(box_of.model(1e-6), 1).unwrap();
    let (mut solid, mut wild) = (vec![0; 16 * 12 * 8], vec![[0.0; 3]; 16 * 12 * 8]);
    let mut inputs = FlowInputs { dt_s: 0.03, ..Default::default() };
    for step in 0..60u32 {
        let sign = if step % 2 == 0 { 1.0 } else { -1.0 };
        for at in box_of.places() {
            let is_wall = (at[0] + at[1] * 3 + at[2] * 5 + step as usize / 3).is_multiple_of(7);
            (solid[box_of.index(at)], wild[box_of.index(at)]) = (u8::from(is_wall), [1e4 * sign, -1e4 * sign, f32::MAX * sign]);
        }
        solver.set_walls(&solid, &wild).unwrap();
        let velocity = [1e3 * sign, 1e3, -1e3 * sign];
        let (a_m, b_m) = ([4e-3, 4e-3, 2e-3], [12e-3, 8e-3, 6e-3]);
        inputs.tools[0] = Capsule { a_m, b_m, radius_m: 2e-3, velocity_a_m_s: velocity, velocity_b_m_s: velocity };
        solver.step_serial(&inputs).unwrap();
        let mut block = vec![0u64; solver.state_bytes() / 8];
        solver.store(bytemuck::cast_slice_mut(&mut block)).unwrap();
        spare.load(bytemuck::cast_slice(&block)).unwrap_or_else(|error| panic!("step {step}: {error}"));
    }
}
