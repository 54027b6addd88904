//! Friction of the planes on the tip: Coulomb's law, with a bristle that bends before the tip slides (Dahl 1968).
//!
//! The bristle is how far the tip has been moved along the planes since it last slid, in the directions in which they let it go: what of a motion lies along a
//! plane's normal is that plane's push and no friction. It resists as a spring of [`SHARE`] of the coupling, and once it would pull with more than the
//! coefficient times what all planes push with, it slides after the tip. So a tip at rest stays where it is, one that turns back is first let go of, and around a
//! path the hand loses what friction takes and gains nothing: the energy of the bent bristle is no more than the hand has put into it, whatever planes come,
//! go or turn, for it is never longer than before with the way of the tip added (`tests/friction.rs`).
//!
//! Limits: planes are felt at the tip, so friction is that of the force at the tip. Across the edge of a corner no direction is along both walls: there each way
//! bends the bristle by as much of it as lies along them, each by its push.

use glam::DVec3;

use super::types::ServoState;
use crate::contact::Constraints;
use crate::proxy::Proxy;

/// Stiffness of the bristle as a share of the coupling's.
pub(super) const SHARE: f32 = 0.1;
/// Longest bristle that a state may have, m: planes that push with more than a hand can would bend it so far.
pub(super) const MOST_BENT_M: f32 = 1.0;

/// Friction of one tick.
pub(super) struct Friction {
    /// Force on the hand, N.
    pub(super) force_n: DVec3,
    /// What the bristle has stored, J.
    pub(super) stored_j: f64,
}

/// One tick: bends the bristle by the way of the tip since the last one, and lets it slide. `gain`: the share of the planes' push that is felt.
pub(super) fn friction_step(
    next: &mut ServoState,
    (walls, rest, coupling_n_m): (&Constraints, &Proxy, f64),
    gain: f64,
    moved_m: DVec3,
) -> Friction {
    let all_n: f64 = rest.push_n.iter().sum();
    let stiffness_n_m = f64::from(SHARE) * coupling_n_m;
    let most_m = walls.friction * (all_n * gain) / stiffness_n_m;
    if most_m <= 0.0 {
        next.bristle_m = [0.0; 3];
        return Friction { force_n: DVec3::ZERO, stored_j: 0.0 };
    }
    let before_m = DVec3::from_array(next.bristle_m.map(f64::from));
    let bent_m = kept(walls, (rest, all_n), before_m) + along(walls, (rest, all_n), moved_m);
    let (length_m, most_m) = (bent_m.length(), most_m.min((before_m + moved_m).length()));
    let bent_m = if length_m > most_m { bent_m * (most_m / length_m) } else { bent_m };
    // No number stays one.
    let bent_m = if bent_m.length() <= f64::from(MOST_BENT_M) { bent_m } else { DVec3::ZERO };
    next.bristle_m = bent_m.as_vec3().to_array();
    Friction { force_n: -bent_m * stiffness_n_m, stored_j: 0.5 * stiffness_n_m * bent_m.length_squared() }
}

/// What is left of a bristle that was bent where planes were others: nothing along their push, by as much as that is of all that they push with. What they push
/// against each other takes nothing, and so a tip at rest on planes of several normals stays where it is. `all_n`: all that they push with, more than 0.
fn kept(walls: &Constraints, (rest, all_n): (&Proxy, f64), bent_m: DVec3) -> DVec3 {
    let pushed_n = walls.used().iter().zip(rest.push_n).fold(DVec3::ZERO, |sum, (wall, push_n)| sum + wall.normal * push_n);
    let length_n = pushed_n.length();
    if length_n > 0.0 { bent_m - pushed_n * (pushed_n.dot(bent_m) / (length_n * all_n)) } else { bent_m }
}

/// What of a way lies along the planes that push, each counted by its push. `all_n`: likewise.
fn along(walls: &Constraints, (rest, all_n): (&Proxy, f64), way_m: DVec3) -> DVec3 {
    let into_m = walls
        .used()
        .iter()
        .zip(rest.push_n)
        .fold(DVec3::ZERO, |sum, (wall, push_n)| sum + wall.normal * (wall.normal.dot(way_m) * (push_n / all_n)));
    way_m - into_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::{ContactModel, Plane};
    use crate::proxy;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    const COUPLING_N_M: f64 = 1_200.0;

    fn any_plane() -> impl Strategy<Value = Plane> {
        (prop::array::uniform3(-1.0..1.0f32), -2e-3..5e-3f32, 10.0..900.0f32)
            .prop_filter("a direction", |(normal, _, _)| normal.iter().map(|part| part * part).sum::<f32>() > 0.3)
            .prop_map(|(normal, depth_m, stiffness_n_m)| {
                let length = normal.iter().map(|part| part * part).sum::<f32>().sqrt();
                let normal = normal.map(|part| part / length);
                Plane { point_m: normal.map(|part| part * depth_m), normal, stiffness_n_m, damping_n_s_m: 0.0 }
            })
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 1000, failure_persistence: None, rng_seed: RngSeed::Fixed(5), ..ProptestConfig::default() })]

        /// Planes that are others in each tick, and a tip that goes anywhere: what a sampled spring gives on the way of a tick, for which the damping of the device
        /// is there, is all that the hand is given, less what is stored in the end.
        #[test]
        fn whatever_planes_come_and_go_the_hand_is_given_no_more_than_it_has_put_in(
            ticks in prop::collection::vec((prop::collection::vec(any_plane(), 0..=8), prop::array::uniform3(-1e-3..1e-3f64), 0.0..1.0f64), 1..40),
            friction in 0.0..1.0f32,
        ) {
            let stiffness_n_m = f64::from(SHARE) * COUPLING_N_M;
            let (mut state, mut force_n) = (ServoState::default(), DVec3::ZERO);
            let (mut given_j, mut sampled_j) = (0.0, 0.0);
            for (planes, moved_m, gain) in ticks {
                let moved_m = DVec3::from_array(moved_m);
                given_j += force_n.dot(moved_m);
                sampled_j += 0.5 * stiffness_n_m * moved_m.length_squared();
                let model = ContactModel { friction, ..ContactModel::new(&planes) };
                let walls = Constraints::at(&model, DVec3::ZERO, 1.0);
                let rest = proxy::rest(walls.used(), COUPLING_N_M);
                let made = friction_step(&mut state, (&walls, &rest, COUPLING_N_M), gain, moved_m);
                let push_n = gain * rest.push_n.iter().sum::<f64>();
                prop_assert!(made.force_n.length() <= f64::from(friction) * push_n + 1e-9, "{} N of {push_n} N", made.force_n);
                force_n = made.force_n;
                let stored_j = made.stored_j;
                prop_assert!(given_j + stored_j <= sampled_j + 1e-8, "{given_j} J given, {stored_j} J stored, {sampled_j} J sampled");
            }
        }
    }
}
