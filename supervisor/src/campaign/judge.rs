//! From the outcomes of a campaign to figures and verdicts: per cell, per pool, per station.
//!
//! A promise is *broken* only beyond doubt: the lower bound of the excess lies above the limit, with the void ticks or without, or something happened that
//! never may (a station that did not go on, a process that did not recover, one that died or hung of another's fault, a force of a servo that lied, a lie that
//! nobody found, a force step that no fault-free tick in the same state makes + 0.05 N, a fault that cost more ticks than the hardware's own ramp bridges and than
//! any control window lost, a state that began anew or a counter that went back, a stale value, ticks that the recording lost, anything left over), unless its
//! cell says that it may, and unless a host that stalls does so as well and no canary would have seen it. It is *held* when the upper bound is within the
//! limit, and that with the void ticks too where they are more than chance makes; a cell of a pool breaks it by itself where its own lower bound lies above the pool's limit with a doubt of
//! one in a thousand. Between the two, when none of a cell's faults showed, when too many faults have no verdict because the host stalled, or most of a cell,
//! when the controls lost more than the windows with a fault, when those in the same state tell otherwise, when those that differ lie together in one station, or
//! when the mean of the ticks that they cost beyond what they may is not within the limit as well, nothing can be said, and the campaign says so.

mod blame;
mod figures;
mod notice;
pub mod pairs;
mod shown;
mod take;
mod verdict;

pub use figures::{Figures, Verdict};
pub use verdict::{Unlike, unlike};

use super::cell::Cell;
use super::draw::Plan;
use super::file::Campaign;
use super::origin::{Batch, batches};
use super::outcome::Outcome;
use super::station::StationOutcome;
use blame::Blame;
use figures::{Known, gather, most_missed_without, quiet_steps_n};
use serde::Serialize;
use verdict::{conclude, enough};

/// All that is known of a campaign.
#[derive(Clone, Debug, Serialize)]
pub struct Judgement {
    /// Campaign's name.
    pub campaign: String,
    /// Seed.
    pub seed: u64,
    /// Faults in the plan.
    pub planned: usize,
    /// Faults that are through.
    pub done: usize,
    /// By what its stations were run.
    pub origins: Vec<Batch>,
    /// Cells, in the file's order, arm by arm.
    pub cells: Vec<Figures>,
    /// Pools.
    pub pools: Vec<Figures>,
    /// Kinds and roles of which fewer faults showed than a kind is to have for each role, in words.
    pub few: Vec<String>,
    /// What was broken in a station as a whole.
    pub broken: Vec<String>,
    /// What keeps the campaign from a verdict.
    pub unknown: Vec<String>,
    /// Share of faults without a verdict.
    pub void_share: f64,
    /// 0, 1 or 3.
    pub exit_code: u8,
}

/// Judges what there is so far; `stopped` says why it ended before what was asked of this run was through.
pub fn judge(
    campaign: &Campaign,
    plan: &Plan,
    outcomes: &[Outcome],
    stations: &[StationOutcome],
    stopped: Option<&str>,
) -> Judgement {
    let blame = Blame::of(campaign, outcomes, stations);
    let mut cells = Vec::new();
    let mut pools = Vec::new();
    for arm in &campaign.arms {
        let steps_n = quiet_steps_n(arm, outcomes, stations);
        let most_missed = most_missed_without(arm, outcomes);
        let figures = |name: &str, chosen: &dyn Fn(&Cell) -> bool| {
            let here: Vec<&Cell> = campaign.cells.iter().filter(|cell| chosen(cell)).collect();
            gather(name, arm, &here, &Known { plan, outcomes, steps_n, most_missed, blame: &blame })
        };
        for cell in &campaign.cells {
            let found = figures(&cell.name, &|other| other.name == cell.name).bound_hangs(cell.found_ms);
            cells.push(conclude(found, cell.limit_upper95, arm, true, campaign));
        }
        for pool in &campaign.pools {
            let found = figures(&pool.name, &|cell| cell.pool.as_deref() == Some(&pool.name));
            if found.planned > 0 {
                pools.push(enough(conclude(found, Some(pool.limit_upper95), arm, false, campaign), pool.least, arm));
            }
        }
    }
    let here: Vec<&Figures> = cells.iter().filter(|cell| campaign.judges(&cell.arm)).collect();
    let done: usize = here.iter().map(|cell| cell.done()).sum();
    let void_share = here.iter().map(|cell| cell.without_verdict).sum::<usize>() as f64 / done.max(1) as f64;
    let origins = batches(stations);
    let stations: Vec<&StationOutcome> = stations.iter().filter(|station| campaign.judges(&station.arm)).collect();
    let mut unknown = unknown(campaign, &stations, void_share, blame.lost_elsewhere);
    unknown.extend(stopped.map(str::to_string));
    let mut judgement = Judgement {
        campaign: campaign.name.clone(),
        seed: plan.seed,
        planned: plan.faults.len(),
        done: outcomes.len(),
        origins,
        few: shown::few(campaign, &cells),
        cells,
        pools,
        broken: blame.broken,
        unknown,
        void_share,
        exit_code: 0,
    };
    judgement.exit_code = exit_code(&judgement, stopped.is_some());
    judgement
}

