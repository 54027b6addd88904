//! A tick of contact, from the hash to the planes, allocates nothing once its buffers exist.

mod common;

use common::tick::Tick;

#[test]
fn a_tick_allocates_nothing() {
    let mut tick = Tick::new([12, 12, 6]);
    let heights_m: Vec<f32> = tick.tool.points_m.iter().map(|point_m| point_m[2]).collect();
    let counted = allocation_counter::measure(|| {
        // What is near is looked for, remembered, and looked for again; some points come from nowhere.
        for ticks in 0..60u8 {
            for (at, (point_m, height_m)) in tick.tool.points_m.iter_mut().zip(&heights_m).enumerate() {
                let is_nowhere = at % 40 == 0 && ticks < 25;
                point_m[2] = if is_nowhere { f32::NAN } else { height_m + 2e-5 * f32::from(ticks) };
            }
            for (_, step) in Tick::STEPS {
                step(&mut tick);
            }
        }
    });
    assert_eq!(counted.count_total, 0);
    assert!(tick.found > 100 && tick.set.count > 0 && tick.set.force_n(tick.tool.points_m[0])[2] < 0.0);
}
