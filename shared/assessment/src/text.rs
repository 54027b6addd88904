//! The report for a terminal of 100 columns; each session beyond three to compare with makes it wider.

use crate::absent::ABSENT;
use crate::case;
use crate::columns::{Column, NONE, Sessions, letter, percent, seconds, valued, word};
use crate::losses::{Loss, losses};
use crate::markup::plain;
use crate::metric::{Group, Metric};
use crate::processes::ProcessSum;
use hyst_recording::{Event, Picture};
use std::fmt::Write;

/// Most events, and most sentences about what is missing, that are told one by one; the page and the JSON have more.
const MOST_LINES: usize = 30;
/// Columns of an event's sentence.
const SENTENCE: usize = 55;

/// The report.
pub fn text(sessions: &Sessions) -> String {
    let mut text = String::new();
    if !sessions.missing().is_empty() {
        text.push_str("Not everything of the recording is there: the end says what is missing, the values are of the rest.\n\n");
    }
    for (name, fact) in sessions.reported.session_facts().into_iter().chain(sessions.reported.origin_facts()) {
        let _ = writeln!(text, "{name:<20}{fact}");
    }
    for (index, column) in sessions.earlier.iter().enumerate() {
        let (head, session) = (format!("compared, {}", letter(index)), column.fact("session"));
        let _ = writeln!(text, "{head:<20}{}, session {session}{}", column.file, column.drawn());
        let mark = column.mark_beside(&sessions.reported);
        let mark = mark.trim_start_matches(", ");
        if !mark.is_empty() {
            let _ = writeln!(text, "{:<20}{mark}", "");
        }
    }
    if let Some(judge) = &sessions.reported.assessment.measured.judge {
        case::text(&mut text, judge);
    }
    table(&mut text, sessions);
    dearest(&mut text, &sessions.reported);
    text.push_str("\nWhat the pump said\n");
    for (name, fact) in sessions.reported.pump_facts() {
        let _ = writeln!(text, "  {name:<46}{fact}");
    }
    text.push_str("\nNot in a recording\n");
    for (group, what, why) in ABSENT {
        let _ = writeln!(text, "  {what:<44}{}: {why}", group.name());
    }
    pictures(&mut text, &sessions.reported);
    station(&mut text, &sessions.reported);
    list(&mut text, "\nMissing of the recording", &sessions.missing());
    text
}

fn table(text: &mut String, sessions: &Sessions) {
    let head = |text: &mut String, name: &str, value: &str, score: &str| {
        let _ = write!(text, "{name:<46}{value:>10}        {score:>7}");
    };
    text.push('\n');
    head(text, "", "value", "score");
    text.push_str(if sessions.earlier.is_empty() { "      100 % … 0 %   weight" } else { "" });
    for index in 0..sessions.earlier.len() {
        let _ = write!(text, "{:>9}", letter(index));
    }
    text.push('\n');
    for (at, group) in Group::ALL.into_iter().enumerate() {
        head(text, group.name(), "", &percent(sessions.reported.scores.groups[at]));
        earlier(text, sessions, |column| percent(column.scores.groups[at]));
        for (index, metric) in sessions.reported.scores.metrics.iter().enumerate() {
            if metric.definition.group == group {
                row(text, sessions, index, metric);
            }
        }
    }
    head(text, "All", "", &percent(sessions.reported.scores.total));
    earlier(text, sessions, |column| percent(column.scores.total));
    if sessions.reported.scores.done < 1.0 {
        let share = percent(Some(100.0 * sessions.reported.scores.done));
        let _ =
            writeln!(text, "  {share} of what the goals ask for was done: of the scores of time, path, economy and turning that");
        text.push_str("  share counts, and of all the mean of it and 100 %.\n");
    }
}

