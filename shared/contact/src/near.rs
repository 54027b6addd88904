//! Points outside of the tissue but close to its surface: the closest boundary triangle of each, found with the hash of the points.
//!
//! Only points on a triangle's outer side count; points inside have penetrations, not gaps.

use crate::ContactError;
use crate::error::same_length;
use crate::hash::LANES;
use crate::hash_read::HashRef;
use crate::tet::{max, min};
use crate::topology::{NONE, Topology};
use crate::types::{Points, Tissue};
use glam::Vec3;

/// Distance of a point to the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gap {
    /// Metres; infinite: no surface in range.
    pub distance_m: f32,
    /// Unit vector from the surface to the point.
    pub direction: [f32; 3],
    /// Index of the closest boundary triangle, or [`NONE`].
    pub triangle: u32,
}

impl Gap {
    /// No surface in range.
    pub const FAR: Gap = Gap { distance_m: f32::INFINITY, direction: [0.0, 0.0, 1.0], triangle: NONE };
}

/// Finds for each hashed point the closest boundary triangle of other objects within `range_m`; `gaps` has one entry per point.
///
/// # Errors
/// [`ContactError::Length`] if arrays that belong together differ in length.
pub fn find_gaps(
    hash: &HashRef<'_>,
    points: &Points<'_>,
    tissue: &Tissue<'_>,
    topology: &Topology,
    range_m: f32,
    gaps: &mut [Gap],
) -> Result<(), ContactError> {
    points.check(hash.points())?;
    same_length("gaps", hash.points(), gaps.len())?;
    gaps.fill(Gap::FAR);
    if range_m.is_nan() || range_m <= 0.0 {
        return Ok(());
    }
    pulp::Arch::new().dispatch(Search { hash, points, tissue, topology, range_m, gaps });
    Ok(())
}

/// The search, to be compiled for each instruction set.
struct Search<'a> {
    hash: &'a HashRef<'a>,
    points: &'a Points<'a>,
    tissue: &'a Tissue<'a>,
    topology: &'a Topology,
    range_m: f32,
    gaps: &'a mut [Gap],
}

impl pulp::WithSimd for Search<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, _: S) {
        let topology = self.topology;
        let (lowest, highest) = self.hash.around((0, self.hash.kept()));
        let groups = topology.boundary.chunks(GROUP).zip(topology.boundary_owner.chunks(GROUP));
        for (group, (triangles, owners)) in groups.enumerate() {
            let corners = |l: usize| triangles[l].map(|n| self.tissue.node(n));
            let (mut lo, mut hi) = ([[f32::INFINITY; GROUP]; 3], [[f32::NEG_INFINITY; GROUP]; 3]);
            for l in 0..triangles.len() {
                let (low, high) = grown_box(&corners(l), self.range_m);
                for axis in 0..3 {
                    (lo[axis][l], hi[axis][l]) = (low[axis], high[axis]);
                }
            }
            if are_beyond(&lo, &hi, &lowest, &highest) {
                continue;
            }
            // Most triangles are far from all points: what their cells say costs less than a normal.
            let (first, last) = self.hash.cells(&lo, &hi);
            for (l, &owner) in owners.iter().enumerate().take(triangles.len()) {
                let cell = |axes: &[[i32; GROUP]; 3]| [axes[0][l], axes[1][l], axes[2][l]];
                let (first, last) = (cell(&first), cell(&last));
                if (0..3).any(|axis| first[axis] > last[axis]) {
                    continue;
                }
                if let Some(near) = Near::new(corners(l), self.range_m) {
                    self.triangle((group * GROUP + l) as u32, owner, &near, (first, last));
                }
            }
        }
    }
}

/// Triangles whose boxes are looked up at once.
const GROUP: usize = 16;

/// Whether none of these boxes meets the one around the points; one with a corner that is no number may.
#[inline(always)]
fn are_beyond(lo: &[[f32; GROUP]; 3], hi: &[[f32; GROUP]; 3], lowest: &[f32; 3], highest: &[f32; 3]) -> bool {
    let mut beyond = [0u32; GROUP];
    for axis in 0..3 {
        for (l, beyond) in beyond.iter_mut().enumerate() {
            *beyond |= u32::from((lo[axis][l] > highest[axis]) | (hi[axis][l] < lowest[axis]));
        }
    }
    beyond.iter().fold(1, |all, &b| all & b) != 0
}

