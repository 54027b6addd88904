//! The guardian: `hystation run`. It founds the station, starts the supervisor and starts it again when it dies, shows the table, and
//! at the end leaves nothing behind: no process, no shared memory, no file.

use crate::cli::RunArgs;
use crate::journal::{self, Verdict};
use crate::plan::Plan;
use crate::remains;
use crate::report;
use crate::settings::{Refusal, prepare};
use crate::supervise::register;
use crate::view::{StationView, Viewer, table};
use hyst_engine::Settings;
use hyst_exchange::{OwnedPage, Station, StationError, system};
use hyst_messages::page::station as layout;
use hyst_messages::{Role, Slot};
use rustix::process::WaitOptions;
use std::io::{IsTerminal, Write};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener};
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Between two looks of the guardian: a dead supervisor is replaced, and a signal answered, this soon.
const LOOK_NS: u64 = 20_000_000;
/// Between two drawings of the table.
const DRAW_NS: u64 = 500_000_000;
/// Between two starts of the supervisor, so that one that cannot start does not take the machine.
const RESTART_NS: u64 = 250_000_000;
/// Starts of the supervisor in a row without a sign of life before the station ends.
const MOST_STARTS: u32 = 10;
/// A supervisor whose heartbeat is older hangs. It beats every 5 ms.
const SUPERVISOR_LATE_NS: u64 = 3_000_000_000;
/// How long `--for` waits for the last process to become ready before it counts.
const READY_WITHIN_NS: u64 = 30_000_000_000;
/// How long the supervisor may take to stop everything.
const STOP_NS: u64 = 4_000_000_000;
/// What a station needs in /dev/shm: the default scene took 88 MiB without pictures, and while a tissue is replaced three lie there.
pub const NEEDED_BYTES: u64 = 192 << 20;

struct Guardian {
    station: Station,
    page: OwnedPage,
    supervisor: Option<u32>,
    starts: u32,
    next_start_ns: u64,
    seen: usize,
    lines: Vec<String>,
    draw: bool,
}

/// Runs a station until it ends; gives the exit code.
pub fn run(name: &str, args: &RunArgs) -> Result<u8, Refusal> {
    let station = Station::named(name).map_err(|e| Refusal::input(e.to_string()))?;
    let (settings, plan) = prepare(args)?;
    let scene_hash = crate::commands::check::admit(&settings)?;
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(|e| Refusal::failed(format!("signals: {e}")))?;
    }
    let _lock = take_name(&station)?;
    clear_remains(&station)?;
    let page = found(&station, &settings, &plan, scene_hash)?;
    // Engines whose supervisor died become children of the guardian, so that somebody reaps them.
    let _ = rustix::process::set_child_subreaper(Some(rustix::process::getpid())); // refused: then init reaps them
    let draw = std::io::stdout().is_terminal() && !args.quiet;
    let mut guardian =
        Guardian { station, page, supervisor: None, starts: 0, next_start_ns: 0, seen: 0, lines: Vec::new(), draw };
    guardian.keep(&plan, args.for_s, &stop);
    Ok(guardian.end(args, &plan))
}

/// The name is held by an abstract socket, which goes with its process and leaves no file.
fn take_name(station: &Station) -> Result<UnixListener, Refusal> {
    let name = format!("hystation-{}-{}", system::user_id(), station.name());
    let taken = || {
        Refusal::input(format!(
            "a station named {0:?} is running; stop it (`hystation --name {0} stop`) or give another --name",
            station.name()
        ))
    };
    let address = SocketAddr::from_abstract_name(name.as_bytes()).map_err(|e| Refusal::failed(format!("station name: {e}")))?;
    UnixListener::bind_addr(&address).map_err(|_| taken())
}

fn clear_remains(station: &Station) -> Result<(), Refusal> {
    let living = remains::living(station);
    if !living.is_empty() {
        let names: Vec<String> = living.iter().map(|living| format!("{} (pid {})", living.name, living.pid)).collect();
        return Err(Refusal::input(format!(
            "processes of a station named {0:?} still run without their guardian: {1}; end them with `hystation --name {0} stop`",
            station.name(),
            names.join(", ")
        )));
    }
    if !station.leftovers().is_empty() {
        eprintln!("hystation: removing what a dead station named {:?} left", station.name());
        station.wipe();
    }
    Ok(())
}

