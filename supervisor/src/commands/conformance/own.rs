//! What an engine does that nobody on a probation asks about: what its steps take from the allocator, whether they are in time, whether it does wrong when it is
//! asked to, without which no fault can be tried on it, and how it ends with the station. All of it is read from pages: what the engine counts of itself, and what the
//! supervisor and the guardian say of its end.

use super::{CAN_BE_LATE, Check, Private, active, check};
use crate::control::{self, Request};
use crate::faultfile::{FaultKind, Injection};
use crate::view::ProcessView;
use hyst_exchange::{Station, StationError, StationPage, system};
use hyst_messages::page::{header, station as layout};
use hyst_messages::{Role, Slot};
use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::ExitStatus;
use std::time::SystemTime;

/// How long steps are looked at, ns: a thousand of a real-time role, two dozen of a fluid.
const WINDOW_NS: u64 = 1_000_000_000;
/// How often, if something is bad: a stall of the machine is over by then.
const WINDOWS: usize = 3;
/// Share of the steps that may enter the allocator: a change of holder was seen to cost single entries, and one in each step is a hundred times that.
const MOST_ENTRIES: f64 = 0.01;
/// Small blocks that the link takes from the thread's own pool in a step, one for each message: a state and a job of a tissue, one message of the others; and
/// half of one, for messages that a stall has delayed.
const TISSUE_BLOCKS: f64 = 2.5;
const SENDER_BLOCKS: f64 = 1.5;
/// Share of the steps that may end after the next one had to begin, beyond twice that of the engine before in the same station.
const MOST_LATE: f64 = 0.05;
/// Share of the steps of the engine before of which at most may do so for that to be told: with more, one that is late in each second step is within it.
const MOST_LATE_BEFORE: f64 = 0.2;
/// For how long it is asked to do wrong, s; and how long it may take to begin, ns: the pictures of a software driver take a second on a busy machine.
const WRONG_FOR_S: f64 = 3.0;
const BEGINS_WITHIN_NS: u64 = 2_500_000_000;
const LOOK_NS: u64 = 1_000_000;
/// Before anything else is looked at, ns: whoever is replaced for what it did is gone by then.
const REST_NS: u64 = 300_000_000;
/// How often it is asked: the one that was asked first may have been about to end.
const ASKED: usize = 2;
/// What supervisor and guardian say of whom they have to kill.
const NOT_STOPPED: &str = "did not stop";
/// Lines of its log that are shown, and bytes of each log that are read for them.
const LOG_LINES: usize = 20;
const LOG_BYTES: u64 = 64 << 10;

/// What the page of a process counts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Count {
    steps: u64,
    overruns: u64,
    /// Entries into the system's allocator.
    entries: u64,
    /// Small blocks from the thread's own pool.
    blocks: u64,
}

impl Count {
    fn less(self, before: &Count) -> Count {
        Count {
            steps: self.steps.saturating_sub(before.steps),
            overruns: self.overruns.saturating_sub(before.overruns),
            entries: self.entries.saturating_sub(before.entries),
            blocks: self.blocks.saturating_sub(before.blocks),
        }
    }
}

fn counts(station: &Station, role: Role) -> Result<BTreeMap<u32, Count>, StationError> {
    let clock = station.open()?;
    let mut counts = BTreeMap::new();
    for (slot, incarnation) in clock.occupied(role).filter(|(slot, _)| !clock.is_dead(*slot)) {
        let Ok(page) = station.read_slot(slot, incarnation) else { continue };
        let words = [header::STEPS, header::OVERRUNS, header::ALLOCATIONS, header::POOL_BLOCKS];
        let [steps, overruns, entries, blocks] = words.map(|word| page.load64(word));
        counts.insert(incarnation, Count { steps, overruns, entries, blocks });
    }
    Ok(counts)
}

/// What those of a role did in a window who lived from its beginning to its end.
fn window(station: &Station, role: Role) -> Vec<Count> {
    let before = counts(station, role).unwrap_or_default();
    system::sleep_ns(WINDOW_NS);
    let after = counts(station, role).unwrap_or_default();
    after.into_iter().filter_map(|(incarnation, count)| Some(count.less(before.get(&incarnation)?))).collect()
}

/// Whether a step of the role must allocate nothing; a driver, a disk and a server that others wrote may.
fn allocates_nothing(role: Role) -> bool {
    matches!(role, Role::Device | Role::Haptic | Role::Tissue | Role::Fluid | Role::CollisionWorker)
}

/// Whether its steps begin by the clock, so that one may be late; of pictures that is no fault, since they give way.
fn is_paced(role: Role) -> bool {
    matches!(role, Role::Device | Role::Tissue | Role::Fluid)
}

