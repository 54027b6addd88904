//! Why a file is not read: what it is, and what helps.

use crate::{FORMAT, READ_FORMATS, Session};
use std::io;
use std::path::{Path, PathBuf};

/// Why a file cannot be read as a recording.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The system refused.
    #[error("recording {path}: {source}; check the path and its rights")]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A version that this one does not know.
    #[error(
        "recording {path}: is not a recording of this version: it is of format {format}, and {oldest} to {FORMAT} are read; {cure}",
        oldest = READ_FORMATS[0]
    )]
    Version {
        /// The file.
        path: PathBuf,
        /// What it says of itself.
        format: String,
        /// What helps.
        cure: &'static str,
    },
    /// Something else, or the beginning is gone.
    #[error("recording {path}: {what}; give a file that `hystation run --record` wrote")]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What was found.
        what: String,
    },
}

/// Whether a session's recording is of a version that is read.
pub(crate) fn version(path: &Path, session: &Session) -> Result<(), ReadError> {
    let format = session.get("format").map_or("none", String::as_str);
    if READ_FORMATS.contains(&format) {
        return Ok(());
    }
    let number = |format: &str| format.parse::<u32>().ok();
    let cure = if number(format) > number(FORMAT) {
        "a newer hystation wrote it, and reads it: install that one"
    } else {
        "give a file that `hystation run --record` wrote"
    };
    Err(ReadError::Version { path: path.to_path_buf(), format: format.into(), cure })
}
