//! The intersection test of one share (Teschner et al. 2003): the points are hashed, the tets are streamed past them.
//!
//! Promise: the hits are those of [`crate::intersect_brute`] to the last bit, and joining the shares of any number of workers
//! by [`merge`] gives the same list. The list is sorted by point, then tet. A point in several tets of one object (a common
//! face) has one deciding tet, the lowest; a point in tets of several objects has one hit for each object.

use crate::ContactError;
use crate::hash::LANES;
use crate::hash_read::HashRef;
use crate::lanes::{Boxes, Corners, TETS, Tests};
use crate::tet::{TetTest, max, min};
use crate::types::{Found, Hit, Points, Share, Tissue};

/// Tests one share: of the hashed points against all tets, or of the tets against all points.
///
/// Writes the hits to the front of `out`; [`Found::dropped`] counts those that did not fit (size `out` at two per point of the
/// share and object). With hits dropped the list is incomplete but each entry is true.
///
/// # Errors
/// [`ContactError::Share`] or [`ContactError::Length`]; then nothing is written.
pub fn intersect(
    share: Share,
    hash: &HashRef<'_>,
    points: &Points<'_>,
    tissue: &Tissue<'_>,
    out: &mut [Hit],
) -> Result<Found, ContactError> {
    points.check(hash.points())?;
    tissue.check()?;
    let (from, to) = share.points(hash.kept())?;
    let mut sink = Sink::new(tissue, out);
    let bundles = share.bundles();
    let nothing = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    let query = Query { hash, points, tissue, from, to, bundles, around: [nothing; 2] };
    pulp::Arch::new().dispatch(Stream { query, sink: &mut sink });
    Ok(sink.finish())
}

/// Joins the hits of the shares into one list: that of a single worker.
///
/// Room for the sum of the parts is enough; what does not fit is counted as dropped.
pub fn merge(parts: &[&[Hit]], tissue: &Tissue<'_>, out: &mut [Hit]) -> Found {
    let mut sink = Sink::new(tissue, out);
    for hit in parts.iter().flat_map(|part| part.iter()) {
        sink.push(*hit);
    }
    sink.finish()
}

fn sort(hits: &mut [Hit]) {
    hits.sort_unstable_by_key(|h| (u64::from(h.point) << 32) | u64::from(h.tet));
}

/// The output and how far it is filled.
pub(crate) struct Sink<'a> {
    tissue: &'a Tissue<'a>,
    out: &'a mut [Hit],
    count: usize,
    dropped: usize,
    /// Compacting no longer gains room.
    crammed: bool,
}

impl<'a> Sink<'a> {
    pub fn new(tissue: &'a Tissue<'a>, out: &'a mut [Hit]) -> Sink<'a> {
        Sink { tissue, out, count: 0, dropped: 0, crammed: false }
    }

    #[inline(always)]
    pub fn push(&mut self, hit: Hit) {
        if self.count == self.out.len() && !self.make_room() {
            self.dropped = self.dropped.wrapping_add(1);
            return;
        }
        self.out[self.count] = hit;
        self.count = self.count.wrapping_add(1);
    }

    /// In scrambled tissue a point lies in many tets: drops all but the deciding ones. Gives up once that gains little, so
    /// that the whole costs a bounded number of sorts.
    #[cold]
    fn make_room(&mut self) -> bool {
        if !self.crammed {
            self.compact();
            self.crammed = self.count > self.out.len() / 8 * 7;
        }
        self.count < self.out.len()
    }

    /// Sorts, and keeps for each point the lowest tet of each object.
    fn compact(&mut self) {
        sort(&mut self.out[..self.count]);
        let mut kept = 0;
        for i in 0..self.count {
            let hit = self.out[i];
            let owner = self.tissue.owner(hit.tet);
            let mut before = self.out[..kept].iter().rev().take_while(|h| h.point == hit.point);
            if before.all(|h| self.tissue.owner(h.tet) != owner) {
                self.out[kept] = hit;
                kept += 1;
            }
        }
        self.count = kept;
    }

    /// Leaves the hits sorted, each point with the lowest tet of each object.
    pub fn finish(mut self) -> Found {
        self.compact();
        Found { count: self.count, dropped: self.dropped }
    }
}

/// The whole of the test, to be compiled for each instruction set. A struct and no closure: a closure that borrows mutably is
/// called through a shim that is not inlined, and loses the instruction set.
struct Stream<'a, 's> {
    query: Query<'a>,
    sink: &'s mut Sink<'a>,
}

impl pulp::WithSimd for Stream<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, _: S) {
        self.query.stream(self.sink);
    }
}

