//! What is told of the case of a session: task, anatomy, goals with their state, end, warnings; as JSON, for a terminal and for the page. The operator's page
//! shows the same JSON of a session that runs.

use crate::judge::Judge;
use crate::markup::{escape, plain, wide_table};
use serde_json::{Value, json};
use std::fmt::Write;

/// Most warnings that are listed with their times.
const MOST_TIMES: usize = 20;
/// Most words of a task: a case file has fewer.
const MOST_WORDS: usize = 1_000;
/// Columns of a line of the task, and of a goal.
const LINE: usize = 96;
/// Columns of what stands beside a picture, and of the words at its left; most lines of one goal, and most warnings there.
const STRIP: usize = 46;
const STRIP_HEAD: usize = 9;
const STRIP_LINES: usize = 2;
const STRIP_WARNINGS: usize = 2;
/// From here on a begin of the session is told of, seconds after the first tick.
const LATE_S: f64 = 1.0;

impl Judge {
    /// Case and judgement for programs. Times `at_s` and `began_s` are seconds from the first tick, as those of curves and pictures; `after_s` is counted
    /// from the begin of the session.
    pub fn json(&self) -> Value {
        let at_s = |tick: Option<u64>| tick.map(|tick| self.since_start_s(tick));
        let goals = self.brief.goals.iter().zip(&self.goals).enumerate().map(|(index, (goal, state))| {
            json!({
                "words": plain(&goal.words),
                "state": if state.reached_tick.is_some() { "reached" } else if state.missed_tick.is_some() { "missed" } else { "open" },
                "called_for": self.is_called_for(index),
                "called_off": self.is_called_off(index),
                "waits_for_blood": self.waits_for_blood(index),
                "progress": state.progress,
                "weight": goal.weight,
                "at_s": at_s(state.reached_tick.or(state.missed_tick)),
            })
        });
        let warnings = self.brief.warnings.iter().zip(&self.warnings).enumerate().map(|(index, (warning, state))| {
            let times = self.told.iter().filter(|(told, _)| *told == index).take(MOST_TIMES);
            json!({
                "words": plain(&warning.words),
                "is_notice": warning.is_notice(),
                "stands": state.stands && self.ended.is_none(),
                "count": state.count,
                "at_s": times.map(|(_, tick)| self.since_start_s(*tick)).collect::<Vec<f64>>(),
            })
        });
        json!({
            "name": plain(&self.brief.name),
            "rung": self.brief.rung,
            "task": self.task(),
            "seed": self.brief.seed,
            "drawn": self.brief.drawn.iter().map(|drawn| plain(drawn)).collect::<Vec<String>>(),
            "goals": goals.collect::<Value>(),
            "warnings": warnings.collect::<Value>(),
            "pathology_removed_percent": self.removed_percent(),
            "ends": self.brief.end.words(),
            "began_s": self.began_s(),
            "ended": self.ended.map(|(by, tick)| {
                let (at_s, after_s) = (self.since_start_s(tick), self.lasted_s(tick));
                json!({ "by": by, "words": by.words(), "at_s": at_s, "after_s": after_s })
            }),
        })
    }

    /// The case in some short lines, ASCII, for what stands beside a picture: goals and time, the next goal or the end, what is warned of.
    pub fn strip(&self) -> Vec<String> {
        let (reached, called_for) = self.tally();
        // While it runs a stop that may never be counts, too; what it has taken the place of does not any more.
        let called_off = (0..self.goals.len()).filter(|index| self.is_called_off(*index)).count();
        let of = if self.ended.is_some() { called_for } else { self.goals.len() - called_off };
        let left_s = self.brief.end.time_s.map(|time_s| (time_s - self.elapsed_s(self.last_tick)).max(0.0).ceil() as u64);
        let left = left_s.filter(|_| self.ended.is_none());
        let left = left.map_or(String::new(), |left_s| format!("   {:02}:{:02} left", left_s / 60, left_s % 60));
        let mut lines = vec![format!("goals    {reached} of {of}{left}")];
        if let Some((by, tick)) = self.ended {
            let lasted_s = self.lasted_s(tick);
            let [minutes, seconds] = [lasted_s / 60.0, lasted_s % 60.0].map(f64::floor);
            lines.extend(beside("OVER", &format!("after {minutes:02.0}:{seconds:02.0}: {}", by.words())));
            return lines;
        }
        let is_open = |goal: &crate::judge::GoalState| goal.reached_tick.is_none() && goal.missed_tick.is_none();
        // One that was called for comes before a stop that may never be; who is to stop is told of nothing else.
        let pairs = || self.brief.goals.iter().zip(&self.goals).enumerate();
        let called_for = pairs().find(|(index, (_, state))| is_open(state) && self.is_called_for(*index));
        let next = called_for.or_else(|| pairs().find(|(_, (_, state))| is_open(state) && !self.is_to_stop()));
        lines.extend(next.into_iter().flat_map(|(index, (goal, state))| {
            let share = match state.progress {
                _ if self.waits_for_blood(index) => "no blood yet: ".to_owned(),
                progress if progress > 0.0 => format!("{:.0} %: ", 100.0 * progress),
                _ => String::new(),
            };
            beside("next", &format!("{share}{}", goal.words))
        }));
        let standing = self.brief.warnings.iter().zip(&self.warnings).filter(|(_, state)| state.stands);
        lines.extend(standing.take(STRIP_WARNINGS).flat_map(|(warned, _)| {
            let head = if warned.is_notice() { "NOTICE" } else { "WARNING" };
            beside(head, &warned.words)
        }));
        lines
    }

