//! Reading the spatial hash where it lies: what another process built is checked first, then read without a copy.

use crate::ContactError;
use crate::hash::{CELL_LIMIT, HEADER_WORDS, HashSizes, Header, LANES, MAGIC, POINTS, cell_of, hash_cell};
use crate::tet::{max, min, most};

/// Whether all points are in their slots, to be asked with each instruction set.
struct InSlots<'a, 't>(&'t HashRef<'a>);

impl pulp::WithSimd for InSlots<'_, '_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> bool {
        self.0.are_in_slots()
    }
}

/// A filled table, for reading where it lies.
#[derive(Debug, Clone, Copy)]
pub struct HashRef<'a> {
    pub(crate) header: Header,
    pub(crate) starts: &'a [u32],
    pub(crate) ids: &'a [u32],
    pub(crate) xyz: [&'a [f32]; 3],
}

impl<'a> HashRef<'a> {
    /// Reads and checks a table that another process built in these words.
    ///
    /// # Errors
    /// [`ContactError::Words`] or [`ContactError::Corrupt`] if they do not hold one.
    pub fn in_words(words: &'a [u32]) -> Result<HashRef<'a>, ContactError> {
        let table = HashRef::in_own_words(words)?;
        table.check()?;
        Ok(table)
    }

    /// Reads a table that this process built itself, in words that no other can write: its places are found, and what stands there is not read through first.
    ///
    /// # Errors
    /// [`ContactError::Words`] or [`ContactError::Corrupt`] if there is none in these words.
    pub fn in_own_words(words: &'a [u32]) -> Result<HashRef<'a>, ContactError> {
        let have = words.len();
        let head = words.get(..HEADER_WORDS).ok_or(ContactError::Words { have, need: HEADER_WORDS })?;
        let header: Header = *bytemuck::from_bytes(bytemuck::cast_slice(head));
        let bad = |what| Err(ContactError::Corrupt { what });
        if header.magic != MAGIC {
            return bad("no mark at the start");
        }
        if header.kept > header.points || header.points > header.capacity || header.slots == 0 {
            return bad("counts that contradict one another");
        }
        let sizes = HashSizes { points: header.capacity as usize, slots: header.slots as usize };
        let words = words.get(..sizes.words()).ok_or(ContactError::Words { have, need: sizes.words() })?;
        let (starts, rest) = words[HEADER_WORDS..].split_at(sizes.slots + 1);
        let (ids, rest) = rest.split_at(sizes.padded());
        let (x, rest) = rest.split_at(sizes.padded());
        let (y, rest) = rest.split_at(sizes.padded());
        let z = &rest[..sizes.padded()];
        Ok(HashRef { header, starts, ids, xyz: [x, y, z].map(bytemuck::cast_slice) })
    }

    /// Whether nothing in it leads out of it.
    fn check(&self) -> Result<(), ContactError> {
        let (header, starts) = (&self.header, self.starts);
        let bad = |what| Err(ContactError::Corrupt { what });
        // All of them without a way out in between, many at once: nearly always none is bad.
        let falls = starts.iter().zip(&starts[1..]).fold(false, |falls, (this, next)| falls | (this > next));
        if starts[0] != 0 || starts[header.slots as usize] != header.kept || falls {
            return bad("slots out of order");
        }
        if self.ids[..header.kept as usize].iter().fold(false, |any, &id| any | (id >= header.points)) {
            return bad("a point that does not exist");
        }
        let cells = header.dims.iter().fold(1u128, |n, &d| n * u128::from(d));
        if (header.hashed == 0 && cells > u128::from(header.slots)) || header.dims.iter().any(|&d| d > 2 * CELL_LIMIT as u32 + 1)
        {
            return bad("a box larger than the table");
        }
        let ends = |a: usize| i64::from(header.origin[a]) + i64::from(header.dims[a]);
        let most = i64::from(CELL_LIMIT);
        if (0..3).any(|a| i64::from(header.origin[a]).abs() > most || ends(a) > most + 1) {
            return bad("a box outside of the space of cells");
        }
        Ok(())
    }

    /// Points that were given, finite or not.
    pub fn points(&self) -> usize {
        self.header.points as usize
    }

    /// Points that are in the table: the finite ones.
    pub fn kept(&self) -> usize {
        self.header.kept as usize
    }

    /// Whether it is the table of these points: each that it has is where that one is, and in the slot of its cell.
    pub fn is_of(&self, points_m: &[[f32; 3]]) -> bool {
        let is_there = |at: usize| points_m.get(self.ids[at] as usize).is_some_and(|point_m| *point_m == self.position(at));
        let are_there = points_m.len() == self.points() && (0..self.kept()).all(is_there);
        are_there && pulp::Arch::new().dispatch(InSlots(self))
    }

    /// Whether each point lies in the occupied box, and in the slot of its cell.
    #[inline(always)]
    fn are_in_slots(&self) -> bool {
        let mut are_in = true;
        for from in (0..self.kept()).step_by(POINTS) {
            let some = POINTS.min(self.kept().wrapping_sub(from));
            let mut points_m = [self.position(from); POINTS];
            for (l, point_m) in points_m.iter_mut().enumerate().take(some) {
                *point_m = self.position(from.wrapping_add(l));
            }
            let (cells, is_finite) = self.header.cells_of(&points_m);
            are_in &= self.header.has_all(&cells);
            for (at, slot) in (from..).zip(self.header.slots_of(&cells, &is_finite)).take(some) {
                let run = self.starts.get(slot as usize).zip(self.starts.get((slot as usize).wrapping_add(1)));
                are_in &= run.is_some_and(|(first, end)| (*first as usize..*end as usize).contains(&at));
            }
        }
        are_in
    }

    /// Cells per metre.
    pub(crate) fn per_m(&self) -> f32 {
        self.header.per_m
    }

    /// Puts each point that is in the table to its number.
    #[inline(always)]
    pub(crate) fn copy_to(&self, points_m: &mut [[f32; 3]]) {
        for at in 0..self.kept() {
            if let Some(point_m) = points_m.get_mut(self.ids[at] as usize) {
                *point_m = self.position(at);
            }
        }
    }

    /// The largest way on any axis from where the points were, by their numbers, to where they are, m; no number if one of them was nowhere.
    #[inline(always)]
    pub(crate) fn farthest_m(&self, points_m: &[[f32; 3]]) -> f32 {
        most((0..self.kept()).map(|at| self.way_m(at, points_m)))
    }

    /// The same of those that were somewhere; gives the sorted places of the others.
    #[cold]
    pub(crate) fn farthest_of_known_m(&self, points_m: &[[f32; 3]], others: &mut Vec<u32>) -> f32 {
        let of_known = |at: usize| {
            let way_m = self.way_m(at, points_m);
            if way_m.is_nan() {
                others.push(at as u32);
            }
            (!way_m.is_nan()).then_some(way_m)
        };
        most((0..self.kept()).filter_map(of_known))
    }

    /// The longest way of a point on any axis, m.
    #[inline(always)]
    fn way_m(&self, at: usize, points_m: &[[f32; 3]]) -> f32 {
        let was_m = points_m.get(self.ids[at] as usize).copied().unwrap_or([f32::NAN; 3]);
        let is_m = self.position(at);
        most([0, 1, 2].into_iter().map(|axis| is_m[axis] - was_m[axis]))
    }

    /// Lowest and highest corner of the box around the points of these sorted places; the lowest is above the highest where there are none.
    #[inline(always)]
    pub(crate) fn around(&self, (from, to): (usize, usize)) -> ([f32; 3], [f32; 3]) {
        /// Accumulators, so that no comparison waits for the one before.
        const WIDE: usize = 16;
        let (mut lo, mut hi) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for axis in 0..3 {
            let (mut least, mut most) = ([f32::INFINITY; WIDE], [f32::NEG_INFINITY; WIDE]);
            let (chunks, rest) = self.xyz[axis][from..to].as_chunks::<WIDE>();
            for chunk in chunks {
                for l in 0..WIDE {
                    least[l] = min(least[l], chunk[l]);
                    most[l] = max(most[l], chunk[l]);
                }
            }
            lo[axis] = least.iter().chain(rest).fold(f32::INFINITY, |least, &v| min(least, v));
            hi[axis] = most.iter().chain(rest).fold(f32::NEG_INFINITY, |most, &v| max(most, v));
        }
        (lo, hi)
    }

    /// Index of the point at a sorted place.
    #[inline(always)]
    pub(crate) fn id(&self, at: usize) -> u32 {
        self.ids[at]
    }

    /// Position of the point at a sorted place, metres.
    #[inline(always)]
    pub(crate) fn position(&self, at: usize) -> [f32; 3] {
        self.xyz.map(|axis| axis[at])
    }

    /// Coordinates of `LANES` sorted points from `at` on; `at` must be below [`HashRef::kept`].
    #[inline(always)]
    pub(crate) fn lanes(&self, at: usize) -> [&[f32; LANES]; 3] {
        self.xyz.map(|axis| axis[at..].first_chunk().unwrap_or(&[f32::NAN; LANES]))
    }

    /// Cells of the corners of some boxes, clipped to the occupied ones; first beyond last where a box meets none.
    #[inline(always)]
    pub(crate) fn cells<const N: usize>(&self, lo: &[[f32; N]; 3], hi: &[[f32; N]; 3]) -> ([[i32; N]; 3], [[i32; N]; 3]) {
        let (mut first, mut last) = ([[0; N]; 3], [[0; N]; 3]);
        for axis in 0..3 {
            let origin = self.header.origin[axis];
            let end = origin.wrapping_add(self.header.dims[axis] as i32).wrapping_sub(1);
            for l in 0..N {
                first[axis][l] = cell_of(lo[axis][l], self.header.per_m).max(origin);
                last[axis][l] = cell_of(hi[axis][l], self.header.per_m).min(end);
            }
        }
        (first, last)
    }

    /// Calls `run(from, to)` for ranges of sorted places that together hold each point of a box once, and points outside of it too; the box is given by
    /// the clipped cells of its corners ([`HashRef::cells`]). Ends after a bounded number of cells, whatever the box.
    #[inline(always)]
    pub(crate) fn for_runs_in(&self, first: [i32; 3], last: [i32; 3], mut run: impl FnMut(usize, usize)) {
        /// More cells than this, and reading all points costs less.
        const MAX_CELLS: u64 = 96;
        let mut cells = 1u64;
        for axis in 0..3 {
            if first[axis] > last[axis] {
                return;
            }
            cells = cells.saturating_mul((last[axis].wrapping_sub(first[axis]) as u64).wrapping_add(1));
        }
        if self.header.hashed == 0 {
            let [row, layer] =
                [self.header.dims[0], self.header.dims[0].wrapping_mul(self.header.dims[1])].map(|slots| slots as usize);
            let many = |axis: usize| (last[axis].wrapping_sub(first[axis]) as usize).wrapping_add(1);
            let mut of_layer = self.header.slot(first) as usize;
            for _ in 0..many(2) {
                let mut from = of_layer;
                for _ in 0..many(1) {
                    run(self.starts[from] as usize, self.starts[from.wrapping_add(many(0))] as usize);
                    from = from.wrapping_add(row);
                }
                of_layer = of_layer.wrapping_add(layer);
            }
        } else if cells > MAX_CELLS {
            run(0, self.kept());
        } else {
            let mut seen = [usize::MAX; MAX_CELLS as usize];
            let mut known = 0;
            for k in first[2]..=last[2] {
                for j in first[1]..=last[1] {
                    for i in first[0]..=last[0] {
                        let slot = hash_cell([i, j, k], self.header.slots);
                        if self.starts[slot] == self.starts[slot + 1] || seen[..known].contains(&slot) {
                            continue;
                        }
                        seen[known] = slot;
                        known += 1;
                        run(self.starts[slot] as usize, self.starts[slot + 1] as usize);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hash::{HashMut, Layout};

    #[test]
    fn a_table_is_the_same_however_it_is_read_in_the_process_that_built_it() {
        let points_m: Vec<[f32; 3]> = (0..57u8).map(|at| [f32::from(at % 7), f32::from(at % 5), f32::from(at) * 0.3]).collect();
        for layout in [Layout::Auto, Layout::Hashed] {
            let sizes = HashSizes::for_points(60);
            let mut words = vec![7; sizes.words() + 3];
            let mut table = HashMut::in_words(&mut words, sizes).unwrap();
            table.build(&points_m, 1.0, layout).unwrap();
            let all = |table: HashRef<'_>| {
                let places: Vec<u32> = table.xyz.concat().iter().map(|v| v.to_bits()).collect();
                (bytemuck::bytes_of(&table.header).to_vec(), [table.starts, table.ids].concat(), places)
            };
            let built = all(table.as_ref());
            assert!(all(HashRef::in_own_words(&words).unwrap()) == built && all(HashRef::in_words(&words).unwrap()) == built);
            let moved: Vec<[f32; 3]> = points_m.iter().map(|[x, y, z]| [*x, *y, z + 0.1]).collect();
            let is_of = |points_m: &[[f32; 3]]| HashRef::in_words(&words).unwrap().is_of(points_m);
            assert!(is_of(&points_m) && !is_of(&moved) && !is_of(&points_m[1..]) && !is_of(&[]));
            // What leaves every point where it is, and hides it or its neighbours: a cell of another size, a box or a slot that it is not in.
            for word in [6, 7, 8, 9, 10, 11, 12, HEADER_WORDS + 1] {
                let mut damaged = words.clone();
                damaged[word] = if word == 6 { 0.5f32.to_bits() } else { damaged[word] ^ 1 };
                let is_taken = HashRef::in_words(&damaged).is_ok_and(|table| table.is_of(&points_m));
                assert!(!is_taken || damaged == words, "word {word}, {layout:?}");
            }
            words[HEADER_WORDS + 1] = u32::MAX;
            assert!(HashRef::in_words(&words).is_err(), "what another process wrote is looked at");
            assert!(HashRef::in_own_words(&words[..sizes.words() - 1]).is_err());
        }
    }
}
