//! Promise: a newborn servo computes every tick beside the other one, and may not be chosen before it has agreed with it for long enough.

mod servos;

use hyst_messages::record::FORCE_SHADOW;
use servos::*;

/// Ticks in which a newborn must agree with the other before it may be chosen.
const SHADOW_TICKS: usize = ::haptic::SHADOW_TICKS as usize;

/// A newborn beside a living servo says that it is in its shadow until it has agreed for long enough, and never again after that.
#[test]
fn a_newborn_may_not_be_chosen_before_it_has_agreed() {
    let (station, keeping, links, page) = founded("newborn");
    let a = Servo::start(&station.0, &keeping, &links, 0);
    run(&page, 1..60, &a, &[&a]);
    assert_eq!(a.answer(59).flags & FORCE_SHADOW, 0, "it is alone, and leads");
    let b = Servo::start(&station.0, &keeping, &links, 1);
    let (mut shadow, mut earlier) = (Vec::new(), 0);
    for tick in 60..160 {
        run(&page, tick..tick + 1, &a, &[&a, &b]);
        if tick == 60 {
            // One that is there soon enough answers tick 59, too, whose input is still the newest. Some ticks later its page has that no more.
            earlier = usize::from(b.answered(59).is_some_and(|answer| answer.flags & FORCE_SHADOW != 0));
        }
        shadow.push(b.answer(tick).flags & FORCE_SHADOW != 0);
        assert_eq!(a.answer(tick).flags & FORCE_SHADOW, 0, "who was there stays");
    }
    let ticks = shadow.iter().take_while(|is_in| **is_in).count();
    println!("{earlier} and {ticks} ticks in the shadow");
    assert!((SHADOW_TICKS..SHADOW_TICKS + 20).contains(&(earlier + ticks)), "{earlier} and {ticks}");
    assert!(shadow[ticks..].iter().all(|is_in| !is_in), "{shadow:?}");
    assert_equal(&a, &b, 159);
}
