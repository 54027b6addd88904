//! Two campaigns beside each other: what a change of the station has made of what faults cost. Both are read and judged by this build ([`super::results`]).
//! A pool or a cell is the same in both if an arm of the same name has one of its name: that of a cell says what is done to whom, and in which state.
//!
//! Promise: worse beyond doubt is only what is worse by its excess, by the campaign's own statistics ([`super::bounds`]), and of the same cells in both,
//! which may cost the same. Times and steps of the force stand beside it, and nothing is concluded from them.

mod table;

use super::begun::told_of_cut;
use super::bounds::{Difference, Excess, Told, told};
use super::cell::Cell;
use super::file::Campaign;
use super::judge::{Figures, Judgement, Verdict};
use super::origin::{Batch, Origin};
use super::results::{self, Results};
use super::say;
use super::text::percentile;
use crate::cli::CompareArgs;
use crate::settings::Refusal;
use crate::warn;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Reads two folders and says what they differ by; gives the exit code: 1 if the second is worse in something, 3 if there is nothing to compare.
pub fn run(args: &CompareArgs) -> Result<u8, Refusal> {
    let read = |folder: &Path| results::read(folder, &args.file);
    let (first, second) = (read(&args.first)?, read(&args.second)?);
    for results in [&first, &second] {
        if let Some(line) = told_of_cut(&results.cut) {
            warn(&format!("{}: {line}", results.folder.display()));
        }
    }
    let comparison = compare(&first, &second);
    if args.json {
        say(false, &format!("{:#}\n", serde_json::to_value(&comparison).unwrap_or_default()));
    } else {
        say(false, &table::text(&comparison));
    }
    Ok(comparison.exit_code)
}

/// Two campaigns beside each other.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// The one that was named first.
    pub first: Side,
    /// The other one.
    pub second: Side,
    /// What else is not the same: `file`, `seed`, `build`, `machine`, `day`.
    pub differ: Vec<&'static str>,
    /// The pools that both have, in the order of the first.
    pub pools: Vec<Row>,
    /// The cells that both have.
    pub cells: Vec<Row>,
    /// Pools and cells that the first alone has, in words.
    pub first_alone: Vec<String>,
    /// Those that the second alone has.
    pub second_alone: Vec<String>,
    /// Pools and cells that are worse beyond doubt in the second, in words.
    pub worse: Vec<String>,
    /// Those that are better beyond doubt.
    pub better: Vec<String>,
    /// 0, 1 or 3.
    pub exit_code: u8,
}

/// One of the two.
#[derive(Clone, Debug, Serialize)]
pub struct Side {
    /// Where its results lie.
    pub folder: String,
    /// Its name.
    pub campaign: String,
    /// Seed of its plan.
    pub seed: u64,
    /// Hash of its file.
    pub file_hash: String,
    /// Faults in the plan.
    pub planned: usize,
    /// Faults that are through.
    pub done: usize,
    /// By what its stations were run.
    pub origins: Vec<Batch>,
    /// What keeps it as a whole from a verdict.
    pub unknown: Vec<String>,
    /// What it comes to by itself: 0, 1 or 3.
    pub exit_code: u8,
}

/// A pool or a cell that both have.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Arm.
    pub arm: String,
    /// Pool's or cell's name.
    pub name: String,
    /// Whether it is of the same cells in both, and these may cost the same: else nothing is concluded of it.
    pub alike: bool,
    /// In the first.
    pub first: Shown,
    /// In the second.
    pub second: Shown,
    /// The excess of the second less that of the first; `None` where one of them has none.
    pub difference: Option<Difference>,
    /// The medians and the 95th percentiles of the times to the detection, the second over the first; `None` of none, and where the first is 0.
    pub detected_ratio: [Option<f64>; 2],
    /// The same of the times to the recovery.
    pub recovered_ratio: [Option<f64>; 2],
    /// What is beyond doubt.
    pub told: Option<Told>,
}

