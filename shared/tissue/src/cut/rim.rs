//! The rim of a wound: where it meets what was the boundary before. The surface for the eye is finer than the tets, lies a little beside their boundary and
//! comes apart along edges of its own. So what has come apart is drawn onto the rim: else one would look into nothing between the two, or see a flap.
//!
//! Promise (`tests/rims`): where it has come apart, the surface ends on the rim of the wound, wherever the nodes go; nothing else of it is moved, and what is
//! farther from the rim than a millimetre, beside what it lies outside of the tets, stays where it is.

use super::CutOptions;
use super::joined::NONE;
use super::neighbourhood::Neighbourhood;
use super::places::{Sides, SingleBounds, at, edge_of_number, number_of_edge, sorted, to_single};
use super::separate::Face;
use super::skin::{Hosted, Skin, bound, divided, outside_m, radius_m};
use glam::DVec3;
use hyst_mesh::{FACES, TetMesh};
use std::iter;
use std::ops::Range;

/// A vertex is drawn onto a rim that is no farther from it than this, and than its triangles reach, beside what it lies outside of the tets, m. What is
/// farther from all rims has come apart for another reason.
const FARTHEST_M: f64 = 1e-3;
/// A point lies on an edge that is nearer than this, m: rounding.
const ON_EDGE_M: f64 = 1e-6;

/// What of a mesh lies on the sheet of a stroke.
#[derive(Debug)]
pub struct OnSheet {
    /// The tets that have a face on it at least.
    tets: Vec<u32>,
    /// Whether each node is on it.
    is_marked: Vec<bool>,
}

impl OnSheet {
    /// `marks`: the sheet's normal at each node, 0 where it is not on it.
    pub fn of(tets: Vec<u32>, marks: &[[f32; 3]]) -> OnSheet {
        OnSheet { tets, is_marked: marks.iter().map(|mark| *mark != [0.0; 3]).collect() }
    }
}

/// A vertex of the surface that has come apart.
pub struct Torn {
    pub vertex: u32,
    /// The vertices that it has become beside itself.
    pub copies: Range<u32>,
    /// The triangles of all of them.
    pub triangles: Vec<Hosted>,
}

impl Torn {
    /// All that it has become.
    fn vertices(&self) -> impl Iterator<Item = u32> + use<> {
        iter::once(self.vertex).chain(self.copies.clone())
    }
}

/// An edge of a face of a wound, at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Edge {
    /// The object that has it.
    region: u32,
    ends_m: [[f32; 3]; 2],
}

impl Edge {
    fn nearest_to(&self, point: DVec3) -> DVec3 {
        let [from, to] = self.ends_m.map(|end_m| at(&[end_m], 0));
        let along = to - from;
        from + along * ((point - from).dot(along) / along.length_squared()).clamp(0.0, 1.0)
    }

    fn has(&self, point: DVec3) -> bool {
        self.nearest_to(point).distance(point) < ON_EDGE_M
    }
}

/// The edges of the faces that a stroke has opened.
#[derive(Debug, Default)]
struct Rim {
    /// Those in which the wound meets what was the boundary before: for each side one.
    outer: Vec<Edge>,
    /// All others: between two faces, and at the front of the cut.
    inner: Vec<Edge>,
}

impl Rim {
    /// Those of them that a box touches.
    fn near(rest: &TetMesh, on_sheet: &OnSheet, around: &SingleBounds) -> Rim {
        let opened = opened_faces(rest, bare_faces(rest, on_sheet, around));
        let edges_of = |([a, b, c], region): (Face, u32)| [[a, b], [b, c], [a, c]].map(|edge| (number_of_edge(edge), region));
        let mut edges: Vec<(u64, u32)> = opened.into_iter().flat_map(edges_of).collect();
        edges.sort_unstable();
        let mut rim = Rim::default();
        for same in edges.chunk_by(|left, right| left.0 == right.0) {
            let (number, region) = same[0];
            let ends_m = edge_of_number(number).map(|node| rest.positions_m[node as usize]);
            // Of an edge beyond the box a face may have been left out.
            if Sides::touch(ends_m.map(|end_m| around.sides(&end_m))) {
                // Within a wound each edge has two faces: at its front, where both sides have the same nodes, one of each.
                let edges = if same.len() == 1 { &mut rim.outer } else { &mut rim.inner };
                edges.push(Edge { region, ends_m });
            }
        }
        rim
    }

    /// The point of the rim that a vertex is to be drawn onto.
    fn nearest(&self, wish: &Wish) -> Option<DVec3> {
        let is_of_it = |edge: &&Edge| edge.region == wish.region;
        // What was the front of this wound comes apart as the cut goes on, and is where it belongs.
        if wish.is_raw && self.inner.iter().filter(is_of_it).any(|edge| edge.has(wish.point)) {
            return None;
        }
        let points = self.outer.iter().filter(is_of_it).map(|edge| edge.nearest_to(wish.point));
        let away_m = |point: &DVec3| point.distance(wish.point);
        let nearest = points.min_by(|left, right| away_m(left).total_cmp(&away_m(right)));
        nearest.filter(|point| away_m(point) <= wish.reach_m)
    }

