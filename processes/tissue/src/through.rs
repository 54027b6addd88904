//! What the tool has gone through: none of its points tunnels, however fast it is and however thin the part. What passes between its points is not seen: a
//! part that is narrower than they are apart may.
//!
//! A point that lies in tissue is found by the intersection test. One that went into a part and out of its far side is not, or in what lies behind alone; it is
//! held here by the face that it went in by, until it is back on that face's outer side. Two things lead to a point being held: it lay in the tissue a step
//! before (the state remembers where it came in), or it was so fast that no step saw it in there, which the sweep finds. A part may have another one of its own
//! object behind it: a point that lies in that is past the first, if the way out of that is not as long as the way back to where it came in.

use crate::contacts::ToolMotion;
use crate::world::World;
use glam::{Quat, Vec3};
use hyst_contact::{
    Crossing, HashRef, Hit, Memory, Penetration, Sense, Source, SweepInput, Tissue, Topology, first_crossing, sweep,
    triangles_in_box, way_out_m,
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
    /// How far along that the face is that it went in by, m; and so far it is looked for.
    face_m: f32,
    reach_m: f32,
    /// How long the way out is of the part of this object that it lies in all the same, m.
    part_m: Option<f32>,
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
        // By what it knew, and by what it came into.
        self.missed.reserve(2 * tool);
        self.near.clear();
        self.near.reserve(world.topology.boundary.len());
        self.held.clear();
        self.held.reserve(tool);
        self.tissue_m = 0.0;
    }

    /// Looks which points of the tool are past what they lay in a step before, or have come into since; and tells those that a fast step brought into tissue by
    /// which face they came in. `memory` is that of the tool's points.
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
            next += hits[next..].iter().take_while(|hit| (hit.point as usize) < point).count();
            let of_point = hits[next..].iter().take_while(|hit| hit.point as usize == point);
            let hit_in = |owner: u32| of_point.clone().find(|hit| tissue.tet_owner.get(hit.tet as usize) == Some(&owner));
            let known = Some(*memory).filter(|memory| memory.direction != [0.0; 3]);
            let came = self.came_in(world, tool, point);
            let is_in_known = known.is_some_and(|known| hit_in(known.owner).is_some());
            if let Some(came) = came.filter(|came| !is_in_known && hit_in(came.owner).is_some()) {
                *memory = came;
            }
            for memory in [known, came].into_iter().flatten() {
                self.miss((world, tissue), tool, (point, hit_in(memory.owner)), &memory);
            }
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

    /// What a point knows of the tissue that it came into in this step, if the sweep has found any: how deep it was before is negative.
    fn came_in(&self, world: &World, tool: &ToolMotion<'_>, point: usize) -> Option<Memory> {
        let crossing = self.entered.get(point).copied().flatten().filter(|crossing| faces(world, tool, point, crossing))?;
        let way = Vec3::from(*tool.points_m.get(point)?) - Vec3::from(self.before_m[point]);
        Some(Memory {
            owner: world.topology.boundary_owner[crossing.triangle as usize],
            direction: crossing.normal,
            depth_m: crossing.fraction * way.dot(Vec3::from(crossing.normal)),
            bent_m: [0.0; 3],
        })
    }

    /// Notes a point that came into an object with this known and lies in none of its tissue, or in another part of it than the one that it came into. The face
    /// that it came in by is as far away now as it has not come back out, and as face and tissue may have changed on its way along it.
    fn miss(
        &mut self,
        (world, tissue): (&World, &Tissue<'_>),
        tool: &ToolMotion<'_>,
        (point, hit): (usize, Option<&Hit>),
        known: &Memory,
    ) {
        let Some(place_m) = tool.points_m.get(point) else { return };
        let Some(out) = Vec3::from(known.direction).try_normalize() else { return };
        let way = Vec3::from(*place_m) - Vec3::from(self.before_m[point]);
        let along_m = way.dot(out);
        let face_m = known.depth_m - along_m;
        let slack_m = (way - along_m * out).length() + self.tissue_m + SLACK_M;
        let mut part_m = None;
        if let Some(hit) = hit {
            part_m = way_out_m(tissue, &world.topology, hit.tet, (*place_m, out.to_array(), FARTHEST_M));
            // Nearly always it lies in the part that it came into.
            if part_m.is_none_or(|part_m| (part_m - face_m).abs() <= SWEPT_FROM_M) {
                return;
            }
        }
        let reach_m = part_m.map_or(face_m, |part_m| part_m.max(face_m)) + slack_m;
        if reach_m > 0.0 && reach_m <= FARTHEST_M {
            let (point, owner, bent_m) = (point as u32, known.owner, known.bent_m);
            self.missed.push(Missed { point, owner, out, face_m, reach_m, part_m, bent_m });
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
            // By what it knew, or else by what it came into.
            if self.held.last() == Some(&missed.point) {
                continue;
            }
            let crossing = face_of(missed, place(missed), (topology, tissue.positions_m), &self.near);
            if let Some(crossing) = crossing.filter(|crossing| faces(world, tool, missed.point as usize, crossing))
                && let Some(contact) = contact(world, missed, &crossing)
                && let Some(place) = room.next()
            {
                let (owner, bent_m) = (missed.owner, missed.bent_m);
                memory[missed.point as usize] = Memory { owner, direction: crossing.normal, depth_m: contact.depth_m, bent_m };
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

/// Whether what came from one place to another in a step has jumped there, and not moved.
pub fn has_jumped(from: Vec3, to: Vec3) -> bool {
    from.distance(to) > FARTHEST_M
}

/// The way from one place to another, m: none, if it has jumped.
fn moved_m(from_m: [f32; 3], to_m: [f32; 3]) -> Vec3 {
    let way_m = Vec3::from(to_m) - Vec3::from(from_m);
    if way_m.length() <= FARTHEST_M { way_m } else { Vec3::ZERO }
}

/// Whether a face is one that a point of the tool can meet from outside of the tissue: one that looks against the tool's own surface there.
fn faces(world: &World, tool: &ToolMotion<'_>, point: usize, crossing: &Crossing) -> bool {
    let outward = Quat::from_array(tool.orientation) * Vec3::from(world.case.tool.outward[point]);
    outward.dot(Vec3::from(crossing.normal)) <= MOST_ALONG
}

/// The face that a point went in by, among the triangles near the points: of those of its object that look out along its way back the first or the last one,
/// whichever is nearer to where it was last known to be. None for a point that lies in a part of this object, if that face is this part's: that is found.
fn face_of(missed: &Missed, from: Vec3, (topology, positions_m): (&Topology, &[[f32; 3]]), near: &[u32]) -> Option<Crossing> {
    let (from_m, to_m) = (from.to_array(), (from + missed.out * missed.reach_m).to_array());
    let look = |[from_m, to_m]: [[f32; 3]; 2], sense: Sense| {
        let of_owner = near.iter().copied().filter(|triangle| topology.boundary_owner[*triangle as usize] == missed.owner);
        first_crossing(from_m, to_m, sense, positions_m, &topology.boundary, of_owner)
    };
    let first = look([from_m, to_m], Sense::Out)?;
    // The last one that looks out is the first that looks in on the way from the other end.
    let last = look([to_m, from_m], Sense::In);
    let last = last.map_or(first, |last| Crossing { fraction: 1.0 - last.fraction, ..last });
    let [first_m, last_m] = [first, last].map(|crossing| crossing.fraction * missed.reach_m);
    let is_first = |at_m: f32| (first_m - at_m).abs() <= (last_m - at_m).abs();
    let is_found = |part_m: f32| last_m - first_m <= SWEPT_FROM_M || is_first(part_m) == is_first(missed.face_m);
    if missed.part_m.is_some_and(is_found) {
        return None;
    }
    Some(if is_first(missed.face_m) { first } else { last })
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
