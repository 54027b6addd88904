//! The scene that a recording holds, on disk for as long as it is needed.

use crate::case::with_scene;
use hyst_recording::{SceneFile, Session, scene_files};
use hyst_scene::{LoadedScene, SourceFile, find_played_case};
use std::fs::DirBuilder;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

/// The files of a scene that were recorded.
pub struct RecordedScene {
    folder: PathBuf,
    /// The scene among them.
    path: PathBuf,
}

/// Why they are not laid down.
#[derive(Debug, thiserror::Error)]
pub enum Unlaid {
    /// The recording.
    #[error("{0}")]
    Unread(#[from] hyst_recording::ReadError),
    /// The system.
    #[error("{0}: {1}")]
    System(PathBuf, std::io::Error),
}

impl RecordedScene {
    /// Lays them down in a folder of this name, which is made anew for it and goes with what is returned; `None` of a recording that has none.
    pub fn lay(recording: &Path, folder: &Path) -> Result<Option<RecordedScene>, Unlaid> {
        let files = scene_files(recording)?;
        if files.is_empty() {
            return Ok(None);
        }
        let files: Vec<_> = files.into_iter().map(|SceneFile { name, bytes, .. }| SourceFile { name, bytes }).collect();
        let refused = |error: std::io::Error| Unlaid::System(folder.to_owned(), error);
        let _ = std::fs::remove_dir_all(folder); // of one that was killed
        // Nobody else can have made it, or put anything into it.
        DirBuilder::new().mode(0o700).create(folder).map_err(refused)?;
        let mut scene = RecordedScene { folder: folder.to_owned(), path: PathBuf::new() };
        scene.path = hyst_scene::unpack(&files, folder).map_err(refused)?;
        Ok(Some(scene))
    }

    /// The scene among them.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for RecordedScene {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder); // it may not have come about
    }
}

/// The anatomy of a session, from what was recorded of its scene and case, or from the scene in this program where it was that one; `None` if neither has
/// the hash that the recording names.
pub fn anatomy(recording: &Path, session: &Session) -> Option<LoadedScene> {
    let hash = u64::from_str_radix(session.get("scene_hash")?, 16).ok()?;
    let folder =
        std::env::temp_dir().join(format!("hystation-{}-report-{}", hyst_exchange::system::user_id(), std::process::id()));
    let laid = RecordedScene::lay(recording, &folder).ok().flatten();
    let recorded = || {
        let laid = laid.as_ref()?;
        let Some(text) = session.get("case_text") else { return hyst_scene::load(laid.path()).ok() };
        let case = folder.join("case.toml");
        std::fs::write(&case, with_scene(text, laid.path())?).ok()?;
        Some(find_played_case(&case, None).ok()??.scene)
    };
    let is_that = |scene: &LoadedScene| scene.hash == hash;
    recorded().filter(is_that).or_else(|| hyst_scene::load_embedded().ok().filter(is_that))
}
