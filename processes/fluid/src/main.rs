//! The `fluid` process: the Flow Engine. See [`engine`].

mod cavity;
mod crew;
mod engine;

use hyst_messages::Role;

fn main() -> std::process::ExitCode {
    hyst_engine::run(Role::Fluid, |life| hyst_engine::run_stateful(life, engine::FlowEngine::new(life)?))
}
