//! Where the mouths of the tubes lie: the cavity's ends to the right and left, by which a surgeon knows where he is. An organ's mesh does not say it; its
//! shape does.

use glam::Vec3;

/// Radius of a mouth, m: some 1.5 mm across, as a hysteroscope sees it under pressure.
pub const MOUTH_RADIUS_M: f32 = 0.000_8;
/// What is nearer to the middle than that is no horn, m.
const LEAST_ASIDE_M: f32 = 0.004;
/// The end of a horn looks back across the cavity: what looks less that way, as the cosine of the angle, is none, for the front of a solid organ looks down
/// the axis as well. The two of `assets/meshes` have 0.98 and 0.96.
const LEAST_ACROSS: f32 = 0.7;

/// The mouths of an organ's tubes, rest positions in m with the radius as fourth number, right and left; none, with zero as radius, where the surface has
/// no cavity that is open to both sides. `rest_m` are places in the frame of the scene (+z towards the fundus, +x to the patient's right), triangles
/// counter-clockwise seen from outside the tissue; a triangle with a vertex that is not there is left out. So is one with a vertex on a wound, for
/// which `raw` has another number than 0: the ground of a wound may lie deeper than the horn, and is none.
pub fn ostia(rest_m: &[[f32; 3]], raw: &[u32], triangles: &[[u32; 3]]) -> [[f32; 4]; 2] {
    let is_wound = |vertex: usize| raw.get(vertex).is_some_and(|raw| *raw != 0);
    let place = |vertex: u32| rest_m.get(vertex as usize).filter(|_| !is_wound(vertex as usize)).map(|at| Vec3::from(*at));
    // A vertex on a wound keeps a normal of zero, and looks nowhere.
    let mut normals = vec![Vec3::ZERO; rest_m.len()];
    for corners in triangles {
        let [Some(a), Some(b), Some(c)] = corners.map(place) else { continue };
        let normal = (b - a).cross(c - a);
        for corner in corners {
            normals[*corner as usize] += normal;
        }
    }
    // A wall of the cavity looks at its axis, and down it; the outside of the organ looks away.
    let looks_in = |(at, normal): &(Vec3, Vec3)| normal.dot(-*at * Vec3::new(1.0, 1.0, 0.2)) > 0.0;
    let inner = || rest_m.iter().map(|at| Vec3::from(*at)).zip(normals.iter().copied()).filter(looks_in);
    // Far to the side, in the plane between the walls, and high: the tubes leave above.
    let farthest = |side: f32| {
        let reach = |at: Vec3| side * at.x - 2.0 * at.y.abs() + 0.3 * at.z;
        inner()
            .filter(|(_, normal)| -side * normal.x > LEAST_ACROSS * normal.length())
            .map(|(at, _)| at)
            .filter(|at| side * at.x > LEAST_ASIDE_M && at.z > 0.0)
            .max_by(|a, b| reach(*a).total_cmp(&reach(*b)))
    };
    match [1.0, -1.0].map(farthest) {
        [Some(right), Some(left)] => [right, left].map(|at| at.extend(MOUTH_RADIUS_M).to_array()),
        _ => [[0.0; 4]; 2],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cells along each edge of a [`cuboid`].
    const CELLS: u32 = 8;

    /// A box of so many metres about a place, whose sides are grids, seen from outside, or from inside. What lies within it is of no triangle.
    fn cuboid(middle_m: [f32; 3], half_m: [f32; 3], from_inside: bool) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        const ROW: u32 = CELLS + 1;
        let place_m = |vertex: u32| {
            let cell = [vertex % ROW, vertex / ROW % ROW, vertex / (ROW * ROW)];
            std::array::from_fn(|axis| middle_m[axis] + half_m[axis] * (2.0 * cell[axis] as f32 / CELLS as f32 - 1.0))
        };
        let mut triangles = Vec::new();
        for (axis, is_high) in (0..3).flat_map(|axis: usize| [(axis, false), (axis, true)]) {
            let vertex = |i: u32, j: u32| {
                let mut cell = [if is_high { CELLS } else { 0 }; 3];
                (cell[(axis + 1) % 3], cell[(axis + 2) % 3]) = (i, j);
                cell[0] + ROW * (cell[1] + ROW * cell[2])
            };
            for (i, j) in (0..CELLS * CELLS).map(|cell| (cell % CELLS, cell / CELLS)) {
                let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
                // Counter-clockwise seen from above; the low side is seen from below.
                let turned = is_high == from_inside;
                triangles.extend([[a, b, c], [a, c, d]].map(|[a, b, c]| if turned { [a, c, b] } else { [a, b, c] }));
            }
        }
        ((0..ROW * ROW * ROW).map(place_m).collect(), triangles)
    }

    /// One surface more.
    fn add(surface: &mut (Vec<[f32; 3]>, Vec<[u32; 3]>), (more_m, more): (Vec<[f32; 3]>, Vec<[u32; 3]>)) {
        let first = surface.0.len() as u32;
        surface.0.extend(more_m);
        surface.1.extend(more.iter().map(|corners| corners.map(|corner| corner + first)));
    }

    /// A box with a flat cavity.
    fn organ() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let mut organ = cuboid([0.0, 0.0, 0.03], [0.024, 0.018, 0.035], false);
        add(&mut organ, cuboid([0.0, 0.0, 0.03], [0.013, 0.004, 0.015], true));
        organ
    }

    #[test]
    fn the_mouths_are_the_ends_of_the_cavity_and_not_of_the_organ() {
        let (rest_m, triangles) = organ();
        let [right, left] = ostia(&rest_m, &[], &triangles);
        assert!((right[0] - 0.013).abs() < 1e-6 && (left[0] + 0.013).abs() < 1e-6, "{right:?} {left:?}");
        assert_eq!([right[3], left[3]], [MOUTH_RADIUS_M; 2]);
        assert!(right[2] > 0.04, "above: {right:?}");
    }

    #[test]
    fn a_wound_that_is_deeper_than_the_horn_moves_no_mouth() {
        let (rest_m, triangles) = organ();
        let whole = ostia(&rest_m, &[], &triangles);
        let mut cut = organ();
        let lining = cut.0.len();
        add(&mut cut, cuboid([0.016, 0.0, 0.038], [0.004, 0.001, 0.007], true));
        let raw: Vec<u32> = (0..cut.0.len()).map(|vertex| u32::from(vertex >= lining)).collect();
        let [deep, _] = ostia(&cut.0, &[], &cut.1);
        assert!((deep[0] - 0.02).abs() < 1e-6, "the ground of the wound is farther out than the horn: {deep:?}");
        assert_eq!(ostia(&cut.0, &raw, &cut.1), whole);
        // At the rim of the wound a triangle turns no vertex of the lining.
        let (rest_m, raw) = ([&cut.0[..], &[[f32::NAN; 3]]].concat(), [&raw[..], &[1]].concat());
        let rim = (0..lining as u32).map(|vertex| [vertex, (vertex + 1) % lining as u32, rest_m.len() as u32 - 1]);
        let triangles: Vec<[u32; 3]> = cut.1.iter().copied().chain(rim).collect();
        assert_eq!(ostia(&rest_m, &raw, &triangles), whole);
    }

    #[test]
    fn what_has_no_cavity_and_what_is_narrow_or_broken_has_none() {
        let (rest_m, triangles) = cuboid([0.0, 0.0, 0.03], [0.02; 3], false);
        assert_eq!(ostia(&rest_m, &[], &triangles), [[0.0; 4]; 2], "a block, whose front looks down the axis");
        let (rest_m, triangles) = cuboid([0.0, 0.0, 0.03], [0.003; 3], true);
        assert_eq!(ostia(&rest_m, &[], &triangles), [[0.0; 4]; 2], "a canal");
        assert_eq!(ostia(&[[0.0; 3]; 3], &[], &[[0, 1, 9]]), [[0.0; 4]; 2]);
        assert_eq!(ostia(&[[f32::NAN; 3]; 3], &[], &[[0, 1, 2]]), [[0.0; 4]; 2]);
    }
}
