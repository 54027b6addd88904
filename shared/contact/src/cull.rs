//! What is remembered from step to step of the tets that come near the points: a neighbour list, as of Verlet (1967). It has each tet that a point lay in or
//! near when it was made, and serves until nodes and points together have come as far as it was made for. So most steps look at a few hundred tets,
//! where there are thousands.
//!
//! Promise: the hits are those of a search through all tets, to the last bit. A point that lies in a tet now is a mean of its corners; the same mean of where
//! these were is in the tet of that time, and as far from where the point was as both have come at most. What rounding makes of that is allowed for: in a
//! tet that it could put a point in from farther nothing is ever found. For points that were nowhere, as nodes of folds are until they are pressed far, tets
//! are looked for and added. For a node that is or was nowhere, another tissue, other points, another share all are looked for anew.

use crate::hash_read::HashRef;
use crate::outcodes::{Around, Outcodes, around};
use crate::tet::{max, min, most};
use crate::types::{Points, Tissue};

/// For how many steps a list is made, if all goes on as fast as before.
const STEPS: f32 = 12.0;
/// The least and the most that a list is made for, in cells: with more, tets are in it that no point will come to for long.
const LEAST: f32 = 0.02;
const MOST: f32 = 0.25;
/// It is made anew after so many steps at the latest, so that what a byte that flips in memory that others write does to it does not stay.
const MOST_STEPS: u32 = 64;
/// The share of it that may be used up: the rest is for rounding.
const USABLE: f32 = 0.95;
/// Up to one newcomer among so many points is added to a list; of more it is made anew.
const NEWCOMERS: usize = 8;
/// No list is made for less than this share of the largest coordinate of a node: rounding would take more than the rest.
const ROUNDING: f32 = 2e-5;

/// What a search for hits keeps between two steps; sized once. Without [`Cull::of`] it remembers nothing.
#[derive(Debug, Default)]
pub struct Cull {
    pub(crate) outcodes: Outcodes,
    pub(crate) known: Known,
}

impl Cull {
    /// With room for so many nodes; it grows with tissue of more.
    pub fn for_nodes(nodes: usize) -> Cull {
        Cull { outcodes: Outcodes::for_nodes(nodes), known: Known::default() }
    }

    /// With room to remember what is near so many points, in so many tets.
    pub fn remembering(nodes: usize, tets: usize, points: usize) -> Cull {
        let known = Known {
            positions_m: Vec::with_capacity(nodes),
            points_m: Vec::with_capacity(points),
            owner: Vec::with_capacity(points),
            node: Vec::with_capacity(points),
            newcomers: Vec::with_capacity(points),
            // Twice, for those that are added may be there already.
            tets: Vec::with_capacity(2 * tets),
            ..Known::default()
        };
        Cull { known, ..Cull::for_nodes(nodes) }
    }

    /// Remembers from now on, for tissue whose tets and their objects have this number, and no others: what is known of another is forgotten.
    pub fn of(&mut self, topology: u32) -> &mut Cull {
        if self.known.topology != Some(topology) {
            self.known.topology = Some(topology);
            self.known.forget();
        }
        self
    }

    /// How many times tets were looked for among all, by one that remembers; also of newcomers alone.
    pub fn searches(&self) -> u64 {
        self.known.searches
    }
}

/// The tets that points may lie in, and what was where when they were looked for.
#[derive(Debug, Default)]
pub(crate) struct Known {
    topology: Option<u32>,
    /// First bundle of tets, and the step to the next.
    bundles: (usize, usize),
    positions_m: Vec<[f32; 3]>,
    /// By their numbers; [`NOWHERE`] for those that the table had not.
    points_m: Vec<[f32; 3]>,
    owner: Vec<u32>,
    node: Vec<u32>,
    /// From which point on they meet their own object alone, if any meets its own.
    only_from: Option<u32>,
    /// Cells per metre of the table.
    per_m: f32,
    /// What the list is made for, m; 0 if there is none.
    margin_m: f32,
    /// Steps since what was where is known, and how far nodes and points have come since then, m.
    age: u32,
    moved_m: f32,
    searches: u64,
    /// Sorted places of points that were nowhere.
    newcomers: Vec<u32>,
    /// The tets, in their order.
    pub tets: Vec<u32>,
}

const NOWHERE: [f32; 3] = [f32::NAN; 3];

impl Known {
    fn forget(&mut self) {
        (self.margin_m, self.age, self.moved_m) = (0.0, 0, 0.0);
        self.positions_m.clear();
        self.points_m.clear();
    }

    /// Whether the tets still are all that a point may lie in but newcomers.
    #[inline(always)]
    pub fn serves(&mut self, bundles: (usize, usize), hash: &HashRef<'_>, points: &Points<'_>, tissue: &Tissue<'_>) -> bool {
        if self.topology.is_none() {
            return false;
        }
        let are_same = self.bundles == bundles
            && self.positions_m.len() == tissue.positions_m.len()
            && self.points_m.len() == hash.points()
            && self.per_m == hash.per_m()
            && self.only_from == only_from(points)
            && self.owner == points.owner
            && self.node == points.node;
        if !are_same {
            self.forget();
            return false;
        }
        self.age = self.age.saturating_add(1);
        self.newcomers.clear();
        let mut of_points_m = hash.farthest_m(&self.points_m);
        if of_points_m.is_nan() {
            of_points_m = hash.farthest_of_known_m(&self.points_m, &mut self.newcomers);
        }
        self.moved_m = farthest_m(&self.positions_m, tissue.positions_m) + of_points_m;
        // False too where that is no number.
        let is_near = self.margin_m > 0.0 && self.moved_m <= USABLE * self.margin_m;
        is_near && self.age <= MOST_STEPS && self.newcomers.len() <= hash.kept() / NEWCOMERS
    }

