//! Fault windows against control windows, as a run's report has them. The figure is that of a campaign (`campaign::bounds`): faults that lost more ticks than
//! their control less those that lost fewer, per fault, so that one burst of the host counts once, and its bounds are exact however few faults there are.
//!
//! The bounds of some hundred faults take milliseconds, for which no death may wait: whoever reads the report at the end adds them ([`bound_all`]).

use crate::campaign::bounds::Excess;
use crate::campaign::file::DEFAULT_LIMIT;
use crate::fault::Fault;
use crate::fault::compare::{excess, tells};
use crate::faultfile::MOST_FAULTS;
use serde_json::{Value, json};

/// Fault windows against control windows.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Arms {
    /// Ticks that count, those that missed, and those that are void, of the windows that are whole.
    pub fault: [u64; 3],
    /// The same of the controls.
    pub control: [u64; 3],
    /// Largest force step in those windows, N.
    pub step_n: f64,
    /// The same of the controls.
    pub control_step_n: f64,
    /// Misses of each fault beyond its control's, where both tell something.
    pub excesses: Vec<i64>,
}

impl Arms {
    pub(super) fn of<'a>(faults: impl Iterator<Item = &'a Fault>) -> Arms {
        let mut arms = Arms::default();
        for fault in faults {
            let Some((window, control)) =
                fault.window.zip(fault.control).filter(|(window, control)| window.is_whole() && control.is_whole())
            else {
                continue;
            };
            for (sums, window) in [(&mut arms.fault, window), (&mut arms.control, control)] {
                sums[0] += window.ticks;
                sums[1] += window.missed;
                sums[2] += window.voided;
            }
            arms.step_n = arms.step_n.max(window.force_step_max_n);
            arms.control_step_n = arms.control_step_n.max(control.force_step_max_n);
            if tells(&window) && tells(&control) {
                arms.excesses.push(excess(&window, &control));
            }
        }
        arms
    }

    /// Judged faults, those that lost more than their controls, and those that lost fewer.
    fn counts(&self) -> [usize; 3] {
        let of = |is: fn(&i64) -> bool| self.excesses.iter().filter(|excess| is(excess)).count();
        [self.excesses.len(), of(|excess| *excess > 0), of(|excess| *excess < 0)]
    }

    /// Faults with excess misses, per fault, still without its bounds.
    pub(super) fn excess(&self) -> Value {
        let [faults, worse, better] = self.counts();
        let per_fault = |sum: f64| sum / (faults as f64).max(1.0);
        json!({
            "mean": per_fault(worse as f64 - better as f64),
            "lower95": null,
            "upper95": null,
            "faults": faults,
            "faults_with_excess": worse,
            "faults_with_fewer": better,
            "mean_excess_misses": per_fault(self.excesses.iter().sum::<i64>() as f64),
        })
    }

    /// What they show beyond doubt of a promise that is broken, in words: even the lower bound is above what a campaign allows that says nothing else.
    pub(super) fn broken(&self) -> Option<String> {
        let [faults, worse, better] = self.counts();
        let is_broken = faults > 0 && Excess::of(faults, worse, better).lower95 > DEFAULT_LIMIT;
        is_broken.then(|| format!("of {faults} faults {worse} lost more ticks than their controls and {better} fewer"))
    }
}

/// Adds the bounds to all figures of a report.
pub(super) fn bound_all(report: &mut Value) {
    for place in ["/device/excess_per_fault", "/device/own_faults/excess_per_fault"] {
        report.pointer_mut(place).into_iter().for_each(bound);
    }
    report.get_mut("by_target").and_then(Value::as_object_mut).into_iter().flatten().for_each(|(_, row)| bound(row));
}

