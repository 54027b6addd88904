//! Which cells of the grid are fluid: those of the cavity that hold no tissue. Found at the fluid's own rate from the tissue's newest state,
//! read in place.

use glam::{Mat3, Vec3};
use hyst_flow::Grid;

/// Cell states for the solver.
const FLUID: u8 = 0;
const SOLID: u8 = 1;

/// The mask and what is needed to make it.
pub struct Cavity {
    grid: Grid,
    mask: Vec<u8>,
    queue: Vec<u32>,
}

impl Cavity {
    /// For a grid; everything is fluid until the tissue is known.
    pub fn new(grid: Grid) -> Cavity {
        let cells = grid.cell_count();
        Cavity { mask: vec![FLUID; cells], queue: Vec::with_capacity(cells), grid }
    }

    /// The mask, x fastest: nonzero is solid.
    pub fn mask(&self) -> &[u8] {
        &self.mask
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        let [nx, ny, _] = self.grid.cells();
        (k * ny + j) * nx + i
    }

    /// Cells whose centre lies in a tet that is a wall are solid; so are those that cannot be reached from the seed (outside of the organ). If the seed
    /// itself lies in tissue, the nearest free cell serves; without any the mask stays as it was, and false is returned.
    pub fn update(
        &mut self,
        positions_m: &[[f32; 3]],
        tets: &[[u32; 4]],
        is_wall: impl Fn(usize) -> bool,
        seed_m: [f32; 3],
    ) -> bool {
        let before_len = self.mask.len();
        let mut solid = std::mem::take(&mut self.mask);
        solid.fill(FLUID);
        for (index, tet) in tets.iter().enumerate() {
            if tet.iter().all(|node| (*node as usize) < positions_m.len()) && is_wall(index) {
                let corners = tet.map(|node| Vec3::from(positions_m[node as usize]));
                self.for_each_cell_in(corners, |cell| solid[cell] = SOLID);
            }
        }
        debug_assert_eq!(solid.len(), before_len);
        let found = self.flood(&mut solid, seed_m);
        self.mask = solid;
        found
    }

    /// Range of cells along an axis whose centres may lie between two coordinates.
    fn range(&self, axis: usize, low_m: f32, high_m: f32) -> std::ops::Range<usize> {
        let (origin, spacing) = (self.grid.origin_m()[axis], self.grid.spacing_m()[axis]);
        let cells = self.grid.cells()[axis] as f32;
        let first = ((low_m - origin) / spacing - 0.5).ceil().clamp(0.0, cells);
        let last = ((high_m - origin) / spacing - 0.5).floor().clamp(-1.0, cells - 1.0);
        first as usize..(last + 1.0).max(0.0) as usize
    }

    /// The cell that a place lies in.
    pub fn cell_at(&self, place_m: Vec3) -> Option<usize> {
        let (origin, spacing, cells) = (self.grid.origin_m(), self.grid.spacing_m(), self.grid.cells());
        let along: [f32; 3] = std::array::from_fn(|axis| (place_m[axis] - origin[axis]) / spacing[axis]);
        let is_inside = (0..3).all(|axis| along[axis] >= 0.0 && along[axis] < cells[axis] as f32);
        is_inside.then(|| self.index(along.map(|cells| cells as usize)))
    }

    /// Calls `visit` with every cell whose centre lies in a tet.
    pub fn for_each_cell_in(&self, corners: [Vec3; 4], mut visit: impl FnMut(usize)) {
        if !corners.iter().all(|corner| corner.is_finite()) {
            return;
        }
        let low = corners.iter().copied().fold(Vec3::INFINITY, Vec3::min);
        let high = corners.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
        let edges = Mat3::from_cols(corners[1] - corners[0], corners[2] - corners[0], corners[3] - corners[0]);
        if edges.determinant().abs() < f32::MIN_POSITIVE {
            return;
        }
        let inverse = edges.inverse();
        for k in self.range(2, low.z, high.z) {
            for j in self.range(1, low.y, high.y) {
                for i in self.range(0, low.x, high.x) {
                    let beta = inverse * (Vec3::from(self.grid.centre_m([i, j, k])) - corners[0]);
                    if beta.min_element() >= 0.0 && beta.element_sum() <= 1.0 {
                        visit(self.index([i, j, k]));
                    }
                }
            }
        }
    }

    /// Turns every cell that cannot be reached from the seed solid.
    fn flood(&mut self, solid: &mut [u8], seed_m: [f32; 3]) -> bool {
        const REACHED: u8 = 2;
        let distance = |at: usize| Vec3::from(self.grid.centre_m(self.place(at))).distance_squared(Vec3::from(seed_m));
        let free = (0..solid.len()).filter(|at| solid[*at] == FLUID);
        let Some(seed) = free.min_by(|a, b| distance(*a).total_cmp(&distance(*b))) else { return false };
        self.queue.clear();
        self.queue.push(seed as u32);
        solid[seed] = REACHED;
        let [nx, ny, nz] = self.grid.cells();
        while let Some(at) = self.queue.pop() {
            let [i, j, k] = self.place(at as usize);
            let neighbours = [
                (i > 0).then(|| [i - 1, j, k]),
                (i + 1 < nx).then_some([i + 1, j, k]),
                (j > 0).then(|| [i, j - 1, k]),
                (j + 1 < ny).then_some([i, j + 1, k]),
                (k > 0).then(|| [i, j, k - 1]),
                (k + 1 < nz).then_some([i, j, k + 1]),
            ];
            for place in neighbours.into_iter().flatten() {
                let next = self.index(place);
                if solid[next] == FLUID {
                    solid[next] = REACHED;
                    self.queue.push(next as u32);
                }
            }
        }
        for cell in solid {
            *cell = if *cell == REACHED { FLUID } else { SOLID };
        }
        true
    }

    fn place(&self, at: usize) -> [usize; 3] {
        let [nx, ny, _] = self.grid.cells();
        [at % nx, at / nx % ny, at / (nx * ny)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of two tets across the box leaves only the seed's side fluid.
    #[test]
    fn what_cannot_be_reached_from_the_seed_is_solid() {
        let grid = Grid::new([8, 8, 8], [1.0; 3], [0.0; 3]).unwrap();
        let mut cavity = Cavity::new(grid);
        // A slab 3 ≤ x ≤ 5 as one big tet prism: corners far outside of the box, so that the slab is closed.
        let far = 100.0;
        let positions =
            [[3.0, -far, -far], [3.0, far, -far], [3.0, 0.0, far], [5.2, -far, -far], [5.2, far, -far], [5.2, 0.0, far]];
        let tets = [[0, 1, 2, 3], [1, 2, 3, 4], [2, 3, 4, 5]];
        assert!(cavity.update(&positions, &tets, |_| true, [1.0, 4.0, 4.0]));
        for (at, cell) in cavity.mask().iter().enumerate() {
            let x = at % 8;
            assert_eq!(*cell == FLUID, x < 3, "cell {at} at x = {x}");
        }
    }

    #[test]
    fn positions_that_are_not_finite_mark_nothing() {
        let grid = Grid::new([4, 4, 4], [1.0; 3], [0.0; 3]).unwrap();
        let mut cavity = Cavity::new(grid);
        let positions = [[f32::NAN; 3], [0.0; 3], [f32::INFINITY; 3], [1.0; 3]];
        assert!(cavity.update(&positions, &[[0, 1, 2, 3], [0, 1, 2, 9]], |_| true, [1.0; 3]));
        assert!(cavity.mask().iter().all(|cell| *cell == FLUID));
    }
}
