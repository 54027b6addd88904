//! The cores that this process may use, by an index: 0 is the first that a real-time thread is tied to. The kernel's numbers say little about which those
//! should be: 0 and 1 are often two threads of one core, the fast cores of a hybrid processor may be any of them, and a control group or `taskset` leaves 5 and 7.
//!
//! Promise: fast cores come before slow ones, a core's first thread before its second, those of the first one's memory before others; what the kernel does not
//! say makes no difference. A thread that is tied to a core still knows them all.

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use std::path::Path;
use std::sync::OnceLock;

/// Where the kernel describes its cores.
const CPUS: &str = "/sys/devices/system/cpu";
/// A core of less than this part of the fastest one's speed is a slow one. The small cores of hybrid processors have 0.4 to 0.8 of it; between the large ones
/// of a processor, some of which its maker lets run a little faster than others, lie a few hundredths.
const SLOW: f64 = 0.85;

/// What the kernel says of a core.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Core {
    number: usize,
    /// The numbers of all threads of the same core, its own among them.
    siblings: Vec<usize>,
    /// In a unit that is the same for all of them.
    speed: Option<u64>,
    /// The part of the memory that is near.
    node: Option<usize>,
}

/// As they were when it was first asked: a thread that is tied to one of them sees only that one from then on.
struct Cores {
    allowed: CpuSet,
    order: Vec<usize>,
    count: usize,
}

/// Number of cores whose time this process may have, whatever the calling thread is tied to: a control group's quota may leave less than there are.
pub fn cores() -> usize {
    own().count
}

/// Number of cores on which this process may run, whatever the calling thread is tied to. A quota says nothing of them, and does not bind real-time threads.
pub fn places() -> usize {
    own().order.len().max(1)
}

/// The kernel's number of the core of this index, which all processes of the machine call it by.
pub fn core_number(index: usize) -> Option<usize> {
    own().order.get(index).copied()
}

/// Ties the calling thread to a core, by its index among those that this process may use. False where there is none.
pub fn pin_to_core(index: usize) -> bool {
    let Some(core) = core_number(index) else { return false };
    let mut one = CpuSet::new();
    one.set(core);
    sched_setaffinity(None, &one).is_ok()
}

/// Keeps the calling thread, and those that it will start, off a core, by the same index. False where no other is left.
pub fn keep_off(index: usize) -> bool {
    let Some(core) = core_number(index) else { return false };
    let mut others = own().allowed;
    others.unset(core);
    others.count() > 0 && sched_setaffinity(None, &others).is_ok()
}

/// Gives the calling thread all cores back that this process may use. False where that is refused.
pub fn unpin() -> bool {
    sched_setaffinity(None, &own().allowed).is_ok()
}

fn own() -> &'static Cores {
    static CORES: OnceLock<Cores> = OnceLock::new();
    CORES.get_or_init(|| {
        let allowed = sched_getaffinity(None).unwrap_or_else(|_| CpuSet::new());
        let numbers = (0..CpuSet::MAX_CPU).filter(|core| allowed.is_set(*core));
        let described: Vec<Core> = numbers.map(|number| read(Path::new(CPUS), number)).collect();
        let count = std::thread::available_parallelism().map_or(1, usize::from);
        Cores { allowed, order: in_order(&described), count }
    })
}

/// Their numbers, in the order in which they are used.
fn in_order(cores: &[Core]) -> Vec<usize> {
    let fastest = cores.iter().filter_map(|core| core.speed).max().unwrap_or(0);
    let is_slow = |core: &Core| core.speed.is_some_and(|speed| (speed as f64) < SLOW * fastest as f64);
    let is_second = |core: &Core| cores.iter().any(|other| other.number < core.number && core.siblings.contains(&other.number));
    let first = cores.iter().min_by_key(|core| (is_slow(core), is_second(core), core.number));
    let node = first.and_then(|core| core.node);
    let mut order: Vec<&Core> = cores.iter().collect();
    order.sort_by_cached_key(|core| (is_slow(core), is_second(core), core.node != node, core.number));
    order.into_iter().map(|core| core.number).collect()
}

/// What stands about a core in the kernel's folder of them.
fn read(cpus: &Path, number: usize) -> Core {
    let folder = cpus.join(format!("cpu{number}"));
    let text = |file: &str| std::fs::read_to_string(folder.join(file)).ok();
    let siblings = text("topology/core_cpus_list").or_else(|| text("topology/thread_siblings_list"));
    let speed = text("cpu_capacity").or_else(|| text("cpufreq/cpuinfo_max_freq"));
    let mut entries = std::fs::read_dir(&folder).into_iter().flatten().flatten();
    Core {
        number,
        siblings: siblings.map_or(Vec::new(), |list| numbers(&list)),
        speed: speed.and_then(|speed| speed.trim().parse().ok()),
        node: entries.find_map(|entry| entry.file_name().to_str()?.strip_prefix("node")?.parse().ok()),
    }
}

