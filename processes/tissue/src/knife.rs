//! The electrode in the Main Loop: where the wire is, what it has swept since it last cut, and what that leaves.
//!
//! What a stroke needs to go on is in the state (its sixth section): the wire as the tissue saw it last, and the nodes on the sheet. So a tissue that is
//! killed in the middle of a cut is followed by one that goes on with it. A stroke that has swept less than [`STEP_M`] since its last cut waits:
//! that decides by the state alone, too. A wire that has come more than [`FARTHEST_M`] since then has jumped, and begins another stroke where it is.
//! Under the current that coagulates the wire cuts nothing, and is as solid as a cold one. One that has just cut becomes that by and by.

#[cfg(test)]
pub(crate) mod tests;

use crate::body::{Body, Piece, Room};
use crate::contacts::MAX_LOOP_DEPTH_M;
use crate::volumes::Volumes;
use crate::world::{Case, Coming, Held, Trailing, World};
use glam::{Quat, Vec3};
use hyst_mesh::{TetMesh, component_of_each_tet};
use hyst_messages::stream::ObjectRecord;
use hyst_messages::{Controls, Pose};
use hyst_scene::{LEAST_PART_M3, LoadedLoop};
use hyst_tissue::{Cut, CutError, CutOptions, Cuttable, LooseSkin, Objects, Seat, Skin, cut_and_bind, keep_momentum};

/// Way of the wire in the tissue after which it cuts, m: a sixth of an edge of the scene's meshes. Each cut costs the tick in which it is made, and a
/// loop is drawn at some 20 mm/s.
const STEP_M: f64 = 0.5e-3;
/// Longest way of the wire from one cut to the next, m: that of a hand of 1 m/s in a step of 4 ms, and what it may have waited with. The device takes a tip
/// that comes farther at once for one that has jumped, and believes it where it stays, with the current on.
const FARTHEST_M: f64 = 5e-3;
/// How much deeper a wire that has cut is pushed out from with each second, m/s: ring and 5 mm of the arms of the default loop are met with 1 800 N/m, of which
/// come 0.027 N in a tick then, less than the 0.04 that a servo lets a model change the force by.
const HARDENS_M_S: f32 = 0.015;
/// Below this the loop is in its sheath, m.
const LEAST_EXTENSION_M: f32 = 1e-3;

/// How far the loop is out, m, and whether it cuts; `None` in its sheath.
fn out_m(electrode: &LoadedLoop, controls: &Controls) -> Option<(f32, bool)> {
    let out_m = Some(controls.loop_extension_m).filter(|out_m| out_m.is_finite())?.min(electrode.reach_m);
    (out_m >= LEAST_EXTENSION_M).then_some((out_m, controls.cuts()))
}

/// Where the wire is, m, if it cuts.
pub fn wire_m(electrode: Option<&LoadedLoop>, pose: &Pose, controls: &Controls) -> Option<Vec<[f32; 3]>> {
    let electrode = electrode?;
    let (out_m, cuts) = out_m(electrode, controls)?;
    let (tip, turn) = (Vec3::from(pose.position_m), Quat::from_array(pose.orientation));
    let place = |point: [f32; 3]| (tip + turn * Vec3::from(point)).to_array();
    cuts.then(|| electrode.wire_at(out_m).map(place).collect())
}

/// How far the loop is out, m, where it is solid; 0 in its sheath, and while it cuts.
pub fn solid_m(electrode: Option<&LoadedLoop>, controls: &Controls) -> f32 {
    let out = electrode.and_then(|electrode| out_m(electrode, controls));
    out.filter(|(_, cuts)| !cuts).map_or(0.0, |(out_m, _)| out_m)
}

