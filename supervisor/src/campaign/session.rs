//! One station of a campaign: started as an operator would start it, watched through its pages, hurt over its control socket, stopped, and
//! its report read. Every wait is bounded, and whatever happens, nothing of the station is left.

mod closing;
mod counters;
mod end;
mod handover;
mod keepers;
mod swaps;

use super::cell::{Cell, State};
use super::draw::Entry;
use super::file::{Arm, Campaign};
use super::outcome::{Ending, Outcome};
use crate::control::{self, Request};
use crate::doing::Strokes;
use crate::faultfile::{Injection, Keepers};
use crate::ledger::AFTERMATH_TICKS;
use crate::plan::Plan;
use crate::remains;
use crate::view::Viewer;
use closing::{Asked, Begun, Done, Omitted};
pub use end::Ended;
use hyst_exchange::{Station, system};
use hyst_messages::{Role, Slot, TICK_NS};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A start takes a second on an idle machine, and much longer on one that compiles beside it.
const START_NS: u64 = 120_000_000_000;
/// A station that is not whole and in the wanted state by then will not be: the hands' periods are at most 12 s.
const READY_NS: u64 = 60_000_000_000;
/// Between two looks.
const LOOK_NS: u64 = 5_000_000;
/// The fault is asked for at least this long before its tick: the socket and the supervisor's loop take 10 ms of it, more on a busy machine.
const AHEAD_TICKS: u64 = 35;
/// And at most this much earlier: two looks and some. Together less than what the supervisor waits (`moment::MOST_AHEAD_NS`).
const EARLY_TICKS: u64 = 15;
/// A station that was whole for this long has settled (the policy's SETTLED_NS, and a margin).
const SETTLED_TICKS: u64 = 150;
/// Ticks between the end of a fault's window, and of a swap, and the next fault or its swap: what it may do to the hand later, and room for a control window.
const QUIET_TICKS: u64 = AFTERMATH_TICKS + 320;
/// Longest run of a station beyond what its faults should take, s: it ends by itself if the campaign was killed while nobody ran the station for it.
const SPARE_TIME_S: u64 = 1_800;

/// Why a station cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum Trouble {
    /// Ctrl-C.
    #[error("interrupted; the same command goes on where it ended")]
    Interrupted,
    /// The station has ended by itself.
    #[error("the station ended by itself; {0} has its words")]
    Ended(String),
    /// It was refused, as any other with these settings would be.
    #[error("{0}")]
    Refused(String),
    /// It did not become whole.
    #[error("the station was not whole and settled within {0} s; {1} has its words")]
    NotWhole(u64, String),
    /// The system.
    #[error("{0}: {1}")]
    System(String, std::io::Error),
}

/// A running station.
pub struct Session {
    station: Station,
    /// What starts it, and takes it over if its guardian was killed.
    command: Command,
    child: Child,
    viewer: Option<Viewer>,
    slots: Vec<Slot>,
    /// Its log, report and recording, without their endings.
    files: PathBuf,
    interrupted: Arc<AtomicBool>,
    /// Bytes of the closed faults' file that were read.
    read_bytes: u64,
    whole_since_tick: Option<u64>,
    strokes: Strokes,
    quiet_from_tick: u64,
    /// It was ended, or never was: the name is another's, or the settings were refused.
    is_over: bool,
}

impl Session {
    /// Starts the station.
    pub fn start(
        campaign: &Campaign,
        arm: &Arm,
        entries: &[&Entry],
        station: &Station,
        files: &Path,
        interrupted: Arc<AtomicBool>,
    ) -> Result<Session, Trouble> {
        let said = files.with_extension("log");
        let _ = std::fs::remove_file(files.with_extension("mcap")); // of a run that was killed: the recorder would refuse it
        let trouble = |e| Trouble::System(format!("{}: a folder that can be written is needed", said.display()), e);
        let log = std::fs::OpenOptions::new().create(true).append(true).open(&said).map_err(trouble)?;
        let mut command =
            command(campaign, arm, entries, station, files).map_err(|e| Trouble::System("this program".into(), e))?;
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(log);
        let child = command.spawn().map_err(|e| Trouble::System("cannot start `hystation run`".into(), e))?;
        Ok(Session {
            station: station.clone(),
            command,
            child,
            viewer: None,
            slots: Vec::new(),
            files: files.to_path_buf(),
            interrupted,
            read_bytes: 0,
            whole_since_tick: None,
            strokes: Strokes::default(),
            quiet_from_tick: 0,
            is_over: false,
        })
    }

