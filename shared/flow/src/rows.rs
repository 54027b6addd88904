//! Row kernels: each works on rows of equal length `out.len()`, with the written rows as arguments of their own, so that the compiler
//! knows that they overlap nothing and keeps every loop in vectors.

#![allow(clippy::needless_range_loop)] // one index over rows of one length: the form that the compiler turns into vectors

use crate::inputs::MAX_SPEED_M_S;
use crate::kernels::{Star, larger, smaller};

#[cfg(test)]
mod tests;

/// out = keep·c + Σ weights·neighbours + push
#[inline(always)]
pub(crate) fn diffuse(out: &mut [f32], star: &Star<'_>, keep: f32, weights: [f32; 3], push: f32) {
    let n = out.len();
    let star = star.cut(n);
    for i in 0..n {
        out[i] = keep * star.c[i] + star.around(i, weights) + push;
    }
}

/// Faces between a fluid cell and another keep their value, the others take the held one.
#[inline(always)]
pub(crate) fn hold(row: &mut [f32], here: &[f32], back: &[f32], held: &[f32]) {
    let n = row.len();
    let (here, back, held) = (&here[..n], &back[..n], &held[..n]);
    for i in 0..n {
        row[i] = if here[i] * back[i] > 0.0 { row[i] } else { held[i] };
    }
}

/// Whether all cells of a row are fluid: each is 1 or 0, and bits, unlike numbers, are combined in any order.
#[inline(always)]
pub(crate) fn are_fluid(cells: &[f32]) -> bool {
    cells.iter().fold(u32::MAX, |all, cell| all & cell.to_bits()) == 1.0f32.to_bits()
}

/// Whether two rows have the same bits, looked at several cells at a time: a comparison of numbers goes cell by cell.
#[inline(always)]
pub(crate) fn are_same(a: &[f32], b: &[f32]) -> bool {
    a.iter().zip(b).fold(0, |all, (a, b)| all | (a.to_bits() ^ b.to_bits())) == 0
}

/// The velocity of faces of which each is between two cells: the mean of those that are solid (not 0), of which the others' is 0.
#[inline(always)]
pub(crate) fn wall(out: &mut [f32], solid: [&[u8]; 2], velocity: [&[f32]; 2]) {
    let n = out.len();
    let (solid, velocity) = (solid.map(|row| &row[..n]), velocity.map(|row| &row[..n]));
    for i in 0..n {
        let solids = f32::from(u8::from(solid[0][i] != 0) + u8::from(solid[1][i] != 0));
        out[i] = (velocity[0][i] + velocity[1][i]) / larger(solids, 1.0);
    }
}

/// A face between two solid cells shows, beside faces that the medium goes through, twice the solid's velocity less the mean of theirs; any other the solid's.
/// `own` are the cells on both sides of each face; `around` the same and the velocity of the four faces beside it.
#[inline(always)]
pub(crate) fn mirror(out: &mut [f32], face: &[f32], own: [&[f32]; 2], around: &[[&[f32]; 3]; 4]) {
    let n = out.len();
    for from in (0..n).step_by(LANES) {
        // The last block overlaps the one before, and makes the same of the same: one that is not whole costs as much as several.
        let from = from.min(n.saturating_sub(LANES));
        let range = from..(from + LANES).min(n);
        let (mut open, mut sum) = ([0.0f32; LANES], [0.0f32; LANES]);
        for rows in around {
            let [here, back, velocity] = rows.map(|row| lanes(&row[range.clone()]));
            for l in 0..LANES {
                let is_open = here[l] * back[l];
                open[l] += is_open;
                sum[l] += is_open * velocity[l];
            }
        }
        let [face, here, back] = [face, own[0], own[1]].map(|row| lanes(&row[range.clone()]));
        let mut shown = [0.0f32; LANES];
        for l in 0..LANES {
            let mirrored = 2.0 * face[l] - sum[l] / larger(open[l], 1.0);
            let mirrored = smaller(larger(mirrored, -MAX_SPEED_M_S), MAX_SPEED_M_S);
            shown[l] = if (1.0 - here[l]) * (1.0 - back[l]) * open[l] > 0.0 { mirrored } else { face[l] };
        }
        let out = &mut out[range];
        out.copy_from_slice(&shown[..out.len()]);
    }
}

