//! What a wire sweeps in one tick, and where an edge goes through it.

use super::Cuttable;
use super::places::{Bounds, Sides, SingleBounds};
use super::wire::Motion;
use glam::DVec3;

/// A triangle has no normal if its area is a smaller share than this of its longest edge squared: 1 µm of way for 1 m of wire.
const FLAT_SHARE: f64 = 1e-6;

/// The swept triangles: two for each piece of the wire. Their normals all point to the same side, also while the wire goes back.
#[derive(Debug)]
pub struct Sheet {
    triangles_m: Vec<[DVec3; 3]>,
    /// Around each.
    bounds: Vec<Bounds>,
    around_all: Bounds,
    /// The same for the points of a mesh.
    around_nodes: SingleBounds,
}

/// Where an edge crosses the sheet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Share of the edge from its first end.
    pub share: f64,
    /// Unit normal of the sheet there.
    pub normal: DVec3,
}

impl Sheet {
    /// What a wire sweeps.
    pub fn of(motion: &Motion) -> Sheet {
        let mut triangles_m = Vec::with_capacity(2 * motion.to_m.len());
        for ((from, to), ways) in motion.from_m.windows(2).zip(motion.to_m.windows(2)).zip(motion.ways.windows(2)) {
            let ([a, b], [c, d]) = ([from[0], from[1]], [to[0], to[1]]);
            let goes_back = (c - a + d - b).dot(ways[0] + ways[1]) < 0.0;
            triangles_m.extend(if goes_back { [[a, d, b], [a, c, d]] } else { [[a, b, d], [a, d, c]] });
        }
        triangles_m.retain(|[a, b, c]| {
            let longest = [b - a, c - a, c - b].map(DVec3::length_squared).into_iter().fold(0.0, f64::max);
            (b - a).cross(c - a).length() > FLAT_SHARE * longest
        });
        let bounds = triangles_m.iter().map(|triangle| Bounds::around(*triangle)).collect();
        let around_all = Bounds::around(triangles_m.iter().flatten().copied());
        Sheet { triangles_m, bounds, around_all, around_nodes: around_all.single() }
    }

    /// The faces of the box around the sheet on whose inner sides a point is. An edge whose ends do not touch it crosses nothing.
    pub fn sides(&self, point_m: &[f32; 3]) -> Sides {
        self.around_nodes.sides(point_m)
    }

    /// The tets whose boxes touch the sheet's.
    pub fn near(&self, tissue: &Cuttable) -> Vec<u32> {
        if self.triangles_m.is_empty() {
            return Vec::new();
        }
        self.around_nodes.tets_in(&tissue.position_m, &tissue.rest.tets)
    }

    /// Where the edge from `from` to `to` crosses the sheet first. Edges of the mesh that go through an edge between two triangles cross: the products
    /// that decide are the same for both but for the sign.
    pub fn crossing(&self, from: DVec3, to: DVec3) -> Option<Crossing> {
        let edge = Bounds::around([from, to]);
        if !edge.touches(&self.around_all) {
            return None;
        }
        let near = self.triangles_m.iter().zip(&self.bounds).filter(|(_, around)| edge.touches(around));
        let crossings = near.filter_map(|(triangle, _)| through(triangle, from, to));
        crossings.min_by(|left, right| left.share.total_cmp(&right.share))
    }
}

fn through([a, b, c]: &[DVec3; 3], from: DVec3, to: DVec3) -> Option<Crossing> {
    let along = to - from;
    let [a_, b_, c_] = [a - from, b - from, c - from];
    let sides = [b_.cross(c_).dot(along), c_.cross(a_).dot(along), a_.cross(b_).dot(along)];
    if !(sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0)) {
        return None;
    }
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let (first, second) = (normal.dot(from - a), normal.dot(to - a));
    if first * second > 0.0 || first == second {
        return None;
    }
    let share = first / (first - second);
    share.is_finite().then_some(Crossing { share: share.clamp(0.0, 1.0), normal })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wire along y from 0 to 2 that moves along x from 0 to 1.
    fn sheet() -> Sheet {
        let wire = |x: f64| (0..3).map(|y| DVec3::new(x, f64::from(y), 0.0)).collect();
        Sheet::of(&Motion { from_m: wire(0.0), to_m: wire(1.0), ways: vec![DVec3::X; 3] })
    }

    #[test]
    fn an_edge_crosses_at_its_share_and_the_normal_has_one_side() {
        let crossing = sheet().crossing(DVec3::new(0.5, 0.7, -1.0), DVec3::new(0.5, 0.7, 3.0)).unwrap();
        assert_eq!((crossing.share, crossing.normal), (0.25, DVec3::new(0.0, 0.0, -1.0)));
        let other = sheet().crossing(DVec3::new(0.1, 1.9, 3.0), DVec3::new(0.1, 1.9, -1.0)).unwrap();
        assert_eq!((other.share, other.normal), (0.75, crossing.normal));
    }

    #[test]
    fn through_the_seams_it_crosses_and_beside_the_sheet_it_does_not() {
        // the diagonal, the seam between two pieces of the wire, and a corner of both
        for [x, y] in [[0.5, 0.5], [0.3, 1.0], [0.0, 1.0]] {
            assert!(sheet().crossing(DVec3::new(x, y, -1.0), DVec3::new(x, y, 1.0)).is_some(), "{x} {y}");
        }
        for [x, y] in [[-0.1, 0.5], [1.1, 0.5], [0.5, -0.1], [0.5, 2.1]] {
            assert!(sheet().crossing(DVec3::new(x, y, -1.0), DVec3::new(x, y, 1.0)).is_none(), "{x} {y}");
        }
        assert!(sheet().crossing(DVec3::new(0.5, 0.5, 1.0), DVec3::new(0.5, 0.5, 2.0)).is_none(), "it ends before");
        assert!(sheet().crossing(DVec3::new(0.2, 0.5, 0.0), DVec3::new(0.5, 0.5, 0.0)).is_none(), "it lies in the sheet");
    }

    #[test]
    fn a_wire_that_stands_still_sweeps_nothing_and_one_that_goes_back_has_the_same_sides() {
        let wire = vec![DVec3::ZERO, DVec3::Y];
        let still = Motion { from_m: wire.clone(), to_m: wire.clone(), ways: vec![DVec3::ZERO; 2] };
        assert!(Sheet::of(&still).triangles_m.is_empty());
        let points = |points: &[DVec3]| Motion { from_m: points.to_vec(), to_m: points.to_vec(), ways: points.to_vec() };
        assert!(Sheet::of(&points(&wire[..1])).triangles_m.is_empty() && Sheet::of(&points(&[])).triangles_m.is_empty());
        let ahead: Vec<DVec3> = wire.iter().map(|point| point + DVec3::X).collect();
        let (low, high) = (DVec3::new(0.5, 0.5, -1.0), DVec3::new(0.5, 0.5, 1.0));
        let forth = Sheet::of(&Motion { from_m: wire.clone(), to_m: ahead.clone(), ways: vec![DVec3::X; 2] }).crossing(low, high);
        let back = Sheet::of(&Motion { from_m: ahead, to_m: wire, ways: vec![DVec3::X; 2] }).crossing(low, high);
        assert!(forth.is_some() && forth == back, "{forth:?} {back:?}");
    }
}
