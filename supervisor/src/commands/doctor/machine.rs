//! What a station needs of the machine itself: programs, rights, shared memory, disk.

use super::{Finding, Machine, devices};
use crate::guardian::{NEEDED_BYTES, size_for};
use crate::recording::{MOST_BYTES_PER_S, SHORT_S};
use hyst_engine::realtime::WATCH_PRIORITY;
use hyst_exchange::{locking, system};
use hyst_messages::Role;
use rustix::fs::{Access, StatVfs, StatVfsMountFlags};
use rustix::process::{Resource, getrlimit};
use std::path::{Path, PathBuf};

/// More than a real-time process maps, and may map later, bytes: it counts whether it is ever touched or not.
const LOCKED_BYTES: u64 = locking::HEADROOM_BYTES + (1 << 30);

/// More than an hour of a recording takes, bytes.
const HOUR_BYTES: u64 = (MOST_BYTES_PER_S * SHORT_S) as u64;

/// The file of limits that the package brings, and the group that it grants them to.
const LIMITS: &str = "/etc/security/limits.d/hystation.conf";
const GROUP: &str = "users";

/// Least share of each second that real-time threads need, µs.
const LEAST_RUNTIME_US: i64 = 900_000;

/// All of them, in the order in which they are read.
pub fn findings(machine: &Machine) -> Vec<Finding> {
    let folder = std::env::current_exe().ok().and_then(|program| program.parent().map(Path::to_path_buf)).unwrap_or_default();
    let shm = rustix::fs::statvfs(machine.path("/dev/shm")).ok();
    let recorded = [Recorded::here()].into_iter().chain(Recorded::by_services(machine));
    let disks = recorded.map(|place| disk(machine, &place, rustix::fs::statvfs(place.folder.as_path()).ok().as_ref().map(room)));
    let before = vec![
        programs(machine, &folder),
        real_time(machine, granted(), system::user_id() == 0, may_be_nice(&machine.text("/proc/self/status"))),
        preemption(machine),
        locked_memory(machine, getrlimit(Resource::Memlock).current, locking::is_exempt()),
        shared_memory(machine, shm.as_ref().map(room)),
        copies(shm.is_some_and(|mounted| mounted.f_flag.contains(StatVfsMountFlags::NOEXEC))),
        throttling(machine),
    ];
    before.into_iter().chain(disks).chain([leftovers()]).collect()
}

/// Bytes of a disk, and how many of them are free.
#[derive(Clone, Copy)]
struct Room {
    size: u64,
    free: u64,
}

fn room(disk: &StatVfs) -> Room {
    Room { size: disk.f_blocks * disk.f_frsize, free: disk.f_bavail * disk.f_frsize }
}

/// The engines, and the simulated device among them, lie beside this program.
fn programs(machine: &Machine, folder: &Path) -> Finding {
    let engines = Role::ALL.iter().filter(|role| !matches!(role, Role::Supervisor | Role::Guardian));
    let is_program = |path: &Path| path.is_file() && (machine.may)(path, Access::EXEC_OK);
    let missing: Vec<&str> = engines.map(|role| role.name()).filter(|name| !is_program(&folder.join(name))).collect();
    match missing.as_slice() {
        [] => Finding::good("programs", format!("every engine, and the simulated device, in {}", folder.display())),
        missing => {
            let found = format!("{} of {} missing or not to be run", missing.join(", "), folder.display());
            Finding::bad("programs", found, "`./station build`, or install the package again")
        }
    }
}

/// Whether SCHED_FIFO is granted at all, and at the highest priority that a station has. Asked of threads that end at once, so that nothing here runs in real time.
fn granted() -> [bool; 2] {
    [1, WATCH_PRIORITY].map(|priority| std::thread::spawn(move || system::become_fifo(priority)).join().unwrap_or(false))
}

/// Whether a process has CAP_SYS_NICE, by what the kernel says of it.
fn may_be_nice(status: &str) -> bool {
    const BIT: u32 = 23;
    system::has_capability(status, BIT)
}

/// How this user comes by a limit (`rtprio 95`): by a line for a group, which the package brings, by being in that group, and by a login after that.
fn limit_cure(machine: &Machine, limit: &str) -> String {
    let wanted = format!("@{GROUP} - {limit}");
    let is_wanted = |line: &str| line.split_whitespace().eq(wanted.split_whitespace());
    let is_there = machine.text(LIMITS).lines().any(is_wanted);
    let put = (!is_there).then(|| format!("put `{wanted}` into {LIMITS}"));
    let join = (!has_group(machine, GROUP)).then(|| format!("`sudo usermod -aG {GROUP} $USER`"));
    let steps: Vec<String> = put.into_iter().chain(join).chain(["log in again".to_owned()]).collect();
    steps.join(" and ")
}

