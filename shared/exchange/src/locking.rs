//! Memory that is locked, so that no page of it has to be fetched while a tick runs.
//!
//! Promise: what is locked never costs the process a mapping. Where the memory that it maps from now on is locked too, and a limit is met, the kernel refuses
//! the mapping itself: a newcomer's stream, a thread, an allocation. So that is asked for only where the limit is far away or binds nobody.

use crate::system;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};

/// What a process may map beside what it has when it asks, bytes: the streams of all newcomers of a session's largest organ, and what the allocator sets aside
/// for each thread.
pub const HEADROOM_BYTES: u64 = 1 << 30;
/// What it needs at least, bytes: the first thread's stack, which is locked, grows up to 8 MiB.
const STACK_BYTES: u64 = 16 << 20;
/// The bit of CAP_IPC_LOCK in the kernel's sets.
const IPC_LOCK_BIT: u32 = 14;

/// How much is to be locked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Extent {
    /// Nothing.
    None,
    /// What is mapped now.
    Present,
    /// That, and what is mapped later.
    All,
}

/// Locks the memory of the process: all that it has mapped, and of what it maps later each page when it is first touched. The kernel would touch a mapping as
/// a whole under the lock of the memory map; when a real-time thread then had to unmap something it waited for that, up to 100 ms for a stream of 50 MB
/// that an ordinary thread mapped (2-core VM, 2026-11-23). False where RLIMIT_MEMLOCK forbids it, or leaves so little that only what is mapped now is locked.
pub fn lock_memory() -> bool {
    let limit = getrlimit(Resource::Memlock).current;
    let mapped = mapped_bytes();
    let extent = extent(limit, mapped, is_exempt());
    if extent == Extent::None || mlockall(MlockAllFlags::CURRENT).is_err() {
        return false;
    }
    // More was locked than the limit allows: then it binds nobody here.
    let is_all = extent == Extent::All || limit.is_some_and(|limit| mapped > limit);
    is_all && mlockall(MlockAllFlags::FUTURE | MlockAllFlags::ONFAULT).is_ok()
}

/// Whether RLIMIT_MEMLOCK does not bind this process, as far as the system says it: it has CAP_IPC_LOCK, and not only in a namespace of its user's.
pub fn is_exempt() -> bool {
    let text = |file: &str| std::fs::read_to_string(file).unwrap_or_default();
    has_right(&text("/proc/self/status")) && is_first_namespace(&text("/proc/self/uid_map"))
}

fn has_right(status: &str) -> bool {
    system::has_capability(status, IPC_LOCK_BIT)
}

/// The first user namespace has all ids, each as itself; in another one the right is the kernel's no reason to lock more.
fn is_first_namespace(uid_map: &str) -> bool {
    uid_map.split_whitespace().eq(["0", "0", "4294967295"])
}

/// What this process has mapped, bytes; 0 where the system does not say.
fn mapped_bytes() -> u64 {
    let text = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages: u64 = text.split_whitespace().next().and_then(|pages| pages.parse().ok()).unwrap_or(0);
    pages.saturating_mul(rustix::param::page_size() as u64)
}

fn extent(limit: Option<u64>, mapped: u64, is_exempt: bool) -> Extent {
    match limit.filter(|_| !is_exempt) {
        None => Extent::All,
        Some(limit) if limit >= mapped.saturating_add(HEADROOM_BYTES) => Extent::All,
        // Too little for what there is: the kernel says whether it binds.
        Some(limit) if limit < mapped || limit >= mapped.saturating_add(STACK_BYTES) => Extent::Present,
        Some(_) => Extent::None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With a limit somewhat above what an engine had mapped when it became real time, it could map no newcomer's stream from then on.
    #[test]
    fn what_comes_later_is_locked_only_where_no_limit_is_near() {
        const MIB: u64 = 1 << 20;
        assert_eq!(extent(None, 500 * MIB, false), Extent::All);
        assert_eq!([0, 8 * MIB, 600 * MIB].map(|limit| extent(Some(limit), 500 * MIB, true)), [Extent::All; 3]);
        assert_eq!(extent(Some(2_000 * MIB), 500 * MIB, false), Extent::All);
        assert_eq!([520 * MIB, 1_500 * MIB].map(|limit| extent(Some(limit), 500 * MIB, false)), [Extent::Present; 2]);
        assert_eq!(extent(Some(510 * MIB), 500 * MIB, false), Extent::None, "the stack could not grow");
        assert_eq!([0, 64 << 10, 499 * MIB].map(|limit| extent(Some(limit), 500 * MIB, false)), [Extent::Present; 3]);
    }

    #[test]
    fn the_right_is_one_of_the_first_namespace() {
        let status = |set: &str| format!("Name:\tx\nCapPrm:\tffffffffffffffff\nCapEff:\t{set}\nCapBnd:\t0\n");
        assert!(has_right(&status("000001ffffffffff")) && has_right(&status("0000000000004000")));
        for none in ["0000000000000000", "00000000a80425fb", "", "x"] {
            assert!(!has_right(&status(none)), "{none}: docker gives the second one");
        }
        assert!(!has_right(""));
        assert!(is_first_namespace("         0          0 4294967295\n"));
        assert!(
            !is_first_namespace("0 1000 1\n") && !is_first_namespace("0 1000 1\n1 100000 65536\n") && !is_first_namespace("")
        );
    }

    #[test]
    fn what_this_process_has_mapped_is_known() {
        assert!(mapped_bytes() > 1 << 20);
    }
}
