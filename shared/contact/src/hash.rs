//! The spatial hash of the points (Teschner et al. 2003), flat and in place in the caller's words.
//!
//! The points are sorted by cell (a counting sort), each coordinate in an array of its own, so that the points of a cell lie
//! side by side for the lanes of the test. A slot of the table belongs to a cell by position while the cells' box fits into the
//! table ([`Layout::Auto`]), else by the paper's h(i,j,k) = (i·73856093 ⊕ j·19349663 ⊕ k·83492791) mod n. Which of the two
//! changes the speed, never the result. Points that are not finite are left out.
//! The words hold no pointer: another process reads them where they lie, after [`HashRef::in_words`] has checked them.

use crate::ContactError;
use crate::hash_read::HashRef;
use crate::tet::{max, min};
use bytemuck::{Pod, Zeroable};

/// Points that are tested at once: one register of AVX2, half a register of AVX-512.
pub const LANES: usize = 8;

pub(crate) const MAGIC: u32 = 0x4853_4831;
pub(crate) const HEADER_WORDS: usize = 16;
/// Cells are clamped here, far outside any scene, so that [`cell_of`] is exact.
pub(crate) const CELL_LIMIT: i32 = 4_000_000;
/// Mark of a point that is left out.
const OUT: u32 = u32::MAX;

/// Which slot a cell has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// By position where the cells' box fits into the table, else by the hash function.
    Auto,
    /// Always by the hash function.
    Hashed,
}

/// First words of the table.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
pub(crate) struct Header {
    pub magic: u32,
    pub hashed: u32,
    pub capacity: u32,
    pub slots: u32,
    pub points: u32,
    pub kept: u32,
    pub per_m: f32,
    pub origin: [i32; 3],
    pub dims: [u32; 3],
    pub spare: [u32; 3],
}

/// Sizes of a table for a bounded number of points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HashSizes {
    /// Points that fit.
    pub points: usize,
    /// Slots of the table, n in the hash function.
    pub slots: usize,
}

impl HashSizes {
    /// Four slots for each point, at least 1 024: short chains, and most tools fit by position.
    pub fn for_points(points: usize) -> HashSizes {
        HashSizes { points, slots: (points.saturating_mul(4).max(1024) | 1).min(i32::MAX as usize) }
    }

    /// Length of each array of the sorted points: whole lanes, plus one so that a load may start anywhere.
    pub(crate) fn padded(self) -> usize {
        self.points.div_ceil(LANES) * LANES + LANES
    }

    /// Number of 32-bit words that the table takes.
    pub fn words(self) -> usize {
        HEADER_WORDS + self.slots + 1 + 5 * self.padded()
    }
}

/// The cell that a coordinate lies in. Monotone, so the cells of a box's corners bound the cells of its points.
#[inline(always)]
pub(crate) fn cell_of(v: f32, per_m: f32) -> i32 {
    /// One and a half times 2²³: added to an integer below 2²² it has that in its last bits, plain or in two's complement. A conversion would have to ask
    /// of each number whether it is one, and so is not made in lanes.
    const SHIFT: f32 = 12_582_912.0;
    let cell = max(min((v * per_m).floor(), CELL_LIMIT as f32), -CELL_LIMIT as f32);
    (cell + SHIFT).to_bits().wrapping_sub(SHIFT.to_bits()) as i32
}

/// The paper's hash function, modulo Euclidean because cells are negative too.
#[inline(always)]
pub(crate) fn hash_cell(cell: [i32; 3], slots: u32) -> usize {
    let h = cell[0].wrapping_mul(73_856_093) ^ cell[1].wrapping_mul(19_349_663) ^ cell[2].wrapping_mul(83_492_791);
    i64::from(h).rem_euclid(i64::from(slots)) as usize
}

/// Points of which the slots are found at once.
pub(crate) const POINTS: usize = 16;

impl Header {
    /// The slot of a cell inside the occupied box, where slots belong to cells by position.
    #[inline(always)]
    pub(crate) fn slot(&self, cell: [i32; 3]) -> u32 {
        let [i, j, k] = [0, 1, 2].map(|axis| cell[axis].wrapping_sub(self.origin[axis]) as u32);
        let row = k.wrapping_mul(self.dims[1]).wrapping_add(j);
        row.wrapping_mul(self.dims[0]).wrapping_add(i)
    }

    /// The cells of some points along each axis, and 1 for each that is finite, else 0.
    #[inline(always)]
    pub(crate) fn cells_of(&self, points_m: &[[f32; 3]; POINTS]) -> ([[i32; POINTS]; 3], [u32; POINTS]) {
        let mut x = [[0f32; POINTS]; 3];
        for (l, point_m) in points_m.iter().enumerate() {
            for (axis, x) in x.iter_mut().enumerate() {
                x[l] = point_m[axis];
            }
        }
        let mut cells = [[0i32; POINTS]; 3];
        let mut is_finite = [1u32; POINTS];
        for (x, cells) in x.iter().zip(&mut cells) {
            for l in 0..POINTS {
                cells[l] = cell_of(x[l], self.per_m);
                is_finite[l] &= u32::from(x[l].abs() < f32::INFINITY);
            }
        }
        (cells, is_finite)
    }