    /// Waits until the station is whole.
    pub fn await_whole(&mut self) -> Result<(), Trouble> {
        let whole = self.wait(START_NS, |session| {
            if session.viewer.is_none() {
                // Both are made by the guardian; the viewer opens once all pages are there.
                session.slots = Plan::read(&session.station).ok()?.slots();
                session.viewer = Viewer::open(&session.station).ok();
            }
            session.whole().then_some(())
        });
        let whole = whole.map_err(|trouble| self.why_refused().map_or(trouble, Trouble::Refused))?;
        whole.ok_or_else(|| Trouble::NotWhole(START_NS / 1_000_000_000, self.said()))
    }

    /// What it said if it has ended with the exit code of bad input: then nothing was founded.
    fn why_refused(&mut self) -> Option<String> {
        let code = self.child.try_wait().ok().flatten()?.code()?;
        self.is_over = code == 2;
        let line = crate::journal::last_line_of(&self.files.with_extension("log")).unwrap_or_default();
        self.is_over.then(|| line.trim_start_matches("hystation: ").to_string())
    }

    fn said(&self) -> String {
        self.files.with_extension("log").display().to_string()
    }

    /// Looks until something is found; `None` when the time is over.
    fn wait<T>(&mut self, limit_ns: u64, mut found: impl FnMut(&mut Session) -> Option<T>) -> Result<Option<T>, Trouble> {
        let end_ns = system::now_ns() + limit_ns;
        loop {
            if let Some(it) = found(self) {
                return Ok(Some(it));
            }
            if self.interrupted.load(Ordering::Relaxed) {
                return Err(Trouble::Interrupted);
            }
            if !matches!(self.child.try_wait(), Ok(None)) {
                return Err(Trouble::Ended(self.said()));
            }
            if system::now_ns() >= end_ns {
                return Ok(None);
            }
            system::sleep_ns(LOOK_NS);
        }
    }

    /// The tick now; 0 before the station has pages.
    pub fn tick(&self) -> u64 {
        self.viewer.as_ref().map_or(0, |viewer| viewer.page().tick_at(system::now_ns()))
    }

    /// Whether every process of the plan, and the supervisor, is there and warm or live, and no role is held still or goes on from an older state, in which
    /// the next death counts as one more of the same trouble; notes since when.
    fn whole(&mut self) -> bool {
        let tick = self.tick();
        let Some(viewer) = &mut self.viewer else { return false };
        let lives = |role| remains::slot_alive(viewer.page(), Slot::first(role).number()).is_some();
        let supervised = lives(Role::Supervisor) && lives(Role::Guardian);
        let page = viewer.page();
        let in_trouble = |role: &Role| page.is_held(*role) || page.ground_tick(*role) != u64::MAX;
        let troubled = Role::STATEFUL.iter().any(in_trouble);
        let whole = supervised && !troubled && !self.slots.is_empty() && self.slots.iter().all(|slot| viewer.is_well(*slot));
        self.whole_since_tick = if whole { Some(self.whole_since_tick.unwrap_or(tick)) } else { None };
        whole
    }

    fn settled(&mut self) -> bool {
        let tick = self.tick();
        self.whole()
            && self.whole_since_tick.is_some_and(|since| tick >= since + SETTLED_TICKS)
            && tick + AHEAD_TICKS >= self.quiet_from_tick
    }

    /// Injects one fault of the plan at its tick, or as soon after it as the station is whole, settled and in the wanted state, and waits
    /// until it is closed. What the station comes to after the fault was injected is the fault's outcome, and ends the session.
    pub fn hurt(&mut self, entry: &Entry, cell: &Cell) -> Result<(Outcome, Option<Trouble>), Trouble> {
        let mut outcome = Outcome::of(entry);
        let now_tick = self.tick();
        let until_ns = entry.tick.saturating_sub(now_tick) * TICK_NS + READY_NS;
        let state = cell.state;
        let ready = self.wait(until_ns, |session| {
            let near = session.settled() && session.tick() + AHEAD_TICKS + EARLY_TICKS >= entry.tick;
            (near && session.is_in(state)).then(|| entry.tick.max(session.tick() + AHEAD_TICKS))
        })?;
        let Some(tick) = ready else {
            if !self.settled() {
                return Err(Trouble::NotWhole(READY_NS / 1_000_000_000, self.said()));
            }
            outcome.ending = Ending::NoState;
            outcome.reason = format!("the station was never in the state of {:?}", cell.name);
            return Ok((outcome, None));
        };
        outcome.before = self.told_counters()?;
        outcome.earlier = self.unread();
        outcome.asked_ns = system::now_ns();
        let tick = match self.swap_beside(entry, cell, &mut outcome)? {
            Ok(beside) => beside.unwrap_or(tick),
            Err(reason) => {
                (outcome.ending, outcome.reason) = (Ending::Refused, reason);
                return Ok((outcome, None));
            }
        };
        let hurt = self.hurt_at(&mut outcome, entry, cell, tick).and_then(|()| self.see_swap_end(&mut outcome, cell));
        match hurt.and_then(|()| self.told_counters()) {
            Ok(after) => outcome.after = after,
            Err(Trouble::Interrupted) => return Err(Trouble::Interrupted),
            Err(trouble) => {
                (outcome.reason, outcome.after) = (trouble.to_string(), outcome.before);
                return Ok((outcome, Some(trouble)));
            }
        }
        Ok((outcome, None))
    }

