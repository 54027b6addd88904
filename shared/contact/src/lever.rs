//! The lever of an instrument that slides through a fixed pivot and turns about it: what a force anywhere on it is at its tip.
//!
//! The way of the tip says how all of the instrument moves: along the axis it goes as one, and across it it turns about the pivot. So a force f at a point
//! is felt at the tip as the force T·f that does the same work, f·(way of the point) = (T·f)·(way of the tip): along the axis all of it; across the axis as
//! much as the point has of the way from the pivot to the tip; and what acts along the axis but beside it turns the instrument, too. What turns it about its
//! own axis moves no tip, and is not felt.

use glam::Vec3;

/// A tip that is nearer to the pivot than this has no lever, m: what acts is felt as it is.
const LEAST_M: f32 = 1e-4;
/// A point counts as if it had at least this share of the way from the pivot to the tip, also behind the pivot: of a smaller one a wall would be as far
/// away as one likes.
const LEAST_SHARE: f32 = 0.05;
/// And at most this: before a tip that has hardly come through the pivot it would be as stiff as one likes. Nor is more than this of any force felt: what acts far
/// beside the axis would be felt as far away, or as stiff, as one likes.
const MOST_SHARE: f32 = 2.0;
/// What acts along the axis but beside it turns the instrument as if the tip were at least so far from the pivot, m: on a shorter lever it would be felt as
/// large as one likes.
const LEAST_BESIDE_M: f32 = 0.01;

/// An instrument's lever.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lever {
    tip: Vec3,
    /// Unit vector from the pivot to the tip.
    axis: Vec3,
    /// From the pivot to the tip, m.
    length_m: f32,
}

impl Lever {
    /// That of an instrument whose tip is somewhere; none without a pivot, or where the tip is in it.
    pub(crate) fn of(pivot_m: Option<[f32; 3]>, tip_m: [f32; 3]) -> Option<Lever> {
        let tip = Vec3::from_array(tip_m);
        let way = tip - Vec3::from_array(pivot_m?);
        let length_m = way.length();
        (length_m >= LEAST_M).then(|| Lever { tip, axis: way / length_m, length_m })
    }

    /// What a force of 1 N in a direction, at a place, is at the tip.
    pub(crate) fn felt(&self, place_m: [f32; 3], force: Vec3) -> Vec3 {
        let from_tip = Vec3::from_array(place_m) - self.tip;
        let ahead_m = from_tip.dot(self.axis);
        let beside_m = from_tip - self.axis * ahead_m;
        let share = (1.0 + ahead_m / self.length_m).clamp(LEAST_SHARE, MOST_SHARE);
        let along = force.dot(self.axis);
        let across = force - self.axis * along;
        let felt = self.axis * along + across * share - beside_m * (along / self.length_m.max(LEAST_BESIDE_M));
        felt.clamp_length_max(MOST_SHARE)
    }
}
