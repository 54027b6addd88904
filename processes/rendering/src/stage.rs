//! The scene graph: objects that appear, move, hang on one another (`tree.rs`), change their topology and vanish while pictures are made.
//!
//! Promise: what streams in is read in place; handing it to the driver is the only copy. Topology is checked once, when it arrives: no later
//! picture can read outside a buffer. Positions are not checked: the passes draw a vertex that is not finite (or farther than 10 m) at its
//! rest position. Objects are drawn in the order of their ids.
mod lobes;
mod openness;
mod tree;

use std::collections::BTreeMap;

use bytemuck::{Pod, Zeroable};
use glam::{Mat4, Quat, Vec3};
use wgpu::BufferUsages as Usage;

use crate::{error::RenderError, gpu::Gpu, pipelines::Pipelines};

pub use openness::Surroundings;

/// Objects at one time: as many as a tissue registers (a cavity, its pathology, the pieces of a long session), and what is the picture's own.
pub const MAX_OBJECTS: usize = 256 + 16;
/// Triangles of one object: ten times the largest mesh that a station is asked to show.
pub const MAX_TRIANGLES: usize = 10_000_000;

/// How far the lobes of a growth stand out in the picture, m, those of a myoma, and tiles of the relief in a metre: lobes of some 4 mm. The collision knows
/// nothing of them, and they end before its wounds (`lobes.rs`).
const LOBES_M: f32 = 3.5e-4;
const KNOBS_M: f32 = 1.5e-4;
const LOBES_PER_M: f32 = 30.0;
/// Most light on what drifts: beside the lens it would be white.
const MOST_LIGHT: f32 = 0.9;
/// Coagulated spots of one object: what the shader has room for.
pub const MAX_SPOTS: usize = 64;

/// What a surface is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Material {
    /// the lining of the cavity
    MucosaTissue,
    /// a growth: paler and smoother, with more of the finest vessels
    Polyp,
    /// a growth of muscle: pale, smooth and shining, with large vessels; what is cut of it whorls
    Myoma,
    /// scope, sheath, loop
    Metal,
    /// bubbles: balls within facets whose vertices have as places at rest those about the middle, in radii
    Gas,
    /// what drifts in the medium: it throws no shadow
    Flake,
}

/// How an object looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Appearance {
    /// linear RGB, 0..=1
    pub base_colour: [f32; 3],
    /// what it is made of
    pub material: Material,
    /// 0 is a mirror, 1 is chalk
    pub roughness: f32,
    /// drawn by the external camera alone: the scope does not see its own shaft
    pub external_only: bool,
    /// light that metal gives itself, 0..=1: a wire with current in it
    pub glow: f32,
    /// burnt tissue that clings to metal, 0..=1: a wire that has cut
    pub eschar: f32,
}

impl Appearance {
    /// The usual look of a material.
    pub fn of(material: Material) -> Self {
        let (base_colour, roughness) = match material {
            Material::MucosaTissue => ([0.78, 0.34, 0.285], 0.30),
            Material::Polyp => ([0.76, 0.33, 0.28], 0.25),
            Material::Myoma => ([0.80, 0.52, 0.455], 0.25),
            Material::Metal => ([0.78, 0.79, 0.81], 0.30),
            Material::Gas => ([0.90, 0.93, 0.95], 0.05),
            Material::Flake => ([0.95, 0.80, 0.74], 0.5),
        };
        Self { base_colour, material, roughness, external_only: false, glow: 0.0, eschar: 0.0 }
    }
}

/// A surface as it first appears. All slices are borrowed for the call alone.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceMesh<'a> {
    /// vertex numbers, counter-clockwise seen from outside the tissue
    pub triangles: &'a [[u32; 3]],
    /// undeformed positions, m, one per vertex; texture sticks to them
    pub rest_m: &'a [[f32; 3]],
    /// 1 for each vertex on a wound, 0 for the others; may be empty if there is none
    pub raw: &'a [u32],
    /// its look
    pub appearance: Appearance,
}

/// What the scene pass reads per object.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(crate) struct ObjectUniform {
    model: [[f32; 4]; 4],
    colour: [f32; 4],
    surface: [f32; 4],
    extra: [f32; 4],
    mouths: [[f32; 4]; 2],
    shape: [f32; 4],
    spots: [[f32; 4]; MAX_SPOTS],
}

