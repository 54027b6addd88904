//! How a station of a campaign ends: asked as by Ctrl-C, and whatever that leaves is ended and removed, and counted.

use super::{LOOK_NS, Session};
use crate::{proc, remains};
use hyst_exchange::{Station, system};
use rustix::process::Signal;

/// How long a `hystation run` that has just been started may take until it is the station's guardian; before that it does not catch signals, or has
/// nothing that it could end.
const KEEPER_NS: u64 = 20_000_000_000;
/// A stop takes 2 s for processes that hang, and then some for the report.
const STOP_NS: u64 = 30_000_000_000;

/// How a station ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ended {
    /// Exit code of `hystation run`; none if a signal ended it.
    pub exit_code: Option<i32>,
    /// Processes, segments and files that were left: by itself if it came to its end, else after it was killed and wiped.
    pub leftovers: u64,
}

impl Session {
    /// Stops the station as Ctrl-C does. Its report lies in the folder; of the station nothing is left.
    pub fn stop(mut self) -> Ended {
        self.end()
    }

    fn end(&mut self) -> Ended {
        self.is_over = true;
        let exit_code = self.ask_to_stop();
        let left = count_left(&self.station);
        if left > 0 {
            remains::end_all(&self.station);
        }
        Ended { exit_code, leftovers: if exit_code.is_some() { left } else { count_left(&self.station) } }
    }

    /// Gives its exit code; none if it ended by a signal, or had to be killed.
    fn ask_to_stop(&mut self) -> Option<i32> {
        let keeper_ns = system::now_ns() + KEEPER_NS;
        let keeps = |session: &Session| remains::guardian(&session.station).is_some_and(|it| it.pid == session.child.id());
        while matches!(self.child.try_wait(), Ok(None)) && !keeps(self) && system::now_ns() < keeper_ns {
            system::sleep_ns(LOOK_NS);
        }
        if let Some(pid) = proc::pid(self.child.id()).filter(|_| matches!(self.child.try_wait(), Ok(None))) {
            let _ = rustix::process::kill_process(pid, Signal::INT); // one that has just ended is reaped below
        }
        let end_ns = system::now_ns() + STOP_NS;
        while system::now_ns() < end_ns {
            if let Ok(Some(status)) = self.child.try_wait() {
                return status.code();
            }
            system::sleep_ns(LOOK_NS);
        }
        let _ = self.child.kill().and_then(|()| self.child.wait()); // the guardian hangs: nothing else is left to do
        None
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        if !self.is_over {
            self.end();
        }
    }
}

fn count_left(station: &Station) -> u64 {
    (remains::living(station).len() + station.leftovers().len()) as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    /// Those who have no place in the station's page are known by their command line.
    #[test]
    fn who_lives_on_without_a_guardian_is_counted_and_ended_and_its_files_removed() {
        let station = Station::named(&format!("t{}-ended", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        assert_eq!(count_left(&station), 1, "its root");
        let mut orphan = Command::new("sh").args(["-c", "sleep 60; true", "sh", "--station", station.name()]).spawn().unwrap();
        while count_left(&station) < 2 {
            system::sleep_ns(LOOK_NS); // until it is what it was started as
        }
        let waits = std::thread::spawn(move || orphan.wait().unwrap().code());
        remains::end_all(&station);
        assert_eq!((count_left(&station), waits.join().unwrap()), (0, None));
    }
}
