//! The tets near a change: which of them a point lies in, or is least outside of, and which hang together.

use super::places::{Bounds, corners};
use glam::DVec3;
use hyst_mesh::{FACES, TetMesh};
use std::cell::OnceCell;
use std::ops::Range;

/// How far outside of a tet a point counts as inside, as a share of the tet's height: rounding.
const HAIR: f64 = 1e-4;
/// A part around a point has rarely more tets.
const USUAL_PART: usize = 32;
/// Most cells of tets along each axis.
const MOST_CELLS: usize = 16;

/// The tets near a change, with what joins them. Tets are named by their index in it.
pub struct Neighbourhood<'a> {
    pub rest: &'a TetMesh,
    pub tets: Vec<u32>,
    cells: Cells,
    bounds: Vec<Bounds>,
    /// Made when they are first asked for: of many tets nothing is.
    planes: Vec<OnceCell<Planes>>,
    joined: Vec<[Option<u32>; 4]>,
    /// How many parts were found so far, by which each is known, and for each tet the last of them that it is in, and for which it was looked at.
    parts: u32,
    is_in: Vec<u32>,
    looked_at: Vec<u32>,
}

/// The planes of the four faces of a tet, inwards: the coordinates of their normals, axis by axis, and their distances from the origin.
struct Planes {
    normals: [[f64; 4]; 3],
    offsets_m: [f64; 4],
}

impl Planes {
    fn of(corners: [DVec3; 4]) -> Planes {
        let planes = FACES.map(|face| {
            let [a, b, c] = face.map(|place| corners[place]);
            let inward = (c - a).cross(b - a).normalize_or_zero();
            (inward, inward.dot(a))
        });
        let normals =
            [planes.map(|(normal, _)| normal.x), planes.map(|(normal, _)| normal.y), planes.map(|(normal, _)| normal.z)];
        Planes { normals, offsets_m: planes.map(|(_, offset_m)| offset_m) }
    }

    fn depth_m(&self, point: DVec3) -> f64 {
        let [x, y, z] = &self.normals;
        let depth_m = |face: usize| x[face] * point.x + y[face] * point.y + z[face] * point.z - self.offsets_m[face];
        let [a, b, c, d]: [f64; 4] = std::array::from_fn(depth_m);
        a.min(b).min(c).min(d)
    }
}

