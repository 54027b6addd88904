//! The guardian: `hystation run`. It founds the station, starts the supervisor and starts it again when it dies, shows the table, and
//! at the end leaves nothing behind: no process, no shared memory, no file.
//!
//! Guardian and supervisor keep each other: one whose guardian dies starts a stand-in, which keeps the station without a terminal and makes room
//! for a `hystation run` of the same name and settings. If both die at once the engines run on, and that same command takes them over.

mod bell;
mod copied;
mod ended;
mod found;
mod kept;
mod order;
mod printer;
mod room;
mod session;

use crate::case::{self, RunCase};
use crate::cli::RunArgs;
use crate::journal::{self, Verdict};
use crate::name;
use crate::neighbours;
use crate::notify::Notifier;
use crate::plan::Plan;
use crate::recording::{self, RecordingView, folder};
use crate::remains;
use crate::report;
use crate::settings::{Refusal, prepare, why_headless};
use crate::spawn::note_exit;
use crate::supervise::register;
use crate::terminal::{self, Size};
use crate::view::{StationView, TEST_MODE, Viewer, table};
use bell::Bell;
use ended::{count_leftovers, judge, owes_report, recorded, remove_unbegun};
use found::{Ground, Wanted, settle, take_name};
use hyst_engine::{Address, Told};
use hyst_exchange::{OwnedPage, Roster, Station, system};
use hyst_messages::page::station as layout;
use hyst_messages::{Role, SLOTS, Slot};
use kept::Kept;
use order::Order;
use printer::Printer;
pub use room::size_for;
use rustix::process::{WaitId, WaitIdOptions, WaitOptions, waitid};
pub use session::PAGE_NS;
use session::Session;
use std::io::IsTerminal;
use std::os::unix::net::UnixListener;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Between two looks of the guardian: a dead supervisor is replaced, and a signal answered, this soon.
const LOOK_NS: u64 = 20_000_000;
/// Between two drawings of the table.
const DRAW_NS: u64 = 500_000_000;
/// How long `--until-end` leaves the end of a session in window and recording.
const LAST_LOOK_NS: u64 = 3_000_000_000;
/// How long `--for` waits for the last process to become ready before it counts.
const READY_WITHIN_NS: u64 = 30_000_000_000;
/// How long the supervisor may take to stop everything.
const STOP_NS: u64 = 4_000_000_000;
/// What a station needs in /dev/shm, calculated for the default scene with two workers. Each of two tissues has 163 MiB if every message of its segments
/// has been used and as much has been cut as there is room for: 117 states of 1.02 MB, 47 topologies of 0.85 MB, 15 jobs of 0.34 MB, 6 checkpoints. The
/// rest has 90 MiB (`ls -l /dev/shm`, 2026-11-22). While a fluid and a tissue are replaced, 28 and 163 MiB more.
pub const NEEDED_BYTES: u64 = 608 << 20;
/// Bytes of the nodes and the surface in a state of the default scene.
const DEFAULT_STATE_BYTES: u64 = 41_000;
/// What each further byte of a tissue's nodes and surface takes in three tissues, calculated likewise: 3 054 (`three-polyps.toml`) as long as half of a
/// mesh is less than the least room for what is cut, 4 700 where there are five tets for a node and that half is more.
const EACH_STATE_BYTE: u64 = 5_000;

/// What a station whose tissue has a state of this length needs in /dev/shm.
pub fn needed_bytes(state_bytes: u64) -> u64 {
    NEEDED_BYTES + EACH_STATE_BYTE * state_bytes.saturating_sub(DEFAULT_STATE_BYTES)
}

/// What one of the three tissues that there may be needs there beyond what it does in the default scene.
pub fn more_bytes_of_tissue(state_bytes: u64) -> u64 {
    (needed_bytes(state_bytes) - NEEDED_BYTES) / 3
}

struct Guardian {
    station: Station,
    page: OwnedPage,
    order: Order,
    name: UnixListener,
    notifier: Notifier,
    kept: Kept,
    seen: usize,
    lines: Vec<String>,
    /// Where the operator's page is, as it was last said.
    page_url: Option<String>,
    /// Since when the session of the case is known to be over.
    case_over_ns: Option<u64>,
    bell: Bell,
    draw: bool,
    printer: Printer,
}

/// Why the guardian no longer keeps the station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    /// The station is to end.
    Stop,
    /// Somebody else keeps it.
    Relieved,
}

