//! What the window's keys switch in the picture itself: the camera and the help. They hold over a display or a device that is lost.

use hyst_messages::controls::{FOCUS_M, WINDOW_POSE};
use rendering::{External, Key, PointerInput, help, help_hint};

/// How they stand.
#[derive(Clone, Copy, Debug)]
pub struct Switches {
    /// The view from outside is shown.
    pub external: bool,
    /// With the lines of the meshes there.
    meshes: bool,
    help: bool,
    /// How far the eye outside has been turned about the organ and raised, rad, and its distance as a share of the usual one.
    orbit: [f32; 3],
}

/// How near and how far the eye outside goes, as shares of the usual distance.
const DISTANCES: [f32; 2] = [0.3, 3.0];
/// How much nearer it comes for each metre that a scope would go in.
const NEARER_PER_M: f32 = 20.0;

impl Switches {
    /// As the settings begin.
    pub fn new(external: bool) -> Switches {
        Switches { external, meshes: false, help: false, orbit: [0.0, 0.0, 1.0] }
    }

    /// Takes what was pressed. Keys and mouse that move no scope, which `given` says as in [`Switches::lines`], move the eye outside.
    pub fn press(&mut self, input: &PointerInput, given: u32) {
        self.external ^= input.was_pressed(Key::External);
        self.meshes ^= input.was_pressed(Key::Meshes);
        self.help ^= input.was_pressed(Key::Help);
        if self.external && given & WINDOW_POSE == 0 {
            let [turn_rad, rise_rad, distance] = self.orbit;
            let distance = distance * (1.0 - NEARER_PER_M * input.insertion_m).clamp(0.5, 2.0);
            self.orbit = [
                (turn_rad - 2.0 * input.yaw_rad).rem_euclid(std::f32::consts::TAU),
                (rise_rad + 2.0 * input.pitch_rad).clamp(-1.7, 1.2),
                distance.clamp(DISTANCES[0], DISTANCES[1]),
            ];
        }
    }

    /// Whether the lines of the meshes are wanted.
    pub fn has_lines(&self) -> bool {
        self.external && self.meshes
    }

    /// The eye outside.
    pub fn outside(&self) -> External {
        let [turn_rad, rise_rad, distance] = self.orbit;
        External::default().orbited(turn_rad, rise_rad, distance)
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
            switches.press(&press(key), WINDOW_ALL);
            assert_eq!(switches.lines(WINDOW_ALL, FOCUS_M).len(), 1, "{key:?}");
        }
        switches.press(&press(Key::Help), WINDOW_ALL);
        switches.press(&PointerInput { held: Key::Help.bit(), ..PointerInput::default() }, WINDOW_ALL);
        let lines = switches.lines(WINDOW_ALL, FOCUS_M);
        assert!(lines[0].is_empty() && lines[1..] == help(WINDOW_ALL), "after a gap: {lines:?}");
        assert!(switches.lines(0, FOCUS_M).len() < lines.len());
        switches.press(&press(Key::Help), WINDOW_ALL);
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
        switches.press(&press(Key::External), 0);
        assert!(!switches.external);
        switches.press(&press(Key::External), 0);
        assert!(switches.external);
    }

    #[test]
    fn what_moves_no_scope_turns_the_eye_outside_and_only_there() {
        let pull = PointerInput { yaw_rad: 0.25, pitch_rad: 0.1, insertion_m: 0.005, ..PointerInput::default() };
        let usual = External::default();
        let mut switches = Switches::new(true);
        switches.press(&pull, WINDOW_ALL);
        assert_eq!(switches.outside().eye_m, usual.orbited(0.0, 0.0, 1.0).eye_m, "the scope moves");
        switches.press(&pull, 0);
        assert_eq!(switches.outside(), usual.orbited(std::f32::consts::TAU - 0.5, 0.2, 0.9));
        for _ in 0..1_000 {
            switches.press(&pull, 0);
        }
        let far_m = |eye: External| glam::Vec3::from(eye.eye_m).distance(glam::Vec3::from(eye.target_m));
        assert!(far_m(switches.outside()) > 0.25 * far_m(usual), "not into the organ");
        let mut inside = Switches::new(false);
        inside.press(&pull, 0);
        assert_eq!(inside.outside(), Switches::new(false).outside());
    }

    #[test]
    fn the_lines_of_the_meshes_come_and_go_with_their_key() {
        let mut switches = Switches::new(true);
        switches.press(&press(Key::Meshes), 0);
        assert!(switches.has_lines() && switches.external);
        switches.press(&press(Key::Meshes), 0);
        assert!(!switches.has_lines());
    }
}
