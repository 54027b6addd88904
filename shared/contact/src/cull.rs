//! Which tets come near any point at all. Each node is told once on which sides of a few boxes around the points it lies (outcodes, as of Cohen and
//! Sutherland), and a tet of which all corners lie beyond the same side of each box is left out: its own box meets none of them. A node belongs to some
//! twenty tets, so that this costs a small part of looking at each tet's box.

use crate::hash_read::HashRef;
use crate::types::Tissue;

/// Boxes around the points.
const BOXES: usize = 5;
/// Sides of a box.
const SIDES: usize = 6;
/// Nodes that are told at once.
const NODES: usize = 16;
/// The highest bit of each box in a code, and all its others.
const HIGH: u32 = fields(1 << (SIDES - 1));
const LOW: u32 = fields((1 << (SIDES - 1)) - 1);

/// The same bits for each box.
const fn fields(bits: u32) -> u32 {
    let (mut all, mut at) = (0, 0);
    while at < BOXES {
        all |= bits << (at * SIDES);
        at += 1;
    }
    all
}

/// Where the nodes lie beside the points; sized once.
#[derive(Debug, Default)]
pub struct Cull {
    codes: Vec<u32>,
}

impl Cull {
    /// With room for so many nodes; it grows with tissue of more.
    pub fn for_nodes(nodes: usize) -> Cull {
        Cull { codes: Vec::with_capacity(nodes) }
    }

    /// Tells each node where it lies beside the points of these sorted places.
    #[inline(always)]
    pub(crate) fn tell(&mut self, tissue: &Tissue<'_>, hash: &HashRef<'_>, (from, to): (usize, usize)) {
        let boxes: [_; BOXES] = std::array::from_fn(|at| {
            // Places are sorted by cells, layer by layer, so that those of a part lie together.
            let place = |at: usize| from.wrapping_add(to.wrapping_sub(from).wrapping_mul(at) / BOXES);
            hash.around((place(at), place(at.wrapping_add(1))))
        });
        self.codes.clear();
        self.codes.resize(tissue.positions_m.len(), 0);
        let (positions_m, codes) = (tissue.positions_m.chunks(NODES), self.codes.chunks_mut(NODES));
        for (positions_m, codes) in positions_m.zip(codes) {
            let mut x = [[f32::NAN; NODES]; 3];
            for (l, position_m) in positions_m.iter().enumerate() {
                for (axis, x) in x.iter_mut().enumerate() {
                    x[l] = position_m[axis];
                }
            }
            let mut all = [0u32; NODES];
            for (at, (lo, hi)) in boxes.iter().enumerate() {
                for (axis, x) in x.iter().enumerate() {
                    mark(&mut all, x, (lo[axis], hi[axis]), 1 << (at * SIDES + 2 * axis));
                }
            }
            codes.copy_from_slice(&all[..codes.len()]);
        }
    }

    /// Whether the box of a tet meets one of those around the points; true too where one of its corners is no number, or does not exist.
    #[inline(always)]
    pub(crate) fn is_near(&self, tet: &[u32; 4]) -> bool {
        let code = |node: u32| self.codes.get(node as usize).copied().unwrap_or(0);
        let beyond = code(tet[0]) & code(tet[1]) & code(tet[2]) & code(tet[3]);
        // The highest bit of each box in which any bit is set.
        (((beyond & LOW).wrapping_add(LOW)) | beyond) & HIGH != HIGH
    }
}

/// Marks the nodes below a range by a bit, and those above it by the next.
#[inline(always)]
fn mark(codes: &mut [u32; NODES], x: &[f32; NODES], (lo, hi): (f32, f32), below: u32) {
    for (code, &x) in codes.iter_mut().zip(x) {
        *code |= if x < lo { below } else { 0 } | if x > hi { below << 1 } else { 0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hash::{HashMut, HashSizes, Layout};

    #[test]
    fn a_tet_is_near_where_its_box_meets_a_box_of_points() {
        // One layer of cells for each box of points: ten points on the diagonal, in pairs.
        let points_m: Vec<[f32; 3]> = (0..10u8).map(|at| [f32::from(at) + 0.5; 3]).collect();
        let sizes = HashSizes::for_points(600);
        let mut words = vec![0; sizes.words()];
        let mut table = HashMut::in_words(&mut words, sizes).unwrap();
        table.build(&points_m, 1.0, Layout::Auto).unwrap();
        let near = |lo: [f32; 3], hi: [f32; 3]| {
            let positions_m = [lo, [hi[0], lo[1], lo[2]], [lo[0], hi[1], lo[2]], [lo[0], lo[1], hi[2]], [f32::NAN; 3]];
            let tissue = Tissue { positions_m: &positions_m, tets: &[], tet_owner: &[] };
            let mut cull = Cull::default();
            cull.tell(&tissue, &table.as_ref(), (0, 10));
            [cull.is_near(&[0, 1, 2, 3]), cull.is_near(&[0, 1, 2, 4]), cull.is_near(&[0, 1, 2, 9])]
        };
        assert_eq!(near([0.0; 3], [10.0; 3]), [true; 3]);
        assert_eq!(near([0.6; 3], [0.7; 3]), [true; 3], "inside of the first");
        assert_eq!(near([1.5; 3], [1.9; 3]), [true; 3], "it touches the first with a corner");
        assert!(!near([1.6; 3], [2.4; 3])[0], "between two");
        assert!(!near([6.6, 6.6, 0.6], [7.4, 7.4, 1.4])[0], "beside all of them");
        assert!(!near([-3.0, 4.0, 4.0], [-2.0, 5.0, 5.0])[0]);
        assert!(!near([9.7; 3], [20.0; 3])[0], "beyond the last");
    }

    #[test]
    fn without_points_nothing_is_near() {
        let sizes = HashSizes::for_points(4);
        let mut words = vec![0; sizes.words()];
        let mut table = HashMut::in_words(&mut words, sizes).unwrap();
        table.build(&[], 1.0, Layout::Auto).unwrap();
        let positions_m = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let mut cull = Cull::for_nodes(4);
        cull.tell(&Tissue { positions_m: &positions_m, tets: &[], tet_owner: &[] }, &table.as_ref(), (0, 0));
        assert!(!cull.is_near(&[0, 1, 2, 3]));
    }
}
