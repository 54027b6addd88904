//! Points and boxes, as the parts of a cut compute with them: in double precision, or in the single one of a mesh where that tells the same.

use glam::{DMat3, DVec3, Vec3A};

/// The box around some points; around none, one that touches nothing.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    low_m: DVec3,
    high_m: DVec3,
}

impl Bounds {
    /// That around points.
    pub fn around(points_m: impl IntoIterator<Item = DVec3>) -> Bounds {
        let none = Bounds { low_m: DVec3::MAX, high_m: DVec3::MIN };
        let with = |around: Bounds, point: DVec3| Bounds { low_m: around.low_m.min(point), high_m: around.high_m.max(point) };
        points_m.into_iter().fold(none, with)
    }

    /// Whether they have a point in common.
    pub fn touches(&self, other: &Bounds) -> bool {
        self.low_m.cmple(other.high_m).all() && self.high_m.cmpge(other.low_m).all()
    }

    /// The one in single precision that has the same points of a mesh in it.
    pub fn single(&self) -> SingleBounds {
        SingleBounds { low_m: Spot::of(self.low_m).above_m, high_m: Spot::of(self.high_m).below_m }
    }
}

/// A point between those of single precision: on each axis the next of them that is not above it, and the next that is not below it.
#[derive(Debug, Clone, Copy)]
pub struct Spot {
    below_m: Vec3A,
    above_m: Vec3A,
}

impl Spot {
    /// That of a point.
    pub fn of(point_m: DVec3) -> Spot {
        let coordinates = point_m.to_array().map(|exact| (exact, exact as f32));
        let below = coordinates.map(|(exact, near)| if f64::from(near) > exact { near.next_down() } else { near });
        let above = coordinates.map(|(exact, near)| if f64::from(near) < exact { near.next_up() } else { near });
        Spot { below_m: Vec3A::from_array(below), above_m: Vec3A::from_array(above) }
    }

    /// That of a point of single precision, which is its own neighbour.
    pub fn at(point_m: &[f32; 3]) -> Spot {
        let point_m = Vec3A::from_array(*point_m);
        Spot { below_m: point_m, above_m: point_m }
    }
}

/// The box around some points of a mesh, whose single precision it needs no more than: one comparison for all axes. Around none, one that has nothing in it.
#[derive(Debug, Clone, Copy)]
pub struct SingleBounds {
    low_m: Vec3A,
    high_m: Vec3A,
}

impl SingleBounds {
    /// That around points.
    pub fn around(points_m: impl IntoIterator<Item = [f32; 3]>) -> SingleBounds {
        let none = SingleBounds { low_m: Vec3A::INFINITY, high_m: Vec3A::NEG_INFINITY };
        let with = |around: SingleBounds, point: [f32; 3]| {
            let point = Vec3A::from_array(point);
            SingleBounds { low_m: around.low_m.min(point), high_m: around.high_m.max(point) }
        };
        points_m.into_iter().fold(none, with)
    }

    /// That around a tet.
    pub fn of_tet(positions_m: &[[f32; 3]], tet: [u32; 4]) -> SingleBounds {
        SingleBounds::around(tet.map(|node| positions_m[node as usize]))
    }

    /// The one around both.
    pub fn with(self, other: SingleBounds) -> SingleBounds {
        SingleBounds { low_m: self.low_m.min(other.low_m), high_m: self.high_m.max(other.high_m) }
    }

    /// The longest side, m.
    pub fn extent_m(&self) -> f64 {
        let (low_m, high_m) = self.ends_m();
        (high_m - low_m).max_element()
    }

    /// The lowest and the highest corner, m.
    pub fn ends_m(&self) -> (DVec3, DVec3) {
        (self.low_m.as_dvec3(), self.high_m.as_dvec3())
    }

