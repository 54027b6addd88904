//! A campaign's report as plain text.

use super::advice::{advice, unknown};
use super::bounds::Excess;
use super::judge::{Figures, Judgement, Verdict};
use super::outcome::{Ending, Outcome};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Most lines of what came beside the faults of one cell.
const MOST_LINES: usize = 6;

/// The value below which a share of an ascending list lies; `None` of nothing.
pub fn percentile(ascending: &[f64], share: f64) -> Option<f64> {
    let last = ascending.len().checked_sub(1)?;
    ascending.get((share * last as f64).round() as usize).copied()
}

/// One line for a fault that is through.
pub fn line(outcome: &Outcome, planned: usize) -> String {
    let mut text = format!(
        "{:>6}/{planned} station {} tick {}+{:03} us  {:<40}",
        outcome.index, outcome.station, outcome.tick, outcome.injected_phase_us, outcome.cell
    );
    let ms = |us: Option<f64>| us.map_or("-".into(), |us| format!("{:.1}", us * 1e-3));
    match (&outcome.fault, outcome.ending) {
        (Some(fault), Ending::Closed) => {
            let missed = |window: Option<crate::ledger::Window>| window.map_or("-".into(), |window| window.missed.to_string());
            let _ = write!(
                text,
                " {} found {} ms by {}, recovered {} ms, missed {} (control {})",
                fault.target,
                ms(fault.detected_us),
                fault.detected_by,
                ms(fault.recovered_us),
                missed(fault.window),
                missed(fault.control)
            );
            if let Some(swap) = &outcome.swap {
                let _ = write!(text, "; after {:?} of the swap; {}", swap.stage, swap.end);
            }
        }
        _ => {
            let _ = write!(text, " {}", outcome.reason);
        }
    }
    text
}

/// A verdict; nothing of figures alone.
pub(super) fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Figures => "",
        Verdict::Held => "held",
        Verdict::Unknown => "UNKNOWN",
        Verdict::Broken => "BROKEN",
    }
}

/// Faults that missed more and fewer ticks than their controls.
fn sides(excess: &Excess) -> String {
    format!("{}/{}", excess.worse, excess.better)
}

/// The median and the largest of an ascending list of times; a dash of none.
pub fn times(list: &[f64]) -> String {
    match (percentile(list, 0.5), percentile(list, 1.0)) {
        (Some(middle), Some(most)) => format!("{middle:.1}/{most:.1}"),
        _ => "-".into(),
    }
}

/// The mean of the excess misses with its bound, which there is not where no fault lost any; a dash of none.
pub fn mean(figures: &Figures, below: &str) -> String {
    let bound = match figures.mean_excess_misses_upper95 {
        Some(_) if figures.lost_none() => " none lost".into(),
        Some(bound) => format!("{below}{bound:.2}"),
        None => String::new(),
    };
    figures.mean_excess_misses.map_or("-".into(), |mean| format!("{mean:.3}{bound}"))
}

/// Ticks right after the windows that missed their force, in words.
pub fn aftermath(figures: &Figures) -> Option<String> {
    let [ticks, missed] = figures.aftermath;
    (missed > 0).then(|| format!("{missed} of {ticks} ticks right after the windows missed"))
}

/// Share of void ticks of those that count and those that are void.
pub fn void_share([ticks, voided]: [u64; 2]) -> f64 {
    voided as f64 / (ticks + voided).max(1) as f64
}

fn row(figures: &Figures) -> String {
    let mut remarks: Vec<String> = figures.detected_by.iter().map(|(by, count)| format!("{by} {count}")).collect();
    remarks.extend(besides(figures));
    remarks.extend(aftermath(figures));
    let excess = figures.excess.map_or(("-".into(), "-".into(), "-".into()), |excess| {
        (sides(&excess), format!("{:.4}", excess.mean), format!("{:.4}", excess.upper95))
    });
    let with_void = figures.excess_with_void.map_or("-".into(), |excess| sides(&excess));
    let void = |of: [u64; 2]| format!("{:.1}", 100.0 * void_share(of));
    let [step, control_step] = figures.step_max_n;
    let limit = figures.limit_upper95.map_or("-".into(), |limit| limit.to_string());
    format!(
        "{:<42} {:>4}/{:<4} {:>5} {:>4} {:>14} {:>15} {:>15} {:>9} {:>8} {:>8} {:>6} {:>16} {:>7} {:>9} {:>9} {:>12} {:>5} {:>5} {:>4}  {:<8} {}\n",
        figures.name,
        figures.injected,
        figures.planned,
        figures.manifested,
        figures.without_verdict,
        times(&figures.detected_ms),
        times(&figures.contained_ms),
        times(&figures.recovered_ms),
        excess.0,
        excess.1,
        excess.2,
        limit,
        mean(figures, "<"),
        figures.allowed_misses,
        with_void,
        format!("{}/{}", void(figures.window_ticks), void(figures.control_ticks)),
        format!("{step:.3}/{control_step:.3}"),
        figures.wrong,
        figures.data_lost_ticks,
        figures.leftovers,
        word(figures.verdict),
        remarks.join(", ")
    )
}

