//! What a servo makes of the planes of a press for a hand that holds the tip where they were made: what they say.

use crate::bench::press::{Press, Record};
use crate::served::{Servo, Tip, model_of};
use glam::Vec3;

/// Ticks after which a servo that has just begun feels planes in full.
const WARM_TICKS: u64 = 1_000;
/// How far what is felt may be from what is told, as a share: places of planes are rounded to some nanometres.
const MOST: f32 = 1e-3;

/// Fails if the hand would feel another force than it is told in a tick.
pub fn assert_felt(what: &str, tick: usize, (press, record): &(Press, Record)) {
    let (model, tip) = (model_of(press.planes()), Tip { place_m: press.tip_m(tick).into(), ..Tip::default() });
    let mut servo = Servo::default();
    (1..=WARM_TICKS).for_each(|tick| servo.tick(tick, tip, &model, 1));
    let (told_n, served_n) = (Vec3::from(record.told_n), servo.force_n);
    let off_n = told_n.distance(served_n);
    assert!(off_n <= MOST * told_n.length() + 1e-4, "{what}, tick {tick}: {served_n} N are felt of {told_n} N");
}
