//! What the tool has gone through: none of its points tunnels, however fast it is and however thin the part. What passes between its points is not seen: a
//! part that is narrower than they are apart may.
//!
//! A point that lies in tissue is found by the intersection test. One that went into a part and out of its far side is not, or in what lies behind it alone; it
//! is held here by the face that it went in by, until it is back on that face's outer side. Two things lead to a point being held: it lay in the object a step
//! before (the state remembers where it came in), or it was so fast that no step saw it in there, which the sweep finds. Another part of the same object is
//! told from the one that it went into by the tet of that which the point knows ([`came`]).

use crate::contacts::{ToolMotion, max_hits};
use crate::world::World;
use glam::{Quat, Vec3};
use hyst_contact::{
    Came, Crossing, HashRef, Hit, Memory, NONE, Part, Penetration, Sense, Source, SweepInput, Tissue, came, exit_of,
    first_crossing, sweep, touch, triangles_in_box,
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
/// Among so many faces on its way back a point looks for the one that it went in by: those of three other parts may come before it, or of two at a seam.
const MOST_FACES: usize = 4;

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
    /// What it went into.
    part: Part,
    /// Its hit in another part of that object.
    behind: Option<usize>,
    /// The way back out, a unit vector.
    out: Vec3,
    reach_m: f32,
    /// What its friction was before.
    bent_m: [f32; 3],
    /// Where its way back leads out of what it went into, if it does.
    face: Option<Crossing>,
}

