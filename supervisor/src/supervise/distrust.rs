//! Engines that beat and whose output is wrong: whoever reads it refuses it and says so in its page, and the supervisor replaces them as soon as
//! somebody else does their work. So does it with one whose own page says what cannot be, and with one that says itself that a thread that helps it stands
//! still.

mod alone;
mod helpers;

use super::Supervisor;
use crate::fault::finder;
use crate::journal;
use crate::mischief::{self, Charge};
use crate::policy::{self, Event};
use hyst_messages::page::ProcessState;
use hyst_messages::page::device::{self, Distrust};
use hyst_messages::page::haptic;
use hyst_messages::{Role, Slot};

use std::collections::{BTreeMap, BTreeSet};

/// A servo that only stands still is found by its heartbeat. One that has computed so many steps while its stamp stood still is not to be trusted:
/// on a busy machine a healthy one beats without a step while it waits to be connected with a new device.
const STILL_STEPS: u64 = 50;
/// A charge that was not repeated for so long is over, ns.
const SERIES_NS: u64 = 20_000_000;
/// What was said longer ago is forgotten, ns.
const FORGOTTEN_NS: u64 = 500_000_000;

/// Who is not trusted, by incarnation, and what others say of them.
#[derive(Debug, Default)]
pub(super) struct Distrusted {
    /// Who was replaced because others distrust it.
    heeded: BTreeSet<u32>,
    /// Lives of the hardware of which the operator was told that they say what cannot be.
    doubted: BTreeSet<u32>,
    /// What is said of those who are alone in their roles.
    alone: alone::Alone,
    /// Who says that a thread that helps it stands still.
    helpers: helpers::Standing,
    /// Servos whose stamp stands still: how many steps they had made when that was first seen, and the stamp.
    standing: BTreeMap<u32, (u64, u64)>,
    /// Who was ready and whose page did not say so at the last look.
    unsound: BTreeSet<u32>,
}

impl Supervisor {
    /// Replaces those whose output is refused (not finite, out of range, for another input, frozen, without progress). One that only differs or
    /// is late is not killed: two servos that lost different ticks to a stall differ in the last bits, and the host stalls everybody now and then.
    pub(super) fn heed(&mut self, now_ns: u64) {
        let (charges, standstills) = mischief::charges(&mut self.viewer);
        let page = self.viewer.page();
        self.distrusted.alone.keep(|incarnation| self.slots.iter().any(|slot| page.incarnation(*slot) == incarnation));
        self.heed_helpers(standstills, now_ns);
        // In the order of the slots: whoever stands nearer to the hand is heard first, and who is replaced is not heard any more, because one that
        // lies about its own state makes honest ones look wrong.
        for charge in charges {
            let Some(slot) = self.slot_of(charge.incarnation) else { continue };
            let accuser = self.viewer.page().incarnation(charge.by);
            if self.distrusted.heeded.contains(&accuser) || self.distrusted.alone.is_doubted(accuser, slot.role(), now_ns) {
                continue;
            }
            if self.is_newcomer(charge.incarnation) {
                let is_grave = self.is_grave(&charge, slot, now_ns);
                self.heed_newcomer(&charge, is_grave, now_ns);
                continue;
            }
            // One whose readiness is not seen yet is heard of at the next look: it was ended as one that hangs, for which its swap was undone, and not for what it
            // says.
            if self.is_unproven(slot) {
                continue;
            }
            // Nobody knows yet what one is worth that a swap has brought: one that refuses all that it reads would have the old ones replaced. What it
            // refuses it does not use; who stands beside it reads the same, and a device, beside whom nobody does, follows the other servo meanwhile.
            if self.is_unproven(charge.by) {
                continue;
            }
            if self.distrusted.heeded.contains(&charge.incarnation) || !self.is_grave(&charge, slot, now_ns) {
                continue;
            }
            if slot.role() == Role::Hardware {
                // Nobody stands in for the device on the desk: what cannot be is not used, and the operator is told once.
                if self.distrusted.doubted.insert(charge.incarnation) {
                    let text = "what it says cannot be, and is not used; `hystation conformance driver` tries a driver";
                    journal::say(&self.station, &format!("{slot} is distrusted by {}: {text}", charge.by));
                }
                continue;
            }
            let is_covered = self.is_covered(slot, charge.by);
            if !is_covered && !self.serves_nobody(slot, &charge) {
                continue;
            }
            self.distrusted.heeded.insert(charge.incarnation);
            let why = match charge.why {
                why if why == Distrust::Frozen as u64 => "its output stands still",
                why if why == Distrust::Still as u64 => "its stamp stands still",
                _ => "its output is not valid",
            };
            let state = self.refused_in_words(&charge);
            let alone =
                if is_covered { "" } else { ", and the role goes on from a checkpoint, for nobody else has a state of it" };
            journal::say(&self.station, &format!("{slot} is distrusted by {} and is replaced: {why}{state}{alone}", charge.by));
            let incarnation = charge.incarnation;
            self.faults.late(slot, incarnation, charge.since_ns, charge.since_ns, &charge.by.to_string());
            self.end_guilty(slot, incarnation, now_ns);
        }
    }

    /// Which state was refused, and why, where one of the writer's own role did.
    pub(super) fn refused_in_words(&mut self, charge: &Charge) -> String {
        mischief::refused(&mut self.viewer, charge).map_or(String::new(), |state| format!(" ({state})"))
    }

