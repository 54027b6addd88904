//! The sessions of one report side by side, and what text, page and JSON say alike: facts of the session, facts of the station, numbers.

use crate::assess::Assessment;
use crate::markup::plain;
use crate::metric::{Metric, Scores, scores};
use hyst_messages::{FLOW_FLAWS, PUMP_ALARMS};
use hyst_recording::Level;
use hyst_scene::{Aim, Brief, Cause};

/// One recording.
#[derive(Clone, Debug)]
pub struct Column {
    /// The file, as it was named.
    pub file: String,
    /// What came of it.
    pub assessment: Assessment,
    /// Its values and scores.
    pub scores: Scores,
}

/// The session that is reported, and earlier ones to compare it with.
#[derive(Clone, Debug)]
pub struct Sessions {
    /// The one that is reported.
    pub reported: Column,
    /// The others, in the order in which they were named.
    pub earlier: Vec<Column>,
}

impl Sessions {
    /// A report of one session.
    pub fn new(file: &str, assessment: Assessment) -> Sessions {
        Sessions { reported: Column::new(file, assessment), earlier: Vec::new() }
    }

    /// Adds an earlier session.
    pub fn compare(&mut self, file: &str, assessment: Assessment) {
        self.earlier.push(Column::new(file, assessment));
    }

    /// What is missing of the recordings, a sentence each; of an earlier one with its file.
    pub fn missing(&self) -> Vec<String> {
        let earlier = self.earlier.iter().flat_map(|column| {
            let of_file = |sentence: String| format!("{}: {sentence}", column.file);
            column.assessment.missing().into_iter().map(of_file).collect::<Vec<_>>()
        });
        self.reported.assessment.missing().into_iter().chain(earlier).collect()
    }
}

impl Column {
    fn new(file: &str, assessment: Assessment) -> Column {
        Column { file: plain(file), scores: scores(&assessment.measured), assessment }
    }

    /// A fact of the session, as the recorder noted it.
    pub(crate) fn fact(&self, name: &str) -> String {
        self.noted(name).unwrap_or_else(|| NONE.to_string())
    }

    /// The same; `None` where it noted none.
    fn noted(&self, name: &str) -> Option<String> {
        self.assessment.session.get(name).map(|value| plain(value))
    }

    /// The case, if there is one.
    fn brief(&self) -> Option<&Brief> {
        self.assessment.measured.judge.as_ref().map(|judge| &judge.brief)
    }

    /// The case and what its anatomy was drawn from, to be said after its file; nothing of a session without one.
    pub(crate) fn drawn(&self) -> String {
        self.brief().map_or_else(String::new, |brief| format!(", {}, seed {}", plain(&brief.name), brief.seed))
    }

    /// Whether another session was in the same anatomy, wherever the file of it lay: of the same case what the same seed has drawn the same, else the same
    /// scene.
    pub(crate) fn is_of_same_anatomy(&self, other: &Column) -> bool {
        match (self.brief(), other.brief()) {
            (None, None) => self.fact("scene_hash") == other.fact("scene_hash"),
            (own, others) => own.map(anatomy) == others.map(anatomy),
        }
    }

    /// Whether another session was judged by the same: goals, ends, warnings, weights and scales of its case, however they are worded, or no case.
    pub(crate) fn is_judged_alike(&self, other: &Column) -> bool {
        match (self.brief(), other.brief()) {
            (None, None) => true,
            (Some(own), Some(others)) => are_judged_alike(own, others),
            _ => false,
        }
    }

    /// Whether another session was with a device of the same force; `None` where one of the two does not say it.
    pub(crate) fn is_of_same_device(&self, other: &Column) -> Option<bool> {
        Some(self.assessment.measured.device_max_n? == other.assessment.measured.device_max_n?)
    }

    /// What is said of a session that is compared with another one of which the figures are not of the same thing.
    pub(crate) fn mark_beside(&self, reported: &Column) -> String {
        let mark = match (self.is_of_same_anatomy(reported), self.is_judged_alike(reported)) {
            (false, _) => ", of another case, seed or scene",
            (true, false) => ", judged by other goals, ends, warnings or weights",
            (true, true) => "",
        };
        let device = if self.is_of_same_device(reported) == Some(false) { ", with another device" } else { "" };
        format!("{mark}{device}")
    }