impl Object {
    /// Draws it with the pipeline that is set.
    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        pass.set_bind_group(1, &self.look, &[]);
        for (slot, points) in (0..).zip([&self.positions, &self.normals, &self.rest, &self.raw, &self.open, &self.lobes]) {
            pass.set_vertex_buffer(slot, points.slice(..));
        }
        pass.set_index_buffer(self.triangles.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(0..self.indices, 0, 0..1);
    }
}

pub(crate) struct Object {
    pub positions: wgpu::Buffer,
    pub normals: wgpu::Buffer,
    pub rest: wgpu::Buffer,
    pub raw: wgpu::Buffer,
    pub open: wgpu::Buffer,
    pub lobes: wgpu::Buffer,
    pub triangles: wgpu::Buffer,
    pub uniform: wgpu::Buffer,
    pub look: wgpu::BindGroup,
    pub shape: wgpu::BindGroup,
    pub vertices: usize,
    pub indices: u32,
    pub appearance: Appearance,
    pub moved: bool,
    pose: Mat4,
    parent: Option<u64>,
    mouths: [[f32; 4]; 2],
    spots: [[f32; 4]; MAX_SPOTS],
}

/// All objects, and the buffers that the passes read.
pub struct Stage {
    device: wgpu::Device,
    queue: wgpu::Queue,
    pipelines: std::sync::Arc<Pipelines>,
    pub(crate) objects: BTreeMap<u64, Object>,
}

impl std::fmt::Debug for Stage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Stage").field("objects", &self.objects.keys()).finish_non_exhaustive()
    }
}

impl Stage {
    pub(crate) fn new(gpu: &Gpu, pipelines: std::sync::Arc<Pipelines>) -> Self {
        Self { device: gpu.device.clone(), queue: gpu.queue.clone(), pipelines, objects: BTreeMap::new() }
    }

    /// Puts an object on the stage at its rest positions, or replaces the one of this id (after a cut), whose pose and place in the graph are kept.
    ///
    /// # Errors
    /// [`RenderError::BadTriangle`], [`RenderError::TooLarge`], [`RenderError::WrongLength`]; the stage is as before.
    pub fn set_object(&mut self, id: u64, mesh: SurfaceMesh<'_>) -> Result<(), RenderError> {
        bound("triangles", mesh.triangles.len(), MAX_TRIANGLES)?;
        bound("vertices", mesh.rest_m.len(), MAX_TRIANGLES)?;
        let others = self.objects.len() - usize::from(self.objects.contains_key(&id));
        bound("objects", others + 1, MAX_OBJECTS)?;
        if !mesh.raw.is_empty() && mesh.raw.len() != mesh.rest_m.len() {
            return Err(RenderError::WrongLength { object: id, got: mesh.raw.len(), expected: mesh.rest_m.len() });
        }
        let (first, incident) = incidence(id, mesh.triangles, mesh.rest_m.len())?;
        let kept = self.objects.get(&id).map_or((Mat4::IDENTITY, None), |o| (o.pose, o.parent));
        let object = self.build(&mesh, &first, &incident, kept);
        self.write_uniform(&object, 1.0);
        self.objects.insert(id, object);
        Ok(())
    }

    /// New positions, m, for every vertex of an object: one copy, from the borrowed slice to the driver.
    ///
    /// # Errors
    /// [`RenderError::UnknownObject`], [`RenderError::WrongLength`]; the object stays as it was.
    pub fn update_positions(&mut self, id: u64, positions_m: &[[f32; 3]]) -> Result<(), RenderError> {
        let object = self.objects.get_mut(&id).ok_or(RenderError::UnknownObject(id))?;
        if positions_m.len() != object.vertices {
            return Err(RenderError::WrongLength { object: id, got: positions_m.len(), expected: object.vertices });
        }
        if !positions_m.is_empty() {
            self.queue.write_buffer(&object.positions, 0, bytemuck::cast_slice(positions_m));
        }
        object.moved = true;
        Ok(())
    }

    /// Moves a rigid object: `position_m` of its origin, unit quaternion (x, y, z, w), in the frame of what it hangs on. One that is not finite moves nothing.
    ///
    /// # Errors
    /// [`RenderError::UnknownObject`].
    pub fn set_pose(&mut self, id: u64, position_m: [f32; 3], rotation: [f32; 4]) -> Result<(), RenderError> {
        let object = self.objects.get_mut(&id).ok_or(RenderError::UnknownObject(id))?;
        let (p, q) = (Vec3::from(position_m), Quat::from_array(rotation));
        if p.is_finite() && p.length() < 10.0 && q.is_finite() && (0.5..2.0).contains(&q.length()) {
            object.pose = Mat4::from_rotation_translation(q.normalize(), p);
        }
        Ok(())
    }