    /// Takes in the newcomers, if there are any; gives boxes around them, grown by as much as a list for them is to reach, m, and that. What has been used up of
    /// the list comes on top, for its way is measured from where all was before they came.
    #[inline(always)]
    pub fn take_newcomers(&mut self, hash: &HashRef<'_>) -> Option<(Around, f32)> {
        if self.newcomers.is_empty() {
            return None;
        }
        self.searches = self.searches.wrapping_add(1);
        let reach_m = self.margin_m + self.moved_m;
        let around_some = |(from, to): (usize, usize)| {
            let places_m = self.newcomers[from..to].iter().map(|place| hash.position(*place as usize));
            places_m.fold(([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]), |(lo, hi), place_m| {
                let axes = |choose: fn(f32, f32) -> f32, of: [f32; 3]| [0, 1, 2].map(|axis| choose(of[axis], place_m[axis]));
                (axes(min, lo), axes(max, hi))
            })
        };
        let boxes = around((0, self.newcomers.len()), reach_m, around_some);
        for place in &self.newcomers {
            if let Some(point_m) = self.points_m.get_mut(hash.id(*place as usize) as usize) {
                *point_m = hash.position(*place as usize);
            }
        }
        Some((boxes, reach_m))
    }

    /// Puts tets that were added into their order.
    #[inline(always)]
    pub fn sort(&mut self) {
        self.tets.sort_unstable();
        self.tets.dedup();
    }

    /// Notes what is where now, and tells how far a list is to reach, m; 0 if none is worth while, or may be kept.
    #[inline(always)]
    pub fn renew(&mut self, bundles: (usize, usize), hash: &HashRef<'_>, points: &Points<'_>, tissue: &Tissue<'_>) -> f32 {
        if self.topology.is_none() {
            return 0.0;
        }
        self.searches = self.searches.wrapping_add(1);
        let (cell_m, each_m) = (1.0 / hash.per_m(), self.moved_m / self.age.max(1) as f32);
        let most_m = MOST * cell_m;
        // For less than two steps a list costs more than it saves. False too where that is no number: a node that is or was nowhere.
        let serves_for_some = 2.0 * each_m <= USABLE * most_m;
        let margin_m = max(min(STEPS * each_m, most_m), LEAST * cell_m);
        let is_exact = margin_m >= ROUNDING * largest_m(tissue.positions_m);
        self.margin_m = if serves_for_some && is_exact { margin_m } else { 0.0 };
        (self.bundles, self.per_m, self.only_from) = (bundles, hash.per_m(), only_from(points));
        (self.age, self.moved_m) = (0, 0.0);
        copy(&mut self.positions_m, tissue.positions_m);
        copy(&mut self.owner, points.owner);
        copy(&mut self.node, points.node);
        self.points_m.clear();
        self.points_m.resize(hash.points(), NOWHERE);
        hash.copy_to(&mut self.points_m);
        self.tets.clear();
        self.margin_m
    }
}

fn only_from(points: &Points<'_>) -> Option<u32> {
    points.own.map(|own| own.only_from)
}

fn copy<T: Copy>(to: &mut Vec<T>, from: &[T]) {
    to.clear();
    to.extend_from_slice(from);
}

/// The largest way on any axis from some places to as many others, m; no number if any is none.
#[inline(always)]
fn farthest_m(from_m: &[[f32; 3]], to_m: &[[f32; 3]]) -> f32 {
    most(from_m.as_flattened().iter().zip(to_m.as_flattened()).map(|(from, to)| to - from))
}

/// The largest coordinate of some places, m; no number if any is none.
#[inline(always)]
fn largest_m(places_m: &[[f32; 3]]) -> f32 {
    most(places_m.as_flattened().iter().copied())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hash::{HEADER_WORDS, HashMut, HashSizes, Layout};
    use crate::intersect::intersect;
    use crate::types::{Hit, Share, Split};

    #[test]
    fn a_damaged_table_spoils_no_step_after_it() {
        let positions_m = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let tissue = Tissue { positions_m: &positions_m, tets: &[[0, 1, 2, 3]], tet_owner: &[0] };
        let points = Points { owner: &[1], node: &[], own: None };
        let sizes = HashSizes::for_points(1);
        let mut words = vec![0; sizes.words()];
        HashMut::in_words(&mut words, sizes).unwrap().build(&[[0.2; 3]], 0.003, Layout::Auto).unwrap();
        let mut out = [Hit::default(); 4];
        let mut found = |cull: &mut Cull, words: &[u32]| {
            let share = Share { split: Split::Tets, ..Share::ALL };
            let hash = HashRef::in_own_words(words).unwrap();
            intersect(share, &hash, &points, &tissue, cull.of(1), &mut out).unwrap().count
        };
        const PER_M: usize = 6;
        for bit in 0..32 {
            let (mut cull, mut damaged) = (Cull::default(), words.clone());
            damaged[PER_M] ^= 1 << bit;
            assert!(PER_M < HEADER_WORDS && found(&mut cull, &damaged) <= 1);
            assert_eq!(found(&mut cull, &words), 1, "bit {bit}");
        }
    }
}
