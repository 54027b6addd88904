//! The boundary of a tet mesh, and what hangs together.

use crate::geometry::{corners, signed_volume};
use crate::types::{TetMesh, TriangleMesh};

/// The boundary of a tet mesh: the faces that belong to one tet only.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Surface {
    /// Node indices of the tet mesh, counter-clockwise seen from outside. Ordered by tet, then by face.
    pub triangles: Vec<[u32; 3]>,
    /// The tet behind each triangle.
    pub tet_of_triangle: Vec<u32>,
}

impl Surface {
    /// A mesh of its own, with only the nodes that the boundary uses, in the order of the tet mesh; and for each of its vertices
    /// the node that it is.
    pub fn to_mesh(&self, positions_m: &[[f32; 3]]) -> (TriangleMesh, Vec<u32>) {
        let mut nodes: Vec<u32> = self.triangles.as_flattened().to_vec();
        nodes.sort_unstable();
        nodes.dedup();
        let vertex = |node: u32| nodes.partition_point(|&other| other < node) as u32;
        let triangles = self.triangles.iter().map(|triangle| triangle.map(vertex)).collect();
        let positions_m = nodes.iter().map(|&node| positions_m[node as usize]).collect();
        (TriangleMesh { positions_m, triangles }, nodes)
    }
}

/// Outward faces of a tet with positive volume, as places within the tet: each lies opposite to the corner of its number.
pub const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// A face by its sorted nodes, and where it comes from (4 × tet + face).
type Face = ([u32; 3], usize);

/// All faces, sorted by their nodes, so that equal ones stand together.
pub(crate) fn sorted_faces(tets: &[[u32; 4]]) -> Vec<Face> {
    let mut faces: Vec<Face> = Vec::with_capacity(4 * tets.len());
    for (tet, nodes) in tets.iter().enumerate() {
        for (face, places) in FACES.iter().enumerate() {
            let mut key = places.map(|place| nodes[place]);
            key.sort_unstable();
            faces.push((key, 4 * tet + face));
        }
    }
    faces.sort_unstable();
    faces
}

/// The boundary of `mesh`. Inverted tets count as if they were not; a face between tets is never part of it.
///
/// # Panics
/// If a tet names a node that is not there; the readers and `repair` never return such a mesh.
pub fn boundary(mesh: &TetMesh) -> Surface {
    let faces = sorted_faces(&mesh.tets);
    let mut single: Vec<usize> = faces
        .chunk_by(|left, right| left.0 == right.0)
        .filter_map(|same| if let [(_, origin)] = same { Some(*origin) } else { None })
        .collect();
    single.sort_unstable();
    let mut surface = Surface::default();
    for origin in single {
        let (index, face) = (origin / 4, origin % 4);
        let tet = mesh.tets[index];
        let [a, b, c] = FACES[face].map(|place| tet[place]);
        let inverted = signed_volume(corners(&mesh.positions_m, tet)) < 0.0;
        surface.triangles.push(if inverted { [a, c, b] } else { [a, b, c] });
        surface.tet_of_triangle.push(index as u32);
    }
    surface
}

/// For each tet the number of its component, from 0 in the order of their first tets. Tets that share a node hang together.
///
/// # Panics
/// As [`boundary`].
pub fn component_of_each_tet(mesh: &TetMesh) -> Vec<u32> {
    components(mesh.positions_m.len(), &mesh.tets)
}

/// How many components there are of cells that have these numbers, each of its own.
pub fn component_count(component_of_each: &[u32]) -> usize {
    component_of_each.iter().max().map_or(0, |last| *last as usize + 1)
}

/// For each triangle the number of its component, likewise.
///
/// # Panics
/// If a triangle names a vertex that is not there.
pub fn component_of_each_triangle(mesh: &TriangleMesh) -> Vec<u32> {
    components(mesh.positions_m.len(), &mesh.triangles)
}

/// For each cell of so many nodes the number of its component.
pub(crate) fn components<const N: usize>(nodes: usize, cells: &[[u32; N]]) -> Vec<u32> {
    let mut sets = Sets::new(nodes);
    cells.iter().for_each(|cell| sets.join_all(cell));
    let mut number_of_root = vec![u32::MAX; nodes];
    let mut next = 0;
    let mut numbers = Vec::with_capacity(cells.len());
    for cell in cells {
        let number = &mut number_of_root[sets.root(cell[0]) as usize];
        if *number == u32::MAX {
            *number = next;
            next += 1;
        }
        numbers.push(*number);
    }
    numbers
}

/// Disjoint sets; the root of a set is its smallest member, so that the result does not depend on the order of joins.
pub(crate) struct Sets {
    parent: Vec<u32>,
}

impl Sets {
    pub fn new(count: usize) -> Self {
        Sets { parent: (0..count as u32).collect() }
    }

    pub fn root(&mut self, mut member: u32) -> u32 {
        while self.parent[member as usize] != member {
            let grandparent = self.parent[self.parent[member as usize] as usize];
            self.parent[member as usize] = grandparent;
            member = grandparent;
        }
        member
    }

    /// Makes one of the sets of some members. Most cells come when their nodes hang together already, below one parent.
    fn join_all<const N: usize>(&mut self, members: &[u32; N]) {
        let parents = members.map(|member| self.parent[member as usize]);
        if parents.iter().all(|parent| *parent == parents[0]) {
            return;
        }
        let root = parents.into_iter().reduce(|root, parent| self.join(root, parent)).unwrap_or_default();
        members.iter().for_each(|member| self.parent[*member as usize] = root);
    }

    /// Makes one of the sets of two members; its root.
    pub fn join(&mut self, left: u32, right: u32) -> u32 {
        let (left, right) = (self.root(left), self.root(right));
        self.parent[left.max(right) as usize] = left.min(right);
        left.min(right)
    }
}
