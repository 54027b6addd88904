//! What the tool has gone through: none of its points tunnels, however fast it is and however thin the part. What passes between its points is not seen: a
//! part that is narrower than they are apart may.
//!
//! A point that lies in tissue is found by the intersection test. One that went into a part and out of its far side is not, or in another object behind it
//! alone; it is held here by the face that it went in by, until it is back on that face's outer side. Two things lead to a point being held: it lay in the
//! object a step before (the state remembers where it came in), or it was so fast that no step saw it in there, which the sweep finds. What lies behind as
//! another part of the same object is not told from the part that it went into.

use crate::contacts::ToolMotion;
use crate::world::World;
use glam::{Quat, Vec3};
use hyst_contact::{
    Crossing, HashRef, Hit, Memory, Penetration, Sense, Source, SweepInput, Tissue, first_crossing, sweep, triangles_in_box,
};
use hyst_engine::Failure;

/// From this way in a step on, m, a point may pass a part without a step that finds it inside: no part of a mesh is thinner than that.
const SWEPT_FROM_M: f32 = 1e-4;
/// What came from farther away in a step has jumped and not moved, m: 20 m/s.
const FARTHEST_M: f32 = 0.02;
/// No hand is faster, m/s: what seems to be was told late, and would drag the tissue with a force that nobody felt.
const FASTEST_M_S: f32 = 2.0;
/// How much farther than a point can have come the face that it went in by is looked for, m: the face turns and stretches.
const SLACK_M: f32 = 2.5e-4;

/// Largest cosine between the outside of the tool and that of a face which it meets: they are opposite where the surfaces are smooth.
const MOST_ALONG: f32 = 0.2;

/// How the tissue came to where it is, and the table of the points there.
#[derive(Clone, Copy, Debug)]
pub struct Passage<'a> {
    /// The table of this step.
    pub hash: &'a HashRef<'a>,
    /// Velocities of the nodes, m/s.
    pub velocities_m_s: &'a [[f32; 3]],
    /// The step, s.
    pub dt_s: f32,
}

/// A point that may have gone through something.
#[derive(Clone, Copy, Debug)]
struct Missed {
    point: u32,
    owner: u32,
    /// The way back out, a unit vector.
    out: Vec3,
    reach_m: f32,
    /// What its friction was before.
    bent_m: [f32; 3],
}

/// Buffers, sized for a world.
#[derive(Default)]
pub struct Through {
    before_m: Vec<[f32; 3]>,
    entered: Vec<Option<Crossing>>,
    missed: Vec<Missed>,
    near: Vec<u32>,
    /// Points that are held.
    held: Vec<u32>,
    /// How far a node of the tissue came in the step at most, m.
    tissue_m: f32,
}

impl Through {
    /// Makes room for a world.
    pub fn fit(&mut self, world: &World) {
        let tool = world.points.tool;
        self.before_m.resize(tool, [0.0; 3]);
        self.entered.resize(tool, None);
        self.missed.clear();
        self.missed.reserve(2 * tool);
        self.near.clear();
        self.near.reserve(world.topology.boundary.len());
        self.held.clear();
        self.held.reserve(tool);
        self.tissue_m = 0.0;
    }