/// The box of a triangle, grown by the range.
#[inline(always)]
fn grown_box([p, q, r]: &[[f32; 3]; 3], range_m: f32) -> ([f32; 3], [f32; 3]) {
    let lo = [0, 1, 2].map(|i| min(min(p[i], q[i]), r[i]) - range_m);
    let hi = [0, 1, 2].map(|i| max(max(p[i], q[i]), r[i]) + range_m);
    (lo, hi)
}

impl Search<'_> {
    #[inline(always)]
    fn triangle(&mut self, triangle: u32, owner: u32, near: &Near, (first, last): ([i32; 3], [i32; 3])) {
        let hash = self.hash;
        hash.for_runs_in(
            first,
            last,
            #[inline(always)]
            |from, to| {
                let mut at = from;
                while at < to {
                    let close = near.lanes(hash.lanes(at), self.range_m);
                    if close.iter().fold(0, |any, &c| any | c) != 0 {
                        let real = close.iter().enumerate().take(to.wrapping_sub(at));
                        for (l, _) in real.filter(|(_, c)| **c != 0) {
                            self.point(at.wrapping_add(l), triangle, owner, near);
                        }
                    }
                    at = at.wrapping_add(LANES);
                }
            },
        );
    }

    #[inline(always)]
    fn point(&mut self, at: usize, triangle: u32, owner: u32, near: &Near) {
        let (point, p) = (self.hash.id(at) as usize, Vec3::from_array(self.hash.position(at)));
        let gap = &mut self.gaps[point];
        let [a, b, c] = near.corners;
        if self.points.owner[point] == owner || (p - a).dot(near.normal) >= gap.distance_m {
            return;
        }
        let away = p - closest_on_triangle(p, a, b, c);
        let distance_m = away.length();
        let direction = away.try_normalize().unwrap_or(near.normal);
        let nearer = distance_m < self.range_m && distance_m < gap.distance_m;
        if nearer && direction.dot(near.normal) > 0.0 {
            *gap = Gap { distance_m, direction: direction.to_array(), triangle };
        }
    }
}

/// A triangle made ready: its unit normal, and its box grown by the range.
struct Near {
    corners: [Vec3; 3],
    normal: Vec3,
    lo: [f32; 3],
    hi: [f32; 3],
}

impl Near {
    #[inline(always)]
    fn new(corners: [[f32; 3]; 3], range_m: f32) -> Option<Near> {
        let (lo, hi) = grown_box(&corners, range_m);
        let [a, b, c] = corners.map(Vec3::from_array);
        let normal = (b - a).cross(c - a).try_normalize()?;
        Some(Near { corners: [a, b, c], normal, lo, hi })
    }

    /// For each lane 1 if the point is in the box and on the outer side, no further than the range; else 0.
    #[inline(always)]
    fn lanes(&self, [x, y, z]: [&[f32; LANES]; 3], range_m: f32) -> [u32; LANES] {
        let (a, n) = (self.corners[0], self.normal);
        let mut close = [0; LANES];
        for l in 0..LANES {
            let above = (x[l] - a.x) * n.x + (y[l] - a.y) * n.y + (z[l] - a.z) * n.z;
            let boxed = (x[l] > self.lo[0])
                & (x[l] < self.hi[0])
                & (y[l] > self.lo[1])
                & (y[l] < self.hi[1])
                & (z[l] > self.lo[2])
                & (z[l] < self.hi[2]);
            close[l] = u32::from((above > 0.0) & (above < range_m) & boxed);
        }
        close
    }
}

