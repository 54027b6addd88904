//! The Site Manager: what takes part in the simulation. Objects register and get a number and their place in the common arrays; engines
//! register through the backplane (their slot in the station page) when the usher brings their ports, and the Main Loop takes a port only
//! from the life of an engine that is registered.

use hyst_messages::stream::{ObjectKind, ObjectRecord};
use hyst_messages::{SLOTS, Slot};

/// Most objects of a scene, free pieces included.
pub const MAX_OBJECTS: usize = 256;

/// The register.
#[derive(Debug, Default)]
pub struct SiteManager {
    objects: Vec<ObjectRecord>,
    /// Incarnation that is registered for each slot, 0 if none is.
    engines: [u32; SLOTS],
}

/// An object that registers behind those that are there: its place in the common arrays is not known yet.
pub fn object(name: &str, kind: ObjectKind, id: u32) -> ObjectRecord {
    let mut label = [0u8; 32];
    let bytes = name.as_bytes();
    let length = bytes.len().min(31);
    label[..length].copy_from_slice(&bytes[..length]);
    ObjectRecord { name: label, kind: kind as u32, id, ..ObjectRecord::default() }
}

impl SiteManager {
    /// Registers the objects as they are now: those of the scene, what has come free of them, the instruments.
    pub fn register_objects(&mut self, objects: &[ObjectRecord]) {
        self.objects.clear();
        self.objects.extend_from_slice(objects);
    }

    /// Registers an engine, or its successor in the same slot; false if a later life of the engine is registered already, so that what this one
    /// brings is not to be used. Lives are numbered in the order of their starts.
    pub fn register_engine(&mut self, slot: Slot, incarnation: u32) -> bool {
        let entry = &mut self.engines[slot.number()];
        let is_current = incarnation >= *entry;
        *entry = incarnation.max(*entry);
        is_current
    }

    /// The engines that are registered, a bit for each slot.
    pub fn engines(&self) -> u32 {
        let bit = |(number, incarnation): (usize, &u32)| u32::from(*incarnation != 0) << number;
        self.engines.iter().enumerate().map(bit).sum()
    }

    /// How many objects there are: what has left through the outflow keeps its number and is none any more.
    pub fn present(&self) -> u32 {
        let has_left = |object: &&ObjectRecord| object.is_free_piece() && object.tets[1] == 0;
        self.objects.iter().filter(|object| !has_left(object)).count() as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::Role;

    #[test]
    fn a_successor_takes_its_predecessors_entry_and_a_predecessor_is_refused() {
        let mut site = SiteManager::default();
        let (device, fluid) = (Slot::first(Role::Device), Slot::first(Role::Fluid));
        assert!(site.register_engine(fluid, 7) && site.register_engine(fluid, 7), "an engine brings several ports");
        assert!(site.register_engine(fluid, 9));
        assert!(!site.register_engine(fluid, 7), "its predecessor comes too late");
        assert!(site.register_engine(device, 2), "another slot");
        assert_eq!(site.engines(), 1 << device.number() | 1 << fluid.number());
    }
}
