//! A swap, as the policy sees it: one newcomer at a time, from its start to the place of all processes of its role, or back.
//!
//! A role with a state takes its newcomer as a guest, beside holder and spare: it *arrives*, *shadows*, is *promoted*, is on *probation* while the
//! elders keep their own state; then the other slots are *settled*, one after the other, the guest gives the role back to one of them and
//! *leaves*. The other roles are replaced in place, first one slot, which *vacates*, arrives and is on probation (a servo shadows and is promoted
//! too, because the other one computes beside it), then the rest. A tissue *yields* where something is cut (`pauses.rs`). Whatever goes wrong before the end of the probation leads to the retreat: the
//! old engine has the role, and the newcomer is gone.
//!
//! Promises: nothing is settled before a probation that nobody doubted; every swap ends once; the role is never taken from its only process
//! that is ready while another may still come; a guest's slot is empty after the end, or has a guest that was told to go and does not end. Then no swap of
//! its role begins before it is gone (`places.rs`).

mod pauses;
mod places;
mod retreat;
mod settle;
mod touch;

use super::{Action, Cause, Life, Reason, State, is_judged};
use hyst_messages::page::Stage as Told;
use hyst_messages::{Role, Slot};
pub(super) use pauses::{cuts, parted};
use retreat::{fail, retreated};
pub use touch::TOUCH_WITHIN_NS;
pub(super) use touch::touched;

/// How long an old engine may take to end in whose place its newcomer starts, ns: one that a disk keeps is not waited for, and its swap is undone. A guest
/// whose work is done may take as long: then its swap is over.
pub const VACATE_WITHIN_NS: u64 = 10_000_000_000;
/// How long a newcomer may take until it is ready, ns: what the watch allows to any start.
pub const ARRIVE_WITHIN_NS: u64 = 30_000_000_000;
/// The same for pictures in software.
pub const ARRIVE_ORDINARY_WITHIN_NS: u64 = 180_000_000_000;
/// How long it may take to agree with the incumbent, ns: a holder that is late leaps, and then there is nothing to compare with. With all the pauses in which a
/// tissue gives the role back while something is cut.
pub const SHADOW_WITHIN_NS: u64 = 60_000_000_000;
/// How long it may take to have the role once it may, ns: a promotion waits for the end of a step, and is the work of the newcomer itself.
pub const PROMOTE_WITHIN_NS: u64 = 5_000_000_000;
/// How long a probation may take until enough of it was compared, ns: a newcomer that leaps over ticks again and again leaves nothing to compare.
pub const PROVE_WITHIN_NS: u64 = 30_000_000_000;
/// How often a newcomer may lose the role on its probation to an elder that saw it miss steps: a stall of the machine hits anybody, and then
/// the probation begins anew.
pub const MOST_LOSSES: u32 = 3;
/// How long the guest may take to give the role back after all others are settled, ns.
pub const GIVE_BACK_WITHIN_NS: u64 = 5_000_000_000;

/// Time on probation: longer than a hang of the role takes to be found, ns; of a device for two strokes of a hand that presses, beyond its ramps.
pub const fn probation_ns(role: Role) -> u64 {
    match role {
        Role::Rendering => 12_000_000_000,
        Role::Device | Role::Fluid | Role::Recorder | Role::Console => 4_000_000_000,
        _ => 2_000_000_000,
    }
}

