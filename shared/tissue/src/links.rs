//! Springs that are evaluated in every substep: contacts with a plane, contacts of a node with a tet, attachments of a node to a point in a tet, and points
//! that are held from outside ([`Hold`]).
//!
//! A contact is damped as far as explicit integration allows: the tissue has next to no damping of its own at the frequency of a node in a stiff contact, and
//! would ring on for as long as it is touched. Friction is a spring that slides (Cundall and Strack 1979), as stiff across the normal as the contact along it:
//! what draws alike along all axes has for each of them the row sums that the model's bound has room for along one. A drag that is as strong would need more
//! than the light nodes of a surface leave. Where things stuck is remembered by whoever makes the contacts, from step to step.
//!
//! A force that is held for a whole step samples the fast modes of the tissue too rarely: even a weak spring then feeds them.
//! Therefore what reacts to positions is handed over as a law, not as a force. Promise: the springs at a free node never add up
//! to more than the stiffness that the model's bound includes; where they would, they are softened, and counted. Each force has
//! its opposite on the other nodes of an attachment; sums are made in the order of the arguments.

#![allow(clippy::needless_range_loop)] // indices are those of the formulas

mod hold;
mod ready;
mod rub;

use crate::model::Model;
use crate::pressure::Pressure;
use crate::step::EXTERNAL_FORCE_MAX_N;

pub use hold::Hold;
pub(crate) use hold::of_hold;
pub(crate) use ready::{Grip, READY_MAX, Ready, known};
use rub::{Rub, stick};

/// How far a spring's normal may be from unit length.
const NORMAL_TOLERANCE: f32 = 1e-3;
/// How far the sum of an attachment's weights may be from 1.
const WEIGHT_TOLERANCE: f32 = 1e-3;

/// How contacts answer, all of a step alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactLaw {
    /// Damping along the normal over stiffness, s, as far as the substep allows it.
    pub damping_s: f32,
    /// Coulomb's coefficient of friction.
    pub friction: f32,
    /// Largest normal force of one contact, N.
    pub most_n: f32,
}

impl Default for ContactLaw {
    /// Springs alone.
    fn default() -> ContactLaw {
        ContactLaw { damping_s: 0.0, friction: 0.0, most_n: EXTERNAL_FORCE_MAX_N }
    }
}

impl ContactLaw {
    /// The same with the default for what is no number of its range.
    pub(crate) fn sane(self) -> ContactLaw {
        let (range, default) = (0.0..=EXTERNAL_FORCE_MAX_N, ContactLaw::default());
        let or = |value: f32, default: f32| if range.contains(&value) { value } else { default };
        ContactLaw {
            damping_s: or(self.damping_s, default.damping_s),
            friction: or(self.friction, default.friction),
            most_n: or(self.most_n, default.most_n),
        }
    }
}

/// A one-sided contact: it pushes the point Σ wᵢ·xᵢ along `normal` with stiffness × depth while normal·point < `offset_m`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneSpring {
    /// Four nodes, usually of a tet; the same node may stand more than once.
    pub nodes: [u32; 4],
    /// Weights from 0 to 1 of the four nodes.
    pub weights: [f32; 4],
    /// Unit normal, out of the obstacle into the tissue's side.
    pub normal: [f32; 3],
    /// Place of the plane along the normal, m.
    pub offset_m: f32,
    /// Velocity of the obstacle, m/s, which damping is relative to. The plane itself stays where it is during the step.
    pub velocity_m_s: [f32; 3],
    /// Where what the point sticks to draws it along the plane, m, as far as friction goes: where it is itself, if nothing does.
    pub sticks_at_m: [f32; 3],
    /// Stiffness, N/m. Where the springs of a node add up to more than the model's contact stiffness, they are softened to it.
    pub stiffness_n_m: f32,
}

/// What a contact does at a state.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Push {
    /// Force of the spring along the normal, N, at least 0, without damping and friction.
    pub normal_n: f32,
    /// Stiffness after softening, N/m.
    pub stiffness_n_m: f32,
    /// Force on the tissue, N, with damping and friction.
    pub force_n: [f32; 3],
    /// The way along the plane from the point to what it sticks to, m, once what is more than friction holds has slid.
    pub bent_m: [f32; 3],
}

/// A node held at a point in a tet of the same model: the stalk of a polyp in the wall of the uterus. (Objects that hold each
/// other are one model: see [`join`](crate::join).)
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attachment {
    /// The node.
    pub node: u32,
    /// Nodes of the tet.
    pub tet: [u32; 4],
    /// Weights of the point, from 0 to 1 with the sum 1.
    pub weights: [f32; 4],
    /// Stiffness, N/m. An attachment takes up twice its stiffness at its node.
    pub stiffness_n_m: f32,
}

