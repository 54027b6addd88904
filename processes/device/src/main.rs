//! The `device` process: the last hop to the hand, 1 kHz. See [`hop`].

mod hop;
mod models;
mod replicas;

use hyst_messages::Role;

fn main() -> std::process::ExitCode {
    hyst_engine::run(Role::Device, hop::run)
}
