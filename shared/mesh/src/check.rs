//! What is wrong with a tet mesh, in figures and in sentences.

use crate::boundary::{Sets, boundary, component_count, component_of_each_tet, sorted_faces};
use crate::geometry::{Unit, corners, count, guess_unit, is_without_volume, quality, signed_volume};
use crate::merge::duplicate_tets;
use crate::types::TetMesh;
use std::fmt;

/// A tet with a lower [`quality`] is called flat: it spoils the step of an explicit integrator and the condition of an
/// implicit one, and its orientation is hardly more than rounding.
pub const FLAT_QUALITY: f64 = 1e-3;

/// Size of an organ that a mesh is expected to have if nobody says better: a uterus is 0.08 m long, a liver 0.2 m wide.
pub const ORGAN_SIZE_M: f32 = 0.1;

/// What [`check`] found. Tets and nodes are named by index.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Number of nodes and of tets.
    pub nodes: usize,
    /// Number of tets.
    pub tets: usize,
    /// Smallest coordinates of the nodes that are finite; 0 if there are none.
    pub min_m: [f32; 3],
    /// Largest coordinates, likewise.
    pub max_m: [f32; 3],
    /// The unit in which the mesh is nearest to the size of an organ ([`ORGAN_SIZE_M`]), if its coordinates are in the file's unit.
    pub unit: Unit,
    /// Sum of the tets' volumes, each counted positive, in m³ (or the file's unit cubed).
    pub volume_m3: f64,
    /// Nodes with a coordinate that is not finite.
    pub not_finite: Vec<u32>,
    /// Tets that name a node that is not there.
    pub out_of_range: Vec<u32>,
    /// Tets with a negative volume.
    pub inverted: Vec<u32>,
    /// Tets of a quality below [`FLAT_QUALITY`].
    pub flat: Vec<u32>,
    /// The tet of the lowest quality, and that quality (0 to 1).
    pub worst: Option<(u32, f64)>,
    /// Tets with their four nodes at the same places as an earlier one: the same nodes, or nodes of their own.
    pub duplicate: Vec<u32>,
    /// Nodes that no tet uses.
    pub unused_nodes: Vec<u32>,
    /// Parts that share no node with each other.
    pub components: usize,
    /// Triangles of the boundary.
    pub boundary_triangles: usize,
    /// Faces that more than two tets share, of those that have a volume and are no duplicates: [`repair`](crate::repair()) drops the others anyway.
    pub crowded_faces: usize,
    /// Edges of the boundary of the same tets with a single triangle.
    pub open_edges: usize,
    /// Edges of the boundary with more than two triangles.
    pub non_manifold_edges: usize,
    /// Nodes at which parts of the boundary touch that share no edge there.
    pub non_manifold_vertices: usize,
}

