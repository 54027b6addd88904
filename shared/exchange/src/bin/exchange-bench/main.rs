//! The exchange primitives beside the bare means that they are made of, measured in one run.
//!
//! `exchange-bench [--json]` founds a station of its own, ends within 50 s and leaves nothing behind; exit code 1 if a ratio is above its limit.
//! With other arguments the same binary plays a partner process. Both sides of a comparison run in turns, block by block, so that a drift of the machine cancels.

mod calls;
mod crews;
mod measure;
mod partner;
mod stream;
mod waits;

use measure::{Budget, Row};
use std::process::ExitCode;

/// Why a benchmark cannot be made or finished.
pub type Failure = Box<dyn std::error::Error + Send + Sync>;

/// All measurements together, s; the promise is 50.
const BUDGET_S: u64 = 40;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let outcome = match arguments.as_slice() {
        [] => bench(false),
        ["--json"] => bench(true),
        ["partner", role, rest @ ..] => partner::play(role, rest).map(|()| true),
        _ => {
            eprintln!("exchange-bench: usage: exchange-bench [--json]");
            return ExitCode::from(2);
        }
    };
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("exchange-bench: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Measures and prints; whether every limit is held.
fn bench(json: bool) -> Result<bool, Failure> {
    let site = partner::Site::found()?;
    let budget = Budget::seconds(BUDGET_S);
    let mut rows: Vec<Row> = Vec::new();
    let granted = waits::rows(&site, &budget, &mut rows)?;
    stream::rows(&site, &budget, &mut rows)?;
    calls::rows(&site, &budget, &mut rows)?;
    drop(site);
    let mut machine = hyst_exchange::machine::describe();
    machine["real_time"] = granted.into();
    if json {
        println!("{}", serde_json::json!({ "machine": machine, "rows": rows.iter().map(Row::json).collect::<Vec<_>>() }));
    } else {
        measure::print(&machine, &rows);
    }
    Ok(rows.iter().all(|row| row.is_held() != Some(false)))
}
