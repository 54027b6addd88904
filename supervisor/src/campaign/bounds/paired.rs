//! How far the difference of two paired proportions may be from what was seen: exact, by Berger and Boos ("P values maximized over a confidence set for
//! the nuisance parameter", JASA 1994), with the order of outcomes of Tango's score ("Equivalence test and confidence interval for the difference in
//! proportions for the paired-sample design", Statistics in Medicine 1998).
//!
//! Of `n` pairs, `worse` fell on one side and `better` on the other. With the chances p and q of these, the figure is Δ = p − q, and what else is
//! unknown is how many pairs differ at all, ψ = p + q. A Δ is refused if, for every ψ that the count of differing pairs allows but for one doubt in a
//! thousand, an outcome that speaks for a smaller Δ at least as much as the one seen has a chance of less than 4.9 %: that doubt and this chance are the 5 %.
//!
//! Promise: the truth lies above `upper` in at most 5 of 100 campaigns, whatever p and q are (a test adds up the chances). Two intervals side by side, one
//! for each proportion, keep that promise too, and are half as wide again where noise falls on both sides.

use super::{lower, upper as upper_of_one};

/// Chance of being wrong.
pub(super) const DOUBT: f64 = 0.05;
/// The share of it that is spent on how many pairs differ: of 5 % one in a thousand.
const SHARE_PSI: f64 = 0.02;
/// Values of ψ that are tried: the chance changes slowly and smoothly with it.
const PSI_STEPS: usize = 24;
/// Values of Δ that are tried from above.
const DELTA_STEPS: usize = 48;
/// Halvings of the last step: a bound to 1e-6.
const HALVINGS: usize = 16;
/// Outcomes whose numbers of differing pairs lie this many standard deviations above the mean are left out: less than 1e-15 of all.
const DEVIATIONS: f64 = 9.0;
/// What is a distance of 1 without any deviation: more than any score.
const CERTAIN: f64 = 1e18;
/// Scores that differ by less are the same: rounding.
const SAME: f64 = 1e-9;

/// Above this Δ lies the truth with at most 5 % doubt.
pub fn upper(n: usize, worse: usize, better: usize) -> f64 {
    upper_but_for(n, worse, better, DOUBT)
}

/// The same with another doubt.
pub fn upper_but_for(n: usize, worse: usize, better: usize, doubt: f64) -> f64 {
    if n == 0 {
        return 1.0;
    }
    let differ = worse + better;
    let doubt_psi = SHARE_PSI * doubt;
    let psi = [lower(differ, n, 0.5 * doubt_psi), upper_of_one(differ, n, 0.5 * doubt_psi)];
    let seen = (worse as f64 - better as f64) / n as f64;
    let ln_factorials = ln_factorials(n);
    let is_refused = |delta: f64| largest_chance(n, [worse, better], delta, psi, &ln_factorials) + doubt_psi <= doubt;
    // Δ is never more than ψ, so above ψ's own bound all are refused.
    let step = (psi[1] - seen) / DELTA_STEPS as f64;
    let at = (1..DELTA_STEPS).find(|at| !is_refused(psi[1] - *at as f64 * step)).unwrap_or(DELTA_STEPS); // the last is what was seen
    let (mut possible, mut refused) = (psi[1] - at as f64 * step, psi[1] - (at - 1) as f64 * step);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (possible + refused);
        if is_refused(middle) { refused = middle } else { possible = middle }
    }
    refused
}

fn ln_factorials(n: usize) -> Vec<f64> {
    let mut sum = 0.0;
    (0..=n)
        .map(|i| {
            sum += (i.max(1) as f64).ln();
            sum
        })
        .collect()
}

/// The score of an outcome against Δ: its distance from Δ over the deviation that the likeliest p and q with that difference give it.
fn score(n: usize, [worse, better]: [usize; 2], delta: f64) -> f64 {
    let [n, b, c] = [n, worse, better].map(|count| count as f64);
    let linear = (2.0 * n - b + c) * delta - (b + c);
    let root = (linear * linear + 8.0 * n * c * delta * (1.0 - delta)).max(0.0).sqrt();
    let q = ((root - linear) / (4.0 * n)).max(0.0).max(-delta);
    let variance = n * (2.0 * q + delta - delta * delta);
    let distance = b - c - n * delta;
    if variance > 0.0 { distance / variance.sqrt() } else { distance * CERTAIN }
}

/// Over all ψ in the range: the largest chance of an outcome whose score is at most that of the one seen.
fn largest_chance(n: usize, seen: [usize; 2], delta: f64, psi: [f64; 2], ln_factorials: &[f64]) -> f64 {
    let [from, to] = [psi[0].max(delta.abs()), psi[1]];
    if from > to {
        return 0.0;
    }
    let mean = n as f64 * to;
    let most = ((mean + DEVIATIONS * (mean.max(1.0)).sqrt() + 2.0 * DEVIATIONS) as usize).min(n);
    let borders = borders(n, most, score(n, seen, delta) + SAME, delta);
    let at = |step: usize| from + (to - from) * step as f64 / (PSI_STEPS - 1) as f64;
    (0..PSI_STEPS).map(|step| chance(n, &borders, delta, at(step), ln_factorials)).fold(0.0, f64::max)
}

/// For each number of differing pairs: how many of the counts of the worse, from 0 on, have at most this score. One more pair that differs adds none
/// or one, for the score grows with the worse and falls with the better.
fn borders(n: usize, most: usize, score_at_most: f64, delta: f64) -> Vec<usize> {
    let mut count = 0;
    (0..=most)
        .map(|differ| {
            if count <= differ && score(n, [count, differ - count], delta) <= score_at_most {
                count += 1;
            }
            count
        })
        .collect()
}

