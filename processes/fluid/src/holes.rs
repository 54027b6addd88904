//! Holes through the wall of a hollow organ: a wound that has come to the organ's outside lets the medium out of the cavity.
//!
//! A wound begins in the cavity, for the loop comes from there; so it is through the wall where one of its points lies on what was the outside when the
//! organ was whole. Promise: the same topology has the same holes, whoever looks; an organ without a cavity has none.

use glam::{Quat, Vec3};
use hyst_flow::Way;
use hyst_messages::{Message, WireError};
use hyst_scene::LoadedScene;
use std::collections::BTreeMap;

/// Farther from the outside a wound has not come to it, m: far above the rounding of its points, far below what a cut leaves standing.
const ON_M: f32 = 1e-5;
/// Width of a hole of size 1, m: 0.6·A·√(2p/ρ) through 3 mm are 18 ml/s at 9.3 kPa, as the pump's model has it.
const FULL_M: f32 = 3e-3;
/// A hole that one point alone shows is so wide, m.
const LEAST_M: f32 = 5e-4;
/// By so much the looks out of a triangle are tilted against its normal, rad. From the outside none of them meets the organ; out of the cavity one may
/// go through the canal, but not all.
const TILT_RAD: f32 = 0.5;

/// Points that are remembered at most: as many as a large scene's surface has vertices; what is more is looked at each time.
const MOST_SEEN: usize = 1 << 18;

/// A triangle of the whole organ's surface, at rest, m.
type Triangle = [Vec3; 3];

/// The holes in the tissue's newest topology.
pub struct Holes {
    surface: Vec<Triangle>,
    /// Of each triangle, whether it lies on the outside, once that was asked.
    is_outside: Vec<Option<bool>>,
    /// Of each point of a wound that was seen, by its bits, whether it lies on the outside.
    seen: BTreeMap<[u32; 3], bool>,
    version: Option<u32>,
    size: f32,
    /// The points of wounds that lie on the outside.
    through: Vec<u32>,
    middle_m: Option<Vec3>,
}

impl Holes {
    /// None yet, in the hollow organs of a scene.
    pub fn new(scene: &LoadedScene) -> Holes {
        let mut surface = Vec::new();
        for object in scene.objects.iter().filter(|object| object.hollow) {
            let corner = |node: u32| Vec3::from(object.mesh.positions_m[node as usize]);
            surface.extend(hyst_mesh::boundary(&object.mesh).triangles.iter().map(|triangle| triangle.map(corner)));
        }
        Holes::through(surface)
    }

    fn through(surface: Vec<Triangle>) -> Holes {
        let (seen, through) = (BTreeMap::new(), Vec::new());
        Holes { is_outside: vec![None; surface.len()], surface, seen, version: None, size: 0.0, through, middle_m: None }
    }

    /// Takes a topology, if it is another one than that before.
    pub fn take(&mut self, topology: &Message<'_>) -> Result<(), WireError> {
        let version = topology.header().topology_version;
        if self.version != Some(version) {
            self.find(topology.section(4)?, topology.section(6)?);
            self.version = Some(version);
        }
        Ok(())
    }

    /// Size of all holes together, 0 none to 1, as the pump has it.
    pub fn size(&self) -> f32 {
        self.size
    }

    /// Finds where the holes are in a state, by its surface vertices.
    pub fn locate(&mut self, surface_m: &[[f32; 3]]) {
        let known = self.through.iter().filter_map(|point| surface_m.get(*point as usize));
        let (count, sum) = known.fold((0u32, Vec3::ZERO), |(count, sum), point| (count + 1, sum + Vec3::from(*point)));
        self.middle_m = (count > 0).then(|| sum / count as f32);
    }

    /// The way through them, of several from their middle; none without a hole.
    pub fn way(&self) -> Way {
        let Some(middle_m) = self.middle_m.filter(|_| self.size > 0.0) else { return Way::default() };
        Way { centre_m: middle_m.to_array(), radius_m: 0.5 * FULL_M * self.size.sqrt() }
    }

