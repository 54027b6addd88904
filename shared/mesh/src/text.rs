//! Walks through a text file token by token and keeps the line, so that every error can name it.
//!
//! Works on bytes: a comment in another encoding is no reason to refuse a mesh. `\n`, `\r\n` and a lone `\r` end a line.

use crate::error::{Place, ReadError, ReadErrorKind, quote};

/// A piece of text between white space, with the line on which it stands.
#[derive(Clone, Copy)]
pub(crate) struct Token<'a> {
    pub bytes: &'a [u8],
    pub line: usize,
}

impl Token<'_> {
    pub fn is(&self, word: &str) -> bool {
        self.bytes.eq_ignore_ascii_case(word.as_bytes())
    }

    pub fn shown(&self) -> String {
        quote(&String::from_utf8_lossy(self.bytes))
    }

    pub fn as_str(&self) -> Option<&str> {
        std::str::from_utf8(self.bytes).ok()
    }

    fn bad(&self, expected: &str) -> ReadError {
        let cure = if self.bytes.contains(&b',') {
            "write decimal points and blanks, no commas: export the mesh again with LC_ALL=C"
        } else {
            "correct this line, or export the mesh again"
        };
        ReadError::new(ReadErrorKind::BadNumber, Place::Line(self.line), self.shown(), expected, cure)
    }

    /// A number as C, Fortran (`1.5D-3`) or a spreadsheet's export (`+2.0`) writes it. NaN and infinity pass here.
    pub fn f64(&self, expected: &str) -> Result<f64, ReadError> {
        let text = self.as_str().ok_or_else(|| self.bad(expected))?;
        if let Ok(value) = text.parse() {
            return Ok(value);
        }
        text.replace(['D', 'd'], "e").parse().map_err(|_| self.bad(expected))
    }

    /// A whole number; `3.0` is one too, since some exporters write indices so.
    pub fn i64(&self, expected: &str) -> Result<i64, ReadError> {
        let text = self.as_str().ok_or_else(|| self.bad(expected))?;
        if let Ok(value) = text.parse() {
            return Ok(value);
        }
        /// Below this every whole number has its own f64.
        const EXACT: f64 = 9.0e15;
        match self.f64(expected) {
            Ok(value) if value.fract() == 0.0 && value.abs() < EXACT => Ok(value as i64),
            _ => Err(self.bad(expected)),
        }
    }
}

/// A place in a text file. `comment` starts a comment that runs to the end of its line.
pub(crate) struct Text<'a> {
    bytes: &'a [u8],
    at: usize,
    line: usize,
    comment: Option<u8>,
    ends_with: &'static str,
}

/// The file without the byte-order mark that some editors put first.
pub(crate) fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

impl<'a> Text<'a> {
    pub fn new(bytes: &'a [u8], comment: Option<u8>) -> Self {
        Text::at_line(without_mark(bytes), comment, 1)
    }

    /// For a piece of a file that starts on `line`.
    pub fn at_line(bytes: &'a [u8], comment: Option<u8>, line: usize) -> Self {
        Text { bytes, at: 0, line, comment, ends_with: "the end of the file" }
    }

