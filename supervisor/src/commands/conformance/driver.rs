//! `hystation conformance driver`: whether a driver of a haptic device does what docs/driver.md asks. It is started on a bench of its own, where this program
//! stands for the `device` engine: it commands forces of at most 0.3 N, then such as no motor may follow, falls silent, is replaced, and stops.
//!
//! What is compared is the driver's own ledger, tick by tick: which command it followed, and what its motors made; and, where the tip gives way, how it moved.

mod bench;
mod motion;

use super::{Check, NO_TIME, check};
use crate::settings::Refusal;
use bench::{Bench, Seen, fresh};
use hyst_messages::{DeviceStatement, ForceCommand, HardwareSample, LedgerEntry, Role};
use std::path::Path;

/// Largest force that is commanded, N, and as a share of what the device can make.
const FORCE_N: f32 = 0.3;
const FORCE_SHARE: f32 = 0.3;
/// Ticks: of the rise to that force, of each trial, and in which what a trial has left comes to rest or into the ledger.
const RISE_TICKS: u64 = 200;
const TRIAL_TICKS: u64 = 1_000;
const REST_TICKS: u64 = 150;
/// Commands in a row that no motor may follow: too few for the watchdog.
const BAD_TICKS: u64 = 3;
/// A silent station: in so many ticks the force must be gone (8 held, 20 of the ramp, and as much again for motors and clocks); nothing is asked of the
/// first ones, in which it is still held.
const SILENT_TICKS: u64 = 60;
/// How old a command is that nobody may follow any more: newer than the last that was followed, for the station has been silent for longer.
const OLD_TICKS: u64 = 100;
const _: () = assert!(OLD_TICKS < SILENT_TICKS + 2 * REST_TICKS);
/// How far a motor may be from what it is told: a share of it, and N.
const SHARE_OFF: f32 = 0.1;
const OFF_N: f32 = 0.02;
/// Share of the entries that may be farther off, and of the ticks that the ledger may lack.
const FEW: f64 = 0.05;
/// This program's own lateness that explains a ramp of the driver: as long as its watchdog waits, ns.
const LATE_NS: u64 = 6_000_000;
/// How often it is tried if this program was late itself.
const TRIES: usize = 3;

/// Checks a driver, until it is given up: then nothing is left of the bench, and what was found means nothing.
pub fn conformance(binary: &Path, given_up: &dyn Fn() -> bool) -> Result<Vec<Check>, Refusal> {
    let mut checks = super::asked(binary, Role::Hardware, given_up)?;
    for attempt in 1..=TRIES {
        let (found, late_ns) = on_a_bench(binary, given_up)?;
        let is_good = found.iter().all(|check| check.good);
        if is_good || late_ns < LATE_NS {
            checks.extend(found);
            break;
        }
        if attempt == TRIES {
            checks.push(check(NO_TIME, Err(format!("this program itself was {:.1} ms late", late_ns as f64 * 1e-6))));
        }
    }
    Ok(checks)
}

/// What was found, and how late this program was.
fn on_a_bench(binary: &Path, given_up: &dyn Fn() -> bool) -> Result<(Vec<Check>, u64), Refusal> {
    let mut bench = Bench::start(binary, given_up)?;
    let stated = match bench.statement() {
        Ok(stated) => stated,
        Err(why) => return Ok((vec![check("states what it can do", Err(why))], 0)),
    };
    let mut checks = vec![check("states what it can do", stated.check().map(|()| stated.words()))];
    if !checks[0].good {
        return Ok((checks, 0));
    }
    if let Err(why) = bench.first_sample() {
        checks.push(check("gives samples", Err(why)));
        return Ok((checks, 0));
    }
    let most_n = FORCE_N.min(FORCE_SHARE * stated.limits.max_force_n);
    let gone_on = |checks: &[Check]| checks.iter().all(|check| check.good);
    checks.extend(samples(&mut bench, &stated, most_n));
    // Of one whose motors do not do as they are told the same would be said again.
    if gone_on(&checks) {
        checks.push(check("moves the way it is pushed", motion::pushed(&mut bench, &stated, most_n)));
    }
    checks.push(check("follows no wrong command", wrong_commands(&mut bench, &stated, most_n)));
    checks.push(check("lets go when nobody commands", silence(&mut bench, most_n)));
    if gone_on(&checks) {
        checks.push(check("follows the next device engine", next_device(&mut bench, most_n)?));
    }
    checks.push(check("says how fast it goes", motion::speeds(&bench.seen)));
    let late_ns = bench.late_ns;
    checks.push(check("stops when it is told", bench.stop()));
    Ok((checks, late_ns))
}

