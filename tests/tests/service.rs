//! The unit under a real systemd, booted here in namespaces of its own and with no other unit than ours: it is ready when the station is, a guardian that is killed or stands still is
//! replaced, together with its supervisor too, while the engines go on, and a stop leaves nothing. One command runs a class; one that finds no room waits for it, and
//! one that is refused is not tried again.

use hyst_messages::page;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use station_tests::shown::not_shown;
use station_tests::{Folder, RECOVERY_LIMIT, binaries, hystation, run, wait_for};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// Cgroup hierarchies that a systemd keeps its books in; each gets a folder of its own, lest two systemds meet there. The others stay as they are: a
/// new group has no share of real time.
const HIERARCHIES: &str = "systemd pids memory unified";
/// A systemd with nothing to start is up within a second.
const BOOT_LIMIT: Duration = Duration::from_secs(120);
/// Three starts of the service and two sessions of 4 s: each begins when the hand first moves, and ends with the last look at it.
const CLASS_LIMIT: Duration = Duration::from_secs(300);
/// Our station's name in the unit.
const NAME: &str = "service";

/// A systemd of the test's own.
struct Manager {
    child: Child,
    /// Its id outside.
    pid: u32,
    folder: Folder,
}

/// Its folder in each hierarchy.
fn cgroup(folder: &Folder) -> String {
    folder.as_path().file_name().expect("a name").to_string_lossy().into_owned()
}

fn boot_script(cgroup: &str) -> String {
    format!(
        "for h in {HIERARCHIES}; do d=/sys/fs/cgroup/$h/{cgroup}; mkdir -p $d 2>/dev/null && echo $$ >$d/cgroup.procs 2>/dev/null; done
         exec unshare --mount --pid --fork --kill-child --mount-proc --ipc --uts --cgroup sh -ec '
            mount --make-rprivate /
            for h in {HIERARCHIES}; do
                [ -d /sys/fs/cgroup/$h/{cgroup} ] || continue
                case $h in systemd) o=none,name=systemd; t=cgroup ;; unified) o=rw; t=cgroup2 ;; *) o=$h; t=cgroup ;; esac
                umount -l /sys/fs/cgroup/$h
                mount -t $t -o $o none /sys/fs/cgroup/$h
            done
            mount -t tmpfs run /run
            mount -t tmpfs shm /dev/shm
            # No unit of the machine: those would set up and clean the machine itself.
            for d in /lib/systemd/system /etc/systemd/system /lib/systemd/system-generators /etc/systemd/system-generators; do
                [ ! -d $d ] || mount -t tmpfs units $d
            done
            mkdir -p /run/systemd/system
            cp \"$0\"/*.service \"$0\"/*.target /run/systemd/system/
            exec env container=unshare /lib/systemd/systemd --system --unit=alone.target --show-status=no --log-target=null
         ' \"$0\""
    )
}

impl Manager {
    /// Boots one that knows the unit; `None` where there is no systemd, or no right to the namespaces.
    fn boot() -> Option<Manager> {
        let folder = Folder::new("service");
        let unit = include_str!("../../assets/systemd/hystation.service")
            .replace("/opt/hystation/bin", &binaries().display().to_string());
        folder.write("hystation.service", &unit);
        for target in ["alone", "sysinit", "basic", "shutdown"] {
            folder.write(&format!("{target}.target"), "[Unit]\nDescription=nothing else\nDefaultDependencies=no\n");
        }
        // Elsewhere another systemd keeps the cgroups, and lets no second one in.
        let has = |path: &str| std::path::Path::new(path).exists();
        let may = rustix::process::geteuid().is_root() && has("/lib/systemd/systemd") && has("/sys/fs/cgroup/systemd");
        let namespaces = ["--mount", "--pid", "--fork", "--ipc", "--uts", "--cgroup", "mount", "-t", "tmpfs", "try", "/run"];
        if !may || has("/run/systemd/system") || run(Command::new("unshare").args(namespaces)).0 != Some(0) {
            not_shown("the unit under systemd, which takes root, namespaces, cgroups of version 1, and no systemd that runs");
            return None;
        }
        let mut command = Command::new("sh");
        command.args(["-c", &boot_script(&cgroup(&folder))]).arg(folder.as_path()).env_remove("NOTIFY_SOCKET");
        let log = std::fs::File::create(folder.as_path().join("boot.log")).expect("a log");
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(log).spawn().expect("sh");
        let mut manager = Manager { pid: 0, child, folder };
        let children = format!("/proc/{0}/task/{0}/children", manager.child.id());
        let up = wait_for(BOOT_LIMIT, || {
            let pid = std::fs::read_to_string(&children).ok()?.trim().parse().ok()?;
            manager.pid = pid;
            let (_, state, _) = manager.inside("systemctl is-system-running");
            (state.trim() == "running").then_some(())
        });
        assert!(up.is_some(), "systemd does not boot: {}", manager.folder.read("boot.log"));
        Some(manager)
    }

