//! What the jaws hold: points of the tissue that both of them met when they closed, each drawn to where its pad is, until they open or it slips out.
//!
//! Promise: what is held is in the state (its eighth section), so that whoever goes on from one holds the same; jaws that have taken hold stand as far apart as
//! then, as one sees them, until they have opened so far again, and so long what they took hold of, unless it is an organ, meets their pads alone: nothing is
//! pressed out from between them or thrown by them, and all else meets them where they stand. What slips, or is no tissue any more, is let go: by how far it
//! has been drawn from its pad in a step, and not by how far the pad goes in the next one, unless that jumps. And jaws that open let go, be it ever so slowly:
//! at once, or where they no longer touch what they took hold of.

use crate::contacts::{STIFFNESS_N_M3, ToolMotion};
use crate::state::Core;
use crate::through::{has_moved, velocity_m_s};
use crate::tool::{Stand, Tool};
use crate::world::World;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use hyst_contact::{Hit, NONE, Spared};
use hyst_messages::stream::ObjectKind;
use hyst_messages::{Controls, Pose};
use hyst_tissue::{Hold, gather};
use std::ops::Range;

/// What a step leaves so far from its pad slips out in the next one, m: jaws of 9 mm hold a soft polyp with some 0.6 N. Assumed; no published figure is used.
const SLIP_M: f32 = 1.5e-3;
/// Jaws that are farther apart than a step before by more than this open, m: more than a hand trembles, or two steps of a converter of 10 bits are.
const OPENS_M: f32 = 2e-5;
/// Jaws that are farther apart than when they took hold by more than this have opened, however slowly, m: what both of them touched then lies loose.
const OPENED_M: f32 = 1e-4;

/// Added to the number of a pad that has let go of what lies between the jaws still.
const LET_GO: u32 = 1 << 31;

/// A point that is held, or was and lies between the jaws still, as the state has it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Grip {
    /// The pad that holds it, counted from 1; with the highest bit, the one that has let go of it. 0 for none.
    pub pad: u32,
    /// Nodes of the tet that it lies in.
    pub nodes: [u32; 4],
    /// Its weights there, 0 to 1 with the sum 1.
    pub weights: [f32; 4],
}

impl Grip {
    fn is_held(&self) -> bool {
        self.pad & LET_GO == 0
    }
}

/// Bytes of what jaws hold at most.
pub fn most_bytes(tool: &Tool) -> usize {
    (tool.points_m.len() - tool.pads) * size_of::<Grip>()
}

/// How far jaws are apart by the controls, m; as before where those say nothing.
pub fn apart_m(tool: &Tool, controls: &Controls, before_m: f32) -> f32 {
    let most_m = tool.jaws().map_or(0.0, |jaws| jaws.opening_m);
    Some(controls.loop_extension_m).filter(|apart_m| apart_m.is_finite()).unwrap_or(before_m).clamp(0.0, most_m)
}

/// What a section of a state says that is held, or was; nothing of what makes no sense.
fn known(section: &[u8]) -> impl Iterator<Item = Grip> {
    let grips = section.chunks_exact(size_of::<Grip>()).map(bytemuck::pod_read_unaligned::<Grip>);
    grips.filter(|grip| grip.pad > 0 && grip.weights.iter().all(|weight| (0.0..=1.0).contains(weight)))
}

/// What the jaws hold in a step.
#[derive(Debug, Default)]
pub struct Grasp {
    /// What they hold, and what they have let go of and not opened for since.
    grips: Vec<Grip>,
    holds: Vec<Hold>,
    /// How far the jaws are to be apart, m.
    apart_m: f32,
    /// How far they were when they took hold, m, which they are at least until they have opened so far again; 0 of such that have.
    hold_m: f32,
    /// Whether the pads look what lies between the jaws.
    looks: bool,
}

impl Grasp {
    /// Goes on with what a state holds in a step in which the tool is at a pose and its jaws are to be so far apart; gives how they stand in it.
    pub fn go_on(
        &mut self,
        world: &World,
        (section, before): (&[u8], &Core),
        (pose, apart_m): (&Pose, f32),
        positions_m: &[[f32; 3]],
    ) -> Stand {
        self.grips.clear();
        (self.apart_m, self.hold_m, self.looks) = (apart_m, 0.0, false);
        let tool = &world.case.tool;
        let Some(jaws) = tool.jaws() else { return Stand::default() };
        // A state that was damaged may say more than they can open again.
        let before_m = before.hold_m.min(jaws.opening_m);
        let stays_shut = apart_m <= (before.loop_m + OPENS_M).min(before_m + OPENED_M);
        // Where the pads were in the state: its tissue was drawn to there. What is held by one that jumps would be flung after it.
        let [at, next] = [&before.pose, pose].map(|pose| pad_placer(tool, pose));
        let is_near = |grip: &Grip| {
            let point = gather(grip.nodes, grip.weights, positions_m).map(Vec3::from);
            let pads = at(grip.pad).zip(next(grip.pad)).filter(|(pad, next)| has_moved(*pad, *next));
            pads.zip(point).is_some_and(|((pad, _), point)| pad.distance(point) <= SLIP_M)
        };
        let gone_on = |grip: Grip| if stays_shut && is_near(&grip) { grip } else { Grip { pad: grip.pad | LET_GO, ..grip } };
        self.grips.extend(known(section).map(gone_on));
        if self.grips.iter().any(Grip::is_held) || apart_m < before_m {
            self.hold_m = before_m;
        } else {
            self.grips.clear();
            self.looks = apart_m < before.loop_m;
        }
        Stand { solid_m: Some(apart_m.max(self.hold_m)), looks: self.looks }
    }