/// How much less deep than a cold one a loop is pushed out from, m: one that cuts is not at all, and one that has cut ever deeper, from what it was so long
/// before on.
pub fn soft_m(electrode: Option<&LoadedLoop>, controls: &Controls, before_m: f32, since_s: f32) -> f32 {
    let cuts = electrode.and_then(|electrode| out_m(electrode, controls)).is_some_and(|(_, cuts)| cuts);
    if cuts { MAX_LOOP_DEPTH_M } else { (before_m - HARDENS_M_S * since_s).max(0.0) }
}

/// Longest stroke section of a state, bytes.
pub fn most_stroke_bytes(room: &Room) -> usize {
    hyst_tissue::MAX_WIRE_POINTS * size_of::<Seat>() + room.nodes * 12
}

/// What a step of the wire did.
#[derive(Debug)]
pub enum Stroke {
    /// There is none.
    None,
    /// It goes on, and the mesh and its surface are what they were.
    GoesOn {
        /// Something was left out of a cut because there was no room for it.
        is_limited: bool,
    },
    /// The mesh is another one, or its surface alone: where that is finer than the tets the wire divides it before it meets an edge of them.
    Cut {
        /// What it is now; without its surface where that is still to come.
        body: Box<Body>,
        /// What holds that.
        held: Held,
        /// The objects that the cut made in it.
        parted: Vec<Piece>,
        /// The surface that is to come: what of it finds no room is known then.
        trailing: Option<Box<Trailing>>,
        /// As above.
        is_limited: bool,
    },
}

/// The tissue as it is cut, kept for its buffers.
#[derive(Default)]
pub struct Knife {
    tissue: Cuttable,
}

impl Knife {
    /// Ends the stroke: the next one begins a sheet of its own.
    pub fn end(&mut self) {
        self.tissue.wire.clear();
    }

    /// Where the nodes are after a cut, m, and how fast, m/s.
    pub fn moved(&self) -> (&[[f32; 3]], &[[f32; 3]]) {
        (&self.tissue.position_m, &self.tissue.velocity_m_s)
    }

    /// Gives what was cut the momentum that it had by the masses of the world before, whose nodes had these velocities. `parted` are the objects that the cut
    /// made.
    pub fn keep_momentum(&mut self, before: &World, after: &World, parted: &[Piece], velocity_m_s: &[[f32; 3]]) {
        let was: Vec<u32> = (0..after.body.origin.len() as u32).map(|object| was(parted, object)).collect();
        let [had, has] = [before, after].map(|world| Objects { model: &world.model, of_tet: &world.body.rest.regions });
        let Cuttable { velocity_m_s: moved_m_s, changed, .. } = &mut self.tissue;
        let was = |object: u32| was.get(object as usize).copied().unwrap_or(object);
        keep_momentum((&had, velocity_m_s), (&has, &mut moved_m_s[..]), changed, was);
    }

    /// Bytes of the stroke as a section of the state; none without one.
    pub fn stroke_bytes(&self) -> usize {
        let marks = if self.tissue.wire.is_empty() { 0 } else { self.tissue.marks.len() };
        self.tissue.wire.len() * size_of::<Seat>() + marks * 12
    }

    /// Writes the stroke into its section.
    pub fn write_stroke(&self, section: &mut [u8]) {
        let (seats, marks) = section.split_at_mut(self.tissue.wire.len() * size_of::<Seat>());
        seats.copy_from_slice(bytemuck::cast_slice(&self.tissue.wire));
        if !marks.is_empty() {
            marks.copy_from_slice(bytemuck::cast_slice(&self.tissue.marks));
        }
    }

    /// For who has the surface bound at once.
    #[cfg(test)]
    pub fn sweep(
        &mut self,
        world: &World,
        wire_m: Option<&[[f32; 3]]>,
        stroke: &[u8],
        nodes: (&[[f32; 3]], &[[f32; 3]]),
    ) -> Result<Stroke, CutError> {
        self.sweep_by(world, wire_m, stroke, nodes, Coming::at_once, || ())
    }