/// The force that is commanded at a tick of a trial: along y it rises, and then goes up and down a little, so that it is another one in each tick.
fn wanted_n(tick: u64, begun: u64, most_n: f32) -> f32 {
    let since = tick.saturating_sub(begun);
    let share = (since as f32 / RISE_TICKS as f32).min(1.0);
    most_n * share * (0.8 + 0.2 * (since as f32 * 0.01).sin())
}

/// Whether a value is no larger than it may be; NaN is not.
fn is_within(value: f32, most: f32) -> bool {
    value <= most
}

fn length(force_n: [f32; 3]) -> f32 {
    force_n.iter().map(|c| c * c).sum::<f32>().sqrt()
}

/// Commands a force for a while, and looks whether the motors made it: `begun` is before the first tick.
fn push(bench: &mut Bench, begun: u64, most_n: f32) -> Result<String, String> {
    bench.drive(TRIAL_TICKS + REST_TICKS, |tick| Some(fresh(tick, [0.0, wanted_n(tick, begun, most_n), 0.0])));
    let entries = bench.ledger(begun + RISE_TICKS..begun + TRIAL_TICKS);
    let ticks = TRIAL_TICKS - RISE_TICKS;
    if (entries.len() as f64) < ticks as f64 * (1.0 - FEW) / 2.0 {
        return Err(format!("its ledger has {} entries for {ticks} ms", entries.len()));
    }
    let is_followed = |entry: &&LedgerEntry| entry.force_tick > begun && entry.station_tick < entry.force_tick.saturating_add(10);
    let followed = entries.iter().filter(is_followed).count();
    if (followed as f64) < entries.len() as f64 * (1.0 - FEW) {
        return Err(format!("of {} of its ticks only {followed} had a new command", entries.len()));
    }
    let far_n = |entry: &LedgerEntry| {
        let wanted = wanted_n(entry.force_tick, begun, most_n);
        let [x, y, z] = entry.force_n;
        (length([x, y - wanted, z]), wanted)
    };

    let is_far = |entry: &&LedgerEntry| {
        let (off_n, wanted) = far_n(entry);
        !is_within(off_n, OFF_N + SHARE_OFF * wanted)
    };
    let far: Vec<&LedgerEntry> = entries.iter().filter(is_far).collect();
    if far.len() as f64 > entries.len() as f64 * FEW {
        let (made, wanted) = (far[far.len() / 2].force_n, far_n(far[far.len() / 2]).1);
        return Err(format!(
            "told to make {wanted:.3} N along y, it made {made:.3?} N ({} of {} ticks)",
            far.len(),
            entries.len()
        ));
    }
    Ok(format!("up to {most_n:.2} N in {} ticks, {} of them off", entries.len(), far.len()))
}

/// A free second, in which everything that can be said of samples is looked at; and the motors.
fn samples(bench: &mut Bench, stated: &DeviceStatement, most_n: f32) -> Vec<Check> {
    bench.seen.clear();
    let begun = bench.tick();
    let (steps, _) = bench.beat();
    let pushed = push(bench, begun, most_n);
    let (steps, beat_ns) = (bench.beat().0.saturating_sub(steps), bench.beat().1);
    let seen = std::mem::take(&mut bench.seen);
    let rate = rate(&seen, stated, steps);
    let beats = hyst_exchange::system::now_ns().saturating_sub(beat_ns);
    let rate = if beats > 50_000_000 { Err(format!("its heartbeat is {} ms old", beats / 1_000_000)) } else { rate };
    vec![
        check("gives samples at its rate", rate),
        check("  stamped when they were taken", stamps(&seen, stated)),
        check("  that can be", can_be(&seen, stated)),
        check("makes the force it is told", pushed),
    ]
}