    /// A new look for an object that stays as it is.
    ///
    /// # Errors
    /// [`RenderError::UnknownObject`].
    pub fn set_appearance(&mut self, id: u64, appearance: Appearance) -> Result<(), RenderError> {
        let object = self.objects.get_mut(&id).ok_or(RenderError::UnknownObject(id))?;
        object.appearance = appearance;
        Ok(())
    }

    /// Where dark mouths are drawn in an object's lining, as [`crate::ostia`] gives them. A number that is not finite draws none.
    ///
    /// # Errors
    /// [`RenderError::UnknownObject`].
    pub fn set_mouths(&mut self, id: u64, mouths_m: [[f32; 4]; 2]) -> Result<(), RenderError> {
        let object = self.objects.get_mut(&id).ok_or(RenderError::UnknownObject(id))?;
        object.mouths = mouths_m.map(|mouth| if mouth.iter().all(|number| number.is_finite()) { mouth } else { [0.0; 4] });
        Ok(())
    }

    /// Where an object is blanched by coagulation: places at rest, m, and radii, m, the first [`MAX_SPOTS`] of them. One with a number that is not finite is
    /// not drawn.
    ///
    /// # Errors
    /// [`RenderError::UnknownObject`].
    pub fn set_spots(&mut self, id: u64, spots_m: &[[f32; 4]]) -> Result<(), RenderError> {
        let object = self.objects.get_mut(&id).ok_or(RenderError::UnknownObject(id))?;
        object.spots = [[0.0; 4]; MAX_SPOTS];
        let sound = spots_m.iter().filter(|spot| spot.iter().all(|number| number.is_finite()) && spot[3] > 0.0);
        for (place, spot) in object.spots.iter_mut().zip(sound) {
            *place = *spot;
        }
        Ok(())
    }

    /// Ids of all objects, ascending.
    pub fn ids(&self) -> impl Iterator<Item = u64> + '_ {
        self.objects.keys().copied()
    }

    /// Hands poses and looks to the driver; called once per frame.
    pub(crate) fn flush(&self, tissue_alpha: f32) {
        for object in self.objects.values() {
            self.write_uniform(object, tissue_alpha);
        }
    }

    fn write_uniform(&self, object: &Object, tissue_alpha: f32) {
        let look = object.appearance;
        let alpha = if look.material == Material::MucosaTissue { tissue_alpha } else { 1.0 };
        let (vessels, bump, frequency, glands) = match look.material {
            Material::MucosaTissue => (0.75, 0.50, 62.0, 1.0),
            Material::Polyp => (1.0, 0.24, 80.0, 0.25),
            Material::Myoma => (1.0, 0.24, 48.0, 0.0),
            Material::Metal => (0.0, 0.0, 60.0, 0.0),
            Material::Gas => (0.0, 0.0, 60.0, 0.0),
            Material::Flake => (0.0, 0.24, 80.0, 0.0),
        };
        let shape = match look.material {
            Material::Polyp => [LOBES_M, LOBES_PER_M, 0.0, 0.0],
            Material::Myoma => [KNOBS_M, LOBES_PER_M, 0.0, 1.0],
            Material::Flake => [0.0, 0.0, MOST_LIGHT, 0.0],
            _ => [0.0; 4],
        };
        let [r, g, b] = look.base_colour.map(|c| share(c, 0.5));
        let [glow, eschar] = [look.glow, look.eschar].map(|of_metal| share(of_metal, 0.0));
        // Of the half that is cut away neither the lining is shown nor the gas under it.
        let whole = if matches!(look.material, Material::MucosaTissue | Material::Gas) { 0.0 } else { 1.0 };
        let uniform = ObjectUniform {
            model: self.world(object).to_cols_array_2d(),
            colour: [r, g, b, alpha],
            surface: [share(look.roughness, 0.5), frequency, vessels, bump],
            extra: [whole, eschar, glow, glands],
            mouths: object.mouths,
            shape,
            spots: object.spots,
        };
        self.queue.write_buffer(&object.uniform, 0, bytemuck::bytes_of(&uniform));
    }

    fn build(&self, mesh: &SurfaceMesh<'_>, first: &[u32], incident: &[u32], (pose, parent): (Mat4, Option<u64>)) -> Object {
        let rest: &[u8] = bytemuck::cast_slice(mesh.rest_m);
        let corners: &[u8] = bytemuck::cast_slice(mesh.triangles);
        let points = Usage::VERTEX | Usage::STORAGE;
        let positions = self.filled("positions", rest, points);
        let normals = self.filled("normals", rest, points);
        let rest = self.filled("rest", rest, points);
        let smooth = vec![0; if mesh.raw.is_empty() { mesh.rest_m.len() } else { 0 }];
        let raw: &[u32] = if mesh.raw.is_empty() { &smooth } else { mesh.raw };
        let raw = self.filled("raw", bytemuck::cast_slice(raw), Usage::VERTEX);
        let open = self.filled("open", bytemuck::cast_slice(&vec![1.0_f32; mesh.rest_m.len()]), Usage::VERTEX);
        let lobes = self.filled("lobes", bytemuck::cast_slice(&lobes::shown(mesh, first, incident)), Usage::VERTEX);
        let triangles = self.filled("triangles", corners, Usage::INDEX | Usage::STORAGE);
        let first = self.filled("first", bytemuck::cast_slice(first), Usage::STORAGE);
        let incident = self.filled("incident", bytemuck::cast_slice(incident), Usage::STORAGE);
        let uniform = self.filled("object", bytemuck::bytes_of(&ObjectUniform::zeroed()), Usage::UNIFORM);
        let shape = self.pipelines.shape_group(&self.device, [&positions, &rest, &triangles, &first, &incident, &normals]);
        let look = self.pipelines.object_group(&self.device, &uniform);
        Object {
            positions,
            normals,
            rest,
            raw,
            open,
            lobes,
            triangles,
            uniform,
            look,
            shape,
            vertices: mesh.rest_m.len(),
            indices: 3 * mesh.triangles.len() as u32,
            appearance: mesh.appearance,
            moved: true,
            pose,
            parent,
            mouths: [[0.0; 4]; 2],
            spots: [[0.0; 4]; MAX_SPOTS],
        }
    }

    /// A buffer with these bytes in it; never of size zero, which Vulkan does not know.
    fn filled(&self, label: &str, bytes: &[u8], usage: Usage) -> wgpu::Buffer {
        let size = (bytes.len().max(16) as u64).next_multiple_of(4);
        let usage = usage | Usage::COPY_DST;
        let buffer =
            self.device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false });
        if !bytes.is_empty() {
            self.queue.write_buffer(&buffer, 0, bytes);
        }
        buffer
    }
}