/// What the steps of a window took from the allocator.
fn of_allocator(role: Role, window: &[Count]) -> Result<String, String> {
    let sum = |of: fn(&Count) -> u64| window.iter().map(of).fold(0, u64::saturating_add);
    let (steps, entries, blocks) = (sum(|count| count.steps), sum(|count| count.entries), sum(|count| count.blocks));
    if steps == 0 {
        return Err("no step is counted in its page".into());
    }
    let most_blocks = if role == Role::Tissue { TISSUE_BLOCKS } else { SENDER_BLOCKS };
    match () {
        () if entries as f64 > MOST_ENTRIES * steps as f64 => {
            Err(format!("{entries} entries into the allocator in {steps} steps"))
        }
        () if blocks as f64 > most_blocks * steps as f64 => Err(format!("{blocks} small blocks in {steps} steps")),
        () => Ok(format!("{entries} entries into the allocator in {steps} steps")),
    }
}

/// The largest share of late steps among the processes of a window.
fn share_of_late(window: &[Count]) -> f64 {
    let shares = window.iter().filter(|count| count.steps > 0).map(|count| count.overruns as f64 / count.steps as f64);
    shares.fold(0.0, f64::max)
}

/// Whether the steps of a window are in time, where this share of the engine's before was late.
fn in_time(late_before: f64, window: &[Count]) -> Result<String, String> {
    if window.iter().all(|count| count.steps == 0) {
        return Err("nobody of the role made steps from the beginning to the end of a second".into());
    }
    let late = share_of_late(window);
    let told = format!("{:.1} % of its steps end late, {:.1} % of the engine's before", 100.0 * late, 100.0 * late_before);
    if late > MOST_LATE + 2.0 * late_before { Err(told) } else { Ok(told) }
}

/// The share of late steps of whoever has the role now, the least of some windows, until it is one by which others can be judged; 0 of a role that has no clock.
pub(super) fn late_share(station: &Station, role: Role) -> f64 {
    let mut least = if is_paced(role) { 1.0 } else { 0.0 };
    for _ in 0..WINDOWS {
        if least > MOST_LATE {
            least = share_of_late(&window(station, role)).min(least);
        }
    }
    least
}

/// Whether that of the engine before tells anything of another one.
fn can_be_late(late_before: f64) -> Result<String, String> {
    let told = format!("{:.1} % of the steps of the engine before end late", 100.0 * late_before);
    if late_before <= MOST_LATE_BEFORE { Ok(told) } else { Err(format!("{told}: on this machine nobody is in time")) }
}

/// Looks at the steps of who has the role.
pub(super) fn steps(role: Role, private: &mut Private, late_before: f64) -> Vec<Check> {
    let mut found = Vec::new();
    for _ in 0..if allocates_nothing(role) && !private.is_given_up() { WINDOWS } else { 0 } {
        let whole = active(role, private);
        let window = window(&private.station, role);
        let judged = |judge: &dyn Fn(&[Count]) -> Result<String, String>| whole.clone().and_then(|_| judge(&window));
        found = vec![check("allocates nothing in a step", judged(&|window| of_allocator(role, window)))];
        if is_paced(role) {
            let told = can_be_late(late_before);
            found.push(match told {
                Ok(_) => check("makes its steps in time", judged(&|window| in_time(late_before, window))),
                Err(_) => check(CAN_BE_LATE, told),
            });
        }
        if found.iter().all(|check| check.good || check.what == CAN_BE_LATE) || private.is_given_up() {
            break;
        }
    }
    found
}

/// Asks who has the role to hang and, where others compute from what it says, to lie: its page counts what it did so. Then all are there again.
pub(super) fn does_wrong(role: Role, private: &mut Private) -> Vec<Check> {
    let kinds = [(FaultKind::Nan, "lies when it is asked to"), (FaultKind::Block, "hangs when it is asked to")];
    let mut found = Vec::new();
    for (kind, what) in kinds {
        if kind.hindrance(role).is_none() {
            found.push(check(what, obeys(role, private, kind)));
            system::sleep_ns(REST_NS);
        }
    }
    let _ = active(role, private); // if nobody comes back, the next check says so
    found
}

fn obeys(role: Role, private: &mut Private, kind: FaultKind) -> Result<String, String> {
    let mut asked = Err(String::new());
    for _ in 0..ASKED {
        let active = active(role, private)?;
        asked = ask(&private.station, &active, kind);
        if asked.is_ok() {
            break;
        }
    }
    asked
}

