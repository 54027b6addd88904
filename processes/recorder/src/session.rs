//! The whole life of the recorder: looks 20 times a second, writes five times. Promise: each tick of the device is in the file once, also
//! across a kill of the recorder at any moment; it costs the real-time processes nothing, because it only reads their pages and streams.

use crate::camera::Camera;
use crate::gather::Gather;
use crate::keeper::{Keeper, while_alive};
use crate::kept::{Kept, MOST_BYTES};
use crate::moments::Mark;
use crate::room::Room;
use crate::said::Said;
use crate::statistics::Statistics;
use crate::watch::{Look, Looks};
use hyst_engine::{Failure, Life};
use hyst_exchange::{Roster, machine, system};
use hyst_messages::page::{ProcessState, header, recorder as layout, station};
use hyst_messages::{DeviceStatement, RecorderStatus, Slot, layout_name};
use hyst_recording::{Event, STATED, SceneFile, Session, scene_files};
use hyst_scene::SourceFile;

/// Longest time between two looks, ns. A change of the slots wakes the recorder earlier, so that events have their tick.
pub const LOOK_NS: u64 = 50_000_000;
/// Shortest time between two looks, ns, however often the slots change.
const REST_NS: u64 = 10_000_000;

/// The whole life of the recorder.
pub fn run(life: &Life) -> Result<(), Failure> {
    let Some(path) = &life.settings.record else {
        return idle(life);
    };
    let Some(mut keeper) = Keeper::open(life, path, &facts(life)?)? else {
        return Ok(());
    };
    let _room = Room::watch(&life.station, path);
    let mut gather = Gather::new(life, keeper.goes_on_after())?;
    let mut said = Said::new(&life.station, keeper.last_tick());
    // A predecessor that died has begun with it, or not, or with a part of it. Where nothing of it is there nobody looks through the file: it may be long, and
    // the device's ring lasts for 4 s.
    if !keeper.has_scene() || while_alive(life, || scene_files(path)).is_ok_and(|files| files.is_empty()) {
        keeper.queue.scene = scene(life);
    }
    let (mut kept, mut statistics) = (Kept::default(), Statistics::default());
    let roster = Roster::open(&life.station)?;
    let is_continued = keeper.is_continued();
    let mut camera = Camera::of(life, is_continued);
    let mut looks = if is_continued { Looks::going_on(&life.station, keeper.last_tick()) } else { Looks::begun() };
    life.say(&format!("recording {}, {}", path.display(), if is_continued { "continued" } else { "new" }));
    life.page.set_state(ProcessState::Live);
    loop {
        let begun_ns = system::now_ns();
        let changes = life.clock.changes();
        let is_last = life.clock.stop_requested() || is_superseded(life);
        if is_last {
            gather.wait_for_last();
        }
        let mark = Mark::of(&keeper.queue);
        gather.take(life, &roster, &mut keeper.queue);
        camera.look(life, &gather, &mut keeper.queue, mark);
        let stated = gather.stated();
        let look = Look::take(&life.clock, &roster, stated.map(|(incarnation, _)| incarnation));
        let events = looks.follow(look, life.tick());
        said.hold(events.into_iter().map(|event| in_words(life, stated.map(|(_, stated)| stated), event)));
        let newest = keeper.queue.applied.last().map(|record| record.tick).or(keeper.last_tick());
        let states = kept.take(&life.station, life.tick());
        if !states.is_empty() {
            keeper.queue.judged.extend(camera.judged());
        }
        keeper.queue.checkpoints.extend(states);
        keeper.queue.processes.extend(statistics.take(life));
        // Who is followed by another leaves it what comes after its last tick.
        said.take(if life.clock.stop_requested() { u64::MAX } else { newest.unwrap_or(0) }, &mut keeper.queue.events);
        let on_disk = keeper.last_tick();
        let mut keep = || {
            camera.keep(life);
            looks.keep(&life.station, on_disk);
        };
        if is_last {
            keep();
            return keeper.close(life);
        }
        keeper.keep(life, keep)?;
        life.drag(begun_ns);
        alive(life);
        rest(life, changes);
    }
}

/// A station without a recording has a recorder all the same, so that every process of a station can be watched alike.
fn idle(life: &Life) -> Result<(), Failure> {
    life.page.write(layout::STATUS, &RecorderStatus::default());
    life.page.set_state(ProcessState::Live);
    while !life.clock.stop_requested() && !is_superseded(life) {
        let (begun_ns, changes) = (system::now_ns(), life.clock.changes());
        life.drag(begun_ns);
        alive(life);
        rest(life, changes);
    }
    Ok(())
}

