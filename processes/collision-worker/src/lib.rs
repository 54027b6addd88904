//! One share of the intersection test each tick, a member of the Meeting Point. See [`run`].

mod worker;

pub use worker::{run, run_telling};
