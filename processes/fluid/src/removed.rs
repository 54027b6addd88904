//! How much of the scene's tissue is gone: burnt by the loop, washed out or taken out. It leaves room in the cavity, which the medium fills.
//!
//! What is gone is what the topology's shape at rest lacks of the scene's. Promise: the same topology lacks the same, whoever looks; a piece that floats is not
//! gone, and nothing is where a topology does not say its shape at rest.

use crate::afford::tissue_at_rest;
use glam::Vec3;
use hyst_messages::Message;
use hyst_scene::LoadedScene;

/// Tets and places of the nodes at rest in a topology.
const TETS: usize = 1;
const REST: usize = 7;

/// What is gone in the tissue's newest topology.
pub struct Removed {
    whole_ml: f64,
    version: Option<u32>,
    gone_ml: f32,
}

impl Removed {
    /// Nothing yet of a scene's tissue.
    pub fn new(scene: &LoadedScene) -> Removed {
        let (positions_m, tets) = tissue_at_rest(scene);
        Removed { whole_ml: volume_ml(&positions_m, &tets), version: None, gone_ml: 0.0 }
    }

    /// Takes a topology, if it is another one than that before.
    pub fn take(&mut self, topology: &Message<'_>) {
        let version = topology.header().topology_version;
        if self.version == Some(version) {
            return;
        }
        let left_ml = match (topology.section(REST), topology.section(TETS)) {
            (Ok(rest_m), Ok(tets)) => volume_ml(rest_m, tets),
            _ => self.whole_ml,
        };
        self.gone_ml = (self.whole_ml - left_ml).clamp(0.0, self.whole_ml) as f32;
        self.version = Some(version);
    }

    /// How much is gone, ml.
    pub fn gone_ml(&self) -> f32 {
        self.gone_ml
    }
}

/// Volume of tets, of those that have all their nodes.
fn volume_ml(places_m: &[[f32; 3]], tets: &[[u32; 4]]) -> f64 {
    let place = |node: u32| places_m.get(node as usize).map(|place_m| Vec3::from(*place_m).as_dvec3());
    let six_m3 = |tet: &[u32; 4]| {
        let [a, b, c, d] = tet.map(place);
        let a = a?;
        Some((b? - a).cross(c? - a).dot(d? - a).abs())
    };
    tets.iter().filter_map(six_m3).sum::<f64>() * 1e6 / 6.0
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use hyst_messages::stream::message_bytes;
    use hyst_messages::{Kind, MessageMut, StreamHeader};

    /// Takes a topology of a version, of tets and, if they are said, places at rest; says how much is gone then, ml.
    pub fn gone_ml(removed: &mut Removed, version: u32, tets: &[[u32; 4]], rest_m: Option<&[[f32; 3]]>) -> f32 {
        let none: &[u8] = &[];
        let mut parts = vec![none; TETS];
        parts.push(bytemuck::cast_slice(tets));
        if let Some(rest_m) = rest_m {
            parts.resize(REST, none);
            parts.push(bytemuck::cast_slice(rest_m));
        }
        let lengths: Vec<usize> = parts.iter().map(|part| part.len()).collect();
        let mut block = vec![0u64; message_bytes(&lengths).div_ceil(8)];
        let header = StreamHeader { topology_version: version, ..StreamHeader::default() };
        let message = MessageMut::format(bytemuck::cast_slice_mut(&mut block), Kind::Topology, header, &lengths).unwrap();
        for (place, part) in message.split().into_iter().zip(parts) {
            place.copy_from_slice(part);
        }
        removed.take(&Message::parse(bytemuck::cast_slice(&block), Kind::Topology).unwrap());
        removed.gone_ml()
    }

    #[test]
    fn what_the_topology_lacks_of_the_scenes_tissue_is_gone() {
        let scene = hyst_scene::load_embedded().unwrap();
        let mut removed = Removed::new(&scene);
        let (rest_m, mut tets) = tissue_at_rest(&scene);
        assert_eq!(removed.gone_ml(), 0.0);
        assert_eq!(gone_ml(&mut removed, 7, &tets, Some(&rest_m[..])), 0.0);
        // The last object of the scene is its polyp: the mesh has 0.34786 ml.
        let own = scene.objects.last().unwrap().mesh.tets.len();
        tets.truncate(tets.len() - own);
        assert_eq!(gone_ml(&mut removed, 7, &tets, Some(&rest_m[..])), 0.0, "the version is looked at, and nothing else");
        let gone = gone_ml(&mut removed, 8, &tets, Some(&rest_m[..]));
        assert!((gone - 0.347_86).abs() < 1e-3, "{gone} ml");
        assert_eq!(gone_ml(&mut removed, 9, &tets, None), 0.0, "nobody knows");
        // More than there was is no less of it.
        let twice = [tissue_at_rest(&scene).1, tets].concat();
        assert_eq!(gone_ml(&mut removed, 10, &twice, Some(&rest_m[..])), 0.0);
    }

    #[test]
    fn volumes_are_those_by_hand_and_a_tet_without_its_nodes_has_none() {
        // A corner of a cube of 10 mm is a sixth of a millilitre.
        let rest_m = [[0.0; 3], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]];
        let found = volume_ml(&rest_m, &[[0, 1, 2, 3], [1, 0, 2, 3], [0, 1, 2, 9]]);
        assert!((found - 1.0 / 3.0).abs() < 1e-6, "{found} ml");
    }
}
