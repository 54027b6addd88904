//! Two campaigns beside each other as plain text.

use super::{Comparison, Row, Shown, Side};
use crate::campaign::bounds::Told;
use crate::campaign::judge::Verdict;
use crate::campaign::text::{head, list, word};
use std::fmt::Write;

/// The heading, the table, what only one of them has, and at last what is beyond doubt.
pub(super) fn text(comparison: &Comparison) -> String {
    let mut text = heading("1", &comparison.first) + &heading("2", &comparison.second);
    text += &match comparison.differ.len() {
        0 => "\nboth are of one file, seed, build, machine and day\n".to_string(),
        _ => format!("\nbeside what is compared they differ in: {}\n", comparison.differ.join(", ")),
    };
    text += "a/b is of 1 and of 2; of found and recovered it is the median and the 95th percentile, ms; in brackets stand one-sided 95 % bounds, each alone\n";
    let rows = || comparison.pools.iter().map(|row| (row, "pool ")).chain(comparison.cells.iter().map(|row| (row, "")));
    let mut arms: Vec<&str> = rows().map(|(row, _)| row.arm.as_str()).collect();
    arms.sort_unstable();
    arms.dedup();
    for arm in arms {
        let _ = write!(
            text,
            "\narm {arm}\n{:<42} {:>11} {:>11} {:>9} {:>27} {:>27} {:>27} {:>17} {:>17} {:>11} {:>17} {:>17} {:>11} {:>11} {:>17}  what is beyond doubt\n",
            "pool or cell",
            "injected",
            "shown",
            "none",
            "excess 1",
            "excess 2",
            "difference",
            "found 1",
            "found 2",
            "ratio",
            "recovered 1",
            "recovered 2",
            "ratio",
            "step/N",
            "verdict"
        );
        for (row, kind) in rows().filter(|(row, _)| row.arm == arm) {
            text.push_str(&line(row, kind));
        }
    }
    list(&mut text, "only in 1", &comparison.first_alone);
    list(&mut text, "only in 2", &comparison.second_alone);
    let _ = writeln!(text, "\n{}", told(comparison));
    text
}

/// Which campaign a number stands for: where it lies, how far it has come, and by which build, on which machine and days.
fn heading(number: &str, side: &Side) -> String {
    let head = head(&side.campaign, side.seed, [side.done, side.planned]);
    let mut text = format!("\n{number}: {}: {head}\n", side.folder);
    for batch in &side.origins {
        let _ = writeln!(text, "{}", batch.words());
    }
    for line in &side.unknown {
        let _ = writeln!(text, "- {line}");
    }
    text
}

fn line(row: &Row, kind: &str) -> String {
    let both = |of: fn(&Shown) -> usize| format!("{}/{}", of(&row.first), of(&row.second));
    let bounded = |mean: f64, lower: f64, upper: f64| format!("{mean:.4} ({lower:.4} to {upper:.4})");
    let excess = |shown: &Shown| shown.excess.map_or("-".into(), |it| bounded(it.mean, it.lower95, it.upper95));
    let times = |times: Option<[f64; 2]>| times.map_or("-".into(), |[half, most]| format!("{half:.1}/{most:.1}"));
    let ratio = |ratio: Option<f64>| ratio.map_or("-".into(), |ratio| format!("{ratio:.2}"));
    let ratios = |[half, most]: [Option<f64>; 2]| format!("{}/{}", ratio(half), ratio(most));
    let text = format!(
        "{:<42} {:>11} {:>11} {:>9} {:>27} {:>27} {:>27} {:>17} {:>17} {:>11} {:>17} {:>17} {:>11} {:>11} {:>17}  {}",
        format!("{kind}{}", row.name),
        both(|shown| shown.injected),
        both(|shown| shown.manifested),
        both(|shown| shown.without_verdict),
        excess(&row.first),
        excess(&row.second),
        row.difference.map_or("-".into(), |it| bounded(it.mean, it.lower95, it.upper95)),
        times(row.first.detected_ms),
        times(row.second.detected_ms),
        ratios(row.detected_ratio),
        times(row.first.recovered_ms),
        times(row.second.recovered_ms),
        ratios(row.recovered_ratio),
        format!("{:.3}/{:.3}", row.first.step_max_n, row.second.step_max_n),
        format!("{}/{}", verdict(row.first.verdict), verdict(row.second.verdict)),
        remark(row)
    );
    format!("{}\n", text.trim_end())
}

fn verdict(of: Verdict) -> &'static str {
    if of == Verdict::Figures { "-" } else { word(of) }
}

/// What is concluded of a row, or why nothing is.
fn remark(row: &Row) -> &'static str {
    match row.told {
        _ if !row.alike => "it is of other cells in 2, or they may cost otherwise: nothing is concluded",
        Some(Told::Worse) => "worse",
        Some(Told::Better) => "better",
        None => "",
    }
}

/// The last line.
fn told(comparison: &Comparison) -> String {
    let said = |what: &str, names: &[String]| (!names.is_empty()).then(|| format!("{what} beyond doubt: {}", names.join("; ")));
    let lines: Vec<String> =
        [said("worse", &comparison.worse), said("better", &comparison.better)].into_iter().flatten().collect();
    match () {
        () if comparison.exit_code == 3 => {
            "nothing can be compared: no pool and no cell is of the same faults in both, and has some with a verdict in both"
                .into()
        }
        () if lines.is_empty() => "nothing can be told: no difference is beyond doubt".into(),
        () => lines.join(". "),
    }
}