    /// Who, what, how long.
    pub(crate) fn session_facts(&self) -> Vec<(&'static str, String)> {
        let conduct = &self.assessment.measured.conduct;
        // A recording of before they were noted has neither.
        let noted = [("trainee", "trainee"), ("begun", "begun_utc")].map(|(name, fact)| (name, self.noted(fact)));
        let noted = noted.into_iter().filter_map(|(name, value)| Some((name, value?)));
        let device = self.assessment.measured.device_max_n;
        let device = device.map(|newton| ("device", format!("states {} N at most", number(newton))));
        let scene = format!("{} ({}){}", self.fact("scene"), self.fact("scene_hash"), self.drawn());
        let length = format!("{:.3} s from tick {}", seconds(conduct.length_ticks()), conduct.first_tick.unwrap_or(0));
        let facts = [("scene or case", scene), ("hand", self.fact("hand"))].into_iter().chain(device);
        noted.chain(facts).chain([("length", length)]).collect()
    }

    /// Out of which file, and what made it.
    pub(crate) fn origin_facts(&self) -> Vec<(&'static str, String)> {
        let facts = [("recording", self.file.clone()), ("session", self.fact("session")), ("station's version", self.version())];
        facts.into_iter().chain(self.machine_facts()).collect()
    }

    /// Of what version the station was, and of which build, if that was noted.
    fn version(&self) -> String {
        let build = self.noted("build").map_or_else(String::new, |build| format!(", build {build}"));
        format!("{}{build}", self.fact("version"))
    }

    /// On what it ran; nothing of a recording of before that was noted.
    fn machine_facts(&self) -> Vec<(&'static str, String)> {
        let cores = self.noted("cores").map_or_else(String::new, |cores| format!(", {cores} cores"));
        let processor = self.noted("cpu").map(|cpu| ("processor", format!("{cpu}{cores}")));
        let kernel = self.noted("kernel").map(|kernel| ("kernel", format!("Linux {kernel}")));
        processor.into_iter().chain(kernel).collect()
    }

    /// What the station itself did.
    pub(crate) fn station_facts(&self) -> Vec<(&'static str, String)> {
        let measured = &self.assessment.measured;
        let conduct = &measured.conduct;
        let [fresh, held, ramped, zero, unknown] = conduct.kinds;
        let longest = conduct.longest_gap.map_or_else(String::new, |gap| {
            format!("; the longest {} from {:.3} s on", gap.count(), seconds(conduct.since_start(gap.first)))
        });
        let step = conduct.largest_step.map_or_else(
            || NONE.to_string(),
            |step| format!("{} N at {:.3} s", number(step.value), seconds(conduct.since_start(step.tick))),
        );
        let of_flow = |flaws: std::ops::Range<usize>| counts_in_words(&FLOW_FLAWS[flaws.clone()], &measured.medium.flaws[flaws]);
        let ([mended, kept], [as_they_were, of_walls]) = (of_flow(0..4), of_flow(4..8));
        vec![
            ("ticks in the recording", conduct.ticks.to_string()),
            ("ticks missing", format!("{} in {} gaps{longest}", conduct.missing, conduct.gaps)),
            ("of them lost by the recorder", conduct.lost.to_string()),
            ("force of a tick: fresh", fresh.to_string()),
            ("force of a tick: held", held.to_string()),
            ("force of a tick: ramped to zero", ramped.to_string()),
            ("force of a tick: zero", zero.to_string()),
            ("ticks of an unknown kind", unknown.to_string()),
            ("ticks with a pose or force that is no number", conduct.not_finite.to_string()),
            ("ticks that came again or late, left out", conduct.repeated.to_string()),
            ("largest step of the force", step),
            ("takeovers of a role", conduct.takeovers.to_string()),
            ("changes of the servo whose force is felt", conduct.servo_changes.to_string()),
            ("events: warnings, errors", format!("{}, {}", conduct.warnings, conduct.errors)),
            ("flaws of the computed flow: mended", mended),
            ("flaws of the computed flow: as before", kept),
            ("flaws of the computed flow: left as they were", as_they_were),
            ("flaws of the computed flow: ports and walls", of_walls),
        ]
    }

