//! Opens the faces that lie between the two sides of the sheet.

use super::CutReport;
use super::fans::{Fan, faces_at, fan, fan_of};
use super::places::at;
use super::refine::Work;
use glam::DVec3;
use std::iter;

/// Times that faces are taken back because of what they would make of the boundary; after these none is opened before the next sweep of the stroke.
const ROUNDS: usize = 12;

/// A face by its sorted nodes.
pub type Face = [u32; 3];
/// A node and the parts of its star that get a copy each.
type Parting = (u32, Vec<Vec<u32>>);

impl Work<'_> {
    /// Opens what can be opened of the faces on the sheet; gives the two tets of each that is open now.
    pub fn open(&mut self, report: &mut CutReport) -> Vec<[u32; 2]> {
        self.on_sheet = self.tets_on_sheet();
        let before = report.out_of_room;
        let mut opened = self.open_faces(self.faces_on_sheet(), report);
        // Without room for copies all of the sheet is closed, and nothing can be freed.
        if report.out_of_room == before {
            opened.extend(self.free_enclosed(report));
        }
        opened
    }

    /// The same of these faces, which are sorted.
    pub fn open_faces(&mut self, mut faces: Vec<Face>, report: &mut CutReport) -> Vec<[u32; 2]> {
        let wanted = faces.len();
        let mut asked = nodes_of(&faces);
        for round in 0..ROUNDS {
            let partings: Vec<Parting> = asked.iter().filter_map(|node| self.parting(*node, &faces)).collect();
            let has_room = partings.iter().map(|(_, parts)| parts.len()).sum::<usize>() <= self.room();
            if partings.is_empty() || !has_room || round + 1 == ROUNDS {
                report.out_of_room += usize::from(!has_room);
                report.closed_faces += wanted;
                break;
            }
            let tets: Vec<Option<[u32; 2]>> = faces.iter().map(|face| self.tets_at(face)).collect();
            let nodes = self.star.nodes();
            let copies = self.part(&partings);
            let bad = self.spoilt_nodes(&partings, &copies);
            if bad.is_empty() {
                report.copied_nodes += copies.len();
                let opened = faces.iter().zip(tets).filter(|(face, _)| !self.is_closed(face));
                let opened: Vec<[u32; 2]> = opened.filter_map(|(_, tets)| tets).collect();
                report.opened_faces += opened.len();
                report.closed_faces += wanted - opened.len();
                return opened;
            }
            self.join_again(&partings, &copies, nodes);
            faces = self.without(faces, &bad);
            // A star that hangs together hangs together by more faces, too: no other node is parted any more.
            let was_parted = |node: &u32| partings.binary_search_by_key(node, |(node, _)| *node).is_ok();
            asked = nodes_of(&faces).into_iter().filter(was_parted).collect();
        }
        Vec::new()
    }

    /// Faces between two tets on different sides whose nodes all lie on the sheet.
    fn faces_on_sheet(&self) -> Vec<Face> {
        let sides = self.sides();
        let marked = self.marked_faces().into_iter();
        marked.filter(|(_, [first, second])| sides[*first as usize] != sides[*second as usize]).map(|(face, _)| face).collect()
    }

    /// Faces between two tets, with these, whose nodes all lie on the sheet; sorted.
    pub fn marked_faces(&self) -> Vec<(Face, [u32; 2])> {
        let mut faces: Vec<(Face, u32)> = Vec::with_capacity(2 * self.on_sheet.len());
        for tet in &self.on_sheet {
            let marked = self.faces_of(*tet).into_iter().filter(|face| face.iter().all(|node| self.is_marked(*node)));
            faces.extend(marked.map(|face| (face, *tet)));
        }
        // As one number each, which takes one comparison.
        let names = |([a, b, c], tet): &(Face, u32)| {
            u128::from(*a) << 96 | u128::from(*b) << 64 | u128::from(*c) << 32 | u128::from(*tet)
        };
        faces.sort_unstable_by_key(names);
        let with_both = |same: &[(Face, u32)]| {
            if let [(face, first), (_, second)] = same { Some((*face, [*first, *second])) } else { None }
        };
        faces.chunk_by(|left, right| left.0 == right.0).filter_map(with_both).collect()
    }

    /// The tets that have a face on the sheet at least, in their order.
    fn tets_on_sheet(&self) -> Vec<u32> {
        let is_marked: Vec<bool> = (0..self.star.nodes() as u32).map(|node| self.is_marked(node)).collect();
        let marked = |tet: &[u32; 4]| tet.iter().filter(|node| is_marked[**node as usize]).count();
        (0..).zip(&self.tissue.rest.tets).filter(|(_, tet)| marked(tet) >= 3).map(|(tet, _)| tet).collect()
    }

    /// On which side of the sheet each tet is that has a face on it. A tet that lies in the sheet with all its nodes is where most of its faces'
    /// area leads to.
    fn sides(&self) -> Vec<bool> {
        let mut sides = vec![Some(false); self.tissue.rest.tets.len()];
        let mut unknown = Vec::new();
        for tet in &self.on_sheet {
            let nodes = self.tissue.rest.tets[*tet as usize];
            let lies_in_it = nodes.iter().all(|node| self.is_marked(*node));
            sides[*tet as usize] = if lies_in_it { None } else { Some(self.is_above(*tet)) };
            unknown.extend(lies_in_it.then_some(*tet));
        }
        // Each round finds at least one.
        while !unknown.is_empty() {
            let found: Vec<(u32, Option<bool>)> =
                unknown.iter().map(|tet| (*tet, self.side_by_neighbours(*tet, &sides))).collect();
            let nothing_new = found.iter().all(|(_, side)| side.is_none());
            for (tet, side) in found {
                sides[tet as usize] = if nothing_new { Some(true) } else { side };
            }
            unknown.retain(|tet| sides[*tet as usize].is_none());
        }
        sides.into_iter().map(|side| side.unwrap_or(true)).collect()
    }

    /// The side that most of a tet's faces lead to, by area; `None` while none of its neighbours is known.
    fn side_by_neighbours(&self, tet: u32, sides: &[Option<bool>]) -> Option<bool> {
        let nodes = self.tissue.rest.tets[tet as usize];
        let mut above = 0.0;
        let mut is_known = false;
        for apex in nodes {
            let mut face = nodes.into_iter().filter(|node| *node != apex);
            let (Some(a), Some(b), Some(c)) = (face.next(), face.next(), face.next()) else { continue };
            let has_face = |other: &&u32| {
                **other != tet && [a, b, c].iter().all(|node| self.tissue.rest.tets[**other as usize].contains(node))
            };
            let Some(side) = self.star.of(a).iter().find(has_face).and_then(|other| sides[*other as usize]) else {
                continue;
            };
            let [a, b, c] = [a, b, c].map(|node| at(&self.tissue.rest.positions_m, node));
            let area = (b - a).cross(c - a).length();
            above += if side { area } else { -area };
            is_known = true;
        }
        is_known.then_some(above >= 0.0)
    }

    /// On which side of the sheet a tet is that has three nodes on it.
    fn is_above(&self, tet: u32) -> bool {
        let nodes = self.tissue.rest.tets[tet as usize];
        let rest_m = &self.tissue.rest.positions_m;
        let those = |are_on: bool| nodes.iter().copied().filter(move |node| self.is_marked(*node) == are_on);
        let middle = |are_on: bool| {
            let sum = those(are_on).map(|node| at(rest_m, node)).sum::<DVec3>();
            sum / those(are_on).count().max(1) as f64
        };
        let normal = those(true).map(|node| self.mark(node)).sum::<DVec3>();
        normal.dot(middle(false) - middle(true)) >= 0.0
    }

    /// The parts of a node's star that hang together by faces other than these, without the first; `None` if there is one part only.
    fn parting(&self, node: u32, faces: &[Face]) -> Option<Parting> {
        let star = self.star.of(node);
        // Few of these faces are at the node, and among few one is found sooner than among all.
        let open: Vec<[u32; 2]> = faces.iter().filter_map(|face| others_of(face, node)).collect();
        let mut part: Vec<usize> = (0..star.len()).collect();
        for same in faces_at(self, node).chunk_by(|left, right| left.0 == right.0) {
            let [(others, first), (_, second)] = same else { continue };
            let (kept, joined) = (part[*first].min(part[*second]), part[*first].max(part[*second]));
            if kept < joined && !open.contains(others) {
                part.iter_mut().filter(|part| **part == joined).for_each(|part| *part = kept);
            }
        }
        // Most stars hang together.
        if part.iter().all(|part| *part == 0) {
            return None;
        }
        let mut names = part.clone();
        names.sort_unstable();
        names.dedup();
        let of_part = |name: &usize| star.iter().zip(&part).filter(|(_, part)| *part == name).map(|(tet, _)| *tet).collect();
        let parts: Vec<Vec<u32>> = names.iter().skip(1).map(of_part).collect();
        (!parts.is_empty()).then_some((node, parts))
    }

    /// Copies each node for its parts; gives the copies with their originals.
    fn part(&mut self, partings: &[Parting]) -> Vec<[u32; 2]> {
        let mut copies = Vec::new();
        for (node, parts) in partings {
            for part in parts {
                let copy = self.copy_node(*node);
                for tet in part {
                    self.rename(*tet, *node, copy);
                }
                self.star.retain(*node, |tet| !part.contains(&tet));
                self.star.clear(copy);
                self.star.extend(copy, part);
                copies.push([copy, *node]);
            }
        }
        copies
    }

    /// Undoes [`Work::part`], before which there were so many nodes: all is as before, but for the places of nodes that no tet uses.
    fn join_again(&mut self, partings: &[Parting], copies: &[[u32; 2]], nodes: usize) {
        let parts = partings.iter().flat_map(|(_, parts)| parts);
        for ([copy, node], part) in copies.iter().zip(parts) {
            for tet in part {
                self.rename(*tet, *copy, *node);
            }
            self.star.extend(*node, part);
            self.star.sort(*node);
            self.star.clear(*copy);
        }
        for [copy, _] in copies.iter().rev() {
            if (*copy as usize) < nodes {
                self.free.push(*copy);
                continue;
            }
            // The last one: those that were added go in the reverse of the order in which they came.
            let tissue = &mut *self.tissue;
            for points in [&mut tissue.rest.positions_m, &mut tissue.position_m, &mut tissue.velocity_m_s, &mut tissue.marks] {
                points.pop();
            }
            tissue.fixed.pop();
            self.star.drop_node();
        }
    }

    fn rename(&mut self, tet: u32, from: u32, to: u32) {
        let nodes = &mut self.tissue.rest.tets[tet as usize];
        *nodes = nodes.map(|node| if node == from { to } else { node });
        self.touched.push(tet);
    }

    /// Nodes at and around the partings, by their originals, at which the boundary is no surface, and was one without the copies.
    fn spoilt_nodes(&self, partings: &[Parting], copies: &[[u32; 2]]) -> Vec<u32> {
        let nodes = self.torn_nodes(partings, copies);
        let original = |node: u32| copies.iter().find(|[copy, _]| *copy == node).map_or(node, |[_, original]| *original);
        let mut bad: Vec<u32> = nodes.into_iter().filter(|node| fan(self, *node) == Fan::Bad).map(original).collect();
        bad.sort_unstable();
        bad.dedup();
        bad.retain(|node| {
            let copies = copies.iter().filter(|[_, original]| original == node).map(|[copy, _]| *copy);
            let tets = copies.chain([*node]).flat_map(|node| self.star.of(node));
            fan_of(tets.map(|tet| self.tissue.rest.tets[*tet as usize].map(original)), *node) != Fan::Bad
        });
        bad
    }

    /// The nodes that partings may spoil, sorted: those that were parted, their copies, and those whose stars have two of what was one node. At every other one
    /// the boundary is what it was, but for the names of nodes. The copies are in the order of the partings.
    fn torn_nodes(&self, partings: &[Parting], copies: &[[u32; 2]]) -> Vec<u32> {
        let mut copies = copies.iter().map(|[copy, _]| *copy);
        let mut torn = Vec::new();
        // For each node the last parted one whose star it was seen in, or in that of a copy of it, and which of these it was.
        let mut seen_in = vec![None; self.star.nodes()];
        for (original, parts) in partings {
            for node in iter::once(*original).chain(copies.by_ref().take(parts.len())) {
                torn.push(node);
                for other in self.star.of(node).iter().flat_map(|tet| self.tissue.rest.tets[*tet as usize]) {
                    let before = seen_in[other as usize].replace((*original, node));
                    torn.extend(before.filter(|(of, by)| of == original && *by != node).map(|_| other));
                }
            }
        }
        torn.sort_unstable();
        torn.dedup();
        torn
    }

    /// The faces without those at bad nodes; without those near them, if these have none.
    fn without(&self, faces: Vec<Face>, bad: &[u32]) -> Vec<Face> {
        let keep = |bad: &[u32]| -> Vec<Face> {
            let is_good = |face: &&Face| !face.iter().any(|node| bad.binary_search(node).is_ok());
            faces.iter().filter(is_good).copied().collect()
        };
        let kept = keep(bad);
        if kept.len() < faces.len() {
            return kept;
        }
        let tets = bad.iter().flat_map(|node| self.star.of(*node).iter());
        let mut near: Vec<u32> = tets.flat_map(|tet| self.tissue.rest.tets[*tet as usize]).collect();
        near.sort_unstable();
        let kept = keep(&near);
        if kept.len() < faces.len() { kept } else { Vec::new() }
    }

    /// The two tets that have a face in common.
    pub fn tets_at(&self, face: &Face) -> Option<[u32; 2]> {
        let [first, others @ ..] = face;
        let has = |tet: &&u32| others.iter().all(|node| self.tissue.rest.tets[**tet as usize].contains(node));
        let mut both = self.star.of(*first).iter().filter(has);
        Some([*both.next()?, *both.next()?])
    }

    /// Whether the two tets of a face still have the same three nodes.
    fn is_closed(&self, face: &Face) -> bool {
        self.tets_at(face).is_some()
    }
}

/// The other two nodes of a face that has a node.
fn others_of([a, b, c]: &Face, node: u32) -> Option<[u32; 2]> {
    if *a == node {
        Some([*b, *c])
    } else if *b == node {
        Some([*a, *c])
    } else {
        (*c == node).then_some([*a, *b])
    }
}

fn nodes_of(faces: &[Face]) -> Vec<u32> {
    let mut nodes: Vec<u32> = faces.as_flattened().to_vec();
    nodes.sort_unstable();
    nodes.dedup();
    nodes
}

#[cfg(test)]
mod tests;
