//! The surface for the eye is cut with the volume: its triangles are divided where the sheet goes through them, each is then taken along by the tet
//! that it lies at, and two triangles come apart where no way leads through tets from one to the other: there they end at the rim of the wound. The faces
//! of the wound become triangles of their own.
//!
//! Promise: every vertex is bound to a tet that is there, with finite weights; no triangle has a vertex twice; what is far from the cut stays as it
//! was; without room nothing is divided, and the wound stays bare.

use super::cells::Cells;
use super::neighbourhood::Neighbourhood;
use super::places::{Sides, SingleBounds, Spot, at, barycentric, corners, edge_of_number, number_of_edge, to_single};
use super::rim::{OnSheet, Torn};
use super::sheet::Sheet;
use super::{CutOptions, Cuttable};
use glam::DVec3;
use hyst_mesh::{Binding, FACES, TetMesh, are_below, are_finite};
use std::collections::BTreeMap;

/// No edge of the surface is divided nearer to its end than this, m: a pixel or two of the picture.
const SHORTEST_M: f64 = 0.1e-3;
/// How far under a triangle its tet is looked for, as a share of its size: a triangle of a wound lies between two tets.
const UNDER_SHARE: f64 = 0.05;

/// The surface for the eye, in the shape at rest.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Skin {
    /// Its vertices at rest, m.
    pub rest_m: Vec<[f32; 3]>,
    /// Its triangles, outward by the right-hand rule.
    pub triangles: Vec<[u32; 3]>,
    /// The tet that each vertex follows.
    pub bindings: Vec<Binding>,
    /// Whether each vertex lies on a wound: what a cut laid open.
    pub raw: Vec<bool>,
}

impl Skin {
    /// Where its vertices are when the nodes of the tets are there, m. A vertex that is bound to nothing stays at rest.
    pub fn place(&self, tets: &[[u32; 4]], position_m: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let one = |(binding, rest): (&Binding, &[f32; 3])| {
            let Some(nodes) = tets.get(binding.tet as usize) else { return *rest };
            to_single(nodes.iter().zip(binding.weights).map(|(node, weight)| at(position_m, *node) * f64::from(weight)).sum())
        };
        self.bindings.iter().zip(&self.rest_m).map(one).collect()
    }

    /// Whether the lists fit each other and the tets.
    pub(super) fn is_sound(&self, tets: usize) -> bool {
        let vertices = self.rest_m.len();
        let is_finite = |weights: &[f32; 4]| weights.iter().fold(true, |all, weight| all & weight.is_finite());
        self.bindings.len() == vertices
            && self.raw.len() == vertices
            && self.bindings.iter().all(|binding| (binding.tet as usize) < tets && is_finite(&binding.weights))
            && are_below(vertices, self.triangles.as_flattened())
            && are_finite(self.rest_m.as_flattened())
    }

    pub(super) fn add(&mut self, rest_m: [f32; 3], binding: Binding, raw: bool) -> u32 {
        self.rest_m.push(rest_m);
        self.bindings.push(binding);
        self.raw.push(raw);
        self.rest_m.len() as u32 - 1
    }

