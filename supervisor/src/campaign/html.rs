//! A campaign's report as one page that needs nothing beside it: no script, no network, plots as SVG.

use super::advice::advice;
use super::judge::{Figures, Judgement, Verdict};
use super::outcome::Outcome;
use super::plots;
use super::station::StationOutcome;
use super::text::{
    self, besides, came_beside, counts, first_not_shown, not_shown, percentile, segments, shortened, target_of, unnoticed,
};
use hyst_assessment::{escape, wide_table};
use std::fmt::Write;

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;color:#1f2937;background:#fff;max-width:1320px;margin:2rem auto;padding:0 1rem}\
h1{font-size:1.6rem;margin-bottom:.2rem}h2{font-size:1.2rem;margin-top:2.2rem;border-bottom:1px solid #e5e7eb;padding-bottom:.2rem}h3{font-size:1rem;margin:1.2rem 0 0}\
.banner{padding:.7rem 1rem;border-radius:8px;color:#fff;font-weight:600;display:inline-block;margin:.6rem 0}p.note{color:#4b5563;max-width:75ch}\
.wide{overflow-x:auto}:focus-visible{outline:3px solid #1d4ed8;outline-offset:2px}table{border-collapse:collapse;font-size:12px;width:100%}th{text-align:right;color:#4b5563;font-weight:600;border-bottom:2px solid #d1d5db;padding:.3rem .35rem;vertical-align:bottom}\
td{text-align:right;border-bottom:1px solid #f0f1f3;padding:.25rem .35rem;font-variant-numeric:tabular-nums;white-space:nowrap}th:first-child,td:first-child{text-align:left}\
tr.pool td{background:#f9fafb;font-weight:600}svg{width:100%;height:auto;display:block}.grid{stroke:#e5e7eb}.mark{font-size:12px;fill:#6b7280;text-anchor:middle}\
.name{font-size:12.5px;text-anchor:end}.limit{stroke:#111827;stroke-width:2;stroke-dasharray:3 2}li{margin:.2rem 0}.key{display:inline-block;margin-right:1rem}\
.key i{display:inline-block;width:.8em;height:.8em;border-radius:50%;margin-right:.35em;vertical-align:-.05em}";

/// The page.
pub fn html(judgement: &Judgement, outcomes: &[Outcome], stations: &[StationOutcome]) -> String {
    let title = format!("Fault campaign {}", escape(&judgement.campaign));
    let (verdict, words) = match judgement.exit_code {
        1 => (Verdict::Broken, "A promise was broken"),
        3 => (Verdict::Unknown, "Of some promises nothing can be said"),
        _ if judgement.done < judgement.planned => (Verdict::Unknown, "No promise was broken so far; the plan is not through"),
        _ if !judgement.has_promises() => (Verdict::Figures, "No promise was judged"),
        _ => (Verdict::Held, "Every promise held"),
    };
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\"><title>{title}</title>\
         <style>{STYLE}</style></head><body>\n<h1>{title}</h1>\n<div class=\"banner\" style=\"background:{}\">{words}</div>\n<p class=\"note\">Seed {}, \
         {} of {} faults, {} stations, {:.0} s of the hardware's clock, {:.2} % of its ticks void because the host itself stalled; {:.1} % of the \
         faults without a verdict.</p>\n",
        plots::colour(verdict),
        judgement.seed,
        judgement.done,
        judgement.planned,
        stations.len(),
        stations.iter().map(|station| station.ticks).sum::<u64>() as f64 * 1e-3,
        100.0 * stations.iter().map(|station| station.voided).sum::<u64>() as f64
            / stations.iter().map(|station| station.ticks).sum::<u64>().max(1) as f64,
        100.0 * judgement.void_share
    );
    for batch in &judgement.origins {
        let _ = writeln!(page, "<p class=\"note\">{}</p>", escape(&batch.words()));
    }
    list(&mut page, "What to do next", &advice(judgement));
    reasons(&mut page, judgement);
    let mut arms: Vec<&str> = judgement.cells.iter().map(|cell| cell.arm.as_str()).collect();
    arms.dedup();
    for arm in arms {
        self::arm(&mut page, judgement, arm);
    }
    segments_table(&mut page, judgement);
    timeline(&mut page, outcomes);
    page.push_str("<h2>Stations</h2>\n");
    page.push_str(&stations_table(stations));
    page.push_str("</body></html>\n");
    page
}

fn reasons(page: &mut String, judgement: &Judgement) {
    let of_cells = judgement.cells.iter().chain(&judgement.pools);
    let of_cells =
        of_cells.flat_map(|figures| figures.reasons.iter().map(|reason| format!("{}, {}: {reason}", figures.arm, figures.name)));
    let all: Vec<String> = judgement.broken.iter().chain(&judgement.unknown).cloned().chain(of_cells).collect();
    list(page, "What speaks against it", &all);
    let named = |said: fn(&Figures) -> Option<String>| -> Vec<String> {
        let line = |figures: &Figures| Some(format!("{}, {}: {}", figures.arm, figures.name, said(figures)?));
        judgement.cells.iter().filter_map(line).collect()
    };
    let beside = |figures: &Figures| -> Vec<String> {
        shortened(&figures.collateral).iter().map(|line| format!("{}, {}: {line}", figures.arm, figures.name)).collect()
    };
    list(page, "Who else died, or hung and was ended", &judgement.cells.iter().flat_map(beside).collect::<Vec<_>>());
    list(page, "What did not show", &named(not_shown));
    list(page, "Whose first fault did not show", &named(first_not_shown));
    list(page, "What came after its recovery, hand-over or swap", &named(came_beside));
    list(page, "What showed fewer than twenty times, which changes no verdict", &judgement.few);
    list(page, "What was done and not noticed", &named(unnoticed));
}

/// A heading with its lines, if there are any.
fn list(page: &mut String, heading: &str, lines: &[String]) {
    if lines.is_empty() {
        return;
    }
    let _ = writeln!(page, "<h2>{heading}</h2>\n<ul>");
    for line in lines {
        let _ = writeln!(page, "<li>{}</li>", escape(line));
    }
    page.push_str("</ul>\n");
}

/// Picks one list of times out of a cell's figures, ms.
type TimesOf = fn(&Figures) -> &[f64];

fn arm(page: &mut String, judgement: &Judgement, arm: &str) {
    let _ = write!(
        page,
        "<h2>Arm {}</h2>\n<h3>Excess misses</h3>\n<p class=\"note\">Faults that missed more ticks than their control window and what they may cost, less those that missed \
         fewer, per fault; the bar lies between the exact one-sided 95 % bounds, each alone, the dashed line is the limit of the upper one.</p>\n{}",
        escape(arm),
        plots::excess(judgement, arm)
    );
    page.push_str(&table(judgement, arm));
    let lists: [(&str, TimesOf); 3] = [
        ("Until it was found", |figures| &figures.detected_ms),
        ("Until the last tick that missed its force (0: the hand never noticed)", |figures| &figures.contained_ms),
        ("Until a successor was warm or live", |figures| &figures.recovered_ms),
    ];
    for (label, list) in lists {
        let _ = write!(page, "<h3>{label}</h3>\n{}", plots::times(judgement, arm, label, list));
    }
}

fn table(judgement: &Judgement, arm: &str) -> String {
    let mut text = wide_table("Cells");
    text.push_str(
        "<tr><th>cell</th><th>verdict</th><th>injected</th><th>shown</th><th>no verdict</th><th>found by</th><th>found ms<br>median / largest</th>\
         <th>contained ms<br>median / largest</th><th>recovered ms<br>median / largest</th><th>worse / better<br>(with void ticks)</th><th>excess</th><th>one-sided<br>95 % bounds</th><th>limit</th><th>excess misses<br>mean &lt; 95 %</th><th>allowed<br>each</th><th>missed ticks<br>fault / control</th><th>of ticks right<br>after, missed</th>\
         <th>largest force step N<br>fault / control</th><th>invalid or stale<br>applied, ticks</th><th>void ticks<br>fault / control</th><th>data lost<br>ticks</th><th>left over</th><th>who else<br>died or hung</th><th>what else<br>came of it</th></tr>\n",
    );
    for (is_pool, figures) in judgement.cells.iter().map(|f| (false, f)).chain(judgement.pools.iter().map(|f| (true, f))) {
        if figures.arm == arm {
            text.push_str(&row(is_pool, figures));
        }
    }
    text.push_str("</table></div>\n");
    text
}

fn row(is_pool: bool, figures: &Figures) -> String {
    let times = |list: &[f64]| match (percentile(list, 0.5), percentile(list, 1.0)) {
        (Some(middle), Some(most)) => format!("{middle:.1} / {most:.1}"),
        _ => "–".into(),
    };
    let found: Vec<String> = figures.detected_by.iter().map(|(by, count)| format!("{} {count}", escape(by))).collect();
    let with_void = figures.excess_with_void.map_or(String::new(), |excess| format!(" ({} / {})", excess.worse, excess.better));
    let excess = figures.excess.map_or(["–".to_string(), "–".into(), "–".into()], |excess| {
        [
            format!("{} / {}{with_void}", excess.worse, excess.better),
            format!("{:.4}", excess.mean),
            format!("{:.4} … {:.4}", excess.lower95, excess.upper95),
        ]
    });
    let word = match figures.verdict {
        Verdict::Figures => "",
        Verdict::Held => "held",
        Verdict::Unknown => "unknown",
        Verdict::Broken => "broken",
    };
    let cells = [
        format!("{} / {}", figures.injected, figures.planned),
        figures.manifested.to_string(),
        figures.without_verdict.to_string(),
        found.join(", "),
        times(&figures.detected_ms),
        times(&figures.contained_ms),
        times(&figures.recovered_ms),
        excess[0].clone(),
        excess[1].clone(),
        excess[2].clone(),
        figures.limit_upper95.map_or("–".into(), |limit| limit.to_string()),
        text::mean(figures, " < "),
        figures.allowed_misses.to_string(),
        format!("{} / {}", figures.missed[0], figures.missed[1]),
        format!("{} / {}", figures.aftermath[1], figures.aftermath[0]),
        format!("{:.3} / {:.3}", figures.step_max_n[0], figures.step_max_n[1]),
        figures.wrong.to_string(),
        format!("{} / {}", figures.window_ticks[1], figures.control_ticks[1]),
        figures.data_lost_ticks.to_string(),
        figures.leftovers.to_string(),
        escape(&shortened(&figures.collateral).join("; ")),
        escape(&besides(figures).join(", ")),
    ];
    let cells: String = cells.iter().map(|cell| format!("<td>{cell}</td>")).collect();
    format!(
        "<tr{}><td>{}{}</td><td style=\"color:{};font-weight:600\">{word}</td>{cells}</tr>\n",
        if is_pool { " class=\"pool\"" } else { "" },
        if is_pool { "pool " } else { "" },
        escape(&figures.name),
        plots::colour(figures.verdict)
    )
}

fn timeline(page: &mut String, outcomes: &[Outcome]) {
    page.push_str("<h2>Faults over the ticks</h2>\n<p class=\"note\">");
    for role in ["haptic", "tissue", "device", "collision-worker", "fluid", "rendering", "recorder", "console", "supervisor"] {
        let colour = plots::role_colour(&format!("kill {role}"));
        let _ = write!(page, "<span class=\"key\"><i style=\"background:{colour}\"></i>{role}</span>");
    }
    page.push_str("<span class=\"key\"><i style=\"background:#dc2626\"></i>large: missed more than its control</span></p>\n");
    page.push_str(&plots::timeline(outcomes));
}

/// What was noticed of what is only done from outside, segment by segment.
fn segments_table(page: &mut String, judgement: &Judgement) {
    let rows = segments(judgement);
    if rows.is_empty() {
        return;
    }
    page.push_str(
        "<h2>What was noticed of what is only done from outside</h2>\n<p class=\"note\">That bytes were flipped is no sign that anybody read them: faults of which \
         nothing was noticed are in no bound.</p>\n",
    );
    page.push_str(&wide_table("What was noticed"));
    page.push_str(
        "<tr><th>where</th><th>target</th><th>arm</th><th>done</th><th>noticed</th>\
         <th>noticed by, or what became of it</th><th>died</th><th>and else</th><th>excess misses</th><th>invalid or stale<br>applied, ticks</th></tr>\n",
    );
    for figures in rows {
        let cells = [
            target_of(figures).to_string(),
            figures.arm.clone(),
            figures.injected.to_string(),
            (figures.injected - figures.unnoticed.len()).to_string(),
            counts(&figures.noticed),
            counts(&figures.died),
            counts(&figures.seen),
            figures.excess_misses.iter().sum::<i64>().to_string(),
            figures.wrong.to_string(),
        ];
        let cells: String = cells.iter().map(|cell| format!("<td>{}</td>", escape(cell))).collect();
        let _ = writeln!(page, "<tr><td>{}</td>{cells}</tr>", escape(&figures.segment));
    }
    page.push_str("</table></div>\n");
}

fn stations_table(stations: &[StationOutcome]) -> String {
    let mut text = wide_table("Stations");
    text.push_str(
        "<tr><th>station</th><th>arm</th><th>faults</th><th>ticks</th><th>void</th><th>invalid applied</th><th>stale applied</th>\
         <th>left over</th><th>given up</th><th>recorded ticks</th><th>exit code</th><th>remarks</th></tr>\n",
    );
    for station in stations {
        let trouble = (!station.trouble.is_empty()).then(|| station.trouble.clone());
        let broken = &station.promises_broken;
        let said = broken.first().map(|first| format!("{} broken by the rules of a single run: {first}", broken.len()));
        let remarks: Vec<String> = station.damage.iter().cloned().chain(trouble).chain(said).collect();
        let _ = writeln!(
            text,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            station.station,
            escape(&station.arm),
            station.faults.len(),
            station.ticks,
            station.voided,
            station.invalid_applied,
            station.stale_applied,
            station.leftovers,
            escape(&station.given_up.join(", ")),
            station.recorded_ticks,
            station.exit_code.map_or("killed".into(), |code| code.to_string()),
            escape(&remarks.join("; "))
        );
    }
    text.push_str("</table></div>\n");
    text
}