    /// How the session ended, in one sentence; `None` while it runs.
    pub fn over(&self) -> Option<String> {
        let (by, tick) = self.ended?;
        let (reached, of) = self.tally();
        let others = self.goals.len() - of;
        let others = if others > 0 { format!(", {others} not called for") } else { String::new() };
        Some(format!("after {:.1} s: {}; {reached} of {of} goals reached{others}", self.lasted_s(tick), by.words()))
    }

    /// The task in one line.
    fn task(&self) -> String {
        self.brief.task.split_whitespace().take(MOST_WORDS).map(plain).collect::<Vec<String>>().join(" ")
    }

    /// Goals: words, state in words, and a class for the page.
    fn goal_lines(&self) -> Vec<(String, String, &'static str)> {
        let line = |(index, (goal, state)): (usize, (&hyst_scene::Asked, &crate::judge::GoalState))| {
            let (told, class) = match (state.reached_tick, state.missed_tick) {
                (Some(tick), _) => (format!("reached at {:.1} s", self.since_start_s(tick)), "reached"),
                (None, Some(tick)) => (format!("missed at {:.1} s", self.since_start_s(tick)), "error"),
                (None, None) if self.is_called_off(index) => ("not called for any more".into(), ""),
                (None, None) if !self.is_called_for(index) => ("not called for".into(), ""),
                (None, None) if self.waits_for_blood(index) => ("not reached: it has not bled".into(), "warning"),
                (None, None) => (format!("not reached ({:.0} % of it)", 100.0 * state.progress), "warning"),
            };
            (plain(&goal.words), told, class)
        };
        self.brief.goals.iter().zip(&self.goals).enumerate().map(line).collect()
    }

    /// Warnings and notices that fell: which of them it is, words, and when.
    fn warning_lines(&self) -> Vec<(&'static str, String, String)> {
        let fallen = self.brief.warnings.iter().zip(&self.warnings).enumerate().filter(|(_, (_, state))| state.count > 0);
        let line = |(index, (warning, state)): (usize, (&hyst_scene::Warned, &crate::judge::WarningState))| {
            let first_s = self.since_start_s(state.first_tick.unwrap_or(0));
            let last =
                self.told.iter().rev().find(|(told, _)| *told == index).map_or(first_s, |(_, tick)| self.since_start_s(*tick));
            let when = if state.count == 1 {
                format!("at {first_s:.1} s")
            } else {
                format!("{} times, from {first_s:.1} s to {last:.1} s", state.count)
            };
            (warning.kind(), plain(&warning.words), when)
        };
        fallen.map(line).collect()
    }

    /// That the session began later than the recording; nothing where that was within a second.
    fn began_line(&self) -> Option<String> {
        let began_s = self.began_s().filter(|began_s| *began_s > LATE_S)?;
        Some(format!("began at {began_s:.1} s: the trainee's time, and all shares of time, count from there"))
    }

    fn ended_line(&self) -> String {
        match self.ended {
            Some((by, tick)) => {
                let lasted_s = self.lasted_s(tick);
                format!("after {lasted_s:.1} s: {}; what came later counts for nothing", by.words())
            }
            None => "not by the case: the recording ends before".to_owned(),
        }
    }
}

/// The case in a report for a terminal.
pub(crate) fn text(out: &mut String, judge: &Judge) {
    let _ = writeln!(out, "\nCase: {} (seed {})", cut(&plain(&judge.brief.name)), judge.brief.seed);
    let mut line = String::from(" ");
    for word in judge.task().split(' ') {
        if line.chars().count() + 1 + word.chars().count() > LINE {
            let _ = writeln!(out, "{line}");
            line = String::from(" ");
        }
        line = line + " " + word;
    }
    let _ = writeln!(out, "{line}");
    for drawn in &judge.brief.drawn {
        let _ = writeln!(out, "  drawn: {}", cut(&plain(drawn)));
    }
    for (words, told, _) in judge.goal_lines() {
        let _ = writeln!(out, "  {:<60} {told}", cut_to(&words, 60));
    }
    if let Some(began) = judge.began_line() {
        let _ = writeln!(out, "  {began}");
    }
    let _ = writeln!(out, "  ended {}", judge.ended_line());
    let warnings = judge.warning_lines();
    out.push_str(if warnings.is_empty() { "  no warnings\n" } else { "" });
    for (kind, words, when) in warnings {
        let _ = writeln!(out, "  {:<60} {when}", cut_to(&format!("{kind}: {words}"), 60));
    }
}