    /// Divides the triangles that the sheet goes through. Tells how many edges found no room.
    pub(super) fn divide(&mut self, tissue: &Cuttable, sheet: &Sheet, options: &CutOptions) -> usize {
        let now_m = &self.place(&tissue.rest.tets, &tissue.position_m)[..];
        let sides: Vec<Sides> = now_m.iter().map(|vertex| sheet.sides(vertex)).collect();
        let is_near = |triangle: &&[u32; 3]| Sides::touch(triangle.map(|vertex| sides[vertex as usize]));
        let edges = self.triangles.iter().filter(is_near).flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]);
        let near = edges.filter(|edge| Sides::touch(edge.map(|vertex| sides[vertex as usize])));
        let mut edges: Vec<u64> = near.map(number_of_edge).collect();
        edges.sort_unstable();
        edges.dedup();
        // By the edges, in their order.
        let (mut middles, mut out_of_room) = (Vec::new(), 0);
        for [a, b] in edges.into_iter().map(edge_of_number) {
            let (from, to) = (at(now_m, a), at(now_m, b));
            let Some(crossing) = sheet.crossing(from, to) else { continue };
            let nearest_m = crossing.share.min(1.0 - crossing.share) * from.distance(to);
            if nearest_m < SHORTEST_M {
                continue;
            }
            // Each division makes at most two triangles more.
            let has_room =
                self.rest_m.len() < options.max_vertices && self.triangles.len() + 2 * middles.len() + 2 < options.max_triangles;
            if !has_room {
                out_of_room = 1;
                break;
            }
            let point = at(&self.rest_m, a).lerp(at(&self.rest_m, b), crossing.share);
            let tet = self.bindings[a as usize].tet;
            let binding = Binding { tet, weights: weights(&tissue.rest, tet, point) };
            let raw = self.raw[a as usize] && self.raw[b as usize];
            middles.push(([a, b], self.add(to_single(point), binding, raw)));
        }
        if middles.is_empty() {
            return out_of_room;
        }
        let whole = std::mem::take(&mut self.triangles);
        self.triangles.reserve(whole.len() + 2 * middles.len());
        for triangle in &whole {
            if is_near(&triangle) {
                divided(*triangle, &middles, |part| self.triangles.push(part));
            } else {
                self.triangles.push(*triangle);
            }
        }
        out_of_room
    }

    /// Binds anew what lies at the tets of its own object that have changed, lets come apart what no way through tets joins, and draws that to the rim of the
    /// stroke's wound. Tells how many vertices found no room.
    pub(super) fn bind_again(&mut self, rest: &TetMesh, changed: &[u32], on_sheet: &OnSheet, options: &CutOptions) -> usize {
        let around = |tet: &u32| SingleBounds::of_tet(&rest.positions_m, rest.tets[*tet as usize]);
        let boxes: Vec<SingleBounds> = changed.iter().map(around).collect();
        let box_of_change = boxes.iter().copied().reduce(SingleBounds::with);
        let Some(box_of_change) = box_of_change.filter(|_| !self.triangles.is_empty()) else { return 0 };
        let mut is_changed = vec![false; rest.tets.len()];
        changed.iter().for_each(|tet| is_changed[*tet as usize] = true);
        let (cells, object_of) = (Cells::new(&boxes), |tet: u32| rest.regions[tet as usize]);
        let is_loose = |vertex: u32| {
            let (spot, tet) = (Spot::at(&self.rest_m[vertex as usize]), self.bindings[vertex as usize].tet);
            let has_it = |index: &u32| boxes[*index as usize].has(&spot) && object_of(changed[*index as usize]) == object_of(tet);
            let is_in_one = || box_of_change.has(&spot) && cells.at(at(&self.rest_m, vertex)).iter().any(has_it);
            is_changed[tet as usize] || is_in_one()
        };
        let at_change: Vec<bool> = (0..self.rest_m.len() as u32).map(is_loose).collect();
        // Looks at all three: few triangles have one, and a branch for each vertex takes longer.
        let has = |triangle: &[u32; 3], of: &[bool]| triangle.iter().fold(false, |any, vertex| any | of[*vertex as usize]);
        // And their neighbours: a vertex outside of all tets may have followed one on the other side.
        let mut loose = at_change.clone();
        for triangle in self.triangles.iter().filter(|triangle| has(triangle, &at_change)) {
            triangle.iter().for_each(|vertex| loose[*vertex as usize] = true);
        }
        let near: Vec<u32> = (0..self.triangles.len() as u32).filter(|one| has(&self.triangles[*one as usize], &loose)).collect();
        let reach = self.around(&near).with(box_of_change);
        let unders: Vec<Under> = near.into_iter().map(|triangle| self.under(triangle)).collect();
        let asked_m = unders.iter().map(|under| under.point);
        let mut place = Neighbourhood::new(rest, reach.tets_in(&rest.positions_m, &rest.tets), asked_m);
        let hosted: Vec<Hosted> = unders.iter().filter_map(|under| self.host(&place, under)).collect();
        // Each loose vertex with its triangles, in their order.
        let (at_vertices, ends) = self.hosted_at(&loose, &hosted);
        let (mut first, mut out_of_room, mut torn) = (0, 0, Vec::new());
        for (vertex, end) in (0..).zip(ends) {
            let (own, known) = (&at_vertices[first..end], self.rest_m.len() as u32);
            out_of_room += self.part(&mut place, &hosted, (vertex, own), options);
            let copies = known..self.rest_m.len() as u32;
            if !copies.is_empty() {
                let triangles = own.iter().map(|index| hosted[*index as usize]).collect();
                torn.push(Torn { vertex, copies, triangles });
            }
            first = end;
        }
        out_of_room + self.draw_to_rim(&mut place, &torn, on_sheet, options)
    }

    /// The triangles at each of some vertices, by their places among those that are hosted and in their order; and where those of each vertex end. Sorted by
    /// counting.
    fn hosted_at(&self, is_one: &[bool], hosted: &[Hosted]) -> (Vec<u32>, Vec<usize>) {
        let corners = |(place, one): (u32, &Hosted)| self.triangles[one.triangle as usize].map(|vertex| (vertex as usize, place));
        let corners = (0..).zip(hosted).flat_map(corners).filter(|(vertex, _)| is_one[*vertex]);
        let mut ends = vec![0; is_one.len()];
        corners.clone().for_each(|(vertex, _)| ends[vertex] += 1);
        let mut all = 0;
        for end in &mut ends {
            all += std::mem::replace(end, all);
        }
        let mut at_vertices = vec![0; all];
        for (vertex, place) in corners {
            at_vertices[ends[vertex]] = place;
            ends[vertex] += 1;
        }
        (at_vertices, ends)
    }

    /// The box around some triangles at rest.
    fn around(&self, triangles: &[u32]) -> SingleBounds {
        let vertices = triangles.iter().flat_map(|triangle| self.triangles[*triangle as usize]);
        SingleBounds::around(vertices.map(|vertex| self.rest_m[vertex as usize]))
    }

    /// The point just under the middle of a triangle.
    fn under(&self, triangle: u32) -> Under {
        let [a, b, c] = self.triangles[triangle as usize].map(|vertex| at(&self.rest_m, vertex));
        let (middle, outward) = ((a + b + c) / 3.0, (b - a).cross(c - a).normalize_or_zero());
        Under { triangle, point: middle - outward * (UNDER_SHARE * middle.distance(a)), middle }
    }

    /// The tet that a triangle lies at: the one around the point under it, or the nearest; of the object that it was bound to.
    fn host(&self, place: &Neighbourhood<'_>, under: &Under) -> Option<Hosted> {
        let [first, ..] = self.triangles[under.triangle as usize];
        let region = place.rest.regions[self.bindings[first as usize].tet as usize];
        let home = place.home(under.point, |index| place.region(index) == region)?;
        Some(Hosted { triangle: under.triangle, home, middle: under.middle })
    }

    /// Gives each part of the triangles at a vertex a vertex of its own, bound to the nearest tet of that part. `own`: the places of these triangles among
    /// those that are hosted. Tells how many found no room.
    fn part(
        &mut self,
        place: &mut Neighbourhood<'_>,
        hosted: &[Hosted],
        (vertex, own): (u32, &[u32]),
        options: &CutOptions,
    ) -> usize {
        if own.is_empty() {
            return 0;
        }
        let triangles = || own.iter().map(|index| &hosted[*index as usize]);
        let point = at(&self.rest_m, vertex);
        let around_m = radius_m(place, triangles(), point);
        let mut out_of_room = 0;
        for number in 0..place.parts_around(point, around_m, triangles().map(|one| one.home)) {
            let binding = bound(place, place.nearest_of(number), point);
            if number == 0 {
                self.bindings[vertex as usize] = binding;
                continue;
            }
            if self.rest_m.len() >= options.max_vertices {
                out_of_room += 1;
                continue;
            }
            let name = self.add(self.rest_m[vertex as usize], binding, self.raw[vertex as usize]);
            for one in triangles().filter(|one| place.part_of(one.home) == number) {
                let corners = &mut self.triangles[one.triangle as usize];
                *corners = corners.map(|corner| if corner == vertex { name } else { corner });
            }
        }
        out_of_room
    }

    /// Lets come apart what still joins two parts: a vertex that its triangles share follows one tet for as long as a way leads from one to the other, and is not
    /// looked at again where the wire goes through that way at some distance. No vertex is left without a triangle. `part_of_tet`: the part of each tet. Tells
    /// how many vertices found no room.
    pub(super) fn part_by(&mut self, rest: &TetMesh, part_of_tet: &[u32], options: &CutOptions) -> usize {
        // Once for each vertex: some six triangles have it.
        let part_of: Vec<u32> = self.bindings.iter().map(|binding| part_of_tet[binding.tet as usize]).collect();
        let joins = |triangle: &u32| {
            let [a, b, c] = self.triangles[*triangle as usize].map(|vertex| part_of[vertex as usize]);
            (a != b) | (b != c)
        };
        let joining: Vec<u32> = (0..self.triangles.len() as u32).filter(joins).collect();
        if joining.is_empty() {
            return 0;
        }
        let unders: Vec<Under> = joining.iter().map(|triangle| self.under(*triangle)).collect();
        let vertices = joining.iter().flat_map(|triangle| self.triangles[*triangle as usize]);
        let asked_m = unders.iter().map(|under| under.point).chain(vertices.map(|vertex| at(&self.rest_m, vertex)));
        let place = Neighbourhood::new(rest, self.around(&joining).tets_in(&rest.positions_m, &rest.tets), asked_m);
        // Where there is nothing of a triangle's object near it, it goes with its first corner.
        let tet_of = |under: &Under| {
            let [first, ..] = self.triangles[under.triangle as usize];
            self.host(&place, under).map_or(self.bindings[first as usize].tet, |one| place.tets[one.home as usize])
        };
        let homes: Vec<u32> = unders.iter().map(tet_of).collect();
        // How many triangles each vertex has, without those that it is to have another one for.
        let mut uses = vec![0_u32; self.rest_m.len()];
        self.triangles.as_flattened().iter().for_each(|vertex| uses[*vertex as usize] += 1);
        for (triangle, tet) in joining.iter().zip(&homes) {
            let leaves = |vertex: &u32| part_of[*vertex as usize] != part_of_tet[*tet as usize];
            let corners = self.triangles[*triangle as usize];
            corners.iter().filter(|vertex| leaves(vertex)).for_each(|vertex| uses[*vertex as usize] -= 1);
        }
        let (mut own, mut out_of_room) = (BTreeMap::new(), 0);
        for (triangle, home) in joining.into_iter().zip(homes) {
            let part = part_of_tet[home as usize];
            for corner in 0..3 {
                let vertex = self.triangles[triangle as usize][corner];
                if part_of[vertex as usize] == part {
                    continue;
                }
                // One that no triangle would have any more goes along itself: else it would stay, and nobody would bind it again.
                let (known, is_left) = (own.get(&(vertex, part)).copied(), uses[vertex as usize] == 0);
                if known.is_none() && !is_left && self.rest_m.len() >= options.max_vertices {
                    out_of_room += 1;
                    continue;
                }
                let name = known.unwrap_or_else(|| {
                    let point = at(&self.rest_m, vertex);
                    let nearest = place.home(point, |index| part_of_tet[place.tets[index as usize] as usize] == part);
                    let tet = nearest.map_or(home, |index| place.tets[index as usize]);
                    let binding = Binding { tet, weights: weights(rest, tet, point) };
                    if !is_left {
                        return self.add(self.rest_m[vertex as usize], binding, self.raw[vertex as usize]);
                    }
                    (self.bindings[vertex as usize], uses[vertex as usize]) = (binding, 1);
                    vertex
                });
                own.insert((vertex, part), name);
                self.triangles[triangle as usize][corner] = name;
            }
        }
        out_of_room
    }

    /// The faces that were opened, on both sides. `opened`: the tets that had each in common.
    /// Tells how many found no room.
    pub(super) fn add_wound(&mut self, rest: &TetMesh, opened: &[[u32; 2]], options: &CutOptions) -> usize {
        let mut own: BTreeMap<u32, u32> = BTreeMap::new();
        let mut out_of_room = 0;
        for (tet, other) in opened.iter().flat_map(|[a, b]| [(*a, *b), (*b, *a)]) {
            if self.rest_m.len() + 3 > options.max_vertices || self.triangles.len() >= options.max_triangles {
                out_of_room += 1;
                continue;
            }
            let Some(face) = face_beside(rest, tet, other) else { continue };
            let corners = face.map(|place| {
                let node = rest.tets[tet as usize][place];
                let mut weights = [0.0; 4];
                weights[place] = 1.0;
                *own.entry(node).or_insert_with(|| self.add(rest.positions_m[node as usize], Binding { tet, weights }, true))
            });
            self.triangles.push(corners);
        }
        out_of_room
    }

    /// Leaves out what was bound to tets that are gone, and the vertices that no triangle has. `number`: the new number of each tet that is left.
    pub fn without_tets(&mut self, number: &[Option<u32>]) {
        let is_there = |vertex: &u32| number[self.bindings[*vertex as usize].tet as usize].is_some();
        let kept: Vec<[u32; 3]> = self.triangles.iter().filter(|triangle| triangle.iter().all(is_there)).copied().collect();
        let mut is_used = vec![false; self.rest_m.len()];
        kept.iter().flatten().for_each(|vertex| is_used[*vertex as usize] = true);
        let mut new_number = vec![0; self.rest_m.len()];
        let mut left = Skin::default();
        for vertex in (0..self.rest_m.len()).filter(|vertex| is_used[*vertex]) {
            let binding = self.bindings[vertex];
            if let Some(tet) = number[binding.tet as usize] {
                new_number[vertex] = left.add(self.rest_m[vertex], Binding { tet, ..binding }, self.raw[vertex]);
            }
        }
        left.triangles = kept.into_iter().map(|triangle| triangle.map(|vertex| new_number[vertex as usize])).collect();
        *self = left;
    }
}

