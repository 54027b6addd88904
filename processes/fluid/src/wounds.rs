//! What the electrode has laid open. The tissue is crossed by vessels, one in each cube of its shape at rest, of a calibre that is drawn by the cube's
//! place; where a wound reaches into a cube its vessel is open, the more the larger the wound there. Below their pressure open vessels bleed, and
//! above that of the veins they take medium in, but for those that are coagulated ([`crate::seals`]).
//!
//! Promise: the same topology opens the same vessels, whoever computes it; what floats does not bleed, for nothing supplies it.

use glam::{IVec3, Vec3};
use hyst_flow::{BloodSource, MAX_SOURCES, MOST_OPENING};
use hyst_messages::stream::ObjectRecord;
use hyst_messages::{Message, WireError};
use hyst_scene::Vessels;

/// Share of a cube's face that a wound in it must have for its vessel to be open as far as it can be.
const FULL_SHARE: f32 = 0.5;
/// Open vessels of the widest calibre that take in as much medium as the pump's model lets veins take.
const ALL_VEINS: f32 = 16.0;

/// A triangle of a wound.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Face {
    cube: IVec3,
    corners: [u32; 3],
    area_m2: f32,
    /// Its middle at rest, m.
    rest_m: Vec3,
}

/// A vessel that a wound has opened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vessel {
    /// Its cube.
    pub cube: IVec3,
    /// Middle of the wound in the cube at rest, m.
    pub rest_m: Vec3,
    /// Area of the wound in the cube at rest, m².
    pub area_m2: f32,
    /// Where the middle of the wound is now, and how far the vessel is open if nothing has shut it.
    pub mouth: BloodSource,
}

/// The wounds in the tissue's newest state.
pub struct Wounds {
    spacing_m: f32,
    seed: u64,
    version: Option<u32>,
    /// By ascending cube.
    faces: Vec<Face>,
    /// By ascending cube.
    vessels: Vec<Vessel>,
    /// What of them is not shut, the widest first.
    open: Vec<BloodSource>,
}

impl Wounds {
    /// None yet.
    pub fn new(vessels: &Vessels) -> Wounds {
        let (spacing_m, seed) = (vessels.spacing_m as f32, vessels.seed);
        Wounds { spacing_m, seed, version: None, faces: Vec::new(), vessels: Vec::new(), open: Vec::new() }
    }

    /// Takes a topology, if it is another one than that before.
    pub fn take(&mut self, topology: &Message<'_>) -> Result<(), WireError> {
        let version = topology.header().topology_version;
        if self.version == Some(version) {
            return Ok(());
        }
        let objects: &[ObjectRecord] = topology.section(0)?;
        self.find(objects, topology.section(3)?, topology.section(4)?, topology.section(6)?);
        self.version = Some(version);
        Ok(())
    }

    /// Finds the triangles whose three corners lie on a wound of what is held.
    fn find(&mut self, objects: &[ObjectRecord], triangles: &[[u32; 3]], rest_m: &[[f32; 3]], is_raw: &[u32]) {
        self.faces.clear();
        for object in objects.iter().filter(|object| !object.is_free_piece()) {
            let [first, count] = object.triangles.map(|number| number as usize);
            let own = triangles.get(first..first.saturating_add(count)).unwrap_or(&[]);
            for corners in own {
                let is_wound = corners.iter().all(|corner| is_raw.get(*corner as usize).is_some_and(|raw| *raw != 0));
                let Some([a, b, c]) = corners_of(rest_m, corners).filter(|_| is_wound) else { continue };
                let cube = ((a + b + c) / (3.0 * self.spacing_m)).floor().as_ivec3();
                let area_m2 = 0.5 * (b - a).cross(c - a).length();
                self.faces.push(Face { cube, corners: *corners, area_m2, rest_m: (a + b + c) / 3.0 });
            }
        }
        self.faces.sort_by_key(|face| (face.cube.to_array(), face.corners));
    }

    /// Finds where the open vessels are in a state, by its surface vertices; none of them is shut.
    pub fn locate(&mut self, surface_m: &[[f32; 3]]) {
        self.vessels.clear();
        let full_m2 = FULL_SHARE * self.spacing_m * self.spacing_m;
        for faces in self.faces.chunk_by(|a, b| a.cube == b.cube) {
            let (mut area_m2, mut moment, mut rest_moment) = (0.0, Vec3::ZERO, Vec3::ZERO);
            for face in faces {
                if let Some([a, b, c]) = corners_of(surface_m, &face.corners) {
                    area_m2 += face.area_m2;
                    moment += face.area_m2 * (a + b + c) / 3.0;
                    rest_moment += face.area_m2 * face.rest_m;
                }
            }
            if area_m2 > 0.0 {
                let cube = faces[0].cube;
                let opening = calibre(self.seed, cube) * (area_m2 / full_m2).min(1.0);
                let mouth = BloodSource { position_m: (moment / area_m2).to_array(), opening };
                self.vessels.push(Vessel { cube, rest_m: rest_moment / area_m2, area_m2, mouth });
            }
        }
        self.shut(|_| 0.0);
    }

