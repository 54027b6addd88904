//! The shape that an organ whose cavity is closed is led to: each wall goes half of the way to the other one along y, as far as what grows in the cavity
//! leaves room, and the tissue behind it goes the less the nearer it is to the outside, which stays.
//!
//! What is beside the slit opens gently: the round canal of the cervix stays as it is, and from the cavity's rim on both sides the walls come together by a
//! slope. The way depends on the place at rest alone, so that it is known for nodes that a cut makes.

use super::lattice::Lattice;
use crate::body::Body;
use hyst_mesh::TetMesh;
use hyst_scene::LoadedScene;
use std::f64::consts::SQRT_2;

/// How far apart the walls of the slit stay, m (assumed). What is pressed together at the cavity's rim resists, so that they stand a half farther apart: less
/// than any instrument, and wide enough for two cells of the default scene's flow, in which the medium goes on.
const SLIT_M: f64 = 0.8e-3;
/// Where the cavity is as many times as wide as it is deep or less, it stays as it is; where it is as many times or more, it closes wholly. Canals are round.
const FLAT: [f64; 2] = [1.25, 1.75];
/// By how much more a wall goes at most from one place to another, per distance.
const STEEPEST: f64 = 1.5;
/// By how much a wall is stretched across at most, as a share of its thickness: a thin one stays apart.
const MOST_STRETCH: f64 = 0.5;
/// A cavity of which more than this share is left is not closed.
const MOST_LEFT: f64 = 0.7;
/// The points on the lattice before one, as so many along x and z.
const BEFORE: [[isize; 2]; 4] = [[-1, 0], [0, -1], [-1, -1], [1, -1]];

/// What a line along y through the cavity meets, m along y.
#[derive(Clone, Copy)]
struct Column {
    /// Where the wall behind the cavity begins and ends, then the one before it.
    faces_m: [f64; 4],
    /// What of the cavity is filled by what grows in it.
    filled_m: f64,
}

impl Column {
    /// How much of the cavity is free, m.
    fn free_m(&self) -> f64 {
        (self.faces_m[2] - self.faces_m[1] - self.filled_m).max(0.0)
    }

    /// How far each wall may go by itself, m.
    fn most_m(&self) -> f64 {
        let [outer_posterior, posterior, anterior, outer_anterior] = self.faces_m;
        let thinnest_m = (posterior - outer_posterior).min(outer_anterior - anterior);
        (0.5 * (self.free_m() - SLIT_M)).min(MOST_STRETCH * thinnest_m).max(0.0)
    }
}

/// The closed shape of a hollow organ.
pub(super) struct Slit {
    /// Which object of the scene it is.
    organ: u32,
    lattice: Lattice,
    /// What the lines through the points meet, those that go through the cavity.
    columns: Vec<Option<Column>>,
    /// How far each wall goes at the points, m.
    way_m: Vec<f64>,
}

impl Slit {
    /// That of an object of a scene.
    ///
    /// # Errors
    /// Why the cavity cannot be closed.
    pub(super) fn of(scene: &LoadedScene, organ: usize) -> Result<Slit, &'static str> {
        let object = &scene.objects[organ];
        let lattice = Lattice::before(&object.mesh);
        let grown: Vec<&TetMesh> = scene.objects.iter().filter(|other| other.attach.is_some()).map(|other| &other.mesh).collect();
        let columns = columns(&lattice, &object.mesh, &grown);
        let way_m = ways_m(&lattice, &columns);
        let slit = Slit { organ: organ as u32, lattice, columns, way_m };
        match slit.left() <= MOST_LEFT {
            true => Ok(slit),
            false => Err("it is no slit between a wall in front and one behind, or they are too thin"),
        }
    }

    /// Where the nodes of a body are led to when the cavity closes, m.
    pub(super) fn shape_m(&self, body: &Body) -> Vec<[f32; 3]> {
        let owners = body.owners();
        let nodes = body.rest.positions_m.iter().zip(owners.iter().zip(&body.fixed));
        let moves = |(owner, fixed): (&Option<u32>, &bool)| *owner == Some(self.organ) && !fixed;
        nodes.map(|(place, node)| if moves(node) { self.closed_m(*place) } else { *place }).collect()
    }

    /// Where a place at rest is led to when the cavity closes, m.
    pub(super) fn closed_m(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        [x, y + self.along_m([x, y, z].map(f64::from)) as f32, z]
    }

    /// How far a place at rest goes along y, m.
    fn along_m(&self, [x, y, z]: [f64; 3]) -> f64 {
        let Some(around) = self.lattice.around([x, z]) else { return 0.0 };
        let way_m: f64 = around.iter().map(|(at, weight)| weight * self.way_m[*at]).sum();
        let (mut faces_m, mut weights) = ([0.0; 4], 0.0);
        for (column, weight) in around.into_iter().filter_map(|(at, weight)| Some((self.columns[at]?, weight))) {
            weights += weight;
            faces_m.iter_mut().zip(column.faces_m).for_each(|(sum, face_m)| *sum += weight * face_m);
        }
        if weights <= 0.0 || way_m <= 0.0 {
            return 0.0;
        }
        let [outer_posterior, posterior, anterior, outer_anterior] = faces_m.map(|sum| sum / weights);
        let share = |left_m: f64, thick_m: f64| (left_m / thick_m.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        match y > 0.5 * (posterior + anterior) {
            true => -way_m * share(outer_anterior - y, outer_anterior - anterior),
            false => way_m * share(y - outer_posterior, posterior - outer_posterior),
        }
    }

    /// What is left of the cavity, as a share of it.
    fn left(&self) -> f64 {
        let known = self.columns.iter().zip(&self.way_m).filter_map(|(column, way_m)| Some((column.as_ref()?.free_m(), *way_m)));
        let (open, closed) =
            known.fold((0.0, 0.0), |(open, closed), (free_m, way_m)| (open + free_m, closed + free_m - 2.0 * way_m));
        if open > 0.0 { closed / open } else { 1.0 }
    }
}

