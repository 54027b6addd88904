//! A campaign's report for a build server: a test case for each cell and pool, and one for stations and campaign as a whole.

use super::advice::advice;
use super::judge::{Figures, Judgement, Verdict};
use super::text::{self, counts, times};
use hyst_assessment::escape;
use std::fmt::Write;

/// The report.
pub fn junit(judgement: &Judgement) -> String {
    let rows: Vec<&Figures> = judgement.cells.iter().chain(&judgement.pools).collect();
    let (verdict_of_all, reasons_of_all) = match (judgement.broken.is_empty(), judgement.unknown.is_empty()) {
        (false, _) => (Verdict::Broken, &judgement.broken),
        (true, false) => (Verdict::Unknown, &judgement.unknown),
        (true, true) => (Verdict::Held, &judgement.broken),
    };
    // Of a plan that goes on another day not everything is known yet, and that is no error.
    let is_over = judgement.done >= judgement.planned || judgement.exit_code == 3;
    let mark = |mark: Mark| if mark == Mark::Error && !is_over { Mark::Skipped } else { mark };
    let results: Vec<Mark> = rows.iter().map(|figures| mark(result(figures))).chain([mark(Mark::of(verdict_of_all))]).collect();
    let count = |wanted: Mark| results.iter().filter(|result| **result == wanted).count();
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n<testsuite name=\"campaign {}\" tests=\"{}\" failures=\"{}\" errors=\"{}\" \
         skipped=\"{}\">\n{}\n",
        escape(&judgement.campaign),
        results.len(),
        count(Mark::Failed),
        count(Mark::Error),
        count(Mark::Skipped),
        properties(&of_all(judgement))
    );
    for (kind, list) in [("", &judgement.cells), ("pool ", &judgement.pools)] {
        for figures in list {
            let name = format!("{kind}{}", figures.name);
            let case = Case { arm: &figures.arm, name: &name, result: mark(result(figures)), reasons: &figures.reasons };
            case.write(&mut text, &judgement.campaign, &columns(figures));
        }
    }
    // That too few faults have a verdict, or that the run was stopped, is no station's fault.
    let (arm, name) = ("campaign", "stations, and the campaign as a whole");
    Case { arm, name, result: mark(Mark::of(verdict_of_all)), reasons: reasons_of_all }.write(
        &mut text,
        &judgement.campaign,
        &[("faults_without_verdict_share", format!("{:.4}", judgement.void_share))],
    );
    text.push_str("</testsuite>\n</testsuites>\n");
    text
}

/// What a build server knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mark {
    Passed,
    Failed,
    Error,
    Skipped,
}

impl Mark {
    fn of(verdict: Verdict) -> Mark {
        match verdict {
            Verdict::Held => Mark::Passed,
            Verdict::Broken => Mark::Failed,
            Verdict::Unknown => Mark::Error,
            Verdict::Figures => Mark::Skipped,
        }
    }
}

/// A cell that its pool judges passes if some of its faults could be judged, and nothing speaks against it alone.
fn result(figures: &Figures) -> Mark {
    let is_known = figures.excess.or(figures.excess_unnoticed).is_some();
    let passes = figures.verdict == Verdict::Figures && figures.judged && is_known && figures.reasons.is_empty();
    if passes { Mark::Passed } else { Mark::of(figures.verdict) }
}

