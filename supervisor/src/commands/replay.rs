//! `hystation replay`: a station in lock-step whose hand, medium and order of steps are those of a recording, so that the same engines compute the same
//! forces and the same states; `--verify` records it and compares tick by tick.

mod beside;
mod look;
mod origin;
mod pace;

use super::large;
use crate::case::{RecordedCase, with_scene};
use crate::cli::{Again, ReplayArgs, RunArgs, StationArgs};
use crate::recorded::{RecordedScene, Unlaid};
use crate::settings::Refusal;
use beside::run_and_look;
use hyst_engine::settings::{Replay, Settings};
use hyst_exchange::{Station, system};
use hyst_messages::{Applied, AppliedRecord, FluidStatus, Role, StepRecord};
use hyst_recording::{Checkpoint, Event, Moment, Playback, checkpoints};
use look::{Whole, look_through};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};

/// States of the tissue that a force may have its contact model of.
const LINE: usize = 1_024;
/// Differences that are named one by one.
const MOST_TOLD: usize = 5;
/// A second recording has no pictures, and takes this share of what the first takes at least.
const LEAST_ROOM: f64 = 0.9;
/// The exit code of a run that lost something, or that ended before its end, and of a replay that did not come to the end of its recording.
const NOT_WHOLE: u8 = 3;

/// Shows or verifies; exit code 1 if something differs, 2 if the file cannot be replayed, 3 if it could be only up to something that is missing, up to where
/// the file was cut, or up to where an engine did not go on.
pub fn replay(station: &Station, args: &ReplayArgs) -> Result<u8, Refusal> {
    let from_tick = args.from_s.map_or(0, |from_s| (from_s * 1e3) as u64);
    let (begin_tick, states) = states_before(args, from_tick)?;
    let mut whole = look_through(args, from_tick, begin_tick)?;
    if from_tick > whole.end_tick || begin_tick >= whole.end_tick {
        let end_s = whole.end_tick as f64 * 1e-3;
        return Err(Refusal::input(format!("--from: the recording {} ends at {end_s:.1} s", args.file.display())));
    }
    let speed = if args.verify { 0.0 } else { args.speed.unwrap_or(1.0) };
    let beside = if args.verify { Some(second(station, args, &whole)?) } else { None };
    if begin_tick > 0 {
        let of = |state: &Checkpoint| format!("{} of {:.3} s", state.role.name(), state.tick as f64 * 1e-3);
        let states: Vec<String> = states.iter().map(of).collect();
        eprintln!("hystation: begins at the checkpoint of {:.3} s: {}", begin_tick as f64 * 1e-3, states.join(", "));
    }
    let scene = recorded_scene(station, args, &whole)?;
    let replay = Replay { begin_tick, from_tick, speed };
    let again = Again { states, ..again(args, &whole, replay, scene.as_ref())? };
    let named = scene_of(args, &whole, &again, scene.as_ref())?;
    let run = RunArgs { scene: named, ..run_args(args, &whole, again, beside.as_deref())? };
    let (ended, missing) = run_and_look(station, args, &run, replay, whole.is_seen)?;
    if let Some((missing, end_tick)) = missing {
        (whole.missing, whole.end_tick) = (Some(missing), end_tick);
    }
    let verdict = match (&beside, ended) {
        (Some(again), Ok(code @ (0 | NOT_WHOLE))) => compare(&args.file, again, whole.end_tick, code == NOT_WHOLE),
        (_, ended) => ended,
    };
    if let Some(path) = &beside {
        let _ = std::fs::remove_file(path); // it may not have come about
    }
    let code = verdict?;
    if let Some(at) = whole.cut_at {
        let (file, end_tick) = (args.file.display(), whole.end_tick);
        let what = format!("it was cut at byte {at}; it was done again up to tick {end_tick}, the rest is lost");
        eprintln!("hystation: {file} is not whole: {what}");
    }
    if let Some(missing) = &whole.missing {
        eprintln!("hystation: {}: {missing}; what is after tick {} was not done again", args.file.display(), whole.end_tick);
    }
    let is_whole = whole.missing.is_none() && whole.cut_at.is_none();
    Ok(if code == 0 && !is_whole { NOT_WHOLE } else { code })
}

