//! The harness of the whole-station tests: starts a station as an operator would, looks at it, hurts single processes, stops it, and reads
//! its report. Every wait is bounded; a station that a test leaves behind is stopped when its handle is dropped.

use hyst_exchange::ReadPage;
use hyst_messages::{Role, Slot};
use serde_json::Value;
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// A start takes a second on an idle machine; this long on one that compiles beside it.
pub const START_LIMIT: Duration = Duration::from_secs(90);
/// A process that was killed is back within a quarter of a second on an idle machine.
pub const RECOVERY_LIMIT: Duration = Duration::from_secs(30);
/// A stop takes at most 2 s for processes that hang, and then some for the report.
pub const STOP_LIMIT: Duration = Duration::from_secs(30);
/// Pause between two looks.
const LOOK: Duration = Duration::from_millis(20);

/// A running station.
pub struct Station {
    name: String,
    child: Child,
    folder: PathBuf,
}

/// How a station ended.
pub struct Ended {
    /// Exit code of `hystation run`.
    pub code: Option<i32>,
    /// Its report.
    pub report: Value,
    /// What it said on stderr.
    pub said: String,
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

/// A command of the station's own program.
pub fn hystation() -> Command {
    let mut command = Command::new(binaries().join("hystation"));
    command.stdin(Stdio::null());
    command
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
        let name = format!("{name}-{}", std::process::id());
        let folder = std::env::temp_dir().join(format!("station-test-{name}"));
        std::fs::create_dir_all(&folder).expect("a folder for the report");
        let log = std::fs::File::create(folder.join("said")).expect("a file for what the station says");
        let child = hystation()
            .args(["--name", &name, "run", "--headless", "--report"])
            .arg(folder.join("report.json"))
            .arg("--record")
            .arg(folder.join("session.mcap"))
            .args(arguments)
            .stdout(Stdio::null())
            .stderr(log)
            .spawn()
            .expect("target/release/hystation: run `./station build` first");
        let mut station = Station { name, child, folder };
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

    /// Whether every process is live or a warm spare.
    pub fn is_whole(&self) -> bool {
        let status = self.status();
        let Some(processes) = status["processes"].as_array() else { return false };
        let named = |name: &str| processes.iter().any(|process| process["name"] == name);
        let well = |process: &Value| matches!(process["state"].as_str(), Some("live" | "spare"));
        ["device", "haptic:1", "tissue:1", "fluid:1", "rendering", "recorder"].into_iter().all(named)
            && processes.iter().all(well)
    }

    /// Waits until the station is whole.
    pub fn recover(&self) {
        let back = wait_for(RECOVERY_LIMIT, || self.is_whole().then_some(()));
        assert!(back.is_some(), "not back: {}\n{}", self.status(), self.said());
    }

    /// Process id of the one that does a role's work (`active`), or of its spare.
    pub fn pid(&self, role: &str, active: bool) -> i32 {
        let of_role = || self.processes(role).into_iter().find(|process| process["active"] == active);
        let found =
            wait_for(RECOVERY_LIMIT, of_role).unwrap_or_else(|| panic!("no {role} with active = {active}: {}", self.status()));
        found["pid"].as_i64().expect("a process id") as i32
    }

    /// Sends a signal to a process of this station.
    pub fn signal(&self, pid: i32, signal: rustix::process::Signal) {
        let pid = rustix::process::Pid::from_raw(pid).expect("a process id");
        rustix::process::kill_process(pid, signal).expect("the process is ours");
    }

    /// Kills (SIGKILL) the process that does a role's work, or its spare, and waits until the station is whole again.
    pub fn kill(&self, role: &str, active: bool) {
        let pid = self.pid(role, active);
        self.signal(pid, rustix::process::Signal::KILL);
        let gone = wait_for(RECOVERY_LIMIT, || self.processes(role).iter().all(|process| process["pid"] != pid).then_some(()));
        assert!(gone.is_some(), "{role} {pid} was not replaced: {}\n{}", self.status(), self.said());
        self.recover();
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
        let station = hyst_exchange::Station::named(&self.name).expect("a name");
        let slot = Slot::first(role);
        let incarnation = station.open().expect("the station's page").incarnation(slot);
        station.read_slot(slot, incarnation).expect("the process's page")
    }

    /// Force that the motors make at this moment, N.
    pub fn force_n(&self) -> f64 {
        let sample = self.page(Role::Hardware).cell(hyst_messages::page::hardware::SAMPLE);
        let force_n = sample.map_or([0.0; 3], |(_, sample)| sample.force_n);
        force_n.iter().map(|c| (*c as f64).powi(2)).sum::<f64>().sqrt()
    }

    /// Deficit of the medium as the fluid that holds the role says it, ml, and the tick of its state.
    pub fn deficit(&self) -> (f64, u64) {
        let station = hyst_exchange::Station::named(&self.name).expect("a name");
        let clock = station.open().expect("the station's page");
        let statuses = clock.occupied(Role::Fluid).filter_map(|(slot, incarnation)| {
            let (_, status) = station.read_slot(slot, incarnation).ok()?.cell(hyst_messages::page::fluid::STATUS)?;
            Some((status.deficit_ml, status.state_tick))
        });
        statuses.max_by_key(|status| status.1).unwrap_or_default()
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
        Ended { code: status.code(), report, said }
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        if self.has_ended().is_none() {
            let _ = run(hystation().args(["--name", &self.name, "stop"]));
            if wait_for(STOP_LIMIT, || self.has_ended()).is_none() {
                let _ = self.child.kill();
                let _ = self.child.wait();
            }
        }
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

impl Ended {
    /// A number of the report by its path (`device.ticks`).
    pub fn number(&self, path: &str) -> f64 {
        let found = path.split('.').fold(&self.report, |value, key| &value[key]);
        found.as_f64().unwrap_or_else(|| panic!("report has no number {path}: {found}"))
    }

    /// Misses of each fault of a target (`haptic:active` has `active` set) in its window less those in its control window.
    pub fn excess(&self, role: &str, active: bool) -> Vec<f64> {
        let of_role = |fault: &&Value| {
            fault["target"].as_str().and_then(|name| name.split(':').next()) == Some(role) && fault["active"] == active
        };
        let excess = |fault: &Value| Some(fault["window"]["missed"].as_f64()? - fault["control"]["missed"].as_f64()?);
        self.report["faults"].as_array().map(|all| all.iter().filter(of_role).filter_map(excess).collect()).unwrap_or_default()
    }

    /// Nothing wrong was ever applied, and nothing is left behind.
    pub fn assert_clean(&self) {
        for path in ["invalid_applied", "stale_applied", "leftovers.processes", "leftovers.shared_memory", "leftovers.files"] {
            assert_eq!(self.number(path), 0.0, "{path}\n{}", self.said);
        }
    }
}

/// The lower end of the 95 % interval of the mean of some figures: what the mean is at least, whatever the host did.
pub fn lower95_of_mean(figures: &[f64]) -> f64 {
    let count = figures.len().max(1) as f64;
    let mean = figures.iter().sum::<f64>() / count;
    let variance = figures.iter().map(|figure| (figure - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    mean - 1.96 * (variance / count).sqrt()
}

#[cfg(test)]
mod tests {
    use super::lower95_of_mean;

    #[test]
    fn the_interval_by_hand() {
        assert_eq!(lower95_of_mean(&[2.0; 10]), 2.0);
        // Mean 0.5, standard deviation 0.5270, standard error 0.1667.
        let halves = [0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 1.0];
        assert!((lower95_of_mean(&halves) - 0.1733).abs() < 1e-3);
    }
}
