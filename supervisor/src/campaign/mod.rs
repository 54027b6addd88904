//! Fault campaigns: a plan of faults is drawn from a file and a seed, injected into stations of its own, and judged. The plan is printed
//! first. A campaign can be interrupted, run in batches, and one fault of it repeated at its tick and phase.
//!
//! Exit codes: 0 every promise held (or the batch is through and the plan is not), 1 a promise was broken, 2 a campaign that cannot be, 3
//! nothing can be said because too much was void or too few faults came about.

pub mod bounds;
pub mod cell;
mod deficit;
pub mod draw;
pub mod file;
mod found;
pub mod html;
pub mod judge;
pub mod junit;
pub mod outcome;
pub mod plots;
pub mod session;
pub mod station;
pub mod store;
pub mod text;

use crate::cli::CampaignArgs;
use crate::settings::Refusal;
use draw::{Entry, Plan};
use file::Campaign;
use hyst_exchange::Station;
use judge::Judgement;
use outcome::Outcome;
use session::{Session, Trouble};
use station::StationOutcome;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use store::Store;

/// Stations in a row that may end before a single fault of theirs is through.
const MOST_FAILED_STATIONS: usize = 3;

/// Runs a campaign, or a batch of it; gives the exit code.
pub fn run(name: &str, args: &CampaignArgs) -> Result<u8, Refusal> {
    let campaign = file::read(&args.file)?;
    let plan = draw::plan(&campaign, args.seed.unwrap_or(campaign.seed));
    if let Some(index) = args.only.filter(|index| *index >= plan.faults.len()) {
        return Err(Refusal::input(format!("--only {index}: the plan has faults 0 to {}", plan.faults.len() - 1)));
    }
    say(args.json, &plan.text());
    campaign.cannot_show().iter().for_each(|line| eprintln!("hystation: {line}"));
    if args.plan {
        return Ok(0);
    }
    let mut store = Store::open(args.report.as_deref(), &plan)?;
    let interrupted = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&interrupted)).map_err(|e| Refusal::failed(format!("signals: {e}")))?;
    }
    let name = if name == "default" { format!("campaign-{}", std::process::id()) } else { name.to_string() };
    let station = Station::named(&name).map_err(|e| Refusal::input(e.to_string()))?;
    if !crate::remains::living(&station).is_empty() {
        return Err(Refusal::input(format!(
            "a station named {name:?} is running; a campaign starts its own: give another --name"
        )));
    }
    let mut runner = Runner { campaign: &campaign, plan: &plan, station, interrupted, json: args.json };
    if let Some(index) = args.only {
        return runner.repeat(index, &store);
    }
    runner.run(&mut store, args.batch.unwrap_or(usize::MAX))?;
    let judgement = judge::judge(&campaign, &plan, &store.outcomes, &store.stations);
    report(&judgement, &store)?;
    if args.json {
        say(false, &format!("{:#}\n", serde_json::to_value(&judgement).unwrap_or_default()));
    } else {
        say(false, &text::text(&judgement));
    }
    Ok(judgement.exit_code)
}

fn report(judgement: &Judgement, store: &Store) -> Result<(), Refusal> {
    let json = serde_json::to_string_pretty(judgement).map_err(|e| Refusal::failed(e.to_string()))?;
    store.write("report.json", &json)?;
    store.write("report.txt", &text::text(judgement))?;
    store.write("junit.xml", &junit::junit(judgement))?;
    store.write("report.html", &html::html(judgement, &store.outcomes, &store.stations))
}

struct Runner<'a> {
    campaign: &'a Campaign,
    plan: &'a Plan,
    station: Station,
    interrupted: Arc<AtomicBool>,
    json: bool,
}

/// Says a line or more: on stdout, or on stderr where stdout is for JSON alone.
fn say(json: bool, text: &str) {
    // A reader that has gone (`| head`) has read what it wanted; the faults go on.
    let _ = if json { std::io::stderr().write_all(text.as_bytes()) } else { std::io::stdout().write_all(text.as_bytes()) };
}

