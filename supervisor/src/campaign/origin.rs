//! Where the results of a station come from: which programs, on which machine, on which day. Those of two builds are never mixed.

use super::file::Campaign;
use super::station::StationOutcome;
use crate::build;
use crate::settings::{Refusal, own_folder};
use hyst_exchange::machine;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::path::Path;

/// What ran a station.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    /// Version of this program.
    pub version: String,
    /// Hash of the programs that are run: this one, and the engines of every arm.
    pub build: String,
    /// Processor.
    pub cpu: String,
    /// Cores.
    pub cores: u64,
    /// Release of the kernel.
    pub kernel: String,
    /// Day on which the station was started (UTC).
    pub date: String,
}

impl Origin {
    /// What a station that is started now is run by.
    pub fn here(campaign: &Campaign) -> Result<Origin, Refusal> {
        let own = own_folder()?;
        let folders: BTreeSet<&Path> = campaign.arms.iter().map(|arm| campaign.binaries(arm).unwrap_or(&own)).collect();
        let build = build::of(&folders)?;
        let machine = machine::describe();
        let word = |key: &str| machine[key].as_str().unwrap_or_default().to_string();
        Ok(Origin {
            version: env!("CARGO_PKG_VERSION").into(),
            build,
            cpu: word("cpu"),
            cores: machine["cores"].as_u64().unwrap_or(0),
            kernel: word("kernel"),
            date: word("date"),
        })
    }

    /// Whether both are of the same programs.
    pub fn is_same_build(&self, other: &Origin) -> bool {
        (&self.version, &self.build) == (&other.version, &other.build)
    }
}

/// Stations that were run by one build on one machine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Batch {
    /// By what, with the first day; `None` of those whose line does not say it.
    pub origin: Option<Origin>,
    /// Last day.
    pub last_date: String,
    /// How many.
    pub stations: usize,
}

impl Batch {
    fn has(&self, origin: Option<&Origin>) -> bool {
        let key = |origin: &Origin| Origin { date: String::new(), ..origin.clone() };
        self.origin.as_ref().map(key) == origin.map(key)
    }

    /// One line for people.
    pub fn words(&self) -> String {
        let Some(origin) = &self.origin else { return format!("runs of a build that nobody noted: {}", self.stations) };
        let Origin { version, build, cpu, cores, kernel, date } = origin;
        let days = if *date == self.last_date { date.clone() } else { format!("{date} to {}", self.last_date) };
        format!("runs of build {version} {build}, {days}, on {cpu}, {cores} cores, Linux {kernel}: {}", self.stations)
    }
}

/// By what all stations were run, in the order in which they were.
pub fn batches(stations: &[StationOutcome]) -> Vec<Batch> {
    let mut batches: Vec<Batch> = Vec::new();
    for station in stations {
        let origin = station.origin.as_ref();
        let last_date = origin.map_or(String::new(), |origin| origin.date.clone());
        match batches.iter_mut().find(|batch| batch.has(origin)) {
            Some(batch) => (batch.last_date, batch.stations) = (last_date, batch.stations + 1),
            None => batches.push(Batch { origin: origin.cloned(), last_date, stations: 1 }),
        }
    }
    batches
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_names_each_build_and_machine_once_with_its_days() {
        let of = |build: &str, date: &str| StationOutcome {
            origin: Some(Origin {
                version: "1.2.3".into(),
                build: build.into(),
                kernel: "6.1".into(),
                date: date.into(),
                ..Origin::default()
            }),
            ..StationOutcome::default()
        };
        let old = StationOutcome::default();
        let all = batches(&[old, of("f00", "2026-11-24"), of("f00", "2026-11-25"), of("bad", "2026-11-25")]);
        let words: Vec<String> = all.iter().map(Batch::words).collect();
        assert_eq!(words[0], "runs of a build that nobody noted: 1");
        assert!(
            words[1].starts_with("runs of build 1.2.3 f00, 2026-11-24 to 2026-11-25, on ") && words[1].ends_with(": 2"),
            "{words:?}"
        );
        assert!(words[2].starts_with("runs of build 1.2.3 bad, 2026-11-25, on ") && words.len() == 3, "{words:?}");
    }
}
