//! What the medium does to tools and wires, against hand arithmetic: buoyancy, friction, the balance of momentum, Stokes drag.

use hyst_flow::{Capsule, FlowInputs, FlowModel, Grid, Load, Medium, Solver, StateView, StepReport, Wall};

/// A box with its low corner at the origin, and a medium of 1 000 kg/m³.
fn model(cells: [usize; 3], spacing_m: [f32; 3], viscosity_m2_s: f32) -> FlowModel {
    let mut model = FlowModel::new(Grid::new(cells, spacing_m, [0.0; 3]).unwrap());
    model.medium = Medium { viscosity_m2_s, ..Medium::SALINE };
    model.residual_relative = 1e-5;
    model
}

fn ball(centre_m: [f32; 3], radius_m: f32, velocity_m_s: [f32; 3]) -> Capsule {
    Capsule { a_m: centre_m, b_m: centre_m, radius_m, velocity_a_m_s: velocity_m_s, velocity_b_m_s: velocity_m_s }
}

fn steps(solver: &Solver, inputs: &FlowInputs, count: usize) -> StepReport {
    let mut report = StepReport::default();
    for _ in 0..count {
        report = solver.step_serial(inputs).unwrap();
    }
    report
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|n| a[(n + 1) % 3] * b[(n + 2) % 3] - a[(n + 2) % 3] * b[(n + 1) % 3])
}