    /// Goes on with a stroke, or begins one, or ends it, for who may have the surface bound elsewhere, and wants to know when something is cut, and its parts
    /// are yet to be named. `stroke` is the section of the state that is read.
    ///
    /// # Errors
    /// What the cut refuses; the tissue is as before then, and the stroke is over.
    pub fn sweep_by(
        &mut self,
        world: &World,
        wire_m: Option<&[[f32; 3]]>,
        stroke: &[u8],
        (position_m, velocity_m_s): (&[[f32; 3]], &[[f32; 3]]),
        bind: impl FnOnce(LooseSkin, &TetMesh) -> Coming,
        passed: impl FnOnce(),
    ) -> Result<Stroke, CutError> {
        self.tissue.wire.clear();
        let Some(wire_m) = wire_m else { return Ok(Stroke::None) };
        let nodes = position_m.len();
        let (wire, marks) = stroke.split_at(stroke.len().saturating_sub(nodes * 12));
        self.tissue.marks.clear();
        match (bytemuck::try_cast_slice::<u8, Seat>(wire), bytemuck::try_cast_slice::<u8, [f32; 3]>(marks)) {
            // A bit that flipped ends the stroke.
            (Ok(wire), Ok(marks)) if marks.len() == nodes && wire.iter().all(Seat::is_finite) => {
                self.tissue.wire.extend_from_slice(wire);
                self.tissue.marks.extend_from_slice(marks);
            }
            _ => self.tissue.marks.resize(nodes, [0.0; 3]),
        }
        // How far the wire has come is asked in each step of a stroke, the rest only where it cuts.
        let tissue = &mut self.tissue;
        copy(&mut tissue.rest.tets, &world.body.rest.tets);
        tissue.position_m.clear();
        tissue.position_m.extend_from_slice(position_m);
        let swept_m = tissue.swept_m(wire_m);
        if swept_m < STEP_M {
            return Ok(Stroke::GoesOn { is_limited: false });
        }
        if swept_m > FARTHEST_M {
            tissue.end_stroke();
        }
        tissue.velocity_m_s.clear();
        tissue.velocity_m_s.extend_from_slice(velocity_m_s);
        copy_all(tissue, &world.body);
        world.note_tied(&mut tissue.keeps_place);
        let cut = cut_and_bind(tissue, wire_m, &options(&world.case.room), bind);
        let cut = cut.inspect_err(|_| self.tissue.wire.clear())?;
        if !cut.report.has_changed() {
            // Faces that stay closed are no limit: at the front of every cut there are some.
            let is_limited = cut.ended(&mut self.tissue, Coming::bound).out_of_room > 0;
            return Ok(Stroke::GoesOn { is_limited });
        }
        Ok(self.left(world, cut, passed))
    }

    /// What a cut has left of a world's body.
    fn left(&mut self, world: &World, cut: Cut<Coming>, passed: impl FnOnce()) -> Stroke {
        let tissue = &mut self.tissue;
        // A surface may come later where all that it lies at stays: nothing was burnt, and nothing will be for want of a number.
        let stays = cut.report.burnt_tets == 0 && world.body.origin.len() + cut.report.parts <= world.case.room.objects;
        let may_trail = stays && !tissue.part_of_tet.is_empty() && cut.skin.as_ref().is_some_and(Coming::is_beside);
        let (report, coming) = if may_trail { (cut.report, cut.skin) } else { (cut.ended(tissue, Coming::bound), None) };
        let mut body = handed_over(tissue, &world.body);
        passed();
        let tets = body.rest.tets.len();
        let known = std::mem::take(&mut tissue.part_of_tet);
        // The surface alone was divided where they are not known.
        let part_of_tet = if known.len() == tets { known } else { component_of_each_tet(&body.rest) };
        let coming = coming.map(|coming| (coming, body.rest.regions.clone()));
        let (parted, held) = register_parts(&world.case, &mut body, &part_of_tet);
        // For want of a number something was burnt, and nobody knows what that took along: what is left moves as it does.
        let is_short = body.rest.tets.len() < tets;
        if is_short {
            tissue.changed.clear();
        }
        let is_limited = report.out_of_room > 0 || is_short;
        let has_named = !parted.is_empty();
        let trailing = coming.map(|(coming, regions)| Trailing::new(coming, part_of_tet, has_named.then_some(regions)));
        Stroke::Cut { body: Box::new(body), held, parted, trailing: trailing.map(Box::new), is_limited }
    }
}

