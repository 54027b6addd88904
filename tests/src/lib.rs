//! The harness of the whole-station tests: starts a station as an operator would, looks at it, hurts single processes, stops it, and reads
//! its report. Every wait is bounded; a station that a test leaves behind is stopped when its handle is dropped.

pub mod beside;
pub mod browser;
pub mod display;
mod ended;
mod folder;
mod keepers;
pub mod page;
pub mod paired;
pub mod shown;
pub mod swapped;
pub mod windows;

use hyst_exchange::ReadPage;
use hyst_messages::{FluidStatus, HardwareSample, Role, Slot, TissueStatus};
use hyst_recording::Recording;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

pub use ended::{DEVICE_TICKS, Ended, STEP_MARGIN_N};
pub use folder::Folder;
pub use keepers::{Census, Engine};

/// A start takes a second on an idle machine; this long is given to one that compiles beside it, and whose driver starts for the first time.
pub const START_LIMIT: Duration = Duration::from_secs(180);
/// A process that was killed is back within a quarter of a second on an idle machine; pictures in software are given 180 s by the supervisor itself.
pub const RECOVERY_LIMIT: Duration = Duration::from_secs(180);
/// A stop takes at most 2 s for processes that hang, and then some for the report.
pub const STOP_LIMIT: Duration = Duration::from_secs(30);
/// Pause between two looks.
const LOOK: Duration = Duration::from_millis(20);

/// A running station.
pub struct Station {
    name: String,
    child: Child,
    folder: PathBuf,
    /// The command that started it.
    words: Vec<std::ffi::OsString>,
}

/// Folder of the release binaries, from the test's own place in it.
pub fn binaries() -> PathBuf {
    let mut folder = std::env::current_exe().unwrap_or_default();
    folder.pop();
    if folder.ends_with("deps") {
        folder.pop();
    }
    folder
}

/// A bad engine of a kind in a folder: it is one by the name that it is called by.
pub fn bad_engine(folder: &Path, role: &str, kind: &str) -> PathBuf {
    let link = folder.join(format!("bad.{role}.{kind}"));
    let _ = std::fs::remove_file(&link); // of the time before
    std::os::unix::fs::symlink(binaries().join("bad-engine"), &link).expect("a link");
    link
}

/// A command of the station's own program.
pub fn hystation() -> Command {
    let mut command = Command::new(binaries().join("hystation"));
    command.stdin(Stdio::null());
    command
}

/// Two things side by side: in lock-step nothing comes of how fast a station is, and one fills less than two cores.
pub fn both<A: Send>(one: impl FnOnce() -> A + Send, other: impl FnOnce() -> A + Send) -> [A; 2] {
    std::thread::scope(|scope| {
        let beside = scope.spawn(other);
        let first = one();
        [first, beside.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))]
    })
}

