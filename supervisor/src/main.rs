//! `hystation`: reads the command line, does it, gives the exit code: 0 good, 1 failed or a promise broken, 2 bad arguments or input,
//! 3 finished or interrupted, and something was lost or is not known.

use clap::Parser;
use hystation::cli::Cli;
use std::process::ExitCode;

fn main() -> ExitCode {
    // The keepers are started by way of /proc/self/exe, by whose last part people would look for them in vain.
    let _ = rustix::thread::set_name(c"hystation"); // refused, it has that name
    hystation::commands::run(Cli::parse())
}
