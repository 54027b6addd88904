//! What the hand does, as the window reports it: movements in radians and metres, buttons and keys as bits. Plain data, no window needed.
use winit::keyboard::KeyCode;

/// What the hand did since the last pump, as the surgeon sees it. In the station's frame a view that goes up is a negative rotation about
/// +x, and one that goes right a negative rotation about +y (+x, the patient's left, is on the picture's left).
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
    /// mouse buttons held: bit 0 left, 1 right, 2 middle
    pub buttons: u32,
    /// keys held, a bit per [`Key`]
    pub held: u32,
    /// keys that went down since the last pump, a bit per [`Key`]
    pub pressed: u32,
}

impl PointerInput {
    /// Whether a key is held.
    pub fn is_held(&self, key: Key) -> bool {
        self.held & key.bit() != 0
    }

    /// Whether a key went down since the last pump.
    pub fn was_pressed(&self, key: Key) -> bool {
        self.pressed & key.bit() != 0
    }
}

/// Keys with a meaning, by place on the keyboard.
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
    /// help
    Help,
    /// the other camera
    External,
    /// current in the loop
    Energize,
    /// extend or retract the loop
    LoopOut,
    /// set pressure
    Pressure,
    /// inflow valve
    Inflow,
    /// outflow valve
    Outflow,
    /// light
    Light,
    /// focus
    Focus,
    /// take a picture
    Picture,
    /// more
    Plus,
    /// less
    Minus,
    /// leave
    Escape,
    /// 1
    Digit1,
    /// 2
    Digit2,
    /// 3
    Digit3,
}

pub(crate) const KEYS: [(KeyCode, Key); 24] = [
    (KeyCode::ArrowUp, Key::Up),
    (KeyCode::ArrowDown, Key::Down),
    (KeyCode::ArrowLeft, Key::Left),
    (KeyCode::ArrowRight, Key::Right),
    (KeyCode::PageUp, Key::In),
    (KeyCode::PageDown, Key::Out),
    (KeyCode::KeyQ, Key::TurnLeft),
    (KeyCode::KeyE, Key::TurnRight),
    (KeyCode::F1, Key::Help),
    (KeyCode::KeyV, Key::External),
    (KeyCode::Space, Key::Energize),
    (KeyCode::KeyL, Key::LoopOut),
    (KeyCode::KeyP, Key::Pressure),
    (KeyCode::KeyI, Key::Inflow),
    (KeyCode::KeyO, Key::Outflow),
    (KeyCode::KeyT, Key::Light),
    (KeyCode::KeyF, Key::Focus),
    (KeyCode::KeyC, Key::Picture),
    (KeyCode::Equal, Key::Plus),
    (KeyCode::Minus, Key::Minus),
    (KeyCode::Escape, Key::Escape),
    (KeyCode::Digit1, Key::Digit1),
    (KeyCode::Digit2, Key::Digit2),
    (KeyCode::Digit3, Key::Digit3),
];

impl Key {
    /// Its bit in [`PointerInput::held`].
    pub fn bit(self) -> u32 {
        1 << (self as u32)
    }
}
