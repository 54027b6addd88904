//! Contacts of a tool, condensed to a few planes that the haptic servo can evaluate between two steps of the tissue.
//!
//! The servo computes F = Σ kᵢ·max(0, (pointᵢ − x_tip)·nᵢ)·nᵢ. What touches an instrument that turns about a pivot is felt at its
//! tip (`lever.rs`): of a direction n with s = |T·n| the direction n' = T·n/s, the force s·N, the stiffness s²·k and the damping
//! s²·c, for where the tip goes by δ along n' the point goes by s·δ along n. Each contact is shared among eight fixed directions (the
//! corners of a cube) by smooth weights; each direction with a force becomes a plane whose normal is its share's direction and
//! whose depth is its share's force over its stiffness. So at the present pose the planes give the sum of the contacts' normal
//! forces, as they are felt, exactly, and contacts that come, go or turn change the planes without a step. Friction is not in the
//! planes, which conserve energy.
//! Points that are about to touch ([`Gap`]) make planes too, at the distance of their gap over s: there the hand meets the wall at
//! the servo's rate, before the tissue has answered.
//! Together the planes are nowhere stiffer than a bound: what a servo can make a hand feel has one, and beyond it would be felt with less force. Contacts that
//! are stiffer become planes that are softer and as much deeper, so that the force stays what it is; walls about to be met have what is left of it.

use crate::force::ContactForce;
use crate::lever::Lever;
use crate::near::Gap;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Most planes of a set.
pub const MAX_PLANES: usize = 8;
/// No plane is farther from the tip, m.
const FARTHEST_M: f32 = 0.1;
/// What is felt at the tip with less than this share of its force is not felt.
const LEAST_FELT: f32 = 0.01;
/// Walls whose normals have a smaller cosine than this are at right angles.
const LEAST_PART: f32 = 1e-3;
/// Contacts may have this share of the bound on stiffness, so that something is left for walls about to be met.
const SHARE_OF_CONTACTS: f32 = 0.9;

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
}

impl PlaneSet {
    /// Force of all planes on a tip at rest, newtons.
    pub fn force_n(&self, tip_m: [f32; 3]) -> [f32; 3] {
        let sum: Vec3 = self.planes.iter().map(|p| Vec3::from_array(p.force_n(tip_m))).sum();
        sum.to_array()
    }

    /// A bound on how stiff the planes are together, N/m: the largest, of the normal of each of them, of the sum of all stiffness along it. It is no more than
    /// they are where they have one normal or are at right angles.
    pub fn stiffness_n_m(&self) -> f32 {
        together(&self.walls())
    }

    /// Normals and stiffness.
    fn walls(&self) -> [(Vec3, f32); MAX_PLANES] {
        self.planes.map(|plane| (Vec3::from_array(plane.normal), plane.stiffness_n_m))
    }
}

/// Stiffness of walls along a direction, N/m, each by the cosine of its normal.
fn along(direction: Vec3, walls: &[(Vec3, f32); MAX_PLANES]) -> f32 {
    walls.iter().map(|(normal, stiffness_n_m)| stiffness_n_m * direction.dot(*normal).abs()).sum()
}

/// The largest of that along the normal of one of them, N/m.
fn together(walls: &[(Vec3, f32); MAX_PLANES]) -> f32 {
    walls.iter().map(|(normal, _)| along(*normal, walls)).fold(0.0, f32::max)
}

/// What the planes are made from.
#[derive(Debug, Clone, Copy)]
pub struct PlaneInput<'a> {
    /// The contacts of all objects.
    pub contacts: &'a [ContactForce],
    /// The gap of each point ([`crate::find_gaps`]), or empty for no walls about to be met.
    pub gaps: &'a [Gap],
    /// Where each point is, metres; parallel to the gaps.
    pub points_m: &'a [[f32; 3]],
    /// Object of each point; parallel to the gaps.
    pub owner: &'a [u32],
    /// Area that each point stands for, m²; parallel to the gaps.
    pub point_area_m2: &'a [f32],
    /// The tool's tip, where the planes are felt, metres.
    pub tip_m: [f32; 3],
    /// What the tool slides through and turns about, metres; without it all of the tool goes as its tip does.
    pub pivot_m: Option<[f32; 3]>,
    /// The tool's object.
    pub tool: u32,
}

/// How far ahead walls are seen, and how stiff planes are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneParams {
    /// Gaps from here on make no plane, metres.
    pub range_m: f32,
    /// Force per area and depth of walls about to be met, as of the contacts, N/m³.
    pub stiffness_n_m3: f32,
    /// All planes together are nowhere stiffer than this, N/m, above 0.
    pub most_stiffness_n_m: f32,
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

/// How a direction at a place is felt at the tip: which way, and how far the point goes along the one for each metre of the tip along the other.
fn felt(lever: Option<Lever>, place_m: [f32; 3], direction: [f32; 3]) -> (Vec3, f32) {
    let direction = Vec3::from_array(direction);
    let Some(lever) = lever else { return (direction, 1.0) };
    let felt = lever.felt(place_m, direction);
    let share = felt.length();
    (felt / share, share)
}

