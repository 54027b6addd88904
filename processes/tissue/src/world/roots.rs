//! What ties the objects of a scene to their hosts, and what of that is left after cuts.
//!
//! Promise: a node is held at the place where it lay in its host at first, by the tet that is around it now. Where a cut has divided or parted that
//! tet, or moved a corner of it, it is another one, or the same with other weights: so nothing draws two sides of a cut together, and no cut sets a
//! spring under tension. No cut moves the node itself at rest, by which it is known: a stroke beside a root takes nothing of what holds it. Where the
//! place is burnt nothing holds. A body that is whole there is held as the scene says, to the bit.

use super::lookup::Lookup;
use super::{ATTACHMENT_N_M, Case, World};
use crate::body::Body;
use glam::{DMat3, DVec3, Vec3};
use hyst_scene::LoadedScene;
use hyst_tissue::Attachment;
use std::collections::BTreeMap;

/// How far outside of a tet a place may be that counts as in it, as a weight: what rounding makes of one on a face.
const OUTSIDE: f64 = 1e-4;
/// How far from its place at rest a node may be held, m: what rounding makes of none.
const AWAY_M: f64 = 1e-6;

/// A place at rest, to the bit.
fn bits(point: [f32; 3]) -> [u32; 3] {
    point.map(f32::to_bits)
}

/// Where a node lay in its host in the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Root {
    /// The host's number.
    host: u32,
    tet: [u32; 4],
    weights: [f32; 4],
}

/// The nodes that are held in hosts.
pub struct Roots {
    all: Vec<Root>,
    /// Their numbers, by their object and their place at rest, which a copy of a node has too.
    places: Lookup,
    /// The tets that they lie in; one in which many do stands there as often.
    tets: Lookup,
    /// Whether each node of the scene is a corner of such a tet.
    is_corner: Vec<bool>,
    /// Box around these places, lowest and highest corner, m: most nodes are outside.
    low: Vec3,
    high: Vec3,
}

impl Roots {
    /// Those of a scene, whose objects are joined in a body; the nodes of each begin at its `starts`.
    pub(super) fn of(scene: &LoadedScene, body: &Body, starts: &[usize]) -> Roots {
        let mut first_tet = vec![0usize];
        for object in &scene.objects {
            first_tet.push(first_tet.last().copied().unwrap_or(0) + object.mesh.tets.len());
        }
        let mut all = BTreeMap::new();
        for (index, object) in scene.objects.iter().enumerate() {
            for (host, held) in object.attach.iter().flat_map(|attach| attach.nodes.iter().map(|node| (attach.host, node))) {
                let node = starts[index] + held.node as usize;
                let tet = body.rest.tets[first_tet[host] + held.tet as usize];
                // On a face a weight may be a hair below 0, with which a step ignores the spring.
                let weights = held.weights.map(|weight| weight.clamp(0.0, 1.0));
                let root = Root { host: host as u32, tet, weights };
                all.insert((index as u32, bits(body.rest.positions_m[node])), root);
            }
        }
        let places = || all.keys().map(|(_, place)| Vec3::from(place.map(f32::from_bits)));
        let (low, high) = (places().fold(Vec3::INFINITY, Vec3::min), places().fold(Vec3::NEG_INFINITY, Vec3::max));
        let places = Lookup::of(all.keys().map(|(object, [x, y, z])| [*object, *x, *y, *z]).collect());
        let all: Vec<Root> = all.into_values().collect();
        let tets = Lookup::of(all.iter().map(|root| root.tet).collect());
        let mut is_corner = vec![false; body.rest.positions_m.len()];
        tets.known().as_flattened().iter().for_each(|node| is_corner[*node as usize] = true);
        Roots { all, places, tets, is_corner, low, high }
    }

    /// Where one is held that is at a place at rest, by the object that is asked for.
    fn at(&self, place_m: [f32; 3], object: impl FnOnce() -> Option<u32>) -> Option<Root> {
        let place = Vec3::from(place_m);
        let is_near = place.cmpge(self.low).all() && place.cmple(self.high).all();
        if !is_near {
            return None;
        }
        let [x, y, z] = bits(place_m);
        self.places.number([object()?, x, y, z]).map(|number| self.all[number])
    }