    /// Finds the points of wounds that lie on the outside.
    fn find(&mut self, rest_m: &[[f32; 3]], is_raw: &[u32]) {
        let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        self.through.clear();
        for (index, (point, _)) in rest_m.iter().zip(is_raw).enumerate().filter(|(_, (_, raw))| **raw != 0) {
            let key = point.map(f32::to_bits);
            let place = Vec3::from(*point);
            let known = self.seen.get(&key).copied();
            let is_through = known.unwrap_or_else(|| self.is_on_the_outside(place));
            if known.is_none() && self.seen.len() < MOST_SEEN {
                self.seen.insert(key, is_through);
            }
            if is_through {
                (low, high) = (low.min(place), high.max(place));
                self.through.push(index as u32);
            }
        }
        let width_m = (high - low).max_element().max(LEAST_M);
        self.size = if low.is_finite() { (width_m / FULL_M).powi(2).min(1.0) } else { 0.0 };
    }

    fn is_on_the_outside(&mut self, place: Vec3) -> bool {
        for index in 0..self.surface.len() {
            if is_on(&self.surface[index], place) {
                let looked = self.is_outside[index].unwrap_or_else(|| self.looks_out(index));
                self.is_outside[index] = Some(looked);
                if looked {
                    return true;
                }
            }
        }
        false
    }

    /// Whether who looks out of a triangle sees nothing of the organ.
    fn looks_out(&self, index: usize) -> bool {
        let [a, b, c] = self.surface[index];
        let (along, normal) = ((b - a).normalize_or_zero(), (b - a).cross(c - a).normalize_or_zero());
        let tilted = |turn: f32| Quat::from_axis_angle(normal, turn) * (Quat::from_axis_angle(along, TILT_RAD) * normal);
        let mut looks = (0..4).map(|quarter| tilted(quarter as f32 * std::f32::consts::FRAC_PI_2)).chain([normal]);
        let from = (a + b + c) / 3.0 + normal * ON_M;
        normal != Vec3::ZERO && looks.all(|look| !self.surface.iter().any(|triangle| is_met(triangle, from, look)))
    }
}

/// Whether a point lies on a triangle, but for [`ON_M`].
fn is_on(triangle: &Triangle, place: Vec3) -> bool {
    let [a, b, c] = *triangle;
    let low = a.min(b).min(c) - ON_M;
    let high = a.max(b).max(c) + ON_M;
    if !(place.cmpge(low).all() && place.cmple(high).all()) {
        return false;
    }
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let inside = |from: Vec3, to: Vec3| normal.cross(to - from).normalize_or_zero().dot(place - from) >= -ON_M;
    normal != Vec3::ZERO && normal.dot(place - a).abs() <= ON_M && inside(a, b) && inside(b, c) && inside(c, a)
}

