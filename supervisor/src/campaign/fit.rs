//! Whether the stations of a campaign can be run, before its plan is told and anything is made: the command that starts them is checked as `hystation run`
//! checks it, scene, hand, settings and engines.

use super::cell::State;
use super::file::{Arm, Campaign};
use super::judge::Judgement;
use super::session;
use super::station::StationOutcome;
use crate::case::RunCase;
use crate::cli::{Cli, Command};
use crate::commands::check::{Admitted, admit};
use crate::settings::{Refusal, prepare};
use clap::Parser;
use hyst_engine::realtime::CANARY_PRIORITY;
use hyst_exchange::{Station, system};

/// Refuses what no station could be started with, and a state that its hand never brings about.
pub(super) fn check(campaign: &Campaign) -> Result<(), Refusal> {
    for arm in &campaign.arms {
        let refuse = |reason: &str| format!("campaign {}: arm {:?}: {reason}", campaign.name, arm.name);
        let admitted = admitted(campaign, arm).map_err(|refusal| Refusal { message: refuse(&refusal.message), ..refusal })?;
        let cutting = campaign.cells.iter().find(|cell| cell.state == State::Cutting && arm.count(cell) > 0);
        if let Some(cell) = cutting.filter(|_| !admitted.may_cut) {
            let reason = format!(
                "cell {}: state cutting: the hand {:?} cuts nothing; take one that cuts for as long as the faults take, as script:slices of the case myoma",
                cell.name,
                campaign.hand()
            );
            return Err(Refusal::input(refuse(&reason)));
        }
    }
    Ok(())
}

/// Whether the stations of an arm have canaries, which see the host stall: threads of real time, where that is wanted and granted.
pub(super) fn has_canaries(campaign: &Campaign, arm: &Arm) -> bool {
    let is_off = campaign.set(arm).get("realtime").is_some_and(|value| value == "off");
    // Asked of a thread that ends at once, so that nothing here runs in real time.
    !is_off && std::thread::spawn(|| system::become_fifo(CANARY_PRIORITY)).join().unwrap_or(false)
}

/// What is said before stations are started that have none.
pub(super) fn warn_of_blind(campaign: &Campaign) -> Option<&'static str> {
    let is_blind = campaign.arms.iter().any(|arm| !has_canaries(campaign, arm));
    is_blind.then_some("no canaries: real time is off or refused, and stalls of the host count as misses (`hystation doctor`)")
}

/// Adds to a judgement what it cannot know: of a station without canaries, which ticks were the host's. The plan that is through is then no proof.
pub(super) fn note_blind(judgement: &mut Judgement, campaign: &Campaign, stations: &[StationOutcome]) {
    let hurt = stations.iter().filter(|station| campaign.judges(&station.arm) && !station.faults.is_empty());
    let (of, blind) = (hurt.clone().count(), hurt.filter(|station| station.blind).count());
    if blind == 0 {
        return;
    }
    judgement.unknown.push(format!("no canaries in {blind} of {of} runs: stalls of the host count as misses"));
    if judgement.exit_code == 0 && judgement.done >= judgement.planned {
        judgement.exit_code = 3;
    }
}

/// What is known of the stations of an arm, once they are found fit.
fn admitted(campaign: &Campaign, arm: &Arm) -> Result<Admitted, Refusal> {
    let failed = |error: &dyn std::fmt::Display| Refusal::failed(error.to_string());
    let station = Station::named(&format!("campaign-{}", std::process::id())).map_err(|error| failed(&error))?;
    let files = std::env::temp_dir().join(station.name()); // nothing is written there
    let command = session::command(campaign, arm, &[], &station, &files).map_err(|error| failed(&error))?;
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    let Command::Run(args) = Cli::try_parse_from(words).map_err(|error| failed(&error))?.command else {
        return Err(failed(&"a station is started by run"));
    };
    let case = RunCase::of(&station, &args)?;
    let (settings, plan) = prepare(&args, &station, case.as_ref(), &|| false)?;
    admit(&settings, &plan, case.as_ref())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::{draw, file, judge};

    const TEXT: &str =
        "[station]\nset = { realtime = \"off\" }\n[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid\"]\ncount = 2\n";

    /// In a container without the right to real time nothing was ever void, and nobody said so.
    #[test]
    fn without_canaries_a_plan_that_is_through_proves_nothing_and_one_that_is_not_goes_on() {
        let campaign = file::parse("t", TEXT).unwrap();
        assert!(!has_canaries(&campaign, &campaign.arms[0]));
        assert!(warn_of_blind(&campaign).is_some_and(|line| line.contains("count as misses")));
        let plan = draw::plan(&campaign, 1);
        let arm = &campaign.arms[0].name;
        let station = |blind| StationOutcome { faults: vec![0, 1], arm: arm.clone(), blind, ..StationOutcome::default() };
        let noted = |done: usize, exit_code: u8, stations: &[StationOutcome]| {
            let mut judgement = judge::judge(&campaign, &plan, &[], &[], None);
            (judgement.done, judgement.exit_code) = (done, exit_code);
            let before = judgement.unknown.len();
            note_blind(&mut judgement, &campaign, stations);
            (judgement.exit_code, judgement.unknown[before..].to_vec())
        };
        let said = vec!["no canaries in 1 of 2 runs: stalls of the host count as misses".to_string()];
        let mixed = [station(true), station(false)];
        assert_eq!(noted(2, 0, &mixed), (3, said.clone()));
        assert_eq!(noted(1, 0, &mixed), (0, said.clone()), "the same command goes on");
        assert_eq!(noted(2, 1, &mixed), (1, said), "what is broken is");
        assert_eq!(noted(2, 0, &[station(false)]), (0, Vec::new()));
    }
}