/// The numbers of a list such as `0-3,8`.
fn numbers(list: &str) -> Vec<usize> {
    let range = |part: &str| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let [first, last] = [first, last].map(|number| number.trim().parse::<usize>().ok());
        Some(first?..=last?.min(CpuSet::MAX_CPU))
    };
    list.split(',').filter_map(range).flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cores of which the kernel says this: siblings, speed, node.
    fn machine(said: impl Fn(usize) -> (Vec<usize>, Option<u64>, Option<usize>), allowed: &[usize]) -> Vec<Core> {
        let core = |number: usize| {
            let (siblings, speed, node) = said(number);
            Core { number, siblings, speed, node }
        };
        allowed.iter().map(|number| core(*number)).collect()
    }

    fn all(count: usize) -> Vec<usize> {
        (0..count).collect()
    }

    #[test]
    fn where_the_kernel_says_nothing_or_all_are_alike_they_come_by_their_numbers() {
        assert_eq!(in_order(&[]), Vec::<usize>::new());
        assert_eq!(in_order(&machine(|_| (vec![], None, None), &[5, 7])), [5, 7], "what taskset has left");
        assert_eq!(in_order(&machine(|at| (vec![at], Some(3_000_000), Some(0)), &all(64))), all(64));
        // Some of a processor's large cores may run a little faster than others.
        assert_eq!(in_order(&machine(|at| (vec![at], Some(5_300_000 - 100_000 * (at as u64 % 3)), None), &all(6))), all(6));
    }

    /// Both servos were tied to the two threads of one core, and both tissues to those of the next one.
    #[test]
    fn a_second_thread_of_a_core_comes_after_all_first_ones_wherever_its_number_is() {
        let side_by_side = |at: usize| (vec![at & !1, at | 1], None, None);
        assert_eq!(in_order(&machine(side_by_side, &all(4))), [0, 2, 1, 3]);
        let far = |at: usize| (vec![at % 4, at % 4 + 4], None, None);
        assert_eq!(in_order(&machine(far, &all(8))), all(8));
        // The first thread of that core is not ours, so this one is as good as any.
        assert_eq!(in_order(&machine(side_by_side, &[1, 2, 3])), [1, 2, 3]);
    }

    #[test]
    fn slow_cores_come_last_and_those_of_another_node_after_the_ones_of_the_first() {
        // Two large cores of two threads each, and four small ones, which come first here.
        let hybrid = |at: usize| match at {
            0..4 => (vec![at], Some(3_600_000), None),
            _ => (vec![at & !1, at | 1], Some(4_700_000), None),
        };
        assert_eq!(in_order(&machine(hybrid, &all(8))), [4, 6, 5, 7, 0, 1, 2, 3]);
        let alternate = |at: usize| (vec![at], None, Some(at % 2));
        assert_eq!(in_order(&machine(alternate, &all(6))), [0, 2, 4, 1, 3, 5]);
        assert_eq!(in_order(&machine(alternate, &[1, 2, 3, 4])), [1, 3, 2, 4], "the first one's node is that of 1");
    }

    #[test]
    fn a_core_is_read_from_what_an_older_or_a_newer_kernel_says_and_nonsense_is_nothing() {
        let cpus = std::env::temp_dir().join(format!("hyst-cores-{}", std::process::id()));
        let write = |file: &str, text: &str| {
            let path = cpus.join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        write("cpu1/topology/thread_siblings_list", "1,33\n");
        write("cpu1/cpufreq/cpuinfo_max_freq", "4700000\n");
        write("cpu1/node3/cpulist", "");
        assert_eq!(read(&cpus, 1), Core { number: 1, siblings: vec![1, 33], speed: Some(4_700_000), node: Some(3) });
        write("cpu1/topology/core_cpus_list", "0-1\n");
        write("cpu1/cpu_capacity", "1024\n");
        assert_eq!(read(&cpus, 1), Core { number: 1, siblings: vec![0, 1], speed: Some(1_024), node: Some(3) });
        write("cpu2/cpu_capacity", "fast\n");
        write("cpu2/topology/core_cpus_list", "x,-,3-,2\n");
        assert_eq!(read(&cpus, 2), Core { number: 2, siblings: vec![2], ..Core::default() });
        assert_eq!(read(&cpus, 9), Core { number: 9, ..Core::default() });
        std::fs::remove_dir_all(&cpus).unwrap();
        assert_eq!((numbers("0-3,8\n"), numbers("7-99999999999").last()), (vec![0, 1, 2, 3, 8], Some(&CpuSet::MAX_CPU)));
    }

    #[test]
    fn a_thread_that_is_tied_to_a_core_still_knows_how_many_there_are_and_is_freed_again() {
        let (count, places) = (cores(), places());
        let of_this_thread = || std::thread::available_parallelism().map_or(0, usize::from);
        std::thread::spawn(move || {
            assert!(pin_to_core(places - 1) && !pin_to_core(CpuSet::MAX_CPU));
            assert_eq!((of_this_thread(), cores(), super::places()), (1, count, places));
            assert!(unpin());
            assert_eq!(of_this_thread(), count);
            assert_eq!(keep_off(0), places > 1, "another core is left");
            assert_eq!(of_this_thread(), count.min(places - 1).max(1));
            assert!(!keep_off(CpuSet::MAX_CPU) && unpin());
        })
        .join()
        .unwrap();
    }
}
