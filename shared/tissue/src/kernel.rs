//! The three loops of a step over blocks of 16 tets and rows of 4 nodes: rotations, element forces, motion of the nodes.
//!
//! Energy of an element at deformation F with the frozen rotation R, S = RᵀF:
//! V·(μ|sym S − 1|² + μβ|skew S|² + h(tr S − 3)), h'(s) = p(s) = min(λs, 2μ), 0 ≤ β ≤ 1. With β = 1 it is μ|F − R|² + h, which
//! never grows when R is replaced by a rotation with a larger tr(RᵀF), but brakes bodies that turn while R is frozen. With β = 0
//! turning is free, but a stretched element gains energy when its R catches up. For a turn by a small angle about an
//! eigenvector of tr(S)·1 − S with eigenvalue g, catching up changes the energy by (μ(1−β)g² − 2μg + pg)·angle²/2: the smallest β
//! that keeps this from being positive is taken. At rest it is 0. Promise: the second derivative in F never exceeds the one
//! that [`bound`](crate::bound) starts from, whatever β, R and F.

#![allow(clippy::needless_range_loop)] // indices are those of the formulas

use pulp::Simd;

use crate::lanes::{F, Lanes, V3};
use crate::layout::{Block, LANES, Nodes, RestBlock, Row};

/// A velocity below this is zero: keeps denormal numbers, which are slow, out of a tissue that has come to rest. m/s.
const VELOCITY_FLUSH_M_S: f32 = 1e-20;

/// Smallest μ·g that is divided by, Pa: an element this small in every direction turns without effect.
const G_MIN: f32 = 1e-6;
/// Where the three columns of the symmetric metric lie among its six rows.
const METRIC_COLUMNS: [[usize; 3]; 3] = [[0, 3, 4], [3, 1, 5], [4, 5, 2]];

/// Constants of one motion of the nodes, in single precision.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Constants {
    /// Time that the forces act on the velocities.
    pub kick_s: f32,
    /// Time that the velocities then act on the positions.
    pub drift_s: f32,
    pub velocity_cap_m_s: f32,
}

/// Sums over tets, one per lane of a block.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TetSums {
    pub energy_j: Row,
    pub inverted: Row,
}

#[inline(always)]
fn minus<S: Simd>(a: V3<S>, b: V3<S>) -> V3<S> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// What the search for rotations leaves for the substeps, of 16 tets; the factors with the sign that forces have.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame {
    /// Q = V·R·Bᵀ, row by row; m².
    pub q: [Row; 9],
    /// −(1 + β)/2, the share of the metric's force.
    pub straight: Row,
    /// −(1 − β)·μ/V, the factor of Q·edgesᵀ·Q; Pa/m³.
    pub turned: Row,
}

impl Frame {
    pub const ZERO: Frame = Frame { q: [Row::ZERO; 9], straight: Row::ZERO, turned: Row::ZERO };
}

/// The three edges from corner 0: `edges[i]` is the edge to corner i + 1.
#[inline(always)]
pub(crate) fn edges<S: Lanes, N: Nodes + ?Sized>(
    simd: S,
    nodes: &N,
    corners: &[[N::Number; LANES]; 4],
    half: usize,
) -> [V3<S>; 3] {
    let origin = simd.gather(nodes, &corners[0], half);
    let one = simd.gather(nodes, &corners[1], half);
    let two = simd.gather(nodes, &corners[2], half);
    let three = simd.gather(nodes, &corners[3], half);
    [minus(one, origin), minus(two, origin), minus(three, origin)]
}

/// Finds the rotation and β of each element at `position`, stores what the substeps need of them, and adds the elastic forces there to `force`: those that
/// [`element_forces`] adds.
#[inline(always)]
pub(crate) fn rotations_and_forces<S: Lanes, N: Nodes + ?Sized>(
    simd: S,
    corners: &[[[N::Number; LANES]; 4]],
    (blocks, rest): (&[Block], &[RestBlock]),
    position: &N,
    (frames, force): (&mut [Frame], &mut N),
) -> TetSums {
    let mut sums = TetSums { energy_j: Row::ZERO, inverted: Row::ZERO };
    for ((corners, frame), (block, rest)) in corners.iter().zip(frames).zip(blocks.iter().zip(rest)) {
        for half in 0..LANES / S::F32_LANES {
            let edges = edges(simd, position, corners, half);
            find_frame(simd, (block, rest), &edges, half, frame, &mut sums);
            simd.scatter(force, corners, half, &forces_of(simd, block, frame, &edges, half));
        }
    }
    sums
}

