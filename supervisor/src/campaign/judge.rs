//! From the outcomes of a campaign to figures and verdicts: per cell, per pool, per station.
//!
//! A promise is *broken* only beyond doubt: the lower end of the interval of the excess lies above the limit, with the void ticks or without, or something happened that
//! never may (a station that did not go on, a process that did not recover, one that died of another's fault, a force step that no fault-free
//! tick makes + 0.05 N, a state that began anew or a counter that went back, a stale value, ticks that the recording lost, anything left over). It is *held* when the upper end is within the limit. Between the two, or when too many faults have no
//! verdict because the host stalled, nothing can be said, and the campaign says so.

use super::bounds::{Excess, Sides};
use super::cell::Cell;
use super::draw::Plan;
use super::file::{Arm, Campaign};
use super::outcome::{Ending, Outcome};
use super::station::StationOutcome;
use crate::fault::Fault;
use serde::Serialize;
use std::collections::BTreeMap;

/// What can be said.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Figures only: the arm is not judged, or a pool judges.
    #[default]
    Figures,
    /// The promise held.
    Held,
    /// Too few faults, or too much void.
    Unknown,
    /// The promise was broken.
    Broken,
}

/// The figures of a cell in an arm, or of a pool in an arm.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Figures {
    /// Arm.
    pub arm: String,
    /// Cell's or pool's name.
    pub name: String,
    /// Faults in the plan.
    pub planned: usize,
    /// Faults that were injected.
    pub injected: usize,
    /// Those that showed.
    pub manifested: usize,
    /// By what they were found.
    pub detected_by: BTreeMap<String, usize>,
    /// From the injection to its detection, ms, ascending.
    pub detected_ms: Vec<f64>,
    /// The same of those that hung and were found by their silence, ms, ascending.
    #[serde(default)]
    pub hang_ms: Vec<f64>,
    /// To the end of the last tick that missed its force because of it, ms, ascending.
    pub contained_ms: Vec<f64>,
    /// To a successor that is warm or live, ms, ascending.
    pub recovered_ms: Vec<f64>,
    /// Faults with a verdict of the supervisor: its promise held.
    pub promise_held: usize,
    /// Faults that could not be judged: not injected, not shown, no control window, or the host stalled in most of a window.
    pub without_verdict: usize,
    /// Ticks of the fault windows, and void ones of them.
    pub window_ticks: [u64; 2],
    /// Ticks of the control windows, and void ones of them.
    pub control_ticks: [u64; 2],
    /// Misses in the fault windows and in the control windows.
    pub missed: [u64; 2],
    /// Faults with excess misses, per fault.
    pub excess: Option<Excess>,
    /// The same with the ticks that do not count: whatever stalled, the fault's own doing in the kernel too. It is broader, and no promise is held by it,
    /// but one can be broken.
    pub excess_with_void: Option<Excess>,
    /// Excess misses of each judged fault, in the plan's order.
    pub excess_misses: Vec<i64>,
    /// Their mean: one stall of the host that falls into a window weighs there as much as it is long.
    pub mean_excess_misses: Option<f64>,
    /// Faults that were to hurt whoever does the role's work, and came when another had taken over already; they have no verdict.
    pub astray: usize,
    /// Largest force step in a fault window, and in a control window, N.
    pub step_max_n: [f64; 2],
    /// Ticks that the recording lost after these faults.
    pub data_lost_ticks: u64,
    /// Other processes that died or hung meanwhile.
    pub collateral: usize,
    /// Limit.
    pub limit_upper95: Option<f64>,
    /// Verdict.
    pub verdict: Verdict,
    /// What speaks against it.
    pub reasons: Vec<String>,
}

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
    /// Cells, in the file's order, arm by arm.
    pub cells: Vec<Figures>,
    /// Pools.
    pub pools: Vec<Figures>,
    /// What was broken in a station as a whole.
    pub broken: Vec<String>,
    /// What keeps the campaign from a verdict.
    pub unknown: Vec<String>,
    /// Share of faults without a verdict.
    pub void_share: f64,
    /// 0, 1 or 3.
    pub exit_code: u8,
}

/// Most reasons that are listed for a cell.
const MOST_REASONS: usize = 8;

