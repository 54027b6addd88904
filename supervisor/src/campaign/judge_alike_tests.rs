//! Where faults and controls are not alike but for the fault, or cells hide in their pools, nothing is held.

use super::tests::{all_of, setup};
use super::*;
use crate::campaign::text::text;
use crate::campaign::{html, junit};

const TEXT: &str = "[[pool]]\nname = \"all\"\nlimit_upper95 = 0.1\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"haptic:active\"]\ncount = 190\npool = \"all\"\n\
                    [[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid:active\"]\ncount = 10\npool = \"all\"\n";

/// The judgement of a pool of 200 faults after something was done to those of some numbers within their cell.
fn judged(change: impl Fn(&str, usize, &mut Outcome)) -> Judgement {
    let (campaign, plan, mut outcomes) = setup(TEXT);
    for cell in ["kill haptic:active", "kill fluid:active"] {
        let here = outcomes.iter_mut().filter(|outcome| outcome.cell == cell);
        here.enumerate().for_each(|(at, outcome)| change(cell, at, outcome));
    }
    let station = all_of(&campaign, &outcomes);
    judge(&campaign, &plan, &outcomes, &[station], None)
}

fn missed(outcome: &mut Outcome, in_window: u64, in_control: u64) {
    let fault = outcome.fault.as_mut().unwrap();
    fault.window.as_mut().unwrap().missed = in_window;
    fault.control.as_mut().unwrap().missed = in_control;
}

#[test]
fn a_cell_that_is_bad_by_itself_does_not_hide_in_its_pool() {
    let judgement = judged(|cell, at, outcome| {
        if cell == "kill fluid:active" && at < 7 {
            missed(outcome, 1, 0);
        }
    });
    let verdicts = [judgement.pools[0].verdict, judgement.cells[0].verdict, judgement.cells[1].verdict];
    assert_eq!(verdicts, [Verdict::Held, Verdict::Figures, Verdict::Broken], "{judgement:?}");
    assert_eq!(judgement.exit_code, 1);
    let said = &judgement.cells[1].reasons;
    assert!(said.iter().any(|reason| reason.contains("beyond doubt above its pool's limit")), "{said:?}");
}

#[test]
fn controls_that_lose_more_than_the_windows_with_a_fault_hold_nothing() {
    let judgement = judged(|_, at, outcome| missed(outcome, 0, u64::from(at % 8 == 0)));
    let pool = &judgement.pools[0];
    assert!(pool.excess.unwrap().upper95 < 0.0 && pool.verdict == Verdict::Unknown, "{pool:?}");
    assert!(pool.reasons.iter().any(|reason| reason.contains("not alike")), "{:?}", pool.reasons);
}

#[test]
fn those_with_a_control_in_the_same_state_must_hold_the_limit_too() {
    let unlike = |among_the_alike: bool| {
        judged(|_, at, outcome| {
            let is_unlike = at % 2 == 0;
            outcome.fault.as_mut().unwrap().control_unlike = is_unlike;
            if is_unlike != among_the_alike && at % 20 < 2 {
                missed(outcome, 1, 0);
            }
        })
    };
    assert_eq!([true, false].map(|among_the_alike| unlike(among_the_alike).pools[0].verdict), [Verdict::Unknown, Verdict::Held]);
    let alike = unlike(true).pools[0].excess_alike.unwrap();
    assert_eq!((alike.faults, alike.worse), (100, 11), "one of them of the fluid's");
}

#[test]
fn a_cell_of_which_most_faults_have_no_verdict_is_not_known() {
    let judgement = judged(|cell, at, outcome| {
        if cell == "kill fluid:active" && at < 6 {
            outcome.fault.as_mut().unwrap().control_early = true;
        }
    });
    let cell = &judgement.cells[1];
    assert_eq!((cell.verdict, cell.without_verdict, cell.seen["control in the first seconds"]), (Verdict::Unknown, 6, 6));
    assert_eq!(judgement.exit_code, 3);
}

