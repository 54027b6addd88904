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

/// The upwind neighbours along x of the faces of a row.
#[inline(always)]
fn ahead<const W: usize>(row: &[f32], i: usize, a: &Pack<W>) -> Pack<W> {
    choose(a, &load(row, i), &load(row, i + 2))
}

/// Of three rows of a plane: the face and its upwind neighbour along x, in the middle row and in the upwind one.
#[inline(always)]
fn sheet<const W: usize>(rows: [&[f32]; 3], i: usize, a: &[Pack<W>; 3]) -> [Pack<W>; 4] {
    let [low, middle, high] = rows;
    let here = choose(&a[1], &load(low, i + 1), &load(high, i + 1));
    let beside = choose(&a[1], &ahead(low, i, &a[0]), &ahead(high, i, &a[0]));
    [load(middle, i + 1), ahead(middle, i, &a[0]), here, beside]
}

/// The eight values around the departure points, x fastest, then y, then z: along each axis first at the face itself, then upwind. They are chosen before they
/// are mixed: what a lane mixes is the same, and four lines are mixed where there are nine.
#[inline(always)]
fn corners<const W: usize>(r: &Nine<'_>, i: usize, a: &[Pack<W>; 3]) -> [Pack<W>; 8] {
    let low = sheet([r[0], r[1], r[2]], i, a);
    let high = sheet([r[6], r[7], r[8]], i, a);
    let [c0, c1, c2, c3] = sheet([r[3], r[4], r[5]], i, a);
    let (c4, c5) = (choose(&a[2], &low[0], &high[0]), choose(&a[2], &low[1], &high[1]));
    let (c6, c7) = (choose(&a[2], &low[2], &high[2]), choose(&a[2], &low[3], &high[3]));
    [c0, c1, c2, c3, c4, c5, c6, c7]
}

/// Trilinear values at the points displaced by −a cells.
#[inline(always)]
fn upwind<const W: usize>(r: &Nine<'_>, i: usize, a: &[Pack<W>; 3]) -> Pack<W> {
    let t = [size(&a[0]), size(&a[1]), size(&a[2])];
    let c = corners(r, i, a);
    let near = mix(&t[1], &mix(&t[0], &c[0], &c[1]), &mix(&t[0], &c[2], &c[3]));
    let far = mix(&t[1], &mix(&t[0], &c[4], &c[5]), &mix(&t[0], &c[6], &c[7]));
    mix(&t[2], &near, &far)
}

/// Least and largest of the eight values that [`upwind`] mixes.
#[inline(always)]
fn bounds<const W: usize>(r: &Nine<'_>, i: usize, a: &[Pack<W>; 3]) -> (Pack<W>, Pack<W>) {
    let c = corners(r, i, a);
    let low_near = least(&least(&c[0], &c[1]), &least(&c[2], &c[3]));
    let low_far = least(&least(&c[4], &c[5]), &least(&c[6], &c[7]));
    let high_near = most(&most(&c[0], &c[1]), &most(&c[2], &c[3]));
    let high_far = most(&most(&c[4], &c[5]), &most(&c[6], &c[7]));
    (least(&low_near, &low_far), most(&high_near, &high_far))
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A face of nine rows and how far upwind its value comes from, computed in the order in which it is defined: nine lines, three sheets, one value.
    struct Face<'a> {
        rows: &'a Nine<'a>,
        i: usize,
        a: [f32; 3],
    }

    impl Face<'_> {
        fn pick(&self, axis: usize, low: f32, high: f32) -> f32 {
            if self.a[axis] > 0.0 { low } else { high }
        }
        fn blend(&self, axis: usize, here: f32, up: f32) -> f32 {
            here + self.a[axis].abs() * (up - here)
        }
        fn pair(&self, row: usize) -> (f32, f32) {
            let row = &self.rows[row][self.i..self.i + 3];
            (row[1], self.pick(0, row[0], row[2]))
        }
        fn value(&self) -> f32 {
            let line = |row: usize| {
                let (here, up) = self.pair(row);
                self.blend(0, here, up)
            };
            let sheet = |plane: usize| {
                let at = 3 * plane;
                self.blend(1, line(at + 1), self.pick(1, line(at), line(at + 2)))
            };
            self.blend(2, sheet(1), self.pick(2, sheet(0), sheet(2)))
        }
        /// The least or the largest of what is mixed.
        fn extreme(&self, of: fn(f32, f32) -> f32) -> f32 {
            let line = |row: usize| {
                let (here, up) = self.pair(row);
                of(here, up)
            };
            let sheet = |plane: usize| {
                let at = 3 * plane;
                of(line(at + 1), self.pick(1, line(at), line(at + 2)))
            };
            of(sheet(1), self.pick(2, sheet(0), sheet(2)))
        }
    }

    /// Numbers from −1 to 1, a tenth of them 0, −0 or an end.
    fn numbers(seed: u64, count: usize) -> Vec<f32> {
        let mut x = seed;
        let mut number = || {
            x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            match (x >> 33) % 40 {
                0 => 0.0,
                1 => -0.0,
                2 => 1.0,
                3 => -1.0,
                _ => (x >> 40) as f32 / (1u64 << 23) as f32 - 1.0,
            }
        };
        (0..count).map(|_| number()).collect()
    }

    #[test]
    fn corners_chosen_before_they_are_mixed_give_the_bits_of_lines_chosen_after() {
        for n in [3, 8, 21, 64] {
            let field = |seed: u64| -> Vec<Vec<f32>> { (0..9).map(|row| numbers(100 * seed + row, n + 2)).collect() };
            let (before, after) = (field(1), field(2));
            let before: Nine<'_> = std::array::from_fn(|row| before[row].as_slice());
            let after: Nine<'_> = std::array::from_fn(|row| after[row].as_slice());
            let shift: [Vec<f32>; 3] = std::array::from_fn(|axis| numbers(300 + axis as u64, n));
            let shift = shift.each_ref().map(|shift| shift.as_slice());
            let (mut to, mut back) = (vec![0.0; n], vec![0.0; n]);
            forward(&mut to, &before, shift);
            backward(&mut back, &before, &after, shift);
            for i in 0..n {
                let a = shift.map(|shift| shift[i]);
                let there = Face { rows: &before, i, a };
                assert_eq!(to[i].to_bits(), there.value().to_bits(), "{n} {i}");
                let again = Face { rows: &after, i, a: a.map(|a| -a) };
                let corrected = after[4][i + 1] + 0.5 * (before[4][i + 1] - again.value());
                let held = smaller(larger(corrected, there.extreme(smaller)), there.extreme(larger));
                assert_eq!(back[i].to_bits(), held.to_bits(), "{n} {i}");
            }
        }
    }
}
