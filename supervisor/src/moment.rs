//! A fault comes at a moment, to some microseconds: so that a fault of a campaign can be repeated at the same phase of the same tick.

use hyst_exchange::system;
use hyst_messages::TICK_NS;

/// Last place in a tick at which a fault may come, µs; the first is 0.
pub const MOST_PHASE_US: u32 = (TICK_NS / 1_000) as u32 - 1;
/// A moment may lie this far ahead, ns: who asks for one waits itself until then, since its taker does nothing else meanwhile.
pub const MOST_AHEAD_NS: u64 = 60_000_000;
/// Above everything but the supervisor's watch: the thread sleeps, then makes one system call.
const PRIORITY: i32 = 88;

/// Does something at a moment (CLOCK_MONOTONIC, ns), or at once if that has passed; gives the time just before it was done. A moment too
/// far ahead is refused with what to do.
pub fn at<T: Send>(moment_ns: u64, act: impl FnOnce() -> T + Send) -> Result<(u64, T), String> {
    let ahead_ns = moment_ns.saturating_sub(system::now_ns());
    if ahead_ns > MOST_AHEAD_NS {
        let (ahead_ms, most_ms) = (ahead_ns / 1_000_000, MOST_AHEAD_NS / 1_000_000);
        return Err(format!("its tick is {ahead_ms} ms ahead; ask again at most {most_ms} ms before it"));
    }
    if ahead_ns == 0 {
        return Ok((system::now_ns(), act()));
    }
    let wait = || {
        let _ = system::become_fifo(PRIORITY); // refused without rights: then the moment is met less exactly
        system::sleep_until_ns(moment_ns);
        (system::now_ns(), act())
    };
    // The class of a thread cannot be taken back here, so the wait has a thread of its own.
    std::thread::scope(|scope| {
        let waits = std::thread::Builder::new().name("moment".into()).spawn_scoped(scope, wait);
        let waits = waits.map_err(|error| format!("a thread to wait for its tick: {error}; look at the limit of processes"))?;
        waits.join().map_err(|_| "the thread that waited for its tick died".to_string())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_is_not_met_too_early_and_not_waited_for_too_long() {
        let moment_ns = system::now_ns() + MOST_AHEAD_NS / 20;
        let (at_ns, seven) = at(moment_ns, || 7).unwrap();
        assert!(at_ns >= moment_ns && seven == 7);
        assert_eq!(at(0, || 8).map(|(_, eight)| eight), Ok(8));
        assert!(at(system::now_ns() + 1_000 * MOST_AHEAD_NS, || ()).unwrap_err().contains("ask again"));
    }
}
