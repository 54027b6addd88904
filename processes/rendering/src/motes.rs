//! Flakes of the lining that drift in the medium, as they do in any cavity that is rinsed: what the eye reads the flow and the depth by.
//!
//! Promise: they are of the picture alone and no tissue; each stands at a place of the station's frame and goes with the medium, so that a scope that
//! moves passes them; those that a wall hides, and those close to the lens, are not seen. The same calls give the same flakes.
use glam::Vec3;

use crate::error::RenderError;
use crate::stage::{Appearance, Material, Stage, SurfaceMesh};

/// How many there are about the lens.
const COUNT: usize = 48;
/// Side of the cube about the lens that they fill, again and again, m: a cavity is hardly wider.
const SIDE_M: f32 = 0.030;
/// None is drawn nearer to the lens, m.
const NEAREST_M: f32 = 0.004;
/// Size, from the smallest to the largest, m.
const RADIUS_M: [f32; 2] = [0.000_04, 0.000_16];
/// Speed for each ml/min that goes through the cavity, and the most, m/s: the mean over a section of some 1 cm², several times over near the stream.
const SPEED_M_S: [f32; 2] = [2.0e-5, 4.0e-3];
/// How far and over what way eddies carry one aside, m.
const EDDY_M: [f32; 2] = [0.001, 0.006];
/// Where the corners lie that draw nothing: all in one place.
const NOWHERE_M: [f32; 3] = [0.0; 3];

/// The flakes of one stage.
#[derive(Debug)]
pub struct Motes {
    id: u64,
    flakes: Vec<Flake>,
    corners_m: Vec<[f32; 3]>,
    /// How far the medium has gone.
    way_m: f32,
}

/// One of them: its place in the cube, its four corners about it, where it is in its eddy.
#[derive(Debug, Clone, Copy)]
struct Flake {
    place_m: Vec3,
    corners_m: [Vec3; 4],
    phase: f32,
}

impl Motes {
    /// None on the stage yet; there they have this id.
    pub fn new(id: u64) -> Self {
        Self { id, flakes: (0..COUNT as u32).map(Flake::of).collect(), corners_m: Vec::new(), way_m: 0.0 }
    }

    /// Moves them on with the medium, and shows those about a lens, or none from outside. Gives the bytes that were uploaded.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] if the stage is full; it is as before.
    pub fn drift(
        &mut self,
        stage: &mut Stage,
        lens_m: Option<[f32; 3]>,
        flow_ml_min: f32,
        elapsed_s: f32,
    ) -> Result<u64, RenderError> {
        let speed_m_s = (SPEED_M_S[0] * flow_ml_min).clamp(0.0, SPEED_M_S[1]);
        let far_m = speed_m_s * elapsed_s.clamp(0.0, 0.1);
        self.way_m += if far_m.is_finite() { far_m } else { 0.0 };
        if self.corners_m.is_empty() {
            self.put(stage)?;
        }
        let lens_m = lens_m.map(Vec3::from).filter(|lens_m| lens_m.is_finite());
        for (flake, corners) in self.flakes.iter().zip(self.corners_m.chunks_exact_mut(4)) {
            let place_m = lens_m.map(|lens_m| flake.at(self.way_m, lens_m)).filter(|(_, off_m)| *off_m > NEAREST_M);
            for (corner, of) in corners.iter_mut().zip(flake.corners_m) {
                *corner = place_m.map_or(NOWHERE_M, |(place_m, _)| (place_m + of).to_array());
            }
        }
        stage.update_positions(self.id, &self.corners_m)?;
        Ok(size_of_val(self.corners_m.as_slice()) as u64)
    }

    fn put(&mut self, stage: &mut Stage) -> Result<(), RenderError> {
        let faces = |flake: u32| [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]].map(|face| face.map(|corner| 4 * flake + corner));
        let triangles: Vec<[u32; 3]> = (0..COUNT as u32).flat_map(faces).collect();
        let corners = |flake: &Flake| flake.corners_m.map(|corner| (flake.place_m + corner).to_array());
        let rest_m: Vec<[f32; 3]> = self.flakes.iter().flat_map(corners).collect();
        let appearance = Appearance { base_colour: [0.95, 0.80, 0.74], roughness: 0.5, ..Appearance::of(Material::Polyp) };
        stage.set_object(self.id, SurfaceMesh { triangles: &triangles, rest_m: &rest_m, raw: &[], appearance })?;
        self.corners_m = rest_m;
        Ok(())
    }
}

impl Flake {
    fn of(number: u32) -> Self {
        let share = |salt: u32| (crate::hash::hash([number, salt, 0], 77) >> 8) as f32 / (1 << 24) as f32;
        let radius_m = RADIUS_M[0] + (RADIUS_M[1] - RADIUS_M[0]) * share(3).powi(2);
        // A flat piece, turned anyhow.
        let turn = glam::Quat::from_euler(glam::EulerRot::XYZ, 6.3 * share(4), 6.3 * share(5), 6.3 * share(6));
        let flat = [[0.0, 0.0, 0.35], [1.0, 0.2, -0.1], [-0.6, 0.8, -0.1], [-0.5, -0.9, -0.1]];
        Self {
            place_m: Vec3::new(share(0), share(1), share(2)) * SIDE_M,
            corners_m: flat.map(|corner| turn * Vec3::from(corner) * radius_m),
            phase: 6.3 * share(7),
        }
    }

    /// Its place when the medium has gone so far, of all cubes in the one about the lens, and its distance from that, m.
    fn at(&self, way_m: f32, lens_m: Vec3) -> (Vec3, f32) {
        let turn = self.phase + way_m / EDDY_M[1];
        let eddy = Vec3::new(turn.sin(), (1.3 * turn).cos(), (0.7 * turn).sin()) * EDDY_M[0];
        let off = self.place_m + Vec3::new(0.2, 0.3, 0.9) * way_m + eddy - lens_m;
        let off = off - (off / SIDE_M).round() * SIDE_M;
        (lens_m + off, off.length())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flakes_stay_where_they_are_while_the_scope_goes_by_and_go_with_the_medium() {
        let flakes: Vec<Flake> = (0..COUNT as u32).map(Flake::of).collect();
        let (here, there) = (Vec3::new(0.0, 0.0, 0.03), Vec3::new(0.001, 0.0, 0.031));
        let stays = |flake: &&Flake| flake.at(0.0, here).0.distance(flake.at(0.0, there).0) < 1e-6;
        assert!(flakes.iter().filter(stays).count() * 10 > COUNT * 8, "all but those that come into the cube on its other side");
        for flake in &flakes {
            let (place, off_m) = flake.at(0.0, here);
            assert!((place - here).abs().max_element() <= 0.5 * SIDE_M + 1e-6 && (off_m - place.distance(here)).abs() < 1e-6);
            let moved = flake.at(1e-4, here).0.distance(place);
            assert!((1e-5..2e-4).contains(&moved) || moved > 0.9 * SIDE_M, "{moved}");
        }
    }
}
