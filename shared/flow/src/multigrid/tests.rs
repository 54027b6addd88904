//! A level that is corrected and smoothed in one go has the bits of one that is corrected, and then smoothed.

use super::*;
use crate::grid::Grid;
use crate::inputs::{Capsule, FlowInputs};
use crate::model::FlowModel;

/// z of a level by its definition, as padded planes.
fn one_after_the_other(solver: &Solver, l: usize) -> Vec<Vec<f32>> {
    let (level, coarse) = (&solver.hierarchy.levels[l], &solver.hierarchy.levels[l + 1]);
    let (layout, s, w) = (&*level.layout, level.layout.stride, solver.weights);
    let (r, v) = (level.r.read().unwrap(), level.inverse.read().unwrap());
    let (d, e) = (level.diagonal.read().unwrap(), coarse.z.read().unwrap());
    let faces = level.faces.as_ref().map(|faces| faces.each_ref().map(|face| face.read().unwrap()));
    let [nx, ny, nz] = layout.n;
    let up = |axis: usize, x: usize| if coarse.halved[axis] { x / 2 } else { x };
    let cells = move || (0..nx * ny * nz).map(move |cell| (cell % nx, cell / nx % ny, cell / (nx * ny) + 1));
    let mut y = vec![vec![0.0f32; layout.plane]; nz + 2];
    for (i, j, kk) in cells() {
        let at = layout.row(j) + i;
        if d.layer(kk)[at] > 0.0 {
            let below = e.layer(up(2, kk - 1) + 1)[coarse.layout.row(up(1, j)) + up(0, i)];
            y[kk][at] = v.layer(kk)[at] * r.layer(kk)[at] + below;
        }
    }
    let mut z = vec![vec![0.0f32; layout.plane]; nz + 2];
    for (i, j, kk) in cells() {
        let at = layout.row(j) + i;
        let (own, diagonal) = (y[kk][at], d.layer(kk)[at]);
        let [x0, x1, y0, y1] = [at - 1, at + 1, at - s, at + s].map(|at| y[kk][at]);
        let (z0, z1) = (y[kk - 1][at], y[kk + 1][at]);
        let image = match &faces {
            None if diagonal > 0.0 => diagonal * own - (w[0] * (x0 + x1) + w[1] * (y0 + y1) + w[2] * (z0 + z1)),
            None => 0.0,
            Some([fx, fy, fz]) => {
                let x = fx.layer(kk)[at] * x0 + fx.layer(kk)[at + 1] * x1;
                let y = fy.layer(kk)[at] * y0 + fy.layer(kk)[at + s] * y1;
                let z = fz.layer(kk)[at] * z0 + fz.layer(kk + 1)[at] * z1;
                diagonal * own - (x + y + z)
            }
        };
        z[kk][at] = own + v.layer(kk)[at] * (r.layer(kk)[at] - image);
    }
    z
}

#[test]
fn a_level_corrected_and_smoothed_at_once_has_the_bits_of_one_after_the_other() {
    for bands in [1, 2, 3] {
        let grid = Grid::new([21, 18, 13], [1e-3, 1e-3, 1.6e-3], [0.0; 3]).unwrap();
        let solver = Solver::new(FlowModel::new(grid), bands).unwrap();
        let solid: Vec<u8> = (0..grid.cell_count()).map(|cell| u8::from(cell % 21 < 4 || cell % 17 == 0)).collect();
        solver.set_mask(&solid).unwrap();
        let mut inputs = FlowInputs { dt_s: 0.02, ..Default::default() };
        inputs.tools[0] = Capsule {
            a_m: [0.012, 0.009, 0.0],
            b_m: [0.012, 0.009, 0.009],
            radius_m: 0.003,
            velocity_a_m_s: [0.05, 0.0, 0.0],
            velocity_b_m_s: [0.05, 0.02, 0.0],
        };
        solver.step_serial(&inputs).unwrap();
        for (l, level) in solver.hierarchy.levels.iter().enumerate().take(solver.hierarchy.levels.len() - 1) {
            let expected = one_after_the_other(&solver, l);
            for band in 0..level.layout.bands {
                solver.smooth_band(l, band).unwrap();
            }
            let z = level.z.read().unwrap();
            for (kk, plane) in expected.iter().enumerate() {
                let is_same = plane.iter().zip(z.layer(kk)).all(|(a, b)| a.to_bits() == b.to_bits());
                assert!(is_same, "{bands} bands, level {l}, layer {kk}");
            }
            assert!(expected.iter().flatten().any(|z| *z != 0.0), "level {l} has something to do");
        }
    }
}

#[test]
fn cells_are_gathered_in_pairs_and_a_single_last_one_stays_as_it_is() {
    let mut out = [9.0f32; 3];
    gather(&[1.0, 2.0, 3.0, 4.0, 5.0], &mut out, true);
    assert_eq!(out, [3.0, 7.0, 5.0]);
    gather(&[1.0, 2.0, 3.0, 4.5], &mut out[..2], true);
    assert_eq!(out, [3.0, 7.5, 5.0]);
    gather(&[-0.0, -0.0, -0.0], &mut out[..2], true);
    assert!(out[..2].iter().all(|x| x.to_bits() == (-0.0f32).to_bits()), "a zero keeps its sign");
    gather(&[1.0, 2.0, 3.0], &mut out, false);
    assert_eq!(out, [1.0, 2.0, 3.0]);
}