/// Finds the frame of one half block, and adds it to the sums.
#[inline(always)]
fn find_frame<S: Lanes>(
    simd: S,
    (block, rest): (&Block, &RestBlock),
    edges: &[V3<S>; 3],
    half: usize,
    frame: &mut Frame,
    sums: &mut TetSums,
) {
    let mut inv_edges = [[F::splat(simd, 0.0); 3]; 3];
    for (index, row) in rest.inv_edges.iter().enumerate() {
        inv_edges[index / 3][index % 3] = F::load(simd, row, half);
    }
    let mut f = [[F::splat(simd, 0.0); 3]; 3];
    for k in 0..3 {
        for m in 0..3 {
            let last = edges[2][k] * inv_edges[2][m];
            f[k][m] = edges[0][k].fma(inv_edges[0][m], edges[1][k].fma(inv_edges[1][m], last));
        }
    }
    let found = crate::polar::rotation(simd, &f);
    let volume = F::load(simd, &rest.volume, half);
    let straight = add_sums(simd, (block, rest), &f, &found, half, sums);
    (-straight).store(&mut frame.straight, half);
    let turned = (F::splat(simd, 1.0) - straight) * F::load(simd, &block.two_mu, half);
    (-(turned * F::load(simd, &block.inv_volume, half))).store(&mut frame.turned, half);
    for k in 0..3 {
        for j in 0..3 {
            let r = found.matrix[k];
            let sum = r[0].fma(inv_edges[j][0], r[1].fma(inv_edges[j][1], r[2] * inv_edges[j][2]));
            (volume * sum).store(&mut frame.q[3 * k + j], half);
        }
    }
}

/// Adds energy and inversions of one half block to its lanes of `sums`; returns (1 + β)/2.
#[inline(always)]
fn add_sums<S: Lanes>(
    simd: S,
    (block, rest): (&Block, &RestBlock),
    f: &[V3<S>; 3],
    found: &crate::polar::Rotation<S>,
    half: usize,
    sums: &mut TetSums,
) -> F<S> {
    let (zero, one) = (F::splat(simd, 0.0), F::splat(simd, 1.0));
    let (mut trace, mut squared, mut size) = (zero, zero, zero);
    for k in 0..3 {
        for m in 0..3 {
            let difference = f[k][m] - found.matrix[k][m];
            squared = difference.fma(difference, squared);
            trace = f[k][m].fma(found.matrix[k][m], trace);
            size = f[k][m].fma(f[k][m], size);
        }
    }
    let stretch = trace - F::splat(simd, 3.0);
    let (lambda, two_mu) = (F::load(simd, &block.lambda, half), F::load(simd, &block.two_mu, half));
    // ∫ min(λs, 2μ) ds = p·(s − p/2λ) with p the clamped pressure; where λ = 0 so is p.
    let pressure = (lambda * stretch).min(two_mu);
    let volumetric = pressure * F::load(simd, &rest.half_inv_lambda, half).nfma(pressure, stretch);
    let mu = F::splat(simd, 0.5) * two_mu;
    let energy = F::load(simd, &rest.volume, half) * mu.fma(squared, volumetric);
    (F::load(simd, &sums.energy_j, half) + energy).store(&mut sums.energy_j, half);
    let inverted = zero.if_greater(found.orientation, one, zero);
    (F::load(simd, &sums.inverted, half) + inverted).store(&mut sums.inverted, half);
    // The largest g is tr S minus the smallest of three numbers with this sum and this sum of squares: at least mean − √2·deviation.
    let third = F::splat(simd, 1.0 / 3.0);
    let mean = trace * third;
    let deviation = mean.nfma(mean, size * third).max(zero).sqrt();
    let largest = F::splat(simd, 2.0f32.sqrt()).fma(deviation, mean + mean);
    let free = (two_mu - pressure) * (largest * mu).max(F::splat(simd, G_MIN)).recip();
    // 1 − β, kept in 0..1; an inverted element, whose rotation may jump, gets β = 1.
    let free = found.orientation.if_greater(zero, free.min(one).max(zero), zero);
    one - F::splat(simd, 0.5) * free
}

