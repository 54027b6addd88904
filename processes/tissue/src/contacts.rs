//! From hits to springs for the deformation, forces on the tool, and planes for the servo.
//!
//! Promise: the force on the tool is what the tissue got. A contact is a law that the deformation evaluates in every substep, with what it is softened by
//! there, and the force on the tool is what the same law does to the state that the step wrote. The hand is told less: what the springs push and the jaws
//! pull with, as it is felt at the tip by the lever about the pivot, and the coefficient of friction, by which the servo holds the tip back along the planes.
//! Damping is the tissue's alone.

mod stuck;

use crate::through::{Passage, Through};
use crate::tool::Stand;
use crate::world::{TOOL_ID, World};
use glam::Vec3;
use hyst_contact::{
    ContactForce, Gap, HITS_OF_A_POINT, HashMut, HashRef, HashSizes, Hit, Layout, Memory, NONE, Penetration, PenetrationInput,
    PenetrationParams, PlaneInput, PlaneParams, PlaneSet, Points, Retreat, Source, Tissue, Workspace, find_gaps, leads_out,
    own_face, penetration, planes,
};
use hyst_engine::Failure;
use hyst_messages::Pose;
use hyst_tissue::{ContactLaw, Hold, PairSpring, PlaneSpring, Scratch, StateRef, gather};
use stuck::Pressed;
pub use stuck::Stuck;

/// Contact stiffness per area, N/m³: a tip of 5 mm diameter (20 mm²) is met with about 1.5 kN/m, several times stiffer than tissue of 30 kPa
/// under it, so that the tissue yields and not the contact.
pub const STIFFNESS_N_M3: f32 = 7.5e7;
/// The same between tissue and tissue, N/m³: several times that of 30 kPa under a contact of 5 mm.
const TISSUE_STIFFNESS_N_M3: f32 = 1.0e7;
/// No node is pushed out of other tissue from deeper than this, m: what got so deep comes out slowly.
const MAX_TISSUE_DEPTH_M: f32 = 0.003;
/// No tool point is taken deeper than this, m: a thick wall.
const MAX_DEPTH_M: f32 = 0.02;
/// No point of the loop is pushed out from deeper than this, m: a cut that ends in tissue leaves the wire there, and it comes out with some newtons, which grow
/// from nothing once it is cold ([`ToolMotion::soft_m`]).
pub const MAX_LOOP_DEPTH_M: f32 = 0.003;
/// So much farther than it is beyond a part that it has passed a point of the tool pushes that, m: a thin one comes to lie before the point again, where its far
/// side is met as well.
const AHEAD_M: f32 = 3e-4;
/// Nothing sticks to the tool, or to other tissue, over a longer way, m.
const MOST_BENT_M: f32 = 0.02;
/// Range in which the servo knows a wall before it is met, m: 0.5 m/s for 4 ms.
const ANTICIPATION_M: f32 = 0.002;
/// Planes are nowhere stiffer than this together, N/m: some as stiff as the wall itself is under the tip, so that a hand that goes on while no tissue steps feels
/// about what the tissue would do (`main_loop/tests/blind.rs`). A device that can make nine tenths of its coupling as stiff as that feels all of the force.
const MOST_STIFFNESS_N_M: f32 = 500.0;

/// How contacts answer, those with the tool and those of tissue with tissue.
pub const LAW: ContactLaw = ContactLaw {
    damping_s: 6e-4,
    friction: 0.05, // wet mucosa slides, on metal and on itself
    most_n: 5.0,
};

/// Buffers of the contact part of a step, sized for a world.
pub struct Contacts {
    /// Of the tool's contacts, per area, N/m³: [`STIFFNESS_N_M3`], or many times that for who asks what the contact itself gives way.
    stiffness_n_m3: f32,
    work: Workspace,
    /// The tool's is part of the state; that of tissue is made of what the state says of its nodes ([`Stuck`]).
    memory: Vec<Memory>,
    found: Vec<Penetration>,
    /// What each spring does to the tool.
    forces: Vec<ContactForce>,
    node_force_n: Vec<[f32; 3]>,
    gaps: Vec<Gap>,
    /// Table of the tool's points alone: gaps are theirs, and pieces may float far from it.
    tool_table: Vec<u32>,
    /// Where the tool meets tissue.
    springs: Vec<PlaneSpring>,
    /// Whether the friction of each is the one that its point remembers: a point may be in two objects.
    remembers: Vec<bool>,
    /// Where tissue meets other tissue, and what each node remembers of that.
    pairs: Vec<PairSpring>,
    pressed: Vec<Pressed>,
    /// What the tool went through.
    through: Through,
}

