//! The intersection test of one share (Teschner et al. 2003): the points are hashed, the tets are streamed past them.
//!
//! Promise: the hits are those of [`crate::intersect_brute`] to the last bit, and joining the shares of any number of workers
//! by [`crate::merge`] gives the same list. The list is sorted by point, then tet. A point in several tets of one object (a common
//! face) has one deciding tet, the lowest; a point in tets of several objects has one hit for each object.

use crate::ContactError;
use crate::cull::{Cull, Known};
use crate::hash::LANES;
use crate::hash_read::HashRef;
use crate::lanes::{Boxes, Corners, TETS, Tests};
use crate::outcodes::{Outcodes, around};
use crate::sink::Sink;
use crate::types::{Found, Hit, Points, Share, Tissue};

/// Tests one share: of the hashed points against all tets, or of the tets against all points.
///
/// What `cull` remembers of the step before ([`Cull::of`]) spares a search through all tets, and changes no hit.
///
/// Writes the hits to the front of `out`; [`Found::dropped`] counts those that did not fit (size `out` at two per point of the
/// share and object, by [`crate::room_of_share`]). With hits dropped the list is its beginning, at least as far as that room is meant for.
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
    /// Tests the tets that points may lie in, many at once as far as it goes: those that are remembered, or all that come near any point.
    #[inline(always)]
    fn stream(&self, Cull { outcodes, known }: &mut Cull, sink: &mut Sink<'_>) {
        if self.from == self.to {
            return;
        }
        // Of a share of the points it would be other points each time.
        let is_of_all = (self.from, self.to) == (0, self.hash.kept());
        if is_of_all && known.serves(self.bundles, self.hash, self.points, self.tissue) {
            if let Some((boxes, reach_m)) = known.take_newcomers(self.hash) {
                outcodes.tell(self.tissue, &boxes);
                self.list(outcodes, reach_m, &mut known.tets);
                known.sort();
            }
            return self.test_known(known, sink);
        }
        let margin_m = if is_of_all { known.renew(self.bundles, self.hash, self.points, self.tissue) } else { 0.0 };
        outcodes.tell(self.tissue, &around((self.from, self.to), margin_m, |places| self.hash.around(places)));
        if margin_m > 0.0 {
            self.list(outcodes, margin_m, &mut known.tets);
            return self.test_known(known, sink);
        }
        self.for_near(
            outcodes,
            #[inline(always)]
            |bundle| self.test(bundle, sink),
        );
    }

    /// Calls for the tets that come near any point, `TETS` at once.
    #[inline(always)]
    fn for_near(&self, outcodes: &Outcodes, mut each: impl FnMut(&Bundle)) {
        // What is left over of one bundle, and those of the next.
        let (mut near, mut count) = ([0u32; 2 * TETS], 0usize);
        let (start, step) = self.bundles;
        for (bundle, tets) in self.tissue.tets.chunks(TETS).enumerate().skip(start).step_by(step) {
            for (l, tet) in tets.iter().enumerate() {
                near[count] = bundle.wrapping_mul(TETS).wrapping_add(l) as u32;
                count = count.wrapping_add(usize::from(outcodes.is_near(tet)));
            }
            if count >= TETS {
                each(&self.bundle(&near[..TETS]));
                near.copy_within(TETS.., 0);
                count = count.wrapping_sub(TETS);
            }
        }
        if count > 0 {
            each(&self.bundle(&near[..count]));
        }
    }

    /// Tests the tets that are remembered.
    #[inline(always)]
    fn test_known(&self, known: &Known, sink: &mut Sink<'_>) {
        for tets in known.tets.chunks(TETS) {
            self.test(&self.bundle(tets), sink);
        }
    }

    /// Up to `TETS` tets, and none in the lanes that are left over.
    #[inline(always)]
    fn bundle(&self, some: &[u32]) -> Bundle {
        let mut tets = [crate::NONE; TETS];
        tets[..some.len()].copy_from_slice(some);
        let mut x: Corners = [[[0.0; TETS]; 4]; 3];
        for (l, &tet) in tets.iter().enumerate() {
            for (corner, p) in self.tissue.corners(tet).iter().enumerate() {
                for axis in 0..3 {
                    x[axis][corner][l] = p[axis];
                }
            }
        }
        let boxes = Boxes::of(&x);
        Bundle { tets, x, boxes }
    }

    /// Calls for lanes of points of which one is in the box of a tet, before anything else is computed of that.
    #[inline(always)]
    fn for_meetings(&self, boxes: &Boxes, mut each: impl FnMut(&[Meeting])) {
        let (first, last) = self.hash.cells(&boxes.lo, &boxes.hi);
        let (mut meetings, mut count) = ([Meeting::default(); MEETINGS], 0usize);
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
                        if count == MEETINGS {
                            each(&meetings);
                            count = 0;
                        }
                        meetings[count] = Meeting::of(at, to.wrapping_sub(at).min(LANES), l);
                        count = count.wrapping_add(usize::from(meets(self.hash.lanes(at), &lo, &hi)));
                        at = at.wrapping_add(LANES);
                    }
                },
            );
        }
        if count > 0 {
            each(&meetings[..count]);
        }
    }

    /// Tests the points that lie near some tets.
    #[inline(always)]
    fn test(&self, bundle: &Bundle, sink: &mut Sink<'_>) {
        self.for_meetings(
            &bundle.boxes,
            #[inline(always)]
            |meetings| self.test_met(bundle, meetings, sink),
        );
    }

    #[inline(always)]
    fn test_met(&self, Bundle { tets, x, boxes }: &Bundle, meetings: &[Meeting], sink: &mut Sink<'_>) {
        let tests = Tests::of(x, boxes);
        for (at, lanes, l) in meetings.iter().map(Meeting::parts) {
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

    /// Lists the tets that a point which may hit them lies in, or comes to when it and their nodes have come so far together, m.
    #[inline(always)]
    fn list(&self, outcodes: &Outcodes, margin_m: f32, listed: &mut Vec<u32>) {
        self.for_near(
            outcodes,
            #[inline(always)]
            |bundle| {
                let mut is_near = [false; TETS];
                self.for_meetings(
                    &bundle.boxes.grown(margin_m),
                    #[inline(always)]
                    |meetings| self.mark_near(bundle, meetings, margin_m, &mut is_near),
                );
                listed.extend(bundle.tets.iter().zip(is_near).filter(|(_, is_near)| *is_near).map(|(tet, _)| *tet));
            },
        );
    }

    #[inline(always)]
    fn mark_near(&self, bundle: &Bundle, meetings: &[Meeting], margin_m: f32, is_near: &mut [bool; TETS]) {
        let Bundle { tets, x, boxes } = bundle;
        let tests = Tests::of(x, boxes);
        for (at, lanes, l) in meetings.iter().map(Meeting::parts) {
            let Some(nodes) = self.tissue.tets.get(tets[l] as usize).filter(|_| !is_near[l]) else { continue };
            // One that is flat now may be none then.
            let near = tests.get(x, boxes, l).map_or([1; LANES], |test| test.near_lanes(self.hash.lanes(at), margin_m));
            if near.iter().fold(0, |any, &is_near| any | is_near) == 0 {
                continue;
            }
            let is_one = |lane: usize| {
                let point = self.hash.id(at.wrapping_add(lane));
                near[lane] != 0 && self.points.may_ever_hit(point, nodes, self.tissue.owner(tets[l]))
            };
            is_near[l] = (0..lanes).any(is_one);
        }
    }
}

/// Tets that are looked at together.
struct Bundle {
    tets: [u32; TETS],
    x: Corners,
    boxes: Boxes,
}

/// Room for lanes of points that lie near some tets; more are tested in turns.
const MEETINGS: usize = 128;
/// Bits of a tet's number in its bundle.
const TET_BITS: u32 = TETS.trailing_zeros();

/// Lanes of points near a tet: the sorted place of the first, and their number above that of the tet in its bundle.
#[derive(Clone, Copy, Default)]
struct Meeting(u32, u32);

impl Meeting {
    #[inline(always)]
    fn of(at: usize, lanes: usize, l: usize) -> Meeting {
        Meeting(at as u32, (lanes as u32) << TET_BITS | l as u32)
    }

    /// The sorted place of the first point, how many they are, and the tet's number in its bundle.
    #[inline(always)]
    fn parts(&self) -> (usize, usize, usize) {
        (self.0 as usize, (self.1 >> TET_BITS) as usize, (self.1 as usize) % TETS)
    }
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
