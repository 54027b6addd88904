//! Why a scene could not be read or loaded: which file, which line, which key, what is wrong, what to do.

use std::fmt;

/// What kind of fault it is, for a caller that decides by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SceneErrorKind {
    /// A file is missing or cannot be read.
    Missing,
    /// A file is larger than any that is read here.
    TooLarge,
    /// The scene is not well-formed TOML, or a value has another type than its key asks for.
    Syntax,
    /// A key that no scene has.
    UnknownKey,
    /// The scene was written for another version.
    Version,
    /// A number outside its range, NaN or infinite.
    Range,
    /// Something that every scene needs is not there: a deformable, a rigid.
    Incomplete,
    /// Two objects of one name, or a name that nothing has, or a circle of attachments.
    Name,
    /// A mesh cannot be read.
    Mesh,
    /// A mesh is read, but no simulation can be made of it.
    BadMesh,
    /// An organ larger or smaller than any organ.
    Size,
    /// A surface that does not lie on its tets, or an object that does not touch what it is attached to.
    Apart,
    /// Goals, rules and ends of a case that cannot all be kept.
    Contradiction,
}

/// Why a scene could not be read or loaded. Its text is one line: where, what, what to do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct SceneError {
    /// What kind of fault it is.
    pub kind: SceneErrorKind,
    /// The file: of the scene, or of the mesh that it names.
    pub origin: String,
    /// Line and column of the scene's text, counted from 1.
    pub line_column: Option<(usize, usize)>,
    /// The key, with its tables, as `deformable[0].material.poisson_ratio`; empty if it concerns none.
    pub key: String,
    /// What is wrong.
    pub what: Box<str>,
    /// What to do.
    pub cure: Box<str>,
}

impl fmt::Display for SceneError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}", self.origin)?;
        if let Some((line, column)) = self.line_column {
            write!(out, ":{line}:{column}")?;
        }
        write!(out, ": ")?;
        if !self.key.is_empty() {
            write!(out, "{}: ", self.key)?;
        }
        write!(out, "{}; {}", self.what, self.cure)
    }
}

impl SceneError {
    pub(crate) fn new(kind: SceneErrorKind, key: impl Into<String>, what: impl Into<String>, cure: impl Into<String>) -> Self {
        SceneError {
            kind,
            origin: String::new(),
            line_column: None,
            key: key.into(),
            what: what.into().into_boxed_str(),
            cure: cure.into().into_boxed_str(),
        }
    }

    /// The same error, said of this file.
    pub(crate) fn at(mut self, origin: &str) -> Self {
        if self.origin.is_empty() {
            self.origin = origin.to_owned();
        }
        self
    }

    /// The same error, with the place of its key in the scene's text.
    pub(crate) fn located(mut self, origin: &str, text: &str) -> Self {
        if self.origin.is_empty() && self.line_column.is_none() {
            self.line_column = crate::parse::line_column_of_key(text, &self.key);
        }
        self.at(origin)
    }
}