    /// Whether each of their tets, by its number, is in a body, with the same nodes in the same order.
    fn whole_tets(&self, body: &Body) -> Vec<bool> {
        let mut is_whole = vec![false; self.tets.known().len()];
        let is_corner = |node: &u32| self.is_corner.get(*node as usize).is_some_and(|is_corner| *is_corner);
        // A look at flags is far cheaper than one into the table, and few tets have four of these nodes.
        for tet in body.rest.tets.iter().filter(|tet| tet.iter().all(is_corner)) {
            if let Some(number) = self.tets.number(*tet) {
                is_whole[number] = true;
            }
        }
        is_whole
    }
}

impl World {
    /// Notes for each node whether it is tied to a host, to which it is known by its place at rest.
    pub fn note_tied(&self, is_tied: &mut Vec<bool>) {
        is_tied.clear();
        is_tied.resize(self.body.rest.positions_m.len(), false);
        for tie in &self.attachments {
            if let Some(is_tied) = is_tied.get_mut(tie.node as usize) {
                *is_tied = true;
            }
        }
    }
}

impl Case {
    /// What holds the nodes of a body in hosts, or in what has come off them. A node that was copied is held as its original is.
    pub fn attachments(&self, body: &Body) -> Vec<Attachment> {
        if self.roots.all.is_empty() {
            return Vec::new();
        }
        let owner = body.owners();
        let root_of = |(node, place_m): (usize, &[f32; 3])| {
            let root = self.roots.at(*place_m, || Some(self.origin(body, owner[node]?) as u32))?;
            Some((node as u32, to_double(*place_m), root))
        };
        let rooted: Vec<(u32, DVec3, Root)> = body.rest.positions_m.iter().enumerate().filter_map(root_of).collect();
        let whole = self.roots.whole_tets(body);
        let is_there = |tet: [u32; 4]| self.roots.tets.number(tet).is_some_and(|number| whole[number]);
        let is_whole = |(_, place, root): &(u32, DVec3, Root)| is_there(root.tet) && is_at(body, root, *place);
        let is_as_it_was: Vec<bool> = rooted.iter().map(is_whole).collect();
        let others = rooted.iter().zip(&is_as_it_was).filter(|(_, is_as_it_was)| !**is_as_it_was);
        let others: Vec<(u32, DVec3)> = others.map(|((_, place, root), _)| (root.host, *place)).collect();
        let near = self.near(body, &others);
        let held = |((node, place, root), is_as_it_was): ((u32, DVec3, Root), bool)| {
            let now = if is_as_it_was { Some((root.tet, root.weights)) } else { host_now(&near, root.host, place) };
            now.map(|(tet, weights)| Attachment { node, tet, weights, stiffness_n_m: ATTACHMENT_N_M })
        };
        rooted.into_iter().zip(is_as_it_was).filter_map(held).collect()
    }

    /// The tets of some hosts, or of what has come off them, whose boxes touch that around places at rest that lay in these: one look at all of them, and not
    /// one for each place.
    fn near(&self, body: &Body, places: &[(u32, DVec3)]) -> Vec<Near> {
        if places.is_empty() {
            return Vec::new();
        }
        let wider = |(low, high): (DVec3, DVec3), (_, place): &(u32, DVec3)| (low.min(*place), high.max(*place));
        let (low, high) = places.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), wider);
        let (low, high) = ((low - AWAY_M).as_vec3(), (high + AWAY_M).as_vec3());
        // Beyond which sides of that box each node is: a tet's box touches it if its corners are not all beyond the same one.
        let beyond = |place_m: &[f32; 3]| {
            let place = Vec3::from(*place_m);
            place.cmplt(low).bitmask() | (place.cmpgt(high).bitmask() << 3)
        };
        let beyond: Vec<u32> = body.rest.positions_m.iter().map(beyond).collect();
        let touches = |tet: &[u32; 4]| tet.iter().fold(u32::MAX, |all, node| all & beyond[*node as usize]) == 0;
        let near = body.rest.tets.iter().zip(&body.rest.regions).filter(|&(tet, _)| touches(tet));
        let near = near.map(|(tet, region)| (tet, self.origin(body, *region) as u32));
        // In what is no host no place is looked for: the pathology itself has most tets where it is held.
        let mut hosts: Vec<u32> = places.iter().map(|(host, _)| *host).collect();
        hosts.sort_unstable();
        hosts.dedup();
        near.filter(|(_, of)| hosts.contains(of)).map(|(tet, of)| Near::of(body, *tet, of)).collect()
    }
}

