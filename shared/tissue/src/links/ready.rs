//! What of a spring stays as it is through all substeps of a step: how far it is softened, and how much of its damping integration allows. It is weighed
//! once per step.
//!
//! Promise: who asks gets the same bits, whether there was room to keep them or they are weighed anew.

use super::{Attachment, Hold, PairSpring, PlaneSpring};
use crate::model::Model;
use crate::step::EXTERNAL_FORCE_MAX_N;

/// Most springs of a step that are weighed once: many times what a scene has. Those beyond are weighed in every substep.
pub(crate) const READY_MAX: usize = 4096;

/// Most of a node's damping over its mass times the substep: half of a speed is taken in a substep, or the speed would change its sign again and again.
const DAMPING_PHASE: f32 = 0.5;
/// Share that is taken of the damping with which explicit integration is just stable.
const STABLE_SHARE: f32 = 0.95;

/// A spring that was weighed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ready {
    /// Stiffness after softening, N/m.
    pub stiffness_n_m: f32,
    /// Most damping that it may have, N·s/m.
    pub most_n_s_m: f32,
    /// Whether it is softened.
    pub is_softened: bool,
}

/// What is kept of the spring of a number; weighed anew where there was no room for it. `None` if it cannot be used.
pub(crate) fn known(ready: &[Option<Ready>], number: usize, weigh: impl FnOnce() -> Option<Ready>) -> Option<Ready> {
    ready.get(number).copied().unwrap_or_else(weigh)
}

/// How the springs of a step hold on to the nodes of a model.
#[derive(Clone, Copy)]
pub(crate) struct Grip<'a> {
    pub model: &'a Model,
    /// Sum of spring stiffness per node, N/m.
    pub load_n_m: &'a [f32],
    pub substep_s: f32,
}

impl Grip<'_> {
    /// Weighs a spring by the row sums of its stiffness matrix, as (node, N/m).
    fn ready(&self, stiffness_n_m: f32, loads: &[(u32, f32)]) -> Ready {
        let factor = self.softening(loads);
        let stiffness_n_m = stiffness_n_m * factor;
        Ready { stiffness_n_m, most_n_s_m: stiffness_n_m * self.most_damping_s(loads), is_softened: factor < 1.0 }
    }

    /// Factor that keeps the sum of the springs at each free node within the model's contact stiffness.
    fn softening(&self, loads: &[(u32, f32)]) -> f32 {
        let limit = self.model.options.contact_stiffness_n_m as f32;
        let mut factor = 1.0f32;
        for &(node, share) in loads {
            let node = node as usize;
            if share > 0.0 && !self.model.held[node] && self.load_n_m[node] > limit {
                factor = factor.min(limit / self.load_n_m[node]);
            }
        }
        factor
    }

    /// Most damping of a spring over its stiffness, s. With rates that lag by half a substep h, explicit integration is stable while
    /// 4M − 2hC − h²K is positive; K and C are below the diagonal matrices of κ (the model's bound) and of the sums of damping at the nodes.
    fn most_damping_s(&self, loads: &[(u32, f32)]) -> f32 {
        let (h, limit) = (self.substep_s, self.model.options.contact_stiffness_n_m as f32);
        let mut most_s = EXTERNAL_FORCE_MAX_N;
        for &(node, share) in loads {
            let node = node as usize;
            if share > 0.0 && !self.model.held[node] {
                let (mass, bound) = (self.model.mass_kg[node], self.model.bound_n_m[node]);
                let stable = STABLE_SHARE * (4.0 * mass - h * h * bound) / (2.0 * h);
                let room_n_s_m = stable.min(DAMPING_PHASE * mass / h).max(0.0);
                most_s = most_s.min(room_n_s_m / self.load_n_m[node].min(limit));
            }
        }
        most_s
    }
}

impl PlaneSpring {
    pub(crate) fn ready(&self, grip: &Grip<'_>) -> Option<Ready> {
        self.usable(grip.load_n_m.len()).then(|| grip.ready(self.stiffness_n_m, &self.loads()))
    }
}

impl PairSpring {
    pub(crate) fn ready(&self, grip: &Grip<'_>) -> Option<Ready> {
        self.usable(grip.load_n_m.len()).then(|| grip.ready(self.stiffness_n_m, &self.loads()))
    }
}

impl Hold {
    pub(crate) fn ready(&self, grip: &Grip<'_>) -> Option<Ready> {
        self.usable(grip.load_n_m.len()).then(|| grip.ready(self.stiffness_n_m, &self.loads()))
    }
}

impl Attachment {
    pub(super) fn ready(&self, grip: &Grip<'_>) -> Option<Ready> {
        self.usable(grip.load_n_m.len()).then(|| grip.ready(self.stiffness_n_m, &self.loads()))
    }
}
