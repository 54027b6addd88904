//! The tets near a change: which of them a point lies in, or is least outside of, and which hang together.

use super::cells::Cells;
use super::joined::{NONE, joined};
use super::places::{SingleBounds, Spot, corners};
use glam::DVec3;
use hyst_mesh::{FACES, TetMesh};
use std::cell::RefCell;

/// How far outside of a tet a point counts as inside, as a share of the tet's height: rounding.
const HAIR: f64 = 1e-4;

/// The tets near a change, with what joins them. Tets are named by their index in it.
pub struct Neighbourhood<'a> {
    pub rest: &'a TetMesh,
    pub tets: Vec<u32>,
    regions: Vec<u32>,
    cells: Cells,
    bounds: Vec<SingleBounds>,
    planes: RefCell<KnownPlanes>,
    /// The nodes of each, and once parts were asked for the tet beyond each face, or none.
    nodes: Vec<[u32; 4]>,
    joined: Vec<[u32; 4]>,
    /// How many parts were found so far, by which each is known, and how many of them around points before; for each tet the last of them that it is in,
    /// and for which it was looked at.
    parts: u32,
    parts_before: u32,
    is_in: Vec<u32>,
    looked_at: Vec<u32>,
    /// How many points were asked about, and for each tet the last of them for which its part is looked for; 0 once that is found.
    points: u32,
    wanted: Vec<u32>,
    /// The nearest tet of each part around the point that was asked about last, and the tets of one, with room for more.
    nearest_of_part: Vec<u32>,
    part: Vec<u32>,
}

/// The planes of the four faces of a tet, inwards: the coordinates of their normals, axis by axis, and their distances from the origin.
struct Planes {
    normals: [[f64; 4]; 3],
    offsets_m: [f64; 4],
}

/// The planes of those tets that were asked about: of many nothing is.
struct KnownPlanes {
    /// The place of each tet's in the list, or none.
    place_of: Vec<u32>,
    all: Vec<Planes>,
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
        // One instruction each: all are numbers, for which `f64::min` would ask.
        let least = |a: f64, b: f64| if a < b { a } else { b };
        least(least(a, b), least(c, d))
    }
}