/// Condenses the contacts and gaps of one tool. Contacts of which one is no number make no plane, nor do gaps beside them.
pub fn planes(input: &PlaneInput<'_>, params: &PlaneParams) -> PlaneSet {
    let mut set = PlaneSet::default();
    let lever = Lever::of(input.pivot_m, input.tip_m);
    let mut bins = [Bin::default(); MAX_PLANES];
    for contact in input.contacts.iter().filter(|c| c.owner == input.tool && c.normal_n > 0.0) {
        let (direction, share) = felt(lever, contact.place_m, contact.direction);
        if share < LEAST_FELT {
            continue;
        }
        let normal_n = share * contact.normal_n;
        if !(direction * normal_n).is_finite() {
            return PlaneSet::default();
        }
        let squared = share * share;
        for (bin, w) in bins.iter_mut().zip(shares(direction)) {
            bin.force_n += direction * (w * normal_n);
            bin.stiffness_n_m += w * (squared * contact.stiffness_n_m);
            bin.damping_n_s_m += w * (squared * contact.damping_n_s_m);
        }
    }
    let tip = Vec3::from_array(input.tip_m);
    // A share of less than a micronewton is rounding of the weights.
    bins.iter_mut().filter(|bin| bin.force_n.length() <= 1.0e-6).for_each(|bin| *bin = Bin::default());
    // None by itself is stiffer than all may be, so that one takes nothing of those at right angles to it.
    let most_n_m = SHARE_OF_CONTACTS * params.most_stiffness_n_m;
    let walls = bins.map(|bin| (bin.force_n.normalize_or_zero(), bin.stiffness_n_m.min(most_n_m)));
    let softer = (most_n_m / together(&walls)).min(1.0);
    for (bin, (normal, stiffness_n_m)) in bins.iter().zip(walls) {
        let depth = bin.force_n.length() / (softer * stiffness_n_m);
        if depth.is_finite() {
            set.push(tip, normal, depth, softer * stiffness_n_m, bin.damping_n_s_m);
        }
    }
    if !Vec3::from_array(set.force_n(input.tip_m)).is_finite() {
        return PlaneSet::default();
    }
    approach(input, params, lever, &mut set);
    set
}

/// Planes of the walls about to be met: offset = mean gap, the nearest counting most; stiffness fades to zero at the range.
fn approach(input: &PlaneInput<'_>, params: &PlaneParams, lever: Option<Lever>, set: &mut PlaneSet) {
    let mut bins = [Bin::default(); MAX_PLANES];
    let points = input.points_m.iter().zip(input.owner).zip(input.point_area_m2);
    for (gap, ((&place_m, &owner), &area)) in input.gaps.iter().zip(points) {
        let near = gap.distance_m < params.range_m;
        if owner != input.tool || !near {
            continue;
        }
        let (direction, share) = felt(lever, place_m, gap.direction);
        if share < LEAST_FELT {
            continue;
        }
        let near = 1.0 - gap.distance_m / params.range_m;
        let stiffness = share * share * (params.stiffness_n_m3 * area * near * near);
        for (bin, w) in bins.iter_mut().zip(shares(direction)) {
            bin.force_n += direction * (w * stiffness);
            bin.stiffness_n_m += w * stiffness;
            bin.gap += w * stiffness * (gap.distance_m / share);
        }
    }
    let mut order: [(f32, usize); MAX_PLANES] = std::array::from_fn(|b| {
        let gap = bins[b].gap / bins[b].stiffness_n_m;
        (if gap.is_finite() { gap } else { f32::INFINITY }, b)
    });
    order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let tip = Vec3::from_array(input.tip_m);
    let ahead = bins.map(|bin| (bin.force_n.normalize_or_zero(), bin.stiffness_n_m));
    let softer = left_beside(set, &ahead, params.most_stiffness_n_m);
    for (gap, b) in order {
        let (normal, stiffness_n_m) = (ahead[b].0, softer[b] * ahead[b].1);
        if normal != Vec3::ZERO && gap.is_finite() && stiffness_n_m > 1.0e-3 {
            set.push(tip, normal, -gap, stiffness_n_m, 0.0);
        }
    }
}

/// The share of its stiffness that each wall ahead may have beside planes that are there, so that all are nowhere stiffer than the bound: the least that is left
/// along any direction that it has a part in.
fn left_beside(set: &PlaneSet, ahead: &[(Vec3, f32); MAX_PLANES], most_n_m: f32) -> [f32; MAX_PLANES] {
    let there = set.walls();
    let mut shares = [1.0f32; MAX_PLANES];
    for (direction, _) in there.iter().chain(ahead).filter(|(direction, _)| *direction != Vec3::ZERO) {
        let wanted_n_m = along(*direction, ahead);
        let left_n_m = (most_n_m - along(*direction, &there)).max(0.0);
        for (share, (normal, _)) in shares.iter_mut().zip(ahead) {
            if wanted_n_m > left_n_m && normal.dot(*direction).abs() > LEAST_PART {
                *share = share.min(left_n_m / wanted_n_m);
            }
        }
    }
    shares
}

impl PlaneSet {
    /// Adds a plane that the tip is `depth_m` below, if there is room. One that is farther away than there is any use for is put nearer, with the same force.
    fn push(&mut self, tip: Vec3, normal: Vec3, depth_m: f32, stiffness_n_m: f32, damping_n_s_m: f32) {
        let nearer = (depth_m / FARTHEST_M).max(1.0);
        let (depth_m, stiffness_n_m) = (depth_m.clamp(-FARTHEST_M, FARTHEST_M), stiffness_n_m * nearer);
        let plane =
            Plane { point_m: (tip + normal * depth_m).to_array(), normal: normal.to_array(), stiffness_n_m, damping_n_s_m };
        let finite = bytemuck::cast_ref::<Plane, [f32; 8]>(&plane).iter().all(|v| v.is_finite());
        if let Some(place) = self.planes.get_mut(self.count as usize).filter(|_| finite) {
            *place = plane;
            self.count += 1;
        }
    }
}
