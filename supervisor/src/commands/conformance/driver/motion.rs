//! Whether a driver's motion is what it says, and what it is told: a tip that is pushed goes the way of the push, and its velocity is that of its place. One
//! whose axes are reversed, swapped or in other units keeps a ledger without a flaw, and makes of a wall one that draws the hand in.

use super::bench::{Bench, Seen, fresh};
use super::{REST_TICKS, is_within};
use hyst_messages::DeviceStatement;

const AXES: [&str; 3] = ["x", "y", "z"];
/// Signs of the pushes along an axis, the Thue–Morse sequence: of their differences in [`answer_m`] nothing is left of a tip that coasts, or that somebody
/// moves at a speed that stays or grows evenly.
const SIGNS: [f32; 8] = [1.0, -1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0];
/// Ticks of each push, and in which its force comes. Shorter than half a swing of a hand that holds the tip on 300 N/m with 150 g (70 ms), so that one that is
/// hardly damped goes along with each push, too.
const PUSH_TICKS: u64 = 40;
const TURN_TICKS: u64 = 10;
/// Ticks of samples before the first push: where the tip is as it begins a sample says that was stamped before, and the first that is seen may be a later one.
const LOOK_TICKS: u64 = 5;
/// A tip that went less far was held, m: a light grip (300 N/m, 13.4 N·s/m) lets it go 0.4 mm under 0.3 N. And in steps of its resolution.
const HELD_M: f32 = 1e-4;
const HELD_STEPS: f32 = 2.0;
/// Velocities are compared over spans of this length, s, in which the tip went faster than that, m/s: a filter of some ms changes nothing of them.
const SPAN_S: f64 = 0.1;
const SPEED_M_S: f64 = 0.005;
/// Fewer spans along an axis tell nothing.
const FEWEST_SPANS: usize = 5;
/// How far the velocity may be from the difference quotient of the place, as a share of it.
const SPEED_OFF: f64 = 0.3;

/// Pushes the tip to and fro along each axis, and looks where it goes.
pub fn pushed(bench: &mut Bench, stated: &DeviceStatement, most_n: f32) -> Result<String, String> {
    let held_m = HELD_M.max(HELD_STEPS * stated.resolution_m);
    let mut told = Vec::new();
    for axis in 0..AXES.len() {
        let begun = bench.tick() + 1 + LOOK_TICKS;
        bench.drive(LOOK_TICKS + SIGNS.len() as u64 * PUSH_TICKS + REST_TICKS, |tick| {
            let mut force_n = [0.0; 3];
            force_n[axis] = most_n * share(tick.saturating_sub(begun));
            Some(fresh(tick, force_n))
        });
        let mut at_m = [[0.0; 3]; SIGNS.len() + 1];
        for (push, at_m) in at_m.iter_mut().enumerate() {
            *at_m = bench.position_m(begun + push as u64 * PUSH_TICKS).ok_or("no sample came")?;
        }
        told.push(verdict(axis, answer_m(&at_m), held_m)?);
    }
    Ok(format!("under {most_n:.2} N: {}", told.join(", ")))
}

/// The force so many ticks after the pushes have begun, as a share of the largest, -1 to 1; none once they are over.
fn share(since: u64) -> f32 {
    let of_push = |push: u64| SIGNS.get(push as usize).copied().unwrap_or(0.0);
    let (push, into) = (since / PUSH_TICKS, since % PUSH_TICKS);
    let before = push.checked_sub(1).map_or(0.0, of_push);
    before + (of_push(push) - before) * (into as f32 / TURN_TICKS as f32).min(1.0)
}

/// How far the tip went with a push, m along each axis, from where it was at their beginnings and at the end of the last: with the first of each four, and less
/// what it did in the third. A spring, a mass and a damper all give one that has the push's sign.
fn answer_m(at_m: &[[f32; 3]; SIGNS.len() + 1]) -> [f32; 3] {
    let went_m = |push: usize, axis: usize| at_m[push + 1][axis] - at_m[push][axis];
    std::array::from_fn(|axis| (went_m(0, axis) - went_m(2, axis) - went_m(4, axis) + went_m(6, axis)) / 4.0)
}

