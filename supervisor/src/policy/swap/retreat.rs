//! A swap that is undone: the old engine has the role again, and the newcomer goes. It is not told to go while it does the work and nobody else
//! is ready, but for a bounded time. One that does not end is not waited for, either: whenever it does, another of the old kind follows it, but for a guest,
//! which keeps its place until then.

use super::{Stage, Swap, VACATE_WITHIN_NS, tend};
use crate::policy::{Action, LEAVE_WITHIN_NS, Life, Reason, State};
use hyst_messages::Slot;

/// Undoes the swap.
pub(super) fn fail(now_ns: u64, reason: Reason, state: &mut State) -> Vec<Action> {
    let Some(swap) = &mut state.swap else { return Vec::new() };
    let (role, to) = (swap.role(), swap.incumbent);
    swap.enter(now_ns, Stage::Retreating);
    let mut actions = vec![Action::Retreat { role, to, reason }];
    actions.extend(tend(now_ns, state));
    actions
}

/// The newcomer is gone.
pub(super) fn retreated(slot: Slot, state: &mut State) -> Vec<Action> {
    state.swap = None;
    if slot.is_guest() {
        state.set_life(slot, Life::Closed);
        return vec![Action::EndSwap { role: slot.role(), promoted: false }];
    }
    let end = Action::EndSwap { role: slot.role(), promoted: false };
    if state.stopping {
        state.set_life(slot, Life::Vacant { due_ns: u64::MAX });
        return vec![end];
    }
    state.set_life(slot, Life::Spawning);
    vec![end, Action::Spawn { slot }]
}

/// What is next: the role goes back to an elder, and the newcomer goes.
pub(super) fn next(now_ns: u64, swap: &Swap, state: &mut State) -> Vec<Action> {
    let (slot, role, passed_ns) = (swap.slot, swap.role(), now_ns.saturating_sub(swap.since_ns));
    let is_waited_for = passed_ns <= LEAVE_WITHIN_NS + VACATE_WITHIN_NS;
    let incarnation = match state.places.get(&slot).map_or(Life::Closed, |place| place.life) {
        Life::Alive { .. } | Life::Spawning if swap.dismissed && is_waited_for => return Vec::new(), // its death ends this
        Life::Spawning if slot.is_guest() => return Vec::new(),
        Life::Alive { incarnation, .. } if !swap.dismissed && (slot.is_guest() || incarnation == swap.incarnation) => incarnation,
        _ => {
            state.swap = None;
            return vec![Action::EndSwap { role, promoted: false }];
        }
    };
    let elder = state.elder(slot, swap.incumbent);
    let holds = slot.is_guest() && state.holder(role) == incarnation;
    let works = holds || (!slot.is_guest() && role.is_replicated() && state.is_ready(slot));
    if works && elder.is_none() && passed_ns < LEAVE_WITHIN_NS {
        return Vec::new();
    }
    if let Some(swap) = &mut state.swap {
        swap.dismissed = true;
    }
    let hand_over = elder.filter(|_| holds).map(|incarnation| Action::HandOver { role, incarnation });
    hand_over.into_iter().chain([Action::Dismiss { slot, incarnation }]).collect()
}
