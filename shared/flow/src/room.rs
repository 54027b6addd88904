//! Where what floats may be, blood and gas alike: in fluid cells of the grid, moved from one to the next through a face that they share.

use crate::field::Read;
use crate::grid::Layout;

/// Share of a cell that something moves in one sweep at most, so that nothing leaps over a wall.
pub(crate) const LEAP_CELLS: f32 = 0.9;
/// How far from a solid that is in its way something stays at least, in cells: single precision tells so much apart in a grid of 512.
const GAP_CELLS: f32 = 1e-3;

/// The cells that something may be in.
pub(crate) struct Room<'a> {
    pub layout: &'a Layout,
    pub fluid: Read<'a>,
    /// Edge of a cell, m.
    pub spacing_m: [f32; 3],
    /// Of what floats.
    pub radius_m: f32,
}

impl Room<'_> {
    /// The cell of a place in cells, in the grid or the nearest one in it.
    fn cell(&self, place: [f32; 3]) -> [usize; 3] {
        std::array::from_fn(|a| (place[a].max(0.0) as usize).min(self.layout.n[a] - 1))
    }

    fn is_fluid(&self, cell: [usize; 3]) -> bool {
        self.fluid.layer(cell[2] + 1)[self.layout.row(cell[1]) + cell[0]] > 0.0
    }

    /// Its index, x fastest.
    pub fn index(&self, cell: [usize; 3]) -> usize {
        (cell[2] * self.layout.n[1] + cell[1]) * self.layout.n[0] + cell[0]
    }

    /// The cell of a place in cells, if it is in the grid and no solid.
    pub fn open(&self, place: [f32; 3]) -> Option<[usize; 3]> {
        let is_inside = (0..3).all(|a| place[a] >= 0.0 && place[a] < self.layout.n[a] as f32);
        Some(self.cell(place)).filter(|cell| is_inside && self.is_fluid(*cell))
    }

    /// The open cell beside a cell.
    pub fn beside(&self, cell: [usize; 3], axis: usize, to_high: bool) -> Option<[usize; 3]> {
        let mut place = cell.map(|index| index as f32 + 0.5);
        place[axis] += if to_high { 1.0 } else { -1.0 };
        self.open(place)
    }

    /// Out of a cell that a wall or a tool has taken, into the nearest one of those around it; without one it waits.
    pub fn freed(&self, place: [f32; 3]) -> [f32; 3] {
        if self.open(place).is_some() {
            return place;
        }
        let cell = self.cell(place);
        let around = (0..27).filter_map(|way: usize| {
            let next: [usize; 3] = std::array::from_fn(|a| (cell[a] + way / 3usize.pow(a as u32) % 3).wrapping_sub(1));
            let is_inside = (0..3).all(|a| next[a] < self.layout.n[a]);
            (is_inside && self.is_fluid(next)).then(|| {
                let low = next.map(|index| index as f32);
                std::array::from_fn(|a| place[a].clamp(low[a] + GAP_CELLS, low[a] + 1.0 - GAP_CELLS))
            })
        });
        let distance2 = |to: &[f32; 3]| (0..3).map(|a| (to[a] - place[a]) * (to[a] - place[a])).sum::<f32>();
        around.min_by(|a, b| distance2(a).total_cmp(&distance2(b))).unwrap_or(place)
    }

    /// Moves what is in an open cell, along one axis after the other, so that it goes through no edge between two solids; up to a radius before a solid.
    pub fn moved(&self, place: [f32; 3], by_cells: [f32; 3]) -> [f32; 3] {
        let mut place = place;
        for axis in 0..3 {
            let by = by_cells[axis].clamp(-LEAP_CELLS, LEAP_CELLS);
            let mut next = place;
            next[axis] += by;
            if self.open(next).is_some() {
                place = next;
                continue;
            }
            let gap = (self.radius_m / self.spacing_m[axis]).clamp(GAP_CELLS, 0.5);
            let face = place[axis].floor();
            place[axis] = if by > 0.0 { place[axis].max(face + 1.0 - gap) } else { place[axis].min(face + gap) };
        }
        place
    }
}
