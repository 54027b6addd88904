//! The terminal, as one draws on it again and again. A line that is longer than it is wide takes two of its rows, and a text that is taller scrolls it: drawn
//! over twice a second, that leaves neither a table nor what stood above it.
//!
//! Promise: what is drawn fits, and says where a line was cut, so that no part of a number is taken for the whole one. A terminal that does not say how large
//! it is has room for everything.

use std::io::IsTerminal;

/// The end of a line that was cut.
const CUT: char = '>';

/// Rows and columns of a terminal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    columns: usize,
    rows: usize,
}

impl Size {
    /// That of the standard output now.
    pub fn now() -> Size {
        let said = rustix::termios::tcgetwinsize(std::io::stdout()).ok();
        Size::of(said.map_or([0, 0], |said| [said.ws_col, said.ws_row]))
    }

    fn of(said: [u16; 2]) -> Size {
        let [columns, rows] = said.map(|cells| if cells == 0 { usize::MAX } else { usize::from(cells) });
        Size { columns, rows }
    }
}

/// Whether the standard output is a terminal that one can draw on.
pub fn can_be_drawn_on() -> bool {
    std::io::stdout().is_terminal() && std::env::var_os("TERM").is_none_or(|kind| kind != "dumb")
}

/// A text, news and a text below them, drawn over what was there. Where there is no room for all of it the oldest news are left out, and then what comes last.
pub fn screen(above: &str, news: &[String], below: &str, size: Size) -> String {
    // In the last row stands the cursor.
    let rows = size.rows.saturating_sub(1).max(1);
    let room = rows.saturating_sub(above.lines().count() + below.lines().count()).max(1);
    let news: Vec<&str> = news.iter().flat_map(|text| text.lines()).collect();
    let newest = news.iter().copied().skip(news.len().saturating_sub(room));
    let lines = above.lines().chain(newest).chain(below.lines()).take(rows);
    let drawn: String = lines.map(|line| format!("{}\x1b[K\n", cut(line, size.columns))).collect();
    format!("\x1b[H{drawn}\x1b[J")
}

fn cut(line: &str, columns: usize) -> String {
    if line.chars().count() <= columns {
        return line.to_string();
    }
    line.chars().take(columns.saturating_sub(1)).chain([CUT]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn(columns: u16, rows: u16) -> Vec<String> {
        let news: Vec<String> = (1..=8).map(|number| format!("event {number}")).collect();
        let screen = screen("a table of 24 columns: 1\n\nits row 999.5\n", &news, "\nCtrl-C\n", Size::of([columns, rows]));
        let text = screen.strip_prefix("\x1b[H").unwrap().strip_suffix("\x1b[J").unwrap();
        assert!(text.split_terminator('\n').all(|line| line.ends_with("\x1b[K")), "{text:?}");
        text.replace("\x1b[K", "").lines().map(str::to_string).collect()
    }

    /// In a terminal of 80 × 24 the table of a station scrolled away twice a second.
    #[test]
    fn what_is_drawn_has_no_more_rows_and_columns_than_there_are() {
        for columns in 1..=40 {
            for rows in 2..=20 {
                let drawn = drawn(columns, rows);
                assert!(drawn.len() < usize::from(rows), "{columns} × {rows}: {drawn:?}");
                assert!(drawn.iter().all(|line| line.chars().count() <= usize::from(columns)), "{columns} × {rows}: {drawn:?}");
            }
        }
    }

    #[test]
    fn the_oldest_news_go_first_and_a_number_that_is_cut_is_seen_to_be() {
        let whole = drawn(0, 0);
        assert_eq!((whole.len(), whole[0].as_str()), (13, "a table of 24 columns: 1"));
        assert_eq!(drawn(24, 14), whole, "it fits");
        let fewer = drawn(80, 9);
        assert_eq!(fewer[3..], ["event 6", "event 7", "event 8", "", "Ctrl-C"].map(String::from));
        assert_eq!(drawn(80, 5)[2..], ["its row 999.5", "event 8"].map(String::from));
        assert_eq!(drawn(11, 14)[2], "its row 99>");
        assert_eq!(Size::of([80, 24]), Size { columns: 80, rows: 24 });
    }
}