/// The tool in one step.
#[derive(Clone, Copy, Debug)]
pub struct ToolMotion<'a> {
    /// All points where they are, m.
    pub points_m: &'a [[f32; 3]],
    /// Where it was before, and how its working element stood.
    pub before: (&'a Pose, Stand),
    /// How long ago that was, s: so fast each of its points goes.
    pub since_s: f32,
    /// What part of the way since then is made in this step: all of it, but where a tick is computed in several steps.
    pub way_share: f32,
    /// Tip, m.
    pub tip_m: [f32; 3],
    /// From tip to pivot, any length.
    pub back: [f32; 3],
    /// How it is turned.
    pub orientation: [f32; 4],
    /// Objects that its jaws do not meet, because they lie between them.
    pub spared: &'a [u32],
    /// How much less deep than that a loop is pushed out from, because it cuts or has just cut, m: up to all of it.
    pub soft_m: f32,
}

/// Tissue as the contact crate sees it.
pub fn tissue<'a>(world: &'a World, positions_m: &'a [[f32; 3]]) -> Tissue<'a> {
    Tissue { positions_m, tets: world.model.tets(), tet_owner: &world.body.rest.regions }
}

/// Depth of a node in other tissue, m, the way out, and whether that is to be remembered. What has just met is behind a face of the very tet that holds it, or
/// beside a node of the surface; surfaces that coincide, as those of a fresh cut, do not push each other. What remembers its way out (`before`) is pushed to no
/// other side, however near a face or a node there is, unless that way is farther than anything is pushed out from: then it has come from one wall of a
/// shut cavity into the other one, and would be pushed on through that. A way out is remembered once a face of the tet says the same.
fn way_out(
    world: &World,
    tissue: &Tissue<'_>,
    found: &Penetration,
    point_m: [f32; 3],
    before: Option<Vec3>,
) -> (f32, [f32; 3], bool) {
    let leads_back = |way: &Vec3| leads_out(tissue, &world.topology, found.tet, (point_m, way.to_array(), MAX_TISSUE_DEPTH_M));
    let before = before.filter(leads_back);
    let direction = Vec3::from(found.direction);
    let direction = before.filter(|before| before.dot(direction) < 0.0).unwrap_or(direction);
    let deep = (found.depth_m.min(MAX_TISSUE_DEPTH_M), direction.to_array());
    let own = own_face(tissue, &world.topology, found.tet, &found.weights, before.map(|before| before.to_array()));
    let (depth_m, normal) = own.filter(|own| own.0 < deep.0).unwrap_or(deep);
    let is_sure = before.is_some() || own.is_some_and(|own| Vec3::from(own.1).dot(Vec3::from(normal)) > 0.0);
    let nodes = world.model.tets().get(found.tet as usize).into_iter().flatten().map(|node| *node as usize);
    let of_surface = nodes.filter(|node| world.points.is_surface[*node]);
    let ways = of_surface.map(|node| Vec3::from(tissue.positions_m[node]) - Vec3::from(point_m));
    let out = ways.filter(|way| before.is_none() || way.dot(Vec3::from(normal)) >= 0.0);
    (out.map(Vec3::length).fold(depth_m, f32::min), normal, is_sure)
}

/// How deep a point of the tool is taken to be at most, m: of a loop that is so soft, or of the rest of it.
fn most_depth_m(is_loop: bool, soft_m: f32) -> f32 {
    if is_loop { MAX_LOOP_DEPTH_M - soft_m } else { MAX_DEPTH_M }
}

/// How far the state says that something is bent, m: one that was damaged may say anything.
fn believed_m(bent_m: [f32; 3]) -> Vec3 {
    let bent_m = Vec3::from(bent_m);
    if bent_m.length() <= MOST_BENT_M { bent_m } else { Vec3::ZERO }
}

