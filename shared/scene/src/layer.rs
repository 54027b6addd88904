//! How near a point is to the boundary of an object: to the wall of its cavity, or to the rest of it.

use crate::fixed::hollow_triangles;
use crate::locate::Locator;
use glam::DVec3;
use hyst_mesh::TetMesh;
use std::collections::BTreeMap;

/// Smallest cell of the grid in which triangles are looked for, m.
const LEAST_CELL_M: f64 = 1e-3;
/// Most entries of its lists; with more it gets larger cells, and with cells as large as the object each triangle has eight at most.
const MAX_ENTRIES: f64 = (1 << 24) as f64;
/// Times that a cell is doubled at most: from 1 mm to far beyond any object.
const MAX_DOUBLINGS: usize = 32;

type Triangle = [DVec3; 3];

/// The boundary of an object in two: the wall of its cavity, of which a solid one has none, and the rest.
pub(crate) struct Skin {
    inner: Vec<Triangle>,
    outer: Vec<Triangle>,
}

impl Skin {
    /// That of a mesh with indices in range.
    pub(crate) fn of(mesh: &TetMesh) -> Skin {
        let boundary = hyst_mesh::boundary(mesh).triangles;
        let is_inner = hollow_triangles(&mesh.positions_m, &boundary, &Locator::new(mesh));
        let side = |of_inner: bool| {
            let own = boundary.iter().zip(&is_inner).filter(|(_, is_inner)| **is_inner == of_inner);
            own.map(|(triangle, _)| triangle.map(|node| DVec3::from(mesh.positions_m[node as usize].map(f64::from)))).collect()
        };
        Skin { inner: side(true), outer: side(false) }
    }

    /// What is within a reach of one of the two.
    pub(crate) fn near(&self, of_inner: bool, reach_m: f64) -> Near<'_> {
        Near::new(if of_inner { &self.inner } else { &self.outer }, reach_m)
    }
}

/// Triangles, by the cells of a grid that they come near to.
pub(crate) struct Near<'a> {
    triangles: &'a [Triangle],
    reach_m: f64,
    cell_m: f64,
    cells: BTreeMap<[i32; 3], Vec<u32>>,
}

