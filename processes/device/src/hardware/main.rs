//! The `hardware` process: the simulated haptic device. See [`device::hardware`].

use hyst_messages::Role;

fn main() -> std::process::ExitCode {
    hyst_engine::run(Role::Hardware, device::hardware::run)
}
