//! The Main Loop and the Site Manager, with a spare that follows. See [`run`].

mod afford;
mod answers;
mod asking;
mod bench;
mod body;
mod check;
mod clerk;
mod closing;
mod collision;
mod contacts;
mod drift;
mod grasp;
mod knife;
mod main_loop;
mod materials;
mod metal;
mod outlet;
mod points;
#[cfg(test)]
mod served;
mod site;
mod state;
mod through;
mod tool;
mod volumes;
mod world;

pub use bench::run as bench;
pub use check::run as check;

use hyst_engine::{Failure, Life, Stateful};

/// The Main Loop, for who puts something around it.
pub fn engine(life: &Life) -> Result<impl Stateful + '_, Failure> {
    let (workshop, world) = world::Workshop::load(life)?;
    main_loop::MainLoop::new(life, workshop, world)
}

/// The scene of the tests of jaws.
#[cfg(test)]
fn grasper_scene() -> std::path::PathBuf {
    std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes/grasper.toml")
}

/// The whole life of a Main Loop.
pub fn run(life: &Life) -> Result<(), Failure> {
    hyst_engine::run_stateful(life, engine(life)?)
}
