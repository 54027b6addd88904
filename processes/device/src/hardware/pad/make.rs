//! The makes of pads, and what their axes and buttons mean. Codes are those of Linux (`input-event-codes.h`); a gamepad's places those of the kernel's
//! gamepad specification (`Documentation/input/gamepad.rst`). A 3D mouse says x to the right, y towards the user, z down, and turns about them.

use hyst_messages::controls::{
    WINDOW_COAGULATION, WINDOW_FOCUS, WINDOW_HEAD, WINDOW_INFLOW, WINDOW_LIGHT, WINDOW_OUTFLOW, WINDOW_PRESSURE,
};
use hyst_messages::{BUTTON_COAGULATING, BUTTON_ENERGIZED, Switch};

/// Types of events.
const KEY: u16 = 1;
const RELATIVE: u16 = 2;
const ABSOLUTE: u16 = 3;
/// A 3D mouse's deflection at its stop, which its relative axes do not tell.
const FULL_OF_MOUSE: f32 = 350.0;
/// For how long a relative axis of a 3D mouse keeps what it said last, ns. The kernel passes on no relative value of 0 (`input_get_disposition` in
/// `drivers/input/input.c`), and so not that the knob was let go of; each other one it passes on, the same again too, as often as the knob says it. One that
/// is off its middle says all of its axes once in 16 ms, held still or not: a SpaceNavigator and a SpaceMouse Wireless, as recorded on their bus
/// (`SpaceNavigator.md` and `SpaceMouseWireless.md` of github.com/AndunHH/spacemouse). So three reports have stayed out; relabsd, which makes joysticks of
/// such knobs, waits 45 ms.
const SILENT_NS: u64 = 50_000_000;
/// Axes that mean something: x, y, z, and the turns about them.
pub(super) const AXES: usize = 6;
/// The axes of a gamepad's cross: sideways, and up and down.
const CROSS: [u16; 2] = [0x10, 0x11];

/// The camera head turns while they are held: a gamepad's shoulder buttons, to the left and to the right.
const HEAD: [u16; 2] = [0x136, 0x137];

/// What is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Make {
    /// Two sticks, a cross and four buttons.
    Gamepad,
    /// A knob with six degrees of freedom, as the SpaceMouse.
    SpaceMouse,
}

/// Buttons that turn something, by their code: of a gamepad east, west, north and select, the cross; of a 3D mouse its second button.
pub const SWITCHES: [(u16, Switch); 9] = [
    (0x131, Switch::Loop),
    (0x134, Switch::Inflow),
    (0x133, Switch::Outflow),
    (0x13a, Switch::Light),
    (CROSS[1], Switch::PressureUp),
    (CROSS[1], Switch::PressureDown),
    (CROSS[0], Switch::FocusNear),
    (CROSS[0], Switch::FocusFar),
    (0x101, Switch::Loop),
];
/// What the cross turns to the left and to the right, up and down.
const ACROSS: [Switch; 2] = [Switch::FocusNear, Switch::FocusFar];
const UPRIGHT: [Switch; 2] = [Switch::PressureUp, Switch::PressureDown];
/// The current that cuts while it is held: a gamepad's south button, a 3D mouse's first.
const CURRENT: [u16; 2] = [0x130, 0x100];
/// The current that coagulates while it is held: a gamepad's start, or its lower right shoulder button, where that is one.
const COAGULATION: [u16; 2] = [0x13b, 0x139];

impl Make {
    /// By the word of `--hand`.
    pub fn from_name(name: &str) -> Option<Make> {
        [Make::Gamepad, Make::SpaceMouse].into_iter().find(|make| make.name() == name)
    }

    /// Its word.
    pub fn name(self) -> &'static str {
        match self {
            Make::Gamepad => "gamepad",
            Make::SpaceMouse => "spacemouse",
        }
    }

    /// What is said while there is none.
    pub(super) fn gone(self) -> &'static str {
        match self {
            Make::Gamepad => "the gamepad is gone: the scope is held where it is, without current, until there is one again",
            Make::SpaceMouse => "the 3D mouse is gone: the scope is held where it is, without current, until there is one again",
        }
    }

    /// What it has no button for, a bit of [`WINDOW_ALL`](hyst_messages::controls::WINDOW_ALL) each: a 3D mouse has two, for the loop and
    /// the current that cuts.
    pub(super) fn lacks(self) -> u32 {
        match self {
            Make::Gamepad => 0,
            Make::SpaceMouse => {
                let valves = WINDOW_INFLOW | WINDOW_OUTFLOW | WINDOW_PRESSURE;
                WINDOW_HEAD | WINDOW_COAGULATION | WINDOW_LIGHT | WINDOW_FOCUS | valves
            }
        }
    }
}

