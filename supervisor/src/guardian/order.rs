//! What the guardian was asked for, in a file in the station's root, so that whoever takes its place goes on with it.

use hyst_exchange::{Station, whole};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Order {
    /// Where the report goes, absolute.
    pub report: Option<PathBuf>,
    /// How long the station runs once it is ready, s.
    pub for_s: Option<f64>,
    /// The station ends with the session of its case.
    #[serde(default)]
    pub until_end: bool,
    /// Of its recording the folder was named: the file was made with the station, and goes with it if no recorder comes to it.
    #[serde(default)]
    pub in_folder: bool,
    /// When it was ready, CLOCK_MONOTONIC ns.
    pub ready_ns: Option<u64>,
    /// The guardian stands in for one that died, and makes room for a `run` of the same name and settings.
    pub stand_in: bool,
}

impl Order {
    fn path(station: &Station) -> PathBuf {
        station.root().join("order.json")
    }
    /// The order of a station, if it can be read.
    pub fn read(station: &Station) -> Option<Order> {
        serde_json::from_str(&std::fs::read_to_string(Order::path(station)).ok()?).ok()
    }
    /// Keeps the order.
    pub fn write(&self, station: &Station) {
        if let Ok(text) = serde_json::to_string(self) {
            let _ = whole::write(&Order::path(station), text.as_bytes()); // a stand-in then knows no report and no end
        }
    }
}
