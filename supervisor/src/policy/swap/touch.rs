//! Whether anything was felt while a newcomer was on probation. Two servos agree at zero force, two tissues without contact, and a worker that nobody asks misses
//! nothing: of an engine through which the hand feels, a probation in the open shows little.

use super::{Stage, State, Swap};
use crate::policy::Action;
use hyst_messages::Role;

/// How long a probation waits for the hand to touch something, ns: a trainee who works does so every few seconds. Nobody is held up for longer, since the newcomer
/// has done nothing wrong; that nothing was felt is said.
pub const TOUCH_WITHIN_NS: u64 = 10_000_000_000;

/// Whether the hand feels through a role.
pub(super) const fn feels(role: Role) -> bool {
    matches!(role, Role::Device | Role::Haptic | Role::Tissue | Role::CollisionWorker)
}

/// The hand has felt something for a while since the newcomer is on probation.
pub(in crate::policy) fn touched(incarnation: u32, state: &mut State) -> Vec<Action> {
    let of_newcomer = |swap: &&mut Swap| swap.incarnation == incarnation && swap.stage == Stage::Probation;
    if let Some(swap) = state.swap.as_mut().filter(of_newcomer) {
        swap.touched = true;
    }
    Vec::new()
}

impl Swap {
    /// Whether it was tried in touch, if that matters for its role.
    pub fn was_tried_in_touch(&self) -> bool {
        self.touched || !feels(self.role())
    }
    pub(super) fn waits_for_touch(&self, now_ns: u64) -> bool {
        !self.was_tried_in_touch() && now_ns.saturating_sub(self.trial_ns) < TOUCH_WITHIN_NS
    }
}
