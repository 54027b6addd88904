//! How far the excesses of two campaigns are from each other. Their faults are others, so that nothing is paired between them: each excess is bounded by
//! itself, as in its own campaign ([`super::paired`]), and the difference lies between what the two bounds leave.
//!
//! Promise: the truth lies above `upper95`, or below `lower95`, in at most 5 of 100 comparisons each, whatever the chances are (a test adds them up). The
//! two campaigns are independent: bounds that hold with √0.95 each hold together with 95 %. Where both have as many faults that differ, the difference would
//! have narrower ones, by up to 1.7 times.

use super::paired::{DOUBT, upper_but_for};
use super::{DOUBT_OF_CELL, Excess};
use serde::Serialize;

/// What two excesses differ by: the second less the first.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// As it was seen.
    pub mean: f64,
    /// Below this with at most 5 % doubt.
    pub lower95: f64,
    /// Above this with at most 5 % doubt.
    pub upper95: f64,
}

/// What is beyond doubt of the second of two.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Told {
    /// More of its faults cost the hand something.
    Worse,
    /// Fewer.
    Better,
}

impl Difference {
    /// Of the excesses of two campaigns.
    pub fn of(first: &Excess, second: &Excess) -> Difference {
        let [lower95, upper95] = between(first, second, DOUBT);
        Difference { mean: second.mean - first.mean, lower95, upper95 }
    }
}

/// Whether one of them is worse beyond doubt. A cell is one of up to a hundred, of which five would be told by chance with 5 % of doubt each: it is told with
/// a thousandth, as one that breaks its pool's promise by itself.
pub fn told(first: &Excess, second: &Excess, is_cell: bool) -> Option<Told> {
    let [lower, upper] = between(first, second, if is_cell { DOUBT_OF_CELL } else { DOUBT });
    match () {
        () if lower > 0.0 => Some(Told::Worse),
        () if upper < 0.0 => Some(Told::Better),
        () => None,
    }
}

/// Below the first and above the second of these lies the difference with at most this doubt each.
fn between(first: &Excess, second: &Excess, doubt: f64) -> [f64; 2] {
    let of_each = 1.0 - (1.0 - doubt).sqrt();
    left_by(ends(first, of_each), ends(second, of_each))
}

/// Below the first and above the second of these lies an excess with at most this doubt each.
fn ends(excess: &Excess, doubt: f64) -> [f64; 2] {
    let Excess { faults, worse, better, .. } = *excess;
    [-upper_but_for(faults, better, worse, doubt), upper_but_for(faults, worse, better, doubt)]
}

/// The least and the most that the second can be above the first.
fn left_by(first: [f64; 2], second: [f64; 2]) -> [f64; 2] {
    [second[0] - first[1], second[1] - first[0]]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The counts alone.
    fn seen(faults: usize, worse: usize, better: usize) -> Excess {
        let mean = (worse as f64 - better as f64) / faults as f64;
        Excess { faults, worse, better, mean, lower95: 0.0, upper95: 0.0 }
    }

    #[test]
    fn a_difference_by_hand_and_the_other_way_round() {
        // None of 100 in both: what each may be is below 1 − 0.0248^(1/100), about 0.036, and above minus that.
        let none = Difference::of(&seen(100, 0, 0), &seen(100, 0, 0));
        assert!(none.mean == 0.0 && (0.07..0.085).contains(&none.upper95), "{none:?}");
        assert!((none.lower95 + none.upper95).abs() < 1e-9, "{none:?}");
        let (here, there) =
            (Difference::of(&seen(90, 3, 1), &seen(120, 20, 2)), Difference::of(&seen(120, 20, 2), &seen(90, 3, 1)));
        assert!((here.mean + there.mean).abs() < 1e-12, "{here:?} {there:?}");
        assert_eq!((here.lower95, here.upper95), (-there.upper95, -there.lower95));
        assert!(here.lower95 < here.mean && here.mean < here.upper95);
    }

    #[test]
    fn a_pool_is_told_with_five_of_a_hundred_and_a_cell_with_one_of_a_thousand() {
        let beside_none = |worse: usize| [true, false].map(|is_cell| told(&seen(60, 0, 0), &seen(60, worse, 0), is_cell));
        assert_eq!(beside_none(30), [Some(Told::Worse); 2]);
        assert_eq!(beside_none(9), [None, Some(Told::Worse)], "one of a hundred cells may be so by chance");
        assert_eq!(beside_none(1), [None; 2]);
        assert_eq!(told(&seen(60, 30, 0), &seen(60, 0, 0), true), Some(Told::Better));
        assert_eq!(told(&seen(300, 9, 9), &seen(300, 12, 9), false), None, "noise that falls on both alike");
    }

    #[test]
    fn the_truth_lies_beyond_a_bound_in_at_most_five_of_a_hundred_comparisons() {
        const N: usize = 20;
        let most = 12; // outcomes with more are less than 1e-4 of all
        let of_each = 1.0 - (1.0 - DOUBT).sqrt();
        let outcomes = (0..=most).flat_map(|worse| (0..=most - worse).map(move |better| (worse, better)));
        let bounds: Vec<(usize, usize, [f64; 2])> =
            outcomes.map(|(worse, better)| (worse, better, ends(&seen(N, worse, better), of_each))).collect();
        let chances = |[p, q]: [f64; 2]| -> Vec<f64> {
            let factorial = |n: usize| (1..=n).map(|i| i as f64).product::<f64>();
            let chance = |worse: usize, better: usize| {
                let rest = N - worse - better;
                let ways = factorial(N) / factorial(worse) / factorial(better) / factorial(rest);
                ways * p.powi(worse as i32) * q.powi(better as i32) * (1.0 - p - q).powi(rest as i32)
            };
            bounds.iter().map(|(worse, better, _)| chance(*worse, *better)).collect()
        };
        for (first, second) in [
            ([0.02, 0.02], [0.02, 0.02]),
            ([0.0, 0.0], [0.1, 0.0]),
            ([0.12, 0.05], [0.02, 0.02]),
            ([0.1, 0.1], [0.1, 0.1]),
            ([0.08, 0.0], [0.08, 0.0]),
        ] {
            let truth = (second[0] - second[1]) - (first[0] - first[1]);
            let mut wrong = [0.0; 2];
            for ((_, _, ends_of_first), chance_of_first) in bounds.iter().zip(chances(first)) {
                for ((_, _, ends_of_second), chance_of_second) in bounds.iter().zip(chances(second)) {
                    let [lower, upper] = left_by(*ends_of_first, *ends_of_second);
                    wrong[0] += if truth < lower { chance_of_first * chance_of_second } else { 0.0 };
                    wrong[1] += if truth > upper { chance_of_first * chance_of_second } else { 0.0 };
                }
            }
            assert!(wrong.iter().all(|chance| *chance <= DOUBT + 1e-4), "{first:?}, {second:?}: {wrong:?}");
        }
    }
}