    /// Replaces those who were ready, live on, and say at two looks in a row that they are anything else: nobody would wait for such a page to become whole
    /// again, and its owner writes its state only when that changes.
    pub(super) fn heed_states(&mut self, now_ns: u64) {
        let before = std::mem::take(&mut self.distrusted.unsound);
        for slot in self.slots.clone() {
            let (incarnation, dead) = (self.viewer.page().incarnation(slot), self.viewer.page().is_dead(slot));
            let state = self.viewer.slot_page(slot).map(|page| page.state());
            if dead || state.is_none_or(ProcessState::is_ready) || self.policy.ready(slot) != Some(incarnation) {
                continue;
            }
            self.distrusted.unsound.insert(incarnation);
            if before.contains(&incarnation) && self.distrusted.heeded.insert(incarnation) {
                journal::say(
                    &self.station,
                    &format!(
                        "{slot} is replaced: its page says that it is {}, and it works",
                        state.map_or("", ProcessState::name)
                    ),
                );
                self.faults.late(slot, incarnation, now_ns, now_ns, finder::PAGE);
                self.end_guilty(slot, incarnation, now_ns);
            }
        }
    }

    /// Ends one for what it does. To the policy that is a hang that was found at once: it comes from within, and from the same state a successor may do the same.
    fn end_guilty(&mut self, slot: Slot, incarnation: u32, now_ns: u64) {
        let actions = policy::step(now_ns, Event::HeartbeatLate { slot, incarnation, beat_ns: now_ns }, &mut self.policy);
        self.act(actions);
    }

    /// The slot in which an incarnation lives.
    fn slot_of(&self, incarnation: u32) -> Option<Slot> {
        let page = self.viewer.page();
        self.slots.iter().copied().find(|slot| page.incarnation(*slot) == incarnation && !page.is_dead(*slot))
    }

    fn is_grave(&mut self, charge: &Charge, slot: Slot, now_ns: u64) -> bool {
        if now_ns.saturating_sub(charge.last_ns) > FORGOTTEN_NS {
            return false;
        }
        if slot.role() == Role::Haptic && !charge.is(Distrust::Invalid) && !charge.is(Distrust::Frozen) {
            let stands = charge.is(Distrust::Still) && now_ns.saturating_sub(charge.last_ns) < SERIES_NS;
            if !stands {
                self.distrusted.standing.remove(&charge.incarnation);
                return false;
            }
            let (steps, stamp) = (self.steps_of(slot), self.stamp_of(slot));
            let stood = self.distrusted.standing.entry(charge.incarnation).or_insert((steps, stamp));
            // One that is not let run for three ticks again and again stands still at each look of the device, and yet goes on.
            if stood.1 != stamp {
                *stood = (steps, stamp);
            }
            return steps.saturating_sub(stood.0) >= STILL_STEPS;
        }
        charge.is(Distrust::Invalid) || charge.is(Distrust::Frozen) || charge.is(Distrust::Still)
    }

    /// Whether one that is alone in its role does nobody's work, because who reads it refuses what it says.
    fn serves_nobody(&mut self, slot: Slot, charge: &Charge) -> bool {
        if !matches!(slot.role(), Role::Tissue | Role::Fluid) {
            return false;
        }
        let used_ticks = self.used_ticks(slot.role());
        self.distrusted.alone.hear(charge, used_ticks)
    }

    /// How old is what the device uses of a role, ticks; 0 if that is not known.
    fn used_ticks(&mut self, role: Role) -> u64 {
        let page = self.viewer.slot_page(Slot::first(Role::Device));
        let newest = page.and_then(|page| page.ring(device::INPUTS, page.ring_end(device::INPUTS).checked_sub(1)?));
        newest.map_or(0, |input| {
            let used = if role == Role::Fluid { input.medium_tick } else { input.model.state_tick };
            input.tick.saturating_sub(used)
        })
    }

    /// The stamp of a servo's newest force.
    fn stamp_of(&mut self, slot: Slot) -> u64 {
        let force = self.viewer.slot_page(slot).and_then(|page| page.cell(haptic::FORCE));
        force.map_or(0, |(_, force)| force.tick)
    }

    /// Whether somebody else does the work: the servo that the device follows, a warm spare, the coordinator of the workers, or the hardware's
    /// own ramp. One that is itself about to be ended for what it said does nobody's work, although it may live on for a while.
    fn is_covered(&mut self, slot: Slot, by: Slot) -> bool {
        match slot.role() {
            Role::Device => by.role() == Role::Hardware,
            Role::CollisionWorker => by.role() == Role::Tissue,
            Role::Haptic => {
                let page = self.viewer.slot_page(Slot::first(Role::Device));
                let followed = page.map_or(0, |page| page.load64(device::SELECTED_INCARNATION) as u32);
                followed != 0 && followed != self.viewer.page().incarnation(slot) && !self.distrusted.heeded.contains(&followed)
            }
            Role::Tissue | Role::Fluid => {
                let others = (0..slot.role().slots().1).filter_map(|index| Slot::new(slot.role(), index));
                let mut others = others.filter(|other| *other != slot && !other.is_guest());
                others.any(|other| {
                    !self.distrusted.heeded.contains(&self.viewer.page().incarnation(other)) && self.viewer.is_well(other)
                })
            }
            _ => false,
        }
    }
}
