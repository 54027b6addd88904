//! `hystation fault`: faults on purpose, in a station in test mode.

use crate::cli::{FaultCommand, InjectArgs};
use crate::control::{self, Request};
use crate::faultfile::{Aim, FaultKind, Injection, Place};
use crate::plan::Plan;
use crate::settings::Refusal;
use crate::{keepers, shortage};
use hyst_exchange::Station;

/// Lists the kinds, injects one, or many by a campaign.
pub fn fault(station: &Station, command: FaultCommand) -> Result<u8, Refusal> {
    match command {
        FaultCommand::List => {
            for (_, name, text) in FaultKind::ALL {
                println!("{name:<11} {text}");
            }
            Ok(0)
        }
        FaultCommand::Campaign(args) => crate::campaign::run(station.name(), &args),
        FaultCommand::Inject(args) => inject(station, &args),
    }
}

fn inject(station: &Station, args: &InjectArgs) -> Result<u8, Refusal> {
    let injection = injection(args)?;
    let aim = injection.check().map_err(Refusal::input)?;
    if !station.root().is_dir() {
        return Err(super::no_station(station));
    }
    if let Ok(plan) = Plan::read(station) {
        injection.check_in(&plan.slots()).map_err(Refusal::input)?;
    }
    shortage::check(station, injection.kind).map_err(Refusal::input)?;
    match aim {
        Aim::Keepers(keepers) => keepers::inject(station, keepers, &injection),
        Aim::Engines(_) => control::ask(station, &Request::Fault(injection)).map(drop),
    }
    .map_err(Refusal::failed)?;
    Ok(0)
}

/// What the arguments say.
fn injection(args: &InjectArgs) -> Result<Injection, Refusal> {
    let InjectArgs { for_s, factor, extra_s, jitter, rate, times, bytes, seed, .. } = *args;
    let kind = FaultKind::from_name(&args.kind)
        .ok_or_else(|| Refusal::input(format!("{:?} is no kind of fault; see `hystation fault list`", args.kind)))?;
    let place = args.place.as_deref().map(|name| {
        let places: Vec<&str> = Place::ALL.iter().map(|(_, name)| *name).collect();
        Place::from_name(name).ok_or_else(|| Refusal::input(format!("--where {name}: there are {}", places.join(", "))))
    });
    let place = place.transpose()?;
    Ok(Injection { for_s, factor, extra_s, jitter, rate, times, place, bytes, seed, ..Injection::now(kind, &args.target) })
}
