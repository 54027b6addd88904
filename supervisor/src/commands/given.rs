//! A file for who asked for it: written beside its place and put there when it is whole. Promise: where the disk does not take all of it, what was there before
//! stays, and nothing is left beside it.

use hyst_exchange::whole;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// A file on its way.
pub struct Given {
    place: PathBuf,
    /// Where it is until it is whole; `None` where it is written to its place at once.
    next: Option<PathBuf>,
    out: BufWriter<File>,
}

impl Given {
    /// Begins it. Where a link leads to, there it will be; what is no file (a pipe, a device) has no whole, and is written to at once.
    ///
    /// # Errors
    /// What the system says.
    pub fn begin(path: &Path) -> io::Result<Given> {
        let place = path.canonicalize().unwrap_or_else(|_| path.to_path_buf()); // of one that is not there yet
        let is_file = std::fs::metadata(&place).map_or(true, |there| there.is_file());
        let next = is_file.then(|| whole::beside(&place));
        let out = BufWriter::new(File::create(next.as_ref().unwrap_or(&place))?);
        Ok(Given { place, next, out })
    }

    /// Puts it in its place.
    ///
    /// # Errors
    /// What the system says.
    pub fn finish(mut self) -> io::Result<()> {
        self.out.flush()?;
        if let Some(next) = &self.next {
            std::fs::rename(next, &self.place)?;
        }
        self.next = None;
        Ok(())
    }
}

impl Write for Given {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.out.write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

impl Drop for Given {
    fn drop(&mut self) {
        if let Some(next) = self.next.take() {
            let _ = std::fs::remove_file(next); // it did not become whole
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_there_stays_until_the_new_one_is_whole_and_a_link_stays_one() {
        let folder = std::env::temp_dir().join(format!("hystation-given-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let (path, link) = (folder.join("page.html"), folder.join("link.html"));
        std::fs::write(&path, "old").unwrap();
        std::os::unix::fs::symlink(&path, &link).unwrap();
        let names = || std::fs::read_dir(&folder).unwrap().count();
        let begun = |path: &Path| {
            let mut given = Given::begin(path).unwrap();
            given.write_all(b"new").unwrap();
            given.flush().unwrap();
            given
        };
        let given = begun(&link);
        assert_eq!((std::fs::read(&path).unwrap(), names()), (b"old".to_vec(), 3));
        drop(given);
        assert_eq!((std::fs::read(&path).unwrap(), names()), (b"old".to_vec(), 2));
        begun(&link).finish().unwrap();
        assert_eq!((std::fs::read(&path).unwrap(), names()), (b"new".to_vec(), 2));
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
        begun(&folder.join("first.html")).finish().unwrap();
        assert_eq!((std::fs::read(folder.join("first.html")).unwrap(), names()), (b"new".to_vec(), 3));
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn what_is_no_file_is_written_to_and_stays_what_it_is() {
        let mut given = Given::begin(Path::new("/dev/null")).unwrap();
        given.write_all(b"new").unwrap();
        given.finish().unwrap();
        assert!(!std::fs::metadata("/dev/null").unwrap().is_file() && !Path::new("/dev/null.next").exists());
        let mut given = Given::begin(Path::new("/dev/full")).unwrap();
        let refused = given.write_all(b"new").and_then(|()| given.finish()).unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::StorageFull);
    }
}