    /// What the pump told whoever was at it.
    pub(crate) fn pump_facts(&self) -> Vec<(&'static str, String)> {
        let [alarms, further] = counts_in_words(&PUMP_ALARMS, &self.assessment.measured.medium.alarms);
        vec![("alarms of the pump", alarms), ("further alarms and notices of the pump", further)]
    }
}

/// What was drawn for a case: its name and seed, what is told of that, and how much pathology there is, ml. Another build may draw otherwise.
fn anatomy(brief: &Brief) -> (&str, u32, &[String], f64) {
    (brief.name.as_str(), brief.seed, brief.drawn.as_slice(), brief.pathology_ml)
}

fn are_judged_alike(own: &Brief, other: &Brief) -> bool {
    let is_same = own.end == other.end && own.score == other.score;
    is_same && aims(own).eq(aims(other)) && causes(own).eq(causes(other))
}

fn aims(brief: &Brief) -> impl Iterator<Item = (&Aim, f64)> {
    brief.goals.iter().map(|goal| (&goal.is, goal.weight))
}

fn causes(brief: &Brief) -> impl Iterator<Item = (&Cause, bool)> {
    brief.warnings.iter().map(|warned| (&warned.is, warned.is_notice()))
}

/// Counts with their names, in two halves: in one line they are too wide for the text.
fn counts_in_words(names: &[(u32, &str)], counts: &[u64]) -> [String; 2] {
    let words: Vec<String> = names.iter().zip(counts).map(|((_, name), count)| format!("{name} {count}")).collect();
    let (first, further) = words.split_at(words.len().div_ceil(2));
    [first.join(", "), further.join(", ")]
}

/// What stands where nothing is recorded.
pub(crate) const NONE: &str = "–";

/// The name of an earlier session's column: A, B, ….
pub(crate) fn letter(index: usize) -> String {
    let letter = u8::try_from(index).ok().and_then(|index| b'A'.checked_add(index)).filter(u8::is_ascii_uppercase);
    letter.map_or_else(|| format!("#{}", index + 1), |letter| char::from(letter).to_string())
}

/// A value with three or four digits.
pub(crate) fn number(value: f64) -> String {
    match value.abs() {
        _ if value == 0.0 => "0".into(),
        size if size < 10.0 => format!("{value:.3}"),
        size if size < 100.0 => format!("{value:.2}"),
        size if size < 1_000.0 => format!("{value:.1}"),
        _ => format!("{value:.0}"),
    }
}

/// The value of a metric: a count as one, another with three or four digits.
pub(crate) fn valued(metric: &Metric) -> String {
    match metric.value {
        None => NONE.to_string(),
        Some(count) if metric.definition.unit.is_empty() && count.fract() == 0.0 => format!("{count:.0}"),
        Some(value) => number(value),
    }
}

/// A score.
pub(crate) fn percent(score: Option<f64>) -> String {
    score.map_or_else(|| NONE.to_string(), |score| format!("{score:.0} %"))
}

/// Ticks as seconds.
pub(crate) fn seconds(ticks: u64) -> f64 {
    ticks as f64 / 1e3
}

/// How bad an event is, in a word; a takeover is of level info.
pub(crate) fn word(level: Level) -> &'static str {
    match level {
        Level::Info => "takeover",
        Level::Warning => "warning",
        Level::Error => "error",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::METRICS;

    #[test]
    fn a_count_is_a_whole_number_and_what_has_a_unit_is_not() {
        let metric = |unit: &'static str, value| {
            let definition = METRICS.iter().find(|definition| definition.unit == unit).unwrap();
            valued(&Metric { definition, value, scale: None, source: "", score: None })
        };
        assert_eq!([metric("", Some(12.0)), metric("s", Some(12.0)), metric("", Some(0.5))], ["12", "12.00", "0.500"]);
        assert_eq!(metric("", None), "–");
    }

    #[test]
    fn numbers_have_three_or_four_digits_and_columns_their_letters() {
        assert_eq!(
            [0.0, 0.12345, -9.5, 12.345, 345.67, 12_345.6].map(number),
            ["0", "0.123", "-9.500", "12.35", "345.7", "12346"]
        );
        assert_eq!([0, 25, 26, 400].map(letter), ["A", "Z", "#27", "#401"]);
        assert_eq!((percent(Some(99.6)), percent(None)), ("100 %".to_string(), "–".to_string()));
    }
}
