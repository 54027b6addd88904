//! The preconditioner of the pressure solve: one V-cycle over aggregated cells (two to one along each axis that is coupled strongly),
//! symmetric, so that conjugate gradients may use it (idea: McAdams et al. 2010; the scaled coarse operator: Braess 1995; coarsening
//! along strong couplings only: Trottenberg et al. 2001, section 5.1).
//!
//! Promise: works for any mask, because a coarse face carries the open area of its fine faces; each cell of a level is computed
//! from the same numbers in the same order whatever the bands.

use std::sync::Arc;

use parking_lot::{Mutex, RwLock, RwLockReadGuard};

use crate::coarsest::Coarsest;
use crate::error::FlowError;
use crate::field::{Field, Read};
use crate::grid::{Layout, MAX_AXIS};
use crate::kernels::{Dot, Star, wide};
use crate::planes::{Correction, Damped, Planes};
use crate::rows;
use crate::solver::Solver;
use crate::spans::Spans;

#[cfg(test)]
mod tests;

/// Damping of the Jacobi smoother. On the scope's poses in the default cavity, boxes, sheets, pockets and random masks 0.8 needs a few
/// tenths of an iteration more.
pub(crate) const DAMPING: f32 = 0.9;
/// Axes whose cells are at most so many times as long as the shortest are halved together. On the same masks 1.45 needs 11 iterations
/// where 1.15 needs 8 (default cavity, cells of 1.06 × 0.89 × 1.75 mm), and 2.1 needs 15.
const ALIKE: f32 = 1.15;
/// Cells of the coarsest level at most: solved by Cholesky's factors.
const COARSEST_CELLS: usize = 64;
/// Levels with fewer cells than this are computed by one band: a barrier would cost more than it brings. On two cores two threads do 1.82 to 1.87 times the work of
/// one at 40×40×40 with 512, 1.47 to 1.82 with 1 024, 0.94 to 1.65 with 8 192 (`fluid bench flow`, 2-core VM, 2026-11-25).
const PARALLEL_CELLS: usize = 512;

/// Two rows of the longest axis with the ghosts between them.
const MOST_FINE: usize = 2 * MAX_AXIS + 2;

/// One level: residual, correction, diagonal, damped inverse, and (not on level 0) face coefficients.
pub(crate) struct Level {
    pub layout: Arc<Layout>,
    /// Axes along which two cells of the level above make one of this.
    pub halved: [bool; 3],
    pub r: Field,
    pub z: Field,
    pub diagonal: Field,
    pub inverse: Field,
    pub faces: Option<[Field; 3]>,
    /// Of each band the planes that a phase makes as it goes.
    pub planes: Vec<Mutex<Planes>>,
    /// What has to be computed.
    pub spans: RwLock<Spans>,
}

impl Level {
    fn new(layout: Arc<Layout>, halved: [bool; 3]) -> Self {
        let field = || Field::new(&layout);
        let coarse = halved.contains(&true);
        let faces = coarse.then(|| [field(), field(), field()]);
        let (r, z, diagonal, inverse) = (field(), field(), field(), field());
        let planes = (0..layout.bands).map(|_| Mutex::new(Planes::new(&layout))).collect();
        let spans = RwLock::new(Spans::new(&layout));
        Self { layout, halved, r, z, diagonal, inverse, faces, planes, spans }
    }

    /// Makes what the cycle computes 0, where it computes nothing from now on.
    pub fn clear(&self, band: usize) -> Result<(), FlowError> {
        for field in [&self.r, &self.z] {
            let mut field = field.write(band)?;
            for kk in self.layout.own(band) {
                field.layer(kk).fill(0.0);
            }
        }
        Ok(())
    }

    pub fn spans(&self) -> Result<RwLockReadGuard<'_, Spans>, FlowError> {
        self.spans.try_read().ok_or(FlowError::PhaseConflict)
    }
}

