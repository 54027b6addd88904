//! The cases that came with the programs, by their names: `hystation run polyp`.
//!
//! Promise: what is there under the path that was given is never looked for elsewhere, and a word that is no name stays what it is.

use crate::settings::{Refusal, own_folder};
use std::path::{Component, Path, PathBuf};

/// Where they lie, from the folder of the programs: of programs in a `bin` beside them; of the package, and of a build in its sources.
const FOLDERS: [&str; 4] = ["../share/hystation/cases", "../assets/cases", "../../share/hystation/cases", "../../assets/cases"];

/// The file that a word of the command line means, beside the programs that run now.
///
/// # Errors
/// The folder of this program cannot be found; or the word can only be a name, and nothing has it.
pub fn file(word: Option<PathBuf>) -> Result<Option<PathBuf>, Refusal> {
    let Some(word) = word else { return Ok(None) };
    let programs = own_folder()?;
    let path = file_beside(&programs, word);
    unknown(&programs, &path).map_or(Ok(Some(path)), Err)
}

/// Whether a word may be a case's name: one part, without an extension.
fn is_name(word: &Path) -> bool {
    matches!(word.components().collect::<Vec<_>>()[..], [Component::Normal(_)]) && word.extension().is_none()
}

/// The case of this name, if the word is one and nothing has it for its path; else the word.
fn file_beside(programs: &Path, word: PathBuf) -> PathBuf {
    if !is_name(&word) || word.exists() {
        return word;
    }
    let place = |folder: &str| programs.join(folder).join(&word).with_extension("toml").canonicalize().ok();
    let found = FOLDERS.into_iter().find_map(place);
    found.unwrap_or(word)
}

/// What is said of a name that neither a case nor a file has, where there are cases.
fn unknown(programs: &Path, word: &Path) -> Option<Refusal> {
    let names = names(programs);
    let is_unknown = is_name(word) && !word.exists() && !names.is_empty();
    is_unknown.then(|| {
        Refusal::input(format!("{}: there is no such file and no such case; the cases: {}", word.display(), names.join(", ")))
    })
}

/// The names of the cases, in the order of the alphabet.
fn names(programs: &Path) -> Vec<String> {
    let entries = FOLDERS.into_iter().filter_map(|folder| std::fs::read_dir(programs.join(folder)).ok()).flatten().flatten();
    let cases = entries.map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|end| end == "toml"));
    let mut names: Vec<String> = cases.filter_map(|path| Some(path.file_stem()?.to_string_lossy().into_owned())).collect();
    names.sort();
    names.dedup();
    names
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

    /// Programs in /opt/hystation/bin found the cases at /opt/assets, and nowhere in their own folder.
    #[test]
    fn programs_in_a_folder_of_their_own_find_the_cases_in_it_before_those_outside_of_it() {
        let root = std::env::temp_dir().join(format!("hystation-beside-{}", std::process::id()));
        let programs = root.join("hystation/bin");
        std::fs::create_dir_all(&programs).unwrap();
        for folder in ["assets/cases", "share/hystation/cases", "hystation/assets/cases", "hystation/share/hystation/cases"] {
            let cases = root.join(folder);
            std::fs::create_dir_all(&cases).unwrap();
            std::fs::write(cases.join("polyp.toml"), "").unwrap();
            assert_eq!(file_beside(&programs, "polyp".into()), cases.join("polyp.toml").canonicalize().unwrap(), "{folder}");
        }
        assert_eq!(names(&programs), ["polyp"]);
        std::fs::remove_dir_all(root).unwrap();
    }

    /// Who mistyped a case's name was told of the mesh of a scene that nobody had written.
    #[test]
    fn a_name_that_nothing_has_is_refused_with_the_names_of_the_cases() {
        let root = std::env::temp_dir().join(format!("hystation-unknown-{}", std::process::id()));
        let (programs, cases) = (root.join("usr/lib/hystation"), root.join("usr/share/hystation/cases"));
        for folder in [&programs, &cases] {
            std::fs::create_dir_all(folder).unwrap();
        }
        let refusal = |word: &str| unknown(&programs, Path::new(word)).map(|refusal| (refusal.code, refusal.message));
        assert_eq!(refusal("poylp"), None, "without cases it is a file that is missing");
        for case in ["septum.toml", "polyp.toml", "notes.txt"] {
            std::fs::write(cases.join(case), "").unwrap();
        }
        let (code, message) = refusal("poylp").unwrap();
        assert!(code == 2 && message.starts_with("poylp: ") && message.ends_with(": polyp, septum"), "{code} {message}");
        for path in ["poylp.toml", "./poylp", "/poylp"] {
            assert_eq!(refusal(path), None, "{path}");
        }
        std::fs::remove_dir_all(root).unwrap();
    }
}