impl Contacts {
    /// Buffers for a world.
    pub fn new(world: &World) -> Contacts {
        Contacts::stiffer(world, 1.0)
    }

    /// The same with contacts of the tool that are so many times as stiff.
    pub fn stiffer(world: &World, stiffer: f32) -> Contacts {
        let mut contacts = Contacts {
            stiffness_n_m3: stiffer * STIFFNESS_N_M3,
            work: Workspace::default(),
            memory: Vec::new(),
            found: Vec::new(),
            forces: Vec::new(),
            node_force_n: Vec::new(),
            gaps: Vec::new(),
            tool_table: Vec::new(),
            springs: Vec::new(),
            remembers: Vec::new(),
            pairs: Vec::new(),
            pressed: Vec::new(),
            through: Through::default(),
        };
        contacts.fit(world);
        contacts
    }

    /// Goes on with another world, with what memory there is: a cut adds few points to some thousand. A step reads nothing that it has not written.
    pub fn fit(&mut self, world: &World) {
        let (points, nodes, tool) = (world.points.len(), world.model.node_count(), world.points.tool);
        let hits = max_hits(world);
        let contacts = hits + tool;
        self.work.fit(points, hits, nodes);
        self.memory.resize(points, Memory::default());
        self.found.resize(contacts, Penetration::default());
        self.forces.clear();
        self.forces.reserve(contacts);
        self.node_force_n.clear();
        self.node_force_n.resize(nodes, [0.0; 3]);
        self.gaps.resize(tool, Gap::FAR);
        self.tool_table.resize(HashSizes::for_points(tool).words(), 0);
        self.springs.clear();
        self.springs.reserve(contacts);
        self.remembers.clear();
        self.remembers.reserve(contacts);
        self.pairs.clear();
        self.pairs.reserve(hits);
        self.pressed.clear();
        self.pressed.reserve(hits);
        self.through.fit(world);
    }

    /// Depth and direction of each hit; the springs that the deformation feels. `memory` is that of the tool's points, `stuck` what the nodes stick to, if
    /// anybody remembers.
    pub fn meet(
        &mut self,
        world: &World,
        hits: &[Hit],
        (tool, passage): (&ToolMotion<'_>, &Passage<'_>),
        positions_m: &[[f32; 3]],
        (memory, stuck): (&mut [Memory], &[Stuck]),
    ) -> Result<(), Failure> {
        let broken = |error: hyst_contact::ContactError| Failure::Broken(error.to_string());
        let tissue = tissue(world, positions_m);
        let points = world.points.view(&world.body.rest.positions_m);
        let graph = &world.points.graph;
        let input = PenetrationInput { hits, points_m: tool.points_m, points, graph, tissue, topology: &world.topology };
        let retreats = [Retreat { owner: TOOL_ID, direction: tool.back }];
        let params = PenetrationParams { max_depth_m: MAX_DEPTH_M, retreats: &retreats, spared: tool.unmet(world) };
        let (of_tool, of_tissue) = self.memory.split_at_mut(world.points.tool);
        if memory.len() != of_tool.len() {
            return Err(Failure::Broken(format!("the state remembers {} points of {}", memory.len(), of_tool.len())));
        }
        of_tool.copy_from_slice(memory);
        stuck::recall(world, stuck, of_tissue);
        self.through.look(world, hits, (tool, passage), &tissue, of_tool)?;
        let found = penetration(&input, &params, &mut self.memory, &mut self.work, &mut self.found).map_err(broken)?.count;
        let of_tool = &mut self.memory[..world.points.tool];
        let held = self.through.hold(world, tool, &tissue, of_tool, &mut self.found[found..]);
        memory.copy_from_slice(of_tool);
        self.node_force_n.fill([0.0; 3]);
        self.spring(world, tool, (positions_m, stuck), found + held);
        Ok(())
    }

