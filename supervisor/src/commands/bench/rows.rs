//! The result as rows, for scripts and for people.

use super::arm::Arm;
use super::bare::Bare;
use super::probe::Spell;
use super::targets::{Target, add, figures, median, ratios, step_us};
use crate::report::latency;
use hyst_engine::realtime;
use hyst_messages::page::hardware::Total;
use hyst_messages::{PICTURE_PASSES, Role};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fmt::Write;

/// All rows: each arm's station and processes, the bare loop, the targets.
pub fn all(arms: &[Arm], bare: &Bare, targets: &[Target]) -> Vec<Value> {
    let mut rows = vec![bare_row(bare)];
    for arm in arms {
        rows.push(station_row(arm, arms));
        rows.extend(names(arm).iter().map(|name| process_row(arm, name)));
    }
    rows.extend(targets.iter().map(Target::json));
    rows
}

fn bare_row(bare: &Bare) -> Value {
    json!({
        "arm": "bare loop",
        "name": "bare loop",
        "windows": bare.windows,
        "priority": realtime::priority(Role::Device),
        "real_time": bare.real_time,
        "rate_hz": if bare.seconds > 0.0 { bare.steps as f64 / bare.seconds } else { 0.0 },
        "wakeup_us": spread(&bare.wakeup),
        "loop_us": spread(&bare.looping),
    })
}

/// The names of an arm's processes, in the order in which a tick passes through them.
fn names(arm: &Arm) -> Vec<String> {
    let found: BTreeSet<&String> = arm.windows.iter().flat_map(|window| window.spells.keys()).collect();
    let mut names: Vec<String> = found.into_iter().cloned().collect();
    let place = |name: &String| Role::ALL.into_iter().position(|role| Role::name_in(name) == role.name());
    names.sort_by_key(|name| (place(name).unwrap_or(usize::MAX), name.clone()));
    names
}

/// Latencies of a histogram; nothing for one that counts nothing.
fn spread(counts: &[u64]) -> Value {
    if counts.iter().sum::<u64>() == 0 { Value::Null } else { latency(counts) }
}

fn station_row(arm: &Arm, arms: &[Arm]) -> Value {
    let total = |total: Total| arm.windows.iter().map(|window| window.ledger[total as usize]).sum::<u64>();
    let most = |figure: fn(&super::probe::Window) -> f64| arm.windows.iter().map(figure).fold(0.0, f64::max);
    let mut row = json!({
        "arm": arm.name(),
        "workers": arm.workers,
        "name": "station",
        "windows": arm.windows.len(),
        "failures": arm.failures,
        "rss_mib": most(|window| window.resident_mib),
        "pss_mib": most(|window| window.proportional_mib),
        "device": {
            "ticks": total(Total::Ticks), "fresh": total(Total::Fresh), "held": total(Total::Held),
            "ramped": total(Total::Ramped), "zero": total(Total::Zero), "voided": total(Total::Void),
        },
        "main_loop_us": arm.windows.iter().map(step_us).collect::<Vec<_>>(),
    });
    if let Some(threads) = arms.iter().find(|other| other.kind != arm.kind && other.workers == arm.workers) {
        let found = match arm.kind {
            super::arm::Kind::Processes => ratios(arm, threads),
            super::arm::Kind::Threads => return row,
        };
        row["main_loop_process_over_thread"] = json!(found);
    }
    row
}

fn process_row(arm: &Arm, name: &str) -> Value {
    let spells: Vec<&Spell> = arm.windows.iter().filter_map(|window| window.spells.get(name)).collect();
    let sum = |figure: fn(&Spell) -> u64| spells.iter().map(|spell| figure(spell)).sum::<u64>();
    let (mut wakeup, mut looping) = (Vec::new(), Vec::new());
    for spell in &spells {
        add(&mut wakeup, &spell.wakeup);
        add(&mut looping, &spell.looping);
    }
    let rates_hz = figures(arm, name, Spell::rate_hz);
    let processor = figures(arm, name, |spell| spell.processor_s.map(|time_s| 100.0 * time_s / spell.seconds));
    let mut row = json!({
        "arm": arm.name(),
        "workers": arm.workers,
        "name": name,
        "rate_hz": median(rates_hz.clone()),
        "rate_hz_least": rates_hz.into_iter().reduce(f64::min),
        "cpu_percent": median(processor),
        "wakeup_us": spread(&wakeup),
        "loop_us": spread(&looping),
        "rss_mib": figures(arm, name, |spell| spell.resident_mib).into_iter().reduce(f64::max),
        "real_time": spells.iter().all(|spell| spell.real_time),
        "steps": sum(|spell| spell.steps.unwrap_or(0)),
        "overruns": sum(|spell| spell.overruns),
        "substitutes": sum(|spell| spell.substitutes),
        "promotions": sum(|spell| spell.promotions),
        "allocations": sum(|spell| spell.allocations),
        "shares_missing": sum(|spell| spell.shares_missing),
    });
    if let Some(picture) = spells.last().and_then(|spell| spell.picture) {
        row["frame_ms"] = json!(picture.frame_ms);
        row["scale"] = json!(picture.scale);
        row["size_px"] = json!(picture.size_px);
        row["period_ticks"] = json!(picture.period_ticks[0]);
        let mut motion = Vec::new();
        spells.iter().for_each(|spell| add(&mut motion, &spell.motion));
        row["motion_us"] = spread(&motion);
        row["pictures_back_s"] = json!(arm.windows.iter().map(|window| window.pictures_back_s).collect::<Vec<_>>());
        row["least_period_ticks"] = json!(picture.period_ticks[1]);
        row["passes_ms"] =
            PICTURE_PASSES.into_iter().zip(picture.passes_ms).map(|(name, ms)| (name.to_string(), json!(ms))).collect();
    }
    row
}

