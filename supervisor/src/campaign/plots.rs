//! The plots of a campaign's page, as SVG in plain text: the excess of each cell between its bounds, the distributions of the times, and the
//! faults over the ticks of each station.

use super::judge::{Figures, Judgement, Verdict};
use super::outcome::Outcome;
use super::text::percentile;
use crate::fault::compare::excess as excess_of;
use hyst_assessment::escape;
use std::fmt::Write;

/// Width of a plot, and of the names at its left, px.
const WIDTH: f64 = 960.0;
const NAMES: f64 = 360.0;
/// Height of a row, px.
const ROW: f64 = 22.0;
/// Above and below the rows, px.
const HEAD: f64 = 26.0;
const FOOT: f64 = 34.0;
/// Most dots that are drawn for one distribution; more say nothing new.
const MOST_DOTS: usize = 400;

/// The colour of a verdict.
pub fn colour(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Figures => "#6b7280",
        Verdict::Held => "#15803d",
        Verdict::Unknown => "#b45309",
        Verdict::Broken => "#b91c1c",
    }
}

/// The colour of a role.
pub fn role_colour(cell: &str) -> &'static str {
    let role = cell.split(' ').nth(1).and_then(|target| target.split(':').next()).unwrap_or("");
    match role {
        "haptic" => "#2563eb",
        "tissue" => "#c2410c",
        "device" => "#7c3aed",
        "collision-worker" => "#0f766e",
        "fluid" => "#0891b2",
        "rendering" => "#a16207",
        "recorder" => "#be185d",
        "console" => "#4d7c0f",
        _ => "#374151",
    }
}

/// Where a value lies between the plot's left and right, linearly or by its logarithm.
struct Scale {
    from: f64,
    to: f64,
    by_logarithm: bool,
}

impl Scale {
    fn x(&self, value: f64) -> f64 {
        let place = |value: f64| if self.by_logarithm { value.max(self.from).log10() } else { value };
        let share = (place(value) - place(self.from)) / (place(self.to) - place(self.from));
        NAMES + share.clamp(0.0, 1.0) * (WIDTH - NAMES - 24.0)
    }
    fn grid(&self, height: f64, marks: &[f64], unit: &str) -> String {
        let mut svg = String::new();
        for mark in marks {
            let x = self.x(*mark);
            let _ = write!(
                svg,
                "<line x1=\"{x:.1}\" y1=\"{HEAD}\" x2=\"{x:.1}\" y2=\"{:.1}\" class=\"grid\"/><text x=\"{x:.1}\" y=\"{:.1}\" class=\"mark\">{mark}</text>",
                height - FOOT,
                height - FOOT + 16.0
            );
        }
        let _ = write!(svg, "<text x=\"{:.1}\" y=\"{:.1}\" class=\"mark\">{unit}</text>", 0.5 * (NAMES + WIDTH), height - 3.0);
        svg
    }
}

fn frame(rows: usize, label: &str, inside: &str) -> String {
    if rows == 0 {
        return "<p class=\"note\">No fault yet.</p>\n".into();
    }
    let height = HEAD + FOOT + rows as f64 * ROW;
    format!("<svg viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{}\">{inside}</svg>\n", escape(label))
}

fn name(row: usize, text: &str, colour: &str) -> String {
    let y = HEAD + (row as f64 + 0.5) * ROW + 4.0;
    format!("<text x=\"{:.1}\" y=\"{y:.1}\" class=\"name\" fill=\"{colour}\">{}</text>", NAMES - 10.0, escape(text))
}

/// Faults with excess misses per fault: a dot between its one-sided 95 % bounds, and the limit as a bar, for each cell and pool.
pub fn excess(judgement: &Judgement, arm: &str) -> String {
    let pool_name = |figures: &Figures| format!("pool {}", figures.name);
    let pools = judgement.pools.iter().map(|figures| (pool_name(figures), figures));
    let cells = judgement.cells.iter().map(|figures| (figures.name.clone(), figures));
    let rows: Vec<(String, &Figures)> =
        pools.chain(cells).filter(|(_, figures)| figures.arm == arm && figures.excess.is_some()).collect();
    let most = rows
        .iter()
        .filter_map(|(_, figures)| figures.excess)
        .map(|excess| excess.upper95.abs().max(excess.lower95.abs()))
        .fold(0.05, f64::max);
    let step = [0.01, 0.02, 0.05, 0.1, 0.25, 0.5].into_iter().find(|step| most / step <= 5.0).unwrap_or(0.5);
    let marks: Vec<f64> =
        (-5..=5).map(|mark| (f64::from(mark) * step * 100.0).round() / 100.0).filter(|mark| mark.abs() <= most + step).collect();
    let scale = Scale { from: -most, to: most, by_logarithm: false };
    let height = HEAD + FOOT + rows.len() as f64 * ROW;
    let mut svg = scale.grid(
        height,
        &marks.into_iter().filter(|mark| mark.abs() <= most).collect::<Vec<_>>(),
        "faults with excess misses, per fault",
    );
    for (row, (label, figures)) in rows.iter().enumerate() {
        let Some(excess) = figures.excess else { continue };
        let (y, colour) = (HEAD + (row as f64 + 0.5) * ROW, colour(figures.verdict));
        svg.push_str(&name(row, label, colour));
        let tip = format!(
            "{} of {} worse, {} better: {:.4} ({:.4} to {:.4})",
            excess.worse, excess.faults, excess.better, excess.mean, excess.lower95, excess.upper95
        );
        let (low, mean, high) = (scale.x(excess.lower95), scale.x(excess.mean), scale.x(excess.upper95));
        let _ = write!(
            svg,
            "<g><title>{tip}</title><line x1=\"{low:.1}\" y1=\"{y:.1}\" x2=\"{high:.1}\" y2=\"{y:.1}\" stroke=\"{colour}\" stroke-width=\"3\" stroke-linecap=\"round\"/>\
             <circle cx=\"{mean:.1}\" cy=\"{y:.1}\" r=\"4.5\" fill=\"{colour}\"/></g>"
        );
        if let Some(limit) = figures.limit_upper95.filter(|limit| limit.abs() <= most) {
            let x = scale.x(limit);
            let _ =
                write!(svg, "<line x1=\"{x:.1}\" y1=\"{:.1}\" x2=\"{x:.1}\" y2=\"{:.1}\" class=\"limit\"/>", y - 9.0, y + 9.0);
        }
    }
    frame(rows.len(), "faults with excess misses, per fault", &svg)
}

