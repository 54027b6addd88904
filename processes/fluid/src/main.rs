//! The `fluid` process: the Flow Engine, or its benchmark.

use hyst_messages::Role;
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    if arguments.next().as_deref() == Some("bench") {
        return fluid::bench(arguments);
    }
    hyst_engine::run(Role::Fluid, fluid::run)
}
