//! The `tissue` process: the Main Loop and the Site Manager, their benchmark, or their opinion on a scene.

use hyst_messages::Role;
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    match arguments.next().as_deref() {
        Some("bench") => tissue::bench(arguments),
        Some("check") => tissue::check(arguments),
        _ => hyst_engine::run(Role::Tissue, tissue::run),
    }
}
