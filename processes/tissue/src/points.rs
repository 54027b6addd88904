//! The points of the contact test: those of the tool; then the nodes of tissue that may meet other tissue, the surfaces of what grows in the cavity and of what
//! has come free (all else meets them with its tets); then the other nodes of surfaces that can move, which meet their own object alone: folds.
//!
//! Two places meet only if together they have come as far from where they are at rest as they were from each other, one of them half as far. So nodes are
//! nowhere that have not come so far themselves and that nothing is near which has, and cost nothing but the look at how far they have come.

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
    /// From which on they meet their own object alone.
    pub own_from: usize,
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

impl ContactPoints {
    /// Those of a body and the case's tool. Nodes that lie in another object of the scene at rest, as the root of a polyp in the wall, meet nobody; nor do
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
            own_from: 0,
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
        let folds_of: Vec<u32> = owner_of.iter().enumerate().map(of_folds).collect();
        let mut place = vec![NONE; owner_of.len()];
        for of in [&others_of, &folds_of] {
            points.own_from = points.owner.len();
            for (node, owner) in of.iter().enumerate().filter(|(_, owner)| **owner != NONE) {
                place[node] = (points.owner.len() - points.tool) as u32;
                points.owner.push(*owner);
                points.node.push(node as u32);
                points.area_m2.push(area_m2[node]);
            }
        }
        let triangles: Vec<[u32; 3]> = topology.boundary.iter().map(|face| face.map(|node| place[node as usize])).collect();
        let of_tissue = PointGraph::from_triangles(points.owner.len() - points.tool, &triangles);
        points.graph = tool.graph.followed_by(&of_tissue);
        Ok(points)
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

