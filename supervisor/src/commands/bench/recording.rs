//! `bench recording`: what a recording costs the Main Loop, how fast it grows, how fast one of an hour is reported, sought in and gone on in, how fast the
//! virtual clock does one again, and how soon it shows a time in it. The Main Loop is measured as in `bench flow`: the default station with a recording and
//! without, in turns, the median of the pairs, and between which of them it lies with 95 %: where that reaches beyond the limit, so many pairs do not show
//! that it is held, and `--pairs` takes more. The hour is the session of those turns, again and again, so that each tick is a real one.

mod hour;

use super::arm::{Arm, Kind, WINDOW_NS};
use super::program::{self, Place, Said};
use super::targets::{Target, interval95, median, ratios, step_us};
use super::{Folder, beside, not_started};
use crate::cli::WindowArgs;
use crate::commands::large;
use crate::settings::Refusal;
use hyst_exchange::{machine, system};
use hyst_recording::{Block, Reader, Session};
use serde_json::{Value, json};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

/// Pairs of windows, if no other number is asked for: a median of seven forgets three that the host disturbed. Its interval is their whole range, though.
const PAIRS: u32 = 7;
/// Length of a window, s, likewise: two checkpoints are recorded in it.
const WINDOW_S: f64 = 10.0;
/// The Main Loop's step with a recording over that without.
const MOST_RATIO: f64 = 1.01;
/// Bytes of the file for each second of the session.
const MOST_MB_S: f64 = 1.0;
/// Recorded time over the time that the virtual clock takes to do it again.
const LEAST_AGAIN: f64 = 1.0;
/// Length of the session that is done again, s.
const AGAIN_S: u64 = 10;
/// Its file.
const AGAIN: &str = "again.mcap";
/// The time in it that is shown first, s: half way between two checkpoints, so that half of what can lie between is done again before.
const SHOWN_S: f64 = 7.5;
/// Between two looks whether it has come to that, ns.
const LOOK_NS: u64 = 1_000_000;
/// No start, with what is done again before, takes longer, s.
const MOST_WAIT_S: f64 = 120.0;
/// How long `hystation stop` may take, ns: twice what it waits for itself.
const STOP_NS: u64 = 30_000_000_000;

/// Measures, prints, and says whether every target is held.
pub fn recording(mesh: Option<&Path>, windows: WindowArgs, json: bool) -> Result<u8, Refusal> {
    let folder = Folder::new("recording")?;
    let session = folder.file("session.mcap");
    let arms = take_turns(mesh, &session, windows)?;
    let (row, judged) = beside_the_main_loop(&arms);
    let (mut rows, mut targets) = (vec![row], Vec::from(judged));
    let (row, target) = size(&session)?;
    rows.push(row);
    targets.push(target);
    let hour = folder.file("hour.mcap");
    hour::repeat(&session, &hour)?;
    for (row, target) in hour::measured(&hour, &folder)?.into_iter().chain([again(mesh, &folder)?]) {
        rows.push(row);
        targets.push(target);
    }
    rows.push(shown(&folder)?);
    let machine = machine::describe();
    if json {
        rows.extend(targets.iter().map(Target::json));
        println!("{:#}", json!({ "machine": machine, "rows": rows }));
    } else {
        println!("{machine}");
        rows.iter().for_each(|row| println!("{row}"));
        targets.iter().for_each(|target| println!("{target}"));
    }
    Ok(u8::from(targets.iter().any(|target| target.held == Some(false))))
}

fn failed(error: &dyn std::fmt::Display) -> Refusal {
    Refusal::failed(format!("bench recording: {error}"))
}

fn take_turns(mesh: Option<&Path>, session: &Path, windows: WindowArgs) -> Result<[Arm; 2], Refusal> {
    let arm = || Arm::new(Kind::Processes, 2).windows_of(window_ns(windows.window_s.unwrap_or(WINDOW_S)));
    let mut arms = [arm().recording(session.to_path_buf()), arm()];
    for round in 0..windows.pairs.unwrap_or(PAIRS) as usize {
        for turn in 0..arms.len() {
            arms[(round + turn) % 2].run(mesh)?;
        }
    }
    Ok(arms)
}

/// The length of a window that is at least so long, ns: whole rounds of the hand, so that each has the same contact.
fn window_ns(window_s: f64) -> u64 {
    ((window_s * 1e9) as u64).div_ceil(WINDOW_NS).max(1) * WINDOW_NS
}

