//! Which tets have a face in common.

use super::places::sorted;
use hyst_mesh::FACES;

/// No tet, no face.
pub const NONE: u32 = u32::MAX;

/// A face that was met.
struct Met {
    /// In their order.
    nodes: [u32; 3],
    /// How many tets have it.
    tets: u32,
    /// The first and the last place where it was met (4 × tet + face).
    first: u32,
    last: u32,
    /// The face of the same slot that was met before it, or none.
    before: u32,
}

/// For each tet the others that have a face with it alone.
pub fn joined(tets: &[[u32; 4]]) -> Vec<[u32; 4]> {
    // By a hash of all three nodes: in a list for each lowest one most faces would be compared with some others first. It decides about nothing but time.
    let slots = (4 * tets.len()).next_power_of_two().max(2);
    let shift = u64::BITS - slots.trailing_zeros();
    let mut last_at: Vec<u32> = vec![NONE; slots];
    let mut faces: Vec<Met> = Vec::with_capacity(3 * tets.len());
    for (index, nodes) in (0..).zip(tets) {
        // By reference: a list of lists that is gone through by value is copied twice for each of them.
        for (face, [a, b, c]) in (0..).zip(&FACES) {
            let nodes = sorted([nodes[*a], nodes[*b], nodes[*c]]);
            let place: u32 = 4 * index + face;
            let last = &mut last_at[(mixed(nodes) >> shift) as usize];
            let mut met = *last;
            while met != NONE && faces[met as usize].nodes != nodes {
                met = faces[met as usize].before;
            }
            if met != NONE {
                let same = &mut faces[met as usize];
                (same.tets, same.last) = (same.tets + 1, place);
                continue;
            }
            let before = std::mem::replace(last, faces.len() as u32);
            faces.push(Met { nodes, tets: 1, first: place, last: place, before });
        }
    }
    let mut joined = vec![[NONE; 4]; tets.len()];
    for Met { first, last, .. } in faces.into_iter().filter(|face| face.tets == 2) {
        joined[first as usize / 4][first as usize % 4] = last / 4;
        joined[last as usize / 4][last as usize % 4] = first / 4;
    }
    joined
}

/// A hash of three nodes, in its highest bits.
fn mixed([a, b, c]: [u32; 3]) -> u64 {
    let [a, b, c] = [a, b, c].map(u64::from);
    let sum = a.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(b.wrapping_mul(0xD1B5_4A32_D192_ED03));
    sum.wrapping_add(c.wrapping_mul(0xA076_1D64_78BD_642F))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tets_are_joined_that_have_a_face_alone_whatever_their_order_and_however_many_there_are() {
        // Rows of tets of which each has a face in common with the next, of so many nodes that slots are taken by chance; a third one at a face joins nobody.
        for count in [0, 1, 2, 500_u32] {
            let row = (0..count).map(|first| [first, first + 1, first + 2, first + 3]);
            let tets: Vec<[u32; 4]> = row.map(|[a, b, c, d]| if a % 2 == 0 { [a, b, c, d] } else { [d, b, a, c] }).collect();
            for (index, others) in (0..count).zip(joined(&tets)) {
                let mut others: Vec<u32> = others.into_iter().filter(|other| *other != NONE).collect();
                others.sort_unstable();
                let expected: Vec<u32> = (0..count).filter(|other| index.abs_diff(*other) == 1).collect();
                assert_eq!(others, expected, "tet {index} of {count}");
            }
        }
        let three = [[0, 1, 2, 3], [4, 2, 1, 0], [0, 2, 1, 5]];
        assert_eq!(joined(&three), [[NONE; 4]; 3]);
        assert_eq!(joined(&three[..2]), [[NONE, NONE, NONE, 1], [0, NONE, NONE, NONE]]);
    }
}
