//! Tissue that hardly gives way to pressure: how the volume of its tets is held, at the nodes that they share.
//!
//! A mesh of tets has several times as many tets as nodes. If each is to keep its own volume there is hardly a way left to move, and the mesh locks. So what
//! is held is the mean dilation about each node (Bonet and Burton, "A simple average nodal pressure tetrahedral element for incompressible and nearly
//! incompressible dynamic explicit applications", 1998), which leaves one condition for each node, and the shear is that of each tet as ever.
//!
//! Energy: the sum over nodes of a quarter of their tets' volume V·h(θ), θ = ΣV·(tr S − 3)/V, h'(θ) = p(θ) = min(λθ, 2μ), with the smallest λ and μ of the
//! node's tets. A tet is under the mean pressure of its corners. Promise: the second derivative is no larger than if each tet held its own volume with its
//! own λ (Jensen), from which [`bound`](crate::bound) starts, and no pressure is above the 2μ of any tet that it acts on.

#![allow(clippy::needless_range_loop)] // indices are those of the formulas

use crate::kernel::{Frame, edges};
use crate::lanes::{F, Lanes};
use crate::layout::{self, Block, LANES, Nodes, RestBlock, Row};

/// Smallest 2μ that is divided by, Pa: that of a padding lane is 0.
const TWO_MU_MIN_PA: f32 = 1e-20;

/// What the tets about a node whose volume it holds come to.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BulkSum {
    pub volume_m3: f64,
    pub lambda_pa: f64,
    pub mu_pa: f64,
}

impl BulkSum {
    /// Of no tet.
    pub const NONE: BulkSum = BulkSum { volume_m3: 0.0, lambda_pa: f64::INFINITY, mu_pa: f64::INFINITY };

    /// With another tet.
    pub fn add(&mut self, volume_m3: f64, lambda_pa: f64, mu_pa: f64) {
        self.volume_m3 += volume_m3;
        self.lambda_pa = self.lambda_pa.min(lambda_pa);
        self.mu_pa = self.mu_pa.min(mu_pa);
    }

    /// λ over the volume, by which what the tets have grown is the node's pressure, Pa/m³; 0 where it holds none.
    pub fn pa_per_m3(&self) -> f64 {
        if self.volume_m3 > 0.0 { self.lambda_pa / self.volume_m3 } else { 0.0 }
    }
}

/// How a node holds the volume about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct NodeBulk {
    /// As of the sum.
    pub pa_per_m3: f32,
    /// Most pressure, Pa.
    pub most_pa: f32,
}

impl NodeBulk {
    fn of(sum: &BulkSum) -> NodeBulk {
        let most_pa = if sum.volume_m3 > 0.0 { 2.0 * sum.mu_pa } else { 0.0 };
        NodeBulk { pa_per_m3: sum.pa_per_m3() as f32, most_pa: most_pa as f32 }
    }
}

/// The tets of a model whose volume is held by their nodes, and these nodes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Bulk {
    /// Blocks with such tets, ascending, and 1 in the lanes of these.
    pub shares: Vec<(u32, Row)>,
    /// One for each node of the model.
    pub nodes: Vec<NodeBulk>,
}

impl Bulk {
    /// `None` for a model without such tets: `sums` are none then.
    pub fn new(rest: &[RestBlock], sums: &[BulkSum]) -> Option<Bulk> {
        if sums.is_empty() {
            return None;
        }
        let share = |rest: &RestBlock| {
            let mut share = Row::ZERO;
            for (lane, share) in share.0.iter_mut().enumerate() {
                *share = f32::from(u8::from(rest.is_held_by_nodes(lane)));
            }
            share
        };
        let shares = (0..).zip(rest.iter().map(share)).filter(|(_, share)| *share != Row::ZERO).collect();
        Some(Bulk { shares, nodes: sums.iter().map(NodeBulk::of).collect() })
    }

