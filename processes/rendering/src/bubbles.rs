//! Gas in the medium: each parcel as one to four bubbles whose volumes sum to its own, all of them one object on the stage.
//!
//! A parcel of the flow is a point that stays clear of the wall by less than a bubble of all its gas would. The largest of its bubbles has its top there, as
//! bubbles hang under a ceiling, or that would be cut off by the wall; the others lie about it, none higher and none within another. How many they are, how
//! large, and where follows from the parcel's place in the flow's ring, which it keeps: they stay as they are while they drift.
//!
//! Promise: without gas the stage is what it was; a parcel whose numbers make no sense is not drawn; the object is made anew only when there are twice
//! as many bubbles as before.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use crate::error::RenderError;
use crate::hash::hash;
use crate::shapes::{Shape, ball};
use crate::stage::{Appearance, Material, Stage, SurfaceMesh};

/// Bubbles that are drawn at most: those of the 256 parcels of the flow's ring.
const MOST: usize = 1_024;
/// Bubbles that there is room for at first.
const FIRST: usize = 32;
/// Bubbles of one parcel at most.
const OF_ONE: usize = 4;
/// What the chance of sizes and places begins with. By this one the parcel of number 0 is a single bubble, of which tests say how one looks.
const SEED: u32 = 74;
/// Volumes of the others, from the least to the most, of the largest's.
const OTHERS: [f32; 2] = [0.03, 0.60];
/// How far from the largest another one lies, from the nearest to the farthest, of where they would touch.
const APART: [f32; 2] = [1.04, 1.34];
/// How much lower than the largest's the top of another one lies at most, in radii of the largest.
const LOWER: f32 = 0.8;
/// The others lie a third of the way around from one another, and this share of that nearer or farther: two of them never touch.
const AROUND: f32 = 0.35;
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
    /// Bubbles that the object has room for; 0: it is not on the stage.
    room: usize,
}

/// One of them, m.
#[derive(Debug, Clone, Copy)]
struct Bubble {
    middle_m: Vec3,
    radius_m: f32,
}

/// The bubbles that are drawn of these parcels.
fn drawn(parcels: &[[f32; 4]]) -> impl Iterator<Item = Bubble> {
    let is_one = |parcel: &[f32; 4]| {
        parcel.iter().all(|value| value.abs() < 10.0) && (0.0..=LARGEST_ML).contains(&parcel[3]) && parcel[3] > 0.0
    };
    let sound = (0..).zip(parcels).filter(move |(_, parcel)| is_one(parcel));
    sound.flat_map(|(number, parcel)| of_parcel(number, *parcel)).take(MOST)
}

/// The bubbles of the parcel of this number, the largest first.
fn of_parcel(number: u32, [x, y, z, volume_ml]: [f32; 4]) -> impl Iterator<Item = Bubble> {
    let chance = move |what: u32, bubble: u32| (hash([number, what, bubble], SEED) >> 8) as f32 / (1 << 24) as f32;
    let between = |[least, most]: [f32; 2], share: f32| least + (most - least) * share;
    let count = 1 + hash([number, 0, 0], SEED) as usize % OF_ONE;
    let volumes: [f32; OF_ONE] = std::array::from_fn(|bubble| match bubble {
        0 => 1.0,
        _ if bubble < count => between(OTHERS, chance(1, bubble as u32).powi(2)),
        _ => 0.0,
    });
    let largest_m = (volume_ml * 1e-6 * 0.75 / PI / volumes.iter().sum::<f32>()).cbrt();
    let first_m = Vec3::new(x, y - largest_m, z);
    let beside = move |bubble: u32, radius_m: f32| {
        let reach_m = (largest_m + radius_m) * between(APART, chance(3, bubble));
        let rise_m = largest_m - radius_m - LOWER * largest_m * chance(4, bubble);
        let level_m = (reach_m * reach_m - rise_m * rise_m).sqrt();
        let turns = chance(2, 0) + (bubble as f32 + AROUND * (chance(5, bubble) - 0.5)) / 3.0;
        let (sin, cos) = (TAU * turns).sin_cos();
        Vec3::new(level_m * cos, rise_m, level_m * sin)
    };
    (0..).zip(volumes).take(count).map(move |(bubble, volume): (u32, f32)| {
        let radius_m = largest_m * volume.cbrt();
        let off_m = if bubble == 0 { Vec3::ZERO } else { beside(bubble, radius_m) };
        Bubble { middle_m: first_m + off_m, radius_m }
    })
}

