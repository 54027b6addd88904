//! The cases that came with the programs, by their names: `hystation run polyp`.
//!
//! Promise: what is there under the path that was given is never looked for elsewhere, and a word that is no name stays what it is.

use crate::settings::{Refusal, own_folder};
use std::path::{Component, Path, PathBuf};

/// Where they lie, from the folder of the programs: of the package, and of a build in its sources.
const FOLDERS: [&str; 2] = ["../../share/hystation/cases", "../../assets/cases"];

/// The file that a word of the command line means, beside the programs that run now.
///
/// # Errors
/// The folder of this program cannot be found.
pub fn file(word: Option<PathBuf>) -> Result<Option<PathBuf>, Refusal> {
    let Some(word) = word else { return Ok(None) };
    Ok(Some(file_beside(&own_folder()?, word)))
}

/// The case of this name, if the word is one and nothing has it for its path; else the word.
fn file_beside(programs: &Path, word: PathBuf) -> PathBuf {
    let is_name = matches!(word.components().collect::<Vec<_>>()[..], [Component::Normal(_)]) && word.extension().is_none();
    if !is_name || word.exists() {
        return word;
    }
    let place = |folder: &str| programs.join(folder).join(&word).with_extension("toml").canonicalize().ok();
    let found = FOLDERS.into_iter().find_map(place);
    found.unwrap_or(word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_that_of_a_case_that_came_with_the_programs_and_a_path_is_a_path() {
        let root = std::env::temp_dir().join(format!("hystation-shipped-{}", std::process::id()));
        let programs = root.join("usr/lib/hystation");
        let cases = root.join("usr/share/hystation/cases");
        for folder in [&programs, &cases] {
            std::fs::create_dir_all(folder).unwrap();
        }
        std::fs::write(cases.join("polyp.toml"), "").unwrap();
        let meant = |word: &str| file_beside(&programs, word.into());
        assert_eq!(meant("polyp"), cases.join("polyp.toml").canonicalize().unwrap());
        for word in ["septum", "polyp.toml", "./polyp", "cases/polyp", "../cases/polyp", "/polyp", ".."] {
            assert_eq!(meant(word), Path::new(word), "{word}");
        }
        // Of a build in its sources.
        let build = root.join("sources/target/release");
        let shipped = root.join("sources/assets/cases");
        for folder in [&build, &shipped] {
            std::fs::create_dir_all(folder).unwrap();
        }
        std::fs::write(shipped.join("septum.toml"), "").unwrap();
        assert_eq!(file_beside(&build, "septum".into()), shipped.join("septum.toml").canonicalize().unwrap());
        std::fs::remove_dir_all(root).unwrap();
    }
}
