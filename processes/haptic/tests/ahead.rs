//! Promise: an input of a tick that is not yet, as of a flipped byte or of a device that lies, is none; the next one is answered as ever.

mod servos;

use servos::*;

/// A servo that took it answered nothing until that tick came.
#[test]
fn an_input_of_a_tick_that_is_not_yet_is_refused_and_the_next_one_is_answered() {
    let (station, keeping, links, page) = founded("ahead");
    let a = Servo::start(&station.0, &keeping, &links, 0);
    run(&page, 1..60, &a, &[&a]);
    for (refused, ahead) in [(1, 1 << 17), (2, u64::MAX)] {
        tell(&page, ahead, &a);
        a.has_refused(refused);
    }
    run(&page, 60..100, &a, &[&a]);
    assert_eq!(a.answer(99).tick, 99);
}