/// Runs a station until it ends; gives the exit code.
pub fn run(name: &str, args: &RunArgs) -> Result<u8, Refusal> {
    let station = Station::named(name).map_err(|e| Refusal::input(e.to_string()))?;
    let case = RunCase::of(&station, args)?;
    case::check_end(args, case.as_ref())?;
    let signals = Signals::catch()?;
    let (settings, plan) = prepare(args, &station, case.as_ref(), &|| signals.stop.load(Ordering::Relaxed))?;
    let report =
        args.report.as_deref().map(std::path::absolute).transpose().map_err(|e| Refusal::input(format!("--report: {e}")))?;
    let in_folder = args.record.as_deref().is_some_and(folder::is_folder);
    let order = Order { report, for_s: args.for_s, until_end: args.until_end, in_folder, ..Order::default() };
    let name = take_name(&station)?;
    let wanted = Wanted { settings: &settings, in_folder, plan: &plan, case: case.as_ref(), again: args.again.as_ref() };
    let ground = settle(&station, &wanted, order, &|| signals.stop.load(Ordering::Relaxed))?;
    drop(case); // the root has it
    let draw = terminal::can_be_drawn_on() && !args.quiet;
    // On a virtual clock nobody's hand is to be warned.
    let hears = !args.quiet && !settings.lockstep && settings.switch("sound", true).unwrap_or(true);
    let bell = Bell::new(hears && std::io::stderr().is_terminal());
    let mut guardian = Guardian::new(station, name, ground, draw, bell)?;
    if settings.headless && !args.station.headless {
        guardian.tell(why_headless());
    }
    if let Some(file) = recording::file_of(&guardian.station).filter(|_| in_folder) {
        guardian.tell(&format!("recording into {}", file.display()));
    }
    let beside = if settings.test_mode { neighbours::warning(&guardian.station) } else { None };
    beside.iter().for_each(|line| guardian.tell(line));
    guardian.keep(&plan, &signals);
    Ok(guardian.end(&plan))
}

/// Takes the place of a guardian that died; the supervisor starts it.
pub fn stand_in(station: Station) -> Result<u8, Refusal> {
    let failed = |e: String| Refusal::failed(e);
    let signals = Signals::catch()?;
    let Some(name) = name::take(&station).map_err(|e| failed(e.to_string()))? else {
        return Ok(0); // the station has a guardian
    };
    // At once: by it whoever comes for the name tells one that makes room from a guardian that stays.
    let order = Order { stand_in: true, ..Order::read(&station).unwrap_or_default() };
    order.write(&station);
    let plan = Plan::read(&station).map_err(|e| failed(e.to_string()))?;
    let page = station.open_for_keeping().map_err(|e| failed(e.to_string()))?;
    register(&page, Role::Guardian);
    let mut guardian = Guardian::new(station, name, Ground { page, order, adopted: true }, false, Bell::new(false))?;
    match guardian.keep(&plan, &signals) {
        End::Stop => Ok(guardian.end(&plan)),
        End::Relieved => {
            // Said before the name is free: one that leaves in order is missed by nobody.
            guardian.page.store32(layout::SLOT_DEAD + Slot::first(Role::Guardian).number(), 1);
            Ok(0)
        }
    }
}

/// What was asked of this process by signals.
struct Signals {
    /// To end the station.
    stop: Arc<AtomicBool>,
    /// To pause, by Ctrl-Z: the engines would go on, and nobody would keep them.
    pause: Arc<AtomicBool>,
}

impl Signals {
    fn catch() -> Result<Signals, Refusal> {
        use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGTSTP};
        let signals = Signals { stop: Arc::default(), pause: Arc::default() };
        let of_flag = |(signal, flag): (i32, &Arc<AtomicBool>)| signal_hook::flag::register(signal, Arc::clone(flag));
        let flags = [(SIGINT, &signals.stop), (SIGTERM, &signals.stop), (SIGHUP, &signals.stop), (SIGTSTP, &signals.pause)];
        for flag in flags {
            of_flag(flag).map_err(|e| Refusal::failed(format!("signals: {e}")))?;
        }
        Ok(signals)
    }
}

impl Guardian {
    fn new(station: Station, name: UnixListener, ground: Ground, draw: bool, bell: Bell) -> Result<Guardian, Refusal> {
        let printer = Printer::start().map_err(|e| Refusal::failed(format!("a thread: {e}; look at the limit of processes")))?;
        // Engines whose supervisor died become children of the guardian, so that somebody reaps them.
        let _ = rustix::process::set_child_subreaper(Some(rustix::process::getpid())); // refused: then init reaps them
        let kept = Kept::new(&station);
        if ground.adopted {
            let who = if ground.order.stand_in { "a stand-in for the guardian" } else { "the guardian" };
            journal::say(&station, &format!("{who} (pid {}) has taken over the station", std::process::id()));
        }
        Ok(Guardian {
            station,
            page: ground.page,
            order: ground.order,
            name,
            notifier: Notifier::of_environment(),
            kept,
            seen: 0,
            lines: Vec::new(),
            page_url: None,
            case_over_ns: None,
            bell,
            draw,
            printer,
        })
    }