/// A tet that may be around places, with what each of them asks of it.
struct Near {
    tet: [u32; 4],
    /// The object of the scene that it is of, or has come off.
    of: u32,
    /// Where its corners are at rest.
    corners: [DVec3; 4],
    /// Box around these and what rounding makes of them, lowest and highest corner.
    low: DVec3,
    high: DVec3,
}

impl Near {
    fn of(body: &Body, tet: [u32; 4], of: u32) -> Near {
        let corners @ [a, b, c, d] = corners(body, tet);
        let near = DVec3::splat(AWAY_M);
        Near { tet, of, corners, low: a.min(b).min(c.min(d)) - near, high: a.max(b).max(c.max(d)) + near }
    }

    /// The weights of its corners at a place at rest that is in it.
    fn weights(&self, place: DVec3) -> Option<[f64; 4]> {
        if !(place.cmpge(self.low).all() && place.cmple(self.high).all()) {
            return None;
        }
        let [a, b, c, d] = self.corners;
        let others = DMat3::from_cols(b - a, c - a, d - a).inverse() * (place - a);
        let weights = [1.0 - others.element_sum(), others.x, others.y, others.z];
        weights.iter().all(|weight| *weight >= -OUTSIDE).then_some(weights)
    }
}

/// The tet of a host, or of what has come off it, in which a place at rest is, and its weights there. `near`: tets near the place.
fn host_now(near: &[Near], host: u32, place: DVec3) -> Option<([u32; 4], [f32; 4])> {
    let of_host = near.iter().filter(|near| near.of == host);
    let around = of_host.filter_map(|near| Some((near.tet, near.weights(place)?)));
    let least = |weights: &[f64; 4]| weights.iter().copied().fold(f64::INFINITY, f64::min);
    let (tet, weights) = around.max_by(|one, other| least(&one.1).total_cmp(&least(&other.1)))?;
    let inside = weights.map(|weight| weight.max(0.0));
    let sum: f64 = inside.iter().sum();
    Some((tet, inside.map(|weight| (weight / sum) as f32)))
}

fn to_double(place_m: [f32; 3]) -> DVec3 {
    DVec3::from_array(place_m.map(f64::from))
}

fn corners(body: &Body, tet: [u32; 4]) -> [DVec3; 4] {
    tet.map(|node| to_double(body.rest.positions_m[node as usize]))
}

