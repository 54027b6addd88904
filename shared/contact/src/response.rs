//! The force that follows from a penetration: a penalty that grows with depth, damped, with Coulomb friction.
//!
//! A point stands for an area A of its object's surface. Along the way out its force is k·A·depth·(1 − v/v₀), cut at [0, 2] times
//! the undamped force (Hunt and Crossley 1975: damping that is zero at zero depth, so contact begins and ends without a step and
//! never pulls). Across it friction is μ times that, against the slip, rising linearly up to the slip speed.
//!
//! Promises: what the tissue's nodes receive for a contact, summed in the order of the tet's corners, is with the sign changed
//! what the rigid object receives, to the last bit of an f64 sum; contacts are taken in the order of the penetrations; nothing is NaN.

use crate::ContactError;
use crate::error::same_length;
use crate::penetrate_data::Penetration;
use crate::types::{Found, Points, Tissue};
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

/// How stiff, how damped, how rough.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ResponseParams {
    /// Force per area and depth, N/m³.
    pub stiffness_n_m3: f32,
    /// Speed of leaving at which the force is gone and of entering at which it is doubled, m/s; infinite for no damping.
    pub damping_speed_m_s: f32,
    /// Coulomb's μ.
    pub friction: f32,
    /// Slip at which friction is full, m/s, above 0.
    pub slip_speed_m_s: f32,
    /// No point's normal force exceeds this, N.
    pub max_point_force_n: f32,
}

/// Where things are and how they move. Lists of points are parallel, lists of nodes too.
#[derive(Debug, Clone, Copy)]
pub struct Motion<'a> {
    /// Positions of the points, metres.
    pub points_m: &'a [[f32; 3]],
    /// Velocities of the points, m/s.
    pub point_velocity_m_s: &'a [[f32; 3]],
    /// Area that each point stands for, m².
    pub point_area_m2: &'a [f32],
    /// Velocities of the tissue's nodes, m/s.
    pub node_velocity_m_s: &'a [[f32; 3]],
}

/// A rigid object that takes the reaction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rigid {
    /// Object of its points.
    pub owner: u32,
    /// The place that torque is about: for the scope its tip. Metres.
    pub reference_m: [f32; 3],
}

/// Force and torque on a rigid object.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wrench {
    /// Newtons.
    pub force_n: [f64; 3],
    /// About the reference, newton metres.
    pub torque_n_m: [f64; 3],
}

/// The force on one point. Plain old data.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
pub struct ContactForce {
    /// Index of the point.
    pub point: u32,
    /// Its object.
    pub owner: u32,
    /// Unit vector out of the tissue.
    pub direction: [f32; 3],
    /// Force on the point along the direction, N, at least 0.
    pub normal_n: f32,
    /// Whole force on the point, friction included, N.
    pub force_n: [f32; 3],
    /// Change of the normal force with depth, N/m.
    pub stiffness_n_m: f32,
    /// Change of the normal force with the speed of entering, N·s/m.
    pub damping_n_s_m: f32,
}

/// What the step writes. Forces are added to what is there.
#[derive(Debug)]
pub struct ResponseOutput<'a> {
    /// Force on each node, N.
    pub node_force_n: &'a mut [[f32; 3]],
    /// One for each rigid object.
    pub wrenches: &'a mut [Wrench],
    /// One for each penetration, in the same order.
    pub contacts: &'a mut [ContactForce],
}

