//! A file that somebody names and that is read as a whole. Promise: no more is read than it may have, and a folder, a pipe or a device is refused, so that nothing
//! here waits or grows for ever.

use std::fs::File;
use std::io::{Error, Read};
use std::path::Path;

/// Why a file was not read.
#[derive(Debug, thiserror::Error)]
pub enum Unread {
    /// What the system says.
    #[error(transparent)]
    System(#[from] Error),
    /// What there is in place of a file.
    #[error("it is {0}, not a file")]
    NoFile(&'static str),
    /// It has more bytes than so many.
    #[error("it has more than {0} bytes")]
    TooLarge(u64),
    /// Which of its bytes is the first that is no text.
    #[error("byte {0} is not UTF-8 text")]
    NoText(usize),
}

/// What is in a file of at most so many bytes.
///
/// # Errors
/// What the system says, what there is in place of such a file, or that it is too large.
pub fn bytes(path: &Path, most_bytes: u64) -> Result<Vec<u8>, Unread> {
    let found = std::fs::metadata(path)?;
    if !found.is_file() {
        return Err(Unread::NoFile(if found.is_dir() { "a folder" } else { "a pipe or a device" }));
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(most_bytes.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most_bytes {
        return Err(Unread::TooLarge(most_bytes));
    }
    Ok(bytes)
}

/// The text of a file of at most so many bytes.
///
/// # Errors
/// Those of [`bytes`], and that it is no text.
pub fn text(path: &Path, most_bytes: u64) -> Result<String, Unread> {
    String::from_utf8(bytes(path, most_bytes)?).map_err(|error| Unread::NoText(error.utf8_error().valid_up_to()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::ErrorKind;

    /// A pipe into which nobody writes was waited for, and /dev/zero was read until there was no memory left.
    #[test]
    fn what_has_no_end_or_is_too_large_is_refused_and_no_more_than_a_file_is_read() {
        let folder = std::env::temp_dir().join(format!("hyst-scene-bounded-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let refusal = |path: &Path| text(path, 8).unwrap_err().to_string();
        let (file, pipe) = (folder.join("file"), folder.join("pipe"));
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        assert!(made.is_ok_and(|status| status.success()), "mkfifo, of coreutils");
        assert_eq!(refusal(&pipe), "it is a pipe or a device, not a file");
        assert_eq!(refusal(Path::new("/dev/zero")), "it is a pipe or a device, not a file");
        assert_eq!(refusal(&folder), "it is a folder, not a file");
        let gone = text(&folder.join("gone"), 8);
        assert!(matches!(&gone, Err(Unread::System(error)) if error.kind() == ErrorKind::NotFound), "{gone:?}");
        std::fs::write(&file, "12345678").unwrap();
        assert_eq!(text(&file, 8).unwrap(), "12345678");
        std::fs::write(&file, "123456789").unwrap();
        assert_eq!(refusal(&file), "it has more than 8 bytes");
        std::fs::write(&file, b"123\xff").unwrap();
        assert_eq!(refusal(&file), "byte 3 is not UTF-8 text");
        assert_eq!(bytes(&file, 8).unwrap(), b"123\xff");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
