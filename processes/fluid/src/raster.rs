//! Which cells of a grid have their centre in a tet. Most of the time that walls take goes here: some dozens of rows of cells for each of thousands of tets.

use glam::{BVec4A, Mat3, Vec3, Vec4};
use hyst_flow::Grid;
use std::ops::Range;

/// By how much a share may be below 0 in a cell that counts as within: what single precision leaves of a face that two tets share.
const ON_A_FACE: f32 = 1e-5;

/// How the share of each corner of a tet changes along a row of cells.
struct Row {
    /// From one cell to the next.
    step: Vec4,
    /// Cells until a share is 0, for each that there is of it; of no use where it does not change.
    cells_per_share: Vec4,
    rises: BVec4A,
    falls: BVec4A,
    is_level: BVec4A,
}

impl Row {
    fn new(step: Vec4) -> Row {
        let (rises, falls) = (step.cmpgt(Vec4::ZERO), step.cmplt(Vec4::ZERO));
        Row { step, cells_per_share: -step.recip(), rises, falls, is_level: !(rises | falls) }
    }

    /// Which of the first `count` cells lie within the tet, whose shares are `first` in the first of them.
    fn inside(&self, first: Vec4, count: f32) -> Range<usize> {
        let shares = first + Vec4::splat(ON_A_FACE);
        if (self.is_level & shares.cmplt(Vec4::ZERO)).any() {
            return 0..0;
        }
        let zero = shares * self.cells_per_share;
        let low = Vec4::select(self.rises, zero, Vec4::ZERO).max_element();
        let high = Vec4::select(self.falls, zero, Vec4::splat(count - 1.0)).min_element();
        up(low, count)..down(high + 1.0, count)
    }
}

/// The least whole number that is not below a number of cells, 0 to `most`; what is no number is 0. (`f32::ceil` is a call on the processors that all can.)
fn up(cells: f32, most: f32) -> usize {
    let cells = cells.clamp(0.0, most);
    let whole = cells as usize;
    whole + usize::from((whole as f32) < cells)
}

/// The greatest that is not above it, 0 to `most`.
fn down(cells: f32, most: f32) -> usize {
    cells.clamp(0.0, most) as usize
}

/// Range of cells along an axis whose centres may lie between two coordinates.
fn range(grid: &Grid, axis: usize, low_m: f32, high_m: f32) -> Range<usize> {
    let (origin_m, spacing_m, most) = (grid.origin_m()[axis], grid.spacing_m()[axis], grid.cells()[axis] as f32);
    up((low_m - origin_m) / spacing_m - 0.5, most)..down((high_m - origin_m) / spacing_m + 0.5, most)
}