    /// The slots of some points by their cells; [`OUT`] for one that is not finite, and beyond the last.
    #[inline(always)]
    pub(crate) fn slots_of(&self, cells: &[[i32; POINTS]; 3], is_finite: &[u32; POINTS]) -> [u32; POINTS] {
        let mut slots = [OUT; POINTS];
        if self.hashed == 0 {
            for l in 0..POINTS {
                let slot = self.slot([cells[0][l], cells[1][l], cells[2][l]]);
                slots[l] = if is_finite[l] != 0 { slot } else { OUT };
            }
        } else {
            for l in (0..POINTS).filter(|l| is_finite[*l] != 0) {
                slots[l] = hash_cell([cells[0][l], cells[1][l], cells[2][l]], self.slots) as u32;
            }
        }
        slots
    }

    /// Whether all of some cells are in the occupied box.
    #[inline(always)]
    pub(crate) fn has_all(&self, cells: &[[i32; POINTS]; 3]) -> bool {
        let mut has = true;
        for (cells, (origin, &dim)) in cells.iter().zip(self.origin.iter().zip(&self.dims)) {
            for cell in cells {
                has &= (cell.wrapping_sub(*origin) as u32) < dim;
            }
        }
        has
    }
}

/// A table to be filled, in place in the caller's words.
#[derive(Debug)]
pub struct HashMut<'a> {
    sizes: HashSizes,
    header: &'a mut Header,
    starts: &'a mut [u32],
    ids: &'a mut [u32],
    xyz: [&'a mut [f32]; 3],
    /// Slot of each point while the table is filled.
    slot_of: &'a mut [u32],
}

impl<'a> HashMut<'a> {
    /// Takes the first [`HashSizes::words`] of the words for the table; what they held does not matter.
    ///
    /// # Errors
    /// [`ContactError::Words`] if they are too few.
    pub fn in_words(words: &'a mut [u32], sizes: HashSizes) -> Result<HashMut<'a>, ContactError> {
        let need = sizes.words();
        let have = words.len();
        let words = words.get_mut(..need).ok_or(ContactError::Words { have, need })?;
        let (header, rest) = words.split_at_mut(HEADER_WORDS);
        let (starts, rest) = rest.split_at_mut(sizes.slots + 1);
        let (ids, rest) = rest.split_at_mut(sizes.padded());
        let (x, rest) = rest.split_at_mut(sizes.padded());
        let (y, rest) = rest.split_at_mut(sizes.padded());
        let (z, slot_of) = rest.split_at_mut(sizes.padded());
        let xyz = [x, y, z].map(bytemuck::cast_slice_mut);
        Ok(HashMut { sizes, header: bytemuck::from_bytes_mut(bytemuck::cast_slice_mut(header)), starts, ids, xyz, slot_of })
    }

    /// Hashes the points with cells of edge `cell_m` (about the mean edge of the tets). Every word of the table is written.
    ///
    /// # Errors
    /// [`ContactError::Cell`] for an edge that is no length, [`ContactError::Capacity`] for too many points.
    pub fn build(&mut self, points_m: &[[f32; 3]], cell_m: f32, layout: Layout) -> Result<(), ContactError> {
        let per_m = 1.0 / cell_m;
        if !(cell_m > 0.0 && per_m > 0.0 && per_m.is_finite()) {
            return Err(ContactError::Cell { cell_m });
        }
        if points_m.len() > self.sizes.points {
            return Err(ContactError::Capacity { points: points_m.len(), capacity: self.sizes.points });
        }
        pulp::Arch::new().dispatch(Fill { table: self, points_m, per_m, layout });
        Ok(())
    }

    #[inline(always)]
    fn fill(&mut self, points_m: &[[f32; 3]], per_m: f32, layout: Layout) {
        let (lo, hi) = bounds(points_m);
        let is_empty = lo.iter().zip(&hi).any(|(lo, hi)| lo > hi);
        let (first, last) = (lo.map(|v| cell_of(v, per_m)), hi.map(|v| cell_of(v, per_m)));
        let dims: [u32; 3] = std::array::from_fn(|a| if is_empty { 0 } else { (last[a] - first[a] + 1) as u32 });
        let cells = dims.iter().fold(1u128, |n, &d| n * u128::from(d));
        let fits = layout == Layout::Auto && cells <= self.sizes.slots as u128;
        let mut header = Header {
            magic: MAGIC,
            hashed: u32::from(!fits),
            capacity: self.sizes.points as u32,
            slots: self.sizes.slots as u32,
            points: points_m.len() as u32,
            kept: 0,
            per_m,
            origin: if is_empty { [0; 3] } else { first },
            dims,
            spare: [0; 3],
        };
        let used = if fits { cells as usize } else { self.sizes.slots };
        let starts = &mut self.starts[..used];
        starts.fill(0);
        let mut last = [[f32::NAN; 3]; POINTS];
        let (chunks, rest) = points_m.as_chunks::<POINTS>();
        last[..rest.len()].copy_from_slice(rest);
        for (points_m, slots) in chunks.iter().chain([&last]).zip(self.slot_of.chunks_mut(POINTS)) {
            let (cells, is_finite) = header.cells_of(points_m);
            for (slot, found) in slots.iter_mut().zip(header.slots_of(&cells, &is_finite)) {
                *slot = found;
                if found != OUT {
                    starts[found as usize] = starts[found as usize].wrapping_add(1);
                    header.kept = header.kept.wrapping_add(1);
                }
            }
        }
        let mut sum = 0u32;
        for s in starts.iter_mut() {
            (*s, sum) = (sum, sum.wrapping_add(*s));
        }
        for (id, (p, &slot)) in points_m.iter().zip(self.slot_of.iter()).enumerate() {
            if slot == OUT {
                continue;
            }
            let start = &mut starts[slot as usize];
            let at = *start as usize;
            *start = start.wrapping_add(1);
            self.ids[at] = id as u32;
            for (axis, v) in self.xyz.iter_mut().zip(p) {
                axis[at] = *v;
            }
        }
        let kept = header.kept as usize;
        self.starts.copy_within(0..used, 1);
        self.starts[0] = 0;
        self.starts[used + 1..].fill(header.kept);
        for axis in &mut self.xyz {
            axis[kept..].fill(f32::NAN);
        }
        self.ids[kept..].fill(0);
        self.slot_of[points_m.len()..].fill(OUT);
        *self.header = header;
    }

    /// The filled table, for reading in the same process.
    pub fn as_ref(&self) -> HashRef<'_> {
        let [x, y, z] = &self.xyz;
        HashRef { header: *self.header, starts: self.starts, ids: self.ids, xyz: [x, y, z] }
    }
}

