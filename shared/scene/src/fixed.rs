//! Which nodes do not move, whether an organ is hollow, and what of a hollow one lies outside.

use crate::file::Fixed;
use crate::locate::{Locator, bounds};
use glam::Vec3;

/// Directions of the supporting planes that stand for the convex hull: with 256 of them the depth is a few per cent too large at most.
const DIRECTIONS: u32 = 256;
/// A hollow organ has at least this share of boundary triangles that face tissue of its own across a space.
const HOLLOW_SHARE: f32 = 0.25;
/// Most triangles that are asked, and steps of each look across.
const ASKED: usize = 2_000;
const LOOK_STEPS: u32 = 64;
/// Cosine and sine of half a radian: by so much the looks to the sides are tilted against the normal.
const TILT: [f32; 2] = [0.877_583, 0.479_426];
/// Shell that is held when a hollow organ names no fixed nodes.
pub(crate) const DEFAULT_SHELL: f64 = 0.06;
/// Part of a solid organ, farthest from the scope, that is held when it names no fixed nodes.
const DEFAULT_FAR_SHARE: f32 = 0.25;

/// How deep each node lies under the convex hull of all, as a share of the thinnest extent of their box. 0 is on the hull.
pub(crate) fn depth_under_hull(positions_m: &[[f32; 3]]) -> Vec<f32> {
    let (low, high) = bounds(positions_m);
    let thinnest_m = (high - low).min_element().max(1e-9);
    let mut depth_m = vec![f32::INFINITY; positions_m.len()];
    let golden_rad = std::f32::consts::PI * (3.0 - 5f32.sqrt());
    for index in 0..DIRECTIONS {
        let z = 1.0 - (2 * index + 1) as f32 / DIRECTIONS as f32;
        let (sin, cos) = (golden_rad * index as f32).sin_cos();
        let direction = Vec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
        let support = positions_m.iter().map(|&point| direction.dot(point.into())).fold(f32::NEG_INFINITY, f32::max);
        for (depth, &point) in depth_m.iter_mut().zip(positions_m) {
            *depth = depth.min(support - direction.dot(point.into()));
        }
    }
    depth_m.iter().map(|depth| depth / thinnest_m).collect()
}

/// Nodes of the wall of the organ's hollow, if it has one; else none. A triangle is of such a wall if whoever looks out of it, along
/// its normal, sees tissue of the same organ. Of a large boundary every n-th triangle is asked.
pub(crate) fn hollow_nodes(positions_m: &[[f32; 3]], boundary: &[[u32; 3]], locator: &Locator) -> Vec<usize> {
    let look = Look::across(positions_m, locator);
    let stride = boundary.len().div_ceil(ASKED).max(1);
    let asked = boundary.len().div_ceil(stride);
    let wall: Vec<&[u32; 3]> = boundary.iter().step_by(stride).filter(|triangle| look.meets_tissue(triangle)).collect();
    if (wall.len() as f32) < HOLLOW_SHARE * asked as f32 {
        return Vec::new();
    }
    let mut nodes: Vec<usize> = wall.into_iter().flatten().map(|&node| node as usize).collect();
    nodes.sort_unstable();
    nodes.dedup();
    nodes
}

/// Whether each triangle of the boundary is of the wall of the organ's hollow; of an organ without one none is.
pub(crate) fn hollow_triangles(positions_m: &[[f32; 3]], boundary: &[[u32; 3]], locator: &Locator) -> Vec<bool> {
    let look = Look::across(positions_m, locator);
    let is_wall: Vec<bool> = boundary.iter().map(|triangle| look.meets_tissue(triangle)).collect();
    let of_wall = is_wall.iter().filter(|is_wall| **is_wall).count();
    if (of_wall as f32) < HOLLOW_SHARE * boundary.len() as f32 { vec![false; boundary.len()] } else { is_wall }
}

/// The triangles of some of a hollow organ's boundary that lie outside: most of the looks out of one, along the normal and tilted to four sides, meet nothing of
/// the organ. Out of the cavity one or two may go through the canal; outside, where it bends inwards, one or two may meet the organ.
pub(crate) fn outside_triangles(positions_m: &[[f32; 3]], some: &[[u32; 3]], locator: &Locator) -> Vec<[u32; 3]> {
    let look = Look::across(positions_m, locator);
    some.iter().filter(|triangle| look.is_free_on_most_ways(triangle)).copied().collect()
}

/// A look out of an organ, as far as the organ is long.
struct Look<'a> {
    positions_m: &'a [[f32; 3]],
    locator: &'a Locator,
    step_m: f32,
}