    /// The vessels that wounds have opened, shut or not.
    pub fn vessels(&self) -> &[Vessel] {
        &self.vessels
    }

    /// Shuts of the vessel of each cube such a share, 0 to 1.
    pub fn shut(&mut self, share: impl Fn(IVec3) -> f32) {
        let left = |vessel: &Vessel| {
            let opening = vessel.mouth.opening * (1.0 - share(vessel.cube));
            BloodSource { opening, ..vessel.mouth }
        };
        self.open.clear();
        self.open.extend(self.vessels.iter().map(left).filter(|mouth| mouth.opening > 0.0));
        self.open.sort_by(|a, b| b.opening.total_cmp(&a.opening));
    }

    /// How many are open.
    pub fn open_count(&self) -> u32 {
        self.open.len() as u32
    }

    /// Where it bleeds: the widest vessels, each with the openings of those that lie nearest to it and find no place.
    pub fn sources(&self) -> [BloodSource; MAX_SOURCES] {
        let (widest, others) = self.open.split_at(self.open.len().min(MAX_SOURCES));
        let mut sources = [BloodSource::default(); MAX_SOURCES];
        sources[..widest.len()].copy_from_slice(widest);
        for other in others {
            let place = Vec3::from(other.position_m);
            let distance = |source: &BloodSource| Vec3::from(source.position_m).distance_squared(place);
            if let Some(nearest) = sources.iter_mut().min_by(|a, b| distance(a).total_cmp(&distance(b))) {
                nearest.opening = (nearest.opening + other.opening).min(MOST_OPENING);
            }
        }
        sources
    }

    /// How far veins are open, 0 to 1.
    pub fn open_veins(&self) -> f32 {
        (self.open.iter().map(|vessel| vessel.opening).sum::<f32>() / ALL_VEINS).min(1.0)
    }
}

fn corners_of(points_m: &[[f32; 3]], corners: &[u32; 3]) -> Option<[Vec3; 3]> {
    let [a, b, c] = corners.map(|corner| points_m.get(corner as usize).copied().map(Vec3::from));
    Some([a?, b?, c?])
}

