//! The exchange primitives beside the bare means that they are made of, measured in one run.
//!
//! `exchange-bench [--json]` founds a station of its own, ends within 50 s and leaves nothing behind. With other arguments the same
//! binary plays a partner process. Both sides of a comparison run in turns, block by block, so that a drift of the machine cancels.

mod calls;
mod crews;
mod machine;
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
        ["partner", role, rest @ ..] => partner::play(role, rest),
        _ => Err("usage: exchange-bench [--json]".into()),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("exchange-bench: {error}");
            ExitCode::FAILURE
        }
    }
}

fn bench(json: bool) -> Result<(), Failure> {
    let site = partner::Site::found()?;
    let budget = Budget::seconds(BUDGET_S);
    let mut rows: Vec<Row> = Vec::new();
    let granted = waits::rows(&site, &budget, &mut rows)?;
    stream::rows(&site, &budget, &mut rows)?;
    calls::rows(&site, &budget, &mut rows)?;
    drop(site);
    let machine = machine::describe(granted);
    if json {
        println!("{}", serde_json::json!({ "machine": machine, "rows": rows.iter().map(Row::json).collect::<Vec<_>>() }));
    } else {
        measure::print(&machine, &rows);
    }
    Ok(())
}