/// The parts of a triangle whose edges have these middles, which are sorted by them.
pub fn divided(triangle: [u32; 3], middles: &[([u32; 2], u32)], mut take: impl FnMut([u32; 3])) {
    let [a, b, c] = triangle;
    let middle = |from: u32, to: u32| {
        let place = middles.binary_search_by_key(&[from.min(to), from.max(to)], |(edge, _)| *edge);
        place.ok().map(|place| middles[place].1)
    };
    match (middle(a, b), middle(b, c), middle(c, a)) {
        (None, None, None) => take(triangle),
        (Some(ab), None, None) => [[a, ab, c], [ab, b, c]].into_iter().for_each(take),
        (None, Some(bc), None) => [[b, bc, a], [bc, c, a]].into_iter().for_each(take),
        (None, None, Some(ca)) => [[c, ca, b], [ca, a, b]].into_iter().for_each(take),
        (Some(ab), Some(bc), None) => [[ab, b, bc], [a, ab, bc], [a, bc, c]].into_iter().for_each(take),
        (None, Some(bc), Some(ca)) => [[bc, c, ca], [b, bc, ca], [b, ca, a]].into_iter().for_each(take),
        (Some(ab), None, Some(ca)) => [[ca, a, ab], [c, ca, ab], [c, ab, b]].into_iter().for_each(take),
        (Some(ab), Some(bc), Some(ca)) => [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]].into_iter().for_each(take),
    }
}