/// The first lines of a list that may have hundreds, and how many more there are.
pub fn shortened(lines: &[String]) -> Vec<String> {
    let surplus = lines.len().saturating_sub(MOST_LINES);
    let rest = (surplus > 0).then(|| format!("… and {surplus} more, in report.json"));
    lines.iter().take(MOST_LINES).cloned().chain(rest).collect()
}

/// What faults brought about beside what they were to do, with how often: `others died 2`.
pub fn besides(figures: &Figures) -> Vec<String> {
    figures.seen.iter().map(|(what, count)| format!("{what} {count}")).collect()
}

/// The numbers of the faults of which nothing came, in words; `None` if there are none.
pub fn not_shown(figures: &Figures) -> Option<String> {
    numbered("nothing came of fault", &figures.not_shown)
}

fn numbered(words: &str, faults: &[usize]) -> Option<String> {
    let numbers: Vec<String> = faults.iter().map(usize::to_string).collect();
    (!numbers.is_empty()).then(|| format!("{words} {}", numbers.join(", ")))
}

/// The numbers of the second faults whose first did not show, in words; `None` if there are none.
pub fn first_not_shown(figures: &Figures) -> Option<String> {
    numbered("the first fault did not show, and the second has no verdict: fault", &figures.first_not_shown)
}

/// The numbers of the faults that came too late for what they were to fall into, in words; `None` if there are none.
pub fn came_beside(figures: &Figures) -> Option<String> {
    numbered("the recovery, hand-over or swap was over, and it has no verdict: fault", &figures.beside)
}

/// How often each, in words: `fluid 2, tissue 1`; a dash for none.
pub fn counts<K: std::fmt::Display>(counts: &BTreeMap<K, usize>) -> String {
    let words: Vec<String> = counts.iter().map(|(what, count)| format!("{what} {count}")).collect();
    if words.is_empty() { "-".into() } else { words.join(", ") }
}

/// The cells whose faults are only done from outside, by the segment that is damaged and the process that it is done to.
pub fn segments(judgement: &Judgement) -> Vec<&Figures> {
    let mut rows: Vec<&Figures> = judgement.cells.iter().filter(|figures| !figures.segment.is_empty()).collect();
    rows.sort_by(|a, b| (&a.arm, &a.segment, &a.name).cmp(&(&b.arm, &b.segment, &b.name)));
    rows
}

/// Who was hurt, of a cell's name.
pub fn target_of(figures: &Figures) -> &str {
    figures.name.split(' ').nth(1).unwrap_or("")
}

/// What was noticed of what is only done from outside, segment by segment.
fn segments_text(judgement: &Judgement) -> String {
    let rows = segments(judgement);
    if rows.is_empty() {
        return String::new();
    }
    let mut text = format!(
        "\nwhat was noticed of what is only done from outside\n{:<11} {:<19} {:>4} {:>7}  {:<52} {:<30} {:<34} {:>6} {:>5}\n",
        "where", "target", "done", "noticed", "noticed by, or what became of it", "died", "and else", "excess", "wrong"
    );
    for figures in rows {
        let _ = writeln!(
            text,
            "{:<11} {:<19} {:>4} {:>7}  {:<52} {:<30} {:<34} {:>6} {:>5}",
            figures.segment,
            target_of(figures),
            figures.injected,
            figures.injected - figures.unnoticed.len(),
            counts(&figures.noticed),
            counts(&figures.died),
            counts(&figures.seen),
            figures.excess_misses.iter().sum::<i64>(),
            figures.wrong
        );
    }
    text
}

/// The numbers of the faults that nobody noticed, in words; `None` if there are none.
pub fn unnoticed(figures: &Figures) -> Option<String> {
    numbered("done and not noticed: fault", &figures.unnoticed)
}