    /// Injects the fault, and the one in whose recovery or hand-over it is to come, and waits until they are closed.
    fn hurt_at(&mut self, outcome: &mut Outcome, entry: &Entry, cell: &Cell, tick: u64) -> Result<(), Trouble> {
        let sent_ns = system::now_ns();
        // Each of a cell's faults hits other bytes, and the same ones when it is repeated. What the second may cost lies in the first one's window as well.
        let in_full = |injection: &Injection| {
            let seed = injection.place.map(|_| injection.seed.unwrap_or(entry.index as u64));
            let allowed_misses = Some(cell.allowed_misses).filter(|ticks| *ticks > 0);
            Injection { seed, allowed_misses, ..injection.clone() }
        };
        let first = cell.with.as_ref().map(|with| self.inject(&in_full(with), tick, entry.phase_us));
        let injection = in_full(&cell.injection);
        let first_by_ns = first.as_ref().and_then(|done| Some(done.as_ref().ok()?.by_ns));
        let done = match first.transpose() {
            Err(omitted) => Err(omitted),
            Ok(_) => match self.second_tick(outcome, entry, cell, tick)? {
                Some(tick) => self.inject(&injection, tick, entry.phase_us),
                None => Err(Omitted::NoHandOver),
            },
        };
        let asked = |by_ns: u64, struck_ns| Asked { sent_ns, by_ns: by_ns.max(first_by_ns.unwrap_or(0)), struck_ns };
        self.whole_since_tick = None;
        match done {
            Ok(Done { by_ns, struck_ns }) => self.close(outcome, cell, asked(by_ns, struck_ns)),
            Err(omitted) => {
                let begun = Begun::of(cell, &omitted, first_by_ns.is_some());
                (outcome.ending, outcome.reason) = omitted.ending(&cell.name);
                if begun.processes() == 0 {
                    return Ok(());
                }
                self.close_rest(outcome, cell, asked(system::now_ns(), None), begun)
            }
        }
    }

    fn is_in(&mut self, state: State) -> bool {
        match state {
            State::Any | State::Recovery | State::Swap | State::Handover => true,
            State::Idle => self.counters().contacts == 0,
            State::Contact => self.counters().contacts > 0,
            State::Cutting => {
                let now = self.counters();
                self.strokes.cut(now.cuts, now.tissue_tick) && now.is_cutting
            }
        }
    }

    /// Gives when a keeper was struck: of an engine the station says it, also where nobody has answered.
    fn inject(&mut self, injection: &Injection, tick: u64, phase_us: u32) -> Result<Done, Omitted> {
        let start_ns = self.viewer.as_ref().map_or(0, |viewer| viewer.page().start_of(tick));
        system::sleep_until_ns(start_ns.saturating_sub((AHEAD_TICKS + EARLY_TICKS) * TICK_NS)); // at most a quarter of a second, for a second fault
        if let Some(keepers) = Keepers::parse(&injection.target) {
            let struck_ns = self.hurt_keepers(keepers, injection, start_ns + u64::from(phase_us) * 1_000);
            return struck_ns.map(Done::at).map_err(Omitted::Refused);
        }
        let request = Injection { tick, phase_us, ..injection.clone() };
        Done::of_answer(control::ask_once(&self.station, &Request::Fault(request)).map(drop), system::now_ns())
    }
}

