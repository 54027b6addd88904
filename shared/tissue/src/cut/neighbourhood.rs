//! The tets near a change: which of them a point lies in, or is least outside of, and which hang together.

use super::places::{Bounds, at};
use glam::DVec3;
use hyst_mesh::{FACES, TetMesh};

/// How far outside of a tet a point counts as inside, as a share of the tet's height: rounding.
const HAIR: f64 = 1e-4;
/// Most cells of tets along each axis.
const MOST_CELLS: usize = 16;

/// The tets near a change, with what joins them. Tets are named by their index in it.
pub struct Neighbourhood<'a> {
    pub rest: &'a TetMesh,
    pub tets: Vec<u32>,
    cells: Cells,
    /// The part in which each is while those around a point are found.
    part_of: Vec<Option<u32>>,
    bounds: Vec<Bounds>,
    /// Planes of the four faces of each, inwards: normal and distance from the origin.
    planes: Vec<[(DVec3, f64); 4]>,
    joined: Vec<[Option<u32>; 4]>,
}

impl<'a> Neighbourhood<'a> {
    pub fn new(rest: &'a TetMesh, tets: Vec<u32>) -> Neighbourhood<'a> {
        let mut faces = Vec::with_capacity(4 * tets.len());
        let (mut bounds, mut planes) = (Vec::with_capacity(tets.len()), Vec::with_capacity(tets.len()));
        for (index, tet) in tets.iter().enumerate() {
            let nodes = rest.tets[*tet as usize];
            let corners = nodes.map(|node| at(&rest.positions_m, node));
            bounds.push(Bounds::around(corners));
            planes.push(FACES.map(|face| {
                let [a, b, c] = face.map(|place| corners[place]);
                let inward = (c - a).cross(b - a).normalize_or_zero();
                (inward, inward.dot(a))
            }));
            for (face, places) in FACES.into_iter().enumerate() {
                let mut key = places.map(|place| nodes[place]);
                key.sort_unstable();
                faces.push((key, index as u32, face));
            }
        }
        faces.sort_unstable();
        let mut joined = vec![[None; 4]; tets.len()];
        for same in faces.chunk_by(|left, right| left.0 == right.0) {
            let [(_, a, of_a), (_, b, of_b)] = same else { continue };
            joined[*a as usize][*of_a] = Some(*b);
            joined[*b as usize][*of_b] = Some(*a);
        }
        Neighbourhood { rest, cells: Cells::new(&bounds), part_of: vec![None; tets.len()], tets, bounds, planes, joined }
    }

    pub fn region(&self, index: u32) -> u32 {
        self.rest.regions[self.tets[index as usize] as usize]
    }

    /// How far a point is inside of the face that it is least inside of, m.
    pub fn depth_m(&self, index: u32, point: DVec3) -> f64 {
        self.planes[index as usize].iter().map(|(normal, offset)| normal.dot(point) - offset).fold(f64::INFINITY, f64::min)
    }

    /// The tet of these that is around a point, or the one near it that it is least outside of.
    pub fn home(&self, point: DVec3, is_of_these: impl Fn(u32) -> bool) -> Option<u32> {
        let these = |index: &u32| is_of_these(*index);
        let near = self.nearest(point, self.cells.at(point).filter(these));
        near.or_else(|| self.nearest(point, (0..self.tets.len() as u32).filter(these)))
    }

    /// The first tet that is around a point, or the one that it is least outside of; the first of equals.
    pub fn nearest(&self, point: DVec3, among: impl Iterator<Item = u32>) -> Option<u32> {
        let mut best: Option<(f64, u32)> = None;
        for index in among {
            let depth_m = self.depth_m(index, point);
            if depth_m > HAIR * self.bounds[index as usize].extent_m() {
                return Some(index);
            }
            if best.is_none_or(|(deepest_m, _)| depth_m > deepest_m) {
                best = Some((depth_m, index));
            }
        }
        best.map(|(_, index)| index)
    }

    /// The parts that some tets fall into when only ways through faces, and through tets near a point, count.
    pub fn parts_around(&mut self, point: DVec3, radius_m: f64, homes: impl Iterator<Item = u32>) -> Vec<Vec<u32>> {
        let mut parts: Vec<Vec<u32>> = Vec::new();
        for home in homes {
            if self.part_of[home as usize].is_some() {
                continue;
            }
            let number = Some(parts.len() as u32);
            self.part_of[home as usize] = number;
            let mut part = vec![home];
            let mut next = 0;
            while let Some(index) = part.get(next).copied() {
                next += 1;
                for other in self.joined[index as usize].into_iter().flatten() {
                    if self.part_of[other as usize] != number && self.depth_m(other, point) >= -radius_m {
                        self.part_of[other as usize] = number;
                        part.push(other);
                    }
                }
            }
            parts.push(part);
        }
        parts.iter().flatten().for_each(|index| self.part_of[*index as usize] = None);
        parts
    }
}

/// The tets of each cell of space, in their order.
struct Cells {
    low_m: DVec3,
    per_m: f64,
    counts: [usize; 3],
    starts: Vec<u32>,
    tets: Vec<u32>,
}

impl Cells {
    /// Of tets by the boxes around them; a cell is as large as they are in the mean.
    fn new(bounds: &[Bounds]) -> Cells {
        let Some(all) = bounds.iter().copied().reduce(Bounds::with) else {
            return Cells { low_m: DVec3::ZERO, per_m: 0.0, counts: [1; 3], starts: vec![0; 2], tets: Vec::new() };
        };
        let mean_m = bounds.iter().map(Bounds::extent_m).sum::<f64>() / bounds.len() as f64;
        let per_m = 1.0 / mean_m.max(all.extent_m() / MOST_CELLS as f64).max(f64::MIN_POSITIVE);
        let (low_m, high_m) = all.ends_m();
        let counts = ((high_m - low_m) * per_m).to_array().map(|cells| (cells as usize + 1).min(MOST_CELLS));
        let mut cells = Cells { low_m, per_m, counts, starts: Vec::new(), tets: Vec::new() };
        let mut starts = vec![0u32; counts.iter().product::<usize>() + 1];
        bounds.iter().for_each(|around| cells.of_box(around).for_each(|cell| starts[cell + 1] += 1));
        (1..starts.len()).for_each(|cell| starts[cell] += starts[cell - 1]);
        let mut ends = starts.clone();
        cells.tets = vec![0; starts.last().map_or(0, |all| *all as usize)];
        for (index, around) in (0..).zip(bounds) {
            for cell in cells.of_box(around) {
                cells.tets[ends[cell] as usize] = index;
                ends[cell] += 1;
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

    fn of_box(&self, around: &Bounds) -> impl Iterator<Item = usize> + use<> {
        let (low_m, high_m) = around.ends_m();
        let ([i, j, k], [to_i, to_j, to_k], [across, deep, _]) = (self.cell(low_m), self.cell(high_m), self.counts);
        (k..=to_k).flat_map(move |k| (j..=to_j).flat_map(move |j| (i..=to_i).map(move |i| (k * deep + j) * across + i)))
    }

    /// The tets whose boxes may have a point in them; all that have are among them.
    fn at(&self, point: DVec3) -> impl Iterator<Item = u32> + '_ {
        let ([i, j, k], [across, deep, _]) = (self.cell(point), self.counts);
        let cell = (k * deep + j) * across + i;
        self.tets[self.starts[cell] as usize..self.starts[cell + 1] as usize].iter().copied()
    }
}
