//! What developers see in the view from outside: arrows where the tip touches, and one for the force on the hand.
//!
//! Promise: the lens sees none of them; an arrow whose numbers make no sense is not drawn.

use glam::{Quat, Vec3};

use crate::error::RenderError;
use crate::shapes::{Shape, arrow};
use crate::stage::{Appearance, Material, Stage, SurfaceMesh};

/// Arrows of one kind at most: the planes of a contact model.
const MOST: usize = 8;
/// Half the width of an arrow's shaft, m.
const RADIUS_M: f32 = 0.000_3;
/// Longest arrow, m: a force that no device makes.
const LONGEST_M: f32 = 0.1;
/// Linear colours: contacts, force.
const COLOURS: [[f32; 3]; 2] = [[0.15, 0.95, 0.30], [1.0, 0.80, 0.10]];

/// From a point along a vector, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arrow {
    /// where it begins
    pub from_m: [f32; 3],
    /// how far it goes
    pub along_m: [f32; 3],
}

/// The arrows of one stage.
#[derive(Debug)]
pub struct Marks {
    ids: [u64; 2],
    /// One of length 1 and radius 1 along +z.
    arrow: Shape,
    corners_m: Vec<[f32; 3]>,
    is_on: bool,
}

impl Marks {
    /// None yet; on the stage they have these ids, contacts and force.
    pub fn new(ids: [u64; 2]) -> Self {
        Self { ids, arrow: arrow(), corners_m: Vec::new(), is_on: false }
    }

    /// Takes them off the stage.
    pub fn clear(&mut self, stage: &mut Stage) {
        if std::mem::take(&mut self.is_on) {
            for id in self.ids {
                stage.remove_object(id);
            }
        }
    }

    /// Shows up to eight contacts and the force. Gives the bytes that were uploaded.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] if the stage is full.
    pub fn show(&mut self, stage: &mut Stage, contacts: &[Arrow], force: Arrow) -> Result<u64, RenderError> {
        if !self.is_on {
            for (id, (colour, room)) in self.ids.into_iter().zip(COLOURS.into_iter().zip([MOST, 1])) {
                self.put(stage, id, colour, room)?;
            }
            self.is_on = true;
        }
        let mut uploaded = 0;
        for (id, (arrows, room)) in self.ids.into_iter().zip([(contacts, MOST), (std::slice::from_ref(&force), 1)]) {
            self.corners_m.clear();
            for arrow in arrows.iter().take(room) {
                self.corners_m.extend(corners(&self.arrow, arrow));
            }
            self.corners_m.resize(room * self.arrow.positions_m.len(), [0.0; 3]);
            stage.update_positions(id, &self.corners_m)?;
            uploaded += size_of_val(self.corners_m.as_slice()) as u64;
        }
        Ok(uploaded)
    }

    /// Puts an object with room for so many arrows on the stage.
    fn put(&self, stage: &mut Stage, id: u64, base_colour: [f32; 3], room: usize) -> Result<(), RenderError> {
        let corners = self.arrow.positions_m.len();
        let of = |index: usize| {
            self.arrow.triangles.iter().map(move |triangle| triangle.map(|corner| (index * corners) as u32 + corner))
        };
        let triangles: Vec<[u32; 3]> = (0..room).flat_map(of).collect();
        let rest_m = vec![[0.0; 3]; room * corners];
        let appearance = Appearance { base_colour, external_only: true, ..Appearance::of(Material::Metal) };
        stage.set_object(id, SurfaceMesh { triangles: &triangles, rest_m: &rest_m, raw: &[], appearance })
    }
}

/// The corners of an arrow; all in one place if it is none.
fn corners(unit: &Shape, arrow: &Arrow) -> impl Iterator<Item = [f32; 3]> {
    let (from, along) = (Vec3::from(arrow.from_m), Vec3::from(arrow.along_m));
    let length = along.length();
    let is_one = from.is_finite() && from.length() < 10.0 && length > 0.0 && length <= LONGEST_M;
    let turn = if is_one { Quat::from_rotation_arc(Vec3::Z, along / length) } else { Quat::IDENTITY };
    let place = move |[x, y, z]: [f32; 3]| (from + turn * Vec3::new(x * RADIUS_M, y * RADIUS_M, z * length)).to_array();
    unit.positions_m.iter().map(move |point| if is_one { place(*point) } else { [0.0; 3] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_arrow_goes_from_its_point_to_its_end_and_none_that_makes_no_sense_is_drawn() {
        let unit = arrow();
        let sound = Arrow { from_m: [0.01, 0.0, 0.02], along_m: [0.0, 0.005, 0.0] };
        let points: Vec<[f32; 3]> = corners(&unit, &sound).collect();
        let (low, high) = points.iter().fold((f32::MAX, f32::MIN), |(low, high), [_, y, _]| (low.min(*y), high.max(*y)));
        assert!(low.abs() < 1e-6 && (high - 0.005).abs() < 1e-6, "{low} to {high}");
        assert!(points.iter().all(|[x, _, z]| (x - 0.01).hypot(z - 0.02) < 4.0 * RADIUS_M));
        for broken in [[f32::NAN, 0.0, 0.0], [0.0; 3], [9.0, 0.0, 0.0]] {
            assert!(corners(&unit, &Arrow { along_m: broken, ..sound }).all(|point| point == [0.0; 3]), "{broken:?}");
        }
    }
}