/// What speaks against cells and pools, and what else is to be known of them.
fn remarks(text: &mut String, judgement: &Judgement) {
    for figures in judgement.cells.iter().chain(&judgement.pools) {
        for reason in &figures.reasons {
            let _ = writeln!(text, "{}, {}: {reason}", figures.arm, figures.name);
        }
    }
    for figures in &judgement.cells {
        for line in shortened(&figures.collateral) {
            let _ = writeln!(text, "{}, {}: beside {line}", figures.arm, figures.name);
        }
        let lists = [not_shown(figures), first_not_shown(figures), came_beside(figures), unnoticed(figures)];
        for list in lists.into_iter().flatten() {
            let _ = writeln!(text, "{}, {}: {list}", figures.arm, figures.name);
        }
    }
}

/// Which campaign it is, and how far it has come.
pub(super) fn head(campaign: &str, seed: u64, [done, planned]: [usize; 2]) -> String {
    format!("campaign {campaign}, seed {seed}: {done} of {planned} faults are through")
}

/// The report.
pub fn text(judgement: &Judgement) -> String {
    let goes_on = if judgement.done < judgement.planned { "; the same command goes on" } else { "" };
    let head = head(&judgement.campaign, judgement.seed, [judgement.done, judgement.planned]);
    let mut text = format!("\n{head}{goes_on}\n");
    for batch in &judgement.origins {
        let _ = writeln!(text, "{}", batch.words());
    }
    let mut arms: Vec<&str> = judgement.cells.iter().map(|cell| cell.arm.as_str()).collect();
    arms.dedup();
    for arm in arms {
        let _ = write!(
            text,
            "\narm {arm}\n{:<42} {:>9} {:>5} {:>4} {:>14} {:>15} {:>15} {:>9} {:>8} {:>8} {:>6} {:>16} {:>7} {:>9} {:>9} {:>12} {:>5} {:>5} {:>4}  {:<8} found by, and what else came of it\n",
            "cell: times are median/largest in ms; none: no verdict",
            "injected",
            "shown",
            "none",
            "found",
            "contained",
            "recovered",
            "+/- miss",
            "excess",
            "upper95",
            "limit",
            "misses<95 %",
            "allowed",
            "+/- void",
            "void %",
            "step/N",
            "wrong",
            "lost",
            "left",
            "verdict"
        );
        for figures in judgement.cells.iter().filter(|cell| cell.arm == arm) {
            text.push_str(&row(figures));
        }
        for figures in judgement.pools.iter().filter(|pool| pool.arm == arm) {
            text.push_str(&row(&Figures { name: format!("pool {}", figures.name), ..figures.clone() }));
        }
    }
    text.push_str(&segments_text(judgement));
    text.push('\n');
    remarks(&mut text, judgement);
    list(&mut text, "what showed fewer than twenty times, which changes no verdict", &judgement.few);
    list(
        &mut text,
        "what speaks against stations, or the campaign as a whole",
        &[&judgement.broken[..], &judgement.unknown[..]].concat(),
    );
    let end = match judgement.exit_code {
        1 => "a promise was broken".to_string(),
        3 => format!("nothing can be said of: {}", unknown(judgement)),
        _ if judgement.done < judgement.planned => "no promise was broken so far".into(),
        _ if !judgement.has_promises() => "no promise was judged".into(),
        _ => "every promise held".into(),
    };
    let _ = writeln!(text, "\n{end}; {:.1} % of the faults without a verdict", 100.0 * judgement.void_share);
    list(&mut text, "what to do next", &advice(judgement));
    text
}

/// A heading with its lines, if there are any.
pub(super) fn list(text: &mut String, heading: &str, lines: &[String]) {
    if !lines.is_empty() {
        let _ = writeln!(text, "\n{heading}");
    }
    for line in lines {
        let _ = writeln!(text, "- {line}");
    }
}

#[cfg(test)]
mod tests {
    use super::{percentile, shortened};

    /// Of 144 faults that others could die of a report had 700 lines, and its verdict stood below them.
    #[test]
    fn a_list_of_hundreds_is_shortened_and_says_by_how_many() {
        let lines = |count: usize| (0..count).map(|line| line.to_string()).collect::<Vec<_>>();
        assert_eq!(shortened(&lines(6)), lines(6));
        assert_eq!(shortened(&lines(300))[5..], ["5".to_string(), "… and 294 more, in report.json".into()]);
    }

    #[test]
    fn percentiles_by_hand() {
        let list = [1.0, 2.0, 3.0, 4.0, 10.0];
        assert_eq!([0.0, 0.5, 1.0].map(|share| percentile(&list, share)), [Some(1.0), Some(3.0), Some(10.0)]);
        assert_eq!(percentile(&[], 0.5), None);
    }
}
