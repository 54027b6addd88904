//! The largest piece that came free, as the tissue tells it: whoever looks how often finds the same.
//!
//! A recording of before that was told knows the sum of what was removed, which grows by what the loop burns, too, and by a loose piece that is brought out. There
//! a piece has come free where there are more objects than before, those that have left counted with the rest; of pieces that come free between two statuses the
//! sum counts.

use hyst_messages::TissueStatus;
use serde::{Deserialize, Serialize};

/// Pieces so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Pieces {
    /// Volume of the largest, ml; 0 before the first.
    pub(crate) largest_ml: f64,
    /// Objects that there were so far; `None` in a recording of before they were counted, where everything that is removed at once is taken for a piece.
    objects: Option<u64>,
}

impl Pieces {
    /// Takes a status, before which so much was removed, ml; `None` before the first.
    pub(crate) fn take(&mut self, status: &TissueStatus, before_ml: Option<f64>) {
        if status.largest_piece_ml.is_finite() {
            self.largest_ml = self.largest_ml.max(status.largest_piece_ml);
            return;
        }
        let objects = objects_so_far(status);
        let before = std::mem::replace(&mut self.objects, objects);
        let has_come_free = before.zip(objects).is_none_or(|(before, now)| now > before);
        if let Some(before_ml) = before_ml.filter(|_| has_come_free) {
            self.largest_ml = self.largest_ml.max(status.removed_volume_ml - before_ml);
        }
    }
}

/// Objects that there are, and those that have left through the outflow or in the jaws. There are always some: 0 is what an old recording says.
fn objects_so_far(status: &TissueStatus) -> Option<u64> {
    let left = u64::from(status.washed_out) + u64::from(status.taken_out);
    (status.objects > 0).then(|| u64::from(status.objects) + left)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The largest piece after statuses with so much removed, so many objects, washed out, taken out, that say nothing of pieces.
    fn largest_ml(story: &[(f64, u32, u32, u32)]) -> f64 {
        let (mut pieces, mut before_ml) = (Pieces::default(), None);
        for (removed_volume_ml, objects, washed_out, taken_out) in story.iter().copied() {
            let counts = TissueStatus { objects, washed_out, taken_out, ..TissueStatus::default() };
            let status = TissueStatus { removed_volume_ml, largest_piece_ml: f64::NAN, ..counts };
            pieces.take(&status, before_ml);
            before_ml = Some(removed_volume_ml);
        }
        pieces.largest_ml
    }

    #[test]
    fn what_the_loop_burns_is_no_piece_and_what_comes_free_is_one() {
        assert_eq!(largest_ml(&[(0.0, 3, 0, 0), (0.25, 3, 0, 0), (0.75, 3, 0, 0)]), 0.0);
        assert_eq!(largest_ml(&[(0.0, 3, 0, 0), (0.25, 3, 0, 0), (0.375, 4, 0, 0), (1.0, 4, 0, 0)]), 0.125);
        assert_eq!(largest_ml(&[(0.5, 4, 0, 0)]), 0.0, "what was there at the beginning is nobody's");
    }

    #[test]
    fn a_piece_that_leaves_is_no_other_one_and_one_that_comes_free_while_another_leaves_is() {
        assert_eq!(largest_ml(&[(0.0, 4, 0, 0), (0.5, 3, 0, 1), (0.5, 2, 1, 1)]), 0.0, "a loose piece is brought out");
        assert_eq!(largest_ml(&[(0.0, 4, 0, 0), (0.5, 4, 1, 0)]), 0.5);
    }

    #[test]
    fn a_tissue_that_tells_of_its_pieces_is_believed_however_seldom_it_is_heard() {
        let heard = |statuses: &[(f64, f64, u32)]| {
            let (mut pieces, mut before_ml) = (Pieces::default(), None);
            for (removed_volume_ml, largest_piece_ml, objects) in statuses.iter().copied() {
                let status = TissueStatus { removed_volume_ml, largest_piece_ml, objects, ..TissueStatus::default() };
                pieces.take(&status, before_ml);
                before_ml = Some(removed_volume_ml);
            }
            pieces.largest_ml
        };
        // A quarter is burnt, then two pieces come free.
        let all = [(0.0, 0.0, 3), (0.25, 0.0, 3), (0.75, 0.5, 4), (1.0, 0.5, 5)];
        assert_eq!((heard(&all), heard(&[all[0], all[3]]), heard(&all[3..])), (0.5, 0.5, 0.5));
        assert_eq!(heard(&all[..2]), 0.0);
    }

    #[test]
    fn without_a_count_of_the_objects_all_that_is_removed_at_once_is_a_piece() {
        assert_eq!(largest_ml(&[(0.0, 0, 0, 0), (0.25, 0, 0, 0), (0.375, 0, 0, 0)]), 0.25);
    }
}
