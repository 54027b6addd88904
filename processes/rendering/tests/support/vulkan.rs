//! What tests that draw have in common, in the library, in the engine and beside them.

use std::fmt::Display;

/// What needs Vulkan. `None` where the machine is declared to have none, by HYSTATION_NO_GPU=1: else a test fails without it.
pub fn unless_declared_absent<T>(found: Result<T, impl Display>) -> Option<T> {
    match found {
        Ok(found) => Some(found),
        Err(error) if std::env::var("HYSTATION_NO_GPU").is_ok_and(|value| value == "1") => {
            eprintln!("not tested, HYSTATION_NO_GPU=1: {error}");
            None
        }
        Err(error) => panic!("{error} (or set HYSTATION_NO_GPU=1 where there is none)"),
    }
}
