//! Every point against every tet: the oracle of the hashed test and the floor of the benchmark.

use crate::ContactError;
use crate::sink::Sink;
use crate::tet::TetTest;
use crate::types::{Found, Hit, Points, Tissue};

/// As [`crate::intersect`] for all points, without a hash. Points that are not finite never hit.
///
/// # Errors
/// [`ContactError::Length`] if arrays that belong together differ in length.
pub fn intersect_brute(
    points_m: &[[f32; 3]],
    points: &Points<'_>,
    tissue: &Tissue<'_>,
    out: &mut [Hit],
) -> Result<Found, ContactError> {
    points.check(points_m.len())?;
    tissue.check()?;
    let mut sink = Sink::new(tissue, out);
    for (tet, nodes) in tissue.tets.iter().enumerate() {
        let Some(test) = TetTest::new(&nodes.map(|n| tissue.node(n))) else {
            continue;
        };
        for (point, p) in points_m.iter().enumerate() {
            let Some(weights) = test.weights(*p) else {
                continue;
            };
            if points.may_hit(point as u32, nodes, tissue.tet_owner[tet], &weights) {
                sink.push(Hit { point: point as u32, tet: tet as u32, weights });
            }
        }
    }
    Ok(sink.finish())
}
