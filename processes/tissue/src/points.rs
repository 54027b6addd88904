//! The points of the contact test: those of the tool; then the nodes of tissue that may meet other tissue, the surfaces of what grows in the cavity and of what
//! has come free (all else meets them with its tets), and those of organs, where there is more than one, which meet each other; then the other nodes of
//! surfaces that can move, which meet their own object alone: folds.
//!
//! Two places of an object meet only if together they have come as far from where they are at rest as they were from each other, one of them half as far. So
//! nodes are nowhere that have not come so far themselves and that nothing is near which has, and cost nothing but the look at how far they have come. Those of
//! organs that meet each other are also where they are near another organ.

use crate::body::Body;
use crate::site::MAX_OBJECTS;
use crate::tool::{NOWHERE, Stand, Tool};
use crate::world::{Case, TOOL_ID};
use glam::Vec3;
use hyst_contact::{
    Cull, HashMut, HashSizes, Hit, Layout, NONE, OwnContact, PointGraph, Points, Share, Tissue, Topology, intersect,
};
use hyst_engine::Failure;
use hyst_messages::Pose;
use hyst_messages::stream::{ObjectKind, ObjectRecord};
use hyst_tissue::Attachment;

/// What is nearer than this to a node at rest is beside it, and no fold that it meets, in mean edges of the scene's tets.
const BESIDE_EDGES: f32 = 1.0;
/// What rounding may take from a way, as a share of it.
const HAIR: f32 = 1e-3;
/// How many times as long as at rest an edge is at most, where it is asked what may be near.
const STRETCH: f32 = 1.5;

/// Points and what is known of them; all lists of points are parallel.
#[derive(Clone, Debug, Default)]
pub struct ContactPoints {
    /// How many are the tool's; they come first.
    pub tool: usize,
    /// From which on they are those of organs that meet each other.
    pub organs_from: usize,
    /// From which on they meet their own object alone.
    pub own_from: usize,
    /// The organs that meet each other.
    pub organs: Vec<u32>,
    /// How far two places of an object are apart at rest, m, that may meet.
    pub own_beyond_m: f32,
    /// Object of each.
    pub owner: Vec<u32>,
    /// Tissue node that each is, [`NONE`] for the tool's.
    pub node: Vec<u32>,
    /// Area that each stands for, at rest, m².
    pub area_m2: Vec<f32>,
    /// Edges between neighbours on one surface.
    pub graph: PointGraph,
    /// For each node of the tissue, whether it is at the surface of its object.
    pub is_surface: Vec<bool>,
    /// What its tets say of each node of the tissue.
    pub of_tets: OfTets,
}

/// What tets say of their nodes.
#[derive(Clone, Debug, Default)]
pub struct OfTets {
    /// Object of each, [`NONE`] for those that no tet uses.
    pub object_of: Vec<u32>,
    /// The longest edge of each at rest, m.
    pub longest_m: Vec<f32>,
}

/// How far the nodes of an object have come from where they are at rest.
#[derive(Clone, Copy)]
struct Moved {
    /// At most, m.
    farthest_m: f32,
    /// Box, lowest and highest corner, around the tets of those that have come so far that they may meet what is where it is at rest, m.
    low: Vec3,
    high: Vec3,
}

/// A box that nothing is in, lowest and highest corner, m.
const EMPTY: (Vec3, Vec3) = (Vec3::INFINITY, Vec3::NEG_INFINITY);

impl Moved {
    const NOTHING: Moved = Moved { farthest_m: 0.0, low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };
}

/// The nodes of all surfaces: the area that each stands for at rest, m², and its object, [`NONE`] inside.
fn surface(body: &Body, topology: &Topology) -> (Vec<f32>, Vec<u32>) {
    let nodes = body.rest.positions_m.len();
    let (mut area_m2, mut owner_of) = (vec![0.0f32; nodes], vec![NONE; nodes]);
    for (face, owner) in topology.boundary.iter().zip(&topology.boundary_owner) {
        let [a, b, c] = face.map(|node| Vec3::from(body.rest.positions_m[node as usize]));
        let share_m2 = (b - a).cross(c - a).length() / 6.0;
        for node in face {
            area_m2[*node as usize] += share_m2;
            owner_of[*node as usize] = *owner;
        }
    }
    (area_m2, owner_of)
}

