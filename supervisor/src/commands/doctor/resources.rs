//! What the machine computes with: its processor, the cores and the memory that a container or a service leaves of it; and what of the kernel and its network a
//! station cannot do without.

use super::{Finding, Machine};
use hyst_exchange::system;
use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};

/// What a station should find free, bytes: half as much again as one of the default scene takes.
const MEMORY_BYTES: u64 = 1 << 30;
/// What the kernels of tissue, contact and flow are written for, as the kernel calls it; without one of these they take one number at a time.
const WANTED: [&str; 7] = ["avx", "avx2", "fma", "bmi1", "bmi2", "abm", "popcnt"];

/// All of them, in the order in which they are read.
pub fn findings(machine: &Machine) -> Vec<Finding> {
    vec![processor(machine), cores(machine, system::places()), memory(machine), calls(holds_itself()), page(listens())]
}

/// Whether the steps are computed with the instructions that they are measured with.
fn processor(machine: &Machine) -> Finding {
    const WHAT: &str = "processor";
    let text = machine.text("/proc/cpuinfo");
    let said = |key: &str| text.lines().find_map(|line| line.strip_prefix(key)?.trim_start().strip_prefix(':')).map(str::trim);
    let name = said("model name").unwrap_or("unknown");
    let Some(flags) = said("flags") else { return Finding::good(WHAT, name) };
    let missing: Vec<&str> = WANTED.into_iter().filter(|wanted| flags.split(' ').all(|flag| flag != *wanted)).collect();
    if missing.is_empty() {
        return Finding::good(WHAT, name);
    }
    Finding::weak(
        WHAT,
        format!("{name}, without {}: steps take several times as long", missing.join(", ")),
        "in a virtual machine let it have the host's processor (qemu: `-cpu host`, Proxmox: type host); else a processor that has AVX2, as most since 2015",
    )
}

/// Cores that this process may run on, and what a container's or a service's quota leaves of them.
fn cores(machine: &Machine, count: usize) -> Finding {
    let found = format!("{count}");
    match quota_cores(machine) {
        _ if count < 2 => Finding::weak("cores", found, "give the station two cores: the two servos belong on different ones"),
        Some(quota) if quota < 2.0 => Finding::weak(
            "cores",
            format!("{found}, of which a quota leaves the time of {quota:.1}"),
            "raise it to two cores: docker --cpus=2, systemd CPUQuota=200%; what is above it stands still until the next period",
        ),
        _ => Finding::good("cores", found),
    }
}

/// The least quota among this process' control groups and those above them, in cores.
fn quota_cores(machine: &Machine) -> Option<f64> {
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|number| *number > 0.0);
    let ratio = |quota_us: &str, period_us: &str| Some(number(quota_us)? / number(period_us)?);
    let of_group = groups(machine, "").into_iter().filter_map(|group| {
        let text = machine.text(group.join("cpu.max"));
        let (quota_us, period_us) = text.trim().split_once(' ')?;
        ratio(quota_us, period_us)
    });
    let of_controller = groups(machine, "cpu")
        .into_iter()
        .filter_map(|group| ratio(&machine.text(group.join("cpu.cfs_quota_us")), &machine.text(group.join("cpu.cfs_period_us"))));
    of_group.chain(of_controller).min_by(f64::total_cmp)
}

/// The folders of this process' control group and of those above it. In the first version each controller has groups of its own; in the second there is none.
fn groups(machine: &Machine, controller: &str) -> Vec<PathBuf> {
    let text = machine.text("/proc/self/cgroup");
    let own = text.lines().find_map(|line| {
        let mut parts = line.splitn(3, ':').skip(1);
        let (controllers, group) = (parts.next()?, parts.next()?);
        controllers.split(',').any(|known| known == controller).then_some(group)
    });
    let folder = Path::new("/sys/fs/cgroup").join(controller);
    let above = Path::new(own.unwrap_or("/")).ancestors().filter_map(|group| group.strip_prefix("/").ok());
    above.map(|group| folder.join(group)).collect()
}

