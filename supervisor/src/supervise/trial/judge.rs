//! The helper process that compares what a newcomer makes with what it should be: its start, the lines that it says, and its end.

use crate::policy::Exit;
use crate::spawn;
use crate::supervise::Input;
use crate::swap::judge::Seen;
use hyst_exchange::{Station, system};
use hyst_messages::{Role, TICK_NS};
use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::process::{Child, Stdio};
use std::sync::mpsc::Sender;

/// How long one that was killed may take to end where nobody but this thread can wait for it, ns.
const REAPED_WITHIN_NS: u64 = 20_000_000;

/// Starts the judge of a newcomer; what it says goes to `tell`. `None` where the system gives no process or no thread for it.
pub(super) fn start(station: &Station, role: Role, guest: u32, draws: bool, tell: Sender<Input>) -> Option<Child> {
    let mut command = crate::proc::own_program();
    command.args(["judge", "--station", station.name(), "--role", role.name(), "--guest", &guest.to_string()]).process_group(0);
    command.args(draws.then_some("--draws"));
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut child = spawn::start_as_begun(station, &mut command, None).ok()?;
    let lines = BufReader::new(child.stdout.take()?).lines();
    // Ends with the judge.
    let read = move || {
        for seen in lines.map_while(Result::ok).filter_map(|line| serde_json::from_str::<Seen>(&line).ok()) {
            if tell.send(Input::Judged { incarnation: guest, seen }).is_err() {
                return;
            }
        }
    };
    if std::thread::Builder::new().name("judge".into()).spawn(read).is_err() {
        end(child); // nobody would read what it says
        return None;
    }
    Some(child)
}

/// Ends a judge, and reaps it: one that waits for a recording's disk ends when that answers, and nobody waits for it.
pub(super) fn end(mut judge: Child) {
    let _ = judge.kill(); // gone is as good
    let pid = judge.id();
    if std::thread::Builder::new().name("judged".into()).spawn(move || judge.wait()).is_err() {
        reap_within(pid, REAPED_WITHIN_NS); // without another thread
    }
}

/// Waits for so long until a child that was killed has ended, ns; whether it has.
fn reap_within(pid: u32, within_ns: u64) -> bool {
    let until_ns = system::now_ns() + within_ns;
    while spawn::reap(pid) == Exit::Unknown {
        if system::now_ns() >= until_ns {
            return false;
        }
        system::sleep_ns(TICK_NS);
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;
    use std::process::Command;

    /// Where no thread could be had for its lines, its process was left for as long as the supervisor lived.
    #[test]
    fn a_judge_is_reaped_with_another_thread_and_without_one() {
        const HANG_NS: u64 = 60_000_000_000;
        let start = || Command::new("sleep").arg("1000").spawn().unwrap();
        let of = |pid: u32| PathBuf::from(format!("/proc/{pid}"));
        let judge = start();
        let pid = judge.id();
        assert!(!reap_within(pid, 0) && of(pid).exists(), "it lives");
        end(judge);
        let until_ns = system::now_ns() + HANG_NS;
        while of(pid).exists() {
            assert!(system::now_ns() < until_ns, "it was not reaped");
            std::thread::yield_now();
        }
        let mut alone = start();
        alone.kill().unwrap();
        assert!(reap_within(alone.id(), HANG_NS) && alone.wait().is_err(), "nobody is left to be waited for");
    }
}