/// The organs that meet each other: all of which there is something, if it is more than one.
fn organs_that_meet(objects: &[ObjectRecord]) -> Vec<u32> {
    let is_organ = |object: &&ObjectRecord| object.kind == ObjectKind::Organ as u32 && object.tets[1] > 0;
    let organs: Vec<u32> = objects.iter().filter(is_organ).map(|object| object.id).collect();
    if organs.len() > 1 { organs } else { Vec::new() }
}

impl ContactPoints {
    /// Those of a body and the case's tool. Nodes that lie in another object of the scene at rest, as the root of a polyp in the wall, meet no other; nor do
    /// those beside a root, which comes out of the wall there, or out of a chip of it. What the tets say of the nodes is left to [`Telling`].
    pub fn of(
        case: &Case,
        body: &Body,
        topology: &Topology,
        objects: &[ObjectRecord],
        attachments: &[Attachment],
    ) -> Result<ContactPoints, Failure> {
        let tool = &case.tool;
        let (area_m2, owner_of) = surface(body, topology);
        let mut points = ContactPoints {
            tool: tool.points_m.len(),
            organs_from: 0,
            own_from: 0,
            organs: organs_that_meet(objects),
            own_beyond_m: BESIDE_EDGES * case.edge_m,
            owner: vec![TOOL_ID; tool.points_m.len()],
            node: vec![NONE; tool.points_m.len()],
            area_m2: tool.area_m2.clone(),
            graph: PointGraph::default(),
            is_surface: owner_of.iter().map(|owner| *owner != NONE).collect(),
            of_tets: OfTets::default(),
        };
        let is = |object: u32, kind: ObjectKind| objects.get(object as usize).is_some_and(|object| object.kind == kind as u32);
        let grows = |object: u32| is(object, ObjectKind::Pathology);
        let may_meet = |object: u32| grows(object) || is(object, ObjectKind::FreePiece);
        // Those that meet others, and of them those at roots, which meet nobody.
        let mut others_of: Vec<u32> = owner_of.iter().map(|owner| if may_meet(*owner) { *owner } else { NONE }).collect();
        let buried = buried(case, body, &owner_of, &others_of)?;
        let (mut is_tied, mut is_root) = (vec![false; body.fixed.len()], body.fixed.clone());
        attachments.iter().for_each(|held| is_tied[held.node as usize] = true);
        buried.iter().for_each(|node| is_root[*node as usize] = true);
        for (tet, object) in body.rest.tets.iter().zip(&body.rest.regions) {
            let is_beside = |node: &u32| is_tied[*node as usize] || grows(*object) && is_root[*node as usize];
            if may_meet(*object) && tet.iter().any(is_beside) {
                tet.iter().for_each(|node| others_of[*node as usize] = NONE);
            }
        }
        buried.into_iter().for_each(|node| others_of[node as usize] = NONE);
        let of_folds = |(node, owner): (usize, &u32)| if may_meet(*owner) || body.fixed[node] { NONE } else { *owner };
        let mut folds_of: Vec<u32> = owner_of.iter().enumerate().map(of_folds).collect();
        let organs_of = points.take_organs(case, body, &owner_of, &mut folds_of)?;
        let (mut place, mut starts) = (vec![NONE; owner_of.len()], [0; 3]);
        for (start, of) in starts.iter_mut().zip([&others_of, &organs_of, &folds_of]) {
            *start = points.owner.len();
            for (node, owner) in of.iter().enumerate().filter(|(_, owner)| **owner != NONE) {
                place[node] = (points.owner.len() - points.tool) as u32;
                points.owner.push(*owner);
                points.node.push(node as u32);
                points.area_m2.push(area_m2[node]);
            }
        }
        [_, points.organs_from, points.own_from] = starts;
        let triangles: Vec<[u32; 3]> = topology.boundary.iter().map(|face| face.map(|node| place[node as usize])).collect();
        let of_tissue = PointGraph::from_triangles(points.owner.len() - points.tool, &triangles);
        points.graph = tool.graph.followed_by(&of_tissue);
        Ok(points)
    }

