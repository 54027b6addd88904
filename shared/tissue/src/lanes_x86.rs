//! Gather and scatter with AVX2 (8 lanes) and AVX-512 (16 lanes), through pulp's tokens: 4×4 transpositions of node rows.
//!
//! Promise: as in [`lanes`](crate::lanes); both add to the nodes in the same order.

use crate::lanes::{F, Lanes, V3 as Vector};
use crate::layout::{LANES, Nodes};
use bytemuck::cast;
use pulp::x86::{V3, V4};
use std::arch::x86_64::{__m128, __m256, __m256d, __m512, __m512d};
use std::hint::black_box;

#[inline(always)]
fn row<N: Nodes + ?Sized>(nodes: &N, node: N::Number) -> __m128 {
    cast(*nodes.node(node))
}

#[inline(always)]
fn add_row<N: Nodes + ?Sized>(simd: V3, nodes: &mut N, node: N::Number, force: __m128) {
    let sum = nodes.node_mut(node);
    *sum = cast(simd.sse._mm_add_ps(cast(*sum), force));
}

/// The numbers of the corners, to be read again: those of a gather are more than there are registers for, and what the compiler knows to be the same it writes
/// to the stack, one by one, and reads from there.
#[inline(always)]
fn again<T>(corners: &T) -> &T {
    black_box(corners)
}

impl Lanes for V3 {
    #[inline(always)]
    fn any(self, mask: Self::m32s) -> bool {
        self.avx._mm256_movemask_ps(cast(mask)) != 0
    }

    #[inline(always)]
    fn gather<N: Nodes + ?Sized>(self, nodes: &N, corner: &[N::Number; LANES], half: usize) -> Vector<Self> {
        let avx = self.avx;
        let mut rows: [__m256; 4] = [cast([0.0f32; 8]); 4];
        for (lane, pair) in rows.iter_mut().enumerate() {
            let low = avx._mm256_castps128_ps256(row(nodes, corner[8 * half + lane]));
            *pair = avx._mm256_insertf128_ps::<1>(low, row(nodes, corner[8 * half + lane + 4]));
        }
        let xy_low: __m256d = cast(avx._mm256_unpacklo_ps(rows[0], rows[1]));
        let xy_high: __m256d = cast(avx._mm256_unpacklo_ps(rows[2], rows[3]));
        let z_low: __m256d = cast(avx._mm256_unpackhi_ps(rows[0], rows[1]));
        let z_high: __m256d = cast(avx._mm256_unpackhi_ps(rows[2], rows[3]));
        [
            F { simd: self, value: cast(avx._mm256_unpacklo_pd(xy_low, xy_high)) },
            F { simd: self, value: cast(avx._mm256_unpackhi_pd(xy_low, xy_high)) },
            F { simd: self, value: cast(avx._mm256_unpacklo_pd(z_low, z_high)) },
        ]
    }

    #[inline(always)]
    fn scatter<N: Nodes + ?Sized>(
        self,
        nodes: &mut N,
        corners: &[[N::Number; LANES]; 4],
        half: usize,
        forces: &[Vector<Self>; 4],
    ) {
        let (avx, corners) = (self.avx, again(corners));
        let zero: __m256 = cast([0.0f32; 8]);
        for corner in 0..4 {
            let [x, y, z]: [__m256; 3] =
                [cast(forces[corner][0].value), cast(forces[corner][1].value), cast(forces[corner][2].value)];
            let xy_low: __m256d = cast(avx._mm256_unpacklo_ps(x, y));
            let xy_high: __m256d = cast(avx._mm256_unpackhi_ps(x, y));
            let z_low: __m256d = cast(avx._mm256_unpacklo_ps(z, zero));
            let z_high: __m256d = cast(avx._mm256_unpackhi_ps(z, zero));
            let rows: [__m256; 4] = [
                cast(avx._mm256_unpacklo_pd(xy_low, z_low)),
                cast(avx._mm256_unpackhi_pd(xy_low, z_low)),
                cast(avx._mm256_unpacklo_pd(xy_high, z_high)),
                cast(avx._mm256_unpackhi_pd(xy_high, z_high)),
            ];
            for (lane, pair) in rows.iter().enumerate() {
                add_row(self, nodes, corners[corner][8 * half + lane], avx._mm256_castps256_ps128(*pair));
            }
            for (lane, pair) in rows.iter().enumerate() {
                add_row(self, nodes, corners[corner][8 * half + lane + 4], avx._mm256_extractf128_ps::<1>(*pair));
            }
        }
    }
}

