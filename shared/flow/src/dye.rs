//! Dye: dissolved blood as a volume fraction per cell, moved by the donor-cell scheme in flux form.
//!
//! Promise: what leaves a cell enters its neighbour, so the amount changes only by sources and sinks; never negative.

use crate::error::FlowError;
use crate::kernels::{Star, larger, smaller, wide};
use crate::solver::Solver;

/// Thinner is clear: far below what an eye sees, far above denormal numbers.
const CLEAR: f32 = 1e-20;

impl Solver {
    /// Phase Dye: one sweep; partial sums of the amount washed out (a), brought in (b) and lost (c), in cell volumes.
    pub(crate) fn dye_band(&self, band: usize) -> Result<(), FlowError> {
        let plan = self.plan()?;
        let layout = &*self.layout;
        let spans = self.hierarchy.levels[0].spans()?;
        let [u, v, w] = self.read_velocity(plan.roles.now)?;
        let (dye, fluid) = (self.dye[plan.dye].read()?, self.fluid.read()?);
        let mut to = self.dye[1 - plan.dye].write(band)?;
        let per_cell = self.model.grid.spacing_m().map(|h| plan.dye_dt_s / h);
        let s = layout.stride;
        let mut sums = self.sums(band)?;
        for (sum, kk) in sums.iter_mut().zip(layout.own(band)) {
            let out = to.layer(kk);
            wide(
                #[inline(always)]
                || {
                    if dye.three(kk).into_iter().all(is_zero) {
                        return out.fill(0.0);
                    }
                    // What a solid took keeps what nobody has taken over from it.
                    for (o, n) in spans.gaps.of(kk) {
                        for (out, here) in out[o..o + n].iter_mut().zip(&dye.layer(kk)[o..o + n]) {
                            *out = if *here > CLEAR { *here } else { 0.0 };
                        }
                    }
                    for (o, n) in spans.open.of(kk) {
                        let (c, m) = (Star::new(dye.three(kk), o, s, n), Star::new(fluid.three(kk), o, s, n));
                        let (ul, vl) = (u.layer(kk), v.layer(kk));
                        let (wl, wh) = (w.layer(kk), w.layer(kk + 1));
                        let faces = [&ul[o..], &ul[o + 1..], &vl[o..], &vl[o + s..], &wl[o..], &wh[o..]];
                        carry(&mut out[o..o + n], &c, &m, faces, per_cell);
                    }
                },
            );
            (sum.a, sum.b, sum.c) = (0.0, 0.0, 0.0);
            for source in plan.sources_of(kk) {
                let change = plan.dye_dt_s * source.rate_per_s;
                let cell = &mut out[source.at];
                if change > 0.0 {
                    *cell += change * source.dye;
                    sum.b += f64::from(change * source.dye);
                } else {
                    let gone = smaller(-change, 1.0) * *cell;
                    *cell -= gone;
                    *(if source.is_lost { &mut sum.c } else { &mut sum.a }) += f64::from(gone);
                }
            }
        }
        Ok(())
    }
}

/// out = c and what comes through the faces of each cell, whose low and high velocities along x, y, z are `faces`; c and the cells m as stars. The written row
/// is an argument, so that the compiler knows that it overlaps none of the twenty that are read, and keeps the loop in vectors (as in [`crate::rows`]).
#[inline(always)]
fn carry(out: &mut [f32], c: &Star<'_>, m: &Star<'_>, faces: [&[f32]; 6], per_cell: [f32; 3]) {
    let n = out.len();
    let (c, m, [cx, cy, cz]) = (c.cut(n), m.cut(n), per_cell);
    let [u0, u1, v0, v1, w0, w1] = faces;
    let (u0, u1, v0, v1, w0, w1) = (&u0[..n], &u1[..n], &v0[..n], &v1[..n], &w0[..n], &w1[..n]);
    for i in 0..n {
        let here = c.c[i];
        let x = m.xm[i] * flux(u0[i], c.xm[i], here) - m.xp[i] * flux(u1[i], here, c.xp[i]);
        let y = m.ym[i] * flux(v0[i], c.ym[i], here) - m.yp[i] * flux(v1[i], here, c.yp[i]);
        let z = m.zm[i] * flux(w0[i], c.zm[i], here) - m.zp[i] * flux(w1[i], here, c.zp[i]);
        let value = here + m.c[i] * (cx * x + cy * y + cz * z);
        out[i] = if value > CLEAR { value } else { 0.0 };
    }
}

/// Whether a plane holds nothing but +0. Bits, unlike numbers, are combined in any order.
#[inline(always)]
fn is_zero(plane: &[f32]) -> bool {
    plane.iter().fold(0, |all, x| all | x.to_bits()) == 0
}

/// What a face carries: the value of the cell that the flow comes from.
#[inline(always)]
fn flux(velocity: f32, low: f32, high: f32) -> f32 {
    larger(velocity, 0.0) * low + smaller(velocity, 0.0) * high
}
