//! The inner loops, row by row: unit stride in x, no branches, no gathers; dispatched at run time to AVX2 or AVX-512 where it exists.
//!
//! Promise: the same bits on every instruction set, because sums keep explicit lanes and no product is fused into a sum.

/// Lanes of a sum: fixed, so that the order of additions does not depend on the machine.
pub(crate) const LANES: usize = 16;

/// Runs `work` compiled for the widest instruction set at hand. Callers pass an `#[inline(always)]` closure.
#[inline(always)]
pub(crate) fn wide<R>(work: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(work)
}

/// Σ aᵢ·bᵢ of a row.
#[inline(always)]
pub(crate) fn dot(a: &[f32], b: &[f32]) -> f64 {
    total(&add_products([0.0; LANES], a, b))
}

/// The lanes with the products of a row, those behind its last whole block first.
#[inline(always)]
fn add_products(mut lanes: [f32; LANES], a: &[f32], b: &[f32]) -> [f32; LANES] {
    let (a16, b16) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    for (x, y) in a16.remainder().iter().zip(b16.remainder()) {
        lanes[0] += x * y;
    }
    for (x, y) in a16.zip(b16) {
        for l in 0..LANES {
            lanes[l] += x[l] * y[l];
        }
    }
    lanes
}

#[inline(always)]
fn total(lanes: &[f32; LANES]) -> f64 {
    lanes.iter().map(|&l| f64::from(l)).sum()
}

/// Σ aᵢ·bᵢ of the runs of a plane, of each as [`dot`] sums it. Whole blocks of zeros may be left out: no lane is ever −0, so that adding ±0 changes none. What
/// is behind a run's last whole block comes before its blocks.
#[derive(Default)]
pub(crate) struct Dot {
    lanes: [f32; LANES],
    run: usize,
    sum: f64,
}

impl Dot {
    /// Adds a part of a run; the runs come in their order.
    #[inline(always)]
    pub fn add(&mut self, run: usize, a: &[f32], b: &[f32]) {
        if run != self.run {
            self.sum += total(&self.lanes);
            (self.lanes, self.run) = ([0.0; LANES], run);
        }
        self.lanes = add_products(self.lanes, a, b);
    }
    /// The sum of all runs.
    #[inline(always)]
    pub fn total(&self) -> f64 {
        self.sum + total(&self.lanes)
    }
}

/// Σ aᵢ of a row.
#[inline(always)]
pub(crate) fn sum(a: &[f32]) -> f64 {
    let mut lanes = [0.0f32; LANES];
    let a16 = a.chunks_exact(LANES);
    for x in a16.remainder() {
        lanes[0] += x;
    }
    for x in a16 {
        for l in 0..LANES {
            lanes[l] += x[l];
        }
    }
    lanes.iter().map(|&l| f64::from(l)).sum()
}

/// max mᵢ·|aᵢ| of a row; not-a-number is ignored.
#[inline(always)]
pub(crate) fn max_abs_where(a: &[f32], m: &[f32]) -> f32 {
    let mut lanes = [0.0f32; LANES];
    let (a16, m16) = (a.chunks_exact(LANES), m[..a.len()].chunks_exact(LANES));
    for (x, m) in a16.remainder().iter().zip(m16.remainder()) {
        lanes[0] = larger(lanes[0], m * x.abs());
    }
    for (x, m) in a16.zip(m16) {
        for l in 0..LANES {
            lanes[l] = larger(lanes[l], m[l] * x[l].abs());
        }
    }
    lanes.iter().fold(0.0, |most, &l| larger(most, l))
}

/// max |aᵢ| of a row; not-a-number is ignored.
#[inline(always)]
pub(crate) fn max_abs(a: &[f32]) -> f32 {
    let mut lanes = [0.0f32; LANES];
    let a16 = a.chunks_exact(LANES);
    for &x in a16.remainder() {
        lanes[0] = larger(lanes[0], x.abs());
    }
    for x in a16 {
        for l in 0..LANES {
            lanes[l] = larger(lanes[l], x[l].abs());
        }
    }
    lanes.iter().fold(0.0, |m, &l| larger(m, l))
}

#[inline(always)]
pub(crate) fn larger(a: f32, b: f32) -> f32 {
    if b > a { b } else { a }
}
#[inline(always)]
pub(crate) fn smaller(a: f32, b: f32) -> f32 {
    if b < a { b } else { a }
}
/// A row of a field and its six neighbours, each `n` long.
#[derive(Clone, Copy)]
pub(crate) struct Star<'a> {
    pub c: &'a [f32],
    pub xm: &'a [f32],
    pub xp: &'a [f32],
    pub ym: &'a [f32],
    pub yp: &'a [f32],
    pub zm: &'a [f32],
    pub zp: &'a [f32],
}

impl<'a> Star<'a> {
    /// The row that begins at `o` in the middle plane of `planes`.
    #[inline(always)]
    pub fn new(planes: [&'a [f32]; 3], o: usize, stride: usize, n: usize) -> Self {
        let [below, here, above] = planes;
        Self {
            c: &here[o..o + n],
            xm: &here[o - 1..o - 1 + n],
            xp: &here[o + 1..o + 1 + n],
            ym: &here[o - stride..o - stride + n],
            yp: &here[o + stride..o + stride + n],
            zm: &below[o..o + n],
            zp: &above[o..o + n],
        }
    }
    /// The same rows with a length that the compiler sees.
    #[inline(always)]
    pub fn cut(&self, n: usize) -> Self {
        Self {
            c: &self.c[..n],
            xm: &self.xm[..n],
            xp: &self.xp[..n],
            ym: &self.ym[..n],
            yp: &self.yp[..n],
            zm: &self.zm[..n],
            zp: &self.zp[..n],
        }
    }
    /// Weighted sum of the neighbours of cell `i`, with one weight per axis.
    #[inline(always)]
    pub fn around(&self, i: usize, w: [f32; 3]) -> f32 {
        w[0] * (self.xm[i] + self.xp[i]) + w[1] * (self.ym[i] + self.yp[i]) + w[2] * (self.zm[i] + self.zp[i])
    }
}
