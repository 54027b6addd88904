//! What of a session cost most of its score: what whoever reads a report is to work on first.

use crate::metric::{Metric, Scores};
use crate::table::OF_THE_TASK;

/// Most that are named: who is told of more remembers none.
const MOST: usize = 5;
/// What costs less of a hundred is not named.
const LEAST: f64 = 0.5;

/// A metric that is not scored in full.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Loss<'a> {
    /// Which.
    pub metric: &'a Metric,
    /// What it takes from the mean of all scores, of a hundred.
    pub points: f64,
}

impl Loss<'_> {
    /// Why it cost anything though its value may be as good as can be: nothing where all goals were done, or its score does not ask for them.
    pub(crate) fn of_goals(&self, done: f64) -> String {
        let asks = done < 1.0 && OF_THE_TASK.contains(&self.metric.definition.key);
        if asks { format!(", × {done:.2} for the goals") } else { String::new() }
    }
}

/// The metrics that cost most of the mean of all scores, the dearest first, and of two that cost the same the one that stands first in the table. All losses
/// together are what that mean lacks of a hundred.
pub(crate) fn losses(scores: &Scores) -> Vec<Loss<'_>> {
    let scored = || scores.metrics.iter().filter_map(|metric| Some((metric, metric.scale?.weight, metric.score?)));
    let weight: f64 = scored().map(|(_, weight, _)| weight).sum();
    let loss = |(metric, own, score): (_, f64, f64)| Loss { metric, points: own * (100.0 - score) / weight };
    let mut losses: Vec<Loss<'_>> = scored().map(loss).filter(|loss| loss.points >= LEAST).collect();
    losses.sort_by(|one, other| other.points.total_cmp(&one.points));
    losses.truncate(MOST);
    losses
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assess::Measured;
    use crate::metric::scores;

    #[test]
    fn the_dearest_comes_first_and_what_costs_nothing_is_not_named() {
        assert!(losses(&scores(&Measured::default())).is_empty(), "nothing is recorded");
        let mut measured = Measured::default();
        // Of 7 weights the largest force, 2, has 56.5 %; to be above the limit all the time, 2 and 2, and to touch, 1, have nothing.
        measured.force.tick(0, 2.0, true);
        let scores = scores(&measured);
        let losses = losses(&scores);
        let told: Vec<(&str, i64)> = losses.iter().map(|loss| (loss.metric.definition.key, loss.points.round() as i64)).collect();
        assert_eq!(told, [("force_p95", 29), ("force_above_limit", 29), ("touching", 14), ("force_peak", 12)]);
        let lacks = 100.0 - scores.total.unwrap();
        assert!((losses.iter().map(|loss| loss.points).sum::<f64>() - lacks).abs() < 1e-9, "{losses:?}");
        assert!(losses.iter().all(|loss| loss.of_goals(0.5).is_empty()), "none of them is good only where the task is done");
    }

    /// A way of nothing at all "cost" half of its score, and nothing said why.
    #[test]
    fn what_is_good_only_where_the_task_is_done_says_how_much_of_it_was() {
        let scores = scores(&Measured::default());
        let of = |key: &str| scores.metrics.iter().find(|metric| metric.definition.key == key).unwrap();
        let said = |key: &str, done: f64| Loss { metric: of(key), points: 1.0 }.of_goals(done);
        assert_eq!(
            [("path", 0.5), ("path", 1.0), ("force_peak", 0.5)].map(|(key, done)| said(key, done)),
            [", × 0.50 for the goals", "", ""]
        );
    }
}
