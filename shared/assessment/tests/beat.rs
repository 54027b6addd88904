//! What the roller's beat in the cavity's pressure does to a judgement: nothing.
#![allow(missing_docs)]

#[allow(dead_code)] // each test file uses its part
mod fixture;

use fixture::{brief, fluid, record};
use hyst_assessment::Judge;
use serde_json::json;

/// So many seconds of a pressure with a roller's beat of 1.3 mmHg in it, to a judge that warns beyond 100 mmHg and below 40.
fn beats(judge: &mut Judge, since: u64, seconds: u64, mean_mmhg: f64, period_s: f64) {
    for tick in (since..since + 1_000 * seconds).step_by(25) {
        let phase = std::f64::consts::TAU * (tick - since) as f64 * 1e-3 / period_s;
        judge.fluid(&fluid(tick, (mean_mmhg + 1.3 * phase.sin()) as f32, 0.0));
        (tick..tick + 25).for_each(|tick| judge.tick(&record(tick, [0.0, 0.0, 0.02], 0.0)));
    }
}

#[test]
fn a_pressure_at_its_limit_is_warned_of_once_and_not_with_each_beat_of_the_roller() {
    const LIMITS_PA: [f64; 2] = [100.0 * 133.322, 40.0 * 133.322];
    let warns = || {
        let causes = json!([{ "pressure_above": LIMITS_PA[0] }, { "pressure_below": LIMITS_PA[1] }]);
        Judge::new(brief(json!([{ "removed": 1.0 }]), json!({}), causes, json!({})))
    };
    let counts = |judge: &Judge| [judge.warnings[0].count, judge.warnings[1].count];
    // A beat every 2.2 s, whose average goes by 0.45 mmHg to either side.
    let mut below = warns();
    beats(&mut below, 0, 30, 99.3, 2.2);
    assert_eq!(counts(&below), [0, 0], "the peaks are at 100.6");
    for period_s in [0.7, 2.2, 12.0] {
        let mut at_limit = warns();
        beats(&mut at_limit, 0, 60, 100.0, period_s);
        assert_eq!((counts(&at_limit), at_limit.warnings[0].stands), ([1, 0], true), "a beat every {period_s} s");
        // 99 mmHg is no end of it; 95 is, and then the limit is passed anew.
        beats(&mut at_limit, 60_000, 20, 99.0, period_s);
        assert!(at_limit.warnings[0].stands, "a beat every {period_s} s");
        beats(&mut at_limit, 80_000, 20, 94.0, period_s);
        assert!(!at_limit.warnings[0].stands, "a beat every {period_s} s");
        beats(&mut at_limit, 100_000, 20, 102.0, period_s);
        assert_eq!(counts(&at_limit), [2, 0], "a beat every {period_s} s");
        beats(&mut at_limit, 120_000, 60, 40.0, period_s);
        assert_eq!(counts(&at_limit), [2, 1], "a beat every {period_s} s");
    }
}
