//! What the system says about processes: their threads, memory and processor time, and which of them belong to a station.

mod members;

use crate::suspicion::Thread;
use hyst_exchange::system;
use hyst_messages::Role;
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fd::OwnedFd;
use rustix::process::{Pid, Signal};
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command};

pub use hyst_engine::verify::{await_end, end_group, wait_unless, wait_within};
pub use members::{MARK, belongs, group, mark_of, of_incarnation, of_station, of_user, started_by};

/// Clock ticks per second of /proc/PID/stat; fixed for all architectures that Linux supports here.
pub const CLOCK_HZ: f64 = 100.0;
/// Fields of /proc/PID/stat between the state and the exit code.
const EXIT_CODE_AFTER_STATE: usize = 48;
/// Most threads of one process that are demoted; engines have a dozen.
const MOST_THREADS: usize = 256;
/// How often SIGSEGV is sent again before its sender goes on with its own work, and tries later: an engine that runs has died of the second.
const MOST_SENT: u32 = 20;
/// Between two of them, ns: time for a real-time thread to wake and take the signal.
const BETWEEN_SENT_NS: u64 = 100_000;

/// The process id as the system-call crate wants it; `None` for 0 and for what is no id.
pub fn pid(number: u32) -> Option<Pid> {
    i32::try_from(number).ok().and_then(Pid::from_raw)
}

/// The very program that runs, also if its file was replaced or removed meanwhile, as by whoever builds it anew.
pub const OWN_PROGRAM: &str = "/proc/self/exe";

/// A command of it.
pub fn own_program() -> Command {
    let mut command = Command::new(OWN_PROGRAM);
    command.arg0("hystation");
    command
}

/// Starts a process without waiting for the processor time that ordinary ones must wait for. From its own program on it is an ordinary one, unless it
/// is in a hurry: then it stays in the class of who started it.
pub fn start(command: &mut Command, in_a_hurry: bool) -> std::io::Result<Child> {
    let (child, lent) = system::start_in_own_class(|| command.spawn());
    let child = child?;
    if lent
        && !in_a_hurry
        && let Ok(first_thread) = i32::try_from(child.id())
    {
        system::demote(first_thread);
    }
    Ok(child)
}

/// Starts a process that is real time from its first instruction on, where the machine grants that: behind ordinary ones on full cores a start-up takes
/// seconds.
pub fn start_at(priority: i32, command: &mut Command) -> std::io::Result<Child> {
    system::start_in_class(priority, || command.spawn())
}

/// A broken invariant ends the process, whichever thread found it, and the guardian starts another: one that had lost its watching thread would beat
/// on, and see nobody die.
pub fn end_on_panic() {
    let default = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        default(info);
        std::process::exit(1);
    }));
}

/// Threads of a process.
pub fn threads(process: u32) -> Vec<i32> {
    std::fs::read_dir(format!("/proc/{process}/task"))
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| entry.file_name().to_string_lossy().parse().ok())
        .take(MOST_THREADS)
        .collect()
}

/// The kernel's files about a thread of a process, mostly its first one, kept open, so that asking costs two reads.
#[derive(Debug)]
pub struct ThreadFiles {
    process: u32,
    stat: File,
    schedstat: Option<File>,
}

impl ThreadFiles {
    /// Opens the files; `None` if the process is gone.
    pub fn open(process: u32) -> Option<ThreadFiles> {
        ThreadFiles::of_thread(process, process as i32)
    }
    /// The same of any of its threads.
    pub fn of_thread(process: u32, thread: i32) -> Option<ThreadFiles> {
        let stat = File::open(task(process, thread, "stat")).ok()?;
        Some(ThreadFiles { process, stat, schedstat: File::open(task(process, thread, "schedstat")).ok() })
    }

    /// What the process does: as its first thread, unless that sleeps while another of its threads is ready to run or waits for the machine, as
    /// the helpers of a driver do.
    pub fn state_of_process(&self) -> Option<Thread> {
        let first = self.state()?;
        if first != Thread::Sleeping {
            return Some(first);
        }
        let helpers = threads(self.process)
            .into_iter()
            .filter_map(|thread| state_letter(&File::open(task(self.process, thread, "stat")).ok()?));
        let busy = helpers.into_iter().any(|letter| matches!(letter, b'R' | b'D'));
        Some(if busy { Thread::Waiting } else { first })
    }