fn found(station: &Station, settings: &Settings, plan: &Plan, scene_hash: u64) -> Result<OwnedPage, Refusal> {
    if let Ok(disk) = rustix::fs::statvfs("/dev/shm")
        && disk.f_bavail * disk.f_frsize < NEEDED_BYTES
    {
        let free_mib = (disk.f_bavail * disk.f_frsize) >> 20;
        let need_mib = NEEDED_BYTES >> 20;
        return Err(Refusal::input(format!(
            "/dev/shm has {free_mib} MiB free, a station needs {need_mib}; remove files there (`ls -l /dev/shm`) or enlarge it \
             (`mount -o remount,size=1g /dev/shm`, docker: --shm-size=1g)"
        )));
    }
    let made = make(station, settings, plan);
    if made.is_err() {
        station.wipe(); // nothing half-founded stays
    }
    let page = made?;
    page.store64(layout::SCENE_HASH, scene_hash);
    page.store32(layout::WORKERS, settings.workers as u32);
    page.store32(layout::TEST_MODE, settings.test_mode as u32);
    register(&page, Role::Guardian);
    Ok(page)
}

fn make(station: &Station, settings: &Settings, plan: &Plan) -> Result<OwnedPage, Refusal> {
    let input = |e: StationError| Refusal::input(e.to_string());
    station.found().map_err(input)?;
    let text = toml::to_string(settings).map_err(|e| Refusal::failed(format!("settings: {e}")))?;
    std::fs::write(station.settings(), text)
        .map_err(|e| Refusal::input(format!("{}: {e}; look at `df /dev/shm`", station.settings().display())))?;
    plan.write(station).map_err(|e| Refusal::input(e.to_string()))?;
    station.open_for_keeping().map_err(input)
}

impl Guardian {
    /// Keeps the station until it is asked to stop, by whomever.
    fn keep(&mut self, plan: &Plan, for_s: Option<f64>, stop: &AtomicBool) {
        let Ok(mut viewer) = Viewer::open(&self.station) else {
            return;
        };
        let begin_ns = system::now_ns();
        let mut ready_ns = None;
        let mut next_draw_ns = 0;
        loop {
            let now_ns = system::now_ns();
            self.reap();
            if stop.load(Ordering::Relaxed) || self.page.load32(layout::STOP) != 0 {
                return;
            }
            if !self.keep_supervisor(now_ns) {
                return;
            }
            if ready_ns.is_none() && (all_ready(&mut viewer, plan) || now_ns - begin_ns > READY_WITHIN_NS) {
                ready_ns = Some(now_ns);
                self.tell(&format!(
                    "station {:?} is ready after {:.1} s",
                    self.station.name(),
                    (now_ns - begin_ns) as f64 * 1e-9
                ));
            }
            if let (Some(for_s), Some(ready_ns)) = (for_s, ready_ns)
                && (now_ns - ready_ns) as f64 * 1e-9 >= for_s
            {
                return;
            }
            if now_ns >= next_draw_ns {
                next_draw_ns = now_ns + DRAW_NS;
                self.draw(&mut viewer);
            }
            system::sleep_ns(LOOK_NS);
        }
    }

    /// Reaps every dead child: the supervisor, and engines that a dead supervisor left.
    fn reap(&mut self) {
        while let Ok(Some((pid, _))) = rustix::process::wait(WaitOptions::NOHANG) {
            if self.supervisor == Some(pid.as_raw_nonzero().get() as u32) {
                self.supervisor = None;
            }
        }
    }

    /// Starts the supervisor if there is none, and ends one that hangs. False when it cannot be kept alive.
    fn keep_supervisor(&mut self, now_ns: u64) -> bool {
        if let Some(pid) = self.supervisor {
            let beat_ns = self.page.load64(layout::SUPERVISOR_NS);
            if beat_ns > self.next_start_ns {
                self.starts = 0;
            }
            if now_ns.saturating_sub(beat_ns.max(self.next_start_ns)) > SUPERVISOR_LATE_NS {
                journal::say(&self.station, "the supervisor hangs and is replaced");
                crate::proc::demote_and_kill(pid);
            }
            return true;
        }
        if now_ns < self.next_start_ns {
            return true;
        }
        if self.starts >= MOST_STARTS {
            let message = format!("the supervisor died {MOST_STARTS} times in a row; look at {}", self.log().display());
            Verdict { code: 1, message }.write(&self.station);
            return false;
        }
        self.starts += 1;
        self.next_start_ns = now_ns + RESTART_NS;
        match self.start_supervisor() {
            Ok(pid) => self.supervisor = Some(pid),
            Err(error) => journal::say(&self.station, &format!("cannot start the supervisor: {error}")),
        }
        true
    }

