//! Where the bytes of a scene and its meshes come from: a folder, or the binary itself.

use crate::bounded::{self, Unread};
use crate::embedded;
use crate::error::{SceneError, SceneErrorKind as Kind};
use std::borrow::Cow;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Largest mesh file, in bytes: a mesh of the most tets that are simulated here has some 30 MB.
pub const MAX_MESH_BYTES: u64 = 256 << 20;

/// Where relative names are looked up.
pub(crate) enum Folder {
    Disk(PathBuf),
    Embedded,
}

impl Folder {
    /// The bytes of a mesh file and the name to speak of it by.
    pub(crate) fn mesh(&self, key: &str, name: &str) -> Result<(Cow<'static, [u8]>, String), SceneError> {
        if let Some(known) = name.strip_prefix(embedded::PREFIX) {
            return match embedded::mesh(known) {
                Some(bytes) => Ok((Cow::Borrowed(bytes), name.to_owned())),
                None => {
                    let what = format!("“{name}” is not inside the binary; there are: {}", embedded::names());
                    Err(SceneError::new(Kind::Missing, key, what, "name one of these, or a file"))
                }
            };
        }
        match self {
            Folder::Embedded => {
                let known = name.rsplit('/').next().unwrap_or(name);
                self.mesh(key, &format!("{}{known}", embedded::PREFIX))
            }
            Folder::Disk(folder) => {
                let path = folder.join(name);
                let cure = "correct the name; it is relative to the folder of the scene";
                let bytes = bounded::bytes(&path, MAX_MESH_BYTES).map_err(|why| unusable(&path, why, key, cure))?;
                Ok((Cow::Owned(bytes), path.display().to_string()))
            }
        }
    }
}

/// Why a file of a scene cannot be used.
pub(crate) fn unusable(path: &Path, why: Unread, key: &str, cure: &str) -> SceneError {
    let shown = path.display();
    match why {
        Unread::System(error) => {
            let why = match error.kind() {
                ErrorKind::NotFound => "there is no such file".to_owned(),
                _ => error.to_string(),
            };
            SceneError::new(Kind::Missing, key, format!("cannot read {shown}: {why}"), cure)
        }
        Unread::NoFile(what) => SceneError::new(Kind::Missing, key, format!("{shown} is {what}, not a file"), cure),
        Unread::TooLarge(most_bytes) => {
            let what = format!("{shown} has more than {} MB", most_bytes >> 20);
            SceneError::new(Kind::TooLarge, key, what, "use a coarser mesh, and check that this is the right file")
        }
        Unread::NoText(byte) => {
            SceneError::new(Kind::Syntax, key, format!("byte {byte} is not UTF-8 text"), "save the file as UTF-8")
        }
    }
}