/// Faces of a row that are computed at once.
const LANES: usize = 16;

/// The numbers of a part of a row, and zeros after them.
#[inline(always)]
fn lanes(row: &[f32]) -> [f32; LANES] {
    row.try_into().unwrap_or_else(|_| {
        let mut lanes = [0.0; LANES];
        lanes[..row.len()].copy_from_slice(row);
        lanes
    })
}

/// out = −m·∇·v; `faces` are the low and high faces along x, y, z.
#[inline(always)]
pub(crate) fn convergence(out: &mut [f32], m: &[f32], faces: [&[f32]; 6], per_m: [f32; 3]) {
    let n = out.len();
    let [u0, u1, v0, v1, w0, w1] = faces;
    let (u0, u1, v0, v1, w0, w1, m) = (&u0[..n], &u1[..n], &v0[..n], &v1[..n], &w0[..n], &w1[..n], &m[..n]);
    let [cx, cy, cz] = per_m;
    for i in 0..n {
        out[i] = -m[i] * (cx * (u1[i] - u0[i]) + cy * (v1[i] - v0[i]) + cz * (w1[i] - w0[i]));
    }
}

/// out = m·(what leaves a cell per second), a number ≥ 0.
#[inline(always)]
pub(crate) fn outflow(out: &mut [f32], m: &[f32], faces: [&[f32]; 6], per_m: [f32; 3]) {
    let n = out.len();
    let [u0, u1, v0, v1, w0, w1] = faces;
    let (u0, u1, v0, v1, w0, w1, m) = (&u0[..n], &u1[..n], &v0[..n], &v1[..n], &w0[..n], &w1[..n], &m[..n]);
    for i in 0..n {
        let x = per_m[0] * (larger(u1[i], 0.0) - smaller(u0[i], 0.0));
        let y = per_m[1] * (larger(v1[i], 0.0) - smaller(v0[i], 0.0));
        let z = per_m[2] * (larger(w1[i], 0.0) - smaller(w0[i], 0.0));
        out[i] = m[i] * (x + y + z);
    }
}

/// x = x·m·scale
#[inline(always)]
pub(crate) fn scale_masked(x: &mut [f32], m: &[f32], scale: f32) {
    for (x, m) in x.iter_mut().zip(m) {
        *x *= m * scale;
    }
}

/// phi = m·scale·(phi − mean); beyond 1e30 or not a number: 0.
#[inline(always)]
pub(crate) fn centre(phi: &mut [f32], m: &[f32], mean: &[f32], scale: f32) {
    let n = phi.len();
    let (m, mean) = (&m[..n], &mean[..n]);
    for i in 0..n {
        let p = m[i] * scale * (phi[i] - mean[i]);
        phi[i] = if p.abs() < 1e30 { p } else { 0.0 };
    }
}

/// What is −0 in solid cells becomes +0.
#[inline(always)]
pub(crate) fn unsign(phi: &mut [f32], m: &[f32]) {
    for (phi, m) in phi.iter_mut().zip(m) {
        *phi = if *m > 0.0 { *phi } else { *phi + 0.0 };
    }
}

/// r −= m·mean
#[inline(always)]
pub(crate) fn subtract_masked(r: &mut [f32], m: &[f32], mean: &[f32]) {
    let n = r.len();
    let (m, mean) = (&m[..n], &mean[..n]);
    for i in 0..n {
        r[i] -= m[i] * mean[i];
    }
}

/// r −= a·t
#[inline(always)]
pub(crate) fn reduce(r: &mut [f32], t: &[f32], a: f32) {
    for (r, t) in r.iter_mut().zip(t) {
        *r -= a * t;
    }
}

/// out = v·r
#[inline(always)]
pub(crate) fn multiply(out: &mut [f32], v: &[f32], r: &[f32]) {
    let n = out.len();
    let (v, r) = (&v[..n], &r[..n]);
    for i in 0..n {
        out[i] = v[i] * r[i];
    }
}

