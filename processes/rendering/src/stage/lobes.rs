//! Where a growth has its lobes: everywhere but on its wounds and at their rims. There what is whole ends on edges of the wound, which has no lobes, or where
//! another part of it ends, whose normals are others: lobes would leave a step between the two, through which one looks into nothing.
//!
//! Promise: a surface without a wound has all of its lobes. One with a wound has none where it ends, and they come back over [`RINGS`] edges. It takes a look
//! at the triangles of each vertex, and one at all triangles for each ring.

use glam::Vec3;

use super::SurfaceMesh;

/// Edges of the surface over which the lobes come back, so that there is no fold.
const RINGS: u8 = 3;
/// What is shorter is no edge that one looks through, m: where a shape comes to a point, its last corners lie in one place.
const SHORTEST_M: f32 = 1e-6;

/// How much of its lobes a surface shows at each vertex, 0 to 1; `first` and `incident` are its triangles by vertex, as `incidence` gives them, which has
/// looked whether there are their corners.
pub(super) fn shown(mesh: &SurfaceMesh<'_>, first: &[u32], incident: &[u32]) -> Vec<f32> {
    let vertices = mesh.rest_m.len();
    let is_raw = |vertex: usize| mesh.raw.get(vertex).is_some_and(|raw| *raw != 0);
    if !(0..vertices).any(is_raw) {
        return vec![1.0; vertices];
    }
    let mut others: Vec<u32> = Vec::new();
    let mut is_at_end = |vertex: usize| {
        let own = &incident[first[vertex] as usize..first[vertex + 1] as usize];
        let corners = own.iter().flat_map(|triangle| mesh.triangles[*triangle as usize]);
        others.clear();
        others.extend(corners.filter(|corner| *corner as usize != vertex));
        others.sort_unstable();
        // An edge that two triangles have is met twice.
        others.chunk_by(|one, other| one == other).any(|same| same.len() == 1 && is_long(mesh, vertex, same[0] as usize))
    };
    let mut rings: Vec<u8> = (0..vertices).map(|vertex| if !is_raw(vertex) && is_at_end(vertex) { 0 } else { RINGS }).collect();
    for ring in 1..RINGS {
        for corners in mesh.triangles {
            if corners.iter().any(|corner| rings[*corner as usize] < ring) {
                for corner in corners {
                    let own = &mut rings[*corner as usize];
                    *own = ring.min(*own);
                }
            }
        }
    }
    let share = |(vertex, ring): (usize, u8)| if is_raw(vertex) { 0.0 } else { f32::from(ring) / f32::from(RINGS) };
    rings.into_iter().enumerate().map(share).collect()
}

