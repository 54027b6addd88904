//! What a station shows as a whole, or only when its next fault comes, by the fault that it follows from.

use crate::campaign::cell::{Cell, May};
use crate::campaign::file::Campaign;
use crate::campaign::outcome::{Counters, Outcome};
use crate::campaign::station::StationOutcome;
use crate::fault::{EXTERNAL, Fault};
use crate::faultfile::Keepers;
use hyst_recording::sequence::RING_TICKS;
use std::collections::{BTreeMap, BTreeSet};

/// The fluid makes a state in some dozens of ticks: one that jumped may bear a tick from before the fault.
const STATE_TICKS: u64 = 100;

/// What came of the faults beside their own outcomes.
#[derive(Debug, Default)]
pub(super) struct Blame<'a> {
    /// Ticks that the recordings lost, by fault.
    lost: BTreeMap<usize, u64>,
    /// Ticks that they lost outside of every window: no fault's doing. Of arms that are judged.
    pub lost_elsewhere: u64,
    /// The outcome that comes next in the same run.
    next: BTreeMap<usize, &'a Outcome>,
    /// Other processes that died or hung, by the fault that was injected last before they did.
    others: BTreeMap<usize, Vec<&'a Fault>>,
    /// The last fault of each run that did not go on, and how that ended.
    ended: BTreeMap<usize, String>,
    /// Largest force step in the last recorded ticks of the same runs, N, by the same faults.
    last_step_n: BTreeMap<usize, f64>,
    /// What was left of the runs, by their last faults.
    left: BTreeMap<usize, u64>,
    /// The faults of stations without canaries.
    blind: BTreeSet<usize>,
    /// What was broken in stations of judged arms, in words.
    pub broken: Vec<String>,
}

impl<'a> Blame<'a> {
    pub(super) fn of(campaign: &Campaign, outcomes: &'a [Outcome], stations: &'a [StationOutcome]) -> Blame<'a> {
        let mut blame = Blame::default();
        for station in stations {
            let is_judged = campaign.judges(&station.arm);
            // A fault that is done again is in the lines of two runs.
            let is_of_run = |outcome: &&Outcome| outcome.run.is_none_or(|run| run == station.run);
            let suffered = outcomes.iter().filter(|outcome| station.faults.contains(&outcome.index));
            let mut here: Vec<&'a Outcome> = suffered.filter(is_of_run).collect();
            here.sort_by_key(|outcome| station.faults.iter().position(|index| *index == outcome.index));
            blame.next.extend(here.windows(2).map(|pair| (pair[0].index, pair[1])));
            blame.blind.extend(here.iter().filter(|_| station.blind).map(|outcome| outcome.index));
            for (at, line) in blame.assign(campaign, station, &here) {
                if is_judged {
                    blame.broken.push(format!(
                        "arm {}, run {}: {} before any fault, at tick {at}",
                        station.arm,
                        station.run,
                        end_of(line)
                    ));
                }
            }
            for (first, last) in &station.lost {
                let lost = last.saturating_sub(*first).saturating_add(1); // whatever a damaged recording says
                // So long after a fault the recorder may still lose what lay in the device's ring.
                match suspect(&here, *first, *last, RING_TICKS) {
                    Some(outcome) => add(blame.lost.entry(outcome.index).or_default(), lost),
                    None if is_judged => add(&mut blame.lost_elsewhere, lost),
                    None => {}
                }
            }
            let may = |outcome: &Outcome, what: May| cell_of(campaign, outcome).is_some_and(|cell| cell.may.contains(&what));
            blame.left.extend(here.last().map(|outcome| (outcome.index, station.leftovers)));
            let last = here.last().filter(|_| station.did_not_go_on());
            blame.ended.extend(last.map(|outcome| (outcome.index, station.end_in_words())));
            blame.last_step_n.extend(last.and_then(|outcome| Some((outcome.index, station.last_step_max_n?))));
            if !is_judged {
                continue;
            }
            blame.broken.extend(station.broken(last.is_some_and(|outcome| may(outcome, May::StationEnds))));
            for (tick, jump_ml) in &station.deficit_jumps {
                let suspects =
                    [0, STATE_TICKS].map(|late| tick.saturating_add(late)).map(|tick| suspect(&here, tick, tick, RING_TICKS));
                let is_why = |outcome: &&Outcome| may(outcome, May::BeginAnew) && blame.sequel(outcome).began_anew();
                if suspects.iter().flatten().any(is_why) {
                    continue;
                }
                let after = suspects[0].map_or(String::new(), |outcome| format!(" after fault {}", outcome.index));
                blame.broken.push(format!(
                    "arm {}, run {}: the deficit jumped by {jump_ml:.3} ml at tick {tick}{after}, without a flow that explains it",
                    station.arm, station.run
                ));
            }
        }
        blame
    }

    /// Gives each end of another process to the fault that was injected last before it, whenever its line was read; those before any fault are given back.
    fn assign(&mut self, campaign: &Campaign, station: &'a StationOutcome, here: &[&'a Outcome]) -> Vec<(u64, &'a Fault)> {
        let hurts_keeper = |cell: &Cell, name: &str| {
            Keepers::parse(&cell.injection.target).is_some_and(|keepers| keepers.roles().iter().any(|role| role.name() == name))
        };
        let lines = here.iter().flat_map(|outcome| outcome.collateral.iter().chain(&outcome.earlier)).chain(&station.external);
        let injected: Vec<(u64, &Outcome)> =
            here.iter().map(|outcome| (outcome.since_ns(), *outcome)).filter(|(since_ns, _)| *since_ns != 0).collect();
        let is_ours = |line: &Fault| {
            here.iter().any(|outcome| [&outcome.fault, &outcome.with].into_iter().flatten().any(|own| is_same(own, line)))
        };
        let (mut known, mut nobodys): (Vec<&Fault>, Vec<(u64, &Fault)>) = (Vec::new(), Vec::new());
        for line in lines.filter(|line| line.kind == EXTERNAL) {
            if is_ours(line) || known.iter().any(|other| is_same(other, line)) {
                continue;
            }
            known.push(line);
            // Who is ended had beaten before that, and is told of after it: what was done to him between the two was the end.
            let was_done = |(since_ns, outcome): &(u64, &Outcome)| {
                (line.injected_ns..=told_ns(line)).contains(since_ns)
                    && cell_of(campaign, outcome).is_some_and(|cell| hurts_keeper(cell, &line.target))
            };
            if injected.iter().any(was_done) {
                continue;
            }
            let before =
                injected.iter().filter(|(since_ns, _)| *since_ns <= happened_ns(line)).max_by_key(|(since_ns, _)| *since_ns);
            match before {
                // Those who keep the station end and come back one by one: whoever the cell hurts, and nobody else.
                Some((_, outcome)) if cell_of(campaign, outcome).is_some_and(|cell| hurts_keeper(cell, &line.target)) => {}
                Some((_, outcome)) => self.others.entry(outcome.index).or_default().push(line),
                None if line.is_found_dead() => nobodys.push((line.tick, line)),
                None => {} // one that was late while the station started
            }
        }
        nobodys
    }

    /// Ticks that the recording lost because of a fault.
    pub(super) fn lost_ticks(&self, index: usize) -> u64 {
        self.lost.get(&index).copied().unwrap_or(0)
    }

    /// Processes, segments and files that were left of the run, if this fault was its last.
    pub(super) fn leftovers(&self, index: usize) -> u64 {
        self.left.get(&index).copied().unwrap_or(0)
    }

    /// Whether its station had no canaries, so that nobody saw the host stall.
    pub(super) fn is_blind(&self, index: usize) -> bool {
        self.blind.contains(&index)
    }

    /// How the run ended if this fault was its last.
    pub(super) fn ended(&self, index: usize) -> Option<&str> {
        self.ended.get(&index).map(String::as_str)
    }

    /// Largest force step in the last recorded ticks of the run, N, if this fault was the one over which it ended; `None` if nothing is recorded of it.
    pub(super) fn last_step_n(&self, index: usize) -> Option<f64> {
        self.last_step_n.get(&index).copied()
    }

    /// What came after a fault, until the next one.
    pub(super) fn sequel<'b>(&'b self, outcome: &'b Outcome) -> Sequel<'b> {
        let next = self.next.get(&outcome.index);
        let others = self.others.get(&outcome.index).map_or(&[][..], Vec::as_slice);
        Sequel { outcome, until: next.map_or(&outcome.after, |next| &next.before), others }
    }
}