/// Whether a look from a point meets a triangle (Möller and Trumbore 1997).
fn is_met(triangle: &Triangle, from: Vec3, look: Vec3) -> bool {
    let [a, b, c] = *triangle;
    let (ab, ac) = (b - a, c - a);
    let p = look.cross(ac);
    let determinant = ab.dot(p);
    if determinant == 0.0 {
        return false;
    }
    let (s, inverse) = (from - a, 1.0 / determinant);
    let (u, q) = (s.dot(p) * inverse, s.cross(ab));
    let v = look.dot(q) * inverse;
    u >= 0.0 && v >= 0.0 && u + v <= 1.0 && ac.dot(q) * inverse > 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The twelve triangles of a cube about the origin, outward, or inward.
    fn cube(half_m: f32, outward: bool) -> Vec<Triangle> {
        let mut triangles = Vec::new();
        for axis in 0..3 {
            for side in [-1.0f32, 1.0] {
                let corner = |u: f32, v: f32| {
                    let mut place = [0.0; 3];
                    (place[axis], place[(axis + 1) % 3], place[(axis + 2) % 3]) = (side, u, v);
                    Vec3::from(place) * half_m
                };
                for [a, b, c] in [
                    [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0)],
                    [corner(-1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
                ] {
                    triangles.push(if (side > 0.0) == outward { [a, b, c] } else { [a, c, b] });
                }
            }
        }
        triangles
    }

    /// An organ of 40 mm with a cavity of 20 mm.
    fn organ() -> Holes {
        Holes::through([cube(0.02, true), cube(0.01, false)].concat())
    }

    #[test]
    fn a_wound_in_the_cavity_is_no_hole_and_one_that_comes_out_is_as_wide_as_it_comes_out() {
        let mut holes = organ();
        // A cut from the cavity's wall at x = 10 mm towards the outside at 20 mm, its points 1.5 mm apart along y.
        let cut = |to_m: f32| [[0.01, 0.0, 0.0], [0.01, 0.0015, 0.0], [to_m, 0.0, 0.0], [to_m, 0.0015, 0.0]];
        holes.find(&cut(0.0199), &[1; 4]);
        holes.locate(&cut(0.0199));
        assert_eq!((holes.size(), holes.way()), (0.0, Way::default()), "0.1 mm are left of the wall");
        holes.find(&cut(0.02), &[1; 4]);
        assert!((holes.size() - 0.25).abs() < 1e-5, "half as wide as a hole of size 1: {}", holes.size());
        // Where the tissue has moved to since, as wide as it is.
        holes.locate(&cut(0.023));
        let Way { centre_m, radius_m } = holes.way();
        assert!(Vec3::from(centre_m).distance(Vec3::new(0.023, 0.00075, 0.0)) < 1e-6, "{centre_m:?}");
        assert!((radius_m - 0.00075).abs() < 1e-6, "{radius_m}");
        holes.locate(&cut(0.023)[..1]);
        assert_eq!(holes.way(), Way::default(), "a state of another surface");
        holes.find(&cut(0.02), &[1, 1, 1, 0]);
        assert!((holes.size() - 1.0 / 36.0).abs() < 1e-6, "one point is 0.5 mm: {}", holes.size());
        holes.find(&cut(0.02), &[1, 1, 0, 0]);
        assert_eq!(holes.size(), 0.0, "whole tissue on the outside is no wound");
        // As it was before: an older state without the hole.
        holes.find(&cut(0.0199), &[1; 4]);
        assert_eq!(holes.size(), 0.0);
        holes.find(&[[0.02, 0.0, 0.0], [0.02, 0.019, 0.0]], &[1; 2]);
        assert_eq!(holes.size(), 1.0);
    }

    #[test]
    fn what_is_no_number_and_lists_that_do_not_fit_make_no_hole_and_no_panic() {
        let mut holes = organ();
        holes.find(&[[f32::NAN, 0.0, 0.0], [f32::INFINITY; 3], [0.02, 0.0, 0.0]], &[1, 1]);
        assert_eq!(holes.size(), 0.0);
        let mut flat = Holes::through(vec![[Vec3::ZERO; 3]]);
        flat.find(&[[0.0; 3]], &[1]);
        assert_eq!(flat.size(), 0.0);
    }

    #[test]
    fn of_the_default_organ_the_outside_is_known_from_the_cavity() {
        let scene = hyst_scene::load_embedded().unwrap();
        let mut holes = Holes::new(&scene);
        let middle = |triangle: &Triangle| ((triangle[0] + triangle[1] + triangle[2]) / 3.0).to_array();
        let inside: Vec<_> = holes
            .surface
            .iter()
            .map(middle)
            .filter(|[x, y, z]| x.abs() < 0.004 && y.abs() < 0.006 && *z > 0.02 && *z < 0.04)
            .collect();
        let top = holes.surface.iter().map(middle).max_by(|a, b| a[1].total_cmp(&b[1])).unwrap();
        assert!(!inside.is_empty());
        holes.find(&inside, &vec![1; inside.len()]);
        assert_eq!(holes.size(), 0.0, "the cavity's walls");
        holes.find(&[top], &[1]);
        assert!(holes.size() > 0.0, "the most anterior place {top:?}");
    }
}
