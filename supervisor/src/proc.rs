//! What the system says about processes: their threads, memory and processor time, and which of them belong to a station.

use hyst_exchange::{Station, system};
use rustix::process::{Pid, Signal};
use std::path::Path;

/// Clock ticks per second of /proc/PID/stat; fixed for all architectures that Linux supports here.
pub const CLOCK_HZ: f64 = 100.0;
/// Most threads of one process that are demoted; engines have a dozen.
const MOST_THREADS: usize = 256;

/// The process id as the system-call crate wants it; `None` for 0 and for what is no id.
pub fn pid(number: u32) -> Option<Pid> {
    i32::try_from(number).ok().and_then(Pid::from_raw)
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

/// Demotes all threads of a process to the idle class, so that its tear-down disturbs nobody, and kills it.
pub fn demote_and_kill(process: u32) {
    for thread in threads(process) {
        system::demote(thread); // refused without rights: then it ends at its old priority
    }
    signal(process, Signal::KILL);
}

/// Sends a signal; false if nobody is there to get it.
pub fn signal(process: u32, signal: Signal) -> bool {
    pid(process).is_some_and(|pid| rustix::process::kill_process(pid, signal).is_ok())
}

/// Resident memory, MiB.
pub fn resident_mib(process: u32) -> Option<f64> {
    let text = std::fs::read_to_string(format!("/proc/{process}/statm")).ok()?;
    let pages: f64 = text.split_whitespace().nth(1)?.parse().ok()?;
    Some(pages * rustix::param::page_size() as f64 / (1024.0 * 1024.0))
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

/// Processes of a station by their command line (`--station NAME`): all but the guardian and the caller.
pub fn of_station(station: &Station) -> Vec<u32> {
    let mine = std::process::id();
    let user = system::user_id();
    std::fs::read_dir("/proc")
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| entry.file_name().to_string_lossy().parse::<u32>().ok())
        .filter(|process| *process != mine && belongs(*process, user, station.name()))
        .collect()
}

fn belongs(process: u32, user: u32, name: &str) -> bool {
    use std::os::unix::fs::MetadataExt;
    let folder = format!("/proc/{process}");
    if !Path::new(&folder).metadata().is_ok_and(|data| data.uid() == user) {
        return false;
    }
    let Ok(line) = std::fs::read(format!("{folder}/cmdline")) else {
        return false;
    };
    let arguments: Vec<&[u8]> = line.split(|byte| *byte == 0).collect();
    let named = arguments.windows(2).any(|pair| pair[0] == b"--station" && pair[1] == name.as_bytes());
    named && system::process_start(process).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_own_process_is_described_and_belongs_to_no_station() {
        let me = std::process::id();
        assert!(threads(me).contains(&(me as i32)));
        assert!(resident_mib(me).unwrap() > 0.5 && processor_s(me).unwrap() >= 0.0);
        let station = Station::named(&format!("t{me}-nobody")).unwrap();
        assert_eq!(of_station(&station), Vec::<u32>::new());
        assert!(!signal(0, Signal::KILL) && pid(u32::MAX).is_none());
    }
}