/// Whether a station has memory beside what others have: shared memory counts as the container's or the service's that touches it.
fn memory(machine: &Machine) -> Finding {
    const WHAT: &str = "memory";
    let number = |path: PathBuf| machine.text(path).trim().parse::<u64>().ok();
    let of_group = groups(machine, "").into_iter().filter_map(|group| number(group.join("memory.max")));
    let of_controller = groups(machine, "memory").into_iter().filter_map(|group| number(group.join("memory.limit_in_bytes")));
    let text = machine.text("/proc/meminfo");
    let kib =
        text.lines().find_map(|line| line.strip_prefix("MemAvailable:")?.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
    let available = kib.map(|kib| kib << 10);
    if let Some(limit) = of_group.chain(of_controller).min().filter(|limit| *limit < MEMORY_BYTES) {
        return Finding::weak(
            WHAT,
            format!("a limit of {} MiB, for /dev/shm too: where it is met the kernel ends a process", limit >> 20),
            "raise it: docker --memory=2g, systemd MemoryMax=2G",
        );
    }
    match available {
        None => Finding::good(WHAT, "unknown"),
        Some(bytes) if bytes < MEMORY_BYTES => Finding::weak(
            WHAT,
            format!("{} MiB available, and a station takes some 700: where there is none the kernel ends a process", bytes >> 20),
            "end other programs, or give the machine more memory",
        ),
        Some(bytes) => Finding::good(WHAT, format!("{} MiB available", bytes >> 20)),
    }
}

/// Whether a process can be held by a descriptor, by which each death is seen and nobody else is ended; else what the system says.
fn holds_itself() -> Result<(), String> {
    let opened = rustix::process::pidfd_open(rustix::process::getpid(), rustix::process::PidfdFlags::empty());
    opened.map(drop).map_err(|error| std::io::Error::from(error).to_string())
}

fn calls(held: Result<(), String>) -> Finding {
    const WHAT: &str = "system calls";
    match held {
        Ok(()) => Finding::good(WHAT, "processes can be held by descriptors"),
        Err(error) => Finding::bad(
            WHAT,
            format!("pidfd_open: {error}: no process can be kept"),
            "Linux 5.3 or later; in a container docker 20.10 or later, or --security-opt seccomp=unconfined",
        ),
    }
}

/// Whether the operator's page can be listened for; else what the system says.
fn listens() -> Result<(), String> {
    TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).map(drop).map_err(|error| error.to_string())
}

