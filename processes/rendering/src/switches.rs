//! What the window's keys switch in the picture itself: the camera, its focus and the help. They hold over a display or a device that is lost.

use rendering::{FOCUS_M, FOCUS_RANGE_M, Key, PointerInput, help, help_hint};

/// What a key makes of the distance that is sharp, as a share: a turn of the ring that one sees.
const FOCUS_STEP: f32 = 1.15;

/// How they stand.
#[derive(Clone, Copy, Debug)]
pub struct Switches {
    /// The view from outside is shown.
    pub external: bool,
    /// Distance from the lens that is sharp, m.
    pub focus_m: f32,
    help: bool,
}

impl Switches {
    /// As the settings begin.
    pub fn new(external: bool, focus_m: f32) -> Switches {
        Switches { external, focus_m, help: false }
    }

    /// Takes what was pressed.
    pub fn press(&mut self, input: &PointerInput) {
        self.external ^= input.was_pressed(Key::External);
        self.help ^= input.was_pressed(Key::Help);
        for (key, factor) in [(Key::FocusNear, 1.0 / FOCUS_STEP), (Key::FocusFar, FOCUS_STEP)] {
            if input.was_pressed(key) {
                self.focus_m = (self.focus_m * factor).clamp(FOCUS_RANGE_M[0], FOCUS_RANGE_M[1]);
            }
        }
    }

    /// The lines under the strip of a window, with the focus if it is not the usual one; `has_hand`: keys and mouse also move the scope.
    pub fn lines(&self, has_hand: bool) -> Vec<String> {
        match self.help {
            true => [String::new()].into_iter().chain(help(has_hand)).collect(),
            false if (self.focus_m / FOCUS_M - 1.0).abs() < 0.05 => vec![help_hint()],
            false => vec![format!("{}   focus {:.0} mm", help_hint(), self.focus_m * 1e3)],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn press(key: Key) -> PointerInput {
        PointerInput { pressed: key.bit(), held: key.bit(), ..PointerInput::default() }
    }

    #[test]
    fn f1_brings_the_help_and_takes_it_away_and_no_other_key_does() {
        let mut switches = Switches::new(false, FOCUS_M);
        assert_eq!(switches.lines(true), ["F1 help"]);
        for key in Key::all().filter(|key| ![Key::Help, Key::FocusNear, Key::FocusFar].contains(key)) {
            switches.press(&press(key));
            assert_eq!(switches.lines(true).len(), 1, "{key:?}");
        }
        switches.press(&press(Key::Help));
        switches.press(&PointerInput { held: Key::Help.bit(), ..PointerInput::default() });
        let lines = switches.lines(true);
        assert!(lines[0].is_empty() && lines[1..] == help(true), "after a gap: {lines:?}");
        assert!(switches.lines(false).len() < lines.len());
        switches.press(&press(Key::Help));
        assert_eq!(switches.lines(true), ["F1 help"]);
    }

    #[test]
    fn the_focus_goes_by_its_keys_within_its_range_and_is_told_where_it_is_not_the_usual_one() {
        let mut switches = Switches::new(false, FOCUS_M);
        switches.press(&press(Key::FocusNear));
        assert!((switches.focus_m - 0.0174).abs() < 1e-4, "{switches:?}");
        assert_eq!(switches.lines(true), ["F1 help   focus 17 mm"]);
        switches.press(&press(Key::FocusFar));
        assert_eq!(switches.lines(true), ["F1 help"]);
        for (key, end_m) in [(Key::FocusNear, FOCUS_RANGE_M[0]), (Key::FocusFar, FOCUS_RANGE_M[1])] {
            (0..40).for_each(|_| switches.press(&press(key)));
            assert_eq!(switches.focus_m, end_m, "{key:?}");
        }
    }

    #[test]
    fn the_camera_changes_with_its_key() {
        let mut switches = Switches::new(true, FOCUS_M);
        switches.press(&press(Key::External));
        assert!(!switches.external);
        switches.press(&press(Key::External));
        assert!(switches.external);
    }
}
