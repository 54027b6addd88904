//! A station of engines that do nothing but beat, for the tests of its keepers.
#![allow(dead_code, reason = "each test program uses its own part")]

use rustix::process::Signal;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// The program.
pub const HYSTATION: &str = env!("CARGO_BIN_EXE_hystation");
/// A wait in these tests ends with a failure after this time; a station of such processes is ready within a fraction of a second.
pub const PATIENCE: Duration = Duration::from_secs(40);

/// Engines of such a station, and its two keepers.
pub const PROCESSES: usize = 14;

/// A folder of engines and a station of its own name; stopped and removed when it is dropped.
pub struct Place {
    /// Name of the station.
    pub name: String,
    /// Where the engines are.
    pub folder: PathBuf,
}

impl Place {
    /// A folder in which every engine's name is the fake engine.
    pub fn new(name: &str) -> Place {
        let name = format!("k{}-{name}", std::process::id());
        let folder = std::env::temp_dir().join(&name);
        let _ = std::fs::remove_dir_all(&folder); // of a test that was killed, and had this process' number
        std::fs::create_dir_all(&folder).unwrap();
        let fake = Path::new(HYSTATION).parent().unwrap().join("examples/fake_engine");
        for role in ["hardware", "device", "haptic", "tissue", "fluid", "rendering", "recorder", "console", "collision-worker"] {
            std::os::unix::fs::symlink(&fake, folder.join(role)).unwrap();
        }
        Place { name, folder }
    }
    pub fn command(&self, words: &[&str]) -> Command {
        let mut command = Command::new(HYSTATION);
        command.args(["--name", &self.name]).args(words);
        command
    }
    pub fn call(&self, words: &[&str]) -> Output {
        self.command(words).output().unwrap()
    }
    pub fn start(&self, words: &[&str]) -> Child {
        let mut command = self.command(&["run", "--headless", "--binaries", self.folder.to_str().unwrap()]);
        command.args(words).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
    }
    pub fn report(&self) -> PathBuf {
        self.folder.join("report.json")
    }
    pub fn status(&self) -> Option<serde_json::Value> {
        let output = self.call(&["status", "--json"]);
        output.status.success().then(|| serde_json::from_slice(&output.stdout).unwrap())
    }
    /// Waits until the processes fulfil a condition.
    pub fn wait(&self, what: &str, mut holds: impl FnMut(&[(String, u64, String)]) -> bool) -> Vec<(String, u64, String)> {
        let since = Instant::now();
        while since.elapsed() < PATIENCE {
            if let Some(status) = self.status() {
                let row = |row: &serde_json::Value| {
                    (
                        row["name"].as_str().unwrap().to_string(),
                        row["pid"].as_u64().unwrap(),
                        row["state"].as_str().unwrap().to_string(),
                    )
                };
                let rows: Vec<_> = status["processes"].as_array().unwrap().iter().map(row).collect();
                if holds(&rows) {
                    return rows;
                }
            }
        }
        panic!("{what}: not within {PATIENCE:?}; {:?}", self.status());
    }
    pub fn wait_ready(&self) -> Vec<(String, u64, String)> {
        self.wait("ready", |rows| rows.len() == PROCESSES && rows.iter().all(|(_, _, state)| state == "live" || state == "spare"))
    }
    pub fn leftovers(&self) -> Vec<String> {
        let station = hyst_exchange::Station::named(&self.name).unwrap();
        station.leftovers().into_iter().map(|path| path.display().to_string()).collect()
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let _ = self.call(&["stop"]);
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// Waits until no process of the station is left.
pub fn gone(place: &Place, what: &str) {
    let station = hyst_exchange::Station::named(&place.name).unwrap();
    let since = Instant::now();
    while !hystation::proc::of_station(&station).is_empty() {
        assert!(since.elapsed() < PATIENCE, "{what}: {:?}", hystation::proc::of_station(&station));
        std::thread::yield_now();
    }
}

/// Waits until something is as it has to be.
pub fn await_that(what: &str, mut holds: impl FnMut() -> bool) {
    let since = Instant::now();
    while !holds() {
        assert!(since.elapsed() < PATIENCE, "{what}: not within {PATIENCE:?}");
        std::thread::yield_now();
    }
}

/// Waits until a process that was killed is no more, or nobody but its parent knows of it.
pub fn ended(pid: u64) {
    let since = Instant::now();
    while hyst_exchange::system::process_start(pid as u32).is_some() {
        assert!(since.elapsed() < PATIENCE, "{pid} does not end");
        std::thread::yield_now();
    }
}

pub fn pid_of(rows: &[(String, u64, String)], name: &str) -> u64 {
    rows.iter().find(|(known, _, _)| known == name).map(|(_, pid, _)| *pid).unwrap()
}

pub fn kill(pid: u64) {
    send(pid, Signal::KILL);
}

pub fn send(pid: u64, signal: Signal) {
    rustix::process::kill_process(rustix::process::Pid::from_raw(pid as i32).unwrap(), signal).unwrap();
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}
