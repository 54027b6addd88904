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
        self.due_ns = if self.looks == 0 { now_ns + PAUSE_NS } else { self.due_ns };
        self.looks = UNBORN_LOOKS;
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

    /// Somebody died, or there is no room. Who asks again puts nothing off.
    pub fn ask(&mut self, now_ns: u64) {
        self.due_ns.get_or_insert(now_ns + PAUSE_NS);
        self.unborn.ask(now_ns);
    }

    /// Starts, ends or kills the helper, as is due; never waits.
    pub fn tend(&mut self, station: &Station, now_ns: u64) {
        let removed = self.unborn.tend(station, now_ns);
        if removed > 0 {
            crate::journal::say(station, &format!("{removed} segments that the dead had left without a size were removed"));
        }
        if let Some((pid, since_ns)) = self.running {
            if let Some(is_done) = is_over(pid) {
                self.running = None;
                if !is_done {
                    self.ask(now_ns); // as where there was no room for a node of its own
                }
            } else if now_ns.saturating_sub(since_ns) > WATCHDOG_NS {
                crate::proc::signal(pid, Signal::KILL);
                crate::journal::say(station, "the clean-up after the dead hung and was killed; it is tried again");
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

/// Whether the helper has ended, which this look reaps, and if so, whether it did what it was to. It is a child of this process, so that nobody else has its id
/// before; and no file is opened for it, or one that runs would be forgotten where none can be.
fn is_over(pid: u32) -> Option<bool> {
    let Some(pid) = crate::proc::pid(pid) else { return Some(true) };
    match waitpid(Some(pid), WaitOptions::NOHANG) {
        Ok(None) => None,
        Ok(Some((_, status))) => Some(status.exit_status() == Some(0)),
        Err(_) => Some(true), // somebody else has reaped it
    }
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
        assert_eq!(is_over(pid), None, "it reads on");
        drop(helper.stdin.take());
        let deadline_ns = hyst_exchange::system::now_ns() + 20_000_000_000;
        while is_over(pid).is_none() {
            assert!(hyst_exchange::system::now_ns() < deadline_ns, "it does not end");
            std::thread::yield_now();
        }
        let status = waitpid(crate::proc::pid(pid), WaitOptions::NOHANG);
        assert!(status.is_err() && is_over(pid) == Some(true), "it was not reaped");
    }

    /// A clean-up that found no room for a node of its own was tried again after the next death alone, and nobody could be started until then.
    #[test]
    #[expect(clippy::zombie_processes, reason = "the look that finds it over reaps it")]
    fn one_that_failed_is_done_again_and_who_asks_meanwhile_puts_nothing_off() {
        let station = Station::named(&format!("t{}-uncleaned", std::process::id())).unwrap();
        let after = |program: &str| {
            let helper = std::process::Command::new(program).spawn().unwrap();
            let mut cleaner = Cleaner { running: Some((helper.id(), 0)), ..Cleaner::default() };
            let deadline_ns = hyst_exchange::system::now_ns() + 20_000_000_000;
            while cleaner.running.is_some() {
                assert!(hyst_exchange::system::now_ns() < deadline_ns, "it does not end");
                cleaner.tend(&station, 7);
            }
            cleaner.due_ns
        };
        assert_eq!(["true", "false"].map(after), [None, Some(7 + PAUSE_NS)]);
        let mut cleaner = Cleaner::default();
        [0, PAUSE_NS / 2, PAUSE_NS - 1].into_iter().for_each(|now_ns| cleaner.ask(now_ns));
        assert_eq!((cleaner.due_ns, cleaner.unborn.due_ns), (Some(PAUSE_NS), PAUSE_NS));
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
