//! Lanes of single-precision numbers over pulp's tokens, and the two moves that every kernel needs: nodes into lanes and back.
//!
//! Promise: each operation is per lane and exactly rounded, so that a lane's result does not depend on how many lanes there are;
//! node sums are made in the order half block, corner, lane for every width.

use pulp::Simd;
use std::ops::{Add, Mul, Neg, Sub};

use crate::layout::{LANES, Nodes, Row};

/// Operations of one lane, as tests count them: a fused multiply-add is two; a change of sign, a comparison and a choice are none, all else is one.
#[cfg(test)]
pub(crate) mod counted {
    use std::cell::Cell;

    thread_local! {
        static OPERATIONS: Cell<u64> = const { Cell::new(0) };
    }

    pub(crate) fn count(operations: u64) {
        OPERATIONS.set(OPERATIONS.get() + operations);
    }

    /// Operations of some work of this thread.
    pub(crate) fn operations_of(work: impl FnOnce()) -> u64 {
        let before = OPERATIONS.get();
        work();
        OPERATIONS.get() - before
    }
}

#[cfg(test)]
use counted::count;

#[cfg(not(test))]
#[inline(always)]
fn count(_: u64) {}

/// One register of lanes, with the token that allows its use.
#[derive(Clone, Copy)]
pub(crate) struct F<S: Simd> {
    pub simd: S,
    pub value: S::f32s,
}

/// Three components in lanes.
pub(crate) type V3<S> = [F<S>; 3];

impl<S: Simd> Add for F<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        count(1);
        F { simd: self.simd, value: self.simd.add_f32s(self.value, other.value) }
    }
}

impl<S: Simd> Sub for F<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        count(1);
        F { simd: self.simd, value: self.simd.sub_f32s(self.value, other.value) }
    }
}

impl<S: Simd> Mul for F<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        count(1);
        F { simd: self.simd, value: self.simd.mul_f32s(self.value, other.value) }
    }
}

impl<S: Simd> Neg for F<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        F { simd: self.simd, value: self.simd.neg_f32s(self.value) }
    }
}

impl<S: Simd> F<S> {
    #[inline(always)]
    pub fn splat(simd: S, value: f32) -> Self {
        F { simd, value: simd.splat_f32s(value) }
    }

    /// Part `half` of a row: its lanes `half·width..`.
    #[inline(always)]
    pub fn load(simd: S, row: &Row, half: usize) -> Self {
        F { simd, value: S::as_simd_f32s(&row.0).0[half] }
    }

    #[inline(always)]
    pub fn store(self, row: &mut Row, half: usize) {
        S::as_mut_simd_f32s(&mut row.0).0[half] = self.value;
    }

    /// self·b + c, in one rounding where the set has it.
    #[inline(always)]
    pub fn fma(self, b: Self, c: Self) -> Self {
        count(2);
        F { simd: self.simd, value: self.simd.mul_add_e_f32s(self.value, b.value, c.value) }
    }

    /// c − self·b.
    #[inline(always)]
    pub fn nfma(self, b: Self, c: Self) -> Self {
        count(2);
        F { simd: self.simd, value: self.simd.negate_mul_add_e_f32s(self.value, b.value, c.value) }
    }

    #[inline(always)]
    pub fn recip(self) -> Self {
        count(1);
        F { simd: self.simd, value: self.simd.div_f32s(self.simd.splat_f32s(1.0), self.value) }
    }

    #[inline(always)]
    pub fn sqrt(self) -> Self {
        count(1);
        F { simd: self.simd, value: self.simd.sqrt_f32s(self.value) }
    }

    #[inline(always)]
    pub fn abs(self) -> Self {
        F { simd: self.simd, value: self.simd.abs_f32s(self.value) }
    }

    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        count(1);
        F { simd: self.simd, value: self.simd.min_f32s(self.value, other.value) }
    }

    #[inline(always)]
    pub fn max(self, other: Self) -> Self {
        count(1);
        F { simd: self.simd, value: self.simd.max_f32s(self.value, other.value) }
    }

    /// `yes` in lanes where self > bound, else `no`.
    #[inline(always)]
    pub fn if_greater(self, bound: Self, yes: Self, no: Self) -> Self {
        let mask = self.simd.greater_than_f32s(self.value, bound.value);
        F { simd: self.simd, value: self.simd.select_f32s(mask, yes.value, no.value) }
    }
}

impl<S: Lanes> F<S> {
    /// Whether self > bound in any lane.
    #[inline(always)]
    pub fn any_greater(self, bound: Self) -> bool {
        self.simd.any(self.simd.greater_than_f32s(self.value, bound.value))
    }
}

/// What differs between the widths. `half` counts parts of a block of 16 lanes; nodes are rows of (x, y, z, 0).
pub(crate) trait Lanes: Simd {
    /// Whether a comparison holds in any lane.
    fn any(self, mask: Self::m32s) -> bool;
    /// The nodes of one corner of this half's tets, as lanes of x, y, z.
    fn gather<N: Nodes + ?Sized>(self, nodes: &N, corner: &[N::Number; LANES], half: usize) -> V3<Self>;
    /// Adds the forces on the four corners of this half's tets to their nodes, corner by corner, lane by lane, in groups of 8.
    fn scatter<N: Nodes + ?Sized>(self, nodes: &mut N, corners: &[[N::Number; LANES]; 4], half: usize, forces: &[V3<Self>; 4]);
}

impl Lanes for pulp::Scalar {
    #[inline(always)]
    fn any(self, mask: bool) -> bool {
        mask
    }

    #[inline(always)]
    fn gather<N: Nodes + ?Sized>(self, nodes: &N, corner: &[N::Number; LANES], half: usize) -> V3<Self> {
        let node = nodes.node(corner[half]);
        [F { simd: self, value: node[0] }, F { simd: self, value: node[1] }, F { simd: self, value: node[2] }]
    }

    #[inline(always)]
    fn scatter<N: Nodes + ?Sized>(self, nodes: &mut N, corners: &[[N::Number; LANES]; 4], half: usize, forces: &[V3<Self>; 4]) {
        for (corner, force) in corners.iter().zip(forces) {
            let node = nodes.node_mut(corner[half]);
            for axis in 0..3 {
                node[axis] += force[axis].value;
            }
        }
    }
}
