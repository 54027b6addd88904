//! The file of a recording of which only the folder was named (`--record FOLDER/`): its name says when the session began, what was run and who trained, so that
//! one command serves a whole class, one session after the other. And whether a file that was named can be begun.
//!
//! Promise: no file is overwritten, and none has two stations: it is made, empty, as the station is founded. Its recorder begins in it, and who takes that
//! station over goes on with it.

use crate::settings::Refusal;
use hyst_engine::Settings;
use hyst_exchange::machine;
use std::fs::OpenOptions;
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};

/// Most letters of a part of a name, which has three: the system takes 255.
const MOST_LETTERS: usize = 60;
/// Most files of one name and one second: more are made by something that is no session.
const MOST_FILES: usize = 100;

/// Whether a path names the folder of a recording: it ends in `/`, or it is one.
pub fn is_folder(path: &Path) -> bool {
    path.as_os_str().as_encoded_bytes().ends_with(b"/") || path.is_dir()
}

/// Looks whether a folder is there, or could be made, without making it.
///
/// # Errors
/// More than its last part is missing, or a file is in its place.
pub fn check(folder: &Path) -> Result<(), Refusal> {
    // With its `/` at the end a file would be none.
    let bare = folder.components().as_path();
    if bare.exists() && !bare.is_dir() {
        return Err(refused(folder, &"it is a file"));
    }
    match bare.parent() {
        Some(parent) if !parent.is_dir() => {
            Err(refused(folder, &format!("there is no folder {}; make it first", parent.display())))
        }
        _ => Ok(()),
    }
}

/// Looks whether a new recording can begin in a file that was named: there is none, or nothing is in it. The recorder refuses any other, once the station runs.
///
/// # Errors
/// Something is in it, or it is no file.
pub fn check_file(file: &Path) -> Result<(), Refusal> {
    let why = match std::fs::metadata(file) {
        Ok(found) if !found.is_file() => "it is no file",
        Ok(found) if found.len() > 0 => "it is there already, and no recording is written over",
        _ => return Ok(()),
    };
    let cure = "give another file, or a folder (sessions/), in which each session gets a file of its own";
    Err(Refusal::input(format!("--record {}: {why}; {cure}", file.display())))
}

/// Makes the file of a session that begins at a time, s since 1970 (UTC), and the folder, if that is not there.
///
/// # Errors
/// The folder cannot be made, or nothing can be made in it.
pub fn make_file(folder: &Path, settings: &Settings, begun_unix_s: u64) -> Result<PathBuf, Refusal> {
    let bare = folder.components().as_path();
    if let Err(error) = std::fs::create_dir(bare)
        && !bare.is_dir()
    {
        return Err(refused(folder, &error));
    }
    let stem = stem(settings, begun_unix_s);
    for number in 1..=MOST_FILES {
        let name = if number == 1 { format!("{stem}.mcap") } else { format!("{stem}-{number}.mcap") };
        let path = bare.join(name);
        match OpenOptions::new().write(true).create_new(true).open(&path) {
            Ok(_) => return Ok(path),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(refused(folder, &error)),
        }
    }
    Err(refused(folder, &Error::from(ErrorKind::AlreadyExists)))
}

fn refused(folder: &Path, why: &dyn std::fmt::Display) -> Refusal {
    let folder = folder.display();
    Refusal::input(format!(
        "--record {folder}: no file can be made in this folder: {why}; give one that may be written, or a file"
    ))
}

/// The name of a session's file, without its end: `2026-11-27-140312-polyp-anna`.
fn stem(settings: &Settings, begun_unix_s: u64) -> String {
    let moment = machine::utc_of(begun_unix_s).replace('T', "-").replace([':', 'Z'], "");
    let what = settings.case.as_deref().or(settings.scene.as_deref()).and_then(Path::file_stem);
    let what = what.map_or("default".into(), |stem| stem.to_string_lossy());
    let trainee = settings.trainee().ok().flatten().unwrap_or_default();
    let parts = [moment, plain(&what), plain(trainee)];
    parts.iter().filter(|part| !part.is_empty()).map(String::as_str).collect::<Vec<_>>().join("-")
}

/// A text in the letters that every file system and every shell takes as they are: `a` to `z`, digits, and one `-` for whatever else stands between them.
fn plain(text: &str) -> String {
    let mut plain = String::new();
    for letter in text.to_lowercase().chars().map(unaccented) {
        match letter {
            'a'..='z' | '0'..='9' => plain.push(letter),
            _ if !plain.is_empty() && !plain.ends_with('-') => plain.push('-'),
            _ => {}
        }
    }
    plain.truncate(MOST_LETTERS); // each is one byte
    plain.trim_end_matches('-').to_string()
}

