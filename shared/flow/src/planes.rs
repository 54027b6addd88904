//! Planes of a level that a phase makes as it goes, few at a time, so that they stay in the nearest cache and no field of them is written and read.
//!
//! Promise: a plane is a function of fields that the phase only reads; two bands that need the same one each make it.

use crate::field::Read;
use crate::grid::{Layout, MAX_AXIS};
use crate::kernels::wide;
use crate::multigrid::Level;
use crate::rows;
use crate::spans::Spans;

/// As many as two layers need, which a coarse one is made of: themselves and those beside them.
const PLANES: usize = 4;

/// The newest planes by padded layer. The ghosts beside and between their rows stay 0.
pub(crate) struct Planes([Vec<f32>; PLANES]);

impl Planes {
    pub fn new(layout: &Layout) -> Self {
        Self(std::array::from_fn(|_| vec![0.0; layout.plane]))
    }
    pub fn at_mut(&mut self, kk: usize) -> &mut [f32] {
        &mut self.0[kk % PLANES]
    }
    /// The planes below, at and above padded layer `kk`.
    #[inline(always)]
    pub fn three(&self, kk: usize) -> [&[f32]; 3] {
        [&self.0[(kk - 1) % PLANES], &self.0[kk % PLANES], &self.0[(kk + 1) % PLANES]]
    }
}

/// The damped residual v·r of a level.
pub(crate) struct Damped<'a> {
    pub layout: &'a Layout,
    pub spans: &'a Spans,
    pub r: &'a Read<'a>,
    pub inverse: &'a Read<'a>,
}

impl Damped<'_> {
    /// That of padded layer `kk`; 0 beyond the grid.
    pub fn plane(&self, kk: usize, out: &mut [f32]) {
        let [nx, ny, nz] = self.layout.n;
        if !(1..=nz).contains(&kk) {
            return out.fill(0.0);
        }
        let (r, v) = (self.r.layer(kk), self.inverse.layer(kk));
        wide(
            #[inline(always)]
            || {
                for j in 0..ny {
                    let (o, span) = (self.layout.row(j), self.spans.row(kk, j));
                    let range = o + span.start..o + span.end;
                    out[o..range.start].fill(0.0);
                    out[range.end..o + nx].fill(0.0);
                    rows::multiply(&mut out[range.clone()], &v[range.clone()], &r[range]);
                }
            },
        );
    }
}

/// The damped residual of a level and what the level below it has found.
pub(crate) struct Correction<'a> {
    pub damped: Damped<'a>,
    /// Of the level below.
    pub e: &'a Read<'a>,
    pub coarse: &'a Level,
}

impl Correction<'_> {
    /// That of padded layer `kk`; 0 beyond the grid. `wide_row` is for a row of the level below, spread.
    pub fn plane(&self, kk: usize, out: &mut [f32], wide_row: &mut [f32; MAX_AXIS + 1]) {
        let Damped { layout, spans, r, inverse } = &self.damped;
        let [nx, ny, nz] = layout.n;
        if !(1..=nz).contains(&kk) {
            return out.fill(0.0);
        }
        let (coarse, halved) = (&*self.coarse.layout, self.coarse.halved);
        let (r, v) = (r.layer(kk), inverse.layer(kk));
        let e = self.e.layer(parent(kk - 1, halved[2]) + 1);
        wide(
            #[inline(always)]
            || {
                for j in 0..ny {
                    let (o, span) = (layout.row(j), spans.row(kk, j));
                    let range = o + span.start..o + span.end;
                    out[o..range.start].fill(0.0);
                    out[range.end..o + nx].fill(0.0);
                    if span.is_empty() {
                        continue;
                    }
                    let oc = coarse.row(parent(j, halved[1]));
                    spread(&e[oc..oc + coarse.n[0]], wide_row, span.end, halved[0]);
                    let (r, v) = (&r[range.clone()], &v[range.clone()]);
                    rows::correct(&mut out[range], r, v, &wide_row[span]);
                }
            },
        );
    }
}

/// Coarse index that fine index `i` belongs to.
#[inline(always)]
fn parent(i: usize, halved: bool) -> usize {
    if halved { i / 2 } else { i }
}

/// Spreads a coarse row to the first `n` fine cells.
#[inline(always)]
fn spread(row: &[f32], out: &mut [f32; MAX_AXIS + 1], n: usize, halved: bool) {
    if !halved {
        out[..n].copy_from_slice(&row[..n]);
        return;
    }
    for (x, pair) in row.iter().zip(out[..n + n % 2].chunks_exact_mut(2)) {
        pair.fill(*x);
    }
}