/// A share, or `otherwise` if it is no number.
fn share(x: f32, otherwise: f32) -> f32 {
    if x.is_finite() { x.clamp(0.0, 1.0) } else { otherwise }
}

fn bound(what: &'static str, got: usize, bound: usize) -> Result<(), RenderError> {
    if got > bound { Err(RenderError::TooLarge { what, got, bound }) } else { Ok(()) }
}

/// For each vertex the numbers of its triangles, ascending: where they begin, and the numbers.
fn incidence(object: u64, triangles: &[[u32; 3]], vertices: usize) -> Result<(Vec<u32>, Vec<u32>), RenderError> {
    let mut first = vec![0_u32; vertices + 1];
    for (triangle, corners) in triangles.iter().enumerate() {
        for &vertex in corners {
            if vertex as usize >= vertices {
                return Err(RenderError::BadTriangle { object, triangle, vertex, vertices });
            }
            first[vertex as usize + 1] += 1;
        }
    }
    for v in 0..vertices {
        first[v + 1] += first[v];
    }
    let mut next = first.clone();
    let mut incident = vec![0_u32; 3 * triangles.len()];
    for (triangle, corners) in triangles.iter().enumerate() {
        for &vertex in corners {
            let slot = &mut next[vertex as usize];
            incident[*slot as usize] = triangle as u32;
            *slot += 1;
        }
    }
    Ok((first, incident))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn incidence_lists_each_corner_once_in_order() {
        let (first, incident) = incidence(0, &[[0, 1, 2], [2, 1, 3]], 5).unwrap();
        assert_eq!(first, [0, 1, 3, 5, 6, 6]);
        assert_eq!(incident, [0, 0, 1, 0, 1, 1]);
    }

    #[test]
    fn a_triangle_outside_its_vertices_is_named() {
        let text = incidence(9, &[[0, 1, 2], [0, 1, 7]], 3).unwrap_err().to_string();
        assert!(text.contains("object 9") && text.contains("triangle 1") && text.contains("vertex 7 of 3"), "{text}");
    }
}
