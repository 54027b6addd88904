//! Which cells of the grid are fluid: those of the cavity that hold no tissue; and how fast the tissue moves in the others. Found at the fluid's own rate
//! from the tissue's newest state, read in place.

use crate::raster;
use glam::{Vec3, Vec4};
use hyst_flow::Grid;

/// Cell states for the solver.
const FLUID: u8 = 0;
const SOLID: u8 = 1;

/// The tissue at a moment.
#[derive(Clone, Copy)]
pub struct Tissue<'a> {
    /// Of each node, m.
    pub positions_m: &'a [[f32; 3]],
    /// Of each node, m/s; none at all of tissue at rest.
    pub velocities_m_s: &'a [[f32; 3]],
    /// Nodes of each tet.
    pub tets: &'a [[u32; 4]],
}

impl Tissue<'_> {
    /// Where the corners of a tet are, if it has all.
    pub fn corners_m(&self, tet: [u32; 4]) -> Option<[Vec3; 4]> {
        let known = tet.iter().all(|node| (*node as usize) < self.positions_m.len());
        known.then(|| tet.map(|node| Vec3::from(self.positions_m[node as usize])))
    }

    /// How fast each corner of a tet moves, m/s.
    fn velocities_m_s(&self, tet: [u32; 4]) -> [Vec3; 4] {
        tet.map(|node| self.velocities_m_s.get(node as usize).map_or(Vec3::ZERO, |velocity| Vec3::from(*velocity)))
    }
}

/// The mask and what is needed to make it.
pub struct Cavity {
    grid: Grid,
    mask: Vec<u8>,
    /// Of the state that is gone on from.
    before: Vec<u8>,
    velocities_m_s: Vec<[f32; 3]>,
    /// Places of cells: to take an index apart would be most of the work.
    queue: Vec<[u16; 3]>,
    is_open: bool,
}

impl Cavity {
    /// For a grid; everything is fluid until the tissue is known.
    pub fn new(grid: Grid) -> Cavity {
        let cells = grid.cell_count();
        let (mask, before, velocities_m_s) = (vec![FLUID; cells], vec![FLUID; cells], vec![[0.0; 3]; cells]);
        Cavity { mask, before, velocities_m_s, queue: Vec::with_capacity(cells), is_open: true, grid }
    }

    /// Takes the mask of the state that is gone on from, whoever made it: what was fluid there is the cavity.
    pub fn go_on_from(&mut self, mask: &[u8]) {
        if mask.len() == self.before.len() {
            self.before.copy_from_slice(mask);
        }
    }

    /// The mask, x fastest: nonzero is solid.
    pub fn mask(&self) -> &[u8] {
        &self.mask
    }

    /// How fast the tissue moves in each cell that it fills, m/s; 0 in the others.
    pub fn velocities_m_s(&self) -> &[[f32; 3]] {
        &self.velocities_m_s
    }

    /// Whether the fluid reaches a side of the box: then the tissue does not close the cavity there, and the box does.
    pub fn is_open(&self) -> bool {
        self.is_open
    }

    fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        let [nx, ny, _] = self.grid.cells();
        (k * ny + j) * nx + i
    }

    /// Cells whose centre lies in a tet that is a wall are solid; so are those that cannot be reached from the seed (outside of the organ). If the seed
    /// itself lies in tissue, or where no cavity was before, the nearest free cell that was fluid before serves; without any the mask stays as it was before,
    /// at rest, and false is returned.
    pub fn update(&mut self, tissue: &Tissue<'_>, is_wall: impl Fn(usize) -> bool, seed_m: [f32; 3]) -> bool {
        let (mut solid, mut velocities_m_s) = (std::mem::take(&mut self.mask), std::mem::take(&mut self.velocities_m_s));
        solid.fill(FLUID);
        velocities_m_s.fill([0.0; 3]);
        let moves = !tissue.velocities_m_s.is_empty();
        for (_, tet) in tissue.tets.iter().enumerate().filter(|(index, _)| is_wall(*index)) {
            let Some(corners) = tissue.corners_m(*tet) else { continue };
            let of_corners_m_s = moves.then(|| tissue.velocities_m_s(*tet));
            self.for_each_cell_in(corners, |cell, shares| {
                solid[cell] = SOLID;
                if let Some([a, b, c, d]) = of_corners_m_s {
                    velocities_m_s[cell] = (shares.x * a + shares.y * b + shares.z * c + shares.w * d).to_array();
                }
            });
        }
        let found = self.flood(&mut solid, seed_m);
        if !found {
            solid.copy_from_slice(&self.before);
            velocities_m_s.fill([0.0; 3]);
        }
        (self.mask, self.velocities_m_s) = (solid, velocities_m_s);
        found
    }

    /// The cell that a place lies in.
    pub fn cell_at(&self, place_m: Vec3) -> Option<usize> {
        let (origin, spacing, cells) = (self.grid.origin_m(), self.grid.spacing_m(), self.grid.cells());
        let along: [f32; 3] = std::array::from_fn(|axis| (place_m[axis] - origin[axis]) / spacing[axis]);
        let is_inside = (0..3).all(|axis| along[axis] >= 0.0 && along[axis] < cells[axis] as f32);
        is_inside.then(|| self.index(along.map(|cells| cells as usize)))
    }

    /// Calls `visit` with every cell whose centre lies in a tet, and the share of each corner there ([`raster`]).
    pub fn for_each_cell_in(&self, corners_m: [Vec3; 4], visit: impl FnMut(usize, Vec4)) {
        raster::for_each_cell_in(&self.grid, corners_m, visit);
    }

    /// The free cell that is nearest to a place: mostly the one that it lies in. Of those that were fluid before, if any was: a place that tissue has covered
    /// may be nearer to the outside of the organ than to what is left of its cavity.
    fn nearest_free(&self, solid: &[u8], place_m: [f32; 3]) -> Option<usize> {
        let is_known = self.before.contains(&FLUID);
        let is_free = |at: &usize| solid[*at] == FLUID && (!is_known || self.before[*at] == FLUID);
        let own = self.cell_at(Vec3::from(place_m)).filter(is_free);
        let distance = |at: usize| Vec3::from(self.grid.centre_m(self.place(at))).distance_squared(Vec3::from(place_m));
        let free = || (0..solid.len()).filter(is_free);
        own.or_else(|| free().min_by(|a, b| distance(*a).total_cmp(&distance(*b))))
    }

    /// Turns every cell that cannot be reached from the seed solid.
    fn flood(&mut self, solid: &mut [u8], seed_m: [f32; 3]) -> bool {
        const REACHED: u8 = 2;
        let Some(seed) = self.nearest_free(solid, seed_m) else { return false };
        self.is_open = false;
        self.queue.clear();
        self.queue.push(self.place(seed).map(|index| index as u16));
        solid[seed] = REACHED;
        let cells = self.grid.cells();
        let strides = [1, cells[0], cells[0] * cells[1]];
        while let Some(place) = self.queue.pop() {
            let at = self.index(place.map(usize::from));
            for axis in 0..3 {
                let (here, stride) = (usize::from(place[axis]), strides[axis]);
                self.is_open |= here == 0 || here + 1 == cells[axis];
                let before = (here > 0).then(|| (at - stride, here - 1));
                let behind = (here + 1 < cells[axis]).then(|| (at + stride, here + 1));
                for (next, index) in before.into_iter().chain(behind) {
                    if solid[next] == FLUID {
                        solid[next] = REACHED;
                        let mut neighbour = place;
                        neighbour[axis] = index as u16;
                        self.queue.push(neighbour);
                    }
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

    fn still<'a>(positions_m: &'a [[f32; 3]], tets: &'a [[u32; 4]]) -> Tissue<'a> {
        Tissue { positions_m, velocities_m_s: &[], tets }
    }

    /// A slab 3 ≤ x ≤ 5 as one big tet prism: corners far outside of the box, so that the slab is closed.
    const SLAB_M: [[f32; 3]; 6] = [
        [3.0, -100.0, -100.0],
        [3.0, 100.0, -100.0],
        [3.0, 0.0, 100.0],
        [5.2, -100.0, -100.0],
        [5.2, 100.0, -100.0],
        [5.2, 0.0, 100.0],
    ];
    const SLAB: [[u32; 4]; 3] = [[0, 1, 2, 3], [1, 2, 3, 4], [2, 3, 4, 5]];

    /// A wall of two tets across the box leaves only the seed's side fluid.
    #[test]
    fn what_cannot_be_reached_from_the_seed_is_solid() {
        let grid = Grid::new([8, 8, 8], [1.0; 3], [0.0; 3]).unwrap();
        let mut cavity = Cavity::new(grid);
        assert!(cavity.update(&still(&SLAB_M, &SLAB), |_| true, [1.0, 4.0, 4.0]));
        for (at, cell) in cavity.mask().iter().enumerate() {
            let x = at % 8;
            assert_eq!(*cell == FLUID, x < 3, "cell {at} at x = {x}");
        }
        assert!(cavity.velocities_m_s().iter().all(|velocity| *velocity == [0.0; 3]));
        assert!(cavity.is_open(), "the box closes what the slab does not");
    }

    #[test]
    fn where_tissue_covers_the_seed_the_cavity_stays_what_was_fluid_and_is_never_what_was_outside() {
        let grid = Grid::new([8, 8, 8], [1.0; 3], [0.0; 3]).unwrap();
        let mut cavity = Cavity::new(grid);
        let seed_m = [2.9, 4.0, 4.0];
        let by = |x_m: f32| SLAB_M.map(|[x, y, z]| [x + x_m, y, z]);
        let fluid = |cavity: &Cavity| (0..8).filter(|x| cavity.mask()[4 * 64 + 4 * 8 + x] == FLUID).collect::<Vec<usize>>();
        assert!(cavity.update(&still(&SLAB_M, &SLAB), |_| true, seed_m));
        assert_eq!(fluid(&cavity), [0, 1, 2]);
        // The slab comes over the seed: the cells behind it are nearer to that, and were outside.
        let mask = cavity.mask().to_vec();
        cavity.go_on_from(&mask);
        assert!(cavity.update(&still(&by(-2.2), &SLAB), |_| true, seed_m));
        assert_eq!(fluid(&cavity), [0]);
        // Over all that was left: that stays as it was.
        let mask = cavity.mask().to_vec();
        cavity.go_on_from(&mask);
        let velocities_m_s = [[0.1; 3]; 6];
        assert!(!cavity.update(&Tissue { velocities_m_s: &velocities_m_s, ..still(&by(-3.2), &SLAB) }, |_| true, seed_m));
        assert!(cavity.mask() == mask && cavity.velocities_m_s().iter().all(|velocity| *velocity == [0.0; 3]));
        // And off again, whoever goes on.
        let mut other = Cavity::new(grid);
        other.go_on_from(&mask);
        assert!(other.update(&still(&SLAB_M, &SLAB), |_| true, seed_m));
        assert_eq!(fluid(&other), [0, 1, 2]);
        // Who knows of no cavity takes what is nearest.
        assert!(Cavity::new(grid).update(&still(&by(-3.2), &SLAB), |_| true, seed_m));
    }

    #[test]
    fn a_wall_moves_as_its_corners_do_and_what_is_behind_it_is_at_rest() {
        let grid = Grid::new([8, 8, 8], [1.0; 3], [0.0; 3]).unwrap();
        let mut cavity = Cavity::new(grid);
        // Its low face goes along x at 0.1 m/s, its high face at 0.32: between them it grows by 0.1 in a metre.
        let velocities_m_s =
            [[0.1, 0.0, 0.02], [0.1, 0.0, 0.02], [0.1, 0.0, 0.02], [0.32, 0.0, 0.02], [0.32, 0.0, 0.02], [0.32, 0.0, 0.02]];
        assert!(cavity.update(&Tissue { velocities_m_s: &velocities_m_s, ..still(&SLAB_M, &SLAB) }, |_| true, [1.0, 4.0, 4.0]));
        for (at, [vx, vy, vz]) in cavity.velocities_m_s().iter().copied().enumerate() {
            let x = at % 8;
            let expected = if (3..5).contains(&x) { [0.1 + 0.1 * (x as f32 + 0.5 - 3.0), 0.0, 0.02] } else { [0.0; 3] };
            let off = [vx - expected[0], vy - expected[1], vz - expected[2]];
            assert!(off.iter().all(|off| off.abs() < 1e-4), "x = {x}: {vx} {vy} {vz}");
        }
        // Fewer velocities than nodes are no velocity, and none again is rest.
        assert!(cavity.update(
            &Tissue { velocities_m_s: &velocities_m_s[..1], ..still(&SLAB_M, &SLAB) },
            |_| true,
            [1.0, 4.0, 4.0]
        ));
        assert!(cavity.update(&still(&SLAB_M, &SLAB), |_| true, [1.0, 4.0, 4.0]));
        assert!(cavity.velocities_m_s().iter().all(|velocity| *velocity == [0.0; 3]));
    }

    #[test]
    fn a_cavity_within_tissue_is_closed_and_one_with_a_hole_to_the_boxs_side_is_open() {
        let grid = Grid::new([9, 9, 9], [1.0; 3], [0.0; 3]).unwrap();
        let mut cavity = Cavity::new(grid);
        // A tet of half a cell around each cell's middle but for one of 3×3×3 cells, and a canal to the side.
        let mut closed_at = |has_canal: bool| {
            let (mut positions, mut tets) = (Vec::new(), Vec::new());
            for at in 0..729 {
                let place = [at % 9, at / 9 % 9, at / 81];
                let is_cavity = place.iter().all(|index| (3..6).contains(index));
                let is_canal = has_canal && place[0] < 4 && place[1] == 4 && place[2] == 4;
                if is_cavity || is_canal {
                    continue;
                }
                let ([x, y, z], first) = (place.map(|index| index as f32 + 0.3), positions.len() as u32);
                positions.extend([[x, y, z], [x + 0.9, y, z], [x, y + 0.9, z], [x, y, z + 0.9]]);
                tets.push([first, first + 1, first + 2, first + 3]);
            }
            assert!(cavity.update(&still(&positions, &tets), |_| true, [4.5; 3]));
            (cavity.mask().iter().filter(|cell| **cell == FLUID).count(), cavity.is_open())
        };
        assert_eq!(closed_at(false), (27, false));
        assert_eq!(closed_at(true), (30, true));
    }

    #[test]
    fn positions_that_are_not_finite_mark_nothing() {
        let grid = Grid::new([4, 4, 4], [1.0; 3], [0.0; 3]).unwrap();
        let mut cavity = Cavity::new(grid);
        let positions = [[f32::NAN; 3], [0.0; 3], [f32::INFINITY; 3], [1.0; 3]];
        assert!(cavity.update(&still(&positions, &[[0, 1, 2, 3], [0, 1, 2, 9]]), |_| true, [1.0; 3]));
        assert!(cavity.mask().iter().all(|cell| *cell == FLUID));
    }
}
