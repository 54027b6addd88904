//! What keys and mouse do in a window, without one.
use super::*;
use crate::input::{Axis, RAD_PER_PX};

/// The axes that a movement goes along, each with its sign.
fn moved(mut input: PointerInput) -> Vec<(Axis, bool)> {
    let axes = [Axis::Pitch, Axis::Yaw, Axis::Roll, Axis::Insertion, Axis::Head];
    let far = axes.into_iter().map(|axis| (axis, *input.along(axis))).filter(|(_, far)| *far != 0.0);
    far.map(|(axis, far)| (axis, far > 0.0)).collect()
}

#[test]
fn each_motion_of_the_table_is_made_by_its_keys_and_by_its_mouse() {
    for motion in &MOTIONS {
        for ((code, key), is_forth) in motion.keys.into_iter().zip([false, true]) {
            let mut app = App::default();
            app.press(code, ElementState::Pressed, false);
            let input = app.take_input(0.01);
            assert!(input.was_pressed(key) && moved(input) == [(motion.axis, is_forth)], "{key:?}: {input:?}");
            app.press(code, ElementState::Released, false);
            assert_eq!(app.take_input(0.01), PointerInput::default(), "{key:?} was let go");
        }
        let mut app = App::default();
        app.moved(PhysicalPosition::new(50.0, 50.0));
        let to = match motion.mouse {
            Mouse::DragUp(button) => (button, PhysicalPosition::new(50.0, 40.0)),
            Mouse::DragRight(button) => (button, PhysicalPosition::new(60.0, 50.0)),
            Mouse::Wheel => {
                app.wheel(1.0);
                (MouseButton::Middle, PhysicalPosition::new(50.0, 50.0))
            }
        };
        app.button(to.0, ElementState::Pressed);
        app.moved(to.1);
        assert_eq!(moved(app.take_input(0.0)), [(motion.axis, true)]);
    }
}

#[test]
fn a_key_that_repeats_itself_is_pressed_once() {
    let mut app = App::default();
    for is_repeat in [false, true, true] {
        app.press(KeyCode::F1, ElementState::Pressed, is_repeat);
    }
    assert!(app.take_input(0.0).was_pressed(Key::Help));
    app.press(KeyCode::F1, ElementState::Pressed, true);
    assert!(!app.take_input(0.0).was_pressed(Key::Help));
}

#[test]
fn f11_fills_the_screen_and_takes_the_window_back_and_escape_only_takes_it_back() {
    for (is_full, code, is_to_be_full) in [
        (false, KeyCode::F11, true),
        (true, KeyCode::F11, false),
        (false, KeyCode::Escape, false),
        (true, KeyCode::Escape, false),
        (true, KeyCode::F1, true),
    ] {
        let mut app = App { is_full, ..App::default() };
        app.press(code, ElementState::Pressed, false);
        let input = app.take_input(0.0);
        assert_eq!(app.is_to_be_full(&input), is_to_be_full, "{is_full}, {code:?}");
        let later = app.take_input(0.0);
        assert_eq!(app.is_to_be_full(&later), is_full, "a key that is held is pressed once");
    }
}

#[test]
fn a_key_does_what_stands_on_it_and_is_let_go_as_it_was_pressed_though_the_layout_changes_meanwhile() {
    let mut app = App::default();
    let mut held = |place: KeyCode, bears: &str, state: ElementState| {
        app.stroke(place, Some(bears), state, false);
        app.take_input(0.0).held
    };
    let (left, roll) = (Key::HeadLeft.bit(), Key::TurnLeft.bit());
    assert_eq!(held(KeyCode::KeyY, "z", ElementState::Pressed), left, "on a German keyboard");
    assert_eq!(held(KeyCode::KeyA, "q", ElementState::Pressed), left | roll, "on a French one");
    assert_eq!(held(KeyCode::KeyY, "y", ElementState::Released), roll, "on an American one by now");
    assert_eq!(held(KeyCode::KeyA, "a", ElementState::Released), 0);
    assert_eq!(held(KeyCode::KeyY, "y", ElementState::Pressed), 0);
}

#[test]
fn the_mouse_moves_the_scope_only_while_a_button_is_held() {
    let mut app = App::default();
    app.moved(PhysicalPosition::new(10.0, 10.0));
    app.moved(PhysicalPosition::new(30.0, 10.0));
    assert_eq!(app.take_input(0.0), PointerInput::default());
    app.button(MouseButton::Left, ElementState::Pressed);
    app.moved(PhysicalPosition::new(40.0, 5.0));
    let input = app.take_input(0.0);
    assert!((input.yaw_rad - 10.0 * RAD_PER_PX).abs() < 1e-6 && (input.pitch_rad - 5.0 * RAD_PER_PX).abs() < 1e-6);
    assert_eq!(app.take_input(0.0), PointerInput { buttons: 1, ..PointerInput::default() }, "a movement counts once");
}

#[test]
fn a_held_key_moves_with_time_and_a_stall_does_not_make_it_leap() {
    let mut app = App::default();
    app.input.held = Key::In.bit();
    assert!((app.take_input(0.05).insertion_m - 0.001).abs() < 1e-7);
    assert!(app.take_input(1000.0).insertion_m <= 0.0021);
    assert_eq!(app.take_input(f32::NAN).insertion_m, 0.0);
}