impl<'a> Look<'a> {
    fn across(positions_m: &'a [[f32; 3]], locator: &'a Locator) -> Look<'a> {
        let (low, high) = bounds(positions_m);
        Look { positions_m, locator, step_m: (high - low).max_element() / LOOK_STEPS as f32 }
    }

    /// Whether it meets tissue of the same organ, out of a triangle of its boundary and along the normal.
    fn meets_tissue(&self, triangle: &[u32; 3]) -> bool {
        let [a, b, c] = triangle.map(|node| Vec3::from(self.positions_m[node as usize]));
        self.meets((a + b + c) / 3.0, (b - a).cross(c - a).normalize_or_zero())
    }

    /// The same from a point in a direction.
    fn meets(&self, from: Vec3, direction: Vec3) -> bool {
        let at = |step: u32| (from + direction * (step as f32 * self.step_m)).to_array();
        (1..=LOOK_STEPS).any(|step| self.locator.find(at(step)).is_some())
    }

    /// Whether most looks out of a triangle, along the normal and to four sides, meet none.
    fn is_free_on_most_ways(&self, triangle: &[u32; 3]) -> bool {
        let [a, b, c] = triangle.map(|node| Vec3::from(self.positions_m[node as usize]));
        let (along, normal) = ((b - a).normalize_or_zero(), (b - a).cross(c - a).normalize_or_zero());
        let across = normal.cross(along);
        let tilted = |side: Vec3| TILT[0] * normal + TILT[1] * side;
        let looks = [normal, tilted(along), tilted(-along), tilted(across), tilted(-across)];
        let free = looks.iter().filter(|look| !self.meets((a + b + c) / 3.0, **look)).count();
        2 * free > looks.len()
    }
}

/// Whether a point is within a sphere.
pub(crate) fn in_sphere(point: &[f64; 3], centre_m: &[f64; 3], radius_m: f64) -> bool {
    (0..3).map(|axis| (point[axis] - centre_m[axis]).powi(2)).sum::<f64>() <= radius_m * radius_m
}

/// Whether a point is within a box.
pub(crate) fn in_box(point: &[f64; 3], min_m: &[f64; 3], max_m: &[f64; 3]) -> bool {
    (0..3).all(|axis| point[axis] >= min_m[axis] && point[axis] <= max_m[axis])
}

/// Marks the nodes of the named shapes.
pub(crate) fn fixed_nodes(shapes: &[Fixed], positions_m: &[[f32; 3]], depth: &[f32], on_boundary: &[bool]) -> Vec<bool> {
    let held = |node: usize, shape: &Fixed| {
        let point = positions_m[node].map(f64::from);
        match shape {
            Fixed::Sphere { centre_m, radius_m } => in_sphere(&point, centre_m, *radius_m),
            Fixed::Box { min_m, max_m } => in_box(&point, min_m, max_m),
            Fixed::BelowZM(z) => point[2] <= *z,
            Fixed::AboveZM(z) => point[2] >= *z,
            Fixed::OuterShell(share) => on_boundary[node] && f64::from(depth[node]) <= *share,
        }
    };
    (0..positions_m.len()).map(|node| shapes.iter().any(|shape| held(node, shape))).collect()
}

/// What is held when the scene does not say: the shell of a hollow organ, else the part farthest from the scope.
pub(crate) fn default_shapes(hollow: bool, positions_m: &[[f32; 3]]) -> Vec<Fixed> {
    if hollow {
        return vec![Fixed::OuterShell(DEFAULT_SHELL)];
    }
    let (low, high) = bounds(positions_m);
    vec![Fixed::AboveZM(f64::from(high.z - (high.z - low.z) * DEFAULT_FAR_SHARE))]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_zero_on_a_sphere_and_half_the_extent_at_its_centre() {
        let mut points = vec![[0.0; 3]];
        for index in 0..400 {
            let z: f32 = 1.0 - (2 * index + 1) as f32 / 400.0;
            let (sin, cos) = (index as f32 * 2.4).sin_cos();
            points.push([(1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z]);
        }
        let depth = depth_under_hull(&points);
        assert!((depth[0] - 0.5).abs() < 0.02, "{}", depth[0]);
        assert!(depth[1..].iter().all(|depth| *depth < 0.01));
    }

    #[test]
    fn each_shape_holds_exactly_its_nodes() {
        let points = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 2.0], [1.0, 0.0, 2.0]];
        let held = |shape: Fixed| fixed_nodes(&[shape], &points, &[0.0, 0.3, 0.0, 0.05], &[true, true, false, true]);
        assert_eq!(held(Fixed::Sphere { centre_m: [0.0, 0.0, 2.0], radius_m: 1.0 }), [false, true, true, true]);
        assert_eq!(held(Fixed::Box { min_m: [0.5, -1.0, 0.0], max_m: [2.0, 1.0, 3.0] }), [false, false, false, true]);
        assert_eq!(held(Fixed::BelowZM(1.0)), [true, true, false, false]);
        assert_eq!(held(Fixed::AboveZM(1.0)), [false, true, true, true]);
        assert_eq!(held(Fixed::OuterShell(0.1)), [true, false, false, true]);
    }
}
