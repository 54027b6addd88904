//! The recording of an hour: a session of some seconds written again and again; what its report takes, what a time in it, and what a recorder that goes on
//! in it.

use super::{blocks, failed, length_of, timed};
use crate::commands::bench::targets::Target;
use crate::commands::bench::{Folder, beside};
use crate::commands::report;
use crate::settings::Refusal;
use hyst_assessment::{Judge, judge_until};
use hyst_messages::Role;
use hyst_recording::{Block, Playback, Reader, Writer, checkpoints, outline};
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// The long recording, and how long its report and its search may take, s.
const HOUR_TICKS: u64 = 3_600_000;
const MOST_REPORT_S: f64 = 10.0;
const MOST_SEEK_S: f64 = 1.0;
/// Where in it a tick is sought, and how long before it the newest that is there may lie: a second.
const SOUGHT_TICK: u64 = 3_000_000;
const GAP_TICKS: u64 = 1_000;
/// Opened by a recorder that follows one that died, s: half of what the device's ring holds meanwhile, for it has to start, too.
const MOST_GO_ON_S: f64 = 2.0;

/// All that is measured of it; the last takes its summary away.
pub(super) fn measured(hour: &Path, folder: &Folder) -> Result<[(Value, Target); 4], Refusal> {
    Ok([reported(hour, folder)?, sought(hour)?, judged_before(hour)?, gone_on(hour)?])
}

/// A case that nobody comes to the end of, before its first tick.
fn case() -> Result<Judge, Refusal> {
    let brief = json!({
        "name": "bench", "rung": "polyp", "task": "Go on.", "seed": 1, "drawn": [], "pathology_ml": 2.0, "score": {},
        "pathologies_m": [[0.01, 0.0, 0.05]], "pathology_sight": { "optic_rad": 0.2, "within_rad": 0.6, "within_m": 0.025 },
        "goals": [{ "words": "all of it and more", "is": { "removed": 1e9 } }],
        "end": { "goals": true, "time_s": null, "deficit_ml": null, "bled_ml": null, "perforation": false },
        "warnings": [{ "words": "too hard", "is": { "force_above": 1.0 } }],
    });
    Judge::read(&brief.to_string()).map_err(|e| failed(&e))
}

/// What a referee makes of a block, and keeps of it beside a checkpoint, as a recorder does.
fn follow(judge: &mut Judge, block: &mut Block) {
    block.tissue.iter().for_each(|status| judge.tissue(status));
    block.fluid.iter().for_each(|status| judge.fluid(status));
    block.applied.iter().for_each(|record| judge.tick(record));
    if !block.checkpoints.is_empty() {
        block.judged = judge.kept(judge.last_tick).into_iter().collect();
    }
}

/// Writes the session again and again, each time with the ticks after those before, until the recording has an hour; with what is judged of a case.
pub(super) fn repeat(session: &Path, hour: &Path) -> Result<(), Refusal> {
    let (mut facts, blocks) = blocks(session)?;
    let ticks = || blocks.iter().flat_map(|block| &block.applied).map(|record| record.tick);
    let (first, last) = ticks().next().zip(ticks().next_back()).ok_or_else(|| failed(&"the station recorded no tick"))?;
    let length = last + 1 - first;
    let mut judge = case()?;
    facts.insert("case".into(), serde_json::to_string(&judge.brief).map_err(|e| failed(&e))?);
    let mut writer = Writer::open(hour, &facts).map_err(|e| failed(&e))?;
    for round in 0..HOUR_TICKS.div_ceil(length) {
        for block in &blocks {
            let mut block = block.clone();
            shift(&mut block, |tick| (tick + round * length + 1).saturating_sub(first));
            follow(&mut judge, &mut block);
            writer.append(&block).map_err(|e| failed(&e))?;
        }
    }
    writer.finish().map_err(|e| failed(&e))?;
    Ok(())
}

/// Moves all ticks of a block.
fn shift(block: &mut Block, to: impl Fn(u64) -> u64) {
    for record in &mut block.applied {
        for tick in [
            &mut record.tick,
            &mut record.command.tick,
            &mut record.command.force_tick,
            &mut record.sample.hardware_tick,
            &mut record.model_tick,
            &mut record.medium_tick,
        ] {
            *tick = to(*tick);
        }
    }
    for step in &mut block.steps {
        (step.tick, step.input_tick, step.from_tick) = (to(step.tick), to(step.input_tick), to(step.from_tick));
    }
    for origin in &mut block.origins {
        (origin.tick, origin.from_tick) = (to(origin.tick), to(origin.from_tick));
    }
    block.tissue.iter_mut().for_each(|status| status.state_tick = to(status.state_tick));
    block.fluid.iter_mut().for_each(|status| status.state_tick = to(status.state_tick));
    block.events.iter_mut().for_each(|event| event.tick = to(event.tick));
    block.processes.iter_mut().for_each(|spell| spell.tick = to(spell.tick));
    block.checkpoints.iter_mut().for_each(|kept| kept.tick = to(kept.tick));
}

/// Its page, in a process of its own: a session of a case, as in a class.
fn reported(hour: &Path, folder: &Folder) -> Result<(Value, Target), Refusal> {
    let mut command = Command::new(beside("hystation")?);
    command.arg("report").arg(hour).arg("--html").arg(folder.file("hour.html"));
    // 3: each repetition is a jump of the hand, and of what was counted.
    let time_s = timed(&mut command, &[0, 3])?;
    let row = json!({ "arm": "file", "name": "report", "ticks": HOUR_TICKS, "bytes": length_of(hour)?, "time_s": time_s });
    Ok((row, Target::new("Report of a recording of an hour, as a page, s".into(), Some(time_s), MOST_REPORT_S, false)))
}