/// A one-sided contact of a node with a point in a tet of the same model: it pushes both apart along `normal` with stiffness × what is left of the
/// depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairSpring {
    /// The node.
    pub node: u32,
    /// Nodes of the tet.
    pub tet: [u32; 4],
    /// Weights of the point, from 0 to 1 with the sum 1.
    pub weights: [f32; 4],
    /// Unit normal, out of the tet's tissue.
    pub normal: [f32; 3],
    /// How far the node is to be from the point along the normal, m.
    pub depth_m: f32,
    /// Where, from the point, what the node sticks to draws it along the plane, m, as far as friction goes: where it is itself, if nothing does.
    pub sticks_at_m: [f32; 3],
    /// Stiffness, N/m. It takes up twice that at its node.
    pub stiffness_n_m: f32,
}

/// All springs of a step, and the pressure.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Links<'a> {
    pub springs: &'a [PlaneSpring],
    pub pairs: &'a [PairSpring],
    pub holds: &'a [Hold],
    pub attachments: &'a [Attachment],
    pub pressure: Pressure<'a>,
    pub law: ContactLaw,
    /// Substep, s.
    pub substep_s: f32,
}

fn in_range(nodes: &[u32; 4], count: usize) -> bool {
    nodes.iter().all(|&node| (node as usize) < count)
}

fn is_unit(normal: &[f32; 3]) -> bool {
    let length = normal.iter().map(|x| x * x).sum::<f32>();
    (length - 1.0).abs() <= 2.0 * NORMAL_TOLERANCE
}

fn are_weights(weights: &[f32; 4]) -> bool {
    weights.iter().all(|weight| (0.0..=1.0).contains(weight))
}

impl PlaneSpring {
    pub(crate) fn usable(&self, nodes: usize) -> bool {
        in_range(&self.nodes, nodes)
            && are_weights(&self.weights)
            && is_unit(&self.normal)
            && self.offset_m.is_finite()
            && self.velocity_m_s.iter().chain(&self.sticks_at_m).all(|number| number.is_finite())
            && (0.0..=EXTERNAL_FORCE_MAX_N).contains(&self.stiffness_n_m)
    }

    /// Row sums of its stiffness matrix, as (node, N/m).
    fn loads(&self) -> [(u32, f32); 4] {
        loads_of_point(&self.nodes, &self.weights, self.stiffness_n_m)
    }
}

/// Row sums of the stiffness matrix of what holds a point of four nodes, as (node, N/m).
fn loads_of_point(nodes: &[u32; 4], weights: &[f32; 4], stiffness_n_m: f32) -> [(u32, f32); 4] {
    let sum: f32 = weights.iter().sum();
    [0, 1, 2, 3].map(|i| (nodes[i], stiffness_n_m * weights[i] * sum))
}

/// Whether a node can be joined with a point in a tet.
fn can_join(node: u32, tet: &[u32; 4], weights: &[f32; 4], stiffness_n_m: f32, nodes: usize) -> bool {
    (node as usize) < nodes
        && in_range(tet, nodes)
        && are_weights(weights)
        && (weights.iter().sum::<f32>() - 1.0).abs() <= WEIGHT_TOLERANCE
        && (0.0..=EXTERNAL_FORCE_MAX_N).contains(&stiffness_n_m)
}

/// Row sums of the stiffness matrix of what joins a node with a point in a tet, as (node, N/m).
fn loads_of_joint(node: u32, tet: &[u32; 4], weights: &[f32; 4], stiffness_n_m: f32) -> [(u32, f32); 5] {
    let twice = (2.0 + 2.0 * WEIGHT_TOLERANCE) * stiffness_n_m;
    let corner = |i: usize| (tet[i], twice * weights[i]);
    [(node, twice), corner(0), corner(1), corner(2), corner(3)]
}

impl Attachment {
    fn usable(&self, nodes: usize) -> bool {
        can_join(self.node, &self.tet, &self.weights, self.stiffness_n_m, nodes)
    }

    fn loads(&self) -> [(u32, f32); 5] {
        loads_of_joint(self.node, &self.tet, &self.weights, self.stiffness_n_m)
    }
}

