//! After the probation: the other slots of the role get the new engine, one after the other, each as soon as somebody else does its work.

use super::{Stage, Swap, arrive_within_ns, enter, tend};
use crate::policy::{Action, State};
use hyst_messages::Slot;
use hyst_messages::page::Stage as Told;

/// The newcomer has passed.
pub(super) fn begin(now_ns: u64, swap: &Swap, state: &mut State) -> Vec<Action> {
    let role = swap.role();
    let others = state.places.keys().filter(|slot| slot.role() == role && **slot != swap.slot).copied();
    let mut rest: Vec<(Slot, u32, bool)> = others.filter_map(|slot| Some((slot, state.alive(slot)?, false))).collect();
    // The spare first: whoever held the role before is the one that knows it best.
    rest.sort_by_key(|(slot, incarnation, _)| (*incarnation == swap.incumbent, *slot));
    if let Some(swap) = &mut state.swap {
        swap.rest = rest;
        swap.enter(now_ns, Stage::Settling);
    }
    let mut actions = vec![Action::Adopt { role }, Action::Told { role, stage: Told::Settled, incarnation: swap.incarnation }];
    actions.extend(tend(now_ns, state));
    actions
}

/// Whether each place of the role but the guest's has somebody who is ready and stays, or will have nobody any more. Before, the guest stays: it may be the only one
/// that has the state.
pub(super) fn others_are_back(swap: &Swap, state: &State) -> bool {
    let mut others = state.places.keys().filter(|slot| slot.role() == swap.role() && **slot != swap.slot);
    others.all(|slot| state.staying(*slot).is_some() || state.is_given_up(*slot))
}

/// The next slot that an old engine is in; at the end the role goes back from the guest.
pub(super) fn next(now_ns: u64, state: &mut State) -> Vec<Action> {
    let Some(swap) = state.swap.clone() else { return Vec::new() };
    let role = swap.role();
    let Some((slot, old, told)) = swap.rest.first().copied() else {
        // A guest that is gone has nothing to give back.
        if !swap.slot.is_guest() || state.alive(swap.slot).is_none() {
            state.swap = None;
            return vec![Action::EndSwap { role, promoted: true }];
        }
        let is_late = now_ns.saturating_sub(swap.since_ns) > arrive_within_ns(role);
        if !is_late && !others_are_back(&swap, state) {
            return Vec::new();
        }
        // It alone does the role's work, which no bound of time is to cost: each place is filled again and again, and whoever comes to be ready has the role. It
        // goes before that if it is unfit, as any that is alone, or dies.
        let Some(elder) = state.elder(swap.slot, 0) else { return Vec::new() };
        enter(now_ns, Stage::Returning, state);
        let hand_over = (state.holder(role) == swap.incarnation).then_some(Action::HandOver { role, incarnation: elder });
        return hand_over.into_iter().collect();
    };
    let now = state.ready(slot);
    let late = now_ns.saturating_sub(swap.since_ns) > arrive_within_ns(role);
    if now.is_some_and(|now| now != old) || state.is_given_up(slot) || late {
        if let Some(swap) = &mut state.swap {
            swap.rest.remove(0);
            swap.since_ns = now_ns;
        }
        return tend(now_ns, state);
    }
    let covered = !role.is_replicated()
        || state.places.keys().any(|other| other.role() == role && *other != slot && state.staying(*other).is_some());
    if told || state.alive(slot) != Some(old) || !covered {
        return Vec::new();
    }
    if let Some(first) = state.swap.as_mut().and_then(|swap| swap.rest.first_mut()) {
        first.2 = true;
    }
    vec![Action::Dismiss { slot, incarnation: old }]
}
