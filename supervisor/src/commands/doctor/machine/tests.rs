//! Machines that are made up, one fault each.

use super::*;
use crate::commands::doctor::State;
use crate::commands::doctor::made_up::MadeUp;

const ROOM: Room = Room { size: 8 << 30, free: 4 << 30 };

/// What was found, and the cure, in one line; empty if it is good.
fn complaint(finding: &Finding) -> (State, String) {
    (finding.state, finding.cure.as_ref().map_or(String::new(), |cure| format!("{}; {cure}", finding.found)))
}

/// A finding is of a state, and says these words.
fn assert_says(finding: Finding, state: State, words: &[&str]) {
    let said = complaint(&finding);
    assert!(said.0 == state && words.iter().all(|word| said.1.contains(word)), "{words:?}: {finding:?}");
}

fn assert_good(finding: Finding) {
    assert_eq!(complaint(&finding), (State::Good, String::new()), "{finding:?}");
}

#[test]
fn a_program_is_a_file_that_may_be_run() {
    let mut made = MadeUp::new("programs");
    let folder = made.0.path("bin");
    assert_says(programs(&made.0, &folder), State::Bad, &["device", "console", "missing", "./station build"]);
    for role in Role::ALL.iter().filter(|role| **role != Role::Haptic) {
        made.write(&format!("bin/{}", role.name()), "");
    }
    std::fs::create_dir(folder.join("haptic")).unwrap();
    assert_says(programs(&made.0, &folder), State::Bad, &["haptic of "]);
    std::fs::remove_dir(folder.join("haptic")).unwrap();
    made.write("bin/haptic", "");
    assert_good(programs(&made.0, &folder));
    made.0.may = |_, _| false;
    assert_says(programs(&made.0, &folder), State::Bad, &["hardware", "not to be run"]);
}

#[test]
fn real_time_that_is_granted_in_part_is_told_from_none_and_root_is_told_another_cure() {
    let made = MadeUp::new("real-time");
    let found = |granted: [bool; 2], is_root: bool| real_time(&made.0, granted, is_root, false);
    assert_good(found([true, true], false));
    assert_says(found([true, false], false), State::Weak, &["not up to priority 90", "rtprio 95"]);
    assert_says(found([false, false], false), State::Weak, &["is refused", "rtprio 95", "--cap-add SYS_NICE"]);
    let root = found([false, false], true);
    assert!(root.cure.as_ref().is_some_and(|cure| !cure.contains("run as root") && cure.contains("CAP_SYS_NICE")), "{root:?}");
}

/// Who had the right and was refused all the same was told to ask for the right.
#[test]
fn where_the_right_to_real_time_is_there_it_is_not_the_right_that_is_lacking() {
    let made = MadeUp::new("granted");
    assert_says(real_time(&made.0, [false, false], true, true), State::Weak, &["is refused", "--cpu-rt-runtime", "seccomp"]);
    assert_good(real_time(&made.0, [true, true], true, true));
    let status = |set: &str| format!("CapPrm:\tffff\nCapEff:\t{set}\n");
    assert!(may_be_nice(&status("000001ffffffffff")) && may_be_nice(&status("0000000000800000")));
    assert!(!may_be_nice(&status("00000000a80425fb")) && !may_be_nice(""), "docker gives its root no more than that");
}

/// Of docker's root it was said that it may lock its memory, which needs a right that docker does not give.
#[test]
fn locked_memory_is_enough_for_all_or_no_limit_binds_the_user() {
    let made = MadeUp::new("locked");
    assert_says(locked_memory(&made.0, Some(8 << 20), false), State::Weak, &["limit 8 MiB", "memlock unlimited"]);
    for (limit, is_exempt) in [(Some(8 << 20), true), (Some(LOCKED_BYTES), false), (None, false)] {
        assert_good(locked_memory(&made.0, limit, is_exempt));
    }
}

/// Who had the package, and was not in the group to which it grants the limits, was told to write once more what stands in its file.
#[test]
fn a_limit_is_had_by_its_line_its_group_and_a_login_and_the_cure_is_what_of_it_is_missing() {
    let made = MadeUp::new("limits");
    let cure = || limit_cure(&made.0, "rtprio 95");
    let line = "put `@users - rtprio 95` into /etc/security/limits.d/hystation.conf";
    let (join, again) = ("`sudo usermod -aG users $USER`", "log in again");
    assert_eq!(cure(), format!("{line} and {join} and {again}"));
    made.write("etc/group", "root:x:0:\nusers:x:100:\n");
    made.write("proc/self/status", "Name:\t100\nGid:\t1000\t1000\t1000\t1000\nGroups:\t24 100 1000 \n");
    assert_eq!(cure(), format!("{line} and {again}"));
    made.write("etc/security/limits.d/hystation.conf", include_str!("../../../../../assets/debian/limits.conf"));
    assert_eq!([cure(), limit_cure(&made.0, "memlock unlimited")], [again, again]);
    made.write("proc/self/status", "Name:\t100\nGid:\t1000\t1000\t1000\t1000\nGroups:\t10 1000 \n");
    assert_eq!(cure(), format!("{join} and {again}"));
    made.write("proc/self/status", "Gid:\t100\t100\t100\t100\nGroups:\t\n");
    assert_eq!(cure(), again, "it is the user's own group");
}

