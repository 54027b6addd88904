//! Collision points on a surface that was read from a file: spread over it in equal areas, and more densely towards the tip, which touches first.
//!
//! Promise: the same surface has the same points; each lies on a triangle and looks to where that does.

use glam::Vec3;
use hyst_mesh::TriangleMesh;

/// Steps of the two coordinates within a triangle from point to point: powers of the inverse of the plastic number, by which points fill the unit square
/// most evenly (Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
const WITHIN: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];

/// Points on a surface, and the unit vectors out of it there.
pub(crate) type Spread = (Vec<[f32; 3]>, Vec<[f32; 3]>);

/// So many points on a surface, the foremost vertex (greatest z) first. A triangle gets them by its area times what `weight` says of its middle: what has
/// none gets none.
pub(crate) fn spread(surface: &TriangleMesh, count: u32, weight: impl Fn(Vec3) -> f64) -> Spread {
    let corners = |triangle: &[u32; 3]| triangle.map(|vertex| Vec3::from(surface.positions_m[vertex as usize]));
    let mut shares = Vec::with_capacity(surface.triangles.len());
    let mut whole = 0.0;
    for triangle in &surface.triangles {
        let [a, b, c] = corners(triangle);
        let share = f64::from((b - a).cross(c - a).length()) * weight((a + b + c) / 3.0);
        whole += if share.is_finite() { share.max(0.0) } else { 0.0 };
        shares.push(whole);
    }
    let foremost = surface.positions_m.iter().max_by(|a, b| a[2].total_cmp(&b[2])).copied().unwrap_or_default();
    let (mut points_m, mut outward) = (vec![foremost], vec![Vec3::Z.to_array()]);
    if whole <= 0.0 {
        return (points_m, outward);
    }
    let others = count.saturating_sub(1);
    for index in 0..others {
        let at = (f64::from(index) + 0.5) / f64::from(others) * whole;
        let found = shares.partition_point(|share| *share < at).min(shares.len() - 1);
        let [a, b, c] = corners(&surface.triangles[found]);
        let [mut u, mut v] = WITHIN.map(|step| (step * f64::from(index + 1)).fract() as f32);
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        points_m.push((a + u * (b - a) + v * (c - a)).to_array());
        outward.push((b - a).cross(c - a).normalize_or(Vec3::Z).to_array());
    }
    (points_m, outward)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box from the origin to a corner, closed, counter-clockwise seen from outside.
    fn a_box(far: [f32; 3]) -> TriangleMesh {
        let positions_m = (0..8).map(|b| std::array::from_fn(|axis| if b >> axis & 1 == 1 { far[axis] } else { 0.0 })).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
        TriangleMesh { positions_m, triangles }
    }

    #[test]
    fn points_lie_on_the_surface_as_densely_everywhere_and_look_out_of_it() {
        let far = [0.002, 0.004, 0.008];
        let (points, outward) = spread(&a_box(far), 2_001, |_| 1.0);
        assert_eq!((points.len(), outward.len(), points[0][2]), (2_001, 2_001, far[2]));
        let mut on_face = [[0u32; 2]; 3];
        for (point, out) in points.iter().zip(&outward).skip(1) {
            let axis = (0..3).find(|axis| out[*axis] != 0.0).unwrap();
            let side = usize::from(out[axis] > 0.0);
            assert!((point[axis] - far[axis] * side as f32).abs() < 1e-8 && out[axis].abs() == 1.0, "{point:?} {out:?}");
            assert!((0..3).all(|axis| (0.0..=far[axis]).contains(&point[axis])), "{point:?}");
            on_face[axis][side] += 1;
        }
        let area = |axis: usize| far[(axis + 1) % 3] * far[(axis + 2) % 3];
        let whole: f32 = 2.0 * (0..3).map(area).sum::<f32>();
        for (axis, sides) in on_face.iter().enumerate() {
            for count in sides {
                assert!((*count as f32 / (2_000.0 * area(axis) / whole) - 1.0).abs() < 0.03, "{on_face:?}");
            }
        }
    }

    #[test]
    fn what_has_no_weight_gets_no_points_and_a_surface_without_area_its_foremost_vertex() {
        let (points, _) = spread(&a_box([0.002, 0.004, 0.008]), 100, |middle| f64::from(u8::from(middle.z > 0.004)));
        assert!(points.len() == 100 && points.iter().all(|point| point[2] > 0.0), "{points:?}");
        let (points, outward) = spread(&a_box([0.0, 0.0, 0.008]), 100, |_| 1.0);
        assert_eq!((points.as_slice(), outward.len()), (&[[0.0, 0.0, 0.008]][..], 1));
        assert_eq!(spread(&TriangleMesh::default(), 100, |_| 1.0).0, [[0.0; 3]]);
    }
}
