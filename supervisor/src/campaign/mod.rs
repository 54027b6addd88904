//! Fault campaigns: a plan of faults is drawn from a file and a seed, injected into stations of its own, and judged. The plan is printed
//! first. A campaign can be interrupted, run in batches, and one fault of it shown, or repeated at its tick and phase; the results of two are compared.
//!
//! Exit codes: 0 every promise held (or the batch is through and the plan is not), 1 a promise was broken, 2 a campaign that cannot be, or nothing to show, 3
//! nothing can be said because too much was void (of a batch: all of it), too few faults came about, the plan is through and stalls of the host were not seen, or the run stopped
//! before its batch was through (Ctrl-C, stations that do not come up, a disk that takes no results).

mod absent;
mod advice;
mod begun;
pub mod bounds;
pub mod cell;
pub mod compare;
mod deficit;
pub mod draw;
pub mod file;
mod fit;
mod found;
pub mod html;
pub mod judge;
pub mod junit;
mod last;
mod origin;
pub mod outcome;
pub mod plots;
mod repeat;
mod results;
mod room;
mod runner;
pub mod session;
mod show;
pub mod stage;
pub mod station;
pub mod store;
pub mod text;

#[cfg(test)]
mod report_tests;

use crate::cli::CampaignArgs;
use crate::settings::Refusal;
use crate::{neighbours, warn};
use draw::Plan;
use file::Campaign;
use hyst_exchange::Station;
use judge::Judgement;
use runner::Runner;
use std::io::Write;
use store::Store;

/// Runs a campaign, or a batch of it; gives the exit code.
pub fn run(name: &str, args: &CampaignArgs) -> Result<u8, Refusal> {
    let campaign = file::read(&args.file)?;
    if let Some((index, folder)) = args.show.zip(args.report.as_deref()) {
        return show::run(index, folder, &campaign, args);
    }
    fit::check(&campaign)?;
    let plan = draw::plan(&campaign, args.seed.unwrap_or(campaign.seed));
    if let Some(index) = args.only.filter(|index| *index >= plan.faults.len()) {
        return Err(Refusal::input(format!("--only {index}: the plan has faults 0 to {}", plan.faults.len() - 1)));
    }
    if args.plan && args.json {
        say(false, &format!("{:#}\n", serde_json::to_value(&plan).unwrap_or_default()));
    } else {
        say(args.json, &plan.text());
    }
    let blind = fit::warn_of_blind(&campaign).map(str::to_string);
    campaign.cannot_show().iter().chain(&blind).for_each(|line| warn(line));
    let room = room::check(&campaign, args.report.as_deref()).map_err(|reason| format!("campaign {}: {reason}", campaign.name));
    if args.plan {
        // The plan is as good as any: what room there is depends on where it is run, and with which --report.
        room.err().iter().for_each(|reason| warn(&format!("run like this, it would be refused: {reason}")));
        return Ok(0);
    }
    room.map_err(Refusal::input)?;
    let mut store = Store::open(args.report.as_deref(), &plan)?;
    store.told_of_cut().iter().for_each(|line| warn(line));
    if let Err(refusal) = store.keep_file(&campaign) {
        warn(&refusal.message); // it is for who compares; whatever the faults need is refused when they do
    }
    let code = in_folder(name, args, &campaign, &plan, &mut store);
    if !matches!(code, Ok(0))
        && let Some(folder) = store.keep()
    {
        warn(&format!("what came of it is kept in {}", folder.display()));
    }
    code
}

/// Runs it, its results in a folder.
fn in_folder(name: &str, args: &CampaignArgs, campaign: &Campaign, plan: &Plan, store: &mut Store) -> Result<u8, Refusal> {
    let interrupted = crate::interrupt::noticed().map_err(Refusal::failed)?;
    let name = if name == "default" { format!("campaign-{}", std::process::id()) } else { name.to_string() };
    let station = Station::named(&name).map_err(|e| Refusal::input(e.to_string()))?;
    if !crate::remains::living(&station).is_empty() {
        return Err(Refusal::input(format!(
            "a station named {name:?} is running; a campaign starts its own: give another --name"
        )));
    }
    neighbours::warning(&station).filter(|_| args.batch != Some(0)).iter().for_each(|line| warn(line));
    let runner = Runner { campaign, plan, station, interrupted, json: args.json };
    if let Some(index) = args.only {
        return runner.repeat(index, store);
    }
    let before = store.outcomes.len();
    let stopped = runner.run(store, args.batch.unwrap_or(usize::MAX))?;
    let judged = |outcomes| judge::judge(campaign, plan, outcomes, &store.stations, stopped.as_deref());
    let mut judgement = judged(&store.outcomes).after_batch(&judged(&store.outcomes[before..]));
    fit::note_blind(&mut judgement, campaign, &store.stations);
    // Said before it is written: what a full disk does not take is seen all the same.
    if args.json {
        say(false, &format!("{:#}\n", serde_json::to_value(&judgement).unwrap_or_default()));
    } else {
        say(false, &text::text(&judgement));
    }
    let written = report(&judgement, store).inspect_err(|refusal| warn(&refusal.message));
    Ok(concluded(judgement.exit_code, written.is_ok()))
}

/// The exit code of a judgement, and whether its reports could be written: a promise that was broken is, and any other run is not through without them.
fn concluded(exit_code: u8, is_written: bool) -> u8 {
    if is_written || exit_code == 1 { exit_code } else { 3 }
}

fn report(judgement: &Judgement, store: &Store) -> Result<(), Refusal> {
    let json = serde_json::to_string_pretty(judgement).map_err(|e| Refusal::failed(e.to_string()))?;
    store.write("report.json", &json)?;
    store.write("report.txt", &text::text(judgement))?;
    store.write("junit.xml", &junit::junit(judgement))?;
    store.write("report.html", &html::html(judgement, &store.outcomes, &store.stations))
}

/// Says a line or more: on stdout, or on stderr where stdout is for JSON alone.
fn say(json: bool, text: &str) {
    // A reader that has gone (`| head`) has read what it wanted; the faults go on.
    let _ = if json { std::io::stderr().write_all(text.as_bytes()) } else { std::io::stdout().write_all(text.as_bytes()) };
}

#[cfg(test)]
mod tests {
    use super::concluded;

    /// A disk that took no report ended with 1, as a broken promise does.
    #[test]
    fn a_report_that_cannot_be_written_breaks_no_promise_and_hides_none() {
        assert_eq!([0, 1, 3].map(|code| concluded(code, true)), [0, 1, 3]);
        assert_eq!([0, 1, 3].map(|code| concluded(code, false)), [3, 1, 3]);
    }
}
