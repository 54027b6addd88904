//! One life of one process: how it starts, what it knows, how it ends. Start and restart are one path.

use crate::settings::{SetError, Settings};
use clap::Parser;
use hyst_exchange::{LinkError, OwnedPage, PageError, Station, StationError, StationPage, system};
use hyst_messages::page::{ProcessState, header};
use hyst_messages::{Role, Slot};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

/// Why an engine ends other than by request.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// Settings, scene or mesh: a restart would not help. Exit code 2.
    #[error("{0}")]
    Input(String),
    /// Something broke: the supervisor restarts. Exit code 1.
    #[error("{0}")]
    Broken(String),
}

impl From<LinkError> for Failure {
    fn from(error: LinkError) -> Failure {
        Failure::Broken(error.to_string())
    }
}
impl From<PageError> for Failure {
    fn from(error: PageError) -> Failure {
        Failure::Broken(error.to_string())
    }
}
impl From<StationError> for Failure {
    fn from(error: StationError) -> Failure {
        Failure::Broken(error.to_string())
    }
}
impl From<SetError> for Failure {
    fn from(error: SetError) -> Failure {
        Failure::Input(error.to_string())
    }
}
impl From<hyst_messages::WireError> for Failure {
    fn from(error: hyst_messages::WireError) -> Failure {
        Failure::Broken(error.to_string())
    }
}
impl From<std::io::Error> for Failure {
    fn from(error: std::io::Error) -> Failure {
        Failure::Broken(error.to_string())
    }
}

/// What an engine says of itself, as one line of JSON, when its only argument is [`DESCRIBE`]: what a swap checks before it starts anything.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    /// Whose engines it is for: [`ENGINE_OF`].
    pub engine_of: String,
    /// The role that it can take.
    pub role: String,
    /// Version of the layouts.
    pub layout: u32,
    /// Hash of the layouts, hexadecimal.
    pub layout_hash: String,
    /// Version of what it does beside its layouts.
    pub interface: u32,
}

/// The argument that asks for a [`Description`].
pub const DESCRIBE: &str = "--describe";
/// What engines of this project say that they are of.
pub const ENGINE_OF: &str = "hystation";

impl Description {
    /// Of an engine of this role that is built from these sources.
    pub fn of(role: Role) -> Description {
        Description {
            engine_of: ENGINE_OF.into(),
            role: role.name().into(),
            layout: hyst_messages::LAYOUT_VERSION,
            layout_hash: format!("{:016x}", hyst_messages::layout_hash()),
            interface: hyst_messages::INTERFACE_VERSION,
        }
    }
}

/// What the supervisor puts on an engine's command line.
#[derive(Debug, Parser)]
#[command(about = "An engine of the hysteroscopy station; `hystation run` starts it")]
struct Start {
    /// Name of the station.
    #[arg(long)]
    station: String,
    /// Slot, such as haptic:1.
    #[arg(long)]
    slot: String,
    /// Number of this life.
    #[arg(long)]
    incarnation: u32,
}

/// What a process knows of itself and of its station.
#[derive(Debug)]
pub struct Life {
    /// The station.
    pub station: Station,
    /// Its page: clock, slots, stop.
    pub clock: StationPage,
    /// The process's own page.
    pub page: Arc<OwnedPage>,
    /// Its slot.
    pub slot: Slot,
    /// The number of this life.
    pub incarnation: u32,
    /// The station's settings.
    pub settings: Settings,
}

impl Life {
    /// A life in a station that exists, for a page that was made for it. Two processes never have the same one: they would write the same words.
    pub fn begin(station: &str, slot: Slot, incarnation: u32) -> Result<Life, Failure> {
        let station = Station::named(station)?;
        let text = std::fs::read_to_string(station.settings()).map_err(|error| {
            Failure::Input(format!("{}: {error}; start engines with `hystation run`", station.settings().display()))
        })?;
        let settings = toml::from_str(&text).map_err(|error| {
            Failure::Input(format!("{}: {error}; rebuild all binaries from one source", station.settings().display()))
        })?;
        let clock = station.open()?;
        let page = Arc::new(station.own_slot(slot, incarnation)?);
        let own = std::process::id() as u64;
        if let Err(lived) = page.swap64(header::PID, 0, own)
            && lived != own
        {
            return Err(Failure::Input(format!(
                "{slot} #{incarnation} is the life of process {lived}; start engines with `hystation run`"
            )));
        }
        page.store64(header::HEARTBEAT_NS, system::now_ns());
        page.set_state(ProcessState::Warming);
        Ok(Life { station, clock, page, slot, incarnation, settings })
    }

