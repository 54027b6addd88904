//! Whether hits that somebody else found are true: those of this share, of these points, in these tets, to the last bit. It costs a test for
//! each hit, a small part of the search. A hit that is missing is not seen.

use crate::lanes::TETS;
use crate::tet::TetTest;
use crate::types::{Hit, Points, Share, Split, Tissue};

/// Whether every hit is true, in the order in which [`crate::intersect`] writes them. A share of points is not told from another.
pub fn are_true(hits: &[Hit], share: Share, points_m: &[[f32; 3]], points: &Points<'_>, tissue: &Tissue<'_>) -> bool {
    let key = |hit: &Hit| (hit.point, hit.tet);
    hits.windows(2).all(|pair| key(&pair[0]) < key(&pair[1]))
        && hits.iter().all(|hit| holds(share, hit.tet) && is_true(hit, points_m, points, tissue))
}

fn holds(share: Share, tet: u32) -> bool {
    match share.split {
        Split::Points => true,
        Split::Tets => (tet / TETS as u32) % share.count.max(1) == share.index,
    }
}

fn is_true(hit: &Hit, points_m: &[[f32; 3]], points: &Points<'_>, tissue: &Tissue<'_>) -> bool {
    let (Some(point), Some(nodes)) = (points_m.get(hit.point as usize), tissue.tets.get(hit.tet as usize)) else {
        return false;
    };
    let weights = TetTest::new(&tissue.corners(hit.tet)).and_then(|test| test.weights(*point));
    weights.is_some_and(|weights| weights.map(f32::to_bits) == hit.weights.map(f32::to_bits))
        && points.may_hit(hit.point, nodes, tissue.owner(hit.tet), &hit.weights)
}