    /// Runs a command line beside it.
    fn inside(&self, script: &str) -> (Option<i32>, String, String) {
        let pid = self.pid.to_string();
        run(Command::new("nsenter").args(["-t", &pid, "-m", "-p", "-i", "-u", "sh", "-c", script]))
    }

    fn hystation(&self, arguments: &str) -> (Option<i32>, String, String) {
        self.inside(&format!("'{}' --name {NAME} {arguments}", binaries().join("hystation").display()))
    }

    /// The unit names neither scene nor case, and the station runs the one that is built in.
    fn assert_default_scene(&self) {
        let root = std::path::PathBuf::from(format!("/proc/{}/root/dev/shm/hystation-0-{NAME}", self.pid));
        let settings = std::fs::read_to_string(root.join("settings.toml")).expect("the station's settings");
        let settings: hyst_engine::Settings = toml::from_str(&settings).expect("settings");
        assert_eq!((settings.scene, settings.case, settings.hand.as_str()), (None, None, "script:press"));
        let page = std::fs::read(root.join("pages/station.page")).expect("the station's page");
        let at = 4 * page::WORDS32 + 8 * page::station::SCENE_HASH;
        let hash = page.get(at..at + 8).and_then(|bytes| bytes.try_into().ok()).map(u64::from_ne_bytes);
        let built_in = hyst_scene::load_embedded().expect("the scene that is built in").hash;
        assert_eq!(hash, Some(built_in), "another scene than the default one");
    }

    /// Has the service run another command, as `systemctl edit` does.
    fn edit(&self, command: &str) {
        let program = binaries().join("hystation").display().to_string();
        let words = format!("[Service]\nExecStart=\nExecStart={program} --name {NAME} run --headless {command}\n");
        let (file, place) = (self.folder.write("edited.conf", &words), "/run/systemd/system/hystation.service.d");
        let copied = format!("mkdir -p {place} && cp '{file}' {place}/ && systemctl daemon-reload");
        let (code, _, said) = self.inside(&format!("{copied} && {{ systemctl reset-failed hystation || true; }}"));
        assert_eq!(code, Some(0), "{said}");
    }

    /// A property of the service.
    fn show(&self, property: &str) -> String {
        self.inside(&format!("systemctl show -p {property} --value hystation")).1.trim().to_string()
    }

    /// The pids of all processes of the station, as they are numbered inside; nothing while one of them is not ready.
    fn processes(&self) -> Option<BTreeMap<String, i64>> {
        let (code, out, _) = self.hystation("status --json");
        let status: Value = serde_json::from_str(&out).ok().filter(|_| code == Some(0))?;
        let rows = status["processes"].as_array()?;
        let is_ready = |row: &Value| matches!(row["state"].as_str(), Some("live" | "spare"));
        rows.iter().map(|row| is_ready(row).then(|| Some((row["name"].as_str()?.into(), row["pid"].as_i64()?)))?).collect()
    }

    /// Sends signals to keepers, and waits until others keep the station under a unit that is active, and no engine was touched.
    fn hurt(&self, signal: &str, keepers: &[&str]) {
        let whole = || wait_for(RECOVERY_LIMIT, || self.processes());
        let before = whole().unwrap_or_else(|| panic!("{signal}: the station is not whole: {}", self.hystation("status").1));
        let pids: Vec<String> = keepers.iter().map(|keeper| before[*keeper].to_string()).collect();
        assert_eq!(self.show("MainPID"), before["guardian"].to_string(), "before {signal} {keepers:?}");
        let (code, _, said) = self.inside(&format!("kill -s {signal} {}", pids.join(" ")));
        assert_eq!(code, Some(0), "{said}");
        let replaced = || {
            let now = self.processes()?;
            let is_new = keepers.iter().all(|keeper| now[*keeper] != before[*keeper]);
            let is_active = self.show("ActiveState") == "active" && self.show("MainPID") == now["guardian"].to_string();
            (is_new && is_active).then_some(now)
        };
        let after = wait_for(RECOVERY_LIMIT, replaced).unwrap_or_else(|| {
            panic!("{signal} {keepers:?}: {}\n{}", self.inside("systemctl status hystation").1, self.hystation("logs").1)
        });
        let engines = |all: &BTreeMap<String, i64>| {
            let is_engine = |name: &String| !matches!(name.as_str(), "guardian" | "supervisor");
            all.iter().filter(|(name, _)| is_engine(name)).map(|(name, pid)| (name.clone(), *pid)).collect::<Vec<_>>()
        };
        assert_eq!(engines(&after), engines(&before), "{signal} {keepers:?}: engines were touched\n{}", self.hystation("logs").1);
    }
}

