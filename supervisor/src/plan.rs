//! What a run consists of: its slots, in the order in which they start, and what the guardian hands to the supervisor, in a file in
//! the station's root, so that a supervisor that was restarted knows the same.

use hyst_engine::Settings;
use hyst_exchange::{Station, whole};
use hyst_messages::{MAX_WORKERS, Role, Slot};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// What the supervisor is started for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Folder of the engines' binaries.
    pub binaries: PathBuf,
    /// Slots, in the order of their start.
    pub slots: Vec<String>,
    /// Roles whose engines were swapped, each with its present binary.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub swapped: BTreeMap<String, PathBuf>,
    /// Bytes of the nodes and the surface in a state of the tissue, by which its processes take their room.
    #[serde(default)]
    pub state_bytes: u64,
    /// In lock-step: the tick at which the run ends.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end_tick: Option<u64>,
    /// Faults to inject.
    pub faults: Vec<crate::faultfile::Injection>,
}

/// A plan that cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// The file.
    #[error("{path}: {source}; the station's root is damaged, stop it and start again")]
    File {
        /// Which.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Its content.
    #[error("{path}: {reason}; the station's root is damaged, stop it and start again")]
    Content {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

/// The slots of a station: hardware and device first, since everything else waits for their input.
pub fn slots(settings: &Settings, spares: bool, only: Option<&[Role]>) -> Vec<Slot> {
    let count = |role: Role| match role {
        Role::Hardware | Role::Device | Role::Rendering => 1,
        Role::Haptic | Role::Tissue | Role::Fluid => 1 + usize::from(spares),
        Role::CollisionWorker => settings.workers.min(MAX_WORKERS),
        Role::Recorder => usize::from(settings.record.is_some()),
        // A value that is neither is refused before a plan is made.
        Role::Console => usize::from(settings.switch("console", true).unwrap_or(true)),
        Role::Supervisor | Role::Guardian => 0,
    };
    Role::ALL
        .into_iter()
        .filter(|role| only.is_none_or(|only| only.contains(role)))
        .flat_map(|role| (0..count(role)).filter_map(move |index| Slot::new(role, index)))
        .collect()
}

/// The roles that have a program of their own in a folder of engines: all but the keepers, which are this program.
pub fn engines() -> impl Iterator<Item = Role> {
    Role::ALL.into_iter().filter(|role| !matches!(role, Role::Supervisor | Role::Guardian))
}

impl Plan {
    /// The slots that have a name here; an unknown name is left out.
    pub fn slots(&self) -> Vec<Slot> {
        self.slots.iter().filter_map(|name| Slot::parse(name)).collect()
    }
    /// The binary of a role.
    pub fn binary(&self, role: Role) -> PathBuf {
        self.swapped.get(role.name()).cloned().unwrap_or_else(|| self.binaries.join(role.name()))
    }
    /// Binaries that are not there.
    pub fn missing(&self) -> Vec<PathBuf> {
        let mut missing: Vec<PathBuf> =
            self.slots().into_iter().map(|slot| self.binary(slot.role())).filter(|path| !path.is_file()).collect();
        missing.dedup();
        missing
    }
    /// Writes the plan into the station's root.
    pub fn write(&self, station: &Station) -> Result<(), PlanError> {
        let path = station.plan();
        let text = toml::to_string(self).map_err(|e| PlanError::Content { path: path.clone(), reason: e.to_string() })?;
        whole::write(&path, text.as_bytes()).map_err(|source| PlanError::File { path, source })
    }
    /// Reads the plan from the station's root.
    pub fn read(station: &Station) -> Result<Plan, PlanError> {
        let path = station.plan();
        let text = std::fs::read_to_string(&path).map_err(|source| PlanError::File { path: path.clone(), source })?;
        toml::from_str(&text).map_err(|e| PlanError::Content { path, reason: e.to_string() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(slots: &[Slot]) -> Vec<String> {
        slots.iter().map(Slot::to_string).collect()
    }

    #[test]
    fn the_default_station_has_two_servos_spares_and_workers_and_starts_at_the_hardware() {
        let settings = Settings { workers: 2, ..Default::default() };
        let expected = "hardware device haptic:0 haptic:1 tissue:0 tissue:1 fluid:0 fluid:1 rendering console collision-worker:0 collision-worker:1";
        assert_eq!(names(&slots(&settings, true, None)).join(" "), expected);
        let set = [("console".to_string(), "off".to_string())].into();
        let small = Settings { workers: 0, record: Some("/x".into()), set, ..Default::default() };
        let expected = "hardware device haptic:0 tissue:0 fluid:0 rendering recorder";
        assert_eq!(names(&slots(&small, false, None)).join(" "), expected);
        assert_eq!(names(&slots(&small, true, Some(&[Role::Tissue]))), ["tissue:0", "tissue:1"]);
    }

    #[test]
    fn the_engines_are_those_of_a_station_that_records_and_has_its_page() {
        let settings = Settings { record: Some("/x".into()), ..Default::default() };
        let mut roles: Vec<Role> = slots(&settings, true, None).into_iter().map(|slot| slot.role()).collect();
        roles.dedup();
        assert_eq!(engines().collect::<Vec<Role>>(), roles);
    }
}