    /// Where two edges meet that have a place each, of which neither has the other one.
    fn corner_between(&self, region: u32, [from, to]: [DVec3; 2]) -> Option<[f32; 3]> {
        let at_ends = [from, to].map(|place| {
            let has_it = |edge: &&Edge| edge.region == region && edge.has(place);
            self.outer.iter().filter(has_it).collect::<Vec<&Edge>>()
        });
        if at_ends[0].iter().any(|edge| edge.has(to)) {
            return None;
        }
        let mut corners_m = at_ends[0].iter().flat_map(|edge| edge.ends_m);
        corners_m.find(|corner_m| at_ends[1].iter().any(|edge| edge.ends_m.contains(corner_m)))
    }
}

/// The faces on the sheet that one tet has alone, of tets whose boxes touch another one; each with the tet's object.
fn bare_faces(rest: &TetMesh, on_sheet: &OnSheet, around: &SingleBounds) -> Vec<(Face, u32)> {
    let is_on_sheet = |face: &Face| face.iter().all(|node| on_sheet.is_marked[*node as usize]);
    let mut faces: Vec<(Face, u32)> = Vec::new();
    for tet in &on_sheet.tets {
        let nodes = rest.tets[*tet as usize];
        if Sides::touch(nodes.map(|node| around.sides(&rest.positions_m[node as usize]))) {
            let of_tet = FACES.map(|places| sorted(places.map(|place| nodes[place])));
            let region = rest.regions[*tet as usize];
            faces.extend(of_tet.into_iter().filter(is_on_sheet).map(|face| (face, region)));
        }
    }
    faces.sort_unstable();
    faces.chunk_by(|left, right| left.0 == right.0).filter(|same| same.len() == 1).map(|same| same[0]).collect()
}

/// Those of these faces that were one: their nodes lie at the same places at rest. What was on the boundary before has none beside it.
fn opened_faces(rest: &TetMesh, bare: Vec<(Face, u32)>) -> Vec<(Face, u32)> {
    let place = |node: u32| rest.positions_m[node as usize].map(f32::to_bits);
    let mut nodes: Vec<u32> = bare.iter().flat_map(|(face, _)| *face).collect();
    nodes.sort_unstable_by_key(|node| (place(*node), *node));
    nodes.dedup();
    // The first of the nodes at the same place.
    let mut name = vec![NONE; rest.positions_m.len()];
    for same in nodes.chunk_by(|left, right| place(*left) == place(*right)) {
        same.iter().for_each(|node| name[*node as usize] = same[0]);
    }
    let named = |(face, region): (Face, u32)| (sorted(face.map(|node| name[node as usize])), face, region);
    let mut all: Vec<(Face, Face, u32)> = bare.into_iter().map(named).collect();
    all.sort_unstable();
    let twins = all.chunk_by(|left, right| left.0 == right.0).filter(|same| same.len() == 2);
    twins.flatten().map(|(_, face, region)| (*face, *region)).collect()
}

/// What is asked of a rim for a vertex that has come apart.
#[derive(Debug)]
struct Wish {
    point: DVec3,
    region: u32,
    is_raw: bool,
    /// How far from it the rim may be, m.
    reach_m: f64,
}

impl Skin {
    /// Draws what has come apart onto the rim of the wound: all sides of it to the same place, each bound to its own tets. Tells how much of it found no room.
    pub(super) fn draw_to_rim(
        &mut self,
        place: &mut Neighbourhood<'_>,
        torn: &[Torn],
        on_sheet: &OnSheet,
        options: &CutOptions,
    ) -> usize {
        if torn.is_empty() {
            return 0;
        }
        let wishes: Vec<Wish> = torn.iter().map(|torn| self.wish(place, torn)).collect();
        let reached = wishes.iter().flat_map(|wish| [-wish.reach_m, wish.reach_m].map(|way_m| wish.point + DVec3::splat(way_m)));
        let corners = torn.iter().flat_map(|torn| &torn.triangles).flat_map(|one| self.triangles[one.triangle as usize]);
        let corners_m = corners.map(|vertex| self.rest_m[vertex as usize]);
        let rim = Rim::near(place.rest, on_sheet, &SingleBounds::around(reached.map(to_single).chain(corners_m)));
        for (torn, wish) in torn.iter().zip(&wishes) {
            if let Some(point) = rim.nearest(wish) {
                self.draw(place, torn, to_single(point));
            }
        }
        self.bend(place, torn, &rim, options)
    }