impl Drop for Manager {
    fn drop(&mut self) {
        // All that live in its namespace go with the first process of it.
        if let Some(first) = i32::try_from(self.pid).ok().and_then(Pid::from_raw) {
            let _ = kill_process(first, Signal::KILL); // gone is as good
        } else {
            let _ = self.child.kill();
        }
        let _ = self.child.wait();
        for hierarchy in HIERARCHIES.split(' ') {
            let folder = format!("/sys/fs/cgroup/{hierarchy}/{}", cgroup(&self.folder));
            let _ = run(Command::new("find").args([&folder, "-depth", "-type", "d", "-exec", "rmdir", "{}", ";"])); // absent is as good
        }
    }
}

/// The recordings in a folder, the oldest first, as they are named.
fn recordings(folder: &Path) -> Vec<PathBuf> {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut files: Vec<PathBuf> = files.filter(|file| file.extension().is_some_and(|end| end == "mcap")).collect();
    files.sort();
    files
}

/// What follows `run` in the handbook's command for a class by a service of the machine.
fn class_command() -> String {
    let handbook = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/handbook.md");
    let text = std::fs::read_to_string(handbook).expect("the handbook");
    let rests = text.split("ExecStart=/usr/bin/hystation --name service run ").skip(1);
    let mut commands = rests.filter_map(|rest| rest.split('`').next());
    commands.find(|command| command.contains("/var/lib/")).expect("a command for a class").to_string()
}

/// One session follows the other, each in a file of its own, and with its page beside that before the next one begins.
fn assert_class(manager: &Manager) {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets");
    let text = std::fs::read_to_string(assets.join("cases/navigation.toml")).expect("a case");
    let scene = assets.join("scenes/default.toml").display().to_string();
    let text = text.replace("time_s = 240.0", "time_s = 4.0").replace("../scenes/default.toml", &scene);
    let (case, folder) = (manager.folder.write("short.toml", &text), manager.folder.as_path().join("class"));
    let place = format!("{}/", folder.display());
    let mut command = class_command();
    for (in_class, here) in [("polyp", case.as_str()), ("gamepad", "script:press"), ("/var/lib/hystation/", place.as_str())] {
        assert!(command.contains(in_class), "{command} has no {in_class}");
        command = command.replace(in_class, here);
    }
    manager.edit(&format!("{command} --set console_port=0 --set trainee=Anna"));
    let (code, _, said) = manager.inside("systemctl start hystation");
    assert_eq!(code, Some(0), "{said}\n{}", manager.inside("systemctl status hystation").1);
    // The third has begun: two are over.
    let begun = wait_for(CLASS_LIMIT, || (recordings(&folder).len() >= 3).then_some(()));
    assert!(begun.is_some(), "{:?}\n{}", recordings(&folder), manager.inside("systemctl status hystation").1);
    let (code, _, said) = manager.inside("systemctl stop hystation");
    assert_eq!(code, Some(0), "{said}");
    for file in recordings(&folder).iter().take(2) {
        assert!(file.to_string_lossy().ends_with("-short-anna.mcap"), "{}", file.display());
        let page = std::fs::read_to_string(file.with_extension("html")).expect("the page of the session beside it");
        assert!(page.contains("<h2>Case: Navigation</h2>") && page.contains("Anna"), "{}: {page}", file.display());
        let (code, report, said) = run(hystation().args(["report", "--json", "-"]).arg(file));
        let report: Value = serde_json::from_str(&report).unwrap_or_else(|error| panic!("{code:?} {error}: {said}"));
        assert_eq!(report["case"]["ended"]["by"], "time", "{}: {said}", file.display());
    }
}