fn rate(seen: &[Seen], stated: &DeviceStatement, steps: u64) -> Result<String, String> {
    let (Some(first), Some(last)) = (seen.first(), seen.last()) else { return Err("no sample came".into()) };
    let time_s = last.seen_ns.saturating_sub(first.seen_ns) as f64 * 1e-9;
    let count = last.sample.hardware_tick.saturating_sub(first.sample.hardware_tick);
    let rate_hz = count as f64 / time_s.max(1e-3);
    let text = format!("{rate_hz:.0} Hz, stated are {:.0}", stated.rate_hz);
    if (rate_hz / f64::from(stated.rate_hz) - 1.0).abs() > FEW {
        return Err(text);
    }
    if (steps as f64) < count as f64 * (1.0 - FEW) {
        return Err(format!("{count} samples, and {steps} steps counted in its page"));
    }
    Ok(text)
}

fn stamps(seen: &[Seen], stated: &DeviceStatement) -> Result<String, String> {
    let mut ages_ns: Vec<i64> = seen.iter().map(|it| (it.seen_ns as i64).saturating_sub(it.sample.time_ns as i64)).collect();
    ages_ns.sort_unstable();
    let Some(median_ns) = ages_ns.get(ages_ns.len() / 2).copied() else { return Err("no sample came".into()) };
    let most_ns = (2e9 / f64::from(stated.rate_hz)) as i64 + 1_000_000;
    let text = format!("{:.2} ms old in the median", median_ns as f64 * 1e-6);
    if !(-100_000..=most_ns).contains(&median_ns) {
        return Err(format!("{text}; on CLOCK_MONOTONIC it must be 0 to {:.1}", most_ns as f64 * 1e-6));
    }
    match seen.windows(2).find(|two| two[1].sample.time_ns <= two[0].sample.time_ns) {
        Some(two) => Err(format!("the stamp of sample {} is not after that of the one before", two[1].sample.hardware_tick)),
        None => Ok(text),
    }
}

fn can_be(seen: &[Seen], stated: &DeviceStatement) -> Result<String, String> {
    let at = |sample: &HardwareSample, what: &str| Err(format!("sample {}: {what}", sample.hardware_tick));
    for Seen { sample, .. } in seen {
        if let Err(what) = stated.admits(sample) {
            return at(sample, &format!("{what} is not finite, or beyond what is stated: {:?}", sample.pose));
        }
        if let Err(why) = is_one_pose(sample) {
            return at(sample, &why);
        }
    }
    match seen.windows(2).find(|two| !two[1].sample.goes_on_from(&two[0].sample)) {
        Some(two) => at(&two[1].sample, "the tip jumps from where it was in the one before"),
        None => Ok(format!("{} samples within what is stated", seen.len())),
    }
}

/// Whether position, orientation and the four degrees of freedom of a pose say the same, of a pivot at the origin.
fn is_one_pose(sample: &HardwareSample) -> Result<(), String> {
    let pose = &sample.pose;
    let (pitch, yaw, deep_m) = (pose.pitch_rad, pose.yaw_rad, pose.insertion_m);
    let axis = [yaw.sin() * pitch.cos(), -pitch.sin(), yaw.cos() * pitch.cos()];
    let far: f32 = length(std::array::from_fn(|i| pose.position_m[i] - axis[i] * deep_m));
    if far > 1e-3 {
        return Err(format!("position_m is {:.1} mm from where pitch, yaw and insertion say the tip is", far * 1e3));
    }
    let [x, y, z, w] = pose.orientation;
    let turned = [2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)];
    let along: f32 = turned.iter().zip(axis).map(|(a, b)| a * b).sum();
    if along < 0.999 { Err("orientation's +z does not lie along pitch and yaw".into()) } else { Ok(()) }
}