#[test]
fn shared_memory_is_a_tmpfs_with_room_that_may_be_written() {
    let mut made = MadeUp::new("shm");
    std::fs::create_dir_all(made.0.path("dev/shm")).unwrap();
    assert_says(shared_memory(&made.0, None), State::Bad, &["is not there", "mount -t tmpfs"]);
    assert_says(shared_memory(&made.0, Some(ROOM)), State::Weak, &["no mount of its own", "mount -t tmpfs"]);
    made.write("proc/mounts", "tmpfs /dev/shm tmpfs rw 0 0\n/dev/sda1 /dev/shm ext4 rw 0 0\n");
    assert_says(shared_memory(&made.0, Some(ROOM)), State::Weak, &["it is a ext4"]);
    made.write("proc/mounts", "/dev/sda1 /dev/shm ext4 rw 0 0\ntmpfs /dev/shm tmpfs rw 0 0\n");
    assert_good(shared_memory(&made.0, Some(ROOM)));
    let full = Room { free: crate::guardian::NEEDED_BYTES - 1, ..ROOM };
    assert_says(
        shared_memory(&made.0, Some(full)),
        State::Bad,
        &["607 MiB free of 8192 MiB", "remount,size=9g", "--shm-size=9g"],
    );
    made.0.may = |_, access| !access.contains(Access::WRITE_OK);
    assert_says(shared_memory(&made.0, Some(ROOM)), State::Bad, &["may not be written", "chmod 1777"]);
    assert_says(copies(true), State::Weak, &["/dev/shm is mounted noexec", "remount,exec"]);
    assert_good(copies(false));
}

#[test]
fn a_disk_has_room_for_an_hour_and_may_be_written() {
    let mut made = MadeUp::new("disk");
    let here = Recorded { folder: made.0.root.clone(), ..Recorded::here() };
    assert_good(disk(&made.0, &here, Some(ROOM)));
    assert_says(
        disk(&made.0, &here, Some(Room { free: 1 << 30, ..ROOM })),
        State::Weak,
        &["1024 MiB free in this folder, less", "an hour", "--record"],
    );
    assert_says(disk(&made.0, &here, None), State::Weak, &["this folder is not there"]);
    made.0.may = |_, _| false;
    assert_says(disk(&made.0, &here, Some(ROOM)), State::Weak, &["may not be written", "--record"]);
}

/// Only the folder in which it was called was looked at, and no service records there.
#[test]
fn the_folders_into_which_services_record_are_looked_at_and_who_is_to_write_into_them_is_known() {
    let mut made = MadeUp::new("recorded");
    made.set("HOME", "/home/ann");
    assert!(Recorded::by_services(&made.0).is_empty());
    let unit = |record: &str| format!("[Service]\nExecStart=/usr/bin/hystation --name service run polyp {record}\n");
    made.write("usr/lib/systemd/user/hystation.service", unit("--record=%h/sessions/"));
    made.write("usr/lib/systemd/system/hystation.service", unit("--record /var/lib/hystation/"));
    std::fs::create_dir_all(made.0.path("/home/ann")).unwrap();
    std::fs::create_dir_all(made.0.path("/var/lib/hystation")).unwrap();
    let [own, machines] = &Recorded::by_services(&made.0)[..] else { panic!("two services record") };
    assert_eq!(own.folder, made.0.path("/home/ann"), "the folder is made in there");
    assert_eq!(machines.folder, made.0.path("/var/lib/hystation"));
    let short = Some(Room { free: 1 << 30, ..ROOM });
    let said = ["1024 MiB free in /var/lib/hystation/ of hystation.service, less"];
    assert_says(disk(&made.0, machines, short), State::Weak, &said);
    made.0.may = |_, _| false;
    assert_good(disk(&made.0, machines, Some(ROOM)));
    let said = ["/home/ann/sessions/ of the user's hystation.service may not be written"];
    assert_says(disk(&made.0, own, Some(ROOM)), State::Weak, &said);
}

#[test]
fn throttled_real_time_threads_are_told_with_the_cure() {
    let made = MadeUp::new("throttled");
    for good in ["", "-1\n", "950000\n", "x"] {
        made.write("proc/sys/kernel/sched_rt_runtime_us", good);
        assert_good(throttling(&made.0));
    }
    made.write("proc/sys/kernel/sched_rt_runtime_us", "500000\n");
    assert_says(throttling(&made.0), State::Weak, &["sched_rt_runtime_us 500000", "950000"]);
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
    let made = MadeUp::new("preempt");
    made.write("proc/version", dynamic);
    assert_says(preemption(&made.0), State::Weak, &["not to be seen", "preempt=full"]);
    made.write("proc/cmdline", "quiet preempt=voluntary\n");
    assert_says(preemption(&made.0), State::Weak, &["voluntary", "preempt=full"]);
    made.write("sys/kernel/debug/sched/preempt", "none voluntary full (lazy)\n");
    assert_good(preemption(&made.0));
}