/// Runs a command to its end and gives exit code, stdout and stderr.
pub fn run(command: &mut Command) -> (Option<i32>, String, String) {
    let output = command.output().expect("target/release/hystation: run `./station build` first");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

/// Looks until `found` gives something, at most for `limit`.
pub fn wait_for<T>(limit: Duration, mut found: impl FnMut() -> Option<T>) -> Option<T> {
    let end = Instant::now() + limit;
    loop {
        if let Some(it) = found() {
            return Some(it);
        }
        if Instant::now() >= end {
            return None;
        }
        std::thread::park_timeout(LOOK);
    }
}

impl Station {
    /// Starts a station of its own name and waits until every process is live or a warm spare.
    pub fn start(name: &str, arguments: &[&str]) -> Station {
        Station::launch(&[], &["--headless"], name, arguments)
    }

    /// The same with a window on a display.
    pub fn start_shown(display: &str, name: &str, arguments: &[&str]) -> Station {
        Station::start_facing(&["env", &format!("DISPLAY={display}")], name, arguments)
    }

    /// The same with a window, if there is a display where this command leaves it (`env -u DISPLAY`).
    pub fn start_facing(wrapper: &[&str], name: &str, arguments: &[&str]) -> Station {
        Station::launch(wrapper, &[], name, arguments)
    }

    /// The same under another command (`prlimit --rtprio=0`), which takes rights away and then runs its arguments.
    pub fn start_under(wrapper: &[&str], name: &str, arguments: &[&str]) -> Station {
        Station::launch(wrapper, &["--headless"], name, arguments)
    }

    fn launch(wrapper: &[&str], front: &[&str], name: &str, arguments: &[&str]) -> Station {
        let name = format!("{name}-{}", std::process::id());
        let folder = std::env::temp_dir().join(format!("station-test-{name}"));
        std::fs::create_dir_all(&folder).expect("a folder for the report");
        let log = std::fs::File::create(folder.join("said")).expect("a file for what the station says");
        let (report, record) = (folder.join("report.json").into(), folder.join("session.mcap").into());
        let own = ["--name", &name, "run"].into_iter().chain(front.iter().copied()).map(std::ffi::OsString::from);
        let words: Vec<std::ffi::OsString> = (wrapper.iter().map(std::ffi::OsString::from))
            .chain([binaries().join("hystation").into_os_string()])
            .chain(own)
            .chain(["--report".into(), report, "--record".into(), record])
            .chain(["--set", "workers=always"].map(std::ffi::OsString::from))
            .chain(arguments.iter().map(std::ffi::OsString::from))
            .collect();
        let child = keepers::guardian(&words, log);
        let mut station = Station { name, child, folder, words };
        let ready = wait_for(START_LIMIT, || (station.has_ended().is_some() || station.is_whole()).then_some(()));
        let ended = station.has_ended();
        assert!(ready.is_some() && ended.is_none(), "the station did not start: {ended:?}\n{}", station.said());
        station
    }

    fn has_ended(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().ok().flatten()
    }

    /// What the station has said so far.
    pub fn said(&self) -> String {
        std::fs::read_to_string(self.folder.join("said")).unwrap_or_default()
    }

    /// The station's name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// A folder for the test's files.
    pub fn folder(&self) -> &PathBuf {
        &self.folder
    }

    /// `status --json`.
    pub fn status(&self) -> Value {
        let (_, text, _) = run(hystation().args(["--name", &self.name, "status", "--json"]));
        serde_json::from_str(&text).unwrap_or(Value::Null)
    }

    /// All processes of a role (`haptic`), as the status has them.
    pub fn processes(&self, role: &str) -> Vec<Value> {
        let is_role = |process: &&Value| process["name"].as_str().and_then(|name| name.split(':').next()) == Some(role);
        self.status()["processes"].as_array().map(|all| all.iter().filter(is_role).cloned().collect()).unwrap_or_default()
    }

    /// Process ids of all of its processes.
    pub fn pids(&self) -> BTreeSet<i64> {
        let status = self.status();
        status["processes"].as_array().into_iter().flatten().filter_map(|process| process["pid"].as_i64()).collect()
    }

    /// Whether every process is live or a warm spare.
    pub fn is_whole(&self) -> bool {
        let status = self.status();
        let Some(processes) = status["processes"].as_array() else { return false };
        let named = |name: &str| processes.iter().any(|process| process["name"] == name);
        let well = |process: &Value| matches!(process["state"].as_str(), Some("live" | "spare"));
        let last = if self.words.iter().any(|word| word == "spares=off") { 0 } else { 1 };
        let spares = ["haptic", "tissue", "fluid"].into_iter().all(|role| named(&format!("{role}:{last}")));
        spares && ["device", "rendering", "recorder"].into_iter().all(named) && processes.iter().all(well)
    }

    /// Waits until the station is whole.
    pub fn recover(&self) {
        let back = wait_for(RECOVERY_LIMIT, || self.is_whole().then_some(()));
        assert!(back.is_some(), "not back: {}\n{}", self.status(), self.said());
    }

    /// Process id of the one that does a role's work (`active`), or of its spare.
    pub fn pid(&self, role: &str, active: bool) -> i32 {
        let is_it = |process: &Value| process["active"] == active && process["state"] != "dead";
        let of_role = || self.processes(role).into_iter().find(is_it);
        let found =
            wait_for(RECOVERY_LIMIT, of_role).unwrap_or_else(|| panic!("no {role} with active = {active}: {}", self.status()));
        found["pid"].as_i64().expect("a process id") as i32
    }

    /// Sends a signal to a process of this station.
    pub fn signal(&self, pid: i32, signal: rustix::process::Signal) {
        let pid = rustix::process::Pid::from_raw(pid).expect("a process id");
        rustix::process::kill_process(pid, signal).expect("the process is ours");
    }

    /// Sends a signal to a process that may have gone.
    pub fn signal_if_alive(&self, pid: i32, signal: rustix::process::Signal) {
        let pid = rustix::process::Pid::from_raw(pid).expect("a process id");
        let _ = rustix::process::kill_process(pid, signal); // gone is as good
    }

    /// Process id and epoch of the one that does a role's work.
    pub fn holder(&self, role: &str) -> (i32, u64) {
        let of_active = || {
            let found =
                self.processes(role).into_iter().find(|process| process["active"] == true && process["state"] != "dead")?;
            Some((found["pid"].as_i64()? as i32, found["epoch"].as_u64()?))
        };
        wait_for(RECOVERY_LIMIT, of_active).unwrap_or_else(|| panic!("no active {role}: {}", self.status()))
    }

    /// Name and process id of a target as faults name it (`haptic:active`, `haptic:spare`, `collision-worker:0`, `device`). The name is that of the slot: who is
    /// active may have changed when a fault comes.
    pub fn victim(&self, target: &str) -> (String, i32) {
        let is_of = |role: &str, process: &Value| process["name"].as_str().is_some_and(|name| name.starts_with(role));
        let is_it = |process: &&Value| match target.split_once(':') {
            Some((role, which @ ("active" | "spare"))) => is_of(role, process) && process["active"] == (which == "active"),
            _ => process["name"] == target,
        };
        let named = || {
            let status = self.status();
            let process = status["processes"].as_array()?.iter().find(is_it)?;
            Some((process["name"].as_str()?.to_string(), process["pid"].as_i64()? as i32))
        };
        wait_for(RECOVERY_LIMIT, named).unwrap_or_else(|| panic!("no {target}: {}", self.status()))
    }

    /// Whether a process is in a slot of this station.
    pub fn has_process(&self, pid: i32) -> bool {
        let status = self.status();
        // A supervisor that does not answer is no proof.
        status["processes"]
            .as_array()
            .is_none_or(|all| all.iter().any(|process| process["pid"] == pid && process["state"] != "dead"))
    }

    /// Waits until a process has been replaced.
    pub fn wait_until_gone(&self, pid: i32) {
        let gone = wait_for(RECOVERY_LIMIT, || (!self.has_process(pid)).then_some(()));
        assert!(gone.is_some(), "process {pid} was not replaced: {}\n{}", self.status(), self.said());
    }

    /// Waits until another process has the role.
    pub fn wait_for_another(&self, role: &str, pid: i32) {
        let taken = || self.processes(role).iter().any(|process| process["active"] == true && process["pid"] != pid);
        let found = wait_for(RECOVERY_LIMIT, || taken().then_some(()));
        assert!(found.is_some(), "nobody has taken over from {role} {pid}: {}\n{}", self.status(), self.said());
    }

    /// Lets the ticks of a fault of 2 s pass, or waits until its process has been replaced.
    pub fn wait_until_over(&self, pid: i32) {
        let tick = || self.status()["tick"].as_u64();
        let end = wait_for(RECOVERY_LIMIT, tick).expect("a tick") + 2_200;
        let over = wait_for(RECOVERY_LIMIT, || (!self.has_process(pid) || tick().is_some_and(|tick| tick >= end)).then_some(()));
        assert!(over.is_some(), "{}\n{}", self.status(), self.said());
    }

    /// Kills (SIGKILL) the process that does a role's work, or its spare, and waits until the station is whole again.
    pub fn kill(&self, role: &str, active: bool) {
        let pid = self.pid(role, active);
        self.signal_if_alive(pid, rustix::process::Signal::KILL); // dead of another cause is as good
        let gone = wait_for(RECOVERY_LIMIT, || self.processes(role).iter().all(|process| process["pid"] != pid).then_some(()));
        assert!(gone.is_some(), "{role} {pid} was not replaced: {}\n{}", self.status(), self.said());
        self.recover();
    }

    /// Injects a fault (`nan haptic:active --for 300ms`); the station must have been started with `--test-mode`.
    pub fn inject(&self, fault: &str) {
        let (code, _, said) = run(hystation().args(["--name", &self.name, "fault", "inject"]).args(fault.split(' ')));
        assert_eq!(code, Some(0), "fault inject {fault}: {said}\n{}", self.said());
    }

    /// Lets the station run for a number of its own ticks.
    pub fn run_ticks(&self, ticks: u64) {
        let tick = || self.status()["tick"].as_u64();
        let end = wait_for(RECOVERY_LIMIT, tick).expect("a tick") + ticks;
        let reached = wait_for(RECOVERY_LIMIT + Duration::from_millis(2 * ticks), || tick().filter(|tick| *tick >= end));
        assert!(reached.is_some(), "the station's clock does not reach tick {end}");
    }

    /// The page of the first process of a role.
    fn page(&self, role: Role) -> ReadPage {
        let slot = Slot::first(role);
        self.place().read_slot(slot, self.clock().incarnation(slot)).expect("the process's page")
    }

    /// What the hardware said last: where the hand is, and what its motors do.
    pub fn sample(&self) -> HardwareSample {
        let sample = self.page(Role::Hardware).cell(hyst_messages::page::hardware::SAMPLE);
        sample.map_or_else(HardwareSample::default, |(_, sample)| sample)
    }

    /// Force that the motors make at this moment, N.
    pub fn force_n(&self) -> f64 {
        self.sample().force_n.iter().map(|c| (*c as f64).powi(2)).sum::<f64>().sqrt()
    }

    /// What the fluid says that spoke last in the newest epoch.
    pub fn fluid_status(&self) -> FluidStatus {
        self.fluid_statuses().into_iter().max_by_key(|status| (status.epoch, status.state_tick)).unwrap_or_default()
    }

    /// Deficit of the medium, ml, and the tick of the state that it is of.
    pub fn deficit(&self) -> (f64, u64) {
        let status = self.fluid_status();
        (status.deficit_ml, status.state_tick)
    }

    /// Whether the fluid that holds the role has said something of a step of its own; one that is held still makes none.
    pub fn has_fluid_spoken(&self) -> bool {
        let holder = hyst_exchange::Roster::open(&self.place()).expect("the roster").holder(Role::Fluid);
        self.fluid_statuses().iter().any(|status| (status.epoch, status.incarnation) == (holder.epoch, holder.incarnation))
    }

    fn fluid_statuses(&self) -> Vec<FluidStatus> {
        let (station, clock) = (self.place(), self.clock());
        let read =
            |(slot, incarnation)| Some(station.read_slot(slot, incarnation).ok()?.cell(hyst_messages::page::fluid::STATUS)?.1);
        clock.occupied(Role::Fluid).filter_map(read).collect()
    }

    /// What the tissue says of its newest state, whoever made it.
    pub fn tissue_status(&self) -> TissueStatus {
        let (station, clock) = (self.place(), self.clock());
        let statuses = clock.occupied(Role::Tissue).filter_map(|(slot, incarnation)| {
            Some(station.read_slot(slot, incarnation).ok()?.cell(hyst_messages::page::tissue::STATUS)?.1)
        });
        statuses.max_by_key(|status| status.state_tick).unwrap_or_default()
    }

    /// Totals of the hardware's ledger so far: non-void ticks, and those of them without a fresh force.
    pub fn ledger(&self) -> (u64, u64) {
        use hyst_messages::page::hardware::{TOTALS, Total};
        let page = self.page(Role::Hardware);
        let total = |total: Total| page.load64(TOTALS + total as usize);
        let missed = total(Total::Held) + total(Total::Ramped) + total(Total::Zero);
        (total(Total::Fresh) + missed, missed)
    }

    /// Stops the station as Ctrl-C does, and reads its report.
    pub fn stop(mut self) -> Ended {
        self.signal(self.child.id() as i32, rustix::process::Signal::INT);
        let status = wait_for(STOP_LIMIT, || self.has_ended());
        let said = self.said();
        let status = status.unwrap_or_else(|| panic!("the station did not stop\n{said}"));
        let text = std::fs::read_to_string(self.folder.join("report.json")).unwrap_or_default();
        let report = serde_json::from_str(&text).unwrap_or_else(|error| panic!("report: {error}\n{said}"));
        let recording = Recording::read(&self.folder.join("session.mcap")).map_err(|error| error.to_string());
        Ended { code: status.code(), report, said, recording }
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        let left = hyst_exchange::Station::named(&self.name).is_ok_and(|station| !station.leftovers().is_empty());
        if self.has_ended().is_none() || left {
            let _ = run(hystation().args(["--name", &self.name, "stop"]));
            if wait_for(STOP_LIMIT, || self.has_ended()).is_none() {
                let _ = self.child.kill();
                let _ = self.child.wait();
                // Its guardian could not: now the command removes what is left.
                let _ = run(hystation().args(["--name", &self.name, "stop"]));
            }
        }
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}
