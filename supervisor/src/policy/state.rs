//! What the policy remembers: of each slot, of each role with a state, of a swap that is under way.

use super::ladder::Ladder;
use super::limits::limits;
use super::swap::Swap;
use hyst_messages::{Role, Slot};
use std::collections::{BTreeMap, VecDeque};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Life {
    Vacant {
        due_ns: u64,
    },
    Spawning,
    Alive {
        incarnation: u32,
        ready_ns: Option<u64>,
    },
    /// Tried again at this time, ns.
    GivenUp {
        again_ns: u64,
    },
    /// A guest's slot without a guest.
    Closed,
}

#[derive(Clone, Debug)]
pub(super) struct Place {
    pub(super) life: Life,
    /// An incarnation of it was ready before: the scene and the settings were good.
    pub(super) was_ready: bool,
    pub(super) short_lives: u32,
    pub(super) deaths_ns: VecDeque<u64>,
    /// The incarnation that hung and was killed for it, and when it had beaten last, ns.
    pub(super) hung: (u32, u64),
    /// The incarnation whose work may be used: one that is ready, and a servo only after it has left its shadow.
    pub(super) serves: u32,
    /// The incarnation that is killed, and whose death is awaited.
    pub(super) killed: u32,
    /// Those whose streams it reads were mistrusted in this row of short lives.
    pub(super) mistrusted: bool,
    /// The incarnation whose readers died again and again.
    pub(super) harmful: u32,
    /// The incarnation that is to be replaced, since when, and whether it was told.
    pub(super) leaving: Option<(u32, u64, bool)>,
    /// One that did its role's work is to be replaced, or was, until somebody is ready here again, of a servo out of its shadow.
    pub(super) hands_over: bool,
}

/// What the policy remembers.
#[derive(Clone, Debug)]
pub struct State {
    pub(super) places: BTreeMap<Slot, Place>,
    pub(super) ladders: BTreeMap<Role, Ladder>,
    pub(super) swap: Option<Swap>,
    pub(super) stopping: bool,
}

impl State {
    /// The slots that must be occupied. Each role with a state has a guest's slot beside, which is closed but for a swap.
    pub fn new(slots: &[Slot]) -> State {
        let life = Life::Vacant { due_ns: 0 };
        let vacant = Place {
            life,
            was_ready: false,
            short_lives: 0,
            deaths_ns: VecDeque::new(),
            hung: (0, 0),
            serves: 0,
            killed: 0,
            mistrusted: false,
            harmful: 0,
            leaving: None,
            hands_over: false,
        };
        let ladders = slots.iter().filter(|slot| slot.role().is_stateful()).map(|slot| (slot.role(), Ladder::default()));
        let ladders: BTreeMap<Role, Ladder> = ladders.collect();
        let guests = ladders.keys().filter_map(|role| Slot::guest(*role));
        let closed = guests.map(|slot| (slot, Place { life: Life::Closed, ..vacant.clone() }));
        let places = slots.iter().map(|slot| (*slot, vacant.clone())).chain(closed).collect();
        State { places, ladders, swap: None, stopping: false }
    }
    /// Whether a stop was asked for.
    pub fn is_stopping(&self) -> bool {
        self.stopping
    }
    /// Slots that were given up.
    pub fn given_up(&self) -> impl Iterator<Item = Slot> + '_ {
        self.places.iter().filter(|(_, place)| matches!(place.life, Life::GivenUp { .. })).map(|(slot, _)| *slot)
    }
    /// Whether a slot was given up.
    pub fn is_given_up(&self, slot: Slot) -> bool {
        self.places.get(&slot).is_some_and(|place| matches!(place.life, Life::GivenUp { .. }))
    }
    /// Where a role stands on its ladder, for a supervisor that is restarted.
    pub fn set_ladder(&mut self, role: Role, to: Ladder) {
        if let Some(ladder) = self.ladders.get_mut(&role) {
            *ladder = to;
        }
    }
    /// Where each role stands on its ladder, for the supervisor after this one.
    pub fn ladders(&self) -> impl Iterator<Item = (Role, u32)> + '_ {
        self.ladders.iter().map(|(role, ladder)| (*role, ladder.word()))
    }
    /// Roles that are held still.
    pub fn held(&self) -> impl Iterator<Item = Role> + '_ {
        self.ladders.iter().filter(|(_, ladder)| ladder.is_held()).map(|(role, _)| *role)
    }
    /// Whether any incarnation is alive or being spawned.
    pub fn anyone_alive(&self) -> bool {
        self.places.values().any(|place| matches!(place.life, Life::Alive { .. } | Life::Spawning))
    }
    /// Whether an incarnation is known to hang, so that its end is its own doing.
    pub fn hangs(&self, slot: Slot, incarnation: u32) -> bool {
        self.places.get(&slot).is_some_and(|place| place.hung.0 == incarnation)
    }
    /// Whether the slot has an incarnation that is ready.
    pub fn is_ready(&self, slot: Slot) -> bool {
        self.ready(slot).is_some()
    }
    /// The incarnation in a slot that is ready.
    pub fn ready(&self, slot: Slot) -> Option<u32> {
        match self.places.get(&slot)?.life {
            Life::Alive { incarnation, ready_ns: Some(_) } => Some(incarnation),
            _ => None,
        }
    }
    /// The incarnation in a slot that is ready, and stays: one that was killed does nobody's work, however long the kernel keeps it.
    pub(super) fn staying(&self, slot: Slot) -> Option<u32> {
        let killed = self.places.get(&slot)?.killed;
        self.ready(slot).filter(|incarnation| killed != *incarnation)
    }
    /// The same, if it does its work.
    pub(super) fn lasting(&self, slot: Slot) -> Option<u32> {
        let serves = self.places.get(&slot)?.serves;
        self.staying(slot).filter(|incarnation| serves == *incarnation)
    }
    /// Whether those who read what an incarnation writes die of it, and its own spare as often as they: to wait for that one is in vain.
    pub(super) fn ends_its_spare(&self, slot: Slot, incarnation: u32) -> bool {
        let harms = self.places.get(&slot).is_some_and(|place| place.harmful == incarnation);
        let spare = self.sibling(slot).and_then(|sibling| self.places.get(&sibling));
        harms && spare.is_some_and(|spare| spare.short_lives >= limits(slot.role()).mistrust_after())
    }
    /// The other slot of a role with a spare, if this station has it.
    pub(super) fn sibling(&self, slot: Slot) -> Option<Slot> {
        let of_two = slot.role().is_replicated() && !slot.is_guest();
        let other = Slot::new(slot.role(), 1 - slot.index().min(1)).filter(|_| of_two)?;
        self.places.contains_key(&other).then_some(other)
    }
}
