//! How a station has ended: what of it is left, and the exit code.

use crate::plan::Plan;
use crate::{remains, report};
use hyst_exchange::Station;

/// What of a station is still there.
pub(super) fn count_leftovers(station: &Station) -> serde_json::Value {
    let left = station.leftovers();
    let files = left.iter().filter(|path| *path == station.root()).count();
    serde_json::json!({ "processes": remains::living(station).len(), "shared_memory": left.len() - files, "files": files })
}

/// The exit code.
pub(super) fn judge(report: &serde_json::Value, left: &serde_json::Value, plan: &Plan, is_data_lost: bool) -> u8 {
    let any_left = ["processes", "shared_memory", "files"].iter().any(|key| left[key].as_u64() != Some(0));
    let unreported = !plan.slots.is_empty() && report.get("processes").is_none();
    match () {
        () if any_left || unreported || report::is_broken(report) => 1,
        () if is_data_lost || report::has_lost(report) => 3,
        () => 0,
    }
}
