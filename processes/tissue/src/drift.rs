//! What moves a piece that nothing holds: its weight in the medium, and the drag of the flow past it, which is that on a ball of its volume. The
//! material's damping, which brakes every node against a medium at rest, is left to what the piece does beside moving as a whole.
//!
//! Drag: Abraham, Phys. Fluids 1970; 13: 2194: 24/9.06² · (1 + 9.06/√Re)², within 5 % of the standard drag of a sphere (Clift, Grace and Weber 1978) at
//! Reynolds numbers of 4 to 1 000, in which chips move.

use crate::body::Body;
use crate::outlet::Draw;
use glam::Vec3;
use hyst_messages::stream::ObjectRecord;
use hyst_messages::{MAX_PIECES, PieceFlow};
use hyst_tissue::Model;

/// A piece that nothing holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Drifter {
    object: u32,
    nodes: Vec<u32>,
    /// Its volume at rest, m³.
    volume_m3: f64,
    /// Its weight in the medium per mass, N/kg; negative if it rises.
    weight_n_kg: f32,
    drag: Drag,
}

/// A medium, as what floats in it meets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bath {
    /// Its density.
    pub density_kg_m3: f64,
    /// Its dynamic viscosity.
    pub viscosity_pa_s: f64,
}

/// The drag on a ball: per mass and speed it is `per_m · (√speed + creep)²`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Drag {
    per_m: f32,
    creep: f32,
}

/// Standard gravity, m/s² (CGPM 1901).
const GRAVITY_M_S2: f64 = 9.806_65;

/// Abraham's δ₀: 9.06 times the root of 1/Re is how much wider the ball looks for the layer that it drags along.
const LAYER: f64 = 9.06;
/// A piece is no smaller than a ball of this size, m: less has no drag that a step of the tissue follows.
const LEAST_M: f64 = 1e-5;

impl Bath {
    /// Weight per mass of what lies in it, N/kg: Archimedes.
    fn weight_n_kg(&self, density_kg_m3: f64) -> f32 {
        (GRAVITY_M_S2 * (1.0 - self.density_kg_m3 / density_kg_m3)) as f32
    }

    /// Drag on a ball of a volume and density.
    fn drag(&self, volume_m3: f64, density_kg_m3: f64) -> Drag {
        let diameter_m = (6.0 * volume_m3.max(0.0) / std::f64::consts::PI).cbrt().max(LEAST_M);
        let pressure_share = 24.0 / (LAYER * LAYER);
        Drag {
            per_m: (0.75 * pressure_share * self.density_kg_m3 / (density_kg_m3 * diameter_m)) as f32,
            creep: (LAYER * (self.viscosity_pa_s / (self.density_kg_m3 * diameter_m)).sqrt()) as f32,
        }
    }
}

impl Drag {
    /// Per mass and speed, 1/s.
    fn rate_per_s(&self, speed_m_s: f32) -> f32 {
        let width = speed_m_s.sqrt() + self.creep;
        self.per_m * width * width
    }
}

impl Drifter {
    /// Those of a body in a medium; `density_kg_m3` is asked for each object.
    pub fn of(objects: &[ObjectRecord], body: &Body, bath: &Bath, density_kg_m3: impl Fn(u32) -> f64) -> Vec<Drifter> {
        let is_there = |object: &&ObjectRecord| object.is_free_piece() && object.tets[1] > 0;
        let pieces: Vec<u32> = objects.iter().filter(is_there).map(|object| object.id).collect();
        if pieces.is_empty() {
            return Vec::new();
        }
        // One look at all tets and nodes, and not one for each piece.
        let mut place_of: Vec<Option<usize>> = vec![None; body.origin.len()];
        pieces.iter().enumerate().for_each(|(place, object)| place_of[*object as usize] = Some(place));
        let mut volumes_m3 = vec![0.0; pieces.len()];
        for (tet, object) in body.rest.tets.iter().zip(&body.rest.regions) {
            if let Some(place) = place_of[*object as usize] {
                volumes_m3[place] += body.volume_m3(*tet);
            }
        }
        let mut nodes: Vec<Vec<u32>> = vec![Vec::new(); pieces.len()];
        for (node, owner) in (0..).zip(body.owners()) {
            if let Some(place) = owner.and_then(|owner| place_of[owner as usize]) {
                nodes[place].push(node);
            }
        }
        let drifter = |((object, volume_m3), nodes): ((u32, f64), Vec<u32>)| {
            let density_kg_m3 = density_kg_m3(object);
            let (weight_n_kg, drag) = (bath.weight_n_kg(density_kg_m3), bath.drag(volume_m3, density_kg_m3));
            Drifter { object, nodes, volume_m3, weight_n_kg, drag }
        };
        pieces.into_iter().zip(volumes_m3).zip(nodes).map(drifter).collect()
    }

    /// Its object.
    pub fn object(&self) -> u32 {
        self.object
    }

    /// Its volume at rest, m³.
    pub fn volume_m3(&self) -> f64 {
        self.volume_m3
    }

    /// Where its nodes are, m.
    pub fn places<'a>(&'a self, positions_m: &'a [[f32; 3]]) -> impl Iterator<Item = &'a [f32; 3]> {
        self.nodes.iter().filter_map(|node| positions_m.get(*node as usize))
    }
}

