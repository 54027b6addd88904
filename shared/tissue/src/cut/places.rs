//! Points and boxes in double precision, as the parts of a cut compute with them.

use glam::{DMat3, DVec3};

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

    /// The one around both.
    pub fn with(self, other: Bounds) -> Bounds {
        Bounds { low_m: self.low_m.min(other.low_m), high_m: self.high_m.max(other.high_m) }
    }

    /// The longest side, m.
    pub fn extent_m(&self) -> f64 {
        (self.high_m - self.low_m).max_element()
    }

    /// The lowest and the highest corner, m.
    pub fn ends_m(&self) -> (DVec3, DVec3) {
        (self.low_m, self.high_m)
    }

    /// The faces of the box on whose inner sides a point is.
    pub fn sides(&self, point_m: &[f32; 3]) -> Sides {
        let (low_m, high_m) = (self.low_m.to_array(), self.high_m.to_array());
        let of_axis = |axis: usize| {
            let place_m = f64::from(point_m[axis]);
            u8::from(place_m >= low_m[axis]) | u8::from(place_m <= high_m[axis]) << 1
        };
        Sides(of_axis(0) | of_axis(1) << 2 | of_axis(2) << 4)
    }

    /// The same of each point.
    pub fn sides_of(&self, positions_m: &[[f32; 3]]) -> Vec<Sides> {
        positions_m.iter().map(|point_m| self.sides(point_m)).collect()
    }

    /// The tets whose own boxes have a point in common with it, in their order.
    pub fn tets_in(&self, positions_m: &[[f32; 3]], tets: &[[u32; 4]]) -> Vec<u32> {
        let sides = self.sides_of(positions_m);
        (0..).zip(tets).filter(|(_, tet)| Sides::touch(tet.map(|node| sides[node as usize]))).map(|(tet, _)| tet).collect()
    }

    /// Whether a point is in it.
    pub fn has(&self, point_m: DVec3) -> bool {
        self.low_m.cmple(point_m).all() && self.high_m.cmpge(point_m).all()
    }

    /// Whether they have a point in common.
    pub fn touches(&self, other: &Bounds) -> bool {
        self.low_m.cmple(other.high_m).all() && self.high_m.cmpge(other.low_m).all()
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

/// Whether all coordinates are numbers; looks at all of them, which takes less time than to stop at the first that is none.
pub fn are_finite(points_m: &[[f32; 3]]) -> bool {
    points_m.as_flattened().iter().fold(true, |all, coordinate| all & coordinate.is_finite())
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
                let (low_m, high_m) = around.ends_m();
                (0..3).all(|axis| {
                    let of_axis = || corners.iter().map(|corner| f64::from(corner[axis]));
                    of_axis().fold(f64::NAN, f64::min) <= high_m[axis] && of_axis().fold(f64::NAN, f64::max) >= low_m[axis]
                })
            };
            let expected: Vec<u32> = (0..tets.len() as u32).filter(touches).collect();
            prop_assert_eq!(around.tets_in(&positions_m, &tets), expected);
            for point in positions_m.iter().filter(|point| point.iter().all(|coordinate| coordinate.is_finite())) {
                let here = Bounds::around([at(&[*point], 0)]);
                prop_assert_eq!(around.has(at(&[*point], 0)), here.touches(&around));
                prop_assert_eq!(Sides::touch([around.sides(point)]), here.touches(&around));
            }
        }
    }
}
