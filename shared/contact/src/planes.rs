//! Contacts of a tool, condensed to a few planes that the haptic servo can evaluate between two steps of the tissue.
//!
//! The servo computes F = Σ kᵢ·max(0, (pointᵢ − x_tip)·nᵢ)·nᵢ. Each contact is shared among eight fixed directions (the
//! corners of a cube) by smooth weights; each direction with a force becomes a plane whose normal is its share's direction and
//! whose depth is its share's force over its stiffness. So at the present pose the planes give the sum of the contacts' normal
//! forces exactly, and contacts that come, go or turn change the planes without a step. Friction is not in the planes, which
//! conserve energy; it is in the residual.
//! Points that are about to touch ([`Gap`]) make planes too, at the distance of their gap: there the hand meets the wall at the
//! servo's rate, before the tissue has answered.

use crate::near::Gap;
use crate::response::ContactForce;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Most planes of a set.
pub const MAX_PLANES: usize = 8;

/// A wall for the tool's tip. Plain old data; all zero: no plane.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
pub struct Plane {
    /// A point of the plane, metres. The force starts when the tip is below it.
    pub point_m: [f32; 3],
    /// Unit vector out of the tissue, to the free side.
    pub normal: [f32; 3],
    /// Force per depth of the tip below the plane, N/m, at least 0.
    pub stiffness_n_m: f32,
    /// Force per speed of the tip along −normal while below the plane, N·s/m, at least 0.
    pub damping_n_s_m: f32,
}

impl Plane {
    /// Force of the plane on a tip at rest, newtons.
    pub fn force_n(&self, tip_m: [f32; 3]) -> [f32; 3] {
        let normal = Vec3::from_array(self.normal);
        let depth = (Vec3::from_array(self.point_m) - Vec3::from_array(tip_m)).dot(normal);
        (normal * (self.stiffness_n_m * depth.max(0.0))).to_array()
    }
}

/// The planes of one tool at one step. Plain old data.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
pub struct PlaneSet {
    /// Contacts first, then walls about to be met, nearest first; the rest is zero.
    pub planes: [Plane; MAX_PLANES],
    /// Planes in use.
    pub count: u32,
    /// The tool's whole contact force less that of the planes at this pose: friction and rounding. Newtons.
    pub residual_n: [f32; 3],
}

impl PlaneSet {
    /// Force of all planes on a tip at rest, newtons.
    pub fn force_n(&self, tip_m: [f32; 3]) -> [f32; 3] {
        let sum: Vec3 = self.planes.iter().map(|p| Vec3::from_array(p.force_n(tip_m))).sum();
        sum.to_array()
    }
}

/// What the planes are made from.
#[derive(Debug, Clone, Copy)]
pub struct PlaneInput<'a> {
    /// The contacts of all objects.
    pub contacts: &'a [ContactForce],
    /// The gap of each point ([`crate::find_gaps`]), or empty for no walls about to be met.
    pub gaps: &'a [Gap],
    /// Object of each point; parallel to the gaps.
    pub owner: &'a [u32],
    /// Area that each point stands for, m²; parallel to the gaps.
    pub point_area_m2: &'a [f32],
    /// The tool's reference, metres.
    pub tip_m: [f32; 3],
    /// The tool's object.
    pub tool: u32,
}

/// For walls about to be met.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneParams {
    /// Gaps from here on make no plane, metres.
    pub range_m: f32,
    /// Force per area and depth, as in the response, N/m³.
    pub stiffness_n_m3: f32,
}

/// Sums over one direction of the cube.
#[derive(Debug, Clone, Copy, Default)]
struct Bin {
    force_n: Vec3,
    stiffness_n_m: f32,
    damping_n_s_m: f32,
    gap: f32,
}

