//! Whether the stations of a campaign can be run, before its plan is told and anything is made: the command that starts them is checked as `hystation run`
//! checks it, scene, hand, settings and engines.

use super::cell::State;
use super::file::{Arm, Campaign};
use super::session;
use crate::case::RunCase;
use crate::cli::{Cli, Command};
use crate::commands::check::{Admitted, admit};
use crate::settings::{Refusal, prepare};
use clap::Parser;
use hyst_exchange::Station;

/// Refuses what no station could be started with, and a state that its hand never brings about.
pub(super) fn check(campaign: &Campaign) -> Result<(), Refusal> {
    for arm in &campaign.arms {
        let refuse = |reason: &str| format!("campaign {}: arm {:?}: {reason}", campaign.name, arm.name);
        let admitted = admitted(campaign, arm).map_err(|refusal| Refusal { message: refuse(&refusal.message), ..refusal })?;
        let cutting = campaign.cells.iter().find(|cell| cell.state == State::Cutting && arm.count(cell) > 0);
        if let Some(cell) = cutting.filter(|_| !admitted.may_cut) {
            let reason =
                format!("cell {}: state cutting: the hand {:?} cuts nothing; take script:polyp", cell.name, campaign.hand());
            return Err(Refusal::input(refuse(&reason)));
        }
    }
    Ok(())
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
    let (settings, plan) = prepare(&args, &station, case.as_ref())?;
    admit(&settings, &plan, case.as_ref())
}
