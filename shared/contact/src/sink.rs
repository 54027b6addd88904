//! Where hits go: a list that is sorted by point, then tet, in which a point has one hit in each object, that in the lowest tet.
//!
//! Promise: without room for all of the list its beginning is kept, in whatever order the hits come. So shares with room enough ([`room_of_share`]) are
//! joined to the same list, however many they are.

use crate::types::{Found, Hit, Tissue};

/// Where not all hits have room, one in so many of the places is made free at once: a sort is paid for by as many hits.
const FREED: usize = 8;

/// Room for a share of which [`merge`] has room for so many hits: with less, one of few shares would leave out what each of many has room for.
pub fn room_of_share(hits: usize) -> usize {
    hits + hits.div_ceil(FREED - 1) + 1
}

/// How many hits stay in some room when places are made free.
fn kept_in(room: usize) -> usize {
    room.saturating_sub((room / FREED).max(1))
}

/// Joins the hits of the shares, each as [`crate::intersect`] leaves it, into one list: that of a single worker.
///
/// What does not fit is counted as dropped; then the beginning of the list is kept, whatever the shares, if each had the room that [`room_of_share`] says.
pub fn merge(parts: &[&[Hit]], tissue: &Tissue<'_>, out: &mut [Hit]) -> Found {
    if parts.iter().map(|part| part.len()).sum::<usize>() > out.len() {
        return merge_in_order(parts, tissue, out);
    }
    let mut sink = Sink::new(tissue, out);
    for hit in parts.iter().flat_map(|part| part.iter()) {
        sink.push(*hit);
    }
    sink.finish()
}

/// The same where there may be no room for all: one hit after the other, as they stand in the list.
fn merge_in_order(parts: &[&[Hit]], tissue: &Tissue<'_>, out: &mut [Hit]) -> Found {
    let mut found = Found::default();
    let mut from = Some(0);
    while let Some(hit) = from.and_then(|from| first_from(parts, from)) {
        from = key(&hit).checked_add(1);
        if has_object_of(&hit, &out[..found.count], tissue) {
            continue;
        }
        match out.get_mut(found.count) {
            Some(place) => {
                *place = hit;
                found.count += 1;
            }
            None => found.dropped += 1,
        }
    }
    found
}

/// The first hit of all parts that does not come before a key.
fn first_from(parts: &[&[Hit]], from: u64) -> Option<Hit> {
    let of_part = |part: &&[Hit]| part.get(part.partition_point(|hit| key(hit) < from)).copied();
    // Looked at again, for a part in no order would be walked through for ever.
    parts.iter().filter_map(of_part).filter(|hit| key(hit) >= from).min_by_key(key)
}

/// The order of the list.
fn key(hit: &Hit) -> u64 {
    (u64::from(hit.point) << 32) | u64::from(hit.tet)
}

/// Whether the last point of a list, if it is that of a hit, has one in the same object already.
fn has_object_of(hit: &Hit, list: &[Hit], tissue: &Tissue<'_>) -> bool {
    let owner = tissue.owner(hit.tet);
    let mut of_point = list.iter().rev().take_while(|other| other.point == hit.point);
    of_point.any(|other| tissue.owner(other.tet) == owner)
}

/// The output and how far it is filled.
pub(crate) struct Sink<'a> {
    tissue: &'a Tissue<'a>,
    out: &'a mut [Hit],
    count: usize,
    dropped: usize,
    /// So many at the front are the list of what came before places were last made free.
    settled: usize,
    /// The key of the first hit that found no room, once there is one: nothing has room from there on.
    end: Option<u64>,
}

impl<'a> Sink<'a> {
    pub fn new(tissue: &'a Tissue<'a>, out: &'a mut [Hit]) -> Sink<'a> {
        Sink { tissue, out, count: 0, dropped: 0, settled: 0, end: None }
    }

    #[inline(always)]
    pub fn push(&mut self, hit: Hit) {
        if self.count == self.out.len() {
            self.make_room();
        }
        if let Some(end) = self.end
            && !self.takes(&hit, end)
        {
            return;
        }
        self.out[self.count] = hit;
        self.count = self.count.wrapping_add(1);
    }

    /// In scrambled tissue a point lies in many tets: drops all but the deciding ones, and of these the last ones where they leave too few places free.
    #[cold]
    fn make_room(&mut self) {
        self.compact();
        let kept = kept_in(self.out.len());
        if self.count > kept {
            self.end = Some(key(&self.out[kept]));
            self.dropped = self.dropped.wrapping_add(self.count - kept);
            self.count = kept;
        } else if self.out.is_empty() {
            self.end = Some(0);
        }
        self.settled = self.count;
    }

    /// Whether a hit is to be kept where not all have room: it comes before those that have none, and decides.
    #[cold]
    fn takes(&mut self, hit: &Hit, end: u64) -> bool {
        if key(hit) >= end {
            self.dropped = self.dropped.wrapping_add(1);
            return false;
        }
        let settled = &self.out[..self.settled];
        let before = settled.partition_point(|other| key(other) <= key(hit));
        !has_object_of(hit, &settled[..before], self.tissue)
    }

    /// Sorts, and keeps for each point the lowest tet of each object.
    fn compact(&mut self) {
        self.out[..self.count].sort_unstable_by_key(key);
        let mut kept = 0;
        for i in 0..self.count {
            let hit = self.out[i];
            if !has_object_of(&hit, &self.out[..kept], self.tissue) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn so_many_of_a_list_are_kept_as_the_room_of_a_share_is_meant_for_whatever_comes_first() {
        let tissue = Tissue { positions_m: &[], tets: &[], tet_owner: &[] };
        let hit = |point: u32| Hit { point, ..Hit::default() };
        for hits in 0..70 {
            let mut out = vec![Hit::default(); room_of_share(hits)];
            for step in [1, 7, 60] {
                let mut sink = Sink::new(&tissue, &mut out);
                // Each of 61 points, of which the last or the first come first; some come again.
                (1..62).map(|turn| turn * step % 61).chain([3, 60]).for_each(|point| sink.push(hit(point)));
                let found = sink.finish();
                assert!(found.count >= hits.min(61) && (found.count < 61) == (found.dropped > 0), "{hits}, {step}: {found:?}");
                assert!(out[..found.count].iter().zip(0..).all(|(hit, point)| hit.point == point), "{hits}, {step}");
            }
        }
        for room in 0..20 {
            assert!(kept_in(room) < room.max(1), "a place is free in {room}");
        }
    }
}