/// What the lines through the points meet of an organ, and of what grows in it.
fn columns(lattice: &Lattice, organ: &TetMesh, grown: &[&TetMesh]) -> Vec<Option<Column>> {
    let grown_m: Vec<Vec<Vec<f64>>> = grown.iter().map(|mesh| lattice.crossings_m(mesh)).collect();
    let column = |(at, crossings_m): (usize, Vec<f64>)| {
        let faces_m = walls_m(&crossings_m)?;
        let filled_m = grown_m.iter().map(|of_object| within_m(&of_object[at], [faces_m[1], faces_m[2]])).sum();
        Some(Column { faces_m, filled_m })
    };
    lattice.crossings_m(organ).into_iter().enumerate().map(column).collect()
}

/// The walls on both sides of the widest space that a line goes through, of the places where it comes into tissue and out of it by turns.
fn walls_m(crossings_m: &[f64]) -> Option<[f64; 4]> {
    if crossings_m.len() < 4 || !crossings_m.len().is_multiple_of(2) {
        return None;
    }
    let wide_m = |out: &usize| crossings_m[out + 1] - crossings_m[*out];
    let out = (1..crossings_m.len() - 2).step_by(2).max_by(|a, b| wide_m(a).total_cmp(&wide_m(b)))?;
    crossings_m[out - 1..].first_chunk().copied()
}

/// How much of what is between two places is within what a line comes into and out of by turns, m.
fn within_m(crossings_m: &[f64], [low_m, high_m]: [f64; 2]) -> f64 {
    let pairs = crossings_m.chunks_exact(2).filter(|_| crossings_m.len().is_multiple_of(2));
    pairs.map(|pair| (pair[1].min(high_m) - pair[0].max(low_m)).max(0.0)).sum()
}

/// How far each wall goes at the points, m.
fn ways_m(lattice: &Lattice, columns: &[Option<Column>]) -> Vec<f64> {
    let flat: Vec<f64> = columns.chunks(lattice.row()).map(|row| flatness(lattice, row)).collect();
    let offsets = [-1, 0, 1];
    let is_rim = |at: usize| {
        let beside = |by: [isize; 2]| lattice.beside(at, by).is_some_and(|other| columns[other].is_some());
        !offsets.iter().all(|z| offsets.iter().all(|x| beside([*x, *z])))
    };
    let whole_m = |(at, column): (usize, &Option<Column>)| {
        let most_m = column.filter(|_| !is_rim(at)).map_or(0.0, |column| column.most_m());
        flat[at / lattice.row()] * most_m
    };
    let mut way_m: Vec<f64> = columns.iter().enumerate().map(whole_m).collect();
    (0..way_m.len()).for_each(|at| slope(lattice, &mut way_m, at, 1));
    (0..way_m.len()).rev().for_each(|at| slope(lattice, &mut way_m, at, -1));
    [[1, 0], [0, 1]].into_iter().fold(way_m, |way_m, axis| rounded(lattice, &way_m, axis))
}

/// How far the cavity closes along a row of the lattice, 0 to 1, by how many times as wide as deep it is there.
fn flatness(lattice: &Lattice, row: &[Option<Column>]) -> f64 {
    let depths_m = row.iter().flatten().map(|column| column.faces_m[2] - column.faces_m[1]);
    let wide_m = depths_m.clone().count() as f64 * lattice.step_m();
    let deep_m = depths_m.fold(0.0, f64::max);
    let share = ((wide_m / deep_m.max(f64::MIN_POSITIVE) - FLAT[0]) / (FLAT[1] - FLAT[0])).clamp(0.0, 1.0);
    share * share * (3.0 - 2.0 * share)
}

/// Takes back the way at a point to what the slope lets it be beside those before it (`sign` 1) or behind it (−1).
fn slope(lattice: &Lattice, way_m: &mut [f64], at: usize, sign: isize) {
    for by in BEFORE {
        if let Some(other) = lattice.beside(at, by.map(|steps| sign * steps)) {
            let steps = if by.contains(&0) { 1.0 } else { SQRT_2 };
            way_m[at] = way_m[at].min(way_m[other] + STEEPEST * steps * lattice.step_m());
        }
    }
}

/// The ways with their edges taken off along an axis: a half of each and a quarter of both beside it.
fn rounded(lattice: &Lattice, way_m: &[f64], axis: [isize; 2]) -> Vec<f64> {
    let beside_m = |at: usize, sign: isize| lattice.beside(at, axis.map(|steps| sign * steps)).map_or(0.0, |other| way_m[other]);
    (0..way_m.len()).map(|at| 0.5 * way_m[at] + 0.25 * (beside_m(at, -1) + beside_m(at, 1))).collect()
}
