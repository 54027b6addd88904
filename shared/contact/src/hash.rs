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
/// Cells are clamped here, far outside any scene, so that differences of cells fit into 32 bits.
const CELL_LIMIT: f32 = 500_000_000.0;
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
    max(min((v * per_m).floor(), CELL_LIMIT), -CELL_LIMIT) as i32
}

/// The paper's hash function, modulo Euclidean because cells are negative too.
#[inline(always)]
pub(crate) fn hash_cell(cell: [i32; 3], slots: u32) -> usize {
    let h = cell[0].wrapping_mul(73_856_093) ^ cell[1].wrapping_mul(19_349_663) ^ cell[2].wrapping_mul(83_492_791);
    i64::from(h).rem_euclid(i64::from(slots)) as usize
}

impl Header {
    #[inline(always)]
    pub(crate) fn cell(&self, p: [f32; 3]) -> [i32; 3] {
        p.map(|v| cell_of(v, self.per_m))
    }

    /// The slot of a cell inside the occupied box.
    #[inline(always)]
    pub(crate) fn slot(&self, cell: [i32; 3]) -> usize {
        if self.hashed != 0 {
            return hash_cell(cell, self.slots);
        }
        let [i, j, k] = [0, 1, 2].map(|a| cell[a].wrapping_sub(self.origin[a]) as u32 as usize);
        let row = k.wrapping_mul(self.dims[1] as usize).wrapping_add(j);
        row.wrapping_mul(self.dims[0] as usize).wrapping_add(i)
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
        let (lo, hi, kept) = bounds(points_m);
        let (first, last) = (lo.map(|v| cell_of(v, per_m)), hi.map(|v| cell_of(v, per_m)));
        let dims: [u32; 3] = std::array::from_fn(|a| if kept == 0 { 0 } else { (last[a] - first[a] + 1) as u32 });
        let cells = dims.iter().fold(1u128, |n, &d| n * u128::from(d));
        let fits = layout == Layout::Auto && cells <= self.sizes.slots as u128;
        *self.header = Header {
            magic: MAGIC,
            hashed: u32::from(!fits),
            capacity: self.sizes.points as u32,
            slots: self.sizes.slots as u32,
            points: points_m.len() as u32,
            kept,
            per_m,
            origin: first,
            dims,
            spare: [0; 3],
        };
        let header = *self.header;
        self.starts.fill(0);
        for (p, slot) in points_m.iter().zip(self.slot_of.iter_mut()) {
            *slot = OUT;
            if finite(p) {
                let s = header.slot(header.cell(*p));
                *slot = s as u32;
                self.starts[s] = self.starts[s].wrapping_add(1);
            }
        }
        let mut sum = 0u32;
        for s in self.starts.iter_mut() {
            (*s, sum) = (sum, sum.wrapping_add(*s));
        }
        for (id, (p, &slot)) in points_m.iter().zip(self.slot_of.iter()).enumerate() {
            if slot == OUT {
                continue;
            }
            let start = &mut self.starts[slot as usize];
            let at = *start as usize;
            *start = start.wrapping_add(1);
            self.ids[at] = id as u32;
            for (axis, v) in self.xyz.iter_mut().zip(p) {
                axis[at] = *v;
            }
        }
        let slots = self.sizes.slots;
        self.starts.copy_within(0..slots, 1);
        self.starts[0] = 0;
        for axis in &mut self.xyz {
            axis[kept as usize..].fill(f32::NAN);
        }
        self.ids[kept as usize..].fill(0);
        self.slot_of[points_m.len()..].fill(OUT);
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

#[inline(always)]
fn finite(p: &[f32; 3]) -> bool {
    p[0].is_finite() & p[1].is_finite() & p[2].is_finite()
}

/// Box and number of the finite points.
#[inline(always)]
fn bounds(points_m: &[[f32; 3]]) -> ([f32; 3], [f32; 3], u32) {
    let (mut lo, mut hi, mut kept) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3], 0u32);
    for p in points_m.iter().filter(|p| finite(p)) {
        kept = kept.wrapping_add(1);
        for a in 0..3 {
            lo[a] = min(lo[a], p[a]);
            hi[a] = max(hi[a], p[a]);
        }
    }
    (lo, hi, kept)
}