/// Adds what the medium exerts on the nodes of the pieces in a step, N: their weight less what it carries, and its drag. The patient lies on
/// her back: what sinks goes to the posterior wall, -y. One that is caught at the outflow goes with that, which bears it.
pub fn drift_forces(
    drifters: &[Drifter],
    (flows, draw): (&[PieceFlow; MAX_PIECES], Option<&Draw>),
    (positions_m, velocities_m_s): (&[[f32; 3]], &[[f32; 3]]),
    (model, dt_s): (&Model, f32),
    node_force_n: &mut [[f32; 3]],
) {
    for drifter in drifters {
        let caught = draw.filter(|draw| draw.has(drifter, positions_m));
        let of_all = drifter.velocity_m_s(velocities_m_s, model);
        // What its damping takes from it as a whole is given back, and the drag taken instead.
        let (with_m_s, per_mass_n_kg) = match caught {
            Some(draw) => (draw.velocity_m_s(drifter, positions_m).into(), Vec3::ZERO),
            None => (of_all, drifter.force_n_kg(flows, of_all, dt_s)),
        };
        for node in &drifter.nodes {
            let resistance_n_s_m = model.resistance_n_s_m(*node as usize);
            let mass_kg = model.mass_kg().get(*node as usize).copied().unwrap_or(0.0);
            let Some(force_n) = node_force_n.get_mut(*node as usize) else { continue };
            let added_n = resistance_n_s_m * with_m_s + mass_kg * per_mass_n_kg;
            force_n.iter_mut().zip(added_n.to_array()).for_each(|(sum, part)| *sum += part);
        }
    }
}

impl Drifter {
    /// Its velocity as a whole, m/s.
    fn velocity_m_s(&self, velocities_m_s: &[[f32; 3]], model: &Model) -> Vec3 {
        let (mut mass_kg, mut momentum) = (0.0, Vec3::ZERO);
        for node in self.nodes.iter().map(|node| *node as usize) {
            if let (Some(mass), Some(velocity)) = (model.mass_kg().get(node), velocities_m_s.get(node)) {
                mass_kg += mass;
                momentum += *mass * Vec3::from(*velocity);
            }
        }
        if mass_kg > 0.0 { momentum / mass_kg } else { Vec3::ZERO }
    }

    /// Weight and drag per mass at a velocity, N/kg, as a step that is implicit in the drag takes them: a crumb is braked within a step, and no more.
    fn force_n_kg(&self, flows: &[PieceFlow; MAX_PIECES], velocity_m_s: Vec3, dt_s: f32) -> Vec3 {
        // What is left over in the list says 0 of the object, which may be a piece too, and of the velocity, and comes last.
        let flow = flows.iter().find(|flow| flow.object == self.object);
        let past_m_s = flow.map_or(Vec3::ZERO, |flow| flow.velocity_m_s.into()) - velocity_m_s;
        let rate_per_s = self.drag.rate_per_s(past_m_s.length());
        (rate_per_s * past_m_s - self.weight_n_kg * Vec3::Y) / (1.0 + rate_per_s * dt_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SALINE: Bath = Bath { density_kg_m3: 1_000.0, viscosity_pa_s: 1.0e-3 };

    /// Volume of a ball, m³.
    fn ball_m3(diameter_m: f64) -> f64 {
        std::f64::consts::PI / 6.0 * diameter_m.powi(3)
    }

    #[test]
    fn a_ball_meets_the_standard_drag_of_a_sphere() {
        // Clift, Grace and Weber, Bubbles, Drops and Particles (1978), table 5.2: Reynolds number and coefficient.
        for (reynolds, coefficient) in [(10.0, 4.26), (100.0, 1.087), (1_000.0, 0.471)] {
            let (diameter_m, density_kg_m3) = (3e-3, 1_050.0);
            let speed_m_s = reynolds * 1e-6 / diameter_m;
            let rate_per_s = f64::from(SALINE.drag(ball_m3(diameter_m), density_kg_m3).rate_per_s(speed_m_s as f32));
            let found = rate_per_s * 4.0 * diameter_m * density_kg_m3 / (3.0 * speed_m_s * 1_000.0);
            assert!((found / coefficient - 1.0).abs() < 0.05, "{found} at {reynolds}, {coefficient} was measured");
        }
        // A fiftieth of a millimetre creeps: Stokes, 18 μ / (ρ d²).
        let creeps_per_s = f64::from(SALINE.drag(ball_m3(2e-5), 1_050.0).rate_per_s(1e-8));
        assert!((creeps_per_s / (18.0 * 1e-3 / (1_050.0 * 4e-10)) - 1.0).abs() < 0.02, "{creeps_per_s}");
    }

    #[test]
    fn a_crumb_comes_to_the_speed_of_the_medium_and_is_not_thrown_about() {
        let drag = SALINE.drag(ball_m3(1e-4), 1_050.0);
        // Any object of a scene may be loose, the first one too.
        for (place, object) in [(0, 0), (2, 3)] {
            let crumb = Drifter { object, nodes: Vec::new(), volume_m3: 0.0, weight_n_kg: SALINE.weight_n_kg(1_050.0), drag };
            let mut flows = [PieceFlow::default(); MAX_PIECES];
            flows[place] = PieceFlow { object, velocity_m_s: [0.3, 0.0, 0.0] };
            let mut velocity_m_s = Vec3::ZERO;
            for _ in 0..50 {
                velocity_m_s += 4e-3 * crumb.force_n_kg(&flows, velocity_m_s, 4e-3);
                assert!(velocity_m_s.length() < 0.31, "{velocity_m_s}");
            }
            assert!(velocity_m_s.x > 0.295 && velocity_m_s.y < 0.0, "object {object}: {velocity_m_s}");
        }
    }
}