/// All levels; `serial_from` is the first that one band computes alone.
pub(crate) struct Hierarchy {
    pub levels: Vec<Level>,
    pub serial_from: usize,
    pub coarsest: Coarsest,
}

impl Hierarchy {
    pub fn new(fine: &Arc<Layout>, spacing_m: [f32; 3]) -> Self {
        let mut levels = vec![Level::new(fine.clone(), [false; 3])];
        let mut serial_from = 0;
        let (mut n, mut h) = (fine.n, spacing_m);
        while levels.len() == 1 || n[0] * n[1] * n[2] > COARSEST_CELLS {
            let halved = halved(n, h);
            for axis in (0..3).filter(|axis| halved[*axis]) {
                (n[axis], h[axis]) = (n[axis].div_ceil(2), 2.0 * h[axis]);
            }
            let parallel = serial_from == 0 && n[0] * n[1] * n[2] >= PARALLEL_CELLS && n[2] >= 2 * fine.bands;
            if !parallel && serial_from == 0 {
                serial_from = levels.len();
            }
            levels.push(Level::new(Arc::new(Layout::new(n, if parallel { fine.bands } else { 1 })), halved));
        }
        let cells = n[0] * n[1] * n[2];
        Self { levels, serial_from, coarsest: Coarsest::new(cells) }
    }
}

/// The operator of a level, locked to read: diagonal and the weighted sum of neighbours.
struct Operator<'a> {
    layout: &'a Layout,
    diagonal: Read<'a>,
    faces: Option<[Read<'a>; 3]>,
    weights: [f32; 3],
}

impl<'a> Operator<'a> {
    fn new(level: &'a Level, weights: [f32; 3]) -> Result<Self, FlowError> {
        let faces = match &level.faces {
            Some([x, y, z]) => Some([x.read()?, y.read()?, z.read()?]),
            None => None,
        };
        Ok(Self { layout: &level.layout, diagonal: level.diagonal.read()?, faces, weights })
    }
    fn diagonal(&self, kk: usize, o: usize, n: usize) -> &[f32] {
        &self.diagonal.layer(kk)[o..o + n]
    }
    /// The low and high coefficients along x, y, z of the row at `o`; of a coarse level alone.
    #[inline(always)]
    fn faces_at(&self, kk: usize, o: usize) -> Option<[&[f32]; 6]> {
        let [fx, fy, fz] = self.faces.as_ref()?;
        let (xl, yl, zl, zh) = (fx.layer(kk), fy.layer(kk), fz.layer(kk), fz.layer(kk + 1));
        Some([&xl[o..], &xl[o + 1..], &yl[o..], &yl[o + self.layout.stride..], &zl[o..], &zh[o..]])
    }
    /// sum += r − A·x of the row at `o`; A·x is 0 in solid cells. `t` is as long, and holds A·x on a coarse level, whose loop has as many rows as it can.
    #[inline(always)]
    fn add_residual(&self, x: [&[f32]; 3], kk: usize, o: usize, r: &[f32], sum: &mut [f32], t: &mut [f32]) {
        let star = Star::new(x, o, self.layout.stride, sum.len());
        let diagonal = self.diagonal(kk, o, sum.len());
        if let Some(faces) = self.faces_at(kk, o) {
            rows::coarse_operator(t, diagonal, &star, faces);
            rows::add_residual(sum, r, t);
        } else {
            rows::fine_residual(sum, r, diagonal, &star, self.weights);
        }
    }
    /// out = y + v·(r − A·y) of the row at `o`; `t` as above.
    #[inline(always)]
    fn smooth(&self, y: [&[f32]; 3], kk: usize, o: usize, [v, r]: [&[f32]; 2], out: &mut [f32], t: &mut [f32]) {
        let star = Star::new(y, o, self.layout.stride, out.len());
        let diagonal = self.diagonal(kk, o, out.len());
        if let Some(faces) = self.faces_at(kk, o) {
            rows::coarse_operator(t, diagonal, &star, faces);
            rows::smooth(out, star.c, v, r, t);
        } else {
            rows::fine_smooth(out, [v, r], diagonal, &star, self.weights);
        }
    }
}