/// The file of the second recording.
///
/// # Errors
/// There is no room for as much as is done again of the first.
fn second(station: &Station, args: &ReplayArgs, whole: &Whole) -> Result<PathBuf, Refusal> {
    let folder = large::folder();
    let bytes = std::fs::metadata(&args.file).map_or(0, |file| file.len()) as f64;
    match large::lacks_room(&folder, (bytes * whole.share * LEAST_ROOM) as u64) {
        Some(why) => Err(refuse(args, &format!("done again and compared it takes {why}"))),
        None => Ok(folder.join(format!("hystation-{}-{}.mcap", station.name(), std::process::id()))),
    }
}

/// The states that the newest checkpoint up to a tick is of, and its tick; 0 where there is none with a tissue, where it was written by a build whose states are
/// other ones, or where faults are to be injected, which may be due before it.
fn states_before(args: &ReplayArgs, from_tick: u64) -> Result<(u64, Vec<Checkpoint>), Refusal> {
    let none = (0, Vec::new());
    if from_tick == 0 || args.station.faults.is_some() {
        return Ok(none);
    }
    let layout = super::report::open(&args.file)?.session().get("layout").cloned();
    if layout != Some(hyst_messages::layout_name()) {
        return Ok(none);
    }
    let states = checkpoints(&args.file, from_tick).map_err(|error| Refusal::input(error.to_string()))?;
    let tissue = states.iter().find(|state| state.role == Role::Tissue).map(|state| state.tick);
    Ok(tissue.map_or(none, |tick| (tick, states)))
}

fn refuse(args: &ReplayArgs, what: &str) -> Refusal {
    Refusal::input(format!("recording {}: {what}", args.file.display()))
}

/// A fact of the recording's session.
fn fact<'a>(args: &ReplayArgs, whole: &'a Whole, name: &str) -> Result<&'a str, Refusal> {
    whole.session.get(name).map(String::as_str).ok_or_else(|| refuse(args, &format!("does not say its {name}")))
}

/// The settings of the station that was recorded.
fn settings(args: &ReplayArgs, whole: &Whole) -> Result<Settings, Refusal> {
    toml::from_str(fact(args, whole, "settings")?).map_err(|error| refuse(args, &format!("has settings that are none: {error}")))
}

/// The scene of a recording that has it, unless another scene is given, or it is the one in the binary. The station makes a copy of its own, so that it does not
/// matter if another replay of that name, which is refused later, lays its own down in this place.
fn recorded_scene(station: &Station, args: &ReplayArgs, whole: &Whole) -> Result<Option<RecordedScene>, Refusal> {
    if args.scene.is_some() || is_in_the_binary(args, whole)? {
        return Ok(None);
    }
    let folder = std::env::temp_dir().join(format!("hystation-{}-{}-scene", system::user_id(), station.name()));
    RecordedScene::lay(&args.file, &folder).map_err(|error| match error {
        Unlaid::Unread(error) => Refusal::input(error.to_string()),
        Unlaid::System(..) => refuse(args, &format!("{error}; look at `df`, or give --scene")),
    })
}

/// Whether a session was in the scene that this program holds.
fn is_in_the_binary(args: &ReplayArgs, whole: &Whole) -> Result<bool, Refusal> {
    let is_named = settings(args, whole)?.scene.is_some();
    let own = || hyst_scene::load_embedded().is_ok_and(|scene| scene_hash(args, whole).is_ok_and(|hash| hash == scene.hash));
    Ok(!is_named && own())
}

/// The hash of the scene that was recorded.
fn scene_hash(args: &ReplayArgs, whole: &Whole) -> Result<u64, Refusal> {
    u64::from_str_radix(fact(args, whole, "scene_hash")?, 16).map_err(|_| refuse(args, "names no scene"))
}

/// The scene of the run; of a case none: it names its own.
fn scene_of(
    args: &ReplayArgs,
    whole: &Whole,
    again: &Again,
    recorded: Option<&RecordedScene>,
) -> Result<Option<PathBuf>, Refusal> {
    let settings = settings(args, whole)?;
    let named = || recorded.map(|scene| scene.path().to_owned()).or(settings.scene);
    Ok(args.scene.clone().or_else(|| if again.case.is_none() { named() } else { None }))
}

/// What is done again, from the beginning.
fn again(args: &ReplayArgs, whole: &Whole, replay: Replay, scene: Option<&RecordedScene>) -> Result<Again, Refusal> {
    let scene_hash = scene_hash(args, whole)?;
    let file = settings(args, whole)?.case;
    let laid = |text: &String| scene.and_then(|scene| with_scene(text, scene.path()));
    let before = (replay.begin_tick > 0).then(|| (args.file.clone(), replay.begin_tick));
    let recorded = |text: &String| RecordedCase { text: laid(text).unwrap_or_else(|| text.clone()), file, before };
    let case = whole.session.get("case_text").map(recorded);
    Ok(Again { replay, scene_hash, case, states: Vec::new(), end_tick: whole.end_tick })
}

