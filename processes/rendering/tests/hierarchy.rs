//! Promise: what hangs on another object is drawn where that carries it, and goes with it; nothing hangs on itself, however far up.
mod stand;

use glam::{Quat, Vec3};
use rendering::{Material, RenderError, Renderer, shapes};
use stand::*;

#[test]
fn what_hangs_on_another_moves_turns_and_goes_with_it_and_nothing_hangs_on_itself() {
    const JAW: u64 = 3;
    const TIP: u64 = 4;
    let Some(mut r) = renderer() else { return };
    let empty = picture(&mut r, &from_outside());
    put(&mut r, TOOL, &shapes::scope(0.004, 0.1, 0.5), Material::Metal);
    put(&mut r, JAW, &shapes::ball([0.0, 0.0, 0.004], 0.006, 16, 24), Material::Metal);
    put(&mut r, TIP, &shapes::ball([0.0; 3], 0.003, 16, 24), Material::Metal);
    let pose = |r: &mut Renderer, id: u64, at: Vec3, turn: Quat| {
        r.stage().set_pose(id, at.to_array(), turn.to_array()).expect("it is there");
    };
    let (at, turn) = (Vec3::new(0.0, 0.01, 0.04), Quat::from_rotation_x(0.4));
    let (jaw_at, jaw_turn, tip_at) = (Vec3::new(0.0, 0.012, 0.0), Quat::from_rotation_y(0.5), Vec3::new(0.0, 0.0, 0.012));
    // Each in the station's frame, by hand.
    pose(&mut r, TOOL, at, turn);
    pose(&mut r, JAW, at + turn * jaw_at, turn * jaw_turn);
    pose(&mut r, TIP, at + turn * (jaw_at + jaw_turn * tip_at), turn * jaw_turn);
    let by_hand = picture(&mut r, &from_outside());
    r.stage().hang(JAW, Some(TOOL)).unwrap();
    r.stage().hang(TIP, Some(JAW)).unwrap();
    pose(&mut r, JAW, jaw_at, jaw_turn);
    pose(&mut r, TIP, tip_at, Quat::IDENTITY);
    let hung = picture(&mut r, &from_outside());
    let [seen, apart] = [changed(&empty, &by_hand), changed(&by_hand, &hung)];
    assert!(seen > 300 && apart < 20, "{apart} of {seen} pixels differ");
    for (id, on) in [(TOOL, TIP), (TOOL, TOOL), (JAW, TIP)] {
        let refused = r.stage().hang(id, Some(on));
        assert!(matches!(refused, Err(RenderError::Circle { object, on: above }) if (object, above) == (id, on)), "{refused:?}");
    }
    assert!(matches!(r.stage().hang(TIP, Some(99)), Err(RenderError::UnknownObject(99))));
    assert!(matches!(r.stage().hang(99, None), Err(RenderError::UnknownObject(99))));
    put(&mut r, JAW, &shapes::ball([0.0, 0.0, 0.004], 0.006, 16, 24), Material::Metal);
    assert_eq!(
        changed(&hung, &picture(&mut r, &from_outside())),
        0,
        "what is made anew hangs where it did, and what was refused changes nothing"
    );
    r.stage().hang(TIP, None).unwrap();
    assert!(r.stage().remove_object(TOOL));
    assert_eq!(r.stage().ids().collect::<Vec<_>>(), [TIP], "the jaw has gone with the tool, and what was let loose has not");
}
