//! The figures of a cell or a pool in one arm, and the verdict that they give.

use super::blame::Blame;
use super::take::Taken;
use crate::campaign::bounds::{Excess, Sides, mean_upper95, together};
use crate::campaign::cell::Cell;
use crate::campaign::draw::Plan;
use crate::campaign::file::Arm;
use crate::campaign::outcome::{Ending, Outcome};
use crate::campaign::station::StationOutcome;
use crate::fault::compare::{MANY, most_missed};
use crate::ledger::Window;
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
    /// Whether promises are judged in it.
    pub judged: bool,
    /// Cell's or pool's name.
    pub name: String,
    /// Faults in the plan.
    pub planned: usize,
    /// Faults that were injected.
    pub injected: usize,
    /// Those that showed: of what is only done from outside, those that somebody noticed.
    pub manifested: usize,
    /// The same of the faults in whose recoveries, or hand-overs, they came.
    pub first_manifested: usize,
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
    /// Faults that could not be judged: not injected, not shown, no control window, or the host stalled in more than a fifth of a window.
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
    /// Of faults that nobody noticed, those with excess misses, per fault: no promise is held by them, but one can be broken.
    #[serde(default)]
    pub excess_unnoticed: Option<Excess>,
    /// [`Figures::excess`] of those whose controls began in the same state, contact or none, where some did not.
    #[serde(default)]
    pub excess_alike: Option<Excess>,
    /// The station in which those that differ from their controls lie together, more than chance has it: then the bounds, which take faults as independent,
    /// are too narrow.
    #[serde(default)]
    pub together_in: Option<usize>,
    /// Excess misses of each judged fault, in the plan's order, those that it may cost among them.
    pub excess_misses: Vec<i64>,
    /// The same beyond what it may cost, by which the bound is made.
    pub beyond_misses: Vec<i64>,
    /// Ticks that each fault may cost; of a pool, the most that one of its cells allows.
    pub allowed_misses: u64,
    /// The mean of the excess misses: one stall of the host that falls into a window weighs there as much as it is long.
    pub mean_excess_misses: Option<f64>,
    /// Below this it lies with some 95 %, station by station, and of fewer than ten fault by fault if that is more; 0 if no fault cost more than its control, and
    /// then no bound.
    #[serde(default)]
    pub mean_excess_misses_upper95: Option<f64>,
    /// The same of the mean of [`Figures::beyond_misses`]: a limit that it does not keep is not held.
    #[serde(default)]
    pub mean_beyond_misses_upper95: Option<f64>,
    /// Ticks right after the windows of the judged faults, in which no control lies, and how many of them missed their force.
    #[serde(default)]
    pub aftermath: [u64; 2],
    /// Faults that were to hurt whoever does the role's work, and came when another had taken over already; they have no verdict.
    pub astray: usize,
    /// Largest force step in a fault window, and in a control window, N.
    pub step_max_n: [f64; 2],
    /// Ticks that the recording lost after these faults.
    pub data_lost_ticks: u64,
    /// Processes, segments and files that were left of the runs whose last faults these were.
    pub leftovers: u64,
    /// Other processes that died, or hung and were ended, each with the fault that was the last before it.
    pub collateral: Vec<String>,
    /// What the faults brought about beside what they were to do, and how often: others died, began anew, station ended, swap done, swap undone; and
    /// for how many there was only a control in the other state, contact or none. And how many waited in vain for their state, and were skipped.
    pub seen: BTreeMap<&'static str, usize>,
    /// Faults of which nothing came, or that were refused, by their numbers.
    pub not_shown: Vec<usize>,
    /// Second faults whose first did not show, by their numbers; they have no verdict.
    pub first_not_shown: Vec<usize>,
    /// Those that came after the recovery, the hand-over or the swap that they were to fall into, by their numbers; they have no verdict.
    pub beside: Vec<usize>,
    /// Of faults that are only done from outside: where, and by whom they were noticed, or what became of what was done.
    pub segment: String,
    /// See [`Figures::segment`].
    pub noticed: BTreeMap<String, usize>,
    /// Of the same, who died: the process that was hurt, or another.
    pub died: BTreeMap<String, usize>,
    /// Of the same, those that nobody noticed, by their numbers: they are in no bound but [`Figures::excess_unnoticed`].
    pub unnoticed: Vec<usize>,
    /// Lies that nobody found, by the numbers of their faults.
    pub unfound: Vec<usize>,
    /// Ticks in the fault windows whose force was not finite, too large, old, or made by a servo that lied.
    pub wrong: u64,
    /// Limit.
    pub limit_upper95: Option<f64>,
    /// Verdict.
    pub verdict: Verdict,
    /// What speaks against it.
    pub reasons: Vec<String>,
    /// What would speak against it if it were known that it was not the host: that no canary saw it stall proves nothing where none ran.
    #[serde(skip)]
    pub unsure: Vec<String>,
}