    /// Looks which points of the tool do not lie in an object though they did a step before, or are past it; and tells those that a fast step brought into
    /// tissue by which face they came in. `memory` is that of the tool's points.
    pub fn look(
        &mut self,
        world: &World,
        hits: &[Hit],
        (tool, passage): (&ToolMotion<'_>, &Passage<'_>),
        tissue: &Tissue<'_>,
        memory: &mut [Memory],
    ) -> Result<(), Failure> {
        world.case.tool.place(tool.before.0, tool.before.1, &mut self.before_m);
        let swiftest = passage.velocities_m_s.iter().map(|velocity| Vec3::from(*velocity).length_squared()).fold(0.0, f32::max);
        self.tissue_m = swiftest.sqrt() * passage.dt_s;
        self.entered.fill(None);
        if self.fastest_m(tool) + self.tissue_m > SWEPT_FROM_M {
            let input = SweepInput {
                hash: passage.hash,
                from_m: &self.before_m,
                tissue: *tissue,
                velocity_m_s: passage.velocities_m_s,
                dt_s: passage.dt_s,
                topology: &world.topology,
                farthest_m: FARTHEST_M,
            };
            sweep(&input, &mut self.entered).map_err(|error| Failure::Broken(error.to_string()))?;
        }
        self.missed.clear();
        let mut next = 0;
        for (point, memory) in memory.iter_mut().enumerate() {
            while hits.get(next).is_some_and(|hit| (hit.point as usize) < point) {
                next += 1;
            }
            let of_point = hits[next..].iter().take_while(|hit| hit.point as usize == point);
            let is_in = |known: &Memory| of_point.clone().any(|hit| tissue.tet_owner.get(hit.tet as usize) == Some(&known.owner));
            if tool.spares(world, point as u32, Some(&memory.owner)) {
                *memory = Memory::default();
            }
            let known = Some(*memory).filter(|known| known.direction != [0.0; 3]);
            let owner_of = |entered: &Crossing| world.topology.boundary_owner[entered.triangle as usize];
            let is_met = |entered: &Crossing| {
                faces(world, tool, point, entered) && !tool.spares(world, point as u32, Some(&owner_of(entered)))
            };
            let entered = self.entered[point].filter(is_met).map(|entered| Memory {
                owner: owner_of(&entered),
                direction: entered.normal,
                depth_m: 0.0,
                bent_m: [0.0; 3],
            });
            if known.is_some_and(|known| is_in(&known)) {
                continue; // what it passes meanwhile lies within that
            }
            if let Some(entered) = entered.filter(&is_in) {
                *memory = entered;
            }
            // One that has come out of what it knew may have gone through something else in the same step.
            let passed = [known, entered].into_iter().flatten().filter(|passed| !is_in(passed));
            passed.for_each(|passed| self.miss(point, passed, tool));
        }
        Ok(())
    }

    /// How fast a point of the tool goes, m/s, after [`look`](Self::look).
    pub fn velocity_m_s(&self, point: usize, tool: &ToolMotion<'_>) -> [f32; 3] {
        let ends = self.before_m.get(point).zip(tool.points_m.get(point));
        ends.map_or([0.0; 3], |(from_m, to_m)| velocity_m_s(*from_m, *to_m, tool.since_s))
    }

    /// How far a point of the tool goes in this step, m: not at all, if it was nowhere before or has jumped.
    pub fn way_m(&self, point: usize, tool: &ToolMotion<'_>) -> Vec3 {
        let ends = self.before_m.get(point).zip(tool.points_m.get(point)).filter(|_| tool.since_s.is_finite());
        ends.map_or(Vec3::ZERO, |(from_m, to_m)| moved_m(*from_m, *to_m) * tool.way_share)
    }

    fn fastest_m(&self, tool: &ToolMotion<'_>) -> f32 {
        let ways = self.before_m.iter().zip(tool.points_m);
        let ways_m = ways.map(|(from, to)| Vec3::from(*from).distance(Vec3::from(*to)));
        ways_m.filter(|way_m| *way_m <= FARTHEST_M).fold(0.0, f32::max)
    }

    /// Notes a point that does not lie in an object but came into it with this known. The face that it came in by is as far away now as it has not come back
    /// out, and as face and tissue may have changed on its way along it.
    fn miss(&mut self, point: usize, known: Memory, tool: &ToolMotion<'_>) {
        let Some(place) = tool.points_m.get(point) else { return };
        let Some(out) = Vec3::from(known.direction).try_normalize() else { return };
        let way = Vec3::from(*place) - Vec3::from(self.before_m[point]);
        let along_m = way.dot(out);
        let reach_m = known.depth_m - along_m + (way - along_m * out).length() + self.tissue_m + SLACK_M;
        if reach_m > 0.0 && reach_m <= FARTHEST_M {
            self.missed.push(Missed { point: point as u32, owner: known.owner, out, reach_m, bent_m: known.bent_m });
        }
    }

