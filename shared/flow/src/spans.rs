//! Which cells have to be computed: of each row those from its first fluid cell to its last, joined to parts of a plane where that is cheaper than a begin.
//!
//! A cavity fills a quarter of its box, and what solids hold is known. Promise: outside of the parts all cells are solid; the cells of a part get the bits that
//! they get in any other part; in a grid without solids the parts are the runs of [`Layout::runs`]. Made anew when solid cells come or go, from the runs that the
//! search for connected parts has found.

use std::ops::Range;
use std::sync::Arc;

use crate::components::Components;
use crate::error::FlowError;
use crate::grid::{Layout, MAX_AXIS};
use crate::kernels::LANES;
use crate::multigrid::children;
use crate::rows::are_fluid;
use crate::solver::Solver;

#[cfg(test)]
mod tests;

/// So many cells between two rows' own are computed with them: three packs cost about what the begin of a loop costs.
const JOIN: usize = 24;
/// A part has so many cells at least, if its plane has: a pack's (see [`crate::sample`]).
const LEAST: usize = 8;

/// The cells of a row from `first` on, up to `end`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Span {
    first: u16,
    end: u16,
}

impl Span {
    /// No cell.
    pub const NONE: Self = Self { first: u16::MAX, end: 0 };

    pub fn new(first: usize, end: usize) -> Self {
        if first < end { Self { first: first as u16, end: end as u16 } } else { Self::NONE }
    }
    fn joined(self, other: Self) -> Self {
        Self { first: self.first.min(other.first), end: self.end.max(other.end) }
    }
    /// With one cell more on each side, in a row of `n`.
    fn widened(self, n: usize) -> Self {
        let range = self.range();
        if range.is_empty() { self } else { Self::new(range.start.saturating_sub(1), (range.end + 1).min(n)) }
    }
    /// The coarse cells that hold these, two to one.
    fn halved(self) -> Self {
        let range = self.range();
        Self::new(range.start / 2, range.end.div_ceil(2))
    }
    fn range(self) -> Range<usize> {
        if self.end == 0 { 0..0 } else { self.first.into()..self.end.into() }
    }
}

/// Parts of planes by layer, each as offset and length.
pub(crate) struct Parts {
    all: Vec<(u32, u32)>,
    /// Where those of the layer after padded layer `kk` begin.
    start: Vec<usize>,
}

impl Parts {
    fn new(layout: &Layout) -> Self {
        // A row begins one part or two, and a long part is cut.
        let most = 2 * layout.n[1] + layout.plane / MAX_AXIS + 2;
        Self { all: Vec::with_capacity(most * layout.n[2]), start: vec![0; layout.n[2] + 1] }
    }
    fn push(&mut self, from: usize, to: usize) {
        if from < to {
            self.all.push((from as u32, (to - from) as u32));
        }
    }
    fn end_layer(&mut self, kk: usize) {
        self.start[kk] = self.all.len();
    }
    /// Those of padded layer `kk`.
    #[inline(always)]
    pub fn of(&self, kk: usize) -> impl Iterator<Item = (usize, usize)> {
        self.all[self.start[kk - 1]..self.start[kk]].iter().map(|&(at, len)| (at as usize, len as usize))
    }

    /// Adds the cells of a plane's rows, joined and cut.
    fn join(&mut self, layout: &Layout, rows: &[Span]) {
        let (mut from, mut to) = (0, 0);
        for (j, range) in rows.iter().map(|span| span.range()).enumerate().filter(|(_, range)| !range.is_empty()) {
            let o = layout.row(j);
            if to == 0 || o + range.start > to + JOIN {
                self.cut(layout, from, to);
                from = o + range.start;
            }
            to = o + range.end;
        }
        self.cut(layout, from, to);
    }

    fn cut(&mut self, layout: &Layout, from: usize, to: usize) {
        if from == to {
            return;
        }
        let inside = inside(layout);
        let to = to.max(from + LEAST).min(inside.end);
        let from = from.min(to.saturating_sub(LEAST)).max(inside.start);
        for at in (from..to).step_by(MAX_AXIS) {
            self.push(at, to.min(at + MAX_AXIS));
        }
    }

