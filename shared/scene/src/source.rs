//! Where the bytes of a scene and its meshes come from: a folder, or the binary itself.

use crate::embedded;
use crate::error::{SceneError, SceneErrorKind as Kind};
use std::borrow::Cow;
use std::fs::File;
use std::io::Read;
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
                let bytes = read_bounded(&path, MAX_MESH_BYTES, key, cure)?;
                Ok((Cow::Owned(bytes), path.display().to_string()))
            }
        }
    }
}

/// Reads a file of at most `limit` bytes. A folder, a pipe or a device is refused, so that nothing here waits for ever.
pub(crate) fn read_bounded(path: &Path, limit: u64, key: &str, cure: &str) -> Result<Vec<u8>, SceneError> {
    let shown = path.display();
    let missing = |error: std::io::Error| {
        let why = match error.kind() {
            std::io::ErrorKind::NotFound => "there is no such file".to_owned(),
            _ => error.to_string(),
        };
        SceneError::new(Kind::Missing, key, format!("cannot read {shown}: {why}"), cure)
    };
    let metadata = std::fs::metadata(path).map_err(missing)?;
    if !metadata.is_file() {
        let what = if metadata.is_dir() { "a folder" } else { "a pipe or a device" };
        return Err(SceneError::new(Kind::Missing, key, format!("{shown} is {what}, not a file"), cure));
    }
    let mut bytes = Vec::new();
    File::open(path).map_err(missing)?.take(limit + 1).read_to_end(&mut bytes).map_err(missing)?;
    if bytes.len() as u64 > limit {
        let what = format!("{shown} has more than {} MB", limit >> 20);
        return Err(SceneError::new(Kind::TooLarge, key, what, "use a coarser mesh, and check that this is the right file"));
    }
    Ok(bytes)
}
