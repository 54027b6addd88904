//! The nearest way out of a tet that lies at the surface. Where a contact is young, as between two tissues that a step brought together, a point is
//! just behind a face of the very tet that holds it; and where two surfaces coincide, as those of a fresh cut, its depth is 0.

use crate::topology::{FACES, NONE, Topology};
use crate::types::Tissue;
use glam::Vec3;

/// Depth of a point behind the nearest boundary face of the tet that holds it, m, and the unit vector out through that face. `weights` are the point's in the
/// tet. Of a point that came in by a way that is known, `before` is that way back out: faces that look against it are none. `None` if no other face of the tet
/// is on the boundary, or all that are have no area.
pub fn own_face(
    tissue: &Tissue<'_>,
    topology: &Topology,
    tet: u32,
    weights: &[f32; 4],
    before: Option<[f32; 3]>,
) -> Option<(f32, [f32; 3])> {
    let behind = topology.neighbours.get(tet as usize)?;
    let corners = tissue.corners(tet).map(Vec3::from_array);
    let faces = (0..4).filter(|face| behind[*face] == NONE).filter_map(|face| {
        let [a, b, c] = FACES[face].map(|corner| corners[corner]);
        let normal = (b - a).cross(c - a).try_normalize()?;
        let height_m = (a - corners[face]).dot(normal);
        let out = if height_m < 0.0 { -normal } else { normal };
        let is_against = before.is_some_and(|before| Vec3::from_array(before).dot(out) < 0.0);
        let depth_m = weights[face].max(0.0) * height_m.abs();
        (depth_m.is_finite() && !is_against).then_some((depth_m, out.to_array()))
    });
    faces.min_by(|a, b| a.0.total_cmp(&b.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_face_of_the_boundary_is_the_way_out() {
        let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.0], [1.0, 1.0, 1.0]];
        let tets = [[0, 1, 2, 3], [1, 2, 3, 4]];
        let topology = Topology::new(&tets, &[0, 0], &positions).unwrap();
        let tissue = Tissue { positions_m: &positions, tets: &tets, tet_owner: &[0, 0] };
        // At (0.1, 0.3, 0.4): 0.1 behind x = 0, and the slanted face is not on the boundary.
        let (depth_m, out) = own_face(&tissue, &topology, 0, &[0.4, 0.1, 0.3, 0.2], None).unwrap();
        assert!((depth_m - 0.1).abs() < 1e-6 && out == [-1.0, 0.0, 0.0], "{depth_m} along {out:?}");
        // What came in through x = 0 goes back there, and what came in the other way by another face: 0.3 behind y = 0.
        let back = |x: f32| own_face(&tissue, &topology, 0, &[0.4, 0.1, 0.3, 0.2], Some([x, 0.0, 0.0]));
        assert_eq!(back(-1.0), Some((depth_m, out)));
        assert!(back(1.0).is_some_and(|(depth_m, out)| (depth_m - 0.3).abs() < 1e-6 && out == [0.0, -1.0, 0.0]));
        assert_eq!(back(f32::NAN), Some((depth_m, out)), "a way that is none");
        // On the face z = 0, by rounding a little outside of it.
        let (depth_m, out) = own_face(&tissue, &topology, 0, &[0.4, 0.3, 0.3, -1e-8], None).unwrap();
        assert_eq!((depth_m, out), (0.0, [0.0, 0.0, -1.0]));
        assert_eq!(own_face(&tissue, &topology, 2, &[0.25; 4], None), None, "no such tet");
        let mut inner = topology;
        inner.neighbours = vec![[1; 4], [0; 4]];
        assert_eq!(own_face(&tissue, &inner, 0, &[0.25; 4], None), None, "not at the surface");
        let flat = [[0.0; 3]; 5];
        assert_eq!(own_face(&Tissue { positions_m: &flat, ..tissue }, &inner, 0, &[0.25; 4], None), None);
    }
}
