//! Topologies of one mesh after the other. A cut changes some tens of tets: all others keep what lies behind their faces, and only faces whose nodes all belong
//! to tets that are new or gone are looked up.

use super::{NONE, Topology, exists};
use crate::ContactError;
use crate::error::same_length;

/// Makes topologies, and keeps what it takes to find what is another one in the next.
///
/// Promise: each is that of its mesh to the last bit, whatever was made before.
#[derive(Debug, Clone, Default)]
pub struct TopologyMaker {
    /// The mesh before.
    tets: Vec<[u32; 4]>,
    tet_owner: Vec<u32>,
    nodes: usize,
    /// The tet behind each of its faces.
    neighbours: Vec<[u32; 4]>,
    /// Whether a node is a corner of a tet that is new or gone.
    is_touched: Vec<bool>,
    /// The tets that have a face of such nodes.
    near: Vec<u32>,
    faces: Faces,
}

impl TopologyMaker {
    /// The topology of a mesh, as [`Topology::new`] has it.
    ///
    /// # Errors
    /// [`ContactError::Length`] if there is not one owner for each tet.
    pub fn make(&mut self, tets: &[[u32; 4]], tet_owner: &[u32], rest_m: &[[f32; 3]]) -> Result<Topology, ContactError> {
        same_length("owners of tets", tets.len(), tet_owner.len())?;
        self.touch(tets, tet_owner, rest_m.len());
        self.join(tets, tet_owner, rest_m.len());
        self.tets.clear();
        self.tets.extend_from_slice(tets);
        self.tet_owner.clear();
        self.tet_owner.extend_from_slice(tet_owner);
        self.nodes = rest_m.len();
        Ok(Topology::of(self.neighbours.clone(), tets, tet_owner, rest_m))
    }

    /// Finds the nodes of the tets that are not what they were, and takes from those tets what lies behind their faces.
    fn touch(&mut self, tets: &[[u32; 4]], tet_owner: &[u32], nodes: usize) {
        self.is_touched.clear();
        self.is_touched.resize(nodes.max(self.nodes), false);
        self.neighbours.resize(tets.len(), [NONE; 4]);
        let is_touched = &mut self.is_touched;
        let mut touch = |tet: &[u32; 4]| {
            for node in tet {
                if let Some(is_touched) = is_touched.get_mut(*node as usize) {
                    *is_touched = true;
                }
            }
        };
        // One with a node that is not there, or was not, counts as changed: it may be left alone now and not before.
        let common_nodes = nodes.min(self.nodes);
        let (before, now) = (self.tets.iter().zip(&self.tet_owner), tets.iter().zip(tet_owner));
        for ((before, now), neighbours) in before.zip(now).zip(&mut self.neighbours) {
            if before != now || !exists(now.0, common_nodes) {
                touch(before.0);
                touch(now.0);
                *neighbours = [NONE; 4];
            }
        }
        let common = tets.len().min(self.tets.len());
        self.tets[common..].iter().chain(&tets[common..]).for_each(touch);
    }

    /// Joins all faces anew whose nodes are all touched. These are all faces with the nodes of one that is new or gone, and some more; behind each other face
    /// lies what lay there before.
    fn join(&mut self, tets: &[[u32; 4]], tet_owner: &[u32], nodes: usize) {
        let TopologyMaker { neighbours, is_touched, near, faces, .. } = self;
        let touched = |node: u32| is_touched.get(node as usize).is_some_and(|is_touched| *is_touched);
        // Of four corners three are touched only if one of the first two is; few tets have any.
        let may_be_near = |tet: &[u32; 4]| touched(tet[0]) || touched(tet[1]);
        let has_face = |tet: &[u32; 4]| tet.iter().filter(|node| touched(**node)).count() >= 3;
        let is_near = |tet: &[u32; 4]| may_be_near(tet) && has_face(tet) && exists(tet, nodes);
        near.clear();
        near.extend((0..).zip(tets).filter(|(_, tet)| is_near(tet)).map(|(t, _): (u32, _)| t));
        faces.clear(near.len());
        for &tet in near.iter() {
            let t = tet as usize;
            let sorted = ascending(&tets[t]);
            let corners_touched = sorted.map(|node| touched((node >> 2) as u32));
            for (opposite, others) in [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]].into_iter().enumerate() {
                if !others.iter().all(|other: &usize| corners_touched[*other]) {
                    continue;
                }
                let [a, b, c] = others.map(|other| (sorted[other] >> 2) as u32);
                let corner = (sorted[opposite] & 3) as u32;
                neighbours[t][corner as usize] = NONE;
                if let Some(first) = faces.first(Face { nodes_and_owner: [a, b, c, tet_owner[t]], tet, corner }) {
                    let behind = &mut neighbours[first.tet as usize][first.corner as usize];
                    if *behind == NONE {
                        *behind = tet;
                        neighbours[t][corner as usize] = first.tet;
                    }
                }
            }
        }
    }
}

