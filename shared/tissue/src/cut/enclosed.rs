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
/// What was seen to hang together around a wall is remembered for the other walls, if it is of so many tets at least: less is found again as fast.
const FAR: usize = 256;
/// Most crumbs that are given to what they lie at, in one cut. More of them keep their walls; a piece is freed from these as from all others.
const MOST_CRUMBS: usize = 64;

/// What can be reached from a tet.
struct Flood {
    tets: Vec<u32>,
    /// How many of them were left behind.
    passed: usize,
}

impl Flood {
    fn from(tet: u32) -> Flood {
        Flood { tets: vec![tet], passed: 0 }
    }
}

impl Work<'_> {
    /// Opens what lies about pieces that the sheet encloses; gives the two tets of each face that is open now.
    pub fn free_enclosed(&mut self, report: &mut CutReport) -> Vec<[u32; 2]> {
        let mut walls = self.walls();
        // Walls are only ever taken away, so that what hangs together stays so.
        let (mut pieces, mut together): (Vec<BTreeSet<u32>>, Vec<BTreeSet<u32>>) = (Vec::new(), Vec::new());
        let (mut next, mut crumbs) = (0, 0);
        while let Some(wall) = walls.get(next).copied() {
            next += 1;
            let Some(sides) = self.tets_at(&wall) else { continue };
            let is_freed = pieces.iter().any(|piece| sides.iter().any(|tet| piece.contains(tet)));
            if is_freed || together.iter().any(|all| sides.iter().all(|tet| all.contains(tet))) {
                continue;
            }
            let piece = match self.enclosed(sides, &walls) {
                Ok(piece) => piece,
                Err([one, other]) => {
                    if one.len() + other.len() >= FAR {
                        together.push(one.into_iter().chain(other).collect());
                    }
                    continue;
                }
            };
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

    /// The side of a wall that has an end within the walls, the smaller one if both have, however large it is. They are looked at by turns, which takes as long as
    /// the smaller one is large, or the way around the wall is long.
    ///
    /// Error: a way leads around the wall; what was seen on both sides of it until they met, which hangs together.
    fn enclosed(&self, sides: [u32; 2], walls: &[Face]) -> Result<BTreeSet<u32>, [Vec<u32>; 2]> {
        let mut floods = sides.map(Flood::from);
        // The side that each tet was reached from: a list of all is cleared in less time than a few tets take to be found in a tree.
        let mut side_of: Vec<Option<bool>> = vec![None; self.tissue.rest.tets.len()];
        for (tet, side) in sides.into_iter().zip([false, true]) {
            side_of[tet as usize] = Some(side);
        }
        loop {
            for side in [false, true] {
                let flood = &mut floods[usize::from(side)];
                let Some(tet) = flood.tets.get(flood.passed).copied() else { return Ok(flood.tets.iter().copied().collect()) };
                flood.passed += 1;
                for next in self.beyond(tet, walls) {
                    match side_of[next as usize].replace(side) {
                        Some(before) if before != side => return Err(floods.map(|flood| flood.tets)),
                        Some(_) => (),
                        None => flood.tets.push(next),
                    }
                }
            }
        }
    }

    /// The tets that have a face with a tet that is no wall.
    fn beyond(&self, tet: u32, walls: &[Face]) -> impl Iterator<Item = u32> {
        // All nodes of a wall are marked.
        let is_wall = move |face: &Face| face.iter().all(|node| self.is_marked(*node)) && walls.binary_search(face).is_ok();
        let faces = self.faces_of(tet).into_iter().filter(move |face| !is_wall(face));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cut::{CutOptions, Cuttable};
    use hyst_mesh::{TetMesh, component_count, component_of_each_tet};

    /// Cubes of a block along each axis, of six tets and 1 m each: 2 688 tets on each side of its middle.
    const CUBES: [u32; 3] = [14, 8, 8];
    /// Where its middle is, m.
    const MIDDLE_M: f32 = 7.0;

    /// The block, with the nodes of a plane through its middle on the sheet, as far along y as it is said, m.
    fn block(to_m: f32) -> Cuttable {
        let [nx, ny, nz] = CUBES.map(|cubes| cubes + 1);
        let number = |[x, y, z]: [u32; 3]| x + nx * (y + ny * z);
        let place = |node: u32| [node % nx, node / nx % ny, node / (nx * ny)];
        let of_cube = |low: u32| {
            let [x, y, z] = [number([1, 0, 0]), number([0, 1, 0]), number([0, 0, 1])];
            // The turns of the axes, and those with two of them swapped, in which the corners change places, too.
            let (turns, top) = ([[x, y, z], [y, z, x], [z, x, y]], low + x + y + z);
            turns.into_iter().flat_map(move |[a, b, c]| [[low, low + a, low + a + b, top], [low, low + a + c, low + a, top]])
        };
        let is_low = |node: &u32| place(*node).iter().zip(CUBES).all(|(at, cubes)| *at < cubes);
        let tets: Vec<[u32; 4]> = (0..nx * ny * nz).filter(is_low).flat_map(of_cube).collect();
        let positions_m: Vec<[f32; 3]> = (0..nx * ny * nz).map(|node| place(node).map(|cubes| cubes as f32)).collect();
        let is_on = |place_m: &[f32; 3]| place_m[0] == MIDDLE_M && place_m[1] <= to_m;
        let marks = positions_m.iter().map(|place_m| if is_on(place_m) { [1.0, 0.0, 0.0] } else { [0.0; 3] }).collect();
        Cuttable { marks, ..Cuttable::at_rest(TetMesh { positions_m, regions: vec![0; tets.len()], tets }) }
    }

    /// Faces that are opened of those of the sheet, all of which have stayed closed so far, and the parts that this leaves.
    fn freed(mut tissue: Cuttable) -> (usize, usize) {
        let (options, mut report) = (CutOptions::default(), CutReport::default());
        let mut work = Work::new(&mut tissue, &options, Vec::new());
        work.on_sheet = (0..work.tissue.rest.tets.len() as u32).collect();
        let opened = work.free_enclosed(&mut report).len();
        (opened, component_count(&component_of_each_tet(&tissue.rest)))
    }

    /// Two pieces of more than 2 000 tets each were not looked for to the end, and hung together by what had stayed closed.
    #[test]
    fn what_the_sheet_has_passed_is_freed_however_large_both_sides_are_and_nothing_where_a_way_leads_around() {
        let walls = 2 * (CUBES[1] * CUBES[2]) as usize;
        assert_eq!(freed(block(CUBES[1] as f32)), (walls, 2));
        assert_eq!(freed(block(CUBES[1] as f32 - 1.0)), (0, 1), "the last row of cubes holds them together");
    }
}
