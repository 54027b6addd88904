//! Which of several parts of one object a point is in: told by the tet that it was in before, where they lie behind each other and where they lie in each other.

mod common;

use common::block;
use glam::{Quat, Vec3};
use hyst_contact::*;

const MM: f32 = 1e-3;

/// Thickness of a slab.
const THICK_M: f32 = 2.0 * MM;
/// The way back out of what was come into along +z.
const OUT: [f32; 3] = [0.0, 0.0, -1.0];

/// Two slabs of one object, 24 mm wide, one layer of cells each. The free side of the first one is z = 0.
struct Slabs {
    positions_m: Vec<[f32; 3]>,
    tets: Vec<[u32; 4]>,
    tet_owner: Vec<u32>,
    topology: Topology,
}

impl Slabs {
    /// The free side of the second one is so far behind that of the first one.
    fn new(second_m: f32) -> Slabs {
        let slab = |low_m: f32| block([12, 12, 1], THICK_M, [-12.0 * MM, -12.0 * MM, low_m]);
        let ((mut positions_m, mut tets), (of_second_m, of_second)) = (slab(0.0), slab(second_m));
        let first = positions_m.len() as u32;
        positions_m.extend(of_second_m);
        tets.extend(of_second.iter().map(|tet| tet.map(|node| node + first)));
        let tet_owner = vec![3; tets.len()];
        Slabs { topology: Topology::new(&tets, &tet_owner, &positions_m).unwrap(), positions_m, tets, tet_owner }
    }

    fn tissue(&self) -> Tissue<'_> {
        Tissue { positions_m: &self.positions_m, tets: &self.tets, tet_owner: &self.tet_owner }
    }

    fn test(&self, tet: u32) -> Option<TetTest> {
        TetTest::new(&self.tets[tet as usize].map(|node| self.positions_m[node as usize]))
    }

    /// The lowest tet of a slab that a place lies in.
    fn tet(&self, slab: usize, place_m: [f32; 3]) -> u32 {
        let of_slab = self.tets.len() as u32 / 2;
        let mut tets = slab as u32 * of_slab..(slab as u32 + 1) * of_slab;
        let lies_in = |tet: &u32| self.test(*tet).is_some_and(|test| test.weights(place_m).is_some());
        tets.find(lies_in).unwrap_or_else(|| panic!("{place_m:?} is not in slab {slab}"))
    }

    /// How a point that was at the first place, in a slab, has come to the second one, where it is found in a slab.
    fn came(&self, [from, to]: [(usize, [f32; 3]); 2], out: [f32; 3]) -> Came {
        let tets = [from, to].map(|(slab, place_m)| self.tet(slab, place_m));
        came(&self.tissue(), &self.topology, tets, (to.1, out))
    }
}

/// A place in mm, as m.
fn at(place_mm: [f32; 3]) -> [f32; 3] {
    place_mm.map(|part| part * MM)
}

#[test]
fn what_leaves_a_part_by_its_far_side_has_come_through_it_and_what_stays_in_it_or_goes_back_has_not() {
    // Half a millimetre behind each other, and without any gap.
    for second_m in [2.5 * MM, THICK_M] {
        let slabs = Slabs::new(second_m);
        let (shallow, deep, behind) = (at([0.3, 0.1, 0.4]), at([0.3, 0.1, 1.7]), at([0.3, 0.1, 2.83]));
        let far = at([7.3, -6.1, 2.83]);
        for from in [shallow, deep] {
            assert_eq!(slabs.came([(0, from), (1, behind)], OUT), Came::Through, "{from:?}");
            assert_eq!(slabs.came([(0, from), (1, far)], OUT), Came::Through, "aside from {from:?}");
            // Pushed from behind it goes on out of its near side.
            assert_eq!(slabs.came([(0, from), (1, behind)], [0.0, 0.0, 1.0]), Came::Within, "{from:?}");
        }
        assert_eq!(slabs.came([(1, behind), (0, deep)], OUT), Came::Within, "back out of the second");
        for to in [deep, at([0.9, 0.2, 0.3]), at([9.1, 8.2, 0.6])] {
            assert_eq!(slabs.came([(0, shallow), (0, to)], OUT), Came::Within, "{to:?}");
        }
        assert_eq!(slabs.came([(1, behind), (1, at([-9.1, 8.2, 3.8]))], OUT), Came::Within);
    }
}

