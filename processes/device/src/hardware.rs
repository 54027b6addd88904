//! The simulated hardware: a haptic device with its own clock, its own firmware and a hand that holds it. It lives outside the station's
//! processes, as hardware would, and its ledger of ticks is the ruler by which the station is judged.

mod awaited;
mod canary;
mod commands;
mod finger;
mod firmware;
mod hand;
mod ledger;
mod pad;
mod pump;
mod score;
mod sequencer;

pub use firmware::run;
