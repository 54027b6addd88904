//! Why a file could not be read: where, what was found, what was expected, what to do.

use std::fmt;

/// Where in the input an error was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A line of a text file, counted from 1.
    Line(usize),
    /// A byte of the file, counted from 0.
    Byte(usize),
    /// The file as a whole.
    File,
}

impl fmt::Display for Place {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Line(line) => write!(out, "line {line}"),
            Place::Byte(byte) => write!(out, "byte {byte}"),
            Place::File => write!(out, "the file"),
        }
    }
}

/// What kind of fault it is, for a caller that decides by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReadErrorKind {
    /// Neither the name nor the content is of a format that is read here.
    UnknownFormat,
    /// A known format in a form that is not read here (binary, compressed, other version).
    Unsupported,
    /// The file ends before what it announced.
    Truncated,
    /// Something other than a number where a number belongs, one out of its range, or one that would be the same as another.
    BadNumber,
    /// A coordinate that is NaN, infinite, or too large for single precision.
    NotFinite,
    /// A count that the rest of the file cannot hold.
    AbsurdCount,
    /// Two nodes with one tag.
    DuplicateNode,
    /// An element names a node that the file does not hold.
    MissingNode,
    /// The file's structure is not that of its format.
    Syntax,
    /// The file is read well, but holds no tetrahedron (or no triangle).
    Empty,
}

/// Why a file could not be read. Its text is one line that says where, what and what to do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{place}: found {found}, expected {expected}; {cure}")]
pub struct ReadError {
    /// What kind of fault it is.
    pub kind: ReadErrorKind,
    /// Where it is.
    pub place: Place,
    /// What stands there (shortened).
    pub found: String,
    /// What should stand there.
    pub expected: String,
    /// What the user can do.
    pub cure: String,
}

/// Longest piece of the input that is repeated in a message, in characters: enough to find it, too short to flood a terminal.
const QUOTE_CHARS: usize = 40;

/// A piece of the input as a message shows it: quoted, shortened, without control characters.
pub(crate) fn quote(text: &str) -> String {
    let mut shown: String = text.chars().take(QUOTE_CHARS).map(|c| if c.is_control() { '·' } else { c }).collect();
    if text.chars().nth(QUOTE_CHARS).is_some() {
        shown.push('…');
    }
    format!("“{shown}”")
}

impl ReadError {
    pub(crate) fn new(
        kind: ReadErrorKind,
        place: Place,
        found: impl Into<String>,
        expected: impl Into<String>,
        cure: impl Into<String>,
    ) -> Self {
        ReadError { kind, place, found: found.into(), expected: expected.into(), cure: cure.into() }
    }
}
