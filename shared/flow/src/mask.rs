//! Solid cells: the case's mask and the moving tools as capsules, and which parts of the fluid hang together.

use crate::error::FlowError;
use crate::grid::{Grid, Layout, MAX_AXIS};
use crate::inputs::Capsule;
use crate::plan::MAX_COMPONENTS;
use crate::solver::Solver;

/// A capsule in the grid: its box in cells, and the test of a point.
struct Tool<'a> {
    capsule: &'a Capsule,
    low: [usize; 3],
    high: [usize; 3],
}

impl<'a> Tool<'a> {
    fn new(grid: &Grid, capsule: &'a Capsule) -> Option<Self> {
        if capsule.radius_m <= 0.0 {
            return None;
        }
        let (a, b) = (grid.to_cells(capsule.a_m), grid.to_cells(capsule.b_m));
        let mut low = [0; 3];
        let mut high = [0; 3];
        for axis in 0..3 {
            let reach = capsule.radius_m / grid.spacing_m()[axis] + 1.0;
            low[axis] = (a[axis].min(b[axis]) - reach).max(0.0) as usize;
            high[axis] = ((a[axis].max(b[axis]) + reach).max(0.0) as usize + 1).min(grid.cells()[axis]);
        }
        (0..3).all(|axis| low[axis] < high[axis]).then_some(Self { capsule, low, high })
    }
    /// Velocity of the capsule at a point inside it, m/s.
    fn velocity_at(&self, p: [f32; 3]) -> Option<[f32; 3]> {
        let c = self.capsule;
        let axis: [f32; 3] = std::array::from_fn(|n| c.b_m[n] - c.a_m[n]);
        let from: [f32; 3] = std::array::from_fn(|n| p[n] - c.a_m[n]);
        let dot = |x: &[f32; 3], y: &[f32; 3]| x[0] * y[0] + x[1] * y[1] + x[2] * y[2];
        let length2 = dot(&axis, &axis);
        let t = if length2 > 0.0 { (dot(&from, &axis) / length2).clamp(0.0, 1.0) } else { 0.0 };
        let off: [f32; 3] = std::array::from_fn(|n| from[n] - t * axis[n]);
        (dot(&off, &off) <= c.radius_m * c.radius_m)
            .then(|| std::array::from_fn(|n| c.velocity_a_m_s[n] + t * (c.velocity_b_m_s[n] - c.velocity_a_m_s[n])))
    }
}

impl Solver {
    /// Phase Mask: fluid (1) and solid (0) cells, the velocity of solid faces, and the largest Courant number per second.
    pub(crate) fn mask_band(&self, band: usize) -> Result<(), FlowError> {
        let plan = self.plan()?;
        let layout = &*self.layout;
        let base = self.base.try_read().ok_or(FlowError::PhaseConflict)?;
        let mut fluid = self.fluid.write(band)?;
        let mut faces = [self.face[0].write(band)?, self.face[1].write(band)?, self.face[2].write(band)?];
        let now = self.read_velocity(plan.roles.now)?;
        let grid = &self.model.grid;
        let [nx, ny, _] = layout.n;
        let mut sums = self.sums(band)?;
        for (sum, kk) in sums.iter_mut().zip(layout.own(band)) {
            *sum = Default::default();
            let plane = fluid.layer(kk);
            for j in 0..ny {
                let mut row = [0.0f32; MAX_AXIS];
                let from = ((kk - 1) * ny + j) * nx;
                for (r, &solid) in row[..nx].iter_mut().zip(&base[from..from + nx]) {
                    *r = if solid == 0 { 1.0 } else { 0.0 };
                }
                for tool in plan.inputs.tools.iter().filter_map(|c| Tool::new(grid, c)) {
                    carve(grid, &tool, j, kk - 1, |i, _| row[i] = 0.0);
                }
                let o = layout.row(j);
                if plane[o..o + nx] != row[..nx] {
                    sum.count += 1;
                    plane[o..o + nx].copy_from_slice(&row[..nx]);
                }
            }
            for (axis, face) in faces.iter_mut().enumerate() {
                face.layer(kk).fill(0.0);
                let h = grid.spacing_m()[axis];
                sum.top = sum.top.max(crate::kernels::max_abs(now[axis].layer(kk)) / h);
            }
            for tool in plan.inputs.tools.iter().filter_map(|c| Tool::new(grid, c)) {
                solid_faces(layout, grid, &tool, kk, &mut faces);
            }
        }
        Ok(())
    }
}

/// Calls `found(i, velocity)` for each cell of row (j, k) inside the tool.
fn carve(grid: &Grid, tool: &Tool<'_>, j: usize, k: usize, mut found: impl FnMut(usize, [f32; 3])) {
    if !(tool.low[1]..tool.high[1]).contains(&j) || !(tool.low[2]..tool.high[2]).contains(&k) {
        return;
    }
    for i in tool.low[0]..tool.high[0] {
        if let Some(v) = tool.velocity_at(grid.centre_m([i, j, k])) {
            found(i, v);
        }
    }
}

