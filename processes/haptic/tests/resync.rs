//! Promise: two servos that lost different ticks to a stall are equal to the bit again within a few ticks, and neither is restarted. Whose state one goes on from
//! is in its page, for a replay.

mod servos;

use servos::*;

#[test]
fn servos_that_lost_different_ticks_are_equal_again_without_a_restart() {
    let (station, keeping, links, page) = founded("resync");
    let station = &station.0;
    let (a, b) = (Servo::start(station, &keeping, &links, 0), Servo::start(station, &keeping, &links, 1));
    run(&page, 1..60, &a, &[&a, &b]);
    assert_equal(&a, &b, 59);

    // A gap in one: it goes on from the other's state at its first tick.
    b.stop();
    run(&page, 60..67, &a, &[&a]);
    b.go_on();
    run(&page, 67..70, &a, &[&a, &b]);
    assert_equal(&a, &b, 69);
    let taken = b.origins().last().copied().unwrap_or_default();
    assert_eq!((taken.servo, taken.from_servo, taken.from_tick + 1), (1, 0, taken.tick), "{taken:?}");
    assert!((66..68).contains(&taken.tick), "{taken:?}");

    // A gap in the one that the device follows, which followed the other meanwhile.
    a.stop();
    run(&page, 70..73, &b, &[&b]);
    a.go_on();
    run(&page, 73..76, &b, &[&a, &b]);
    assert_equal(&a, &b, 75);

    // Gaps in both, of other ticks: the one that the device does not follow adopts.
    for (first, second, from) in [(&a, &b, 76), (&b, &a, 90)] {
        first.stop();
        run(&page, from..from + 1, second, &[second]);
        second.stop();
        tell(&page, from + 1, second);
        tell(&page, from + 2, second);
        first.go_on();
        second.go_on();
        tell(&page, from + 3, second);
        run(&page, from + 4..from + 12, second, &[first, second]);
        assert_equal(first, second, from + 11);
    }
    drop((a, b));
}