    /// What the thread does; `None` if it is dead. A kernel without schedstat lets nobody be seen to spin, only to be silent.
    pub fn state(&self) -> Option<Thread> {
        match state_letter(&self.stat)? {
            b'T' | b't' => Some(Thread::Stopped),
            b'D' => Some(Thread::Waiting),
            b'R' => Some(Thread::Running(self.ran_and_waited_ns().map_or(0, |(ran_ns, _)| ran_ns))),
            b'Z' | b'X' => None,
            _ => Some(Thread::Sleeping),
        }
    }

    /// What the thread has run, and for how long it was ready to and not let, ns; `None` if the kernel does not say.
    pub fn ran_and_waited_ns(&self) -> Option<(u64, u64)> {
        ran_and_waited_ns(self.schedstat.as_ref()?)
    }

    /// The same of all threads of the process, added up: of a rendering most is done by the driver's.
    pub fn all_ran_and_waited_ns(&self) -> Option<(u64, u64)> {
        let of = |thread: &i32| File::open(task(self.process, *thread, "schedstat")).ok().as_ref().and_then(ran_and_waited_ns);
        let first = self.ran_and_waited_ns()?;
        let helpers = threads(self.process).into_iter().filter(|thread| *thread as u32 != self.process);
        Some(helpers.filter_map(|thread| of(&thread)).fold(first, |all, one| (all.0 + one.0, all.1 + one.1)))
    }
}

fn ran_and_waited_ns(schedstat: &File) -> Option<(u64, u64)> {
    let mut bytes = [0u8; 64];
    let length = schedstat.read_at(&mut bytes, 0).ok()?;
    let mut numbers = std::str::from_utf8(bytes.get(..length)?).ok()?.split_whitespace();
    Some((numbers.next()?.parse().ok()?, numbers.next()?.parse().ok()?))
}

fn task(process: u32, thread: i32, file: &str) -> String {
    format!("/proc/{process}/task/{thread}/{file}")
}

/// State of a thread as its stat file says it.
fn state_letter(stat: &File) -> Option<u8> {
    let mut bytes = [0u8; 128];
    let length = stat.read_at(&mut bytes, 0).ok()?;
    let text = bytes.get(..length)?;
    let close = text.iter().rposition(|byte| *byte == b')')?;
    text.get(close + 2).copied()
}

/// How a process ended that nobody has reaped yet, as `waitpid` would say it: an adopted one is the guardian's to reap, who looks every 20 ms. `None` if it
/// lives, is reaped, or ended with 0, which is also what the kernel says where it does not tell.
pub fn status_of_zombie(process: u32) -> Option<i32> {
    let text = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let mut fields = text.rsplit_once(')')?.1.split_whitespace();
    let is_zombie = fields.next()? == "Z";
    let status = fields.nth(EXIT_CODE_AFTER_STATE)?.parse().ok()?; // proc(5): field 52, the state is 3
    (is_zombie && status != 0).then_some(status)
}

/// Kills a process, of a role if that is known, and what it has started, if it leads a group. Before that, all of its threads are made ordinary ones, so that its
/// tear-down disturbs nobody who is real time; not those of the device: nobody does its work until it is gone.
pub fn end(role: Option<Role>, process: u32) {
    demote(role, process);
    signal(process, Signal::KILL);
    end_group(process);
}

/// The same for one that is held by its descriptor: its id may be somebody else's by now, and nobody else is killed.
pub fn end_held(role: Role, process: u32, pidfd: &OwnedFd) {
    if has_ended(pidfd) {
        return;
    }
    demote(Some(role), process);
    let _ = rustix::process::pidfd_send_signal(pidfd, Signal::KILL); // gone is as good
}

/// Whether a process has ended, by its descriptor.
pub fn has_ended(pidfd: &OwnedFd) -> bool {
    let mut asked = [PollFd::new(pidfd, PollFlags::IN)];
    rustix::event::poll(&mut asked, Some(&Timespec::default())).is_ok_and(|count| count > 0)
}

