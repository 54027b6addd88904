//! The outflow of the instrument, as what floats meets it. Medium is drawn into the ring between the outer sheath and the shaft while the valve is open;
//! a piece that comes to it leaves with the medium if it is small enough, and else stays caught at it as long as it draws.
//!
//! Promise: what happens to a piece follows from the state and the input of its step alone. A piece that has left is in no state that comes after, and
//! counted in the same one from which it is missing.

use crate::drift::Drifter;
use glam::{Quat, Vec3};
use hyst_messages::InputRecord;
use hyst_scene::{LoadedRigid, OUTFLOW_RADII};

/// Volume of a piece that passes the ring at most, m³: a ball of 4 mm. Assumed, from sheaths of 7 to 9 mm around an instrument of 3 to 5; tissue is soft, so
/// that a chip which is longer than the ring is wide folds.
pub const MOST_M3: f64 = 33.5e-9;
/// A valve that is less open than this draws nothing in.
const LEAST_OPEN: f32 = 0.05;
/// How fast a piece that is caught is drawn to the middle of the outflow per distance, 1/s: a quarter of what the medium brakes it with, so that it does
/// not swing.
const DRAW_PER_S: f32 = 2.0;

/// Where the outflow is at an instrument, in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outlet {
    behind_m: f32,
    radius_m: f32,
}

/// The outflow in a step in which it draws.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Draw {
    /// Its middle, m.
    pub place_m: Vec3,
    /// How far it reaches, m.
    radius_m: f32,
    /// How fast the instrument moves, m/s.
    velocity_m_s: Vec3,
}

impl Outlet {
    /// That of a scene's instrument.
    pub fn of(rigid: &LoadedRigid) -> Outlet {
        let [behind_m, radius_m] = OUTFLOW_RADII.map(|radii| radii * rigid.radius_m);
        Outlet { behind_m, radius_m }
    }

    /// What an input says of it; `None` while it draws nothing: the valve is shut, or there is no pressure that drives medium out.
    pub fn draw(&self, input: &InputRecord) -> Option<Draw> {
        let (pose, valve) = (&input.sample.pose, input.sample.controls.outflow_valve);
        let place_m = Vec3::from(pose.position_m) - self.behind_m * (Quat::from_array(pose.orientation) * Vec3::Z);
        let draws = valve >= LEAST_OPEN && input.pressure_pa > 0.0 && place_m.is_finite();
        let velocity_m_s = Some(Vec3::from(input.sample.velocity_m_s)).filter(|speed| speed.is_finite()).unwrap_or_default();
        draws.then_some(Draw { place_m, radius_m: self.radius_m, velocity_m_s })
    }
}

impl Draw {
    /// Whether a piece has come to it: one of its nodes.
    pub fn has(&self, piece: &Drifter, positions_m: &[[f32; 3]]) -> bool {
        let is_near = |place: &[f32; 3]| Vec3::from(*place).distance_squared(self.place_m) <= self.radius_m * self.radius_m;
        piece.places(positions_m).any(is_near)
    }

    /// The piece that leaves in this step: the first of those that have come and are small enough.
    pub fn leaving<'a>(&self, pieces: &'a [Drifter], positions_m: &[[f32; 3]]) -> Option<&'a Drifter> {
        pieces.iter().find(|piece| piece.volume_m3() <= MOST_M3 && self.has(piece, positions_m))
    }

    /// How fast it makes a piece go that is caught, m/s.
    pub fn velocity_m_s(&self, piece: &Drifter, positions_m: &[[f32; 3]]) -> [f32; 3] {
        let places = piece.places(positions_m).map(|place| Vec3::from(*place));
        let (count, sum) = places.fold((0, Vec3::ZERO), |(count, sum), place| (count + 1, sum + place));
        (self.velocity_m_s + DRAW_PER_S * (self.place_m - sum / count.max(1) as f32)).to_array()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_draws_where_the_sheath_ends_while_the_valve_is_open_and_something_drives_medium_out() {
        let outlet = Outlet { behind_m: 0.01, radius_m: 0.005 };
        let mut input = InputRecord { pressure_pa: 9_000.0, ..InputRecord::default() };
        input.sample.pose.position_m = [0.001, 0.002, 0.03];
        // A quarter turn about x: the instrument looks to -y.
        input.sample.pose.orientation = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2).to_array();
        assert_eq!(outlet.draw(&input), None, "the valve is shut");
        input.sample.controls.outflow_valve = 0.4;
        let draw = outlet.draw(&input).unwrap();
        assert!(draw.place_m.distance(Vec3::new(0.001, 0.012, 0.03)) < 1e-6 && draw.radius_m == 0.005, "{draw:?}");
        assert_eq!(outlet.draw(&InputRecord { pressure_pa: 0.0, ..input }), None);
        input.sample.pose.position_m[1] = f32::NAN;
        assert_eq!(outlet.draw(&input), None);
    }
}
