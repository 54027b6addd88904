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
#[derive(Debug, Clone, Default)]
pub struct Topology {
    /// For each tet and corner the tet behind the face opposite to the corner, or [`NONE`] on the boundary.
    pub neighbours: Vec<[u32; 4]>,
    /// Boundary triangles, outward by the right-hand rule in the rest shape; sorted by (tet, face).
    pub boundary: Vec<[u32; 3]>,
    /// Object of each boundary triangle.
    pub boundary_owner: Vec<u32>,
    nodes: usize,
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
        let mut faces = Vec::with_capacity(tets.len() * 4);
        for (t, tet) in tets.iter().enumerate().filter(|(_, tet)| tet.iter().all(|&n| (n as usize) < rest_m.len())) {
            for (f, corners) in FACES.iter().enumerate() {
                let mut key = corners.map(|c| tet[c]);
                key.sort_unstable();
                faces.push((tet_owner[t], key, t as u32, f as u32));
            }
        }
        faces.sort_unstable();
        let mut neighbours = vec![[NONE; 4]; tets.len()];
        for group in faces.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            if let [a, b, ..] = group {
                neighbours[a.2 as usize][a.3 as usize] = b.2;
                neighbours[b.2 as usize][b.3 as usize] = a.2;
            }
        }
        faces.sort_unstable_by_key(|f| (f.2, f.3));
        faces.retain(|f| neighbours[f.2 as usize][f.3 as usize] == NONE);
        let boundary = faces.iter().map(|f| outward(&tets[f.2 as usize], f.3 as usize, rest_m)).collect();
        let boundary_owner = faces.iter().map(|f| f.0).collect();
        Ok(Topology { neighbours, boundary, boundary_owner, nodes: rest_m.len() })
    }

    /// Number of nodes of the mesh.
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Area-weighted outward normals of the boundary nodes (not of unit length; zero inside), for the positions as they are.
    pub(crate) fn node_normals(&self, positions_m: &[[f32; 3]], normals: &mut [Vec3]) {
        normals.fill(Vec3::ZERO);
        for tri in &self.boundary {
            let at = |n: u32| positions_m.get(n as usize).map_or(Vec3::NAN, |p| Vec3::from_array(*p));
            let [a, b, c] = tri.map(at);
            let area = (b - a).cross(c - a);
            if area.is_finite() {
                for &n in tri {
                    if let Some(normal) = normals.get_mut(n as usize) {
                        *normal += area;
                    }
                }
            }
        }
    }
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
        let mut both: Vec<(u32, u32)> = edges.iter().filter(real).flat_map(|&[a, b]| [(a, b), (b, a)]).collect();
        both.sort_unstable();
        both.dedup();
        let mut starts = vec![0u32; points + 1];
        for &(a, _) in &both {
            starts[a as usize + 1] += 1;
        }
        for p in 0..points {
            starts[p + 1] += starts[p];
        }
        PointGraph { starts, joined: both.into_iter().map(|(_, b)| b).collect() }
    }

    /// The edges of a set of triangles.
    pub fn from_triangles(points: usize, triangles: &[[u32; 3]]) -> PointGraph {
        let edges: Vec<[u32; 2]> = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        PointGraph::from_edges(points, &edges)
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