    /// Finds the pressure of each node at `position`, and leaves it in `rows`, which need not be as the last call left them.
    #[inline(always)]
    pub fn find_pressures<S: Lanes, N: Nodes + ?Sized>(
        &self,
        simd: S,
        corners: &[[[N::Number; LANES]; 4]],
        (rest, frames): (&[RestBlock], &[Frame]),
        position: &N,
        rows: &mut [Row],
    ) {
        rows[..layout::node_rows(self.nodes.len())].fill(Row::ZERO);
        let (zero, three) = (F::splat(simd, 0.0), F::splat(simd, 3.0));
        let sums = N::of_mut(rows);
        for (block, share) in &self.shares {
            let block = *block as usize;
            let (corners, rest, frame) = (&corners[block], &rest[block], &frames[block]);
            for half in 0..LANES / S::F32_LANES {
                let edges = edges(simd, position, corners, half);
                let mut trace = zero;
                for j in 0..3 {
                    for k in 0..3 {
                        trace = edges[j][k].fma(F::load(simd, &frame.q[3 * k + j], half), trace);
                    }
                }
                let grown = three.nfma(F::load(simd, &rest.volume, half), trace) * F::load(simd, share, half);
                simd.scatter(sums, corners, half, &[[grown, zero, zero]; 4]);
            }
        }
        let rows: &mut [[f32; 4]] = bytemuck::cast_slice_mut(rows);
        for (row, node) in rows.iter_mut().zip(&self.nodes) {
            let grown_m3 = row[0];
            *row = [0.25 * (node.pa_per_m3 * grown_m3).min(node.most_pa), grown_m3, 0.0, 0.0];
        }
    }

    /// The energy of the volumes that the last search has found, J.
    pub fn energy_j(&self, rows: &[Row]) -> f32 {
        let rows: &[[f32; 4]] = bytemuck::cast_slice(rows);
        // A quarter of V·p·(θ − p/2λ).
        let of_node = |(row, node): (&[f32; 4], &NodeBulk)| match node.pa_per_m3 > 0.0 {
            true => row[0] * (row[1] - 2.0 * row[0] / node.pa_per_m3),
            false => 0.0,
        };
        rows.iter().zip(&self.nodes).map(of_node).sum()
    }

    /// Brakes the turning of tets under tension, as the kernel does that of tets which hold their own volume: 1 − β, which it has found for a pressure of 0, is
    /// (2μ − p) over what it does not know any more. Under compression β stays larger than it has to be.
    #[inline(always)]
    pub fn brake<S: Lanes, N: Nodes + ?Sized>(
        &self,
        simd: S,
        corners: &[[[N::Number; LANES]; 4]],
        blocks: &[Block],
        rows: &[Row],
        frames: &mut [Frame],
    ) {
        let (zero, one) = (F::splat(simd, 0.0), F::splat(simd, 1.0));
        for (block, share) in &self.shares {
            let block = *block as usize;
            for half in 0..LANES / S::F32_LANES {
                let pressure = mean(simd, N::of(rows), &corners[block], half) * F::load(simd, share, half);
                let two_mu = F::load(simd, &blocks[block].two_mu, half).max(F::splat(simd, TWO_MU_MIN_PA));
                let left = (one - pressure.max(zero) * two_mu.recip()).max(zero);
                let frame = &mut frames[block];
                let half_free = one + F::load(simd, &frame.straight, half);
                half_free.fma(left, -one).store(&mut frame.straight, half);
                (F::load(simd, &frame.turned, half) * left).store(&mut frame.turned, half);
            }
        }
    }

    /// Adds the forces of the pressures that the last search has found to `force`.
    #[inline(always)]
    pub fn add_forces<S: Lanes, N: Nodes + ?Sized>(
        &self,
        simd: S,
        corners: &[[[N::Number; LANES]; 4]],
        frames: &[Frame],
        rows: &[Row],
        force: &mut N,
    ) {
        for (block, share) in &self.shares {
            let block = *block as usize;
            let (corners, frame) = (&corners[block], &frames[block]);
            for half in 0..LANES / S::F32_LANES {
                let pressure = -(mean(simd, N::of(rows), corners, half) * F::load(simd, share, half));
                let mut forces = [[pressure; 3]; 4];
                for k in 0..3 {
                    for j in 0..3 {
                        forces[j + 1][k] = pressure * F::load(simd, &frame.q[3 * k + j], half);
                    }
                    forces[0][k] = -(forces[1][k] + forces[2][k] + forces[3][k]);
                }
                simd.scatter(force, corners, half, &forces);
            }
        }
    }
}

/// The mean pressure of a half block's corners, of which each node has a quarter.
#[inline(always)]
fn mean<S: Lanes, N: Nodes + ?Sized>(simd: S, rows: &N, corners: &[[N::Number; LANES]; 4], half: usize) -> F<S> {
    let one = simd.gather(rows, &corners[0], half)[0] + simd.gather(rows, &corners[1], half)[0];
    one + (simd.gather(rows, &corners[2], half)[0] + simd.gather(rows, &corners[3], half)[0])
}
