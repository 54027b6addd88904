//! A straight way through a tet that is too flat for weights: a sliver that a repair has kept, or tissue that is crushed.
//!
//! Seen along the way a tet covers a place with two of its faces or with none, however flat it is and whichever way round. So the way leaves by the one other
//! face that covers it: each two of that face's corners turn about the way in the same sense. This is asked of areas, and divided by none of the tet's volume.
//! The test is that of Platis and Theoharis, "Fast ray-tetrahedron intersection using Plücker coordinates" (Journal of Graphics Tools 8, 2003).

use crate::topology::FACES;
use glam::Vec3;

/// A face has at least this share of the square of its corners' distance, seen along the way: a thousand times what rounding makes of that.
const SEEN: f32 = 1e-4;
/// By what share of a face a way may miss it that goes through: rounding.
const ROUNDING: f32 = 1e-3;

/// A flat tet and the way through it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Flat<'a> {
    /// Its corners, metres.
    pub corners: &'a [[f32; 3]; 4],
    /// A place on the way, near the tet, metres.
    pub at: Vec3,
    /// The whole way, metres.
    pub way: Vec3,
}

impl Flat<'_> {
    /// The face by which the way leaves; `None` where a corner is nowhere.
    pub fn way_out(&self, came_in: impl Fn(usize) -> bool) -> Option<usize> {
        let mut best: Option<(f32, usize)> = None;
        for face in (0..4).filter(|face| !came_in(*face)) {
            let areas = self.areas(face);
            if !areas.is_finite() {
                return None;
            }
            // Where rounding leaves none that covers the place, the one that is nearest to it.
            let least = (areas * areas.element_sum().signum()).min_element();
            if best.is_none_or(|(most, _)| least > most) {
                best = Some((least, face));
            }
        }
        best.map(|(_, face)| face)
    }

    /// Whether the way goes through a face, and that is not seen from its edge, where all that is asked of it is rounding.
    pub fn covers(&self, face: usize) -> bool {
        let areas = self.areas(face);
        let sum = areas.element_sum();
        let farthest = FACES[face].map(|corner| Vec3::from_array(self.corners[corner]).distance_squared(self.at));
        let largest = farthest.into_iter().fold(0.0, f32::max) * self.way.length();
        sum.abs() > SEEN * largest && (areas * sum.signum()).min_element() >= -ROUNDING * sum.abs()
    }

    /// How far beyond the place the way goes through a face, as a share of the whole way; no number for a face that is seen from its edge.
    pub fn beyond(&self, face: usize) -> f32 {
        let weighed = self.corners.iter().zip(self.weights(face));
        let through: Vec3 = weighed.map(|(corner, weight)| weight * (Vec3::from_array(*corner) - self.at)).sum();
        through.dot(self.way) / self.way.length_squared()
    }

    /// Weights of the corners where the way goes through a face; likewise.
    pub fn weights(&self, face: usize) -> [f32; 4] {
        let areas = self.areas(face);
        let shares = (areas / areas.element_sum()).clamp(Vec3::ZERO, Vec3::ONE);
        let shares = shares / shares.element_sum();
        let mut weights = [0.0; 4];
        FACES[face].into_iter().zip(shares.to_array()).for_each(|(corner, share)| weights[corner] = share);
        weights
    }

    /// The normal of a face by which the way leaves, outward; of any length.
    pub fn outward(&self, face: usize) -> Vec3 {
        let [a, b, c] = FACES[face].map(|corner| Vec3::from_array(self.corners[corner]));
        let normal = (b - a).cross(c - a);
        if normal.dot(self.way) < 0.0 { -normal } else { normal }
    }

    /// For each corner of a face twice the area that the other two make with the way, seen along it, times the length of that: all of one sign where the way goes
    /// through the face.
    fn areas(&self, face: usize) -> Vec3 {
        let [a, b, c] = FACES[face].map(|corner| Vec3::from_array(self.corners[corner]) - self.at);
        Vec3::new(b.cross(c).dot(self.way), c.cross(a).dot(self.way), a.cross(b).dot(self.way))
    }
}
