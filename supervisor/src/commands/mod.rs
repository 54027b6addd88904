//! One file for each command; this one chooses among them.

pub mod bench;
pub mod check;
pub mod conformance;
pub mod doctor;
pub mod fault;
mod given;
mod large;
pub mod logs;
mod others;
pub mod replay;
pub mod report;
mod shielded;
pub mod status;
pub mod stop;
pub mod swap;
mod watched;

use crate::cli::{Cli, Command};
use crate::settings::Refusal;
use hyst_exchange::Station;
use hyst_messages::Role;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

/// Exit code of a command that was interrupted.
const INTERRUPTED: u8 = 3;

/// Does what the command line says.
pub fn run(cli: Cli) -> ExitCode {
    let is_json = cli.command.is_json();
    match choose(cli) {
        Ok(code) => ExitCode::from(code),
        Err(refusal) => {
            if is_json {
                let _ = writeln!(std::io::stdout(), "{:#}", not_done(&refusal)); // nobody reads it any more
            }
            crate::warn(&refusal.message);
            ExitCode::from(refusal.code)
        }
    }
}

/// What a script that wanted JSON is told of a command that was not done, or failed: what `check` says of a scene that cannot be, and the exit code.
fn not_done(refusal: &Refusal) -> serde_json::Value {
    serde_json::json!({ "error": refusal.message, "exit_code": refusal.code })
}

fn choose(cli: Cli) -> Result<u8, Refusal> {
    let station = Station::named(&cli.name).map_err(|e| Refusal::input(e.to_string()))?;
    match cli.command {
        Command::Run(mut args) => {
            args.with_parent.map_or(Ok(()), end_with_parent)?;
            args.scene = crate::shipped::file(args.scene.take())?;
            with_folder(args.passing.as_deref(), || crate::guardian::run(&cli.name, &args))
        }
        Command::Status { json } => status::status(&station, json),
        Command::Top => status::top(&station),
        Command::Logs { process, follow } => logs::logs(&station, process.as_deref(), follow),
        Command::Stop => stop::stop(&station),
        Command::Fault { command } => fault::fault(&station, command),
        Command::Check { file, set, json } => check::check(&station, crate::shipped::file(file)?.as_deref(), &set, json),
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
        Command::Witness { station } => {
            let station = Station::named(&station).map_err(|e| Refusal::input(e.to_string()))?;
            crate::swap::witness(&station).map(|()| 0).map_err(Refusal::failed)
        }
        Command::Clean { station } => {
            let station = Station::named(&station).map_err(|e| Refusal::input(e.to_string()))?;
            crate::clean::clean(&station).map(|()| 0).map_err(|e| Refusal::failed(e.to_string()))
        }
    }
}

/// Has the system ask this process to end once its parent has, and refuses if that is so already.
fn end_with_parent(parent: u32) -> Result<(), Refusal> {
    let bound = rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::INT));
    bound.map_err(|e| Refusal::failed(format!("--with-parent: {e}")))?;
    // Only now: the system tells of a parent that ends later, and of one that had ended before it was asked it never does.
    let present = std::os::unix::process::parent_id();
    if present == parent {
        return Ok(());
    }
    let found = format!("the parent of this process is {present}; that one has ended, or never was it");
    Err(Refusal::input(format!("--with-parent={parent}: {found}, and nothing was started")))
}

/// Runs a station that has a folder as long as it runs: whoever asked for one may have gone by its end.
fn with_folder(folder: Option<&Path>, run: impl FnOnce() -> Result<u8, Refusal>) -> Result<u8, Refusal> {
    let Some(folder) = folder else { return run() };
    std::fs::create_dir_all(folder).map_err(|e| Refusal::failed(format!("--passing {}: {e}", folder.display())))?;
    let code = run();
    let _ = std::fs::remove_dir_all(folder); // it is in the system's folder for such things
    code
}

/// The error of a command that needs a running station.
pub fn no_station(station: &Station) -> Refusal {
    let none = format!("no station named {0:?} is running; start it with `hystation --name {0} run`", station.name());
    let others: Vec<String> = others::others(station).iter().map(|begin| format!("`{begin} …`")).collect();
    Refusal::input(if others.is_empty() { none } else { format!("{none}; or name one that runs: {}", others.join(", ")) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_of_a_station_is_there_while_it_runs_and_goes_with_it_however_it_ends() {
        let folder = std::env::temp_dir().join(format!("hystation-passing-{}", std::process::id()));
        for ends in [Ok(0), Err(2)] {
            let run = || {
                std::fs::write(folder.join("session.mcap"), "ticks").unwrap();
                ends.map_err(|code| Refusal { code, message: "refused".into() })
            };
            assert_eq!(with_folder(Some(&folder), run).map_err(|refusal| refusal.code), ends);
            assert!(!folder.exists());
        }
        assert_eq!(with_folder(None, || Ok(3)).ok(), Some(3));
    }
}
