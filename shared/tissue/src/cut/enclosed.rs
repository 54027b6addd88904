//! Frees what the sheet encloses. Which side of the sheet a tet is on is guessed from the nodes around it, so that now and then a face
//! behind the wire stays closed, for which a chip of a hundred tets would hang on. Once there is no way from a piece to the rest but
//! through faces that the sheet has passed, all of these are opened, whichever side their tets were taken to be on.

use super::CutReport;
use super::places::{at, corners, sorted};
use super::refine::Work;
use super::separate::Face;
use glam::DVec3;
use hyst_mesh::{FACES, signed_volume};
use std::collections::BTreeSet;

/// A face lies in the sheet if the sheet's normals at two of its nodes have this cosine to its own at least, whatever their signs. The
/// others are chords: inside of what a loop has swept they lead from one of its arms to the other.
const IN_SHEET: f64 = 0.4;
/// Most tets of a piece that is looked for: a cut has one tick. The chip of a loop has some hundred.
const MOST_TETS: usize = 2_000;
/// Most crumbs that are given to what they lie at, in one cut.
const MOST_CRUMBS: usize = 64;

/// What can be reached from a tet.
struct Flood {
    tets: Vec<u32>,
    /// The same, to look them up.
    all: BTreeSet<u32>,
    /// How many of them were left behind.
    passed: usize,
}

impl Flood {
    fn from(tet: u32) -> Flood {
        Flood { tets: vec![tet], all: BTreeSet::from([tet]), passed: 0 }
    }
}

impl Work<'_> {
    /// Opens what lies about pieces that the sheet encloses; gives the two tets of each face that is open now.
    pub fn free_enclosed(&mut self, report: &mut CutReport) -> Vec<[u32; 2]> {
        let mut walls = self.walls();
        let mut pieces: Vec<BTreeSet<u32>> = Vec::new();
        let (mut next, mut crumbs) = (0, 0);
        while let Some(wall) = walls.get(next).copied() {
            next += 1;
            let Some(sides) = self.tets_at(&wall) else { continue };
            if pieces.iter().any(|piece| sides.iter().any(|tet| piece.contains(tet))) {
                continue;
            }
            let Some(piece) = self.enclosed(sides, &walls) else { continue };
            if self.is_chip(&piece) {
                pieces.push(piece);
                continue;
            }
            // What is none belongs to what it has most in common with.
            let area = |face: &Face| self.normal(face).length();
            let widest = self.around_piece(&piece, &walls).into_iter().max_by(|left, right| area(left).total_cmp(&area(right)));
            if let Some(widest) = widest.filter(|_| crumbs < MOST_CRUMBS) {
                walls.retain(|wall| *wall != widest);
                (next, crumbs) = (0, crumbs + 1);
            }
        }
        let around: Vec<Vec<Face>> = pieces.iter().map(|piece| self.around_piece(piece, &walls)).collect();
        around.into_iter().flat_map(|faces| self.open_faces(faces, report)).collect()
    }

    /// The closed faces that lie in the sheet, sorted.
    fn walls(&self) -> Vec<Face> {
        // Each once, for all the faces at its node.
        let mark = |node: u32| if self.is_marked(node) { self.mark(node) } else { DVec3::ZERO };
        let marks: Vec<DVec3> = (0..self.star.nodes() as u32).map(mark).collect();
        self.marked_faces().into_iter().map(|(face, _)| face).filter(|face| self.is_in_sheet(face, &marks)).collect()
    }

    /// `marks`: the normal of the sheet at each node.
    fn is_in_sheet(&self, face: &Face, marks: &[DVec3]) -> bool {
        let normal = self.normal(face).normalize_or_zero();
        face.iter().filter(|node| marks[**node as usize].dot(normal).abs() >= IN_SHEET).count() >= 2
    }

    /// Twice the area of a face along its normal, at rest.
    fn normal(&self, face: &Face) -> DVec3 {
        let [a, b, c] = face.map(|node| at(&self.tissue.rest.positions_m, node));
        (b - a).cross(c - a)
    }

    /// Whether what is enclosed is more than a crumb, and more than tets that lie in the sheet with all their nodes.
    fn is_chip(&self, tets: &BTreeSet<u32>) -> bool {
        let rest = &self.tissue.rest;
        let nodes = || tets.iter().map(|tet| rest.tets[*tet as usize]);
        let volume_m3: f64 = nodes().map(|nodes| signed_volume(corners(&rest.positions_m, nodes))).sum();
        volume_m3 >= self.options.min_piece_m3 && nodes().flatten().any(|node| !self.is_marked(node))
    }

    /// The side of a wall that has an end within the walls, the smaller one if both have; `None` if a way leads around the wall, or if
    /// both are too large. They are looked at by turns, which takes as long as the smaller one is large.
    fn enclosed(&self, sides: [u32; 2], walls: &[Face]) -> Option<BTreeSet<u32>> {
        let mut floods = sides.map(Flood::from);
        loop {
            for side in [0, 1] {
                let flood = &mut floods[side];
                let Some(tet) = flood.tets.get(flood.passed).copied() else { return Some(std::mem::take(&mut flood.all)) };
                flood.passed += 1;
                if flood.tets.len() > MOST_TETS {
                    return None;
                }
                for next in self.beyond(tet, walls) {
                    if floods[1 - side].all.contains(&next) {
                        return None;
                    }
                    let flood = &mut floods[side];
                    if flood.all.insert(next) {
                        flood.tets.push(next);
                    }
                }
            }
        }
    }

    /// The tets that have a face with a tet that is no wall.
    fn beyond(&self, tet: u32, walls: &[Face]) -> impl Iterator<Item = u32> {
        let faces = self.faces_of(tet).into_iter().filter(move |face| walls.binary_search(face).is_err());
        faces.filter_map(move |face| self.tets_at(&face)).map(move |[one, other]| if one == tet { other } else { one })
    }

    /// The walls between a piece and the rest.
    fn around_piece(&self, piece: &BTreeSet<u32>, walls: &[Face]) -> Vec<Face> {
        let is_between =
            |face: &&Face| self.tets_at(face).is_some_and(|[one, other]| piece.contains(&one) != piece.contains(&other));
        walls.iter().filter(is_between).copied().collect()
    }

    /// The faces of a tet.
    pub fn faces_of(&self, tet: u32) -> [Face; 4] {
        let nodes = self.tissue.rest.tets[tet as usize];
        FACES.map(|places| sorted(places.map(|place| nodes[place])))
    }
}