impl Lanes for V4 {
    #[inline(always)]
    fn any(self, mask: Self::m32s) -> bool {
        mask.0 != 0
    }

    #[inline(always)]
    fn gather<N: Nodes + ?Sized>(self, nodes: &N, corner: &[N::Number; LANES], _half: usize) -> Vector<Self> {
        let avx = self.avx512f;
        let mut rows: [__m512; 4] = [cast([0.0f32; 16]); 4];
        for (lane, quad) in rows.iter_mut().enumerate() {
            let one = avx._mm512_castps128_ps512(row(nodes, corner[lane]));
            let two = avx._mm512_insertf32x4::<1>(one, row(nodes, corner[lane + 4]));
            let three = avx._mm512_insertf32x4::<2>(two, row(nodes, corner[lane + 8]));
            *quad = avx._mm512_insertf32x4::<3>(three, row(nodes, corner[lane + 12]));
        }
        let xy_low: __m512d = cast(avx._mm512_unpacklo_ps(rows[0], rows[1]));
        let xy_high: __m512d = cast(avx._mm512_unpacklo_ps(rows[2], rows[3]));
        let z_low: __m512d = cast(avx._mm512_unpackhi_ps(rows[0], rows[1]));
        let z_high: __m512d = cast(avx._mm512_unpackhi_ps(rows[2], rows[3]));
        [
            F { simd: self, value: cast(avx._mm512_unpacklo_pd(xy_low, xy_high)) },
            F { simd: self, value: cast(avx._mm512_unpackhi_pd(xy_low, xy_high)) },
            F { simd: self, value: cast(avx._mm512_unpacklo_pd(z_low, z_high)) },
        ]
    }

    #[inline(always)]
    fn scatter<N: Nodes + ?Sized>(
        self,
        nodes: &mut N,
        corners: &[[N::Number; LANES]; 4],
        _half: usize,
        forces: &[Vector<Self>; 4],
    ) {
        let (avx, corners) = (self.avx512f, again(corners));
        let zero: __m512 = cast([0.0f32; 16]);
        let mut rows = [[zero; 4]; 4];
        for corner in 0..4 {
            let [x, y, z]: [__m512; 3] =
                [cast(forces[corner][0].value), cast(forces[corner][1].value), cast(forces[corner][2].value)];
            let xy_low: __m512d = cast(avx._mm512_unpacklo_ps(x, y));
            let xy_high: __m512d = cast(avx._mm512_unpackhi_ps(x, y));
            let z_low: __m512d = cast(avx._mm512_unpacklo_ps(z, zero));
            let z_high: __m512d = cast(avx._mm512_unpackhi_ps(z, zero));
            rows[corner] = [
                cast(avx._mm512_unpacklo_pd(xy_low, z_low)),
                cast(avx._mm512_unpackhi_pd(xy_low, z_low)),
                cast(avx._mm512_unpacklo_pd(xy_high, z_high)),
                cast(avx._mm512_unpackhi_pd(xy_high, z_high)),
            ];
        }
        // The order of AVX2: lanes 0 to 7 of all corners, then lanes 8 to 15.
        for corner in 0..4 {
            for (lane, quad) in rows[corner].iter().enumerate() {
                add_row(*self, nodes, corners[corner][lane], avx._mm512_castps512_ps128(*quad));
            }
            for (lane, quad) in rows[corner].iter().enumerate() {
                add_row(*self, nodes, corners[corner][lane + 4], avx._mm512_extractf32x4_ps::<1>(*quad));
            }
        }
        for corner in 0..4 {
            for (lane, quad) in rows[corner].iter().enumerate() {
                add_row(*self, nodes, corners[corner][lane + 8], avx._mm512_extractf32x4_ps::<2>(*quad));
            }
            for (lane, quad) in rows[corner].iter().enumerate() {
                add_row(*self, nodes, corners[corner][lane + 12], avx._mm512_extractf32x4_ps::<3>(*quad));
            }
        }
    }
}