/// Buffers, sized for a world.
#[derive(Default)]
pub struct Through {
    before_m: Vec<[f32; 3]>,
    entered: Vec<Option<Crossing>>,
    missed: Vec<Missed>,
    /// The hits: of several parts of one object that a point lies in, in that which it knows.
    hits: Vec<Hit>,
    /// Of each whether it lies behind a part that holds its point.
    is_behind: Vec<bool>,
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
        self.hits.clear();
        self.hits.reserve(max_hits(world));
        self.is_behind.clear();
        self.is_behind.reserve(max_hits(world));
        self.near.clear();
        self.near.reserve(world.topology.boundary.len());
        self.held.clear();
        self.held.reserve(tool);
        self.tissue_m = 0.0;
    }

    /// Looks which points of the tool do not lie in a part though they did a step before, or are past it; and tells those that a fast step brought into
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
        self.hits.clear();
        self.hits.extend_from_slice(hits);
        self.is_behind.clear();
        self.is_behind.resize(hits.len(), false);
        let mut next = 0;
        for (point, memory) in memory.iter_mut().enumerate() {
            while hits.get(next).is_some_and(|hit| (hit.point as usize) < point) {
                next += 1;
            }
            let end = next + hits[next..].iter().take_while(|hit| hit.point as usize == point).count();
            if tool.spares(world, point as u32, Some(&memory.part.owner())) {
                *memory = Memory::default();
            }
            let known = Some(*memory).filter(|known| known.direction != [0.0; 3]);
            let entered = self.came_in(world, tool, point);
            let Some(place_m) = tool.points_m.get(point).copied() else { continue };
            let by_known = known.map(|known| (known, stay(world, tissue, place_m, &mut self.hits[next..end], &known)));
            if matches!(by_known, Some((_, Stay::In))) {
                continue; // what it passes meanwhile lies within that
            }
            let by_entered = entered.map(|entered| (entered, stay(world, tissue, place_m, &mut self.hits[next..end], &entered)));
            if let Some((entered, Stay::In)) = by_entered {
                *memory = entered;
            }
            // One that has come out of what it knew may have gone through something else in the same step.
            for (passed, whether) in [by_known, by_entered].into_iter().flatten() {
                if let Stay::Past(behind) = whether {
                    self.miss(point, (passed, behind.map(|hit| next + hit)), tool);
                }
            }
        }
        self.seek(world, tool, tissue);
        Ok(())
    }

    /// The hits of this step as [`look`](Self::look) has left them, and of each whether it lies behind a part that holds its point.
    pub fn hits(&self) -> (&[Hit], &[bool]) {
        (&self.hits, &self.is_behind)
    }

    /// What a point knows of the tissue that the sweep has found it to come into.
    fn came_in(&self, world: &World, tool: &ToolMotion<'_>, point: usize) -> Option<Memory> {
        let entered = self.entered[point].filter(|entered| faces(world, tool, point, entered))?;
        let part = part_of(world, &entered);
        let is_met = !tool.spares(world, point as u32, Some(&part.owner()));
        is_met.then_some(Memory { part, direction: entered.normal, ..Memory::default() })
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

    /// Notes a point that does not lie in a part but came into it with this known, and has this hit in another part of that object. The face that it came in by
    /// is as far away now as it has not come back out, and as face and tissue may have changed on its way along it.
    fn miss(&mut self, point: usize, (known, behind): (Memory, Option<usize>), tool: &ToolMotion<'_>) {
        let Some(place) = tool.points_m.get(point) else { return };
        let Some(out) = Vec3::from(known.direction).try_normalize() else { return };
        let way = Vec3::from(*place) - Vec3::from(self.before_m[point]);
        let along_m = way.dot(out);
        let reach_m = known.depth_m - along_m + (way - along_m * out).length() + self.tissue_m + SLACK_M;
        if reach_m > 0.0 && reach_m <= FARTHEST_M {
            let (point, part, bent_m) = (point as u32, known.part, known.bent_m);
            self.missed.push(Missed { point, part, behind, out, reach_m, bent_m, face: None });
        }
    }

    /// Seeks the faces by which the points that were noted went in.
    fn seek(&mut self, world: &World, tool: &ToolMotion<'_>, tissue: &Tissue<'_>) {
        let place = |missed: &Missed| Vec3::from(tool.points_m[missed.point as usize]);
        let ends = self.missed.iter().flat_map(|missed| [place(missed), place(missed) + missed.out * missed.reach_m]);
        let (low, high) = ends.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), end| (low.min(end), high.max(end)));
        if !self.missed.is_empty() {
            triangles_in_box([low.to_array(), high.to_array()], tissue.positions_m, &world.topology.boundary, &mut self.near);
        }
        for missed in &mut self.missed {
            let noted = *missed;
            let behind = noted.behind.map(|hit| self.hits[hit].tet);
            let face = face_of(world, tissue, (&noted, behind), place(&noted), &self.near);
            missed.face = face.filter(|face| faces(world, tool, noted.point as usize, face));
            if let Some(hit) = noted.behind.filter(|_| missed.face.is_some()) {
                self.is_behind[hit] = true;
            }
        }
    }

    /// Writes the contacts of the points that are held, as many as there is room for, and remembers them. Gives their number.
    pub fn hold(&mut self, world: &World, memory: &mut [Memory], found: &mut [Penetration]) -> usize {
        self.held.clear();
        let mut room = found.iter_mut();
        for missed in &self.missed {
            if self.held.last() == Some(&missed.point) {
                continue; // by what it knew
            }
            if let Some(face) = &missed.face
                && let Some(contact) = contact(world, missed, face)
                && let Some(place) = room.next()
            {
                let (part, bent_m) = (part_of(world, face), missed.bent_m);
                memory[missed.point as usize] = Memory { part, direction: face.normal, depth_m: contact.depth_m, bent_m };
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

/// Whether a point lies in the part that it came into.
#[derive(Clone, Copy, Debug)]
enum Stay {
    /// It does.
    In,
    /// It does not, but perhaps in another part of the same object: with the hit of that number among its own.
    Past(Option<usize>),
}

/// Whether a point with these hits lies in the part that it came into with this known. Where it lies in another one as well, its hit is of that part then.
fn stay(world: &World, tissue: &Tissue<'_>, place_m: [f32; 3], hits: &mut [Hit], known: &Memory) -> Stay {
    let owner = known.part.owner();
    let is_of_owner = |tet: u32| tissue.tet_owner.get(tet as usize) == Some(&owner);
    let Some(at) = hits.iter().position(|hit| is_of_owner(hit.tet)) else { return Stay::Past(None) };
    let Some(tet) = known.part.tet().filter(|tet| is_of_owner(*tet)) else { return Stay::In };
    match came(tissue, &world.topology, [tet, hits[at].tet], (place_m, known.direction)) {
        Came::Within => Stay::In,
        Came::Beside(tet, weights) => {
            hits[at] = Hit { tet, weights, ..hits[at] };
            Stay::In
        }
        Came::Through => Stay::Past(Some(at)),
    }
}

/// The part that a face bounds.
fn part_of(world: &World, crossing: &Crossing) -> Part {
    let (topology, triangle) = (&world.topology, crossing.triangle as usize);
    Part::of(topology.boundary_owner[triangle], Some(topology.boundary_tet[triangle]))
}

/// The face by which a point went into what it has passed, among these triangles: the first of its object on the way back that bounds the part which it knows.
/// If none does, it is the first one at all; but none where the point lies in a tet behind that part, for it is pushed out of that already.
fn face_of(
    world: &World,
    tissue: &Tissue<'_>,
    (missed, behind): (&Missed, Option<u32>),
    from: Vec3,
    near: &[u32],
) -> Option<Crossing> {
    let (topology, out) = (&world.topology, missed.out.to_array());
    let (from_m, to_m) = (from.to_array(), (from + missed.out * missed.reach_m).to_array());
    // Where the way does not lead out of what it lies in, no face on it can be told from those of that.
    let exit = match behind {
        Some(behind) => Some(exit_of(tissue, topology, behind, (from_m, out, missed.reach_m))?.face.0),
        None => None,
    };
    let is_of_part = |crossing: &Crossing| {
        let tet = topology.boundary_tet[crossing.triangle as usize];
        let at_m = (from + missed.out * (crossing.fraction * missed.reach_m)).to_array();
        let came_from = |known: u32| came(tissue, topology, [known, tet], (at_m, out)) == Came::Within;
        missed.part.tet().is_none_or(came_from) && exit.is_none_or(|exit| !touch(tissue, [exit, tet]))
    };
    let (mut others, mut first, owner) = ([NONE; MOST_FACES], None, missed.part.owner());
    let mut count = 0;
    while count < MOST_FACES {
        let is_other = |triangle: &u32| others[..count].contains(triangle);
        let is_of_owner = |triangle: &u32| topology.boundary_owner[*triangle as usize] == owner;
        let among = near.iter().copied().filter(|triangle| is_of_owner(triangle) && !is_other(triangle));
        let crossing = first_crossing(from_m, to_m, Sense::Out, tissue.positions_m, &topology.boundary, among);
        let Some(crossing) = crossing else { break };
        if is_of_part(&crossing) {
            return Some(crossing);
        }
        first = first.or(Some(crossing));
        others[count] = crossing.triangle;
        count += 1;
    }
    first.filter(|_| behind.is_none())
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