/// What the figures are made from.
pub(super) struct Known<'a> {
    pub plan: &'a Plan,
    pub outcomes: &'a [Outcome],
    /// Largest force steps of fault-free windows, N: of those that came while the tool touched nothing, and while it did.
    pub steps_n: [f64; 2],
    /// Most ticks that a control window lost.
    pub most_missed: u64,
    pub blame: &'a Blame<'a>,
}

pub(super) fn gather(name: &str, arm: &Arm, cells: &[&Cell], known: &Known) -> Figures {
    let cell_of = |name: &str| cells.iter().find(|cell| cell.name == name);
    let planned = known.plan.faults.iter().filter(|entry| entry.arm == arm.name && cell_of(&entry.cell).is_some()).count();
    let allowed_misses = cells.iter().map(|cell| cell.allowed_misses).max().unwrap_or(0);
    let (arm_name, judged) = (arm.name.clone(), arm.judged);
    let mut figures = Figures { arm: arm_name, name: name.into(), judged, planned, allowed_misses, ..Figures::default() };
    let mut sums = Sums::default();
    for outcome in known.outcomes.iter().filter(|outcome| outcome.arm == arm.name) {
        let Some(cell) = cell_of(&outcome.cell) else { continue };
        figures.take_sequel(cell, outcome, known.blame);
        figures.take_first(cell, outcome, known.blame);
        let taken = match (&outcome.fault, outcome.ending) {
            (Some(fault), Ending::Closed) => figures.take(fault, cell, known, outcome),
            (_, Ending::Open) => figures.take_open(cell, known, outcome),
            _ => {
                figures.take_undone(outcome);
                Taken::NoVerdict
            }
        };
        sums.take(outcome.station, taken, &mut figures);
    }
    let lists = [&mut figures.detected_ms, &mut figures.hang_ms, &mut figures.contained_ms, &mut figures.recovered_ms];
    for list in lists {
        list.sort_by(f64::total_cmp);
    }
    sums.close(&mut figures);
    figures
}

/// What the faults with a verdict add up to.
#[derive(Default)]
pub(super) struct Sums {
    missed: Sides,
    late: Sides,
    alike: Sides,
    silent: Sides,
    /// By station: what each of its faults cost, and what beyond that which it may.
    stations: BTreeMap<usize, [Vec<i64>; 2]>,
}

impl Sums {
    /// Adds what a fault in a station says, here and to the figures.
    pub(super) fn take(&mut self, station: usize, taken: Taken, figures: &mut Figures) {
        match taken {
            Taken::NoVerdict => figures.without_verdict += 1,
            Taken::Stalled(with_void) => {
                self.late.add(with_void);
                figures.without_verdict += 1;
            }
            Taken::Unnoticed(excess) => excess.into_iter().for_each(|excess| self.silent.add(excess)),
            Taken::Excess { lost, beyond: [excess, with_void], is_alike } => {
                self.add(station, lost, [excess, with_void], is_alike);
                figures.excess_misses.push(lost);
                figures.beyond_misses.push(excess);
            }
        }
    }

    fn add(&mut self, station: usize, lost: i64, [excess, with_void]: [i64; 2], is_alike: bool) {
        self.missed.add(excess);
        self.late.add(with_void);
        if is_alike {
            self.alike.add(excess);
        }
        let [costs, beyond] = self.stations.entry(station).or_default();
        costs.push(lost);
        beyond.push(excess);
    }