    /// Forgets what is no tissue of a world any more. Gives the objects between the jaws that meet their pads alone: all but organs, which are around the jaws,
    /// too, and go on being met as they were when the jaws took hold.
    pub fn keep_tissue(&mut self, world: &World) -> Vec<u32> {
        let object = |node: &u32| world.points.of_tets.object_of.get(*node as usize).copied().unwrap_or(NONE);
        self.grips.retain(|grip| grip.nodes.iter().all(|node| object(node) != NONE));
        let is_organ = |object: &u32| {
            let record = world.objects.get(*object as usize);
            record.is_some_and(|record| record.kind == ObjectKind::Organ as u32)
        };
        let between = self.grips.iter().map(|grip| object(&grip.nodes[0]));
        let mut spared: Vec<u32> = between.filter(|object| !is_organ(object)).collect();
        spared.sort_unstable();
        spared.dedup();
        spared
    }

    /// Takes hold of the tissue that pads were found in, if they look; draws what is held to where the pads are of a tool that came from one pose to another in
    /// some time, s, and writes it into its section.
    pub fn act(&mut self, world: &World, hits: &[Hit], (poses, since_s): ([&Pose; 2], f32), section: &mut [u8]) {
        if self.looks {
            self.take(world, hits);
        }
        self.hold(&world.case.tool, poses, since_s);
        section.fill(0);
        for (place, grip) in section.chunks_exact_mut(size_of::<Grip>()).zip(&self.grips) {
            place.copy_from_slice(bytemuck::bytes_of(grip));
        }
    }

    /// What lies at the pads of an object that both jaws have met.
    fn take(&mut self, world: &World, hits: &[Hit]) {
        let [right, left, pads] = world.case.tool.parts();
        let object = |hit: &Hit| world.body.rest.regions.get(hit.tet as usize);
        let of = |part: &Range<usize>| {
            let part = part.clone();
            hits.iter().filter(move |hit| part.contains(&(hit.point as usize)))
        };
        let is_met = |hit: &Hit| [&right, &left].into_iter().all(|jaw| of(jaw).any(|other| object(other) == object(hit)));
        for hit in of(&pads).filter(|hit| is_met(hit)) {
            let pad = (hit.point as usize - pads.start) as u32 + 1;
            let Some(nodes) = world.model.tets().get(hit.tet as usize) else { continue };
            // One that lies in two objects holds the first of them.
            if self.grips.last().is_none_or(|last| last.pad != pad) {
                self.hold_m = self.apart_m;
                self.grips.push(Grip { pad, nodes: *nodes, weights: hit.weights.map(|weight| weight.clamp(0.0, 1.0)) });
            }
        }
    }

    fn hold(&mut self, tool: &Tool, poses: [&Pose; 2], since_s: f32) {
        self.holds.clear();
        let [before, now] = poses.map(|pose| pad_placer(tool, pose));
        let stiffness_n_m = STIFFNESS_N_M3 * tool.jaws().map_or(0.0, |jaws| jaws.pad_area_m2);
        for grip in self.grips.iter().filter(|grip| grip.is_held()) {
            if let Some((from, place)) = before(grip.pad).zip(now(grip.pad)) {
                let (nodes, weights, place_m) = (grip.nodes, grip.weights, place.to_array());
                let velocity_m_s = velocity_m_s(from.to_array(), place_m, since_s);
                self.holds.push(Hold { nodes, weights, place_m, velocity_m_s, stiffness_n_m });
            }
        }
    }

    /// What is held in the step.
    pub fn holds(&self) -> &[Hold] {
        &self.holds
    }

    /// How many points are held, and how far the jaws were apart when they took hold, m.
    pub fn held(&self) -> (usize, f32) {
        (self.grips.iter().filter(|grip| grip.is_held()).count(), self.hold_m)
    }

    /// Objects of which something is held.
    pub fn objects<'a>(&'a self, world: &'a World) -> impl Iterator<Item = u32> + 'a {
        let held = self.grips.iter().filter(|grip| grip.is_held());
        held.filter_map(|grip| world.points.of_tets.object_of.get(grip.nodes[0] as usize).copied())
    }
}

impl ToolMotion<'_> {
    /// What a jaw does not meet: whatever lies between the jaws.
    pub fn unmet(&self, world: &World) -> Spared<'_> {
        Spared { points: [world.case.tool.shaft, world.case.tool.pads].map(|point| point as u32), objects: self.spared }
    }

    /// Whether a point of the tool does not meet an object.
    pub fn spares(&self, world: &World, point: u32, object: Option<&u32>) -> bool {
        object.is_some_and(|object| self.unmet(world).holds(point, *object))
    }
}

/// Where a pad is, counted from 1, of a tool at a pose, m.
fn pad_placer(tool: &Tool, pose: &Pose) -> impl Fn(u32) -> Option<Vec3> {
    let at = tool.placer(pose, Stand { solid_m: None, looks: true });
    let [.., pads] = tool.parts();
    move |pad| {
        let index = pads.start + (pad as usize).checked_sub(1)?;
        pads.contains(&index).then(|| at(index).into())
    }
}
