//! The `haptic` process: the servo, 1 kHz, one of two replicas.

use hyst_messages::Role;

fn main() -> std::process::ExitCode {
    hyst_engine::run(Role::Haptic, haptic::run)
}
