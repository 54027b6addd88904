//! The simulated hardware: a haptic device with its own clock, its own firmware and a hand that holds it. It lives outside the station's
//! processes, as hardware would, and its ledger of ticks is the ruler by which the station is judged. See [`firmware`].

mod canary;
mod firmware;
mod hand;
mod ledger;

use hyst_messages::Role;

fn main() -> std::process::ExitCode {
    hyst_engine::run(Role::Hardware, firmware::run)
}