/// What is said of an answer to pushes along an axis; an error if the tip went another way. Of one that is held nothing is known.
fn verdict(axis: usize, answer_m: [f32; 3], held_m: f32) -> Result<String, String> {
    let size_m = |other: &usize| answer_m[*other].abs();
    let most = (0..AXES.len()).max_by(|a, b| size_m(a).total_cmp(&size_m(b))).unwrap_or(axis);
    let (name, mm) = (AXES[axis], answer_m[most] * 1e3);
    if !is_within(held_m, size_m(&most)) {
        return Ok(format!("{name} held"));
    }
    if most != axis {
        return Err(format!("pushed along {name} the tip went {mm:.2} mm along {}: axes are swapped", AXES[most]));
    }
    if mm < 0.0 {
        return Err(format!("pushed along {name} the tip went {mm:.2} mm, against its force: an axis is reversed"));
    }
    Ok(format!("{name} {mm:.2} mm"))
}

/// Whether the velocity that is said is that of the place, along each axis.
pub fn speeds(seen: &[Seen]) -> Result<String, String> {
    let spans = spans(seen);
    let mut told = Vec::new();
    for (axis, name) in AXES.iter().enumerate() {
        let each = spans.iter().map(|span| (said_m(span, axis), went_m(span, axis), SPEED_M_S * seconds(span)));
        let moving: Vec<_> = each.filter(|(_, went_m, least_m)| went_m.abs() > *least_m).collect();
        if moving.len() < FEWEST_SPANS {
            continue;
        }
        let sum = |product: fn(&(f64, f64, f64)) -> f64| moving.iter().map(product).sum::<f64>();
        let share = sum(|(said_m, went_m, _)| said_m * went_m) / sum(|(_, went_m, _)| went_m * went_m);
        if !(1.0 - SPEED_OFF..=1.0 + SPEED_OFF).contains(&share) {
            return Err(format!("along {name} velocity_m_s is {share:.2} times as fast as position_m goes"));
        }
        told.push(format!("{name} {share:.2}"));
    }
    let text = if told.is_empty() { "it moved too little to tell".into() } else { told.join(", ") };
    Ok(text)
}

/// The samples of each span; one in which nobody looked is none.
fn spans(seen: &[Seen]) -> Vec<&[Seen]> {
    let mut spans = Vec::new();
    let mut from = 0;
    for to in 1..seen.len() {
        let span = &seen[from..=to];
        if seconds(span) >= SPAN_S {
            from = to;
            spans.extend((seconds(span) < 2.0 * SPAN_S).then_some(span));
        }
    }
    spans
}

/// How long a span is, by the stamps of its samples.
fn seconds(span: &[Seen]) -> f64 {
    let ends = span.first().zip(span.last());
    ends.map_or(0.0, |(first, last)| last.sample.time_ns.saturating_sub(first.sample.time_ns) as f64 * 1e-9)
}

/// How far the tip went in a span, m.
fn went_m(span: &[Seen], axis: usize) -> f64 {
    let ends = span.first().zip(span.last());
    ends.map_or(0.0, |(first, last)| f64::from(last.sample.pose.position_m[axis]) - f64::from(first.sample.pose.position_m[axis]))
}

