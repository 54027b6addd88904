//! The `tissue` process: the Main Loop and the Site Manager. See [`main_loop`].

mod bench;
mod clerk;
mod collision;
mod contacts;
mod main_loop;
mod site;
mod tool;
mod world;

use hyst_messages::Role;
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    if arguments.next().as_deref() == Some("bench") {
        return bench::run(arguments);
    }
    hyst_engine::run(Role::Tissue, |life| {
        let world = world::World::load(life)?;
        hyst_engine::run_stateful(life, main_loop::MainLoop::new(life, world)?)
    })
}
