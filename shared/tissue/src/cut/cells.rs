//! Space in cells, each with the boxes that reach into it: which of many boxes have a point in them.

use super::places::SingleBounds;
use glam::DVec3;

/// Most cells along each axis.
const MOST_CELLS: usize = 16;

/// The tets of each cell of space that is asked about, in their order.
pub struct Cells {
    low_m: DVec3,
    per_m: f64,
    counts: [usize; 3],
    /// Which are asked about: for each row of cells a bit for each of these.
    asked: Vec<u32>,
    starts: Vec<u32>,
    tets: Vec<u32>,
}

/// The first and the last cell along each axis that a box reaches into.
type Reach = [[usize; 2]; 3];

impl Cells {
    /// Of tets by the boxes around them; a cell is as large as they are in the mean.
    pub fn new(bounds: &[SingleBounds]) -> Cells {
        let mut cells = Cells::without_tets(bounds);
        cells.asked.fill(u32::MAX);
        cells.with_tets(bounds)
    }

    /// The same for who asks about these places alone: of a box around a change most cells are none that a surface goes through.
    pub fn for_places(bounds: &[SingleBounds], places_m: impl Iterator<Item = DVec3>) -> Cells {
        let mut cells = Cells::without_tets(bounds);
        for place_m in places_m {
            let [i, j, k] = cells.cell(place_m);
            let row = cells.row(j, k);
            cells.asked[row] |= 1 << i;
        }
        cells.with_tets(bounds)
    }

    fn without_tets(bounds: &[SingleBounds]) -> Cells {
        let (starts, tets) = (Vec::new(), Vec::new());
        let Some(all) = bounds.iter().copied().reduce(SingleBounds::with) else {
            return Cells { low_m: DVec3::ZERO, per_m: 0.0, counts: [1; 3], asked: vec![0], starts, tets };
        };
        let mean_m = bounds.iter().map(SingleBounds::extent_m).sum::<f64>() / bounds.len() as f64;
        let per_m = 1.0 / mean_m.max(all.extent_m() / MOST_CELLS as f64).max(f64::MIN_POSITIVE);
        let (low_m, high_m) = all.ends_m();
        let counts = ((high_m - low_m) * per_m).to_array().map(|cells| (cells as usize + 1).min(MOST_CELLS));
        Cells { low_m, per_m, counts, asked: vec![0; counts[1] * counts[2]], starts, tets }
    }

    /// Each cell with the tets that reach into it: found tet by tet, sorted by counting.
    fn with_tets(mut self, bounds: &[SingleBounds]) -> Cells {
        let mut found: Vec<[u32; 2]> = Vec::with_capacity(2 * bounds.len());
        for (index, around) in (0..).zip(bounds) {
            self.for_asked(self.reach(around), |cell| found.push([cell as u32, index]));
        }
        let mut starts = vec![0u32; self.counts.iter().product::<usize>() + 1];
        found.iter().for_each(|[cell, _]| starts[*cell as usize + 1] += 1);
        (1..starts.len()).for_each(|cell| starts[cell] += starts[cell - 1]);
        let (mut ends, mut tets) = (starts.clone(), vec![0; found.len()]);
        for [cell, index] in found {
            let end = &mut ends[cell as usize];
            tets[*end as usize] = index;
            *end += 1;
        }
        (self.starts, self.tets) = (starts, tets);
        self
    }

    /// The cell of a place along each axis.
    fn cell(&self, place_m: DVec3) -> [usize; 3] {
        let cell = ((place_m - self.low_m) * self.per_m).to_array();
        std::array::from_fn(|axis| ((cell[axis] as i32).max(0) as usize).min(self.counts[axis] - 1))
    }

    /// The number of a row of cells.
    fn row(&self, j: usize, k: usize) -> usize {
        k * self.counts[1] + j
    }

    fn reach(&self, around: &SingleBounds) -> Reach {
        let (low_m, high_m) = around.ends_m();
        let (low, high) = (self.cell(low_m), self.cell(high_m));
        std::array::from_fn(|axis| [low[axis], high[axis]])
    }

    /// Calls for the cells that a box reaches into, of those that are asked about.
    fn for_asked(&self, [[i, to_i], [j, to_j], [k, to_k]]: Reach, mut each: impl FnMut(usize)) {
        let span: u32 = (2 << to_i) - (1 << i);
        for k in k..to_k + 1 {
            for j in j..to_j + 1 {
                let row = self.row(j, k);
                let mut cells = self.asked[row] & span;
                while cells != 0 {
                    each(row * self.counts[0] + cells.trailing_zeros() as usize);
                    cells &= cells - 1;
                }
            }
        }
    }

    /// The tets whose boxes may have a place in them that is asked about; all that have are among them.
    pub fn at(&self, place_m: DVec3) -> &[u32] {
        let [i, j, k] = self.cell(place_m);
        let row = self.row(j, k);
        debug_assert!(self.asked[row] >> i & 1 == 1, "{place_m}: nobody said that this place is asked about");
        let cell = row * self.counts[0] + i;
        &self.tets[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cut::places::Spot;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 500, rng_seed: RngSeed::Fixed(6), failure_persistence: None, ..ProptestConfig::default() })]

        /// Boxes on a lattice, some of them flat, and places outside of all of them, too.
        #[test]
        fn a_place_that_is_asked_about_has_all_tets_that_reach_into_its_cell_in_their_order(
            ends in prop::collection::vec(prop::array::uniform2(prop::array::uniform3(0..20_u8)), 0..40),
            places in prop::collection::vec(prop::array::uniform3(-2.0..22.0_f64), 0..10),
        ) {
            let around = |ends: &[[u8; 3]; 2]| SingleBounds::around(ends.map(|end| end.map(f32::from)));
            let bounds: Vec<SingleBounds> = ends.iter().map(around).collect();
            let places: Vec<DVec3> = places.into_iter().map(DVec3::from_array).collect();
            let (cells, whole) = (Cells::for_places(&bounds, places.iter().copied()), Cells::new(&bounds));
            for place in places {
                let cell = cells.cell(place);
                let reaches = |index: &u32| {
                    let reach = cells.reach(&bounds[*index as usize]);
                    cell.iter().zip(reach).all(|(cell, [first, last])| (first..=last).contains(cell))
                };
                let expected: Vec<u32> = (0..bounds.len() as u32).filter(reaches).collect();
                prop_assert_eq!(cells.at(place), &expected[..]);
                prop_assert_eq!(whole.at(place), &expected[..]);
                let mut around = (0..).zip(&bounds).filter(|(_, bounds)| bounds.has(&Spot::of(place)));
                prop_assert!(around.all(|(index, _): (u32, _)| expected.contains(&index)));
            }
        }
    }
}