    /// The faces of the box on whose inner sides a point is.
    pub fn sides(&self, point_m: &[f32; 3]) -> Sides {
        let point_m = Vec3A::from_array(*point_m);
        Sides((point_m.cmpge(self.low_m).bitmask() | point_m.cmple(self.high_m).bitmask() << 3) as u8)
    }

    /// The tets whose own boxes have a point in common with it, in their order.
    pub fn tets_in(&self, positions_m: &[[f32; 3]], tets: &[[u32; 4]]) -> Vec<u32> {
        let sides: Vec<Sides> = positions_m.iter().map(|point_m| self.sides(point_m)).collect();
        (0..).zip(tets).filter(|(_, tet)| Sides::touch(tet.map(|node| sides[node as usize]))).map(|(tet, _)| tet).collect()
    }

    /// Whether a point is in it.
    pub fn has(&self, spot: &Spot) -> bool {
        (self.low_m.cmple(spot.below_m) & self.high_m.cmpge(spot.above_m)).all()
    }
}

/// A bit for each face of a box.
const ALL_FACES: u8 = 0x3f;

/// The faces of a box on whose inner sides a point is, a bit for each; a coordinate that is no number is on neither.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sides(u8);

impl Sides {
    /// Whether the box around some points has a point in common with the one that these are the sides of: each of its faces has one of them on its inner side.
    pub fn touch<const N: usize>(of_points: [Sides; N]) -> bool {
        of_points.iter().fold(0, |all, sides| all | sides.0) == ALL_FACES
    }
}

/// Three nodes, the lowest first.
pub fn sorted([a, b, c]: [u32; 3]) -> [u32; 3] {
    let (low, high) = (a.min(b), a.max(b));
    [low.min(c), low.max(high.min(c)), high.max(c)]
}

/// An edge as one number, the lower node in front: these have the order of the nodes, and take one comparison.
pub fn number_of_edge([a, b]: [u32; 2]) -> u64 {
    u64::from(a.min(b)) << u32::BITS | u64::from(a.max(b))
}

/// The nodes of the edge that has a number, the lower one first.
pub fn edge_of_number(number: u64) -> [u32; 2] {
    [(number >> u32::BITS) as u32, number as u32]
}

/// A point in double precision.
pub fn at(positions_m: &[[f32; 3]], node: u32) -> DVec3 {
    DVec3::from_array(positions_m[node as usize].map(f64::from))
}

/// The corners of a tet.
pub fn corners(positions_m: &[[f32; 3]], tet: [u32; 4]) -> [DVec3; 4] {
    tet.map(|node| at(positions_m, node))
}

/// Weights of the corners of a tet for a point; not finite where the tet has no volume.
pub fn barycentric([a, b, c, d]: [DVec3; 4], point: DVec3) -> [f64; 4] {
    let others = DMat3::from_cols(b - a, c - a, d - a).inverse() * (point - a);
    [1.0 - others.element_sum(), others.x, others.y, others.z]
}