/// Calibre of a cube's vessel, 0 to 1: most are narrow (the square of an even draw, by the finalizer of splitmix64, Steele et al. 2014).
fn calibre(seed: u64, cube: IVec3) -> f32 {
    let mut x = seed;
    for place in cube.to_array() {
        x = x.wrapping_add(u64::from(place.cast_unsigned())).wrapping_add(0x9e37_79b9_7f4a_7c15);
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^= x >> 31;
    }
    let even = (x >> 40) as f32 / (1u64 << 24) as f32;
    even * even
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::stream::ObjectKind;

    const SPACING_M: f32 = 0.004;

    fn wounds() -> Wounds {
        Wounds::new(&Vessels { spacing_m: SPACING_M as f64, ..Vessels::default() })
    }

    fn object(kind: ObjectKind, first: u32, count: u32) -> ObjectRecord {
        ObjectRecord { kind: kind as u32, triangles: [first, count], ..ObjectRecord::default() }
    }

    /// A square of two triangles for each corner, edge 4 mm, in the plane z = 1 mm.
    fn squares(corners: &[[f32; 2]]) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let (mut points, mut triangles) = (Vec::new(), Vec::new());
        for [x, y] in corners {
            let first = points.len() as u32;
            points.extend(
                [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]].map(|[u, v]| [x + u * SPACING_M, y + v * SPACING_M, 1e-3]),
            );
            triangles.extend([[first, first + 1, first + 2], [first + 3, first + 2, first + 1]]);
        }
        (points, triangles)
    }

    #[test]
    fn only_a_wound_of_what_is_held_bleeds_and_it_bleeds_where_the_tissue_has_moved_to() {
        let (points, triangles) = squares(&[[0.0, 0.0], [0.008, 0.0], [0.016, 0.0]]);
        let objects = [object(ObjectKind::Organ, 0, 4), object(ObjectKind::FreePiece, 4, 2)];
        let mut wounds = wounds();
        wounds.find(&objects, &triangles, &points, &[0; 12]);
        wounds.locate(&points);
        assert_eq!((wounds.open_veins(), wounds.sources()), (0.0, [BloodSource::default(); MAX_SOURCES]), "whole tissue");
        // The second square and the free piece are wounds; of the first one corner is.
        wounds.find(&objects, &triangles, &points, &[1, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1]);
        let moved: Vec<_> = points.iter().map(|[x, y, z]| [*x, y + 0.01, *z]).collect();
        wounds.locate(&moved);
        let sources = wounds.sources();
        assert_eq!(wounds.open.len(), 1, "{:?}", wounds.open);
        assert!(Vec3::from(sources[0].position_m).distance(Vec3::new(0.010, 0.012, 1e-3)) < 1e-6, "{:?}", sources[0]);
        let full = calibre(1, IVec3::new(2, 0, 0));
        assert!(full > 0.0 && (sources[0].opening - full).abs() < 1e-6, "{} of {full}", sources[0].opening);
        // A quarter of the wound opens it half as far as half of it does.
        let small: Vec<_> = points.iter().map(|[x, y, z]| [0.0085 + (x - 0.008) * 0.5, y * 0.5, *z]).collect();
        wounds.find(&objects[..1], &triangles, &small, &[0, 0, 0, 0, 1, 1, 1, 1, 0, 0, 0, 0]);
        wounds.locate(&small);
        assert!((wounds.sources()[0].opening - 0.5 * full).abs() < 1e-4, "{:?}", wounds.sources()[0]);
    }

    #[test]
    fn a_vessel_that_is_shut_neither_bleeds_nor_takes_medium_in_and_its_place_is_known() {
        let (points, triangles) = squares(&[[0.0, 0.0], [0.012, 0.0]]);
        let mut wounds = wounds();
        wounds.find(&[object(ObjectKind::Organ, 0, 4)], &triangles, &points, &[1; 8]);
        let moved: Vec<_> = points.iter().map(|[x, y, z]| [*x, y + 0.01, *z]).collect();
        wounds.locate(&moved);
        let (all, veins) = (wounds.vessels().to_vec(), wounds.open_veins());
        assert_eq!((all.len(), wounds.open_count()), (2, 2));
        for (vessel, x) in all.iter().zip([0.002, 0.014]) {
            assert!(vessel.rest_m.distance(Vec3::new(x, 0.002, 1e-3)) < 1e-6, "{vessel:?}");
            assert!(Vec3::from(vessel.mouth.position_m).distance(Vec3::new(x, 0.012, 1e-3)) < 1e-6, "{vessel:?}");
            assert!((vessel.area_m2 - SPACING_M * SPACING_M).abs() < 1e-9, "{vessel:?}");
        }
        wounds.shut(|cube| if cube == all[0].cube { 1.0 } else { 0.5 });
        let [first, rest @ ..] = wounds.sources();
        assert_eq!((first.position_m, first.opening), (all[1].mouth.position_m, 0.5 * all[1].mouth.opening));
        assert_eq!((wounds.open_count(), rest), (1, [BloodSource::default(); MAX_SOURCES - 1]));
        assert!((wounds.open_veins() - 0.5 * all[1].mouth.opening / ALL_VEINS).abs() < 1e-6 && wounds.open_veins() < veins);
        wounds.shut(|_| 1.0);
        assert_eq!((wounds.open_veins(), wounds.sources()), (0.0, [BloodSource::default(); MAX_SOURCES]));
        wounds.locate(&moved);
        assert_eq!(wounds.vessels(), all, "nothing is shut for ever here: that is in the state");
    }

    #[test]
    fn a_wide_wound_bleeds_from_all_of_its_vessels() {
        let corners: Vec<[f32; 2]> = (0..400).map(|n| [n % 20, n / 20].map(|at| at as f32 * SPACING_M + 1e-6)).collect();
        let (points, triangles) = squares(&corners);
        let mut wounds = wounds();
        wounds.find(&[object(ObjectKind::Organ, 0, triangles.len() as u32)], &triangles, &points, &vec![1; points.len()]);
        wounds.locate(&points);
        let all: f32 = wounds.open.iter().map(|vessel| vessel.opening).sum();
        let given: f32 = wounds.sources().iter().map(|source| source.opening).sum();
        assert!(wounds.open.len() == 400 && all > 2.0 * MAX_SOURCES as f32, "{} vessels, {all}", wounds.open.len());
        assert!((given / all - 1.0).abs() < 1e-4, "{given} of {all}");
    }

    #[test]
    fn of_many_vessels_none_is_forgotten_and_numbers_of_another_mesh_open_nothing() {
        let corners: Vec<[f32; 2]> = (0..40).map(|n| [n as f32 * SPACING_M + 1e-6, 1e-6]).collect();
        let (points, triangles) = squares(&corners);
        let raw = vec![1; points.len()];
        let objects = [object(ObjectKind::Organ, 0, triangles.len() as u32), object(ObjectKind::Organ, 4_000, u32::MAX)];
        let mut wounds = wounds();
        wounds.find(&objects, &triangles, &points, &raw);
        wounds.locate(&points);
        let all: f32 = wounds.open.iter().map(|vessel| vessel.opening).sum();
        assert_eq!((wounds.open.len(), wounds.open_veins()), (40, (all / ALL_VEINS).min(1.0)));
        let sources = wounds.sources();
        let given = sources.iter().map(|source| source.opening).sum::<f32>();
        assert!((given - all).abs() < 1e-4, "{given} of {all}");
        assert!(sources.iter().all(|source| source.opening > 0.0));
        wounds.locate(&points[..8]);
        assert_eq!(wounds.open.len(), 2);
        wounds.find(&objects, &[[0, 1, 900]], &points, &raw);
        wounds.locate(&points);
        assert_eq!(wounds.open_veins(), 0.0);
    }
}