fn page(listened: Result<(), String>) -> Finding {
    const WHAT: &str = "operator's page";
    match listened {
        Ok(()) => Finding::good(WHAT, "127.0.0.1 has a port for it"),
        Err(error) => Finding::weak(
            WHAT,
            format!("127.0.0.1 has no port ({error}): there is none, and nobody judges a case"),
            "bring the loopback interface up: `ip link set lo up`; else run with --set console=off",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::doctor::State;
    use crate::commands::doctor::made_up::MadeUp;

    /// A finding is of a state, and it and its cure say these words.
    fn assert_says(finding: &Finding, state: State, words: &[&str]) {
        let said = format!("{}; {}", finding.found, finding.cure.as_deref().unwrap_or_default());
        assert!(finding.state == state && words.iter().all(|word| said.contains(word)), "{words:?}: {finding:?}");
        assert_eq!(finding.cure.is_none(), state == State::Good, "{finding:?}");
    }

    /// Virtual machines hide them from their guests more often than processors lack them.
    #[test]
    fn a_processor_without_the_instructions_of_the_kernels_is_told_which_it_lacks() {
        let made = MadeUp::new("processor");
        assert_says(&processor(&made.0), State::Good, &["unknown"]);
        let write = |flags: &str| {
            let of_one =
                |number: usize| format!("processor\t: {number}\nmodel name\t: A CPU @ 2 GHz\nflags\t\t: {flags}\nbugs\t:\n\n");
            made.write("proc/cpuinfo", of_one(0) + &of_one(1));
        };
        write("fpu avx avx2 fma bmi1 bmi2 abm popcnt avx512f");
        assert_says(&processor(&made.0), State::Good, &["A CPU @ 2 GHz"]);
        write("fpu sse2 avx bmi1 bmi2 abm popcnt avx2x");
        assert_says(&processor(&made.0), State::Weak, &["without avx2, fma:", "-cpu host"]);
    }

    #[test]
    fn cores_are_counted_and_a_quota_of_the_group_or_of_one_above_it_is_said() {
        let made = MadeUp::new("cores");
        assert_says(&cores(&made.0, 2), State::Good, &["2"]);
        assert_says(&cores(&made.0, 1), State::Weak, &["two cores"]);
        made.write("proc/self/cgroup", "1:cpu:/old\n0::/user.slice/a.service\n");
        made.write("sys/fs/cgroup/user.slice/a.service/cpu.max", "max 100000\n");
        assert_says(&cores(&made.0, 4), State::Good, &["4"]);
        made.write("sys/fs/cgroup/user.slice/cpu.max", "150000 100000\n");
        assert_says(&cores(&made.0, 4), State::Weak, &["leaves the time of 1.5", "--cpus=2"]);
        for nonsense in ["", "x y", "100000 0", "-", "max"] {
            made.write("sys/fs/cgroup/user.slice/cpu.max", nonsense);
            assert_says(&cores(&made.0, 4), State::Good, &["4"]);
        }
    }

    #[test]
    fn the_quotas_of_groups_of_the_first_version_count_too_also_where_a_container_sees_its_own_as_the_root() {
        let made = MadeUp::new("cores-v1");
        made.write("proc/self/cgroup", "5:memory:/docker/x\n4:cpu,cpuacct:/docker/x\n1:name=systemd:/docker/x\n");
        made.write("sys/fs/cgroup/cpu/cpu.cfs_period_us", "100000\n");
        made.write("sys/fs/cgroup/cpu/cpu.cfs_quota_us", "-1\n");
        assert_says(&cores(&made.0, 8), State::Good, &["8"]);
        made.write("sys/fs/cgroup/cpu/cpu.cfs_quota_us", "50000\n");
        assert_says(&cores(&made.0, 8), State::Weak, &["8, of which a quota leaves the time of 0.5"]);
    }

    #[test]
    fn memory_is_what_the_machine_has_left_or_a_limit_leaves() {
        let made = MadeUp::new("memory");
        assert_says(&memory(&made.0), State::Good, &["unknown"]);
        made.write("proc/meminfo", "MemTotal: 99 kB\nMemAvailable:    2097152 kB\n");
        assert_says(&memory(&made.0), State::Good, &["2048 MiB available"]);
        made.write("proc/self/cgroup", "5:memory:/docker/x\n0::/a\n");
        made.write("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n");
        made.write("sys/fs/cgroup/a/memory.max", "max\n");
        assert_says(&memory(&made.0), State::Good, &["2048 MiB available"]);
        made.write("sys/fs/cgroup/memory.max", "536870912\n");
        assert_says(&memory(&made.0), State::Weak, &["a limit of 512 MiB", "--memory=2g"]);
        made.write("sys/fs/cgroup/memory.max", "8589934592\n");
        made.write("proc/meminfo", "MemAvailable: 409600 kB\n");
        assert_says(&memory(&made.0), State::Weak, &["400 MiB available", "end other programs"]);
        made.write("sys/fs/cgroup/memory/docker/x/memory.limit_in_bytes", "268435456\n");
        assert_says(&memory(&made.0), State::Weak, &["a limit of 256 MiB"]);
    }

    #[test]
    fn what_a_kernel_or_a_container_refuses_is_told_and_this_one_holds_its_own_process() {
        assert_says(
            &calls(Err("Operation not permitted".into())),
            State::Bad,
            &["pidfd_open: Operation not", "Linux 5.3", "seccomp"],
        );
        assert_says(&calls(holds_itself()), State::Good, &["descriptors"]);
        assert_says(&page(Err("Cannot assign".into())), State::Weak, &["no port (Cannot assign)", "ip link set lo up"]);
        assert_says(&page(Ok(())), State::Good, &["127.0.0.1"]);
    }
}
