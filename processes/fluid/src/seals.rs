//! Contact coagulation: a loop under the current that coagulates shrinks and seals the vessels that it touches. It cuts nothing; a vessel that was
//! touched long enough neither bleeds nor takes medium in, until a later cut opens it anew.
//!
//! What is sealed, and how far, is a section of the fluid's state: whoever goes on from a state has all of it. Promise: the same state, tissue and hand
//! seal the same vessels, whoever computes it; no more than [`MAX_SEALS`], and a vessel that finds no place stays open.

use crate::wounds::Vessel;
use glam::{IVec3, Vec3};
use hyst_flow::Capsule;
use hyst_messages::{MAX_SEALS, Message, SealRecord, WireError};

/// Section of a fluid state that they are in.
pub const SECTION: usize = 4;
/// For so long the loop has to touch a vessel under current until that is shut, s. Assumed: about a second in the hand of a surgeon, whatever the calibre.
const SEAL_S: f32 = 0.8;
/// A vessel is touched if its mouth, the middle of the wound in its cube, is no farther from the wire's surface than this, m. Assumed: the wire lies on a wound
/// that is not flat, and the heat reaches somewhat farther than the contact.
const REACH_M: f32 = 1.5e-3;
/// What a later cut changes of the wound that had opened a vessel at least, where it opens it anew: it makes that larger by so much, m², or moves its middle by
/// so much, m. A stroke of the loop sweeps 0.5 mm at a time.
const ANEW_M2: f32 = 5e-7;
const ANEW_M: f32 = 5e-4;

/// The vessels that are coagulated, in the order in which the loop first touched them.
#[derive(Debug)]
pub struct Seals {
    records: Vec<SealRecord>,
}

/// Those of a state; none of a fluid that knows of none.
fn records<'a>(message: &Message<'a>) -> Result<&'a [SealRecord], WireError> {
    if message.header().sections as usize <= SECTION { Ok(&[]) } else { message.section(SECTION) }
}

/// Whether a state's numbers of them can be.
pub fn are_sane(message: &Message<'_>) -> bool {
    let can_be = |seal: &SealRecord| {
        (0.0..=1.0).contains(&seal.share) && seal.area_m2.is_finite() && seal.rest_m.iter().all(|value| value.is_finite())
    };
    records(message).is_ok_and(|records| records.len() <= MAX_SEALS && records.iter().all(can_be))
}

impl Seals {
    /// None.
    pub fn new() -> Seals {
        Seals { records: Vec::with_capacity(MAX_SEALS) }
    }

    /// Takes those of a state.
    ///
    /// # Errors
    /// Their section is not what it should be.
    pub fn load(&mut self, message: &Message<'_>) -> Result<(), WireError> {
        self.take(records(message)?);
        Ok(())
    }

    fn take(&mut self, records: &[SealRecord]) {
        self.clear();
        self.records.extend(records.iter().filter(|seal| seal.share > 0.0).take(MAX_SEALS));
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        self.records.clear();
    }

    /// Writes them into their section of a state, all of it.
    pub fn store(&self, section: &mut [u8]) {
        let bytes: &[u8] = bytemuck::cast_slice(&self.records);
        let length = bytes.len().min(section.len());
        section[..length].copy_from_slice(&bytes[..length]);
        section[length..].fill(0);
    }

    /// Forgets those that have been cut anew, and those whose wound is gone.
    pub fn settle(&mut self, vessels: &[Vessel]) {
        self.records.retain(|seal| vessels.iter().any(|vessel| is_as_it_was(seal, vessel)));
    }

    /// Coagulates what the wires of the loop touch for so long, s.
    pub fn touch(&mut self, vessels: &[Vessel], wires: &[Capsule], dt_s: f32) {
        for vessel in vessels {
            let mouth_m = Vec3::from(vessel.mouth.position_m);
            if !wires.iter().any(|wire| wire.radius_m > 0.0 && clearance_m(wire, mouth_m) <= REACH_M) {
                continue;
            }
            if let Some(seal) = self.seal_of(vessel) {
                seal.share = (seal.share + dt_s / SEAL_S).min(1.0);
            }
        }
    }