impl Bubbles {
    /// None yet; on the stage they have this id.
    pub fn new(id: u64) -> Self {
        Self { id, ball: ball([0.0; 3], CORNERS, 7, 12), corners_m: Vec::new(), room: 0 }
    }

    /// Shows these parcels, each by its number in the row: place, m, and volume, ml; a volume of 0 is none. The patient lies on her back, so that their tops are
    /// towards +y. Gives the bytes that were uploaded.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] if the stage is full; it is as before.
    pub fn show(&mut self, stage: &mut Stage, parcels: &[[f32; 4]]) -> Result<u64, RenderError> {
        let count = drawn(parcels).count();
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
        for Bubble { middle_m, radius_m } in drawn(parcels) {
            let corner_m = |corner: &[f32; 3]| (middle_m + radius_m * Vec3::from(*corner)).to_array();
            self.corners_m.extend(self.ball.positions_m.iter().map(corner_m));
        }
        self.corners_m.resize(self.room * self.ball.positions_m.len(), NOWHERE_M);
        stage.update_positions(self.id, &self.corners_m)?;
        Ok(size_of_val(self.corners_m.as_slice()) as u64)
    }

    /// Puts an object with room for so many bubbles on the stage.
    fn put(&mut self, stage: &mut Stage, room: usize) -> Result<(), RenderError> {
        let corners = self.ball.positions_m.len();
        let of = |bubble: usize| {
            let first = (bubble * corners) as u32;
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
    #[test]
    fn the_bubbles_of_a_parcel_sum_to_its_volume_hang_from_its_place_and_lie_beside_one_another() {
        let mut counts = [0; OF_ONE];
        for number in 0..512 {
            let all: Vec<Bubble> = of_parcel(number, [0.001, 0.002, 0.03, 2e-3]).collect();
            counts[all.len() - 1] += 1;
            let volume_ml: f32 = all.iter().map(|bubble| 1e6 * 4.0 / 3.0 * PI * bubble.radius_m.powi(3)).sum();
            assert!((volume_ml / 2e-3 - 1.0).abs() < 1e-4, "{number}: {volume_ml} ml");
            assert!(all[0].middle_m.distance(Vec3::new(0.001, 0.002 - all[0].radius_m, 0.03)) < 1e-8, "{number}: {all:?}");
            for (at, bubble) in all.iter().enumerate() {
                assert!(bubble.middle_m.y + bubble.radius_m < 0.002 + 1e-7, "{number}: {all:?}");
                assert!(bubble.radius_m <= all[0].radius_m, "{number}: {all:?}");
                for other in &all[..at] {
                    let off = bubble.middle_m.distance(other.middle_m) / (bubble.radius_m + other.radius_m);
                    assert!(off > 1.03, "{number}: {off} in {all:?}");
                }
            }
        }
        assert!(counts.iter().all(|count| (100..160).contains(count)), "one, two, three and four: {counts:?}");
    }

    #[test]
    fn a_parcel_that_drifts_keeps_its_bubbles_and_those_before_it_may_go() {
        let about = |parcels: &[[f32; 4]], at_m: Vec3| -> Vec<(Vec3, f32)> {
            drawn(parcels)
                .filter(|bubble| bubble.middle_m.distance(at_m) < 0.004)
                .map(|bubble| (bubble.middle_m - at_m, bubble.radius_m))
                .collect()
        };
        let (none, other) = ([0.0; 4], [0.0, 0.0, 0.01, 1e-3]);
        let before = about(&[other, other, [0.002, 0.001, 0.03, 1e-3]], Vec3::new(0.002, 0.001, 0.03));
        let after = about(&[none, other, [0.003, 0.004, 0.04, 1e-3]], Vec3::new(0.003, 0.004, 0.04));
        let is_near = |((a_m, a), (b_m, b)): (&(Vec3, f32), &(Vec3, f32))| a_m.distance(*b_m) < 1e-7 && a == b;
        assert!(
            !before.is_empty() && before.len() == after.len() && before.iter().zip(&after).all(is_near),
            "{before:?} {after:?}"
        );
        assert_eq!(of_parcel(0, other).count(), 1, "the parcel of which tests say how a bubble looks");
        assert_eq!(drawn(&vec![other; 5_000]).count(), MOST);
    }
}