impl<'a> Neighbourhood<'a> {
    /// `asked_m`: the points whose homes are asked for, some of them for nothing.
    pub fn new(rest: &'a TetMesh, tets: Vec<u32>, asked_m: impl Iterator<Item = DVec3>) -> Neighbourhood<'a> {
        let nodes: Vec<[u32; 4]> = tets.iter().map(|tet| rest.tets[*tet as usize]).collect();
        let bounds: Vec<SingleBounds> = nodes.iter().map(|nodes| SingleBounds::of_tet(&rest.positions_m, *nodes)).collect();
        let regions = tets.iter().map(|tet| rest.regions[*tet as usize]).collect();
        let planes = RefCell::new(KnownPlanes { place_of: vec![NONE; tets.len()], all: Vec::new() });
        let cells = Cells::for_places(&bounds, asked_m);
        let [is_in, looked_at, wanted] = [(); 3].map(|()| vec![0; tets.len()]);
        Neighbourhood {
            rest,
            tets,
            regions,
            cells,
            bounds,
            planes,
            nodes,
            joined: Vec::new(),
            parts: 0,
            parts_before: 0,
            is_in,
            looked_at,
            points: 0,
            wanted,
            nearest_of_part: Vec::new(),
            part: Vec::new(),
        }
    }

    pub fn region(&self, index: u32) -> u32 {
        self.regions[index as usize]
    }

    /// How far a point is inside of the face that it is least inside of, m.
    pub fn depth_m(&self, index: u32, point: DVec3) -> f64 {
        let KnownPlanes { place_of, all } = &mut *self.planes.borrow_mut();
        let place = &mut place_of[index as usize];
        if *place == NONE {
            *place = all.len() as u32;
            all.push(Planes::of(corners(&self.rest.positions_m, self.nodes[index as usize])));
        }
        all[*place as usize].depth_m(point)
    }

    /// By how much depths in a tet may be wrong.
    fn hair_m(&self, index: u32) -> f64 {
        HAIR * self.bounds[index as usize].extent_m()
    }

    /// Whether a point that is so deep in a tet is around it beyond doubt.
    fn is_around(&self, index: u32, depth_m: f64) -> bool {
        // Most are less than 0 deep, and no box has an extent of less.
        depth_m > 0.0 && depth_m > self.hair_m(index)
    }

    /// Whether a point is deeper in a tet than in another one beyond doubt: on the rim of a wound it is as deep in those of both sides.
    fn is_deeper(&self, index: u32, depth_m: f64, other_m: f64) -> bool {
        depth_m > other_m && depth_m > other_m + self.hair_m(index)
    }

    /// The tet of these that is around a point that is asked about, or the one near it that it is least outside of.
    pub fn home(&self, point: DVec3, is_of_these: impl Fn(u32) -> bool) -> Option<u32> {
        // Most points are in one, which has the point in its box, too.
        let spot = Spot::of(point);
        let is_around = |index: &u32| {
            let has = self.bounds[*index as usize].has(&spot) && is_of_these(*index);
            has && self.is_around(*index, self.depth_m(*index, point))
        };
        let these = |index: &u32| is_of_these(*index);
        let here = self.cells.at(point).iter().copied();
        let near = here.clone().find(is_around).or_else(|| self.nearest(point, here.filter(these)));
        near.or_else(|| self.nearest(point, (0..self.tets.len() as u32).filter(these)))
    }

    /// The first tet that is around a point, or the one that it is least outside of; the first of those that are equal but for rounding.
    fn nearest(&self, point: DVec3, among: impl Iterator<Item = u32>) -> Option<u32> {
        let mut best = Nearest::default();
        for index in among {
            best.look_at(self, index, self.depth_m(index, point));
            if best.is_around {
                break;
            }
        }
        best.index
    }

    /// Finds the parts that some tets fall into when only ways through faces, and through tets near a point, count; of these the point is nowhere more than
    /// `radius_m` outside. Tells how many there are.
    pub fn parts_around(&mut self, point: DVec3, radius_m: f64, homes: impl Iterator<Item = u32> + Clone) -> usize {
        self.join();
        self.parts_before = self.parts;
        self.points += 1;
        self.nearest_of_part.clear();
        // How many of them no part has yet.
        let mut left = 0;
        for home in homes.clone() {
            left += u32::from(self.wanted[home as usize] != self.points);
            self.wanted[home as usize] = self.points;
        }
        for home in homes {
            if self.is_in[home as usize] <= self.parts_before {
                let nearest = self.flood(point, radius_m, home, &mut left);
                self.nearest_of_part.push(nearest);
            }
        }
        self.nearest_of_part.len()
    }

    /// Finds the tets beyond all faces, unless they are known: who asks for homes alone needs none of them.
    fn join(&mut self) {
        if self.joined.is_empty() {
            self.joined = joined(&self.nodes);
        }
    }

    /// Of a part around the point that was asked about last the first tet that is around it, or the one that it is least outside of.
    pub fn nearest_of(&self, part: usize) -> u32 {
        self.nearest_of_part[part]
    }

    /// The part, around the point that was asked about last, that one of the tets is in that were given with it.
    pub fn part_of(&self, home: u32) -> usize {
        (self.is_in[home as usize] - self.parts_before - 1) as usize
    }

    /// The nearest tet of the part that has this one. Goes no further once a tet is found that is around the point, and none is wanted any more: what
    /// comes after changes nothing. `left`: how many are.
    fn flood(&mut self, point: DVec3, radius_m: f64, home: u32, left: &mut u32) -> u32 {
        self.parts += 1;
        self.looked_at[home as usize] = self.parts;
        let mut best = Nearest::default();
        let mut part = std::mem::take(&mut self.part);
        part.clear();
        self.take_in(home, self.depth_m(home, point), &mut best, &mut part, left);
        let mut next = 0;
        while let Some(index) = part.get(next).copied().filter(|_| *left > 0 || !best.is_around) {
            next += 1;
            for other in self.joined[index as usize] {
                if other == NONE || self.looked_at[other as usize] == self.parts {
                    continue;
                }
                self.looked_at[other as usize] = self.parts;
                let depth_m = self.depth_m(other, point);
                if depth_m >= -radius_m {
                    self.take_in(other, depth_m, &mut best, &mut part, left);
                }
            }
        }
        self.part = part;
        best.index.unwrap_or(home)
    }

    /// Takes a tet into the last part.
    fn take_in(&mut self, index: u32, depth_m: f64, best: &mut Nearest, part: &mut Vec<u32>, left: &mut u32) {
        self.is_in[index as usize] = self.parts;
        if std::mem::take(&mut self.wanted[index as usize]) == self.points {
            *left -= 1;
        }
        best.look_at(self, index, depth_m);
        part.push(index);
    }
}

/// The nearest tet to a point of those that were looked at so far.
#[derive(Default)]
struct Nearest {
    index: Option<u32>,
    depth_m: f64,
    /// Whether it is around the point: then what comes after it changes nothing.
    is_around: bool,
}

impl Nearest {
    fn look_at(&mut self, place: &Neighbourhood<'_>, index: u32, depth_m: f64) {
        if self.is_around {
            return;
        }
        self.is_around = place.is_around(index, depth_m);
        if self.is_around || self.index.is_none() || place.is_deeper(index, depth_m, self.depth_m) {
            (self.index, self.depth_m) = (Some(index), depth_m);
        }
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use hyst_mesh::signed_volume;
    use proptest::prelude::*;
    use proptest::test_runner::RngSeed;

    /// Cubes of the lattice along each axis.
    const CUBES: u32 = 3;
    /// Tets of all of them.
    pub const TETS: usize = 6 * (CUBES * CUBES * CUBES) as usize;

    /// The tets that are there of those that lead, in the cubes of a lattice of 1 m, from the lowest corner to the highest one.
    pub fn lattice(is_there: &[bool]) -> TetMesh {
        let place = |node: u32| [node % (CUBES + 1), node / (CUBES + 1) % (CUBES + 1), node / (CUBES + 1).pow(2)];
        let positions_m = (0..(CUBES + 1).pow(3)).map(|node| place(node).map(|cubes| cubes as f32)).collect();
        let of_cube = |cube: u32| {
            let low = cube % CUBES + (CUBES + 1) * (cube / CUBES % CUBES + (CUBES + 1) * (cube / CUBES.pow(2)));
            let [x, y, z] = [1, CUBES + 1, (CUBES + 1).pow(2)];
            let top = low + x + y + z;
            // The turns of the axes, and those with two of them swapped, in which the corners change places, too.
            let turns = [[x, y, z], [y, z, x], [z, x, y]];
            turns.into_iter().flat_map(move |[a, b, c]| [[low, low + a, low + a + b, top], [low, low + a + c, low + a, top]])
        };
        let all = (0..CUBES.pow(3)).flat_map(of_cube);
        let tets: Vec<[u32; 4]> = all.zip(is_there).filter(|(_, is_there)| **is_there).map(|(tet, _)| tet).collect();
        TetMesh { positions_m, regions: vec![0; tets.len()], tets }
    }

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
            let points: Vec<DVec3> = points.into_iter().map(DVec3::from_array).collect();
            let near = Neighbourhood::new(&rest, (0..tets.len() as u32).collect(), points.iter().copied());
            for point in points {
                let first = (0..tets.len() as u32).find(|index| near.is_around(*index, near.depth_m(*index, point)));
                let home = near.home(point, |_| true);
                prop_assert!(first.is_none() || home == first, "{point}: {home:?}, not {first:?}");
                prop_assert!(home.is_some() || tets.is_empty());
            }
            let joined = joined(&tets);
            for (index, nodes) in tets.iter().enumerate() {
                for (face, places) in FACES.iter().enumerate() {
                    let has_face = |other: &usize| places.iter().all(|place| tets[*other].contains(&nodes[*place]));
                    let others: Vec<usize> = (0..tets.len()).filter(|other| *other != index && has_face(other)).collect();
                    let expected = if let [other] = others[..] { other as u32 } else { NONE };
                    prop_assert_eq!(joined[index][face], expected);
                }
            }
        }

