//! A tissue on trial while the electrode cuts. What was cut is to stay cut; but a newcomer and the old engine, which goes on beside it, lose other ticks to the
//! machine, and cut at other places. To undo the one would take back what the trainee has seen, and to compare them would blame a good one. So whoever is not
//! proven cuts nothing: as soon as there is current it gives the role back, before the wire has swept enough to cut. It shadows what the old engine cuts, in
//! which it is compared with it step by step, and has the role again in the next pause. The time that it has had it counts.
//!
//! Nor is one blamed at once whose state has become another one after one of the two lost ticks: a piece that floats is elsewhere then, and nothing pulls it back.

use super::{GIVE_BACK_WITHIN_NS, MOST_LOSSES, Reason, Stage, State, Swap, fail};
use crate::policy::Action;
use hyst_messages::Role;
use hyst_messages::page::Stage as Told;

fn on_probation(incarnation: u32, state: &mut State) -> Option<&mut Swap> {
    let is_it = |swap: &&mut Swap| {
        swap.incarnation == incarnation && swap.stage == Stage::Probation && swap.role() == Role::Tissue && incarnation != 0
    };
    state.swap.as_mut().filter(is_it)
}

/// There is current while the newcomer is on probation.
pub(in crate::policy) fn cuts(now_ns: u64, incarnation: u32, state: &mut State) -> Vec<Action> {
    let Some(swap) = on_probation(incarnation, state) else { return Vec::new() };
    let (slot, incumbent) = (swap.slot, swap.incumbent);
    if state.elder(slot, incumbent).is_none() {
        return Vec::new(); // nobody else can cut
    }
    if let Some(swap) = &mut state.swap {
        swap.tried_ns += now_ns.saturating_sub(swap.since_ns);
        swap.enter(now_ns, Stage::Yielding);
    }
    next(now_ns, state)
}

/// Its state and that of the old engine have parted as those of two good ones may: a piece that has left with the outflow in the one hangs in the other. From a
/// state that both have they may go on together; if they part each time, it is the newcomer's doing, for this reason.
pub(in crate::policy) fn parted(now_ns: u64, incarnation: u32, reason: Reason, state: &mut State) -> Vec<Action> {
    let Some(swap) = on_probation(incarnation, state) else { return Vec::new() };
    if swap.losses >= MOST_LOSSES {
        return fail(now_ns, Reason { text: format!("{}, again and again", reason.text), ..reason }, state);
    }
    let actions = cuts(now_ns, incarnation, state);
    if let Some(swap) = state.swap.as_mut().filter(|swap| swap.stage == Stage::Yielding) {
        (swap.losses, swap.tried_ns) = (swap.losses + 1, 0);
    }
    actions
}

/// Whom it gives the role back to, as long as it has it.
pub(super) fn next(now_ns: u64, state: &mut State) -> Vec<Action> {
    let Some((slot, incumbent)) = state.swap.as_ref().map(|swap| (swap.slot, swap.incumbent)) else { return Vec::new() };
    let holder = state.holder(slot.role());
    let elder = state.elder(slot, incumbent);
    let Some(swap) = &mut state.swap else { return Vec::new() };
    if now_ns.saturating_sub(swap.since_ns) > GIVE_BACK_WITHIN_NS {
        swap.begin_probation(now_ns); // nobody took it
        return Vec::new();
    }
    let elder = elder.filter(|_| holder == swap.incarnation);
    elder.map(|incarnation| Action::HandOver { role: slot.role(), incarnation }).into_iter().collect()
}

/// An elder has the role again.
pub(super) fn shadows_again(now_ns: u64, holder: u32, state: &mut State) -> Vec<Action> {
    let Some(swap) = &mut state.swap else { return Vec::new() };
    swap.incumbent = holder;
    swap.enter(now_ns, Stage::Shadowing);
    vec![Action::Told { role: swap.role(), stage: Told::Shadow, incarnation: swap.incarnation }]
}
