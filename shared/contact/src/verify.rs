//! Whether hits that somebody else found are true: those of this share, of these points, in these tets, to the last bit; and whether any is missing of
//! those that are likely. It costs a test for each hit and candidate, a small part of the search.

use crate::lanes::TETS;
use crate::tet::TetTest;
use crate::types::{Hit, Points, Share, Split, Tissue};

/// Whether every hit is true, in the order in which [`crate::intersect`] writes them. A share of points is not told from another.
pub fn are_true(hits: &[Hit], share: Share, points_m: &[[f32; 3]], points: &Points<'_>, tissue: &Tissue<'_>) -> bool {
    let key = |hit: &Hit| (hit.point, hit.tet);
    hits.windows(2).all(|pair| key(&pair[0]) < key(&pair[1]))
        && hits.iter().all(|hit| holds(share, hit.tet) && is_true(hit, points_m, points, tissue))
}

/// Whether none of these candidates is missing: each whose tet is of the share, and whose point lies in it now, has a hit of its point in the same object
/// in that tet or in a lower one, which is what [`crate::intersect`] keeps. The hits are in its order. Candidates that are not true count for nothing, so that hits
/// of a step before, or of a part of the share, will do.
pub fn has_all_of(
    candidates: &[Hit],
    hits: &[Hit],
    share: Share,
    points_m: &[[f32; 3]],
    points: &Points<'_>,
    tissue: &Tissue<'_>,
) -> bool {
    let is_same_object = |hit: &Hit, candidate: &Hit| {
        (hit.tet as usize) < tissue.tets.len() && tissue.owner(hit.tet) == tissue.owner(candidate.tet)
    };
    let is_told = |candidate: &Hit| {
        let from = hits.partition_point(|hit| hit.point < candidate.point);
        let mut of_point = hits[from..].iter().take_while(|hit| hit.point == candidate.point && hit.tet <= candidate.tet);
        of_point.any(|hit| is_same_object(hit, candidate))
    };
    let is_true_now = |candidate: &&Hit| holds(share, candidate.tet) && weights_of(candidate, points_m, points, tissue).is_some();
    candidates.iter().filter(is_true_now).all(is_told)
}

fn holds(share: Share, tet: u32) -> bool {
    match share.split {
        Split::Points => true,
        Split::Tets => (tet / TETS as u32) % share.count.max(1) == share.index,
    }
}

/// The weights of the hit's point in its tet, if it lies there and may hit it.
fn weights_of(hit: &Hit, points_m: &[[f32; 3]], points: &Points<'_>, tissue: &Tissue<'_>) -> Option<[f32; 4]> {
    let (point, nodes) = (points_m.get(hit.point as usize)?, tissue.tets.get(hit.tet as usize)?);
    let weights = TetTest::new(&tissue.corners(hit.tet))?.weights(*point)?;
    points.may_hit(hit.point, nodes, tissue.owner(hit.tet), &weights).then_some(weights)
}

fn is_true(hit: &Hit, points_m: &[[f32; 3]], points: &Points<'_>, tissue: &Tissue<'_>) -> bool {
    weights_of(hit, points_m, points, tissue).is_some_and(|weights| weights.map(f32::to_bits) == hit.weights.map(f32::to_bits))
}
