//! The statistics of a campaign: a bound on the faults that cost the hand something, beyond what the host's own noise does.
//!
//! Counts are tiny and mostly zero, so nothing here is approximated by a normal distribution. Of `n` faults, `worse` missed more ticks in
//! their window than in their control, `better` missed fewer: what is not the fault's doing falls on both alike. The figure is
//! `(worse − better) / n`: a fault counts once, however many ticks a burst of the host took. Its interval puts the ends of the exact
//! intervals of Clopper and Pearson ("The use of confidence or fiducial limits", Biometrika 1934) together, each end with 2.5 %: by
//! Bonferroni the truth lies above `upper95`, or below `lower95`, with at most 5 % each. That is conservative: it never promises too much.

use crate::faultfile::MOST_FAULTS;
use serde::{Deserialize, Serialize};

/// Of each end of either binomial.
const TAIL: f64 = 0.025;
/// Halvings of [0, 1]: to the last bit.
const HALVINGS: usize = 60;

/// Faults with excess misses, per fault.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Excess {
    /// Faults that were judged.
    pub faults: usize,
    /// Those that missed more than their control.
    pub worse: usize,
    /// Those that missed fewer.
    pub better: usize,
    /// `(worse − better) / faults`.
    pub mean: f64,
    /// Below this with at most 5 % doubt.
    pub lower95: f64,
    /// Above this with at most 5 % doubt.
    pub upper95: f64,
}

impl Excess {
    /// From the counts; without any fault nothing is known.
    pub fn of(faults: usize, worse: usize, better: usize) -> Excess {
        Excess {
            faults,
            worse,
            better,
            mean: (worse as f64 - better as f64) / faults.max(1) as f64,
            lower95: lower(worse, faults) - upper(better, faults),
            upper95: upper(worse, faults) - lower(better, faults),
        }
    }
}

/// Faults by the sign of their excess.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sides {
    faults: usize,
    worse: usize,
    better: usize,
}

impl Sides {
    /// Adds one.
    pub fn add(&mut self, excess: i64) {
        self.faults += 1;
        self.worse += usize::from(excess > 0);
        self.better += usize::from(excess < 0);
    }
    /// Their excess.
    pub fn excess(&self) -> Excess {
        Excess::of(self.faults, self.worse, self.better)
    }
}

/// Fewest faults that can show a limit of the upper end: so many without an excess miss. `None` for a limit of 0 or less, which nothing can show.
pub fn least_faults(limit_upper95: f64) -> Option<usize> {
    let within = |faults: &usize| upper(0, *faults) <= limit_upper95;
    let (mut too_few, mut enough) = (0, 1);
    while !within(&enough) {
        (too_few, enough) = (enough, enough * 2);
        if enough > MOST_FAULTS {
            return None;
        }
    }
    while enough - too_few > 1 {
        let middle = too_few.midpoint(enough);
        if within(&middle) { enough = middle } else { too_few = middle }
    }
    Some(enough)
}

/// P(X ≤ k) of a binomial distribution.
fn at_most(k: usize, n: usize, p: f64) -> f64 {
    let mut ln_choose = 0.0;
    let mut sum = 0.0;
    for i in 0..=k.min(n) {
        sum += (ln_choose + i as f64 * p.ln() + (n - i) as f64 * (-p).ln_1p()).exp();
        ln_choose += ((n - i) as f64 / (i + 1) as f64).ln();
    }
    sum
}

/// Upper end for `k` of `n`.
fn upper(k: usize, n: usize) -> f64 {
    if k >= n {
        return 1.0;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if at_most(k, n, middle) > TAIL { low = middle } else { high = middle }
    }
    high
}

/// Lower end for `k` of `n`.
fn lower(k: usize, n: usize) -> f64 {
    if n == 0 { 0.0 } else { 1.0 - upper(n - k.min(n), n) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: f64, b: f64) {
        assert!((a - b).abs() < 1e-6, "{a} is not {b}");
    }

    #[test]
    fn the_ends_by_hand() {
        // No success: (1 − p)^n = 0.025.
        near(upper(0, 300), 1.0 - 0.025f64.powf(1.0 / 300.0));
        near(lower(10, 10), 0.025f64.powf(0.1));
        // One of two: (1 − p)² + 2 p (1 − p) = 1 − p² = 0.025.
        near(upper(1, 2), 0.975f64.sqrt());
        near(lower(1, 2), 1.0 - 0.975f64.sqrt());
        // Clopper and Pearson's table: 5 of 10.
        assert!((lower(5, 10) - 0.1871).abs() < 1e-4 && (upper(5, 10) - 0.8129).abs() < 1e-4);
        assert_eq!((lower(0, 7), upper(7, 7), lower(0, 0), upper(0, 0)), (0.0, 1.0, 0.0, 1.0));
    }

    #[test]
    fn a_limit_takes_so_many_faults() {
        // (1 − limit)^n ≤ 0.025: 71.9, 182.6, 1.
        assert_eq!([0.05, 0.02, 1.0].map(least_faults), [Some(72), Some(183), Some(1)]);
        assert_eq!([0.0, -1.0, f64::NAN].map(least_faults), [None; 3]);
        for (limit, least) in [(0.05, 72), (0.3, 11)] {
            assert!(Excess::of(least, 0, 0).upper95 <= limit && Excess::of(least - 1, 0, 0).upper95 > limit);
        }
    }

    #[test]
    fn the_excess_by_hand() {
        let none = Excess::of(300, 0, 0);
        near(none.upper95, 0.012221);
        near(none.lower95, -0.012221);
        let one = Excess::of(2, 1, 1);
        near(one.mean, 0.0);
        near(one.upper95, 0.975f64.sqrt() - (1.0 - 0.975f64.sqrt()));
        assert_eq!((Excess::of(0, 0, 0).upper95, Excess::of(0, 0, 0).lower95), (1.0, -1.0), "nothing is known");
        let all = Excess::of(4, 4, 0);
        assert!(all.lower95 < all.mean && all.lower95 > -0.21 && all.upper95 == 1.0);
        near(all.lower95, 0.025f64.powf(0.25) - (1.0 - 0.025f64.powf(0.25)));
    }

    #[test]
    fn noise_that_falls_on_both_arms_is_no_excess_and_a_real_one_is_seen() {
        assert!(Excess::of(300, 9, 9).lower95 < 0.0);
        assert!(Excess::of(300, 60, 3).lower95 > 0.1);
        // More faults, narrower.
        assert!(Excess::of(3_000, 10, 10).upper95 < Excess::of(300, 1, 1).upper95);
    }

    #[test]
    fn large_counts_stay_finite() {
        let many = Excess::of(100_000, 50_000, 20);
        assert!(many.lower95 > 0.49 && many.upper95 < 0.51, "{many:?}");
    }
}
