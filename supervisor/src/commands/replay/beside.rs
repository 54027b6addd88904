//! The run of a replay, and what goes on beside it in threads of their own, which end with it.

use super::look::look_ahead;
use super::pace;
use crate::cli::{ReplayArgs, RunArgs};
use crate::settings::Refusal;
use hyst_engine::settings::Replay;
use hyst_exchange::Station;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{Builder, Scope, ScopedJoinHandle};

/// What ended the run, and what of the recording was found to be missing meanwhile, with the last tick before it.
pub type Ended = (Result<u8, Refusal>, Option<(String, u64)>);

/// Runs the station. Beside it what of the recording has not been seen yet is looked at, and how fast it is shown.
pub fn run_and_look(
    station: &Station,
    args: &ReplayArgs,
    run: &RunArgs,
    replay: Replay,
    is_seen: bool,
) -> Result<Ended, Refusal> {
    let is_over = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let over = Over(&is_over);
        let look = || look_ahead(station, &args.file, replay.begin_tick, &is_over);
        let ahead = if is_seen { None } else { Some(begin(scope, "ahead", look)?) };
        let watch = || pace::watch(station, replay, &is_over);
        let pace = if replay.speed > 0.0 { Some(begin(scope, "pace", watch)?) } else { None };
        let ended = crate::guardian::run(station.name(), run);
        drop(over);
        if let Some(words) = pace.and_then(joined) {
            eprintln!("hystation: {words}");
        }
        Ok((ended, ahead.and_then(joined)))
    })
}

/// A thread beside the run.
fn begin<'scope, T: Send + 'scope>(
    scope: &'scope Scope<'scope, '_>,
    name: &str,
    work: impl FnOnce() -> T + Send + 'scope,
) -> Result<ScopedJoinHandle<'scope, T>, Refusal> {
    let thread = Builder::new().name(name.into()).spawn_scoped(scope, work);
    thread.map_err(|error| Refusal::failed(format!("a thread: {error}; look at the limit of processes")))
}

/// What came of it; its panic is the caller's.
fn joined<T>(thread: ScopedJoinHandle<'_, T>) -> T {
    thread.join().unwrap_or_else(|cause| std::panic::resume_unwind(cause))
}

/// Says that the run is over, however it ended, to whom the scope would wait for.
struct Over<'a>(&'a AtomicBool);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}