/// They lie in each other by half of their thickness.
#[test]
fn a_point_in_two_parts_is_in_the_one_that_it_knows_whichever_has_the_lower_tets() {
    let slabs = Slabs::new(0.5 * THICK_M);
    let (both, beyond) = (at([0.3, 0.1, 1.53]), at([0.3, 0.1, 2.61]));
    for (from, place_m) in [(0, at([-5.2, 0.4, 0.53])), (1, at([5.3, -2.1, 2.41]))] {
        let Came::Beside(tet, weights) = slabs.came([(from, place_m), (1 - from, both)], OUT) else {
            panic!("from slab {from}: {:?}", slabs.came([(from, place_m), (1 - from, both)], OUT));
        };
        assert_eq!(tet, slabs.tet(from, both));
        assert_eq!(Some(weights), slabs.test(tet).and_then(|test| test.weights(both)));
        assert_eq!(slabs.came([(from, place_m), (from, both)], OUT), Came::Within, "it is found where it was");
    }
    assert_eq!(slabs.came([(0, both), (1, beyond)], OUT), Came::Through);
}

/// Bent about the tool: the straight way from one place in the first slab to another one leads through the hollow.
#[test]
fn a_way_that_leaves_by_the_side_that_it_came_in_by_has_not_come_through() {
    let mut slabs = Slabs::new(2.5 * MM);
    let bent = |[x, y, z]: [f32; 3]| Quat::from_rotation_y(x / (8.0 * MM)) * Vec3::new(0.0, 0.0, 8.0 * MM + z) + Vec3::Y * y;
    slabs.positions_m.iter_mut().for_each(|place_m| *place_m = bent(*place_m).to_array());
    let [from, to] = [-5.7f32, 5.7].map(|x| bent(at([x, 0.1, 1.0])).to_array());
    let out = Quat::from_rotation_y(-5.7 / 8.0) * Vec3::NEG_Z;
    assert_eq!(slabs.came([(0, from), (0, to)], out.to_array()), Came::Within);
    assert_eq!(slabs.came([(0, from), (0, to)], (-out).to_array()), Came::Through, "what came in from outside was in the hollow");
}

#[test]
fn where_nobody_knows_a_point_stays_in_its_part() {
    let mut slabs = Slabs::new(2.5 * MM);
    let behind = at([0.3, 0.1, 3.0]);
    let [from, to] = [(0, at([0.3, 0.1, 1.0])), (1, behind)].map(|(slab, place_m)| slabs.tet(slab, place_m));
    let how = |slabs: &Slabs, tets: [u32; 2], place_m: [f32; 3], out: [f32; 3]| {
        came(&slabs.tissue(), &slabs.topology, tets, (place_m, out))
    };
    assert_eq!(how(&slabs, [from, to], behind, OUT), Came::Through);
    for tets in [[NONE, to], [from, from], [to, to]] {
        assert_eq!(how(&slabs, tets, behind, OUT), Came::Within, "{tets:?}");
    }
    assert_eq!(how(&slabs, [from, to], [f32::NAN; 3], OUT), Came::Within, "nowhere");
    assert_eq!(how(&slabs, [from, to], behind, [f32::NAN; 3]), Came::Within, "no way back");
    let nodes = slabs.tets[from as usize];
    nodes.iter().for_each(|node| slabs.positions_m[*node as usize] = [0.0; 3]);
    assert_eq!(how(&slabs, [from, to], behind, OUT), Came::Within, "from a flat tet");
}