impl<'a> Neighbourhood<'a> {
    pub fn new(rest: &'a TetMesh, tets: Vec<u32>) -> Neighbourhood<'a> {
        let nodes: Vec<[u32; 4]> = tets.iter().map(|tet| rest.tets[*tet as usize]).collect();
        let bounds: Vec<Bounds> = nodes.iter().map(|nodes| Bounds::around(corners(&rest.positions_m, *nodes))).collect();
        let planes = tets.iter().map(|_| OnceCell::new()).collect();
        let (cells, joined) = (Cells::new(&bounds), joined(rest.positions_m.len(), &nodes));
        let (is_in, looked_at) = (vec![0; tets.len()], vec![0; tets.len()]);
        Neighbourhood { rest, tets, cells, bounds, planes, joined, parts: 0, is_in, looked_at }
    }

    pub fn region(&self, index: u32) -> u32 {
        self.rest.regions[self.tets[index as usize] as usize]
    }

    /// How far a point is inside of the face that it is least inside of, m.
    pub fn depth_m(&self, index: u32, point: DVec3) -> f64 {
        let planes = self.planes[index as usize].get_or_init(|| {
            let nodes = self.rest.tets[self.tets[index as usize] as usize];
            Planes::of(corners(&self.rest.positions_m, nodes))
        });
        planes.depth_m(point)
    }

    /// Whether a point that is so deep in a tet is around it beyond doubt.
    fn is_around(&self, index: u32, depth_m: f64) -> bool {
        depth_m > HAIR * self.bounds[index as usize].extent_m()
    }

    /// The tet of these that is around a point, or the one near it that it is least outside of.
    pub fn home(&self, point: DVec3, is_of_these: impl Fn(u32) -> bool) -> Option<u32> {
        // Most points are in one, which has the point in its box, too.
        let is_around = |index: &u32| {
            let has = self.bounds[*index as usize].has(point) && is_of_these(*index);
            has && self.is_around(*index, self.depth_m(*index, point))
        };
        let these = |index: &u32| is_of_these(*index);
        let with_depth = |index: u32| (index, self.depth_m(index, point));
        let around = self.cells.at(point).find(is_around);
        let near = around.or_else(|| self.nearest(self.cells.at(point).filter(these).map(with_depth)));
        near.or_else(|| self.nearest((0..self.tets.len() as u32).filter(these).map(with_depth)))
    }

    /// The first tet that is around a point, or the one that it is least outside of; the first of equals. Each comes with how deep the point is in it, m.
    pub fn nearest(&self, among: impl Iterator<Item = (u32, f64)>) -> Option<u32> {
        let mut best: Option<(f64, u32)> = None;
        for (index, depth_m) in among {
            if self.is_around(index, depth_m) {
                return Some(index);
            }
            if best.is_none_or(|(deepest_m, _)| depth_m > deepest_m) {
                best = Some((depth_m, index));
            }
        }
        best.map(|(_, index)| index)
    }

    /// The parts that some tets fall into when only ways through faces, and through tets near a point, count; with how deep the point is in each tet, m.
    pub fn parts_around(&mut self, point: DVec3, radius_m: f64, homes: impl Iterator<Item = u32>) -> Vec<Vec<(u32, f64)>> {
        let before = self.parts;
        let mut parts: Vec<Vec<(u32, f64)>> = Vec::new();
        for home in homes {
            if self.is_in[home as usize] > before {
                continue;
            }
            self.parts += 1;
            self.is_in[home as usize] = self.parts;
            self.looked_at[home as usize] = self.parts;
            let mut part = Vec::with_capacity(USUAL_PART);
            part.push((home, self.depth_m(home, point)));
            let mut next = 0;
            while let Some((index, _)) = part.get(next).copied() {
                next += 1;
                for other in self.joined[index as usize].into_iter().flatten() {
                    if self.looked_at[other as usize] == self.parts {
                        continue;
                    }
                    self.looked_at[other as usize] = self.parts;
                    let depth_m = self.depth_m(other, point);
                    if depth_m >= -radius_m {
                        self.is_in[other as usize] = self.parts;
                        part.push((other, depth_m));
                    }
                }
            }
            parts.push(part);
        }
        parts
    }
}

/// A face that was met, but for its lowest node.
struct Met {
    others: [u32; 2],
    /// How many tets have it.
    tets: usize,
    /// The first and the last place where it was met (4 × tet + face).
    first: usize,
    last: usize,
    /// The face of the same lowest node that was met before it.
    before: Option<u32>,
}

/// For each tet the others that have a face with it alone. `nodes`: how many there are.
fn joined(nodes: usize, tets: &[[u32; 4]]) -> Vec<[Option<u32>; 4]> {
    // Few faces have the same lowest node, so that each is found among them faster than all are sorted.
    let mut last_at: Vec<Option<u32>> = vec![None; nodes];
    let mut faces: Vec<Met> = Vec::with_capacity(3 * tets.len());
    for (index, nodes) in tets.iter().enumerate() {
        for (face, places) in FACES.iter().enumerate() {
            let mut key = places.map(|place| nodes[place]);
            key.sort_unstable();
            let ([lowest, b, c], place) = (key, 4 * index + face);
            let mut met = last_at[lowest as usize];
            while let Some(other) = met.filter(|other| faces[*other as usize].others != [b, c]) {
                met = faces[other as usize].before;
            }
            if let Some(same) = met {
                let same = &mut faces[same as usize];
                (same.tets, same.last) = (same.tets + 1, place);
                continue;
            }
            let before = last_at[lowest as usize].replace(faces.len() as u32);
            faces.push(Met { others: [b, c], tets: 1, first: place, last: place, before });
        }
    }
    let mut joined = vec![[None; 4]; tets.len()];
    for Met { first, last, .. } in faces.into_iter().filter(|face| face.tets == 2) {
        joined[first / 4][first % 4] = Some(last as u32 / 4);
        joined[last / 4][last % 4] = Some(first as u32 / 4);
    }
    joined
}

/// The tets of each cell of space, in their order.
pub struct Cells {
    low_m: DVec3,
    per_m: f64,
    counts: [usize; 3],
    starts: Vec<u32>,
    tets: Vec<u32>,
}

impl Cells {
    /// Of tets by the boxes around them; a cell is as large as they are in the mean.
    pub fn new(bounds: &[Bounds]) -> Cells {
        let Some(all) = bounds.iter().copied().reduce(Bounds::with) else {
            return Cells { low_m: DVec3::ZERO, per_m: 0.0, counts: [1; 3], starts: vec![0; 2], tets: Vec::new() };
        };
        let mean_m = bounds.iter().map(Bounds::extent_m).sum::<f64>() / bounds.len() as f64;
        let per_m = 1.0 / mean_m.max(all.extent_m() / MOST_CELLS as f64).max(f64::MIN_POSITIVE);
        let (low_m, high_m) = all.ends_m();
        let counts = ((high_m - low_m) * per_m).to_array().map(|cells| (cells as usize + 1).min(MOST_CELLS));
        let mut cells = Cells { low_m, per_m, counts, starts: Vec::new(), tets: Vec::new() };
        let mut starts = vec![0u32; counts.iter().product::<usize>() + 1];
        for row in bounds.iter().flat_map(|around| cells.of_box(around)) {
            starts[row.start + 1..=row.end].iter_mut().for_each(|count| *count += 1);
        }
        (1..starts.len()).for_each(|cell| starts[cell] += starts[cell - 1]);
        let mut ends = starts.clone();
        cells.tets = vec![0; starts.last().map_or(0, |all| *all as usize)];
        for (index, around) in (0..).zip(bounds) {
            for row in cells.of_box(around) {
                for end in &mut ends[row] {
                    cells.tets[*end as usize] = index;
                    *end += 1;
                }
            }
        }
        cells.starts = starts;
        cells
    }

