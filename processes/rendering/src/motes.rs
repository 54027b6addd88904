//! Flakes of the lining that drift in the medium, as they do in any cavity that is rinsed: what the eye reads the flow and the depth by.
//!
//! Promise: they are of the picture alone and no tissue; each stands at a place of the station's frame and goes with the medium, so that a scope that
//! moves passes them; those that a wall hides, and those close to the lens, are not seen. The same calls give the same flakes.
//!
//! Where the medium's velocities are known they are carried by those, into no wall, and each is replaced after some seconds by another one elsewhere: the
//! medium goes where it is sucked off, and would leave the cavity empty. Where they are not, all go one way, as fast as the inflow.
use glam::Vec3;

use crate::error::RenderError;
use crate::flow::FlowField;
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
/// Longest time between two pictures that they are moved on for, s.
const LONGEST_S: f32 = 0.1;
/// Times for which they are carried before another one takes their place, from the shortest to the longest, s: a cavity of 10 ml is rinsed in some 3 s.
const LIFE_S: [f32; 2] = [4.0, 8.0];
/// Time in which one comes into view, and goes, s.
const FADE_S: f32 = 0.5;
/// Speed at which they wander in a medium that stands still, m/s, and the time of a turn there, s.
const WANDER_M_S: f32 = 3.0e-4;
const WANDER_S: f32 = 2.0;
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
    number: u32,
    place_m: Vec3,
    corners_m: [Vec3; 4],
    phase: f32,
    /// How many were carried in its place before, for how long it has been, and will be, s.
    before: u32,
    age_s: f32,
    life_s: f32,
    /// Share of its size that is drawn.
    size: f32,
}

impl Motes {
    /// None on the stage yet; there they have this id.
    pub fn new(id: u64) -> Self {
        Self { id, flakes: (0..COUNT as u32).map(Flake::of).collect(), corners_m: Vec::new(), way_m: 0.0 }
    }