/// The distribution of a time for each cell, ms, by its logarithm: a dot for each fault, a bar at the median.
pub fn times(judgement: &Judgement, arm: &str, label: &str, list: impl Fn(&Figures) -> &[f64]) -> String {
    let rows: Vec<&Figures> = judgement.cells.iter().filter(|figures| figures.arm == arm && !list(figures).is_empty()).collect();
    // A start that hangs takes an ordinary process three minutes.
    let scale = Scale { from: 0.1, to: 200_000.0, by_logarithm: true };
    let height = HEAD + FOOT + rows.len() as f64 * ROW;
    let mut svg = scale.grid(
        height,
        &[0.1, 1.0, 10.0, 100.0, 1_000.0, 10_000.0, 100_000.0],
        "ms (what is below 0.1 ms lies at the left edge)",
    );
    for (row, figures) in rows.iter().enumerate() {
        let (y, colour) = (HEAD + (row as f64 + 0.5) * ROW, role_colour(&figures.name));
        svg.push_str(&name(row, &figures.name, "#1f2937"));
        let values = list(figures);
        for value in values.iter().step_by(values.len() / MOST_DOTS + 1) {
            let _ = write!(
                svg,
                "<circle cx=\"{:.1}\" cy=\"{y:.1}\" r=\"3.5\" fill=\"{colour}\" fill-opacity=\"0.25\"/>",
                scale.x(*value)
            );
        }
        let x = scale.x(percentile(values, 0.5).unwrap_or(0.0));
        let (middle, most) = (percentile(values, 0.5).unwrap_or(0.0), percentile(values, 1.0).unwrap_or(0.0));
        let _ = write!(
            svg,
            "<line x1=\"{x:.1}\" y1=\"{:.1}\" x2=\"{x:.1}\" y2=\"{:.1}\" stroke=\"{colour}\" stroke-width=\"2.5\"><title>median {middle:.1} ms, largest {most:.1} ms</title></line>",
            y - 8.0,
            y + 8.0
        );
    }
    frame(rows.len(), label, &svg)
}

/// The faults over the ticks of each station; one that missed more than its control is large and red.
pub fn timeline(outcomes: &[Outcome]) -> String {
    let mut stations: Vec<(usize, &str)> = outcomes.iter().map(|outcome| (outcome.station, outcome.arm.as_str())).collect();
    stations.sort_unstable();
    stations.dedup();
    let last_tick = outcomes.iter().map(|outcome| outcome.tick).max().unwrap_or(1) as f64;
    let scale = Scale { from: 0.0, to: last_tick * 1e-3, by_logarithm: false };
    let step = [5.0, 10.0, 20.0, 30.0, 60.0, 120.0, 300.0, 600.0]
        .into_iter()
        .find(|step| last_tick * 1e-3 / step <= 8.0)
        .unwrap_or(1_800.0);
    let marks: Vec<f64> = (0..9).map(|mark| f64::from(mark) * step).filter(|mark| *mark <= last_tick * 1e-3).collect();
    let height = HEAD + FOOT + stations.len() as f64 * ROW;
    let mut svg = scale.grid(height, &marks, "seconds of the station's clock");
    for (row, (station, arm)) in stations.iter().enumerate() {
        let y = HEAD + (row as f64 + 0.5) * ROW;
        svg.push_str(&name(row, &format!("station {station}, {arm}"), "#1f2937"));
        for outcome in outcomes.iter().filter(|outcome| outcome.station == *station) {
            let windows = outcome.fault.as_ref().and_then(|fault| Some((fault.window?, fault.control?)));
            let is_worse = windows.is_some_and(|(window, control)| excess_of(&window, &control) > 0);
            let (radius, colour) = if is_worse { (6.0, "#dc2626") } else { (3.5, role_colour(&outcome.cell)) };
            let missed = windows.map_or("no verdict".to_string(), |(window, control)| {
                format!("missed {}, control {}", window.missed, control.missed)
            });
            let _ = write!(
                svg,
                "<circle cx=\"{:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{colour}\" fill-opacity=\"0.75\"><title>{}: {} at tick {}: {missed}</title></circle>",
                scale.x(outcome.tick as f64 * 1e-3),
                outcome.index,
                escape(&outcome.cell),
                outcome.tick
            );
        }
    }
    frame(stations.len(), "faults over the ticks of each station", &svg)
}
