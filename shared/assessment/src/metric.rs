//! From what was measured to values and scores: how a raw value becomes a score, and what it weighs. The table of them is in `table`.

use crate::assess::Measured;
use crate::judge::Judge;
use crate::table::{METRICS, OF_THE_TASK};
use hyst_scene::Score;

/// Where a scale or a weight comes from that a case has set.
const OF_CASE: &str = "the case";
/// Why there is none, usually.
const SHOWN: &str = "shown, not scored: it depends on the case";

/// A group of metrics: the four of Bajka et al. 2010, and the task of the case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Group {
    /// What was seen.
    Visualisation,
    /// How the scope was moved.
    Ergonomics,
    /// What the tissue suffered.
    Safety,
    /// What the medium did.
    Fluid,
    /// What the case asked for.
    Task,
}

impl Group {
    /// All groups, in the order of the report.
    pub const ALL: [Group; 5] = [Group::Visualisation, Group::Ergonomics, Group::Safety, Group::Fluid, Group::Task];

    /// The name that people read.
    pub const fn name(self) -> &'static str {
        match self {
            Group::Visualisation => "Visualisation",
            Group::Ergonomics => "Ergonomics",
            Group::Safety => "Safety",
            Group::Fluid => "Fluid handling",
            Group::Task => "Task",
        }
    }
}

/// How a raw value becomes a score: linearly between two values, and not beyond.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// From this value on the score is 100 %.
    pub full: f64,
    /// From this value on it is 0.
    pub none: f64,
    /// What it weighs in its group and in the whole.
    pub weight: f64,
}

impl Scale {
    /// The score, %.
    pub fn score(&self, value: f64) -> f64 {
        100.0 * ((value - self.none) / (self.full - self.none)).clamp(0.0, 1.0).abs() // of a negative zero
    }
}

/// A scale of the table.
pub(crate) const fn scale(full: f64, none: f64, weight: f64) -> Option<Scale> {
    Some(Scale { full, none, weight })
}

/// Part of a whole, %; `None` of nothing.
pub(crate) fn share(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then_some(100.0 * part as f64 / whole as f64)
}

/// A metric as the table has it.
#[derive(Debug)]
pub struct Definition {
    /// The group.
    pub group: Group,
    /// The name that programs read.
    pub key: &'static str,
    /// The name that people read.
    pub name: &'static str,
    /// Unit of the value.
    pub unit: &'static str,
    /// How it is scored where no case says otherwise; `None` if it is only shown then.
    pub scale: Option<Scale>,
    /// The value; `None` if the recording does not hold it.
    pub value: fn(&Measured) -> Option<f64>,
    /// Where the scale comes from, or why there is none.
    pub source: &'static str,
}

/// A metric that is only shown where no case gives it a scale.
pub(crate) const fn shown(
    group: Group,
    key: &'static str,
    name: &'static str,
    unit: &'static str,
    value: fn(&Measured) -> Option<f64>,
) -> Definition {
    Definition { group, key, name, unit, scale: None, value, source: SHOWN }
}

/// A metric of one recording.
#[derive(Clone, Copy, Debug)]
pub struct Metric {
    /// What it is.
    pub definition: &'static Definition,
    /// The raw value; `None` if the recording does not hold it.
    pub value: Option<f64>,
    /// How it is scored in this session; `None` if it is only shown.
    pub scale: Option<Scale>,
    /// Where the scale comes from, or why there is none.
    pub source: &'static str,
    /// The score, %; `None` without a value, if it is only shown, and of the time of a session that was broken off. Of a metric in [`OF_THE_TASK`] it is the
    /// scale's times the share that was done.
    pub score: Option<f64>,
}

/// The metrics of one recording.
#[derive(Clone, Debug)]
pub struct Scores {
    /// In the table's order.
    pub metrics: Vec<Metric>,
    /// Weighted mean of the scores of each group, %, in the order of [`Group::ALL`].
    pub groups: [Option<f64>; Group::ALL.len()],
    /// Weighted mean of all scores, %, times the mean of 1 and the share that was done: at most half of all is for who has done nothing.
    pub total: Option<f64>,
    /// Share that was done of what the goals that were called for ask for, 0 to 1; 1 without a case, and where none was called for.
    pub done: f64,
}

/// The metric that has no score where a session was broken off: nobody knows how long the rest would have taken.
const OF_A_WHOLE: &str = "time";

/// Values and scores of what was measured, with the weights and scales of its case. A metric without a value weighs nothing.
pub fn scores(measured: &Measured) -> Scores {
    let judge = measured.judge.as_ref();
    let done = judge.and_then(Judge::done_percent).map_or(1.0, |percent| percent / 100.0);
    let is_broken_off = judge.is_some_and(Judge::is_broken_off);
    let metric = |definition: &'static Definition| {
        let value = (definition.value)(measured).filter(|value| value.is_finite());
        let case = judge.and_then(|judge| judge.brief.score.get(definition.key));
        let scale = case.map_or(definition.scale, |case| of_case(case, definition.scale));
        let counts = if OF_THE_TASK.contains(&definition.key) { done } else { 1.0 };
        let is_scored = definition.key != OF_A_WHOLE || !is_broken_off;
        let score = scale.zip(value).filter(|_| is_scored).map(|(scale, value)| counts * scale.score(value));
        let source = if case.is_some() { OF_CASE } else { definition.source };
        Metric { definition, value, scale, source, score }
    };
    let metrics: Vec<Metric> = METRICS.iter().map(metric).collect();
    let groups = Group::ALL.map(|group| mean(metrics.iter().filter(|metric| metric.definition.group == group)));
    let total = mean(metrics.iter()).map(|score| score * (1.0 + done) / 2.0);
    Scores { metrics, groups, total, done }
}

