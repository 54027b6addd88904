//! The `fluid` process: the Flow Engine. See [`engine`].

mod bench;
mod cavity;
mod crew;
mod engine;

use hyst_messages::Role;
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    if arguments.next().as_deref() == Some("bench") {
        return bench::run(arguments);
    }
    hyst_engine::run(Role::Fluid, |life| hyst_engine::run_stateful(life, engine::FlowEngine::new(life)?))
}
