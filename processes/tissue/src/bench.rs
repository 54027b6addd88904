//! `tissue bench tissue|contact [--mesh FILE] [--json]`: times the parts of a Main Loop step on one core, outside of any station.

use std::process::ExitCode;

/// Runs the benchmark that the arguments name.
pub fn run(arguments: impl Iterator<Item = String>) -> ExitCode {
    let _ = arguments.count();
    ExitCode::from(2)
}
