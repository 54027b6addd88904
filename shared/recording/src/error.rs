//! Why a file is not read, or not written: what it is, and what helps.

use crate::{FORMAT, READ_FORMATS, Session, TickRange};
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

/// Why something cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The file cannot be made or opened.
    #[error("recording {path}: {source}; give --record a path in a folder that exists and may be written")]
    Open {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Another process writes it.
    #[error("recording {path} is being written by another process; stop it, or give --record another file")]
    Locked {
        /// The file.
        path: PathBuf,
    },
    /// The file holds something else.
    #[error("recording {path} exists and {holds}; move it away, or give --record another file")]
    Foreign {
        /// The file.
        path: PathBuf,
        /// What it holds.
        holds: &'static str,
    },
    /// No room: the disk, the quota or the limit.
    #[error("recording {path}: no room for {bytes} bytes more; make room, the recorder tries again")]
    Full {
        /// The file.
        path: PathBuf,
        /// Bytes that did not fit.
        bytes: usize,
    },
    /// The write failed otherwise.
    #[error("recording {path}: {source}; look at the disk")]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The disk took it and did not keep it: a stick that is gone, or a server that is full.
    #[error(
        "recording {path}: the disk did not keep what it had taken: {source}; {ticks} ticks may be lost, look at the disk",
        ticks = count(.ranges)
    )]
    Unsynced {
        /// The file.
        path: PathBuf,
        /// Ticks that were written since the disk last kept everything.
        ranges: Vec<TickRange>,
        /// What the system said.
        source: io::Error,
    },
    /// A block cannot be put into bytes.
    #[error("a block of the recording cannot be encoded: {0}")]
    Encode(String),
}

impl WriteError {
    pub(crate) fn encode(error: mcap::McapError) -> WriteError {
        WriteError::Encode(error.to_string())
    }

    /// Ticks that were written and may not be on the disk.
    pub fn doubtful_ticks(&self) -> u64 {
        if let WriteError::Unsynced { ranges, .. } = self { count(ranges) } else { 0 }
    }
}

fn count(ranges: &[TickRange]) -> u64 {
    ranges.iter().map(TickRange::count).sum()
}
