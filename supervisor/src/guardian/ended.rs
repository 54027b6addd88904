//! How a station has ended: what of it is left, what its recording holds, and the exit code.

use super::order::Order;
use crate::plan::Plan;
use crate::recording::{self, RecordingView};
use crate::{remains, report};
use hyst_exchange::{OwnedPage, ReadPage, Station};
use hyst_messages::page::{header, station as layout};
use hyst_messages::{Role, Slot};
use std::path::PathBuf;

/// What of a station is still there.
pub(super) fn count_leftovers(station: &Station) -> serde_json::Value {
    let left = station.leftovers();
    let files = left.iter().filter(|path| *path == station.root()).count();
    serde_json::json!({ "processes": remains::living(station).len(), "shared_memory": left.len() - files, "files": files })
}

/// Whether a station has to have a report: one that was asked to stop before any supervisor had begun has nothing to report of.
pub(super) fn owes_report(page: &OwnedPage, plan: &Plan) -> bool {
    !plan.slots.is_empty() && page.load64(layout::SUPERVISOR_STARTS) > 0
}

/// The exit code: 1 if anything is left, or the report that it owes is not there, or if a fault of that broke a promise beyond doubt, 3 if something is lost.
pub(super) fn judge(report: &serde_json::Value, left: &serde_json::Value, owes_report: bool, is_data_lost: bool) -> u8 {
    let any_left = ["processes", "shared_memory", "files"].iter().any(|key| left[key].as_u64() != Some(0));
    let unreported = owes_report && report.get("processes").is_none();
    match () {
        () if any_left || unreported || report::is_broken(report) => 1,
        () if is_data_lost || report::has_lost(report) => 3,
        () => 0,
    }
}

/// The recording of a station that has ended. One whose recorder never came up holds nothing of what the device made without it.
pub(super) fn recorded(station: &Station, plan: &Plan) -> Option<RecordingView> {
    recording::at_end(station).or_else(|| {
        let is_recorded = plan.slots().iter().any(|slot| slot.role() == Role::Recorder);
        let file = recording::file_of(station).filter(|_| is_recorded)?;
        let device = page_of(station, Role::Device);
        let view = RecordingView::of(&file, None, recording::newest_tick(device.as_ref()));
        (view.behind_ticks > 0).then_some(view)
    })
}

/// Removes the file that was made for the recording of a station that has ended, if it is empty and no recorder has worked on it: a service that is tried again and
/// again would leave one each time. Gives the one that is gone.
pub(super) fn remove_unbegun(station: &Station, order: &Order) -> Option<PathBuf> {
    let file = recording::file_of(station).filter(|_| order.in_folder)?;
    let has_worked = page_of(station, Role::Recorder).is_some_and(|page| page.load64(header::STEPS) > 0);
    let is_empty = std::fs::symlink_metadata(&file).is_ok_and(|file| file.is_file() && file.len() == 0);
    (is_empty && !has_worked && std::fs::remove_file(&file).is_ok()).then_some(file)
}

/// The page of the last one that did a role's work.
fn page_of(station: &Station, role: Role) -> Option<ReadPage> {
    let slot = Slot::first(role);
    let incarnation = station.open().ok()?.incarnation(slot);
    station.read_slot(slot, incarnation).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_engine::Settings;

    fn nothing() -> serde_json::Value {
        serde_json::json!({ "processes": 0, "shared_memory": 0, "files": 0 })
    }

    #[test]
    fn a_broken_promise_is_a_failure_whatever_was_lost_beside_it() {
        let code = |broken: &[&str], given_up: &[&str]| {
            let report = serde_json::json!({ "processes": {}, "promises_broken": broken, "given_up": given_up });
            judge(&report, &nothing(), true, false)
        };
        assert_eq!([code(&[], &[]), code(&[], &["console"])], [0, 3]);
        let one = ["fault kill of device at tick 9000: the hand lost 30 ticks, 0 at most without a fault"];
        assert_eq!([code(&one, &[]), code(&one, &["console"])], [1, 1]);
    }

    /// A service that was stopped while it started had failed.
    #[test]
    fn one_that_is_stopped_before_any_supervisor_has_begun_owes_no_report_and_one_of_which_one_had_does() {
        let station = Station::named(&format!("t{}-owes", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let page = station.open_for_keeping().unwrap();
        let plan = Plan {
            binaries: PathBuf::new(),
            slots: vec!["device".into()],
            swapped: std::collections::BTreeMap::new(),
            state_bytes: 0,
            end_tick: None,
            faults: Vec::new(),
        };
        let code = || judge(&serde_json::json!({}), &nothing(), owes_report(&page, &plan), false);
        let before = code();
        page.fetch_add64(layout::SUPERVISOR_STARTS, 1);
        assert_eq!([before, code()], [0, 1]);
        station.wipe();
    }

    #[test]
    fn an_empty_file_goes_with_its_station_where_only_the_folder_was_named() {
        let station = Station::named(&format!("t{}-unbegun", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let file = std::env::temp_dir().join(format!("hystation-ended-{}.mcap", std::process::id()));
        let settings = Settings { record: Some(file.clone()), ..Settings::default() };
        std::fs::write(station.settings(), toml::to_string(&settings).unwrap()).unwrap();
        let [named, in_folder] = [false, true].map(|in_folder| Order { in_folder, ..Order::default() });
        std::fs::write(&file, "ticks").unwrap();
        assert_eq!(remove_unbegun(&station, &in_folder), None, "something is in it");
        std::fs::write(&file, "").unwrap();
        assert_eq!(remove_unbegun(&station, &named), None, "its user named it");
        assert_eq!(remove_unbegun(&station, &in_folder), Some(file.clone()));
        assert!(!file.exists());
        station.wipe();
    }
}