/// Judges what there is so far.
pub fn judge(campaign: &Campaign, plan: &Plan, outcomes: &[Outcome], stations: &[StationOutcome]) -> Judgement {
    let judged = |name: &str| campaign.arms.iter().any(|arm| arm.name == name && arm.judged);
    let lost = lost_by(outcomes, stations, &judged);
    let mut cells = Vec::new();
    let mut pools = Vec::new();
    for arm in &campaign.arms {
        let step_n = quiet_step_n(arm, outcomes, stations);
        let figures = |name: &str, chosen: &dyn Fn(&Cell) -> bool| {
            let here: Vec<&Cell> = campaign.cells.iter().filter(|cell| chosen(cell)).collect();
            gather(name, arm, &here, plan, outcomes, step_n, &lost)
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
    let broken = stations.iter().filter(|station| judged(&station.arm)).flat_map(StationOutcome::broken).collect();
    let here: Vec<&Figures> = cells.iter().filter(|cell| judged(&cell.arm)).collect();
    let done: usize = here.iter().map(|cell| cell.done()).sum();
    let void_share = here.iter().map(|cell| cell.without_verdict).sum::<usize>() as f64 / done.max(1) as f64;
    let stations: Vec<&StationOutcome> = stations.iter().filter(|station| judged(&station.arm)).collect();
    let lost_elsewhere = lost.get(&None).copied().unwrap_or(0);
    let unknown = unknown(campaign, &stations, void_share, lost_elsewhere);
    let mut judgement = Judgement {
        campaign: campaign.name.clone(),
        seed: plan.seed,
        planned: plan.faults.len(),
        done: outcomes.len(),
        cells,
        pools,
        broken,
        unknown,
        void_share,
        exit_code: 0,
    };
    judgement.exit_code = exit_code(&judgement);
    judgement
}

/// What keeps the campaign as a whole from a verdict.
fn unknown(campaign: &Campaign, stations: &[&StationOutcome], void_share: f64, lost_elsewhere: u64) -> Vec<String> {
    let troubled = stations.iter().filter(|station| !station.trouble.is_empty() && station.faults.is_empty());
    let mut unknown: Vec<String> = troubled.map(|station| format!("run {}: {}", station.run, station.trouble)).collect();
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

/// 1 if a promise was broken; 3 if, at the end of the plan, nothing can be said of one; 0 while the plan is not through.
fn exit_code(judgement: &Judgement) -> u8 {
    let any = |verdict| judgement.cells.iter().chain(&judgement.pools).any(|figures| figures.verdict == verdict);
    match () {
        () if any(Verdict::Broken) || !judgement.broken.is_empty() => 1,
        () if judgement.done < judgement.planned => 0,
        () if any(Verdict::Unknown) || !judgement.unknown.is_empty() => 3,
        () => 0,
    }
}

/// Ticks after a fault's window in which the recorder may still lose what lay in the device's ring.
const RING_TICKS: u64 = 4_096;

/// Ticks that the recordings lost, by the fault in whose window they lie; those outside of every window are no fault's doing and have no
/// number, and count in arms that are judged.
fn lost_by(outcomes: &[Outcome], stations: &[StationOutcome], judged: &dyn Fn(&str) -> bool) -> BTreeMap<Option<usize>, u64> {
    let mut lost = BTreeMap::new();
    for station in stations {
        let here: Vec<&Outcome> = outcomes.iter().filter(|outcome| station.faults.contains(&outcome.index)).collect();
        for (first, last) in &station.lost {
            let overlaps = |outcome: &&&Outcome| {
                let window = outcome.fault.as_ref().and_then(|fault| fault.window);
                let to_tick = window.map_or(outcome.tick, |window| window.to_tick.max(outcome.tick)) + RING_TICKS;
                *last >= outcome.tick && *first < to_tick
            };
            let by = here.iter().filter(overlaps).max_by_key(|outcome| outcome.tick).map(|outcome| outcome.index);
            if by.is_some() || judged(&station.arm) {
                *lost.entry(by).or_default() += last.saturating_sub(*first) + 1;
            }
        }
    }
    lost
}

fn gather(
    name: &str,
    arm: &Arm,
    cells: &[&Cell],
    plan: &Plan,
    outcomes: &[Outcome],
    step_n: f64,
    lost: &BTreeMap<Option<usize>, u64>,
) -> Figures {
    let cell_of = |name: &str| cells.iter().find(|cell| cell.name == name);
    let planned = plan.faults.iter().filter(|entry| entry.arm == arm.name && cell_of(&entry.cell).is_some()).count();
    let mut figures = Figures { arm: arm.name.clone(), name: name.into(), planned, ..Figures::default() };
    let (mut missed, mut late) = (Sides::default(), Sides::default());
    for outcome in outcomes.iter().filter(|outcome| outcome.arm == arm.name) {
        let Some(cell) = cell_of(&outcome.cell) else { continue };
        figures.data_lost_ticks += lost.get(&Some(outcome.index)).copied().unwrap_or(0);
        figures.collateral += outcome.collateral.len();
        let excess = match (&outcome.fault, outcome.ending) {
            (Some(fault), Ending::Closed) => figures.take(fault, cell, step_n, outcome),
            (_, Ending::Open) => {
                figures.reasons.push(format!("fault {}: {}", outcome.index, outcome.reason));
                None
            }
            _ => None,
        };
        match excess {
            None => figures.without_verdict += 1,
            Some([excess, with_void]) => {
                missed.add(excess);
                late.add(with_void);
                figures.excess_misses.push(excess);
            }
        }
    }
    let lists = [&mut figures.detected_ms, &mut figures.hang_ms, &mut figures.contained_ms, &mut figures.recovered_ms];
    for list in lists {
        list.sort_by(f64::total_cmp);
    }
    if !figures.excess_misses.is_empty() {
        figures.mean_excess_misses = Some(figures.excess_misses.iter().sum::<i64>() as f64 / figures.excess_misses.len() as f64);
        figures.excess = Some(missed.excess());
        figures.excess_with_void = Some(late.excess());
    }
    if figures.data_lost_ticks > 0 {
        figures.reasons.push(format!("the recording lost {} ticks", figures.data_lost_ticks));
    }
    figures
}

impl Figures {
    /// Faults that are through.
    fn done(&self) -> usize {
        self.without_verdict + self.excess_misses.len()
    }

    /// Adds a fault; gives its excess misses beyond what it may cost, without and with void ticks, if it can be judged.
    fn take(&mut self, fault: &Fault, cell: &Cell, step_n: f64, outcome: &Outcome) -> Option<[i64; 2]> {
        let ms = |us: Option<f64>| us.map(|us| us * 1e-3);
        self.injected += 1;
        self.manifested += usize::from(fault.manifested);
        if !fault.detected_by.is_empty() {
            *self.detected_by.entry(fault.detected_by.clone()).or_default() += 1;
        }
        self.detected_ms.extend(ms(fault.detected_us));
        self.take_hang(fault);
        self.contained_ms.extend(ms(fault.contained_us));
        self.recovered_ms.extend(ms(fault.recovered_us));
        self.promise_held += usize::from(fault.promise_held == Some(true));
        if fault.manifested && fault.recovered_us.is_none() {
            self.reasons.push(format!("fault {}: {} did not recover", outcome.index, fault.target));
        }
        let died = |fault: &&Fault| fault.dead && fault.detected_by == "pidfd";
        for other in outcome.collateral.iter().filter(died) {
            self.reasons.push(format!("fault {}: {} died too ({})", outcome.index, other.target, other.exit));
        }
        if let Some(broken) = outcome.before.broken_by(&outcome.after) {
            self.reasons.push(format!("fault {}: {broken}", outcome.index));
        }
        let (window, control) = (fault.window?, fault.control?);
        for (sums, window) in [(&mut self.window_ticks, window), (&mut self.control_ticks, control)] {
            sums[0] += window.ticks;
            sums[1] += window.voided;
        }
        self.missed[0] += window.missed;
        self.missed[1] += control.missed;
        self.step_max_n = [self.step_max_n[0].max(window.force_step_max_n), self.step_max_n[1].max(control.force_step_max_n)];
        if window.force_step_max_n > fault.most_step_n(step_n) && fault.promise_held != Some(true) {
            let text = format!(
                "fault {}: a force step of {:.3} N, {step_n:.3} N without a fault",
                outcome.index, window.force_step_max_n
            );
            self.reasons.push(text);
        }
        let is_void = |window: crate::ledger::Window| window.voided >= window.ticks;
        // One that was to fall into a recovery, and came after it.
        let is_late = outcome.with.as_ref().is_some_and(|with| {
            let recovered_ns = with.recovered_us.map(|us| with.injected_ns + (us * 1e3) as u64);
            recovered_ns.is_some_and(|recovered_ns| fault.injected_ns > recovered_ns)
        });
        let is_astray = cell.injection.target.ends_with(":active") && !fault.active;
        self.astray += usize::from(is_astray);
        if !fault.manifested || is_astray || is_late || is_void(window) || is_void(control) {
            return None;
        }
        let beyond = |excess: i64| match excess {
            1.. => (excess - cell.allowed_misses as i64).max(0),
            _ if cell.allowed_misses > 0 => 0,
            _ => excess,
        };
        Some([window.missed as i64 - control.missed as i64, window.late as i64 - control.late as i64].map(beyond))
    }
}

/// Fewest control windows of which one in a hundred is left out.
const MANY: usize = 100;

/// The largest force step of fault-free ticks in an arm, N; of many control windows the hundredth part that stepped most does not count, so that a
/// single bad one does not excuse every fault.
fn quiet_step_n(arm: &Arm, outcomes: &[Outcome], stations: &[StationOutcome]) -> f64 {
    let here = outcomes.iter().filter(|outcome| outcome.arm == arm.name);
    let mut steps: Vec<f64> = here.filter_map(|outcome| Some(outcome.fault.as_ref()?.control?.force_step_max_n)).collect();
    if steps.len() >= MANY {
        steps.sort_by(f64::total_cmp);
        return steps[steps.len() - 1 - steps.len() / MANY];
    }
    let here = stations.iter().filter(|station| station.arm == arm.name);
    here.map(|station| station.control_step_max_n).fold(0.0, f64::max)
}

/// A pool with fewer judged faults than it was to have proves nothing.
fn enough(mut figures: Figures, least: usize, arm: &Arm) -> Figures {
    let judged = figures.excess_misses.len();
    if arm.judged && judged < least && figures.verdict == Verdict::Held {
        figures.verdict = Verdict::Unknown;
        figures.reasons.push(format!("{judged} faults have a verdict, at least {least} are to have one"));
    }
    figures
}

/// Gives the verdict. What never may happen is judged in the cells, once.
fn conclude(mut figures: Figures, limit: Option<f64>, arm: &Arm, is_cell: bool, campaign: &Campaign) -> Figures {
    figures.limit_upper95 = limit;
    let is_wrong = is_cell && !figures.reasons.is_empty();
    let done = figures.done();
    let is_void = figures.without_verdict as f64 > campaign.most_void * done as f64;
    figures.verdict = match (limit, figures.excess) {
        _ if !arm.judged => Verdict::Figures,
        _ if is_wrong => Verdict::Broken,
        (None, _) => Verdict::Figures,
        (Some(limit), Some(excess)) if excess.lower95 > limit => Verdict::Broken,
        (Some(limit), _) if figures.excess_with_void.is_some_and(|excess| excess.lower95 > limit) => Verdict::Broken,
        _ if is_void => Verdict::Unknown,
        (Some(limit), Some(excess)) if excess.upper95 <= limit => Verdict::Held,
        _ => Verdict::Unknown,
    };
    if let (Some(limit), Some(excess), true) =
        (limit, figures.excess, figures.verdict != Verdict::Held && figures.verdict != Verdict::Figures)
    {
        figures.reasons.push(format!(
            "excess misses per fault: {:.4}, 95 %: {:.4} to {:.4}, limit {limit}",
            excess.mean, excess.lower95, excess.upper95
        ));
        figures.reasons.extend(figures.excess_with_void.map(|excess| {
            let (mean, lower, upper) = (excess.mean, excess.lower95, excess.upper95);
            format!("with void ticks: {mean:.4}, 95 %: {lower:.4} to {upper:.4}")
        }));
    }
    figures.reasons.truncate(MOST_REASONS);
    figures
}

#[cfg(test)]
#[path = "judge_tests.rs"]
mod tests;
