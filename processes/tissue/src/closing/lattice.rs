//! Points of a plane across the y axis, and the lines along y through them: where these meet a mesh's surface is how an organ looks from in front.

use crate::world::mean_edge_m;
use hyst_mesh::TetMesh;
use std::ops::Range;

/// From one point to the next, in mean edges of the mesh.
const STEP_EDGES: f64 = 0.2;
/// Most points along an axis, about: a mesh with tets finer than that has its steps longer.
const MOST_POINTS: f64 = 250.0;
/// So far before the mesh's box the first point lies, in steps along x and z: no whole number and no half, so that no line goes along the edges of a mesh
/// whose places are round numbers.
const BEFORE: [f64; 2] = [0.63, 0.71];

/// The points, x first, then z.
pub(super) struct Lattice {
    low_m: [f64; 2],
    step_m: f64,
    counts: [usize; 2],
}

impl Lattice {
    /// Points before all of a mesh, and some beside it.
    pub(super) fn before(mesh: &TetMesh) -> Lattice {
        let ends_m = [0, 2].map(|axis: usize| {
            let along_m = mesh.positions_m.iter().map(|place| f64::from(place[axis]));
            along_m.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)])
        });
        let extent_m = ends_m.iter().map(|[low, high]| high - low).fold(0.0, f64::max);
        let step_m = (STEP_EDGES * f64::from(mean_edge_m(&mesh.tets, &mesh.positions_m))).max(extent_m / MOST_POINTS);
        Lattice {
            low_m: [0, 1].map(|axis| ends_m[axis][0] - BEFORE[axis] * step_m),
            step_m,
            counts: ends_m.map(|[low, high]| ((high - low) / step_m).ceil() as usize + 3),
        }
    }

    /// How many points there are.
    pub(super) fn len(&self) -> usize {
        self.counts[0] * self.counts[1]
    }

    /// Along x.
    pub(super) fn row(&self) -> usize {
        self.counts[0]
    }

    /// From one point to the next along an axis, m.
    pub(super) fn step_m(&self) -> f64 {
        self.step_m
    }

    /// The point that is so many beside another one along x and z, if there is one.
    pub(super) fn beside(&self, at: usize, by: [isize; 2]) -> Option<usize> {
        let place = [at % self.counts[0], at / self.counts[0]];
        let along = |axis: usize| place[axis].checked_add_signed(by[axis]).filter(|index| *index < self.counts[axis]);
        Some(along(1)? * self.counts[0] + along(0)?)
    }

    /// The four points about a place, with their weights; `None` beside the lattice.
    pub(super) fn around(&self, [x_m, z_m]: [f64; 2]) -> Option<[(usize, f64); 4]> {
        let along = [(x_m - self.low_m[0]) / self.step_m, (z_m - self.low_m[1]) / self.step_m];
        let is_within = |axis: usize| along[axis] >= 0.0 && along[axis] < (self.counts[axis] - 1) as f64;
        if !(is_within(0) && is_within(1)) {
            return None;
        }
        let first = along[1] as usize * self.counts[0] + along[0] as usize;
        let [x, z] = along.map(f64::fract);
        let above = first + self.counts[0];
        Some([(first, (1.0 - x) * (1.0 - z)), (first + 1, x * (1.0 - z)), (above, (1.0 - x) * z), (above + 1, x * z)])
    }

    /// Where the line through each point meets the surface of a mesh, m along y, in ascending order.
    pub(super) fn crossings_m(&self, mesh: &TetMesh) -> Vec<Vec<f64>> {
        let mut found = vec![Vec::new(); self.len()];
        for face in hyst_mesh::boundary(mesh).triangles {
            let [a, b, c] = face.map(|node| mesh.positions_m[node as usize].map(f64::from));
            let [u, v] = [b, c].map(|corner| [corner[0] - a[0], corner[2] - a[2]]);
            let twice_area = u[0] * v[1] - v[0] * u[1];
            if twice_area == 0.0 {
                continue;
            }
            for row in self.between(1, [a[2], b[2], c[2]]) {
                let z = self.low_m[1] + row as f64 * self.step_m - a[2];
                for column in self.between(0, [a[0], b[0], c[0]]) {
                    let x = self.low_m[0] + column as f64 * self.step_m - a[0];
                    let [beta, gamma] = [(x * v[1] - v[0] * z) / twice_area, (u[0] * z - x * u[1]) / twice_area];
                    if beta >= 0.0 && gamma >= 0.0 && beta + gamma <= 1.0 {
                        found[row * self.counts[0] + column].push(a[1] + beta * (b[1] - a[1]) + gamma * (c[1] - a[1]));
                    }
                }
            }
        }
        found.iter_mut().for_each(|of_line| of_line.sort_by(f64::total_cmp));
        found
    }

    /// The points along an axis (0 is x, 1 is z) that lie between the least and the greatest of three places.
    fn between(&self, axis: usize, along_m: [f64; 3]) -> Range<usize> {
        let steps = along_m.map(|at_m| (at_m - self.low_m[axis]) / self.step_m);
        let [low, high] = [steps.into_iter().fold(f64::INFINITY, f64::min), steps.into_iter().fold(f64::NEG_INFINITY, f64::max)];
        low.ceil().max(0.0) as usize..((high.floor() + 1.0).max(0.0) as usize).min(self.counts[axis])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One tet whose face toward −y is the plane y = 0, and whose tip is at y = 3.
    fn tip() -> TetMesh {
        let positions_m = vec![[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 0.0, 4.0], [0.0, 3.0, 0.0]];
        TetMesh { positions_m, tets: vec![[0, 1, 3, 2]], regions: vec![0] }
    }

    #[test]
    fn a_line_meets_a_closed_surface_as_often_out_as_in_and_where_it_is() {
        let mesh = tip();
        let lattice = Lattice::before(&mesh);
        let crossings_m = lattice.crossings_m(&mesh);
        assert_eq!(crossings_m.len(), lattice.len());
        let mut met = 0;
        for (at, found) in crossings_m.iter().enumerate() {
            let x = lattice.low_m[0] + (at % lattice.row()) as f64 * lattice.step_m;
            let z = lattice.low_m[1] + (at / lattice.row()) as f64 * lattice.step_m;
            if x <= 0.0 || z <= 0.0 || x + z >= 4.0 {
                assert!(found.is_empty(), "({x}, {z}): {found:?}");
                continue;
            }
            met += 1;
            assert!(found.len() == 2 && found[0].abs() < 1e-9, "({x}, {z}): {found:?}");
            assert!((found[1] - 3.0 * (1.0 - (x + z) / 4.0)).abs() < 1e-9, "({x}, {z}): {found:?}");
        }
        assert!(met > 5, "{met} lines");
    }

    #[test]
    fn the_weights_of_a_place_are_those_of_its_four_points() {
        let lattice = Lattice { low_m: [-1.0, 2.0], step_m: 0.5, counts: [4, 3] };
        let around = lattice.around([-0.6, 2.7]).unwrap();
        let [x, z] = [0, 1].map(|axis| {
            let of = |at: usize| lattice.low_m[axis] + 0.5 * [at % 4, at / 4][axis] as f64;
            around.iter().map(|(at, weight)| weight * of(*at)).sum::<f64>()
        });
        assert!((x + 0.6).abs() < 1e-12 && (z - 2.7).abs() < 1e-12, "{x} {z}");
        assert!(
            lattice.around([-1.1, 2.1]).is_none() && lattice.around([0.0, 3.0]).is_none() && lattice.around([0.6, 2.1]).is_none()
        );
        let beside = [[1, 0], [-1, 0], [0, 1], [0, -1], [-1, 1]].map(|by| lattice.beside(4, by));
        assert_eq!(beside, [Some(5), None, Some(8), Some(0), None]);
    }
}