/// The figures of one fault among these outcomes, as of a cell that has no other and no limit; `None` if the campaign has no such cell or arm.
pub fn of_one(
    campaign: &Campaign,
    plan: &Plan,
    outcomes: &[Outcome],
    stations: &[StationOutcome],
    own: &Outcome,
) -> Option<Figures> {
    let (cell, arm) = (campaign.cell(&own.cell)?, campaign.arms.iter().find(|arm| arm.name == own.arm)?);
    let blame = Blame::of(campaign, outcomes, stations);
    let (steps_n, most_missed) = (quiet_steps_n(arm, outcomes, stations), most_missed_without(arm, outcomes));
    let known = Known { plan, outcomes: std::slice::from_ref(own), steps_n, most_missed, blame: &blame };
    Some(conclude(gather(&cell.name, arm, &[cell], &known), None, arm, true, campaign))
}

impl Judgement {
    /// Whether any promise was judged.
    pub fn has_promises(&self) -> bool {
        self.cells.iter().any(|cell| cell.judged)
    }

    /// With what is to be said of the batch that has just been run, judged `alone`: one of which no fault can be judged says nothing, whatever is known of those
    /// before it, and ends with exit code 3, unless the plan is through or a promise is broken.
    pub fn after_batch(mut self, alone: &Judgement) -> Judgement {
        let count = |of: fn(&Figures) -> usize| alone.cells.iter().map(of).sum::<usize>();
        let (done, silent) = (count(Figures::done), count(|figures| figures.without_verdict));
        if self.exit_code == 0 && self.done < self.planned && done > 0 && silent == done {
            self.unknown.push(format!("none of the {done} faults of this batch has a verdict"));
            self.exit_code = 3;
        }
        self
    }
}

/// What keeps the campaign as a whole from a verdict.
fn unknown(campaign: &Campaign, stations: &[&StationOutcome], void_share: f64, lost_elsewhere: u64) -> Vec<String> {
    let troubled = stations.iter().filter(|station| !station.trouble.is_empty() && station.faults.is_empty());
    let mut unknown: Vec<String> = troubled.map(|station| format!("run {}: {}", station.run, station.trouble)).collect();
    let silent = stations.iter().filter(|station| !station.reported && !station.never_whole);
    unknown.extend(silent.map(|station| format!("run {}: it left no report, so that nobody knows what it applied", station.run)));
    if void_share > campaign.most_void {
        let (share, most) = (100.0 * void_share, 100.0 * campaign.most_void);
        unknown.push(format!("{share:.0} % of the faults are without a verdict, at most {most:.0} % may be"));
    }
    if lost_elsewhere > 0 {
        unknown.push(format!(
            "recordings lost {lost_elsewhere} ticks outside of every fault's window: the machine starves the recorder"
        ));
    }
    unknown
}

/// 1 if a promise was broken; 3 if the run was stopped or, at the end of the plan, nothing can be said of one; 0 while the plan is not through, but for a batch
/// without any verdict ([`Judgement::after_batch`]).
fn exit_code(judgement: &Judgement, was_stopped: bool) -> u8 {
    let any = |verdict| judgement.cells.iter().chain(&judgement.pools).any(|figures| figures.verdict == verdict);
    match () {
        () if any(Verdict::Broken) || !judgement.broken.is_empty() => 1,
        () if was_stopped => 3,
        () if judgement.done < judgement.planned => 0,
        () if any(Verdict::Unknown) || !judgement.unknown.is_empty() => 3,
        () => 0,
    }
}

#[cfg(test)]
#[path = "judge_tests.rs"]
mod tests;

#[cfg(test)]
#[path = "judge_seen_tests.rs"]
mod seen_tests;

#[cfg(test)]
#[path = "judge_known_tests.rs"]
mod known_tests;

#[cfg(test)]
#[path = "judge_alike_tests.rs"]
mod alike_tests;
