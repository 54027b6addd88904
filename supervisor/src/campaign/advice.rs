//! What a tester does next: a line for whatever stands between a campaign and its verdict, and for a promise that was broken.

use super::bounds::Excess;
use super::judge::{Figures, Judgement, Unlike, Verdict, unlike};

/// Up to so many times as many faults are advised: where more would be needed, what each of them cost tells more than a bound.
const MOST_TIMES: usize = 8;
/// Most names of what is unknown, and most lines of what helps.
const MOST_NAMES: usize = 4;
const MOST_LINES: usize = 8;
/// What helps against whatever else runs on the machine.
const ALONE: &str = "leave the machine alone (`hystation doctor`), and run the file again into another folder";
/// What helps where no canary ran.
const REAL_TIME: &str = "without canaries the host is not told from the station: grant real time (`hystation doctor`), and run the file \
                         again into another folder";

/// Of what nothing can be said, in words: `pool corrupt, the campaign as a whole`.
pub fn unknown(judgement: &Judgement) -> String {
    let mut names: Vec<String> = undecided(judgement).map(|(name, _)| name).collect();
    let surplus = names.len().saturating_sub(MOST_NAMES);
    if surplus > 0 {
        names.truncate(MOST_NAMES);
        names.push(format!("{surplus} more"));
    }
    if !judgement.unknown.is_empty() {
        names.push("the campaign as a whole".into());
    }
    names.join(", ")
}

/// What helps; nothing where every promise held and enough of everything showed.
pub fn advice(judgement: &Judgement) -> Vec<String> {
    let mut lines = Vec::new();
    if judgement.exit_code == 1 {
        lines.push(of_broken(judgement));
    }
    if judgement.done < judgement.planned {
        lines.push("the plan is not through: the same command goes on".into());
        return lines;
    }
    lines.extend(undecided(judgement).map(|(name, figures)| format!("{name}: {}", cure(figures))).take(MOST_LINES));
    if !judgement.unknown.is_empty() {
        lines.push(format!("the campaign as a whole: {ALONE}"));
    }
    if !judgement.few.is_empty() {
        let more = "take a copy of the file with a larger `count` there, or `bytes` of `corrupt`, to know more";
        lines.push(format!("what showed fewer than twenty times changes no verdict, and little is known of it: {more}"));
    }
    lines
}

/// The pools and cells of a plan that is through of which nothing can be said, by their names.
fn undecided(judgement: &Judgement) -> impl Iterator<Item = (String, &Figures)> {
    let pools = judgement.pools.iter().map(|figures| (format!("pool {}", figures.name), figures));
    let cells = judgement.cells.iter().map(|figures| (figures.name.clone(), figures));
    let is_through = judgement.done >= judgement.planned;
    pools.chain(cells).filter(move |(_, figures)| is_through && figures.verdict == Verdict::Unknown)
}

/// How a broken promise is looked into: by the first fault that what was broken names.
fn of_broken(judgement: &Judgement) -> String {
    let is_broken = |figures: &&Figures| figures.verdict == Verdict::Broken;
    let mut reasons = judgement.cells.iter().filter(is_broken).flat_map(|figures| &figures.reasons);
    let number = |reason: &String| reason.strip_prefix("fault ")?.split(':').next()?.parse::<usize>().ok();
    let seen = "results.jsonl has what was seen of each fault, stations.jsonl of each station";
    match reasons.find_map(number) {
        Some(fault) => format!("a promise was broken: `--only {fault}` does that fault again at its tick and phase; {seen}"),
        None => format!("a promise was broken: {seen}; `--only NUMBER` does a fault again at its tick and phase"),
    }
}