        /// In the cubes of a lattice, six tets each, of which some are left out.
        #[test]
        fn parts_are_what_all_ways_from_a_tet_lead_to_and_the_first_around_the_point_or_the_deepest_is_nearest(
            is_there in prop::collection::vec(prop::bool::weighted(0.6), TETS),
            points in prop::collection::vec(prop::array::uniform3(0..25_u8), 1..12),
            homes in prop::collection::vec(prop::collection::vec(0..TETS, 0..5), 12),
            more_m in 0.0..1.0_f64,
        ) {
            let rest = lattice(&is_there);
            let mut near = Neighbourhood::new(&rest, (0..rest.tets.len() as u32).collect(), std::iter::empty());
            for (point, homes) in points.into_iter().zip(homes) {
                let point = DVec3::from_array(point.map(|eighths| f64::from(eighths) / 8.0));
                let homes = homes.iter().filter(|_| !rest.tets.is_empty()).map(|home| (home % rest.tets.len()) as u32);
                let homes: Vec<u32> = homes.collect();
                let joined = joined(&rest.tets);
                let radius_m = more_m + homes.iter().map(|home| -near.depth_m(*home, point)).fold(0.0, f64::max);
                let mut expected: Vec<Vec<u32>> = Vec::new();
                for home in &homes {
                    if expected.iter().any(|part| part.contains(home)) {
                        continue;
                    }
                    let mut part = vec![*home];
                    let mut next = 0;
                    while let Some(index) = part.get(next).copied() {
                        next += 1;
                        for other in joined[index as usize] {
                            if other != NONE && !part.contains(&other) && near.depth_m(other, point) >= -radius_m {
                                part.push(other);
                            }
                        }
                    }
                    expected.push(part);
                }
                prop_assert_eq!(near.parts_around(point, radius_m, homes.iter().copied()), expected.len());
                for (number, part) in expected.iter().enumerate() {
                    let around = part.iter().copied().find(|index| near.is_around(*index, near.depth_m(*index, point)));
                    let depth_m = |index: u32| near.depth_m(index, point);
                    let is_deeper = |other: u32, best: u32| near.is_deeper(other, depth_m(other), depth_m(best));
                    let deeper = |best: u32, other: u32| if is_deeper(other, best) { other } else { best };
                    let nearest = around.or_else(|| part.iter().copied().reduce(deeper));
                    prop_assert_eq!(Some(near.nearest_of(number)), nearest);
                    prop_assert!(homes.iter().all(|home| (near.part_of(*home) == number) == part.contains(home)));
                }
            }
        }
    }
}