    fn log(&self) -> std::path::PathBuf {
        self.station.log(Slot::first(Role::Supervisor))
    }

    fn start_supervisor(&self) -> std::io::Result<u32> {
        let log = std::fs::OpenOptions::new().append(true).create(true).open(self.log())?;
        let child = Command::new(std::env::current_exe()?)
            .args(["supervise", "--station", self.station.name()])
            .stdin(Stdio::null())
            .stdout(log.try_clone()?)
            .stderr(log)
            .process_group(0)
            .spawn()?;
        Ok(child.id())
    }

    fn tell(&mut self, line: &str) {
        if self.draw { self.lines.push(line.to_string()) } else { eprintln!("hystation: {line}") }
    }

    fn draw(&mut self, viewer: &mut Viewer) {
        for line in journal::news(&self.station, &mut self.seen) {
            self.tell(line.trim_end());
        }
        if !self.draw {
            return;
        }
        let view = viewer.look();
        let screen = screen(&view, &mut self.lines);
        let mut out = std::io::stdout();
        let _ = out.write_all(screen.as_bytes()).and_then(|()| out.flush()); // a terminal that has gone shows nothing
    }

    /// Stops everything, kills what does not stop, writes the report, removes everything.
    fn end(&mut self, args: &RunArgs, plan: &Plan) -> u8 {
        self.page.store32_and_wake(layout::STOP, 1);
        self.page.bump_and_wake(layout::CHANGES);
        let station = self.station.clone();
        let deadline_ns = system::now_ns() + STOP_NS;
        remains::wait_until_gone(&station, deadline_ns, || self.reap());
        let killed = remains::kill_all(&station, || self.reap());
        for line in journal::news(&station, &mut self.seen) {
            eprintln!("hystation: {}", line.trim_end());
        }
        if !killed.is_empty() {
            eprintln!("hystation: killed because they did not stop: {}", killed.join(", "));
        }
        let verdict = Verdict::read(&station);
        let mut report = report::take(&station);
        let faults = report::summary(&report);
        station.wipe();
        let left = count_leftovers(&station);
        report["leftovers"] = left.clone();
        eprintln!("hystation: {faults}");
        let mut code = judge(&report, &left, plan);
        if let Some(verdict) = verdict {
            eprintln!("hystation: {}", verdict.message);
            code = verdict.code;
        }
        if let Some(path) = &args.report
            && let Err(error) = std::fs::write(path, format!("{report:#}\n"))
        {
            eprintln!("hystation: --report {}: {error}; give a path that can be written", path.display());
            code = code.max(1);
        }
        code
    }
}

fn count_leftovers(station: &Station) -> serde_json::Value {
    let left = station.leftovers();
    let files = left.iter().filter(|path| *path == station.root()).count();
    serde_json::json!({ "processes": remains::living(station).len(), "shared_memory": left.len() - files, "files": files })
}

fn judge(report: &serde_json::Value, left: &serde_json::Value, plan: &Plan) -> u8 {
    let any_left = ["processes", "shared_memory", "files"].iter().any(|key| left[key].as_u64() != Some(0));
    let unreported = !plan.slots.is_empty() && report.get("processes").is_none();
    match () {
        () if any_left || unreported || report::is_broken(report) => 1,
        () if report::has_lost(report) => 3,
        () => 0,
    }
}

fn all_ready(viewer: &mut Viewer, plan: &Plan) -> bool {
    use hyst_messages::page::ProcessState::{Live, Warm};
    plan.slots().into_iter().all(|slot| viewer.slot_page(slot).is_some_and(|page| matches!(page.state(), Warm | Live)))
}

/// Events that are shown under the table.
const SHOWN_LINES: usize = 8;

/// The whole screen: table and newest events, drawn over the one before.
fn screen(view: &StationView, lines: &mut Vec<String>) -> String {
    let surplus = lines.len().saturating_sub(SHOWN_LINES);
    lines.drain(..surplus);
    let text = format!("{}\n{}\nCtrl-C stops the station and removes everything.\n", table(view), lines.join("\n"));
    format!("\x1b[H{}\x1b[J", text.replace('\n', "\x1b[K\n"))
}