    /// Keeps the station until it is asked to stop, by whomever, or somebody else keeps it.
    fn keep(&mut self, plan: &Plan, signals: &Signals) -> End {
        // A supervisor mends it as it begins; there may be none, and nobody maps a roster with a damaged header.
        let _ = Roster::restore_header(&self.station); // refused: then it cannot be viewed either
        let Ok(mut viewer) = Viewer::open(&self.station) else {
            return End::Stop;
        };
        if self.page.load32(layout::TEST_MODE) != 0 && !self.draw {
            self.tell(TEST_MODE); // where there is a table it stands above it
        }
        let begin_ns = system::now_ns();
        let mut told = false;
        let mut next_draw_ns = 0;
        let mut is_main = !self.order.stand_in;
        loop {
            let now_ns = system::now_ns();
            self.reap();
            if signals.pause.swap(false, Ordering::Relaxed) {
                self.tell("a station does not pause; Ctrl-C ends it");
            }
            if signals.stop.load(Ordering::Relaxed)
                || self.page.load32(layout::STOP) != 0
                || !self.kept.keep(&self.station, &self.page, now_ns)
            {
                return End::Stop;
            }
            if name::was_knocked(&self.name) && self.order.stand_in {
                return End::Relieved;
            }
            if !is_main {
                // Not sooner: a `run` of the service that has knocked meanwhile is to stay its main process, whose end is the service's.
                is_main = true;
                self.notifier.say(&format!("MAINPID={}\n", std::process::id()));
            }
            if !told {
                let is_whole = plan.slots().into_iter().all(|slot| viewer.says_ready(slot));
                told = is_whole || now_ns - begin_ns > READY_WITHIN_NS;
                if told {
                    self.ready(begin_ns, now_ns, is_whole);
                }
            }
            if self.is_over(plan, now_ns) {
                return End::Stop;
            }
            self.notifier.watchdog(|| !self.kept.hangs());
            if now_ns >= next_draw_ns {
                next_draw_ns = now_ns + DRAW_NS;
                self.draw(&mut viewer);
            }
            system::sleep_ns(LOOK_NS);
        }
    }

    /// Whether the run has lasted as long as it was asked to.
    fn is_over(&self, plan: &Plan, now_ns: u64) -> bool {
        if self.order.until_end && self.case_over_ns.is_some_and(|since_ns| now_ns >= since_ns + LAST_LOOK_NS) {
            return true;
        }
        if let Some(end_tick) = plan.end_tick {
            return self.page.load64(layout::ENDED_TICK) >= end_tick;
        }
        let elapsed_s = self.order.ready_ns.map(|ready_ns| now_ns.saturating_sub(ready_ns) as f64 * 1e-9);
        elapsed_s.zip(self.order.for_s).is_some_and(|(elapsed_s, for_s)| elapsed_s >= for_s)
    }

    /// Says that the station runs, and whether all of it does: one that has waited long enough goes on with what there is.
    fn ready(&mut self, begin_ns: u64, now_ns: u64, is_whole: bool) {
        let name = self.station.name().to_string();
        let (after_s, how) =
            ((now_ns - begin_ns) as f64 * 1e-9, if is_whole { "is ready" } else { "runs, and not all of it is ready," });
        self.tell(&format!("station {name:?} {how} after {after_s:.1} s"));
        self.notifier.say(&format!("READY=1\nSTATUS=station {name} {}\n", how.trim_end_matches(',')));
        if self.order.ready_ns.is_none() {
            self.order.ready_ns = Some(now_ns);
            self.order.write(&self.station);
        }
    }

    /// Reaps every dead child: the supervisor, and engines that a dead supervisor left. How those ended is said first, for the next one.
    fn reap(&mut self) {
        let pid_in = |slot: usize| self.page.load32(layout::SLOT_PID + slot);
        while waitid(WaitId::All, WaitIdOptions::EXITED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT)
            .is_ok_and(|it| it.is_some())
        {
            (0..SLOTS).for_each(|slot| note_exit(&self.page, slot, pid_in(slot)));
            // One that died since is told of at once.
            let Ok(Some((pid, status))) = rustix::process::wait(WaitOptions::NOHANG) else { break };
            let pid = pid.as_raw_nonzero().get() as u32;
            if let Some(slot) = (0..SLOTS).find(|slot| pid_in(*slot) == pid) {
                self.page.store64(layout::SLOT_EXIT + slot, layout::exit_word(pid, status.as_raw()));
            }
        }
        self.kept.reaped();
    }

