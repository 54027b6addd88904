//! The Site Manager: what takes part in the simulation. Objects register and get a number and their place in the common arrays; engines
//! register through the backplane (their slot in the station page) when the usher brings their ports, and the Main Loop takes a port only
//! from the life of an engine that is registered.

use hyst_messages::stream::ObjectRecord;
use hyst_messages::{SLOTS, Slot};

/// Most objects of a scene, free pieces included.
pub const MAX_OBJECTS: usize = 256;

/// What an object is, as the topology message says it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum ObjectKind {
    /// It stays.
    Organ = 0,
    /// It is to be removed.
    Pathology = 1,
    /// An instrument.
    Tool = 3,
}

/// Sizes of an object that registers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Extent {
    /// Nodes.
    pub nodes: usize,
    /// Tets.
    pub tets: usize,
    /// Vertices of the surface for the eye.
    pub vertices: usize,
    /// Triangles of the surface for the eye.
    pub triangles: usize,
}

/// The register.
#[derive(Debug, Default)]
pub struct SiteManager {
    objects: Vec<ObjectRecord>,
    /// Incarnation that is registered for each slot, 0 if none is.
    engines: [u32; SLOTS],
    version: u32,
}

impl SiteManager {
    /// Registers an object behind those that are there; `None` if the scene is full.
    pub fn register_object(&mut self, name: &str, kind: ObjectKind, extent: Extent) -> Option<u32> {
        if self.objects.len() >= MAX_OBJECTS {
            return None;
        }
        let end = |pair: fn(&ObjectRecord) -> [u32; 2]| self.objects.last().map_or(0, |last| pair(last)[0] + pair(last)[1]);
        let mut label = [0u8; 32];
        let bytes = name.as_bytes();
        let length = bytes.len().min(31);
        label[..length].copy_from_slice(&bytes[..length]);
        let id = self.objects.len() as u32;
        let record = ObjectRecord {
            name: label,
            kind: kind as u32,
            id,
            nodes: [end(|o| o.nodes), extent.nodes as u32],
            tets: [end(|o| o.tets), extent.tets as u32],
            vertices: [end(|o| o.vertices), extent.vertices as u32],
            triangles: [end(|o| o.triangles), extent.triangles as u32],
        };
        self.objects.push(record);
        self.version += 1;
        Some(id)
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

    /// All objects, in order of registration.
    pub fn objects(&self) -> &[ObjectRecord] {
        &self.objects
    }

    /// Grows with each object that comes or goes.
    pub fn version(&self) -> u32 {
        self.version
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::Role;

    #[test]
    fn objects_lie_one_behind_the_other_and_a_full_scene_says_so() {
        let mut site = SiteManager::default();
        let extent = Extent { nodes: 10, tets: 20, vertices: 30, triangles: 40 };
        assert_eq!(site.register_object("uterus", ObjectKind::Organ, extent), Some(0));
        assert_eq!(site.register_object("polyp", ObjectKind::Pathology, extent), Some(1));
        let polyp = site.objects()[1];
        assert_eq!((polyp.nodes, polyp.tets, polyp.vertices, polyp.triangles), ([10, 10], [20, 20], [30, 30], [40, 40]));
        for _ in 2..MAX_OBJECTS {
            assert!(site.register_object("piece", ObjectKind::Pathology, extent).is_some());
        }
        assert_eq!(site.register_object("one too many", ObjectKind::Pathology, extent), None);
        assert_eq!(site.version() as usize, MAX_OBJECTS);
    }

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
