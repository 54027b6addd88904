//! Promise: the page of a servo that lives may come late; until it is there nobody can be agreed with, and the newborn is not alone either.

mod servos;

use hyst_messages::page::station as layout;
use hyst_messages::record::FORCE_SHADOW;
use hyst_messages::{Role, Slot};
use servos::*;

#[test]
fn a_newborn_that_has_not_seen_the_other_ones_page_yet_may_not_be_chosen() {
    let (station, keeping, links, page) = founded("unseen");
    let other = Slot::new(Role::Haptic, 1).unwrap();
    announce(&keeping, other, 77);
    let a = Servo::start(&station.0, &keeping, &links, 0);
    run(&page, 1..100, &a, &[&a]);
    let in_shadow = |tick: u64| a.answer(tick).flags & FORCE_SHADOW != 0;
    assert!((93..100).all(in_shadow), "another one lives");
    keeping.store32(layout::SLOT_DEAD + other.number(), 1);
    run(&page, 100..160, &a, &[&a]);
    assert!(!in_shadow(159), "now it is alone, and leads");
}
