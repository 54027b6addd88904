//! The Main Loop and the Site Manager, with a spare that follows. See [`run`].

mod afford;
mod bench;
mod check;
mod clerk;
mod collision;
mod contacts;
mod main_loop;
mod site;
mod tool;
mod world;

pub use bench::run as bench;
pub use check::run as check;

use hyst_engine::{Failure, Life, Stateful};

/// The Main Loop, for who puts something around it.
pub fn engine(life: &Life) -> Result<impl Stateful + '_, Failure> {
    let world = world::World::load(life)?;
    main_loop::MainLoop::new(life, world)
}

/// The whole life of a Main Loop.
pub fn run(life: &Life) -> Result<(), Failure> {
    hyst_engine::run_stateful(life, engine(life)?)
}
