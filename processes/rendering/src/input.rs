//! What the hand does, as the window reports it: movements in radians and metres, buttons and keys as bits. Plain data, no window needed.
//!
//! Promise: [`MOTIONS`] and [`SWITCHES`] are all that keys and mouse do. The window acts by them and the help is written from them, so that neither
//! knows a key that the other does not.
use hyst_messages::controls::{
    WINDOW_COAGULATION, WINDOW_CURRENT, WINDOW_FOCUS, WINDOW_HEAD, WINDOW_INFLOW, WINDOW_LIGHT, WINDOW_LOOP, WINDOW_OUTFLOW,
    WINDOW_POSE, WINDOW_PRESSURE,
};
use winit::{event::MouseButton, keyboard::KeyCode};

/// What the hand did since the last pump, as the surgeon sees it. In the station's frame a view that goes up is a negative rotation about
/// +x, and one that goes right a negative rotation about +y (+x, the patient's right, is on the picture's left).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PointerInput {
    /// the view goes up, rad
    pub pitch_rad: f32,
    /// the view goes right, rad
    pub yaw_rad: f32,
    /// inwards, m
    pub insertion_m: f32,
    /// clockwise, rad
    pub roll_rad: f32,
    /// the camera head on the scope, clockwise, rad
    pub head_rad: f32,
    /// mouse buttons held: bit 0 left, 1 right, 2 middle
    pub buttons: u32,
    /// keys held, a bit per [`Key`]
    pub held: u32,
    /// keys that went down since the last pump, a bit per [`Key`]
    pub pressed: u32,
}

impl PointerInput {
    /// This, and what the hand did after it.
    pub fn then(&self, next: &PointerInput) -> PointerInput {
        PointerInput {
            pitch_rad: self.pitch_rad + next.pitch_rad,
            yaw_rad: self.yaw_rad + next.yaw_rad,
            insertion_m: self.insertion_m + next.insertion_m,
            roll_rad: self.roll_rad + next.roll_rad,
            head_rad: self.head_rad + next.head_rad,
            pressed: self.pressed | next.pressed,
            ..*next
        }
    }

    /// Whether a key is held.
    pub fn is_held(&self, key: Key) -> bool {
        self.held & key.bit() != 0
    }

    /// Whether a key went down since the last pump.
    pub fn was_pressed(&self, key: Key) -> bool {
        self.pressed & key.bit() != 0
    }
}

/// Keys with a meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// view up
    Up,
    /// view down
    Down,
    /// view left
    Left,
    /// view right
    Right,
    /// insert
    In,
    /// withdraw
    Out,
    /// turn the scope anticlockwise
    TurnLeft,
    /// turn the scope clockwise
    TurnRight,
    /// turn the camera head anticlockwise
    HeadLeft,
    /// turn the camera head clockwise
    HeadRight,
    /// extend or retract the loop
    LoopOut,
    /// the current that cuts
    Energize,
    /// the current that coagulates
    Coagulate,
    /// inflow valve
    Inflow,
    /// outflow valve
    Outflow,
    /// lower set pressure
    PressureDown,
    /// higher set pressure
    PressureUp,
    /// light
    Light,
    /// a nearer focus
    FocusNear,
    /// a farther focus
    FocusFar,
    /// the other camera
    External,
    /// the lines of the meshes in it
    Meshes,
    /// the window fills the screen, or no more
    FullScreen,
    /// the window fills the screen no more
    Framed,
    /// help
    Help,
}

impl Key {
    /// Its bit in [`PointerInput::held`].
    pub fn bit(self) -> u32 {
        1 << (self as u32)
    }

    /// All of them, in the order of the help.
    pub fn all() -> impl Iterator<Item = Key> {
        bindings().map(|(_, key)| key)
    }
}

/// A degree of freedom of the scope.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Axis {
    Pitch,
    Yaw,
    Roll,
    Insertion,
    Head,
}

impl PointerInput {
    /// The movement along an axis, rad or m.
    pub(crate) fn along(&mut self, axis: Axis) -> &mut f32 {
        match axis {
            Axis::Pitch => &mut self.pitch_rad,
            Axis::Yaw => &mut self.yaw_rad,
            Axis::Roll => &mut self.roll_rad,
            Axis::Insertion => &mut self.insertion_m,
            Axis::Head => &mut self.head_rad,
        }
    }
}

/// What the mouse does for an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Mouse {
    /// it goes up the screen with this button held
    DragUp(MouseButton),
    /// it goes right with this button held
    DragRight(MouseButton),
    /// its wheel is turned away from the hand
    Wheel,
}

/// How one degree of freedom is moved.
pub(crate) struct Motion {
    pub axis: Axis,
    /// the bit of `WINDOW_ALL` under which the window makes it
    pub bit: u32,
    /// the keys that move it back and forth while they are held
    pub keys: [(KeyCode, Key); 2],
    /// speed under a key, rad/s or m/s
    pub per_s: f32,
    pub mouse: Mouse,
    /// movement for a pixel, rad, or a notch, m
    pub per_step: f32,
    /// what the help says of it, back and forth
    pub does: &'static str,
}

