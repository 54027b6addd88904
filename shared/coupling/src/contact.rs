//! The local contact model: what the tissue tells the servo about its surface near the tip.
//!
//! It promises that whatever bytes arrive, only planes that can be used reach the solver: unit normals, positive bounded
//! stiffness, bounded damping, points near the organ. All others are dropped and counted.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use crate::vector::{is_finite, sane};

/// Planes in a model: a tip in a cavity meets few walls at once, and 8 fit into 272 bytes.
pub const MAX_PLANES: usize = 8;

/// No planes rub with more than this share of what they push with.
pub const MAX_FRICTION: f32 = 1.0;

/// A point farther from the origin than this is not in a patient; its plane is dropped.
const MAX_POINT_M: f32 = 2.0;

/// One half-space of the tissue's surface: the free side is where `(x − point_m) · normal > 0`.
///
/// On its own it resists with `stiffness_n_m · penetration − damping_n_s_m · (v · normal)` along `normal`, never pulling.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Plane {
    /// A point of the plane, metres, station frame.
    pub point_m: [f32; 3],
    /// Unit normal that points to the free side. Lengths from 0.5 to 2 are normalised, others drop the plane.
    pub normal: [f32; 3],
    /// Resistance to penetration, N/m, > 0. How stiff the planes are together is limited by the servo's passivity bound.
    pub stiffness_n_m: f32,
    /// Resistance to normal speed, N·s/m, ≥ 0. A negative or non-finite value counts as 0.
    pub damping_n_s_m: f32,
}

/// The planes near the tip at one tick of the tissue. Its age is given to the servo by the caller.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ContactModel {
    /// The planes; the first `count` are used.
    pub planes: [Plane; MAX_PLANES],
    /// How many are used; more than [`MAX_PLANES`] is a fault and counts as [`MAX_PLANES`].
    pub count: u32,
    /// Coulomb's coefficient of friction between the planes and the tip, 0 to [`MAX_FRICTION`]; what is no number, or is less, counts as 0.
    pub friction: f32,
    /// Explicit padding, zero.
    pub reserved: [u32; 2],
}

impl ContactModel {
    /// A model of the given planes; planes beyond [`MAX_PLANES`] are left out.
    pub fn new(planes: &[Plane]) -> Self {
        let mut model = Self::default();
        let count = planes.len().min(MAX_PLANES);
        model.planes[..count].copy_from_slice(&planes[..count]);
        model.count = count as u32;
        model
    }
}

/// A plane after checking, seen from the device: what the proxy solver works on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Constraint {
    /// Unit normal to the free side.
    pub normal: DVec3,
    /// Depth of the device below the plane, metres; negative outside.
    pub depth_m: f64,
    /// Resistance of its own, N/m, > 0.
    pub stiffness_n_m: f64,
    /// Damping, N·s/m, within `[0, max_damping]`.
    pub damping_n_s_m: f64,
}

/// The usable planes of a model as constraints at one device position.
#[derive(Clone, Copy, Debug, Default)]
pub struct Constraints {
    /// The constraints; the first `count` are used.
    pub all: [Constraint; MAX_PLANES],
    /// How many are used.
    pub count: usize,
    /// Coefficient of friction of all of them, 0 to [`MAX_FRICTION`].
    pub friction: f64,
    /// True if a plane was dropped, or the count or the friction was absurd.
    pub faulty: bool,
}

impl Constraints {
    /// Checks `model` and expresses it at `position_m` (finite). Damping is limited to `max_damping_n_s_m`, ≥ 0.
    pub fn at(model: &ContactModel, position_m: DVec3, max_damping_n_s_m: f64) -> Self {
        let has_friction = (0.0..=MAX_FRICTION).contains(&model.friction);
        let faulty = model.count as usize > MAX_PLANES || !has_friction;
        let friction = f64::from(sane(model.friction, 0.0, MAX_FRICTION, 0.0));
        let mut result = Self { faulty, friction, ..Self::default() };
        for plane in model.planes.iter().take((model.count as usize).min(MAX_PLANES)) {
            let Some(normal) = usable_normal(plane) else {
                result.faulty = true;
                continue;
            };
            let point = DVec3::from_array(plane.point_m.map(f64::from));
            let damping = f64::from(plane.damping_n_s_m);
            result.all[result.count] = Constraint {
                normal,
                depth_m: (point - position_m).dot(normal),
                stiffness_n_m: f64::from(plane.stiffness_n_m),
                damping_n_s_m: if damping.is_finite() { damping.clamp(0.0, max_damping_n_s_m) } else { 0.0 },
            };
            result.count += 1;
        }
        result
    }