    /// The next bytes as they are, whatever they mean.
    pub fn raw(&mut self, count: usize, what: &str) -> Result<&'a [u8], ReadError> {
        take(self.bytes, &mut self.at, count, what, "the file is cut short: copy or export it again")
    }

    /// Bytes before this place.
    pub fn at(&self) -> usize {
        self.at
    }

    pub fn place(&self) -> Place {
        Place::Line(self.line)
    }

    /// The next token, on whatever line, or `None` at the end of the file.
    pub fn token(&mut self) -> Option<Token<'a>> {
        loop {
            let byte = *self.bytes.get(self.at)?;
            if Some(byte) == self.comment {
                self.skip_line();
            } else if is_space(byte) {
                self.step(byte);
            } else {
                break;
            }
        }
        let rest = &self.bytes[self.at..];
        let ends = |&byte: &u8| is_space(byte) || Some(byte) == self.comment;
        let length = rest.iter().position(ends).unwrap_or(rest.len());
        self.at += length;
        Some(Token { bytes: &rest[..length], line: self.line })
    }

    /// The next token without taking it.
    pub fn peek(&mut self) -> Option<Token<'a>> {
        let (at, line) = (self.at, self.line);
        let token = self.token();
        (self.at, self.line) = (at, line);
        token
    }

    /// Goes to the start of the next line.
    pub fn skip_line(&mut self) {
        while let Some(&byte) = self.bytes.get(self.at) {
            self.step(byte);
            if byte == b'\n' || (byte == b'\r' && self.bytes.get(self.at) != Some(&b'\n')) {
                return;
            }
        }
    }

    /// The tokens left on this line, as a walk of its own; this one goes to the next line.
    pub fn rest_of_line(&mut self) -> Text<'a> {
        let (start, line) = (self.at, self.line);
        self.skip_line();
        let mut rest = Text::at_line(&self.bytes[start..self.at], self.comment, line);
        rest.ends_with = "the end of the line";
        rest
    }

    /// The tokens of the first line that is not blank.
    pub fn rest_of_first_line(&mut self) -> Text<'a> {
        while self.bytes.get(self.at).is_some_and(|&byte| is_space(byte)) {
            self.step(self.bytes[self.at]);
        }
        self.rest_of_line()
    }

    /// The next token, or an error that says what the file promised.
    pub fn need(&mut self, expected: &str) -> Result<Token<'a>, ReadError> {
        let ends_with = self.ends_with;
        let end = self.line;
        self.token().ok_or_else(|| {
            ReadError::new(
                ReadErrorKind::Truncated,
                Place::Line(end),
                ends_with,
                expected,
                "the file is cut short: copy or export it again",
            )
        })
    }

    /// Names the end of this text in errors: “the end of the array”.
    pub fn ending(mut self, ends_with: &'static str) -> Self {
        self.ends_with = ends_with;
        self
    }

    pub fn i64(&mut self, expected: &str) -> Result<i64, ReadError> {
        self.need(expected)?.i64(expected)
    }

    /// A count of things that take at least `bytes_each` bytes of text each. A count that the rest of the file cannot hold is an
    /// error, so that no claim makes a reader allocate more than the file's own size allows.
    pub fn count(&mut self, expected: &str, bytes_each: usize) -> Result<usize, ReadError> {
        let token = self.need(expected)?;
        let count = token.i64(expected)?;
        let left = self.bytes.len() - self.at;
        usize::try_from(count).ok().filter(|&n| n.saturating_mul(bytes_each) <= left + 1).ok_or_else(|| {
            ReadError::new(
                ReadErrorKind::AbsurdCount,
                Place::Line(token.line),
                format!("{} as {expected}", token.shown()),
                format!("a count that the {left} bytes left can hold"),
                "the file is cut short or its count is wrong: copy or export it again",
            )
        })
    }

    /// A point in the file's unit. Checked to be finite in single precision.
    pub fn point(&mut self, what: &str) -> Result<[f32; 3], ReadError> {
        let mut point = [0.0; 3];
        for (axis, coordinate) in ["x", "y", "z"].iter().zip(&mut point) {
            let token = self.need(what)?;
            *coordinate = narrow(token.f64(what)?, Place::Line(token.line), || format!("{} as {axis} of {what}", token.shown()))?;
        }
        Ok(point)
    }

    fn step(&mut self, byte: u8) {
        self.at += 1;
        if byte == b'\n' || (byte == b'\r' && self.bytes.get(self.at) != Some(&b'\n')) {
            self.line += 1;
        }
    }
}

/// So many bytes from a place on, which lies behind them then; with this cure where there are fewer.
pub(crate) fn take<'a>(bytes: &'a [u8], at: &mut usize, count: usize, what: &str, cure: &str) -> Result<&'a [u8], ReadError> {
    let taken = bytes[*at..]
        .get(..count)
        .ok_or_else(|| ReadError::new(ReadErrorKind::Truncated, Place::Byte(*at), "the end of the file", what, cure))?;
    *at += count;
    Ok(taken)
}

/// A coordinate in single precision, if it is finite there.
pub(crate) fn narrow(value: f64, place: Place, found: impl Fn() -> String) -> Result<f32, ReadError> {
    let narrow = value as f32;
    if narrow.is_finite() {
        return Ok(narrow);
    }
    Err(ReadError::new(
        ReadErrorKind::NotFinite,
        place,
        found(),
        "a finite coordinate below 3.4e38",
        "correct the coordinate, or mesh again: the program that wrote the file has failed there",
    ))
}

fn is_space(byte: u8) -> bool {
    byte.is_ascii_whitespace() || byte == 0x0b
}