/// In single precision, as a mesh has it.
pub fn to_single(point: DVec3) -> [f32; 3] {
    point.to_array().map(|coordinate| coordinate as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 2_000, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

        /// On a lattice, so that boxes touch in faces, edges and corners; some coordinates are no numbers.
        #[test]
        fn a_tet_is_in_a_box_when_its_own_box_touches_it(
            ends in prop::array::uniform2(prop::array::uniform3(0..8_i8)),
            points in prop::collection::vec(prop::array::uniform3(0..9_i8), 4..20),
            tets in prop::collection::vec(prop::array::uniform4(0..20_u32), 1..20),
        ) {
            let place = |point: [i8; 3]| point.map(|value| if value == 8 { f32::NAN } else { 0.1 * f32::from(value) });
            let around = Bounds::around(ends.map(|end| at(&[place(end)], 0)));
            let positions_m: Vec<[f32; 3]> = points.iter().map(|point| place(*point)).collect();
            let tets: Vec<[u32; 4]> = tets.iter().map(|tet| tet.map(|node| node % positions_m.len() as u32)).collect();
            let touches = |tet: &u32| {
                let corners = tets[*tet as usize].map(|node| positions_m[node as usize]);
                let Bounds { low_m, high_m } = around;
                (0..3).all(|axis| {
                    let of_axis = || corners.iter().map(|corner| f64::from(corner[axis]));
                    of_axis().fold(f64::NAN, f64::min) <= high_m[axis] && of_axis().fold(f64::NAN, f64::max) >= low_m[axis]
                })
            };
            let expected: Vec<u32> = (0..tets.len() as u32).filter(touches).collect();
            let single = around.single();
            prop_assert_eq!(single.tets_in(&positions_m, &tets), expected);
            for point in positions_m.iter().filter(|point| point.iter().all(|coordinate| coordinate.is_finite())) {
                let here = Bounds::around([at(&[*point], 0)]);
                prop_assert_eq!(single.has(&Spot::at(point)), here.touches(&around));
                prop_assert_eq!(Sides::touch([single.sides(point)]), here.touches(&around));
            }
        }

        /// Ends and points are those of single precision, and the next ones of double precision beside them; some are beyond all that single precision has.
        #[test]
        fn in_single_precision_a_box_has_in_it_what_it_has_in_double(
            ends in prop::array::uniform2(prop::array::uniform3((0..6_usize, -1..2_i8))),
            point in prop::array::uniform3((0..6_usize, -1..2_i8)),
        ) {
            const PLACES: [f64; 6] = [f64::MIN, -0.1_f32 as f64, 0.0, 0.1_f32 as f64, 0.3_f32 as f64, f64::MAX];
            let beside = |(place, way): (usize, i8)| match way {
                -1 => PLACES[place].next_down(),
                0 => PLACES[place],
                _ => PLACES[place].next_up(),
            };
            let [low_m, high_m] = ends.map(|end| DVec3::from_array(end.map(beside)));
            let around = Bounds { low_m: low_m.min(high_m), high_m: low_m.max(high_m) };
            let point_m = point.map(beside);
            let is_between = |low_m: DVec3, high_m: DVec3, point_m: [f64; 3]| {
                (0..3).all(|axis| (low_m[axis]..=high_m[axis]).contains(&point_m[axis]))
            };
            // A point of double precision in a box of a mesh, and one of a mesh in a box of double precision.
            let ends_m = [around.low_m, around.high_m].map(to_single);
            let of_mesh = SingleBounds::around(ends_m);
            let (low_m, high_m) = of_mesh.ends_m();
            prop_assert_eq!(of_mesh.has(&Spot::of(DVec3::from_array(point_m))), is_between(low_m, high_m, point_m));
            let in_mesh = point_m.map(|coordinate| coordinate as f32);
            let is_in = is_between(around.low_m, around.high_m, in_mesh.map(f64::from));
            prop_assert_eq!(around.single().has(&Spot::at(&in_mesh)), is_in);
            prop_assert_eq!(Sides::touch([around.single().sides(&in_mesh)]), is_in);
        }

        #[test]
        fn numbers_of_edges_have_the_order_of_their_nodes(edges in prop::array::uniform2(prop::array::uniform2(0..3_u32))) {
            let edges = edges.map(|edge| edge.map(|node| node * (u32::MAX / 2)));
            let [mut one, mut other] = edges;
            one.sort_unstable();
            other.sort_unstable();
            let numbers = edges.map(number_of_edge);
            prop_assert_eq!(numbers.map(edge_of_number), [one, other]);
            prop_assert_eq!(numbers[0].cmp(&numbers[1]), one.cmp(&other));
        }

        #[test]
        fn three_nodes_are_sorted(nodes in prop::array::uniform3(0..4_u32)) {
            let mut expected = nodes;
            expected.sort_unstable();
            prop_assert_eq!(sorted(nodes), expected);
        }
    }
}
