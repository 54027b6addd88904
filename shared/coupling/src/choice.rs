//! Which of the two haptic replicas the device follows.
//!
//! It promises: the selected replica while it delivers; the other one, and from then on, when it does not; and if both
//! deliver but not the same bits, the force nearer to what the hand feels now, while the other replica is named for a restart.

use glam::DVec3;

use crate::vector::is_finite;

/// The outcome of a choice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// The replica that is selected from now on, 0 or 1.
    pub index: usize,
    /// Its force, N; `None` if neither delivered.
    pub force_n: Option<[f32; 3]>,
    /// The replica to restart, because both were valid and differed.
    pub disagreement: Option<usize>,
}

/// Chooses between the valid forces `a` (replica 0) and `b` (replica 1) of one tick, N on the hand.
///
/// A force that is not finite counts as absent; all other checks are `valid_force`'s. `selected` is the replica followed so
/// far (anything but 0 counts as 1). Equal bits keep the selection; at equal distance from `last_applied_n` too.
pub fn choose(last_applied_n: [f32; 3], a: Option<[f32; 3]>, b: Option<[f32; 3]>, selected: usize) -> Choice {
    let forces = [a.filter(|f| is_finite(*f)), b.filter(|f| is_finite(*f))];
    let selected = selected.min(1);
    let other = 1 - selected;
    let distance = |force: [f32; 3]| to_f64(force).distance(to_f64(last_applied_n));
    let (index, disagreement) =
        match (forces[selected], forces[other]) {
            (Some(mine), Some(theirs)) if mine.map(f32::to_bits) != theirs.map(f32::to_bits) => {
                if distance(theirs) < distance(mine) { (other, Some(selected)) } else { (selected, Some(other)) }
            }
            (None, Some(_)) => (other, None),
            _ => (selected, None),
        };
    Choice { index, force_n: forces[index], disagreement }
}

/// Doubles, so that no finite force overflows when squared.
fn to_f64(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAST: [f32; 3] = [0.0, 0.0, 1.0];
    const NEAR: [f32; 3] = [0.0, 0.0, 1.1];
    const FAR: [f32; 3] = [0.0, 0.0, 2.0];
    const NAN: [f32; 3] = [f32::NAN, 0.0, 0.0];

    /// The whole table: (a, b, selected) → (index, force, restart).
    type Row = (Option<[f32; 3]>, Option<[f32; 3]>, usize, usize, Option<[f32; 3]>, Option<usize>);

    #[test]
    fn truth_table() {
        let rows: [Row; 14] = [
            (Some(NEAR), Some(NEAR), 0, 0, Some(NEAR), None),
            (Some(NEAR), Some(NEAR), 1, 1, Some(NEAR), None),
            (Some(NEAR), None, 0, 0, Some(NEAR), None),
            (Some(NEAR), None, 1, 0, Some(NEAR), None),
            (None, Some(NEAR), 0, 1, Some(NEAR), None),
            (None, Some(NEAR), 1, 1, Some(NEAR), None),
            (None, None, 0, 0, None, None),
            (None, None, 1, 1, None, None),
            (Some(NEAR), Some(FAR), 0, 0, Some(NEAR), Some(1)),
            (Some(FAR), Some(NEAR), 0, 1, Some(NEAR), Some(0)),
            (Some(NEAR), Some(FAR), 1, 0, Some(NEAR), Some(1)),
            (Some(NAN), Some(FAR), 0, 1, Some(FAR), None),
            (Some(NAN), Some(NAN), 0, 0, None, None),
            (Some([0.1, 0.0, 1.0]), Some([-0.1, 0.0, 1.0]), 1, 1, Some([-0.1, 0.0, 1.0]), Some(0)),
        ];
        for (a, b, selected, index, force_n, disagreement) in rows {
            let expected = Choice { index, force_n, disagreement };
            assert_eq!(choose(LAST, a, b, selected), expected, "a {a:?} b {b:?} selected {selected}");
        }
    }

    #[test]
    fn the_selection_stays_with_the_replica_that_took_over() {
        let taken = choose(LAST, None, Some(NEAR), 0);
        assert_eq!(choose(LAST, Some(NEAR), Some(NEAR), taken.index).index, 1);
    }
}
