//! `hystation check`, and the check that `run` makes before anything starts.

use crate::settings::Refusal;
use hyst_engine::Settings;
use std::path::Path;

/// Checks the scene of a run; gives its hash.
pub fn admit(settings: &Settings) -> Result<u64, Refusal> {
    if let Some(path) = &settings.scene
        && !path.is_file()
    {
        return Err(Refusal::input(format!("scene {}: no such file; give a scene (.toml) or a mesh", path.display())));
    }
    Ok(0)
}

/// Prints what was found in a scene or mesh and what will be done about it.
pub fn check(_file: Option<&Path>, _json: bool) -> Result<u8, Refusal> {
    super::not_here("check")
}
