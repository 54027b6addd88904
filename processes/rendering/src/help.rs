//! The help over the picture: which keys there are and what the mouse does, written from the table that the window acts by.
use winit::keyboard::KeyCode;

use crate::input::{Key, MOTIONS, Mouse, SWITCHES, bindings};

/// The lines of the help, each as long as the others; of what moves and sets only what the window gives, a bit of
/// [`WINDOW_ALL`](hyst_messages::controls::WINDOW_ALL) each.
pub fn help(given: u32) -> Vec<String> {
    let motions = MOTIONS.iter().filter(|motion| given & motion.bit != 0);
    let motions = motions.map(|motion| (names(&motion.keys), format!("{}; {}", motion.does, motion.mouse.name())));
    let switches = SWITCHES.iter().filter(|switch| switch.bit == 0 || given & switch.bit != 0);
    let switches = switches.map(|switch| (names(switch.keys), switch.does.to_string()));
    let rows: Vec<(String, String)> = motions.chain(switches).collect();
    let left = rows.iter().map(|(keys, _)| keys.len()).max().unwrap_or(0);
    let right = rows.iter().map(|(_, does)| does.len()).max().unwrap_or(0);
    rows.iter().map(|(keys, does)| format!("{keys:<left$}  {does:<right$}")).collect()
}

/// How to come to the help.
pub fn help_hint() -> String {
    let place = bindings().find(|(_, key)| *key == Key::Help).map(|(code, _)| name(code));
    format!("{} help", place.unwrap_or_default())
}

impl Mouse {
    fn name(self) -> String {
        match self {
            Mouse::DragUp(button) | Mouse::DragRight(button) => format!("{button:?} drag").to_lowercase(),
            Mouse::Wheel => "wheel".into(),
        }
    }
}

fn names(keys: &[(KeyCode, Key)]) -> String {
    keys.iter().map(|(code, _)| name(*code)).collect::<Vec<_>>().join(" ")
}

/// What stands on the key.
fn name(code: KeyCode) -> String {
    match code {
        KeyCode::PageUp => "PgUp".into(),
        KeyCode::PageDown => "PgDn".into(),
        KeyCode::Escape => "Esc".into(),
        _ => {
            let text = format!("{code:?}");
            ["Key", "Arrow"].iter().find_map(|front| text.strip_prefix(front)).map_or(text.clone(), String::from)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::overlay::{COLUMNS, ROWS};
    use hyst_messages::controls::{WINDOW_ALL, WINDOW_HEAD, WINDOW_LIGHT};

    #[test]
    fn the_help_names_every_key_and_the_mouse_once_and_fits() {
        let lines = help(WINDOW_ALL);
        let words: Vec<&str> = lines.iter().flat_map(|line| line.split("  ").next().unwrap_or_default().split(' ')).collect();
        for (code, key) in bindings() {
            assert_eq!(words.iter().filter(|word| **word == name(code)).count(), 1, "{key:?} in {words:?}");
        }
        assert_eq!(words.len(), bindings().count(), "a word that is no key: {words:?}");
        for mouse in ["left drag", "right drag", "wheel"] {
            assert!(lines.iter().any(|line| line.contains(mouse)), "{mouse}");
        }
        // Beside it five lines of the strip, that of the test mode among them, the pump's notice, its alarms and a role that is held still, of two rows each, a
        // gap, the sign.
        let alarms = hyst_messages::PUMP_ALARMS.len() - hyst_messages::PUMP_NOTICES.count_ones() as usize + 1;
        assert!(lines.len() + 6 + 2 * alarms + 2 <= ROWS && lines.iter().all(|line| line.len() <= COLUMNS), "{lines:#?}");
        assert!(lines.iter().all(|line| line.len() == lines[0].len()));
    }

    #[test]
    fn the_handbook_has_each_key_and_each_alarm() {
        let handbook = include_str!("../../../docs/handbook.md");
        let keys = MOTIONS.iter().map(|motion| motion.does).chain(SWITCHES.iter().map(|switch| switch.does));
        for does in keys {
            assert!(handbook.contains(&format!("{does} |")) || handbook.contains(&format!("{does};")), "{does}");
        }
        for (_, alarm) in hyst_messages::PUMP_ALARMS {
            assert!(handbook.contains(&format!("| {alarm} |")), "{alarm}");
        }
    }

    #[test]
    fn where_the_hand_is_not_the_windows_the_help_has_only_what_changes_the_picture() {
        let left = ["V M         view from outside; its meshes   ", "F1 F11 Esc  this help; full screen, and back"];
        assert_eq!(help(0), left);
        assert_eq!(help_hint(), "F1 help");
    }

    #[test]
    fn beside_a_device_the_help_has_what_the_device_lacks() {
        let lines = help(WINDOW_HEAD | WINDOW_LIGHT);
        let keys: Vec<&str> = lines.iter().filter_map(|line| line.split("  ").next()).collect();
        assert_eq!(keys, ["Z C", "T", "V M", "F1 F11 Esc"], "{lines:?}");
    }
}