/// One event, as the kernel gives it.
#[derive(Clone, Copy, Debug)]
pub struct Event {
    /// Its type.
    pub kind: u16,
    /// Its code.
    pub code: u16,
    /// Its value.
    pub value: i32,
}

/// What the absolute axes go from and to.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ranges([Option<(i32, i32)>; AXES]);

impl Ranges {
    /// From axis, least and greatest value.
    pub fn new(infos: impl Iterator<Item = (u16, i32, i32)>) -> Ranges {
        let mut ranges = Ranges::default();
        for (axis, least, greatest) in infos {
            if let Some(range) = ranges.0.get_mut(usize::from(axis)) {
                *range = Some((least, greatest)).filter(|(least, greatest)| least < greatest);
            }
        }
        ranges
    }

    /// A value of an absolute axis, from -1 to 1; nothing if its range makes no sense.
    fn share(&self, axis: usize, value: i32) -> f32 {
        let Some((least, greatest)) = self.0.get(axis).copied().flatten() else { return 0.0 };
        let (least, greatest) = (f64::from(least), f64::from(greatest));
        (((f64::from(value) - least) / (greatest - least)) * 2.0 - 1.0).clamp(-1.0, 1.0) as f32
    }
}

/// How far each axis is deflected, from -1 to 1, and the currents that the finger is on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Deflections {
    axes: [f32; AXES],
    /// When a relative axis said last what it has, ns; of one that rests, and of an absolute one, nothing.
    said_ns: [Option<u64>; AXES],
    is_mouse: bool,
    is_energized: bool,
    is_coagulating: bool,
    is_turned: [bool; 2],
}

impl Deflections {
    /// Takes an event that was read at a time, ns; gives which of [`SWITCHES`] it has pressed.
    pub(super) fn take(&mut self, make: Make, ranges: &Ranges, event: &Event, now_ns: u64) -> Option<usize> {
        self.is_mouse = make == Make::SpaceMouse;
        let pressed = |wanted: Switch| SWITCHES.iter().position(|(code, switch)| (*code, *switch) == (event.code, wanted));
        match (event.kind, event.code) {
            (KEY, code) if CURRENT.contains(&code) => self.is_energized = event.value != 0,
            (KEY, code) if COAGULATION.contains(&code) => self.is_coagulating = event.value != 0,
            (KEY, code) if HEAD.contains(&code) => self.is_turned[usize::from(code - HEAD[0])] = event.value != 0,
            // 2 is a key that repeats itself.
            (KEY, code) if event.value == 1 && !CROSS.contains(&code) => {
                return SWITCHES.iter().position(|(known, _)| *known == code);
            }
            (ABSOLUTE, code) if CROSS.contains(&code) => {
                let [less, more] = if code == CROSS[0] { ACROSS } else { UPRIGHT };
                return if event.value == 0 { None } else { pressed(if event.value < 0 { less } else { more }) };
            }
            (ABSOLUTE, code) => self.set(usize::from(code), ranges.share(usize::from(code), event.value)),
            (RELATIVE, code) if self.is_mouse => {
                self.set(usize::from(code), (event.value as f32 / FULL_OF_MOUSE).clamp(-1.0, 1.0));
                if let Some(said_ns) = self.said_ns.get_mut(usize::from(code)) {
                    *said_ns = Some(now_ns);
                }
            }
            _ => {}
        }
        None
    }

    fn set(&mut self, axis: usize, share: f32) {
        if let Some(value) = self.axes.get_mut(axis) {
            *value = share;
        }
    }

    /// Lets each relative axis rest that has said nothing for [`SILENT_NS`]; each by itself, for a twist may end while the push goes on.
    pub(super) fn rest(&mut self, now_ns: u64) {
        for (axis, said_ns) in self.axes.iter_mut().zip(&mut self.said_ns) {
            if said_ns.is_some_and(|said_ns| now_ns >= said_ns.saturating_add(SILENT_NS)) {
                (*axis, *said_ns) = (0.0, None);
            }
        }
    }

