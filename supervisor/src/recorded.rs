//! The scene that a recording holds, on disk for as long as it is needed.

use crate::case::with_scene;
use hyst_recording::{SceneFile, Session, scene_files};
use hyst_scene::{LoadedScene, SourceFile, find_played_case};
use std::fs::DirBuilder;
use std::io::ErrorKind;
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

/// Why the organ of a session is not drawn.
#[derive(Debug, thiserror::Error)]
pub enum Undrawn {
    /// The recording has not what it takes, or not for this build.
    #[error("{0}")]
    Unknown(&'static str),
    /// The system refused the room in which a scene is read.
    #[error("the recorded scene cannot be laid down in {0}: {1}; free some there, or name another folder with TMPDIR")]
    Refused(PathBuf, std::io::Error),
}

/// The anatomy of a session, from what was recorded of its scene and case, or from the scene in this program where it was that one.
///
/// # Errors
/// Why it is not to be had: none has the hash that the recording names, or the system refused to have it read.
pub fn anatomy(recording: &Path, session: &Session) -> Result<LoadedScene, Undrawn> {
    let hash = session.get("scene_hash").and_then(|hash| u64::from_str_radix(hash, 16).ok());
    let hash = hash.ok_or(Undrawn::Unknown("the recording does not say of which scene it is"))?;
    let is_that = |scene: &LoadedScene| scene.hash == hash;
    let other = Undrawn::Unknown("this build has another organ of the scene that was recorded");
    let recorded = recorded_anatomy(recording, session).and_then(|scene| if is_that(&scene) { Ok(scene) } else { Err(other) });
    recorded.or_else(|why| hyst_scene::load_embedded().ok().filter(is_that).ok_or(why))
}

/// What was recorded of scene and case, read where it is laid down for that.
fn recorded_anatomy(recording: &Path, session: &Session) -> Result<LoadedScene, Undrawn> {
    let unread = || Undrawn::Unknown("this build does not read the scene that was recorded");
    let refused = |error: std::io::Error| Undrawn::Refused(std::env::temp_dir(), error);
    let folder =
        std::env::temp_dir().join(format!("hystation-{}-report-{}", hyst_exchange::system::user_id(), std::process::id()));
    let laid = RecordedScene::lay(recording, &folder).map_err(|why| match why {
        Unlaid::System(_, error) if error.kind() != ErrorKind::InvalidInput => refused(error), // that is a name that is none
        _ => unread(),
    })?;
    let laid = laid.ok_or(Undrawn::Unknown("the recording does not hold its scene"))?;
    let Some(text) = session.get("case_text") else { return hyst_scene::load(laid.path()).map_err(|_| unread()) };
    let case = folder.join("case.toml");
    let text = with_scene(text, laid.path()).ok_or_else(unread)?;
    std::fs::write(&case, text).map_err(refused)?;
    let found = find_played_case(&case, None).map_err(|_| unread())?;
    Ok(found.ok_or_else(unread)?.scene)
}