impl Runner<'_> {
    /// Injects what is not through yet, at most `batch` faults.
    fn run(&mut self, store: &mut Store, batch: usize) -> Result<(), Refusal> {
        let open: Vec<&Entry> = self.plan.faults.iter().filter(|entry| !store.has(entry.index)).take(batch).collect();
        let mut at = 0;
        let mut failed = 0;
        while at < open.len() && failed < MOST_FAILED_STATIONS && !self.interrupted.load(Ordering::Relaxed) {
            let number = open[at].station;
            let lap: Vec<&Entry> = open[at..].iter().copied().take_while(|entry| entry.station == number).collect();
            let through = self.lap(&lap, store)?;
            failed = if through == 0 { failed + 1 } else { 0 };
            at += through;
        }
        if failed == MOST_FAILED_STATIONS {
            eprintln!(
                "hystation: {MOST_FAILED_STATIONS} stations in a row came to nothing; their logs are in {}",
                store.folder().display()
            );
        }
        Ok(())
    }

    /// One station with its faults; gives how many of them are through.
    fn lap(&mut self, entries: &[&Entry], store: &mut Store) -> Result<usize, Refusal> {
        let Some(first) = entries.first() else { return Ok(0) };
        let run = store.stations.len();
        let files = store.folder().join(format!("run-{run}"));
        let mut station = StationOutcome { run, station: first.station, arm: first.arm.clone(), ..StationOutcome::default() };
        let mut trouble = None;
        match self.start(entries, &files) {
            Err(Trouble::Refused(why)) => return Err(Refusal::input(format!("no station can be started: {why}"))),
            Err(error) => trouble = Some(error),
            Ok(mut session) => {
                for entry in entries {
                    match self.hurt(&mut session, entry) {
                        Ok((outcome, ended)) => {
                            say(self.json, &format!("{}\n", text::line(&outcome, self.plan.faults.len())));
                            station.faults.push(entry.index);
                            store.add(outcome)?;
                            trouble = ended;
                            if trouble.is_some() {
                                break;
                            }
                        }
                        Err(error) => {
                            trouble = Some(error);
                            break;
                        }
                    }
                }
                station.exit_code = session.stop();
            }
        }
        station.read_report(&files.with_extension("json"));
        let recording = files.with_extension("mcap");
        if self.campaign.records() {
            station.read_recording(&recording);
        }
        if station.lost.is_empty() && station.damage.is_empty() {
            let _ = std::fs::remove_file(&recording); // kept only if it shows something
        }
        if let Some(error) = trouble {
            eprintln!("hystation: run {run}: {error}");
            if !matches!(error, Trouble::Interrupted) {
                station.trouble = error.to_string();
            }
        }
        let through = station.faults.len();
        store.add_station(station)?;
        Ok(through)
    }

    fn start(&self, entries: &[&Entry], files: &Path) -> Result<Session, Trouble> {
        let arm = self.campaign.arms.iter().find(|arm| Some(&arm.name) == entries.first().map(|entry| &entry.arm));
        let arm = arm.unwrap_or(&self.campaign.arms[0]); // a plan names arms of its campaign alone
        Session::start(self.campaign, arm, entries, &self.station, files, Arc::clone(&self.interrupted))
    }

    fn hurt(&self, session: &mut Session, entry: &Entry) -> Result<(Outcome, Option<Trouble>), Trouble> {
        match self.campaign.cells.iter().find(|cell| cell.name == entry.cell) {
            Some(cell) => session.hurt(entry, cell),
            None => Ok((Outcome::of(entry), None)),
        }
    }

    /// One fault alone, in a station of its own, at the tick at which it was injected if the folder knows that, else at the drawn one.
    fn repeat(&mut self, index: usize, store: &Store) -> Result<u8, Refusal> {
        let mut entry = self.plan.faults[index].clone();
        if let Some(known) = store.outcomes.iter().find(|outcome| outcome.index == index) {
            entry.tick = known.tick - if known.with.is_some() { entry.with_ticks.min(known.tick) } else { 0 };
        }
        let failed = |trouble: Trouble| Refusal::failed(trouble.to_string());
        let mut session = self.start(&[&entry], &store.folder().join(format!("only-{index}-run"))).map_err(failed)?;
        let (outcome, _) = self.hurt(&mut session, &entry).map_err(failed)?; // what became of the station is in the outcome
        session.stop();
        say(self.json, &format!("{}\n", text::line(&outcome, self.plan.faults.len())));
        let json = serde_json::to_string_pretty(&outcome).map_err(|e| Refusal::failed(e.to_string()))?;
        store.write(&format!("only-{index}.json"), &json)?;
        say(false, &format!("{json}\n"));
        Ok(match outcome.fault.as_ref().and_then(|fault| fault.promise_held) {
            Some(true) => 0,
            Some(false) => 1,
            None => 3,
        })
    }
}
