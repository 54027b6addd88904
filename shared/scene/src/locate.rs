//! Which tet a point lies in: a uniform grid over the tets' boxes. Used while loading only; the simulation has its own.

use glam::{Mat3, Vec3};
use hyst_mesh::TetMesh;

/// Cells along the longest side: at 48 a mesh of 200 000 tets has a few tets per cell, and 48³ lists are a few megabytes.
const CELLS: f32 = 48.0;
/// Most entries of the grid's lists. A mesh of which each tet fills the whole box would need billions: it gets larger cells.
const MAX_ENTRIES: usize = 1 << 24;
/// A point this far outside, in barycentric terms, still counts as inside: it lies on a face up to rounding.
const ON_FACE: f32 = 1e-5;

/// Finds tets by position.
pub(crate) struct Locator {
    low: Vec3,
    cell_m: f32,
    size: [usize; 3],
    starts: Vec<u32>,
    tets: Vec<u32>,
    origins: Vec<Vec3>,
    inverses: Vec<Mat3>,
}

impl Locator {
    /// Over the tets of a mesh with finite coordinates and indices in range. Flat tets hold no point.
    pub(crate) fn new(mesh: &TetMesh) -> Locator {
        let mut cells = CELLS;
        loop {
            let mut locator = Locator::empty(mesh, cells);
            let boxes: Vec<_> = mesh.tets.iter().map(|&tet| locator.add(mesh, tet)).collect();
            let entries: usize =
                boxes.iter().map(|(from, to)| (0..3).map(|axis| to[axis] - from[axis] + 1).product::<usize>()).sum();
            if entries <= MAX_ENTRIES || cells <= 1.0 {
                locator.fill(&boxes, entries);
                return locator;
            }
            cells /= 2.0;
        }
    }

    fn empty(mesh: &TetMesh, cells: f32) -> Locator {
        let (low, high) = bounds(&mesh.positions_m);
        let cell_m = ((high - low).max_element() / cells).max(1e-9);
        let size = ((high - low) / cell_m).to_array().map(|cells| cells as usize + 1);
        Locator { low, cell_m, size, starts: Vec::new(), tets: Vec::new(), origins: Vec::new(), inverses: Vec::new() }
    }

    /// Adds a tet's inverse and returns the range of cells that its box covers.
    fn add(&mut self, mesh: &TetMesh, tet: [u32; 4]) -> ([usize; 3], [usize; 3]) {
        let [a, b, c, d] = tet.map(|node| Vec3::from(mesh.positions_m[node as usize]));
        let edges = Mat3::from_cols(b - a, c - a, d - a);
        self.origins.push(a);
        self.inverses.push(if edges.determinant() == 0.0 { Mat3::NAN } else { edges.inverse() });
        (self.cell(a.min(b).min(c).min(d)), self.cell(a.max(b).max(c).max(d)))
    }

    /// Counting sort of the tets into the cells, in ascending order within each.
    fn fill(&mut self, boxes: &[([usize; 3], [usize; 3])], entries: usize) {
        let mut starts = vec![0u32; self.size[0] * self.size[1] * self.size[2] + 1];
        for &(from, to) in boxes {
            self.each_cell(from, to, |cell| starts[cell + 1] += 1);
        }
        for cell in 1..starts.len() {
            starts[cell] += starts[cell - 1];
        }
        let mut tets = vec![0; entries];
        let mut next = starts.clone();
        for (tet, &(from, to)) in boxes.iter().enumerate() {
            self.each_cell(from, to, |cell| {
                tets[next[cell] as usize] = tet as u32;
                next[cell] += 1;
            });
        }
        (self.starts, self.tets) = (starts, tets);
    }

    /// The first tet that holds the point, with the point's barycentric weights.
    pub(crate) fn find(&self, point_m: [f32; 3]) -> Option<(u32, [f32; 4])> {
        let point = Vec3::from(point_m);
        let relative = (point - self.low) / self.cell_m;
        let inside = (0..3).all(|axis| relative[axis] >= -1.0 && relative[axis] <= self.size[axis] as f32);
        if !inside {
            return None;
        }
        let [x, y, z] = self.cell(point);
        let cell = (z * self.size[1] + y) * self.size[0] + x;
        let range = self.starts[cell] as usize..self.starts[cell + 1] as usize;
        self.tets[range].iter().find_map(|&tet| {
            let beta = self.inverses[tet as usize] * (point - self.origins[tet as usize]);
            let weights = [1.0 - beta.x - beta.y - beta.z, beta.x, beta.y, beta.z];
            weights.iter().all(|&weight| weight >= -ON_FACE).then_some((tet, weights))
        })
    }

    fn cell(&self, point: Vec3) -> [usize; 3] {
        let relative = ((point - self.low) / self.cell_m).to_array();
        std::array::from_fn(|axis| (relative[axis].max(0.0) as usize).min(self.size[axis] - 1))
    }

    fn each_cell(&self, from: [usize; 3], to: [usize; 3], mut visit: impl FnMut(usize)) {
        for z in from[2]..=to[2] {
            for y in from[1]..=to[1] {
                for x in from[0]..=to[0] {
                    visit((z * self.size[1] + y) * self.size[0] + x);
                }
            }
        }
    }
}

/// Lowest and highest corner of a set of points; zeros for none.
pub(crate) fn bounds(points: &[[f32; 3]]) -> (Vec3, Vec3) {
    let first = points.first().map_or(Vec3::ZERO, |&point| Vec3::from(point));
    points.iter().fold((first, first), |(low, high), &point| (low.min(point.into()), high.max(point.into())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_tet_is_found_by_its_centre_and_outside_nothing_is_found() {
        let mut mesh = TetMesh::default();
        for step in 0..20u32 {
            let at = step as f32 * 0.01;
            mesh.positions_m.extend([[at, 0.0, 0.0], [at + 0.009, 0.0, 0.0], [at, 0.009, 0.0], [at, 0.0, 0.009 + at]]);
            mesh.tets.push([0, 1, 2, 3].map(|corner| step * 4 + corner));
            mesh.regions.push(0);
        }
        mesh.tets.push([0, 0, 1, 2]);
        mesh.regions.push(0);
        let locator = Locator::new(&mesh);
        for (tet, corners) in mesh.tets.iter().enumerate().take(20) {
            let centre = corners.iter().map(|&node| Vec3::from(mesh.positions_m[node as usize])).sum::<Vec3>() / 4.0;
            let (found, weights) = locator.find(centre.to_array()).unwrap();
            assert_eq!(found, tet as u32);
            assert!(weights.iter().all(|weight| (weight - 0.25).abs() < 1e-3));
        }
        for outside in [[-0.01, 0.0, 0.0], [0.0095, 0.001, 0.001], [5.0, 5.0, 5.0], [f32::NAN; 3]] {
            assert_eq!(locator.find(outside), None);
        }
    }
}
