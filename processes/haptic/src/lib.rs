//! The servo, 1 kHz, one of two replicas. See [`run`].

mod accord;
mod drain;
mod servo;

pub use servo::{SHADOW_TICKS, run, run_telling};
