//! What two hundred seeds of each shipped case draw, without a station: figures within their ranges, no two anatomies the same, and pathology that sits in the
//! cavity and holds to its wall.

use super::file::{Case, Vary};
use super::seat::Seats;
use super::{Past, read_case, vary};
use crate::file::{DeformableKind, Scene};
use crate::load::{ReadScene, placed};
use crate::locate::Locator;
use crate::validate::validate;
use glam::Vec3;
use hyst_mesh::TetMesh;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

const SEEDS: u32 = 200;
/// Steps in which a wall is looked for, and how far: no uterus is wider than 60 mm.
const STEP_M: f32 = 0.000_5;
const STEPS: u32 = 120;

/// The shipped cases by their names, with their scenes, nothing drawn.
fn shipped() -> Vec<(String, Case, ReadScene)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/cases");
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    assert!(paths.len() >= 11, "{paths:?}");
    let read = |path: PathBuf| {
        let text = std::fs::read_to_string(&path).unwrap();
        let (case, read) = read_case(&text, &path, Past::New).unwrap_or_else(|error| panic!("{error}"));
        (path.file_stem().unwrap().to_string_lossy().into_owned(), case, read)
    };
    paths.into_iter().map(read).collect()
}

/// A figure that was drawn, which lies in its range up to the rounding to single precision; to the bit.
fn figure(what: &str, value: f64, [low, high]: [f64; 2]) -> u64 {
    let rounding = 1e-6 * high;
    assert!((low - rounding..=high + rounding).contains(&value), "{what}: {value} is not within {low} to {high}");
    value.to_bits()
}

/// All that was drawn of an entry.
fn figures(vary: &Vary, home: &Scene, drawn: &Scene, seats: &Seats) -> Vec<u64> {
    let Some(name) = &vary.object else {
        let vessels = &drawn.vessels;
        let of_vessels = [
            (vary.vessel_pressure_pa, vessels.pressure_pa),
            (vary.vessel_spacing_m, vessels.spacing_m),
            (vary.vessel_conductance_ml_s_pa, vessels.conductance_ml_s_pa),
        ];
        return of_vessels.into_iter().filter_map(|(limits, value)| Some(figure("vessels", value, limits?))).collect();
    };
    let index = home.deformable.iter().position(|object| object.name == *name).unwrap();
    let [now_pa, before_pa] = [drawn, home].map(|scene| scene.deformable[index].material.youngs_modulus_pa);
    let of_object = [
        (vary.stiffness, Some(now_pa / before_pa)),
        (vary.size, seats.of[index].map(|seat| f64::from(seat.size))),
        (vary.shift_m, seats.of[index].map(|seat| f64::from(seat.shift_m))),
    ];
    of_object.into_iter().filter_map(|(limits, value)| limits.map(|limits| figure(name, value.unwrap(), limits))).collect()
}

#[test]
fn two_hundred_seeds_of_each_case_draw_within_its_ranges_and_no_two_draw_the_same() {
    for (name, case, read) in shipped() {
        let mut anatomies = BTreeSet::new();
        for seed in 0..=SEEDS {
            let mut scene = read.scene.clone();
            let (seats, _) = vary::draw(&case, seed, &mut scene);
            validate(&scene).unwrap_or_else(|error| panic!("{name}, seed {seed}: {error}"));
            let drawn: Vec<u64> = case.vary.iter().flat_map(|vary| figures(vary, &read.scene, &scene, &seats)).collect();
            assert!(!drawn.is_empty() && anatomies.insert(drawn), "{name}: seed {seed} draws nothing, or what another one does");
        }
    }
}

#[test]
fn the_pathology_of_two_hundred_seeds_of_each_case_sits_in_the_cavity_and_holds_to_its_wall() {
    std::thread::scope(|scope| {
        for (name, case, read) in shipped() {
            scope.spawn(move || assert_seated(&name, &case, &read));
        }
    });
}

fn assert_seated(name: &str, case: &Case, read: &ReadScene) {
    let scene = &read.scene;
    let place = |seats: &Seats| {
        let placed = placed(scene, &read.folder, seats, &mut Vec::new());
        placed.unwrap_or_else(|error| panic!("{name}: {error}")).0
    };
    let home = place(&Seats::default());
    let organ_index = scene.deformable.iter().position(|object| object.kind == DeformableKind::Organ).unwrap();
    let organ_at_home = Locator::new(&home[organ_index].0);
    let rooted = |mesh: &TetMesh, organ: &Locator| mesh.positions_m.iter().filter(|point| organ.find(**point).is_some()).count();
    let volume_m3 = |mesh: &TetMesh| hyst_mesh::check(mesh).volume_m3;
    let is_moved = case.vary.iter().any(|vary| vary.size.is_some() || vary.shift_m.is_some());
    for seed in 0..=if is_moved { SEEDS } else { 1 } {
        let (seats, _) = vary::draw(case, seed, &mut scene.clone());
        let objects = place(&seats);
        let organ = Locator::new(&objects[organ_index].0);
        let mut pathology_ml = 0.0;
        for (index, object) in scene.deformable.iter().enumerate() {
            if object.kind != DeformableKind::Pathology {
                continue;
            }
            let who = format!("{name}, seed {seed}, {}", object.name);
            let (now, before) = (&objects[index].0, &home[index].0);
            let outside = now.positions_m.iter().find(|point| !is_enclosed(**point, &organ));
            assert_eq!(outside, None, "{who}: a node is outside of the organ");
            let (nodes, nodes_before) = (rooted(now, &organ), rooted(before, &organ_at_home));
            let is_held = object.attach_to.is_none() || nodes > 0 && (nodes_before / 2..=2 * nodes_before).contains(&nodes);
            assert!(is_held, "{who}: {nodes} nodes in the wall, {nodes_before} at home");
            // What would grow into another wall, or off its own, is drawn back towards its size at home.
            let [least, most] = size_of(case, &object.name);
            let size = (volume_m3(now) / volume_m3(before)).cbrt();
            assert!((least.min(1.0) - 1e-3..=most.max(1.0) + 1e-3).contains(&size), "{who}: {size} times as large");
            assert!(hyst_mesh::check(now).inverted.is_empty(), "{who}");
            pathology_ml += 1e6 * volume_m3(now);
        }
        let biopsies = case.goal.iter().filter_map(|goal| goal.biopsy.as_ref());
        biopsies.for_each(|biopsy| assert!(biopsy.at_least_ml < pathology_ml, "{name}, seed {seed}: {pathology_ml} ml"));
    }
}

/// Factors between which a case draws the size of an object.
fn size_of(case: &Case, object: &str) -> [f64; 2] {
    let vary = case.vary.iter().find(|vary| vary.object.as_deref() == Some(object));
    vary.and_then(|vary| vary.size).unwrap_or([1.0; 2])
}

/// Whether a point lies in the wall of an organ, or has wall before it on every side but that of the cervix.
fn is_enclosed(point: [f32; 3], organ: &Locator) -> bool {
    let is_wall = |direction: Vec3, step: u32| {
        let there = Vec3::from(point) + direction * (step as f32 * STEP_M);
        organ.find(there.to_array()).is_some()
    };
    let sides = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z];
    sides.into_iter().all(|direction| (0..STEPS).any(|step| is_wall(direction, step)))
}