/// Shares of a unit vector among the eight directions: smooth, at least 0, sum 1.
fn shares(direction: Vec3) -> [f32; MAX_PLANES] {
    let raw: [f32; MAX_PLANES] = std::array::from_fn(|b| {
        let sign = |bit: usize| if b >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let along = direction.dot(Vec3::new(sign(0), sign(1), sign(2))).max(0.0);
        (along * along) * (along * along)
    });
    let sum: f32 = raw.iter().sum();
    if sum > 0.0 { raw.map(|w| w / sum) } else { [0.0; MAX_PLANES] }
}

/// Condenses the contacts and gaps of one tool.
pub fn planes(input: &PlaneInput<'_>, params: &PlaneParams) -> PlaneSet {
    let mut set = PlaneSet::default();
    let mut whole = Vec3::ZERO;
    let mut bins = [Bin::default(); MAX_PLANES];
    for contact in input.contacts.iter().filter(|c| c.owner == input.tool && c.normal_n > 0.0) {
        let direction = Vec3::from_array(contact.direction);
        whole += Vec3::from_array(contact.force_n);
        for (bin, w) in bins.iter_mut().zip(shares(direction)) {
            bin.force_n += direction * (w * contact.normal_n);
            bin.stiffness_n_m += w * contact.stiffness_n_m;
            bin.damping_n_s_m += w * contact.damping_n_s_m;
        }
    }
    let tip = Vec3::from_array(input.tip_m);
    for bin in &bins {
        let force = bin.force_n.length();
        let depth = force / bin.stiffness_n_m;
        // A share of less than a micronewton is rounding of the weights.
        if force > 1.0e-6 && depth.is_finite() {
            set.push(tip, bin.force_n / force, depth, bin.stiffness_n_m, bin.damping_n_s_m);
        }
    }
    set.residual_n = (whole - Vec3::from_array(set.force_n(input.tip_m))).to_array();
    if !Vec3::from_array(set.residual_n).is_finite() {
        return PlaneSet::default();
    }
    approach(input, params, &mut set);
    set
}

/// Planes of the walls about to be met: offset = mean gap, the nearest counting most; stiffness fades to zero at the range.
fn approach(input: &PlaneInput<'_>, params: &PlaneParams, set: &mut PlaneSet) {
    let mut bins = [Bin::default(); MAX_PLANES];
    for (gap, (&owner, &area)) in input.gaps.iter().zip(input.owner.iter().zip(input.point_area_m2)) {
        let near = gap.distance_m < params.range_m;
        if owner != input.tool || !near {
            continue;
        }
        let near = 1.0 - gap.distance_m / params.range_m;
        let (direction, stiffness) = (Vec3::from_array(gap.direction), params.stiffness_n_m3 * area * near * near);
        for (bin, w) in bins.iter_mut().zip(shares(direction)) {
            bin.force_n += direction * (w * stiffness);
            bin.stiffness_n_m += w * stiffness;
            bin.gap += w * stiffness * gap.distance_m;
        }
    }
    let mut order: [(f32, usize); MAX_PLANES] = std::array::from_fn(|b| {
        let gap = bins[b].gap / bins[b].stiffness_n_m;
        (if gap.is_finite() { gap } else { f32::INFINITY }, b)
    });
    order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let tip = Vec3::from_array(input.tip_m);
    for (gap, b) in order {
        if let Some(normal) = bins[b].force_n.try_normalize()
            && gap.is_finite()
            && bins[b].stiffness_n_m > 1.0e-3
        {
            set.push(tip, normal, -gap, bins[b].stiffness_n_m, 0.0);
        }
    }
}

impl PlaneSet {
    /// Adds a plane that the tip is `depth_m` below, if there is room.
    fn push(&mut self, tip: Vec3, normal: Vec3, depth_m: f32, stiffness_n_m: f32, damping_n_s_m: f32) {
        let plane =
            Plane { point_m: (tip + normal * depth_m).to_array(), normal: normal.to_array(), stiffness_n_m, damping_n_s_m };
        let finite = bytemuck::cast_ref::<Plane, [f32; 8]>(&plane).iter().all(|v| v.is_finite());
        if let Some(place) = self.planes.get_mut(self.count as usize).filter(|_| finite) {
            *place = plane;
            self.count += 1;
        }
    }
}