/// Calls `visit` with every cell (x fastest, then y, then z) whose centre lies in a tet, and the share of each corner there. A centre on a face that
/// two tets share is in both, so that no wall has holes. A tet with a corner that is not finite, or with a volume of 0 or beyond single precision,
/// has none.
pub fn for_each_cell_in(grid: &Grid, corners_m: [Vec3; 4], mut visit: impl FnMut(usize, Vec4)) {
    if !corners_m.iter().all(|corner| corner.is_finite()) {
        return;
    }
    let low = corners_m.iter().copied().fold(Vec3::INFINITY, Vec3::min);
    let high = corners_m.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
    let [columns, rows, layers] = [0, 1, 2].map(|axis| range(grid, axis, low[axis], high[axis]));
    if columns.is_empty() || rows.is_empty() || layers.is_empty() {
        return;
    }
    let edges = Mat3::from_cols(corners_m[1] - corners_m[0], corners_m[2] - corners_m[0], corners_m[3] - corners_m[0]);
    if !edges.determinant().is_normal() {
        return;
    }
    let inverse = edges.inverse();
    let shares = |beta: Vec3, rest: f32| Vec4::new(rest - beta.element_sum(), beta.x, beta.y, beta.z);
    let spacing_m = grid.spacing_m();
    let row = Row::new(shares(inverse.x_axis * spacing_m[0], 0.0));
    let (across, onward) = (shares(inverse.y_axis * spacing_m[1], 0.0), shares(inverse.z_axis * spacing_m[2], 0.0));
    let corner_m = Vec3::from(grid.centre_m([columns.start, rows.start, layers.start]));
    let of_all = shares(inverse * (corner_m - corners_m[0]), 1.0);
    let ([nx, ny, _], count) = (grid.cells(), columns.len() as f32);
    for (layer, k) in layers.enumerate() {
        let of_layer = of_all + layer as f32 * onward;
        for (line, j) in rows.clone().enumerate() {
            let first = of_layer + line as f32 * across;
            let start = (k * ny + j) * nx + columns.start;
            for at in row.inside(first, count) {
                visit(start + at, first + at as f32 * row.step);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers from -0.5 to 0.5, the same ones each time.
    fn draws() -> impl FnMut() -> f32 {
        let mut state = 20_061_u32;
        move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 - 0.5
        }
    }

    #[test]
    fn the_cells_of_a_tet_are_those_whose_centres_lie_in_it() {
        let grid = Grid::new([9, 7, 8], [0.07, 0.11, 0.09], [-0.3, -0.4, -0.35]).unwrap();
        let mut draw = draws();
        let centre_m = |cell: usize| Vec3::from(grid.centre_m([cell % 9, cell / 9 % 7, cell / 63]));
        let mut visited = 0;
        for tet in 0..2_000 {
            let corners: [Vec3; 4] = std::array::from_fn(|_| Vec3::new(draw(), draw(), draw()));
            let edges = Mat3::from_cols(corners[1] - corners[0], corners[2] - corners[0], corners[3] - corners[0]);
            if edges.determinant().abs() < 1e-4 {
                continue;
            }
            let mut found = vec![false; grid.cell_count()];
            for_each_cell_in(&grid, corners, |cell, shares| {
                let centre: Vec3 = corners.iter().zip(shares.to_array()).map(|(corner, share)| share * *corner).sum();
                assert!(centre.distance(centre_m(cell)) < 1e-4, "tet {tet}, cell {cell}: {shares:?}");
                assert!(!std::mem::replace(&mut found[cell], true), "tet {tet}: cell {cell} twice");
                visited += 1;
            });
            for (cell, found) in found.into_iter().enumerate() {
                let beta = edges.inverse() * (centre_m(cell) - corners[0]);
                let least = beta.min_element().min(1.0 - beta.element_sum());
                assert!(least.abs() < 1e-3 || found == (least > 0.0), "tet {tet}, cell {cell}: {least}");
            }
        }
        assert!(visited > 10_000, "{visited}");
    }

    /// Faces along the axes, on which shares do not change, and tets that reach beyond the grid on all sides or lie beside it.
    #[test]
    fn a_tet_along_the_axes_one_around_the_grid_and_one_beside_it() {
        let grid = Grid::new([4; 3], [1.0; 3], [0.0; 3]).unwrap();
        let cells = |at: f32, edge: f32| {
            let corner = Vec3::splat(at);
            let mut found = Vec::new();
            for_each_cell_in(
                &grid,
                [corner, corner + edge * Vec3::X, corner + edge * Vec3::Y, corner + edge * Vec3::Z],
                |cell, _| {
                    found.push(cell);
                },
            );
            found
        };
        // The centres at 0.5, 1.5 and 2.5 of which the three together are 4 at the most.
        assert_eq!(cells(0.0, 4.0), [0, 1, 2, 4, 5, 8, 16, 17, 20, 32]);
        assert_eq!(cells(0.5, 1.0), [0, 1, 4, 16], "corners on centres are within");
        assert_eq!(cells(-100.0, 1_000.0).len(), 64);
        assert!(cells(4.0, 10.0).is_empty() && cells(-20.0, 10.0).is_empty() && cells(0.0, 0.0).is_empty());
        assert!(cells(-1e13, 2e13).is_empty() && cells(-1e20, 2e20).is_empty(), "more than single precision can hold");
        assert!(cells(f32::NAN, 1.0).is_empty() && cells(f32::INFINITY, 1.0).is_empty() && cells(0.0, f32::INFINITY).is_empty());
    }

    /// Cubes of six tets each about a diagonal: with all nodes on centres of cells, so that the other centres lie on faces and edges, and with those
    /// nodes moved about that are within.
    #[test]
    fn a_mesh_of_tets_leaves_no_cell_inside_it_out() {
        const CUBES: usize = 4;
        const NODES: usize = CUBES + 1;
        const CELLS: usize = 2 * CUBES + 3;
        const WAYS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
        let grid = Grid::new([CELLS; 3], [1.0625e-3, 0.889e-3, 1.75e-3], [-0.017, -0.008, -0.002]).unwrap();
        let place = |index: usize, count: usize| [index % count, index / count % count, index / (count * count)];
        for jitter in [0.0f32, 0.5] {
            let mut draw = draws();
            let node_m = |node: usize| {
                let at = place(node, NODES);
                let centre_m = Vec3::from(grid.centre_m(at.map(|index| 2 * index + 1)));
                // Within the faces of the block, which stays as it is; by a quarter of a cube at most.
                let share = at.map(|index| if index % CUBES == 0 { 0.0 } else { jitter * draw() });
                centre_m + 2.0 * Vec3::from(share) * Vec3::from(grid.spacing_m())
            };
            let nodes_m: Vec<Vec3> = (0..NODES.pow(3)).map(node_m).collect();
            let at_m = |[x, y, z]: [usize; 3]| nodes_m[(z * NODES + y) * NODES + x];
            let mut visited = vec![false; grid.cell_count()];
            for (cube, way) in (0..CUBES.pow(3)).flat_map(|cube| WAYS.map(|way| (cube, way))) {
                let mut at = place(cube, CUBES);
                let mut corners_m = [at_m(at); 4];
                for (corner_m, axis) in corners_m[1..].iter_mut().zip(way) {
                    at[axis] += 1;
                    *corner_m = at_m(at);
                }
                for_each_cell_in(&grid, corners_m, |cell, _| visited[cell] = true);
            }
            let is_inside = |cell: usize| place(cell, CELLS).iter().all(|index| (2..CELLS - 2).contains(index));
            let left_out: Vec<usize> = (0..visited.len()).filter(|cell| is_inside(*cell) && !visited[*cell]).collect();
            assert!(left_out.is_empty(), "jitter {jitter}: cells {left_out:?}");
        }
    }

    #[test]
    fn numbers_of_cells_are_rounded_as_the_library_does() {
        for tenth in -30..80 {
            let cells = tenth as f32 * 0.1;
            assert_eq!(up(cells, 5.0), cells.ceil().clamp(0.0, 5.0) as usize, "{cells}");
            assert_eq!(down(cells, 5.0), cells.floor().clamp(0.0, 5.0) as usize, "{cells}");
        }
        assert_eq!(
            [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].map(|cells| (up(cells, 5.0), down(cells, 5.0))),
            [(0, 0), (5, 5), (0, 0)]
        );
    }
}
