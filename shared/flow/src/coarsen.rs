//! The pressure operator of the coarser levels: each coarse face carries the open area of its fine faces.

use crate::error::FlowError;
use crate::field::Read;
use crate::grid::{Layout, MAX_AXIS};
use crate::kernels::wide;
use crate::multigrid::{DAMPING, children, gather};
use crate::rows;
use crate::solver::Solver;

/// Weight of the summed fine coefficients along an axis that shrinks. Twice the distance and constant interpolation give ½. On the
/// scope's poses in the default cavity, boxes, sheets, pockets and random masks (November 2026, damping 0.9) 0.58 and 0.75 need up to
/// one iteration more in most cases, 0.85 two. A setting for such cavities, no optimum for every mask.
const SHRINK: f32 = 0.66;

impl Solver {
    /// Phase Coarsen: face coefficients and diagonal of level `l` from level `l − 1`.
    pub(crate) fn coarsen_band(&self, l: usize, band: usize) -> Result<(), FlowError> {
        let (fine, coarse) = (&self.hierarchy.levels[l - 1], &self.hierarchy.levels[l]);
        let Some(faces) = &coarse.faces else {
            return Ok(());
        };
        let fluid = if l == 1 { Some(self.fluid.read()?) } else { None };
        let (fl, cl) = (&*fine.layout, &*coarse.layout);
        let mut sum = [0.0f32; MAX_AXIS];
        for (axis, face) in faces.iter().enumerate() {
            let below = match &fine.faces {
                Some(faces) => Some(faces[axis].read()?),
                None => None,
            };
            let mut out = face.write(band)?;
            let scale = if coarse.halved[axis] { SHRINK } else { 1.0 };
            for kk in cl.own(band) {
                let plane = out.layer(kk);
                wide(
                    #[inline(always)]
                    || {
                        for j in 0..cl.n[1] {
                            let sum = &mut sum[..fl.n[0]];
                            sum.fill(0.0);
                            let ranges = fine_rows(axis, j, kk - 1, fl, coarse.halved);
                            for k in ranges[1].clone() {
                                for o in ranges[0].clone().map(|j| fl.row(j)) {
                                    match (&below, &fluid) {
                                        (Some(below), _) => rows::add_scaled(sum, &below.layer(k + 1)[o..], scale),
                                        (None, Some(fluid)) => {
                                            add_open(sum, fluid, axis, o, k + 1, fl.stride, scale * self.weights[axis])
                                        }
                                        _ => {}
                                    }
                                }
                            }
                            let oc = cl.row(j);
                            let row = &mut plane[oc..oc + cl.n[0]];
                            match (axis, coarse.halved[0]) {
                                (0, true) => every_second(sum, row),
                                (_, halved) => gather(sum, row, halved),
                            }
                        }
                    },
                );
            }
        }
        Ok(())
    }

    /// Second half of Coarsen: diagonal and damped inverse of level `l` from its own faces.
    pub(crate) fn coarsen_diagonal_band(&self, l: usize, band: usize) -> Result<(), FlowError> {
        let level = &self.hierarchy.levels[l];
        let Some([fx, fy, fz]) = &level.faces else {
            return Ok(());
        };
        let (fx, fy, fz) = (fx.read()?, fy.read()?, fz.read()?);
        let layout = &*level.layout;
        level.clear(band)?;
        let (mut diagonal, mut inverse) = (level.diagonal.write(band)?, level.inverse.write(band)?);
        for kk in layout.own(band) {
            let (d, v) = (diagonal.layer(kk), inverse.layer(kk));
            let (x, y, z, above) = (fx.layer(kk), fy.layer(kk), fz.layer(kk), fz.layer(kk + 1));
            wide(
                #[inline(always)]
                || {
                    for j in 0..layout.n[1] {
                        let (o, n) = (layout.row(j), layout.n[0]);
                        let faces = [&x[o..], &x[o + 1..], &y[o..], &y[o + layout.stride..], &z[o..], &above[o..]];
                        rows::coarse_diagonal(&mut d[o..o + n], &mut v[o..o + n], faces, DAMPING);
                    }
                },
            );
        }
        Ok(())
    }
}

/// Fine rows and layers whose faces along `axis` lie on the low side of coarse row (j, k).
fn fine_rows(axis: usize, j: usize, k: usize, fine: &Layout, halved: [bool; 3]) -> [std::ops::Range<usize>; 2] {
    let mut ranges = [children(j, fine.n[1], halved[1]), children(k, fine.n[2], halved[2])];
    if axis > 0 {
        ranges[axis - 1].end = ranges[axis - 1].start + 1;
    }
    ranges
}

/// sum += weight where the face on the low side of a cell along `axis` lies between two fluid cells.
#[inline(always)]
fn add_open(sum: &mut [f32], fluid: &Read<'_>, axis: usize, o: usize, kk: usize, stride: usize, weight: f32) {
    let here = fluid.layer(kk);
    let back = match axis {
        0 => &here[o - 1..],
        1 => &here[o - stride..],
        _ => &fluid.layer(kk - 1)[o..],
    };
    rows::add_product(sum, &here[o..], back, weight);
}

/// The low faces of pairs.
#[inline(always)]
fn every_second(row: &[f32], out: &mut [f32]) {
    for (o, x) in out.iter_mut().zip(row.iter().step_by(2)) {
        *o = *x;
    }
}