/// The run that does the recording again.
fn run_args(args: &ReplayArgs, whole: &Whole, again: Again, record: Option<&Path>) -> Result<RunArgs, Refusal> {
    let settings = settings(args, whole)?;
    let recorded = settings.set.get("isa").map(|isa| format!("isa={isa}"));
    let quiet = [("console", "off")].map(|(key, value)| format!("{key}={value}"));
    let set = recorded.into_iter().chain(quiet.into_iter().filter(|_| args.verify)).chain(args.station.set.iter().cloned());
    let roles = ["hardware", "device", "haptic", "tissue", "collision-worker", "fluid", "recorder"].map(String::from).to_vec();
    Ok(RunArgs {
        hand: Some(format!("replay:{}", args.file.display())),
        record: record.map(PathBuf::from),
        report: args.report.clone(),
        lockstep: true,
        roles: args.verify.then_some(roles),
        quiet: args.verify,
        again: Some(again),
        station: StationArgs {
            headless: args.station.headless || args.verify,
            workers: Some(args.station.workers.unwrap_or(settings.workers)),
            set: set.collect(),
            ..args.station.clone()
        },
        ..RunArgs::default()
    })
}

/// What was compared, and what differed.
#[derive(Default)]
struct Verdict {
    forces: u64,
    states: u64,
    pumps: u64,
    /// Ticks that the replay's device did not make: even a virtual clock goes on without who is not let run for its whole patience.
    unmade: u64,
    /// The first of them.
    first_unmade: Option<u64>,
    /// Forces that cannot be compared: their contact model, or that of a tick from which they still differ, was of a state that nobody went on from.
    orphans: u64,
    /// Whether the force before was such a one.
    is_orphan: bool,
    /// Ticks of the states that were gone on from, of the last seconds.
    line: VecDeque<u64>,
    different: u64,
    told: Vec<String>,
}

impl Verdict {
    fn say(&mut self, what: String) {
        self.different += 1;
        if self.told.len() < MOST_TOLD {
            self.told.push(what);
        }
    }

    /// The steps that come before the device's part of a tick.
    fn note_line(&mut self, steps: &[StepRecord]) {
        self.line.extend(steps.iter().map(|step| step.tick));
        self.line.drain(..self.line.len().saturating_sub(LINE));
    }

    /// Compares a tick. The model of a tick is made before the device's part of it.
    fn tick(&mut self, tick: u64, recorded: &Moment, again: &Moment, is_lockstep: bool) {
        if let Some(was) = &recorded.applied {
            self.forces += 1;
            let bits = |record: &AppliedRecord| (record.command.force_n.map(f32::to_bits), record.command.kind);
            let is_same = again.applied.as_ref().is_some_and(|is| bits(is) == bits(was));
            let is_made = was.model_epoch == 0 || self.line.iter().rev().any(|tick| *tick == was.model_tick);
            self.is_orphan = !is_same && (self.is_orphan || !is_made);
            match &again.applied {
                _ if is_same => {}
                _ if self.is_orphan => self.orphans += 1,
                Some(is) => self.say(format!("tick {tick}: force {} recorded, {} now", newton(was), newton(is))),
                None => {
                    self.unmade += 1;
                    self.first_unmade.get_or_insert(tick);
                }
            }
        }
        if let Some(was) = &recorded.step {
            self.states += 1;
            let now = again.step.map(|is| is.state_hash);
            if now != Some(was.state_hash) {
                let now = now.map_or("none".into(), |hash| format!("{hash:016x}"));
                self.say(format!("tick {tick}: state {:016x} recorded, {now} now", was.state_hash));
            }
        }
        // What the pump did in real time depended on moments that nobody wrote down; what of it was felt was done again with the input.
        if let (true, Some(was), Some(is)) = (is_lockstep, &recorded.fluid, &again.fluid) {
            self.pumps += 1;
            let bits = |status: &FluidStatus| {
                (status.deficit_ml.to_bits(), status.cavity_volume_ml.to_bits(), status.pressure_pa.to_bits())
            };
            if bits(was) != bits(is) {
                self.say(format!("tick {tick}: deficit {} ml recorded, {} ml now", was.deficit_ml, is.deficit_ml));
            } else if was.state_hash != 0 && was.state_hash != is.state_hash {
                // An older recording has none.
                self.say(format!("tick {tick}: the fluid's state {:016x} recorded, {:016x} now", was.state_hash, is.state_hash));
            }
        }
    }

