//! Semi-Lagrangian sampling without gathers: with displacements under one cell the departure point lies between a cell and its upwind
//! neighbour along each axis, so the values come from 27 shifted loads and selects. Works on packs of `W` cells.

#![allow(clippy::needless_range_loop)] // one index over packs of one width

use crate::kernels::{larger, smaller};

/// Nine rows around a row (three planes × three rows), each reaching one cell further on both sides.
pub(crate) type Nine<'a> = [&'a [f32]; 9];
/// Cells side by side.
type Pack<const W: usize> = [f32; W];
/// Cells per pack: the lanes of a 256-bit register.
const WIDTH: usize = 8;

#[inline(always)]
pub(crate) fn nine<'a>(planes: [&'a [f32]; 3], o: usize, stride: usize, n: usize) -> Nine<'a> {
    std::array::from_fn(|r| {
        let at = o + (r % 3) * stride - stride - 1;
        &planes[r / 3][at..at + n + 2]
    })
}

#[inline(always)]
fn load<const W: usize>(row: &[f32], i: usize) -> Pack<W> {
    let mut pack = [0.0; W];
    pack.copy_from_slice(&row[i..i + W]);
    pack
}

/// The neighbour that the flow comes from.
#[inline(always)]
fn choose<const W: usize>(a: &Pack<W>, low: &Pack<W>, high: &Pack<W>) -> Pack<W> {
    let mut out = [0.0; W];
    for l in 0..W {
        let (x, y) = (low[l], high[l]);
        out[l] = if a[l] > 0.0 { x } else { y };
    }
    out
}

#[inline(always)]
fn mix<const W: usize>(t: &Pack<W>, c: &Pack<W>, up: &Pack<W>) -> Pack<W> {
    let mut out = [0.0; W];
    for l in 0..W {
        out[l] = c[l] + t[l] * (up[l] - c[l]);
    }
    out
}

#[inline(always)]
fn least<const W: usize>(a: &Pack<W>, b: &Pack<W>) -> Pack<W> {
    let mut out = [0.0; W];
    for l in 0..W {
        out[l] = smaller(a[l], b[l]);
    }
    out
}

#[inline(always)]
fn most<const W: usize>(a: &Pack<W>, b: &Pack<W>) -> Pack<W> {
    let mut out = [0.0; W];
    for l in 0..W {
        out[l] = larger(a[l], b[l]);
    }
    out
}

#[inline(always)]
fn size<const W: usize>(a: &Pack<W>) -> Pack<W> {
    let mut out = [0.0; W];
    for l in 0..W {
        out[l] = a[l].abs();
    }
    out
}

#[inline(always)]
fn line<const W: usize>(row: &[f32], i: usize, a: &Pack<W>, t: &Pack<W>) -> Pack<W> {
    mix(t, &load(row, i + 1), &choose(a, &load(row, i), &load(row, i + 2)))
}

#[inline(always)]
fn sheet<const W: usize>(rows: [&[f32]; 3], i: usize, a: &[Pack<W>; 3], t: &[Pack<W>; 3]) -> Pack<W> {
    let low = line(rows[0], i, &a[0], &t[0]);
    let high = line(rows[2], i, &a[0], &t[0]);
    mix(&t[1], &line(rows[1], i, &a[0], &t[0]), &choose(&a[1], &low, &high))
}

/// Trilinear values at the points displaced by −a cells.
#[inline(always)]
fn upwind<const W: usize>(r: &Nine<'_>, i: usize, a: &[Pack<W>; 3]) -> Pack<W> {
    let t = [size(&a[0]), size(&a[1]), size(&a[2])];
    let low = sheet([r[0], r[1], r[2]], i, a, &t);
    let high = sheet([r[6], r[7], r[8]], i, a, &t);
    mix(&t[2], &sheet([r[3], r[4], r[5]], i, a, &t), &choose(&a[2], &low, &high))
}

