//! A recording opened with readers that are not ours. With the `mcap` package of PyPI: topics, schemas, every message against its schema, and what is in them,
//! to the bit, against what our own reader finds; and whether anything of it breaks a rule of the format, of Foxglove or of PlotJuggler. With Foxglove's own
//! reader for Node: how many messages it finds, also in a file that was cut.

use hyst_messages::{Controls, FluidStatus, Pose, TICK_NS, TissueStatus};
use hyst_recording::{Block, Continuity, Recording, SAID};
use serde_json::Value;
use station_tests::shown::not_shown;
use station_tests::{Folder, binaries, hystation, run};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The tick at which the recorder dies.
const RECORDER_DIES: u64 = 2_000;

/// Where `./station test` has put the package.
fn packages() -> PathBuf {
    binaries().with_file_name("reader")
}

fn python() -> Command {
    let mut command = Command::new("python3");
    command.env("PYTHONPATH", packages());
    command
}

/// A session of three seconds on the virtual clock, in which the hand presses, and three processes die, of which the recorder is one.
fn session(folder: &Folder) -> PathBuf {
    let fault = |target: &str, tick: u64| format!("[[fault]]\nkind = \"kill\"\ntarget = \"{target}\"\ntick = {tick}\n");
    let faults = [("tissue:active", 1_800), ("recorder", RECORDER_DIES), ("haptic:active", 2_200)];
    let faults: String = faults.into_iter().map(|(target, tick)| fault(target, tick)).collect();
    let faults = folder.write("faults.toml", &faults);
    let path = folder.path("session.mcap");
    let mut command = hystation();
    command.args(["--name", &format!("m{}", std::process::id()), "run", "--headless", "--lockstep", "--for", "3s"]);
    command.args(["--roles", "hardware,device,haptic,tissue,fluid,collision-worker,recorder", "--hand", "script:press"]);
    command.args(["--test-mode", "--faults", &faults, "--record", &path]);
    let (code, _, said) = run(&mut command);
    assert_eq!(code, Some(0), "{said}");
    path.into()
}

/// The recorder died on the way: no tick is missing about its death, and none comes twice.
fn assert_continuous(ours: &Block) {
    let continuity = Continuity::of(ours);
    let (repeated, missing, lost) = (continuity.repeated, continuity.missing(), continuity.lost());
    assert_eq!((repeated, missing, lost), (0, 0, 0), "repeated, missing and lost of {} ticks", continuity.ticks);
    let about = RECORDER_DIES - 500..RECORDER_DIES + 500;
    let there = ours.applied.iter().filter(|record| about.contains(&record.tick)).count() as u64;
    assert!(there + continuity.unmade >= 1_000, "{there} of {about:?}, {} were never made", continuity.unmade);
}

fn bits(vector: &[f32]) -> Vec<u64> {
    vector.iter().map(|value| u64::from(value.to_bits())).collect()
}

/// What the hand set, and what fluid and tissue say of themselves.
fn assert_statuses(dumped: &Value, ours: &Block) {
    let told = rows(&dumped["controls"]);
    assert!(!told.is_empty());
    for (tick, numbers) in told {
        let record = ours.applied.iter().find(|record| record.tick == tick).unwrap_or_else(|| panic!("controls of tick {tick}"));
        let Controls { buttons, inflow_valve, outflow_valve, set_pressure_pa, light, loop_extension_m, focus_m } =
            record.sample.controls;
        let set = bits(&[inflow_valve, outflow_valve, set_pressure_pa, light, loop_extension_m, focus_m]);
        assert_eq!(numbers, [vec![u64::from(buttons)], set].concat(), "tick {tick}");
    }
    let of_fluid = |status: &FluidStatus| {
        let exact = [status.deficit_ml, status.cavity_volume_ml, status.bled_ml].map(f64::to_bits);
        let flow = bits(&[status.pressure_pa, status.inflow_ml_min, status.outflow_ml_min]);
        (status.state_tick, exact.into_iter().chain(flow).chain([u64::from(status.alarms)]).collect::<Vec<_>>())
    };
    let (theirs, fluid) = (sorted(rows(&dumped["fluid"])), sorted(ours.fluid.iter().map(of_fluid).collect()));
    assert_eq!(theirs, fluid);
    let of_tissue =
        |status: &TissueStatus| (status.state_tick, vec![status.removed_volume_ml.to_bits(), u64::from(status.contact_count)]);
    assert_eq!(sorted(rows(&dumped["tissue"])), sorted(ours.tissue.iter().map(of_tissue).collect()));
}