/// What a key does that does not move the scope.
pub(crate) struct Switch {
    pub keys: &'static [(KeyCode, Key)],
    /// the bit of `WINDOW_ALL` under which it turns something for the hand, or one for each of its keys; 0 for the eye, at all times
    pub bit: u32,
    /// what the help says of it
    pub does: &'static str,
}

/// Turn of the scope per pixel of the mouse, rad.
pub(crate) const RAD_PER_PX: f32 = 0.0022;
/// Insertion per notch of the wheel, m.
const M_PER_NOTCH: f32 = 0.0015;

/// The degrees of freedom: the scope's four, and its camera's.
pub(crate) static MOTIONS: [Motion; 5] = [
    Motion {
        axis: Axis::Pitch,
        bit: WINDOW_POSE,
        keys: [(KeyCode::ArrowDown, Key::Down), (KeyCode::ArrowUp, Key::Up)],
        per_s: 0.35,
        mouse: Mouse::DragUp(MouseButton::Left),
        per_step: RAD_PER_PX,
        does: "view down, up",
    },
    Motion {
        axis: Axis::Yaw,
        bit: WINDOW_POSE,
        keys: [(KeyCode::ArrowLeft, Key::Left), (KeyCode::ArrowRight, Key::Right)],
        per_s: 0.35,
        mouse: Mouse::DragRight(MouseButton::Left),
        per_step: RAD_PER_PX,
        does: "view left, right",
    },
    Motion {
        axis: Axis::Roll,
        bit: WINDOW_POSE,
        keys: [(KeyCode::KeyQ, Key::TurnLeft), (KeyCode::KeyE, Key::TurnRight)],
        per_s: 0.8,
        mouse: Mouse::DragRight(MouseButton::Right),
        per_step: 2.0 * RAD_PER_PX,
        does: "turn the scope",
    },
    Motion {
        axis: Axis::Insertion,
        bit: WINDOW_POSE,
        keys: [(KeyCode::PageDown, Key::Out), (KeyCode::PageUp, Key::In)],
        per_s: 0.02,
        mouse: Mouse::Wheel,
        per_step: M_PER_NOTCH,
        does: "out, in",
    },
    Motion {
        axis: Axis::Head,
        bit: WINDOW_HEAD,
        keys: [(KeyCode::KeyZ, Key::HeadLeft), (KeyCode::KeyC, Key::HeadRight)],
        per_s: 0.8,
        mouse: Mouse::DragRight(MouseButton::Middle),
        per_step: 2.0 * RAD_PER_PX,
        does: "turn the camera head",
    },
];

/// The other keys.
pub(crate) static SWITCHES: [Switch; 9] = [
    Switch { keys: &[(KeyCode::KeyL, Key::LoopOut)], bit: WINDOW_LOOP, does: "loop out, in; jaws open, close" },
    Switch {
        keys: &[(KeyCode::Space, Key::Energize), (KeyCode::KeyB, Key::Coagulate)],
        bit: WINDOW_CURRENT | WINDOW_COAGULATION,
        does: "cutting, coagulation, while held",
    },
    Switch { keys: &[(KeyCode::KeyI, Key::Inflow)], bit: WINDOW_INFLOW, does: "inflow shut, open" },
    Switch { keys: &[(KeyCode::KeyO, Key::Outflow)], bit: WINDOW_OUTFLOW, does: "outflow shut, open" },
    Switch {
        keys: &[(KeyCode::End, Key::PressureDown), (KeyCode::Home, Key::PressureUp)],
        bit: WINDOW_PRESSURE,
        does: "pressure 5 mmHg down, up",
    },
    Switch { keys: &[(KeyCode::KeyT, Key::Light)], bit: WINDOW_LIGHT, does: "light dim, full" },
    Switch {
        keys: &[(KeyCode::KeyF, Key::FocusNear), (KeyCode::KeyG, Key::FocusFar)],
        bit: WINDOW_FOCUS,
        does: "focus nearer, farther",
    },
    Switch {
        keys: &[(KeyCode::KeyV, Key::External), (KeyCode::KeyM, Key::Meshes)],
        bit: 0,
        does: "view from outside; its meshes",
    },
    Switch {
        keys: &[(KeyCode::F1, Key::Help), (KeyCode::F11, Key::FullScreen), (KeyCode::Escape, Key::Framed)],
        bit: 0,
        does: "this help; full screen, and back",
    },
];

/// All keys, with their places on an American keyboard, after which the help names them.
pub(crate) fn bindings() -> impl Iterator<Item = (KeyCode, Key)> {
    MOTIONS.iter().flat_map(|motion| motion.keys).chain(SWITCHES.iter().flat_map(|switch| switch.keys.iter().copied()))
}