/// The median of the pairs, which is to be within the limit, and the upper end of its interval: within it that is shown; if even the lower end is above, it is
/// not held; else it is not judged.
fn beside_the_main_loop([with, without]: &[Arm; 2]) -> (Value, [Target; 2]) {
    let steps = |arm: &Arm| arm.windows.iter().map(step_us).collect::<Vec<_>>();
    let pairs = ratios(with, without);
    let is_sound = [with, without].iter().all(|arm| arm.failures.is_empty());
    let interval = interval95(pairs.clone()).filter(|_| is_sound);
    let middle = median(pairs.clone()).filter(|_| is_sound);
    let row = json!({
        "arm": "station",
        "name": "Main Loop beside the recorder",
        "window_s": with.window_ns as f64 * 1e-9,
        "main_loop_us": { "with": steps(with), "without": steps(without) },
        "ratios": pairs,
        "median": middle,
        "interval95": interval,
        "failures": [&with.failures, &without.failures],
    });
    let median = Target::new("Main Loop's median step, with a recording over without".into(), middle, MOST_RATIO, false);
    let lower = interval.map_or("-".into(), |[lower, _]| format!("{lower:.3}"));
    let name = format!("the same with 95 %: {} pairs, from {lower} to", pairs.len());
    let upper = Target::new(name, interval.map(|[_, upper]| upper), MOST_RATIO, false);
    let held = match interval {
        Some([lower, _]) if lower > MOST_RATIO => Some(false),
        _ => upper.held.filter(|held| *held),
    };
    (row, [median.required(), Target { held, ..upper }])
}

fn length_of(path: &Path) -> Result<u64, Refusal> {
    Ok(std::fs::metadata(path).map_err(|e| failed(&e))?.len())
}

/// All blocks of a recording, and its session.
fn blocks(path: &Path) -> Result<(Session, Vec<Block>), Refusal> {
    let mut reader = Reader::open(path).map_err(|e| failed(&e))?;
    let mut blocks = Vec::new();
    while let Some(block) = reader.next_block().map_err(|e| failed(&e))? {
        blocks.push(block);
    }
    Ok((reader.session().clone(), blocks))
}

fn size(session: &Path) -> Result<(Value, Target), Refusal> {
    let bytes = length_of(session)?;
    let ticks: usize = blocks(session)?.1.iter().map(|block| block.applied.len()).sum();
    let mb_s = (ticks > 0).then(|| bytes as f64 * 1e-6 / (ticks as f64 * 1e-3));
    let kind = session.parent().and_then(large::file_system);
    let row = json!({ "arm": "file", "name": "size", "bytes": bytes, "ticks": ticks, "mb_s": mb_s, "file_system": kind });
    Ok((row, Target::new("MB of a recording for each second of its session".into(), mb_s, MOST_MB_S, false).required()))
}

/// Runs this program with these words; the time that it took, s, if it gave one of these codes.
fn timed(command: &mut Command, codes: &[i32]) -> Result<f64, Refusal> {
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    let begun = Instant::now();
    let mut child = command.spawn().map_err(|e| not_started(Path::new(command.get_program()), &e))?;
    let said = Said::of(child.stderr.take());
    let status = program::ends_within(&mut child, program::MOST_NS);
    let time_s = begun.elapsed().as_secs_f64();
    let words: Vec<_> = command.get_args().map(|word| word.to_string_lossy()).collect();
    let what = format!("`hystation {}`", words.join(" "));
    match status {
        Some(status) if status.code().is_some_and(|code| codes.contains(&code)) => Ok(time_s),
        Some(status) => Err(failed(&format!("{what} gave {status}: {}", said.text().trim()))),
        None => Err(program::endless(&format!("bench recording: {what}"), program::MOST_NS)),
    }
}

