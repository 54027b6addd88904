//! Parts of one object that lie behind each other, as the layers of a fold. Which of them a point is in is told by the tet that it was in before, and by the
//! tissue on the way from there.
//!
//! Promise: how far the tissue has moved since then decides nothing, for the tet has moved with it. Where nobody knows, as in flat tets, a point stays in its
//! part.

use crate::tet::TetTest;
use crate::topology::Topology;
use crate::types::Tissue;
use crate::walk::{End, walk};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Bits of the number of an object; those above are of that of a tet.
const OWNER_BITS: u32 = 9;
/// The highest of these numbers, which stands for all from there on.
const LAST_OWNER: u32 = (1 << OWNER_BITS) - 1;

/// An object and one of its tets, by which the part about that is told from others of the object: one word of a state. All zero: object 0, and no tet.
#[repr(transparent)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub struct Part(u32);

impl Part {
    /// Of an object below 511: all others are taken for one. Tets from 8 388 607 on are left out, and then no part is told from another one.
    pub fn of(owner: u32, tet: Option<u32>) -> Part {
        let above = tet.and_then(|tet| tet.checked_add(1)).filter(|above| *above <= u32::MAX >> OWNER_BITS);
        Part(owner.min(LAST_OWNER) | (above.unwrap_or(0) << OWNER_BITS))
    }

    /// The object.
    pub fn owner(self) -> u32 {
        self.0 & LAST_OWNER
    }

    /// The tet, if it is known: one of the mesh that the state has, unless somebody has damaged that.
    pub fn tet(self) -> Option<u32> {
        (self.0 >> OWNER_BITS).checked_sub(1)
    }

    /// Whether it is that of a tet of an object; of another tet it may be only where its own is not known.
    pub fn is_of(self, owner: u32, tet: u32) -> bool {
        self.owner() == owner && self.tet().is_none_or(|known| known == tet)
    }
}

/// How a point that was in a tet has come to another one of the same object, in which it is found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Came {
    /// Within the part that it was in, or back out of that to the side that it came from, or nobody knows.
    Within,
    /// Within that part, of which this tet holds it, with these weights; what it is found in lies in the same place.
    Beside(u32, [f32; 4]),
    /// Through that part, and out of its far side.
    Through,
}

/// Looks along the straight way from the middle of the tet that a point was in, the first one, to where it is now. `out` is the way back out of that part, of
/// any length: a side of the tissue that looks against it is the far one. Tets that have a node in common are of one part.
pub fn came(tissue: &Tissue<'_>, topology: &Topology, [from, to]: [u32; 2], (place_m, out): ([f32; 3], [f32; 3])) -> Came {
    if from == to || touch(tissue, [from, to]) {
        return Came::Within;
    }
    let middle = tissue.corners(from).map(Vec3::from_array).iter().sum::<Vec3>() / 4.0;
    match walk(tissue, topology, |_| Vec3::ZERO, from, (middle, Vec3::from_array(place_m))) {
        Some(End::Out(exit)) if exit.normal.dot(Vec3::from_array(out)) < 0.0 => Came::Through,
        Some(End::Inside(tet)) if !touch(tissue, [tet, to]) => {
            let weights = TetTest::new(&tissue.corners(tet)).and_then(|test| test.weights(place_m));
            weights.map_or(Came::Within, |weights| Came::Beside(tet, weights))
        }
        _ => Came::Within,
    }
}

/// Whether two tets have a node in common.
pub fn touch(tissue: &Tissue<'_>, tets: [u32; 2]) -> bool {
    let [one, other] = tets.map(|tet| tissue.tets.get(tet as usize));
    one.zip(other).is_some_and(|(one, other)| one.iter().any(|node| other.contains(node)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_an_object_and_a_tet_as_far_as_there_is_room_for_their_numbers() {
        assert_eq!(Part::of(0, None), Part::default());
        for owner in [0, 1, 255, LAST_OWNER - 1] {
            for tet in [None, Some(0), Some(1), Some(200_000), Some((1 << 23) - 2)] {
                let part = Part::of(owner, tet);
                assert_eq!((part.owner(), part.tet()), (owner, tet));
                let is_of = [tet.unwrap_or(5), 5].map(|tet| part.is_of(owner, tet));
                assert!(is_of == [true, tet.is_none()] && !part.is_of(owner + 1, 5), "{part:?}: {is_of:?}");
            }
            for tet in [(1 << 23) - 1, u32::MAX - 1, u32::MAX] {
                assert_eq!(Part::of(owner, Some(tet)), Part::of(owner, None), "{tet}");
            }
        }
        for owner in [LAST_OWNER, LAST_OWNER + 1, u32::MAX] {
            assert_eq!((Part::of(owner, Some(7)).owner(), Part::of(owner, Some(7)).tet()), (LAST_OWNER, Some(7)));
        }
    }
}