#[test]
fn faults_that_differ_together_in_one_station_hold_nothing() {
    let spread = |bad: usize| {
        judged(|_, at, outcome| {
            outcome.station = at % 5;
            let is_bad = if bad < 5 { at % 5 == bad && at < 100 } else { at < 20 };
            if is_bad {
                missed(outcome, u64::from(at % 2 == 0), u64::from(at % 2 == 1));
            }
        })
    };
    let together = spread(3);
    assert_eq!(
        (together.pools[0].together_in, together.pools[0].verdict),
        (Some(3), Verdict::Unknown),
        "{:?}",
        together.pools[0]
    );
    assert_eq!((spread(5).pools[0].together_in, spread(5).pools[0].verdict), (None, Verdict::Held));
}

/// A fault counted once, however many ticks it cost: of 200 four that cost 12 each held a limit of 0.1 ticks for each fault.
#[test]
fn few_faults_that_each_cost_many_ticks_hold_nothing_and_as_few_that_cost_one_do() {
    let costing = |ticks: u64, stations: usize| {
        judged(|cell, at, outcome| {
            outcome.station = at % stations;
            if cell == "kill haptic:active" && at % 50 == 7 {
                missed(outcome, ticks, 0);
            }
        })
    };
    // Of one station and of two, too, of which each fault is drawn by itself.
    for stations in [1, 2, 7] {
        let (dear, cheap) = (costing(12, stations), costing(1, stations));
        let [pool, other] = [&dear.pools[0], &cheap.pools[0]];
        assert!(pool.excess.unwrap().worse == 4 && pool.excess.unwrap().upper95 <= 0.1, "{pool:?}");
        assert_eq!((pool.verdict, dear.exit_code), (Verdict::Unknown, 3), "{pool:?}");
        assert!(pool.mean_beyond_misses_upper95.unwrap() > 0.24, "more than the mean: {pool:?}");
        assert_eq!((other.verdict, cheap.exit_code), (Verdict::Held, 0), "{other:?}");
        let reason = "ticks beyond their controls' and what they may cost, per fault: 0.2400, with 95 % below ";
        assert!(pool.reasons.iter().any(|line| line.starts_with(reason)), "{:?}", pool.reasons);
        let whole = pool.reasons.iter().find(|line| line.starts_with(reason)).map(|line| hyst_assessment::escape(line)).unwrap();
        let reports = [junit::junit(&dear), html::html(&dear, &[], &[])];
        assert!(text(&dear).contains(reason) && reports.iter().all(|report| report.contains(&whole)), "{reports:?}");
    }
}

/// Of four stations that lost as much as each other the mean was bounded by itself, whatever a fifth might lose.
#[test]
fn of_few_stations_that_are_alike_the_mean_is_bounded_by_their_faults() {
    let judgement = judged(|cell, at, outcome| {
        outcome.station = at % 4;
        if cell == "kill haptic:active" && at % 51 == 7 {
            missed(outcome, 4, 0); // one in each
        }
    });
    let pool = &judgement.pools[0];
    assert!(pool.mean_beyond_misses() <= 0.1 && pool.excess.unwrap().upper95 <= 0.1, "{pool:?}");
    assert!(pool.mean_beyond_misses_upper95.unwrap() > 0.12 && pool.verdict == Verdict::Unknown, "{pool:?}");
}

