//! Text from outside on its way to a page or a terminal, and what the pages have in common.

/// Most characters of a sentence out of a recording that are shown.
const MOST_CHARACTERS: usize = 300;

/// Text that can stand in XML and HTML.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            // What XML 1.0 forbids altogether.
            '\u{fffe}' | '\u{ffff}' => out.push('\u{fffd}'),
            control if control.is_control() && !matches!(control, '\n' | '\t') => out.push('\u{fffd}'),
            other => out.push(other),
        }
    }
    out
}

/// The beginning of a table of this name that is moved sideways where it is wider than the page, by the keys, too; `</table></div>` ends it.
pub fn wide_table(name: &str) -> String {
    format!("{}<table>", wide(name))
}

/// The same of anything else; `</div>` ends it.
pub(crate) fn wide(name: &str) -> String {
    format!("<div class=\"wide\" tabindex=\"0\" role=\"region\" aria-label=\"{}\">", escape(name))
}

/// One line that no terminal obeys, and that is not endless.
pub fn plain(text: &str) -> String {
    let mut characters = text.chars();
    let mut out: String =
        characters.by_ref().take(MOST_CHARACTERS).map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect();
    if characters.next().is_some() {
        out.push('…');
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_and_escape_sequences_are_only_text() {
        assert_eq!(escape("<a href='x'>&\"\u{1b}"), "&lt;a href=&#39;x&#39;&gt;&amp;&quot;\u{fffd}");
        assert_eq!(escape("\u{0}\r\u{85}\u{fffe}\u{ffff}\n\t\u{fffd}"), "\u{fffd}\u{fffd}\u{fffd}\u{fffd}\u{fffd}\n\t\u{fffd}");
        assert_eq!(plain("\u{1b}[2J\nü"), "\u{fffd}[2J\u{fffd}ü");
        assert_eq!(plain(&"x".repeat(301)).chars().count(), 301);
        assert!(plain(&"x".repeat(301)).ends_with('…') && !plain(&"x".repeat(300)).ends_with('…'));
    }
}