    /// Takes the nodes of organs that meet each other out of those of folds: the owner of each. Those that lie in another object at rest stay there.
    fn take_organs(&self, case: &Case, body: &Body, owner_of: &[u32], folds_of: &mut [u32]) -> Result<Vec<u32>, Failure> {
        if self.organs.is_empty() {
            return Ok(Vec::new());
        }
        let of_organ = |owner: &u32| if self.organs.contains(owner) { *owner } else { NONE };
        let mut organs_of: Vec<u32> = folds_of.iter().map(of_organ).collect();
        buried(case, body, owner_of, &organs_of)?.into_iter().for_each(|node| organs_of[node as usize] = NONE);
        let folds = folds_of.iter_mut().zip(&organs_of).filter(|(_, organ)| **organ != NONE);
        folds.for_each(|(fold, _)| *fold = NONE);
        Ok(organs_of)
    }

    /// Whether a point of tissue is pushed by an object that it lies in: one of an organ only by its own or by another organ, for what else there is meets the
    /// organ with nodes of its own.
    pub fn is_pushed_by(&self, point: usize, object: u32) -> bool {
        let is_of_organ = (self.organs_from..self.own_from).contains(&point);
        !is_of_organ || self.owner.get(point) == Some(&object) || self.organs.contains(&object)
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.owner.len()
    }

    /// Sizes of their table: with room for all, and with slots for those that are always there, because of the others few ever are.
    pub fn table_sizes(&self) -> HashSizes {
        HashSizes { points: self.len(), ..HashSizes::for_points(self.own_from) }
    }

    /// As the contact crate sees them; `rest_m` is where the nodes are at rest.
    pub fn view<'a>(&'a self, rest_m: &'a [[f32; 3]]) -> Points<'a> {
        let own = OwnContact { rest_m, beyond_m: self.own_beyond_m, only_from: self.own_from as u32 };
        Points { owner: &self.owner, node: &self.node, own: Some(own) }
    }

    /// Puts the tool's points where its pose and the stand of its working element say, and the others where their nodes are; nowhere those that can meet
    /// neither a fold nor another organ.
    pub fn place(
        &self,
        tool: &Tool,
        (pose, stand): (&Pose, Stand),
        (positions_m, rest_m): (&[[f32; 3]], &[[f32; 3]]),
        out_m: &mut [[f32; 3]],
    ) {
        let (of_tool, of_tissue) = out_m.split_at_mut(self.tool.min(out_m.len()));
        tool.place(pose, stand, of_tool);
        let (of_others, of_rest) = of_tissue.split_at_mut((self.organs_from - self.tool).min(of_tissue.len()));
        let (of_organs, of_folds) = of_rest.split_at_mut((self.own_from - self.organs_from).min(of_rest.len()));
        let at = |places_m: &[[f32; 3]], node: &u32| places_m.get(*node as usize).copied().unwrap_or(NOWHERE);
        for (out, node) in of_others.iter_mut().zip(&self.node[self.tool..]) {
            *out = at(positions_m, node);
        }
        let moved = self.moved(positions_m, rest_m);
        let may_fold = |(node, owner): (&u32, &u32)| {
            let (place, rest) = (at(positions_m, node), at(rest_m, node));
            let others = moved.get(*owner as usize).copied().unwrap_or(Moved::NOTHING);
            self.may_meet(place.into(), Vec3::from(place).distance(rest.into()), &others)
        };
        if !of_organs.is_empty() {
            let around = self.around_objects(positions_m);
            let nodes = self.node[self.organs_from..].iter().zip(&self.owner[self.organs_from..]);
            for (out, (node, owner)) in of_organs.iter_mut().zip(nodes) {
                let place = at(positions_m, node);
                let is_there = self.is_near_organ(place.into(), (*node, *owner), &around) || may_fold((node, owner));
                *out = if is_there { place } else { NOWHERE };
            }
        }
        if moved.iter().all(|of_object| 2.0 * of_object.farthest_m < self.beyond_m()) {
            of_folds.fill(NOWHERE);
            return;
        }
        let nodes = self.node[self.own_from..].iter().zip(&self.owner[self.own_from..]);
        for (out, (node, owner)) in of_folds.iter_mut().zip(nodes) {
            *out = if may_fold((node, owner)) { at(positions_m, node) } else { NOWHERE };
        }
    }

