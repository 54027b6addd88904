//! Promises of the process: bad arguments are one message and exit code 2; a session that is killed half-way and taken up by a successor
//! holds every tick once; a file of somebody else is not touched. The test founds the station and is its device.

#[path = "../../../shared/engine/tests/support/cli.rs"]
mod cli;
#[path = "../../../shared/messages/tests/support/stated.rs"]
mod stated;

use hyst_exchange::checkpoint::CheckpointWriter;
use hyst_exchange::{OwnedPage, ReadPage, Roster, Station, Tenure, system};
use hyst_messages::page::{ProcessState, device, haptic, hardware, recorder, station as layout};
use hyst_messages::{AppliedRecord, ForceCommand, HardwareSample, OriginRecord, RecorderStatus, Role, Slot};
use hyst_recording::{Ending, Recording, scene_files};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

const BINARY: &str = env!("CARGO_BIN_EXE_recorder");

/// A station without any process; the recording lies in its root.
struct Stage {
    station: Station,
    keeper: OwnedPage,
    children: Vec<Child>,
}

impl Stage {
    fn new(name: &str, record: bool) -> Stage {
        let station = Station::named(&format!("t{}-{name}", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let keeper = station.open_for_keeping().unwrap();
        let file = station.root().join("session.mcap");
        let settings = if record { format!("record = \"{}\"\n", file.display()) } else { String::new() };
        std::fs::write(station.settings(), settings).unwrap();
        Stage { station, keeper, children: Vec::new() }
    }
    fn file(&self) -> PathBuf {
        self.station.root().join("session.mcap")
    }
    fn announce(&self, slot: Slot, incarnation: u32) {
        self.keeper.store32(layout::SLOT_DEAD + slot.number(), 0);
        self.keeper.store32(layout::SLOT_INCARNATION + slot.number(), incarnation);
        self.keeper.bump_and_wake(layout::CHANGES);
    }
    fn device(&self, incarnation: u32) -> OwnedPage {
        self.engine(Slot::first(Role::Device), incarnation)
    }
    fn engine(&self, slot: Slot, incarnation: u32) -> OwnedPage {
        let page = self.station.create_slot(slot, incarnation).unwrap();
        self.announce(slot, incarnation);
        page
    }
    /// A device on the desk that says what it is.
    fn plug(&self, incarnation: u32) {
        let slot = Slot::first(Role::Hardware);
        self.station.create_slot(slot, incarnation).unwrap().write(hardware::STATEMENT, &stated::stated());
        self.announce(slot, incarnation);
    }
    /// Waits until the recorder has kept, for who follows, that it knows what the device of this life is; likewise without a bound.
    fn wait_for_stated(&self, incarnation: u32) {
        let is_known = |kept: String| kept.ends_with(&format!(",{incarnation}]]"));
        while !std::fs::read_to_string(self.station.recorder_seen()).is_ok_and(is_known) {
            system::sleep_ns(2_000_000);
        }
    }
    /// Starts a recorder; gives its page.
    fn start(&mut self, incarnation: u32) -> ReadPage {
        let slot = Slot::first(Role::Recorder);
        self.station.create_slot(slot, incarnation).unwrap();
        let child = self.command(incarnation).stderr(Stdio::null()).spawn().unwrap();
        self.children.push(child);
        self.announce(slot, incarnation);
        self.station.read_slot(slot, incarnation).unwrap()
    }
    fn command(&self, incarnation: u32) -> Command {
        let mut command = Command::new(BINARY);
        command.args(["--station", self.station.name(), "--slot", "recorder", "--incarnation", &incarnation.to_string()]);
        command
    }
    fn kill(&mut self) {
        let mut child = self.children.pop().unwrap();
        child.kill().unwrap();
        child.wait().unwrap();
        self.keeper.store32(layout::SLOT_DEAD + Slot::first(Role::Recorder).number(), 1);
        self.keeper.bump_and_wake(layout::CHANGES);
    }
    fn stop(&mut self) -> Option<i32> {
        self.keeper.store32(layout::STOP, 1);
        self.keeper.bump_and_wake(layout::CHANGES);
        self.children.pop().unwrap().wait().unwrap().code()
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        for child in &mut self.children {
            let _ = child.kill();
            let _ = child.wait();
        }
        self.station.wipe();
    }
}

fn push(page: &OwnedPage, ticks: std::ops::Range<u64>) {
    for tick in ticks {
        let sample = HardwareSample { hardware_tick: tick, time_ns: tick, ..Default::default() };
        let command = ForceCommand { tick, force_n: [0.0, 0.001 * tick as f32, 0.1], ..Default::default() };
        page.push(device::APPLIED, tick, &AppliedRecord { tick, command, sample, ..Default::default() });
    }
}

/// Looks until the recorder says so; a recorder that never does hangs the test, which is then ended from outside.
fn wait_for(page: &ReadPage, done: impl Fn(&RecorderStatus) -> bool) -> RecorderStatus {
    loop {
        match page.cell(recorder::STATUS) {
            Some((_, status)) if done(&status) => return status,
            _ => system::sleep_ns(2_000_000),
        }
    }
}

fn ticks(recording: &Recording) -> Vec<u64> {
    recording.applied().iter().map(|record| record.tick).collect()
}

fn refused(output: &Output, word: &str) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains(word) && !said.contains("panicked"), "{said}");
}