    /// Writes the contacts of the points that are held, as many as there is room for, and remembers them. Gives their number.
    pub fn hold(
        &mut self,
        world: &World,
        tool: &ToolMotion<'_>,
        tissue: &Tissue<'_>,
        memory: &mut [Memory],
        found: &mut [Penetration],
    ) -> usize {
        self.held.clear();
        let topology = &world.topology;
        let place = |missed: &Missed| Vec3::from(tool.points_m[missed.point as usize]);
        let ends = self.missed.iter().flat_map(|missed| [place(missed), place(missed) + missed.out * missed.reach_m]);
        let (low, high) = ends.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), end| (low.min(end), high.max(end)));
        if !self.missed.is_empty() {
            triangles_in_box([low.to_array(), high.to_array()], tissue.positions_m, &topology.boundary, &mut self.near);
        }
        let mut room = found.iter_mut();
        for missed in &self.missed {
            if self.held.last() == Some(&missed.point) {
                continue; // by what it knew
            }
            let (from, owner) = (place(missed), missed.owner);
            let to = from + missed.out * missed.reach_m;
            let of_owner = self.near.iter().copied().filter(|triangle| topology.boundary_owner[*triangle as usize] == owner);
            let (from_m, to_m) = (from.to_array(), to.to_array());
            let crossing = first_crossing(from_m, to_m, Sense::Out, tissue.positions_m, &topology.boundary, of_owner);
            if let Some(crossing) = crossing.filter(|crossing| faces(world, tool, missed.point as usize, crossing))
                && let Some(contact) = contact(world, missed, &crossing)
                && let Some(place) = room.next()
            {
                memory[missed.point as usize] =
                    Memory { owner, direction: crossing.normal, depth_m: contact.depth_m, bent_m: missed.bent_m };
                *place = contact;
                self.held.push(missed.point);
            }
        }
        self.held.len()
    }

    /// The points that were held in the last step.
    pub fn held(&self) -> &[u32] {
        &self.held
    }
}

/// How fast something goes that came from one place to another in some time, m/s: not at all, if it was nowhere before or has jumped.
pub fn velocity_m_s(from_m: [f32; 3], to_m: [f32; 3], since_s: f32) -> [f32; 3] {
    (moved_m(from_m, to_m) / since_s).clamp_length_max(FASTEST_M_S).to_array()
}

/// Whether what came from one place to another in a step has moved there, and not jumped.
pub fn has_moved(from: Vec3, to: Vec3) -> bool {
    from.distance(to) <= FARTHEST_M
}

/// The way from one place to another, m: none, if it has jumped.
fn moved_m(from_m: [f32; 3], to_m: [f32; 3]) -> Vec3 {
    let (from, to) = (Vec3::from(from_m), Vec3::from(to_m));
    if has_moved(from, to) { to - from } else { Vec3::ZERO }
}

/// Whether a face is one that a point of the tool can meet from outside of the tissue: one that looks against the tool's own surface there.
fn faces(world: &World, tool: &ToolMotion<'_>, point: usize, crossing: &Crossing) -> bool {
    let outward = Quat::from_array(tool.orientation) * Vec3::from(world.case.tool.outward[point]);
    outward.dot(Vec3::from(crossing.normal)) <= MOST_ALONG
}

/// The contact of a point with the face that it went in by.
fn contact(world: &World, missed: &Missed, crossing: &Crossing) -> Option<Penetration> {
    let (nodes, tet) =
        (world.topology.boundary[crossing.triangle as usize], world.topology.boundary_tet[crossing.triangle as usize]);
    let corners = world.model.tets().get(tet as usize)?;
    let weight = |corner: &u32| nodes.iter().position(|node| node == corner).map_or(0.0, |at| crossing.weights[at]);
    let along = Vec3::from(crossing.normal).dot(missed.out);
    Some(Penetration {
        point: missed.point,
        tet,
        weights: std::array::from_fn(|corner| weight(&corners[corner])),
        depth_m: crossing.fraction * missed.reach_m * along,
        direction: crossing.normal,
        source: Source::Held as u32,
    })
}