/// x += a·y
#[inline(always)]
pub(crate) fn add_scaled(x: &mut [f32], y: &[f32], a: f32) {
    for (x, y) in x.iter_mut().zip(y) {
        *x += a * y;
    }
}

/// x += a·y·z
#[inline(always)]
pub(crate) fn add_product(x: &mut [f32], y: &[f32], z: &[f32], a: f32) {
    let n = x.len();
    let (y, z) = (&y[..n], &z[..n]);
    for i in 0..n {
        x[i] += a * (y[i] * z[i]);
    }
}

/// row −= per_m·(phi − back); what exceeds `limit` becomes 0 and is counted, what is below `rest` becomes 0.
#[inline(always)]
pub(crate) fn project(row: &mut [f32], phi: &[f32], back: &[f32], per_m: f32, limit: f32, rest: f32) -> u32 {
    let n = row.len();
    let (phi, back) = (&phi[..n], &back[..n]);
    let mut wild = 0u32;
    for i in 0..n {
        let x = row[i] - per_m * (phi[i] - back[i]);
        let size = x.abs();
        wild = wild.wrapping_add(u32::from(size > limit || size.is_nan()));
        row[i] = if size <= limit && size >= rest { x } else { 0.0 };
    }
    wild
}

/// d = m·Σ weights·neighbours, the diagonal of the finest level from the star of its cells m; v = damping/d where d is not 0, else 0.
#[inline(always)]
pub(crate) fn fine_diagonal(d: &mut [f32], v: &mut [f32], star: &Star<'_>, weights: [f32; 3], damping: f32) {
    let n = d.len();
    let (v, star) = (&mut v[..n], star.cut(n));
    for i in 0..n {
        let diagonal = star.c[i] * star.around(i, weights);
        d[i] = diagonal;
        v[i] = if diagonal > 0.0 { damping / diagonal } else { 0.0 };
    }
}

/// d = Σ coefficients, the diagonal of a coarse level from its low and high faces along x, y, z; v as in [`fine_diagonal`].
#[inline(always)]
pub(crate) fn coarse_diagonal(d: &mut [f32], v: &mut [f32], faces: [&[f32]; 6], damping: f32) {
    let n = d.len();
    let v = &mut v[..n];
    let [x0, x1, y0, y1, z0, z1] = faces;
    let (x0, x1, y0, y1, z0, z1) = (&x0[..n], &x1[..n], &y0[..n], &y1[..n], &z0[..n], &z1[..n]);
    for i in 0..n {
        let diagonal = x0[i] + x1[i] + y0[i] + y1[i] + z0[i] + z1[i];
        d[i] = diagonal;
        v[i] = if diagonal > 0.0 { damping / diagonal } else { 0.0 };
    }
}

/// A·x of cell `i` on the finest level; 0 where the diagonal is 0.
#[inline(always)]
fn fine_image(diagonal: &[f32], star: &Star<'_>, weights: [f32; 3], i: usize) -> f32 {
    let value = diagonal[i] * star.c[i] - star.around(i, weights);
    if diagonal[i] > 0.0 { value } else { 0.0 }
}

/// out = A·x on the finest level.
#[inline(always)]
pub(crate) fn fine_operator(out: &mut [f32], diagonal: &[f32], star: &Star<'_>, weights: [f32; 3]) {
    let n = out.len();
    let (diagonal, star) = (&diagonal[..n], star.cut(n));
    for i in 0..n {
        out[i] = fine_image(diagonal, &star, weights, i);
    }
}

/// sum += r − A·x on the finest level: [`fine_operator`] and [`add_residual`] at once.
#[inline(always)]
pub(crate) fn fine_residual(sum: &mut [f32], r: &[f32], diagonal: &[f32], star: &Star<'_>, weights: [f32; 3]) {
    let n = sum.len();
    let (r, diagonal, star) = (&r[..n], &diagonal[..n], star.cut(n));
    for i in 0..n {
        sum[i] += r[i] - fine_image(diagonal, &star, weights, i);
    }
}