#[test]
fn bad_arguments_are_refused() {
    cli::engine(BINARY, "recorder", "recorder");
}

#[test]
fn every_tick_is_in_the_file_once_although_the_recorder_was_killed_half_way() {
    let mut stage = Stage::new("kill", true);
    let device = stage.device(1);
    push(&device, 10..100);
    let page = stage.start(2);
    wait_for(&page, |status| status.last_tick == 99);
    push(&device, 100..170);
    wait_for(&page, |status| status.last_tick >= 99);
    stage.kill();
    let halfway = Recording::read(&stage.file()).unwrap();
    assert!(matches!(halfway.ending, Ending::Cut { .. }) && halfway.applied().len() >= 90);
    push(&device, 170..200);
    let page = stage.start(3);
    wait_for(&page, |status| status.last_tick == 199);
    assert_eq!(page.state(), ProcessState::Live);
    // The device is restarted too, and its successor begins some ticks later.
    push(&device, 200..210);
    let successor = stage.device(4);
    push(&successor, 220..310);
    let status = wait_for(&page, |status| status.last_tick == 309);
    assert_eq!((status.ticks, status.lost), (290, 0));
    push(&successor, 310..320);
    assert_eq!(stage.stop(), Some(0));
    let recording = Recording::read(&stage.file()).unwrap();
    assert_eq!(ticks(&recording), (10..210).chain(220..320).collect::<Vec<_>>());
    assert_eq!((recording.ending, recording.damage.len(), recording.content.lost.len()), (Ending::Complete, 0, 0));
    assert_eq!(recording.applied()[150].command.force_n, [0.0, 0.001 * 160.0, 0.1]);
    assert_eq!(recording.session["station"], stage.station.name());
    let scene = scene_files(&stage.file()).unwrap();
    assert!(!scene.is_empty() && recording.content.scene == scene, "the scene is there once: {}", recording.content.scene.len());
    let said = |kind: &str, process: &str| {
        recording.content.events.iter().filter(|event| event.kind == kind && event.process == process).count()
    };
    assert_eq!((said("skipped", "recorder"), said("started", "device")), (1, 2));
}

/// Makes ticks until this is in the file.
fn push_until(stage: &Stage, device: &OwnedPage, next: &mut u64, origin: OriginRecord) {
    while !Recording::read(&stage.file()).is_ok_and(|read| read.content.origins.contains(&origin)) {
        push(device, *next..*next + 1);
        *next += 1;
        system::sleep_ns(2_000_000);
    }
}

/// Where both servos had lost ticks at once nobody had written down whose state each of them went on from.
#[test]
fn what_a_servo_went_on_from_is_in_the_file_also_of_one_that_is_followed_and_where_the_recorder_is_killed() {
    let (mut stage, slot) = (Stage::new("origins", true), Slot::new(Role::Haptic, 1).unwrap());
    let (device, servo, mut next) = (stage.device(1), stage.engine(slot, 5), 100);
    let origin = |tick: u64| OriginRecord { tick, from_tick: tick - 3, servo: 1, from_servo: 1 };
    servo.push(haptic::ORIGINS, 0, &OriginRecord { servo: 2, ..origin(39) }); // nobody's
    servo.push(haptic::ORIGINS, 1, &origin(40));
    push(&device, 10..100);
    stage.start(2);
    push_until(&stage, &device, &mut next, origin(40));
    stage.kill();
    let killed_tick = next;
    servo.push(haptic::ORIGINS, 2, &origin(killed_tick));
    stage.start(3);
    push_until(&stage, &device, &mut next, origin(killed_tick));
    // What it has said last is read before what its successor says.
    let died_tick = next;
    servo.push(haptic::ORIGINS, 3, &origin(died_tick));
    let successor = stage.engine(slot, 6);
    successor.push(haptic::ORIGINS, 0, &origin(died_tick + 1));
    push_until(&stage, &device, &mut next, origin(died_tick + 1));
    assert_eq!(stage.stop(), Some(0));
    let told: BTreeSet<u64> = Recording::read(&stage.file()).unwrap().content.origins.iter().map(|origin| origin.tick).collect();
    assert_eq!(told, BTreeSet::from([40, killed_tick, died_tick, died_tick + 1]));
}

