//! One arm of the comparison: a whole station, with so many collision workers, as processes or as threads of one process. Each round starts
//! it, measures one window, and stops it.

use super::probe::{self, Window};
use super::program::{self, Place, Said};
use super::{beside, not_started};
use crate::plan;
use crate::proc;
use crate::settings::Refusal;
use crate::view::Viewer;
use hyst_engine::Settings;
use hyst_exchange::system;
use hyst_messages::page::{header, rendering};
use hyst_messages::{Role, Slot};
use rustix::process::Signal;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// Length of a window, as a rule: one round of the scripted hand, so that every window holds the same contact wherever it begins. Others are of several.
pub const WINDOW_NS: u64 = 2_000_000_000;
/// Tick of the hardware from which on a window may begin: the hand has rested for its first second, and pressed for half a round.
const FIRST_TICK: u64 = 2_000;
/// How long a start may take before the arm counts as failed.
const START_NS: u64 = 40_000_000_000;
/// How long an end may take: engines have 2 s, the guardian's report and removal some more.
const STOP_NS: u64 = 10_000_000_000;
/// A station whose benchmark was killed ends by itself after this time and that of a window, s.
const BOUND_S: u64 = 60;
/// How long a first picture is waited for.
pub const PICTURE_NS: u64 = 10_000_000_000;
/// Between two looks for it.
const PICTURE_LOOK_NS: u64 = 1_000_000;
/// Between two looks at a station that starts or ends.
const LOOK_NS: u64 = 10_000_000;

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A process for each engine.
    Processes,
    /// A thread for each engine, in one process.
    Threads,
}

/// An arm and its windows.
#[derive(Clone, Debug)]
pub struct Arm {
    /// What is measured.
    pub kind: Kind,
    /// Collision workers.
    pub workers: usize,
    /// A role that is left out.
    pub without: Option<Role>,
    /// Where the session is recorded; of each round anew.
    pub record: Option<PathBuf>,
    /// After each window rendering is killed, and its successor's first picture waited for.
    pub kills_rendering: bool,
    /// Length of a window, ns.
    pub window_ns: u64,
    /// One for each round.
    pub windows: Vec<Window>,
    /// Exit codes other than 0.
    pub failures: Vec<i32>,
}

impl Arm {
    /// An arm that has not run yet.
    pub fn new(kind: Kind, workers: usize) -> Arm {
        let (windows, failures) = Default::default();
        Arm { kind, workers, without: None, record: None, kills_rendering: false, window_ns: WINDOW_NS, windows, failures }
    }
    /// The same, in which rendering is killed after each window.
    pub fn killing_rendering(self) -> Arm {
        Arm { kills_rendering: true, ..self }
    }
    /// The same with a recording.
    pub fn recording(self, path: PathBuf) -> Arm {
        Arm { record: Some(path), ..self }
    }
    /// The same with windows of another length, ns.
    pub fn windows_of(self, window_ns: u64) -> Arm {
        Arm { window_ns, ..self }
    }
    /// The same without a role.
    pub fn without(self, role: Role) -> Arm {
        Arm { without: Some(role), ..self }
    }
    fn slots(&self) -> Vec<Slot> {
        let mut slots = plan::slots(&Settings { workers: self.workers, ..Settings::default() }, true, None);
        slots.retain(|slot| self.kind == Kind::Processes || slot.role() != Role::Console); // which has no thread: nobody looks
        slots.retain(|slot| Some(slot.role()) != self.without);
        slots
    }
    /// What people read.
    pub fn name(&self) -> String {
        match self.kind {
            Kind::Processes => format!("workers {}", self.workers),
            Kind::Threads => format!("threads, workers {}", self.workers),
        }
    }

    /// One round.
    pub fn run(&mut self, mesh: Option<&Path>) -> Result<(), Refusal> {
        let name = format!("bench-{}-{}", std::process::id(), if self.kind == Kind::Threads { "t" } else { "p" });
        let mut running = Running::start(Place::named(&name)?, self.command(&name, mesh)?)?;
        let window = running.measure(&self.slots(), self.window_ns).map(|mut window| {
            let draws = window.spells.get("rendering").is_some_and(|spell| spell.picture.is_some());
            window.pictures_back_s = (self.kills_rendering && draws).then(|| running.kill_rendering()).flatten();
            window
        });
        let (code, said) = running.stop();
        match window {
            Ok(window) => self.windows.push(window),
            Err(refusal) if said.is_empty() => return Err(refusal),
            Err(_) => return Err(Refusal { code: code.clamp(1, 2) as u8, message: format!("bench: {said}") }),
        }
        if code != 0 {
            self.failures.push(code);
        }
        Ok(())
    }