/// Closest point of a triangle, by the regions of its plane.
#[inline(always)]
pub(crate) fn closest_on_triangle(p: Vec3, a: Vec3, b: Vec3, c: Vec3) -> Vec3 {
    let normal = (b - a).cross(c - a);
    let inside = |from: Vec3, to: Vec3| (to - from).cross(p - from).dot(normal) >= 0.0;
    if inside(a, b) && inside(b, c) && inside(c, a) {
        return p - normal * ((p - a).dot(normal) / normal.length_squared());
    }
    let on = |from: Vec3, to: Vec3| {
        let edge = to - from;
        from + edge * ((p - from).dot(edge) / edge.length_squared()).clamp(0.0, 1.0)
    };
    let mut best = on(a, b);
    for candidate in [on(b, c), on(c, a)] {
        if candidate.distance_squared(p) < best.distance_squared(p) {
            best = candidate;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hash::{HashMut, HashSizes, Layout};

    const RANGE_M: f32 = 0.002;

    /// Numbers from 0 to 1.
    fn noise(state: &mut u64) -> f32 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 40) as f32 / (1u64 << 24) as f32
    }

    /// The definition: each triangle looks at all points.
    fn plain(hash: &HashRef<'_>, points: &Points<'_>, tissue: &Tissue<'_>, topology: &Topology) -> Vec<Gap> {
        let mut gaps = vec![Gap::FAR; hash.points()];
        let mut search = Search { hash, points, tissue, topology, range_m: RANGE_M, gaps: &mut gaps };
        let (first, last) = hash.cells(&[[f32::NEG_INFINITY; 1]; 3], &[[f32::INFINITY; 1]; 3]);
        for (triangle, (nodes, owner)) in topology.boundary.iter().zip(&topology.boundary_owner).enumerate() {
            if let Some(near) = Near::new(nodes.map(|node| tissue.node(node)), RANGE_M) {
                search.triangle(triangle as u32, *owner, &near, (first.map(|cell| cell[0]), last.map(|cell| cell[0])));
            }
        }
        gaps
    }

    #[test]
    fn groups_that_are_left_out_hold_no_nearest_triangle() {
        let (mut state, mut found, mut far) = (5, 0, 0);
        for round in 0..30 {
            // Tets one after the other along x, so that most groups are far from a tool of some millimetres.
            let place_m = |node: u32| [node as f32 * 1e-4, 0.0, 0.0].map(|v| v + 0.01 * noise(&mut state));
            let mut positions_m: Vec<[f32; 3]> = (0..800).map(place_m).collect();
            let tets: Vec<[u32; 4]> = (0..780).map(|at| [at, at + 3, at + 7, at + 12]).collect();
            let topology = Topology::new(&tets, &vec![0; tets.len()], &positions_m).unwrap();
            positions_m[round * 20][round % 3] = if round % 2 == 0 { f32::NAN } else { f32::INFINITY };
            let at_m = noise(&mut state) * 0.09 - 0.005;
            let points_m: Vec<[f32; 3]> =
                (0..round * 4).map(|_| [at_m, 0.0, 0.0].map(|v| v + 0.024 * noise(&mut state) - 0.006)).collect();
            let sizes = HashSizes::for_points(points_m.len());
            let mut words = vec![0; sizes.words()];
            let mut table = HashMut::in_words(&mut words, sizes).unwrap();
            table.build(&points_m, 0.003, if round % 5 == 0 { Layout::Hashed } else { Layout::Auto }).unwrap();
            let (hash, owner) = (table.as_ref(), vec![1; points_m.len()]);
            let points = Points { owner: &owner, node: &[], own: None };
            let tissue = Tissue { positions_m: &positions_m, tets: &tets, tet_owner: &vec![0; tets.len()] };
            let mut gaps = vec![Gap::FAR; points_m.len()];
            find_gaps(&hash, &points, &tissue, &topology, RANGE_M, &mut gaps).unwrap();
            assert_eq!(gaps, plain(&hash, &points, &tissue, &topology), "round {round}");
            found += gaps.iter().filter(|gap| gap.triangle != NONE).count();
            far += gaps.iter().filter(|gap| gap.triangle == NONE).count();
        }
        assert!(found > 50 && far > 50, "{found} points near a surface, {far} far from it");
    }
}
