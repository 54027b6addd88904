//! A campaign's report for a build server: a test case for each cell and pool, and one for the stations as a whole.

use super::judge::{Figures, Judgement, Verdict};
use hyst_assessment::escape;
use std::fmt::Write;

/// The report.
pub fn junit(judgement: &Judgement) -> String {
    let rows: Vec<&Figures> = judgement.cells.iter().chain(&judgement.pools).collect();
    let count = |verdict| rows.iter().filter(|figures| figures.verdict == verdict).count();
    let failures = count(Verdict::Broken) + usize::from(!judgement.broken.is_empty());
    let skipped = count(Verdict::Unknown) + count(Verdict::Figures) + usize::from(!judgement.unknown.is_empty());
    let skipped = skipped - usize::from(!judgement.broken.is_empty() && !judgement.unknown.is_empty());
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n<testsuite name=\"campaign {}\" tests=\"{}\" failures=\"{failures}\" errors=\"0\" \
         skipped=\"{skipped}\">\n<properties><property name=\"seed\" value=\"{}\"/><property name=\"faults\" value=\"{}\"/></properties>\n",
        escape(&judgement.campaign),
        rows.len() + 1,
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
                figures.verdict,
                &figures.reasons,
            );
        }
    }
    let (verdict, reasons) = match (judgement.broken.is_empty(), judgement.unknown.is_empty()) {
        (false, _) => (Verdict::Broken, &judgement.broken),
        (true, false) => (Verdict::Unknown, &judgement.unknown),
        (true, true) => (Verdict::Held, &judgement.broken),
    };
    case(&mut text, &judgement.campaign, "stations", "nothing invalid, nothing stale, nothing left over", verdict, reasons);
    text.push_str("</testsuite>\n</testsuites>\n");
    text
}

fn case(text: &mut String, campaign: &str, arm: &str, name: &str, verdict: Verdict, reasons: &[String]) {
    let class = format!("{campaign}.{arm}");
    let said = escape(&reasons.join("\n"));
    let first = escape(reasons.first().map_or("", String::as_str));
    let _ = write!(text, "<testcase classname=\"{}\" name=\"{}\">", escape(&class), escape(name));
    let _ = match verdict {
        Verdict::Held => Ok(()),
        Verdict::Broken => write!(text, "<failure message=\"{first}\">{said}</failure>"),
        Verdict::Unknown => write!(text, "<skipped message=\"nothing can be said: {first}\"/>"),
        Verdict::Figures => write!(text, "<skipped message=\"figures only\"/>"),
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
            cells: vec![figures("good", Verdict::Held), figures("bad", Verdict::Broken), figures("dim", Verdict::Unknown)],
            pools: vec![],
            broken: vec![],
            unknown: vec![],
            void_share: 0.0,
            exit_code: 1,
        };
        let text = junit(&judgement);
        assert!(text.contains("tests=\"4\" failures=\"1\" errors=\"0\" skipped=\"1\""), "{text}");
        assert!(text.contains("<failure message=\"1 &lt; 2 &amp; &quot;3&quot;\u{fffd}\">"), "{text}");
        assert_eq!((text.matches("<testcase").count(), text.matches("</testcase>").count()), (4, 4));
    }
}
