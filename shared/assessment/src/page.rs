//! The report as one page that needs nothing beside it: no script, no network, curves as SVG; for light and dark screens and for paper.

use crate::absent::ABSENT;
use crate::case;
use crate::columns::{Column, NONE, Sessions, letter, percent, seconds, valued, word};
use crate::judge::Judge;
use crate::losses::losses;
use crate::markup::{escape, plain, wide_table};
use crate::metric::{Group, Metric};
use crate::plots::curves;
use crate::style::STYLE;
use crate::way::{Side, way};
use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use std::fmt::Write;

/// The page.
pub fn html(sessions: &Sessions) -> String {
    let reported = &sessions.reported;
    let who = reported.assessment.session.get("trainee").map_or_else(String::new, |name| format!(", {}", escape(name)));
    let title = format!("Training session {}{who}", escape(&reported.fact("session")));
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\"><title>{title}</title>\
         <style>{STYLE}</style></head><body><main>\n<h1>{title}</h1>\n"
    );
    facts(&mut page, &reported.session_facts());
    missing(&mut page, sessions);
    compared(&mut page, sessions);
    tiles(&mut page, sessions);
    dearest(&mut page, reported);
    if let Some(judge) = &reported.assessment.measured.judge {
        case::html(&mut page, judge);
    }
    pictures(&mut page, reported);
    page.push_str("<section><h2>Values and scores</h2>\n");
    metrics(&mut page, sessions);
    facts(&mut page, &reported.pump_facts());
    page.push_str("</section>\n<section><h2>Over time</h2>\n<p class=\"note\">Each curve spans from the least to the largest value at its time. The dashed level \
         is the force to stay below, the shaded ranges are the working pressure and the light of a clear view. Upright and solid are goals that were reached (green), and faults and takeovers of \
         the station, as in the table below; dashed are warnings of the case (amber) and alarms and notices of the pump (red); the bars on the axis \
         of the time are current in the loop. Each says what it is to a pointer that rests on it.</p>\n");
    page.push_str(&curves(reported));
    page.push_str("</section>\n<section><h2>Path of the tip</h2>\n<p class=\"key\"><span><i style=\"background:var(--good)\"></i>begin</span><span>\
         <i style=\"background:var(--ink)\"></i>end</span><span><i style=\"background:var(--force)\"></i>largest force</span></p>\n");
    let anatomy = reported.assessment.anatomy.as_ref();
    if anatomy.is_some() {
        page.push_str("<p class=\"note\">Behind it the organ, cut through the pivot, and the outline of the pathology, as they were before anything moved.</p>\n");
    } else if let Some(why) = &reported.assessment.undrawn {
        let _ = writeln!(page, "<p class=\"note\">The organ is not drawn behind it: {}.</p>", escape(why));
    }
    page.push_str("<div class=\"sides\">\n");
    for side in [Side::Left, Side::Front] {
        page.push_str(&way(&reported.assessment.measured.curves, anatomy, side));
    }
    page.push_str("</div></section>\n<section><h2>What the station did</h2>\n");
    facts(&mut page, &reported.origin_facts());
    facts(&mut page, &reported.station_facts());
    processes(&mut page, reported);
    page.push_str("</section>\n");
    events(&mut page, reported);
    origin(&mut page);
    page.push_str("</main></body></html>\n");
    page
}