    /// A box around the nodes of each object, lowest and highest corner, m.
    fn around_objects(&self, positions_m: &[[f32; 3]]) -> [(Vec3, Vec3); MAX_OBJECTS] {
        let mut around = [EMPTY; MAX_OBJECTS];
        for (place_m, object) in positions_m.iter().zip(&self.of_tets.object_of) {
            let Some(around) = around.get_mut(*object as usize) else { continue };
            *around = (around.0.min(Vec3::from(*place_m)), around.1.max(Vec3::from(*place_m)));
        }
        around
    }

    /// Whether a node of an organ may lie in another organ, or be a neighbour of one that does.
    fn is_near_organ(&self, place: Vec3, (node, owner): (u32, u32), around: &[(Vec3, Vec3); MAX_OBJECTS]) -> bool {
        let grown = Vec3::splat(STRETCH * self.of_tets.longest_m.get(node as usize).copied().unwrap_or(0.0));
        let others = self.organs.iter().filter(|organ| **organ != owner).filter_map(|organ| around.get(*organ as usize));
        let mut boxes = others.map(|(low, high)| (*low - grown, *high + grown));
        boxes.any(|(low, high)| place.cmpge(low).all() && place.cmple(high).all())
    }

    /// How far two places are apart at rest, m, that may meet, less what rounding may take from that.
    fn beyond_m(&self) -> f32 {
        (1.0 - HAIR) * self.own_beyond_m
    }

    /// Whether a node that has come so far, m, may meet its own object.
    fn may_meet(&self, place: Vec3, away_m: f32, others: &Moved) -> bool {
        let beyond_m = self.beyond_m();
        let is_near = place.cmpge(others.low).all() && place.cmple(others.high).all();
        away_m + others.farthest_m >= beyond_m && (2.0 * away_m >= beyond_m || is_near)
    }

    /// How far the nodes of each object have come.
    fn moved(&self, positions_m: &[[f32; 3]], rest_m: &[[f32; 3]]) -> [Moved; MAX_OBJECTS] {
        let mut moved = [Moved::NOTHING; MAX_OBJECTS];
        let far = (0.5 * self.beyond_m()).powi(2);
        let OfTets { object_of, longest_m } = &self.of_tets;
        for (((place, rest), object), longest_m) in positions_m.iter().zip(rest_m).zip(object_of).zip(longest_m) {
            let Some(moved) = moved.get_mut(*object as usize) else { continue };
            let (place, rest) = (Vec3::from(*place), Vec3::from(*rest));
            let squared = place.distance_squared(rest);
            moved.farthest_m = moved.farthest_m.max(squared);
            if squared >= far {
                // What lies in a tet is as far from a corner as the longest edge there at most.
                let grown = Vec3::splat(STRETCH * longest_m);
                (moved.low, moved.high) = (moved.low.min(place - grown), moved.high.max(place + grown));
            }
        }
        moved.iter_mut().for_each(|moved| moved.farthest_m = moved.farthest_m.sqrt());
        moved
    }
}

/// Asks the tets of a body what they say of their nodes, one after the other.
pub struct Telling<'a> {
    body: &'a Body,
    /// The next tet.
    next: usize,
    /// With squares of the edges until all are known: the root of the greatest is the greatest root.
    told: OfTets,
}

