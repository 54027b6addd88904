//! The disk as it is asked to keep what it took. That takes as long as the disk does, and may be done on another thread than the one that writes.

use crate::{TickRange, WriteError};
use std::fs::File;
use std::io::{self, ErrorKind};
use std::path::PathBuf;

/// Linux: a file system without this operation.
const EOPNOTSUPP: i32 = 95;

/// A recording's file, as a thread has it that asks for nothing but that it is kept.
#[derive(Debug)]
pub struct Disk {
    pub(crate) path: PathBuf,
    pub(crate) file: File,
    pub(crate) sync_data: fn(&File) -> io::Result<()>,
}

impl Disk {
    /// The same file once more; it stays locked until the last of them is gone.
    pub(crate) fn share(&self) -> io::Result<Disk> {
        Ok(Disk { path: self.path.clone(), file: self.file.try_clone()?, sync_data: self.sync_data })
    }

    /// Has the disk keep what was written, `ranges` of ticks of it. A file system that cannot be asked for it is not to blame. After an error
    /// ([`WriteError::Unsynced`]) it is not known what of it the disk has, and the system says so once.
    pub fn keep(&self, ranges: Vec<TickRange>) -> Result<(), WriteError> {
        match (self.sync_data)(&self.file) {
            Err(source) if !cannot_sync(&source) => Err(WriteError::Unsynced { path: self.path.clone(), ranges, source }),
            _ => Ok(()),
        }
    }
}

/// Whether it is the file system that knows no such thing, and no failure of it.
fn cannot_sync(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::InvalidInput | ErrorKind::Unsupported) || error.raw_os_error() == Some(EOPNOTSUPP)
}
