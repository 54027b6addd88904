//! `hystation fault`: faults on purpose, in a station in test mode.

use super::not_here;
use crate::cli::FaultCommand;
use crate::control::{self, Request};
use crate::faultfile::{FaultKind, Injection};
use crate::settings::Refusal;
use hyst_exchange::Station;

/// Lists the kinds, or injects one.
pub fn fault(station: &Station, command: FaultCommand) -> Result<u8, Refusal> {
    match command {
        FaultCommand::List => {
            for (_, name, text) in FaultKind::ALL {
                println!("{name:<10} {text}");
            }
            Ok(0)
        }
        FaultCommand::Campaign(_) => not_here("fault campaign"),
        FaultCommand::Inject { kind, target, for_s } => {
            let kind = FaultKind::from_name(&kind)
                .ok_or_else(|| Refusal::input(format!("{kind:?} is no kind of fault; see `hystation fault list`")))?;
            let injection = Injection { kind, target, tick: 0, for_s };
            injection.check().map_err(Refusal::input)?;
            if !station.root().is_dir() {
                return Err(super::no_station(station));
            }
            control::ask(station, &Request::Fault(injection)).map_err(|reason| Refusal { code: 1, message: reason })?;
            Ok(0)
        }
    }
}