type Range<const W: usize> = (Pack<W>, Pack<W>);

/// The range of the middle widened by that of the upwind neighbour.
#[inline(always)]
fn widen<const W: usize>(a: &Pack<W>, low: &Range<W>, middle: &Range<W>, high: &Range<W>) -> Range<W> {
    (least(&middle.0, &choose(a, &low.0, &high.0)), most(&middle.1, &choose(a, &low.1, &high.1)))
}

#[inline(always)]
fn line_range<const W: usize>(row: &[f32], i: usize, a: &Pack<W>) -> Range<W> {
    let (c, up) = (load(row, i + 1), choose(a, &load(row, i), &load(row, i + 2)));
    (least(&c, &up), most(&c, &up))
}

#[inline(always)]
fn sheet_range<const W: usize>(rows: [&[f32]; 3], i: usize, a: &[Pack<W>; 3]) -> Range<W> {
    let (low, high) = (line_range(rows[0], i, &a[0]), line_range(rows[2], i, &a[0]));
    widen(&a[1], &low, &line_range(rows[1], i, &a[0]), &high)
}

/// Least and largest of the eight values that [`upwind`] mixes.
#[inline(always)]
fn bounds<const W: usize>(r: &Nine<'_>, i: usize, a: &[Pack<W>; 3]) -> Range<W> {
    let (low, high) = (sheet_range([r[0], r[1], r[2]], i, a), sheet_range([r[6], r[7], r[8]], i, a));
    widen(&a[2], &low, &sheet_range([r[3], r[4], r[5]], i, a), &high)
}

#[inline(always)]
fn shifts<const W: usize>(shift: &[&[f32]; 3], i: usize) -> [Pack<W>; 3] {
    [load(shift[0], i), load(shift[1], i), load(shift[2], i)]
}

/// Forward half of a sweep: out = value at the departure points.
#[inline(always)]
pub(crate) fn forward(out: &mut [f32], rows: &Nine<'_>, shift: [&[f32]; 3]) {
    let n = out.len();
    if n < WIDTH {
        for i in 0..n {
            out[i] = upwind::<1>(rows, i, &shifts(&shift, i))[0];
        }
        return;
    }
    let mut i = 0;
    while i < n {
        let at = i.min(n - WIDTH); // the last pack overlaps the one before
        out[at..at + WIDTH].copy_from_slice(&upwind::<WIDTH>(rows, at, &shifts(&shift, at)));
        i += WIDTH;
    }
}

/// MacCormack's correction of one pack: φ̂ + ½(φ − φ̌), within the values that φ̂ was mixed from.
#[inline(always)]
fn corrected<const W: usize>(before: &Nine<'_>, after: &Nine<'_>, i: usize, a: &[Pack<W>; 3]) -> Pack<W> {
    let mut reverse = *a;
    for axis in &mut reverse {
        for x in axis {
            *x = -*x;
        }
    }
    let back = upwind::<W>(after, i, &reverse);
    let (value, old) = (load::<W>(after[4], i + 1), load::<W>(before[4], i + 1));
    let (low, high) = bounds::<W>(before, i, a);
    let mut out = [0.0; W];
    for l in 0..W {
        out[l] = value[l] + 0.5 * (old[l] - back[l]);
    }
    least(&most(&out, &low), &high)
}

/// Backward half of a sweep.
#[inline(always)]
pub(crate) fn backward(out: &mut [f32], before: &Nine<'_>, after: &Nine<'_>, shift: [&[f32]; 3]) {
    let n = out.len();
    if n < WIDTH {
        for i in 0..n {
            out[i] = corrected::<1>(before, after, i, &shifts(&shift, i))[0];
        }
        return;
    }
    let mut i = 0;
    while i < n {
        let at = i.min(n - WIDTH);
        out[at..at + WIDTH].copy_from_slice(&corrected::<WIDTH>(before, after, at, &shifts(&shift, at)));
        i += WIDTH;
    }
}
