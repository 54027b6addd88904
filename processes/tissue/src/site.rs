//! The Site Manager: what takes part in the simulation. Objects register and get a number and their place in the common arrays; engines
//! register through the backplane (their slot in the station page) when the usher brings their ports.

use hyst_messages::Slot;
use hyst_messages::stream::ObjectRecord;

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
    engines: Vec<(Slot, u32)>,
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

    /// Registers an engine, or its successor in the same slot.
    pub fn register_engine(&mut self, slot: Slot, incarnation: u32) {
        if let Some(entry) = self.engines.iter_mut().find(|(known, _)| *known == slot) {
            entry.1 = incarnation;
        } else if self.engines.len() < self.engines.capacity() {
            self.engines.push((slot, incarnation));
        }
    }

    /// Room for the engines of a station, so that registering one allocates nothing.
    pub fn reserve_engines(&mut self, count: usize) {
        self.engines.reserve(count);
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
    fn a_successor_takes_its_predecessors_entry() {
        let mut site = SiteManager::default();
        site.reserve_engines(4);
        let slot = Slot::first(Role::Fluid);
        site.register_engine(slot, 7);
        site.register_engine(slot, 9);
        assert_eq!(site.engines, vec![(slot, 9)]);
    }
}