struct Query<'a> {
    hash: &'a HashRef<'a>,
    points: &'a Points<'a>,
    tissue: &'a Tissue<'a>,
    /// Sorted places of this share.
    from: usize,
    to: usize,
    /// First bundle of `TETS` tets, and the step to the next.
    bundles: (usize, usize),
    /// Boxes, lowest and highest corner, of the share's points: of those with the owner of the first, which is the tool, and of all others. One box around
    /// both would be met by all the tissue between them.
    around: [([f32; 3], [f32; 3]); 2],
}

impl Query<'_> {
    /// Streams the tets past the points: many at once as far as it goes, one by one past their points.
    #[inline(always)]
    fn stream(&mut self, sink: &mut Sink<'_>) {
        for at in self.from..self.to {
            let p = self.hash.position(at);
            let is_other = self.points.owner.get(self.hash.id(at) as usize) != self.points.owner.first();
            let (lo, hi) = &mut self.around[usize::from(is_other)];
            for (axis, &v) in p.iter().enumerate() {
                lo[axis] = min(lo[axis], v);
                hi[axis] = max(hi[axis], v);
            }
        }
        if self.from == self.to {
            return;
        }
        let (start, step) = self.bundles;
        let bundles = self.tissue.tets.chunks(TETS).enumerate();
        for (bundle, tets) in bundles.skip(start).step_by(step) {
            let first = bundle.wrapping_mul(TETS) as u32;
            match <&[[u32; 4]; TETS]>::try_from(tets) {
                Ok(tets) => self.bundle(tets, first, sink),
                Err(_) => {
                    // The last few, filled up with tets of no nodes, which nothing is near to.
                    let mut filled = [[crate::NONE; 4]; TETS];
                    filled[..tets.len()].copy_from_slice(tets);
                    self.bundle(&filled, first, sink);
                }
            }
        }
    }

    /// Tests `TETS` tets.
    #[inline(always)]
    fn bundle(&self, tets: &[[u32; 4]; TETS], first: u32, sink: &mut Sink<'_>) {
        let mut x: Corners = [[[0.0; TETS]; 4]; 3];
        for (l, tet) in tets.iter().enumerate() {
            for (corner, &node) in tet.iter().enumerate() {
                let p = self.tissue.node(node);
                for axis in 0..3 {
                    x[axis][corner][l] = p[axis];
                }
            }
        }
        let boxes = Boxes::of(&x);
        let mut near = [0u32; TETS];
        for (lo, hi) in self.around {
            near.iter_mut().zip(boxes.meet(lo, hi)).for_each(|(near, meets)| *near |= meets);
        }
        if near.iter().fold(0, |any, &n| any | n) == 0 {
            return;
        }
        let (from, to) = self.hash.cells(&boxes.lo, &boxes.hi);
        let tests = Tests::of(&x, &boxes);
        for (l, tet) in tets.iter().enumerate().filter(|(l, _)| near[*l] != 0) {
            let Some(test) = tests.get(&x, &boxes, l) else {
                continue;
            };
            let cell = |axes: &[[i32; TETS]; 3]| [axes[0][l], axes[1][l], axes[2][l]];
            // Inlined, or the lanes of `run` would lose the instruction set of the dispatch.
            self.hash.for_runs_in(
                cell(&from),
                cell(&to),
                #[inline(always)]
                |from, to| {
                    let (from, to) = (from.max(self.from), to.min(self.to));
                    self.run(first.wrapping_add(l as u32), tet, &test, from, to, sink);
                },
            );
        }
    }

    /// Tests the sorted points `from..to` in lanes.
    #[inline(always)]
    fn run(&self, tet: u32, nodes: &[u32; 4], test: &TetTest, from: usize, to: usize, sink: &mut Sink<'_>) {
        let mut at = from;
        while at < to {
            let [x, y, z] = self.hash.lanes(at);
            let inside = test.inside_lanes(x, y, z);
            if inside.iter().fold(0, |any, &i| any | i) != 0 {
                let lanes = to.wrapping_sub(at).min(LANES);
                for (l, _) in inside.iter().enumerate().take(lanes).filter(|(_, i)| **i != 0) {
                    let point = self.hash.id(at.wrapping_add(l));
                    let weights = test.weights_at([x[l], y[l], z[l]]);
                    if self.points.may_hit(point, nodes, self.tissue.owner(tet), &weights) {
                        sink.push(Hit { point, tet, weights });
                    }
                }
            }
            at = at.wrapping_add(LANES);
        }
    }
}
