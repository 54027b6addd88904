//! The last hop to the hand, 1 kHz (see [`run`]), and the simulated hardware that it drives (see [`hardware`]).

mod again;
pub mod hardware;
mod hop;
mod models;
mod plugged;
mod replicas;

pub use hop::{run, run_giving, run_ordering};