/// Checks a mesh. Nothing is too broken for it: tets that name missing nodes or nodes that are not finite are reported and left
/// out of the figures about shape and boundary.
pub fn check(mesh: &TetMesh) -> Report {
    let nodes = mesh.positions_m.len();
    let finite = |node: u32| mesh.positions_m[node as usize].iter().all(|coordinate| coordinate.is_finite());
    let in_range = |tet: &[u32; 4]| tet.iter().all(|&node| (node as usize) < nodes);
    let indices_where = |bad: &dyn Fn(&[u32; 4]) -> bool| -> Vec<u32> {
        mesh.tets.iter().enumerate().filter(|(_, tet)| bad(tet)).map(|(index, _)| index as u32).collect()
    };
    let sound = |tet: &[u32; 4]| in_range(tet) && tet.iter().all(|&node| finite(node));
    let not_finite: Vec<u32> = (0..nodes as u32).filter(|&node| !finite(node)).collect();
    let (min_m, max_m) = bounding_box(&mesh.positions_m);
    let volume = |tet: &[u32; 4]| signed_volume(corners(&mesh.positions_m, *tet));
    let worth = |tet: &[u32; 4]| quality(corners(&mesh.positions_m, *tet));

    let sound_tets: Vec<[u32; 4]> = mesh.tets.iter().copied().filter(|tet| sound(tet)).collect();
    let shape = TetMesh { positions_m: mesh.positions_m.clone(), regions: vec![0; sound_tets.len()], tets: sound_tets };
    let worst = indices_where(&|tet| sound(tet))
        .into_iter()
        .map(|index| (index, worth(&mesh.tets[index as usize])))
        .min_by(|left, right| left.1.total_cmp(&right.1));
    let edges = boundary_edges(&shape);
    let duplicate = duplicate_tets(&mesh.positions_m, &mesh.tets);
    let is_filling = |(tet, index): &(&[u32; 4], u32)| {
        sound(tet) && duplicate.binary_search(index).is_err() && !is_without_volume(corners(&mesh.positions_m, **tet))
    };
    let filling: Vec<[u32; 4]> = mesh.tets.iter().zip(0..).filter(is_filling).map(|(tet, _)| *tet).collect();
    let (crowded_faces, open_edges) = crowded_and_open(&filling);
    Report {
        nodes,
        tets: mesh.tets.len(),
        min_m,
        max_m,
        unit: guess_unit(extent(min_m, max_m), ORGAN_SIZE_M),
        volume_m3: shape.tets.iter().map(|tet| volume(tet).abs()).sum(),
        not_finite,
        out_of_range: indices_where(&|tet| !in_range(tet)),
        inverted: indices_where(&|tet| sound(tet) && volume(tet) < 0.0),
        flat: indices_where(&|tet| sound(tet) && worth(tet) < FLAT_QUALITY),
        worst,
        duplicate,
        unused_nodes: unused_nodes(nodes, &mesh.tets),
        components: component_count(&component_of_each_tet(&shape)),
        boundary_triangles: edges.triangles,
        crowded_faces,
        open_edges,
        non_manifold_edges: edges.non_manifold,
        non_manifold_vertices: edges.non_manifold_vertices,
    }
}

fn extent(min_m: [f32; 3], max_m: [f32; 3]) -> f32 {
    (0..3).fold(0.0, |extent, axis| extent.max(max_m[axis] - min_m[axis]))
}

fn bounding_box(positions_m: &[[f32; 3]]) -> ([f32; 3], [f32; 3]) {
    let mut finite = positions_m.iter().filter(|position| position.iter().all(|c| c.is_finite()));
    let Some(&first) = finite.next() else {
        return ([0.0; 3], [0.0; 3]);
    };
    finite.fold((first, first), |(mut min, mut max), position| {
        for axis in 0..3 {
            min[axis] = min[axis].min(position[axis]);
            max[axis] = max[axis].max(position[axis]);
        }
        (min, max)
    })
}

/// Nodes that no tet uses.
pub(crate) fn unused_nodes(nodes: usize, tets: &[[u32; 4]]) -> Vec<u32> {
    let mut used = vec![false; nodes];
    for &node in tets.as_flattened() {
        if let Some(used) = used.get_mut(node as usize) {
            *used = true;
        }
    }
    (0..nodes as u32).filter(|&node| !used[node as usize]).collect()
}

/// Edges that only one of these triangles has: 0 for a surface that is closed.
pub fn open_edges(triangles: &[[u32; 3]]) -> usize {
    let mut edges: Vec<[u32; 2]> = triangles
        .iter()
        .flat_map(|[a, b, c]| [[a, b], [b, c], [c, a]].map(|[from, to]| [*from.min(to), *from.max(to)]))
        .collect();
    edges.sort_unstable();
    edges.chunk_by(|left, right| left == right).filter(|same| same.len() == 1).count()
}

/// The faces that more than two of some tets share, and the edges of their boundary with a single triangle.
fn crowded_and_open(tets: &[[u32; 4]]) -> (usize, usize) {
    let (mut crowded, mut outside) = (0, Vec::new());
    for same in sorted_faces(tets).chunk_by(|left, right| left.0 == right.0) {
        match same {
            [(nodes, _)] => outside.push(*nodes),
            [_, _] => {}
            _ => crowded += 1,
        }
    }
    (crowded, open_edges(&outside))
}

struct BoundaryEdges {
    triangles: usize,
    non_manifold: usize,
    non_manifold_vertices: usize,
}

