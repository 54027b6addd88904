//! The hand in the window: mouse and keys become targets for the hardware, in the page's pointer cell. What the device on the desk has itself, as its samples
//! say, no key changes.
//!
//! Promise: the first record repeats where the scope is and how valves, pressure, light, focus and loop are set, so that a restarted window changes nothing;
//! a target stays within reach of the scope, so that nothing is wound up while the tissue or the workspace holds it.

use hyst_messages::controls::{WINDOW_COAGULATION, WINDOW_CURRENT, WINDOW_HEAD, WINDOW_HEAD_FREE, WINDOW_POSE};
use hyst_messages::{BUTTON_COAGULATING, BUTTON_ENERGIZED, BUTTONS_CURRENT, HardwareSample, PointerRecord, Switch};
use rendering::{Key, PointerInput};
use std::f32::consts::PI;

/// How far a target may be from the scope: rad, rad, rad, m, rad. A hand's lead over an instrument that is held.
const REACH: [f32; 5] = [0.25, 0.25, 0.6, 0.012, 0.6];
/// Bounds of a target whatever the scope says: rad, rad, rad, m, rad.
const BOUNDS: [(f32, f32); 5] = [(-1.2, 1.2), (-1.2, 1.2), (-PI, PI), (0.0, 0.2), (-PI, PI)];
/// What the window gives of each.
const GIVEN: [u32; 5] = [WINDOW_POSE, WINDOW_POSE, WINDOW_POSE, WINDOW_POSE, WINDOW_HEAD];
/// What makes the current flow while it is held: the key, its button, and the bit under which the window has it.
const PEDALS: [(Key, u32, u32); 2] =
    [(Key::Energize, BUTTON_ENERGIZED, WINDOW_CURRENT), (Key::Coagulate, BUTTON_COAGULATING, WINDOW_COAGULATION)];
/// What the keys of the hand turn.
const TURNS: [(Key, Switch); 8] = [
    (Key::Inflow, Switch::Inflow),
    (Key::Outflow, Switch::Outflow),
    (Key::Light, Switch::Light),
    (Key::PressureUp, Switch::PressureUp),
    (Key::PressureDown, Switch::PressureDown),
    (Key::FocusNear, Switch::FocusNear),
    (Key::FocusFar, Switch::FocusFar),
    (Key::LoopOut, Switch::Loop),
];

/// Adds up what the hand does.
#[derive(Debug, Default)]
pub struct Hand {
    record: PointerRecord,
    /// The session is over: no key puts current into the loop any more.
    pub is_over: bool,
}

impl Hand {
    /// The next record; `now` is what the hardware says of scope and controls, and what of them the window gives.
    pub fn follow(&mut self, input: &PointerInput, now: &HardwareSample) -> PointerRecord {
        let (scope, given) = (&now.pose, now.from_window);
        // The head turns on the scope, and the scope in the head: both together are the horizon, which is kept unless the head goes along with the scope.
        let kept_rad = if given & WINDOW_HEAD_FREE == 0 { scope.roll_rad } else { 0.0 };
        let at = [scope.pitch_rad, scope.yaw_rad, scope.roll_rad, scope.insertion_m, scope.camera_roll_rad + kept_rad];
        if self.record.sequence == 0 {
            (self.record.target, self.record.controls) = (at, now.controls);
        }
        self.record.controls.take(&now.controls, !given);
        // A view that goes up is a negative turn about +x; one that goes right is a negative turn about +y.
        let moved = [-input.pitch_rad, -input.yaw_rad, input.roll_rad, input.insertion_m, input.head_rad];
        for (axis, target) in self.record.target.iter_mut().enumerate() {
            let wanted = if given & GIVEN[axis] != 0 { *target + moved[axis] } else { at[axis] };
            let (low, high) = BOUNDS[axis];
            if wanted.is_finite() && at[axis].is_finite() {
                *target = wanted.clamp(at[axis] - REACH[axis], at[axis] + REACH[axis]).clamp(low, high);
            }
        }
        let controls = &mut self.record.controls;
        // Up and down at once is neither.
        let both = input.was_pressed(Key::PressureUp) && input.was_pressed(Key::PressureDown);
        let due = |key: Key| input.was_pressed(key) && !(both && matches!(key, Key::PressureUp | Key::PressureDown));
        let turned = TURNS.iter().filter(|(key, switch)| due(*key) && given & switch.window_bit() != 0);
        turned.for_each(|(_, switch)| controls.turn(*switch));
        for (key, button, _) in PEDALS.into_iter().filter(|(_, _, bit)| given & bit != 0) {
            controls.buttons &= !button;
            controls.buttons |= if input.is_held(key) && !self.is_over { button } else { 0 };
        }
        self.record.sequence += 1;
        self.record
    }

