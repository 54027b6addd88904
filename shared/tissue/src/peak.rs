//! The most arithmetic that a core does with an instruction set: chains of fused multiply-adds that stay in registers, for who times what the kernels do beside
//! it. Nothing here looks at a clock.

use crate::isa::Isa;
use crate::lanes::F;
use pulp::Simd;

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