/// The scale of a metric in a case.
fn of_case(case: &Score, default: Option<Scale>) -> Option<Scale> {
    let weight = case.weight.or(default.map(|scale| scale.weight)).unwrap_or(1.0);
    let ends = case.full.zip(case.none).filter(|(full, none)| full != none);
    ends.map(|(full, none)| Scale { full, none, weight }).or(default.map(|scale| Scale { weight, ..scale }))
}

fn mean<'a>(metrics: impl Iterator<Item = &'a Metric>) -> Option<f64> {
    let (mut sum, mut weight) = (0.0, 0.0);
    for metric in metrics {
        if let (Some(score), Some(scale)) = (metric.score, metric.scale) {
            sum += scale.weight * score;
            weight += scale.weight;
        }
    }
    (weight > 0.0).then_some(sum / weight)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_score_goes_linearly_between_its_two_values_and_not_beyond() {
        let less_is_better = Scale { full: 100.0, none: 1_000.0, weight: 1.0 };
        assert_eq!(
            [0.0, 100.0, 550.0, 1_000.0, 9_000.0].map(|value| less_is_better.score(value)),
            [100.0, 100.0, 50.0, 0.0, 0.0]
        );
        let more_is_better = Scale { full: 20.0, none: 0.0, weight: 1.0 };
        assert_eq!([-5.0, 5.0, 30.0].map(|value| more_is_better.score(value)), [0.0, 25.0, 100.0]);
    }

    #[test]
    fn the_table_has_every_key_once_groups_in_order_and_sound_scales() {
        let mut keys: Vec<&str> = METRICS.iter().map(|metric| metric.key).collect();
        keys.sort_unstable();
        keys.dedup();
        assert_eq!(keys.len(), METRICS.len());
        assert!(OF_THE_TASK.iter().all(|key| METRICS.iter().any(|metric| metric.key == *key && metric.scale.is_some())));
        assert!(METRICS.windows(2).all(|pair| pair[0].group <= pair[1].group));
        for metric in &METRICS {
            assert!(metric.scale.is_none_or(|scale| scale.full != scale.none && scale.weight > 0.0), "{}", metric.key);
            assert!(
                metric.name.chars().count() <= 44 && metric.unit.chars().count() <= 6,
                "{}: the table has 100 columns",
                metric.key
            );
        }
    }

    #[test]
    fn a_case_can_weigh_every_metric_of_the_table_and_no_other() {
        let table: Vec<(&str, bool)> = METRICS.iter().map(|metric| (metric.key, metric.scale.is_some())).collect();
        assert_eq!(table, hyst_scene::METRIC_KEYS, "keep hyst_scene::METRIC_KEYS in step");
    }

    #[test]
    fn weights_and_scales_are_the_cases_where_it_has_some() {
        let default = Some(Scale { full: 1.0, none: 3.0, weight: 2.0 });
        let score = |weight, full, none| Score { weight, full, none };
        assert_eq!(of_case(&score(Some(0.5), None, None), default), Some(Scale { full: 1.0, none: 3.0, weight: 0.5 }));
        assert_eq!(of_case(&score(None, Some(9.0), Some(0.0)), default), Some(Scale { full: 9.0, none: 0.0, weight: 2.0 }));
        assert_eq!(of_case(&score(None, Some(9.0), Some(0.0)), None), Some(Scale { full: 9.0, none: 0.0, weight: 1.0 }));
        assert_eq!(of_case(&score(Some(4.0), None, None), None), None, "without a scale there is no score");
    }

    #[test]
    fn what_is_not_recorded_is_absent_and_weighs_nothing() {
        let nothing = scores(&Measured::default());
        assert!(nothing.metrics.iter().all(|metric| metric.value.is_none() && metric.score.is_none()));
        assert_eq!((nothing.groups, nothing.total, nothing.done), ([None; 5], None, 1.0));
        let mut measured = Measured::default();
        measured.force.tick(0, 1.0, true); // 100 %: largest; 95 % below 1.005 N, at most its 1 N: 66.7 %; above the limit: 100 %; touching: 0 %
        let scores = scores(&measured);
        let safety = (2.0 * 100.0 + 2.0 * 100.0 * (1.0 / 1.5) + 2.0 * 100.0 + 1.0 * 0.0) / 7.0;
        assert!((scores.groups[2].unwrap() - safety).abs() < 1e-9 && scores.total == scores.groups[2]);
    }
}
