//! The intersection test of one share (Teschner et al. 2003): the points are hashed, the tets are streamed past them.
//!
//! Promise: the hits are those of [`crate::intersect_brute`] to the last bit, and joining the shares of any number of workers
//! by [`merge`] gives the same list. The list is sorted by point, then tet. A point in several tets of one object (a common
//! face) has one deciding tet, the lowest; a point in tets of several objects has one hit for each object.

use crate::ContactError;
use crate::cull::Cull;
use crate::hash::LANES;
use crate::hash_read::HashRef;
use crate::lanes::{Boxes, Corners, TETS, Tests};
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
    cull: &mut Cull,
    out: &mut [Hit],
) -> Result<Found, ContactError> {
    points.check(hash.points())?;
    tissue.check()?;
    let (from, to) = share.points(hash.kept())?;
    let mut sink = Sink::new(tissue, out);
    let bundles = share.bundles();
    let query = Query { hash, points, tissue, from, to, bundles };
    pulp::Arch::new().dispatch(Stream { query, cull, sink: &mut sink });
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
    cull: &'s mut Cull,
    sink: &'s mut Sink<'a>,
}

impl pulp::WithSimd for Stream<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        self.query.stream(self.cull, self.sink);
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
}

impl Query<'_> {
    /// Streams the tets past the points: those that come near any are gathered, and tested many at once as far as it goes, one by one past their points.
    #[inline(always)]
    fn stream(&self, cull: &mut Cull, sink: &mut Sink<'_>) {
        if self.from == self.to {
            return;
        }
        cull.tell(self.tissue, self.hash, (self.from, self.to));
        // What is left over of one bundle, and those of the next.
        let (mut near, mut count) = ([0u32; 2 * TETS], 0usize);
        let (start, step) = self.bundles;
        for (bundle, tets) in self.tissue.tets.chunks(TETS).enumerate().skip(start).step_by(step) {
            for (l, tet) in tets.iter().enumerate() {
                near[count] = bundle.wrapping_mul(TETS).wrapping_add(l) as u32;
                count = count.wrapping_add(usize::from(cull.is_near(tet)));
            }
            if count >= TETS {
                self.bundle(&std::array::from_fn(|l| near[l]), sink);
                near.copy_within(TETS.., 0);
                count = count.wrapping_sub(TETS);
            }
        }
        if count > 0 {
            near[count..].fill(crate::NONE); // no tet
            self.bundle(&std::array::from_fn(|l| near[l]), sink);
        }
    }

    /// Tests `TETS` tets.
    #[inline(always)]
    fn bundle(&self, tets: &[u32; TETS], sink: &mut Sink<'_>) {
        let mut x: Corners = [[[0.0; TETS]; 4]; 3];
        for (l, &tet) in tets.iter().enumerate() {
            for (corner, p) in self.tissue.corners(tet).iter().enumerate() {
                for axis in 0..3 {
                    x[axis][corner][l] = p[axis];
                }
            }
        }
        let boxes = Boxes::of(&x);
        let (first, last) = self.hash.cells(&boxes.lo, &boxes.hi);
        // Lanes of points of which one is in the box of a tet, before anything else is computed of that.
        let mut meetings = Meetings { known: [(0, 0); MEETINGS], count: 0 };
        for l in 0..TETS {
            let (lo, hi) = ([0, 1, 2].map(|axis| boxes.lo[axis][l]), [0, 1, 2].map(|axis| boxes.hi[axis][l]));
            // Inlined, or the lanes would lose the instruction set of the dispatch.
            self.hash.for_runs_in(
                [0, 1, 2].map(|axis| first[axis][l]),
                [0, 1, 2].map(|axis| last[axis][l]),
                #[inline(always)]
                |from, to| {
                    let (mut at, to) = (from.max(self.from), to.min(self.to));
                    while at < to {
                        if meetings.count == MEETINGS {
                            self.test(tets, (&x, &boxes), &mut meetings, sink);
                        }
                        let lanes = to.wrapping_sub(at).min(LANES) as u32;
                        meetings.known[meetings.count] = (at as u32, lanes << TET_BITS | l as u32);
                        meetings.count = meetings.count.wrapping_add(usize::from(meets(self.hash.lanes(at), &lo, &hi)));
                        at = at.wrapping_add(LANES);
                    }
                },
            );
        }
        self.test(tets, (&x, &boxes), &mut meetings, sink);
    }

    /// Tests the points that lie near the boxes of `TETS` tets.
    #[inline(always)]
    fn test(&self, tets: &[u32; TETS], (x, boxes): (&Corners, &Boxes), meetings: &mut Meetings, sink: &mut Sink<'_>) {
        let count = std::mem::take(&mut meetings.count);
        if count == 0 {
            return;
        }
        let tests = Tests::of(x, boxes);
        for &(at, whom) in &meetings.known[..count] {
            let (at, lanes, l) = (at as usize, (whom >> TET_BITS) as usize, (whom as usize) % TETS);
            let (Some(test), Some(nodes)) = (tests.get(x, boxes, l), self.tissue.tets.get(tets[l] as usize)) else {
                continue;
            };
            let [px, py, pz] = self.hash.lanes(at);
            let inside = test.inside_lanes(px, py, pz);
            if inside.iter().fold(0, |any, &i| any | i) == 0 {
                continue;
            }
            for (lane, _) in inside.iter().enumerate().take(lanes).filter(|(_, i)| **i != 0) {
                let point = self.hash.id(at.wrapping_add(lane));
                let weights = test.weights_at([px[lane], py[lane], pz[lane]]);
                if self.points.may_hit(point, nodes, self.tissue.owner(tets[l]), &weights) {
                    sink.push(Hit { point, tet: tets[l], weights });
                }
            }
        }
    }
}

/// Room for lanes of points that lie near some tets; more are tested in turns.
const MEETINGS: usize = 128;
/// Bits of a tet's number in its bundle.
const TET_BITS: u32 = TETS.trailing_zeros();

/// Lanes of points near tets: the sorted place of the first, and their number above that of the tet in its bundle.
struct Meetings {
    known: [(u32, u32); MEETINGS],
    count: usize,
}

/// Whether any of the points lies in a box.
#[inline(always)]
fn meets([x, y, z]: [&[f32; LANES]; 3], lo: &[f32; 3], hi: &[f32; 3]) -> bool {
    let mut any = 0u32;
    for l in 0..LANES {
        let is_in = (x[l] >= lo[0]) & (x[l] <= hi[0]) & (y[l] >= lo[1]) & (y[l] <= hi[1]) & (z[l] >= lo[2]) & (z[l] <= hi[2]);
        any |= u32::from(is_in);
    }
    any != 0
}