    /// The springs of what was found. The tool's points come first.
    fn spring(&mut self, world: &World, tool: &ToolMotion<'_>, (positions_m, stuck): (&[[f32; 3]], &[Stuck]), found: usize) {
        let tissue = tissue(world, positions_m);
        self.springs.clear();
        self.remembers.clear();
        self.forces.clear();
        self.pairs.clear();
        self.pressed.clear();
        for found in &self.found[..found] {
            let Some(nodes) = world.model.tets().get(found.tet as usize) else { continue };
            if tool.spares(world, found.point, tissue.tet_owner.get(found.tet as usize)) {
                continue;
            }
            let (point, area_m2) = (tool.points_m[found.point as usize], world.points.area_m2[found.point as usize]);
            let weights = found.weights.map(|w| w.clamp(0.0, 1.0));
            let at = gather(*nodes, weights, positions_m).map_or(Vec3::ZERO, Vec3::from);
            if let Some(node) = world.points.node.get(found.point as usize).copied().filter(|node| *node != NONE) {
                let owner = tissue.tet_owner.get(found.tet as usize).copied().unwrap_or(NONE);
                if !world.points.is_pushed_by(found.point as usize, owner) {
                    continue;
                }
                let known = Stuck::of(stuck, node, owner);
                let (depth_m, normal, is_sure) = way_out(world, &tissue, found, point, known.and_then(Stuck::way_back));
                let stiffness_n_m = TISSUE_STIFFNESS_N_M3 * area_m2;
                let sticks_at_m = (Vec3::from(point) - at + known.map_or(Vec3::ZERO, Stuck::way_m)).to_array();
                self.pairs.push(PairSpring { node, tet: *nodes, weights, normal, depth_m, sticks_at_m, stiffness_n_m });
                let (out, is_known) = (if is_sure { normal } else { [0.0; 3] }, known.is_some());
                self.pressed.push(Pressed { owner, out, is_known });
            } else if (found.point as usize) < world.case.tool.pads {
                let normal = found.direction.map(|c| -c);
                // What has passed a part meets it where it went in, and anything else where it is.
                let is_held = found.source == Source::Held as u32;
                let (met_at, ahead_m) = if is_held { (at.to_array(), AHEAD_M.min(found.depth_m)) } else { (point, 0.0) };
                let along: f32 = normal.iter().zip(met_at).map(|(n, p)| n * p).sum();
                let is_loop = found.point as usize >= world.case.tool.shaft;
                let depth_m = (found.depth_m + ahead_m).min(most_depth_m(is_loop, tool.soft_m));
                let (offset_m, stiffness_n_m) = (along + depth_m, self.stiffness_n_m3 * area_m2);
                let velocity_m_s = self.through.velocity_m_s(found.point as usize, tool);
                let remembered = self.remembered(&tissue, found);
                let way_m = self.through.way_m(found.point as usize, tool);
                let sticks_at_m = (at + remembered.unwrap_or_default() + way_m).to_array();
                self.remembers.push(remembered.is_some());
                self.springs.push(PlaneSpring {
                    nodes: *nodes,
                    weights,
                    normal,
                    offset_m,
                    velocity_m_s,
                    sticks_at_m,
                    stiffness_n_m,
                });
                let (place_m, direction) = (point, found.direction);
                let force = ContactForce { point: found.point, owner: TOOL_ID, place_m, direction, ..ContactForce::default() };
                self.forces.push(force);
            }
        }
    }

    /// How far what sticks to a point of the tool was bent along this tissue, m; `None` where the point remembers other tissue.
    fn remembered(&self, tissue: &Tissue<'_>, found: &Penetration) -> Option<Vec3> {
        let owner = tissue.tet_owner.get(found.tet as usize);
        let memory = self.memory.get(found.point as usize).filter(|memory| owner == Some(&memory.owner))?;
        Some(believed_m(memory.bent_m))
    }

    /// Springs of the step, where the tool meets tissue.
    pub fn springs(&self) -> &[PlaneSpring] {
        &self.springs
    }

    /// Springs of the step, where tissue meets other tissue.
    pub fn pairs(&self) -> &[PairSpring] {
        &self.pairs
    }

    /// Forces on the nodes beside the springs, N, to which others may add.
    pub fn node_force_n(&mut self) -> &mut [[f32; 3]] {
        &mut self.node_force_n
    }

    /// Forces on the nodes beside the springs, N.
    pub fn forces_n(&self) -> &[[f32; 3]] {
        &self.node_force_n
    }

    /// Contacts of the tool in the step.
    pub fn count(&self) -> usize {
        self.springs.len()
    }

