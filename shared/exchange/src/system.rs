//! The few system calls that the link needs: clock, absolute sleep, futex, real-time class, room on a disk; what is locked is in [`crate::locking`], and the
//! cores are in [`crate::cores`].
//!
//! Promise: what is refused by the machine is reported, never assumed. Times are CLOCK_MONOTONIC nanoseconds.

use rustix::thread::futex;
use rustix::time::{ClockId, Timespec, clock_gettime};
use std::num::NonZeroU32;
use std::path::Path;
use std::sync::atomic::AtomicU32;

pub use crate::cores::{core_number, cores, keep_off, pin_to_core, places, unpin};
pub use crate::locking::lock_memory;

/// Unit in which the kernel tells when a process was started, ns: 100 to the second wherever it runs.
const START_UNIT_NS: u64 = 10_000_000;

/// CLOCK_MONOTONIC in nanoseconds.
pub fn now_ns() -> u64 {
    read_ns(ClockId::Monotonic)
}

/// Processor time of the calling thread, ns.
pub fn thread_ns() -> u64 {
    read_ns(ClockId::ThreadCPUTime)
}

fn read_ns(clock: ClockId) -> u64 {
    let now = clock_gettime(clock);
    now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64
}

/// When a process began that has this start time ([`process_start`]), on CLOCK_MONOTONIC, ns. The kernel tells it on a clock that goes on while the machine
/// sleeps, which that one does not. Of a process that has slept with it this is too early by as much.
pub fn started_ns(start: u64) -> u64 {
    let boot_ns = read_ns(ClockId::Boottime);
    on_monotonic(start, boot_ns, now_ns())
}

fn on_monotonic(start: u64, boot_ns: u64, now_ns: u64) -> u64 {
    start.saturating_mul(START_UNIT_NS).saturating_sub(boot_ns.saturating_sub(now_ns))
}

fn timespec(time_ns: u64) -> Timespec {
    Timespec { tv_sec: (time_ns / 1_000_000_000) as i64, tv_nsec: (time_ns % 1_000_000_000) as i64 }
}

/// Sleeps until an absolute time; a time in the past returns at once. A signal does not end the sleep.
pub fn sleep_until_ns(time_ns: u64) {
    let request = timespec(time_ns);
    // Bounded by the number of signals that arrive before `time_ns`.
    while rustix::thread::clock_nanosleep_absolute(ClockId::Monotonic, &request).is_err() {
        if now_ns() >= time_ns {
            return;
        }
    }
}

/// Sleeps for a time, for threads that are not real time.
pub fn sleep_ns(duration_ns: u64) {
    sleep_until_ns(now_ns() + duration_ns);
}

/// Waits until `word` differs from `expected` or `deadline_ns` has passed; may return early. The caller looks at the word again. `as_one_of`: who it is, as
/// bits, of those that are woken apart; all of them for who is woken with any.
pub fn wait_word(word: &AtomicU32, expected: u32, deadline_ns: u64, as_one_of: NonZeroU32) {
    let deadline = timespec(deadline_ns);
    // Every outcome (woken, changed, timed out, interrupted) has the same answer: look again.
    let _ = futex::wait_bitset(word, futex::Flags::empty(), expected, Some(&deadline), as_one_of);
}

/// Wakes all who wait on `word` as one of these.
pub fn wake_word(word: &AtomicU32, whom: NonZeroU32) {
    // Fails only for an unmapped address, which a reference cannot be.
    let _ = futex::wake_bitset(word, futex::Flags::empty(), i32::MAX as u32, whom);
}

/// Bytes that the file system of a file or folder has left for this user. Of a disk that stands still the answer is waited for.
///
/// # Errors
/// What the system says.
pub fn free_bytes(path: &Path) -> std::io::Result<u64> {
    let found = rustix::fs::statvfs(path)?;
    // One without a limit says that it has no blocks at all.
    Ok(if found.f_blocks == 0 { u64::MAX } else { found.f_bavail.saturating_mul(found.f_frsize) })
}

/// What the machine granted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RealTime {
    /// SCHED_FIFO was granted.
    pub fifo: bool,
    /// Memory is locked.
    pub locked: bool,
    /// The thread is tied to a core.
    pub pinned: bool,
}

impl RealTime {
    /// The word in the page: bit 0 FIFO, bit 1 locked, bit 2 pinned.
    pub fn word(self) -> u64 {
        self.fifo as u64 | (self.locked as u64) << 1 | (self.pinned as u64) << 2
    }
}

/// Brings so many bytes from an address on into the memory map, for reading. Not on a real-time thread.
#[allow(unsafe_code)]
pub(crate) fn populate(start: usize, bytes: usize) {
    use rustix::mm::{Advice, madvise};
    // SAFETY: to bring pages in for reading changes no memory. A range that has been unmapped meanwhile is refused by the kernel, and one in whose place
    // another was mapped is brought in as well, which is harmless.
    let _ = unsafe { madvise(std::ptr::with_exposed_provenance_mut(start), bytes, Advice::LinuxPopulateRead) };
}

