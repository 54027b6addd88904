//! The limits that a station began with. A process inherits those of who starts it: one that was born while its keeper's were lowered, by a fault that was
//! injected there, would keep that shortage for its whole life, long after the fault.

use hyst_exchange::Station;
use rustix::process::{Resource, Rlimit, getrlimit, prlimit};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Soft limits of a process; `None` is no limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Limits {
    /// Open files.
    files: Option<u64>,
    /// Address space, bytes.
    memory: Option<u64>,
}

impl Limits {
    /// Those of this process.
    pub fn own() -> Limits {
        Limits { files: getrlimit(Resource::Nofile).current, memory: getrlimit(Resource::As).current }
    }

    /// The file in which they are kept.
    pub fn path(station: &Station) -> PathBuf {
        station.root().join("limits.json")
    }

    /// Those that a station began with; `None` if it was founded by an older build, or they cannot be read now.
    pub fn of(station: &Station) -> Option<Limits> {
        serde_json::from_str(&std::fs::read_to_string(Limits::path(station)).ok()?).ok()
    }

    /// As they are kept.
    pub fn text(&self) -> String {
        serde_json::to_string(self).unwrap_or_default() // two numbers always serialize
    }

    /// Gives them to a process that this one has just started, whatever its own are by now. One that has died since needs none.
    pub fn give(self, process: u32) {
        let Some(pid) = crate::proc::pid(process) else { return };
        for (resource, current) in [(Resource::Nofile, self.files), (Resource::As, self.memory)] {
            let _ = prlimit(Some(pid), resource, Rlimit { current, maximum: getrlimit(resource).maximum }); // refused, it has this one's
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faultfile::FaultKind;
    use crate::faults::tests::book;
    use crate::shortage;

    fn said(process: &str) -> Vec<String> {
        let text = std::fs::read_to_string(format!("/proc/{process}/limits")).unwrap();
        let is_one = |line: &&str| line.starts_with("Max open files") || line.starts_with("Max address space");
        text.lines().filter(is_one).map(str::to_string).collect()
    }

    #[test]
    fn who_was_born_with_lowered_limits_is_given_those_of_the_beginning() {
        let mut child = std::process::Command::new("sleep").arg("600").spawn().unwrap();
        let begun = said("self");
        for kind in [FaultKind::NoFiles, FaultKind::Oom] {
            shortage::lower(child.id(), kind).unwrap();
        }
        let lowered = said(&child.id().to_string());
        assert!(
            lowered.len() == 2 && lowered.iter().zip(&begun).all(|(lowered, begun)| lowered != begun),
            "{lowered:?} {begun:?}"
        );
        Limits::own().give(child.id());
        assert_eq!(said(&child.id().to_string()), begun);
        child.kill().unwrap();
        child.wait().unwrap();
        Limits::own().give(child.id()); // nobody is there
    }

    #[test]
    fn a_station_keeps_those_that_it_began_with() {
        let (station, _faults) = book("limits");
        assert_eq!(Limits::of(&station), None);
        let begun = Limits { files: Some(77), memory: None };
        std::fs::write(Limits::path(&station), begun.text()).unwrap();
        assert_eq!(Limits::of(&station), Some(begun));
    }
}