    /// The last record, of a window that goes: everything stays as it is, and no finger is on the current. `None` if there was none before.
    pub fn let_go(&mut self) -> Option<PointerRecord> {
        self.record.controls.buttons &= !BUTTONS_CURRENT;
        self.record.sequence += u64::from(self.record.sequence > 0);
        (self.record.sequence > 0).then_some(self.record)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::controls::{PRESSURE_PA, WINDOW_ALL, WINDOW_INFLOW};
    use hyst_messages::{BUTTON_EXTENDED, Controls, Pose};

    fn now() -> HardwareSample {
        let pose =
            Pose { pitch_rad: 0.1, yaw_rad: -0.2, roll_rad: 0.3, insertion_m: 0.04, camera_roll_rad: 0.5, ..Pose::default() };
        let controls =
            Controls { inflow_valve: 1.0, outflow_valve: 0.3, set_pressure_pa: 9_333.0, light: 1.0, ..Controls::default() };
        HardwareSample { pose, controls, from_window: WINDOW_ALL, ..HardwareSample::default() }
    }

    fn press(key: Key) -> PointerInput {
        PointerInput { pressed: key.bit(), held: key.bit(), ..PointerInput::default() }
    }

    #[test]
    fn a_session_that_is_over_has_no_current_and_everything_else_goes_on() {
        let mut hand = Hand::default();
        let held = Key::Energize.bit() | Key::Coagulate.bit();
        let keys = PointerInput { held, insertion_m: 0.001, ..PointerInput::default() };
        assert_eq!(hand.follow(&keys, &now()).controls.buttons, BUTTON_ENERGIZED | BUTTON_COAGULATING);
        hand.is_over = true;
        let record = hand.follow(&keys, &now());
        assert_eq!(record.controls.buttons, 0);
        assert!(record.target[3] > 0.041, "{:?}", record.target);
    }

    #[test]
    fn a_window_that_goes_takes_its_finger_off_the_current_and_leaves_the_rest() {
        let mut hand = Hand::default();
        assert_eq!(hand.let_go(), None, "it has said nothing yet");
        hand.follow(&press(Key::LoopOut), &now());
        let held = hand.follow(&PointerInput { insertion_m: 0.002, ..press(Key::Energize) }, &now());
        assert_eq!(held.controls.buttons, BUTTON_ENERGIZED | BUTTON_EXTENDED);
        let controls = Controls { buttons: BUTTON_EXTENDED, ..held.controls };
        assert_eq!(hand.let_go(), Some(PointerRecord { sequence: held.sequence + 1, controls, ..held }));
    }

    #[test]
    fn the_first_record_leaves_the_scope_where_it_is_and_what_was_set_as_it_was() {
        let controls =
            Controls { outflow_valve: 0.0, set_pressure_pa: 5_000.0, focus_m: 0.008, buttons: BUTTON_EXTENDED, ..now().controls };
        let record = Hand::default().follow(&PointerInput::default(), &HardwareSample { controls, ..now() });
        assert_eq!((record.sequence, record.target, record.controls), (1, [0.1, -0.2, 0.3, 0.04, 0.8], controls));
    }

    /// The head was taken for the horizon: after a turn of the scope by more than the reach the horizon was drawn along, farther with each picture.
    #[test]
    fn the_horizon_stays_however_far_the_scope_turns_in_the_head_and_a_successors_window_leaves_it_there() {
        let turned = |roll_rad: f32| {
            let pose = Pose { roll_rad, camera_roll_rad: 0.1 - roll_rad, ..now().pose };
            HardwareSample { pose, ..now() }
        };
        let mut hand = Hand::default();
        let horizons = (0..31).map(|step| hand.follow(&PointerInput::default(), &turned(step as f32 * 0.1)).target[4]);
        let farthest_rad = horizons.map(|horizon_rad| (horizon_rad - 0.1).abs()).fold(0.0, f32::max);
        assert!(farthest_rad < 1e-5, "{farthest_rad} rad");
        let next = Hand::default().follow(&PointerInput::default(), &turned(1.6));
        assert!((next.target[4] - 0.1).abs() < 1e-5, "{next:?}");
    }

    #[test]
    fn a_head_that_goes_along_with_the_scope_stays_where_it_is_on_it_until_the_window_turns_it() {
        let turned = |roll_rad: f32| {
            let pose = Pose { roll_rad, camera_roll_rad: 0.1, ..now().pose };
            HardwareSample { pose, from_window: WINDOW_ALL | WINDOW_HEAD_FREE, ..now() }
        };
        let mut hand = Hand::default();
        let heads = (0..31).map(|step| hand.follow(&PointerInput::default(), &turned(step as f32 * 0.1)).target[4]);
        let farthest_rad = heads.map(|head_rad| (head_rad - 0.1).abs()).fold(0.0, f32::max);
        assert!(farthest_rad < 1e-6, "{farthest_rad} rad");
        let back = hand.follow(&PointerInput { head_rad: -0.2, ..PointerInput::default() }, &turned(3.0));
        assert!((back.target[4] + 0.1).abs() < 1e-6, "{back:?}");
    }

    #[test]
    fn beside_a_device_keys_change_what_it_lacks_and_the_record_repeats_the_rest() {
        let mut hand = Hand::default();
        let lacking = |from_window: u32, sample: HardwareSample| HardwareSample { from_window, ..sample };
        hand.follow(&PointerInput::default(), &lacking(WINDOW_HEAD | WINDOW_INFLOW, now()));
        // The device goes on by itself, and somebody leans on the whole keyboard and the mouse.
        let all = Key::all().fold(0, |bits, key| bits | key.bit());
        let (pitch_rad, yaw_rad, roll_rad, insertion_m, head_rad) = (0.1, 0.1, 0.1, 0.005, 0.1);
        let input = PointerInput {
            pitch_rad,
            yaw_rad,
            roll_rad,
            insertion_m,
            head_rad,
            pressed: all,
            held: all,
            ..PointerInput::default()
        };
        let pose = Pose { pitch_rad: 0.4, roll_rad: 0.2, camera_roll_rad: 0.6, ..now().pose };
        let controls = Controls { buttons: BUTTON_EXTENDED | BUTTON_ENERGIZED, outflow_valve: 0.7, light: 0.6, ..now().controls };
        let record = hand.follow(&input, &lacking(WINDOW_HEAD | WINDOW_INFLOW, HardwareSample { pose, controls, ..now() }));
        assert_eq!(record.controls, Controls { inflow_valve: 0.0, ..controls });
        assert_eq!(record.target[..4], [0.4, -0.2, 0.2, 0.04]);
        assert!((record.target[4] - 0.9).abs() < 1e-5, "{record:?}");
        let own = hand.follow(&input, &lacking(0, now()));
        assert_eq!((own.controls, own.target[..4].to_vec()), (now().controls, vec![0.1, -0.2, 0.3, 0.04]));
    }

    #[test]
    fn a_view_that_goes_up_and_right_turns_the_scope_about_minus_x_and_minus_y() {
        let input = PointerInput { pitch_rad: 0.01, yaw_rad: 0.02, insertion_m: 0.001, ..PointerInput::default() };
        let record = Hand::default().follow(&input, &now());
        assert!((record.target[0] - 0.09).abs() < 1e-6 && (record.target[1] + 0.22).abs() < 1e-6, "{record:?}");
        assert!((record.target[3] - 0.041).abs() < 1e-6);
    }

    #[test]
    fn nothing_is_wound_up_against_an_obstacle_and_no_number_gets_through() {
        let mut hand = Hand::default();
        let push = PointerInput { insertion_m: 0.005, roll_rad: f32::NAN, ..PointerInput::default() };
        for _ in 0..100 {
            let record = hand.follow(&push, &now());
            assert!(record.target[3] <= 0.04 + REACH[3] + 1e-6 && record.target.iter().all(|angle| angle.is_finite()));
        }
        let back = hand.follow(&PointerInput { insertion_m: -0.02, ..push }, &now());
        assert!(back.target[3] < 0.04, "{back:?}");
        let nowhere = Pose { insertion_m: f32::NAN, ..now().pose };
        let lost = hand.follow(&push, &HardwareSample { pose: nowhere, ..now() });
        assert_eq!(lost.target[3], back.target[3]);
    }

    #[test]
    fn keys_turn_valves_and_loop() {
        let mut hand = Hand::default();
        assert_eq!(hand.follow(&press(Key::Inflow), &now()).controls.inflow_valve, 0.0);
        assert_eq!(hand.follow(&press(Key::Inflow), &now()).controls.inflow_valve, 1.0);
        assert_eq!(hand.follow(&press(Key::LoopOut), &now()).controls.buttons, BUTTON_EXTENDED);
        assert_eq!(hand.follow(&press(Key::Energize), &now()).controls.buttons, BUTTON_EXTENDED | BUTTON_ENERGIZED);
        assert_eq!(hand.follow(&press(Key::Coagulate), &now()).controls.buttons, BUTTON_EXTENDED | BUTTON_COAGULATING);
        assert_eq!(hand.follow(&PointerInput::default(), &now()).controls.buttons, BUTTON_EXTENDED);
    }

    #[test]
    fn the_focus_goes_from_where_the_device_has_it_by_a_key_at_a_time() {
        let mut hand = Hand::default();
        let focused = HardwareSample { controls: Controls { focus_m: 0.010, ..now().controls }, ..now() };
        let near_m = hand.follow(&press(Key::FocusNear), &focused).controls.focus_m;
        assert!((near_m - 0.0087).abs() < 1e-4, "{near_m}");
        let held = PointerInput { held: Key::FocusNear.bit(), ..PointerInput::default() };
        assert_eq!(hand.follow(&held, &focused).controls.focus_m, near_m);
        assert!((hand.follow(&press(Key::FocusFar), &focused).controls.focus_m - 0.010).abs() < 1e-6);
    }

    #[test]
    fn the_set_pressure_goes_by_five_mmhg_within_the_pumps_range() {
        let mut hand = Hand::default();
        let up = hand.follow(&press(Key::PressureUp), &now()).controls.set_pressure_pa;
        assert!((up - 9_999.6).abs() < 1.0, "75 mmHg: {up}");
        assert_eq!(
            hand.follow(&PointerInput { held: Key::PressureUp.bit(), ..PointerInput::default() }, &now())
                .controls
                .set_pressure_pa,
            up
        );
        for (key, end_pa) in [(Key::PressureDown, PRESSURE_PA[0]), (Key::PressureUp, PRESSURE_PA[1])] {
            let ends: Vec<f32> = (0..40).map(|_| hand.follow(&press(key), &now()).controls.set_pressure_pa).collect();
            assert_eq!(ends.last(), Some(&end_pa), "{key:?}: {ends:?}");
        }
        let none = Controls { set_pressure_pa: f32::NAN, ..now().controls };
        let record = Hand::default().follow(&press(Key::PressureUp), &HardwareSample { controls: none, ..now() });
        assert!(record.controls.set_pressure_pa.is_nan(), "what is no number is not made one: the device refuses it");
    }

    #[test]
    fn every_key_of_the_help_moves_the_scope_or_sets_something_or_is_of_the_picture() {
        let moves = [
            Key::Down,
            Key::Up,
            Key::Left,
            Key::Right,
            Key::TurnLeft,
            Key::TurnRight,
            Key::Out,
            Key::In,
            Key::HeadLeft,
            Key::HeadRight,
        ];
        for key in Key::all() {
            let mut hand = Hand::default();
            let before = hand.follow(&PointerInput::default(), &now());
            let after = hand.follow(&press(key), &now());
            let is_of_picture = matches!(key, Key::External | Key::Meshes | Key::FullScreen | Key::Framed | Key::Help);
            assert_eq!(after.controls != before.controls, !is_of_picture && !moves.contains(&key), "{key:?}");
        }
    }
}