/// Lets the threads that are left of a dying process end before whoever is below this priority: they are ordinary, and on full cores the last of them got
/// no time for tens of milliseconds. Refused without rights: then it ends as it can.
pub fn hasten(process: u32, priority: i32) {
    for thread in threads(process) {
        system::hasten(thread, priority);
    }
}

fn demote(role: Option<Role>, process: u32) {
    if role != Some(Role::Device) {
        for thread in threads(process) {
            system::demote(thread); // refused without rights: then it ends at its old priority
        }
    }
}

/// Sends a signal; false if nobody is there to get it.
pub fn signal(process: u32, signal: Signal) -> bool {
    pid(process).is_some_and(|pid| rustix::process::kill_process(pid, signal).is_ok())
}

/// Sends SIGSEGV until it is felt; false if nobody is there to get it. The runtime of a Rust program takes a first one to look for an overflow of the
/// stack, resets the signal and returns to the instruction: a wild access faults there again, but one that was only sent is gone.
pub fn segfault(process: u32) -> bool {
    let sent = signal(process, Signal::SEGV);
    let Some(files) = ThreadFiles::open(process) else { return sent };
    for _ in 0..MOST_SENT {
        system::sleep_ns(BETWEEN_SENT_NS);
        if files.state().is_none() || !signal(process, Signal::SEGV) {
            break;
        }
    }
    sent
}

/// Resident memory, MiB: all of it, and what of it others may have, too (files, and what is in `/dev/shm`).
pub fn resident_and_shared_mib(process: u32) -> Option<[f64; 2]> {
    let text = std::fs::read_to_string(format!("/proc/{process}/statm")).ok()?;
    let mut pages = text.split_whitespace().skip(1).map_while(|field| field.parse::<f64>().ok());
    let mib = rustix::param::page_size() as f64 / (1024.0 * 1024.0);
    Some([pages.next()? * mib, pages.next()? * mib])
}

/// Resident memory, MiB.
pub fn resident_mib(process: u32) -> Option<f64> {
    resident_and_shared_mib(process).map(|[resident_mib, _]| resident_mib)
}

/// Open files of a process.
pub fn open_files(process: u32) -> Option<u64> {
    Some(std::fs::read_dir(format!("/proc/{process}/fd")).ok()?.count() as u64)
}

/// Memory that is the process's share, with what it shares divided by the number of sharers, MiB. Costs some milliseconds.
pub fn proportional_mib(process: u32) -> Option<f64> {
    let text = std::fs::read_to_string(format!("/proc/{process}/smaps_rollup")).ok()?;
    let line = text.lines().find(|line| line.starts_with("Pss:"))?;
    let kib: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib / 1024.0)
}

