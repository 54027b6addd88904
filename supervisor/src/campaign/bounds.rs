//! The statistics of a campaign: a bound on the faults that cost the hand something, beyond what the host's own noise does.
//!
//! Counts are tiny and mostly zero, so nothing here is approximated by a normal distribution. Of `n` faults, `worse` missed more ticks in
//! their window than in their control, `better` missed fewer: what is not the fault's doing falls on both alike. The figure is
//! `(worse − better) / n`: a fault counts once, however many ticks a burst of the host took. The truth lies above `upper95`, or below `lower95`, with at
//! most 5 % each, by an exact test for pairs ([`paired`]); single proportions are bounded by Clopper and Pearson ("The use of confidence or fiducial
//! limits", Biometrika 1934).

mod difference;
mod paired;
mod spread;

pub use difference::{Difference, Told, told};
pub use spread::{mean_upper95, together};

use crate::faultfile::MOST_FAULTS;
use serde::{Deserialize, Serialize};

/// The same of what one cell of a pool says beyond doubt: a file has up to a hundred of them.
const DOUBT_OF_CELL: f64 = 0.001;
/// Halvings of [0, 1]: to the last bit.
const HALVINGS: usize = 60;

/// Faults with excess misses, per fault.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Excess {
    /// Faults that were judged.
    pub faults: usize,
    /// Those that missed more than their control and what they may cost.
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
            lower95: -paired::upper(faults, better, worse),
            upper95: paired::upper(faults, worse, better),
        }
    }

    /// Whether so many are worse that, with a thousandth of doubt, more are than this share beside the noise that falls on both sides alike, of which the better
    /// tell. For a cell of few faults [`Excess::lower95`] says little: of ten of which seven are worse it knows no more than that some are.
    pub fn is_far_above(&self, limit: f64) -> bool {
        lower(self.worse, self.faults, DOUBT_OF_CELL) > limit + upper(self.better, self.faults, 0.5)
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
    let within = |faults: &usize| paired::upper(*faults, 0, 0) <= limit_upper95;
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

/// Upper end for `k` of `n`, above which the truth lies with at most this doubt.
fn upper(k: usize, n: usize, doubt: f64) -> f64 {
    if k >= n {
        return 1.0;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if at_most(k, n, middle) > doubt { low = middle } else { high = middle }
    }
    high
}

/// Lower end for `k` of `n`.
fn lower(k: usize, n: usize, doubt: f64) -> f64 {
    if n == 0 { 0.0 } else { 1.0 - upper(n - k.min(n), n, doubt) }
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
        near(upper(0, 300, 0.025), 1.0 - 0.025f64.powf(1.0 / 300.0));
        near(lower(10, 10, 0.025), 0.025f64.powf(0.1));
        // One of two: (1 − p)² + 2 p (1 − p) = 1 − p² = 0.025.
        near(upper(1, 2, 0.025), 0.975f64.sqrt());
        near(lower(1, 2, 0.025), 1.0 - 0.975f64.sqrt());
        // Clopper and Pearson's table: 5 of 10.
        assert!((lower(5, 10, 0.025) - 0.1871).abs() < 1e-4 && (upper(5, 10, 0.025) - 0.8129).abs() < 1e-4);
        let nothing = [lower(0, 7, 0.025), upper(7, 7, 0.025), lower(0, 0, 0.025), upper(0, 0, 0.025)];
        assert_eq!(nothing, [0.0, 1.0, 0.0, 1.0]);
    }

    #[test]
    fn a_limit_takes_so_many_faults() {
        // About (1 − limit)^n ≤ 0.049: 58.8, 149.3, 1.
        for (limit, about) in [(0.05, 59..70), (0.02, 150..175), (1.0, 1..2)] {
            let least = least_faults(limit).unwrap();
            assert!(about.contains(&least), "{limit}: {least}");
            assert!(Excess::of(least, 0, 0).upper95 <= limit && (least == 1 || Excess::of(least - 1, 0, 0).upper95 > limit));
        }
        assert_eq!([0.0, -1.0, f64::NAN].map(least_faults), [None; 3]);
    }

    #[test]
    fn both_ends_are_the_same_the_other_way_round() {
        let (here, there) = (Excess::of(120, 7, 3), Excess::of(120, 3, 7));
        assert_eq!((here.lower95, here.upper95, here.mean), (-there.upper95, -there.lower95, -there.mean));
        assert!(here.lower95 < here.mean && here.mean < here.upper95);
        assert_eq!((Excess::of(0, 0, 0).upper95, Excess::of(0, 0, 0).lower95), (1.0, -1.0), "nothing is known");
    }

    #[test]
    fn noise_that_falls_on_both_arms_is_no_excess_and_a_real_one_is_seen() {
        assert!(Excess::of(300, 9, 9).lower95 < 0.0);
        assert!(Excess::of(300, 60, 3).lower95 > 0.1);
        // More faults, narrower.
        assert!(Excess::of(3_000, 10, 10).upper95 < Excess::of(300, 1, 1).upper95);
    }

    /// By hand, of 10: P(6 or more worse) = 0.001 at 0.13, and half of such cells without a better one have a chance of 0.067 for it.
    #[test]
    fn few_of_few_are_beyond_doubt_and_few_of_many_are_not() {
        let far = |faults, worse, better| Excess::of(faults, worse, better).is_far_above(0.05);
        assert_eq!(
            [far(10, 6, 0), far(10, 4, 0), far(200, 12, 0), far(24, 14, 10), far(0, 0, 0)],
            [true, false, false, false, false]
        );
    }

    #[test]
    fn large_counts_stay_finite() {
        let many = Excess::of(20_000, 10_000, 20);
        assert!(many.lower95 > 0.48 && many.upper95 < 0.52, "{many:?}");
    }

    /// The heads of two files told of bounds that were not those of this formula.
    #[test]
    fn what_campaigns_say_that_so_many_faults_show_is_so() {
        let says = |name: &str, words: &str| {
            let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/campaigns").join(name);
            let text = std::fs::read_to_string(path).unwrap();
            assert!(text.contains(words), "{words:?} is not in {name}");
        };
        let with_one = (1..200).find(|faults| Excess::of(*faults, 1, 0).upper95 <= 0.05).unwrap();
        let without = least_faults(0.05).unwrap();
        let words = format!("{without} with a verdict and without an excess miss show the limit, {with_one} with a single one");
        says("full.toml", &words);
        says("quick.toml", &format!("of 12 without an excess miss up to {:.2} per fault", Excess::of(12, 0, 0).upper95));
    }
}
