//! Small files that are replaced as a whole, as those in a station's root are: written beside the one before, and put in its place in one step.
//!
//! Promises: a reader finds what was there before or what is there now, and never a part, whoever dies when; a writing that fails leaves what was there, and
//! nothing beside it. Each file has one writer at a time. Nothing waits for a disk: what a machine without power forgets, a station does, too.

use std::fs::OpenOptions;
use std::io::Write;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

/// Rights of a file that anybody may read whom its folder lets in, less what the process's mask takes away, and of one that is its user's alone.
const ANYBODY: u32 = 0o666;
const OWN_USER: u32 = 0o600;

/// Writes a file in the place of the one before.
///
/// # Errors
/// What the system says: nothing is changed then.
pub fn write(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    replace(path, bytes, ANYBODY)
}

/// The same for a file that its user alone may read.
///
/// # Errors
/// As [`write`].
pub fn write_for_own_user(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    replace(path, bytes, OWN_USER)
}

/// Where a file is written before it is whole; the whole name is kept, so that `a.json` and `a.toml` do not meet there.
pub fn beside(path: &Path) -> PathBuf {
    let mut next = path.as_os_str().to_os_string();
    next.push(".next");
    PathBuf::from(next)
}

fn replace(path: &Path, bytes: &[u8], mode: u32) -> std::io::Result<()> {
    let next = beside(path);
    let put = || {
        let mut file = OpenOptions::new().write(true).create(true).truncate(true).mode(mode).open(&next)?;
        file.write_all(bytes)?;
        std::fs::rename(&next, path)
    };
    put().inspect_err(|_| {
        let _ = std::fs::remove_file(&next); // not made is as good
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("hystation-whole-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).unwrap();
        folder
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<String> = entries.collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_takes_the_place_of_the_one_before_and_of_what_a_dead_writer_left_beside_it() {
        let folder = folder("replaced");
        let path = folder.join("told.json");
        write(&path, b"old").unwrap();
        std::fs::write(beside(&path), "a longer half of").unwrap();
        write(&path, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        write(&folder.join("told.toml"), b"").unwrap();
        write_for_own_user(&folder.join("token"), b"secret").unwrap();
        assert_eq!(std::fs::metadata(folder.join("token")).unwrap().permissions().mode() & 0o777, OWN_USER);
        assert_eq!(names(&folder), ["token", "told.json", "told.toml"]);
        assert_eq!(beside(&path), folder.join("told.json.next"));
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_writing_that_fails_leaves_what_was_there_and_nothing_beside_it() {
        let folder = folder("refused");
        // A folder in its place that is not empty: it is written, and cannot be put there.
        let taken = folder.join("taken");
        std::fs::create_dir(&taken).unwrap();
        std::fs::write(taken.join("old"), "old").unwrap();
        assert!(write(&taken, b"new").is_err());
        assert_eq!((names(&folder), names(&taken)), (vec!["taken".to_string()], vec!["old".to_string()]));
        // Nothing can be written beside it: one that is there is not touched.
        let path = folder.join("kept");
        write(&path, b"old").unwrap();
        std::fs::create_dir(beside(&path)).unwrap();
        assert!(write(&path, b"new").is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        let nowhere = folder.join("no-such-folder/file");
        assert_eq!(write(&nowhere, b"new").unwrap_err().kind(), std::io::ErrorKind::NotFound);
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_reader_finds_the_one_before_or_the_new_one_and_never_a_part() {
        const WRITINGS: usize = 300;
        let folder = folder("read");
        let path = folder.join("file");
        let [long, short] = [vec![b'l'; 70_000], vec![b's'; 3]];
        write(&path, &short).unwrap();
        let writer = std::thread::spawn({
            let (path, contents) = (path.clone(), [long.clone(), short.clone()]);
            move || (0..WRITINGS).for_each(|round| write(&path, &contents[round % 2]).unwrap())
        });
        while !writer.is_finished() {
            let read = std::fs::read(&path).unwrap();
            assert!(read == long || read == short, "{} bytes", read.len());
        }
        writer.join().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), short);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