fn cell_of<'c>(campaign: &'c Campaign, outcome: &Outcome) -> Option<&'c Cell> {
    campaign.cell(&outcome.cell)
}

fn is_same(a: &Fault, b: &Fault) -> bool {
    (&a.target, a.incarnation, a.injected_ns) == (&b.target, b.incarnation, b.injected_ns)
}

/// When it was told of, ns.
fn told_ns(line: &Fault) -> u64 {
    line.injected_ns + (line.detected_us.unwrap_or(0.0) * 1e3) as u64
}

/// When a process that nobody hurt came to its end, ns. Its line says when it last beat, which may be long before: one that dies is told of at once, and of
/// one that hangs it is told after three of its periods.
fn happened_ns(line: &Fault) -> u64 {
    let after_ns = told_ns(line) - line.injected_ns;
    line.injected_ns + if line.is_found_dead() { after_ns } else { after_ns / 3 }
}

/// How a process came to its end, in words.
pub(super) fn end_of(line: &Fault) -> String {
    let how = if line.is_found_dead() { "died" } else { "hung and was ended" };
    format!("{} {how} ({}, found by {})", line.target, line.exit, line.detected_by)
}

/// A fault and what came after it, until the next one in the same run.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sequel<'a> {
    outcome: &'a Outcome,
    until: &'a Counters,
    others: &'a [&'a Fault],
}

impl<'a> Sequel<'a> {
    /// Other processes that died, or hung and were ended.
    pub(super) fn others(self) -> impl Iterator<Item = &'a Fault> {
        self.others.iter().copied().filter(|fault| fault.dead)
    }

    /// Whether a state went on from an older one.
    pub(super) fn began_anew(self) -> bool {
        self.until.founded_tick > self.outcome.before.founded_tick
    }

    /// What went back or jumped, in words.
    pub(super) fn broken(self) -> Option<String> {
        let before = &self.outcome.before;
        before.broken_by(&self.outcome.after).or_else(|| before.broken_by(self.until))
    }
}

fn add(sum: &mut u64, ticks: u64) {
    *sum = sum.saturating_add(ticks);
}

/// The last fault in whose window, and the ticks after it, these ticks lie.
fn suspect<'a>(here: &[&'a Outcome], first: u64, last: u64, after_ticks: u64) -> Option<&'a Outcome> {
    let overlaps = |outcome: &&&'a Outcome| {
        let window = outcome.fault.as_ref().and_then(|fault| fault.window);
        let to_tick = window.map_or(outcome.tick, |window| window.to_tick.max(outcome.tick)).saturating_add(after_ticks);
        last >= outcome.tick && first < to_tick
    };
    here.iter().filter(overlaps).max_by_key(|outcome| outcome.tick).copied()
}