/// A shared memory that others have filled ends no service: it waits, is tried again, and starts once there is room.
fn assert_waits_for_room(manager: &Manager) {
    manager.edit("--hand script:press");
    let status = || manager.inside("systemctl status hystation").1;
    let fill = "mount -o remount,size=768m /dev/shm && fallocate -l 256M /dev/shm/others";
    let (code, _, said) = manager.inside(&format!("{fill} && systemctl start --no-block hystation"));
    assert_eq!(code, Some(0), "{said}");
    let waits = || manager.show("ActiveState") == "activating" && manager.show("NRestarts") == "0";
    let says_so = || wait_for(RECOVERY_LIMIT, || (waits() && manager.show("StatusText").contains("room")).then_some(()));
    assert!(says_so().is_some(), "{}", status());
    let (code, _, said) = manager.inside("systemctl stop hystation");
    let ended = (code, manager.show("ActiveState"), manager.show("Result"));
    assert_eq!(ended, (Some(0), "inactive".into(), "success".into()), "stopped while it waits: {said}\n{}", status());
    let (code, _, said) = manager.inside("systemctl start --no-block hystation");
    assert_eq!(code, Some(0), "{said}");
    assert!(says_so().is_some(), "{}", status());
    let tried_again = wait_for(RECOVERY_LIMIT, || (manager.show("NRestarts") != "0").then_some(()));
    assert!(tried_again.is_some(), "{}", status());
    let (code, _, said) = manager.inside("rm /dev/shm/others");
    assert_eq!(code, Some(0), "{said}");
    let started = wait_for(RECOVERY_LIMIT, || (manager.show("ActiveState") == "active").then_some(()));
    assert!(started.is_some() && manager.processes().is_some(), "{}", status());
    assert_stops(manager);
}

/// What is refused once is refused again, and is not tried.
fn assert_refusal_ends(manager: &Manager) {
    // Nobody can record into /proc; and a session is no script's because it is a service's, which has no window.
    let case = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/cases/polyp.toml").display().to_string();
    for command in ["--record /proc/", case.as_str()] {
        manager.edit(command);
        let (code, ..) = manager.inside("systemctl start hystation");
        assert_ne!(code, Some(0), "{command} is refused");
        let failed = wait_for(RECOVERY_LIMIT, || (manager.show("ActiveState") == "failed").then_some(()));
        assert!(failed.is_some(), "{command}: {}", manager.inside("systemctl status hystation").1);
        assert_eq!((manager.show("ExecMainStatus"), manager.show("NRestarts")), ("2".into(), "0".into()), "{command}");
    }
}

#[test]
fn systemd_starts_watches_restarts_and_stops_the_station_and_no_engine_notices() {
    let Some(manager) = Manager::boot() else { return };
    let (code, _, said) = manager.inside("systemctl start hystation");
    assert_eq!(code, Some(0), "{said}\n{}", manager.inside("systemctl status hystation").1);
    assert_eq!(manager.show("ActiveState"), "active");
    assert!(manager.processes().is_some(), "ready was said before all were: {}", manager.hystation("status").1);
    manager.assert_default_scene();
    manager.hurt("KILL", &["guardian"]);
    manager.hurt("KILL", &["guardian", "supervisor"]);
    manager.hurt("STOP", &["guardian"]);
    // Nobody is left who could see that but systemd's watchdog.
    manager.hurt("STOP", &["guardian", "supervisor"]);
    assert_ne!(manager.show("NRestarts"), "0");
    assert_stops(&manager);
    assert_class(&manager);
    assert_waits_for_room(&manager);
    assert_refusal_ends(&manager);
    assert_eq!(manager.inside("ls /dev/shm").1, "", "shared memory is left");
}

/// A stop leaves nothing.
fn assert_stops(manager: &Manager) {
    let (code, _, said) = manager.inside("systemctl stop hystation");
    assert_eq!(code, Some(0), "{said}");
    assert_eq!((manager.show("ActiveState"), manager.show("Result")), ("inactive".into(), "success".into()));
    let (_, processes, _) = manager.inside("ps -eo args");
    let left: Vec<&str> =
        processes.lines().filter(|line| line.contains(&binaries().display().to_string()) && !line.contains("ps -eo")).collect();
    assert_eq!(left, Vec::<&str>::new());
    assert_eq!(manager.inside("ls /dev/shm").1, "", "shared memory is left");
}
