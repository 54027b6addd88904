//! The servo, 1 kHz, one of two replicas. See [`run`].

mod accord;
mod drain;
mod servo;

pub use hyst_messages::record::SHADOW_TICKS;
pub use servo::{run, run_telling};