fn ask(station: &Station, active: &ProcessView, kind: FaultKind) -> Result<String, String> {
    let name = &active.name;
    let slot = Slot::parse(name).ok_or_else(|| format!("{name} is no process"))?;
    let page = station.read_slot(slot, active.incarnation).map_err(|error| error.to_string())?;
    let done = page.load64(header::MISCHIEF);
    let injection = Injection { for_s: Some(WRONG_FOR_S), ..Injection::now(kind, name) };
    control::ask(station, &Request::Fault(injection))?;
    let begun_ns = system::now_ns();
    while page.load64(header::MISCHIEF) == done && system::now_ns() < begun_ns + BEGINS_WITHIN_NS {
        system::sleep_ns(LOOK_NS);
    }
    let (after_ms, has_begun) = ((system::now_ns() - begun_ns) as f64 * 1e-6, page.load64(header::MISCHIEF) != done);
    // It may have been replaced for it by now, and then nothing is left to end.
    let _ = control::ask(station, &Request::Fault(Injection::now(FaultKind::Undo, name)));
    if has_begun {
        return Ok(format!("{}: after {after_ms:.0} ms", kind.name()));
    }
    Err(format!("{}: {name} has not done so after {after_ms:.0} ms; `Life::misbehave` is to be called in each step", kind.name()))
}

/// The processes of a role before the station stops, and the page in which their end will be told: it is mapped, and outlives its file.
pub(super) struct Ends {
    clock: Option<StationPage>,
    processes: Vec<(Slot, u32)>,
}

impl Ends {
    /// Those that live.
    pub(super) fn of(station: &Station, role: Role) -> Ends {
        let clock = station.open().ok();
        let of = |clock: &StationPage| {
            let living = clock.occupied(role).filter(|(slot, _)| !clock.is_dead(*slot) && clock.pid(*slot) != 0);
            living.map(|(slot, _)| (slot, clock.pid(slot))).collect::<Vec<_>>()
        };
        let processes = clock.as_ref().map(of).unwrap_or_default();
        Ends { clock, processes }
    }

    /// How they have ended, once the station has, which said so much meanwhile: whom it has to kill it names.
    pub(super) fn told(&self, said: &str) -> Result<String, String> {
        let Some(clock) = &self.clock else { return Err("the station had ended before".into()) };
        let mut told = Vec::new();
        for (slot, pid) in &self.processes {
            let name = slot.to_string();
            if said.lines().any(|line| line.contains(NOT_STOPPED) && line.contains(&name)) {
                return Err(format!("{name}: {}", killed()));
            }
            let word = clock.page().load64(layout::SLOT_EXIT + slot.number());
            told.push(format!("{name}: {}", end(layout::exit_of(word, *pid)).map_err(|why| format!("{name}: {why}"))?));
        }
        if told.is_empty() { Err("nobody of the role lived when the station stopped".into()) } else { Ok(told.join(", ")) }
    }
}

fn killed() -> String {
    format!("had to be killed {} s after the station's stop", crate::supervise::STOP_NS / 1_000_000_000)
}

/// What an end says, as `waitpid` gives it, if it is known.
fn end(status: Option<i32>) -> Result<&'static str, String> {
    let Some(status) = status.map(ExitStatus::from_raw) else { return Ok("how it ended was not seen") };
    match (status.code(), status.signal().and_then(rustix::process::Signal::from_named_raw)) {
        (Some(0), _) => Ok("exit code 0"),
        (None, Some(rustix::process::Signal::KILL)) => Err(killed()),
        _ => Err(format!("{status}; it must be exit code 0")),
    }
}

/// What the processes of a role have printed last, each line with the slot's name.
pub(super) fn last_lines(station: &Station, role: Role) -> Vec<String> {
    let slots = (0..role.slots().1).filter_map(|index| Slot::new(role, index));
    let mut logs: Vec<(SystemTime, String, String)> = slots
        .filter_map(|slot| {
            let (changed, text) = tail(&station.log(slot)).ok()?;
            Some((changed, slot.to_string(), text))
        })
        .collect();
    logs.sort();
    let lines = logs.iter().flat_map(|(_, slot, text)| text.lines().map(move |line| format!("{slot}: {line}")));
    let lines: Vec<String> = lines.collect();
    lines[lines.len().saturating_sub(LOG_LINES)..].to_vec()
}