/// What a replay looks for before it shows anything, in a file that was just written: the states before a time, the end, and the ticks from that time on.
fn sought(hour: &Path) -> Result<(Value, Target), Refusal> {
    let begun = Instant::now();
    let states = checkpoints(hour, SOUGHT_TICK).map_err(|e| failed(&e))?;
    let begin_tick = states.iter().find(|state| state.role == Role::Tissue).map_or(0, |state| state.tick);
    let end_tick = outline(hour).map_err(|e| failed(&e))?.map(|outline| outline.last_tick);
    let mut playback = Playback::open(hour).map_err(|e| failed(&e))?;
    playback.skip_to(begin_tick).map_err(|e| failed(&e))?;
    let moment = playback.at(SOUGHT_TICK).map_err(|e| failed(&e))?;
    let time_s = begun.elapsed().as_secs_f64();
    let is_found = begin_tick > 0 && end_tick >= Some(HOUR_TICKS) && moment.is_some_and(|moment| moment.applied.is_some());
    let row = json!({
        "arm": "file",
        "name": "seek",
        "tick": SOUGHT_TICK,
        "begin_tick": begin_tick,
        "end_tick": end_tick,
        "time_s": time_s,
    });
    let name = "A time found in a recording of an hour, with the states before it and the end, s".into();
    Ok((row, Target::new(name, Some(time_s).filter(|_| is_found), MOST_SEEK_S, false).required()))
}

/// What a replay that begins at that time looks for beside it, if the session has a case: what of it was done before.
fn judged_before(hour: &Path) -> Result<(Value, Target), Refusal> {
    let (reader, brief) = (report::open(hour)?, case()?.brief);
    let begun = Instant::now();
    let judge = judge_until(reader, &brief, SOUGHT_TICK, report::threads()).map_err(|e| failed(&e))?;
    let time_s = begun.elapsed().as_secs_f64();
    let last_tick = judge.last_tick;
    let row = json!({ "arm": "file", "name": "judged", "tick": SOUGHT_TICK, "last_tick": last_tick, "time_s": time_s });
    let name = "What of a case was done before that time, judged, s".into();
    // Some ticks of a session are not there.
    let is_there = last_tick + GAP_TICKS > SOUGHT_TICK;
    Ok((row, Target::new(name, Some(time_s).filter(|_| is_there), MOST_SEEK_S, false).required()))
}

/// What a recorder that follows one that died needs until it goes on in the file, whose summary counts for nothing then.
fn gone_on(hour: &Path) -> Result<(Value, Target), Refusal> {
    let facts = Reader::open(hour).map_err(|e| failed(&e))?.session().clone();
    let begun = Instant::now();
    let writer = Writer::open(hour, &facts).map_err(|e| failed(&e))?;
    let time_s = begun.elapsed().as_secs_f64();
    let last_tick = writer.last_tick();
    let row = json!({ "arm": "file", "name": "gone on", "last_tick": last_tick, "bytes": writer.bytes(), "time_s": time_s });
    let name = "A recorder that follows goes on in a recording of an hour, s".into();
    Ok((row, Target::new(name, Some(time_s).filter(|_| last_tick >= Some(HOUR_TICKS)), MOST_GO_ON_S, false).required()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::{AppliedRecord, StepRecord};
    use hyst_recording::Session;

    #[test]
    fn a_session_that_is_repeated_has_each_tick_once_and_its_states_where_they_belong() {
        let folder = Folder::new("recording").unwrap();
        let [short, long] = ["short.mcap", "long.mcap"].map(|name| folder.file(name));
        let block = |first: u64| Block {
            applied: (first..first + 200)
                .map(|tick| AppliedRecord { tick, model_tick: tick - 1, ..AppliedRecord::default() })
                .collect(),
            steps: vec![StepRecord { tick: first, from_tick: first - 1, ..StepRecord::default() }],
            checkpoints: vec![hyst_recording::Checkpoint { role: Role::Tissue, tick: first, state: vec![7; 16] }],
            ..Block::default()
        };
        let facts = Session::from([("session".into(), "bench".into())]);
        let mut writer = Writer::open(&short, &facts).unwrap();
        // So long that an hour is three of them.
        (0..6_000).for_each(|part| writer.append(&block(500 + 200 * part)).unwrap());
        writer.finish().unwrap();
        repeat(&short, &long).unwrap();
        let mut continuity = hyst_recording::Continuity::default();
        Reader::open(&long).unwrap().each_block(2, |block| continuity.follow(&block)).unwrap();
        assert_eq!((continuity.ticks, continuity.repeated, continuity.missing()), (HOUR_TICKS, 0, 0));
        let (row, target) = sought(&long).unwrap();
        assert_eq!((row["begin_tick"].as_u64(), target.value.is_some()), (Some(SOUGHT_TICK - 199), true), "{row}");
        let (row, target) = judged_before(&long).unwrap();
        assert_eq!((row["last_tick"].as_u64(), target.value.is_some()), (Some(SOUGHT_TICK), true), "{row}");
        let kept = Reader::open(&long).unwrap().judged(SOUGHT_TICK).unwrap().unwrap();
        assert_eq!(kept.tick, SOUGHT_TICK, "it goes on from there");
        let brief = Reader::open(&long).unwrap().session()["case"].clone();
        assert_eq!(Judge::read(&brief).unwrap(), case().unwrap(), "its report judges by it");
        let (row, target) = gone_on(&long).unwrap();
        assert_eq!((row["last_tick"].as_u64(), target.value.is_some()), (Some(HOUR_TICKS), true), "{row}");
    }
}