fn length(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

/// Distance of two vectors in parts of the length of the second.
fn off(found: [f64; 3], expected: [f64; 3]) -> f64 {
    length(std::array::from_fn(|axis| found[axis] - expected[axis])) / length(expected)
}

fn wide(of: [f32; 3]) -> [f64; 3] {
    of.map(f64::from)
}

/// The state's block, from which fields are read.
fn stored(solver: &Solver) -> Vec<u64> {
    let mut block = vec![0u64; solver.state_bytes() / 8];
    solver.store(bytemuck::cast_slice_mut(&mut block)).unwrap();
    block
}

#[test]
fn a_medium_at_rest_does_nothing_to_a_tool_at_rest() {
    let solver = Solver::new(model([12, 12, 12], [1e-3; 3], 0.7e-6), 2).unwrap();
    let mut inputs = FlowInputs { dt_s: 0.01, ..Default::default() };
    inputs.tools[1] = ball([6e-3; 3], 2e-3, [0.0; 3]);
    let report = steps(&solver, &inputs, 5);
    assert!(report.tools[1].cells > 20 && report.tools[1].faces > 20, "{report:?}");
    assert_eq!((report.tools[1].force_n, report.tools[1].torque_nm), ([0.0; 3], [0.0; 3]));
    assert_eq!((report.tools[0], report.wires), (Load::default(), Load::default()), "there are none");
}

/// Archimedes: in a closed box under an acceleration a the medium stands, and pushes on a body of volume V by −ρ·a·V, at the middle of the volume.
#[test]
fn a_tool_in_a_heavy_medium_is_lifted_by_what_it_displaces() {
    let (cells, spacing_m) = ([16, 14, 12], [1e-3, 1.2e-3, 0.8e-3]);
    let solver = Solver::new(model(cells, spacing_m, 0.7e-6), 1).unwrap();
    let mut inputs = FlowInputs { dt_s: 1e-3, acceleration_m_s2: [1.0, -2.0, 9.81], ..Default::default() };
    let (a_m, b_m, radius_m) = ([6e-3, 7e-3, 4e-3], [10e-3, 9e-3, 5e-3], 2e-3);
    inputs.tools[0] = Capsule { a_m, b_m, radius_m, ..Default::default() };
    let load = steps(&solver, &inputs, 10).tools[0];
    // The cells whose middle is within the radius of the segment, and the middle of all of them.
    let (from, to) = (wide(a_m), wide(b_m));
    let along: [f64; 3] = std::array::from_fn(|axis| to[axis] - from[axis]);
    let middle_m = |at: usize| -> [f64; 3] {
        let ijk = [at % cells[0], at / cells[0] % cells[1], at / (cells[0] * cells[1])];
        std::array::from_fn(|axis| (ijk[axis] as f64 + 0.5) * f64::from(spacing_m[axis]))
    };
    let is_inside = |place_m: &[f64; 3]| {
        let own: [f64; 3] = std::array::from_fn(|axis| place_m[axis] - from[axis]);
        let t = (dot(own, along) / dot(along, along)).clamp(0.0, 1.0);
        length(std::array::from_fn(|axis| own[axis] - t * along[axis])) <= f64::from(radius_m)
    };
    let count: usize = cells.iter().product();
    let places: Vec<[f64; 3]> = (0..count).map(middle_m).filter(is_inside).collect();
    assert_eq!((load.cells as usize, places.len()), (93, 93));
    let volume_m3 = 93.0 * spacing_m.iter().map(|h| f64::from(*h)).product::<f64>();
    let middle_m: [f64; 3] = std::array::from_fn(|axis| places.iter().map(|place| place[axis]).sum::<f64>() / 93.0);
    let force_n = [1.0, -2.0, 9.81].map(|a| -1_000.0 * a * volume_m3);
    assert!(off(wide(load.force_n), force_n) < 0.005, "{load:?} against {force_n:?} N");
    let torque_nm = cross(middle_m, force_n);
    assert!(off(wide(load.torque_nm), torque_nm) < 0.01, "{load:?} against {torque_nm:?} N·m");
}

/// A plate slides over a trough that is closed at its ends, so that what it drags along returns below it: u = U·(η − 3·η·(1 − η)), and at the plate µ·du/dy = 4·µ·U/H
/// (Couette flow with a pressure gradient and no net flow; White, Viscous Fluid Flow, 3-2). Of the plate's three pieces the middle one knows nothing of the ends.
#[test]
fn a_plate_that_drags_the_medium_along_is_held_back_by_its_friction() {
    let (spacing_m, speed, viscosity_m2_s) = ([0.4e-3, 0.3e-3, 0.5e-3], 0.01f32, 2e-5);
    let mut trough = model([64, 18, 3], spacing_m, viscosity_m2_s);
    (trough.walls[4], trough.walls[5]) = (Wall::Slip, Wall::Slip);
    let solver = Solver::new(trough, 1).unwrap();
    // The floor are two rows of cells, and the plate is the four rows from the fourteenth on.
    let solid: Vec<u8> = (0..64 * 18 * 3).map(|at| u8::from(at / 64 % 18 < 2)).collect();
    solver.set_mask(&solid).unwrap();
    let piece = |from_m: f32, to_m: f32| {
        let velocity = [speed, 0.0, 0.0];
        let [a_m, b_m] = [from_m, to_m].map(|x| [x, 4.8e-3, 0.75e-3]);
        Capsule { a_m, b_m, radius_m: 0.7e-3, velocity_a_m_s: velocity, velocity_b_m_s: velocity }
    };
    let mut inputs = FlowInputs { dt_s: 2e-4, ..Default::default() };
    inputs.tools[..3].copy_from_slice(&[piece(-1e-3, 10.1e-3), piece(15.5e-3, 26.6e-3), piece(10.1e-3, 15.5e-3)]);
    let report = steps(&solver, &inputs, 3_000);
    let load = report.tools[2];
    assert_eq!(load.faces, 44, "{load:?}");
    let area_m2 = 44.0 * 0.4e-3 * 0.5e-3;
    let by_hand_n = -4.0 * 1_000.0 * viscosity_m2_s * speed / (12.0 * 0.3e-3) * area_m2;
    // Half a cell from the plate the parabola is 2.6 % less steep than at it, and the projection leaves a slip of dt·∇p/ρ, 0.2 % of the speed, or 1 % of this.
    let share = load.force_n[0] / by_hand_n;
    assert!((share - 0.974).abs() < 0.03, "{} N against {by_hand_n} N", load.force_n[0]);
    assert!(load.force_n[2].abs() < 0.01 * by_hand_n.abs(), "across nothing drags: {load:?}");
    // The pieces at the ends are dragged the same way.
    assert!(report.tools[..2].iter().all(|load| load.force_n[0] < by_hand_n), "{report:?}");
}

/// Two pistons carry a tough medium past a ball that stands in a duct without friction: what the medium loses of its pressure on the way is the force on the
/// ball, for nothing else holds it. By Stokes a ball of this volume alone would feel 6·π·µ·R·U; among so near walls it is two to three times as much, as of
/// balls in rows (Hasimoto 1959).
#[test]
fn the_force_on_a_tool_in_a_duct_is_the_loss_of_pressure_along_each_axis() {
    for turn in 0..3 {
        let own = |of: [usize; 3]| -> [usize; 3] { std::array::from_fn(|axis| of[(axis + 3 - turn) % 3]) };
        let cells = own([24, 9, 9]);
        let mut duct = model(cells, [1e-3; 3], 1e-3);
        duct.walls = [Wall::Slip; 6];
        let solver = Solver::new(duct, 2).unwrap();
        let count: usize = cells.iter().product();
        let along = |at: usize| [at % cells[0], at / cells[0] % cells[1], at / (cells[0] * cells[1])][turn];
        let mut velocity_m_s = [0.0; 3];
        velocity_m_s[turn] = 0.01;
        let solid: Vec<u8> = (0..count).map(|at| u8::from(!(3..21).contains(&along(at)))).collect();
        solver.set_walls(&solid, &vec![velocity_m_s; count]).unwrap();
        let mut inputs = FlowInputs { dt_s: 5e-5, ..Default::default() };
        inputs.tools[0] = ball(own([12, 4, 4]).map(|index| (index as f32 + 0.5) * 1e-3), 2.2e-3, [0.0; 3]);
        let load = steps(&solver, &inputs, 1_200).tools[0];
        assert_eq!(load.cells, 33);
        let block = stored(&solver);
        let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
        let mean_pa = |slice: usize| {
            let here = (0..count).filter(|at| along(*at) == slice);
            here.map(|at| f64::from(view.pressure_pa()[at])).sum::<f64>() / 81.0
        };
        let lost_n = (mean_pa(3) - mean_pa(20)) * 81e-6;
        let found_n = f64::from(load.force_n[turn]);
        assert!((found_n / lost_n - 1.0).abs() < 0.02, "axis {turn}: {found_n} N, and {lost_n} N are lost");
        let radius_m = (33e-9 * 3.0 / (4.0 * std::f64::consts::PI)).cbrt();
        let stokes_n = 6.0 * std::f64::consts::PI * radius_m * 0.01;
        assert!((1.2..4.0).contains(&(found_n / stokes_n)), "axis {turn}: {found_n} N against {stokes_n} N");
        for across in [1, 2].map(|next| (turn + next) % 3) {
            assert!(f64::from(load.force_n[across]).abs() < 0.01 * found_n, "axis {turn}: {load:?}");
        }
    }
}

/// Slow flow is linear and the grid is the same along each axis, so that the force is against the motion wherever that goes.
#[test]
fn a_ball_that_moves_through_a_tough_medium_is_held_back_along_its_way() {
    let solver = Solver::new(model([17; 3], [1e-3; 3], 1e-3), 1).unwrap();
    let mut inputs = FlowInputs { dt_s: 5e-5, ..Default::default() };
    inputs.tools[0] = ball([8.5e-3; 3], 2.2e-3, [6e-3, -8e-3, 0.0]);
    let load = steps(&solver, &inputs, 600).tools[0];
    let (force_n, speed_m_s) = (wide(load.force_n), 0.01);
    let along = dot(force_n, [0.6, -0.8, 0.0]);
    assert!(off(force_n, [0.6 * along, -0.8 * along, 0.0]) < 0.02, "{load:?}");
    let stokes_n = 6.0 * std::f64::consts::PI * (33e-9 * 3.0 / (4.0 * std::f64::consts::PI)).cbrt() * speed_m_s;
    assert!((1.2..4.0).contains(&(-along / stokes_n)), "{along} N against {stokes_n} N");
    // It goes through the middle of the ball: about the origin it turns as one there.
    let torque_nm = cross([8.5e-3; 3], force_n);
    assert!(off(wide(load.torque_nm), torque_nm) < 0.02, "{load:?} against {torque_nm:?} N·m");
}

/// From rest, in one step: the momentum that the medium has afterwards is what the wire gave it and what the walls did by the pressure.
#[test]
fn a_wire_is_held_back_by_as_much_momentum_as_it_gives_the_medium() {
    let solver = Solver::new(model([16; 3], [1e-3; 3], 0.7e-6), 1).unwrap();
    let mut inputs = FlowInputs { dt_s: 1e-3, ..Default::default() };
    let (a_m, b_m, velocity) = ([6e-3, 5e-3, 4e-3], [10e-3, 9e-3, 11e-3], [0.1, -0.05, 0.02]);
    inputs.wires[0] = Capsule { a_m, b_m, radius_m: 0.2e-3, velocity_a_m_s: velocity, velocity_b_m_s: velocity };
    let load = steps(&solver, &inputs, 1).wires;
    let block = stored(&solver);
    let view = StateView::new(bytemuck::cast_slice(&block)).unwrap();
    let given_n: [f64; 3] = std::array::from_fn(|axis| {
        let has_n_s = 1e-6 * view.velocity_m_s(axis).iter().map(|u| f64::from(*u)).sum::<f64>();
        let slice = |at: usize| at / 16usize.pow(axis as u32) % 16;
        let pressed = |(at, pa): (usize, &f32)| match slice(at) {
            0 => f64::from(*pa) * 1e-6,
            15 => f64::from(*pa) * -1e-6,
            _ => 0.0,
        };
        has_n_s / 1e-3 - view.pressure_pa().iter().enumerate().map(pressed).sum::<f64>()
    });
    let force_n = wide(load.force_n);
    assert!(dot(force_n, wide(velocity)) < 0.0 && length(force_n) > 1e-5, "it opposes the motion: {load:?}");
    assert!(off(force_n, given_n.map(|n| -n)) < 0.01, "{force_n:?} N, and the medium got {given_n:?} N");
    let torque_nm = cross([8e-3, 7e-3, 7.5e-3], force_n);
    assert!(off(wide(load.torque_nm), torque_nm) < 0.03, "{load:?} against {torque_nm:?} N·m");
}

#[test]
fn any_number_of_bands_gives_the_same_forces_to_the_bit() {
    let reports = [1, 3, 8].map(|bands| {
        let solver = Solver::new(model([14, 12, 16], [1e-3, 0.9e-3, 1.1e-3], 1e-6), bands).unwrap();
        let mut inputs = FlowInputs { dt_s: 0.01, acceleration_m_s2: [0.3, 0.0, -0.2], ..Default::default() };
        inputs.tools[0] = ball([5e-3, 5e-3, 8e-3], 2e-3, [0.03, 0.0, -0.02]);
        inputs.tools[1] = ball([7e-3, 6e-3, 8e-3], 2e-3, [0.0, 0.02, 0.0]);
        inputs.wires[0] = Capsule { radius_m: 0.1e-3, b_m: [12e-3, 9e-3, 15e-3], ..ball([9e-3; 3], 0.0, [0.05; 3]) };
        let report = steps(&solver, &inputs, 12);
        (report.tools, report.wires)
    });
    let [one, two] = [reports[0].0[0], reports[0].0[1]];
    assert!(one.cells > 0 && one.cells < two.cells, "what both fill is the later one's: {one:?}, {two:?}");
    assert!(one.force_n != [0.0; 3] && two.force_n != [0.0; 3] && reports[0].1.force_n != [0.0; 3]);
    assert!(reports[0] == reports[1] && reports[0] == reports[2]);
}
