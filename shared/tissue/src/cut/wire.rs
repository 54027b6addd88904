//! Where the wire was in the tissue. Between two ticks both move: what the wire has cut through is what it was swept past in the tissue, so each
//! of its points is kept by the tet that it was in, or by the nearest node, and carried along. Of a wire that is in something no point is carried along
//! by something else, which may only pass by: nobody has swept it through what it is in. One that is in nothing goes along with what is nearest, so that
//! tissue which comes to it is cut by it from the surface on.

use super::Cuttable;
use super::places::{Bounds, SingleBounds, Spot, at, barycentric, corners, to_single};
use glam::DVec3;

/// A point of the wire, as the tissue saw it last.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Seat {
    /// The tet that it was in; `u32::MAX` for none.
    pub tet: u32,
    /// Weights of the tet's corners.
    pub weights: [f32; 4],
    /// The node that was nearest, of the parts that the wire was in, or of all: outside of the tissue it moves along with that. `u32::MAX` for none.
    pub node: u32,
    /// Where it was from that node, m; from the origin without one.
    pub offset_m: [f32; 3],
    /// The line along which it last moved in the tissue, a unit vector; its sign is kept when the wire goes back. 0 before it moves.
    pub way: [f32; 3],
}

impl Seat {
    /// Whether all its numbers are.
    pub fn is_finite(&self) -> bool {
        self.weights.iter().chain(&self.offset_m).chain(&self.way).all(|value| value.is_finite())
    }
}

/// What a wire does from one tick to the next.
#[derive(Debug)]
pub struct Motion {
    /// Where its points were in the tissue, which is somewhere else now, and a little behind that, m.
    pub from_m: Vec<DVec3>,
    /// Where they are, m.
    pub to_m: Vec<DVec3>,
    /// The lines along which they move, unit vectors.
    pub ways: Vec<DVec3>,
}

/// A sheet begins behind where the one before has ended, by this share of its step: what is carried is rounded, and no edge may slip between the two.
const OVERLAP: f64 = 0.01;
/// No tet, no node.
const NONE: u32 = u32::MAX;

/// The tet that a point is in, with the weights of its corners, if it is in one.
type Around = Option<(u32, [f32; 4])>;

impl Cuttable {
    /// What a wire does in the tissue; nothing if it has another number of points than before.
    pub(super) fn motion(&self, wire: &[[f32; 3]]) -> Motion {
        let to_m: Vec<DVec3> = wire.iter().map(|point| at(&[*point], 0)).collect();
        let from_m = if self.wire.len() == wire.len() { self.carried_wire() } else { to_m.clone() };
        let steps: Vec<DVec3> = to_m.iter().zip(&from_m).map(|(to, from)| to - from).collect();
        let before: Vec<DVec3> = self.wire.iter().map(|seat| at(&[seat.way], 0)).collect();
        // What moves for the first time has the sign of what moves most: a wire that turns about its middle sweeps one sheet.
        let first = steps.iter().copied().fold(DVec3::ZERO, |most, step| if step.length() > most.length() { step } else { most });
        let way = |(index, step): (usize, &DVec3)| {
            let before = before.get(index).copied().unwrap_or_default();
            let sign = if before == DVec3::ZERO { step.dot(first) } else { step.dot(before) };
            step.try_normalize().map_or(before, |way| if sign < 0.0 { -way } else { way })
        };
        let ways = steps.iter().enumerate().map(way).collect();
        let from_m = from_m.into_iter().zip(&steps).map(|(from, step)| from - OVERLAP * step).collect();
        Motion { from_m, to_m, ways }
    }

    /// How far a wire has come in the tissue since it was last seen in this stroke, m: the longest way of its points; infinite for the first of a
    /// stroke, and where a seat or the tissue is not finite.
    pub fn swept_m(&self, wire: &[[f32; 3]]) -> f64 {
        if self.wire.len() != wire.len() {
            return f64::INFINITY;
        }
        let ways = self.carried_wire().into_iter().zip(wire).map(|(from, to)| at(&[*to], 0).distance(from));
        ways.fold(0.0, |most, way| {
            if way <= most {
                most
            } else if way.is_finite() {
                way
            } else {
                f64::INFINITY
            }
        })
    }

