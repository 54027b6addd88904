//! What does not change while nothing is cut: which tet lies behind which face, and which faces bound the tissue. Made when a mesh is loaded or cut; this is
//! the model, positions are the state.

mod maker;

use crate::ContactError;
use glam::Vec3;

pub use maker::TopologyMaker;

/// No index: no neighbour, no node.
pub const NONE: u32 = u32::MAX;

/// Corners of the face opposite to each corner, outward by the right-hand rule in a tet of positive volume.
pub(crate) const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// Faces and neighbours of a set of tets (of all objects together).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Topology {
    /// For each tet and corner the tet behind the face opposite to the corner, or [`NONE`] on the boundary.
    pub neighbours: Vec<[u32; 4]>,
    /// Boundary triangles, outward by the right-hand rule in the rest shape; sorted by (tet, face).
    pub boundary: Vec<[u32; 3]>,
    /// Object of each boundary triangle.
    pub boundary_owner: Vec<u32>,
    /// The tet behind each boundary triangle.
    pub boundary_tet: Vec<u32>,
    about: About,
    nodes: usize,
}

/// For each node its boundary triangles, ascending; one that has it twice stands twice.
#[derive(Debug, Clone, Default, PartialEq)]
struct About {
    starts: Vec<u32>,
    triangles: Vec<u32>,
}

impl About {
    fn of(boundary: &[[u32; 3]], nodes: usize) -> About {
        let mut starts = vec![0u32; nodes + 1];
        boundary.as_flattened().iter().for_each(|node| starts[*node as usize + 1] += 1);
        for node in 0..nodes {
            starts[node + 1] += starts[node];
        }
        let (mut next, mut triangles) = (starts.clone(), vec![0; 3 * boundary.len()]);
        for (triangle, corners) in boundary.iter().enumerate() {
            for node in corners {
                let place = &mut next[*node as usize];
                triangles[*place as usize] = triangle as u32;
                *place += 1;
            }
        }
        About { starts, triangles }
    }

    fn node(&self, node: u32) -> &[u32] {
        let at = |node: usize| self.starts.get(node).map_or(0, |start| *start as usize);
        self.triangles.get(at(node as usize)..at(node as usize + 1)).unwrap_or(&[])
    }
}

/// Outward normals of the boundary nodes at some positions, each found when it is asked for first: a contact asks for those about it, a small part of all.
#[derive(Debug, Clone, Default)]
pub(crate) struct Normals {
    known: Vec<Option<Vec3>>,
}

impl Normals {
    /// Makes room for those of so many nodes.
    pub fn fit(&mut self, nodes: usize) {
        self.known.resize(nodes, None);
    }

    pub fn nodes(&self) -> usize {
        self.known.len()
    }

    /// The nodes are somewhere else now.
    pub fn forget(&mut self) {
        self.known.fill(None);
    }

    /// Area-weighted, not of unit length; zero inside and for a node that there is not.
    pub fn of(&mut self, topology: &Topology, positions_m: &[[f32; 3]], node: u32) -> Vec3 {
        let Some(known) = self.known.get_mut(node as usize) else { return Vec3::ZERO };
        *known.get_or_insert_with(|| topology.normal(positions_m, node))
    }
}

impl Topology {
    /// Joins tets of one owner along faces with the same three nodes. `rest_m` gives the side that is outside.
    ///
    /// A face of more than two tets joins the first two; the others end there. Tets with nodes out of range are left alone.
    ///
    /// # Errors
    /// [`ContactError::Length`] if there is not one owner for each tet.
    pub fn new(tets: &[[u32; 4]], tet_owner: &[u32], rest_m: &[[f32; 3]]) -> Result<Topology, ContactError> {
        TopologyMaker::default().make(tets, tet_owner, rest_m)
    }

    /// Of what lies behind each face of a mesh.
    fn of(neighbours: Vec<[u32; 4]>, tets: &[[u32; 4]], tet_owner: &[u32], rest_m: &[[f32; 3]]) -> Topology {
        let open = neighbours.as_flattened().iter().filter(|behind| **behind == NONE).count();
        let mut boundary = Vec::with_capacity(open);
        let (mut boundary_owner, mut boundary_tet) = (Vec::with_capacity(open), Vec::with_capacity(open));
        for (t, (tet, behind)) in tets.iter().zip(&neighbours).enumerate() {
            // One bit each, for which of the four are open no processor foresees.
            let mut open = (0..4usize).fold(0u32, |open, face| open | (u32::from(behind[face] == NONE) << face));
            if open == 0 || !exists(tet, rest_m.len()) {
                continue;
            }
            while open != 0 {
                let face = open.trailing_zeros() as usize;
                open &= open - 1;
                boundary.push(outward(tet, face, rest_m));
                boundary_owner.push(tet_owner[t]);
                boundary_tet.push(t as u32);
            }
        }
        let about = About::of(&boundary, rest_m.len());
        Topology { neighbours, boundary, boundary_owner, boundary_tet, about, nodes: rest_m.len() }
    }

