//! `bench station`: the whole station on the default scene, or on somebody's mesh, in three arms: with collision workers, without, and its
//! engines as threads of one process. The arms take turns in windows of one round of the scripted hand, so that what the host does falls on
//! all of them; figures are medians over windows, percentiles are over all windows of an arm. Between the rounds a bare loop shows what the
//! machine does by itself.
//!
//! Every target of the station is a row with its limit; the exit code is 1 if one of them is not held.

use super::arm::{Arm, Kind};
use super::bare::Bare;
use super::{rows, targets};
use crate::settings::Refusal;
use hyst_exchange::{machine, system};
use serde_json::{Value, json};
use std::path::Path;

/// No run begins that would end after this time, ns: a benchmark takes 50 s at most.
const BUDGET_NS: u64 = 49_000_000_000;
/// Rounds, if the budget allows them: from three on a median forgets one disturbed window.
const ROUNDS: usize = 3;
/// Collision workers of the arms that have them: the station's default.
const WORKERS: usize = 2;

/// Measures, prints, and says whether every target is held.
pub fn station(mesh: Option<&Path>, json: bool) -> Result<u8, Refusal> {
    let load_average = load_average();
    let mut bare = Bare::default();
    let mut arms =
        [Arm::new(Kind::Processes, WORKERS).killing_rendering(), Arm::new(Kind::Threads, WORKERS), Arm::new(Kind::Processes, 0)];
    take_turns(&mut arms, &mut bare, mesh)?;
    let targets = targets::judge(&arms, mesh.is_none());
    let mut described = machine::describe();
    described["load_average"] = load_average;
    let rows = rows::all(&arms, &bare, &targets);
    if json {
        println!("{:#}", json!({ "machine": described, "rows": rows }));
    } else {
        print!("{described}\n{}", rows::table(&arms, &bare, &targets));
    }
    let broken = targets.iter().any(|target| target.held == Some(false)) || arms.iter().any(|arm| !arm.failures.is_empty());
    Ok(u8::from(broken))
}

/// Load before the benchmark: what else the machine does.
fn load_average() -> Value {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    json!(text.split_whitespace().next().and_then(|first| first.parse::<f64>().ok()))
}

/// Runs the arms in turns, forwards and backwards, so that the first two are always neighbours in time. Every arm runs once, whatever it takes.
fn take_turns(arms: &mut [Arm; 3], bare: &mut Bare, mesh: Option<&Path>) -> Result<(), Refusal> {
    let begun_ns = system::now_ns();
    let mut longest_ns = 0;
    bare.measure();
    for round in 0..ROUNDS {
        for turn in 0..arms.len() {
            let arm = &mut arms[if round % 2 == 0 { turn } else { 2 - turn }];
            let now_ns = system::now_ns();
            if round > 0 && now_ns + longest_ns > begun_ns + BUDGET_NS {
                return Ok(());
            }
            arm.run(mesh)?;
            longest_ns = longest_ns.max(system::now_ns() - now_ns);
        }
        if system::now_ns() + longest_ns < begun_ns + BUDGET_NS {
            bare.measure();
        }
    }
    Ok(())
}
