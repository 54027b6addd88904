//! Which tets come near any point at all. Each node is told once on which sides of a few boxes around the points it lies (outcodes, as of Cohen and
//! Sutherland), and a tet of which all corners lie beyond the same side of each box is left out: its own box meets none of them. A node belongs to some
//! twenty tets, so that this costs a small part of looking at each tet's box.

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

/// The lowest and the highest corner of boxes around points, m; the lowest is above the highest where there are none.
pub(crate) type Around = [([f32; 3], [f32; 3]); BOXES];

/// Boxes around so many sorted places, grown by so much on each side, m. Places are sorted by cells, layer by layer, so that those of a part lie together.
#[inline(always)]
pub(crate) fn around((from, to): (usize, usize), grown_m: f32, of: impl Fn((usize, usize)) -> ([f32; 3], [f32; 3])) -> Around {
    let place = |at: usize| from.wrapping_add(to.wrapping_sub(from).wrapping_mul(at) / BOXES);
    std::array::from_fn(|at| {
        let (lo, hi) = of((place(at), place(at.wrapping_add(1))));
        (lo.map(|lo| lo - grown_m), hi.map(|hi| hi + grown_m))
    })
}

/// Where the nodes lie beside the points; sized once.
#[derive(Debug, Default)]
pub(crate) struct Outcodes {
    codes: Vec<u32>,
}

impl Outcodes {
    /// With room for so many nodes; it grows with tissue of more.
    pub fn for_nodes(nodes: usize) -> Outcodes {
        Outcodes { codes: Vec::with_capacity(nodes) }
    }

    /// Tells each node where it lies beside some boxes.
    #[inline(always)]
    pub fn tell(&mut self, tissue: &Tissue<'_>, boxes: &Around) {
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
    pub fn is_near(&self, tet: &[u32; 4]) -> bool {
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
        let near_grown = |lo: [f32; 3], hi: [f32; 3], grown: f32| {
            let positions_m = [lo, [hi[0], lo[1], lo[2]], [lo[0], hi[1], lo[2]], [lo[0], lo[1], hi[2]], [f32::NAN; 3]];
            let tissue = Tissue { positions_m: &positions_m, tets: &[], tet_owner: &[] };
            let mut outcodes = Outcodes::default();
            let table = table.as_ref();
            outcodes.tell(&tissue, &around((0, 10), grown, |places| table.around(places)));
            [[0, 1, 2, 3], [0, 1, 2, 4], [0, 1, 2, 9]].map(|tet| outcodes.is_near(&tet))
        };
        let near = |lo: [f32; 3], hi: [f32; 3]| near_grown(lo, hi, 0.0);
        assert_eq!(near([0.0; 3], [10.0; 3]), [true; 3]);
        assert_eq!(near([0.6; 3], [0.7; 3]), [true; 3], "inside of the first");
        assert_eq!(near([1.5; 3], [1.9; 3]), [true; 3], "it touches the first with a corner");
        assert!(!near([1.6; 3], [2.4; 3])[0], "between two");
        assert!(!near([6.6, 6.6, 0.6], [7.4, 7.4, 1.4])[0], "beside all of them");
        assert!(!near([-3.0, 4.0, 4.0], [-2.0, 5.0, 5.0])[0]);
        assert!(!near([9.7; 3], [20.0; 3])[0], "beyond the last");
        assert!(
            near_grown([9.7; 3], [20.0; 3], 0.3)[0] && near_grown([1.6; 3], [2.4; 3], 0.2)[0],
            "boxes that are grown reach further"
        );
        assert!(!near_grown([9.7; 3], [20.0; 3], 0.1)[0]);
    }

    #[test]
    fn without_points_nothing_is_near() {
        let sizes = HashSizes::for_points(4);
        let mut words = vec![0; sizes.words()];
        let mut table = HashMut::in_words(&mut words, sizes).unwrap();
        table.build(&[], 1.0, Layout::Auto).unwrap();
        let positions_m = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let mut outcodes = Outcodes::for_nodes(4);
        let table = table.as_ref();
        let boxes = around((0, 0), 0.0, |places| table.around(places));
        outcodes.tell(&Tissue { positions_m: &positions_m, tets: &[], tet_owner: &[] }, &boxes);
        assert!(!outcodes.is_near(&[0, 1, 2, 3]));
    }
}