    /// The record of a vessel, a new one if there is none and room for it.
    fn seal_of(&mut self, vessel: &Vessel) -> Option<&mut SealRecord> {
        let known = self.records.iter().position(|seal| IVec3::from(seal.cube) == vessel.cube);
        let index = known.unwrap_or(self.records.len());
        if known.is_none() && index < MAX_SEALS {
            let (cube, rest_m) = (vessel.cube.to_array(), vessel.rest_m.to_array());
            self.records.push(SealRecord { cube, share: 0.0, rest_m, area_m2: vessel.area_m2 });
        }
        self.records.get_mut(index)
    }

    /// How far the vessel of a cube is shut, 0 to 1.
    pub fn share(&self, cube: IVec3) -> f32 {
        self.records.iter().find(|seal| IVec3::from(seal.cube) == cube).map_or(0.0, |seal| seal.share)
    }

    /// How many are shut.
    pub fn sealed(&self) -> u32 {
        self.records.iter().filter(|seal| seal.share >= 1.0).count() as u32
    }
}

/// Whether the wound of a vessel is the one that the loop has touched.
fn is_as_it_was(seal: &SealRecord, vessel: &Vessel) -> bool {
    IVec3::from(seal.cube) == vessel.cube
        && vessel.area_m2 - seal.area_m2 <= ANEW_M2
        && vessel.rest_m.distance(Vec3::from(seal.rest_m)) <= ANEW_M
}

