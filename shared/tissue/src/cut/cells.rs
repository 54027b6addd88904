//! Space in cells, each with the boxes that reach into it: which of many boxes have a point in them.

use super::places::SingleBounds;
use glam::DVec3;
use std::ops::Range;

/// Most cells along each axis.
const MOST_CELLS: usize = 16;

/// The tets of each cell of space, in their order.
pub struct Cells {
    low_m: DVec3,
    per_m: f64,
    counts: [usize; 3],
    starts: Vec<u32>,
    tets: Vec<u32>,
}

/// The first and the last cell along each axis that a box reaches into.
type Reach = [[u8; 2]; 3];

impl Cells {
    /// Of tets by the boxes around them; a cell is as large as they are in the mean.
    pub fn new(bounds: &[SingleBounds]) -> Cells {
        let Some(all) = bounds.iter().copied().reduce(SingleBounds::with) else {
            return Cells { low_m: DVec3::ZERO, per_m: 0.0, counts: [1; 3], starts: vec![0; 2], tets: Vec::new() };
        };
        let mean_m = bounds.iter().map(SingleBounds::extent_m).sum::<f64>() / bounds.len() as f64;
        let per_m = 1.0 / mean_m.max(all.extent_m() / MOST_CELLS as f64).max(f64::MIN_POSITIVE);
        let (low_m, high_m) = all.ends_m();
        let counts = ((high_m - low_m) * per_m).to_array().map(|cells| (cells as usize + 1).min(MOST_CELLS));
        let mut cells = Cells { low_m, per_m, counts, starts: Vec::new(), tets: Vec::new() };
        let reaches: Vec<Reach> = bounds.iter().map(|around| cells.reach(around)).collect();
        let mut starts = vec![0u32; counts.iter().product::<usize>() + 1];
        let rows = reaches.iter().flat_map(|reach| cells.rows(*reach));
        rows.for_each(|row| starts[row.start + 1..=row.end].iter_mut().for_each(|count| *count += 1));
        (1..starts.len()).for_each(|cell| starts[cell] += starts[cell - 1]);
        let mut ends = starts.clone();
        let mut tets = vec![0; starts.last().map_or(0, |all| *all as usize)];
        for (index, reach) in (0..).zip(reaches) {
            cells.rows(reach).for_each(|row| {
                for end in &mut ends[row] {
                    tets[*end as usize] = index;
                    *end += 1;
                }
            });
        }
        (cells.starts, cells.tets) = (starts, tets);
        cells
    }

    /// The cell of a place along each axis.
    fn cell(&self, place_m: DVec3) -> [usize; 3] {
        let cell = ((place_m - self.low_m) * self.per_m).to_array();
        std::array::from_fn(|axis| ((cell[axis] as i32).max(0) as usize).min(self.counts[axis] - 1))
    }

    fn reach(&self, around: &SingleBounds) -> Reach {
        let (low_m, high_m) = around.ends_m();
        let (low, high) = (self.cell(low_m), self.cell(high_m));
        std::array::from_fn(|axis| [low[axis] as u8, high[axis] as u8])
    }

    /// The cells that a box reaches into, row by row.
    fn rows(&self, reach: Reach) -> impl Iterator<Item = Range<usize>> + use<> {
        let ([[i, to_i], [j, to_j], [k, to_k]], [across, deep, _]) = (reach.map(|ends| ends.map(usize::from)), self.counts);
        let row = move |j: usize, k: usize| {
            let first = (k * deep + j) * across;
            first + i..first + to_i + 1
        };
        (k..to_k + 1).flat_map(move |k| (j..to_j + 1).map(move |j| row(j, k)))
    }

    /// The tets whose boxes may have a point in them; all that have are among them.
    pub fn at(&self, point: DVec3) -> &[u32] {
        let ([i, j, k], [across, deep, _]) = (self.cell(point), self.counts);
        let cell = (k * deep + j) * across + i;
        &self.tets[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }
}
