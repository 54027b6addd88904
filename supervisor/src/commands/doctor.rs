//! `hystation doctor`: is this machine fit for a station, and the cure for each thing that is not. Nothing is changed.

use crate::settings::Refusal;
use hyst_exchange::system;
use hyst_messages::Role;
use rustix::fs::{Access, StatVfsMountFlags};
use rustix::process::{Resource, getrlimit};
use std::path::Path;

/// Memory that the real-time processes lock together, bytes.
const LOCKED_BYTES: u64 = 256 << 20;

/// More than an hour of a recording takes, bytes: it may take 1 MB a second.
const HOUR_BYTES: u64 = 3_600_000_000;

/// One finding.
struct Finding {
    what: &'static str,
    found: String,
    /// What to do; `None` if it is good.
    cure: Option<String>,
    /// A station runs without it, though worse.
    is_optional: bool,
}

fn finding(what: &'static str, found: String, good: bool, is_optional: bool, cure: &str) -> Finding {
    Finding { what, found, cure: (!good).then(|| cure.to_string()), is_optional }
}

/// Looks at the machine; exit code 1 if a station cannot run on it.
pub fn doctor() -> Result<u8, Refusal> {
    let findings = [
        programs(),
        cores(),
        real_time(),
        preemption(),
        locked_memory(),
        shared_memory(),
        copies(),
        throttling(),
        disk(),
        pictures(),
        display(),
        leftovers(),
    ];
    for finding in &findings {
        let mark = match (&finding.cure, finding.is_optional) {
            (None, _) => "good",
            (Some(_), true) => "weak",
            (Some(_), false) => "bad ",
        };
        println!("{mark}  {:<16} {}", finding.what, finding.found);
        if let Some(cure) = &finding.cure {
            println!("      {:<16} cure: {cure}", "");
        }
    }
    Ok(u8::from(findings.iter().any(|finding| finding.cure.is_some() && !finding.is_optional)))
}

/// The engines, and the simulated device among them, lie beside this program.
fn programs() -> Finding {
    let folder = std::env::current_exe().ok().and_then(|program| program.parent().map(Path::to_path_buf)).unwrap_or_default();
    let engines = Role::ALL.iter().filter(|role| !matches!(role, Role::Supervisor | Role::Guardian));
    let missing: Vec<&str> = engines.map(|role| role.name()).filter(|name| !is_program(&folder.join(name))).collect();
    let found = match missing.as_slice() {
        [] => format!("every engine, and the simulated device, in {}", folder.display()),
        missing => format!("{} of {} missing or not to be run", missing.join(", "), folder.display()),
    };
    finding("programs", found, missing.is_empty(), false, "`./station build`, or install the package again")
}

fn is_program(path: &Path) -> bool {
    rustix::fs::access(path, Access::EXEC_OK).is_ok() && path.is_file()
}

fn cores() -> Finding {
    let cores = system::cores();
    finding("cores", format!("{cores}"), cores >= 2, true, "give the station two cores: the two servos belong on different ones")
}

fn real_time() -> Finding {
    // Asked of a thread that ends at once, so that nothing here runs in real time.
    let granted = std::thread::spawn(|| system::become_fifo(1)).join().unwrap_or(false);
    let found =
        if granted { "SCHED_FIFO is granted" } else { "SCHED_FIFO is refused; the station runs without it, with more misses" };
    let cure = "run as root, or put `@users - rtprio 95` into /etc/security/limits.d/hystation.conf and log in again, or give docker \
                --cap-add SYS_NICE";
    finding("real time", found.into(), granted, true, cure)
}

