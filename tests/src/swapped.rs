//! Swaps, as an operator asks for them.

use crate::{RECOVERY_LIMIT, Station, hystation, run, wait_for};
use serde_json::Value;
use std::path::Path;

/// Swaps; gives the exit code, and the record of what happened or what was said.
pub fn swap(station: &Station, role: &str, binary: &Path) -> (Option<i32>, Value, String) {
    let try_it = || {
        let (code, out, said) = run(hystation().args(["--name", station.name(), "swap", role, "--json"]).arg(binary));
        // On a busy machine a process is replaced now and then for another reason; nobody swaps while one of the role is missing.
        let again = code == Some(2) && said.contains("is not ready now");
        (!again).then(|| (code, serde_json::from_str(&out).unwrap_or(Value::Null), said))
    };
    wait_for(RECOVERY_LIMIT, try_it).unwrap_or_else(|| panic!("{role} does not become whole: {}", station.status()))
}

/// Whether a newcomer was rolled back because the machine left it no time to show what it is.
pub fn got_no_time(record: &Value) -> bool {
    record["cause"] == "no-time"
}
