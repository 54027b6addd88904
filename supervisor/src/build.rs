//! By which programs a station is run: a hash of their bytes, which two builds of one version differ in.

use crate::plan;
use crate::settings::Refusal;
use hyst_messages::fnv_words;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;

/// Bytes of a program that are hashed at once.
const PART_BYTES: u64 = 1 << 20;

/// The build of this program and of the engines in these folders, 16 hexadecimal digits. Takes as long as it takes to read them. The recorder is among them:
/// it is hurt as the others are, and what it lost is judged.
///
/// # Errors
/// Names the program that cannot be read.
pub fn of(folders: &BTreeSet<&Path>) -> Result<String, Refusal> {
    let programs = programs(folders)?;
    let hash = hash(&programs).map_err(|(path, e)| Refusal::failed(format!("{}: {e}; it is to be run", path.display())))?;
    Ok(format!("{hash:016x}"))
}

/// A build that is found on a thread of its own, beside whatever else a start does until it is needed.
#[derive(Debug)]
pub struct Beside {
    folder: PathBuf,
    thread: Option<JoinHandle<Option<String>>>,
}

impl Beside {
    /// Begins to read this program and the engines of a folder.
    pub fn of(folder: &Path) -> Beside {
        let own = folder.to_path_buf();
        let read = move || of(&BTreeSet::from([own.as_path()])).ok();
        // Refused, they are read when it is waited for.
        let thread = std::thread::Builder::new().name("build".into()).spawn(read).ok();
        Beside { folder: folder.to_path_buf(), thread }
    }

    /// Waits until it is found; `None` of engines that cannot all be read.
    pub fn wait(self) -> Option<String> {
        match self.thread {
            Some(thread) => thread.join().ok().flatten(),
            None => of(&BTreeSet::from([self.folder.as_path()])).ok(),
        }
    }
}

/// This program and the engines, each once.
fn programs(folders: &BTreeSet<&Path>) -> Result<Vec<PathBuf>, Refusal> {
    let roles: BTreeSet<&str> = plan::engines().map(|role| role.name()).collect();
    let engines = folders.iter().flat_map(|folder| roles.iter().map(|role| folder.join(role)));
    let own_program = std::env::current_exe().map_err(|e| Refusal::failed(format!("cannot find this program: {e}")))?;
    Ok([own_program].into_iter().chain(engines).collect())
}

fn hash(programs: &[PathBuf]) -> Result<u64, (PathBuf, std::io::Error)> {
    let mut hash = 0;
    for path in programs {
        hash = hash_file(hash, path).map_err(|e| (path.clone(), e))?;
    }
    Ok(hash)
}

fn hash_file(mut hash: u64, path: &Path) -> std::io::Result<u64> {
    let mut file = File::open(path)?;
    let mut part = Vec::with_capacity(PART_BYTES as usize);
    loop {
        part.clear();
        let length = file.by_ref().take(PART_BYTES).read_to_end(&mut part)?;
        if length == 0 {
            return Ok(hash);
        }
        part.resize(length.next_multiple_of(8), 0);
        let words = part.chunks_exact(8).map(|word| word.iter().fold(0, |word, byte| word << 8 | u64::from(*byte)));
        hash = fnv_words(hash, words.chain([length as u64]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_found_beside_is_the_build_and_of_engines_that_cannot_all_be_read_there_is_none() {
        let folder = std::env::temp_dir().join(format!("hystation-beside-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        assert_eq!(Beside::of(&folder).wait(), None);
        let folders = BTreeSet::from([folder.as_path()]);
        for engine in programs(&folders).unwrap().into_iter().skip(1) {
            std::fs::write(engine, "an engine").unwrap();
        }
        let found = of(&folders).unwrap();
        assert_eq!(Beside::of(&folder).wait().as_ref(), Some(&found));
        assert_eq!(Beside { folder: folder.clone(), thread: None }.wait(), Some(found), "no thread was to be had");
        std::fs::remove_dir_all(&folder).unwrap();
    }

    /// A recorder that loses ticks was the same build as one that loses none.
    #[test]
    fn another_engine_of_any_role_is_another_build() {
        let folder = std::env::temp_dir().join(format!("hystation-engines-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let folders = BTreeSet::from([folder.as_path()]);
        plan::engines().for_each(|role| std::fs::write(folder.join(role.name()), "an engine").unwrap());
        let build = || hash(&programs(&folders).unwrap()[1..]).unwrap(); // without this program, which is large
        let found = build();
        assert_eq!(build(), found);
        for role in plan::engines() {
            std::fs::write(folder.join(role.name()), "another").unwrap();
            assert_ne!(build(), found, "{}", role.name());
            std::fs::write(folder.join(role.name()), "an engine").unwrap();
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn another_byte_in_any_program_is_another_build_and_the_same_bytes_are_the_same_one() {
        let folder = std::env::temp_dir().join(format!("hystation-origin-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let files = ["a", "b"].map(|name| folder.join(name));
        let of = |a: &[u8], b: &[u8]| {
            std::fs::write(&files[0], a).unwrap();
            std::fs::write(&files[1], b).unwrap();
            hash(&files).unwrap()
        };
        let long = vec![7; PART_BYTES as usize + 3];
        let mut other = long.clone();
        other[PART_BYTES as usize + 2] = 8;
        assert_eq!(of(&long, b"engine"), of(&long, b"engine"));
        let hashes: BTreeSet<u64> =
            [of(&long, b"engine"), of(&other, b"engine"), of(&long, b"engine\0"), of(&long, b"engin"), of(b"engine", &long)]
                .into();
        assert_eq!(hashes.len(), 5);
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(hash(&files).unwrap_err().0, files[0]);
    }
}