/// Weights of the corners of a tet for a point, in the shape at rest.
fn weights(rest: &TetMesh, tet: u32, point: DVec3) -> [f32; 4] {
    let all = barycentric(corners(&rest.positions_m, rest.tets[tet as usize]), point).map(|weight| weight as f32);
    if all.iter().all(|weight| weight.is_finite()) { all } else { [0.25; 4] }
}

/// How far a point lies outside of the tets that some triangles lie at: of that of which it is farthest outside, m.
pub fn outside_m<'h>(place: &Neighbourhood<'_>, triangles: impl Iterator<Item = &'h Hosted>, point: DVec3) -> f64 {
    triangles.map(|one| -place.depth_m(one.home, point)).fold(0.0, f64::max)
}

/// How far around a point ways are looked for from tet to tet, m: no farther than to the middles of its triangles, and what it lies outside of their tets.
pub fn radius_m<'h>(place: &Neighbourhood<'_>, triangles: impl Iterator<Item = &'h Hosted> + Clone, point: DVec3) -> f64 {
    let middles_m2 = triangles.clone().map(|one| one.middle.distance_squared(point));
    outside_m(place, triangles, point) + middles_m2.fold(0.0, f64::max).sqrt()
}

/// A point bound to a tet of a neighbourhood.
pub fn bound(place: &Neighbourhood<'_>, index: u32, point: DVec3) -> Binding {
    let tet = place.tets[index as usize];
    Binding { tet, weights: weights(place.rest, tet, point) }
}

/// The face of a tet that another one had in common with it: its nodes lie at the same places at rest.
fn face_beside(rest: &TetMesh, tet: u32, other: u32) -> Option<[usize; 3]> {
    let [own, others] = [tet, other].map(|tet| rest.tets[tet as usize].map(|node| rest.positions_m[node as usize]));
    FACES.into_iter().find(|face| face.iter().all(|place| others.contains(&own[*place])))
}

/// A triangle with the point just under its middle, and the middle, at rest.
struct Under {
    triangle: u32,
    point: DVec3,
    middle: DVec3,
}

/// A triangle with the tet that it lies at, by its index in the neighbourhood, and its middle at rest.
#[derive(Clone, Copy)]
pub struct Hosted {
    pub triangle: u32,
    pub home: u32,
    pub middle: DVec3,
}