/// Whether this process has a group, by the number that the group has.
fn has_group(machine: &Machine, name: &str) -> bool {
    let (groups, status) = (machine.text("/etc/group"), machine.text("/proc/self/status"));
    let number = groups.lines().find_map(|line| {
        let mut fields = line.split(':'); // name, password, number, members
        if fields.next() == Some(name) { fields.nth(1) } else { None }
    });
    let is_own = |line: &&str| line.starts_with("Gid:") || line.starts_with("Groups:");
    let mut numbers = status.lines().filter(is_own).flat_map(|line| line.split_whitespace().skip(1));
    number.is_some_and(|number| numbers.any(|own| own == number))
}

fn real_time(machine: &Machine, [any, all]: [bool; 2], is_root: bool, has_right: bool) -> Finding {
    let cure = if has_right {
        "the right is there, so the control group has no real time (a kernel with CONFIG_RT_GROUP_SCHED: docker --cpu-rt-runtime=950000, or start it outside \
         of the group), or a filter of system calls refuses it (docker --security-opt seccomp=unconfined)"
            .to_owned()
    } else if is_root {
        "give docker --cap-add SYS_NICE, or the service AmbientCapabilities=CAP_SYS_NICE".to_owned()
    } else {
        format!("run as root, or {}, or give docker --cap-add SYS_NICE", limit_cure(machine, "rtprio 95"))
    };
    match (any, all) {
        (_, true) => Finding::good("real time", format!("SCHED_FIFO is granted up to priority {WATCH_PRIORITY}")),
        (true, false) => {
            let found = format!(
                "SCHED_FIFO is granted, but not up to priority {WATCH_PRIORITY}: some threads go without it, with more misses"
            );
            Finding::weak("real time", found, cure)
        }
        (false, false) => {
            Finding::weak("real time", "SCHED_FIFO is refused; the station runs without it, with more misses", cure)
        }
    }
}

/// Whether the kernel lets go of a core while it works for somebody: the start and the end of a large process keep it busy for up to a millisecond.
fn preemption(machine: &Machine) -> Finding {
    let [version, command_line, switch] =
        ["/proc/version", "/proc/cmdline", "/sys/kernel/debug/sched/preempt"].map(|path| machine.text(path));
    let mode = mode_of_preemption(&version, &command_line, &switch);
    let cure = "add `preempt=full` to the kernel's command line: else the start and the end of a large process (rendering) hold a core for up to 1 ms, and \
                single ticks come late";
    match mode {
        Some(mode) if matches!(mode, "rt" | "full" | "lazy") => Finding::good("preemption", mode),
        Some(mode) => Finding::weak("preemption", mode, cure),
        None => Finding::weak("preemption", "not to be seen (/sys/kernel/debug/sched/preempt)", cure),
    }
}

/// How the kernel is preempted, as far as its version, its command line or its switch say it.
fn mode_of_preemption<'a>(version: &str, command_line: &'a str, switch: &'a str) -> Option<&'a str> {
    if version.contains("PREEMPT_RT") {
        return Some("rt");
    }
    // `none (voluntary) full lazy`: the one in brackets is in force.
    let in_force = switch.split_whitespace().find_map(|word| word.strip_prefix('(')?.strip_suffix(')'));
    let asked = command_line.split_whitespace().filter_map(|word| word.strip_prefix("preempt=")).next_back();
    let built_in = (version.contains("PREEMPT") && !version.contains("PREEMPT_DYNAMIC")).then_some("full");
    in_force.or(asked).or(built_in)
}

fn locked_memory(machine: &Machine, limit: Option<u64>, is_exempt: bool) -> Finding {
    let found = limit.map_or("unlimited".to_string(), |bytes| format!("limit {} MiB", bytes >> 20));
    if limit.is_none_or(|bytes| bytes >= LOCKED_BYTES) || is_exempt {
        return Finding::good("locked memory", found);
    }
    let cure = format!("{}, or give docker --ulimit memlock=-1", limit_cure(machine, "memlock unlimited"));
    Finding::weak("locked memory", found, cure)
}

/// Whether the engines have a memory to share: a tmpfs with room for a station, which this user may write.
fn shared_memory(machine: &Machine, room: Option<Room>) -> Finding {
    const WHAT: &str = "/dev/shm";
    let mount = "mount a tmpfs there: `mount -t tmpfs -o size=1g,mode=1777 tmpfs /dev/shm`";
    let Some(Room { size, free }) = room else { return Finding::bad(WHAT, "is not there", mount) };
    let found = format!("{} MiB free of {} MiB", free >> 20, size >> 20);
    let enough = size_for(size.saturating_sub(free).saturating_add(NEEDED_BYTES));
    let mounts = machine.text("/proc/mounts");
    // The last one that was mounted there is the one that is seen.
    let kind = mounts.lines().rev().find_map(|line| {
        let mut words = line.split(' ').skip(1);
        if words.next() == Some(WHAT) { words.next() } else { None }
    });
    if free < NEEDED_BYTES {
        let cure = format!(
            "free it (`ls -l /dev/shm`) or enlarge it: `mount -o remount,size={enough} /dev/shm`, docker: --shm-size={enough}"
        );
        Finding::bad(WHAT, found, cure)
    } else if !(machine.may)(&machine.path(WHAT), Access::WRITE_OK) {
        Finding::bad(WHAT, "may not be written by this user", "`chmod 1777 /dev/shm`, or mount it writable")
    } else if kind != Some("tmpfs") {
        let kind = kind.map_or("no mount of its own".to_string(), |kind| format!("a {kind}"));
        Finding::weak(
            WHAT,
            format!("{found}, but it is {kind}: what the engines share is written to a disk, and they wait for it"),
            mount,
        )
    } else {
        Finding::good(WHAT, format!("{found}, a tmpfs"))
    }
}