/// A list has room for one more of so many: most cuts add fewer.
const ADDED: usize = 8;

/// Copies a list that was handed over with the last cut, and makes room for what one adds, so that it is not copied once more for that.
fn copy<T: Copy>(to: &mut Vec<T>, from: &[T]) {
    to.clear();
    to.reserve(from.len() + from.len() / ADDED);
    to.extend_from_slice(from);
}

/// Copies what a cut may change of a body, all but the tets.
fn copy_all(tissue: &mut Cuttable, body: &Body) {
    copy(&mut tissue.rest.positions_m, &body.rest.positions_m);
    copy(&mut tissue.rest.regions, &body.rest.regions);
    copy(&mut tissue.material, &body.material);
    copy(&mut tissue.fixed, &body.fixed);
    let Skin { rest_m, triangles, bindings, raw } = &mut tissue.skin;
    copy(rest_m, &body.skin.rest_m);
    copy(triangles, &body.skin.triangles);
    copy(bindings, &body.skin.bindings);
    copy(raw, &body.skin.raw);
}

/// What a cut has left of a body, which takes the lists along.
fn handed_over(tissue: &mut Cuttable, before: &Body) -> Body {
    Body {
        rest: std::mem::take(&mut tissue.rest),
        material: std::mem::take(&mut tissue.material),
        fixed: std::mem::take(&mut tissue.fixed),
        skin: std::mem::take(&mut tissue.skin),
        origin: before.origin.clone(),
    }
}

fn options(room: &Room) -> CutOptions {
    CutOptions {
        min_piece_m3: LEAST_PART_M3,
        max_nodes: room.nodes,
        max_tets: room.tets,
        max_vertices: room.vertices,
        max_triangles: room.triangles,
        ..CutOptions::default()
    }
}

/// Makes objects of the parts of a body that hang together no more, of which each tet has the number of its own; gives them, and what holds the body then.
pub fn register_parts(case: &Case, body: &mut Body, part_of_tet: &[u32]) -> (Vec<Piece>, Held) {
    let (tets, mut held) = (body.rest.tets.len(), case.held_in_parts(body, part_of_tet));
    let parted = body.register_parts(part_of_tet, |node| held.is_rooted[node as usize], &case.room);
    if body.rest.tets.len() < tets {
        // What is burnt holds nothing.
        held = case.held(body);
    } else if !parted.is_empty() {
        // Names matter where nothing holds an organ: the part that keeps its name is no piece, and holds what is tied to it.
        held.is_rooted = case.rooted_nodes(body, &body.rest.regions, &held.is_held, &held.attachments);
    }
    (parted, held)
}

/// What a cut has removed, m³: how much less pathology is held than before, whether it has come free or is burnt. What is burnt of other tissue is none of
/// it, and what had come free before has been counted then, so cutting or burning it again counts nothing. Not below 0: the volume of a mesh that is
/// divided anew is the same but for its rounding.
pub fn removed_m3(before: &World, after: &World) -> f64 {
    lost_m3(before, after, true)
}

/// What a cut has taken off other tissue than pathology, m³, by the same count: what nothing holds any more, and what is burnt. A wound that takes nothing off
/// is none of it, however deep it is.
pub fn healthy_removed_m3(before: &World, after: &World) -> f64 {
    lost_m3(before, after, false)
}