    /// When the next of them rests if nothing comes, ns; nothing while all do.
    pub(super) fn rests_at_ns(&self) -> Option<u64> {
        self.said_ns.iter().flatten().min().map(|said_ns| said_ns.saturating_add(SILENT_NS))
    }

    /// The currents that are wanted, as bits of [`Controls::buttons`](hyst_messages::Controls::buttons).
    pub(super) fn current(&self) -> u32 {
        let bit = |is_held: bool, bit: u32| if is_held { bit } else { 0 };
        bit(self.is_energized, BUTTON_ENERGIZED) | bit(self.is_coagulating, BUTTON_COAGULATING)
    }

    /// Which way the camera head is turned: -1 to the left, 1 to the right.
    pub(super) fn head(&self) -> f32 {
        let [left, right] = self.is_turned.map(|is_held| if is_held { 1.0 } else { 0.0 });
        right - left
    }

    /// About pitch, yaw, roll and along the insertion. A view that goes up is a negative turn about +x, one that goes right a negative turn about +y.
    pub(super) fn along(&self) -> [f32; 4] {
        let [x, y, _, turn_x, turn_y, turn_z] = self.axes;
        match self.is_mouse {
            // Tilted back and to a side, twisted, pushed away.
            true => [-turn_x, turn_y, turn_z, -y],
            // The left stick looks, the right one turns and pushes. Up is negative.
            false => [y, -x, turn_x, -turn_y],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(make: Make, events: &[(u16, u16, i32)]) -> (Deflections, Vec<Switch>) {
        let ranges =
            Ranges::new([(0, -32_768, 32_767), (1, 0, 255), (3, -32_768, 32_767), (4, -32_768, 32_767), (5, 7, 7)].into_iter());
        let mut now = Deflections::default();
        let take = |(kind, code, value): &(u16, u16, i32)| {
            now.take(make, &ranges, &Event { kind: *kind, code: *code, value: *value }, 0)
        };
        let pressed = events.iter().filter_map(take).map(|index| SWITCHES[index].1).collect();
        (now, pressed)
    }

    #[test]
    fn a_gamepads_left_stick_looks_and_its_right_one_turns_and_pushes() {
        let along = |axis: u16, value: i32| after(Make::Gamepad, &[(ABSOLUTE, axis, value)]).0.along();
        assert_eq!(along(1, 0), [-1.0, 0.0, 0.0, 0.0], "up, in a range of 0 to 255");
        assert_eq!(along(0, 32_767)[1], -1.0, "right");
        assert_eq!(along(3, 32_767)[2], 1.0);
        assert_eq!(along(4, -32_768)[3], 1.0, "away from the hand is in");
        assert_eq!(
            (along(5, 7), along(2, 9), along(0, i32::MAX)[1]),
            ([0.0; 4], [0.0; 4], -1.0),
            "no range, no such axis, beyond it"
        );
    }

    #[test]
    fn a_3d_mouse_that_is_pushed_away_goes_in_and_what_is_relative_is_its_deflection() {
        let along = |kind: u16, axis: u16, value: i32| after(Make::SpaceMouse, &[(kind, axis, value)]).0.along();
        assert_eq!(along(RELATIVE, 1, -350), [0.0, 0.0, 0.0, 1.0]);
        assert_eq!(along(RELATIVE, 1, -175)[3], 0.5);
        assert_eq!(along(RELATIVE, 5, 9_999)[2], 1.0, "twisted to the right");
        assert_eq!(along(ABSOLUTE, 3, -32_768)[0], 1.0, "the models that tell their range");
        assert_eq!(after(Make::Gamepad, &[(RELATIVE, 1, -350)]).0.along(), [0.0; 4]);
    }

    /// The kernel does not say that a knob was let go of: the scope went on.
    #[test]
    fn an_axis_of_a_3d_mouse_that_falls_silent_rests_and_one_that_is_held_still_or_tells_its_range_goes_on() {
        let ranges = Ranges::new([(3, -350, 350)].into_iter());
        let mut now = Deflections::default();
        let mut at = |ms: u64, events: &[(u16, u16, i32)]| {
            for (kind, code, value) in events {
                now.take(Make::SpaceMouse, &ranges, &Event { kind: *kind, code: *code, value: *value }, ms * 1_000_000);
            }
            now.rest(ms * 1_000_000);
            now.along()
        };
        let (push, twist, tilt) = ((RELATIVE, 1, -350), (RELATIVE, 5, 175), (ABSOLUTE, 3, -350));
        assert_eq!(at(0, &[push, twist]), [0.0, 0.0, 0.5, 1.0]);
        let twists = [16, 32, 48, 64].map(|ms| at(ms, &[push])[2]);
        assert_eq!(twists, [0.5, 0.5, 0.5, 0.0], "the twist has ended");
        assert_eq!([80, 96, 112, 128].map(|ms| at(ms, &[push])), [[0.0, 0.0, 0.0, 1.0]; 4], "the push is held still");
        assert_eq!([177, 178].map(|ms| at(ms, &[])[3]), [1.0, 0.0], "and has ended");
        assert_eq!((at(200, &[tilt])[0], at(9_999, &[])[0]), (1.0, 1.0), "of an absolute axis the kernel says the end");
        assert_eq!(now.rests_at_ns(), None, "and it is waited for as long as it takes");
    }

    #[test]
    fn a_press_is_one_and_the_current_flows_while_it_is_held() {
        let held = |make: Make, code: u16| {
            let (down, up) = (after(make, &[(KEY, code, 1)]).0, after(make, &[(KEY, code, 1), (KEY, code, 0)]).0);
            (down.current(), up.current())
        };
        let head = |events: &[(u16, u16, i32)]| after(Make::Gamepad, events).0.head();
        let (left, right) = ((KEY, 0x136, 1), (KEY, 0x137, 1));
        assert_eq!([head(&[left]), head(&[right]), head(&[left, right]), head(&[left, (KEY, 0x136, 0)])], [-1.0, 1.0, 0.0, 0.0]);
        let [cuts, coagulates] = [(BUTTON_ENERGIZED, 0), (BUTTON_COAGULATING, 0)];
        assert_eq!((held(Make::Gamepad, 0x130), held(Make::SpaceMouse, 0x100)), (cuts, cuts));
        assert_eq!([0x13b, 0x139].map(|code| held(Make::Gamepad, code)), [coagulates; 2]);
        let (_, pressed) =
            after(Make::Gamepad, &[(KEY, 0x131, 1), (KEY, 0x131, 2), (KEY, 0x131, 0), (KEY, 0x133, 1), (KEY, 0x2ff, 1)]);
        assert_eq!(pressed, [Switch::Loop, Switch::Outflow]);
        let cross =
            |axis: u16| after(Make::Gamepad, &[(ABSOLUTE, axis, -1), (ABSOLUTE, axis, 0), (ABSOLUTE, axis, 1), (KEY, axis, 1)]).1;
        assert_eq!(cross(0x11), [Switch::PressureUp, Switch::PressureDown]);
        assert_eq!(
            cross(0x10),
            [Switch::FocusNear, Switch::FocusFar],
            "to the left, to the right; its number is a letter's key too"
        );
        assert_eq!(after(Make::SpaceMouse, &[(KEY, 0x101, 1)]).1, [Switch::Loop]);
        assert_eq!([Make::from_name("gamepad"), Make::from_name("pad")], [Some(Make::Gamepad), None]);
    }

    #[test]
    fn what_a_pad_lacks_none_of_its_buttons_turns_and_all_else_one_does() {
        const HELD: u32 = WINDOW_HEAD | WINDOW_COAGULATION;
        // The buttons that each is known to have: a gamepad's of its specification, a 3D mouse's first two.
        for (make, codes) in [(Make::Gamepad, 0x130..=0x13e), (Make::SpaceMouse, 0x100..=0x101)] {
            let presses = codes.flat_map(|code| after(make, &[(KEY, code, 1)]).1);
            let cross = [(0x10, -1), (0x11, 1)].into_iter().filter(|_| make == Make::Gamepad);
            let turned = cross.flat_map(|(axis, value)| after(make, &[(ABSOLUTE, axis, value)]).1);
            let bits = presses.chain(turned).fold(0, |bits, switch| bits | switch.window_bit());
            let all = SWITCHES.iter().fold(0, |bits, (_, switch)| bits | switch.window_bit());
            assert_eq!(make.lacks() & !HELD, all & !bits, "{make:?}");
        }
        assert_eq!([Make::Gamepad, Make::SpaceMouse].map(|make| make.lacks() & HELD), [0, HELD]);
    }
}
