//! Gas in the medium: each parcel as one bubble of its volume, all of them one object on the stage.
//!
//! A parcel of the flow is a point that stays clear of the wall by less than a bubble of all its gas would. It is drawn with its top there, as bubbles hang
//! under a ceiling, or those would be cut off by the wall.
//!
//! Promise: without gas the stage is what it was; a parcel whose numbers make no sense is not drawn; the object is made anew only when there are twice
//! as many parcels as before.

use crate::error::RenderError;
use crate::shapes::{Shape, ball};
use crate::stage::{Appearance, Material, Stage, SurfaceMesh};

/// Parcels that are drawn at most.
const MOST: usize = 1_024;
/// Parcels that there is room for at first.
const FIRST: usize = 32;
/// Largest volume of a parcel, ml: nothing larger is a bubble.
const LARGEST_ML: f32 = 1.0;
/// How far the corners of a bubble's facets are from its middle, in radii: so far that they cut nothing off it, for `scene.wgsl` draws the ball within.
const CORNERS: f32 = 1.07;
/// Where the corners lie that draw nothing: all in one place.
const NOWHERE_M: [f32; 3] = [0.0; 3];

/// The bubbles of one stage.
#[derive(Debug)]
pub struct Bubbles {
    id: u64,
    /// The facets of one of radius 1 about the origin.
    ball: Shape,
    corners_m: Vec<[f32; 3]>,
    /// Parcels that the object has room for; 0: it is not on the stage.
    room: usize,
}

impl Bubbles {
    /// None yet; on the stage they have this id.
    pub fn new(id: u64) -> Self {
        Self { id, ball: ball([0.0; 3], CORNERS, 7, 12), corners_m: Vec::new(), room: 0 }
    }

    /// Shows these parcels: place, m, and volume, ml; a volume of 0 is none. The patient lies on her back, so that their tops are towards +y. Gives the bytes
    /// that were uploaded.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] if the stage is full; it is as before.
    pub fn show(&mut self, stage: &mut Stage, parcels: &[[f32; 4]]) -> Result<u64, RenderError> {
        let is_one = |parcel: &&[f32; 4]| {
            parcel.iter().all(|value| value.abs() < 10.0) && (0.0..=LARGEST_ML).contains(&parcel[3]) && parcel[3] > 0.0
        };
        let count = parcels.iter().filter(is_one).take(MOST).count();
        if count == 0 {
            if std::mem::take(&mut self.room) > 0 {
                stage.remove_object(self.id);
            }
            return Ok(0);
        }
        if count > self.room {
            self.put(stage, count.next_power_of_two().max(FIRST))?;
        }
        self.corners_m.clear();
        for [x, y, z, volume_ml] in parcels.iter().filter(is_one).take(MOST) {
            let radius_m = (volume_ml * 1e-6 * 0.75 / std::f32::consts::PI).cbrt();
            let corner_m = |[a, b, c]: &[f32; 3]| [x + radius_m * a, y + radius_m * (b - 1.0), z + radius_m * c];
            self.corners_m.extend(self.ball.positions_m.iter().map(corner_m));
        }
        self.corners_m.resize(self.room * self.ball.positions_m.len(), NOWHERE_M);
        stage.update_positions(self.id, &self.corners_m)?;
        Ok(size_of_val(self.corners_m.as_slice()) as u64)
    }

    /// Puts an object with room for so many parcels on the stage.
    fn put(&mut self, stage: &mut Stage, room: usize) -> Result<(), RenderError> {
        let corners = self.ball.positions_m.len();
        let of = |parcel: usize| {
            let first = (parcel * corners) as u32;
            self.ball.triangles.iter().map(move |triangle| triangle.map(|corner| first + corner))
        };
        let triangles: Vec<[u32; 3]> = (0..room).flat_map(of).collect();
        // By them the shader knows where the ball is within its facets.
        let rest_m = self.ball.positions_m.repeat(room);
        let appearance = Appearance::of(Material::Gas);
        stage.set_object(self.id, SurfaceMesh { triangles: &triangles, rest_m: &rest_m, raw: &[], appearance })?;
        self.room = room;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn the_facets_of_a_bubble_cut_nothing_off_it_and_stand_close_about_it() {
        let facets = Bubbles::new(1).ball;
        let nearest = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|corner| Vec3::from(facets.positions_m[corner as usize]));
            let normal = (b - a).cross(c - a);
            // At its poles a triangle of each pair is a line.
            (normal.length() > 1e-6).then(|| a.dot(normal.normalize()))
        };
        let distances: Vec<f32> = facets.triangles.iter().filter_map(nearest).collect();
        assert!(distances.len() > 100 && distances.iter().all(|distance| (1.0..1.07).contains(distance)), "{distances:?}");
    }
}
