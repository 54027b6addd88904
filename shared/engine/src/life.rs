//! One life of one process: how it starts, what it knows, how it ends. Start and restart are one path.

use crate::settings::{SetError, Settings};
use clap::Parser;
use hyst_exchange::{LinkError, OwnedPage, PageError, Station, StationError, StationPage, system};
use hyst_messages::page::{ProcessState, header};
use hyst_messages::{Role, Slot};
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
    /// A life in a station that exists, for a page that was made for it.
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
        page.store64(header::PID, std::process::id() as u64);
        page.store64(header::HEARTBEAT_NS, system::now_ns());
        page.set_state(ProcessState::Warming);
        Ok(Life { station, clock, page, slot, incarnation, settings })
    }

    /// Says that this process's streams have their writers, so that others may connect; the warm-up may still go on.
    pub fn ports_are_open(&self) {
        self.page.store32_and_wake(header::PORTS_OPEN, 1);
    }

    /// Says that the process is alive; loops that are paced say it themselves.
    pub fn heartbeat(&self) {
        self.page.store64(header::HEARTBEAT_NS, system::now_ns());
    }

    /// Present tick.
    pub fn tick(&self) -> u64 {
        self.clock.tick_at(system::now_ns())
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
    let default = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        page.last_words(&info.to_string());
        page.set_state(ProcessState::Failed);
        default(info);
        // A broken invariant ends the process, whichever thread found it; the spare takes over.
        std::process::exit(1);
    }));
}

/// The whole of an engine's `main`.
pub fn run(role: Role, body: impl FnOnce(&Life) -> Result<(), Failure>) -> ExitCode {
    let life = match begin(role) {
        Ok(life) => life,
        Err(error) => {
            eprintln!("{}: {error}", role.name());
            return ExitCode::from(2);
        }
    };
    leave_last_words(&life.page);
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