    /// Moves them on one way, as fast as the inflow, and shows those about a lens, or none from outside. Gives the bytes that were uploaded.
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
        let far_m = speed_m_s * bounded_s(elapsed_s);
        self.way_m += if far_m.is_finite() { far_m } else { 0.0 };
        for flake in &mut self.flakes {
            flake.size = 1.0;
        }
        self.show(stage, lens_m)
    }

    /// Moves those about a lens on as the medium carries them, and shows them; none from outside, where they wait. Gives the bytes that were uploaded.
    ///
    /// # Errors
    /// [`RenderError::BadField`] if the field's numbers contradict each other, [`RenderError::TooLarge`] if the stage is full; it is as before.
    pub fn carry(
        &mut self,
        stage: &mut Stage,
        lens_m: Option<[f32; 3]>,
        flow: &FlowField<'_>,
        elapsed_s: f32,
    ) -> Result<u64, RenderError> {
        if !flow.is_sound() {
            return Err(RenderError::BadField { got: flow.solid.len(), dims: flow.dims });
        }
        if let Some(about_m) = finite(lens_m) {
            for flake in &mut self.flakes {
                flake.carry(self.way_m, about_m, flow, bounded_s(elapsed_s));
            }
        }
        self.show(stage, lens_m)
    }

    fn show(&mut self, stage: &mut Stage, lens_m: Option<[f32; 3]>) -> Result<u64, RenderError> {
        if self.corners_m.is_empty() {
            self.put(stage)?;
        }
        let lens_m = finite(lens_m);
        for (flake, corners) in self.flakes.iter().zip(self.corners_m.chunks_exact_mut(4)) {
            let place_m = lens_m.map(|lens_m| flake.at(self.way_m, lens_m)).filter(|(_, off_m)| *off_m > NEAREST_M);
            for (corner, of) in corners.iter_mut().zip(flake.corners_m) {
                *corner = place_m.map_or(NOWHERE_M, |(place_m, _)| (place_m + flake.size * of).to_array());
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
        let appearance = Appearance::of(Material::Flake);
        stage.set_object(self.id, SurfaceMesh { triangles: &triangles, rest_m: &rest_m, raw: &[], appearance })?;
        self.corners_m = rest_m;
        Ok(())
    }
}

/// The time to move on for, s; none if it is no number.
fn bounded_s(elapsed_s: f32) -> f32 {
    if elapsed_s.is_nan() { 0.0 } else { elapsed_s.clamp(0.0, LONGEST_S) }
}

fn finite(lens_m: Option<[f32; 3]>) -> Option<Vec3> {
    lens_m.map(Vec3::from).filter(|lens_m| lens_m.is_finite())
}

/// A number from 0 to 1 that looks like chance: what for, of the flake of this number that came after so many.
fn chance(number: u32, what: u32, before: u32) -> f32 {
    (crate::hash::hash([number, what, before], 77) >> 8) as f32 / (1 << 24) as f32
}

/// Where in the cube one begins.
fn first_m(number: u32, before: u32) -> Vec3 {
    Vec3::new(chance(number, 0, before), chance(number, 1, before), chance(number, 2, before)) * SIDE_M
}

impl Flake {
    fn of(number: u32) -> Self {
        let share = |what: u32| chance(number, what, 0);
        let radius_m = RADIUS_M[0] + (RADIUS_M[1] - RADIUS_M[0]) * share(3).powi(2);
        // A flat piece, turned anyhow.
        let turn = glam::Quat::from_euler(glam::EulerRot::XYZ, 6.3 * share(4), 6.3 * share(5), 6.3 * share(6));
        let flat = [[0.0, 0.0, 0.35], [1.0, 0.2, -0.1], [-0.6, 0.8, -0.1], [-0.5, -0.9, -0.1]];
        let life_s = LIFE_S[0] + (LIFE_S[1] - LIFE_S[0]) * share(8);
        Self {
            number,
            place_m: first_m(number, 0),
            corners_m: flat.map(|corner| turn * Vec3::from(corner) * radius_m),
            phase: 6.3 * share(7),
            before: 0,
            // They are not all replaced at once.
            age_s: life_s * share(9),
            life_s,
            size: 1.0,
        }
    }

    /// Moves it on by such a time in a sound field, or has the next one begin in its stead.
    fn carry(&mut self, way_m: f32, lens_m: Vec3, flow: &FlowField<'_>, dt_s: f32) {
        self.age_s += dt_s;
        if self.age_s >= self.life_s {
            (self.before, self.age_s) = (self.before.wrapping_add(1), 0.0);
            self.place_m = first_m(self.number, self.before);
        }
        let (here_m, _) = self.at(way_m, lens_m);
        let step_m = self.step_m(here_m, flow, dt_s);
        self.place_m += step_m;
        self.size = (self.age_s.min(self.life_s - self.age_s) / FADE_S).clamp(0.0, 1.0);
    }

    /// How far the medium takes it from a place in such a time, m: by a cell at most, along one axis after the other, so that it goes through no edge between
    /// two solids, and not at all where there is no velocity.
    fn step_m(&self, here_m: Vec3, flow: &FlowField<'_>, dt_s: f32) -> Vec3 {
        let Some(velocity_m_s) = flow.velocity_at(here_m) else { return Vec3::ZERO };
        let still = 1.0 - (velocity_m_s.length() / WANDER_M_S).min(1.0);
        let turn = self.phase + self.age_s * std::f32::consts::TAU / WANDER_S;
        let wander = Vec3::new(turn.sin(), (1.3 * turn).cos(), (0.7 * turn).sin()) * (still * WANDER_M_S);
        let step_m = ((velocity_m_s + wander) * dt_s).clamp_length_max(flow.edge_m());
        let mut moved_m = Vec3::ZERO;
        for axis in Vec3::AXES {
            let next_m = moved_m + axis * step_m;
            if flow.is_medium(here_m + next_m) {
                moved_m = next_m;
            }
        }
        moved_m
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

    const LENS_M: Vec3 = Vec3::new(0.001, -0.002, 0.030);
    const CELLS: usize = 40;
    const ALL: usize = CELLS * CELLS * CELLS;

    /// Cells of a millimetre about the lens, wider than the cube.
    fn flow<'a>(velocity_m_s: &'a [Vec<f32>; 3], solid: &'a [u8]) -> FlowField<'a> {
        let velocity_m_s = velocity_m_s.each_ref().map(Vec::as_slice);
        let min_m = (LENS_M - 0.5 * CELLS as f32 * 1e-3).to_array();
        FlowField { dims: [CELLS as u32; 3], min_m, spacing_m: [1e-3; 3], velocity_m_s, solid }
    }

    fn uniform(velocity_m_s: Vec3) -> [Vec<f32>; 3] {
        velocity_m_s.to_array().map(|component| vec![component; ALL])
    }

    /// In the middle of their time.
    fn flakes() -> Vec<Flake> {
        (0..COUNT as u32).map(|number| Flake { age_s: 1.0, ..Flake::of(number) }).collect()
    }

    /// How far each is carried.
    fn carried(flow: &FlowField<'_>, dt_s: f32) -> Vec<Vec3> {
        let carry = |mut flake: Flake| {
            let before_m = flake.place_m;
            flake.carry(0.0, LENS_M, flow, dt_s);
            flake.place_m - before_m
        };
        flakes().into_iter().map(carry).collect()
    }

    #[test]
    fn an_even_flow_carries_each_flake_as_far_as_it_goes_itself_and_by_a_cell_at_most() {
        let (velocity_m_s, solid) = (Vec3::new(0.010, -0.006, 0.004), vec![0_u8; ALL]);
        for moved_m in carried(&flow(&uniform(velocity_m_s), &solid), 0.03) {
            assert!(moved_m.distance(0.03 * velocity_m_s) < 1e-7, "{moved_m}");
        }
        for moved_m in carried(&flow(&uniform(Vec3::new(3.0, 4.0, 0.0)), &solid), 0.1) {
            assert!(moved_m.distance(Vec3::new(0.0006, 0.0008, 0.0)) < 1e-7, "{moved_m}");
        }
        assert_eq!([f32::NAN, -1.0, 0.02, f32::INFINITY].map(bounded_s), [0.0, 0.0, 0.02, LONGEST_S]);
    }

    #[test]
    fn a_solid_holds_a_flake_and_what_is_no_number_moves_none() {
        let velocity = uniform(Vec3::new(0.010, -0.006, 0.004));
        assert_eq!(carried(&flow(&velocity, &vec![1_u8; ALL]), 0.03), [Vec3::ZERO; COUNT]);
        let solid = vec![0_u8; ALL];
        assert_eq!(carried(&flow(&velocity.map(|_| vec![f32::NAN; ALL]), &solid), 0.03), [Vec3::ZERO; COUNT]);
    }

    #[test]
    fn a_flake_that_is_carried_against_a_wall_stays_before_it_and_goes_along_it() {
        // Solid from a millimetre beyond the lens on, along x.
        let solid: Vec<u8> = (0..ALL).map(|cell| u8::from(cell % CELLS > CELLS / 2)).collect();
        let velocity = uniform(Vec3::new(0.010, -0.002, 0.0));
        let mut flake = flakes()[0];
        flake.place_m += LENS_M + Vec3::new(0.0002, 0.003, 0.005) - flake.at(0.0, LENS_M).0;
        let (from_m, before_m) = (flake.at(0.0, LENS_M).0, flake.place_m);
        assert!(from_m.distance(LENS_M + Vec3::new(0.0002, 0.003, 0.005)) < 1e-6, "{from_m}");
        for _ in 0..100 {
            flake.carry(0.0, LENS_M, &flow(&velocity, &solid), 0.01);
        }
        let moved_m = flake.place_m - before_m;
        assert!((0.0006..0.000_81).contains(&moved_m.x) && (moved_m.y + 0.002).abs() < 1e-5, "{moved_m}");
    }

    #[test]
    fn where_the_medium_stands_still_flakes_wander_slowly() {
        for moved_m in carried(&flow(&uniform(Vec3::ZERO), &vec![0_u8; ALL]), 0.03) {
            assert!(moved_m.length() > 0.0 && moved_m.length() < 0.03 * 2.0 * WANDER_M_S, "{moved_m}");
        }
    }

    #[test]
    fn after_its_time_a_flake_is_followed_by_another_one_elsewhere_that_comes_out_of_nothing() {
        let (velocity, solid) = (uniform(Vec3::ZERO), vec![0_u8; ALL]);
        for number in 0..COUNT as u32 {
            let mut flake = Flake::of(number);
            let (size, place_m) = (flake.size, flake.place_m);
            flake.age_s = flake.life_s - 0.01;
            flake.carry(0.0, LENS_M, &flow(&velocity, &solid), 0.02);
            assert!(size == 1.0 && flake.size == 0.0 && flake.before == 1, "{flake:?}");
            assert!(flake.place_m.distance(place_m) > 1e-4 && flake.place_m.abs().max_element() < SIDE_M + 1e-4, "{flake:?}");
            for _ in 0..10 {
                flake.carry(0.0, LENS_M, &flow(&velocity, &solid), 0.1);
            }
            assert_eq!((flake.size, flake.before), (1.0, 1));
        }
    }
}