/// A session on the virtual clock, and the same done again and compared.
fn again(mesh: Option<&Path>, folder: &Folder) -> Result<(Value, Target), Refusal> {
    let file = folder.file(AGAIN);
    let own = beside("hystation")?;
    let name = format!("bench-{}-a", std::process::id());
    let _place = Place::named(&name)?; // cleared however this ends
    let mut record = Command::new(&own);
    record.args(["--name", &name, "run", "--headless", "--quiet", "--lockstep", "--for", &format!("{AGAIN_S}s")]).args(mesh);
    record.arg("--record").arg(&file);
    timed(&mut record, &[0])?;
    let mut verify = Command::new(&own);
    verify.args(["--name", &name, "replay", "--verify"]).arg(&file);
    let time_s = timed(&mut verify, &[0])?;
    let ratio = AGAIN_S as f64 / time_s;
    let row = json!({ "arm": "station", "name": "replay", "session_s": AGAIN_S, "time_s": time_s, "ratio": ratio });
    let name = "Recorded time over that of its replay, start and comparison included".into();
    Ok((row, Target::new(name, Some(ratio), LEAST_AGAIN, true)))
}

/// What a trainer waits for who asks for a time in that session: from the command until its first tick is shown. Nothing judges it.
fn shown(folder: &Folder) -> Result<Value, Refusal> {
    let name = format!("bench-{}-s", std::process::id());
    let place = Place::named(&name)?;
    let own = beside("hystation")?;
    let mut replay = Command::new(&own);
    replay.args(["--name", &name, "replay", "--headless", "--set", "console_port=0", "--from", &format!("{SHOWN_S}s")]);
    replay.arg(folder.file(AGAIN)).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let begun = Instant::now();
    let mut child = replay.spawn().map_err(|e| not_started(&own, &e))?;
    let has_come = || place.0.open().is_ok_and(|page| page.is_lockstep() && page.present_tick() as f64 >= SHOWN_S * 1e3);
    let time_s = loop {
        let time_s = begun.elapsed().as_secs_f64();
        if has_come() {
            break Some(time_s);
        }
        if time_s > MOST_WAIT_S || child.try_wait().is_ok_and(|ended| ended.is_some()) {
            break None;
        }
        system::sleep_ns(LOOK_NS);
    };
    let stop = Command::new(&own).args(["--name", &name, "stop"]).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    if let Ok(mut stop) = stop {
        program::ends_within(&mut stop, STOP_NS); // it may have ended
    }
    program::end(&mut child); // the same
    let what = "from the command `hystation replay FILE --from T` to the first shown tick, s";
    Ok(json!({ "arm": "station", "name": what, "session_s": AGAIN_S, "from_s": SHOWN_S, "time_s": time_s }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::bench::probe::{Spell, Window};

    fn window(step_ns: u64) -> Window {
        let mut looping = vec![0; hyst_messages::LATENCY_BUCKETS];
        looping[hyst_messages::bucket_of_ns(step_ns)] = 1_000;
        let tissue = Spell { seconds: 2.0, steps: Some(2_000), looping, ..Spell::default() };
        Window { spells: [("tissue:active".into(), tissue)].into(), quiet: true, ..Window::default() }
    }

    #[test]
    fn a_cost_is_shown_only_where_its_interval_is_within_the_limit_and_refuted_where_it_is_above() {
        let judged = |with_ns: &[u64]| {
            let mut arms = [Arm::new(Kind::Processes, 2), Arm::new(Kind::Processes, 2)];
            arms[0].windows = with_ns.iter().map(|step_ns| window(*step_ns)).collect();
            arms[1].windows = with_ns.iter().map(|_| window(500_000)).collect();
            let (row, targets) = beside_the_main_loop(&arms);
            assert_eq!(row["ratios"].as_array().unwrap().len(), with_ns.len(), "{row}");
            targets.map(|target| target.held)
        };
        assert_eq!(judged(&[500_000; 7]), [Some(true), Some(true)]);
        assert_eq!(judged(&[500_000; 5]), [Some(true), None], "five pairs show nothing");
        assert_eq!(judged(&[500_000, 500_000, 500_000, 500_000, 500_000, 500_000, 600_000]), [Some(true), None]);
        assert_eq!(judged(&[600_000; 7]), [Some(false), Some(false)]);
        // Of nine pairs the interval leaves out one at each end.
        let one_bad = [[500_000u64; 8].to_vec(), vec![600_000]].concat();
        assert_eq!(judged(&one_bad), [Some(true), Some(true)]);
    }

    #[test]
    fn a_window_has_whole_rounds_of_the_hand() {
        assert_eq!([0.0, 0.5, 2.0, 2.1, 10.0].map(window_ns), [1, 1, 1, 2, 5].map(|rounds| rounds * WINDOW_NS));
    }
}
