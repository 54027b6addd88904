//! What a wire sweeps in one tick, and where an edge goes through it.

use super::{Cuttable, DVec3, at};

/// Triangles of a smaller share of the sheet's own size squared have no normal.
const FLAT_SHARE: f64 = 1e-12;

/// The swept triangles: two for each piece of the wire. Their normals all point to the same side.
#[derive(Debug)]
pub struct Sheet {
    triangles_m: Vec<[DVec3; 3]>,
    low_m: DVec3,
    high_m: DVec3,
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
    /// The sheet between two places of the wire.
    pub fn of(before: &[[f32; 3]], now: &[[f32; 3]]) -> Sheet {
        let point = |wire: &[[f32; 3]], index: u32| at(wire, index);
        let pieces = if before.len() == now.len() { before.len().saturating_sub(1) as u32 } else { 0 };
        let mut triangles_m = Vec::with_capacity(2 * pieces as usize);
        for piece in 0..pieces {
            let [a, b] = [piece, piece + 1].map(|index| point(before, index));
            let [c, d] = [piece, piece + 1].map(|index| point(now, index));
            triangles_m.push([a, b, d]);
            triangles_m.push([a, d, c]);
        }
        let all = || triangles_m.iter().flatten().copied();
        let low_m = all().fold(DVec3::MAX, DVec3::min);
        let high_m = all().fold(DVec3::MIN, DVec3::max);
        let least = FLAT_SHARE * (high_m - low_m).length_squared().powi(2);
        triangles_m.retain(|[a, b, c]| (b - a).cross(c - a).length_squared() > least);
        Sheet { triangles_m, low_m, high_m }
    }

    /// Whether the box around some points touches the sheet's own.
    pub fn is_near(&self, points_m: &[DVec3]) -> bool {
        let low = points_m.iter().copied().fold(DVec3::MAX, DVec3::min);
        let high = points_m.iter().copied().fold(DVec3::MIN, DVec3::max);
        low.cmple(self.high_m).all() && high.cmpge(self.low_m).all()
    }

    /// Whether any tet's box touches the sheet's.
    pub fn touches(&self, tissue: &Cuttable) -> bool {
        !self.triangles_m.is_empty()
            && tissue.rest.tets.iter().any(|tet| self.is_near(&tet.map(|node| at(&tissue.position_m, node))))
    }

    /// Where the edge from `from` to `to` crosses the sheet first. Edges of the mesh that go through an edge between two triangles cross: the products
    /// that decide are the same for both but for the sign.
    pub fn crossing(&self, from: DVec3, to: DVec3) -> Option<Crossing> {
        if !self.is_near(&[from, to]) {
            return None;
        }
        let crossings = self.triangles_m.iter().filter_map(|triangle| through(triangle, from, to));
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
        Sheet::of(&[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 2.0, 0.0]], &[[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 2.0, 0.0]])
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
    fn a_wire_that_stands_still_sweeps_nothing() {
        let wire = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        assert!(Sheet::of(&wire, &wire).triangles_m.is_empty());
        assert!(Sheet::of(&wire, &wire[..1]).triangles_m.is_empty());
        assert!(Sheet::of(&[], &[]).triangles_m.is_empty());
    }
}
