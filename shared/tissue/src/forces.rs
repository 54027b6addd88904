//! Forces and points between nodes, tets and surfaces, outside the step.
//!
//! Promise: sums are made in the order of the arguments; an index out of range is skipped and counted, never a panic.

use hyst_mesh::{Binding, TetMesh};

/// Puts several meshes into one: the nodes, tets and regions of each follow those of the one before. Part i of the result has
/// the nodes `starts[i]..starts[i + 1]`. Objects that hold each other (a polyp and the wall) belong into one model.
///
/// `None` if there are more nodes than 32-bit indices hold.
pub fn join(meshes: &[&TetMesh]) -> Option<(TetMesh, Vec<usize>)> {
    let mut all = TetMesh::default();
    let mut starts = vec![0];
    for mesh in meshes {
        let shift = u32::try_from(all.positions_m.len()).ok()?;
        for tet in &mesh.tets {
            let [a, b, c, d] = tet.map(|node| node.checked_add(shift));
            all.tets.push([a?, b?, c?, d?]);
        }
        all.positions_m.extend_from_slice(&mesh.positions_m);
        all.regions.extend_from_slice(&mesh.regions);
        starts.push(all.positions_m.len());
    }
    Some((all, starts))
}

/// Adds `force_n`, which acts at the point with these `weights` in a tet, to the tet's nodes. Returns false, and adds nothing,
/// if a node is out of range or a number is not finite.
pub fn scatter(tet: [u32; 4], weights: [f32; 4], force_n: [f32; 3], out_n: &mut [[f32; 3]]) -> bool {
    let in_range = tet.iter().all(|&node| (node as usize) < out_n.len());
    if !in_range || !weights.iter().chain(&force_n).all(|x| x.is_finite()) {
        return false;
    }
    for (node, weight) in tet.into_iter().zip(weights) {
        for axis in 0..3 {
            out_n[node as usize][axis] += weight * force_n[axis];
        }
    }
    true
}

/// The weighted sum of four nodes' vectors (positions or velocities); `None` if a node is out of range.
pub fn gather(tet: [u32; 4], weights: [f32; 4], vectors: &[[f32; 3]]) -> Option<[f32; 3]> {
    let mut sum = [0.0; 3];
    for (node, weight) in tet.into_iter().zip(weights) {
        let vector = vectors.get(node as usize)?;
        for axis in 0..3 {
            sum[axis] += weight * vector[axis];
        }
    }
    Some(sum)
}

/// Adds the force of a fluid's pressure on boundary triangles to their nodes, a third to each: −p·area·normal, N.
///
/// `triangles` are counter-clockwise seen from the fluid, so that a positive pressure pushes into the tissue. One pressure per
/// triangle, Pa. Returns how many triangles were skipped: index out of range, pressure missing, force not finite.
pub fn pressure_forces(triangles: &[[u32; 3]], position_m: &[[f32; 3]], pressure_pa: &[f32], out_n: &mut [[f32; 3]]) -> usize {
    let mut skipped = 0;
    for (index, triangle) in triangles.iter().enumerate() {
        let corners = triangle.map(|node| position_m.get(node as usize).copied());
        let pressure = pressure_pa.get(index).copied();
        let in_range = triangle.iter().all(|&node| (node as usize) < out_n.len());
        let ([Some(a), Some(b), Some(c)], Some(pressure), true) = (corners, pressure, in_range) else {
            skipped += 1;
            continue;
        };
        let (u, v) = (minus(b, a), minus(c, a));
        let twice_area = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let share = twice_area.map(|x| -pressure * x / 6.0);
        if !share.iter().all(|x| x.is_finite()) {
            skipped += 1;
            continue;
        }
        for &node in triangle {
            for axis in 0..3 {
                out_n[node as usize][axis] += share[axis];
            }
        }
    }
    skipped
}

/// Moves a surface that is bound to a volume: `out_m[i]` is the point of `bindings[i]` at the positions of the nodes.
///
/// Returns how many vertices were left as they are: tet or node out of range, or beyond the shorter of the two arrays.
pub fn surface_update(bindings: &[Binding], tets: &[[u32; 4]], position_m: &[[f32; 3]], out_m: &mut [[f32; 3]]) -> usize {
    let mut left = bindings.len().abs_diff(out_m.len());
    for (binding, out) in bindings.iter().zip(out_m) {
        let nodes = tets.get(binding.tet as usize);
        match nodes.and_then(|&nodes| gather(nodes, binding.weights, position_m)) {
            Some(point) => *out = point,
            None => left += 1,
        }
    }
    left
}

/// A surface that is bound to the volume of a model, with the nodes that each vertex follows beside its weights: what
/// [`Scratch::move_surface`](crate::Scratch::move_surface) reads in each step.
#[derive(Debug, Clone, Default)]
pub struct BoundSurface {
    vertices: Vec<BoundVertex>,
}

#[derive(Debug, Clone, Copy)]
struct BoundVertex {
    /// [`u32::MAX`] where the binding names no tet.
    nodes: [u32; 4],
    weights: [f32; 4],
}

impl BoundSurface {
    /// Of the vertices with these bindings to a model's tets.
    pub fn new(bindings: &[Binding], tets: &[[u32; 4]]) -> BoundSurface {
        let mut surface = BoundSurface::default();
        surface.fit(bindings, tets);
        surface
    }

    /// Goes on as another surface, with what memory there is.
    pub fn fit(&mut self, bindings: &[Binding], tets: &[[u32; 4]]) {
        let nodes = |tet: u32| tets.get(tet as usize).copied().unwrap_or([u32::MAX; 4]);
        let vertex = |binding: &Binding| BoundVertex { nodes: nodes(binding.tet), weights: binding.weights };
        self.vertices.clear();
        self.vertices.extend(bindings.iter().map(vertex));
    }

    /// As [`surface_update`], with nodes in rows of (x, y, z, 0): to the same bits.
    pub(crate) fn update(&self, nodes: &[[f32; 4]], out_m: &mut [[f32; 3]]) -> usize {
        let mut left = self.vertices.len().abs_diff(out_m.len());
        for (vertex, out) in self.vertices.iter().zip(out_m) {
            match vertex.place(nodes) {
                Some([x, y, z, _]) => *out = [x, y, z],
                None => left += 1,
            }
        }
        left
    }
}

impl BoundVertex {
    fn place(&self, nodes: &[[f32; 4]]) -> Option<[f32; 4]> {
        let mut sum = [0.0f32; 4];
        for (node, weight) in self.nodes.into_iter().zip(self.weights) {
            let row = nodes.get(node as usize)?;
            for (sum, part) in sum.iter_mut().zip(row) {
                *sum += weight * part;
            }
        }
        Some(sum)
    }
}

fn minus(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