impl Solver {
    /// Phase Operator: diagonal and damped inverse of level 0 from the mask. What solids have taken holds 0 from here on: no iteration writes there.
    pub(crate) fn operator_band(&self, band: usize) -> Result<(), FlowError> {
        let level = &self.hierarchy.levels[0];
        let layout = &*level.layout;
        let fluid = self.fluid.read()?;
        let (mut diagonal, mut inverse) = (level.diagonal.write(band)?, level.inverse.write(band)?);
        let n = layout.n[0];
        level.clear(band)?;
        for kk in layout.own(band) {
            let (d, v) = (diagonal.layer(kk), inverse.layer(kk));
            wide(
                #[inline(always)]
                || {
                    for j in 0..layout.n[1] {
                        let o = layout.row(j);
                        let star = Star::new(fluid.three(kk), o, layout.stride, n);
                        rows::fine_diagonal(&mut d[o..o + n], &mut v[o..o + n], &star, self.weights, DAMPING);
                    }
                },
            );
        }
        Ok(())
    }

    /// Residual of level `l` after its first smoothing (z = v·r), summed into level `l + 1`.
    pub(crate) fn restrict_band(&self, l: usize, band: usize) -> Result<(), FlowError> {
        let (fine, coarse) = (&self.hierarchy.levels[l], &self.hierarchy.levels[l + 1]);
        let op = Operator::new(fine, self.weights)?;
        let (r, inverse) = (fine.r.read()?, fine.inverse.read()?);
        let (fine_spans, spans) = (fine.spans()?, coarse.spans()?);
        let mut planes = fine.planes[band].try_lock().ok_or(FlowError::PhaseConflict)?;
        let mut r_out = coarse.r.write(band)?;
        let (fl, cl) = (&*fine.layout, &*coarse.layout);
        let damped = Damped { layout: fl, spans: &fine_spans, r: &r, inverse: &inverse };
        let own = cl.own(band);
        let mut next = children(own.start - 1, fl.n[2], coarse.halved[2]).start;
        // Of the whole phase: to make them anew costs as much as a coarse layer.
        let (mut sum, mut t) = ([0.0f32; MOST_FINE], [0.0f32; MOST_FINE]);
        for kk in own {
            let rc = r_out.layer(kk);
            let low = children(kk - 1, fl.n[2], coarse.halved[2]);
            while next <= low.end + 1 {
                damped.plane(next, planes.at_mut(next));
                next += 1;
            }
            let z = &*planes;
            wide(
                #[inline(always)]
                || {
                    for jc in 0..cl.n[1] {
                        let span = spans.row(kk, jc);
                        if span.is_empty() {
                            continue;
                        }
                        let fine_rows = children(jc, fl.n[1], coarse.halved[1]);
                        let from = children(span.start, fl.n[0], coarse.halved[0]).start;
                        let n = children(span.end - 1, fl.n[0], coarse.halved[0]).end - from;
                        // Both rows and what lies between them.
                        let (o, m) = (fl.row(fine_rows.start) + from, (fine_rows.len() - 1) * fl.stride + n);
                        let (sum, t) = (&mut sum[..m], &mut t[..m]);
                        sum.fill(0.0);
                        for k in low.clone() {
                            op.add_residual(z.three(k + 1), k + 1, o, &r.layer(k + 1)[o..o + m], sum, t);
                        }
                        if m > n {
                            let (first, second) = sum.split_at_mut(fl.stride);
                            rows::add_scaled(&mut first[..n], second, 1.0);
                        }
                        let oc = cl.row(jc) + span.start;
                        gather(&sum[..n], &mut rc[oc..oc + span.len()], coarse.halved[0]);
                    }
                },
            );
        }
        Ok(())
    }

