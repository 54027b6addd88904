//! The clean-up after the dead, in a helper process under a watchdog: what iceoryx2 keeps of a process that was killed is removed by
//! `hystation clean`, at most one at a time. It takes 4 to 30 ms for each of the dead and has been seen to hang, so it is never done
//! by the supervisor itself.

use hyst_exchange::{Links, Station};
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::process::{PidfdFlags, Signal};
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};

/// A clean-up that takes longer is killed.
pub const WATCHDOG_NS: u64 = 5_000_000_000;
/// Between a death and the clean-up: the successor comes first, and deaths that come together are cleaned together.
pub const PAUSE_NS: u64 = 300_000_000;

/// At most one clean-up at a time.
#[derive(Debug, Default)]
pub struct Cleaner {
    due_ns: Option<u64>,
    running: Option<(u32, u64)>,
}

impl Cleaner {
    /// Somebody died.
    pub fn ask(&mut self, now_ns: u64) {
        self.due_ns = Some(now_ns + PAUSE_NS);
    }

    /// Starts, ends or kills the helper, as is due; never waits.
    pub fn tend(&mut self, station: &Station, now_ns: u64) {
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
            self.running = start(station).map(|pid| (pid, now_ns));
        }
    }
}

fn start(station: &Station) -> Option<u32> {
    let program = std::env::current_exe().ok()?;
    let mut command = Command::new(program);
    command.args(["clean", "--station", station.name()]).process_group(0);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    crate::proc::start(&mut command, false).ok().map(|child| child.id())
}

fn is_over(pid: u32) -> bool {
    let Some(process) = crate::proc::pid(pid) else {
        return true;
    };
    let Ok(fd) = rustix::process::pidfd_open(process, PidfdFlags::empty()) else {
        return true;
    };
    let mut polled = [PollFd::new(&fd, PollFlags::IN)];
    let over = rustix::event::poll(&mut polled, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })).is_ok_and(|ready| ready > 0);
    if over {
        crate::spawn::reap(pid);
    }
    over
}

/// The helper itself.
pub fn clean(station: &Station) -> Result<(), hyst_exchange::LinkError> {
    let links = Links::join(station, "clean")?;
    links.clean_up_dead();
    drop(links);
    Ok(())
}