    fn wish(&self, place: &Neighbourhood<'_>, torn: &Torn) -> Wish {
        let point = at(&self.rest_m, torn.vertex);
        let corners = torn.triangles.iter().flat_map(|one| self.triangles[one.triangle as usize]);
        let size_m = corners.map(|corner| at(&self.rest_m, corner).distance(point)).fold(0.0, f64::max);
        let reach_m = size_m.min(FARTHEST_M) + outside_m(place, torn.triangles.iter(), point);
        let region = place.rest.regions[self.bindings[torn.vertex as usize].tet as usize];
        Wish { point, region, is_raw: self.raw[torn.vertex as usize], reach_m }
    }

    /// Moves a vertex that has come apart, and binds each of those that it has become to the nearest tet that its own triangles lead to.
    fn draw(&mut self, place: &mut Neighbourhood<'_>, torn: &Torn, point_m: [f32; 3]) {
        let point = at(&[point_m], 0);
        for vertex in torn.vertices() {
            self.rest_m[vertex as usize] = point_m;
            let has_it = |one: &&Hosted| self.triangles[one.triangle as usize].contains(&vertex);
            let own = torn.triangles.iter().filter(has_it);
            let around_m = radius_m(place, own.clone(), point);
            if place.parts_around(point, around_m, own.map(|one| one.home)) > 0 {
                self.bindings[vertex as usize] = bound(place, place.nearest_of(0), point);
            }
        }
    }

    /// Divides the edges that would cut off a corner of the rim, in the corner. Tells how many found no room.
    fn bend(&mut self, place: &mut Neighbourhood<'_>, torn: &[Torn], rim: &Rim, options: &CutOptions) -> usize {
        let mut vertices: Vec<u32> = torn.iter().flat_map(Torn::vertices).collect();
        vertices.sort_unstable();
        let mut triangles: Vec<Hosted> = torn.iter().flat_map(|torn| torn.triangles.iter().copied()).collect();
        triangles.sort_unstable_by_key(|one| one.triangle);
        triangles.dedup_by_key(|one| one.triangle);
        // By the edges, in their order.
        let (mut middles, mut out_of_room) = (Vec::new(), 0);
        for (edge, one) in self.open_edges(&triangles) {
            // Of the others not all triangles are known.
            if !edge.iter().any(|vertex| vertices.binary_search(vertex).is_ok()) {
                continue;
            }
            let Some(corner_m) = self.corner_within(edge, place, rim) else { continue };
            // Each division makes one triangle more.
            if self.rest_m.len() >= options.max_vertices || self.triangles.len() + middles.len() >= options.max_triangles {
                out_of_room += 1;
                continue;
            }
            let corner = at(&[corner_m], 0);
            let around_m = radius_m(place, iter::once(&one), corner);
            if place.parts_around(corner, around_m, iter::once(one.home)) > 0 {
                let binding = bound(place, place.nearest_of(0), corner);
                middles.push((edge, self.add(corner_m, binding, false)));
            }
        }
        if middles.is_empty() {
            return out_of_room;
        }
        for triangle in triangles.iter().map(|one| one.triangle as usize) {
            // The first part stands for the whole.
            let (whole, mut is_first) = (self.triangles[triangle], true);
            divided(whole, &middles, |part| {
                if std::mem::take(&mut is_first) {
                    self.triangles[triangle] = part;
                } else {
                    self.triangles.push(part);
                }
            });
        }
        out_of_room
    }

    /// The edges that one of some triangles has alone, with it; sorted.
    fn open_edges(&self, triangles: &[Hosted]) -> Vec<([u32; 2], Hosted)> {
        let edges_of = |one: &Hosted| {
            let [a, b, c] = self.triangles[one.triangle as usize];
            [[a, b], [b, c], [c, a]].map(|edge| (number_of_edge(edge), *one))
        };
        let mut edges: Vec<(u64, Hosted)> = triangles.iter().flat_map(edges_of).collect();
        edges.sort_unstable_by_key(|(number, one)| (*number, one.triangle));
        let alone = edges.chunk_by(|left, right| left.0 == right.0).filter(|same| same.len() == 1);
        alone.flatten().map(|(number, one)| (edge_of_number(*number), *one)).collect()
    }

