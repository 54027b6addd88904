//! The `device` process: the last hop to the hand, 1 kHz.

use hyst_messages::Role;

fn main() -> std::process::ExitCode {
    hyst_engine::run(Role::Device, device::run)
}
