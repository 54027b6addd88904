//! A tick of contact, from the hash to the planes, allocates nothing once its buffers exist.

mod common;

use common::tick::Tick;

#[test]
fn a_tick_allocates_nothing() {
    let mut tick = Tick::new([12, 12, 6]);
    let counted = allocation_counter::measure(|| {
        for (_, step) in Tick::STEPS {
            step(&mut tick);
        }
    });
    assert_eq!(counted.count_total, 0);
    assert!(tick.found > 100 && tick.set.count > 0 && tick.wrenches[0].force_n[2] < 0.0);
}