/// The figures of one of the two.
#[derive(Clone, Debug, Serialize)]
pub struct Shown {
    /// Faults in the plan.
    pub planned: usize,
    /// Faults that were injected.
    pub injected: usize,
    /// Those that showed.
    pub manifested: usize,
    /// Those without a verdict.
    pub without_verdict: usize,
    /// Faults with excess misses, per fault.
    pub excess: Option<Excess>,
    /// From the injection to the detection, ms: the median and the 95th percentile.
    pub detected_ms: Option<[f64; 2]>,
    /// To a successor that is warm, or live, ms: the same.
    pub recovered_ms: Option<[f64; 2]>,
    /// Largest force step in a fault's window, N.
    pub step_max_n: f64,
    /// Ticks that each fault may cost; of a pool, the most that one of its cells allows.
    pub allowed_misses: u64,
    /// What it comes to by itself.
    pub verdict: Verdict,
}

/// A campaign, and what is known of it.
struct Judged<'a> {
    results: &'a Results,
    judgement: Judgement,
}

/// What two campaigns differ by.
pub fn compare(first: &Results, second: &Results) -> Comparison {
    let both = [first, second].map(|results| Judged { results, judgement: results.judgement() });
    let [pools, cells] = [true, false].map(|of_pools| rows(&both, of_pools));
    let told_of = |wanted: Told| {
        let names = |rows: &[Row], of_pools: bool| -> Vec<String> {
            let these = rows.iter().filter(|row| row.told == Some(wanted));
            these.map(|row| title(&row.arm, &row.name, of_pools)).collect()
        };
        [names(&pools, true), names(&cells, false)].concat()
    };
    let (worse, better) = (told_of(Told::Worse), told_of(Told::Better));
    let is_comparable = pools.iter().chain(&cells).any(|row| row.alike && row.difference.is_some());
    let exit_code = match () {
        () if !is_comparable => 3,
        () if !worse.is_empty() => 1,
        () => 0,
    };
    let [first, second] = [both[0].side(), both[1].side()];
    let differ = differing(&first, &second);
    let [first_alone, second_alone] = [alone(&both[0], &both[1]), alone(&both[1], &both[0])];
    Comparison { first, second, differ, pools, cells, first_alone, second_alone, worse, better, exit_code }
}

/// How a pool or a cell is called.
fn title(arm: &str, name: &str, of_pools: bool) -> String {
    format!("{arm}, {}{name}", if of_pools { "pool " } else { "" })
}

/// The pools or the cells that both have.
fn rows([first, second]: &[Judged; 2], of_pools: bool) -> Vec<Row> {
    let in_both = first.figures(of_pools).filter_map(|figures| Some((figures, second.same(figures, of_pools)?)));
    let is_alike = |here: &Figures, there: &Figures| first.allowed(here, of_pools) == second.allowed(there, of_pools);
    in_both.map(|(here, there)| row(here, there, is_alike(here, there), of_pools)).collect()
}

fn row(first: &Figures, second: &Figures, alike: bool, of_pools: bool) -> Row {
    let excess = first.excess.zip(second.excess);
    let (here, there) = (shown(first), shown(second));
    Row {
        arm: first.arm.clone(),
        name: first.name.clone(),
        alike,
        difference: excess.map(|(first, second)| Difference::of(&first, &second)),
        told: excess.filter(|_| alike).and_then(|(first, second)| told(&first, &second, !of_pools)),
        detected_ratio: ratios(here.detected_ms, there.detected_ms),
        recovered_ratio: ratios(here.recovered_ms, there.recovered_ms),
        first: here,
        second: there,
    }
}

