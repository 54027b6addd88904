//! What moves a piece that nothing holds: its weight in the medium, and the flow. The material's damping is the resistance of the medium about it, which brakes every node against
//! a medium at rest; where the medium moves, the same resistance carries.

use crate::body::Body;
use crate::outlet::Draw;
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
}

/// Standard gravity, m/s² (CGPM 1901).
const GRAVITY_M_S2: f64 = 9.806_65;

/// Weight per mass of what lies in a medium, N/kg: Archimedes.
pub fn weight_n_kg(density_kg_m3: f64, medium_kg_m3: f64) -> f32 {
    (GRAVITY_M_S2 * (1.0 - medium_kg_m3 / density_kg_m3)) as f32
}

impl Drifter {
    /// Those of a body; `weight_n_kg` is asked for each object.
    pub fn of(objects: &[ObjectRecord], body: &Body, weight_n_kg: impl Fn(u32) -> f32) -> Vec<Drifter> {
        let free = objects.iter().filter(|object| object.is_free_piece());
        let drifter = |object: &ObjectRecord| Drifter {
            object: object.id,
            nodes: Vec::new(),
            volume_m3: body.volume_of_m3(object.id),
            weight_n_kg: weight_n_kg(object.id),
        };
        let is_there = |object: &&ObjectRecord| object.tets[1] > 0;
        let mut drifters: Vec<Drifter> = free.filter(is_there).map(drifter).collect();
        if drifters.is_empty() {
            return drifters;
        }
        for (node, owner) in body.owners().into_iter().enumerate() {
            if let Some(drifter) = drifters.iter_mut().find(|drifter| Some(drifter.object) == owner) {
                drifter.nodes.push(node as u32);
            }
        }
        drifters
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

/// Adds what the medium exerts on the nodes of the pieces, N: their weight less what it carries, and its motion where that is known. The patient lies on
/// her back: what sinks goes to the posterior wall, -y. One that is caught at the outflow goes with that, which bears it.
pub fn drift_forces(
    drifters: &[Drifter],
    (flows, draw): (&[PieceFlow; MAX_PIECES], Option<&Draw>),
    positions_m: &[[f32; 3]],
    model: &Model,
    node_force_n: &mut [[f32; 3]],
) {
    for drifter in drifters {
        let flow = flows.iter().find(|flow| flow.object != 0 && flow.object == drifter.object);
        let caught = draw.filter(|draw| draw.has(drifter, positions_m)).map(|draw| draw.velocity_m_s(drifter, positions_m));
        let speed_m_s = caught.unwrap_or_else(|| flow.map_or([0.0; 3], |flow| flow.velocity_m_s));
        let weight_n_kg = if caught.is_some() { 0.0 } else { drifter.weight_n_kg };
        for node in &drifter.nodes {
            let resistance_n_s_m = model.resistance_n_s_m(*node as usize);
            let mass_kg = model.mass_kg().get(*node as usize).copied().unwrap_or(0.0);
            let Some(force_n) = node_force_n.get_mut(*node as usize) else { continue };
            force_n.iter_mut().zip(speed_m_s).for_each(|(sum, speed)| *sum += resistance_n_s_m * speed);
            force_n[1] -= mass_kg * weight_n_kg;
        }
    }
}