/// Adds the elastic forces at `position` to `force`.
#[inline(always)]
pub(crate) fn element_forces<S: Lanes, N: Nodes + ?Sized>(
    simd: S,
    corners: &[[[N::Number; LANES]; 4]],
    (blocks, frames): (&[Block], &[Frame]),
    position: &N,
    force: &mut N,
) {
    for (corners, (block, frame)) in corners.iter().zip(blocks.iter().zip(frames)) {
        for half in 0..LANES / S::F32_LANES {
            let edges = edges(simd, position, corners, half);
            simd.scatter(force, corners, half, &forces_of(simd, block, frame, &edges, half));
        }
    }
}

/// The elastic forces on the four corners of one half block. Factors and pressure have the opposite sign, so that the nine sums come with that of the forces.
#[inline(always)]
fn forces_of<S: Lanes>(simd: S, block: &Block, frame: &Frame, edges: &[V3<S>; 3], half: usize) -> [V3<S>; 4] {
    let three = F::splat(simd, 3.0);
    let (lambda, two_mu) = (F::load(simd, &block.lambda, half), F::load(simd, &block.two_mu, half));
    let mut q = [[lambda; 3]; 3];
    for (index, row) in frame.q.iter().enumerate() {
        q[index / 3][index % 3] = F::load(simd, row, half);
    }
    // turned[i][j] = edge i · column j of Q; its trace is V·tr S.
    let mut turned = [[three; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            turned[i][j] = edges[i][0].fma(q[0][j], edges[i][1].fma(q[1][j], edges[i][2] * q[2][j]));
        }
    }
    let trace = (turned[0][0] + turned[1][1] + turned[2][2]) * F::load(simd, &block.inv_volume, half);
    let pressure = two_mu - (lambda * (trace - three)).min(two_mu);
    let factor = F::load(simd, &frame.turned, half);
    for i in 0..3 {
        for j in 0..3 {
            turned[i][j] = if i == j { factor.fma(turned[i][j], pressure) } else { factor * turned[i][j] };
        }
    }
    let straight = F::load(simd, &frame.straight, half);
    let metric = &block.metric;
    let mut forces = [[three; 3]; 4];
    for k in 0..3 {
        let d = [straight * edges[0][k], straight * edges[1][k], straight * edges[2][k]];
        for j in 0..3 {
            let [a, b, c] = METRIC_COLUMNS[j];
            let turn = q[k][0].fma(turned[0][j], q[k][1].fma(turned[1][j], q[k][2] * turned[2][j]));
            let last = d[2].fma(F::load(simd, &metric[c], half), turn);
            forces[j + 1][k] = d[0].fma(F::load(simd, &metric[a], half), d[1].fma(F::load(simd, &metric[b], half), last));
        }
        forces[0][k] = -(forces[1][k] + forces[2][k] + forces[3][k]);
    }
    forces
}

/// Rows that the motion of the nodes works on, all of one length.
pub(crate) struct NodeRows<'a> {
    pub inv_mass: &'a [Row],
    pub damping_per_s: &'a [Row],
    pub external: &'a [Row],
    pub position: &'a mut [Row],
    pub velocity: &'a mut [Row],
    pub force: &'a mut [Row],
}

/// Kicks and drifts the nodes, and sets `force` back to the external one.
#[inline(always)]
pub(crate) fn move_nodes<S: Lanes>(simd: S, constants: &Constants, rows: &mut NodeRows) {
    let (kick, drift) = (F::splat(simd, constants.kick_s), F::splat(simd, constants.drift_s));
    let one = F::splat(simd, 1.0);
    let (cap, zero) = (F::splat(simd, constants.velocity_cap_m_s), F::splat(simd, 0.0));
    let flush = F::splat(simd, VELOCITY_FLUSH_M_S);
    let masses = rows.inv_mass.iter().zip(rows.damping_per_s).zip(rows.external);
    let moving = rows.position.iter_mut().zip(rows.velocity.iter_mut()).zip(rows.force.iter_mut());
    for (((inv_mass, damping), external), ((position, velocity), force)) in masses.zip(moving) {
        for half in 0..LANES / S::F32_LANES {
            let inv_mass = F::load(simd, inv_mass, half);
            let old = F::load(simd, velocity, half);
            let free = (kick * inv_mass).fma(F::load(simd, force, half), old);
            let damped = free * kick.fma(F::load(simd, damping, half), one).recip();
            let capped = damped.min(cap).max(-cap);
            let new = capped.abs().if_greater(flush, capped, zero);
            new.store(velocity, half);
            drift.fma(new, F::load(simd, position, half)).store(position, half);
            F::load(simd, external, half).store(force, half);
        }
    }
}
