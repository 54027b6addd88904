//! What every engine does the same way: start, real-time set-up, the paced loop, the loop of an engine with a spare, last words. And what those who
//! keep engines ask of them: what a program says of itself, where the operator's page is.

pub mod address;
pub mod bench;
pub mod helpers;
pub mod journal;
pub mod kept;
pub mod lane;
pub mod life;
pub mod lockstep;
pub mod mischief;
pub mod pace;
pub mod pump;
pub mod realtime;
pub mod room;
pub mod settings;
pub mod silence;
pub mod stateful;
pub mod told;
pub mod verify;

pub use address::Address;
pub use helpers::{Helper, Helpers};
pub use life::{Failure, Life, run};
pub use mischief::{Liar, Lies, Output};
pub use pace::Pace;
pub use pump::said_of_pump;
pub use settings::Settings;
pub use silence::Silence;
pub use stateful::{Stateful, StepContext, run_stateful};
pub use told::Told;

/// Counts allocations on real-time threads; every engine installs it, so that the station itself reports them.
#[global_allocator]
static ALLOCATOR: hyst_exchange::allocation::Counting = hyst_exchange::allocation::Counting;