/// The filling, to be compiled for each instruction set.
struct Fill<'a, 't> {
    table: &'t mut HashMut<'a>,
    points_m: &'t [[f32; 3]],
    per_m: f32,
    layout: Layout,
}

impl pulp::WithSimd for Fill<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        self.table.fill(self.points_m, self.per_m, self.layout);
    }
}

/// Box of the numbers of each axis that are finite; the lowest corner is above the highest where there are none.
#[inline(always)]
fn bounds(points_m: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    /// Numbers that are looked at at once, of whole points.
    const WIDE: usize = 48;
    let (mut least, mut most) = ([f32::INFINITY; WIDE], [f32::NEG_INFINITY; WIDE]);
    let (chunks, rest) = points_m.as_flattened().as_chunks::<WIDE>();
    let mut last = [f32::NAN; WIDE];
    last[..rest.len()].copy_from_slice(rest);
    for chunk in chunks.iter().chain([&last]) {
        for (l, &v) in chunk.iter().enumerate() {
            let is_number = v.abs() < f32::INFINITY;
            least[l] = if is_number & (v < least[l]) { v } else { least[l] };
            most[l] = if is_number & (v > most[l]) { v } else { most[l] };
        }
    }
    let of = |axis: usize, all: &[f32; WIDE], choose: fn(f32, f32) -> f32| {
        all.iter().skip(axis).step_by(3).fold(all[axis], |found, &v| choose(found, v))
    };
    (std::array::from_fn(|axis| of(axis, &least, min)), std::array::from_fn(|axis| of(axis, &most, max)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_is_the_next_integer_below_up_to_the_limits() {
        let limit = CELL_LIMIT as f32;
        for cell in [0, 1, 2, 3, 1_000, CELL_LIMIT / 2, CELL_LIMIT - 1] {
            for beside in [0.0f32, 0.25, 0.5, 0.75] {
                for v in [cell as f32 + beside, -(cell as f32 + beside)] {
                    assert_eq!(cell_of(v, 1.0), v.floor() as i32, "{v}");
                    assert_eq!(cell_of(0.5 * v, 2.0), v.floor() as i32, "{v}");
                }
            }
        }
        assert_eq!([-0.0, 1e-40, -1e-40].map(|v| cell_of(v, 1.0)), [0, 0, -1]);
        for v in [limit, limit + 1.0, 1e30, f32::MAX, f32::INFINITY] {
            assert_eq!([v, -v].map(|v| cell_of(v, 1.0)), [CELL_LIMIT, -CELL_LIMIT], "{v}");
        }
        assert_eq!(cell_of(f32::NAN, 1.0), CELL_LIMIT);
    }
}