/// What cost most of the score.
fn dearest(text: &mut String, column: &Column) {
    let losses = losses(&column.scores);
    let line = |loss: &Loss<'_>| {
        let (definition, value) = (loss.metric.definition, valued(loss.metric));
        let goals = loss.of_goals(column.scores.done);
        format!("{:<44}{value:>10} {:<7}{:>7.1}{goals}", definition.name, definition.unit, loss.points)
    };
    let lines: Vec<String> = losses.iter().map(line).collect();
    list(text, "\nWhat cost most, of 100", &lines);
}

fn row(text: &mut String, sessions: &Sessions, index: usize, metric: &Metric) {
    let definition = metric.definition;
    let score = if metric.scale.is_some() { percent(metric.score) } else { String::new() };
    let _ = write!(text, "  {:<44}{:>10} {:<7}{score:>7}", definition.name, valued(metric), definition.unit);
    if let Some(scale) = metric.scale.filter(|_| sessions.earlier.is_empty()) {
        let _ = write!(text, "{:>17}{:>9}", format!("{} … {}", scale.full, scale.none), scale.weight);
    }
    earlier(text, sessions, |column| column.scores.metrics.get(index).map_or_else(String::new, valued));
}

/// The rest of a line: a field for each earlier session.
fn earlier(text: &mut String, sessions: &Sessions, field: impl Fn(&Column) -> String) {
    for column in &sessions.earlier {
        let _ = write!(text, "{:>9}", field(column));
    }
    text.push('\n');
}

/// Of what there are pictures, which the page shows.
fn pictures(text: &mut String, column: &Column) {
    let measured = &column.assessment.measured;
    let line = |picture: &Picture| {
        let time_s = seconds(measured.conduct.since_start(picture.event_tick));
        format!("{time_s:>10.3} s  {}", cut(&plain(&picture.words)))
    };
    let lines: Vec<String> = measured.pictures.iter().map(line).collect();
    list(text, "\nPictures, which --html shows", &lines);
}

fn station(text: &mut String, column: &Column) {
    text.push_str("\nWhat the station did\n");
    for (name, fact) in column.station_facts() {
        let _ = writeln!(text, "  {name:<46}{fact}");
    }
    let conduct = &column.assessment.measured.conduct;
    let us = |value: Option<f64>| value.map_or_else(|| NONE.to_string(), |us| format!("{us:.0}"));
    let process = |(name, process): (&str, &ProcessSum)| {
        let hz = process.rate_hz().map_or_else(|| NONE.to_string(), |hz| format!("{hz:.1}"));
        let [wakeup, median, late] = [process.wakeup_p99_us, process.loop_p50_us(), process.loop_p99_us].map(us);
        format!("{name:<20}{hz:>8}/s{:>8} late{wakeup:>9}{median:>9}{late:>9}", process.overruns)
    };
    let processes: Vec<String> = conduct.processes.all().map(process).collect();
    list(text, "\nProcesses: rate, late steps, worst wake-up p99, mean loop p50, worst loop p99 (\u{b5}s)", &processes);
    let line = |event: &Event| {
        let time_s = seconds(conduct.since_start(event.tick));
        format!("{time_s:>10.3} s  {:<9}{:<20}{}", word(event.level), event.process, cut(&event.text))
    };
    let lines: Vec<String> = conduct.events.iter().map(line).collect();
    list(text, "\nFaults and takeovers", &lines);
    if conduct.events_left_out > 0 {
        let _ = writeln!(text, "  and {} later ones", conduct.events_left_out);
    }
}

/// A heading with lines under it; nothing without lines.
fn list(text: &mut String, heading: &str, lines: &[String]) {
    if lines.is_empty() {
        return;
    }
    let _ = writeln!(text, "{heading}");
    for line in lines.iter().take(MOST_LINES) {
        let _ = writeln!(text, "  {line}");
    }
    if lines.len() > MOST_LINES {
        let _ = writeln!(text, "  … and {} more, which --html and --json have", lines.len() - MOST_LINES);
    }
}

fn cut(sentence: &str) -> String {
    if sentence.chars().count() <= SENTENCE {
        return sentence.to_string();
    }
    sentence.chars().take(SENTENCE - 1).chain(['…']).collect()
}
