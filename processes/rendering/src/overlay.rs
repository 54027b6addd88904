//! The strip of text over the picture: pressure, flow, deficit, time, and a discreet sign when a process was replaced.
//!
//! Promise: any text is accepted; letters with marks are written without them, what has no glyph then shows as a box, and what does not fit is left out.
use crate::font;

/// Characters per row.
pub const COLUMNS: usize = 48;
/// Characters of an alarm, whose letters are twice as wide and high.
pub const ALARM_COLUMNS: usize = COLUMNS / 2;
/// Rows of text, the sign included; an alarm takes two.
pub const ROWS: usize = 32;
/// From the edge of the picture to the text, px, as `post.wgsl` has it.
pub(crate) const EDGE_PX: u32 = 6;
/// Words of the glyph buffer: two per glyph, then one code per cell.
pub(crate) const WORDS: usize = 256 + COLUMNS * ROWS;

/// How a line begins that is to stand out.
pub const ALARM: &str = "ALARM";
/// Bits of a cell, beyond the code, as `post.wgsl` has them: it is written as the sign is; it holds a quarter of a large character, that on the right, the
/// lower one.
const IN_AMBER: u32 = 128;
const LARGE: u32 = 256;
const RIGHT: u32 = 512;
const LOWER: u32 = 1024;

/// What is written over the picture.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Overlay {
    /// from the top left, one row each; in amber and twice as large those that begin with [`ALARM`]
    pub lines: Vec<String>,
    /// under the lines, in amber; empty: none
    pub sign: String,
}

/// Rows that a line takes.
fn height(line: &str) -> usize {
    if line.starts_with(ALARM) { 2 } else { 1 }
}

impl Overlay {
    /// The lines that fit, each with its first row, and the row after them.
    fn placed(&self) -> (Vec<(usize, &str)>, usize) {
        let (room, mut end, mut placed) = (ROWS - usize::from(!self.sign.is_empty()), 0, Vec::new());
        for line in self.lines.iter().map(String::as_str) {
            if end + height(line) > room {
                break;
            }
            placed.push((end, line));
            end += height(line);
        }
        (placed, end)
    }

    /// Rows in use, of which the sign's is the last.
    pub(crate) fn rows(&self) -> usize {
        self.placed().1 + usize::from(!self.sign.is_empty())
    }

    /// Codes of all cells, row by row, into the words behind the glyphs; 0 is an empty cell.
    pub(crate) fn write(&self, words: &mut [u32; WORDS]) {
        let cells = &mut words[256..];
        cells.fill(0);
        let (placed, end) = self.placed();
        for (row, line) in placed.into_iter().chain((!self.sign.is_empty()).then_some((end, self.sign.as_str()))) {
            let size = if row < end { height(line) } else { 1 };
            for (at, c) in font::spelled(line).chars().take(COLUMNS / size).enumerate() {
                let first = row * COLUMNS + size * at;
                match size {
                    1 => cells[first] = font::code(c),
                    _ => {
                        for (cell, quarter) in [(0, 0), (1, RIGHT), (COLUMNS, LOWER), (COLUMNS + 1, RIGHT | LOWER)] {
                            cells[first + cell] = font::code(c) | IN_AMBER | LARGE | quarter;
                        }
                    }
                }
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
    fn an_alarm_stands_out_over_two_rows_each_of_its_letters_in_four_cells() {
        let lines = ["flow", "ALARM  deficit", "force"].map(String::from).to_vec();
        let overlay = Overlay { lines, sign: "replaced".into() };
        let mut words = blank();
        overlay.write(&mut words);
        let cell = |row: usize, column: usize| words[256 + row * COLUMNS + column];
        let large = |c: u8, quarter: u32| u32::from(c) | IN_AMBER | LARGE | quarter;
        assert_eq!((overlay.rows(), cell(0, 0), cell(3, 0), cell(4, 0)), (5, u32::from(b'f'), u32::from(b'f'), u32::from(b'r')));
        assert_eq!([cell(1, 0), cell(1, 1), cell(2, 0)], [large(b'A', 0), large(b'A', RIGHT), large(b'A', LOWER)]);
        assert_eq!([cell(2, 1), cell(1, 2)], [large(b'A', RIGHT | LOWER), large(b'L', 0)]);
    }

    #[test]
    fn what_does_not_fit_is_left_out_whole_and_the_sign_stays() {
        for (alarms, sign, rows) in [(ROWS, "", ROWS), (ROWS, "!", ROWS - 1), (3, "!", 7)] {
            let overlay = Overlay { lines: vec!["ALARM".repeat(30); alarms], sign: sign.into() };
            let mut words = blank();
            overlay.write(&mut words);
            assert_eq!(overlay.rows(), rows, "{alarms} alarms: {sign:?}");
            assert_eq!(words[256 + (rows - 1) * COLUMNS] & 127, u32::from(if sign.is_empty() { b'A' } else { b'!' }));
        }
    }

    /// Of a case's words in German every third was one with a box in it.
    #[test]
    fn letters_with_marks_are_written_without_them_and_those_of_other_scripts_as_boxes() {
        assert_eq!(font::spelled("Größe des Müoms: naïve, 5 µl, 70°"), "Groesse des Mueoms: naive, 5 ul, 70 deg");
        let overlay = Overlay { lines: vec!["äß中".into()], sign: String::new() };
        let mut words = blank();
        overlay.write(&mut words);
        let written: Vec<u32> = "aess".bytes().map(u32::from).chain([127, 0]).collect();
        assert_eq!(words[256..262], written);
    }

    #[test]
    fn every_printable_character_has_its_own_ink() {
        let mut seen = std::collections::BTreeSet::new();
        for code in 33..127_u32 {
            let rows = font::rows(code);
            assert!(rows.iter().any(|&r| r != 0), "{:?} is blank", char::from_u32(code));
            assert!(seen.insert(rows), "{:?} looks like another", char::from_u32(code));
        }
        assert_eq!(font::code('中'), font::code('\u{7}'));
    }
}
