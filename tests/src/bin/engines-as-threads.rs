//! The station's engines as threads of one process: what `hystation bench station` compares the station with. Ended by SIGINT or SIGTERM, at
//! the end of `--for`, or by the end of any engine; then it leaves nothing behind.
//!
//! Promise: the same code on the same pages and streams with the same priorities. What is missing is the border around each engine, and with
//! it guardian, supervisor and every restart. Only rendering stays a process, as it is in the station.

use clap::Parser;
use hyst_engine::{Failure, Life, Settings};
use hyst_exchange::rendezvous::HeldRendezvous;
use hyst_exchange::stream::HeldService;
use hyst_exchange::{Links, OwnedPage, Station, system};
use hyst_messages::page::station as layout;
use hyst_messages::{Kind, MAX_WORKERS, Role, Slot, kinds_of};
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// Between two looks at signals, time and engines.
const LOOK_NS: u64 = 20_000_000;
/// How long engines may take to stop, as in a station.
const STOP_NS: u64 = 2_000_000_000;

/// What can go wrong here, with its cure.
type Error = Box<dyn std::error::Error + Send + Sync>;

/// The engines of a station as threads of one process; `hystation bench station` starts it.
#[derive(Debug, Parser)]
struct Arguments {
    /// Name of the station that is founded.
    #[arg(long)]
    station: String,
    /// Scene or mesh; without it, the embedded scene.
    #[arg(long)]
    scene: Option<PathBuf>,
    /// Number of collision workers.
    #[arg(long, default_value_t = 2)]
    workers: usize,
    /// End by itself after so many seconds.
    #[arg(long = "for", default_value_t = 60)]
    for_s: u64,
}

/// A founded station; gone when dropped.
struct Founded {
    station: Station,
    page: OwnedPage,
    _services: Vec<Service>,
    rendering: Option<Child>,
}