fn shown(figures: &Figures) -> Shown {
    let times = |list: &[f64]| percentile(list, 0.5).zip(percentile(list, 0.95)).map(|(half, most)| [half, most]);
    Shown {
        planned: figures.planned,
        injected: figures.injected,
        manifested: figures.manifested,
        without_verdict: figures.without_verdict,
        excess: figures.excess,
        detected_ms: times(&figures.detected_ms),
        recovered_ms: times(&figures.recovered_ms),
        step_max_n: figures.step_max_n[0],
        allowed_misses: figures.allowed_misses,
        verdict: figures.verdict,
    }
}

/// Each of the second over that of the first.
fn ratios(first: Option<[f64; 2]>, second: Option<[f64; 2]>) -> [Option<f64>; 2] {
    [0_usize, 1].map(|at| first.zip(second).filter(|(first, _)| first[at] > 0.0).map(|(first, second)| second[at] / first[at]))
}

/// The pools and the cells that one has and the other has not, in words.
fn alone(one: &Judged, other: &Judged) -> Vec<String> {
    let names = |of_pools: bool| -> Vec<String> {
        let has_no_other = |figures: &&Figures| other.same(figures, of_pools).is_none();
        one.figures(of_pools).filter(has_no_other).map(|figures| title(&figures.arm, &figures.name, of_pools)).collect()
    };
    [names(true), names(false)].concat()
}

impl Judged<'_> {
    /// Its pools or its cells that have a fault in the plan.
    fn figures(&self, of_pools: bool) -> impl Iterator<Item = &Figures> {
        let all = if of_pools { &self.judgement.pools } else { &self.judgement.cells };
        all.iter().filter(|figures| figures.planned > 0)
    }

    /// The one of the same name in an arm of the same name.
    fn same(&self, other: &Figures, of_pools: bool) -> Option<&Figures> {
        self.figures(of_pools).find(|figures| (&figures.arm, &figures.name) == (&other.arm, &other.name))
    }

    /// The cells that are judged in it, and what each of their faults may cost, ticks.
    fn allowed(&self, figures: &Figures, of_pools: bool) -> BTreeMap<&str, u64> {
        let campaign: &Campaign = &self.results.campaign;
        let arm = campaign.arms.iter().find(|arm| arm.name == figures.arm);
        let is_of_it = |cell: &Cell| if of_pools { cell.pool.as_ref() == Some(&figures.name) } else { cell.name == figures.name };
        let here = campaign.cells.iter().filter(|cell| is_of_it(cell) && arm.is_some_and(|arm| arm.count(cell) > 0));
        here.map(|cell| (cell.name.as_str(), cell.allowed_misses)).collect()
    }

    fn side(&self) -> Side {
        let Judgement { campaign, seed, planned, done, origins, unknown, exit_code, .. } = &self.judgement;
        Side {
            folder: self.results.folder.display().to_string(),
            campaign: campaign.clone(),
            seed: *seed,
            file_hash: self.results.plan.file_hash.clone(),
            planned: *planned,
            done: *done,
            origins: origins.clone(),
            unknown: unknown.clone(),
            exit_code: *exit_code,
        }
    }
}

/// What else is not the same of two campaigns.
fn differing(first: &Side, second: &Side) -> Vec<&'static str> {
    let words = |of: fn(&Batch, &Origin) -> String| {
        let all = |side: &Side| -> BTreeSet<Option<String>> {
            side.origins.iter().map(|batch| Some(of(batch, batch.origin.as_ref()?))).collect()
        };
        all(first) != all(second)
    };
    let differ = [
        ("file", first.file_hash != second.file_hash),
        ("seed", first.seed != second.seed),
        ("build", words(|_, origin| format!("{} {}", origin.version, origin.build))),
        ("machine", words(|_, origin| format!("{}, {}, {}", origin.cpu, origin.cores, origin.kernel))),
        ("day", words(|batch, origin| format!("{} {}", origin.date, batch.last_date))),
    ];
    differ.into_iter().filter(|(_, is_other)| *is_other).map(|(what, _)| what).collect()
}

#[cfg(test)]
mod tests;
