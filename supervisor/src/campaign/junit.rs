//! A campaign's report for a build server: a test case for each cell and pool, and one for the stations as a whole.

use super::judge::{Figures, Judgement, Verdict};
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
         skipped=\"{}\">\n<properties><property name=\"seed\" value=\"{}\"/><property name=\"faults\" value=\"{}\"/></properties>\n",
        escape(&judgement.campaign),
        results.len(),
        count(Mark::Failed),
        count(Mark::Error),
        count(Mark::Skipped),
        judgement.seed,
        judgement.done
    );
    for (kind, list) in [("", &judgement.cells), ("pool ", &judgement.pools)] {
        for figures in list {
            case(
                &mut text,
                &judgement.campaign,
                &figures.arm,
                &format!("{kind}{}", figures.name),
                mark(result(figures)),
                &figures.reasons,
            );
        }
    }
    case(
        &mut text,
        &judgement.campaign,
        "stations",
        "nothing invalid, nothing stale, nothing left over",
        mark(Mark::of(verdict_of_all)),
        reasons_of_all,
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

/// A cell that its pool judges passes if nothing speaks against it alone.
fn result(figures: &Figures) -> Mark {
    let passes = figures.verdict == Verdict::Figures && figures.judged && figures.injected > 0 && figures.reasons.is_empty();
    if passes { Mark::Passed } else { Mark::of(figures.verdict) }
}

fn case(text: &mut String, campaign: &str, arm: &str, name: &str, result: Mark, reasons: &[String]) {
    let class = format!("{campaign}.{arm}");
    let said = escape(&reasons.join("\n"));
    let first = escape(reasons.first().map_or("", String::as_str));
    let _ = write!(text, "<testcase classname=\"{}\" name=\"{}\">", escape(&class), escape(name));
    let _ = match result {
        Mark::Passed => Ok(()),
        Mark::Failed => write!(text, "<failure message=\"{first}\">{said}</failure>"),
        Mark::Error => write!(text, "<error message=\"nothing can be said: {first}\">{said}</error>"),
        Mark::Skipped => {
            write!(text, "<skipped message=\"nothing was injected, nothing is judged here, or the plan is not through\"/>")
        }
    };
    text.push_str("</testcase>\n");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_broken_cell_is_a_failure_and_nothing_breaks_the_markup() {
        let figures = |name: &str, verdict| Figures {
            arm: "a".into(),
            name: name.into(),
            verdict,
            reasons: vec!["1 < 2 & \"3\"\u{1b}".into()],
            ..Figures::default()
        };
        let judgement = Judgement {
            campaign: "c<>".into(),
            seed: 1,
            planned: 2,
            done: 2,
            cells: vec![
                figures("good", Verdict::Held),
                figures("bad", Verdict::Broken),
                figures("dim", Verdict::Unknown),
                Figures { reasons: vec![], judged: true, injected: 1, ..figures("pooled", Verdict::Figures) },
                Figures { reasons: vec![], judged: true, ..figures("not yet", Verdict::Figures) },
                Figures { reasons: vec![], injected: 1, ..figures("beside", Verdict::Figures) },
            ],
            pools: vec![],
            broken: vec![],
            unknown: vec![],
            void_share: 0.0,
            exit_code: 1,
        };
        let text = junit(&judgement);
        assert!(text.contains("tests=\"7\" failures=\"1\" errors=\"1\" skipped=\"2\""), "{text}");
        assert!(text.contains("<failure message=\"1 &lt; 2 &amp; &quot;3&quot;\u{fffd}\">"), "{text}");
        assert_eq!((text.matches("<testcase").count(), text.matches("</testcase>").count()), (7, 7));
        let going_on = junit(&Judgement { planned: 3, ..judgement.clone() });
        assert!(going_on.contains("failures=\"1\" errors=\"0\" skipped=\"3\""), "{going_on}");
        let stopped = junit(&Judgement { planned: 3, exit_code: 3, ..judgement });
        assert!(stopped.contains("errors=\"1\" skipped=\"2\""), "{stopped}");
        assert!(text.contains("name=\"pooled\"></testcase>") && text.contains("name=\"dim\"><error message="), "{text}");
    }
}