    /// The cell of a place along each axis.
    fn cell(&self, place_m: DVec3) -> [usize; 3] {
        let cell = ((place_m - self.low_m) * self.per_m).to_array();
        std::array::from_fn(|axis| (cell[axis].max(0.0) as usize).min(self.counts[axis] - 1))
    }

    /// The cells that a box reaches into, row by row.
    fn of_box(&self, around: &Bounds) -> impl Iterator<Item = Range<usize>> + use<> {
        let (low_m, high_m) = around.ends_m();
        let ([i, j, k], [to_i, to_j, to_k], [across, deep, _]) = (self.cell(low_m), self.cell(high_m), self.counts);
        let row = move |j: usize, k: usize| {
            let first = (k * deep + j) * across;
            first + i..first + to_i + 1
        };
        (k..to_k + 1).flat_map(move |k| (j..to_j + 1).map(move |j| row(j, k)))
    }

    /// The tets whose boxes may have a point in them; all that have are among them.
    pub fn at(&self, point: DVec3) -> impl Iterator<Item = u32> + '_ {
        let ([i, j, k], [across, deep, _]) = (self.cell(point), self.counts);
        let cell = (k * deep + j) * across + i;
        self.tets[self.starts[cell] as usize..self.starts[cell + 1] as usize].iter().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_mesh::signed_volume;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    proptest! {
        #![proptest_config(ProptestConfig { cases: 500, rng_seed: RngSeed::Fixed(3), failure_persistence: None, ..ProptestConfig::default() })]

        /// Of tets that overlap, and have faces of which one, two or more are, in any order.
        #[test]
        fn a_point_is_at_home_in_the_first_tet_around_it_and_tets_are_joined_by_the_faces_of_two(
            places in prop::collection::vec(prop::array::uniform3(0..6_u8), 8),
            tets in prop::collection::vec(prop::array::uniform4(0..8_u32), 1..30),
            points in prop::collection::vec(prop::array::uniform3(0.0..5.0_f64), 20),
        ) {
            let positions_m: Vec<[f32; 3]> = places.iter().map(|place| place.map(f32::from)).collect();
            let is_one = |tet: &[u32; 4]| signed_volume(corners(&positions_m, *tet)) > 0.0;
            let tets: Vec<[u32; 4]> = tets.into_iter().filter(is_one).collect();
            let rest = TetMesh { regions: vec![0; tets.len()], positions_m: positions_m.clone(), tets: tets.clone() };
            let near = Neighbourhood::new(&rest, (0..tets.len() as u32).collect());
            for point in points {
                let point = DVec3::from_array(point);
                let first = (0..tets.len() as u32).find(|index| near.is_around(*index, near.depth_m(*index, point)));
                let home = near.home(point, |_| true);
                prop_assert!(first.is_none() || home == first, "{point}: {home:?}, not {first:?}");
                prop_assert!(home.is_some() || tets.is_empty());
            }
            for (index, nodes) in tets.iter().enumerate() {
                for (face, places) in FACES.iter().enumerate() {
                    let has_face = |other: &usize| places.iter().all(|place| tets[*other].contains(&nodes[*place]));
                    let others: Vec<usize> = (0..tets.len()).filter(|other| *other != index && has_face(other)).collect();
                    let expected = if let [other] = others[..] { Some(other as u32) } else { None };
                    prop_assert_eq!(near.joined[index][face], expected);
                }
            }
        }
    }
}