/// out = y + v·(r − A·y) on the finest level, with the star of y: [`fine_operator`] and [`smooth`] at once.
#[inline(always)]
pub(crate) fn fine_smooth(out: &mut [f32], [v, r]: [&[f32]; 2], diagonal: &[f32], star: &Star<'_>, weights: [f32; 3]) {
    let n = out.len();
    let (v, r, diagonal, star) = (&v[..n], &r[..n], &diagonal[..n], star.cut(n));
    for i in 0..n {
        out[i] = star.c[i] + v[i] * (r[i] - fine_image(diagonal, &star, weights, i));
    }
}

/// d = z + beta·d and q = A·z + beta·q on the finest level, with the star of z.
#[inline(always)]
pub(crate) fn fine_direction(d: &mut [f32], q: &mut [f32], diagonal: &[f32], star: &Star<'_>, weights: [f32; 3], beta: f32) {
    let n = d.len();
    let (q, diagonal, star) = (&mut q[..n], &diagonal[..n], star.cut(n));
    for i in 0..n {
        q[i] = fine_image(diagonal, &star, weights, i) + beta * q[i];
        d[i] = star.c[i] + beta * d[i];
    }
}

/// out = Σ coefficient·neighbour on a coarse level; `faces` are the low and high coefficients along x, y, z. The result is A·x.
#[inline(always)]
pub(crate) fn coarse_operator(out: &mut [f32], diagonal: &[f32], star: &Star<'_>, faces: [&[f32]; 6]) {
    let n = out.len();
    let [x0, x1, y0, y1, z0, z1] = faces;
    let (x0, x1, y0, y1, z0, z1) = (&x0[..n], &x1[..n], &y0[..n], &y1[..n], &z0[..n], &z1[..n]);
    let (diagonal, star) = (&diagonal[..n], star.cut(n));
    for i in 0..n {
        let x = x0[i] * star.xm[i] + x1[i] * star.xp[i];
        let y = y0[i] * star.ym[i] + y1[i] * star.yp[i];
        let z = z0[i] * star.zm[i] + z1[i] * star.zp[i];
        out[i] = diagonal[i] * star.c[i] - (x + y + z);
    }
}

/// out = y + v·(r − ay)
#[inline(always)]
pub(crate) fn smooth(out: &mut [f32], y: &[f32], v: &[f32], r: &[f32], ay: &[f32]) {
    let n = out.len();
    let (y, v, r, ay) = (&y[..n], &v[..n], &r[..n], &ay[..n]);
    for i in 0..n {
        out[i] = y[i] + v[i] * (r[i] - ay[i]);
    }
}

/// sum += r − az
#[inline(always)]
pub(crate) fn add_residual(sum: &mut [f32], r: &[f32], az: &[f32]) {
    let n = sum.len();
    let (r, az) = (&r[..n], &az[..n]);
    for i in 0..n {
        sum[i] += r[i] - az[i];
    }
}

/// out = v·r + w where the damped inverse v is not 0, which it is where the diagonal is not, else 0.
#[inline(always)]
pub(crate) fn correct(out: &mut [f32], r: &[f32], v: &[f32], w: &[f32]) {
    let n = out.len();
    let (r, v, w) = (&r[..n], &v[..n], &w[..n]);
    for i in 0..n {
        let corrected = v[i] * r[i] + w[i];
        out[i] = if v[i] > 0.0 { corrected } else { 0.0 };
    }
}

/// Displacement: out = clamp(c·own, −1, 1)
#[inline(always)]
pub(crate) fn shift_own(out: &mut [f32], own: &[f32], c: f32) {
    for (out, x) in out.iter_mut().zip(own) {
        *out = smaller(larger(c * x, -1.0), 1.0);
    }
}

/// Displacement by the mean of four faces, within −1..1.
#[inline(always)]
pub(crate) fn shift_mean(out: &mut [f32], four: [&[f32]; 4], c: f32) {
    let n = out.len();
    let [p, q, r, s] = four;
    let (p, q, r, s) = (&p[..n], &q[..n], &r[..n], &s[..n]);
    for i in 0..n {
        let mean = 0.25 * c * ((p[i] + q[i]) + (r[i] + s[i]));
        out[i] = smaller(larger(mean, -1.0), 1.0);
    }
}
