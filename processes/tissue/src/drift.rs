//! What the flow does to a piece that nothing holds. The material's damping is the resistance of the medium about it, which brakes every node against
//! a medium at rest; where the medium moves, the same resistance carries.

use crate::body::Body;
use hyst_messages::stream::ObjectRecord;
use hyst_messages::{MAX_PIECES, PieceFlow};
use hyst_tissue::Model;

/// A piece that nothing holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Drifter {
    object: u32,
    nodes: Vec<u32>,
}

impl Drifter {
    /// Those of a body.
    pub fn of(objects: &[ObjectRecord], body: &Body) -> Vec<Drifter> {
        let free = objects.iter().filter(|object| object.is_free_piece());
        let mut drifters: Vec<Drifter> = free.map(|object| Drifter { object: object.id, nodes: Vec::new() }).collect();
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
}

/// Adds what the medium's motion exerts on the nodes of the pieces that it is known of, N.
pub fn drift_forces(drifters: &[Drifter], flows: &[PieceFlow; MAX_PIECES], model: &Model, node_force_n: &mut [[f32; 3]]) {
    for flow in flows.iter().filter(|flow| flow.object != 0) {
        let Some(drifter) = drifters.iter().find(|drifter| drifter.object == flow.object) else { continue };
        for node in &drifter.nodes {
            let resistance_n_s_m = model.resistance_n_s_m(*node as usize);
            let Some(force_n) = node_force_n.get_mut(*node as usize) else { continue };
            force_n.iter_mut().zip(flow.velocity_m_s).for_each(|(sum, speed)| *sum += resistance_n_s_m * speed);
        }
    }
}