/// Counts the edges of the boundary by their triangles, and the vertices whose triangles form more than one fan.
fn boundary_edges(mesh: &TetMesh) -> BoundaryEdges {
    let triangles = boundary(mesh).triangles;
    // an edge by its nodes, low first; and the corners (3 × triangle + place) at its low and its high end
    let mut edges: Vec<([u32; 2], [u32; 2])> = Vec::with_capacity(3 * triangles.len());
    for (triangle, nodes) in triangles.iter().enumerate() {
        for [from, to] in [[0, 1], [1, 2], [2, 0]] {
            let [low, high] = if nodes[from] < nodes[to] { [from, to] } else { [to, from] };
            edges.push(([nodes[low], nodes[high]], [low, high].map(|place| (3 * triangle + place) as u32)));
        }
    }
    edges.sort_unstable();
    let mut counts = BoundaryEdges { triangles: triangles.len(), non_manifold: 0, non_manifold_vertices: 0 };
    let mut fans = Sets::new(3 * triangles.len());
    for same in edges.chunk_by(|left, right| left.0 == right.0) {
        counts.non_manifold += usize::from(same.len() > 2);
        for pair in same.windows(2) {
            fans.join(pair[0].1[0], pair[1].1[0]);
            fans.join(pair[0].1[1], pair[1].1[1]);
        }
    }
    let corner_nodes = triangles.as_flattened();
    let mut fan_of_node: Vec<(u32, u32)> =
        corner_nodes.iter().zip(0..).map(|(&node, corner)| (node, fans.root(corner))).collect();
    fan_of_node.sort_unstable();
    fan_of_node.dedup();
    counts.non_manifold_vertices = fan_of_node.chunk_by(|left, right| left.0 == right.0).filter(|fans| fans.len() > 1).count();
    counts
}

impl Report {
    /// The longest side of the bounding box, for [`guess_unit`](crate::guess_unit) with the size that a scene expects.
    pub fn extent_m(&self) -> f32 {
        extent(self.min_m, self.max_m)
    }

    /// True if there is nothing that [`repair`](crate::repair()) would change or could not change, but for parts that touch with whole faces, which it joins.
    pub fn is_sound(&self) -> bool {
        let lists = [&self.not_finite, &self.out_of_range, &self.inverted, &self.flat, &self.duplicate, &self.unused_nodes];
        let counts = [self.crowded_faces, self.open_edges, self.non_manifold_edges, self.non_manifold_vertices];
        self.tets > 0 && lists.iter().all(|list| list.is_empty()) && counts.iter().all(|&count| count == 0)
    }
}

impl fmt::Display for Report {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size: Vec<f32> = (0..3).map(|axis| self.max_m[axis] - self.min_m[axis]).collect();
        writeln!(out, "{}, {}, {}", count(self.nodes, "node"), count(self.tets, "tet"), count(self.components, "part"))?;
        writeln!(out, "size {:.4} × {:.4} × {:.4}, volume {:.4e}", size[0], size[1], size[2], self.volume_m3)?;
        writeln!(out, "by its size the file is in {}", self.unit.symbol())?;
        if let Some((tet, quality)) = self.worst {
            writeln!(out, "worst tet {tet}, quality {quality:.2e} (1 is regular, flat below {FLAT_QUALITY:e})")?;
        }
        writeln!(out, "boundary of {} triangles", self.boundary_triangles)?;
        let lists = [
            (&self.not_finite, "node", "with a coordinate that is no finite number"),
            (&self.out_of_range, "tet", "with a node that is not there"),
            (&self.inverted, "tet", "inverted"),
            (&self.flat, "tet", "flat"),
            (&self.duplicate, "tet", "duplicate"),
            (&self.unused_nodes, "node", "unused by any tet"),
        ];
        for (list, what, how) in lists.iter().filter(|(list, ..)| !list.is_empty()) {
            writeln!(out, "{} {how}, the first is {what} {} (counted from 0)", count(list.len(), what), list[0])?;
        }
        let counts = [
            (self.crowded_faces, "face", "shared by more than two tets"),
            (self.open_edges, "boundary edge", "with one triangle only (open boundary)"),
            (self.non_manifold_edges, "boundary edge", "shared by more than two triangles (non-manifold boundary)"),
            (self.non_manifold_vertices, "boundary node", "at which the boundary touches itself (non-manifold boundary)"),
        ];
        for (number, what, how) in counts.iter().filter(|(number, ..)| *number > 0) {
            writeln!(out, "{} {how}", count(*number, what))?;
        }
        Ok(())
    }
}