    /// Moves all planes by `by_m`.
    pub fn shift(&mut self, by_m: DVec3) {
        for constraint in &mut self.all[..self.count] {
            constraint.depth_m += by_m.dot(constraint.normal);
        }
    }

    /// The constraints in use.
    pub fn used(&self) -> &[Constraint] {
        &self.all[..self.count]
    }
}

/// The normal of `plane` at unit length, or `None` if the plane cannot be used.
fn usable_normal(plane: &Plane) -> Option<DVec3> {
    let near = is_finite(plane.point_m) && plane.point_m.iter().all(|c| c.abs() <= MAX_POINT_M);
    let stiff = plane.stiffness_n_m.is_finite() && plane.stiffness_n_m > 0.0;
    if !(near && stiff && is_finite(plane.normal)) {
        return None;
    }
    let normal = DVec3::from_array(plane.normal.map(f64::from));
    let length = normal.length();
    (0.5..=2.0).contains(&length).then(|| normal / length)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wall() -> Plane {
        Plane { point_m: [0.0, 0.0, 0.05], normal: [0.0, 0.0, -1.0], stiffness_n_m: 500.0, damping_n_s_m: 1.0 }
    }

    #[test]
    fn depth_is_positive_behind_the_plane_and_normals_become_unit() {
        let long = Plane { normal: [0.0, 0.0, -1.5], ..wall() };
        let seen = Constraints::at(&ContactModel::new(&[long]), DVec3::new(0.0, 0.0, 0.052), 2.0);
        assert_eq!(seen.count, 1);
        assert_eq!(seen.used()[0].normal, DVec3::NEG_Z);
        assert!((seen.used()[0].depth_m - 0.002).abs() < 1e-8);
    }

    #[test]
    fn unusable_planes_are_dropped_and_reported() {
        let bad = [
            Plane { normal: [0.0; 3], ..wall() },
            Plane { normal: [f32::NAN, 0.0, 0.0], ..wall() },
            Plane { point_m: [1e30, 0.0, 0.0], ..wall() },
            Plane { stiffness_n_m: -1.0, ..wall() },
            Plane { stiffness_n_m: f32::INFINITY, ..wall() },
        ];
        for plane in bad {
            let seen = Constraints::at(&ContactModel::new(&[plane, wall()]), DVec3::ZERO, 2.0);
            assert!(seen.faulty && seen.count == 1, "{plane:?}");
        }
    }

    #[test]
    fn a_friction_that_is_none_counts_as_nothing_and_one_that_is_too_large_as_the_largest() {
        for (told, expected, is_faulty) in [
            (0.05, 0.05, false),
            (0.0, 0.0, false),
            (1.0, 1.0, false),
            (-0.1, 0.0, true),
            (1e9, 1.0, true),
            (f32::NAN, 0.0, true),
            (f32::INFINITY, 0.0, true),
        ] {
            let model = ContactModel { friction: told, ..ContactModel::new(&[wall()]) };
            let seen = Constraints::at(&model, DVec3::ZERO, 2.0);
            assert_eq!((seen.friction as f32, seen.faulty, seen.count), (expected, is_faulty, 1), "{told}");
        }
    }

    #[test]
    fn an_absurd_count_reads_no_further_than_the_array() {
        let mut model = ContactModel::new(&[wall(); MAX_PLANES]);
        model.count = u32::MAX;
        let seen = Constraints::at(&model, DVec3::ZERO, 2.0);
        assert!(seen.faulty && seen.count == MAX_PLANES);
    }
}
