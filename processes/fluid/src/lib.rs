//! The Flow Engine: Navier–Stokes over the cavity, pump and blood, with a spare that follows. See [`run`].

mod afford;
mod bench;
mod cavity;
mod coarse;
mod crew;
mod engine;
mod gas;
mod heard;
mod holes;
mod lens;
mod pieces;
mod raster;
mod removed;
mod seals;
mod status;
mod tools;
mod wounds;

pub use afford::{has_possible_step, moved_s};
pub use bench::run as bench;
pub use coarse::cells_of;
pub use crew::broken;
pub use engine::{load_scene, model_of};
pub use status::{Head, status_of};
pub use tools::Instrument;

use hyst_engine::{Failure, Life, Stateful};

// The scene, the records and the solver, which know nothing of each other, count pressures in one unit.
const _: () =
    assert!(hyst_flow::PA_PER_MMHG == hyst_messages::PA_PER_MMHG && hyst_scene::PA_PER_MMHG == hyst_messages::PA_PER_MMHG);

/// The Flow Engine, for who puts something around it.
pub fn engine(life: &Life) -> Result<impl Stateful + '_, Failure> {
    engine::FlowEngine::new(life)
}

/// The whole life of a Flow Engine.
pub fn run(life: &Life) -> Result<(), Failure> {
    hyst_engine::run_stateful(life, engine(life)?)
}
