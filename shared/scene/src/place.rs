//! How an object comes from the frame of its file to its place in the scene.

use crate::file::{Deformable, Place};
use crate::locate::{Locator, bounds};
use glam::{EulerRot, Quat, Vec3};
use hyst_mesh::TetMesh;

/// Distance from the pivot at which an organ placed by itself begins on the scope's axis: the scope reaches it, and has room to start.
pub(crate) const FRONT_M: f32 = 0.03;
/// Steps along the axis in which its beginning is found, per extent of the organ.
const STEPS: u32 = 2_000;

/// Scale, then rotation, then translation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Transform {
    pub(crate) scale: f32,
    pub(crate) rotation: Quat,
    pub(crate) translation_m: Vec3,
}

impl Transform {
    /// What the scene gives, with a scale found elsewhere if it gives none.
    pub(crate) fn given(object: &Deformable, scale: f64) -> Transform {
        let [x, y, z] = object.rotate_deg.unwrap_or_default().map(|angle| angle.to_radians() as f32);
        Transform {
            scale: object.scale_to_m.unwrap_or(scale) as f32,
            rotation: Quat::from_euler(EulerRot::ZYX, z, y, x),
            translation_m: Vec3::from(object.translate_m.unwrap_or_default().map(|shift| shift as f32)),
        }
    }

    pub(crate) fn apply(&self, positions: &mut [[f32; 3]]) {
        for position in positions {
            *position = (self.rotation * (Vec3::from(*position) * self.scale) + self.translation_m).to_array();
        }
    }
}

/// Whether the object is to be placed by itself.
pub(crate) fn is_auto(object: &Deformable) -> bool {
    let nothing_given = object.scale_to_m.is_none() && object.rotate_deg.is_none() && object.translate_m.is_none();
    object.place.map_or(nothing_given, |place| place == Place::Auto)
}

/// The translation that brings an organ, already in metres and turned, in front of the scope: the pivot's axis goes through the
/// tet nearest to the organ's middle, and meets its first tet [`FRONT_M`] from the pivot.
pub(crate) fn in_front(mesh: &TetMesh, pivot_m: [f32; 3]) -> Vec3 {
    let (low, high) = bounds(&mesh.positions_m);
    let centre = |tet: &[u32; 4]| tet.iter().map(|&node| Vec3::from(mesh.positions_m[node as usize])).sum::<Vec3>() / 4.0;
    let middle = mesh.tets.iter().map(centre).sum::<Vec3>() / mesh.tets.len().max(1) as f32;
    let distance = |tet: &[u32; 4]| centre(tet).distance_squared(middle);
    let nearest = mesh.tets.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).map_or(middle, centre);
    let locator = Locator::new(mesh);
    let height = |step: u32| low.z + (high.z - low.z) * step as f32 / STEPS as f32;
    let front = (0..=STEPS).map(height).find(|&z| locator.find([nearest.x, nearest.y, z]).is_some());
    let front = Vec3::new(nearest.x, nearest.y, front.unwrap_or(low.z));
    Vec3::from(pivot_m) + Vec3::Z * FRONT_M - front
}