    /// Adds what the parts of padded layer `kk` leave of its plane.
    fn complement(&mut self, layout: &Layout, parts: &Parts, kk: usize) {
        let inside = inside(layout);
        let mut from = inside.start;
        for (o, n) in parts.of(kk) {
            self.push(from, o);
            from = o + n;
        }
        self.push(from, inside.end);
    }

    /// Adds the cells of a plane's rows in whole blocks of [`LANES`] from the begin of their run on, so that each product of a sum stays in its lane.
    fn cover(&mut self, layout: &Layout, rows: &[Span]) {
        for (o, n) in layout.runs() {
            let row_of = |at: usize| (at - layout.row(0)) / layout.stride;
            let mut live = 0u64;
            for (j, span) in rows.iter().enumerate().take(row_of(o + n - 1) + 1).skip(row_of(o)) {
                let range = span.range();
                let (from, to) = ((layout.row(j) + range.start).max(o), (layout.row(j) + range.end).min(o + n));
                if from < to {
                    let (first, last) = ((from - o) / LANES, (to - 1 - o) / LANES);
                    live |= ((2u64 << (last - first)) - 1) << first;
                }
            }
            // A single block that is left out costs more than it saves.
            live |= (live << 1) & (live >> 1);
            let (tail, rest) = (n / LANES, n % LANES);
            // A sum takes the rest behind its last whole block first.
            if rest > 0 && live >> tail & 1 == 1 && stretches(live).count() > 1 {
                self.push(o + LANES * tail, o + n);
                live &= !(1u64 << tail);
            }
            for (first, count) in stretches(live) {
                self.push(o + LANES * first, (o + LANES * (first + count)).min(o + n));
            }
        }
    }
}

/// The inside of a plane, with the ghosts between its rows.
fn inside(layout: &Layout) -> Range<usize> {
    layout.row(0)..layout.row(layout.n[1] - 1) + layout.n[0]
}

/// The stretches of ones in a number below 2³³, lowest first: which bit is the first, and how many they are.
fn stretches(mut bits: u64) -> impl Iterator<Item = (usize, usize)> {
    let mut at = 0;
    std::iter::from_fn(move || {
        if bits == 0 {
            return None;
        }
        let zeros = bits.trailing_zeros();
        bits >>= zeros;
        let ones = bits.trailing_ones();
        bits >>= ones;
        let first = at + zeros as usize;
        at = first + ones as usize;
        Some((first, ones as usize))
    })
}

/// What has to be computed of one level. `near`, `gaps` and `lanes` are those of the grid itself alone.
pub(crate) struct Spans {
    layout: Arc<Layout>,
    rows: Vec<Span>,
    /// The same with the cells beside them, in all directions.
    near_rows: Vec<Span>,
    /// Whether all cells of a row are fluid.
    full: Vec<bool>,
    /// Whether all cells of a padded layer are.
    full_layers: Vec<bool>,
    /// All fluid cells.
    pub open: Parts,
    /// What `open` leaves.
    pub gaps: Parts,
    /// All fluid cells and those beside them.
    pub near: Parts,
    /// All fluid cells, for sums.
    pub lanes: Parts,
}

impl Spans {
    pub fn new(layout: &Arc<Layout>) -> Self {
        let rows = layout.n[1] * layout.n[2];
        Self {
            layout: layout.clone(),
            rows: vec![Span::NONE; rows],
            near_rows: vec![Span::NONE; rows],
            full: vec![false; rows],
            full_layers: vec![false; layout.n[2] + 1],
            open: Parts::new(layout),
            gaps: Parts::new(layout),
            near: Parts::new(layout),
            lanes: Parts::new(layout),
        }
    }