    fn tell(&mut self, line: &str) {
        if self.draw { self.lines.push(line.to_string()) } else { self.printer.say(line) }
    }

    fn draw(&mut self, viewer: &mut Viewer) {
        for line in journal::news(&self.station, &mut self.seen) {
            self.tell(line.trim_end());
        }
        let told = Told::read(&self.station, viewer.page().present_tick());
        if let Some(over) = told.as_ref().and_then(|told| told.over.as_ref()).filter(|_| self.case_over_ns.is_none()) {
            self.case_over_ns = Some(system::now_ns());
            self.tell(&format!("the session is over {over}"));
        }
        if self.bell.look(told.as_ref(), viewer) {
            self.printer.ring();
        }
        if self.draw {
            let view = viewer.look_all();
            self.printer.show(screen(&view, told.map_or(Vec::new(), |told| told.lines), &mut self.lines));
            return;
        }
        // As soon as the console has written it, and again if another one had to take another port.
        let url = Address::read(&self.station).map(|address| address.url());
        if url.is_some() && url != self.page_url {
            // A service's words are kept, and read by others than its user.
            let end = if std::env::var_os("JOURNAL_STREAM").is_some() { '?' } else { '\n' };
            let shown = url.as_deref().and_then(|url| url.split(end).next()).unwrap_or_default();
            self.tell(&format!("operator's page: {shown}"));
            self.page_url = url;
        }
    }

    /// Stops everything, kills what does not stop, writes the report, removes everything.
    fn end(mut self, plan: &Plan) -> u8 {
        self.notifier.say("STOPPING=1\n");
        self.page.store32_and_wake(layout::STOP, 1);
        self.page.bump_and_wake(layout::CHANGES);
        let station = self.station.clone();
        let deadline_ns = system::now_ns() + STOP_NS;
        remains::wait_until_gone(&station, deadline_ns, || self.reap());
        let killed = remains::kill_all(&station, || self.reap());
        for line in journal::news(&station, &mut self.seen) {
            self.printer.say(line.trim_end());
        }
        if !killed.is_empty() {
            self.printer.say(&format!("killed because they did not stop: {}", killed.join(", ")));
        }
        let verdict = Verdict::read(&station);
        let mut report = report::take(&station);
        let faults = report::summary(&report);
        let recording = recorded(&station, plan);
        let loss = recording.as_ref().and_then(RecordingView::loss);
        if let Some(recording) = &recording {
            report["recording"] = serde_json::json!(recording);
        }
        let unbegun = remove_unbegun(&station, &self.order);
        let session = Session::of(&station, &self.order);
        crate::shortage::relieve_all(&station, |_| false);
        station.wipe();
        let left = count_leftovers(&station);
        report["leftovers"] = left.clone();
        self.printer.say(&faults);
        report::broken(&report).iter().for_each(|line| self.printer.say(line));
        loss.iter().for_each(|loss| self.printer.say(loss));
        if let Some(file) = unbegun {
            self.printer.say(&format!("{} is removed: no recording was begun in it", file.display()));
        }
        let mut code = judge(&report, &left, owes_report(&self.page, plan), loss.is_some());
        if let Some(verdict) = verdict {
            self.printer.say(&verdict.message);
            code = verdict.code;
        }
        if let Some(path) = &self.order.report
            && let Err(error) = std::fs::write(path, format!("{report:#}\n"))
        {
            self.printer.say(&format!("--report {}: {error}; give a path that can be written", path.display()));
            code = code.max(1);
        }
        session.iter().for_each(|session| self.printer.say(&session.tell(&mut self.notifier)));
        self.printer.finish();
        code
    }
}

/// Events that are shown under the table.
const SHOWN_LINES: usize = 8;

/// The whole screen: table and newest events, drawn over the one before.
fn screen(view: &StationView, case: Vec<String>, lines: &mut Vec<String>) -> String {
    let surplus = lines.len().saturating_sub(SHOWN_LINES);
    lines.drain(..surplus);
    let above = format!("{}\n{}", table(view), case.join("\n"));
    terminal::screen(&above, lines, "Ctrl-C stops the station and removes everything.\n", Size::now())
}