/// The places of the letters on an American keyboard.
const LETTERS: [KeyCode; 26] = [
    KeyCode::KeyA,
    KeyCode::KeyB,
    KeyCode::KeyC,
    KeyCode::KeyD,
    KeyCode::KeyE,
    KeyCode::KeyF,
    KeyCode::KeyG,
    KeyCode::KeyH,
    KeyCode::KeyI,
    KeyCode::KeyJ,
    KeyCode::KeyK,
    KeyCode::KeyL,
    KeyCode::KeyM,
    KeyCode::KeyN,
    KeyCode::KeyO,
    KeyCode::KeyP,
    KeyCode::KeyQ,
    KeyCode::KeyR,
    KeyCode::KeyS,
    KeyCode::KeyT,
    KeyCode::KeyU,
    KeyCode::KeyV,
    KeyCode::KeyW,
    KeyCode::KeyX,
    KeyCode::KeyY,
    KeyCode::KeyZ,
];

/// The place on an American keyboard of what is meant by a key that bears such a text: a Latin letter is meant wherever the layout has it, so that a key does
/// what the help says of its name. Any other key is meant by its place: what bears no text, and what a layout without Latin letters has there.
pub(crate) fn meant(place: KeyCode, bears: Option<&str>) -> KeyCode {
    match bears.unwrap_or_default().as_bytes() {
        [letter] if letter.is_ascii_alphabetic() => LETTERS[usize::from(letter.to_ascii_lowercase() - b'a')],
        _ => place,
    }
}

/// What a place on an American keyboard means.
pub(crate) fn key_at(code: KeyCode) -> Option<Key> {
    bindings().find(|(known, _)| *known == code).map(|(_, key)| key)
}

/// Its bit in [`PointerInput::buttons`].
pub(crate) fn button_bit(button: MouseButton) -> u32 {
    match button {
        MouseButton::Left => 1,
        MouseButton::Right => 2,
        MouseButton::Middle => 4,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By their places, Z and C would have been where Y and C stand in Germany, and Q and M where A and a comma do in France.
    #[test]
    fn a_letter_is_meant_wherever_the_layout_has_it_and_everything_else_by_its_place() {
        let key = |place: KeyCode, bears: Option<&str>| key_at(meant(place, bears));
        let german = [(KeyCode::KeyY, "z"), (KeyCode::KeyZ, "y")].map(|(place, bears)| key(place, Some(bears)));
        assert_eq!(german, [Some(Key::HeadLeft), None]);
        let french = [(KeyCode::KeyA, "q"), (KeyCode::KeyQ, "a"), (KeyCode::KeyW, "z"), (KeyCode::Semicolon, "m")];
        let meant_by = french.map(|(place, bears)| key(place, Some(bears)));
        assert_eq!(meant_by, [Some(Key::TurnLeft), None, Some(Key::HeadLeft), Some(Key::Meshes)]);
        assert_eq!(key(KeyCode::KeyZ, Some("я")), Some(Key::HeadLeft), "no Latin letter");
        assert_eq!([None, Some("Q"), Some("qu"), Some("")].map(|bears| key(KeyCode::KeyQ, bears)), [Some(Key::TurnLeft); 4]);
        assert_eq!((key(KeyCode::Space, None), key(KeyCode::F1, None)), (Some(Key::Energize), Some(Key::Help)));
        for (at, code) in LETTERS.iter().enumerate() {
            assert_eq!(format!("{code:?}"), format!("Key{}", char::from(b'A' + at as u8)));
        }
    }

    #[test]
    fn of_two_looks_movements_add_up_presses_are_all_there_and_what_is_held_is_held_now() {
        let first = PointerInput { pitch_rad: 0.25, head_rad: 1.0, buttons: 1, held: 3, pressed: 1, ..PointerInput::default() };
        let then = PointerInput { pitch_rad: 0.5, yaw_rad: 0.25, held: 2, pressed: 2, ..PointerInput::default() };
        let both = PointerInput { pitch_rad: 0.75, head_rad: 1.0, buttons: 0, pressed: 3, ..then };
        assert_eq!((first.then(&then), PointerInput::default().then(&then)), (both, then));
    }

    #[test]
    fn a_key_has_one_place_and_one_bit() {
        let all: Vec<(KeyCode, Key)> = bindings().collect();
        let mut bits = 0_u32;
        for (place, (code, key)) in all.iter().enumerate() {
            assert_eq!(key_at(*code), Some(*key));
            assert!(all[..place].iter().all(|(other, _)| other != code) && bits & key.bit() == 0, "{key:?}");
            bits |= key.bit();
        }
        assert_eq!(all.len() as u32, Key::Help as u32 + 1, "a key that means something is at no place");
        assert_eq!(key_at(KeyCode::Tab), None);
    }
}
