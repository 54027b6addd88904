//! Opens the faces that lie between the two sides of the sheet.

use super::fans::{Fan, faces_at, fan};
use super::refine::Work;
use super::{CutReport, DVec3, at};

/// Least cosine between a face and the sheet: a face whose three nodes lie on a bent sheet may lie across it.
const ALONG_SHEET: f64 = 0.3;
/// Times that faces are taken back because of what they would make of the boundary; after these none is opened.
const ROUNDS: usize = 12;

/// A face by its sorted nodes.
type Face = [u32; 3];
/// A node and the parts of its star that get a copy each.
type Parting = (u32, Vec<Vec<u32>>);

impl Work<'_> {
    /// Opens what can be opened of the faces on the sheet.
    pub fn open(&mut self, report: &mut CutReport) {
        let mut faces = self.faces_on_sheet();
        let wanted = faces.len();
        let nodes = self.tissue.rest.positions_m.len();
        for round in 0..ROUNDS {
            let partings: Vec<Parting> = nodes_of(&faces).into_iter().filter_map(|node| self.parting(node, &faces)).collect();
            let has_room = nodes + partings.iter().map(|(_, parts)| parts.len()).sum::<usize>() <= self.options.max_nodes;
            if partings.is_empty() || !has_room || round + 1 == ROUNDS {
                report.out_of_room += usize::from(!has_room);
                report.closed_faces = wanted;
                return;
            }
            let bad_before = self.bad_nodes(&partings, &[]);
            let copies = self.part(&partings);
            let bad: Vec<u32> = self.bad_nodes(&partings, &copies).into_iter().filter(|bad| !bad_before.contains(bad)).collect();
            if bad.is_empty() {
                report.copied_nodes = copies.len();
                report.opened_faces = faces.iter().filter(|face| !self.is_closed(face)).count();
                report.closed_faces = wanted - report.opened_faces;
                return;
            }
            self.join_again(&partings, nodes);
            faces = self.without(faces, &bad);
        }
    }

    /// Faces between two tets on different sides whose nodes all lie on the sheet.
    fn faces_on_sheet(&self) -> Vec<Face> {
        let mut faces = Vec::new();
        for node in (0..self.star.len() as u32).filter(|node| self.is_marked(*node)) {
            for same in faces_at(self, node).chunk_by(|left, right| left.0 == right.0) {
                let [([a, b], first), (_, second)] = same else { continue };
                // Each face is met at each of its nodes.
                if node < *a && self.is_marked(*a) && self.is_marked(*b) && self.is_between([node, *a, *b], [*first, *second]) {
                    faces.push([node, *a, *b]);
                }
            }
        }
        faces.sort_unstable();
        faces
    }

    fn is_between(&self, face: Face, tets: [u32; 2]) -> bool {
        let rest_m = &self.tissue.rest.positions_m;
        let [a, b, c] = face.map(|node| at(rest_m, node));
        let sheet = face.iter().map(|node| self.mark(*node)).sum::<DVec3>().normalize_or_zero();
        let across = (b - a).cross(c - a).normalize_or_zero();
        let [first, second] = tets.map(|tet| self.is_above(tet));
        sheet.dot(across).abs() >= ALONG_SHEET && first != second
    }

    /// On which side of the sheet a tet is that has a face on it. One that lies in the sheet with all its nodes is above.
    fn is_above(&self, tet: u32) -> bool {
        let nodes = self.tissue.rest.tets[tet as usize];
        let rest_m = &self.tissue.rest.positions_m;
        let (mut on, mut off, mut normal) = ((DVec3::ZERO, 0.0), (DVec3::ZERO, 0.0), DVec3::ZERO);
        for node in nodes {
            let sum = if self.is_marked(node) { &mut on } else { &mut off };
            *sum = (sum.0 + at(rest_m, node), sum.1 + 1.0);
            normal += self.mark(node);
        }
        off.1 == 0.0 || normal.dot(off.0 / off.1 - on.0 / on.1) >= 0.0
    }

    /// The parts of a node's star that hang together by faces other than these, without the first; `None` if there is one part only.
    fn parting(&self, node: u32, faces: &[Face]) -> Option<Parting> {
        let star = &self.star[node as usize];
        let mut part: Vec<usize> = (0..star.len()).collect();
        let place = |tet: u32| star.iter().position(|other| *other == tet);
        for same in faces_at(self, node).chunk_by(|left, right| left.0 == right.0) {
            let [([a, b], first), (_, second)] = same else { continue };
            let mut face = [node, *a, *b];
            face.sort_unstable();
            if faces.binary_search(&face).is_ok() {
                continue;
            }
            let (Some(first), Some(second)) = (place(*first), place(*second)) else { continue };
            let (kept, joined) = (part[first].min(part[second]), part[first].max(part[second]));
            part.iter_mut().filter(|part| **part == joined).for_each(|part| *part = kept);
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
                self.star[*node as usize].retain(|tet| !part.contains(tet));
                self.star[copy as usize].clone_from(part);
                copies.push([copy, *node]);
            }
        }
        copies
    }

    /// Undoes [`Work::part`]: there are so many nodes again.
    fn join_again(&mut self, partings: &[Parting], nodes: usize) {
        let mut copy = nodes as u32;
        for (node, parts) in partings {
            for part in parts {
                for tet in part {
                    self.rename(*tet, copy, *node);
                }
                self.star[*node as usize].extend(part);
                self.star[*node as usize].sort_unstable();
                copy += 1;
            }
        }
        let tissue = &mut *self.tissue;
        for points in [&mut tissue.rest.positions_m, &mut tissue.position_m, &mut tissue.velocity_m_s, &mut tissue.marks] {
            points.truncate(nodes);
        }
        tissue.fixed.truncate(nodes);
        self.star.truncate(nodes);
    }

    fn copy_node(&mut self, node: u32) -> u32 {
        let tissue = &mut *self.tissue;
        for points in [&mut tissue.rest.positions_m, &mut tissue.position_m, &mut tissue.velocity_m_s, &mut tissue.marks] {
            points.push(points[node as usize]);
        }
        tissue.fixed.push(tissue.fixed[node as usize]);
        self.star.push(Vec::new());
        (self.star.len() - 1) as u32
    }

    fn rename(&mut self, tet: u32, from: u32, to: u32) {
        let nodes = &mut self.tissue.rest.tets[tet as usize];
        *nodes = nodes.map(|node| if node == from { to } else { node });
    }

    /// Nodes around the partings, by their originals, at which the boundary is no surface.
    fn bad_nodes(&self, partings: &[Parting], copies: &[[u32; 2]]) -> Vec<u32> {
        let parted = partings.iter().map(|(node, _)| *node).chain(copies.iter().map(|[copy, _]| *copy));
        let tets = parted.flat_map(|node| self.star[node as usize].iter().copied());
        let mut nodes: Vec<u32> = tets.flat_map(|tet| self.tissue.rest.tets[tet as usize]).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let original = |node: u32| copies.iter().find(|[copy, _]| *copy == node).map_or(node, |[_, original]| *original);
        let mut bad: Vec<u32> = nodes.into_iter().filter(|node| fan(self, *node) == Fan::Bad).map(original).collect();
        bad.sort_unstable();
        bad.dedup();
        bad
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
        let tets = bad.iter().flat_map(|node| self.star[*node as usize].iter());
        let mut near: Vec<u32> = tets.flat_map(|tet| self.tissue.rest.tets[*tet as usize]).collect();
        near.sort_unstable();
        let kept = keep(&near);
        if kept.len() < faces.len() { kept } else { Vec::new() }
    }

    /// Whether the two tets of a face still have the same three nodes.
    fn is_closed(&self, face: &Face) -> bool {
        let has = |tet: &&u32| face.iter().all(|node| self.tissue.rest.tets[**tet as usize].contains(node));
        self.star[face[0] as usize].iter().filter(has).count() == 2
    }
}

fn nodes_of(faces: &[Face]) -> Vec<u32> {
    let mut nodes: Vec<u32> = faces.as_flattened().to_vec();
    nodes.sort_unstable();
    nodes.dedup();
    nodes
}
