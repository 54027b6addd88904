//! What is held from outside of the model: jaws that have closed on tissue draw points of it to where they are, whichever side the points are on.

use super::{ContactLaw, Push, Ready, are_weights, in_range, loads_of_point, point};
use crate::step::EXTERNAL_FORCE_MAX_N;

/// A point Σ wᵢ·xᵢ of the tissue that is held at a place outside of the model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hold {
    /// Four nodes, usually of a tet; the same node may stand more than once.
    pub nodes: [u32; 4],
    /// Weights from 0 to 1 of the four nodes.
    pub weights: [f32; 4],
    /// Where the point is held, m.
    pub place_m: [f32; 3],
    /// How fast that moves, m/s, which damping is relative to. The place itself stays where it is during the step.
    pub velocity_m_s: [f32; 3],
    /// Stiffness, N/m. Where the springs of a node add up to more than the model's contact stiffness, they are softened to it.
    pub stiffness_n_m: f32,
}

impl Hold {
    pub(crate) fn usable(&self, nodes: usize) -> bool {
        in_range(&self.nodes, nodes)
            && are_weights(&self.weights)
            && self.place_m.iter().chain(&self.velocity_m_s).all(|number| number.is_finite())
            && (0.0..=EXTERNAL_FORCE_MAX_N).contains(&self.stiffness_n_m)
    }

    /// Row sums of its stiffness matrix, as (node, N/m).
    pub(crate) fn loads(&self) -> [(u32, f32); 4] {
        loads_of_point(&self.nodes, &self.weights, self.stiffness_n_m)
    }
}

/// What a usable hold does: a spring to its place, which draws with the law's greatest force at most, and a damper.
pub(crate) fn of_hold<const N: usize>(
    law: &ContactLaw,
    hold: &Hold,
    ready: &Ready,
    position: &[[f32; N]],
    velocity: &[[f32; N]],
) -> Push {
    let (at, speed) = (point(&hold.weights, &hold.nodes, position), point(&hold.weights, &hold.nodes, velocity));
    let stiffness_n_m = ready.stiffness_n_m;
    let damping_n_s_m = (stiffness_n_m * law.damping_s).min(ready.most_n_s_m);
    let away_m = [0, 1, 2].map(|axis| hold.place_m[axis] - at[axis]);
    let length_m = (away_m[0] * away_m[0] + away_m[1] * away_m[1] + away_m[2] * away_m[2]).sqrt();
    let normal_n = (stiffness_n_m * length_m).min(law.most_n);
    let per_m = if length_m > 0.0 { normal_n / length_m } else { 0.0 };
    let force_n = [0, 1, 2].map(|axis| per_m * away_m[axis] - damping_n_s_m * (speed[axis] - hold.velocity_m_s[axis]));
    if force_n.iter().all(|force| force.is_finite()) {
        Push { normal_n, stiffness_n_m, force_n, ..Push::default() }
    } else {
        Push::default()
    }
}