/// Whether two vertices lie apart at rest.
fn is_long(mesh: &SurfaceMesh<'_>, from: usize, to: usize) -> bool {
    Vec3::from(mesh.rest_m[from]).distance(Vec3::from(mesh.rest_m[to])) > SHORTEST_M
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::{Shape, ball};
    use crate::stage::{Appearance, Material, incidence};

    /// Bands of triangles of a ball from pole to pole, and vertices around it.
    const BANDS: usize = 16;
    const AROUND: usize = 12;
    /// The row of vertices along which it is cut in two, and where its middle is, m.
    const RIM: usize = BANDS / 2;
    const MIDDLE_M: [f32; 3] = [0.0, 0.001, 0.03];

    fn whole() -> Shape {
        ball(MIDDLE_M, 0.004, BANDS as u32 + 1, AROUND as u32)
    }

    fn mesh<'a>(shape: &'a Shape, raw: &'a [u32]) -> SurfaceMesh<'a> {
        let appearance = Appearance::of(Material::Polyp);
        SurfaceMesh { triangles: &shape.triangles, rest_m: &shape.positions_m, raw, appearance }
    }

    fn shown_of(mesh: &SurfaceMesh<'_>) -> Vec<f32> {
        let (first, incident) = incidence(0, mesh.triangles, mesh.rest_m.len()).unwrap();
        shown(mesh, &first, &incident)
    }

    /// The lower half of a ball, and over it a wound that has vertices of its own at the places of the rim. In the middle of one of the wound's edges the skin
    /// has a vertex and the wound none, as where a cut has drawn the skin onto the rim.
    fn half() -> (Shape, Vec<u32>) {
        let mut half = whole();
        half.positions_m.truncate((RIM + 1) * AROUND);
        half.triangles.truncate(2 * RIM * AROUND);
        let [left, right, middle] = [0, 1, AROUND].map(|at| (RIM * AROUND + at) as u32);
        let [left_m, right_m] = [left, right].map(|end| Vec3::from(half.positions_m[end as usize]));
        half.positions_m.push(left_m.midpoint(right_m).to_array());
        let has_both = |corners: &&mut [u32; 3]| corners.contains(&left) && corners.contains(&right);
        let divided = half.triangles.iter_mut().find(has_both).unwrap();
        let other_part = divided.map(|corner| if corner == left { middle } else { corner });
        *divided = divided.map(|corner| if corner == right { middle } else { corner });
        half.triangles.push(other_part);
        let skin = half.positions_m.len();
        half.positions_m.extend_from_within(RIM * AROUND..(RIM + 1) * AROUND);
        half.positions_m.push(MIDDLE_M);
        let (around, first) = (AROUND as u32, skin as u32);
        half.triangles.extend((0..around).map(|at| [first + at, first + (at + 1) % around, first + around]));
        let raw = (0..half.positions_m.len()).map(|vertex| u32::from(vertex >= skin)).collect();
        (half, raw)
    }

    #[test]
    fn the_lobes_end_at_the_rim_of_a_wound_and_come_back_over_three_edges() {
        let (half, raw) = half();
        let shown = shown_of(&mesh(&half, &raw));
        let (rows, beyond) = shown.split_at((RIM + 1) * AROUND);
        for (row, of_row) in rows.chunks(AROUND).enumerate() {
            let expected = (RIM - row).min(3) as f32 / 3.0;
            assert_eq!(of_row, [expected; AROUND], "row {row}");
        }
        assert!(beyond.iter().all(|share| *share == 0.0), "in the middle of an edge of the wound, and on that: {beyond:?}");
    }

    /// Both sides of a cut and of its wound lie in the same places: what lifts one of them parts them.
    #[test]
    fn no_triangle_of_a_cut_mesh_has_a_corner_that_is_lifted_off_another_vertex_in_its_place() {
        let (mut both, mut raw) = half();
        // The other side is its mirror image, with its corners in the other order.
        let (one, own) = (both.clone(), both.positions_m.len());
        both.positions_m.extend(one.positions_m.iter().map(|[x, y, z]| [*x, *y, 2.0 * MIDDLE_M[2] - z]));
        both.triangles.extend(one.triangles.iter().map(|[a, b, c]| [a, c, b].map(|corner| corner + own as u32)));
        raw.extend_from_within(..);
        let mesh = mesh(&both, &raw);
        let shown = shown_of(&mesh);
        let is_beside_another = |vertex: usize| (0..shown.len()).any(|other| other != vertex && !is_long(&mesh, vertex, other));
        // The vertices of a pole lie in one place, too.
        let is_pole = |vertex: usize| vertex % own < AROUND;
        let corners = both.triangles.iter().flatten().map(|corner| *corner as usize);
        let beside: Vec<usize> = corners.filter(|corner| !is_pole(*corner) && is_beside_another(*corner)).collect();
        assert!(beside.len() > 8 * AROUND && shown.contains(&1.0), "{} corners lie beside others: {shown:?}", beside.len());
        assert!(beside.iter().all(|corner| shown[*corner] == 0.0), "{shown:?}");
    }

    #[test]
    fn what_has_no_wound_has_all_its_lobes_wherever_it_ends_and_so_has_what_ends_nowhere() {
        let (half, _) = half();
        for raw in [vec![], vec![0; half.positions_m.len()]] {
            assert!(shown_of(&mesh(&half, &raw)).iter().all(|share| *share == 1.0), "{} flags", raw.len());
        }
        // A wound whose corners the skin has, too, has no rim, and a pole is a point.
        let whole = whole();
        let raw: Vec<u32> = (0..whole.positions_m.len()).map(|vertex| u32::from(vertex < RIM * AROUND)).collect();
        let expected: Vec<f32> = raw.iter().map(|raw| if *raw == 0 { 1.0 } else { 0.0 }).collect();
        assert_eq!(shown_of(&mesh(&whole, &raw)), expected);
    }
}
