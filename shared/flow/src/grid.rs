//! The staggered grid (Harlow and Welch 1965) and how its layers are laid out in memory.
//!
//! Cell (i, j, k) has its centre at origin + (i+½, j+½, k+½)·spacing. Velocity u lives on the cell's left face (low x), v on its
//! low-y face, w on its low-z face. Memory holds one ghost cell on each side of each axis, so that inner loops have no branches.

use crate::error::FlowError;

/// Cells of one grid at most: the largest that a station computes is 128³ (2.1 million).
pub const MAX_CELLS: usize = 1 << 22;
/// Cells along one axis at most: rows are staged in arrays of this length.
pub const MAX_AXIS: usize = 512;
/// Bands (groups of layers, one per Synchronized Thread) at most.
pub const MAX_BANDS: usize = 8;

/// A regular grid of cells in the station's frame (metres).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    cells: [usize; 3],
    spacing_m: [f32; 3],
    origin_m: [f32; 3],
}

impl Grid {
    /// A grid of `cells` (x, y, z; z counts the layers) of size `spacing_m`, whose low corner is at `origin_m`.
    ///
    /// # Errors
    /// [`FlowError::GridSize`] or [`FlowError::GridGeometry`].
    pub fn new(cells: [usize; 3], spacing_m: [f32; 3], origin_m: [f32; 3]) -> Result<Self, FlowError> {
        let [x, y, z] = cells;
        let total = x.checked_mul(y).and_then(|xy| xy.checked_mul(z));
        let axis_ok = cells.iter().all(|&n| (1..=MAX_AXIS).contains(&n));
        if !axis_ok || total.is_none_or(|n| n > MAX_CELLS) {
            return Err(FlowError::GridSize(x, y, z));
        }
        for axis in 0..3 {
            let (spacing_m, origin_m) = (spacing_m[axis], origin_m[axis]);
            if !(1e-6..=1.0).contains(&spacing_m) || !(-1e3..=1e3).contains(&origin_m) {
                return Err(FlowError::GridGeometry { axis, spacing_m, origin_m });
            }
        }
        Ok(Self { cells, spacing_m, origin_m })
    }

    /// Cells along x, y, z.
    pub fn cells(&self) -> [usize; 3] {
        self.cells
    }
    /// Size of a cell along x, y, z, m.
    pub fn spacing_m(&self) -> [f32; 3] {
        self.spacing_m
    }
    /// The low corner, m.
    pub fn origin_m(&self) -> [f32; 3] {
        self.origin_m
    }
    /// Number of cells.
    pub fn cell_count(&self) -> usize {
        self.cells[0] * self.cells[1] * self.cells[2]
    }
    /// Volume of a cell, m³.
    pub fn cell_volume_m3(&self) -> f64 {
        self.spacing_m.iter().map(|&h| f64::from(h)).product()
    }
    /// Position in units of cells (cell (0,0,0) spans 0..1).
    pub(crate) fn to_cells(self, position_m: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|a| (position_m[a] - self.origin_m[a]) / self.spacing_m[a])
    }
    /// Centre of cell (i, j, k), m.
    pub fn centre_m(&self, ijk: [usize; 3]) -> [f32; 3] {
        std::array::from_fn(|a| self.origin_m[a] + (ijk[a] as f32 + 0.5) * self.spacing_m[a])
    }
}

/// How a field of `n` cells with one ghost cell around lies in memory, split into bands of whole layers.
/// Padded layer kk = k + 1 runs over 0..=n_z+1; the ghost layers belong to the first and the last band.
#[derive(Debug, Clone)]
pub(crate) struct Layout {
    pub n: [usize; 3],
    pub stride: usize,
    pub plane: usize,
    pub bands: usize,
    start: [usize; MAX_BANDS + 1],
    band_of: Vec<u8>,
}

impl Layout {
    pub fn new(n: [usize; 3], bands: usize) -> Self {
        let stride = n[0] + 2;
        let mut start = [0; MAX_BANDS + 1];
        for (b, s) in start.iter_mut().enumerate() {
            *s = 1 + b.min(bands) * n[2] / bands;
        }
        start[0] = 0;
        start[bands] = n[2] + 2;
        let band_of = (0..n[2] + 2).map(|kk| (0..bands).rfind(|&b| start[b] <= kk).unwrap_or(0) as u8).collect();
        Self { n, stride, plane: stride * (n[1] + 2), bands, start, band_of }
    }
    /// Padded layers whose inside belongs to `band`.
    pub fn own(&self, band: usize) -> std::ops::Range<usize> {
        let low = self.start[band].max(1);
        low..self.start[band + 1].min(self.n[2] + 1).max(low)
    }
    /// All padded layers stored with `band`.
    pub fn stored(&self, band: usize) -> std::ops::Range<usize> {
        self.start[band]..self.start[band + 1]
    }
    pub fn band_of(&self, kk: usize) -> usize {
        usize::from(self.band_of[kk])
    }
    /// The inside of a plane in pieces, each as offset and length of at most [`MAX_AXIS`], with the two ghosts between one row and the next: for loops to
    /// whose result ghosts add nothing, as their diagonal and their mask are 0. A row alone is so short that the loop costs less than its begin.
    #[inline(always)]
    pub fn runs(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let end = self.row(self.n[1] - 1) + self.n[0];
        (self.row(0)..end).step_by(MAX_AXIS).map(move |o| (o, MAX_AXIS.min(end - o)))
    }
    /// In which run a cell of a plane is.
    #[inline(always)]
    pub fn run_of(&self, at: usize) -> usize {
        (at - self.row(0)) / MAX_AXIS
    }
    /// Offset of cell (0, j) in a plane.
    #[inline(always)]
    pub fn row(&self, j: usize) -> usize {
        (j + 1) * self.stride + 1
    }
    pub fn cell_count(&self) -> usize {
        self.n[0] * self.n[1] * self.n[2]
    }
}