    fn command(&self, name: &str, mesh: Option<&Path>) -> Result<Command, Refusal> {
        let bound_s = BOUND_S + self.window_ns / 1_000_000_000;
        let (binary, bound) = match self.kind {
            Kind::Processes => ("hystation", format!("{bound_s}s")),
            Kind::Threads => ("engines-as-threads", bound_s.to_string()),
        };
        let path: PathBuf = beside(binary)?;
        let mut command = Command::new(&path);
        match self.kind {
            // As many as the arm is named for work in each step: what they cost is to be seen.
            Kind::Processes => {
                command.args(["--name", name, "run", "--headless", "--quiet", "--set", "workers=always"]).args(mesh)
            }
            Kind::Threads => {
                command.args(["--station", name]).args(mesh.map(|mesh| [Path::new("--scene"), mesh]).into_iter().flatten())
            }
        };
        command.args(["--for", &bound, "--workers", &self.workers.to_string()]);
        if let Some(path) = &self.record {
            let _ = std::fs::remove_file(path); // that of the round before
            command.arg("--record").arg(path);
        }
        if self.without.is_some() {
            let mut roles: Vec<&str> = self.slots().iter().map(|slot| slot.role().name()).collect();
            roles.dedup();
            command.args(["--roles", &roles.join(",")]);
        }
        Ok(command)
    }
}

/// A station that was started here; killed and removed when dropped.
struct Running {
    child: Child,
    said: Said,
    place: Place,
}

impl Running {
    fn start(place: Place, mut command: Command) -> Result<Running, Refusal> {
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|e| not_started(Path::new(command.get_program()), &e))?;
        let said = Said::of(child.stderr.take());
        Ok(Running { child, said, place })
    }

    fn has_ended(&mut self) -> Option<i32> {
        self.child.try_wait().ok().flatten().map(|status| status.code().unwrap_or(1))
    }

    /// Waits until everyone is ready and the hand moves, and measures one window.
    fn measure(&mut self, slots: &[Slot], window_ns: u64) -> Result<Window, Refusal> {
        let failed = |what: &str| Refusal::failed(format!("bench: the station {what}; `hystation doctor` may say why"));
        let end_ns = system::now_ns() + START_NS;
        let mut viewer = loop {
            if self.has_ended().is_some() {
                return Err(failed("ended while it started"));
            }
            // Not founded yet is as good as not ready yet.
            let viewer = Viewer::open(&self.place.0).ok();
            let waits_for = match viewer {
                None => "its founding".to_string(),
                Some(mut viewer) => match unready(&mut viewer, slots) {
                    None => break viewer,
                    Some(names) => names,
                },
            };
            if system::now_ns() > end_ns {
                return Err(failed(&format!("was not ready in time, it still waits for {waits_for}")));
            }
            system::sleep_ns(LOOK_NS);
        };
        let before = probe::look(&mut viewer);
        system::sleep_ns(window_ns);
        let after = probe::look(&mut viewer);
        if self.has_ended().is_some() {
            return Err(failed("ended while it was measured"));
        }
        Ok(probe::window(&mut viewer, &before, &after))
    }

    /// Kills rendering, and waits for its successor's first picture; gives the time between, s. Where none comes that is as long as it was waited for: it took
    /// longer still. `None` where the station cannot be looked at.
    fn kill_rendering(&mut self) -> Option<f64> {
        let slot = Slot::first(Role::Rendering);
        let mut viewer = Viewer::open(&self.place.0).ok()?;
        let (killed, begun_ns) = (viewer.page().incarnation(slot), system::now_ns());
        proc::signal(viewer.page().pid(slot), Signal::KILL);
        while system::now_ns() < begun_ns + PICTURE_NS {
            system::sleep_ns(PICTURE_LOOK_NS);
            let Some(page) = viewer.slot_page(slot).filter(|page| page.incarnation() != killed) else { continue };
            if page.cell(rendering::STATUS).is_some_and(|(_, status)| status.shown_tick > 0) {
                break;
            }
        }
        Some((system::now_ns() - begun_ns) as f64 * 1e-9)
    }

    /// Stops it as Ctrl-C does; gives its exit code and, if that is not 0, what it said.
    fn stop(mut self) -> (i32, String) {
        if self.has_ended().is_none() {
            proc::signal(self.child.id(), Signal::INT);
        }
        let code = program::ends_within(&mut self.child, STOP_NS).map_or(1, |status| status.code().unwrap_or(1));
        let said = if code == 0 { String::new() } else { self.said.text() };
        (code, said.trim().to_string())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        program::end(&mut self.child); // before its place is cleared
    }
}

/// Who is not ready yet; `None` if everyone is and the hand moves.
fn unready(viewer: &mut Viewer, slots: &[Slot]) -> Option<String> {
    let names: Vec<String> = slots.iter().filter(|slot| !viewer.says_ready(**slot)).map(Slot::to_string).collect();
    let hand = viewer.slot_page(Slot::first(Role::Hardware)).map_or(0, |page| page.load64(header::TICK));
    match names.is_empty() {
        true if hand >= FIRST_TICK => None,
        true => Some("the hand to move".into()),
        false => Some(names.join(", ")),
    }
}