/// It stood there that with 95 % less than 0.00 ticks are lost, of as few faults as there were.
#[test]
fn where_no_fault_lost_a_tick_that_is_said_in_place_of_a_bound() {
    let reports = |in_window: u64, in_control: u64| {
        let judgement = judged(|_, at, outcome| {
            if at == 3 {
                missed(outcome, in_window, in_control);
            }
        });
        assert_eq!(judgement.pools[0].mean_excess_misses_upper95 > Some(0.0), in_window > 0, "{:?}", judgement.pools[0]);
        [text(&judgement), html::html(&judgement, &[], &[]), junit::junit(&judgement)]
    };
    assert!(reports(0, 0).iter().all(|report| report.contains("0.000 none lost")));
    assert!(reports(0, 1).iter().all(|report| report.contains("-0.010 none lost")), "they lost fewer than their controls");
    assert!(reports(1, 0).iter().all(|report| !report.contains("none lost")));
}

#[test]
fn what_faults_cost_within_what_they_may_is_in_no_mean_that_is_judged_and_what_is_beyond_it_is() {
    let cells = "[[pool]]\nname = \"all\"\nlimit_upper95 = 0.1\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"device\"]\ncount = 100\npool = \"all\"\n";
    let judged = |of_some: u64| {
        let (campaign, plan, mut outcomes) = setup(cells);
        for (at, outcome) in outcomes.iter_mut().enumerate() {
            outcome.station = at % 4;
            missed(outcome, if at < 3 { of_some } else { 8 }, 0);
        }
        let station = all_of(&campaign, &outcomes);
        judge(&campaign, &plan, &outcomes, &[station], None).pools.remove(0)
    };
    let [within, beyond] = [20, 34].map(judged);
    assert_eq!((within.verdict, within.mean_beyond_misses_upper95), (Verdict::Held, Some(0.0)), "{within:?}");
    assert!(within.mean_excess_misses.unwrap() > 8.0 && beyond.excess.unwrap().upper95 <= 0.1, "{beyond:?}");
    assert_eq!((beyond.verdict, beyond.beyond_misses[..4].to_vec()), (Verdict::Unknown, vec![14, 14, 14, 0]), "{beyond:?}");
}

#[test]
fn what_is_lost_right_after_a_window_is_the_faults() {
    let lost = |ticks: u64| {
        judged(|_, at, outcome| {
            let fault = outcome.fault.as_mut().unwrap();
            fault.aftermath =
                Some(crate::ledger::Window { ticks: 300, missed: if at == 4 { ticks } else { 0 }, ..Default::default() });
        })
    };
    assert_eq!([lost(20).exit_code, lost(21).exit_code], [0, 1]);
    assert_eq!(lost(21).pools[0].aftermath, [60_000, 42], "one of each cell");
}

#[test]
fn a_window_that_is_mostly_void_is_in_the_bound_with_the_void_ticks() {
    let judgement = judged(|_, _, outcome| {
        let fault = outcome.fault.as_mut().unwrap();
        let window = fault.window.as_mut().unwrap();
        (window.ticks, window.voided, window.late) = (100, 100, 90);
    });
    let pool = &judgement.pools[0];
    assert_eq!((pool.without_verdict, pool.excess_with_void.unwrap().worse), (200, 200));
    assert_eq!((pool.verdict, judgement.exit_code), (Verdict::Broken, 1));
}

/// Of a pool that too much was void of only its bounds were told, and these were within its limit.
#[test]
fn a_pool_of_which_too_many_faults_have_no_verdict_says_so() {
    let void = |count: usize| {
        judged(|cell, at, outcome| {
            if cell == "kill haptic:active" && at < count {
                outcome.fault.as_mut().unwrap().window.as_mut().unwrap().voided = 100;
            }
        })
    };
    let (few, many) = (void(40), void(41));
    assert_eq!((few.pools[0].verdict, few.pools[0].reasons.len()), (Verdict::Held, 0), "{:?}", few.pools[0]);
    let line = "41 of its 200 faults have no verdict: more than most_void = 0.2";
    assert_eq!((many.pools[0].verdict, many.pools[0].reasons.last().map(String::as_str)), (Verdict::Unknown, Some(line)));
    assert!(many.pools[0].excess.unwrap().upper95 <= 0.1 && text(&many).contains(&format!("station, all: {line}")));
}
