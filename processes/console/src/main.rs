//! The `console` process: the operator's page in a browser, on this machine alone. Ordinary, and it gives way to everybody: whatever a browser does,
//! nothing else waits for it. It reads what engines publish, asks the supervisor for the rest, and changes nothing by itself. See [`session`].

mod ask;
mod desk;
mod door;
mod guard;
mod look;
mod metrics;
mod outcomes;
mod picture;
mod pump;
mod referee;
mod session;
mod sources;
mod web;

use hyst_messages::Role;

fn main() -> std::process::ExitCode {
    hyst_engine::run(Role::Console, session::run)
}