    /// Puts the tool's points where its pose and the stand of its working element say, and the others where their nodes are; nowhere those that can meet no fold.
    pub fn place(
        &self,
        tool: &Tool,
        (pose, stand): (&Pose, Stand),
        (positions_m, rest_m): (&[[f32; 3]], &[[f32; 3]]),
        out_m: &mut [[f32; 3]],
    ) {
        let (of_tool, of_tissue) = out_m.split_at_mut(self.tool.min(out_m.len()));
        tool.place(pose, stand, of_tool);
        let (of_others, of_folds) = of_tissue.split_at_mut((self.own_from - self.tool).min(of_tissue.len()));
        let at = |places_m: &[[f32; 3]], node: &u32| places_m.get(*node as usize).copied().unwrap_or(NOWHERE);
        for (out, node) in of_others.iter_mut().zip(&self.node[self.tool..]) {
            *out = at(positions_m, node);
        }
        let moved = self.moved(positions_m, rest_m);
        if moved.iter().all(|of_object| 2.0 * of_object.farthest_m < self.beyond_m()) {
            of_folds.fill(NOWHERE);
            return;
        }
        let nodes = self.node[self.own_from..].iter().zip(&self.owner[self.own_from..]);
        for (out, (node, owner)) in of_folds.iter_mut().zip(nodes) {
            let (place, rest) = (at(positions_m, node), at(rest_m, node));
            let others = moved.get(*owner as usize).copied().unwrap_or(Moved::NOTHING);
            let may_meet = self.may_meet(place.into(), Vec3::from(place).distance(rest.into()), &others);
            *out = if may_meet { place } else { NOWHERE };
        }
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
    let nothing = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let mut around = vec![[nothing; 2]; body.origin.len()];
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
mod tests {
    use super::*;
    use crate::world::Workshop;
    use hyst_contact::intersect_brute;
    use hyst_tissue::Isa;

    #[test]
    fn buried_is_what_lies_in_a_tet_of_another_object_whatever_is_left_out_of_the_search() {
        let (_, world) = Workshop::open(&hyst_scene::load_embedded().unwrap(), Isa::detect()).unwrap();
        let (rest, owner_of) = (&world.body.rest, surface(&world.body, &world.topology).1);
        let tissue = Tissue { positions_m: &rest.positions_m, tets: &rest.tets, tet_owner: &rest.regions };
        let of_all = |node: usize| owner_of[node];
        let of_polyp = |node: usize| if owner_of[node] == 1 { 1 } else { NONE };
        for of in [&of_polyp as &dyn Fn(usize) -> u32, &of_all] {
            let owner: Vec<u32> = (0..owner_of.len()).map(of).collect();
            let place = |(node, owner): (&[f32; 3], &u32)| if *owner == NONE { NOWHERE } else { *node };
            let places_m: Vec<[f32; 3]> = rest.positions_m.iter().zip(&owner).map(place).collect();
            let mut hits = vec![Hit::default(); 4 * places_m.len()];
            let points = Points { owner: &owner, node: &[], own: None };
            let found = intersect_brute(&places_m, &points, &tissue, &mut hits).unwrap();
            let expected: Vec<u32> = hits[..found.count].iter().map(|hit| hit.point).collect();
            assert!(expected.len() > 3 && found.dropped == 0, "{} nodes", expected.len());
            assert_eq!(buried(&world.case, &world.body, &owner_of, &owner).unwrap(), expected);
        }
    }

    #[test]
    fn an_object_may_bury_nodes_of_another_whose_box_meets_its_own_and_none_of_itself() {
        let (_, mut world) = Workshop::open(&hyst_scene::load_embedded().unwrap(), Isa::detect()).unwrap();
        let owner_of = surface(&world.body, &world.topology).1;
        let of_polyp: Vec<u32> = owner_of.iter().map(|owner| if *owner == 1 { 1 } else { NONE }).collect();
        assert_eq!(may_bury(&world.case, &world.body, &owner_of, &of_polyp), [true, false]);
        assert_eq!(may_bury(&world.case, &world.body, &owner_of, &owner_of), [true, true]);
        assert_eq!(may_bury(&world.case, &world.body, &owner_of, &vec![NONE; owner_of.len()]), [false, false]);
        // A polyp that is elsewhere.
        let places_m = world.body.rest.positions_m.iter_mut();
        places_m.zip(&world.points.of_tets.object_of).filter(|(_, of)| **of == 1).for_each(|(place_m, _)| place_m[2] += 1.0);
        assert_eq!(may_bury(&world.case, &world.body, &owner_of, &owner_of), [false, false]);
        assert!(buried(&world.case, &world.body, &owner_of, &owner_of).unwrap().is_empty());
    }

    #[test]
    fn the_longest_edge_and_the_object_of_a_node_are_those_of_its_tets() {
        let (_, world) = Workshop::open(&hyst_scene::load_embedded().unwrap(), Isa::detect()).unwrap();
        let (rest, OfTets { object_of, longest_m }) = (&world.body.rest, world.points.of_tets.clone());
        let (place, owners) = (|node: u32| Vec3::from(rest.positions_m[node as usize]), world.body.owners());
        for (node, (longest_m, object)) in (0..).zip(longest_m.into_iter().zip(object_of)) {
            let around = rest.tets.iter().filter(|tet| tet.contains(&node));
            let edges_m = around.flatten().map(|other| place(node).distance(place(*other)));
            assert_eq!(longest_m.to_bits(), edges_m.fold(0.0, f32::max).to_bits(), "node {node}");
            assert_eq!(Some(object).filter(|object| *object != NONE), owners[node as usize]);
        }
    }

    #[test]
    fn a_wall_that_is_hardly_deformed_is_nowhere_and_what_has_come_far_is_there_with_what_it_may_reach() {
        let scene = hyst_scene::load_embedded().unwrap();
        let (_, world) = Workshop::open(&scene, Isa::detect()).unwrap();
        let (points, rest_m) = (&world.points, &world.body.rest.positions_m);
        let mut out = vec![[0.0; 3]; points.len()];
        let pose = Pose { orientation: [0.0, 0.0, 0.0, 1.0], ..Pose::default() };
        let mut there = |positions_m: &[[f32; 3]]| {
            points.place(&world.case.tool, (&pose, Stand::default()), (positions_m, rest_m), &mut out);
            let is_there: Vec<bool> = out.iter().map(|place| place[0].is_finite()).collect();
            let folds = &is_there[points.own_from..];
            assert!(is_there[..world.case.tool.shaft].iter().all(|is| *is), "the shaft");
            assert!(is_there[points.tool..points.own_from].iter().all(|is| *is), "the polyp");
            (folds.iter().filter(|is| **is).count(), folds[0])
        };
        let folds = points.len() - points.own_from;
        assert!(folds > 300, "{folds} nodes of the wall");
        assert_eq!(there(rest_m), (0, false), "at rest");
        let mut moved = rest_m.clone();
        let mut move_by = |share: f32| {
            moved[points.node[points.own_from] as usize][1] += share * points.own_beyond_m;
            there(&moved)
        };
        assert_eq!(move_by(0.4), (0, false), "no two nodes have come so far from each other that they may meet");
        assert_eq!(move_by(0.2), (1, true), "this one may meet one that has come as far, and all others none");
        let (near, moved) = move_by(0.5);
        assert!(moved && near > 1 && near < folds / 2, "those near where this one has come to, not {near} of {folds}");
    }
}
