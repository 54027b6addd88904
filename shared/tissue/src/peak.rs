//! What the kernels do in operations, and the most of them that a core does with an instruction set: chains of fused multiply-adds that stay in registers, for
//! who times the kernels beside it. Nothing here looks at a clock.

use crate::isa::Isa;
use crate::lanes::F;
use pulp::Simd;

/// Operations for each tet in each evaluation of the forces (`kernel::element_forces`): edges 9, edges times Q 45, trace and pressure 7, the turned part 12,
/// the straight part 9, forces 99 and 6 for the first corner, sums at the nodes 12. A fused multiply-add counts as two, a quotient, a root, a least and a
/// greatest as one, a change of sign as none.
pub const FORCE_OPERATIONS: f64 = 199.0;
/// What each step does once beside that (`kernel::find_frame`): deformation 45, rotation 337 (`polar.rs`, all six of Newton's steps among them, of 15
/// operations each; 16 tets that are hardly strained take two or three), energy and what a rotation is free to do 93, Q and its factor 57.
pub const ROTATION_OPERATIONS: f64 = 532.0;

/// Chains beside each other: more than a multiply-add takes cycles times the units that a core has for them, and few enough for 16 registers.
const CHAINS: usize = 12;
/// What a sum is multiplied with each time: it comes to rest at twice what is added.
const FACTOR: f32 = 0.5;

struct Busy<S> {
    simd: S,
    rounds: u32,
}

impl<S: Simd> pulp::NullaryFnOnce for Busy<S> {
    type Output = f32;
    #[inline(always)]
    fn call(self) -> f32 {
        chains(self.simd, self.rounds)
    }
}

#[inline(always)]
fn chains<S: Simd>(simd: S, rounds: u32) -> f32 {
    let factor = F::splat(simd, FACTOR);
    let mut sums = [factor; CHAINS];
    // Each begins elsewhere, so that no two are one.
    sums.iter_mut().enumerate().for_each(|(chain, sum)| *sum = F::splat(simd, chain as f32));
    for _ in 0..rounds {
        for sum in &mut sums {
            *sum = sum.fma(factor, factor);
        }
    }
    let all = sums.into_iter().fold(F::splat(simd, 0.0), |all, sum| all + sum);
    simd.reduce_sum_f32s(all.value)
}

/// Does so many rounds; gives a number that depends on all of them. An instruction set that this machine has not is done without.
pub fn busy(isa: Isa, rounds: u32) -> f32 {
    match isa {
        Isa::Baseline => chains(pulp::Scalar::new(), rounds),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => match pulp::x86::V3::try_new() {
            Some(simd) => simd.vectorize(Busy { simd, rounds }),
            None => chains(pulp::Scalar::new(), rounds),
        },
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => match pulp::x86::V4::try_new() {
            Some(simd) => simd.vectorize(Busy { simd, rounds }),
            None => chains(pulp::Scalar::new(), rounds),
        },
        #[cfg(not(target_arch = "x86_64"))]
        _ => chains(pulp::Scalar::new(), rounds),
    }
}

/// Operations of so many rounds; a multiply-add is two.
pub fn operations(isa: Isa, rounds: u32) -> f64 {
    let lanes = match isa {
        Isa::Baseline => 1.0,
        Isa::Avx2 => 8.0,
        Isa::Avx512 => 16.0,
    };
    2.0 * lanes * CHAINS as f64 * f64::from(rounds)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::{Frame, element_forces, rotations_and_forces};
    use crate::lanes::counted::operations_of;
    use crate::layout::{Block, LANES, RestBlock};

    /// Sums at the nodes: three for each corner, which are made without lanes.
    const SUMS: f64 = 12.0;

    /// In tets that have collapsed into a point each of Newton's steps moves the root.
    #[test]
    fn the_kernels_do_as_many_operations_for_a_tet_as_is_said() {
        let (simd, position) = (pulp::Scalar::new(), [[0.0f32; 4]; 1]);
        let (corners, blocks, rest) = ([[[0u32; LANES]; 4]], [Block::ZERO], [RestBlock::ZERO]);
        let (mut frames, mut force) = ([Frame::ZERO], [[0.0f32; 4]; 1]);
        let first = operations_of(|| {
            let (position, force): (&[[f32; 4]], &mut [[f32; 4]]) = (&position, &mut force);
            rotations_and_forces(simd, &corners, (&blocks, &rest), position, (&mut frames, force));
        });
        let next = operations_of(|| {
            let (position, force): (&[[f32; 4]], &mut [[f32; 4]]) = (&position, &mut force);
            element_forces(simd, &corners, (&blocks, &frames), position, force);
        });
        let of_tet = |operations: u64| operations as f64 / LANES as f64 + SUMS;
        assert_eq!(of_tet(next), FORCE_OPERATIONS);
        assert_eq!(of_tet(first), FORCE_OPERATIONS + ROTATION_OPERATIONS);
    }

    #[test]
    fn every_chain_of_every_lane_is_done() {
        for isa in [Isa::Baseline, Isa::Avx2, Isa::Avx512].into_iter().filter(|isa| isa.available()) {
            let sums = operations(isa, 1) / 2.0;
            // Each comes from its own begin to twice the half that is added.
            assert!((f64::from(busy(isa, 100)) - sums).abs() < 1e-3, "{}: {} of {sums}", isa.name(), busy(isa, 100));
            let begun: f64 = (0..CHAINS).map(|chain| chain as f64).sum::<f64>() * sums / CHAINS as f64;
            assert_eq!(f64::from(busy(isa, 0)), begun, "{}", isa.name());
        }
    }
}