fn facts(page: &mut String, facts: &[(&'static str, String)]) {
    page.push_str("<dl>\n");
    for (name, fact) in facts {
        let _ = writeln!(page, "<dt>{}</dt><dd>{}</dd>", escape(name), escape(fact));
    }
    page.push_str("</dl>\n");
}

fn missing(page: &mut String, sessions: &Sessions) {
    let sentences = sessions.missing();
    if sentences.is_empty() {
        return;
    }
    page.push_str(
        "<div class=\"missing\"><b>Not everything of the recording is there.</b> The values below are of what is.\n<ul>\n",
    );
    for sentence in sentences {
        let _ = writeln!(page, "<li>{}</li>", escape(&sentence));
    }
    page.push_str("</ul></div>\n");
}

/// Which the earlier sessions are, by their letters.
fn compared(page: &mut String, sessions: &Sessions) {
    if sessions.earlier.is_empty() {
        return;
    }
    page.push_str("<p class=\"note\">Compared with ");
    let named = |(index, column): (usize, &Column)| {
        let [session, scene, hand] = ["session", "scene", "hand"].map(|fact| escape(&column.fact(fact)));
        let (drawn, mark) = (escape(&column.drawn()), column.mark_beside(&sessions.reported));
        format!("<b>{}</b>: {}, session {session}, {scene}{drawn}, {hand}{mark}", letter(index), escape(&column.file))
    };
    page.push_str(&sessions.earlier.iter().enumerate().map(named).collect::<Vec<_>>().join("; "));
    page.push_str("</p>\n");
}

/// The goals and the scores at one glance, those of earlier sessions below, and what a score is.
fn tiles(page: &mut String, sessions: &Sessions) {
    let column = &sessions.reported;
    page.push_str("<div class=\"tiles\">\n");
    if let Some((reached, of)) = column.assessment.measured.judge.as_ref().map(Judge::tally) {
        let _ = writeln!(page, "<div class=\"tile\"><b>{reached} of {of}</b><span>Goals reached</span></div>");
    }
    let done = column.scores.done;
    let all = if done < 1.0 { format!("All, × {:.2} for the goals", (1.0 + done) / 2.0) } else { "All".to_owned() };
    tile(page, sessions, &all, |column| column.scores.total);
    for (at, group) in Group::ALL.into_iter().enumerate() {
        tile(page, sessions, group.name(), |column| column.scores.groups[at]);
    }
    page.push_str(
        "</div>\n<p class=\"note\">A score is 100 % where a value is good enough and 0 % where it is not good at all; between the two it goes with the \
         value. Those of time, path, economy and camera are then multiplied by the share of the goals that was done. The table below has both \
         values of each, and its bars are green from 67 % on and red below 34 %. A group is the mean of its scores, each by its weight; a dash \
         means that there is nothing to score.</p>\n",
    );
}

fn tile(page: &mut String, sessions: &Sessions, name: &str, score: impl Fn(&Column) -> Option<f64>) {
    let _ = write!(page, "<div class=\"tile\"><b>{}</b><span>{name}</span>", percent(score(&sessions.reported)));
    let earlier = |(index, column): (usize, &Column)| format!("{} {}", letter(index), percent(score(column)));
    let earlier: Vec<String> = sessions.earlier.iter().enumerate().map(earlier).collect();
    if !earlier.is_empty() {
        let _ = write!(page, "<small>{}</small>", earlier.join(", "));
    }
    page.push_str("</div>\n");
}

/// What is to be worked on first.
fn dearest(page: &mut String, column: &Column) {
    let losses = losses(&column.scores);
    if losses.is_empty() {
        return;
    }
    page.push_str("<section><h2>What cost most</h2>\n<ul>\n");
    for loss in losses {
        let (definition, value) = (loss.metric.definition, valued(loss.metric));
        let goals = loss.of_goals(column.scores.done);
        let full = loss.metric.scale.map_or_else(String::new, |scale| format!(" (100 % at {}{goals})", scale.full));
        let (name, unit, group) = (escape(definition.name), definition.unit, definition.group.name());
        let _ = writeln!(page, "<li><b>{:.1} of 100</b>: {name}, {value} {unit}{full}; {group}</li>", loss.points);
    }
    page.push_str("</ul>\n<p class=\"note\">So much each takes from the mean of all scores, by its weight.</p></section>\n");
}

/// What was seen when something happened, in the page itself.
fn pictures(page: &mut String, column: &Column) {
    let measured = &column.assessment.measured;
    if measured.pictures.is_empty() {
        return;
    }
    page.push_str("<section><h2>Pictures</h2>\n<div class=\"pictures\">\n");
    for picture in &measured.pictures {
        let words = escape(&plain(&picture.words));
        let time_s = seconds(measured.conduct.since_start(picture.event_tick));
        let _ = writeln!(
            page,
            "<figure><img alt=\"{words}\" src=\"data:image/jpeg;base64,{}\"><figcaption><b>{time_s:.1} s</b> {words}</figcaption></figure>",
            BASE64_STANDARD.encode(&picture.jpeg)
        );
    }
    page.push_str("</div></section>\n");
}

fn metrics(page: &mut String, sessions: &Sessions) {
    page.push_str(&wide_table("Values and scores"));
    page.push_str("\n<thead><tr><th>metric</th><th>value</th><th class=\"text\">unit</th><th>score</th>");
    for index in 0..sessions.earlier.len() {
        let _ = write!(page, "<th>{0}</th><th>score {0}</th>", letter(index));
    }
    page.push_str("<th>100 % at</th><th>0 % at</th><th>weight</th><th class=\"text\">from where</th></tr></thead>\n");
    for (at, group) in Group::ALL.into_iter().enumerate() {
        let _ = write!(page, "<tr class=\"group\"><td>{}</td><td></td><td></td>", group.name());
        total(page, sessions, |column| column.scores.groups[at]);
        for (index, metric) in sessions.reported.scores.metrics.iter().enumerate() {
            if metric.definition.group == group {
                row(page, sessions, index, metric);
            }
        }
    }
    page.push_str("<tr class=\"group\"><td>All</td><td></td><td></td>");
    total(page, sessions, |column| column.scores.total);
    page.push_str("</table></div>\n");
}

/// The rest of the line of a group.
fn total(page: &mut String, sessions: &Sessions, score: impl Fn(&Column) -> Option<f64>) {
    page.push_str(&scored(score(&sessions.reported)));
    for column in &sessions.earlier {
        let _ = write!(page, "<td></td>{}", scored(score(column)));
    }
    page.push_str("<td></td><td></td><td></td><td></td></tr>\n");
}

fn row(page: &mut String, sessions: &Sessions, index: usize, metric: &Metric) {
    let definition = metric.definition;
    let score = |metric: &Metric| if metric.scale.is_some() { scored(metric.score) } else { "<td></td>".into() };
    let _ = write!(
        page,
        "<tr><td>{}</td><td>{}</td><td class=\"text\">{}</td>{}",
        escape(definition.name),
        valued(metric),
        definition.unit,
        score(metric)
    );
    for column in &sessions.earlier {
        if let Some(metric) = column.scores.metrics.get(index) {
            let _ = write!(page, "<td>{}</td>{}", valued(metric), score(metric));
        }
    }
    let _ = match metric.scale {
        Some(scale) => write!(page, "<td>{}</td><td>{}</td><td>{}</td>", scale.full, scale.none, scale.weight),
        None => write!(page, "<td></td><td></td><td></td>"),
    };
    let _ = writeln!(page, "<td class=\"text source\">{}</td></tr>", escape(metric.source));
}

/// A score with its bar.
fn scored(score: Option<f64>) -> String {
    let bar = score.map_or_else(String::new, |score| {
        let class = if score < 34.0 {
            "low"
        } else if score < 67.0 {
            "middle"
        } else {
            "high"
        };
        format!("<span class=\"bar\"><i class=\"{class}\" style=\"width:{score:.0}%\"></i></span>")
    });
    format!("<td>{}{bar}</td>", percent(score))
}

/// What of a second was largest, of each process, and its means.
fn processes(page: &mut String, column: &Column) {
    let processes = &column.assessment.measured.conduct.processes;
    if processes.all().next().is_none() {
        return;
    }
    page.push_str(
        "<h2>Processes</h2>\n<p class=\"note\">The rate and the loop's median are means over the session; the 99th percentiles are those of the worst second.</p>\n",
    );
    page.push_str(&wide_table("Processes"));
    page.push_str(
        "\n<thead><tr><th class=\"text\">process</th><th>incarnations</th><th>steps/s</th><th>late steps</th>\
         <th>wake-up p99 \u{b5}s</th><th>loop p50 \u{b5}s</th><th>loop p99 \u{b5}s</th></tr></thead>\n",
    );
    for (name, process) in processes.all() {
        let us = |value: Option<f64>| value.map_or_else(|| NONE.to_string(), |us| format!("{us:.0}"));
        let _ = writeln!(
            page,
            "<tr><td class=\"text\">{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            escape(name),
            process.incarnations,
            process.rate_hz().map_or_else(|| NONE.to_string(), |hz| format!("{hz:.1}")),
            process.overruns,
            us(process.wakeup_p99_us),
            us(process.loop_p50_us()),
            us(process.loop_p99_us)
        );
    }
    page.push_str("</table></div>\n");
}

fn events(page: &mut String, column: &Column) {
    let conduct = &column.assessment.measured.conduct;
    if conduct.events.is_empty() {
        return;
    }
    page.push_str("<h2>Faults and takeovers</h2>\n");
    page.push_str(&wide_table("Faults and takeovers"));
    page.push_str(
        "\n<thead><tr><th>s</th><th>tick</th><th class=\"text\">level</th>\
         <th class=\"text\">what</th><th class=\"text\">process</th><th class=\"text\">in words</th></tr></thead>\n",
    );
    for event in &conduct.events {
        let level = word(event.level);
        let _ = writeln!(
            page,
            "<tr><td>{:.3}</td><td>{}</td><td class=\"text {level}\">{level}</td><td class=\"text\">{}</td><td class=\"text\">{}</td><td class=\"text\">{}</td></tr>",
            seconds(conduct.since_start(event.tick)),
            event.tick,
            escape(&event.kind),
            escape(&event.process),
            escape(&event.text)
        );
    }
    page.push_str("</table></div>\n");
    if conduct.events_left_out > 0 {
        let _ = writeln!(page, "<p class=\"note\">And {} later ones.</p>", conduct.events_left_out);
    }
}

/// What is not there, and where the scores come from.
fn origin(page: &mut String) {
    page.push_str("<section><h2>Not in a recording</h2>\n<ul>\n");
    for (group, what, why) in ABSENT {
        let _ = writeln!(page, "<li>{}: {}; {}</li>", group.name(), escape(what), escape(why));
    }
    page.push_str(
        "</ul>\n<p class=\"note\">Groups after Bajka et al. 2010, with the task of the case. A score goes linearly from 100 % to 0 % between the two values beside it and counts by its \
         weight; what was not recorded weighs nothing. Where a case called for goals, the scores of time, path, economy and turning of the camera head \
         are multiplied by the share of them that was done, each by its weight, and the score of all by the mean of that share and 1: who does nothing is \
         not good at it. The time of a session that was broken off before its goals or its end has no score. \
         Everything is computed from the recording alone, the same each time. This is no certificate: \
         a range that is marked as assumed is a guess until a course has set its own.</p></section>\n",
    );
}