impl PairSpring {
    pub(crate) fn usable(&self, nodes: usize) -> bool {
        can_join(self.node, &self.tet, &self.weights, self.stiffness_n_m, nodes)
            && is_unit(&self.normal)
            && (0.0..=EXTERNAL_FORCE_MAX_N).contains(&self.depth_m)
            && self.sticks_at_m.iter().all(|part| part.is_finite())
    }

    fn loads(&self) -> [(u32, f32); 5] {
        loads_of_joint(self.node, &self.tet, &self.weights, self.stiffness_n_m)
    }
}

/// What a contact does that is `depth_m` deep: `apart_m_s` is the velocity of what is pushed along the normal, against the other side, and `away_m` the way
/// from where it is to what it sticks to.
fn push(law: &ContactLaw, normal: &[f32; 3], ready: &Ready, (depth_m, apart_m_s): (f32, [f32; 3]), away_m: [f32; 3]) -> Push {
    if depth_m <= 0.0 {
        return Push::default();
    }
    let Ready { stiffness_n_m, most_n_s_m, .. } = *ready;
    let leaving_m_s = normal[0] * apart_m_s[0] + normal[1] * apart_m_s[1] + normal[2] * apart_m_s[2];
    let normal_n = (stiffness_n_m * depth_m).min(law.most_n);
    let damping_n_s_m = (stiffness_n_m * law.damping_s).min(most_n_s_m);
    let damped_n = (normal_n - damping_n_s_m * leaving_m_s).clamp(0.0, law.most_n);
    let slip = [0, 1, 2].map(|axis| apart_m_s[axis] - leaving_m_s * normal[axis]);
    let Rub { force_n: rubbed_n, bent_m } = stick(law, ready, (normal, away_m), damped_n, slip);
    let force_n = [0, 1, 2].map(|axis| damped_n * normal[axis] + rubbed_n[axis]);
    if force_n.iter().all(|force| force.is_finite()) {
        Push { normal_n, stiffness_n_m, force_n, bent_m }
    } else {
        Push::default()
    }
}

/// What a usable spring does.
pub(crate) fn of_plane<const N: usize>(
    law: &ContactLaw,
    spring: &PlaneSpring,
    ready: &Ready,
    position: &[[f32; N]],
    velocity: &[[f32; N]],
) -> Push {
    let (at, speed) = (point(&spring.weights, &spring.nodes, position), point(&spring.weights, &spring.nodes, velocity));
    let depth_m = spring.offset_m - (spring.normal[0] * at[0] + spring.normal[1] * at[1] + spring.normal[2] * at[2]);
    let apart_m_s = [0, 1, 2].map(|axis| speed[axis] - spring.velocity_m_s[axis]);
    let away_m = [0, 1, 2].map(|axis| spring.sticks_at_m[axis] - at[axis]);
    push(law, &spring.normal, ready, (depth_m, apart_m_s), away_m)
}

/// What a usable pair does to its node; the tet takes the opposite.
pub(crate) fn of_pair<const N: usize>(
    law: &ContactLaw,
    pair: &PairSpring,
    ready: &Ready,
    position: &[[f32; N]],
    velocity: &[[f32; N]],
) -> Push {
    let apart = |rows: &[[f32; N]]| {
        let (node, point) = (rows[pair.node as usize], point(&pair.weights, &pair.tet, rows));
        [0, 1, 2].map(|axis| node[axis] - point[axis])
    };
    let from_point_m = apart(position);
    let along_m = pair.normal[0] * from_point_m[0] + pair.normal[1] * from_point_m[1] + pair.normal[2] * from_point_m[2];
    let away_m = [0, 1, 2].map(|axis| pair.sticks_at_m[axis] - from_point_m[axis]);
    push(law, &pair.normal, ready, (pair.depth_m - along_m, apart(velocity)), away_m)
}

/// Σ wᵢ·rowᵢ.
fn point<const N: usize>(weights: &[f32; 4], nodes: &[u32; 4], rows: &[[f32; N]]) -> [f32; 3] {
    [0, 1, 2].map(|axis| dot(weights, nodes, rows, axis))
}

fn dot<const N: usize>(weights: &[f32; 4], nodes: &[u32; 4], rows: &[[f32; N]], axis: usize) -> f32 {
    let mut sum = 0.0;
    for (weight, &node) in weights.iter().zip(nodes) {
        sum += weight * rows[node as usize][axis];
    }
    sum
}

/// Adds a force on a point of four nodes to them.
fn add_at_point(nodes: &[u32; 4], weights: &[f32; 4], force_n: [f32; 3], force: &mut [[f32; 4]]) {
    for (&node, weight) in nodes.iter().zip(weights) {
        for axis in 0..3 {
            force[node as usize][axis] += weight * force_n[axis];
        }
    }
}

