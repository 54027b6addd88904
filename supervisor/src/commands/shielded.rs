//! Ctrl-C and the like in a command that asks a file what it is. Who is asked leads a process group of its own, which no signal of a terminal reaches, and
//! would stay behind a command that just ends.

use super::INTERRUPTED;
use crate::interrupt::SIGNALS;
use crate::settings::Refusal;
use signal_hook::flag;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Does what is to be given up once the flag is set, which a signal does meanwhile; one that comes later ends this program as ever.
pub fn shielded<T>(work: impl FnOnce(&AtomicBool) -> T) -> Result<T, Refusal> {
    let (interrupted, is_over) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
    for signal in SIGNALS {
        let ends = flag::register_conditional_default(signal, Arc::clone(&is_over));
        let told = ends.and_then(|_| flag::register(signal, Arc::clone(&interrupted)));
        told.map_err(|e| Refusal::failed(format!("signals: {e}")))?;
    }
    let done = work(&interrupted);
    // In this order: a signal is either seen here, or ends this program.
    is_over.store(true, Ordering::SeqCst);
    if interrupted.load(Ordering::SeqCst) {
        return Err(Refusal { code: INTERRUPTED, message: "interrupted, and nothing was found".into() });
    }
    Ok(done)
}

#[cfg(test)]
mod tests {
    use super::*;
    use signal_hook::consts::{SIGINT, SIGTERM};
    use std::os::unix::process::ExitStatusExt;
    use std::process::{Command, Stdio};

    /// Runs as a program of its own below: it is interrupted while it is shielded, and once more afterwards.
    #[test]
    fn an_interrupted_command() {
        if std::env::var_os("HYSTATION_TEST_INTERRUPTED").is_none() {
            return;
        }
        let shielded = shielded(|interrupted| {
            signal_hook::low_level::raise(SIGINT).unwrap();
            assert!(interrupted.load(Ordering::SeqCst), "it goes on, and is told");
        });
        assert_eq!(shielded.unwrap_err().code, INTERRUPTED);
        signal_hook::low_level::raise(SIGTERM).unwrap();
        panic!("it goes on after a signal that nobody waits for");
    }

    #[test]
    fn a_signal_in_it_is_told_and_one_after_it_ends_the_program() {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "commands::shielded::tests::an_interrupted_command"]).env("HYSTATION_TEST_INTERRUPTED", "1");
        let ended = command.stdout(Stdio::null()).stderr(Stdio::null()).status().unwrap();
        assert_eq!(ended.signal(), Some(SIGTERM), "{ended}");
    }

    #[test]
    fn what_is_not_interrupted_gives_what_it_found() {
        assert_eq!(shielded(|interrupted| interrupted.load(Ordering::SeqCst)), Ok(false));
    }
}