/// How much less is held after a cut, of pathology or of all else, m³.
fn lost_m3(before: &World, after: &World, of_pathology: bool) -> f64 {
    let [before_m3, after_m3] = [before, after].map(|world| world.filled.held_m3[usize::from(of_pathology)]);
    (before_m3 - after_m3).max(0.0)
}

/// What the tets of a world fill at rest.
#[derive(Clone, Copy, Debug)]
pub struct Filled {
    /// Volume of what something holds, m³: of all else than pathology, and of pathology.
    held_m3: [f64; 2],
    /// Whether each tet has a volume.
    pub is_everywhere: bool,
}

/// Adds up what the tets of a body fill, one after the other.
pub struct Filling<'a> {
    body: &'a Body,
    /// For each object the place of its sum, if it is held.
    place_of: Vec<Option<usize>>,
    /// The next tet.
    next: usize,
    filled: Filled,
    /// The volumes of the tets, and where they are kept for the next body.
    volumes: Volumes,
    kept: &'a mut Volumes,
}

impl<'a> Filling<'a> {
    /// Of a body with these objects; `kept`: what is known of the volumes of the one before, and then of this one.
    pub fn of(case: &Case, body: &'a Body, objects: &[ObjectRecord], kept: &'a mut Volumes) -> Filling<'a> {
        let place = |(object, record): (u32, &ObjectRecord)| {
            (!record.is_free_piece()).then(|| usize::from(case.is_pathology(body, object)))
        };
        // The sum of nothing is -0, as that of an iterator.
        let filled = Filled { held_m3: [-0.0; 2], is_everywhere: true };
        // Nothing is known where somebody stops before all are added.
        let mut volumes = std::mem::take(kept);
        volumes.begin(body);
        Filling { body, place_of: (0..).zip(objects).map(place).collect(), next: 0, filled, volumes, kept }
    }

    /// Adds the next tet; false behind the last one.
    pub fn add(&mut self) -> bool {
        let rest = &self.body.rest;
        let (true, Some(object)) = (self.next < rest.tets.len(), rest.regions.get(self.next)) else { return false };
        let volume_m3 = self.volumes.of(self.body, self.next);
        self.filled.is_everywhere &= volume_m3 > 0.0;
        if let Some(place) = self.place_of.get(*object as usize).copied().flatten() {
            self.filled.held_m3[place] += volume_m3;
        }
        self.next += 1;
        true
    }

    /// Adds what is left.
    pub fn ended(mut self) -> Filled {
        while self.add() {}
        self.volumes.end(self.body, self.next);
        *self.kept = self.volumes;
        self.filled
    }
}

/// The object that an object was before a cut that made these of others.
fn was(parted: &[Piece], object: u32) -> u32 {
    parted.iter().find(|piece| piece.object == object).map_or(object, |piece| piece.of)
}

/// What has come free by a cut, m³: the pathology that is free after it and was held before. What came free as a whole keeps its
/// number, and so does the greatest part of what nothing holds any more; `parted` are the objects that the cut made. What is burnt
/// is none of it, nor is what was free before.
pub fn freed_m3(before: &World, after: &World, parted: &[Piece]) -> f64 {
    let was_free = |object: u32| before.objects.get(was(parted, object) as usize).is_some_and(ObjectRecord::is_free_piece);
    let is_of_it = |object: u32| after.case.is_pathology(&after.body, object) && !was_free(object);
    let freed = |(object, record): (u32, &ObjectRecord)| record.is_free_piece() && is_of_it(object);
    let is_freed: Vec<bool> = (0..).zip(&after.objects).map(freed).collect();
    // The sum of nothing is -0, of which and 0 the greater has no bits that are sure; it becomes part of the state.
    if !is_freed.contains(&true) {
        return 0.0;
    }
    0.0 + after.body.volume_where_m3(|object| is_freed.get(object as usize).is_some_and(|is_freed| *is_freed))
}