/// From the surface of a wire to a point, m; negative within it.
fn clearance_m(wire: &Capsule, point_m: Vec3) -> f32 {
    let (a, b) = (Vec3::from(wire.a_m), Vec3::from(wire.b_m));
    let along = b - a;
    let share = ((point_m - a).dot(along) / along.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    point_m.distance(a + share * along) - wire.radius_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_flow::BloodSource;
    use hyst_messages::stream::message_bytes;
    use hyst_messages::{Kind, MessageMut, StreamHeader};

    /// Length of a step of the flow, s.
    const STEP_S: f32 = 0.033;

    /// Vessels 10 mm apart along x, the wound of each 2 mm² large.
    fn vessels(count: i32) -> Vec<Vessel> {
        let vessel = |index: i32| {
            let place = Vec3::new(0.01 * index as f32, 0.0, 0.0);
            let mouth = BloodSource { position_m: (place + Vec3::Y * 0.002).to_array(), opening: 0.5 };
            Vessel { cube: IVec3::new(index, 0, -1), rest_m: place, area_m2: 2e-6, mouth }
        };
        (0..count).map(vessel).collect()
    }

    /// A wire of 0.2 mm along z, so far above the mouth of a vessel, m.
    fn wire(index: i32, above_m: f32) -> Capsule {
        let [x, y] = [0.01 * index as f32, 0.002 + above_m];
        Capsule { a_m: [x, y, -0.004], b_m: [x, y, 0.004], radius_m: 1e-4, ..Capsule::default() }
    }

    fn touched(vessels: &[Vessel], wires: &[Capsule], time_s: f32) -> Seals {
        let mut seals = Seals::new();
        (0..(time_s / STEP_S).round() as u32).for_each(|_| seals.touch(vessels, wires, STEP_S));
        seals
    }

    #[test]
    fn a_vessel_is_shut_in_time_by_the_loop_that_touches_it_and_no_other_one_is() {
        let vessels = vessels(3);
        let half = touched(&vessels, &[wire(1, 0.0)], 0.5 * SEAL_S);
        assert!((half.share(vessels[1].cube) - 0.5).abs() < 0.05 && half.sealed() == 0, "{half:?}");
        let whole = touched(&vessels, &[wire(1, 0.001)], SEAL_S + STEP_S);
        assert_eq!((whole.share(vessels[1].cube), whole.sealed()), (1.0, 1), "{whole:?}");
        assert_eq!([0, 2].map(|other| whole.share(vessels[other].cube)), [0.0; 2]);
    }

    #[test]
    fn a_loop_that_is_away_or_in_its_sheath_shuts_nothing() {
        let vessels = vessels(1);
        let gap_m = REACH_M + wire(0, 0.0).radius_m;
        assert_eq!(touched(&vessels, &[wire(0, gap_m + 1e-5)], 5.0).sealed(), 0);
        assert_eq!(touched(&vessels, &[wire(0, gap_m - 1e-5)], 5.0).sealed(), 1);
        assert_eq!(touched(&vessels, &[Capsule { radius_m: 0.0, ..wire(0, 0.0) }], 5.0).sealed(), 0, "no wire is out");
        let nowhere = Capsule { a_m: [f32::NAN; 3], ..wire(0, 0.0) };
        assert_eq!(touched(&vessels, &[nowhere], 5.0).sealed(), 0);
    }

    #[test]
    fn what_is_sealed_stays_so_until_a_cut_changes_its_wound() {
        let before = vessels(2);
        let settled = |change: fn(&mut Vessel)| {
            let mut seals = touched(&before, &[wire(0, 0.0), wire(1, 0.0)], 1.0);
            let mut after = before.clone();
            change(&mut after[0]);
            seals.settle(&after);
            [0, 1].map(|index| seals.share(before[index].cube))
        };
        assert_eq!(settled(|_| {}), [1.0; 2]);
        // The tissue moves, and a mesh that is divided anew has the same wound but for its rounding.
        let moves: fn(&mut Vessel) = |vessel| {
            vessel.mouth.position_m[0] += 0.005;
            vessel.area_m2 *= 1.000_1;
        };
        assert_eq!(settled(moves), [1.0; 2]);
        assert_eq!(settled(|vessel| vessel.area_m2 += 1e-6), [0.0, 1.0], "a larger wound");
        assert_eq!(settled(|vessel| vessel.rest_m.z += 6e-4), [0.0, 1.0], "a deeper one");
        assert_eq!(settled(|vessel| vessel.cube.x = 9), [0.0, 1.0], "there is none any more");
    }

    #[test]
    fn they_go_through_a_state_and_a_state_of_a_fluid_that_knows_of_none_has_none() {
        let vessels = vessels(2 * MAX_SEALS as i32);
        let wires: Vec<Capsule> = (0..vessels.len() as i32).map(|index| wire(index, 0.0)).collect();
        let full = touched(&vessels, &wires, 1.0);
        assert_eq!(full.sealed() as usize, MAX_SEALS, "no more than there is room for");
        let written = |seals: Option<&Seals>| {
            let lengths = [0, 0, 0, 0, MAX_SEALS * size_of::<SealRecord>()];
            let lengths = &lengths[..if seals.is_some() { SECTION + 1 } else { SECTION }];
            let mut words = vec![u64::MAX; message_bytes(lengths).div_ceil(8)];
            let bytes = bytemuck::cast_slice_mut(&mut words);
            let parts = MessageMut::format(bytes, Kind::FluidState, StreamHeader::default(), lengths).unwrap().split();
            let [_, _, _, _, section, ..] = parts;
            if let Some(seals) = seals {
                seals.store(section);
            }
            words
        };
        for seals in [full, touched(&vessels, &wires[3..5], 0.5), Seals::new()] {
            let words = written(Some(&seals));
            let message = Message::parse(bytemuck::cast_slice(&words), Kind::FluidState).unwrap();
            let mut again = Seals::new();
            again.load(&message).unwrap();
            assert!(are_sane(&message) && again.records == seals.records, "{again:?}");
        }
        let words = written(None);
        let message = Message::parse(bytemuck::cast_slice(&words), Kind::FluidState).unwrap();
        let mut none = touched(&vessels, &wires[..1], 1.0);
        none.load(&message).unwrap();
        assert!(are_sane(&message) && none.records.is_empty());
    }
}
