//! The station's own copy of its scene's files: an engine that is restarted finds them as they were, whoever edits, moves or unmounts what was named. A scene
//! that cannot be copied is run from where it is, which is said.

use crate::case::{RunCase, with_scene};
use hyst_engine::Settings;
use hyst_exchange::Station;
use hyst_scene::SourceFile;
use std::path::Path;

/// Most bytes that are copied into shared memory.
const MOST_BYTES: usize = 64 << 20;

/// What is to be copied.
pub struct Copied {
    files: Vec<SourceFile>,
    /// The case that is drawn in the scene.
    case: Option<String>,
}

impl Copied {
    /// The files of what a station is to run; none of a scene in the binary.
    pub fn of(settings: &Settings, case: Option<&RunCase>) -> Copied {
        let named = case.map(|case| case.beside.as_path()).or(settings.scene.as_deref());
        let files = named.map_or_else(|| Ok(Vec::new()), gather).unwrap_or_else(|why| {
            say(&why);
            Vec::new()
        });
        Copied { files, case: case.map(|case| case.settled.text.clone()) }
    }

    /// How much memory it takes.
    pub fn bytes(&self) -> u64 {
        self.files.iter().map(|file| file.bytes.len() as u64).sum()
    }

    /// Lays it down in a station's root, if it is the scene that was admitted.
    pub fn lay(&self, station: &Station, hash: u64) {
        if self.files.is_empty() {
            return;
        }
        if let Err(why) = self.try_to_lay(station, hash) {
            say(&why);
            let _ = std::fs::remove_dir_all(station.scene()); // it may not have come about
        }
    }

    fn try_to_lay(&self, station: &Station, hash: u64) -> Result<(), String> {
        let system = |error: std::io::Error| error.to_string();
        let scene = hyst_scene::unpack(&self.files, &station.scene()).map_err(system)?;
        let entry = match &self.case {
            Some(text) => {
                let text = with_scene(text, &scene).ok_or("its case cannot be written again")?;
                std::fs::write(station.scene_case(), text).map_err(system)?;
                station.scene_case()
            }
            None => scene,
        };
        let copy = hyst_scene::load(&entry).map_err(|error| error.to_string())?;
        if copy.hash != hash {
            return Err("it was edited this moment".into());
        }
        let path = entry.to_str().ok_or("its path is no text")?;
        std::fs::write(station.scene_entry(), path).map_err(system)
    }
}

fn gather(named: &Path) -> Result<Vec<SourceFile>, String> {
    let files = hyst_scene::sources(Some(named)).map_err(|error| error.to_string())?;
    let bytes: usize = files.iter().map(|file| file.bytes.len()).sum();
    if bytes > MOST_BYTES {
        return Err(format!("it has {} MiB, at most {} are copied", bytes >> 20, MOST_BYTES >> 20));
    }
    Ok(files)
}

fn say(why: &str) {
    eprintln!("hystation: the station has no copy of its scene, and needs the files as they are: {why}");
}
