//! Windows beside controls that are of no campaign, as the tests take them of swaps: judged as the faults of a campaign's pool are. All are of one station, so
//! that the mean of what they cost is bounded pair by pair.

pub use crate::campaign::file::DEFAULT_LIMIT;
pub use crate::ledger::{AFTERMATH_TICKS, Window};

use super::figures::{Figures, Sums, Verdict};
use super::take::compared;
use super::verdict::{by_limit, said, unlike};
use crate::campaign::file::MOST_VOID;

/// The figures of these pairs, a window and its control each, of which each window may cost so many ticks, and the verdict that they give on a limit of the
/// share of those that cost more: a campaign's, but that no single one breaks it.
pub fn of_pairs(name: &str, pairs: &[[Window; 2]], allowed_misses: u64, limit: f64) -> Figures {
    let (name, planned, limit_upper95) = (name.to_string(), pairs.len(), Some(limit));
    let mut figures = Figures { name, judged: true, planned, allowed_misses, limit_upper95, ..Figures::default() };
    let mut sums = Sums::default();
    for [window, control] in pairs {
        figures.take_ticks(window, control);
        sums.take(0, compared(window, control, allowed_misses), &mut figures);
    }
    sums.close(&mut figures);
    figures.verdict = by_limit(&figures, limit, MOST_VOID);
    if figures.verdict != Verdict::Held {
        let with_void = figures.excess_with_void.map(|excess| said("with void ticks", &excess));
        let unlike = unlike(&figures, limit).map(|unlike| unlike.words(&figures));
        figures.reasons.extend(with_void.into_iter().chain(unlike));
    }
    figures
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::bounds::least_faults;

    /// One of 3 s that missed so many ticks.
    fn window(missed: u64) -> Window {
        Window { to_tick: 3_000, ticks: 3_000, missed, late: missed, ..Window::default() }
    }

    /// Of so many pairs the first few, each of which lost so many in its window and in its control.
    fn pairs(count: usize, first: usize, lost: [u64; 2]) -> Vec<[Window; 2]> {
        (0..count).map(|at| if at < first { lost.map(window) } else { [0; 2].map(window) }).collect()
    }

    fn judged(pairs: &[[Window; 2]], allowed_misses: u64) -> Figures {
        of_pairs("swaps", pairs, allowed_misses, DEFAULT_LIMIT)
    }

    #[test]
    fn so_many_pairs_without_a_loss_hold_the_limit_and_one_less_does_not() {
        let least = least_faults(DEFAULT_LIMIT).unwrap();
        let found = [least, least - 1, 0].map(|count| judged(&pairs(count, 0, [0, 0]), 0));
        assert_eq!(found.each_ref().map(|figures| figures.verdict), [Verdict::Held, Verdict::Unknown, Verdict::Unknown]);
        assert!(least <= 60 && found[0].excess.is_some_and(|excess| excess.upper95 <= DEFAULT_LIMIT));
        assert!(found[0].mean_beyond_misses_upper95 == Some(0.0) && found[0].reasons.is_empty(), "{:?}", found[0]);
        assert_eq!((found[2].planned, found[2].excess), (0, None), "of none nothing is known");
    }

    #[test]
    fn a_pair_is_worse_or_better_by_its_own_control_and_counts_once() {
        let mut all = pairs(60, 3, [7, 2]);
        all[10] = [0, 4].map(window);
        all[20] = [9, 9].map(window);
        let figures = judged(&all, 0);
        let excess = figures.excess.unwrap();
        assert_eq!((excess.faults, excess.worse, excess.better, figures.missed), (60, 3, 1, [30, 19]));
        assert_eq!((figures.mean_beyond_misses(), figures.verdict), (11.0 / 60.0, Verdict::Unknown), "(3 · 5 − 4) / 60");
        assert_eq!(judged(&pairs(60, 60, [3, 3]), 0).verdict, Verdict::Held, "what falls on both alike is the host's");
        assert_eq!(judged(&pairs(60, 30, [1, 0]), 0).verdict, Verdict::Broken);
    }

    #[test]
    fn what_may_cost_some_ticks_is_worse_only_beyond_them() {
        let verdicts = [20, 21].map(|lost| judged(&pairs(60, 30, [lost, 0]), 20).verdict);
        assert_eq!(verdicts, [Verdict::Held, Verdict::Broken]);
    }

    #[test]
    fn few_that_cost_much_are_not_held_by_their_share() {
        let figures = judged(&pairs(200, 1, [40, 0]), 0);
        assert!(figures.excess.is_some_and(|excess| excess.upper95 <= DEFAULT_LIMIT), "{figures:?}");
        assert_eq!(figures.verdict, Verdict::Unknown);
        assert!(figures.reasons.iter().any(|reason| reason.contains("0.2000, with 95 % below")), "{:?}", figures.reasons);
    }

    #[test]
    fn what_is_void_or_has_gaps_does_not_count_and_too_much_of_it_holds_nothing() {
        let void = Window { ticks: 2_300, voided: 700, ..window(0) };
        let gaps = Window { ticks: 2_900, ..window(0) };
        let with = |other: [Window; 2], count: usize| {
            let all: Vec<[Window; 2]> = pairs(60, 0, [0, 0]).into_iter().chain(vec![other; count]).collect();
            let figures = judged(&all, 0);
            (figures.excess.unwrap().faults, figures.without_verdict, figures.verdict)
        };
        for other in [[void, window(0)], [window(0), void], [gaps, window(0)], [window(0), gaps]] {
            assert_eq!(with(other, 10), (60, 10, Verdict::Held));
            assert_eq!(with(other, 20), (60, 20, Verdict::Unknown), "a quarter of all");
        }
    }

    #[test]
    fn void_ticks_that_are_late_speak_against_it_and_hold_nothing() {
        let late = |late: u64| Window { ticks: 2_990, voided: 10, late, ..window(0) };
        let all: Vec<[Window; 2]> = (0..60).map(|at| [late(if at < 30 { 3 } else { 0 }), late(0)]).collect();
        let figures = judged(&all, 0);
        assert_eq!((figures.excess.unwrap().worse, figures.verdict), (0, Verdict::Broken));
        assert!(figures.reasons[0].starts_with("with void ticks: 0.5000"), "{:?}", figures.reasons);
        assert_eq!((figures.window_ticks, figures.control_ticks), ([179_400, 600], [179_400, 600]));
    }
}