/// Whether a newer recorder has the slot: it waits for the file's lock.
fn is_superseded(life: &Life) -> bool {
    life.clock.incarnation(life.slot) > life.incarnation
}

fn alive(life: &Life) {
    life.misbehave();
    life.heartbeat();
    life.page.store64(header::TICK, life.tick());
    life.page.add64(header::STEPS, 1);
}

fn rest(life: &Life, changes: u32) {
    let deadline_ns = system::now_ns() + LOOK_NS;
    system::sleep_ns(REST_NS);
    life.clock.wait_for_change(changes, deadline_ns);
}

/// An event with what its process says: before it died, if its page is still there, or of the device on the desk.
fn in_words(life: &Life, stated: Option<DeviceStatement>, event: Event) -> Event {
    let page = || life.station.read_slot(Slot::parse(&event.process)?, event.incarnation).ok();
    let words = match event.kind.as_str() {
        "died" => page().map(|page| page.last_words()),
        STATED => stated.map(|stated| stated.words()),
        _ => None,
    };
    match words.filter(|words| !words.is_empty()) {
        Some(words) => Event { text: format!("{}: {words}", event.text), ..event },
        None => event,
    }
}

/// The files of the scene, with which the session can be done again anywhere; none, and why is said, where they are larger than what any reader takes at once.
fn scene(life: &Life) -> Vec<SceneFile> {
    let entry = life.scene();
    let files = while_alive(life, || hyst_scene::sources(entry.as_deref()).map_err(|error| error.to_string()));
    let is_large = |files: &[SourceFile]| files.iter().map(|file| file.bytes.len()).sum::<usize>() > MOST_BYTES;
    let files = files.and_then(|files| if is_large(&files) { Err("they are too large".into()) } else { Ok(files) });
    let files = files.unwrap_or_else(|why| {
        life.say(&format!("the scene is not in the recording, which can be done again only with these files as they are: {why}"));
        Vec::new()
    });
    let count = files.len() as u32;
    (0..).zip(files).map(|(index, SourceFile { name, bytes })| SceneFile { index, count, name, bytes }).collect()
}

/// The facts of the session, the same for every incarnation of the recorder.
fn facts(life: &Life) -> Result<Session, Failure> {
    let t0_ns = life.clock.t0_ns();
    let settings = std::fs::read_to_string(life.station.settings()).unwrap_or_default();
    let named = life.settings.case.as_ref().or(life.settings.scene.as_ref());
    let scene = named.map_or("embedded".into(), |path| path.display().to_string());
    let scene_hash = life.clock.page().load64(station::SCENE_HASH);
    let facts = [
        ("session", format!("{}-{t0_ns}", life.station.name())),
        ("station", life.station.name().to_string()),
        ("t0_ns", t0_ns.to_string()),
        ("scene", scene),
        ("scene_hash", format!("{scene_hash:016x}")),
        ("hand", life.settings.hand.clone()),
        ("version", env!("CARGO_PKG_VERSION").to_string()),
        ("layout", layout_name()),
        ("settings", settings),
    ];
    let here = machine::describe();
    let made_on = ["cpu", "kernel"].map(|key| (key, here[key].as_str().unwrap_or_default().to_string()));
    let made_on = made_on.into_iter().chain([("cores", here["cores"].to_string())]);
    // Of a case its text, from which its anatomy is drawn again, and what it is judged by; which programs ran it, and how much there was to be removed.
    let of_case = [("case_text", life.station.case()), ("case", life.station.brief())];
    let files = of_case.into_iter().chain([("build", life.station.build()), ("pathology_ml", life.station.pathology())]);
    let files = files.filter_map(|(name, path)| Some((name, std::fs::read_to_string(path).ok()?)));
    let trainee = life.settings.trainee().map_err(|error| Failure::Input(error.to_string()))?;
    let begun = Some(life.settings.begun_unix_s).filter(|unix_s| *unix_s > 0).map(machine::utc_of);
    let who_and_when = [("trainee", trainee.map(str::to_string)), ("begun_utc", begun)];
    let said = who_and_when.into_iter().filter_map(|(name, value)| Some((name, value?)));
    Ok(facts.into_iter().chain(made_on).chain(files).chain(said).map(|(name, value)| (name.to_string(), value)).collect())
}