/// Whether the kernel lets go of a core while it works for somebody: the start and the end of a large process keep it busy for up to a millisecond.
fn preemption() -> Finding {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let [version, command_line, switch] = ["/proc/version", "/proc/cmdline", "/sys/kernel/debug/sched/preempt"].map(read);
    let mode = mode_of_preemption(&version, &command_line, &switch);
    let good = mode.is_some_and(|mode| matches!(mode, "rt" | "full" | "lazy"));
    let found = mode.map_or("not to be seen (/sys/kernel/debug/sched/preempt)".to_string(), str::to_string);
    let cure = "add `preempt=full` to the kernel's command line: else the start and the end of a large process (rendering) hold a core for up to 1 ms, and \
                single ticks come late";
    finding("preemption", found, good, true, cure)
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

fn locked_memory() -> Finding {
    let limit = getrlimit(Resource::Memlock).current;
    let good = limit.is_none_or(|bytes| bytes >= LOCKED_BYTES) || system::user_id() == 0;
    let found = limit.map_or("unlimited".to_string(), |bytes| format!("limit {} MiB", bytes >> 20));
    let cure = "put `@users - memlock unlimited` into /etc/security/limits.d/hystation.conf and log in again, or give docker --ulimit memlock=-1";
    finding("locked memory", found, good, true, cure)
}

fn shared_memory() -> Finding {
    let cure = "free it (`ls -l /dev/shm`) or enlarge it: `mount -o remount,size=1g /dev/shm`, docker: --shm-size=1g";
    match rustix::fs::statvfs("/dev/shm") {
        Ok(disk) => {
            let (size, free) = (disk.f_blocks * disk.f_frsize, disk.f_bavail * disk.f_frsize);
            finding(
                "/dev/shm",
                format!("{} MiB free of {} MiB", free >> 20, size >> 20),
                free >= crate::guardian::NEEDED_BYTES,
                false,
                cure,
            )
        }
        Err(error) => {
            finding("/dev/shm", format!("{error}"), false, false, "mount a tmpfs there: `mount -t tmpfs tmpfs /dev/shm`")
        }
    }
}

/// Whether an engine can be started from where the station keeps its own copies of those that were swapped.
fn copies() -> Finding {
    let is_noexec = rustix::fs::statvfs("/dev/shm").is_ok_and(|mounted| mounted.f_flag.contains(StatVfsMountFlags::NOEXEC));
    let found = if is_noexec {
        "/dev/shm is mounted noexec: a swapped engine runs from its own file"
    } else {
        "can be run from /dev/shm"
    };
    finding(
        "engines' copies",
        found.into(),
        !is_noexec,
        true,
        "`mount -o remount,exec /dev/shm`, docker: --tmpfs /dev/shm:exec,size=1g",
    )
}

/// Whether an hour can be recorded here.
fn disk() -> Finding {
    let cure =
        "free some, or record elsewhere (`--record /another/disk/FILE.mcap`): a full disk costs the recording, and not the force";
    match rustix::fs::statvfs(".") {
        Ok(disk) => {
            let free = disk.f_bavail * disk.f_frsize;
            finding("disk", format!("{} MiB free in this folder", free >> 20), free >= HOUR_BYTES, true, cure)
        }
        Err(error) => finding("disk", format!("this folder: {error}"), false, true, cure),
    }
}

fn throttling() -> Finding {
    let text = std::fs::read_to_string("/proc/sys/kernel/sched_rt_runtime_us").unwrap_or_default();
    let found = if text.trim().is_empty() { "unknown".to_string() } else { format!("sched_rt_runtime_us {}", text.trim()) };
    let granted_us: i64 = text.trim().parse().unwrap_or(-1);
    let good = !(0..900_000).contains(&granted_us);
    finding(
        "throttling",
        found,
        good,
        true,
        "`sysctl kernel.sched_rt_runtime_us=950000`: real-time threads need most of each second",
    )
}

fn pictures() -> Finding {
    let folders = ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d"];
    let drivers: Vec<String> = folders
        .iter()
        .filter_map(|folder| std::fs::read_dir(folder).ok())
        .flat_map(|entries| entries.flatten())
        .map(|entry| entry.file_name().to_string_lossy().trim_end_matches(".json").to_string())
        .collect();
    let found = if drivers.is_empty() { "no Vulkan driver: there are no pictures".into() } else { drivers.join(", ") };
    finding(
        "Vulkan",
        found,
        !drivers.is_empty(),
        true,
        "`apt install mesa-vulkan-drivers libvulkan1`: the software driver is enough",
    )
}

fn display() -> Finding {
    let display =
        ["DISPLAY", "WAYLAND_DISPLAY"].iter().find_map(|name| std::env::var(name).ok().filter(|value| !value.is_empty()));
    let found = display.unwrap_or_else(|| "none: the station runs headless, with a scripted hand".into());
    finding("display", found, true, true, "")
}

/// Roots and segments of stations of this user of which nobody lives.
fn leftovers() -> Finding {
    let user = system::user_id();
    let roots = format!("hystation-{user}-");
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
    let found = if dead.is_empty() { "none of dead stations".into() } else { format!("of dead stations: {}", dead.join(", ")) };
    let cure = format!(
        "`hystation --name {} stop` removes them, and so does the next run of that name",
        dead.first().map_or("NAME", String::as_str)
    );
    finding("leftovers", found, dead.is_empty(), true, &cure)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_is_a_file_that_may_be_run() {
        let folder = std::env::temp_dir().join(format!("hystation-doctor-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("text"), "").unwrap();
        assert!(is_program(&std::env::current_exe().unwrap()));
        assert!(![&folder, &folder.join("text"), &folder.join("none")].iter().any(|path| is_program(path)));
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn the_mode_of_preemption_is_read_from_whatever_says_it() {
        let dynamic = "Linux version 6.18 #1 SMP PREEMPT_DYNAMIC";
        assert_eq!(mode_of_preemption("Linux version 6.1 #1 SMP PREEMPT_RT", "", ""), Some("rt"));
        assert_eq!(mode_of_preemption(dynamic, "quiet preempt=none", "none voluntary (full) lazy\n"), Some("full"));
        assert_eq!(mode_of_preemption(dynamic, "preempt=full quiet preempt=none", ""), Some("none"));
        assert_eq!(mode_of_preemption("Linux version 6.1 #1 SMP PREEMPT", "quiet", ""), Some("full"));
        assert_eq!(mode_of_preemption(dynamic, "quiet", ""), None);
        assert_eq!(mode_of_preemption("Linux version 6.1 #1 SMP", "quiet", ""), None);
    }
}
