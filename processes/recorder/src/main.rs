//! The `recorder` process: the session as an MCAP file. Ordinary, never real time. See [`session`].

mod camera;
mod gather;
mod keeper;
mod kept;
mod moments;
mod parts;
mod room;
mod said;
mod scribe;
mod session;
mod statistics;
mod syncer;
mod watch;

use hyst_messages::Role;

fn main() -> std::process::ExitCode {
    hyst_engine::run(Role::Recorder, session::run)
}
