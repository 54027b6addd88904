//! A swap as it is written down: what is asked for, how far it is, what happened when, how it ended. One file in the station's root, replaced as a whole,
//! so that a supervisor that dies in the middle leaves what its successor needs, and whoever asked can read how it goes.

mod beside;
mod feel;
mod inspect;
pub mod judge;
mod lives;
mod pictures;
mod stated;
mod visit;
mod witness;
mod written;

pub use feel::feel;
pub use inspect::inspect;
pub use stated::{SERVO_FORCE_N, stated};
pub use visit::visit;
pub use witness::witness;

pub use hyst_engine::{kept, verify};

use crate::policy::Cause;
use hyst_exchange::{Station, system, whole};
use hyst_messages::page::device;
use hyst_messages::{Role, Slot};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The step of a newcomer that works in the place of an old engine.
pub const IN_PLACE: &str = "ready, and on probation in the old engine's place";
/// That of a servo which is followed from now on, and of who is to take a role with a state.
pub const AGREES: &str = "agrees with the old engine, and may take the role";
/// That of who has taken it.
pub const HAS_THE_ROLE: &str = "has the role, on probation; the old engine keeps its own state";
/// The last of a swap that was not undone.
pub const DONE: &str = "done: every process of the role runs it";

/// What the supervisor says of a step of a swap.
pub fn line_of_step(number: u64, role: &str, step: &str) -> String {
    format!("swap {number} of {role}: {step}")
}

/// The role of which such a line says that a newcomer does its work; `None` of any other line.
pub fn taken_over(line: &str) -> Option<Role> {
    let (role, step) = line.strip_prefix("swap ")?.split_once(" of ")?.1.split_once(": ")?;
    let role = Role::from_name(role)?;
    let does_its_work = match step {
        AGREES => !role.is_stateful(), // of a role with a state it says so itself
        step => [IN_PLACE, HAS_THE_ROLE, DONE].contains(&step),
    };
    does_its_work.then_some(role)
}

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Step {
    /// Time since the swap was asked for, ms.
    pub at_ms: f64,
    /// What.
    pub what: String,
}

/// A swap.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Counts the station's swaps.
    pub number: u64,
    /// The role.
    pub role: String,
    /// Where the newcomer starts.
    pub slot: String,
    /// The newcomer's binary: the station's own copy, if it could have one.
    pub binary: PathBuf,
    /// The binary before.
    pub before: PathBuf,
    /// The newcomer, 0 until it is ready.
    pub incarnation: u32,
    /// Who did the role's work before.
    pub incumbent: u32,
    /// The probation was passed: the binary is the role's.
    pub proven: bool,
    /// How it ended; `None` while it goes on.
    pub promoted: Option<bool>,
    /// Why it was undone.
    pub cause: Option<Cause>,
    /// In words.
    pub reason: String,
    /// When it was asked for, ns.
    pub begun_ns: u64,
    /// What happened.
    pub steps: Vec<Step>,
}

impl Record {
    /// The station's newest swap.
    pub fn read(station: &Station) -> Option<Record> {
        serde_json::from_str(&std::fs::read_to_string(station.swap()).ok()?).ok()
    }
    /// The swap of a role that is under way.
    pub fn under_way(station: &Station, role: Role) -> Option<Record> {
        Record::read(station).filter(|record| record.role == role.name() && record.promoted.is_none())
    }
    /// Writes it; false if that is refused.
    pub fn write(&self, station: &Station) -> bool {
        let text = serde_json::to_string(self).unwrap_or_default();
        whole::write(&station.swap(), text.as_bytes()).is_ok()
    }
    /// Notes what happened.
    pub fn note(&mut self, what: &str) {
        // Tenths of a millisecond.
        let at_ms = (system::now_ns().saturating_sub(self.begun_ns) / 100_000) as f64 / 10.0;
        self.steps.push(Step { at_ms, what: what.to_string() });
    }
    /// Where the newcomer starts.
    pub fn slot(&self) -> Option<Slot> {
        Slot::parse(&self.slot)
    }
}

/// The role that a name means, if its engines can be swapped; else what is wrong.
pub fn role_of(name: &str) -> Result<Role, String> {
    let names = || Role::ALL.into_iter().filter(|role| role.is_engine()).map(Role::name).collect::<Vec<_>>().join(", ");
    match Role::from_name(name) {
        Some(role) if role.is_engine() => Ok(role),
        Some(Role::Hardware) => {
            Err("hardware stands for the device on the desk, which keeps the ledger: it is no engine, and is not swapped".into())
        }
        Some(role) => Err(format!("{} is no engine; the engines are: {}", role.name(), names())),
        None => Err(format!("{name:?} is no role; the engines are: {}", names())),
    }
}

/// The slot in which a swap of a role begins: the guest's, or that of the servo which the device does not follow, or the first.
pub fn first_slot(role: Role, device: Option<&hyst_exchange::ReadPage>) -> Slot {
    if let Some(guest) = Slot::guest(role) {
        return guest;
    }
    let followed = device.map(|page| page.load64(device::SELECTED) as usize);
    let other = (0..role.slots().1).filter_map(|index| Slot::new(role, index)).find(|slot| Some(slot.number()) != followed);
    if role == Role::Haptic { other.unwrap_or(Slot::first(role)) } else { Slot::first(role) }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// One of a fluid.
    pub(crate) fn record() -> Record {
        Record {
            number: 1,
            role: "fluid".into(),
            slot: "fluid:2".into(),
            binary: "/x/fluid".into(),
            before: "/y/fluid".into(),
            incarnation: 17,
            incumbent: 6,
            proven: false,
            promoted: None,
            cause: None,
            reason: String::new(),
            begun_ns: 0,
            steps: Vec::new(),
        }
    }

    #[test]
    fn a_record_is_read_back_and_a_name_means_an_engine_or_is_refused() {
        let station = Station::named(&format!("t{}-swap", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        assert_eq!(Record::read(&station), None);
        let mut record = Record { number: 3, begun_ns: system::now_ns(), ..record() };
        record.note("ready");
        (record.cause, record.reason) = (Some(Cause::NoTime), "it had none".into());
        assert!(record.write(&station));
        assert_eq!(Record::read(&station), Some(record.clone()));
        assert_eq!(Record::under_way(&station, Role::Fluid), Some(record.clone()));
        assert_eq!(Record::under_way(&station, Role::Tissue), None);
        record.promoted = Some(false);
        assert!(record.write(&station) && Record::under_way(&station, Role::Fluid).is_none(), "it is over");
        assert_eq!(record.slot(), Slot::guest(Role::Fluid));
        station.wipe();
        for name in ["device", "haptic", "tissue", "fluid", "rendering", "recorder", "collision-worker", "console"] {
            assert_eq!(role_of(name).map(Role::name), Ok(name));
        }
        for name in ["hardware", "supervisor", "guardian", "", "fluid:0", "Fluid"] {
            assert!(role_of(name).is_err(), "{name}");
        }
        assert_eq!(first_slot(Role::Tissue, None).to_string(), "tissue:2");
        assert_eq!(first_slot(Role::Rendering, None), Slot::first(Role::Rendering));
    }
}