    /// y = v·r + the correction of the level below, in fluid cells, and z = y + damped residual of y; on level 0 also the partial sums of r·z.
    pub(crate) fn smooth_band(&self, l: usize, band: usize) -> Result<(), FlowError> {
        let (level, coarse) = (&self.hierarchy.levels[l], &self.hierarchy.levels[l + 1]);
        let op = Operator::new(level, self.weights)?;
        let (r, inverse, e) = (level.r.read()?, level.inverse.read()?, coarse.z.read()?);
        let mut z = level.z.write(band)?;
        let mut planes = level.planes[band].try_lock().ok_or(FlowError::PhaseConflict)?;
        let (layout, spans) = (&*level.layout, level.spans()?);
        let parts = if l == 0 { &spans.lanes } else { &spans.open };
        let mut sums = self.sums(band)?;
        let damped = Damped { layout, spans: &spans, r: &r, inverse: &inverse };
        let correction = Correction { damped, e: &e, coarse };
        let own = layout.own(band);
        let mut next = own.start - 1;
        let (mut t, mut wide_row) = ([0.0f32; MAX_AXIS], [0.0f32; MAX_AXIS + 1]);
        for (index, kk) in own.enumerate() {
            while next <= kk + 1 {
                correction.plane(next, planes.at_mut(next), &mut wide_row);
                next += 1;
            }
            let y = planes.three(kk);
            let (out, v) = (z.layer(kk), inverse.layer(kk));
            let rz = wide(
                #[inline(always)]
                || {
                    let mut rz = Dot::default();
                    for (o, n) in parts.of(kk) {
                        let (row, r) = (&mut out[o..o + n], &r.layer(kk)[o..o + n]);
                        op.smooth(y, kk, o, [&v[o..o + n], r], row, &mut t[..n]);
                        if l == 0 {
                            rz.add(layout.run_of(o), r, row);
                        }
                    }
                    rz.total()
                },
            );
            if l == 0 {
                sums[index].a = rz;
            }
        }
        Ok(())
    }

    /// Phase Coarse: the V-cycle below the parallel levels, by one band.
    pub(crate) fn coarse_cycle(&self) -> Result<(), FlowError> {
        let last = self.hierarchy.levels.len() - 1;
        for l in self.hierarchy.serial_from - 1..last {
            self.restrict_band(l, 0)?;
        }
        self.hierarchy.coarsest.solve(&self.hierarchy.levels[last])?;
        for l in (self.hierarchy.serial_from..last).rev() {
            self.smooth_band(l, 0)?;
        }
        Ok(())
    }
}

/// Axes that the next coarser level halves: those along which neighbours are coupled most, until all are coupled alike. A smoother
/// evens out errors along strong couplings only, so along a weak one a coarser level would have nothing smooth to take over.
fn halved(n: [usize; 3], h: [f32; 3]) -> [bool; 3] {
    let least = (0..3).filter(|axis| n[*axis] > 1).map(|axis| h[axis]).fold(f32::INFINITY, f32::min);
    std::array::from_fn(|axis| n[axis] > 1 && h[axis] <= ALIKE * least)
}

/// Fine indices that belong to coarse index `c` on an axis of `n` fine cells.
#[inline(always)]
pub(crate) fn children(c: usize, n: usize, halved: bool) -> std::ops::Range<usize> {
    if halved { 2 * c..(2 * c + 2).min(n) } else { c..c + 1 }
}

/// Sums what belongs to each coarse cell of a row.
#[inline(always)]
pub(crate) fn gather(row: &[f32], out: &mut [f32], halved: bool) {
    if !halved {
        out.copy_from_slice(row);
        return;
    }
    let (pairs, single) = row.as_chunks::<2>();
    for (o, [a, b]) in out.iter_mut().zip(pairs) {
        *o = a + b;
    }
    if let ([a], Some(o)) = (single, out.get_mut(pairs.len())) {
        *o = *a;
    }
}