    /// Gives the figures their bounds.
    pub(super) fn close(self, figures: &mut Figures) {
        figures.excess_with_void = Some(self.late.excess()).filter(|excess| excess.faults > 0);
        figures.excess_unnoticed = Some(self.silent.excess()).filter(|excess| excess.faults > 0);
        let judged = figures.excess_misses.len();
        if judged == 0 {
            return;
        }
        figures.mean_excess_misses = Some(figures.excess_misses.iter().sum::<i64>() as f64 / judged as f64);
        figures.excess = Some(self.missed.excess());
        figures.excess_alike = Some(self.alike.excess()).filter(|alike| alike.faults < judged);
        let differ = |beyond: &[i64]| beyond.iter().filter(|excess| **excess != 0).count();
        let spread: Vec<(usize, usize)> = self.stations.values().map(|[_, beyond]| (beyond.len(), differ(beyond))).collect();
        figures.together_in = together(&spread).and_then(|at| self.stations.keys().nth(at).copied());
        let (costs, beyond): (Vec<Vec<i64>>, Vec<Vec<i64>>) =
            self.stations.into_values().map(|[costs, beyond]| (costs, beyond)).unzip();
        (figures.mean_excess_misses_upper95, figures.mean_beyond_misses_upper95) = (mean_upper95(&costs), mean_upper95(&beyond));
    }
}

impl Figures {
    /// Faults that are through.
    pub(super) fn done(&self) -> usize {
        self.without_verdict + self.excess_misses.len() + self.unnoticed.len()
    }

    /// Whether there are faults with a verdict, and none of them missed more than its control.
    pub fn lost_none(&self) -> bool {
        !self.excess_misses.is_empty() && self.excess_misses.iter().all(|excess| *excess <= 0)
    }

    /// The mean of [`Figures::beyond_misses`]; 0 of none.
    pub fn mean_beyond_misses(&self) -> f64 {
        self.beyond_misses.iter().sum::<i64>() as f64 / self.beyond_misses.len().max(1) as f64
    }
}

/// The largest force steps of fault-free ticks in an arm, N, of those of its control windows that came while the tool touched nothing, and of those that came
/// while it did: what is made at the wall excuses no kick in the open. Of many control windows with such steps the hundredth part that stepped most does not
/// count, so that a single bad one does not excuse every fault. Where none has a step in the open, nobody knows better than all of them together.
pub(super) fn quiet_steps_n(arm: &Arm, outcomes: &[Outcome], stations: &[StationOutcome]) -> [f64; 2] {
    [false, true].map(|in_contact| {
        let here = outcomes.iter().filter(|outcome| outcome.arm == arm.name);
        let later = |outcome: &&Outcome| outcome.fault.as_ref().is_some_and(|fault| !fault.control_early);
        let controls = here.filter(later).filter_map(|outcome| Some((outcome.fault.as_ref()?.control?, outcome)));
        let steps = controls.map(|(control, outcome)| control.steps_n(touches(Some(&control), outcome)));
        let mut steps: Vec<f64> = steps.filter_map(|steps_n| steps_n[usize::from(in_contact)]).collect();
        steps.sort_by(f64::total_cmp);
        if steps.len() >= MANY {
            return steps[steps.len() - 1 - steps.len() / MANY];
        }
        let of_all = in_contact || steps.is_empty();
        let here = stations.iter().filter(|station| of_all && station.arm == arm.name);
        here.map(|station| station.control_step_max_n).chain(steps.last().copied()).fold(0.0, f64::max)
    })
}

/// Whether the tool touched something where a window begins, as its first force says; of one of which that is not known, when the fault was asked for.
pub(super) fn touches(window: Option<&Window>, outcome: &Outcome) -> bool {
    window.and_then(|window| window.contact).unwrap_or(outcome.before.contacts > 0)
}

/// Most ticks that a control window of an arm lost.
pub(super) fn most_missed_without(arm: &Arm, outcomes: &[Outcome]) -> u64 {
    let here = outcomes.iter().filter(|outcome| outcome.arm == arm.name).filter_map(|outcome| outcome.fault.as_ref());
    most_missed(here.filter(|fault| !fault.control_early).filter_map(|fault| fault.control))
}