/// A tet's nodes in ascending order, each with its corner in the lowest two bits.
fn ascending(tet: &[u32; 4]) -> [u64; 4] {
    let mut nodes = [0, 1, 2, 3].map(|corner| u64::from(tet[corner]) << 2 | corner as u64);
    for (i, j) in [(0, 1), (2, 3), (0, 2), (1, 3), (1, 2)] {
        (nodes[i], nodes[j]) = (nodes[i].min(nodes[j]), nodes[i].max(nodes[j]));
    }
    nodes
}

/// A face of a tet.
#[derive(Debug, Clone)]
struct Face {
    /// Ascending, and the owner of the tet.
    nodes_and_owner: [u32; 4],
    tet: u32,
    /// The corner that it lies opposite to.
    corner: u32,
}

/// Faces by a hash of their nodes. They are asked for in the order of the tets, so that the hash decides about nothing but time.
#[derive(Debug, Clone, Default)]
struct Faces {
    /// Places in `known`, or [`NONE`]; a third of them is free at least, and their number is a power of two.
    slots: Vec<u32>,
    known: Vec<Face>,
}

impl Faces {
    /// Forgets all, and makes room for those of so many tets.
    fn clear(&mut self, tets: usize) {
        self.slots.clear();
        self.slots.resize((6 * tets).next_power_of_two().max(2), NONE);
        self.known.clear();
        // Most faces lie between two tets.
        self.known.reserve(2 * tets);
    }

    /// The face with the same nodes and owner that came first; `None` if it is this one.
    fn first(&mut self, face: Face) -> Option<&Face> {
        let [a, b, c, _] = face.nodes_and_owner.map(u64::from);
        let mixed = (a.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ b).wrapping_mul(0xD1B5_4A32_D192_ED03) ^ c;
        let mut slot = (mixed.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (64 - self.slots.len().trailing_zeros())) as usize;
        // There are fewer faces than slots.
        while self.slots[slot] != NONE {
            let place = self.slots[slot] as usize;
            if self.known[place].nodes_and_owner == face.nodes_and_owner {
                return Some(&self.known[place]);
            }
            slot = (slot + 1) & (self.slots.len() - 1);
        }
        self.slots[slot] = self.known.len() as u32;
        self.known.push(face);
        None
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::plain;
    use super::*;
    use proptest::collection::vec;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    fn places(nodes: usize) -> Vec<[f32; 3]> {
        (0..nodes).map(|node| [node as f32, (node * node) as f32, (node % 3) as f32]).collect()
    }

    #[test]
    fn what_a_change_does_not_touch_is_not_looked_up_again() {
        // Each tet of the row has a face in common with the next; one of them gets a node of its own.
        let mut tets: Vec<[u32; 4]> = (0..100).map(|first| [0, 1, 2, 3].map(|corner| first + corner)).collect();
        let (owners, mut maker) = (vec![0; tets.len()], TopologyMaker::default());
        let whole = maker.make(&tets, &owners, &places(103)).unwrap();
        assert_eq!((maker.near.len(), whole.neighbours[50]), (100, [51, NONE, NONE, 49]));
        tets[50][3] = 103;
        let parted = maker.make(&tets, &owners, &places(104)).unwrap();
        assert_eq!((&maker.near[..], parted.neighbours[50]), (&[49, 50, 51][..], [NONE, NONE, NONE, 49]));
        assert_eq!(parted.neighbours[51], [52, NONE, NONE, NONE]);
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 400,
            rng_seed: RngSeed::Fixed(7),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        /// Few nodes, so that faces meet: two, three and more tets at one, tets with a node twice or with one that does not exist. Between two topologies tets are
        /// replaced, added, burnt or given to another owner, nodes come and go, or all tets are in another order.
        #[test]
        fn a_topology_is_the_same_whatever_was_made_before(
            tets in vec([0..9u32, 0..9u32, 0..9u32, 0..9u32], 0..60),
            rounds in vec(vec((0..8u32, 0..60usize, [0..9u32, 0..9u32, 0..9u32, 0..9u32]), 0..4), 1..6),
        ) {
            let (mut tets, mut nodes, mut maker) = (tets, 8, TopologyMaker::default());
            let mut owners: Vec<u32> = (0..tets.len() as u32).map(|tet| tet / 7 % 2).collect();
            for changes in rounds {
                for (what, at, tet) in changes {
                    let at = at % tets.len().max(1);
                    match what {
                        0..3 if at < tets.len() => tets[at] = tet,
                        3 if at < tets.len() => owners[at] = 1 - owners[at],
                        4 if at < tets.len() => {
                            tets.remove(at);
                            owners.remove(at);
                        }
                        5 => nodes = 6 + at % 4,
                        6 => tets.reverse(),
                        _ => {
                            tets.push(tet);
                            owners.push(0);
                        }
                    }
                }
                let rest_m = places(nodes);
                prop_assert_eq!(maker.make(&tets, &owners, &rest_m), Ok(plain(&tets, &owners, &rest_m)));
            }
        }
    }
}
