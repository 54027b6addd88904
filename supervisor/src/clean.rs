//! The clean-up after the dead, in a helper process under a watchdog: what iceoryx2 keeps of a process that was killed is removed by
//! `hystation clean`, at most one at a time. It takes 4 to 30 ms for each of the dead and has been seen to hang, so it is never done
//! by the supervisor itself.

use crate::spawn::start_as_begun;
use hyst_engine::realtime::SUPERVISOR_PRIORITY;
use hyst_exchange::{Links, Station};
use rustix::process::{Signal, WaitOptions, waitpid};
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Stdio;

/// A clean-up that takes longer is killed.
pub const WATCHDOG_NS: u64 = 5_000_000_000;
/// Between a death and the clean-up: the successor comes first, and deaths that come together are cleaned together.
pub const PAUSE_NS: u64 = 300_000_000;
/// Between two looks for segments that the dead have left without a size: a living maker gives one its size at once, and is not taken for a dead one
/// unless it stands for so long.
const UNBORN_NS: u64 = 1_000_000_000;
/// Looks after a death.
const UNBORN_LOOKS: u32 = 4;

/// Its SCHED_FIFO priority: above ordinary processes, below the supervisor and whoever starts.
const PRIORITY: i32 = SUPERVISOR_PRIORITY - 1;

/// At most one clean-up at a time.
#[derive(Debug, Default)]
pub struct Cleaner {
    is_real_time: bool,
    due_ns: Option<u64>,
    running: Option<(u32, u64)>,
    unborn: Unborn,
}

/// Segments that had no size at the last look. Whoever opens one waits for its size, without a bound: a tissue that founded its role anew stood for 28 s.
#[derive(Debug, Default)]
struct Unborn {
    looks: u32,
    due_ns: u64,
    seen: Vec<PathBuf>,
}

impl Unborn {
    fn ask(&mut self, now_ns: u64) {
        (self.looks, self.due_ns) = (UNBORN_LOOKS, self.due_ns.max(now_ns + PAUSE_NS));
    }

    /// Removes those that had no size at the look before either; gives their number.
    fn tend(&mut self, station: &Station, now_ns: u64) -> usize {
        if self.looks == 0 || now_ns < self.due_ns {
            return 0;
        }
        let found = station.unborn_segments();
        let (old, new): (Vec<PathBuf>, Vec<PathBuf>) = found.into_iter().partition(|path| self.seen.contains(path));
        let removed = old.iter().filter(|path| std::fs::remove_file(path).is_ok()).count();
        self.due_ns = now_ns + UNBORN_NS;
        self.looks = if new.is_empty() { self.looks - 1 } else { UNBORN_LOOKS };
        self.seen = new;
        removed
    }
}

impl Cleaner {
    /// One that has nobody to clean up after yet.
    pub fn new(is_real_time: bool) -> Cleaner {
        Cleaner { is_real_time, ..Cleaner::default() }
    }

    /// Somebody died.
    pub fn ask(&mut self, now_ns: u64) {
        self.due_ns = Some(now_ns + PAUSE_NS);
        self.unborn.ask(now_ns);
    }

    /// Starts, ends or kills the helper, as is due; never waits.
    pub fn tend(&mut self, station: &Station, now_ns: u64) {
        let removed = self.unborn.tend(station, now_ns);
        if removed > 0 {
            crate::journal::say(station, &format!("{removed} segments that the dead had left without a size were removed"));
        }
        if let Some((pid, since_ns)) = self.running {
            if is_over(pid) {
                self.running = None;
            } else if now_ns.saturating_sub(since_ns) > WATCHDOG_NS {
                crate::proc::signal(pid, Signal::KILL);
                crate::journal::say(
                    station,
                    "the clean-up after the dead hung and was killed; it is tried again after the next death",
                );
                self.running = Some((pid, now_ns));
            }
            return;
        }
        if self.due_ns.is_some_and(|due_ns| due_ns <= now_ns) {
            self.due_ns = None;
            self.running = start(station, self.is_real_time).map(|pid| (pid, now_ns));
        }
    }
}

fn start(station: &Station, is_real_time: bool) -> Option<u32> {
    let mut command = crate::proc::own_program();
    command.args(["clean", "--station", station.name()]).process_group(0);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    // Not behind ordinary ones: what it does not clean up fills the lists that newborns connect by.
    start_as_begun(station, &mut command, is_real_time.then_some(PRIORITY)).ok().map(|child| child.id())
}

/// Whether the helper has ended, which this look reaps. It is a child of this process, so that nobody else has its id before; and no file is opened for it, or
/// one that runs would be forgotten where none can be.
fn is_over(pid: u32) -> bool {
    crate::proc::pid(pid).is_none_or(|pid| !matches!(waitpid(Some(pid), WaitOptions::NOHANG), Ok(None)))
}

/// The helper itself.
pub fn clean(station: &Station) -> Result<(), hyst_exchange::LinkError> {
    let links = Links::join(station, "clean")?;
    links.clean_up_dead();
    drop(links);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[expect(clippy::zombie_processes, reason = "the look that finds it over reaps it")]
    fn a_helper_is_over_when_it_has_ended_and_is_reaped_by_the_look_that_finds_it() {
        let mut helper = std::process::Command::new("cat").stdin(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
        let pid = helper.id();
        assert!(!is_over(pid), "it reads on");
        drop(helper.stdin.take());
        let deadline_ns = hyst_exchange::system::now_ns() + 20_000_000_000;
        while !is_over(pid) {
            assert!(hyst_exchange::system::now_ns() < deadline_ns, "it does not end");
            std::thread::yield_now();
        }
        let status = waitpid(crate::proc::pid(pid), WaitOptions::NOHANG);
        assert!(status.is_err() && is_over(pid), "it was not reaped");
    }

    #[test]
    fn a_segment_without_a_size_is_removed_at_the_second_look_and_no_other() {
        let station = Station::named(&format!("t{}-unborn", std::process::id())).unwrap();
        let path = |name: &str| PathBuf::from(format!("/dev/shm/{}{name}.connection", station.prefix()));
        let [dead, slow, whole, late] = ["dead", "slow", "whole", "late"].map(path);
        for (path, content) in [(&dead, ""), (&slow, ""), (&whole, "something")] {
            std::fs::write(path, content).unwrap();
        }
        let mut unborn = Unborn::default();
        assert_eq!(unborn.tend(&station, 0), 0, "nobody has died");
        unborn.ask(0);
        assert_eq!(unborn.tend(&station, PAUSE_NS - 1), 0);
        assert_eq!(unborn.tend(&station, PAUSE_NS), 0, "one look is not enough");
        std::fs::write(&slow, "now").unwrap();
        std::fs::write(&late, "").unwrap();
        assert_eq!(unborn.tend(&station, PAUSE_NS + UNBORN_NS - 1), 0);
        assert_eq!(unborn.tend(&station, PAUSE_NS + UNBORN_NS), 1);
        assert_eq!([&dead, &slow, &whole, &late].map(|path| path.exists()), [false, true, true, true]);
        let mut now_ns = PAUSE_NS + UNBORN_NS;
        let looks: Vec<usize> = (0..=UNBORN_LOOKS)
            .map(|_| {
                now_ns += UNBORN_NS;
                unborn.tend(&station, now_ns)
            })
            .collect();
        assert_eq!(looks.iter().sum::<usize>(), 1, "the one that came late, and nothing twice: {looks:?}");
        assert_eq!(unborn.looks, 0, "it goes on looking although nobody has died");
        station.wipe();
    }
}