/// The case on the page of a report.
pub(crate) fn html(page: &mut String, judge: &Judge) {
    let _ = writeln!(
        page,
        "<section><h2>Case: {}</h2>\n<p>{}</p>\n<p class=\"note\">Seed {}. {}</p>\n{}\n\
         <thead><tr><th>goal</th><th class=\"text\">what came of it</th></tr></thead>",
        escape(&judge.brief.name),
        escape(&judge.task()),
        judge.brief.seed,
        escape(&judge.brief.drawn.join("; ")),
        wide_table("Goals")
    );
    for (words, told, class) in judge.goal_lines() {
        let _ = writeln!(
            page,
            "<tr><td class=\"text\">{}</td><td class=\"text {class}\">{}</td></tr>",
            escape(&words),
            escape(&told)
        );
    }
    page.push_str("</table></div>\n<dl>\n");
    if let Some(began) = judge.began_line() {
        let _ = writeln!(page, "<dt>session</dt><dd>{}</dd>", escape(&began));
    }
    let _ = writeln!(page, "<dt>ended</dt><dd>{}</dd>", escape(&judge.ended_line()));
    let warnings = judge.warning_lines();
    if warnings.is_empty() {
        page.push_str("<dt>warnings</dt><dd>none</dd>\n");
    }
    for (kind, words, when) in warnings {
        let _ = writeln!(page, "<dt>{kind}</dt><dd class=\"{kind}\">{}: {}</dd>", escape(&words), escape(&when));
    }
    page.push_str("</dl></section>\n");
}

/// Words beside a head, in as many lines as there are; letters that a simple font lacks are written with others.
fn beside(head: &str, words: &str) -> Vec<String> {
    let letter = |letter: char| match letter {
        '²' => '2',
        '³' => '3',
        '·' => '.',
        '“' | '”' => '"',
        '’' => '\'',
        '–' | '—' => '-',
        'µ' => 'u',
        ' '..='~' => letter,
        _ => '?',
    };
    let plain: String = words.chars().map(letter).collect();
    let mut rows = vec![String::new()];
    for word in plain.split_whitespace() {
        let row = rows.last().map_or(0, String::len);
        if row > 0 && row + 1 + word.len() > STRIP - STRIP_HEAD {
            rows.push(String::new());
        }
        if let Some(row) = rows.last_mut() {
            row.push_str(if row.is_empty() { "" } else { " " });
            row.push_str(word);
        }
    }
    rows.truncate(STRIP_LINES);
    let head = |index: usize| if index == 0 { head } else { "" };
    rows.iter().enumerate().map(|(index, row)| format!("{:<STRIP_HEAD$}{row}", head(index))).collect()
}

fn cut(words: &str) -> String {
    cut_to(words, LINE - 20)
}

fn cut_to(words: &str, most: usize) -> String {
    if words.chars().count() <= most {
        return words.to_owned();
    }
    words.chars().take(most - 1).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::{AppliedRecord, Controls, FluidStatus, HardwareSample};

    #[test]
    fn a_goal_that_a_stop_has_taken_the_place_of_is_told_from_a_stop_that_nothing_called_for() {
        let brief = json!({
            "name": "A case", "rung": "polyp", "task": "Do it.", "seed": 3, "drawn": [], "pathology_ml": 2.0,
            "goals": [
                { "words": "stop", "is": { "stop": { "after": { "alarm": "perforation" }, "ticks": 200 } } },
                { "words": "resect", "is": { "removed": 1.0 } },
            ],
            "end": { "goals": true, "time_s": null, "deficit_ml": null, "bled_ml": null, "perforation": false },
            "warnings": [], "score": {},
        });
        let mut judge = Judge::new(serde_json::from_value(brief).unwrap());
        let told = |judge: &Judge| judge.goal_lines().into_iter().map(|(_, told, _)| told).collect::<Vec<String>>();
        let controls = Controls { inflow_valve: 1.0, ..Controls::default() };
        let sample = HardwareSample { controls, ..HardwareSample::default() };
        judge.tick(&AppliedRecord { tick: 1, sample, ..AppliedRecord::default() });
        assert_eq!(told(&judge), ["not called for", "not reached (0 % of it)"]);
        judge.fluid(&FluidStatus { state_tick: 1, alarms: 8, ..FluidStatus::default() });
        judge.tick(&AppliedRecord { tick: 2, sample, ..AppliedRecord::default() });
        assert_eq!(told(&judge), ["not reached (0 % of it)", "not called for any more"]);
    }
}