/// Gives the faces of padded layer `kk` that touch the tool its velocity; faces on the walls stay at rest.
fn solid_faces(layout: &Layout, grid: &Grid, tool: &Tool<'_>, kk: usize, faces: &mut [crate::field::Write<'_>; 3]) {
    let [nx, ny, _] = layout.n;
    for j in 0..ny {
        let o = layout.row(j);
        if kk >= 2 {
            let below = faces[2].layer(kk);
            carve(grid, tool, j, kk - 2, |i, v| below[o + i] = v[2]);
        }
        carve(grid, tool, j, kk - 1, |i, v| {
            for at in [i, i + 1].into_iter().filter(|at| (1..nx).contains(at)) {
                faces[0].layer(kk)[o + at] = v[0];
            }
            for at in [j, j + 1].into_iter().filter(|at| (1..ny).contains(at)) {
                faces[1].layer(kk)[layout.row(at) + i] = v[1];
            }
            if kk >= 2 {
                faces[2].layer(kk)[o + i] = v[2];
            }
        });
    }
}

/// A run of fluid cells in a row.
#[derive(Clone, Copy, Default)]
struct Run {
    start: u32,
    end: u32,
    parent: u32,
    cells: u32,
}

/// Finds the connected parts of the fluid by runs and union-find. Buffers are made once.
pub(crate) struct Components {
    runs: Vec<Run>,
    row_start: Vec<u32>,
}

impl Components {
    pub fn new(layout: &Layout) -> Self {
        let rows = layout.n[1] * layout.n[2];
        Self { runs: vec![Run::default(); rows * layout.n[0].div_ceil(2)], row_start: vec![0; rows + 1] }
    }

    fn root(&mut self, mut r: usize) -> usize {
        while self.runs[r].parent as usize != r {
            let up = self.runs[self.runs[r].parent as usize].parent;
            self.runs[r].parent = up;
            r = up as usize;
        }
        r
    }

    /// Reads the fluid planes through `fluid(kk)`; writes the labels. Returns (number of parts, cells of each,
    /// true if parts beyond the largest eight were found: those cells are labelled 255 and the caller makes them solid).
    pub fn label<'a>(
        &mut self,
        layout: &Layout,
        fluid: impl Fn(usize) -> &'a [f32],
        labels: &mut [u8],
    ) -> (usize, [u32; MAX_COMPONENTS], bool) {
        let [nx, ny, nz] = layout.n;
        let mut count = 0;
        for row in 0..ny * nz {
            self.row_start[row] = count as u32;
            let o = layout.row(row % ny);
            count = self.scan(&fluid(row / ny + 1)[o..o + nx], count);
            self.row_start[row + 1] = count as u32;
            if row % ny > 0 {
                self.join(row - 1, row);
            }
            if row >= ny {
                self.join(row - ny, row);
            }
        }
        self.number(count, ny * nz, nx, labels)
    }

    fn scan(&mut self, row: &[f32], mut count: usize) -> usize {
        let mut i = 0;
        while i < row.len() {
            if row[i] > 0.0 {
                let start = i;
                while i < row.len() && row[i] > 0.0 {
                    i += 1;
                }
                self.runs[count] = Run { start: start as u32, end: i as u32, parent: count as u32, cells: (i - start) as u32 };
                count += 1;
            } else {
                i += 1;
            }
        }
        count
    }

    fn join(&mut self, a: usize, b: usize) {
        let (mut p, mut q) = (self.row_start[a] as usize, self.row_start[b] as usize);
        let (p_end, q_end) = (self.row_start[a + 1] as usize, self.row_start[b + 1] as usize);
        while p < p_end && q < q_end {
            let (x, y) = (self.runs[p], self.runs[q]);
            if x.start < y.end && y.start < x.end {
                let (r, s) = (self.root(p), self.root(q));
                if r != s {
                    let (keep, drop) = (r.min(s), r.max(s));
                    self.runs[drop].parent = keep as u32;
                    self.runs[keep].cells += self.runs[drop].cells;
                }
            }
            if x.end <= y.end { p += 1 } else { q += 1 }
        }
    }

    fn number(&mut self, count: usize, rows: usize, nx: usize, labels: &mut [u8]) -> (usize, [u32; MAX_COMPONENTS], bool) {
        // The largest parts, largest first, the earlier one first among equals.
        let mut best = [(0u32, 0usize); MAX_COMPONENTS];
        let mut parts = 0;
        for r in 0..count {
            if self.runs[r].parent as usize != r {
                continue;
            }
            parts += 1;
            let mut candidate = (self.runs[r].cells, r);
            for slot in &mut best {
                if candidate.0 > slot.0 {
                    std::mem::swap(slot, &mut candidate);
                }
            }
        }
        let kept = parts.min(MAX_COMPONENTS);
        if parts > 1 {
            labels.fill(0);
            for row in 0..rows {
                for r in self.row_start[row] as usize..self.row_start[row + 1] as usize {
                    let root = self.root(r);
                    let label = best[..kept].iter().position(|b| b.1 == root).map_or(255, |l| l as u8);
                    let run = self.runs[r];
                    labels[row * nx + run.start as usize..row * nx + run.end as usize].fill(label);
                }
            }
        }
        (kept, best.map(|b| b.0), parts > kept)
    }
}
