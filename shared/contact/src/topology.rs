//! What does not change while nothing is cut: which tet lies behind which face, which faces bound the tissue, which points of
//! an object are joined by an edge. Made when a mesh is loaded or cut; this is the model, positions are the state.

use crate::ContactError;
use crate::error::same_length;
use glam::Vec3;

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
#[derive(Debug, Clone)]
pub(crate) struct Normals {
    known: Vec<Option<Vec3>>,
}

impl Normals {
    /// For so many nodes.
    pub fn new(nodes: usize) -> Normals {
        Normals { known: vec![None; nodes] }
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
        same_length("owners of tets", tets.len(), tet_owner.len())?;
        let neighbours = neighbours(tets, tet_owner, rest_m.len());
        let (mut boundary, mut boundary_owner, mut boundary_tet) = (Vec::new(), Vec::new(), Vec::new());
        for (t, tet) in tets.iter().enumerate().filter(|(_, tet)| exists(tet, rest_m.len())) {
            for face in (0..4).filter(|&face| neighbours[t][face] == NONE) {
                boundary.push(outward(tet, face, rest_m));
                boundary_owner.push(tet_owner[t]);
                boundary_tet.push(t as u32);
            }
        }
        let about = About::of(&boundary, rest_m.len());
        Ok(Topology { neighbours, boundary, boundary_owner, boundary_tet, about, nodes: rest_m.len() })
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

/// A tet's nodes in ascending order, each with its corner in the lowest two bits.
fn ascending(tet: &[u32; 4]) -> [u64; 4] {
    let mut nodes = [0, 1, 2, 3].map(|corner| u64::from(tet[corner]) << 2 | corner as u64);
    for (i, j) in [(0, 1), (2, 3), (0, 2), (1, 3), (1, 2)] {
        (nodes[i], nodes[j]) = (nodes[i].min(nodes[j]), nodes[i].max(nodes[j]));
    }
    nodes
}

/// A face of a tet.
struct Face {
    /// Ascending, and the owner of the tet.
    nodes_and_owner: [u32; 4],
    tet: u32,
    /// The corner that it lies opposite to.
    corner: u32,
}

/// Faces by a hash of their nodes. They are asked for in the order of the tets, so that the hash decides about nothing but time.
struct Faces {
    /// Places in `known`, or [`NONE`]; a third of them is free at least.
    slots: Vec<u32>,
    known: Vec<Face>,
}

impl Faces {
    /// With room for those of so many tets.
    fn new(tets: usize) -> Faces {
        Faces { slots: vec![NONE; (6 * tets).next_power_of_two().max(2)], known: Vec::with_capacity(4 * tets) }
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
            slot = (slot + 1) % self.slots.len();
        }
        self.slots[slot] = self.known.len() as u32;
        self.known.push(face);
        None
    }
}

/// The tet behind each face.
fn neighbours(tets: &[[u32; 4]], tet_owner: &[u32], nodes: usize) -> Vec<[u32; 4]> {
    let mut neighbours = vec![[NONE; 4]; tets.len()];
    let mut faces = Faces::new(tets.len());
    for (t, tet) in tets.iter().enumerate().filter(|(_, tet)| exists(tet, nodes)) {
        let sorted = ascending(tet);
        for (opposite, [a, b, c]) in [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]].into_iter().enumerate() {
            let [a, b, c] = [a, b, c].map(|other: usize| (sorted[other] >> 2) as u32);
            let corner = (sorted[opposite] & 3) as u32;
            let face = Face { nodes_and_owner: [a, b, c, tet_owner[t]], tet: t as u32, corner };
            if let Some(first) = faces.first(face) {
                let behind = &mut neighbours[first.tet as usize][first.corner as usize];
                if *behind == NONE {
                    *behind = t as u32;
                    neighbours[t][corner as usize] = first.tet;
                }
            }
        }
    }
    neighbours
}

/// A face's nodes, turned so that they are outward in the rest shape.
fn outward(tet: &[u32; 4], face: usize, rest_m: &[[f32; 3]]) -> [u32; 3] {
    let [a, b, c] = FACES[face].map(|i| tet[i]);
    let at = |n: u32| Vec3::from_array(rest_m[n as usize]);
    let inside = (at(b) - at(a)).cross(at(c) - at(a)).dot(at(tet[face]) - at(a)) > 0.0;
    if inside { [a, c, b] } else { [a, b, c] }
}