impl<'a> Near<'a> {
    fn new(triangles: &'a [Triangle], reach_m: f64) -> Near<'a> {
        let mut cell_m = reach_m.max(LEAST_CELL_M);
        for _ in 0..MAX_DOUBLINGS {
            let cells = |triangle: &Triangle| {
                span(triangle, reach_m, cell_m).iter().map(|[from, to]| f64::from(*to) - f64::from(*from) + 1.0).product::<f64>()
            };
            if triangles.iter().map(cells).sum::<f64>() <= MAX_ENTRIES {
                break;
            }
            cell_m *= 2.0;
        }
        let mut cells: BTreeMap<[i32; 3], Vec<u32>> = BTreeMap::new();
        for (index, triangle) in (0u32..).zip(triangles) {
            let [x, y, z] = span(triangle, reach_m, cell_m).map(|[from, to]| from..=to);
            for (x, y) in x.flat_map(|x| y.clone().map(move |y| (x, y))) {
                z.clone().for_each(|z| cells.entry([x, y, z]).or_default().push(index));
            }
        }
        Near { triangles, reach_m, cell_m, cells }
    }

    /// Whether a point is.
    pub(crate) fn has(&self, point_m: &[f64; 3]) -> bool {
        let is_near = |index: &u32| distance_m(DVec3::from(*point_m), &self.triangles[*index as usize]) <= self.reach_m;
        self.cells.get(&point_m.map(|at| cell(at, self.cell_m))).is_some_and(|listed| listed.iter().any(is_near))
    }
}

fn cell(at_m: f64, cell_m: f64) -> i32 {
    (at_m / cell_m).floor() as i32
}

/// The first and the last cell on each axis that what is within reach of a triangle lies in.
fn span(triangle: &Triangle, reach_m: f64, cell_m: f64) -> [[i32; 2]; 3] {
    let [a, b, c] = *triangle;
    let (low, high) = (a.min(b).min(c) - reach_m, a.max(b).max(c) + reach_m);
    [0, 1, 2].map(|axis| [cell(low[axis], cell_m), cell(high[axis], cell_m)])
}

/// How far a point is from the nearest one of a triangle: the regions of its plane (Ericson, "Real-Time Collision Detection", 2005, section 5.1.5).
fn distance_m(point: DVec3, [a, b, c]: &Triangle) -> f64 {
    let (ab, ac) = (*b - *a, *c - *a);
    let along = |from: &DVec3| (ab.dot(point - *from), ac.dot(point - *from));
    let ((a1, a2), (b1, b2), (c1, c2)) = (along(a), along(b), along(c));
    let [of_a, of_b, of_c] = [b1 * c2 - c1 * b2, c1 * a2 - a1 * c2, a1 * b2 - b1 * a2];
    let nearest = if a1 <= 0.0 && a2 <= 0.0 {
        *a
    } else if b1 >= 0.0 && b2 <= b1 {
        *b
    } else if of_c <= 0.0 && a1 >= 0.0 && b1 <= 0.0 {
        *a + ab * (a1 / (a1 - b1))
    } else if c2 >= 0.0 && c1 <= c2 {
        *c
    } else if of_b <= 0.0 && a2 >= 0.0 && c2 <= 0.0 {
        *a + ac * (a2 / (a2 - c2))
    } else if of_a <= 0.0 && b2 >= b1 && c1 >= c2 {
        *b + (*c - *b) * ((b2 - b1) / ((b2 - b1) + (c1 - c2)))
    } else {
        *a + (ab * of_b + ac * of_c) / (of_a + of_b + of_c)
    };
    point.distance(nearest)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The least distance from a point to points all over a triangle.
    fn tried_m(point: DVec3, [a, b, c]: &Triangle) -> f64 {
        const STEPS: u32 = 400;
        let share = |step: u32| f64::from(step) / f64::from(STEPS);
        let all = (0..=STEPS).flat_map(|s| (0..=STEPS - s).map(move |t| (share(s), share(t))));
        all.map(|(s, t)| point.distance(*a + (*b - *a) * s + (*c - *a) * t)).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn the_distance_is_that_of_the_nearest_of_all_points_of_the_triangle() {
        let triangle = [DVec3::new(0.0, 0.0, 0.1), DVec3::new(1.0, 0.2, 0.0), DVec3::new(0.3, 0.9, -0.2)];
        let mut tried = 0;
        for (x, y, z) in (-3..=5).flat_map(|x| (-3..=5).flat_map(move |y| [-1, 0, 2].map(|z| (x, y, z)))) {
            let point = DVec3::new(f64::from(x), f64::from(y), f64::from(z)) * 0.3;
            let (found, by_trial) = (distance_m(point, &triangle), tried_m(point, &triangle));
            assert!(found <= by_trial + 1e-12 && by_trial - found < 3e-3, "{point}: {found}, by trial {by_trial}");
            tried += 1;
        }
        assert_eq!(tried, 243);
    }

    #[test]
    fn what_is_near_is_found_whatever_the_cells_are() {
        let triangle = [DVec3::ZERO, DVec3::new(0.3, 0.0, 0.0), DVec3::new(0.0, 0.3, 0.0)];
        for (count, reach_m) in [(1, 0.002), (1, 0.08), (1_000, 0.004)] {
            let triangles = vec![triangle; count];
            let near = Near::new(&triangles, reach_m);
            for z in [0.0, 0.5 * reach_m, 0.99 * reach_m, 1.01 * reach_m, 3.0 * reach_m] {
                assert_eq!(near.has(&[0.1, 0.1, z]), z <= reach_m, "{count} triangles, {z} m of {reach_m} m");
                assert!(!near.has(&[0.1 + 2.0, 0.1, z]));
            }
            assert!(near.has(&[-0.9 * reach_m, 0.1, 0.0]) && !near.has(&[-1.1 * reach_m, 0.1, 0.0]));
        }
    }
}
