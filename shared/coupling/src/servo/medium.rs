//! What the medium does to the scope, as the hand feels it: smooth between two states of the fluid, and passive.
//!
//! The fluid says some thirty times a second what it did to the scope a period ago. Each tick goes a 32nd of the way there, so that a change is felt over some
//! 32 ms, and by 2 mN at most. What comes late can drive a hand: a force against its acceleration of a period ago pushes it on. So the medium gives the hand no
//! more than it took from it (at most 1 mJ of that), and 1 mJ, of which a debt is forgotten in half a second: a tenth of what the last hop lets pass
//! ([`crate::energy`]). Less than 2 mN is no force, and of more it is what is beyond: no hand feels it, and a force that stays what it was for a period while
//! the tip goes on is taken for one that stands still by whoever watches. So what is felt is always on its way.

use glam::Vec3;

use super::types::ServoState;
use crate::vector::{clamp_length, sane};

/// Most force along an axis that is believed of a medium, N.
pub(super) const MAX_MEDIUM_N: f32 = 0.5;
/// Most that it may have in credit or in debt, J.
pub(super) const RESERVE_J: f32 = 1e-3;
/// Part of the way to the force that is wanted, in a tick.
const PART: f32 = 1.0 / 32.0;
/// Largest change of the force in a tick, N: a twentieth of what a contact model may cause.
const MOST_STEP_N: f32 = 0.002;
/// A force that goes to nothing is nothing where it is so small, N.
const NEAR_N: f32 = 1e-6;
/// What is left of a debt after a tick.
const LEFT: f32 = 1.0 - 1.0 / 500.0;

/// Less is not felt, N.
const LEAST_FELT_N: f32 = 0.002;

/// What a servo is to make of the force that the fluid says: what of it is beyond the least that is felt. No number stays none.
pub fn felt_of_medium_n(on_scope_n: [f32; 3]) -> [f32; 3] {
    let length_n = Vec3::from_array(on_scope_n).length();
    if length_n <= LEAST_FELT_N { [0.0; 3] } else { on_scope_n.map(|newton| newton * (1.0 - LEAST_FELT_N / length_n)) }
}

/// One tick: books what the force of the tick before has done while the tip went by `moved_m`, and gives the force of this one, N.
pub(super) fn medium_step(next: &mut ServoState, wanted_n: [f32; 3], moved_m: Vec3) -> Vec3 {
    let last_n = Vec3::from_array(next.medium_n);
    let left_j = if next.medium_j < 0.0 { next.medium_j * LEFT } else { next.medium_j };
    next.medium_j = sane(left_j - last_n.dot(moved_m), -RESERVE_J, RESERVE_J, 0.0);
    let share = (1.0 + next.medium_j / RESERVE_J).clamp(0.0, 1.0);
    let wanted_n = Vec3::from_array(wanted_n.map(|newton| sane(newton, -MAX_MEDIUM_N, MAX_MEDIUM_N, 0.0))) * share;
    let way_n = wanted_n - last_n;
    let force_n = if wanted_n == Vec3::ZERO && way_n.length() <= NEAR_N {
        wanted_n
    } else {
        last_n + clamp_length(way_n * PART, MOST_STEP_N)
    };
    next.medium_n = force_n.to_array();
    force_n
}