/// Turns penetrations into forces. A point that is a node passes its force on to that node, a point of a rigid object to its
/// wrench. Penetrations beyond the room in `contacts` are dropped, and counted.
///
/// # Errors
/// [`ContactError::Length`] if arrays that belong together differ in length.
pub fn respond(
    penetrations: &[Penetration],
    points: &Points<'_>,
    motion: &Motion<'_>,
    tissue: &Tissue<'_>,
    rigids: &[Rigid],
    params: &ResponseParams,
    out: &mut ResponseOutput<'_>,
) -> Result<Found, ContactError> {
    points.check(motion.points_m.len())?;
    same_length("velocities of points", motion.points_m.len(), motion.point_velocity_m_s.len())?;
    same_length("areas of points", motion.points_m.len(), motion.point_area_m2.len())?;
    same_length("velocities of nodes", tissue.positions_m.len(), motion.node_velocity_m_s.len())?;
    same_length("forces on nodes", tissue.positions_m.len(), out.node_force_n.len())?;
    same_length("wrenches", rigids.len(), out.wrenches.len())?;
    let count = penetrations.len().min(out.contacts.len());
    for (i, penetration) in penetrations[..count].iter().enumerate() {
        let (contact, nodes) = match tissue.tets.get(penetration.tet as usize) {
            Some(nodes) => (force_on_point(penetration, points, motion, nodes, params), *nodes),
            None => (ContactForce { point: penetration.point, ..ContactForce::default() }, [crate::NONE; 4]),
        };
        let reaction = scatter(Vec3::from_array(contact.force_n), &penetration.weights, &nodes, out.node_force_n);
        out.contacts[i] = contact;
        if let Some(node) = points.node_of(penetration.point) {
            add(out.node_force_n, node, reaction.as_vec3());
        } else if let Some(r) = rigids.iter().position(|r| r.owner == contact.owner) {
            let p = motion.points_m[penetration.point as usize];
            out.wrenches[r].add(reaction, Vec3::from_array(p).as_dvec3() - Vec3::from_array(rigids[r].reference_m).as_dvec3());
        }
    }
    Ok(Found { count, dropped: penetrations.len() - count })
}

impl Wrench {
    fn add(&mut self, force_n: DVec3, arm_m: DVec3) {
        self.force_n = (DVec3::from_array(self.force_n) + force_n).to_array();
        self.torque_n_m = (DVec3::from_array(self.torque_n_m) + arm_m.cross(force_n)).to_array();
    }
}

fn add(forces_n: &mut [[f32; 3]], node: u32, force_n: Vec3) {
    if let Some(f) = forces_n.get_mut(node as usize) {
        *f = (Vec3::from_array(*f) + force_n).to_array();
    }
}

/// Gives the tet's nodes −force, shared by the weights; returns what they received, summed in order, sign changed.
fn scatter(force_n: Vec3, weights: &[f32; 4], nodes: &[u32; 4], forces_n: &mut [[f32; 3]]) -> DVec3 {
    let mut given = DVec3::ZERO;
    for (&node, &weight) in nodes.iter().zip(weights) {
        let part = force_n * -weight;
        if part.is_finite() && (node as usize) < forces_n.len() {
            add(forces_n, node, part);
            given += part.as_dvec3();
        }
    }
    -given
}

fn force_on_point(
    penetration: &Penetration,
    points: &Points<'_>,
    motion: &Motion<'_>,
    nodes: &[u32; 4],
    params: &ResponseParams,
) -> ContactForce {
    let point = penetration.point as usize;
    let nothing = ContactForce { point: penetration.point, owner: crate::NONE, ..ContactForce::default() };
    let (Some(&area), Some(&owner)) = (motion.point_area_m2.get(point), points.owner.get(point)) else {
        return nothing;
    };
    let nothing = ContactForce { owner, direction: penetration.direction, ..nothing };
    let tissue_velocity: Vec3 = nodes
        .iter()
        .zip(penetration.weights)
        .map(|(&n, w)| motion.node_velocity_m_s.get(n as usize).map_or(Vec3::ZERO, |v| Vec3::from_array(*v) * w))
        .sum();
    let slip = Vec3::from_array(motion.point_velocity_m_s[point]) - tissue_velocity;
    let direction = Vec3::from_array(penetration.direction);
    let leaving = slip.dot(direction);
    let stiffness_n_m = params.stiffness_n_m3 * area;
    let still = stiffness_n_m * penetration.depth_m;
    let damped = still * (1.0 - leaving / params.damping_speed_m_s).clamp(0.0, 2.0);
    let normal_n = damped.min(params.max_point_force_n);
    let across = slip - direction * leaving;
    let speed = across.length().max(params.slip_speed_m_s);
    let force = direction * normal_n - across * (params.friction * normal_n / speed);
    if !(normal_n > 0.0 && force.is_finite()) {
        return nothing;
    }
    let damping_n_s_m = still / params.damping_speed_m_s;
    ContactForce { normal_n, force_n: force.to_array(), stiffness_n_m, damping_n_s_m, ..nothing }
}
