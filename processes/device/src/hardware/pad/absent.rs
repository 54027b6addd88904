//! What stands for a pad in a build without cargo's feature `pads`: there is none, and whoever asks for one is told why.

use super::Source;
use super::make::{Event, Make, Ranges};
use std::io;
use std::path::PathBuf;

/// None can be.
pub enum Absent {}

impl Source for Absent {
    fn ranges(&self) -> Ranges {
        match *self {}
    }

    fn next(&mut self, _until_ns: Option<u64>) -> io::Result<Vec<Event>> {
        match *self {}
    }
}

/// Refuses whatever `--hand` names.
pub fn find(make: Make, _path: Option<&PathBuf>) -> Result<Absent, String> {
    let name = make.name();
    Err(format!("--hand {name}: this `hardware` was built without cargo's feature `pads`, which reads gamepads and 3D mice"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_build_without_pads_names_the_feature_that_it_lacks() {
        for make in [Make::Gamepad, Make::SpaceMouse] {
            let said = find(make, None).map(|_| ()).unwrap_err();
            assert!(said.starts_with(&format!("--hand {}: ", make.name())) && said.contains("`pads`"), "{said}");
        }
    }
}