/// Adds the one-sided 95 % bounds, each alone, where there is a fault and the counts can be.
fn bound(figure: &mut Value) {
    let count = |key: &str| figure[key].as_u64().filter(|count| *count <= MOST_FAULTS as u64).map(|count| count as usize);
    let Some(counts) = count("faults").zip(count("faults_with_excess")).zip(count("faults_with_fewer")) else { return };
    let ((faults, worse), better) = counts;
    if faults > 0 && worse + better <= faults {
        let excess = Excess::of(faults, worse, better);
        (figure["lower95"], figure["upper95"]) = (json!(excess.lower95), json!(excess.upper95));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ledger::Window;

    fn fault(missed: u64, control: u64) -> Fault {
        let window = |missed| Some(Window { ticks: 200, missed, ..Window::default() });
        Fault { target: "haptic:0".into(), window: window(missed), control: window(control), ..Fault::default() }
    }

    #[test]
    fn the_excess_by_hand() {
        let faults = [fault(3, 1), fault(0, 0), fault(0, 1), fault(1, 0)];
        let arms = Arms::of(faults.iter());
        assert_eq!((arms.fault, arms.control), ([800, 4, 0], [800, 2, 0]));
        let mut report = json!({ "device": { "excess_per_fault": arms.excess() } });
        bound_all(&mut report);
        let excess = &report["device"]["excess_per_fault"];
        assert_eq!((&excess["mean"], &excess["mean_excess_misses"], &excess["faults"]), (&json!(0.25), &json!(0.5), &json!(4)));
        assert_eq!((&excess["faults_with_excess"], &excess["faults_with_fewer"]), (&json!(2), &json!(1)));
        let expected = Excess::of(4, 2, 1);
        assert_eq!((excess["lower95"].as_f64(), excess["upper95"].as_f64()), (Some(expected.lower95), Some(expected.upper95)));
    }

    /// Two faults without a miss, of which a normal distribution says that nothing more is possible: their deviation is 0.
    #[test]
    fn two_faults_prove_nothing_whatever_they_cost() {
        let upper = |faults: &[Fault]| {
            let mut report = json!({ "by_target": { "haptic:active": Arms::of(faults.iter()).excess() } });
            bound_all(&mut report);
            report["by_target"]["haptic:active"]["upper95"].as_f64()
        };
        // Without any: (1 − p)² = 0.049.
        assert!(upper(&[fault(0, 0), fault(0, 0)]).is_some_and(|upper| (upper - (1.0 - 0.049f64.sqrt())).abs() < 0.001));
        assert_eq!(upper(&[]), None);
        let broken = |count: usize| Arms::of(vec![fault(9, 0); count].iter()).broken().is_some();
        // Of five at least 0.094, where 0.05 may be.
        assert_eq!([0, 1, 2, 4, 5, 6].map(broken), [false, false, false, false, true, true]);
    }

    #[test]
    fn a_promise_is_broken_only_beyond_doubt() {
        let many: Vec<Fault> = (0..50).map(|index| fault(2 + index % 2, 0)).collect();
        assert!(Arms::of(many.iter()).broken().is_some_and(|words| words.starts_with("of 50 faults 50 lost more")));
        let noise: Vec<Fault> = (0..50).map(|index| fault(u64::from(index == 7) * 4, u64::from(index == 9) * 2)).collect();
        assert_eq!(Arms::of(noise.iter()).broken(), None);
    }

    #[test]
    fn where_the_host_stalled_for_more_than_a_fifth_nothing_is_compared() {
        let mut faults = [fault(1, 0), fault(0, 0)];
        (faults[0].window, faults[1].control) = (
            Some(Window { ticks: 150, voided: 50, missed: 1, to_tick: 200, ..Window::default() }),
            Some(Window { ticks: 170, voided: 30, to_tick: 200, ..Window::default() }),
        );
        let arms = Arms::of(faults.iter());
        assert_eq!((arms.fault, arms.control, arms.excesses), ([350, 1, 50], [370, 0, 30], vec![0]));
    }

    #[test]
    fn counts_that_cannot_be_get_no_bounds() {
        for (faults, worse) in [(json!(2), json!(3)), (json!(u64::MAX), json!(0)), (json!(-1), json!(0)), (json!("2"), json!(0))]
        {
            let mut figure = json!({ "faults": faults, "faults_with_excess": worse, "faults_with_fewer": 0, "upper95": null });
            let before = figure.clone();
            bound(&mut figure);
            assert_eq!(figure, before);
        }
    }
}
