//! What the window's keys switch in the picture itself: the camera and the help. They hold over a display or a device that is lost.

use hyst_messages::controls::FOCUS_M;
use rendering::{Key, PointerInput, help, help_hint};

/// How they stand.
#[derive(Clone, Copy, Debug)]
pub struct Switches {
    /// The view from outside is shown.
    pub external: bool,
    help: bool,
}

impl Switches {
    /// As the settings begin.
    pub fn new(external: bool) -> Switches {
        Switches { external, help: false }
    }

    /// Takes what was pressed.
    pub fn press(&mut self, input: &PointerInput) {
        self.external ^= input.was_pressed(Key::External);
        self.help ^= input.was_pressed(Key::Help);
    }

    /// The lines under the strip of a window, with the focus, m, if it is not the usual one; `given`: what keys and mouse move and set, a bit of
    /// [`WINDOW_ALL`](hyst_messages::controls::WINDOW_ALL) each.
    pub fn lines(&self, given: u32, focus_m: f32) -> Vec<String> {
        match self.help {
            true => [String::new()].into_iter().chain(help(given)).collect(),
            false if (focus_m / FOCUS_M - 1.0).abs() < 0.05 => vec![help_hint()],
            false => vec![format!("{}   focus {:.0} mm", help_hint(), focus_m * 1e3)],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::controls::WINDOW_ALL;

    fn press(key: Key) -> PointerInput {
        PointerInput { pressed: key.bit(), held: key.bit(), ..PointerInput::default() }
    }

    #[test]
    fn f1_brings_the_help_and_takes_it_away_and_no_other_key_does() {
        let mut switches = Switches::new(false);
        assert_eq!(switches.lines(WINDOW_ALL, FOCUS_M), ["F1 help"]);
        for key in Key::all().filter(|key| *key != Key::Help) {
            switches.press(&press(key));
            assert_eq!(switches.lines(WINDOW_ALL, FOCUS_M).len(), 1, "{key:?}");
        }
        switches.press(&press(Key::Help));
        switches.press(&PointerInput { held: Key::Help.bit(), ..PointerInput::default() });
        let lines = switches.lines(WINDOW_ALL, FOCUS_M);
        assert!(lines[0].is_empty() && lines[1..] == help(WINDOW_ALL), "after a gap: {lines:?}");
        assert!(switches.lines(0, FOCUS_M).len() < lines.len());
        switches.press(&press(Key::Help));
        assert_eq!(switches.lines(WINDOW_ALL, FOCUS_M), ["F1 help"]);
    }

    #[test]
    fn the_focus_is_told_where_it_is_not_the_usual_one() {
        let switches = Switches::new(false);
        assert_eq!(switches.lines(WINDOW_ALL, 0.0174), ["F1 help   focus 17 mm"]);
        assert_eq!(switches.lines(0, FOCUS_M * 1.01), ["F1 help"]);
    }

    #[test]
    fn the_camera_changes_with_its_key() {
        let mut switches = Switches::new(true);
        switches.press(&press(Key::External));
        assert!(!switches.external);
        switches.press(&press(Key::External));
        assert!(switches.external);
    }
}
