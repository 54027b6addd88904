//! Which parts of the fluid hang together: each part has a pressure level of its own.

use crate::grid::Layout;
use crate::plan::MAX_COMPONENTS;
use crate::spans::Span;

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

    /// The cells of row `row` (y first, then z) from its first fluid one to its last.
    pub fn span(&self, row: usize) -> Span {
        let runs = &self.runs[self.row_start[row] as usize..self.row_start[row + 1] as usize];
        match (runs.first(), runs.last()) {
            (Some(first), Some(last)) => Span::new(first.start as usize, last.end as usize),
            _ => Span::NONE,
        }
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