/// A small letter of a western European name without its accent.
fn unaccented(letter: char) -> char {
    match letter {
        'à'..='å' => 'a',
        'ç' => 'c',
        'è'..='ë' => 'e',
        'ì'..='ï' => 'i',
        'ñ' => 'n',
        'ò'..='ö' | 'ø' => 'o',
        'ß' => 's',
        'ù'..='ü' => 'u',
        'ý' | 'ÿ' => 'y',
        _ => letter,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 2026-11-27T14:03:12Z.
    const MOMENT_UNIX_S: u64 = 1_795_788_192;

    fn settings(case: Option<&str>, scene: Option<&str>, trainee: Option<&str>) -> Settings {
        let set = trainee.map(|trainee| ("trainee".to_string(), trainee.to_string()));
        Settings {
            case: case.map(PathBuf::from),
            scene: scene.map(PathBuf::from),
            set: set.into_iter().collect(),
            ..Settings::default()
        }
    }

    fn named(case: Option<&str>, scene: Option<&str>, trainee: Option<&str>) -> String {
        stem(&settings(case, scene, trainee), MOMENT_UNIX_S)
    }

    fn folder(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("hystation-folder-{}-{name}", std::process::id()))
    }

    #[test]
    fn a_session_is_named_by_its_moment_its_case_or_scene_and_its_trainee_in_plain_letters() {
        assert_eq!(named(Some("/c/polyp.toml"), Some("/dev/shm/x/case.toml"), Some("Anna")), "2026-11-27-140312-polyp-anna");
        assert_eq!(named(None, Some("/m/My Liver.msh"), None), "2026-11-27-140312-my-liver");
        assert_eq!(named(None, None, Some("  Dr. Ana Müller-Ångström! ")), "2026-11-27-140312-default-dr-ana-muller-angstrom");
        assert_eq!(named(None, None, Some("../../Ω\u{7f}")), "2026-11-27-140312-default", "nothing of it is left");
        let long = "x".repeat(500);
        let name = named(Some(format!("/{long}.toml").as_str()), None, Some(&long[..60]));
        assert!(name.len() < 200 && name.ends_with('x'), "{name}");
    }

    #[test]
    fn each_session_has_a_file_of_its_own_and_the_folder_is_made_if_its_last_part_is_missing() {
        let folder = folder("own");
        let slashed = PathBuf::from(format!("{}/", folder.display()));
        assert!(is_folder(&slashed) && !is_folder(&folder), "it is not there yet");
        assert_eq!(check(&slashed), Ok(()));
        let settings = settings(None, None, Some("Anna"));
        let made = [(); 3].map(|()| make_file(&slashed, &settings, MOMENT_UNIX_S).unwrap());
        let names = ["", "-2", "-3"].map(|end| folder.join(format!("2026-11-27-140312-default-anna{end}.mcap")));
        assert_eq!(made, names);
        assert!(is_folder(&folder) && check(&folder) == Ok(()), "it is there now");
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_file_is_begun_where_there_is_none_or_nothing_is_in_it() {
        let file = folder("named.mcap");
        assert_eq!(check_file(&file), Ok(()), "it is not there");
        std::fs::write(&file, "").unwrap();
        assert_eq!(check_file(&file), Ok(()), "nothing is in it");
        std::fs::write(&file, "ticks").unwrap();
        for (bad, word) in [(file.as_path(), "written over"), (Path::new("/dev/null"), "no file")] {
            let refusal = check_file(bad).unwrap_err();
            assert!(refusal.code == 2 && refusal.message.contains(word), "{}: {refusal:?}", bad.display());
        }
        std::fs::remove_file(file).unwrap();
    }

    #[test]
    fn a_folder_in_which_nothing_can_be_made_is_refused_with_code_2() {
        let file = folder("file");
        std::fs::write(&file, "").unwrap();
        let (slashed, within) = (PathBuf::from(format!("{}/", file.display())), file.join("sessions/"));
        for bad in [slashed, within, PathBuf::from("/nowhere/at/all/")] {
            let refusal = check(&bad).unwrap_err();
            assert!(refusal.code == 2 && refusal.message.contains("--record"), "{}: {refusal:?}", bad.display());
        }
        // Nobody makes a file there, root neither.
        let refusal = make_file(Path::new("/proc"), &settings(None, None, None), MOMENT_UNIX_S).unwrap_err();
        assert!(refusal.code == 2 && refusal.message.contains("/proc"), "{refusal:?}");
        std::fs::remove_file(file).unwrap();
    }
}