impl<'a> Telling<'a> {
    /// Of a body.
    pub fn of(body: &'a Body) -> Telling<'a> {
        let nodes = body.rest.positions_m.len();
        Telling { body, next: 0, told: OfTets { object_of: vec![NONE; nodes], longest_m: vec![0.0; nodes] } }
    }

    /// Asks the next tet; false behind the last one.
    pub fn ask(&mut self) -> bool {
        let rest = &self.body.rest;
        let (Some(tet), Some(object)) = (rest.tets.get(self.next), rest.regions.get(self.next)) else { return false };
        let [a, b, c, d] = tet.map(|node| Vec3::from(rest.positions_m[node as usize]));
        let [ab, ac, ad] = [b, c, d].map(|other| a.distance_squared(other));
        let [bc, bd, cd] = [(b, c), (b, d), (c, d)].map(|(one, other)| one.distance_squared(other));
        let longest = [ab.max(ac).max(ad), ab.max(bc).max(bd), ac.max(bc).max(cd), ad.max(bd).max(cd)];
        for (node, longest) in tet.iter().zip(longest) {
            let longest_m = &mut self.told.longest_m[*node as usize];
            *longest_m = longest_m.max(longest);
            self.told.object_of[*node as usize] = *object;
        }
        self.next += 1;
        true
    }

    /// Asks those that are left.
    pub fn ended(mut self) -> OfTets {
        while self.ask() {}
        self.told.longest_m.iter_mut().for_each(|longest_m| *longest_m = longest_m.sqrt());
        self.told
    }
}

/// For each object of the scene whether the box around it meets one around those nodes of another that are asked about: else none of them lies in its tets.
/// `owner_of` has the owner of each node of a surface, where an object's farthest nodes are, `asked_of` that of each that is asked about.
fn may_bury(case: &Case, body: &Body, owner_of: &[u32], asked_of: &[u32]) -> Vec<bool> {
    let mut around = vec![[EMPTY; 2]; body.origin.len()];
    for (place_m, owners) in body.rest.positions_m.iter().zip(owner_of.iter().zip(asked_of)) {
        for (which, owner) in [owners.0, owners.1].into_iter().enumerate().filter(|(_, owner)| **owner != NONE) {
            let (place, around) = (Vec3::from(*place_m), &mut around[case.origin(body, *owner)][which]);
            *around = (around.0.min(place), around.1.max(place));
        }
    }
    let meets = |one: &(Vec3, Vec3), other: &(Vec3, Vec3)| one.0.cmple(other.1).all() && other.0.cmple(one.1).all();
    let is_met = |object: usize| (0..around.len()).any(|other| other != object && meets(&around[object][0], &around[other][1]));
    (0..around.len()).map(is_met).collect()
}

/// Nodes that lie in tissue of another object of the scene at rest, of those that `asked_of` has an owner of; `owner_of` has that of all nodes of surfaces.
fn buried(case: &Case, body: &Body, owner_of: &[u32], asked_of: &[u32]) -> Result<Vec<u32>, Failure> {
    let broken = |error: hyst_contact::ContactError| Failure::Broken(error.to_string());
    // What buries nothing, as a pathology beside no other one, is not even looked at.
    let may_bury = may_bury(case, body, owner_of, asked_of);
    if !may_bury.contains(&true) {
        return Ok(Vec::new());
    }
    let nodes: Vec<u32> = (0..asked_of.len() as u32).filter(|node| asked_of[*node as usize] != NONE).collect();
    let points_m: Vec<[f32; 3]> = nodes.iter().map(|node| body.rest.positions_m[*node as usize]).collect();
    let sizes = HashSizes::for_points(points_m.len());
    let mut words = vec![0; sizes.words()];
    let mut hash = HashMut::in_words(&mut words, sizes).map_err(broken)?;
    hash.build(&points_m, case.cell_m, Layout::Auto).map_err(broken)?;
    // Whose a tet was in the scene: where two parts of one object touch after a cut, neither is buried in the other.
    let origin = |object: u32| case.origin(body, object) as u32;
    let owner: Vec<u32> = nodes.iter().map(|node| origin(asked_of[*node as usize])).collect();
    let count = body.rest.tets.len();
    let (mut tets, mut of_tet) = (Vec::with_capacity(count), Vec::with_capacity(count));
    for (tet, object) in body.rest.tets.iter().zip(&body.rest.regions) {
        let of = origin(*object);
        if may_bury[of as usize] {
            tets.push(*tet);
            of_tet.push(of);
        }
    }
    let tissue = Tissue { positions_m: &body.rest.positions_m, tets: &tets, tet_owner: &of_tet };
    let mut hits = vec![Hit::default(); 4 * points_m.len()];
    let points = Points { owner: &owner, node: &[], own: None };
    let found = intersect(Share::ALL, &hash.as_ref(), &points, &tissue, &mut Cull::default(), &mut hits).map_err(broken)?;
    Ok(hits[..found.count].iter().map(|hit| nodes[hit.point as usize]).collect())
}

#[cfg(test)]
mod tests;