    /// The corner of the rim that a straight edge between two places of it cuts off, if it is one; none of what a wire has laid open before.
    fn corner_within(&self, ends: [u32; 2], place: &Neighbourhood<'_>, rim: &Rim) -> Option<[f32; 3]> {
        if ends.iter().any(|end| self.raw[*end as usize]) {
            return None;
        }
        let region = place.rest.regions[self.bindings[ends[0] as usize].tet as usize];
        rim.corner_between(region, ends.map(|end| at(&self.rest_m, end)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORIGIN_M: [f32; 3] = [0.0; 3];
    const ALONG_M: [f32; 3] = [1.0, 0.0, 0.0];
    const ASIDE_M: [f32; 3] = [1.0, 1.0, 0.0];

    /// A rim of two edges, and the edge of the wound below their corner.
    fn bent() -> Rim {
        let edge = |ends_m: [[f32; 3]; 2]| Edge { region: 0, ends_m };
        let outer = vec![edge([ORIGIN_M, ALONG_M]), edge([ASIDE_M, ALONG_M])];
        Rim { outer, inner: vec![edge([ALONG_M, [1.0, 0.0, -1.0]])] }
    }

    /// Two tets that had a face in common, of which one node was copied; and one elsewhere, with a face on the sheet that was on the boundary before.
    #[test]
    fn the_rim_is_of_the_edges_that_one_open_face_has_alone_on_its_side() {
        let apart = |[x, y, z]: [f32; 3]| [x + 0.2, y + 0.2, z + 0.2];
        let (up_m, down_m) = ([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]);
        let mut positions_m = vec![ORIGIN_M, ALONG_M, ASIDE_M, up_m, down_m, ASIDE_M];
        positions_m.extend([ORIGIN_M, ALONG_M, ASIDE_M, up_m].map(apart));
        let rest = TetMesh { positions_m, tets: vec![[0, 1, 2, 3], [0, 5, 1, 4], [6, 7, 8, 9]], regions: vec![3, 4, 3] };
        let is_marked = (0..10).map(|node| ![3, 4, 9].contains(&node)).collect();
        let on_sheet = OnSheet { tets: vec![0, 1, 2], is_marked };
        let rim = Rim::near(&rest, &on_sheet, &SingleBounds::around([[-2.0; 3], [2.0; 3]]));
        let edge = |region: u32, from_m: [f32; 3]| Edge { region, ends_m: [from_m, ASIDE_M] };
        let outer = [edge(3, ORIGIN_M), edge(4, ORIGIN_M), edge(3, ALONG_M), edge(4, ALONG_M)];
        assert_eq!((rim.outer.len(), rim.inner.len()), (4, 1), "{rim:?}");
        assert!(outer.iter().all(|edge| rim.outer.contains(edge)), "{rim:?}");
        assert_eq!(rim.inner[0].ends_m, [ORIGIN_M, ALONG_M]);
        let elsewhere = Rim::near(&rest, &on_sheet, &SingleBounds::around([[5.0; 3], [6.0; 3]]));
        assert!(elsewhere.outer.is_empty() && elsewhere.inner.is_empty(), "{elsewhere:?}");
    }

    #[test]
    fn a_vertex_comes_to_the_nearest_point_of_the_rim_and_none_from_afar_or_from_within_the_wound() {
        let rim = bent();
        let wish =
            |[x, y, z]: [f64; 3], region: u32, is_raw: bool| Wish { point: DVec3::new(x, y, z), region, is_raw, reach_m: 0.3 };
        for (wish, expected) in [
            (wish([0.5, 0.1, 0.0], 0, false), Some(DVec3::new(0.5, 0.0, 0.0))),
            (wish([1.2, 0.25, 0.0], 0, true), Some(DVec3::new(1.0, 0.25, 0.0))),
            (wish([1.1, -0.1, 0.0], 0, false), Some(DVec3::X)),
            (wish([0.125, 0.0, 0.0], 0, false), Some(DVec3::new(0.125, 0.0, 0.0))),
            (wish([0.5, 0.5, 0.0], 0, false), None),
            (wish([0.5, 0.1, 0.0], 1, false), None),
            (wish([1.0, 0.0, -0.1], 0, true), None),
            // What is no wound lies there by chance.
            (wish([1.0, 0.0, -0.1], 0, false), Some(DVec3::X)),
        ] {
            assert_eq!(rim.nearest(&wish), expected, "{wish:?}");
        }
    }

    #[test]
    fn a_corner_is_between_two_places_of_the_rim_that_no_edge_of_it_joins() {
        let rim = bent();
        let [low, high, corner] = [DVec3::new(0.5, 0.0, 0.0), DVec3::new(1.0, 0.75, 0.0), DVec3::X];
        assert_eq!(rim.corner_between(0, [low, high]), Some(ALONG_M));
        assert_eq!(rim.corner_between(0, [high, low]), Some(ALONG_M));
        for (region, ends) in [(1, [low, high]), (0, [low, corner]), (0, [corner, high]), (0, [low, DVec3::ZERO])] {
            assert_eq!(rim.corner_between(region, ends), None, "{ends:?}");
        }
        let beside = DVec3::new(1.0, 0.75, 0.01);
        assert_eq!(rim.corner_between(0, [low, beside]), None, "it is on no edge");
    }
}