/// Makes the calling thread SCHED_FIFO with this priority; children go back to the ordinary class. False where it is refused.
pub fn become_fifo(priority: i32) -> bool {
    schedule(0, libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, priority)
}

/// Makes the calling thread an ordinary one again, ahead of all others of that class: it has what real-time threads leave, and nearly all of it.
/// False where it is refused.
pub fn become_ordinary() -> bool {
    be_nice(-40) && schedule(0, libc::SCHED_OTHER | libc::SCHED_RESET_ON_FORK, 0)
}

/// Starts a process in the class of the calling thread, if that is SCHED_FIFO: whoever starts a process waits until it has its own program, and an
/// ordinary one would have to wait for all others before that. Says whether the process has that class now.
pub fn start_in_own_class<T>(start: impl FnOnce() -> T) -> (T, bool) {
    let priority = own_priority();
    let lent = priority > 0 && schedule(0, libc::SCHED_FIFO, priority);
    let started = start();
    if lent {
        schedule(0, libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, priority);
    }
    (started, lent)
}

/// Starts a process that is SCHED_FIFO from its first instruction on, where that is granted; the calling thread stays what it is.
pub fn start_in_class<T>(priority: i32, start: impl FnOnce() -> T) -> T {
    let own = own_priority();
    let lent = schedule(0, libc::SCHED_FIFO, priority);
    let started = start();
    match lent {
        true if own > 0 => schedule(0, libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, own),
        true => schedule(0, libc::SCHED_OTHER, 0),
        false => false,
    };
    started
}

/// SCHED_FIFO priority of the calling thread, 0 for an ordinary one.
#[allow(unsafe_code)] // rustix has no scheduler class; one call, proof below
pub fn own_priority() -> i32 {
    let mut parameters = libc::sched_param { sched_priority: 0 };
    // SAFETY: the pointer is to a live sched_param, which the call fills; thread id 0 is the calling thread.
    let result = unsafe { libc::sched_getparam(0, &mut parameters) };
    if result == 0 { parameters.sched_priority } else { 0 }
}

/// Makes a thread by its id an ordinary one, so that its tear-down disturbs nobody who is real time. In the idle class a death took up to 3 s where
/// the core that the thread is tied to has ordinary work (rendering in software, 2-core VM, 2026-11-23). False where it is refused.
pub fn demote(thread_id: i32) -> bool {
    schedule(thread_id, libc::SCHED_OTHER, 0)
}

/// Makes a thread by its id SCHED_FIFO with this priority: one that is dying, so that it is gone sooner, or one that does the next thing that somebody
/// waits for. False where it is refused.
pub fn hasten(thread_id: i32, priority: i32) -> bool {
    schedule(thread_id, libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK, priority)
}

/// The calling thread's id, as the other functions here take it.
pub fn thread_id() -> i32 {
    rustix::thread::gettid().as_raw_nonzero().get()
}

/// Gives a thread (0: the calling one) a scheduling class and a priority in it.
#[allow(unsafe_code)] // rustix has no scheduler class; one call, proof below
fn schedule(thread_id: i32, class: i32, priority: i32) -> bool {
    let parameters = libc::sched_param { sched_priority: priority };
    // SAFETY: the pointer is to a live, initialised sched_param and is only read during the call; any thread id is allowed.
    unsafe { libc::sched_setscheduler(thread_id, class, &parameters) == 0 }
}

/// Changes the calling thread's place among ordinary ones, and that of the threads that it will start: 19 gives way to all, −20 to none. False where it
/// is refused.
pub fn be_nice(by: i32) -> bool {
    rustix::process::nice(by).is_ok()
}

/// Gives all threads of this process the same place among ordinary ones, from −20 to 19. False where they cannot be listed, or one refuses.
pub fn set_niceness(nice: i32) -> bool {
    let Ok(threads) = std::fs::read_dir("/proc/self/task") else { return false };
    let ids = threads.flatten().filter_map(|thread| rustix::process::Pid::from_raw(thread.file_name().to_str()?.parse().ok()?));
    // One that has ended since then needs no place.
    ids.map(|id| rustix::process::setpriority_process(Some(id), nice))
        .all(|set| matches!(set, Ok(()) | Err(rustix::io::Errno::SRCH)))
}

/// Whether a process has a capability, by its bit in the kernel's sets and what the kernel says of the process in `/proc/PID/status`.
pub fn has_capability(status: &str, bit: u32) -> bool {
    let effective = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    effective.and_then(|set| u64::from_str_radix(set.trim(), 16).ok()).is_some_and(|set| (set >> bit) & 1 == 1)
}

/// User id, which is part of the station's root.
pub fn user_id() -> u32 {
    rustix::process::getuid().as_raw()
}

fn stat_of(pid: u32) -> std::io::Result<String> {
    std::fs::read_to_string(format!("/proc/{pid}/stat"))
}

/// Field 22 of /proc/PID/stat; `None` for a zombie.
fn start_in(stat: &str) -> Option<u64> {
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace();
    let state = fields.next()?;
    if state == "Z" || state == "X" {
        return None;
    }
    fields.nth(18)?.parse().ok()
}