/// Whether a root's tet holds at a place, where its corners are at rest now.
fn is_at(body: &Body, root: &Root, place: DVec3) -> bool {
    let parts = corners(body, root.tet).into_iter().zip(root.weights).map(|(corner, weight)| corner * f64::from(weight));
    parts.sum::<DVec3>().distance(place) <= AWAY_M
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Workshop;
    use hyst_tissue::{CutOptions, Cuttable, Isa, cut};

    /// Way of the wire between two cuts, m.
    const STEP_M: f32 = 5e-4;
    /// How far the wire reaches to both sides of the root, and how far it is drawn, m.
    const REACH_M: f32 = 0.015;
    /// The same of one that passes beside a node, and how far beside it, m.
    const SHORT_M: f32 = 0.003;
    const BESIDE_M: f32 = 2e-4;

    fn world() -> World {
        Workshop::open(&hyst_scene::load_embedded().unwrap(), Isa::detect()).unwrap().1
    }

    /// The body after a wire has gone through the middle of the root, across its host, by a cut that knows which nodes are tied.
    fn cut_through_root(world: &World) -> Body {
        let body = &world.body;
        let places = world.attachments.iter().map(|held| to_double(body.rest.positions_m[held.node as usize]));
        let root = (places.sum::<DVec3>() / world.attachments.len() as f64).as_vec3();
        let mut tissue = Cuttable { fixed: body.fixed.clone(), ..Cuttable::at_rest(body.rest.clone()) };
        world.note_tied(&mut tissue.keeps_place);
        let steps = (2.0 * REACH_M / STEP_M) as i32;
        for step in 0..=steps {
            let y = root.y - REACH_M + step as f32 * STEP_M;
            let wire = [-REACH_M, 0.0, REACH_M].map(|aside| [root.x + aside, y, root.z]);
            cut(&mut tissue, &wire, &CutOptions::default()).unwrap();
        }
        Body { rest: tissue.rest, fixed: tissue.fixed, origin: body.origin.clone(), ..Body::default() }
    }

    /// The body after a wire has passed beside a node, on the side of a direction, and what then holds it; `keeps`: the cut knows which nodes are tied.
    fn cut_beside(world: &World, (node, aside): (u32, Vec3), keeps: bool) -> (Body, Vec<Attachment>) {
        let body = &world.body;
        let mut tissue = Cuttable { fixed: body.fixed.clone(), ..Cuttable::at_rest(body.rest.clone()) };
        if keeps {
            world.note_tied(&mut tissue.keeps_place);
        }
        let along = aside.any_orthonormal_vector();
        let (middle, way) = (Vec3::from(body.rest.positions_m[node as usize]) + BESIDE_M * aside, aside.cross(along));
        for gone_m in [-SHORT_M, SHORT_M] {
            let wire = [-SHORT_M, 0.0, SHORT_M].map(|along_m| (middle + gone_m * way + along_m * along).to_array());
            cut(&mut tissue, &wire, &CutOptions::default()).unwrap();
        }
        let cut = Body { rest: tissue.rest, fixed: tissue.fixed, origin: body.origin.clone(), ..Body::default() };
        let held = world.case.attachments(&cut);
        (cut, held)
    }

    #[test]
    fn a_cut_beside_a_node_of_a_root_takes_nothing_of_what_holds_it() {
        let world = world();
        let inner = world.attachments.iter().map(|tie| tie.node).filter(|node| !world.points.is_surface[*node as usize]);
        let sides = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
        let strokes: Vec<(u32, Vec3)> = inner.flat_map(|node| sides.map(|side| (node, side))).collect();
        assert!(!strokes.is_empty(), "no node of the root is inside of what it holds");
        let lost = |stroke: (u32, Vec3), keeps: bool| {
            let (cut, held) = cut_beside(&world, stroke, keeps);
            assert_ne!(cut.rest, world.body.rest, "{stroke:?}: nothing is cut");
            assert_held(&world, &cut, &held);
            world.attachments.iter().filter(|tie| !held.iter().any(|now| now.node == tie.node)).count()
        };
        let [with, without] = [true, false].map(|keeps| strokes.iter().map(|stroke| lost(*stroke, keeps)).sum::<usize>());
        println!("{} strokes take {with} attachments, and {without} where the cut does not know them", strokes.len());
        assert!(with == 0 && without > 0, "{with} are lost, and {without} where nobody takes care of them");
    }

    /// Asserts that each node is held at its own place, by a tet of its host that is there.
    fn assert_held(world: &World, body: &Body, attachments: &[Attachment]) {
        let owner = body.owners();
        for held in attachments {
            let index = body.rest.tets.iter().position(|tet| *tet == held.tet);
            let index = index.unwrap_or_else(|| panic!("{held:?}: no tet has these corners"));
            let origin = |object: u32| world.case.origin(body, object);
            assert_ne!(origin(body.rest.regions[index]), origin(owner[held.node as usize].unwrap()), "{held:?}: held in itself");
            let root = Root { host: 0, tet: held.tet, weights: held.weights };
            assert!(is_at(body, &root, to_double(body.rest.positions_m[held.node as usize])), "{held:?}: held elsewhere");
            assert!(held.weights.iter().all(|weight| (0.0..=1.0).contains(weight)), "{held:?}");
            assert!((held.weights.iter().sum::<f32>() - 1.0).abs() < 1e-5, "{held:?}");
        }
    }

    #[test]
    fn a_root_that_is_cut_is_held_by_what_is_around_it_then_and_one_that_is_whole_as_the_scene_says() {
        let world = world();
        assert_held(&world, &world.body, &world.attachments);
        let cut = cut_through_root(&world);
        let after = world.case.attachments(&cut);
        assert_held(&world, &cut, &after);
        let stay = after.iter().filter(|held| world.attachments.contains(held)).count();
        let before = world.attachments.len();
        println!("{before} nodes held, after the cut {}, {stay} of them as before", after.len());
        assert!(3 * after.len() > before, "{} of {before} nodes are held after the cut", after.len());
        assert!(stay < before && after.len() > stay, "{stay} of {before} stay as they were: the cut missed the root");
    }

    /// The definition: each node is compared with each root, each root's tet and each place that it no longer holds at with each tet of the body.
    fn plain(case: &Case, body: &Body) -> Vec<Attachment> {
        let (owner, rest, roots) = (body.owners(), &body.rest, &case.roots);
        let origin = |object: u32| case.origin(body, object) as u32;
        let near: Vec<Near> = rest.tets.iter().zip(&rest.regions).map(|(tet, of)| Near::of(body, *tet, origin(*of))).collect();
        let held = |(node, place_m): (usize, &[f32; 3])| {
            let [x, y, z] = bits(*place_m);
            let known = [origin(owner[node]?), x, y, z];
            let root = &roots.all[roots.places.known().iter().position(|place| *place == known)?];
            let is_as_it_was = rest.tets.contains(&root.tet) && is_at(body, root, to_double(*place_m));
            let now = if is_as_it_was { Some((root.tet, root.weights)) } else { host_now(&near, root.host, to_double(*place_m)) };
            now.map(|(tet, weights)| Attachment { node: node as u32, tet, weights, stiffness_n_m: ATTACHMENT_N_M })
        };
        rest.positions_m.iter().enumerate().filter_map(held).collect()
    }

    #[test]
    fn what_holds_a_body_is_what_comparing_every_node_with_every_root_finds() {
        let world = world();
        let (cut, burnt) = (cut_through_root(&world), burnt(&world, |tet| tet.contains(&world.attachments[0].tet[0])));
        for body in [&world.body, &cut, &burnt] {
            assert_eq!(world.case.attachments(body), plain(&world.case, body));
        }
    }

    /// The body without some tets of the host.
    fn burnt(world: &World, is_burnt: impl Fn(&[u32; 4]) -> bool) -> Body {
        let (tets, regions) = (&world.body.rest.tets, &world.body.rest.regions);
        let is_kept = |index: &usize| world.case.origin(&world.body, regions[*index]) != 0 || !is_burnt(&tets[*index]);
        let kept: Vec<usize> = (0..tets.len()).filter(is_kept).collect();
        assert!(kept.len() < tets.len(), "nothing is burnt");
        let mut body = world.body.clone();
        body.rest.tets = kept.iter().map(|index| tets[*index]).collect();
        body.rest.regions = kept.iter().map(|index| regions[*index]).collect();
        body
    }

    #[test]
    fn where_the_host_is_burnt_or_its_nodes_are_used_again_elsewhere_nothing_holds() {
        let world = world();
        let first = world.attachments[0];
        let place = to_double(world.body.rest.positions_m[first.node as usize]);
        let is_held = |body: &Body| world.case.attachments(body).iter().any(|held| held.node == first.node);
        assert!(is_held(&world.body));
        let around = burnt(&world, |tet| Near::of(&world.body, *tet, 0).weights(place).is_some());
        assert!(!is_held(&around), "its host is burnt");
        assert!(!world.case.attachments(&around).is_empty(), "the others are held");
        // The numbers of its corners are those of a tet that is elsewhere now.
        let mut again = burnt(&world, |tet| tet.iter().any(|node| first.tet.contains(node)));
        again.rest.tets.push(first.tet);
        again.rest.regions.push(0);
        first.tet.iter().for_each(|node| again.rest.positions_m[*node as usize][2] += 0.1);
        assert!(!is_held(&again), "it is held by what is 10 cm away");
    }
}