    /// Those of the grid, of which `fluid` gives the padded layers. Without `skips` every cell is computed.
    fn set_fine<'a>(&mut self, components: &Components, fluid: impl Fn(usize) -> &'a [f32], skips: bool) {
        let layout = self.layout.clone();
        let [nx, ny, nz] = layout.n;
        let whole = Span::new(0, nx);
        for row in 0..ny * nz {
            let (span, o) = (components.span(row), layout.row(row % ny));
            // A pocket that has become solid is still a part.
            self.full[row] = span == whole && are_fluid(&fluid(row / ny + 1)[o..o + nx]);
            self.rows[row] = if skips { span } else { whole };
        }
        for kk in 1..=nz {
            self.full_layers[kk] = skips && self.full[(kk - 1) * ny..kk * ny].iter().all(|is_full| *is_full);
        }
        for (k, j) in (0..nz).flat_map(|k| (0..ny).map(move |j| (k, j))) {
            let mut span = Span::NONE;
            for k in k.saturating_sub(1)..(k + 2).min(nz) {
                for beside in &self.rows[k * ny + j.saturating_sub(1)..k * ny + (j + 2).min(ny)] {
                    span = span.joined(*beside);
                }
            }
            self.near_rows[k * ny + j] = span.widened(nx);
        }
        for parts in [&mut self.open, &mut self.gaps, &mut self.near, &mut self.lanes] {
            parts.all.clear();
        }
        for kk in 1..=nz {
            let rows = (kk - 1) * ny..kk * ny;
            self.open.join(&layout, &self.rows[rows.clone()]);
            self.open.end_layer(kk);
            self.gaps.complement(&layout, &self.open, kk);
            self.gaps.end_layer(kk);
            self.near.join(&layout, &self.near_rows[rows.clone()]);
            self.near.end_layer(kk);
            self.lanes.cover(&layout, &self.rows[rows]);
            self.lanes.end_layer(kk);
        }
    }

    /// Those of a level from the next finer one's.
    fn set_coarse(&mut self, fine: &Spans, halved: [bool; 3]) {
        let layout = self.layout.clone();
        let ([_, ny, nz], [_, fine_ny, fine_nz]) = (layout.n, fine.layout.n);
        self.open.all.clear();
        for k in 0..nz {
            for j in 0..ny {
                let mut span = Span::NONE;
                for k in children(k, fine_nz, halved[2]) {
                    for j in children(j, fine_ny, halved[1]) {
                        span = span.joined(fine.rows[k * fine_ny + j]);
                    }
                }
                self.rows[k * ny + j] = if halved[0] { span.halved() } else { span };
            }
            self.open.join(&layout, &self.rows[k * ny..(k + 1) * ny]);
            self.open.end_layer(k + 1);
        }
    }

    fn index(&self, kk: usize, j: usize) -> usize {
        (kk - 1) * self.layout.n[1] + j
    }
    /// The cells of row `j` of padded layer `kk` from its first fluid one to its last.
    #[inline(always)]
    pub fn row(&self, kk: usize, j: usize) -> Range<usize> {
        self.rows[self.index(kk, j)].range()
    }
    /// The cells of a row that have a fluid cell beside them, or are one, and those between.
    #[inline(always)]
    pub fn near_row(&self, kk: usize, j: usize) -> Range<usize> {
        self.near_rows[self.index(kk, j)].range()
    }
    /// Whether the cells on both sides of a component's faces in a row are fluid; beyond the grid's sides none is, but before the first cell along x that does
    /// not count.
    pub fn is_free_row(&self, component: usize, kk: usize, j: usize) -> bool {
        let row = self.index(kk, j);
        match component {
            0 => self.full[row],
            1 => j > 0 && self.full[row] && self.full[row - 1],
            _ => kk > 1 && self.full[row] && self.full[row - self.layout.n[1]],
        }
    }
    /// Whether no face of a component in a padded layer touches a solid; those on the grid's sides are given by its walls in any case.
    pub fn is_free_layer(&self, component: usize, kk: usize) -> bool {
        self.full_layers[kk] && (component < 2 || kk == 1 || self.full_layers[kk - 1])
    }
}

impl Solver {
    /// After the connected parts of the fluid were found: what has to be computed of each level.
    pub(crate) fn mark(&self, components: &Components, skips: bool) -> Result<(), FlowError> {
        let fluid = self.fluid.read()?;
        let levels = &self.hierarchy.levels;
        for (l, level) in levels.iter().enumerate() {
            let mut spans = level.spans.try_write().ok_or(FlowError::PhaseConflict)?;
            if l == 0 {
                spans.set_fine(components, |kk| fluid.layer(kk), skips);
            } else {
                let finer = levels[l - 1].spans()?;
                spans.set_coarse(&finer, level.halved);
            }
        }
        Ok(())
    }
}