/// Start time of a process in clock ticks since boot; `None` if it does not exist or is a zombie.
pub fn process_start(pid: u32) -> Option<u64> {
    start_in(&stat_of(pid).ok()?)
}

/// Whether the process that began then is alive. Who has no file left to look with takes nobody for dead whose number is taken.
pub fn is_alive(pid: u32, start: u64) -> bool {
    let exists = || {
        rustix::process::Pid::from_raw(pid as i32)
            .is_some_and(|pid| rustix::process::test_kill_process(pid) != Err(rustix::io::Errno::SRCH))
    };
    is_alive_by(stat_of(pid), start, exists)
}

fn is_alive_by(stat: std::io::Result<String>, start: u64, exists: impl Fn() -> bool) -> bool {
    let gone = [rustix::io::Errno::NOENT, rustix::io::Errno::SRCH].map(|errno| Some(errno.raw_os_error()));
    match stat {
        Ok(stat) => start_in(&stat) == Some(start),
        Err(error) => !gone.contains(&error.raw_os_error()) && exists(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wait_on_a_word_that_differs_returns_and_a_sleep_is_not_short() {
        let word = AtomicU32::new(1);
        wait_word(&word, 0, u64::MAX / 2, NonZeroU32::MAX);
        let until = now_ns() + 2_000_000;
        sleep_until_ns(until);
        assert!(now_ns() >= until);
    }

    /// On a laptop that had slept since it was started every process seemed to begin in the future.
    #[test]
    fn a_process_begins_before_now_also_on_a_machine_that_has_slept() {
        const S: u64 = 1_000_000_000;
        assert_eq!(on_monotonic(12_345, 200 * S, 200 * S), 123 * S + S / 100 * 45, "it never slept");
        assert_eq!(on_monotonic(360_100, 3_610 * S, 110 * S), 101 * S, "it slept for 3 500 s before that");
        assert_eq!((on_monotonic(0, 90 * S, 5 * S), on_monotonic(100, 5 * S, 6 * S)), (0, S));
        let began_ns = started_ns(process_start(std::process::id()).unwrap());
        assert!(began_ns <= now_ns(), "{began_ns}");
    }

    #[test]
    fn a_folder_has_room_and_one_that_is_not_there_has_none_that_anybody_knows() {
        assert!(free_bytes(&std::env::temp_dir()).is_ok());
        assert!(free_bytes(Path::new("/nowhere/at/all")).is_err_and(|error| error.kind() == std::io::ErrorKind::NotFound));
    }

    #[test]
    fn who_waits_as_another_one_sleeps_on_and_who_waits_for_any_is_woken_with_each() {
        let word = AtomicU32::new(0);
        let [first, second] = [1, 2].map(|bits| NonZeroU32::new(bits).unwrap());
        std::thread::scope(|scope| {
            let wait = |as_one_of: NonZeroU32| {
                scope.spawn({
                    let word = &word;
                    move || wait_word(word, 0, u64::MAX / 2, as_one_of)
                })
            };
            let [one, other, any] = [first, second, NonZeroU32::MAX].map(wait);
            // They may not wait yet.
            while !(other.is_finished() && any.is_finished()) {
                wake_word(&word, second);
                std::thread::yield_now();
            }
            assert!(!one.is_finished(), "it was woken as the other");
            while !one.is_finished() {
                wake_word(&word, first);
                std::thread::yield_now();
            }
        });
    }

    #[test]
    fn a_process_is_started_in_the_class_of_who_starts_it_and_that_goes_back() {
        let fifo = become_fifo(2); // refused without rights: then nothing is lent
        let (inside, lent) = start_in_own_class(|| std::thread::spawn(own_priority).join().unwrap_or(-1));
        assert_eq!((inside, lent), if fifo { (2, true) } else { (0, false) });
        assert_eq!(std::thread::spawn(own_priority).join().unwrap_or(-1), 0);
        let (started, after) = std::thread::spawn(|| {
            let started = start_in_class(3, || std::thread::spawn(own_priority).join().unwrap_or(-1));
            (started, own_priority())
        })
        .join()
        .unwrap();
        assert_eq!((started, after), (if fifo { 3 } else { 0 }, 0));
        assert_eq!(own_priority(), if fifo { 2 } else { 0 });
    }

    #[test]
    fn own_start_time_is_known_and_no_process_has_none() {
        assert!(process_start(std::process::id()).is_some());
        assert_eq!(process_start(u32::MAX), None);
        let own = std::process::id();
        let start = process_start(own).unwrap();
        assert!(is_alive(own, start) && !is_alive(own, start + 1) && !is_alive(u32::MAX >> 1, start));
        let failed = |errno: rustix::io::Errno| Err(std::io::Error::from_raw_os_error(errno.raw_os_error()));
        assert!(is_alive_by(failed(rustix::io::Errno::MFILE), start, || true), "no file to look with");
        assert!(!is_alive_by(failed(rustix::io::Errno::MFILE), start, || false));
        assert!(!is_alive_by(failed(rustix::io::Errno::SRCH), start, || true), "it went while it was read");
    }
}
