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

    /// The tets whose own boxes have a point in common with it, in their order.
    pub fn tets_in(&self, positions_m: &[[f32; 3]], tets: &[[u32; 4]]) -> Vec<u32> {
        let (low_m, high_m) = (self.low_m.to_array(), self.high_m.to_array());
        let touches = |tet: &[u32; 4]| {
            let corners = tet.map(|node| positions_m[node as usize]);
            (0..3).all(|axis| {
                let [a, b, c, d] = corners.map(|corner| corner[axis]);
                f64::from(a.min(b).min(c.min(d))) <= high_m[axis] && f64::from(a.max(b).max(c.max(d))) >= low_m[axis]
            })
        };
        (0..).zip(tets).filter(|(_, tet)| touches(tet)).map(|(index, _)| index).collect()
    }

    /// Whether they have a point in common.
    pub fn touches(&self, other: &Bounds) -> bool {
        self.low_m.cmple(other.high_m).all() && self.high_m.cmpge(other.low_m).all()
    }
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