/// That reader gives messages in the order of their time, ours in that of the file.
fn sorted<T: Ord>(mut rows: Vec<T>) -> Vec<T> {
    rows.sort();
    rows
}

/// Rows of a tick and what belongs to it.
fn rows(found: &Value) -> Vec<(u64, Vec<u64>)> {
    let numbers = |row: &Value| row.as_array().unwrap().iter().map(|number| number.as_u64().unwrap()).collect::<Vec<_>>();
    let split = |row: Vec<u64>| (row[0], row[1..].to_vec());
    found.as_array().unwrap().iter().map(|row| split(numbers(row))).collect()
}

/// Curves that `docs/sessions.md` promises to whoever opens a recording in PlotJuggler.
const CURVES: [&str; 6] = [
    "/tool/pose/position/z",
    "/tool/velocity_m_s/x",
    "/force/force_n/x",
    "/force/motor_n/z",
    "/tissue/contact_count",
    "/fluid/pressure_pa",
];

/// Nothing of it is what `mcap doctor`, Foxglove or PlotJuggler would refuse or show otherwise; and PlotJuggler has these curves of it, up to the last tick.
fn assert_others_take_it(path: &Path, ours: &Block) {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("readers/others.py");
    let asked = python().arg(script).arg(path).output().unwrap();
    assert!(asked.status.success(), "{}", String::from_utf8_lossy(&asked.stderr));
    let found: Value = serde_json::from_slice(&asked.stdout).unwrap();
    assert_eq!(found["complaints"], serde_json::json!([]));
    let curves: Vec<&str> = found["curves"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    let missing: Vec<&str> = CURVES.into_iter().filter(|curve| !curves.contains(curve)).collect();
    assert_eq!(missing, Vec::<&str>::new(), "of {curves:?}");
    let last_tick = ours.applied.last().map(|record| record.tick);
    assert_eq!(found["newest_ns"]["/force"].as_u64(), last_tick.map(|tick| tick * TICK_NS));
}

/// Foxglove's own reader finds each message by the summary, and in a file that was cut those before the cut.
fn assert_foxglove_reads_it(path: &Path, counted: &Value) {
    let modules = packages().join("node_modules");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("readers/foxglove.js");
    let asked = Command::new("node").arg(script).arg(path).env("NODE_PATH", &modules).output();
    let Some(asked) = asked.ok().filter(|_| modules.join("@mcap/core").is_dir()) else {
        return not_shown(
            "a recording read by Foxglove's reader: there is none (npm install --prefix target/reader @mcap/core @mcap/support)",
        );
    };
    assert!(asked.status.success(), "{}", String::from_utf8_lossy(&asked.stderr));
    let found: Value = serde_json::from_slice(&asked.stdout).unwrap();
    let there = |counts: &Value| {
        let counts = counts.as_object().unwrap().iter().filter_map(|(topic, count)| Some((topic.clone(), count.as_u64()?)));
        counts.filter(|(_, count)| *count > 0).collect::<BTreeMap<_, _>>()
    };
    assert_eq!(there(&found["whole"]["messages"]), there(counted));
    assert!(found["whole"]["metadata"].as_array().unwrap().iter().any(|name| name == "station"), "{}", found["whole"]);
    let (cut, whole) = (found["cut"]["messages"]["/force"].as_u64(), counted["/force"].as_u64().unwrap());
    assert!(cut.is_some_and(|cut| (1..whole).contains(&cut)), "{cut:?} of {whole} ticks before the cut");
}

#[test]
fn what_the_mcap_package_of_pypi_reads_is_what_was_recorded() {
    let has_it = python().args(["-c", "import mcap.reader"]).output().is_ok_and(|tried| tried.status.success());
    if !has_it {
        return not_shown(
            "a recording read by the mcap package of PyPI: there is none (pip install --target target/reader mcap)",
        );
    }
    let folder = Folder::new("reader");
    let path = session(&folder);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("readers/dump.py");
    let dumped = python().arg(script).arg(&path).output().unwrap();
    assert!(dumped.status.success(), "{}", String::from_utf8_lossy(&dumped.stderr));
    let dumped: Value = serde_json::from_slice(&dumped.stdout).unwrap();
    let ours = Recording::read(&path).unwrap().content;
    assert_continuous(&ours);
    assert_others_take_it(&path, &ours);
    assert_foxglove_reads_it(&path, &dumped["counted"]);
    let topics = dumped["topics"].as_object().unwrap();
    for (topic, found) in topics {
        assert_eq!(found["misfit"], Value::Null, "{topic}");
        assert_eq!((&found["encoding"], &found["schema_encoding"]), (&"json".into(), &"jsonschema".into()), "{topic}");
        assert_eq!(found["messages"], dumped["counted"][topic], "{topic}: as the summary counts them");
    }
    assert_eq!(topics["/tool"]["schema"], "foxglove.PoseInFrame");
    assert_eq!(topics["/events"]["schema"], "foxglove.Log");
    let counts = [
        ("/tool", ours.applied.len()),
        ("/force", ours.applied.len()),
        ("/steps", ours.steps.len()),
        ("/tissue", ours.tissue.len()),
        ("/fluid", ours.fluid.len()),
        ("/events", ours.events.len()),
        ("/checkpoints", ours.checkpoints.len()),
        ("/processes", ours.processes.len()),
        ("/scene", ours.scene.len()),
    ];
    for (topic, count) in counts {
        assert_eq!(topics[topic]["messages"], count, "{topic}");
        assert!(count > 0, "{topic} is empty");
    }
    // Drawn where there is a driver.
    let pictures = topics.get("/pictures");
    assert!(pictures.is_none_or(|found| found["schema"] == "foxglove.CompressedImage"), "{pictures:?}");
    assert_eq!(pictures.map_or(0, |found| found["messages"].as_u64().unwrap()), ours.pictures.len() as u64);
    let forces: Vec<_> = ours.applied.iter().map(|record| (record.tick, bits(&record.command.force_n))).collect();
    assert_eq!(rows(&dumped["forces"]), forces);
    assert!(forces.iter().any(|(_, force)| force.iter().any(|bits| bits << 1 != 0)), "the hand has felt something");
    let place = |pose: &Pose| [bits(&pose.position_m), bits(&pose.orientation)].concat();
    let places: Vec<_> = ours.applied.iter().map(|record| (record.tick, place(&record.sample.pose))).collect();
    assert_eq!(rows(&dumped["places"]), places);
    assert_statuses(&dumped, &ours);
    let steps: Vec<_> = ours.steps.iter().map(|step| (step.tick, format!("{:016x}", step.state_hash))).collect();
    let found = dumped["steps"].as_array().unwrap().iter();
    let theirs: Vec<_> = found.map(|step| (step[0].as_u64().unwrap(), step[1].as_str().unwrap().to_string())).collect();
    assert_eq!(sorted(theirs), sorted(steps));
    let said: Vec<&str> = ours.events.iter().filter(|event| event.kind == SAID).map(|event| &*event.text).collect();
    for target in ["tissue:", "recorder", "haptic:"] {
        let injected = said.iter().filter(|words| words.starts_with(&format!("fault kill injected into {target}"))).count();
        assert_eq!(injected, 1, "what the supervisor said is there once, whoever wrote it: {said:?}");
    }
}