/// The chance of an outcome below the borders.
fn chance(n: usize, borders: &[usize], delta: f64, psi: f64, ln_factorials: &[f64]) -> f64 {
    let ln_choose = |n: usize, k: usize| ln_factorials[n] - ln_factorials[k] - ln_factorials[n - k];
    let binomial = |k: usize, n: usize, p: f64| {
        let part = |count: usize, ln_p: f64| if count == 0 { 0.0 } else { count as f64 * ln_p };
        (ln_choose(n, k) + part(k, p.ln()) + part(n - k, (-p).ln_1p())).exp()
    };
    let theta = if psi > 0.0 { (0.5 * (1.0 + delta / psi)).clamp(0.0, 1.0) } else { 0.5 };
    // Of the chance that at most `count − 1` of `differ` are worse: from one line to the next by what crosses the border.
    let mut below = 0.0;
    let mut sum = 0.0;
    for (differ, &count) in borders.iter().enumerate() {
        let before = if differ == 0 { 0 } else { borders[differ - 1] };
        if differ > 0 && before > 0 && before <= differ {
            below -= theta * binomial(before - 1, differ - 1, theta);
        }
        if count > before {
            below += binomial(count - 1, differ, theta);
        }
        sum += binomial(differ, n, psi) * below;
    }
    sum.clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_score_by_hand() {
        // 3 worse, 1 better of 10 against 0: q = 0.2 = (3 + 1) / 20, deviation √(10 · 0.4).
        assert!((score(10, [3, 1], 0.0) - 2.0 / 4.0f64.sqrt()).abs() < 1e-12);
        // None of 10 against 0.1: p = 0.1, q = 0; −1 over √(10 · 0.09).
        assert!((score(10, [0, 0], 0.1) + 1.0 / 0.9f64.sqrt()).abs() < 1e-12);
        // The other way round it is the same with the other sign.
        for (worse, better, delta) in [(3, 1, 0.2), (0, 4, 0.3), (5, 5, -0.1)] {
            let (here, there) = (score(12, [worse, better], delta), score(12, [better, worse], -delta));
            assert!((here + there).abs() < 1e-9, "{here} {there}");
        }
    }

    #[test]
    fn a_chance_is_the_sum_over_the_outcomes() {
        let (n, delta, psi) = (9, 0.15, 0.4);
        let table = ln_factorials(n);
        let (p, q) = (0.5 * (psi + delta), 0.5 * (psi - delta));
        for seen in [[0, 0], [1, 2], [4, 1], [0, 5]] {
            let mut expected = 0.0;
            for worse in 0..=n {
                for better in 0..=n - worse {
                    if score(n, [worse, better], delta) <= score(n, seen, delta) + SAME {
                        let ln = table[n] - table[worse] - table[better] - table[n - worse - better];
                        let rest = (1.0 - p - q).powi((n - worse - better) as i32);
                        expected += ln.exp() * p.powi(worse as i32) * q.powi(better as i32) * rest;
                    }
                }
            }
            let found = chance(n, &borders(n, n, score(n, seen, delta) + SAME, delta), delta, psi, &table);
            assert!((found - expected).abs() < 1e-12, "{seen:?}: {found} is not {expected}");
        }
    }

    #[test]
    fn without_any_difference_the_bound_is_that_of_one_proportion() {
        for n in [50, 300] {
            let alone = 1.0 - 0.049f64.powf(1.0 / n as f64);
            let found = upper(n, 0, 0);
            assert!(found >= alone - 1e-4 && found < 1.15 * alone, "{n}: {found} beside {alone}");
        }
        assert_eq!(upper(0, 0, 0), 1.0);
        assert_eq!(upper(5, 5, 0), 1.0);
        // All five better: q⁵ = 0.049 with p = 1 − q, so Δ = 1 − 2q.
        let all_better = 1.0 - 2.0 * 0.049f64.powf(0.2);
        assert!((upper(5, 0, 5) - all_better).abs() < 1e-4, "{} is not {all_better}", upper(5, 0, 5));
    }

    #[test]
    fn the_truth_lies_above_in_at_most_five_of_a_hundred() {
        let n = 40;
        let table = ln_factorials(n);
        let most = 24; // outcomes with more are less than 1e-6 of all
        let outcomes = (0..=most).flat_map(|worse| (0..=most - worse).map(move |better| (worse, better)));
        let bounds: Vec<_> = outcomes.map(|(worse, better)| (worse, better, upper(n, worse, better))).collect();
        for (p, q) in [(0.01, 0.01), (0.05, 0.0), (0.08, 0.02), (0.1, 0.1), (0.02, 0.08), (0.12, 0.05), (0.03, 0.0), (0.07, 0.0)]
        {
            let mut wrong = 0.0;
            for &(worse, better, _) in bounds.iter().filter(|(_, _, bound)| *bound < p - q) {
                let rest = n - worse - better;
                let ln = table[n] - table[worse] - table[better] - table[rest];
                let better_part = if better == 0 { 1.0 } else { f64::powi(q, better as i32) };
                wrong += ln.exp() * f64::powi(p, worse as i32) * better_part * f64::powi(1.0 - p - q, rest as i32);
            }
            assert!(wrong <= DOUBT + 1e-6, "p {p}, q {q}: {wrong}");
        }
    }

    #[test]
    fn noise_on_both_sides_is_bounded_closer_than_by_two_intervals() {
        // The kills of other roles of a campaign: 20 and 17 of 940.
        let found = upper(940, 20, 17);
        let apart = upper_of_one(20, 940, 0.025) - lower(17, 940, 0.025);
        assert!((0.012..0.02).contains(&found) && apart > 0.02, "{found} beside {apart}");
    }
}