enum Service {
    Stream(#[allow(dead_code, reason = "held, not used")] HeldService),
    Rendezvous(#[allow(dead_code, reason = "held, not used")] HeldRendezvous),
}

/// What an engine does with its life.
type Body = fn(&Life) -> Result<(), Failure>;

/// An engine that runs.
type Engine = (Slot, JoinHandle<Result<(), Failure>>);

fn main() -> ExitCode {
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => {
            eprintln!("engines-as-threads: {error}");
            return ExitCode::from(2);
        }
    };
    let station = match Station::named(&arguments.station) {
        Ok(station) => station,
        Err(error) => {
            eprintln!("engines-as-threads: {error}");
            return ExitCode::from(2);
        }
    };
    match run(station, &arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("engines-as-threads: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(station: Station, arguments: &Arguments) -> Result<(), Error> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop))?;
    }
    let mut founded = found(station, arguments)?;
    let engines = founded.start_engines(&slots(arguments.workers))?;
    let end_ns = system::now_ns() + arguments.for_s * 1_000_000_000;
    while !stop.load(Ordering::Relaxed) && system::now_ns() < end_ns && !engines.iter().any(|(_, thread)| thread.is_finished()) {
        system::sleep_ns(LOOK_NS);
    }
    founded.stop(engines)
}

/// The engines of a station, as `hystation run` starts them.
fn slots(workers: usize) -> Vec<Slot> {
    let count = |role: Role| match role {
        Role::Hardware | Role::Device => 1,
        Role::Haptic | Role::Tissue | Role::Fluid => 2,
        Role::CollisionWorker => workers.min(MAX_WORKERS),
        _ => 0,
    };
    Role::ALL.into_iter().flat_map(|role| (0..count(role)).filter_map(move |index| Slot::new(role, index))).collect()
}

/// What the engine of a role does.
fn body(role: Role) -> Option<Body> {
    match role {
        Role::Hardware => Some(device::hardware::run),
        Role::Device => Some(device::run),
        Role::Haptic => Some(haptic::run),
        Role::Tissue => Some(tissue::run),
        Role::CollisionWorker => Some(collision_worker::run),
        Role::Fluid => Some(fluid::run),
        _ => None,
    }
}

fn found(station: Station, arguments: &Arguments) -> Result<Founded, Error> {
    station.found()?;
    let page = station.open_for_keeping().inspect_err(|_| station.wipe())?;
    let founded = Founded { station, page, _services: Vec::new(), rendering: None };
    let settings = Settings {
        scene: arguments.scene.as_deref().map(std::path::absolute).transpose()?,
        headless: true,
        workers: arguments.workers,
        // As in the arms that it is compared with.
        set: [("workers".to_string(), "always".to_string())].into(),
        ..Settings::default()
    };
    std::fs::write(founded.station.settings(), toml::to_string(&settings)?)?;
    founded.page.store32(layout::WORKERS, arguments.workers as u32);
    Ok(founded)
}

impl Founded {
    /// Makes page and services of a new incarnation.
    fn prepare(&mut self, links: &Links, slot: Slot) -> Result<u32, Error> {
        let incarnation = self.page.fetch_add64(layout::NEXT_INCARNATION, 1) as u32;
        drop(self.station.create_slot(slot, incarnation)?);
        for &kind in kinds_of(slot.role()) {
            self._services.push(match kind {
                Kind::Appearance => Service::Rendezvous(links.create_rendezvous(slot.role(), incarnation, kind)?),
                _ => Service::Stream(links.create_service(slot.role(), incarnation, kind)?),
            });
        }
        Ok(incarnation)
    }

    /// Says in the station page who is in a slot.
    fn announce(&self, slot: Slot, incarnation: u32, process: u32) {
        let at = slot.number();
        self.page.store64(layout::SLOT_START + at, system::process_start(process).unwrap_or(0));
        self.page.store32(layout::SLOT_PID + at, process);
        self.page.store32(layout::SLOT_INCARNATION + at, incarnation);
        self.page.bump_and_wake(layout::CHANGES);
    }

    /// Starts a thread for each slot, and the process of rendering.
    fn start_engines(&mut self, slots: &[Slot]) -> Result<Vec<Engine>, Error> {
        let links = Links::join(&self.station, "engines-as-threads")?;
        let mut engines = Vec::new();
        for &slot in slots {
            let Some(body) = body(slot.role()) else { continue };
            let incarnation = self.prepare(&links, slot)?;
            self.announce(slot, incarnation, std::process::id());
            let name = self.station.name().to_string();
            let life = move || Life::begin(&name, slot, incarnation).and_then(|life| body(&life));
            engines.push((slot, std::thread::Builder::new().name(slot.to_string()).spawn(life)?));
        }
        let slot = Slot::first(Role::Rendering);
        let incarnation = self.prepare(&links, slot)?;
        let child = self.start_rendering(slot, incarnation)?;
        self.announce(slot, incarnation, child.id());
        self.rendering = Some(child);
        Ok(engines)
    }

    fn start_rendering(&self, slot: Slot, incarnation: u32) -> Result<Child, Error> {
        let program = std::env::current_exe()?.with_file_name(Role::Rendering.name());
        let child = Command::new(&program)
            .args(["--station", self.station.name(), "--slot", &slot.to_string(), "--incarnation", &incarnation.to_string()])
            // As the supervisor starts it.
            .envs([("LP_NUM_THREADS", "0"), ("NODEVICE_SELECT", "1")])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .process_group(0)
            .spawn();
        child.map_err(|e| {
            format!("{}: {e}; build all binaries into one folder (`cargo build --release`)", program.display()).into()
        })
    }

    /// Asks everyone to stop, waits, and says who failed. An engine that does not stop ends with this process.
    fn stop(mut self, engines: Vec<Engine>) -> Result<(), Error> {
        self.ask_to_stop();
        let end_ns = system::now_ns() + STOP_NS;
        let mut failed = Vec::new();
        for (slot, thread) in engines {
            while !thread.is_finished() && system::now_ns() < end_ns {
                system::sleep_ns(LOOK_NS / 10);
            }
            match thread.is_finished().then(|| thread.join()) {
                Some(Ok(Ok(()))) => {}
                Some(Ok(Err(error))) => failed.push(format!("{slot}: {error}")),
                Some(Err(_)) => failed.push(format!("{slot} panicked")),
                None => failed.push(format!("{slot} did not stop")),
            }
        }
        if let Some(child) = &mut self.rendering {
            while child.try_wait()?.is_none() && system::now_ns() < end_ns {
                system::sleep_ns(LOOK_NS / 10);
            }
        }
        if failed.is_empty() { Ok(()) } else { Err(failed.join("; ").into()) }
    }

    fn ask_to_stop(&self) {
        self.page.store32_and_wake(layout::STOP, 1);
        self.page.bump_and_wake(layout::CHANGES);
    }
}

impl Drop for Founded {
    fn drop(&mut self) {
        self.ask_to_stop();
        if let Some(child) = &mut self.rendering {
            let _ = child.kill(); // it has ended by itself
            let _ = child.wait();
        }
        self.station.wipe();
    }
}