    /// Tells what came of it; gives the exit code.
    fn tell(self, is_lockstep: bool) -> u8 {
        let Verdict { forces, states, pumps, unmade, first_unmade, orphans, different, told, .. } = self;
        let forces = forces - orphans - unmade;
        if let Some(tick) = first_unmade {
            println!(
                "{unmade} forces were not made again, the first of tick {tick}: this machine did not let the device run for two seconds; \
                 verify once more"
            );
        }
        if orphans > 0 {
            println!(
                "{orphans} forces are not compared: the states of their contact models were made and nobody went on from them"
            );
        }
        let pumps = if is_lockstep { format!(", {pumps} figures of the pump") } else { String::new() };
        if different == 0 {
            println!("the same to the bit: {forces} forces, {states} states{pumps}");
            return if unmade > 0 { NOT_WHOLE } else { 0 };
        }
        println!("{different} differ of all that was compared ({forces} forces, {states} states{pumps}):");
        told.iter().for_each(|line| println!("  {line}"));
        1
    }
}

fn newton(record: &AppliedRecord) -> String {
    let [x, y, z] = record.command.force_n;
    let kind = if record.command.kind == Applied::Fresh as u32 { "" } else { " (not fresh)" };
    format!("({x}, {y}, {z}) N{kind}")
}

/// Compares a recording with what was recorded of its replay; of one that `is_cut`, because an engine did not go on or something of it was lost, or that somebody
/// has stopped, what comes before the first state that was not made again.
fn compare(recorded: &Path, again: &Path, end_tick: u64, is_cut: bool) -> Result<u8, Refusal> {
    let open = |path: &Path| super::report::open(path).map(Playback::new);
    let unread = |error: hyst_recording::ReadError| Refusal::input(error.to_string());
    let mut was = open(recorded)?;
    let mut is = match open(again) {
        Ok(is) => is,
        Err(refusal) => {
            println!("nothing was made again: {}", refusal.message);
            return Ok(NOT_WHOLE);
        }
    };
    let ends_early = hyst_recording::outline(again).ok().flatten().is_some_and(|outline| outline.last_tick < end_tick);
    let is_cut = is_cut || ends_early;
    let settings = was.session().get("settings").and_then(|text| toml::from_str::<Settings>(text).ok());
    let is_lockstep = settings.is_some_and(|settings| settings.lockstep);
    let (mut verdict, mut unmade_tick) = (Verdict::default(), None);
    for tick in 0..=end_tick {
        let moments = (was.at(tick).map_err(unread)?, is.at(tick).map_err(unread)?);
        if moments.1.is_none() || is_cut && is_unmade(&moments) {
            unmade_tick = Some(tick);
            break;
        }
        verdict.note_line(&was.due(tick));
        verdict.tick(tick, &moments.0.unwrap_or_default(), &moments.1.unwrap_or_default(), is_lockstep);
    }
    let code = verdict.tell(is_lockstep);
    if let Some(tick) = unmade_tick {
        println!("tick {tick} and what comes after it were not made again");
    }
    if code == 1 {
        let said = [origin::other_build, origin::other_processor].map(|other| other(was.session(), is.session()));
        let swapped = origin::other_engines(&events(recorded));
        said.into_iter().flatten().chain(swapped).for_each(|words| println!("{words}"));
    }
    Ok(if code == 0 && (is_cut || unmade_tick.is_some()) { NOT_WHOLE } else { code })
}

/// What happened, by a recording, as far as it can be read.
fn events(recorded: &Path) -> Vec<Event> {
    let mut events = Vec::new();
    if let Ok(mut reader) = super::report::open(recorded) {
        let _ = reader.each_block(super::report::threads(), |block| events.extend(block.events)); // what was read serves
    }
    events
}

/// Whether a tick has a state in the recording, and none in that of its replay.
fn is_unmade((was, is): &(Option<Moment>, Option<Moment>)) -> bool {
    let has_state = |moment: &Option<Moment>| moment.as_ref().is_some_and(|moment| moment.step.is_some());
    has_state(was) && !has_state(is)
}

#[cfg(test)]
mod tests;