/// The last picture of an arm and what its passes took, in words; nothing where none was drawn.
fn picture(row: &Value) -> Option<String> {
    let (size_px, passes_ms) = (row["size_px"].as_array()?, row["passes_ms"].as_object()?);
    let number = |value: &Value| value.as_f64().unwrap_or(0.0);
    let of_pass = |name: &&str| format!("{name} {:.2}", passes_ms.get(*name).map_or(0.0, number));
    let passes: Vec<String> = PICTURE_PASSES.iter().map(of_pass).collect();
    Some(format!(
        "{}: a picture of {}x{} px, drawn at {:.3} of that, every {} ms (at best {}), took {:.1} ms: {}\n",
        row["arm"].as_str().unwrap_or_default(),
        size_px.first()?,
        size_px.get(1)?,
        number(&row["scale"]),
        row["period_ticks"],
        row["least_period_ticks"],
        number(&row["frame_ms"]),
        passes.join(", ")
    ))
}

/// The same for people.
pub fn table(arms: &[Arm], bare: &Bare, targets: &[Target]) -> String {
    let number = |value: &Value| value.as_f64().map_or("-".to_string(), |value| format!("{value:.1}"));
    let mut text = format!(
        "{:<20} {:<20} {:>8} {:>6} | {:>8} {:>8} {:>8} {:>8} | {:>8} {:>8} {:>8} {:>8} | {:>7}\n",
        "arm",
        "process",
        "rate/Hz",
        "cpu/%",
        "wake p50",
        "p99",
        "p99.9",
        "max/us",
        "loop p50",
        "p99",
        "p99.9",
        "max/us",
        "rss/MiB"
    );
    let rows = all(arms, bare, &[]);
    for row in &rows {
        let _ = write!(text, "{:<20} {:<20}", row["arm"].as_str().unwrap_or("-"), row["name"].as_str().unwrap_or("-"));
        let _ = write!(text, " {:>8} {:>6}", number(&row["rate_hz"]), number(&row["cpu_percent"]));
        for latency in [&row["wakeup_us"], &row["loop_us"]] {
            let _ = write!(text, " |");
            for key in ["p50", "p99", "p999", "max"] {
                let _ = write!(text, " {:>8}", number(&latency[key]));
            }
        }
        let _ = writeln!(text, " | {:>7}", number(&row["rss_mib"]));
    }
    text.extend(rows.iter().filter_map(picture));
    for target in targets {
        let _ = writeln!(text, "{target}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::arm::Kind;
    use super::super::probe::Window;
    use super::*;
    use hyst_messages::RenderingStatus;

    #[test]
    fn what_each_pass_of_the_last_picture_took_is_printed_and_nothing_of_who_drew_none() {
        let window = |last: Option<RenderingStatus>| Window {
            spells: [("rendering".to_string(), Spell { picture: last, ..Spell::default() })].into(),
            ..Window::default()
        };
        let said = |windows: Vec<Window>| picture(&process_row(&Arm { windows, ..Arm::new(Kind::Processes, 2) }, "rendering"));
        let drawn = RenderingStatus {
            frame_ms: 14.2,
            scale: 0.5,
            passes_ms: [0.25, 7.5, 0.0, 1.0, 4.0],
            size_px: [640, 480],
            period_ticks: [33, 16],
            ..RenderingStatus::default()
        };
        let text = said(vec![window(None), window(Some(drawn))]).expect("there is a picture");
        let of_picture = "a picture of 640x480 px, drawn at 0.500 of that, every 33 ms (at best 16), took 14.2 ms: ";
        let of_passes = "normals 0.25, scene 7.50, focus 0.00, glow 1.00, finish 4.00\n";
        assert!(text.ends_with(&format!("{of_picture}{of_passes}")), "{text}");
        assert_eq!(said(vec![window(None)]), None);
    }
}
