//! The pressure solve converges on any cavity: flat cells, thin sheets, separate pockets, walls full of holes.

use hyst_flow::{FlowInputs, FlowModel, Grid, Solver};

/// A number in 0..1 from a linear congruence (Knuth's multiplier).
fn random(seed: &mut u64) -> f32 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
    (*seed >> 40) as f32 / (1u64 << 24) as f32
}

/// Iterations of the worst of eight steps that begin with noise on every face, so that errors of all wavelengths are there to solve.
fn worst(cells: [usize; 3], spacing_m: [f32; 3], solid: impl Fn([usize; 3], &mut u64) -> bool) -> u32 {
    let model = FlowModel::new(Grid::new(cells, spacing_m, [0.0; 3]).unwrap());
    let solver = Solver::new(model, 1).unwrap();
    let [nx, ny, _] = cells;
    let count = solver.model().grid.cell_count();
    let mut seed = 99;
    let mask: Vec<u8> = (0..count).map(|c| u8::from(solid([c % nx, c / nx % ny, c / (nx * ny)], &mut seed))).collect();
    solver.set_mask(&mask).unwrap();
    for axis in 0..3 {
        let noise: Vec<f32> = (0..count).map(|_| 0.1 * (random(&mut seed) - 0.5)).collect();
        solver.set_velocity_m_s(axis, &noise).unwrap();
    }
    let inputs = FlowInputs { dt_s: 1.0 / 60.0, acceleration_m_s2: [0.3, 0.2, 0.1], ..Default::default() };
    let mut most = 0;
    for step in 0..8 {
        let report = solver.step_serial(&inputs).unwrap();
        assert!(report.residual_relative <= 1e-4, "{cells:?} of {spacing_m:?} m, step {step}: {report:?}");
        most = most.max(report.iterations);
    }
    most
}

const MM: f32 = 1e-3;

#[test]
fn flat_cells_need_no_more_iterations_than_cubes() {
    let open = |_: [usize; 3], _: &mut u64| false;
    let cubes = worst([32, 32, 18], [MM; 3], open);
    assert!(cubes <= 12, "cubes: {cubes}");
    for spacing_m in
        [[MM, MM, 4.0 * MM], [1.0625 * MM, 0.889 * MM, 1.75 * MM], [0.53 * MM, 0.25 * MM, 2.0 * MM], [MM, 8.0 * MM, MM]]
    {
        let flat = worst([32, 32, 18], spacing_m, open);
        assert!(flat <= cubes + 4, "cells of {spacing_m:?} m: {flat}, cubes {cubes}");
    }
}

#[test]
fn sheets_of_a_few_cells_are_solved() {
    let level = worst([48, 18, 48], [MM; 3], |[_, j, _], _| !(7..10).contains(&j));
    assert!(level <= 14, "level: {level}");
    let slanted = worst([48, 24, 48], [MM; 3], |[i, j, _], _| !(0.0..2.5).contains(&(j as f32 - 4.0 - 0.31 * i as f32)));
    assert!(slanted <= 14, "slanted: {slanted}");
}

#[test]
fn a_wall_of_one_cell_parts_two_pockets_with_and_without_a_hole() {
    let closed = worst([32, 32, 18], [MM; 3], |[i, _, _], _| i == 15);
    assert!(closed <= 12, "closed: {closed}");
    let holed = worst([32, 32, 18], [MM; 3], |[i, j, k], _| i == 15 && (j, k) != (7, 7));
    assert!(holed <= 12, "with a hole: {holed}");
}

#[test]
fn random_walls_are_solved_up_to_half_of_all_cells() {
    for (share, bound) in [(0.1, 12), (0.3, 16), (0.5, 36)] {
        let most = worst([32, 18, 32], [1.0625 * MM, 0.889 * MM, 1.75 * MM], |_, seed| random(seed) < share);
        assert!(most <= bound, "{share} of all cells solid: {most}");
    }
}