    /// Number of nodes of the mesh.
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Area-weighted outward normal of a node (not of unit length; zero inside), for the positions as they are.
    fn normal(&self, positions_m: &[[f32; 3]], node: u32) -> Vec3 {
        let at = |n: u32| positions_m.get(n as usize).map_or(Vec3::NAN, |p| Vec3::from_array(*p));
        let mut normal = Vec3::ZERO;
        for triangle in self.about.node(node).iter().filter_map(|triangle| self.boundary.get(*triangle as usize)) {
            let [a, b, c] = triangle.map(at);
            let area = (b - a).cross(c - a);
            if area.is_finite() {
                normal += area;
            }
        }
        normal
    }
}

fn exists(tet: &[u32; 4], nodes: usize) -> bool {
    tet.iter().all(|&node| (node as usize) < nodes)
}

/// A face's nodes, turned so that they are outward in the rest shape.
fn outward(tet: &[u32; 4], face: usize, rest_m: &[[f32; 3]]) -> [u32; 3] {
    let [a, b, c] = FACES[face].map(|i| tet[i]);
    let at = |n: u32| Vec3::from_array(rest_m[n as usize]);
    let inside = (at(b) - at(a)).cross(at(c) - at(a)).dot(at(tet[face]) - at(a)) > 0.0;
    if inside { [a, c, b] } else { [a, b, c] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::collection::vec;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    /// The definition: of an owner's faces with the same nodes the first two are joined.
    pub(super) fn plain(tets: &[[u32; 4]], tet_owner: &[u32], rest_m: &[[f32; 3]]) -> Topology {
        let mut faces = Vec::new();
        for (t, tet) in tets.iter().enumerate().filter(|(_, tet)| exists(tet, rest_m.len())) {
            for (f, corners) in FACES.iter().enumerate() {
                let mut key = corners.map(|c| tet[c]);
                key.sort_unstable();
                faces.push((tet_owner[t], key, t, f));
            }
        }
        let mut neighbours = vec![[NONE; 4]; tets.len()];
        for face in &faces {
            let same: Vec<_> = faces.iter().filter(|other| (other.0, other.1) == (face.0, face.1)).collect();
            if let [a, b, ..] = same[..] {
                neighbours[a.2][a.3] = b.2 as u32;
                neighbours[b.2][b.3] = a.2 as u32;
            }
        }
        faces.retain(|face| neighbours[face.2][face.3] == NONE);
        let boundary: Vec<_> = faces.iter().map(|face| outward(&tets[face.2], face.3, rest_m)).collect();
        let boundary_owner = faces.iter().map(|face| face.0).collect();
        let boundary_tet = faces.iter().map(|face| face.2 as u32).collect();
        let about = About::of(&boundary, rest_m.len());
        Topology { neighbours, boundary, boundary_owner, boundary_tet, about, nodes: rest_m.len() }
    }

    /// The definition: each triangle gives its area to its corners.
    fn plain_normals(topology: &Topology, positions_m: &[[f32; 3]], nodes: usize) -> Vec<Vec3> {
        let mut normals = vec![Vec3::ZERO; nodes];
        for triangle in &topology.boundary {
            let at = |n: u32| positions_m.get(n as usize).map_or(Vec3::NAN, |p| Vec3::from_array(*p));
            let [a, b, c] = triangle.map(at);
            let area = (b - a).cross(c - a);
            if area.is_finite() {
                triangle.iter().for_each(|n| normals[*n as usize] += area);
            }
        }
        normals
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 400,
            rng_seed: RngSeed::Fixed(5),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        /// Few nodes, so that faces meet: two, three and more tets at one, tets with a node twice or with one that does not exist, several owners.
        #[test]
        fn looking_faces_up_finds_what_comparing_every_face_with_every_other_finds(
            tets in vec([0..9u32, 0..9u32, 0..9u32, 0..9u32], 0..60),
            owners in 1..3u32,
            nodes in 6..9usize,
        ) {
            let rest_m: Vec<[f32; 3]> = (0..nodes).map(|node| [node as f32, (node * node) as f32, (node % 3) as f32]).collect();
            let tet_owner: Vec<u32> = (0..tets.len() as u32).map(|tet| tet / 7 % owners).collect();
            prop_assert_eq!(Topology::new(&tets, &tet_owner, &rest_m), Ok(plain(&tets, &tet_owner, &rest_m)));
        }

        /// A node that is nowhere, and positions of fewer nodes than the mesh has.
        #[test]
        fn a_normal_that_is_asked_for_is_the_one_that_all_triangles_give(
            tets in vec([0..12u32, 0..12u32, 0..12u32, 0..12u32], 0..60),
            places in vec([-1.0..1.0f32, -1.0..1.0f32, -1.0..1.0f32], 10..13),
            nowhere in 0..20usize,
        ) {
            let mut places = places;
            let rest_m: Vec<[f32; 3]> = (0..12).map(|node| [node as f32, (node * node) as f32, (node % 3) as f32]).collect();
            let topology = Topology::new(&tets, &vec![0; tets.len()], &rest_m).unwrap();
            if let Some(place) = places.get_mut(nowhere) {
                place[1] = f32::NAN;
            }
            let (plain, mut normals) = (plain_normals(&topology, &places, 12), Normals::default());
            normals.fit(12);
            for node in (0..12).chain([3, 7, 7]) {
                let normal = normals.of(&topology, &places, node);
                prop_assert_eq!(normal.to_array().map(f32::to_bits), plain[node as usize].to_array().map(f32::to_bits));
            }
            prop_assert_eq!(normals.of(&topology, &places, 12), Vec3::ZERO);
        }
    }
}