/// What starts a station for these faults.
pub(super) fn command(
    campaign: &Campaign,
    arm: &Arm,
    entries: &[&Entry],
    station: &Station,
    files: &Path,
) -> std::io::Result<Command> {
    use std::os::unix::process::CommandExt;
    let last_tick = entries.last().map_or(0, |entry| entry.tick);
    let mut command = Command::new(std::env::current_exe()?);
    // A group of its own: Ctrl-C is for the campaign, which then stops the station. One that is killed stops nobody: its station is asked to end by that.
    command.process_group(0).args(["--name", station.name(), "run", "--headless", "--test-mode", "--quiet"]);
    command.arg(format!("--with-parent={}", std::process::id()));
    command.arg("--for").arg(format!("{}s", (4 * last_tick / 1_000 + SPARE_TIME_S).min(86_000)));
    command.arg("--report").arg(files.with_extension("json"));
    if campaign.records() {
        command.arg("--record").arg(files.with_extension("mcap"));
    }
    command.arg("--hand").arg(campaign.hand());
    if let Some(workers) = campaign.station.workers {
        command.arg("--workers").arg(workers.to_string());
    }
    if let Some(folder) = campaign.binaries(arm) {
        command.arg("--binaries").arg(folder);
    }
    for (key, value) in campaign.set(arm) {
        command.arg("--set").arg(format!("{key}={value}"));
    }
    command.args(&campaign.station.scene);
    Ok(command)
}

#[cfg(test)]
mod skipped_tests;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::{draw, file};
    use crate::fault::Fault;
    use crate::faultfile::FaultKind;
    use crate::supervise::Input;
    use std::sync::mpsc::channel;
    use std::time::Duration;

    /// A session with a station of which nothing lives but a process that does nothing.
    pub(super) fn session(station: &Station) -> Session {
        let mut command = Command::new("sleep");
        command.arg("600");
        Session {
            station: station.clone(),
            child: command.spawn().unwrap(),
            command,
            viewer: None,
            slots: Vec::new(),
            files: PathBuf::new(),
            interrupted: Arc::default(),
            read_bytes: 0,
            whole_since_tick: None,
            strokes: Strokes::default(),
            quiet_from_tick: 0,
            is_over: true,
        }
    }

    /// Nobody waited for its end: the next fault came while it went on in the one whom it had come to, and read its line.
    #[test]
    fn a_first_fault_that_came_to_one_alone_of_two_is_waited_for_and_the_second_is_not_done() {
        let beside = "states = [\"handover\"]\nwith = \"leak-memory haptic:both rate=64.0\"\nallowed_misses = 300\n";
        let text = format!("[[cell]]\nkinds = [\"kill\"]\ntargets = [\"fluid:active\"]\ncount = 1\n{beside}");
        let campaign = file::parse("t", &text).unwrap();
        let entry = draw::plan(&campaign, 1).faults.remove(0);
        let station = Station::named(&format!("t{}-first-by-half", std::process::id())).unwrap();
        station.wipe();
        std::fs::create_dir(station.root()).unwrap();
        let closed = station.root().join("faults.jsonl");
        let (tell, inbox) = channel();
        control::serve(&station, tell).unwrap();
        let supervisor = std::thread::spawn(move || {
            let Ok(Input::Request(asked, reply)) = inbox.recv_timeout(Duration::from_secs(60)) else { return None };
            let (kind, injected_ns) = (FaultKind::LeakMemory.name().to_string(), system::now_ns());
            let fault = Fault { kind, target: "haptic:0".into(), injected_ns, ..Fault::default() };
            reply.send(control::half("haptic:0 was hit alone")).unwrap();
            system::sleep_ns(10 * LOOK_NS); // it is closed later than it is answered
            std::fs::write(closed, format!("{}\n", serde_json::to_string(&fault).unwrap())).unwrap();
            Some((asked, inbox))
        });
        let mut session = session(&station);
        let mut outcome = Outcome::of(&entry);
        session.hurt_at(&mut outcome, &entry, &campaign.cells[0], 0).unwrap();
        let (asked, inbox) = supervisor.join().unwrap().unwrap();
        let Request::Fault(ref first) = asked else { panic!("{asked:?}") };
        assert_eq!((first.target.as_str(), first.allowed_misses), ("haptic:both", Some(300)), "it is told what that may cost");
        assert!(inbox.try_recv().is_err(), "the second was asked for");
        let reason = "haptic:0 was hit alone".to_string();
        assert_eq!((outcome.ending, outcome.reason, outcome.fault), (Ending::Refused, reason, None));
        assert_eq!(outcome.with.map(|fault| fault.target), Some("haptic:0".into()));
        assert_eq!((outcome.collateral, session.quiet_from_tick), (vec![], QUIET_TICKS));
        session.child.kill().unwrap();
        session.child.wait().unwrap();
        station.wipe();
    }
}