    /// Where the points of the wire are now that the tissue has moved, m.
    fn carried_wire(&self) -> Vec<DVec3> {
        let in_tet = |seat: &Seat| {
            let tet = self.rest.tets.get(seat.tet as usize)?;
            let parts = corners(&self.position_m, *tet).into_iter().zip(seat.weights);
            Some(parts.map(|(corner, weight)| corner * f64::from(weight)).sum::<DVec3>())
        };
        let beside_node = |seat: &Seat| {
            let node = self.position_m.get(seat.node as usize).map_or(DVec3::ZERO, |_| at(&self.position_m, seat.node));
            node + at(&[seat.offset_m], 0)
        };
        self.wire.iter().map(|seat| in_tet(seat).unwrap_or_else(|| beside_node(seat))).collect()
    }

    /// Remembers where the wire is.
    pub(super) fn seat_wire(&mut self, motion: &Motion) {
        let near = Bounds::around(motion.to_m.iter().copied()).single().tets_in(&self.position_m, &self.rest.tets);
        let bounds = |tet: u32| SingleBounds::of_tet(&self.position_m, self.rest.tets[tet as usize]);
        let near: Vec<(u32, SingleBounds)> = near.into_iter().map(|tet| (tet, bounds(tet))).collect();
        let around: Vec<Around> = motion.to_m.iter().map(|point| self.tet_around(*point, &near)).collect();
        // Asked only where the wire is outside of all tets.
        let nodes = if around.iter().all(Option::is_some) { Vec::new() } else { self.carriers(&around) };
        let points = motion.to_m.iter().zip(&motion.ways).zip(around);
        self.wire = points.map(|((point, way), around)| self.seat(*point, *way, around, &nodes)).collect();
    }

    fn tet_around(&self, point: DVec3, near: &[(u32, SingleBounds)]) -> Around {
        let spot = Spot::of(point);
        let mut around = near.iter().filter(|(_, bounds)| bounds.has(&spot)).map(|(tet, _)| *tet);
        around.find_map(|tet| Some((tet, weights_in(corners(&self.position_m, self.rest.tets[tet as usize]), point)?)))
    }

    /// The nodes that may carry along a point that is outside of all tets, in their order: those of the parts in which the wire has a point, or all that a tet
    /// has. What came apart in this cut is told by its parts, else what hangs together is one region.
    fn carriers(&self, around: &[Around]) -> Vec<u32> {
        let (tets, known) = (&self.rest.tets, &self.part_of_tet);
        let part_of_tet = if known.len() == tets.len() { known } else { &self.rest.regions };
        let mut parts: Vec<u32> = around.iter().flatten().map(|(tet, _)| part_of_tet[*tet as usize]).collect();
        parts.sort_unstable();
        parts.dedup();
        let mut may_carry = vec![false; self.position_m.len()];
        for (tet, _) in tets.iter().zip(part_of_tet).filter(|(_, part)| parts.is_empty() || parts.contains(*part)) {
            tet.iter().for_each(|node| may_carry[*node as usize] = true);
        }
        (0..).zip(may_carry).filter(|(_, may_carry)| *may_carry).map(|(node, _)| node).collect()
    }

    /// A point that is in a tet, or moves along with the nearest of some nodes.
    fn seat(&self, point: DVec3, way: DVec3, around: Around, nodes: &[u32]) -> Seat {
        let (tet, weights) = around.unwrap_or((NONE, [0.0; 4]));
        let nodes: &[u32] = if tet == NONE { nodes } else { &[] };
        // The first of the nearest, and none whose distance is infinite or no number.
        let nearer = |(nearest, least): (u32, f64), node: &u32| {
            let distance = at(&self.position_m, *node).distance_squared(point);
            if distance < least { (*node, distance) } else { (nearest, least) }
        };
        let (node, _) = nodes.iter().fold((NONE, f64::INFINITY), nearer);
        let offset = if node == NONE { point } else { point - at(&self.position_m, node) };
        Seat { tet, weights, node, offset_m: to_single(offset), way: to_single(way) }
    }
}

/// The weights of the corners, if the point is inside.
fn weights_in(corners: [DVec3; 4], point: DVec3) -> Option<[f32; 4]> {
    let all = barycentric(corners, point);
    all.iter().all(|weight| *weight >= 0.0).then(|| all.map(|weight| weight as f32))
}