const fn arrive_within_ns(role: Role) -> u64 {
    match role {
        Role::Rendering | Role::Recorder | Role::Console => ARRIVE_ORDINARY_WITHIN_NS,
        _ => ARRIVE_WITHIN_NS,
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Vacating,
    Arriving,
    Shadowing,
    Promoting,
    Probation,
    Yielding,
    Settling,
    Returning,
    Leaving,
    Retreating,
}

/// The swap that is under way.
#[derive(Clone, Debug)]
pub struct Swap {
    slot: Slot,
    stage: Stage,
    since_ns: u64,
    /// The newcomer, 0 until it was started.
    incarnation: u32,
    /// Who has the role beside it.
    incumbent: u32,
    /// Slots that are still to be settled, each with the incarnation that must go, and whether that was told.
    rest: Vec<(Slot, u32, bool)>,
    /// The newcomer was told to go.
    dismissed: bool,
    losses: u32,
    /// It was compared for long enough on this probation, also at its end, and agrees; asked of a role that has a judge.
    agrees: bool,
    /// The hand has felt something on this probation.
    touched: bool,
    /// When it was in the shadow first, and when its probation began, ns; and how long that was before something was cut, ns.
    shadow_ns: u64,
    trial_ns: u64,
    tried_ns: u64,
}

impl Swap {
    /// One that begins.
    fn begun(now_ns: u64, slot: Slot, incumbent: u32) -> Swap {
        Swap {
            slot,
            stage: Stage::Arriving,
            since_ns: now_ns,
            incarnation: 0,
            incumbent,
            rest: Vec::new(),
            dismissed: false,
            losses: 0,
            agrees: false,
            touched: false,
            shadow_ns: now_ns,
            trial_ns: now_ns,
            tried_ns: 0,
        }
    }
    /// The role.
    pub fn role(&self) -> Role {
        self.slot.role()
    }
    fn enter(&mut self, now_ns: u64, stage: Stage) {
        (self.stage, self.since_ns) = (stage, now_ns);
    }
    fn begin_probation(&mut self, now_ns: u64) {
        self.enter(now_ns, Stage::Probation);
        self.agrees = !is_judged(self.role());
        if self.tried_ns == 0 {
            (self.touched, self.trial_ns) = (false, now_ns);
        }
    }
    /// Whether it has been on probation for as long as its role asks.
    fn is_tried(&self, now_ns: u64) -> bool {
        self.tried_ns + now_ns.saturating_sub(self.since_ns) >= probation_ns(self.role())
    }
    /// Whether the newcomer is to give the role back for now.
    pub fn is_given_back(&self) -> bool {
        self.stage == Stage::Yielding
    }
    fn is_proven(&self) -> bool {
        matches!(self.stage, Stage::Settling | Stage::Returning | Stage::Leaving)
    }
}

/// Somebody asks for a swap that begins in this slot. Nothing happens if [`State::may_swap`] says no.
pub(super) fn begin(now_ns: u64, slot: Slot, incumbent: u32, state: &mut State) -> Vec<Action> {
    if state.may_swap(slot).is_err() {
        return Vec::new();
    }
    let mut swap = Swap::begun(now_ns, slot, incumbent);
    let action = match state.alive(slot) {
        Some(incarnation) => {
            swap.stage = Stage::Vacating;
            Action::Dismiss { slot, incarnation }
        }
        None => {
            state.set_life(slot, Life::Spawning);
            Action::Spawn { slot }
        }
    };
    state.swap = Some(swap);
    vec![action]
}

/// What a supervisor before this one left unfinished: a swap that was proven is finished, any other is undone.
pub(super) fn resume(now_ns: u64, left: &super::Left, state: &mut State) -> Vec<Action> {
    let incarnation = state.alive(left.slot).filter(|alive| *alive == left.incarnation).unwrap_or(0);
    let rest = if left.proven { left.old.iter().map(|(slot, old)| (*slot, *old, false)).collect() } else { Vec::new() };
    state.swap = Some(Swap { stage: Stage::Probation, incarnation, rest, ..Swap::begun(now_ns, left.slot, left.incumbent) });
    if left.proven {
        enter(now_ns, Stage::Settling, state);
        // Who died may not have said so any more: until it is said, the elders keep their line.
        let settled = Action::Told { role: left.slot.role(), stage: Told::Settled, incarnation };
        return std::iter::once(settled).filter(|_| incarnation != 0).chain(tend(now_ns, state)).collect();
    }
    fail(now_ns, Reason::new(Cause::Interrupted, "the supervisor died meanwhile"), state)
}

fn enter(now_ns: u64, stage: Stage, state: &mut State) {
    if let Some(swap) = &mut state.swap {
        swap.enter(now_ns, stage);
    }
}

/// Whether the newcomer of the swap that is under way is in this slot, and has passed its probation.
pub(super) fn is_proven(slot: Slot, state: &State) -> bool {
    state.swap.as_ref().is_some_and(|swap| swap.slot == slot && swap.is_proven())
}

/// Somebody of the swap's role is ready.
pub(super) fn ready(now_ns: u64, slot: Slot, incarnation: u32, state: &mut State) -> Vec<Action> {
    let Some(swap) = state.swap.as_mut().filter(|swap| swap.slot == slot && swap.stage == Stage::Arriving) else {
        return Vec::new();
    };
    swap.incarnation = incarnation;
    let role = swap.role();
    if !role.is_replicated() {
        swap.begin_probation(now_ns);
        return vec![Action::Told { role, stage: Told::Trial, incarnation }];
    }
    swap.enter(now_ns, Stage::Shadowing);
    swap.shadow_ns = now_ns;
    vec![Action::Told { role, stage: Told::Shadow, incarnation }]
}

/// A process was started.
pub(super) fn spawned(now_ns: u64, slot: Slot, incarnation: u32, state: &mut State) -> Vec<Action> {
    match state.swap.as_mut().filter(|swap| swap.slot == slot) {
        Some(swap) if swap.stage == Stage::Arriving => {
            swap.incarnation = incarnation;
            Vec::new()
        }
        Some(swap) if swap.stage == Stage::Retreating && slot.is_guest() => {
            swap.incarnation = incarnation;
            tend(now_ns, state)
        }
        _ => Vec::new(),
    }
}

/// The judge has compared enough, and the newcomer agrees.
pub(super) fn agreed(now_ns: u64, incarnation: u32, state: &mut State) -> Vec<Action> {
    let Some(swap) = state.swap.as_mut().filter(|swap| swap.incarnation == incarnation) else { return Vec::new() };
    let role = swap.role();
    match swap.stage {
        Stage::Shadowing => {
            swap.enter(now_ns, Stage::Promoting);
            vec![Action::Told { role, stage: Told::Trial, incarnation }]
        }
        // What was compared before its end does not tell that it still works then.
        Stage::Probation => {
            swap.agrees |= swap.is_tried(now_ns);
            Vec::new()
        }
        _ => Vec::new(),
    }
}

/// Somebody holds a role, or the device follows a servo.
pub(super) fn holds(now_ns: u64, role: Role, incarnation: u32, state: &mut State) -> Vec<Action> {
    let Some(swap) = state.swap.as_mut().filter(|swap| swap.role() == role) else { return Vec::new() };
    let own = incarnation == swap.incarnation && incarnation != 0;
    match swap.stage {
        Stage::Promoting if own => {
            swap.begin_probation(now_ns);
            Vec::new()
        }
        Stage::Arriving | Stage::Shadowing | Stage::Promoting if !own => {
            swap.incumbent = incarnation; // whose spare took over meanwhile
            Vec::new()
        }
        Stage::Yielding if !own => pauses::shadows_again(now_ns, incarnation, state),
        Stage::Shadowing if own && role.is_stateful() => {
            fail(now_ns, Reason::new(Cause::Unasked, "it took the role unasked"), state)
        }
        Stage::Probation if !own && role.is_stateful() && swap.losses < MOST_LOSSES => {
            (swap.losses, swap.tried_ns) = (swap.losses + 1, 0);
            swap.enter(now_ns, Stage::Promoting);
            Vec::new()
        }
        Stage::Probation if !own && role.is_stateful() => {
            let text = "it missed its steps again and again, and the old engine took the role back";
            fail(now_ns, Reason::new(Cause::Missed, text), state)
        }
        _ => Vec::new(),
    }
}

/// Somebody has a reason not to trust a process: if that is the newcomer, its swap is undone for it.
pub(super) fn doubted(now_ns: u64, incarnation: u32, reason: Reason, state: &mut State) -> Vec<Action> {
    let is_newcomer = |swap: &Swap| {
        incarnation != 0 && swap.incarnation == incarnation && !swap.is_proven() && !matches!(swap.stage, Stage::Retreating)
    };
    if state.swap.as_ref().is_some_and(is_newcomer) { fail(now_ns, reason, state) } else { Vec::new() }
}

/// A process died that the swap has to do with: gives what follows, or nothing if this is an ordinary death.
pub(super) fn died(now_ns: u64, slot: Slot, incarnation: u32, hung: bool, state: &mut State) -> Option<Vec<Action>> {
    let swap = state.swap.as_mut()?;
    if swap.rest.iter().any(|(other, old, told)| *other == slot && *old == incarnation && *told) {
        state.set_life(slot, Life::Spawning);
        return Some(vec![Action::Spawn { slot }]);
    }
    if swap.slot != slot {
        return None;
    }
    match swap.stage {
        Stage::Vacating => {
            swap.enter(now_ns, Stage::Arriving);
            state.set_life(slot, Life::Spawning);
            Some(vec![Action::Spawn { slot }])
        }
        Stage::Retreating => Some(retreated(slot, state)),
        Stage::Arriving | Stage::Shadowing | Stage::Promoting | Stage::Probation | Stage::Yielding => {
            let (role, to) = (swap.role(), swap.incumbent);
            let reason = if hung { Reason::new(Cause::Hung, "it hung") } else { Reason::new(Cause::Died, "it died") };
            let mut actions = vec![Action::Retreat { role, to, reason }];
            actions.extend(retreated(slot, state));
            Some(actions)
        }
        Stage::Settling | Stage::Returning | Stage::Leaving if slot.is_guest() => {
            state.set_life(slot, Life::Closed);
            Some(tend(now_ns, state))
        }
        _ => None,
    }
}

/// A start failed: of the newcomer, if it says so.
pub(super) fn spawn_failed(slot: Slot, no_room: bool, state: &mut State) -> Option<Vec<Action>> {
    let swap = state.swap.as_ref().filter(|swap| swap.slot == slot && !swap.is_proven())?;
    let (role, to) = (swap.role(), swap.incumbent);
    let reason = match no_room {
        true => Reason::new(Cause::NoTime, "the machine has no room for it in /dev/shm"),
        false => Reason::new(Cause::NotReady, "it cannot be started"),
    };
    let retreat = Action::Retreat { role, to, reason };
    let mut actions = if swap.stage == Stage::Retreating { Vec::new() } else { vec![retreat] };
    actions.extend(retreated(slot, state));
    Some(actions)
}

/// What is due.
pub(super) fn tend(now_ns: u64, state: &mut State) -> Vec<Action> {
    let Some(swap) = state.swap.clone().filter(|_| !state.stopping) else { return Vec::new() };
    let (role, passed_ns) = (swap.role(), now_ns.saturating_sub(swap.since_ns));
    match swap.stage {
        Stage::Vacating if passed_ns > VACATE_WITHIN_NS => {
            fail(now_ns, Reason::new(Cause::NoTime, "the old engine did not end, and keeps its place"), state)
        }
        Stage::Arriving if passed_ns > arrive_within_ns(role) => {
            fail(now_ns, Reason::new(Cause::NotReady, "it did not become ready"), state)
        }
        Stage::Shadowing if now_ns.saturating_sub(swap.shadow_ns) > SHADOW_WITHIN_NS => {
            fail(now_ns, Reason::new(Cause::NotCompared, "it could not be compared with the old engine in time"), state)
        }
        Stage::Promoting if passed_ns > PROMOTE_WITHIN_NS => {
            fail(now_ns, Reason::new(Cause::Missed, "it did not take the role"), state)
        }
        Stage::Probation if swap.agrees && swap.is_tried(now_ns) && !swap.waits_for_touch(now_ns) => {
            settle::begin(now_ns, &swap, state)
        }
        Stage::Probation if passed_ns > PROVE_WITHIN_NS => {
            fail(now_ns, Reason::new(Cause::NotCompared, "it could not be compared on its probation"), state)
        }
        Stage::Yielding => pauses::next(now_ns, state),
        Stage::Settling => settle::next(now_ns, state),
        Stage::Returning if state.holder(role) != swap.incarnation => {
            if passed_ns <= GIVE_BACK_WITHIN_NS && !settle::others_are_back(&swap, state) {
                return Vec::new();
            }
            enter(now_ns, Stage::Leaving, state);
            dismiss(swap.slot, state).map_or_else(|| tend(now_ns, state), |action| vec![action])
        }
        Stage::Returning if passed_ns > GIVE_BACK_WITHIN_NS => {
            enter(now_ns, Stage::Settling, state); // whom it was given to died: it is given to another
            Vec::new()
        }
        Stage::Leaving if state.alive(swap.slot).is_none() || passed_ns > VACATE_WITHIN_NS => {
            state.swap = None;
            vec![Action::EndSwap { role, promoted: true }]
        }
        Stage::Retreating => retreat::next(now_ns, &swap, state),
        _ => Vec::new(),
    }
}

fn dismiss(slot: Slot, state: &State) -> Option<Action> {
    state.alive(slot).map(|incarnation| Action::Dismiss { slot, incarnation })
}
