//! Ctrl-C, and the signals that mean the same, in commands that have something to end before they go.

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// A key, somebody who ends the command, and a terminal that goes.
pub const SIGNALS: [i32; 3] = [SIGINT, SIGTERM, SIGHUP];

/// A flag that each of them sets from now on, in place of ending this process. An error is what the system said.
pub fn noticed() -> Result<Arc<AtomicBool>, String> {
    let interrupted = Arc::new(AtomicBool::new(false));
    for signal in SIGNALS {
        flag::register(signal, Arc::clone(&interrupted)).map_err(|error| format!("signals: {error}"))?;
    }
    Ok(interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;
    use std::sync::atomic::Ordering;

    /// Runs as a program of its own below: what is raised here is for the whole process.
    #[test]
    fn a_command_that_has_something_to_end() {
        if std::env::var_os("HYSTATION_TEST_NOTICED").is_none() {
            return;
        }
        let interrupted = noticed().unwrap();
        for signal in SIGNALS {
            interrupted.store(false, Ordering::SeqCst);
            signal_hook::low_level::raise(signal).unwrap();
            assert!(interrupted.load(Ordering::SeqCst), "{signal}");
        }
    }

    #[test]
    fn each_of_them_is_noticed_and_ends_nothing() {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "interrupt::tests::a_command_that_has_something_to_end"]).env("HYSTATION_TEST_NOTICED", "1");
        let ended = command.output().unwrap();
        let told = String::from_utf8_lossy(&ended.stdout);
        assert!(ended.status.success() && told.contains("1 passed"), "{}: {told}", ended.status);
    }
}