/// How far it went in a span by the velocities that are said, m.
fn said_m(span: &[Seen], axis: usize) -> f64 {
    let mean = |two: &[Seen]| two.iter().map(|it| f64::from(it.sample.velocity_m_s[axis])).sum::<f64>() / 2.0;
    span.windows(2).map(|two| mean(two) * seconds(two)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::{HardwareSample, Pose, TICK_NS};

    /// A tip of some mass on a spring and a damper, which somebody moves besides, at a speed that grows evenly.
    #[derive(Clone, Copy)]
    struct Tip {
        mass_kg: f32,
        stiffness_n_m: f32,
        damping_n_s_m: f32,
        speed_m_s: f32,
        growth_m_s2: f32,
    }

    /// The samples of a tip that is pushed along y with 0.3 N, a millisecond apart.
    fn samples(tip: Tip) -> Vec<Seen> {
        let (mut own_m, mut own_m_s) = (0.0f32, 0.0f32);
        let sample = |tick: u64| {
            let (time_s, step_s) = (tick as f32 * 1e-3, 1e-3);
            let moved_m = tip.speed_m_s * time_s + tip.growth_m_s2 * time_s * time_s / 2.0;
            let pose = Pose { position_m: [0.0, own_m + moved_m, 0.045], ..Pose::default() };
            let velocity_m_s = [0.0, own_m_s + tip.speed_m_s + tip.growth_m_s2 * time_s, 0.0];
            let push_n = 0.3 * share(tick) - tip.stiffness_n_m * own_m - tip.damping_n_s_m * own_m_s;
            own_m_s += push_n / tip.mass_kg * step_s;
            own_m += own_m_s * step_s;
            let time_ns = tick * TICK_NS;
            Seen { sample: HardwareSample { time_ns, pose, velocity_m_s, ..HardwareSample::default() }, seen_ns: time_ns }
        };
        (0..1_000).map(sample).collect()
    }

    fn answer_of(tip: Tip) -> [f32; 3] {
        let seen = samples(tip);
        answer_m(&std::array::from_fn(|push| seen[push * PUSH_TICKS as usize].sample.pose.position_m))
    }

    const HELD: Tip = Tip { mass_kg: 0.15, stiffness_n_m: 300.0, damping_n_s_m: 13.4, speed_m_s: 0.0, growth_m_s2: 0.0 };
    const FREE: Tip = Tip { mass_kg: 0.3, stiffness_n_m: 0.0, damping_n_s_m: 0.6, ..HELD };

    #[test]
    fn whatever_holds_a_tip_it_goes_the_way_of_the_push_and_whoever_moves_it_beside_is_not_taken_for_that() {
        let tips = [
            HELD,
            FREE,
            Tip { mass_kg: 0.05, ..FREE },
            Tip { damping_n_s_m: 2.0, ..HELD },
            Tip { speed_m_s: 0.02, ..HELD },
            Tip { speed_m_s: -0.02, growth_m_s2: 0.1, ..HELD },
            Tip { speed_m_s: -0.02, growth_m_s2: -0.1, ..FREE },
        ];
        for (at, tip) in tips.into_iter().enumerate() {
            let [x, y, z] = answer_of(tip);
            assert!((2e-4..0.01).contains(&y) && [x, z] == [0.0; 2], "tip {at}: {x} {y} {z} m");
        }
        let [_, still_m, _] = answer_of(HELD);
        let [_, moved_m, _] = answer_of(Tip { speed_m_s: 0.02, growth_m_s2: 0.1, ..HELD });
        assert!((still_m - moved_m).abs() < 1e-6, "{still_m} m and {moved_m} m");
        let [_, clamped_m, _] = answer_of(Tip { stiffness_n_m: 1e5, damping_n_s_m: 100.0, ..HELD });
        assert!(clamped_m.abs() < HELD_M, "{clamped_m} m of one that is held fast");
    }

    #[test]
    fn a_tip_that_goes_against_its_force_or_along_another_axis_is_named_and_of_one_that_is_held_nothing_is_said() {
        assert_eq!(verdict(1, [1e-4, 5e-4, 0.0], HELD_M), Ok("y 0.50 mm".into()));
        assert_eq!(verdict(1, [0.0, 5e-5, -9e-5], HELD_M), Ok("y held".into()));
        assert_eq!(verdict(1, [0.0, f32::NAN, 0.0], HELD_M), Ok("y held".into()));
        let [reversed, swapped] =
            [[0.0, -5e-4, 1e-4], [-5e-4, 1e-4, 0.0]].map(|answer_m| verdict(1, answer_m, HELD_M).unwrap_err());
        assert!(reversed.contains("against its force"), "{reversed}");
        assert!(swapped.contains("went -0.50 mm along x"), "{swapped}");
    }

    #[test]
    fn a_velocity_is_that_of_the_place_or_it_is_said_how_far_it_is_off() {
        let seen = samples(Tip { speed_m_s: 0.02, ..FREE });
        assert_eq!(speeds(&seen), Ok("y 1.00".into()));
        for (factor, words) in [(-1.0, "y velocity_m_s is -1.00 times"), (1e3, "times"), (0.25, "y velocity_m_s is 0.25 times")] {
            let said: Vec<Seen> = seen.iter().map(|it| times(it, factor)).collect();
            assert!(speeds(&said).is_err_and(|why| why.contains(words)), "{factor}");
        }
        let still = samples(Tip { stiffness_n_m: 1e5, damping_n_s_m: 100.0, ..HELD });
        assert_eq!(speeds(&still), Ok("it moved too little to tell".into()));
        assert_eq!(speeds(&[]), Ok("it moved too little to tell".into()));
    }

    /// A sample whose velocity is so many times as large.
    fn times(seen: &Seen, factor: f32) -> Seen {
        let sample = HardwareSample { velocity_m_s: seen.sample.velocity_m_s.map(|c| factor * c), ..seen.sample };
        Seen { sample, ..*seen }
    }
}