/// What helps where nothing can be said.
fn cure(figures: &Figures) -> String {
    if !figures.unsure.is_empty() {
        return REAL_TIME.into();
    }
    let Some((excess, limit)) = figures.excess.zip(figures.limit_upper95) else {
        return match figures.not_shown.first() {
            Some(fault) if figures.seen.contains_key("skipped") => format!(
                "its state does not come: take a hand that brings it about for as long as the faults take; `--only {fault}` waits for it again"
            ),
            Some(fault) => format!("`--only {fault}` does one of its faults again, and says why it does not come"),
            None => format!("its faults have no verdict: {ALONE}"),
        };
    };
    if excess.upper95 > limit {
        return match times(&excess, limit) {
            Some(times) => format!(
                "so few faults cannot hold its limit: {times} times as many would if they go on like this; take a copy of the file with a \
                 larger `count`"
            ),
            None => {
                "more of the like would not hold its limit: results.jsonl has what each cost, and `--only NUMBER` does it again"
                    .into()
            }
        };
    }
    match unlike(figures, limit) {
        Some(Unlike::Stalls) => {
            format!("{ALONE}; if it stays so, this kind keeps the kernel busy, and costs what `+/- void` says")
        }
        Some(Unlike::States) => {
            "take a copy of the file with a larger `count`, so that those with a control in the same state are enough".into()
        }
        Some(Unlike::Controls) => format!("something else took the cores: {ALONE}"),
        Some(Unlike::Together(station)) => {
            format!("something was with station {station} (its line in stations.jsonl): {ALONE}")
        }
        Some(Unlike::Mean) => of_mean(figures, limit),
        None => format!("too few of its faults have a verdict: {ALONE}"),
    }
}

/// What helps where few are worse, and the mean of what all cost has no bound within the limit: more of them, where what a few cost leaves room for that.
fn of_mean(figures: &Figures, limit: f64) -> String {
    let costs = "results.jsonl has what each cost, and `--only NUMBER` does it again";
    match times_for_mean(figures, limit) {
        Some(times) => format!(
            "so few faults cannot hold the mean of their ticks within its limit: some {times} times as many would if they go on \
             like this; take a copy of the file with a larger `count`; {costs}"
        ),
        None => format!("a few of its faults cost so many ticks that more of the like would not hold the mean of all: {costs}"),
    }
}

/// About how many times as many faults hold a limit of the mean of their ticks if they go on like this: the width of its bound shrinks with the root of their
/// number. `None` if that is more than [`MOST_TIMES`].
fn times_for_mean(figures: &Figures, limit: f64) -> Option<usize> {
    let mean = figures.mean_beyond_misses();
    let width = figures.mean_beyond_misses_upper95? - mean;
    (2..=MOST_TIMES).find(|times| mean + width / (*times as f64).sqrt() <= limit)
}

