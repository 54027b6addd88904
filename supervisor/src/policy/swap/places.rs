//! Whether a swap may begin, and who is in the places of its role.

use super::Swap;
use crate::policy::{Life, State};
use hyst_messages::{Role, Slot};

impl State {
    /// The swap that is under way.
    pub fn swap(&self) -> Option<&Swap> {
        self.swap.as_ref()
    }

    /// Why no swap may begin in this slot now.
    pub fn may_swap(&self, slot: Slot) -> Result<(), String> {
        if self.stopping {
            return Err("the station is stopping".into());
        }
        if let Some(swap) = &self.swap {
            return Err(format!("a swap of {} is under way; wait for its end", swap.role().name()));
        }
        if !self.places.contains_key(&slot) {
            let (name, has_another) = (slot.role().name(), self.places.keys().any(|other| other.role() == slot.role()));
            let alone = format!("this station has one {name}, and that is swapped beside another one; start it with spares");
            return Err(if has_another { alone } else { format!("this station has no {name}") });
        }
        if let Some((guest, _)) = self.lingering(slot.role()) {
            let why = "something in the kernel keeps it, as a disk or a network that does not answer does; wait until it is gone";
            return Err(format!("{guest}, which a swap had brought, was told to go and has not ended: {why}"));
        }
        let of_role = self.places.keys().filter(|other| other.role() == slot.role() && !other.is_guest());
        match of_role.copied().find(|other| !self.is_ready(*other)) {
            Some(other) => Err(format!("{other} is not ready now; wait until it is back")),
            None if self.ladders.get(&slot.role()).is_some_and(|ladder| ladder.is_held()) => {
                Err(format!("{} is held still; wait until it makes steps again", slot.role().name()))
            }
            None => Ok(()),
        }
    }

    /// The guest of a role whose swap is over, if it has not ended: its place, its page and its streams are nobody else's yet.
    pub fn lingering(&self, role: Role) -> Option<(Slot, u32)> {
        let is_over = self.swap.as_ref().is_none_or(|swap| swap.role() != role);
        let guest = Slot::guest(role).filter(|_| is_over)?;
        Some((guest, self.alive(guest)?))
    }

    pub(super) fn alive(&self, slot: Slot) -> Option<u32> {
        match self.places.get(&slot)?.life {
            Life::Alive { incarnation, .. } => Some(incarnation),
            _ => None,
        }
    }

    pub(super) fn holder(&self, role: Role) -> u32 {
        self.ladders.get(&role).map_or(0, |ladder| ladder.holder())
    }

    pub(super) fn set_life(&mut self, slot: Slot, life: Life) {
        if let Some(place) = self.places.get_mut(&slot) {
            place.life = life;
        }
    }

    /// A process of the newcomer's role that is ready, stays, and is not the newcomer; the one that had the role before, if it is among them.
    pub(super) fn elder(&self, newcomer: Slot, first: u32) -> Option<u32> {
        let others = self.places.keys().filter(|slot| slot.role() == newcomer.role() && **slot != newcomer);
        let staying: Vec<u32> = others.filter_map(|slot| self.staying(*slot)).collect();
        staying.iter().copied().find(|incarnation| *incarnation == first).or(staying.first().copied())
    }
}