/// With nobody but recorders to judge it, the second part of a session was judged as if it had begun there.
#[test]
fn a_recorder_that_follows_goes_on_judging_from_where_the_one_before_was() {
    let mut stage = Stage::new("judged", true);
    let brief = serde_json::json!({
        "name": "a case", "rung": "polyp", "task": "Do it.", "seed": 1, "drawn": [], "pathology_ml": 2.0, "score": {},
        "goals": [{ "words": "all", "is": { "removed": 2.0 } }], "warnings": [],
        "end": { "goals": true, "time_s": null, "deficit_ml": null, "bled_ml": null, "perforation": false },
    });
    std::fs::write(stage.station.brief(), brief.to_string()).unwrap();
    let device = stage.device(1);
    push(&device, 10..100);
    let page = stage.start(2);
    wait_for(&page, |status| status.last_tick == 99);
    stage.kill();
    // What was judged is recorded beside a state.
    let tissue = CheckpointWriter::open(&stage.station, Slot::first(Role::Tissue), 100).unwrap();
    assert!(tissue.write(1, 90, &[7; 24], true));
    push(&device, 100..200);
    let page = stage.start(3);
    wait_for(&page, |status| status.last_tick == 199);
    assert_eq!(stage.stop(), Some(0));
    let recording = Recording::read(&stage.file()).unwrap();
    let judged = recording.content.judged.last().expect("nothing is recorded of what was judged");
    let judge: serde_json::Value = serde_json::from_str(&judged.judge).unwrap();
    assert!(judged.tick >= 99 && judge["first_tick"] == 10, "{judge}");
}

/// What had died and come back while no recorder lived was in no event, and which device it was in none at all.
#[test]
fn what_happened_while_no_recorder_lived_and_which_device_was_on_the_desk_is_said_once() {
    // The clock does not come to these ticks: what is seen is written with the next.
    const FAR: u64 = 1_000_000_000;
    let mut stage = Stage::new("between", true);
    let (roster, console) = (Roster::open(&stage.station).unwrap(), Slot::first(Role::Console));
    let device = stage.device(1);
    stage.plug(4);
    stage.announce(console, 5);
    let holder = roster.promote(Role::Tissue, Tenure::default(), 6).unwrap();
    let page = stage.start(2);
    push(&device, FAR..FAR + 50);
    stage.wait_for_stated(4);
    push(&device, FAR + 50..FAR + 100);
    wait_for(&page, |status| status.last_tick == FAR + 99);
    stage.kill();
    stage.plug(8);
    stage.announce(console, 9);
    roster.promote(Role::Tissue, holder, 7).unwrap();
    let page = stage.start(3);
    push(&device, FAR + 100..FAR + 200);
    wait_for(&page, |status| status.last_tick == FAR + 199);
    stage.wait_for_stated(8);
    assert_eq!(stage.stop(), Some(0));
    let events = Recording::read(&stage.file()).unwrap().content.events;
    let of = |process: &str| {
        let events = events.iter().filter(|event| event.process == process);
        events.map(|event| (event.kind.as_str(), event.incarnation)).collect::<Vec<_>>()
    };
    assert_eq!(of("console"), [("started", 5), ("ended", 5), ("started", 9)]);
    assert_eq!(of("tissue"), [("promoted", 6), ("promoted", 7)]);
    assert_eq!(of("hardware"), [("started", 4), ("stated", 4), ("ended", 4), ("started", 8), ("stated", 8)]);
    let stated: Vec<&str> = events.iter().filter(|event| event.kind == "stated").map(|event| event.text.as_str()).collect();
    assert!(
        stated.iter().all(|text| text.contains(" says what it is: Nobody Nothing: ") && text.contains("3.3 N")),
        "{stated:?}"
    );
}

#[test]
fn ticks_that_left_the_ring_while_no_recorder_lived_are_counted_as_lost() {
    let mut stage = Stage::new("lost", true);
    let device = stage.device(1);
    push(&device, 1..100);
    let page = stage.start(2);
    wait_for(&page, |status| status.last_tick == 99);
    stage.kill();
    let end = 120 + device::APPLIED.entries as u64;
    push(&device, 100..end);
    let page = stage.start(3);
    let status = wait_for(&page, |status| status.last_tick == end - 1);
    assert_eq!(status.lost, 20);
    assert_eq!(stage.stop(), Some(0));
    let recording = Recording::read(&stage.file()).unwrap();
    let lost: u64 = recording.content.lost.iter().map(|range| range.count()).sum();
    assert_eq!((lost, recording.applied().len() as u64), (status.lost, end - 1 - status.lost));
}

#[test]
fn without_a_recording_the_recorder_lives_and_writes_nothing() {
    let mut stage = Stage::new("none", false);
    let page = stage.start(1);
    wait_for(&page, |status| *status == RecorderStatus::default());
    assert_eq!(stage.stop(), Some(0));
    assert_eq!(page.state(), ProcessState::Stopping);
    assert!(!stage.file().exists());
}

#[test]
fn a_file_of_somebody_else_is_refused_and_stays_as_it_is() {
    let stage = Stage::new("foreign", true);
    let precious: &Path = &stage.file();
    std::fs::write(precious, "precious").unwrap();
    stage.station.create_slot(Slot::first(Role::Recorder), 1).unwrap();
    let output = stage.command(1).output().unwrap();
    refused(&output, "is not an MCAP file");
    assert_eq!(std::fs::read(precious).unwrap(), b"precious");
}