/// How many times as many faults hold a limit if as many of them are worse and better; `None` if that is more than [`MOST_TIMES`].
fn times(excess: &Excess, limit: f64) -> Option<usize> {
    let of = |times: usize| Excess::of(times * excess.faults, times * excess.worse, times * excess.better);
    (2..=MOST_TIMES).find(|times| of(*times).upper95 <= limit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::{html, text};

    fn judgement(exit_code: u8, cells: Vec<Figures>, pools: Vec<Figures>) -> Judgement {
        Judgement {
            campaign: "c".into(),
            seed: 1,
            planned: 9,
            done: 9,
            origins: vec![],
            cells,
            pools,
            few: vec![],
            broken: vec![],
            unknown: vec![],
            void_share: 0.0,
            exit_code,
        }
    }

    fn undecided(excess: Option<Excess>) -> Figures {
        let (name, verdict, limit_upper95) = ("start".into(), Verdict::Unknown, Some(0.05));
        Figures { arm: "a".into(), judged: true, name, verdict, excess, limit_upper95, ..Figures::default() }
    }

    /// A report said that too much was void, or too few came about, or the run was stopped, and not which, nor of what.
    #[test]
    fn a_report_without_a_verdict_says_of_what_it_has_none_and_what_helps() {
        let many = Excess::of(1_000, 1, 1);
        let void = Excess { lower95: 0.03, upper95: 0.17, ..many };
        let not_shown = vec![7, 8];
        // Of a hundred faults one cost so many ticks.
        let mean = |ticks: i64, upper95: f64| {
            let beyond_misses = [vec![0; 99], vec![ticks]].concat();
            Figures { beyond_misses, mean_beyond_misses_upper95: Some(upper95), ..undecided(Some(many)) }
        };
        for (figures, words) in [
            (undecided(Some(Excess::of(168, 8, 5))), "2 times as many would"),
            (undecided(Some(Excess::of(100, 8, 1))), "more of the like would not hold"),
            (Figures { excess_with_void: Some(void), ..undecided(Some(many)) }, "keeps the kernel busy"),
            (Figures { together_in: Some(5), ..undecided(Some(many)) }, "with station 5"),
            (mean(0, 0.06), "some 2 times as many would"),
            (mean(3, 0.08), "some 7 times as many would"),
            (mean(4, 0.12), "cost so many ticks that more"),
            (mean(9, 0.2), "cost so many ticks that more"),
            (Figures { mean_beyond_misses_upper95: Some(0.05), ..undecided(Some(many)) }, "too few of its faults have a verdict"),
            (undecided(Some(many)), "too few of its faults have a verdict"),
            (Figures { unsure: vec!["fault 3: no canary ran".into()], ..undecided(Some(many)) }, "grant real time"),
            (
                Figures { seen: [("skipped", 1)].into(), not_shown: vec![7], ..undecided(None) },
                "take a hand that brings it about",
            ),
            (Figures { not_shown, ..undecided(None) }, "`--only 7`"),
        ] {
            let judgement = judgement(3, vec![], vec![figures]);
            assert_eq!(unknown(&judgement), "pool start");
            let line = format!("pool start: {}", cure(&judgement.pools[0]));
            assert!(line.contains(words), "{line}");
            let (said, page) = (text::text(&judgement), html::html(&judgement, &[], &[]));
            assert!(said.contains("nothing can be said of: pool start;") && said.contains(&format!("- {line}")), "{said}");
            assert!(page.contains("What to do next") && page.contains(&hyst_assessment::escape(&line)), "{page}");
        }
        let five = judgement(3, vec![undecided(None); 5], vec![]);
        let whole = Judgement { unknown: vec!["run 3: it left no report".into()], ..five };
        assert_eq!(unknown(&whole), "start, start, start, start, 1 more, the campaign as a whole");
    }

    #[test]
    fn a_plan_that_is_not_through_goes_on_and_a_broken_promise_is_looked_into() {
        let open = Judgement { done: 5, unknown: vec!["interrupted".into()], ..judgement(3, vec![undecided(None)], vec![]) };
        assert_eq!(unknown(&open), "the campaign as a whole", "of the rest something will be known");
        assert_eq!(advice(&open), ["the plan is not through: the same command goes on"]);
        let of_none = "half of the hangs were found after more than 7.0 ms, limit 4";
        let reasons = vec![of_none.to_string(), "fault 1386: a force step of 0.127 N".into()];
        let broken = judgement(1, vec![Figures { verdict: Verdict::Broken, reasons, ..undecided(None) }], vec![]);
        assert!(advice(&broken)[0].contains("`--only 1386`"), "{:?}", advice(&broken));
        assert!(advice(&judgement(1, vec![], vec![]))[0].contains("`--only NUMBER`"));
    }

    #[test]
    fn where_every_promise_held_only_what_hardly_showed_is_left_to_do() {
        let held = judgement(0, vec![], vec![]);
        assert!(advice(&held).is_empty() && !text::text(&held).contains("what to do next"));
        let few = Judgement { few: vec!["arm a: corrupt of haptic, stream: 3 of 28 showed, fewer than 20".into()], ..held };
        assert!(advice(&few)[0].contains("changes no verdict") && text::text(&few).contains("what to do next"));
    }
}