impl Links<'_> {
    /// Sums the stiffness at each node into `load_n_m`, and weighs as many springs as `ready` has room for, in the order of the fields; returns how many
    /// springs are softened and how many ignored.
    pub fn weigh(&self, model: &Model, load_n_m: &mut [f32], ready: &mut [Option<Ready>]) -> (u32, u32) {
        if self.springs.is_empty() && self.pairs.is_empty() && self.holds.is_empty() && self.attachments.is_empty() {
            return (0, 0);
        }
        let count = load_n_m.len();
        load_n_m.fill(0.0);
        for spring in self.springs.iter().filter(|spring| spring.usable(count)) {
            spring.loads().into_iter().for_each(|(node, share)| load_n_m[node as usize] += share);
        }
        for pair in self.pairs.iter().filter(|pair| pair.usable(count)) {
            pair.loads().into_iter().for_each(|(node, share)| load_n_m[node as usize] += share);
        }
        for hold in self.holds.iter().filter(|hold| hold.usable(count)) {
            hold.loads().into_iter().for_each(|(node, share)| load_n_m[node as usize] += share);
        }
        for attachment in self.attachments.iter().filter(|attachment| attachment.usable(count)) {
            attachment.loads().into_iter().for_each(|(node, share)| load_n_m[node as usize] += share);
        }
        let grip = Grip { model, load_n_m, substep_s: self.substep_s };
        let (mut softened, mut ignored, mut next) = (0, 0, 0usize);
        let mut note = |found: Option<Ready>| {
            softened += u32::from(found.is_some_and(|found| found.is_softened));
            ignored += u32::from(found.is_none());
            if let Some(place) = ready.get_mut(next) {
                *place = found;
            }
            next += 1;
        };
        self.springs.iter().for_each(|spring| note(spring.ready(&grip)));
        self.pairs.iter().for_each(|pair| note(pair.ready(&grip)));
        self.holds.iter().for_each(|hold| note(hold.ready(&grip)));
        self.attachments.iter().for_each(|attachment| note(attachment.ready(&grip)));
        (softened, ignored)
    }

    /// Adds the forces at `position` and `velocity` to `force`. `ready` is what was weighed with this grip.
    pub fn add_forces(
        &self,
        grip: &Grip<'_>,
        ready: &[Option<Ready>],
        (position, velocity): (&[[f32; 4]], &[[f32; 4]]),
        force: &mut [[f32; 4]],
    ) {
        let pairs_from = self.springs.len();
        let holds_from = pairs_from + self.pairs.len();
        let attachments_from = holds_from + self.holds.len();
        for (number, spring) in self.springs.iter().enumerate() {
            let Some(own) = known(ready, number, || spring.ready(grip)) else { continue };
            let push = of_plane(&self.law, spring, &own, position, velocity);
            add_at_point(&spring.nodes, &spring.weights, push.force_n, force);
        }
        for (number, pair) in self.pairs.iter().enumerate() {
            let Some(own) = known(ready, pairs_from + number, || pair.ready(grip)) else { continue };
            let push = of_pair(&self.law, pair, &own, position, velocity);
            for axis in 0..3 {
                force[pair.node as usize][axis] += push.force_n[axis];
                for (&node, weight) in pair.tet.iter().zip(pair.weights) {
                    force[node as usize][axis] -= weight * push.force_n[axis];
                }
            }
        }
        for (number, hold) in self.holds.iter().enumerate() {
            let Some(own) = known(ready, holds_from + number, || hold.ready(grip)) else { continue };
            let pull = of_hold(&self.law, hold, &own, position, velocity);
            add_at_point(&hold.nodes, &hold.weights, pull.force_n, force);
        }
        for (number, attachment) in self.attachments.iter().enumerate() {
            let Some(own) = known(ready, attachments_from + number, || attachment.ready(grip)) else { continue };
            for axis in 0..3 {
                let place = dot(&attachment.weights, &attachment.tet, position, axis);
                let pull_n = own.stiffness_n_m * (place - position[attachment.node as usize][axis]);
                force[attachment.node as usize][axis] += pull_n;
                for (&node, weight) in attachment.tet.iter().zip(attachment.weights) {
                    force[node as usize][axis] -= weight * pull_n;
                }
            }
        }
        let nodes = grip.load_n_m.len();
        self.pressure.add_forces(&position[..nodes], &mut force[..nodes]);
    }
}

#[cfg(test)]
mod tests;
