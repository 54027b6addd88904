//! The faults of a plan, one after another: stations are started for them, hurt, stopped, and what came of both is handed on.

use super::absent::Absent;
use super::draw::{Entry, FIRST_TICK, Plan};
use super::file::{Arm, Campaign};
use super::origin::Origin;
use super::outcome::{Ending, Outcome};
use super::session::{Session, Trouble};
use super::station::StationOutcome;
use super::store::Store;
use super::{fit, say, text};
use crate::settings::Refusal;
use crate::warn;
use hyst_exchange::{Station, system};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Stations in a row that may end before a single fault of theirs is through.
const MOST_FAILED_STATIONS: usize = 3;

/// Runs the faults of a plan.
pub(super) struct Runner<'a> {
    pub campaign: &'a Campaign,
    pub plan: &'a Plan,
    pub station: Station,
    pub interrupted: Arc<AtomicBool>,
    pub json: bool,
}

impl Runner<'_> {
    /// Injects what is not through yet, at most `batch` faults; gives why it stopped before they were through, if it did.
    pub(super) fn run(&self, store: &mut Store, batch: usize) -> Result<Option<String>, Refusal> {
        let open: Vec<&Entry> = self.plan.faults.iter().filter(|entry| !store.has(entry.index)).take(batch).collect();
        let mut at = 0;
        let mut failed = 0;
        let mut absent = Absent::of(&store.outcomes);
        while at < open.len() && failed < MOST_FAILED_STATIONS && !self.interrupted.load(Ordering::Relaxed) {
            let number = open[at].station;
            let lap: Vec<&Entry> = open[at..].iter().copied().take_while(|entry| entry.station == number).collect();
            let lap = closed_up(&lap, &self.plan.faults, self.campaign.gap_ticks[1]);
            let origin = Origin::here(self.campaign)?;
            store.check_build(&origin)?;
            let run = store.begin(number, &origin)?;
            let files = store.files(run);
            let mut take = |outcome: Outcome| store.add(Outcome { run: Some(run), ..outcome });
            let mut station = self.lap(&lap.iter().collect::<Vec<_>>(), run, &files, &mut take, &mut absent)?;
            station.origin = Some(origin);
            let through = station.through().count();
            store.add_station(station)?;
            failed = if through == 0 { failed + 1 } else { 0 };
            at += through;
        }
        let left = open.len() - at;
        Ok(match () {
            () if left == 0 => None,
            () if self.interrupted.load(Ordering::Relaxed) => {
                Some(format!("interrupted: {left} faults of this run are left, and the same command goes on"))
            }
            () => Some(format!(
                "{MOST_FAILED_STATIONS} stations in a row came to nothing, and {left} faults of this run are left; their logs are in {}",
                store.folder().display()
            )),
        })
    }

    /// One station with its faults; gives what came of it, and hands on what came of each of them.
    pub(super) fn lap(
        &self,
        entries: &[&Entry],
        run: usize,
        files: &Path,
        take: &mut dyn FnMut(Outcome) -> Result<(), Refusal>,
        absent: &mut Absent,
    ) -> Result<StationOutcome, Refusal> {
        let Some(first) = entries.first() else { return Ok(StationOutcome::default()) };
        let (arm, blind) = (first.arm.clone(), !fit::has_canaries(self.campaign, self.arm_of(first)));
        let mut station = StationOutcome { run, station: first.station, arm, blind, ..StationOutcome::default() };
        let trouble;
        let mut cut_ns = u64::MAX;
        match self.start(entries, files) {
            Err(error) => (trouble, station.never_whole) = (Some(error), true),
            Ok(mut session) => {
                match session.await_whole() {
                    Err(Trouble::Refused(why)) => return Err(Refusal::input(format!("no station can be started: {why}"))),
                    Err(error) => (trouble, station.never_whole) = (Some(error), true),
                    Ok(()) => (trouble, cut_ns) = self.hurt_all(&mut session, entries, &mut station, take, absent)?,
                }
                let ended = session.stop();
                (station.exit_code, station.leftovers) = (ended.exit_code, ended.leftovers);
            }
        }
        station.read_report(&files.with_extension("json"));
        station.forget_since(cut_ns);
        let recording = files.with_extension("mcap");
        if self.campaign.records() {
            station.read_recording(&recording);
        }
        if !station.recording_shows_something() {
            let _ = std::fs::remove_file(&recording);
        }
        if let Some(error) = trouble {
            warn(&format!("run {run}: {error}"));
            if !matches!(error, Trouble::Interrupted) {
                station.trouble = error.to_string();
            }
        }
        Ok(station)
    }

    /// Injects the faults one after another, but for those whose state does not come, and hands on what came of each; gives what kept the station from going on,
    /// and since when the fault was under way that was cut off by it, ns.
    pub(super) fn hurt_all(
        &self,
        session: &mut Session,
        entries: &[&Entry],
        station: &mut StationOutcome,
        take: &mut dyn FnMut(Outcome) -> Result<(), Refusal>,
        absent: &mut Absent,
    ) -> Result<(Option<Trouble>, u64), Refusal> {
        for entry in entries {
            let begun_ns = system::now_ns();
            let (outcome, ended) = match absent.why_skipped(entry, station.run) {
                Some(reason) => {
                    station.skipped.push(entry.index);
                    (self.as_planned(Outcome { ending: Ending::Skipped, reason, ..Outcome::of(entry) }), None)
                }
                None => match self.hurt(session, entry) {
                    Ok(found) => {
                        station.faults.push(entry.index);
                        found
                    }
                    Err(error) => return Ok((Some(error), begun_ns)),
                },
            };
            absent.note(&outcome, Some(station.run));
            say(self.json, &format!("{}\n", text::line(&outcome, self.plan.faults.len())));
            take(outcome)?;
            if ended.is_some() {
                return Ok((ended, u64::MAX));
            }
        }
        Ok((None, u64::MAX))
    }

    fn arm_of(&self, entry: &Entry) -> &Arm {
        let named = self.campaign.arms.iter().find(|arm| arm.name == entry.arm);
        named.unwrap_or(&self.campaign.arms[0]) // a plan names arms of its campaign alone
    }

    fn start(&self, entries: &[&Entry], files: &Path) -> Result<Session, Trouble> {
        let arm = entries.first().map_or(&self.campaign.arms[0], |first| self.arm_of(first));
        Session::start(self.campaign, arm, entries, &self.station, files, Arc::clone(&self.interrupted))
    }

    fn hurt(&self, session: &mut Session, entry: &Entry) -> Result<(Outcome, Option<Trouble>), Trouble> {
        match self.campaign.cell(&entry.cell) {
            Some(cell) => session.hurt(entry, cell).map(|(outcome, ended)| (self.as_planned(outcome), ended)),
            None => Ok((Outcome::of(entry), None)),
        }
    }

    /// With the tick and phase that were drawn: a run that goes on, and a repetition, ask for others.
    fn as_planned(&self, mut outcome: Outcome) -> Outcome {
        if let Some(drawn) = self.plan.faults.get(outcome.index) {
            (outcome.planned_tick, outcome.phase_us) = (drawn.tick, drawn.phase_us);
        }
        outcome
    }
}