/// Whether an engine can be started from where the station keeps its own copies of those that were swapped.
fn copies(is_noexec: bool) -> Finding {
    const WHAT: &str = "engines' copies";
    if is_noexec {
        let found = "/dev/shm is mounted noexec: a swapped engine runs from its own file";
        Finding::weak(WHAT, found, "`mount -o remount,exec /dev/shm`, docker: --tmpfs /dev/shm:exec,size=1g")
    } else {
        Finding::good(WHAT, "can be run from /dev/shm")
    }
}

fn throttling(machine: &Machine) -> Finding {
    let text = machine.text("/proc/sys/kernel/sched_rt_runtime_us");
    let found = if text.trim().is_empty() { "unknown".to_string() } else { format!("sched_rt_runtime_us {}", text.trim()) };
    let granted_us: i64 = text.trim().parse().unwrap_or(-1);
    if (0..LEAST_RUNTIME_US).contains(&granted_us) {
        let cure = "`sysctl kernel.sched_rt_runtime_us=950000`: real-time threads need most of each second";
        Finding::weak("throttling", found, cure)
    } else {
        Finding::good("throttling", found)
    }
}

/// A folder into which sessions are recorded.
struct Recorded {
    folder: PathBuf,
    /// How it is called.
    name: String,
    /// This user records into it, and has to have the right to.
    is_own: bool,
}

impl Recorded {
    /// That in which this program was called.
    fn here() -> Recorded {
        Recorded { folder: PathBuf::from("."), name: "this folder".into(), is_own: true }
    }

    /// Those of the services, where their commands name one. A folder that is not there yet is made in the one above it, as a file is.
    fn by_services(machine: &Machine) -> Vec<Recorded> {
        let of_service = |(path, unit, is_own): (PathBuf, String, bool)| {
            let there = machine.path(&path);
            let above = there.parent().unwrap_or(there.as_path()).to_path_buf();
            let folder = if there.is_dir() { there } else { above };
            Recorded { folder, name: format!("{} of {unit}", path.display()), is_own }
        };
        devices::recordings(machine).into_iter().map(of_service).collect()
    }
}

/// Whether an hour can be recorded in a folder.
fn disk(machine: &Machine, Recorded { folder, name, is_own }: &Recorded, room: Option<Room>) -> Finding {
    let cure = "record elsewhere (`--record /another/disk/FILE.mcap`)";
    match room {
        None => Finding::weak("disk", format!("{name} is not there"), cure),
        Some(_) if *is_own && !(machine.may)(folder, Access::WRITE_OK) => {
            Finding::weak("disk", format!("{name} may not be written by this user: nothing can be recorded in it"), cure)
        }
        Some(Room { free, .. }) if free < HOUR_BYTES => {
            let cure = format!("free some, or {cure}: a full disk costs the recording, and not the force");
            Finding::weak("disk", format!("{} MiB free in {name}, less than an hour may take", free >> 20), cure)
        }
        Some(Room { free, .. }) => Finding::good("disk", format!("{} MiB free in {name}", free >> 20)),
    }
}

/// Roots and segments of stations of this user of which nobody lives.
fn leftovers() -> Finding {
    let roots = format!("hystation-{}-", system::user_id());
    let mut dead: Vec<String> = Vec::new();
    for entry in std::fs::read_dir(Path::new("/dev/shm")).into_iter().flatten().flatten() {
        let file = entry.file_name().to_string_lossy().into_owned();
        let Some(name) = file.strip_prefix(&roots) else {
            continue;
        };
        if hyst_exchange::Station::named(name).is_ok_and(|station| crate::remains::living(&station).is_empty()) {
            dead.push(name.to_string());
        }
    }
    match dead.first() {
        None => Finding::good("leftovers", "none of dead stations"),
        Some(first) => {
            let cure = format!("`hystation --name {first} stop` removes them, and so does the next run of that name");
            Finding::weak("leftovers", format!("of dead stations: {}", dead.join(", ")), cure)
        }
    }
}

#[cfg(test)]
mod tests;