/// Commands that are no number, beyond the device, or old, among good ones.
fn wrong_commands(bench: &mut Bench, stated: &DeviceStatement, most_n: f32) -> Result<String, String> {
    let begun = bench.tick();
    type Make = fn(u64, f32) -> ForceCommand;
    let wrong: [(&str, Make); 4] = [
        ("that is no number", |tick, _| fresh(tick, [0.0, f32::NAN, 0.0])),
        ("of ten times its force", |tick, limit_n| fresh(tick, [10.0 * limit_n, 0.0, 0.0])),
        ("of a tick that has passed", |tick, limit_n| fresh(tick - 100, [0.0, 0.0, 0.2 * limit_n])),
        ("of a tick to come", |tick, limit_n| fresh(tick + 10_000, [0.0, 0.0, 0.2 * limit_n])),
    ];
    let first = RISE_TICKS + 100;
    let limit_n = stated.limits.max_force_n;
    let each = |tick: u64| ((tick - begun).saturating_sub(first) / 100) as usize;
    bench.drive(first + 400 + REST_TICKS, |tick| {
        let since = tick - begun;
        let is_wrong = (first..first + 400).contains(&since) && (since - first) % 100 < BAD_TICKS;
        let good = fresh(tick, [0.0, wanted_n(tick, begun, most_n), 0.0]);
        Some(if is_wrong { wrong[each(tick)].1(tick, limit_n) } else { good })
    });
    for entry in bench.ledger(begun + first..begun + first + 400) {
        let [x, y, z] = entry.force_n;

        let most_aside_n = OFF_N + SHARE_OFF * most_n;
        let is_good = is_within(length(entry.force_n), most_n + most_aside_n) && is_within(x.abs().max(z.abs()), most_aside_n);
        if !is_good {
            let (name, _) = wrong[each(entry.station_tick).min(3)];
            return Err(format!("near a command {name} it made [{x:.3}, {y:.3}, {z:.3}] N"));
        }
    }
    // Nobody was shut out by the one from the future.
    let end = begun + first + 400;
    let after = bench.ledger(end..end + REST_TICKS / 2);
    match after.iter().any(|entry| entry.force_tick >= end) {
        true => Ok("no number, ten times its force, old, from the future: none".into()),
        false => Err("after a command from the future it followed no good one".into()),
    }
}

/// The station falls silent under force.
fn silence(bench: &mut Bench, most_n: f32) -> Result<String, String> {
    let begun = bench.tick();
    bench.drive(RISE_TICKS + 100, |tick| Some(fresh(tick, [0.0, wanted_n(tick, begun, most_n), 0.0])));
    let silent = bench.tick();
    bench.drive(SILENT_TICKS + 2 * REST_TICKS, |_| None);
    let entries = bench.ledger(silent..silent + SILENT_TICKS + REST_TICKS);
    let mut steps = entries.windows(2).map(|two| {
        let fell = std::array::from_fn(|i| two[1].force_n[i] - two[0].force_n[i]);
        (length(fell), two[1].station_tick)
    });
    if let Some((step_n, tick)) = steps.find(|(step_n, _)| !is_within(*step_n, OFF_N + 0.25 * most_n)) {
        return Err(format!("{} ms after the last command it let go of {step_n:.3} N at once", tick.saturating_sub(silent)));
    }
    let late: Vec<&LedgerEntry> = entries.iter().filter(|entry| entry.station_tick >= silent + SILENT_TICKS).collect();
    match late.iter().find(|entry| !is_within(length(entry.force_n), OFF_N)) {
        Some(entry) => Err(format!(
            "{} ms after the last command it still makes {:.3} N",
            entry.station_tick - silent,
            length(entry.force_n)
        )),
        None if late.is_empty() => Err("its ledger has no entry for the time in which nobody commanded".into()),
        None => {
            let gone = entries.iter().find(|entry| length(entry.force_n) <= OFF_N).map_or(0, |entry| entry.station_tick - silent);
            Ok(format!("no force {gone} ms after the last command"))
        }
    }
}

/// Another engine in the place of the device, in whose page stands a command of long ago, which no motor may follow; then such as it follows.
fn next_device(bench: &mut Bench, most_n: f32) -> Result<Result<String, String>, Refusal> {
    let replaced = bench.tick();
    bench.replace_device(fresh(replaced.saturating_sub(OLD_TICKS), [0.0, most_n, 0.0]))?;
    bench.drive(SILENT_TICKS, |_| None);
    let begun = bench.tick();
    let pushed = push(bench, begun, most_n);
    let entries = bench.ledger(replaced..replaced + SILENT_TICKS);
    let follows = entries.iter().find(|entry| !is_within(length(entry.force_n), OFF_N));
    Ok(match follows {
        Some(entry) if pushed.is_ok() => {
            Err(format!("of a command that was {OLD_TICKS} ms old when it came it made {:.3} N", length(entry.force_n)))
        }
        _ => pushed,
    })
}