/// Processor time so far, seconds.
pub fn processor_s(process: u32) -> Option<f64> {
    let text = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let mut fields = text.rsplit_once(')')?.1.split_whitespace().skip(11);
    let user: f64 = fields.next()?.parse().ok()?;
    let system: f64 = fields.next()?.parse().ok()?;
    Some((user + system) / CLOCK_HZ)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_exchange::Station;
    use std::os::unix::process::ExitStatusExt;
    use std::process::{Command, Stdio};

    #[test]
    fn the_own_process_is_described_and_belongs_to_no_station() {
        let me = std::process::id();
        assert!(threads(me).contains(&(me as i32)));
        assert!(resident_mib(me).unwrap() > 0.5 && processor_s(me).unwrap() >= 0.0);
        let own_mib = || resident_and_shared_mib(me).map(|[resident_mib, shared_mib]| resident_mib - shared_mib).unwrap();
        let before_mib = own_mib();
        let taken = std::hint::black_box(vec![1u8; 256 << 20]);
        assert!(own_mib() - before_mib > 200.0, "{} MiB are its own", taken.len() >> 20);
        let station = Station::named(&format!("t{me}-nobody")).unwrap();
        assert_eq!(of_station(&station), Vec::<u32>::new());
        assert!(!signal(0, Signal::KILL) && pid(u32::MAX).is_none());
    }

    #[test]
    fn what_all_threads_ran_grows_while_the_first_one_sleeps() {
        let files = ThreadFiles::open(std::process::id()).unwrap();
        let helpers_ns = || {
            let first_ns = files.ran_and_waited_ns()?.0; // before the sum: the first one may run meanwhile
            Some(files.all_ran_and_waited_ns()?.0 - first_ns)
        };
        let Some(before_ns) = helpers_ns() else { return }; // a kernel that keeps no such books
        let deadline_ns = system::now_ns() + 60_000_000_000;
        while helpers_ns().is_none_or(|ns| ns < before_ns + 20_000_000) {
            assert!(system::now_ns() < deadline_ns, "this thread, which is not the first, runs all the time");
        }
    }

    #[test]
    fn how_a_zombie_ended_is_known_before_it_is_reaped_and_nothing_afterwards() {
        let ended = |script: &str| {
            let mut child = Command::new("sh").args(["-c", script]).spawn().unwrap();
            let stat = File::open(format!("/proc/{}/stat", child.id())).unwrap();
            let deadline_ns = system::now_ns() + 20_000_000_000;
            while state_letter(&stat) != Some(b'Z') {
                assert!(system::now_ns() < deadline_ns, "{script}: it does not end");
                system::sleep_ns(1_000_000);
            }
            let status = status_of_zombie(child.id());
            assert_eq!(child.wait().unwrap().into_raw(), status.unwrap_or_default(), "{script}");
            assert_eq!(status_of_zombie(child.id()), None, "{script}: reaped");
            status
        };
        assert_eq!([ended("exit 3"), ended("kill -9 $$"), ended("exit 0")], [Some(3 << 8), Some(9), None]);
        assert_eq!(status_of_zombie(std::process::id()), None);
    }

    /// Runs as a program of its own below: the runtime's handler is there, as in an engine.
    #[test]
    fn a_victim() {
        if std::env::var_os("HYSTATION_TEST_VICTIM").is_some() {
            println!("here");
            std::io::stdin().read_line(&mut String::new()).unwrap();
        }
    }

    /// The same: one thread of it panics, the first one waits for a line that nobody writes.
    #[test]
    fn a_panicking_thread() {
        if std::env::var_os("HYSTATION_TEST_PANIC").is_some() {
            end_on_panic();
            std::thread::spawn(|| panic!("an invariant is broken"));
            std::io::stdin().read_line(&mut String::new()).unwrap();
        }
    }

    #[test]
    fn a_thread_that_panics_ends_the_whole_process() {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "proc::tests::a_panicking_thread", "--nocapture"]).env("HYSTATION_TEST_PANIC", "1");
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let _open = child.stdin.take(); // without it the first thread would read the end of its input, and go on
        let status = wait_within(&mut child, 60_000_000_000).expect("it lives on");
        assert_eq!(status.code(), Some(1));
        // Kept from the test's own output, where the first panic is to be one that nobody wanted.
        let said = std::io::read_to_string(child.stderr.take().unwrap()).unwrap();
        assert!(said.contains("an invariant is broken"), "{said}");
    }

    #[test]
    fn a_segfault_kills_a_program_whose_runtime_swallows_the_first_signal() {
        use std::io::Read;
        use std::os::unix::process::ExitStatusExt;
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "proc::tests::a_victim", "--nocapture"]).env("HYSTATION_TEST_VICTIM", "1");
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let mut said = Vec::new();
        let mut out = child.stdout.take().unwrap();
        while !said.ends_with(b"here") {
            let mut byte = [0];
            assert_eq!(out.read(&mut byte).unwrap(), 1, "it ended: {}", String::from_utf8_lossy(&said));
            said.push(byte[0]);
        }
        assert!(segfault(child.id()));
        // One that gets no time between two signals has felt one of them; the station, too, sends again until it is felt.
        let since = std::time::Instant::now();
        let status = loop {
            if let Some(status) = child.try_wait().unwrap() {
                break status;
            }
            assert!(since.elapsed().as_secs() < 60, "it lives");
            segfault(child.id());
        };
        assert_eq!(status.signal(), Some(11));
    }
}
