//! One file for each command; this one chooses among them.

pub mod bench;
pub mod check;
pub mod conformance;
pub mod doctor;
pub mod fault;
mod given;
pub mod logs;
pub mod replay;
pub mod report;
pub mod status;
pub mod stop;
pub mod swap;
mod watched;

use crate::cli::{Cli, Command};
use crate::settings::Refusal;
use hyst_exchange::Station;
use hyst_messages::Role;
use std::process::ExitCode;

/// Does what the command line says.
pub fn run(cli: Cli) -> ExitCode {
    match choose(cli) {
        Ok(code) => ExitCode::from(code),
        Err(refusal) => {
            eprintln!("hystation: {}", refusal.message);
            ExitCode::from(refusal.code)
        }
    }
}

fn choose(cli: Cli) -> Result<u8, Refusal> {
    let station = Station::named(&cli.name).map_err(|e| Refusal::input(e.to_string()))?;
    match cli.command {
        Command::Run(mut args) => {
            args.scene = crate::shipped::file(args.scene.take())?;
            if args.with_parent {
                let bound = rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::INT));
                bound.map_err(|e| Refusal::failed(format!("--with-parent: {e}")))?;
            }
            crate::guardian::run(&cli.name, &args)
        }
        Command::Status { json } => status::status(&station, json),
        Command::Top => status::top(&station),
        Command::Logs { process, follow } => logs::logs(&station, process.as_deref(), follow),
        Command::Stop => stop::stop(&station),
        Command::Fault { command } => fault::fault(&station, command),
        Command::Check { file, json } => check::check(crate::shipped::file(file)?.as_deref(), json),
        Command::Doctor { json } => doctor::doctor(json),
        Command::Bench { what, mesh, windows, json } => bench::bench(&what, mesh.as_deref(), windows, json),
        Command::Swap { role, binary, json } => swap::swap(&station, &role, &binary, json),
        Command::Conformance { role, binary, scene, hand, json } => {
            let place = conformance::Place { scene: scene.as_deref(), hand: &hand };
            conformance::conformance(&role, &binary, place, json)
        }
        Command::Report(args) => report::report(&args),
        Command::Replay(args) => replay::replay(&station, &args),
        Command::Supervise { station } => {
            let station = Station::named(&station).map_err(|e| Refusal::input(e.to_string()))?;
            crate::supervise::supervise(&station).map_err(|e| Refusal::failed(e.to_string()))
        }
        Command::StandIn { station } => {
            crate::guardian::stand_in(Station::named(&station).map_err(|e| Refusal::input(e.to_string()))?)
        }
        Command::Judge { station, role, guest, draws } => {
            let station = Station::named(&station).map_err(|e| Refusal::input(e.to_string()))?;
            let role = crate::swap::role_of(&role).map_err(Refusal::input)?;
            let judged = match role {
                Role::Console => crate::swap::visit(&station),
                Role::Device => crate::swap::feel(&station),
                Role::Recorder | Role::Rendering => crate::swap::inspect(&station, role, guest, draws),
                _ => crate::swap::judge::judge(&station, role, guest),
            };
            judged.map(|()| 0).map_err(Refusal::failed)
        }
        Command::Clean { station } => {
            let station = Station::named(&station).map_err(|e| Refusal::input(e.to_string()))?;
            crate::clean::clean(&station).map(|()| 0).map_err(|e| Refusal::failed(e.to_string()))
        }
    }
}

/// The error of a command that needs a running station.
pub fn no_station(station: &Station) -> Refusal {
    Refusal::input(format!("no station named {0:?} is running; start it with `hystation --name {0} run`", station.name()))
}