    /// The planes for the servo, which are felt at the tip, and the force on the tool wherever it acts, from the tissue as it is after the step that
    /// `scratch` has made, with what the tool holds. What sticks to its points is remembered in `memory`, which is that of the tool's points, and what tissue
    /// sticks to in `stuck`, which is that of the nodes.
    pub fn planes(
        &mut self,
        world: &World,
        hash: &HashRef<'_>,
        (tool, holds): (&ToolMotion<'_>, &[Hold]),
        (memory, stuck): (&mut [Memory], &mut [Stuck]),
        after: &StateRef<'_>,
        scratch: &Scratch,
    ) -> Result<(PlaneSet, [f32; 3]), Failure> {
        let mut total = [0.0f32; 3];
        self.forces.truncate(self.springs.len());
        for ((spring, force), remembers) in self.springs.iter().zip(&mut self.forces).zip(&self.remembers) {
            let push = scratch.push(&world.model, &LAW, spring, after);
            (force.normal_n, force.stiffness_n_m) = (push.normal_n, push.stiffness_n_m);
            if let Some(memory) = memory.get_mut(force.point as usize).filter(|_| *remembers) {
                memory.bent_m = push.bent_m;
            }
            total.iter_mut().zip(push.force_n).for_each(|(sum, part)| *sum -= part);
        }
        for hold in holds {
            let pull = scratch.pull(&world.model, &LAW, hold, after);
            let at = gather(hold.nodes, hold.weights, after.position_m).map(Vec3::from);
            // The tool is drawn to where the tissue is.
            let direction = at.map_or(Vec3::ZERO, |at| (at - Vec3::from(hold.place_m)).normalize_or_zero()).to_array();
            let (place_m, normal_n, stiffness_n_m) = (hold.place_m, pull.normal_n, pull.stiffness_n_m);
            let force = ContactForce { owner: TOOL_ID, place_m, direction, normal_n, stiffness_n_m, ..ContactForce::default() };
            self.forces.push(force);
            total.iter_mut().zip(pull.force_n).for_each(|(sum, part)| *sum -= part);
        }
        self.remember(world, after, scratch, stuck);
        let tissue = tissue(world, after.position_m);
        let broken = |error: hyst_contact::ContactError| Failure::Broken(error.to_string());
        let count = world.points.tool;
        let (owner, area_m2) = (&world.points.owner[..count], &world.points.area_m2[..count]);
        let points = Points { owner, node: &[], own: None };
        if world.points.len() == count {
            find_gaps(hash, &points, &tissue, &world.topology, ANTICIPATION_M, &mut self.gaps).map_err(broken)?;
        } else {
            let mut table = HashMut::in_words(&mut self.tool_table, HashSizes::for_points(count)).map_err(broken)?;
            table.build(&tool.points_m[..count], world.case.cell_m, Layout::Auto).map_err(broken)?;
            find_gaps(&table.as_ref(), &points, &tissue, &world.topology, ANTICIPATION_M, &mut self.gaps).map_err(broken)?;
        }
        // The face that is nearest to a point that is held is the wrong one.
        self.through.held().iter().for_each(|point| self.gaps[*point as usize] = Gap::FAR);
        for (point, gap) in (0..).zip(&mut self.gaps) {
            if tool.spares(world, point, world.topology.boundary_owner.get(gap.triangle as usize)) {
                *gap = Gap::FAR;
            }
        }
        let input = PlaneInput {
            contacts: &self.forces,
            gaps: &self.gaps,
            points_m: &tool.points_m[..count],
            owner,
            point_area_m2: area_m2,
            tip_m: tool.tip_m,
            pivot_m: Some(world.case.pivot_m),
            tool: TOOL_ID,
        };
        let params =
            PlaneParams { range_m: ANTICIPATION_M, stiffness_n_m3: self.stiffness_n_m3, most_stiffness_n_m: MOST_STIFFNESS_N_M };
        Ok((planes(&input, &params), total))
    }
}

/// Room for hits: each point in at most two objects. Nobody's share may have more.
pub fn max_hits(world: &World) -> usize {
    HITS_OF_A_POINT * world.points.len()
}

#[cfg(test)]
mod tests;
