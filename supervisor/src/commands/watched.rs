//! A recording that takes long to read says how far it is.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;
use std::time::{Duration, Instant};

/// Nothing is said for so long, and then as often.
const QUIET: Duration = Duration::from_secs(5);

/// A file that says on stderr how much of it was read.
pub struct Watched {
    file: File,
    name: String,
    length: u64,
    at: u64,
    say_at: Instant,
}

impl Watched {
    /// Of a file that was opened by this name.
    pub fn of(file: File, path: &Path) -> io::Result<Watched> {
        let length = file.metadata()?.len();
        Ok(Watched { file, name: path.display().to_string(), length, at: 0, say_at: Instant::now() + QUIET })
    }

    /// What is to be said at a moment.
    fn word(&mut self, now: Instant) -> Option<String> {
        if now < self.say_at {
            return None;
        }
        self.say_at = now + QUIET;
        let percent = 100.0 * self.at as f64 / self.length.max(1) as f64;
        Some(format!("{}: read up to {percent:.0} % of {:.1} GB", self.name, self.length as f64 * 1e-9))
    }
}

impl Read for Watched {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read(bytes)?;
        self.at += count as u64;
        if let Some(word) = self.word(Instant::now()) {
            eprintln!("hystation: {word}");
        }
        Ok(count)
    }
}

impl Seek for Watched {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.at = self.file.seek(to)?;
        Ok(self.at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_read_quickly_says_nothing_and_a_long_one_every_five_seconds() {
        let path = std::env::temp_dir().join(format!("hyst-watched-{}", std::process::id()));
        std::fs::write(&path, [7; 1_000]).unwrap();
        let mut watched = Watched::of(File::open(&path).unwrap(), &path).unwrap();
        std::fs::remove_file(&path).unwrap();
        let began = Instant::now();
        let mut bytes = [0; 250];
        watched.read_exact(&mut bytes).unwrap();
        watched.seek(SeekFrom::Current(250)).unwrap();
        watched.read_exact(&mut bytes).unwrap();
        assert_eq!(bytes, [7; 250]);
        let words = [1, 6, 7, 12].map(|seconds| watched.word(began + Duration::from_secs(seconds)).is_some());
        assert_eq!(words, [false, true, false, true]);
        let word = watched.word(began + Duration::from_secs(30)).unwrap();
        assert!(word.ends_with(": read up to 75 % of 0.0 GB"), "{word}");
    }
}