/// The faults of a station that are not through yet, as soon as they may come: a run that goes on does not wait for those that are.
fn closed_up(open: &[&Entry], plan: &[Entry], most_gap_ticks: u64) -> Vec<Entry> {
    let mut before: Option<(&Entry, u64)> = None;
    let mut lap = Vec::with_capacity(open.len());
    for entry in open {
        let planned_before =
            entry.index.checked_sub(1).and_then(|index| plan.get(index)).filter(|it| it.station == entry.station);
        let tick = match (planned_before, before) {
            (None, _) => entry.tick,
            (Some(planned), Some((last, tick))) if planned.index == last.index => tick + (entry.tick - last.tick),
            (Some(_), before) => before.map_or(FIRST_TICK, |(_, tick)| tick) + most_gap_ticks,
        };
        before = Some((entry, tick));
        lap.push(Entry { tick, ..(*entry).clone() });
    }
    lap
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::{draw, file};

    #[test]
    fn a_run_that_is_interrupted_before_its_batch_is_through_says_so_and_one_with_nothing_left_does_not() {
        let text = "[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid\"]\ncount = 3\n";
        let campaign = file::parse("t", text).unwrap();
        let plan = draw::plan(&campaign, 1);
        let folder = std::env::temp_dir().join(format!("hystation-runner-{}", std::process::id()));
        let mut store = Store::open(Some(&folder), &plan).unwrap();
        let station = Station::named(&format!("t{}-runner", std::process::id())).unwrap();
        let interrupted = Arc::new(AtomicBool::new(true));
        let runner = Runner { campaign: &campaign, plan: &plan, station, interrupted, json: true };
        assert!(runner.run(&mut store, 2).unwrap().unwrap().contains("2 faults of this run are left"));
        plan.faults.iter().for_each(|entry| store.add(Outcome::of(entry)).unwrap());
        assert_eq!(runner.run(&mut store, 2).unwrap(), None);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_run_that_goes_on_does_not_wait_for_the_faults_that_are_through() {
        let text = "gap_ticks = [500, 700]\nfaults_per_station = 6\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"tissue:active\"]\ncount = 12\n";
        let plan = draw::plan(&file::parse("t", text).unwrap(), 1).faults;
        let up = |open: &[usize]| {
            let open: Vec<&Entry> = open.iter().map(|index| &plan[*index]).collect();
            closed_up(&open, &plan, 700).iter().map(|entry| entry.tick).collect::<Vec<_>>()
        };
        let tick = |index: usize| plan[index].tick;
        assert_eq!(up(&[0, 1, 2, 3]), [0, 1, 2, 3].map(tick), "nothing is through");
        assert_eq!(up(&[6, 7]), [6, 7].map(tick), "the first of the next station");
        let first = FIRST_TICK + 700;
        assert_eq!(up(&[3, 4]), [first, first + tick(4) - tick(3)]);
        assert_eq!(up(&[0, 1, 4, 5]), [tick(0), tick(1), tick(1) + 700, tick(1) + 700 + tick(5) - tick(4)]);
    }
}
