//! From a scene's text to a checked [`Scene`]: every fault has its line, its column, its key and its cure.

use crate::error::{SceneError, SceneErrorKind as Kind};
use crate::file::Scene;
use crate::validate::validate;
use serde::de::DeserializeOwned;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Largest scene file, in bytes: a hundred times the largest that makes sense.
pub const MAX_SCENE_BYTES: usize = 1 << 20;

/// A kind of file: what it is called, and where its keys are listed.
pub(crate) struct Format {
    pub(crate) name: &'static str,
    pub(crate) schema: &'static str,
}

const SCENE: Format = Format { name: "scene", schema: "assets/schema/scene.schema.json" };

impl Scene {
    /// Reads and checks a scene. `origin` names the text in errors (its path).
    ///
    /// Checked here is all that the text alone can show: keys, types, ranges, names. Meshes are checked by [`load`](crate::load).
    pub fn parse(text: &str, origin: &str) -> Result<Scene, SceneError> {
        let scene: Scene = read(text, origin, &SCENE)?;
        validate(&scene).map_err(|error| error.located(origin, text))?;
        Ok(scene)
    }
}

/// Reads a file of version 1: keys and types are right, and every number is finite.
pub(crate) fn read<T: DeserializeOwned>(text: &str, origin: &str, format: &Format) -> Result<T, SceneError> {
    if text.len() > MAX_SCENE_BYTES {
        let what = format!("the {} has {} bytes, at most {MAX_SCENE_BYTES} are read", format.name, text.len());
        let cure = format!("check that this is a {} and not a mesh", format.name);
        return Err(SceneError::new(Kind::TooLarge, "", what, cure).at(origin));
    }
    let table = DeTable::parse(text).map_err(|error| from_toml(&error, None, text, format).at(origin))?;
    let values = walk(&table);
    if let Some(entry) = values.iter().find(|entry| entry.not_finite) {
        let error = SceneError::new(Kind::Range, entry.path.clone(), "is not a finite number", "give a finite number");
        return Err(error.located(origin, text));
    }
    version(&table, text).map_err(|error| error.located(origin, text))?;
    toml::from_str(text).map_err(|error| from_toml(&error, Some(&values), text, format).at(origin))
}

/// The keys at the top of a text; none of one that is no TOML.
pub(crate) fn top_keys(text: &str) -> Vec<String> {
    DeTable::parse(text)
        .map_or_else(|_| Vec::new(), |table| table.get_ref().keys().map(|key| key.get_ref().to_string()).collect())
}

/// The version is looked at before anything else, so that a scene of a later version is not called full of unknown keys.
fn version(table: &Spanned<DeTable<'_>>, text: &str) -> Result<(), SceneError> {
    let found = table.get_ref().get("version");
    let cure = "this station reads version 1: write `version = 1` as the first line";
    match found.map(|value| value.get_ref()) {
        Some(DeValue::Integer(number)) if number.as_str() == "1" && number.radix() == 10 => Ok(()),
        Some(_) => {
            let shown = found.and_then(|value| text.get(value.span())).unwrap_or("?");
            Err(SceneError::new(Kind::Version, "version", format!("is {shown}"), cure))
        }
        None => Err(SceneError::new(Kind::Version, "version", "is missing", cure)),
    }
}

/// One value of the text.
struct Entry {
    path: String,
    key_span: Range<usize>,
    span: Range<usize>,
    not_finite: bool,
}

/// All values of the text, tables before what they hold. The parser bounds the depth.
fn walk(table: &Spanned<DeTable<'_>>) -> Vec<Entry> {
    let mut entries = Vec::new();
    walk_table(table.get_ref(), "", &mut entries);
    entries
}

fn walk_table(table: &DeTable<'_>, path: &str, entries: &mut Vec<Entry>) {
    for (key, value) in table {
        let name = key.get_ref();
        let path = if path.is_empty() { name.to_string() } else { format!("{path}.{name}") };
        walk_value(value, key.span(), path, entries);
    }
}

fn walk_value(value: &Spanned<DeValue<'_>>, key_span: Range<usize>, path: String, entries: &mut Vec<Entry>) {
    let not_finite = match value.get_ref() {
        DeValue::Float(number) => !number.as_str().replace('_', "").parse().is_ok_and(f64::is_finite),
        _ => false,
    };
    entries.push(Entry { path: path.clone(), key_span: key_span.clone(), span: value.span(), not_finite });
    match value.get_ref() {
        DeValue::Table(table) => walk_table(table, &path, entries),
        DeValue::Array(array) => {
            for (index, item) in array.iter().enumerate() {
                walk_value(item, item.span(), format!("{path}[{index}]"), entries);
            }
        }
        _ => {}
    }
}

/// Line and column of a byte of the text, counted from 1, the column in characters.
fn line_column(text: &str, byte: usize) -> (usize, usize) {
    let before = &text.as_bytes()[..byte.min(text.len())];
    let start = before.iter().rposition(|&b| b == b'\n').map_or(0, |newline| newline + 1);
    let line = before.iter().filter(|&&b| b == b'\n').count() + 1;
    (line, String::from_utf8_lossy(&before[start..]).chars().count() + 1)
}

/// Where the key stands, or the nearest table above it that the text names.
pub(crate) fn line_column_of_key(text: &str, key: &str) -> Option<(usize, usize)> {
    let entries = walk(&DeTable::parse(text).ok()?);
    let mut path = key;
    while !path.is_empty() {
        if let Some(entry) = entries.iter().find(|entry| entry.path == path) {
            return Some(line_column(text, entry.key_span.start));
        }
        path = &path[..path.rfind(['.', '[']).unwrap_or(0)];
    }
    None
}

/// An error of the TOML reader, with the key that it concerns.
fn from_toml(error: &toml::de::Error, entries: Option<&Vec<Entry>>, text: &str, format: &Format) -> SceneError {
    let message = error.message().trim().replace('\n', ", ");
    let (kind, cure) = if message.starts_with("unknown field") || message.starts_with("unknown variant") {
        (Kind::UnknownKey, "correct or remove it".to_owned())
    } else if message.starts_with("missing field") {
        (Kind::Incomplete, format!("add it; {} lists every key", format.schema))
    } else {
        (Kind::Syntax, format!("correct the line; {} lists every key and its type", format.schema))
    };
    // What the whole file lacks concerns no key, though one stands at its beginning.
    let start = error.span().map(|span| span.start);
    let of_key = start.filter(|start| kind != Kind::Incomplete || *start > 0);
    let inside = |entry: &&Entry| of_key.is_some_and(|byte| entry.span.contains(&byte) || entry.key_span.contains(&byte));
    let key = entries.and_then(|entries| entries.iter().rfind(inside)).map_or(String::new(), |entry| entry.path.clone());
    let mut error = SceneError::new(kind, key, message, cure);
    error.line_column = start.map(|byte| line_column(text, byte));
    error
}
