//! The strip of text over the picture: pressure, flow, deficit, time, and a discreet sign when a process was replaced.
//!
//! Promise: any text is accepted; characters without a glyph show as a box, what does not fit is left out.
use crate::font;

/// Characters per row.
pub const COLUMNS: usize = 48;
/// Rows of text, the sign included.
pub const ROWS: usize = 26;
/// From the edge of the picture to the text, px, as `post.wgsl` has it.
pub(crate) const EDGE_PX: u32 = 6;
/// Words of the glyph buffer: two per glyph, then one code per cell.
pub(crate) const WORDS: usize = 256 + COLUMNS * ROWS;

/// How a line begins that is to stand out.
pub const ALARM: &str = "ALARM";
/// Bit of a cell, beyond the code, that is written as the sign is.
const IN_AMBER: u32 = 128;

/// What is written over the picture.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Overlay {
    /// from the top left, one row each; in amber those that begin with [`ALARM`]
    pub lines: Vec<String>,
    /// under the lines, in amber; empty: none
    pub sign: String,
}

impl Overlay {
    /// Rows in use.
    pub(crate) fn rows(&self) -> usize {
        if self.sign.is_empty() { self.lines.len().min(ROWS) } else { self.lines.len().min(ROWS - 1) + 1 }
    }

    /// Codes of all cells, row by row, into the words behind the glyphs; 0 is an empty cell.
    pub(crate) fn write(&self, words: &mut [u32; WORDS]) {
        let cells = &mut words[256..];
        cells.fill(0);
        let sign = (!self.sign.is_empty()).then_some(&self.sign);
        let lines = self.lines.iter().take(ROWS - usize::from(sign.is_some()));
        for (row, line) in lines.chain(sign).enumerate() {
            let amber = if line.starts_with(ALARM) { IN_AMBER } else { 0 };
            for (column, c) in line.chars().take(COLUMNS).enumerate() {
                cells[row * COLUMNS + column] = font::code(c) | amber;
            }
        }
    }
}

/// The glyphs and an empty text.
pub(crate) fn blank() -> [u32; WORDS] {
    let mut words = [0; WORDS];
    for code in 0..128_u32 {
        let rows = font::rows(code);
        words[2 * code as usize] = u32::from_le_bytes([rows[0], rows[1], rows[2], rows[3]]);
        words[2 * code as usize + 1] = u32::from_le_bytes([rows[4], rows[5], rows[6], rows[7]]);
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sign_comes_last_and_too_much_text_is_left_out() {
        let overlay = Overlay { lines: vec!["x".repeat(500); 40], sign: "TISSUE REPLACED".into() };
        let mut words = blank();
        overlay.write(&mut words);
        assert_eq!(overlay.rows(), ROWS);
        assert_eq!(words[256 + (ROWS - 1) * COLUMNS], u32::from(b'T'));
        assert_eq!(words[256 + (ROWS - 1) * COLUMNS + 15], 0);
        assert_eq!(words[256 + COLUMNS - 1], u32::from(b'x'));
    }

    #[test]
    fn an_alarm_stands_out() {
        let overlay = Overlay { lines: vec!["flow".into(), "ALARM    deficit".into()], sign: String::new() };
        let mut words = blank();
        overlay.write(&mut words);
        assert_eq!((words[256], words[256 + COLUMNS]), (u32::from(b'f'), u32::from(b'A') | IN_AMBER));
    }

    #[test]
    fn every_printable_character_has_its_own_ink() {
        let mut seen = std::collections::BTreeSet::new();
        for code in 33..127_u32 {
            let rows = font::rows(code);
            assert!(rows.iter().any(|&r| r != 0), "{:?} is blank", char::from_u32(code));
            assert!(seen.insert(rows), "{:?} looks like another", char::from_u32(code));
        }
        assert_eq!(font::code('é'), font::code('\u{7}'));
    }
}