/// Which points of an object are joined by an edge: how depth travels inward from the border of a contact.
#[derive(Debug, Clone, Default)]
pub struct PointGraph {
    starts: Vec<u32>,
    joined: Vec<u32>,
}

impl PointGraph {
    /// From a list of edges, in any order and direction; edges to points that do not exist, loops and repeats are left out.
    pub fn from_edges(points: usize, edges: &[[u32; 2]]) -> PointGraph {
        let real = |e: &&[u32; 2]| e[0] != e[1] && e.iter().all(|&p| (p as usize) < points);
        let both = || edges.iter().filter(real).flat_map(|&[a, b]| [(a, b), (b, a)]);
        let mut ends = vec![0u32; points + 1];
        both().for_each(|(a, _)| ends[a as usize + 1] += 1);
        (0..points).for_each(|p| ends[p + 1] += ends[p]);
        let mut all = vec![0u32; ends[points] as usize];
        let mut next = ends.clone();
        for (a, b) in both() {
            all[next[a as usize] as usize] = b;
            next[a as usize] += 1;
        }
        // Each point has a few, most of them twice.
        let (mut starts, mut joined) = (Vec::with_capacity(points + 1), Vec::with_capacity(all.len() / 2));
        for ends in ends.windows(2) {
            starts.push(joined.len() as u32);
            let of_point = &mut all[ends[0] as usize..ends[1] as usize];
            of_point.sort_unstable();
            joined.extend(of_point.chunk_by(PartialEq::eq).map(|same| same[0]));
        }
        starts.push(joined.len() as u32);
        PointGraph { starts, joined }
    }

    /// The edges of a set of triangles.
    pub fn from_triangles(points: usize, triangles: &[[u32; 3]]) -> PointGraph {
        let edges: Vec<[u32; 2]> = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        PointGraph::from_edges(points, &edges)
    }

    /// This graph and behind its points those of another, with no edge between the two.
    pub fn followed_by(&self, other: &PointGraph) -> PointGraph {
        let (first, edges) = (self.points() as u32, self.joined.len() as u32);
        let mut both = self.clone();
        both.starts.resize(first as usize + 1, 0); // one without points may have no start either
        both.starts.extend(other.starts.iter().skip(1).map(|start| start + edges));
        both.joined.extend(other.joined.iter().map(|point| point + first));
        both
    }

    /// Number of points.
    pub fn points(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// The points joined to one point, ascending.
    pub fn joined(&self, point: u32) -> &[u32] {
        let at = |i: usize| self.starts.get(i).map_or(0, |&s| s as usize);
        self.joined.get(at(point as usize)..at(point as usize + 1)).unwrap_or(&[])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::collection::vec;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    #[test]
    fn a_graph_behind_another_has_the_edges_of_both_and_none_between() {
        let (line, triangle) = (PointGraph::from_edges(3, &[[0, 1], [1, 2]]), PointGraph::from_triangles(4, &[[0, 1, 3]]));
        let both = line.followed_by(&triangle);
        let expected = PointGraph::from_edges(7, &[[0, 1], [1, 2], [3, 4], [4, 6], [6, 3]]);
        let joined =
            |graph: &PointGraph| (0..graph.points() as u32).map(|point| graph.joined(point).to_vec()).collect::<Vec<_>>();
        assert_eq!(joined(&both), joined(&expected));
        assert_eq!(joined(&PointGraph::default().followed_by(&line)), joined(&line));
        assert_eq!(joined(&line.followed_by(&PointGraph::default())), joined(&line));
    }

    /// The definition: of an owner's faces with the same nodes the first two are joined.
    fn plain(tets: &[[u32; 4]], tet_owner: &[u32], rest_m: &[[f32; 3]]) -> Topology {
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
            let (plain, mut normals) = (plain_normals(&topology, &places, 12), Normals::new(12));
            for node in (0..12).chain([3, 7, 7]) {
                let normal = normals.of(&topology, &places, node);
                prop_assert_eq!(normal.to_array().map(f32::to_bits), plain[node as usize].to_array().map(f32::to_bits));
            }
            prop_assert_eq!(normals.of(&topology, &places, 12), Vec3::ZERO);
        }
    }
}