/// When a log was written last, and its end.
fn tail(path: &Path) -> std::io::Result<(SystemTime, String)> {
    let mut file = std::fs::File::open(path)?;
    let about = file.metadata()?;
    file.seek(SeekFrom::Start(about.len().saturating_sub(LOG_BYTES)))?;
    let mut bytes = Vec::new();
    file.take(LOG_BYTES).read_to_end(&mut bytes)?;
    Ok((about.modified()?, String::from_utf8_lossy(&bytes).into_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counted(steps: u64, overruns: u64, entries: u64, blocks: u64) -> Count {
        Count { steps, overruns, entries, blocks }
    }

    #[test]
    fn a_step_that_allocates_is_told_from_single_entries_and_from_the_blocks_of_messages() {
        let judged = |role: Role, count: Count| of_allocator(role, &[count, counted(1_000, 0, 0, 0)]).is_ok();
        assert!(judged(Role::Tissue, counted(1_000, 0, 4, 2_000)), "a change of holder, and two messages in each step");
        assert!(!judged(Role::Haptic, counted(1_000, 0, 1_000, 0)), "one in each step");
        assert!(!judged(Role::Tissue, counted(1_000, 0, 0, 6_000)), "small ones");
        assert!(!judged(Role::Fluid, counted(1_000, 0, 0, 4_000)), "small ones beside its message");
        assert!(of_allocator(Role::Haptic, &[]).is_err_and(|why| why.contains("no step is counted")));
    }

    #[test]
    fn steps_that_are_late_count_against_those_of_the_engine_before() {
        let window = [counted(1_000, 0, 0, 0), counted(100, 20, 0, 0), counted(0, 3, 0, 0)];
        assert_eq!(share_of_late(&window), 0.2, "of the one that is late most often");
        assert!(in_time(0.0, &window).is_err() && in_time(0.07, &window).is_err());
        assert!(in_time(0.08, &window).is_ok(), "this machine lets nobody be in time");
        let each_second = [counted(33, 16, 0, 0)];
        assert!(can_be_late(MOST_LATE_BEFORE).is_ok() && in_time(MOST_LATE_BEFORE, &each_second).is_err());
        assert!(can_be_late(0.21).is_err_and(|why| why.starts_with("21.0 % of the steps")));
        assert!(in_time(0.0, &[counted(1_000, 40, 0, 0)]).is_ok() && in_time(0.0, &[]).is_err());
    }

    #[test]
    fn an_end_by_itself_is_told_from_one_that_somebody_had_to_bring_about() {
        let code = |code: i32| code << 8;
        assert_eq!((end(Some(code(0))), end(None)), (Ok("exit code 0"), Ok("how it ended was not seen")));
        assert!(end(Some(9)).is_err_and(|why| why == "had to be killed 2 s after the station's stop"));
        assert!(end(Some(code(3))).is_err_and(|why| why.contains('3')));
        assert!(end(Some(6)).is_err_and(|why| why.contains("must be exit code 0")));
    }

    #[test]
    fn who_had_to_be_killed_is_told_by_the_station_and_who_ended_by_its_exit_code() {
        let station = Station::named(&format!("t{}-ends", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let (page, slot) = (station.open_for_keeping().unwrap(), Slot::new(Role::Fluid, 1).unwrap());
        let ends = Ends { clock: station.open().ok(), processes: vec![(slot, 41)] };
        page.store64(layout::SLOT_EXIT + slot.number(), layout::exit_word(41, 0));
        assert_eq!(
            ends.told("hystation: fluid:0 did not stop within 2000 ms and is killed\n"),
            Ok("fluid:1: exit code 0".into())
        );
        for said in ["fluid:1 did not stop within 2000 ms and is killed", "killed because they did not stop: fluid:0, fluid:1"] {
            assert!(ends.told(said).is_err_and(|why| why.starts_with("fluid:1: had to be killed")), "{said}");
        }
        page.store64(layout::SLOT_EXIT + slot.number(), layout::exit_word(41, 9));
        assert!(ends.told("").is_err_and(|why| why.contains("had to be killed")));
        station.wipe();
    }

    #[test]
    fn the_last_lines_are_those_of_the_log_that_was_written_last_and_no_more_than_twenty() {
        let station = Station::named(&format!("t{}-lines", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let [first, second] = [0, 1].map(|index| Slot::new(Role::Haptic, index).unwrap());
        std::fs::write(station.log(first), "old\n".repeat(5)).unwrap();
        std::fs::write(station.log(second), (0..18).map(|line| format!("line {line}\n")).collect::<String>()).unwrap();
        let past = SystemTime::now() - std::time::Duration::from_secs(60);
        std::fs::File::options().append(true).open(station.log(first)).unwrap().set_modified(past).unwrap();
        let lines = last_lines(&station, Role::Haptic);
        assert_eq!((lines.len(), lines[0].as_str(), lines[1].as_str()), (LOG_LINES, "haptic:0: old", "haptic:0: old"));
        assert_eq!(lines.last().map(String::as_str), Some("haptic:1: line 17"));
        station.wipe();
    }
}
