//! Springs that are evaluated in every substep: contacts with a plane, contacts of a node with a tet, and attachments of a node to a point in a tet.
//!
//! A force that is held for a whole step samples the fast modes of the tissue too rarely: even a weak spring then feeds them.
//! Therefore what reacts to positions is handed over as a law, not as a force. Promise: the springs at a free node never add up
//! to more than the stiffness that the model's bound includes; where they would, they are softened, and counted. Each force has
//! its opposite on the other nodes of an attachment; sums are made in the order of the arguments.

#![allow(clippy::needless_range_loop)] // indices are those of the formulas

use crate::model::Model;
use crate::step::EXTERNAL_FORCE_MAX_N;

/// How far a spring's normal may be from unit length.
const NORMAL_TOLERANCE: f32 = 1e-3;
/// How far the sum of an attachment's weights may be from 1.
const WEIGHT_TOLERANCE: f32 = 1e-3;

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
    /// Stiffness, N/m. Where the springs of a node add up to more than the model's contact stiffness, they are softened to it.
    pub stiffness_n_m: f32,
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
    /// Stiffness, N/m. It takes up twice that at its node.
    pub stiffness_n_m: f32,
}

/// All springs of a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Links<'a> {
    pub springs: &'a [PlaneSpring],
    pub pairs: &'a [PairSpring],
    pub attachments: &'a [Attachment],
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
    fn usable(&self, nodes: usize) -> bool {
        in_range(&self.nodes, nodes)
            && are_weights(&self.weights)
            && is_unit(&self.normal)
            && self.offset_m.is_finite()
            && (0.0..=EXTERNAL_FORCE_MAX_N).contains(&self.stiffness_n_m)
    }

    /// Row sums of its stiffness matrix, as (node, N/m).
    fn loads(&self) -> [(u32, f32); 4] {
        let sum: f32 = self.weights.iter().sum();
        [0, 1, 2, 3].map(|i| (self.nodes[i], self.stiffness_n_m * self.weights[i] * sum))
    }
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
    fn usable(&self, nodes: usize) -> bool {
        can_join(self.node, &self.tet, &self.weights, self.stiffness_n_m, nodes)
            && is_unit(&self.normal)
            && (0.0..=EXTERNAL_FORCE_MAX_N).contains(&self.depth_m)
    }

    fn loads(&self) -> [(u32, f32); 5] {
        loads_of_joint(self.node, &self.tet, &self.weights, self.stiffness_n_m)
    }

    /// Force along the normal at `position`, N, at least 0.
    fn push_n(&self, position: &[[f32; 4]], softening: f32) -> f32 {
        let apart = |axis: usize| position[self.node as usize][axis] - dot(&self.weights, &self.tet, position, axis);
        let left_m = self.depth_m - (0..3).map(|axis| self.normal[axis] * apart(axis)).sum::<f32>();
        (self.stiffness_n_m * softening * left_m).clamp(0.0, EXTERNAL_FORCE_MAX_N)
    }
}

/// Factor that keeps the sum of the springs at each free node within the model's contact stiffness.
fn softening(model: &Model, load_n_m: &[f32], loads: &[(u32, f32)]) -> f32 {
    let limit = model.options.contact_stiffness_n_m as f32;
    let mut factor = 1.0f32;
    for &(node, share) in loads {
        let node = node as usize;
        if share > 0.0 && !model.held[node] && load_n_m[node] > limit {
            factor = factor.min(limit / load_n_m[node]);
        }
    }
    factor
}

fn dot(weights: &[f32; 4], nodes: &[u32; 4], position: &[[f32; 4]], axis: usize) -> f32 {
    let mut sum = 0.0;
    for (weight, &node) in weights.iter().zip(nodes) {
        sum += weight * position[node as usize][axis];
    }
    sum
}

impl Links<'_> {
    /// Sums the stiffness at each node into `load_n_m`; returns how many springs are softened and how many ignored.
    pub fn weigh(&self, model: &Model, load_n_m: &mut [f32]) -> (u32, u32) {
        let (mut softened, mut ignored) = (0, 0);
        if self.springs.is_empty() && self.pairs.is_empty() && self.attachments.is_empty() {
            return (softened, ignored);
        }
        let count = load_n_m.len();
        load_n_m.fill(0.0);
        for spring in self.springs.iter().filter(|spring| spring.usable(count)) {
            spring.loads().into_iter().for_each(|(node, share)| load_n_m[node as usize] += share);
        }
        for pair in self.pairs.iter().filter(|pair| pair.usable(count)) {
            pair.loads().into_iter().for_each(|(node, share)| load_n_m[node as usize] += share);
        }
        for attachment in self.attachments.iter().filter(|attachment| attachment.usable(count)) {
            attachment.loads().into_iter().for_each(|(node, share)| load_n_m[node as usize] += share);
        }
        for spring in self.springs {
            let usable = spring.usable(count);
            ignored += u32::from(!usable);
            softened += u32::from(usable && softening(model, load_n_m, &spring.loads()) < 1.0);
        }
        for pair in self.pairs {
            let usable = pair.usable(count);
            ignored += u32::from(!usable);
            softened += u32::from(usable && softening(model, load_n_m, &pair.loads()) < 1.0);
        }
        for attachment in self.attachments {
            let usable = attachment.usable(count);
            ignored += u32::from(!usable);
            softened += u32::from(usable && softening(model, load_n_m, &attachment.loads()) < 1.0);
        }
        (softened, ignored)
    }

    /// Adds the forces at `position` to `force`.
    pub fn add_forces(&self, model: &Model, load_n_m: &[f32], position: &[[f32; 4]], force: &mut [[f32; 4]]) {
        let count = load_n_m.len();
        for spring in self.springs.iter().filter(|spring| spring.usable(count)) {
            let along = [0, 1, 2].map(|axis| spring.normal[axis] * dot(&spring.weights, &spring.nodes, position, axis));
            let depth_m = spring.offset_m - (along[0] + along[1] + along[2]);
            if depth_m > 0.0 {
                let stiffness = spring.stiffness_n_m * softening(model, load_n_m, &spring.loads());
                let push_n = (stiffness * depth_m).min(EXTERNAL_FORCE_MAX_N);
                for (&node, weight) in spring.nodes.iter().zip(spring.weights) {
                    for axis in 0..3 {
                        force[node as usize][axis] += weight * push_n * spring.normal[axis];
                    }
                }
            }
        }
        for pair in self.pairs.iter().filter(|pair| pair.usable(count)) {
            let push_n = pair.push_n(position, softening(model, load_n_m, &pair.loads()));
            if push_n > 0.0 {
                for axis in 0..3 {
                    let part_n = push_n * pair.normal[axis];
                    force[pair.node as usize][axis] += part_n;
                    for (&node, weight) in pair.tet.iter().zip(pair.weights) {
                        force[node as usize][axis] -= weight * part_n;
                    }
                }
            }
        }
        for attachment in self.attachments.iter().filter(|attachment| attachment.usable(count)) {
            let stiffness = attachment.stiffness_n_m * softening(model, load_n_m, &attachment.loads());
            for axis in 0..3 {
                let place = dot(&attachment.weights, &attachment.tet, position, axis);
                let pull_n = stiffness * (place - position[attachment.node as usize][axis]);
                force[attachment.node as usize][axis] += pull_n;
                for (&node, weight) in attachment.tet.iter().zip(attachment.weights) {
                    force[node as usize][axis] -= weight * pull_n;
                }
            }
        }
    }
}