/// Names with their values.
type Properties = [(&'static str, String)];

fn properties(list: &Properties) -> String {
    let property = |(name, value): &(&str, String)| format!("<property name=\"{name}\" value=\"{}\"/>", escape(value));
    if list.is_empty() {
        String::new()
    } else {
        format!("<properties>{}</properties>", list.iter().map(property).collect::<String>())
    }
}

/// What holds of the campaign as a whole.
fn of_all(judgement: &Judgement) -> Vec<(&'static str, String)> {
    let origins = judgement.origins.iter().map(|batch| ("runs", batch.words()));
    let few = judgement.few.iter().map(|line| ("showed_fewer_than_twenty_times", line.clone()));
    let next = advice(judgement).into_iter().map(|line| ("what_to_do_next", line));
    let run = [("seed", judgement.seed.to_string()), ("faults", judgement.done.to_string())];
    run.into_iter().chain(origins).chain(few).chain(next).collect()
}

/// The figures of a cell or a pool.
fn columns(figures: &Figures) -> Vec<(&'static str, String)> {
    let [step_n, control_step_n] = figures.step_max_n;
    let excess = figures.excess.map_or(["-".to_string(), "-".into()], |excess| {
        [format!("{:.4}", excess.mean), format!("{:.4} to {:.4}", excess.lower95, excess.upper95)]
    });
    let [mean, bounds] = excess;
    let void_share = |of: [u64; 2]| format!("{:.4}", text::void_share(of));
    vec![
        ("injected", figures.injected.to_string()),
        ("planned", figures.planned.to_string()),
        ("manifested", figures.manifested.to_string()),
        ("without_verdict", figures.without_verdict.to_string()),
        ("detected_by", counts(&figures.detected_by)),
        ("detected_ms_median_and_largest", times(&figures.detected_ms)),
        ("contained_ms_median_and_largest", times(&figures.contained_ms)),
        ("recovered_ms_median_and_largest", times(&figures.recovered_ms)),
        ("faults_with_excess_misses_per_fault", mean),
        ("faults_with_excess_misses_per_fault_95", bounds),
        ("faults_with_excess_misses_limit_95", figures.limit_upper95.map_or("-".into(), |limit| limit.to_string())),
        ("excess_misses_mean", text::mean(figures, " below ")),
        ("missed_ticks", figures.missed[0].to_string()),
        ("missed_control_ticks", figures.missed[1].to_string()),
        ("missed_right_after", figures.aftermath[1].to_string()),
        ("allowed_misses", figures.allowed_misses.to_string()),
        ("void_tick_share", void_share(figures.window_ticks)),
        ("void_tick_control_share", void_share(figures.control_ticks)),
        ("force_step_max_n", format!("{step_n:.3}")),
        ("force_step_max_control_n", format!("{control_step_n:.3}")),
        ("invalid_or_stale_applied_ticks", figures.wrong.to_string()),
        ("data_lost_ticks", figures.data_lost_ticks.to_string()),
        ("leftovers", figures.leftovers.to_string()),
        ("what_else", counts(&figures.seen)),
    ]
}

/// A test case.
struct Case<'a> {
    arm: &'a str,
    name: &'a str,
    result: Mark,
    reasons: &'a [String],
}

impl Case<'_> {
    fn write(&self, text: &mut String, campaign: &str, figures: &Properties) {
        let class = format!("{campaign}.{}", self.arm);
        let said = escape(&self.reasons.join("\n"));
        let first = escape(self.reasons.first().map_or("", String::as_str));
        let (class, name) = (escape(&class), escape(self.name));
        let _ = write!(text, "<testcase classname=\"{class}\" name=\"{name}\">{}", properties(figures));
        let _ = match self.result {
            Mark::Passed => Ok(()),
            Mark::Failed => write!(text, "<failure message=\"{first}\">{said}</failure>"),
            Mark::Error => write!(text, "<error message=\"nothing can be said: {first}\">{said}</error>"),
            Mark::Skipped => {
                let why = if first.is_empty() {
                    "nothing was injected, nothing is judged here, or the plan is not through"
                } else {
                    first.as_str()
                };
                write!(text, "<skipped message=\"{why}\"/>")
            }
        };
        text.push_str("</testcase>\n");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::bounds::Excess;

    #[test]
    fn a_broken_cell_is_a_failure_and_nothing_breaks_the_markup() {
        let figures = |name: &str, verdict| Figures {
            arm: "a".into(),
            name: name.into(),
            verdict,
            reasons: vec!["1 < 2 & \"3\"\u{1b}".into()],
            ..Figures::default()
        };
        let excess = Some(Excess::of(1, 0, 0));
        let judgement = Judgement {
            campaign: "c<>".into(),
            seed: 1,
            planned: 2,
            done: 2,
            origins: vec![],
            cells: vec![
                figures("good", Verdict::Held),
                figures("bad", Verdict::Broken),
                figures("dim", Verdict::Unknown),
                Figures { reasons: vec![], judged: true, excess, ..figures("pooled", Verdict::Figures) },
                Figures { reasons: vec![], judged: true, ..figures("not yet", Verdict::Figures) },
                Figures { reasons: vec![], excess, ..figures("beside", Verdict::Figures) },
            ],
            pools: vec![],
            few: vec![],
            broken: vec![],
            unknown: vec![],
            void_share: 0.0,
            exit_code: 1,
        };
        let text = junit(&judgement);
        assert!(text.contains("tests=\"7\" failures=\"1\" errors=\"1\" skipped=\"2\""), "{text}");
        let of = |name: &str| text.lines().find(|line| line.contains(&format!("name=\"{name}\">"))).unwrap();
        assert!(text.contains("<failure message=\"1 &lt; 2 &amp; &quot;3&quot;\u{fffd}\">"), "{text}");
        assert_eq!((text.matches("<testcase").count(), text.matches("</testcase>").count()), (7, 7));
        let going_on = junit(&Judgement { planned: 3, ..judgement.clone() });
        assert!(going_on.contains("failures=\"1\" errors=\"0\" skipped=\"3\""), "{going_on}");
        let stopped = junit(&Judgement { planned: 3, exit_code: 3, ..judgement });
        assert!(stopped.contains("errors=\"1\" skipped=\"2\""), "{stopped}");
        assert!(
            of("pooled").ends_with("</properties></testcase>") && of("dim").contains("</properties><error message="),
            "{text}"
        );
    }
}
