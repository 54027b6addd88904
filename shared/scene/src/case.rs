//! Cases: a scene whose anatomy is drawn from a seed, a task, goals, ends, warnings, and what the scores weigh.
//!
//! [`find_case`] reads the case at a path and draws its scene. What comes of it is settled: a text that names its seed and its scene whole, from which every
//! engine, its successors and a replay draw the same anatomy to the bit, and a [`Brief`], by which a session is judged without file or mesh.
//! [`find_played_case`] reads one that was played: whether its goals are within reach is not asked again.
//!
//! Promise: no file makes anything here panic; an error says file, line, key, reason and cure; goals that cannot be reached together with the rest of the
//! case are refused. The ladder of exercises is that of courses in hysteroscopy (Bajka et al. 2010), as shared as the station's meshes allow.

mod brief;
mod checks;
mod conflicts;
mod file;
mod fits;
mod metrics;
mod reach;
mod seat;
mod vary;
mod words;

pub use brief::{Aim, Asked, Brief, Cause, Named, Region, Sight, Warned};
pub use conflicts::LOOKS_FROM_PA;
pub use file::{
    Alarm, Biopsy, CameraHead, Case, End, Energy, Goal, Held, Mirror, Place, Removed, Rules, Rung, Score, Staunch, Stop, Survey,
    Vary, Visit, Warning,
};
pub use metrics::METRIC_KEYS;
pub use reach::Reach;
pub(crate) use seat::{Seat, Seats};

use crate::error::{SceneError, SceneErrorKind as Kind};
use crate::load::{Found, ReadScene, read_file};
use crate::loaded::LoadedScene;
use crate::mirror;
use crate::parse::{Format, read, top_keys};
use crate::validate::validate;
use std::path::Path;

const CASE: Format = Format { name: "case", schema: "assets/schema/case.schema.json" };
/// Keys that no scene has at its top: a file with one of them is a case.
const KEYS: [&str; 7] = ["scene", "rung", "task", "goal", "end", "vary", "score"];

/// Whether a case was played: then it is not asked any more whether the scope comes to its places and its current works in its medium. What was played once can
/// be played again, whatever rules have come since.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Past {
    /// It is about to be played for the first time, for all that is known.
    New,
    /// It was settled before: by who started the station, or whose recording it is.
    Played,
}

/// A case with one anatomy.
#[derive(Debug, Clone, PartialEq)]
pub struct SettledCase {
    /// The case, with its seed and the whole path of its scene: a case file from which the same anatomy is drawn wherever it lies.
    pub text: String,
    /// What it is judged by.
    pub brief: Brief,
    /// Its scene.
    pub scene: LoadedScene,
}

impl Case {
    /// Reads a case and checks all that the text alone can show. `origin` names the text in errors (its path).
    ///
    /// # Errors
    /// A [`SceneError`] that says which line and key, what is wrong and what to do.
    pub fn parse(text: &str, origin: &str) -> Result<Case, SceneError> {
        let case: Case = read(text, origin, &CASE)?;
        checks::alone(&case).map_err(|error| error.located(origin, text))?;
        Ok(case)
    }
}

/// The case at a path with the anatomy of a seed, its own where none is given; `None` if a scene or a mesh lies there.
///
/// # Errors
/// A [`SceneError`] about the case, its scene or a mesh.
pub fn find_case(path: &Path, seed: Option<u32>) -> Result<Option<SettledCase>, SceneError> {
    find(path, seed, Past::New)
}

/// The same of a case that was played, as a recording has it: one that a later build would refuse, because its scope does not come to a place, its current
/// does not work in its medium, its vessels do not bleed or its goals do not go together, is settled all the same.
///
/// # Errors
/// Those of [`find_case`], but for these.
pub fn find_played_case(path: &Path, seed: Option<u32>) -> Result<Option<SettledCase>, SceneError> {
    find(path, seed, Past::Played)
}

fn find(path: &Path, seed: Option<u32>, past: Past) -> Result<Option<SettledCase>, SceneError> {
    match read_file(path)? {
        Found::Scene(_) => Ok(None),
        Found::Case(text) => settle(&text, path, seed, past).map(Some),
    }
}

/// The JSON schema of a case file, derived from the types that read it.
pub fn case_schema_json() -> String {
    let schema = schemars::schema_for!(Case);
    let mut text = serde_json::to_string_pretty(&schema).unwrap_or_default(); // a schema always serializes
    text.push('\n');
    text
}

pub(crate) fn is_case(text: &str) -> bool {
    top_keys(text).iter().any(|key| KEYS.contains(&key.as_str()))
}

/// Draws the anatomy of a case whose text lies at a path.
pub(crate) fn settle(text: &str, path: &Path, seed: Option<u32>, past: Past) -> Result<SettledCase, SceneError> {
    let origin = path.display().to_string();
    let located = |error: SceneError| error.located(&origin, text);
    let (mut case, mut read) = read_case(text, path, past)?;
    case.seed = seed.unwrap_or(case.seed);
    let whole = std::path::absolute(path.parent().unwrap_or(Path::new("")).join(&case.scene));
    let whole = whole.ok().and_then(|whole| whole.into_os_string().into_string().ok());
    case.scene = whole.ok_or_else(|| {
        let what = "the path of the scene is no text";
        located(SceneError::new(Kind::Missing, "scene", what, "give folders names in UTF-8"))
    })?;
    read.scene.hand.extend(case.hand.clone());
    let (seats, drawn) = vary::draw(&case, case.seed, &mut read.scene);
    validate(&read.scene).map_err(|error| located(SceneError { key: "vary".into(), ..error }))?;
    let mut scene = read.load(&seats)?;
    scene.drawn.extend(drawn);
    scene.is_head_free = case.rules.camera == CameraHead::Free;
    scene.fluid.deficit_alarm_ml = case.rules.max_deficit_ml;
    if past == Past::New {
        fits::playable_as_drawn(&case, &scene).map_err(located)?;
    }
    let text = toml::to_string(&case).map_err(|error| {
        located(SceneError::new(Kind::Syntax, "", format!("cannot be written again: {error}"), "write it simpler"))
    })?;
    // What is settled draws its mirror image anew; what it is judged by is that image.
    mirror::places(&mut case.place, scene.scene.workspace.pivot_m, seats.mirrored);
    let brief = brief::brief(&case, &scene).map_err(located)?;
    Ok(SettledCase { text, brief, scene })
}

/// A case and its scene, which fit each other; nothing is drawn, and no mesh is read.
pub(crate) fn read_case(text: &str, path: &Path, past: Past) -> Result<(Case, ReadScene), SceneError> {
    let origin = path.display().to_string();
    let case = Case::parse(text, &origin)?;
    let located = |error: SceneError| error.located(&origin, text);
    let scene_path = path.parent().unwrap_or(Path::new("")).join(&case.scene);
    let of_key = |what: &str, cure: &str| located(SceneError::new(Kind::Missing, "scene", what, cure));
    let read = match read_file(&scene_path) {
        Ok(Found::Scene(read)) => *read,
        Ok(Found::Case(_)) => return Err(of_key("names another case", "name a scene (.toml) or a mesh")),
        Err(error) if error.kind == Kind::Missing && error.key.is_empty() => {
            return Err(of_key(&error.what, "correct the name; it is relative to the folder of the case"));
        }
        Err(error) => return Err(error),
    };
    fits::together(&case, &read.scene).map_err(located)?;
    if past == Past::New {
        fits::playable(&case, &read.scene).map_err(located)?;
    }
    Ok((case, read))
}

#[cfg(test)]
mod tests;