    /// Says that this process's streams have their writers, so that others may connect; the warm-up may still go on.
    pub fn ports_are_open(&self) {
        self.page.store32_and_wake(header::PORTS_OPEN, 1);
    }

    /// The scene that this process loads: the station's own copy where it has one, else what was named; `None` is the one in the binary.
    pub fn scene(&self) -> Option<PathBuf> {
        let copy = std::fs::read_to_string(self.station.scene_entry()).ok().map(PathBuf::from);
        copy.or_else(|| self.settings.scene.clone())
    }

    /// Refuses a scene that is not the one that the station was started with; `hash` is that of what this process has loaded.
    pub fn admit_scene(&self, hash: u64) -> Result<(), Failure> {
        match self.clock.scene_hash() {
            known if known == hash || known == 0 => Ok(()),
            known => Err(Failure::Input(format!(
                "{}: the scene or one of its meshes was changed since the station started (hash {known:016x} then, {hash:016x} now); put the \
                 files back as they were, or stop the station and start it again",
                self.scene().as_deref().unwrap_or(std::path::Path::new("embedded scene")).display()
            ))),
        }
    }

    /// Says that the process is alive; loops that are paced say it themselves.
    pub fn heartbeat(&self) {
        self.page.store64(header::HEARTBEAT_NS, system::now_ns());
    }

    /// Whether an incarnation is in one of the role's slots and not known to be dead.
    pub fn is_alive(&self, role: Role, incarnation: u32) -> bool {
        self.clock.occupied(role).any(|(slot, of)| of == incarnation && !self.clock.is_dead(slot))
    }

    /// Present tick.
    pub fn tick(&self) -> u64 {
        self.clock.present_tick()
    }

    /// Whether the station runs on a virtual clock.
    pub fn is_lockstep(&self) -> bool {
        self.settings.lockstep
    }

    /// Whether the station does again what a recording says; then it also runs in lock-step.
    pub fn is_replay(&self) -> bool {
        self.settings.replay.is_some()
    }

    /// Says something in the process's log. Not on a real-time thread.
    pub fn say(&self, text: &str) {
        eprintln!("[{:>9}] {} #{}: {text}", self.tick(), self.slot, self.incarnation);
    }
}

fn begin(role: Role) -> Result<Life, Failure> {
    let start = Start::try_parse().map_err(|error| Failure::Input(error.to_string()))?;
    let slot = Slot::parse(&start.slot).filter(|slot| slot.role() == role);
    let slot = slot.ok_or_else(|| Failure::Input(format!("--slot {}: this binary is a {}", start.slot, role.name())))?;
    Life::begin(&start.station, slot, start.incarnation)
}

/// Leaves the message of a panic in the page before the process ends.
fn leave_last_words(page: &Arc<OwnedPage>) {
    let page = Arc::clone(page);
    std::panic::set_hook(Box::new(move |info| {
        page.last_words(&info.to_string());
        page.set_state(ProcessState::Failed);
        // One line, whatever RUST_BACKTRACE says: to find the names of a backtrace takes 150 ms, a second in the console, and as long nobody would take over.
        eprintln!("{info}");
        // A broken invariant ends the process, whichever thread found it; the spare takes over.
        std::process::exit(1);
    }));
}

/// The whole of an engine's `main`.
pub fn run(role: Role, body: impl FnOnce(&Life) -> Result<(), Failure>) -> ExitCode {
    if std::env::args().skip(1).eq([DESCRIBE]) {
        println!("{}", serde_json::json!(Description::of(role)));
        return ExitCode::SUCCESS;
    }
    let life = match begin(role) {
        Ok(life) => life,
        Err(error) => {
            eprintln!("{}: {error}", role.name());
            return ExitCode::from(2);
        }
    };
    leave_last_words(&life.page);
    // The page outlives this thread, so that the kernel finds the latch. Where the C library refuses it, a death is told by the process's descriptor alone.
    std::mem::forget(Arc::clone(&life.page));
    life.page.hold_latch();
    if let Some(code) = life.hindered_start() {
        life.page.set_state(ProcessState::Failed);
        return ExitCode::from(code);
    }
    crate::mischief::attend(&life);
    crate::realtime::give_way(&life);
    match body(&life) {
        Ok(()) => {
            life.page.set_state(ProcessState::Stopping);
            ExitCode::SUCCESS
        }
        Err(error) => {
            life.page.last_words(&error.to_string());
            life.say(&error.to_string());
            life.page.set_state(ProcessState::Failed);
            ExitCode::from(if matches!(error, Failure::Input(_)) { 2 } else { 1 })
        }
    }
}
