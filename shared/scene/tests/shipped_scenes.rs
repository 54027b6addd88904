//! The scenes that come with the station: what they hold, that they can be run, and that binary and folder give the same.
#![allow(missing_docs)]

use hyst_scene::{DeformableKind, LoadedScene, Pose, load, load_embedded};
use std::path::{Path, PathBuf};

fn scene() -> LoadedScene {
    load_embedded().unwrap_or_else(|error| panic!("{error}"))
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes")
}

/// All scenes of the assets, by their file names.
fn scenes() -> Vec<(String, LoadedScene)> {
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    assert!(paths.len() >= 4, "{paths:?}");
    let stem = |path: &Path| path.file_stem().unwrap().to_string_lossy().into_owned();
    paths.iter().map(|path| (stem(path), load(path).unwrap_or_else(|error| panic!("{error}")))).collect()
}

fn touched(scene: &LoadedScene, pose: &Pose) -> Vec<usize> {
    (0..scene.objects.len()).filter(|&object| touches(scene, pose, object)).collect()
}

/// Whether any collision point of the instrument lies in a tet of an object: brute force, the oracle of the loader's own search.
fn touches(scene: &LoadedScene, pose: &Pose, object: usize) -> bool {
    let mesh = &scene.objects[object].mesh;
    let points: Vec<glam::Vec3> =
        scene.rigid[0].points_m.iter().map(|&point| pose.place(scene.workspace.pivot_m, point).into()).collect();
    mesh.tets.iter().any(|tet| {
        let [a, b, c, d] = tet.map(|node| glam::Vec3::from(mesh.positions_m[node as usize]));
        let inverse = glam::Mat3::from_cols(b - a, c - a, d - a).inverse();
        points.iter().any(|&point| {
            let beta = inverse * (point - a);
            beta.min_element() >= 0.0 && beta.element_sum() <= 1.0
        })
    })
}

#[test]
fn the_counts_are_those_of_the_2006_framework() {
    let scene = scene();
    let counts: Vec<_> =
        scene.objects.iter().map(|object| (object.mesh.tets.len() as f64, object.surface.triangles.len())).collect();
    assert!((counts[0].0 / 3198.0 - 1.0).abs() < 0.02, "{counts:?}");
    assert!((counts[1].0 / 206.0 - 1.0).abs() < 0.05, "{counts:?}");
    assert!(counts[0].1.abs_diff(1646) <= 10 && counts[1].1.abs_diff(1336) <= 10, "{counts:?}");
    assert_eq!(scene.objects[1].kind, DeformableKind::Pathology);
    assert_eq!(scene.notes, Vec::<String>::new(), "the default scene needs no repair and no assumption");
}

/// Table 2 of the paper: one myoma, one polyp, three polyps, each in a uterus.
#[test]
fn the_three_cases_of_the_2006_framework_have_their_sizes_and_need_no_repair_and_no_assumption() {
    let all = scenes();
    for (name, tets, pathologies) in [("myoma", 3_589, 1), ("polyp-medium", 5_598, 1), ("three-polyps", 10_398, 3)] {
        let (_, scene) = all.iter().find(|(found, _)| found == name).unwrap_or_else(|| panic!("no {name}"));
        let count: usize = scene.objects.iter().map(|object| object.mesh.tets.len()).sum();
        assert!((count as f64 / f64::from(tets) - 1.0).abs() < 0.05, "{name}: {count} tets");
        assert_eq!(scene.objects.iter().filter(|object| object.kind == DeformableKind::Pathology).count(), pathologies, "{name}");
        assert_eq!(scene.notes, Vec::<String>::new(), "{name}");
    }
}

#[test]
fn every_surface_vertex_follows_its_tets_and_the_surface_is_closed() {
    for object in scenes().into_iter().flat_map(|(_, scene)| scene.objects) {
        assert_eq!(object.bindings.len(), object.surface.positions_m.len());
        let mut bound_m = vec![[0.0; 3]; object.bindings.len()];
        hyst_mesh::evaluate(&object.bindings, &object.mesh.tets, &object.mesh.positions_m, &mut bound_m);
        for ((bound, drawn), binding) in bound_m.iter().zip(&object.surface.positions_m).zip(&object.bindings) {
            assert!(glam::Vec3::from(*bound).distance(glam::Vec3::from(*drawn)) < 1e-6, "{}", object.name);
            assert!(binding.weights.iter().all(|weight| weight.abs() < 1.6), "{}: {binding:?}", object.name);
        }
        let mut edges = std::collections::BTreeMap::new();
        for [a, b, c] in object.surface.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *edges.entry((from.min(to), from.max(to))).or_insert((0, 0)) = {
                    let (count, balance) = edges.get(&(from.min(to), from.max(to))).copied().unwrap_or((0, 0));
                    (count + 1, balance + if from < to { 1 } else { -1 })
                };
            }
        }
        assert!(edges.values().all(|&edge| edge == (2, 0)), "{}: an open or wrongly turned edge", object.name);
    }
}

#[test]
fn the_uterus_is_held_outside_and_free_inside_and_the_polyp_is_rooted_in_it() {
    let scene = scene();
    let uterus = &scene.objects[0];
    assert!(uterus.hollow && !scene.objects[1].hollow);
    for (fixed, position) in uterus.fixed.iter().zip(&uterus.mesh.positions_m) {
        let in_cavity = position[0].abs() < 0.010 && position[1].abs() < 0.006 && (0.005..0.050).contains(&position[2]);
        assert!(!(*fixed && in_cavity), "a node of the cavity's wall is fixed: {position:?}");
    }
    let held = uterus.fixed.iter().filter(|&&fixed| fixed).count();
    assert!(held > 100 && held < uterus.fixed.len() / 2, "{held} held");
    let attach = scene.objects[1].attach.as_ref().unwrap();
    assert!(attach.host == 0 && attach.nodes.len() >= 4, "{} nodes", attach.nodes.len());
    for node in &attach.nodes {
        let tet = uterus.mesh.tets[node.tet as usize];
        let there: glam::Vec3 = tet
            .iter()
            .zip(node.weights)
            .map(|(&corner, weight)| glam::Vec3::from(uterus.mesh.positions_m[corner as usize]) * weight)
            .sum();
        assert!(there.distance(scene.objects[1].mesh.positions_m[node.node as usize].into()) < 1e-6);
    }
}

#[test]
fn a_straight_scope_passes_freely_to_50_mm() {
    let scene = scene();
    for step in 0..=100 {
        let pose = Pose::straight(step as f32 * 0.0005);
        assert!(!touches(&scene, &pose, 0) && !touches(&scene, &pose, 1), "touches at {} mm", pose.insertion_m * 1e3);
    }
}

#[test]
fn the_press_starts_free_and_ends_in_the_posterior_wall() {
    for (name, scene) in scenes() {
        let press = scene.hand("press").unwrap();
        let (from, into) = (press.pose_at(0.0), press.pose_at(press.period_s / 2.0));
        assert_eq!(press.target, Some(0), "{name}");
        assert_eq!(touched(&scene, &from), Vec::<usize>::new(), "{name}: {from:?}");
        assert_eq!(touched(&scene, &into), vec![0], "{name}: {into:?}");
        assert!(into.tip_m([0.0; 3])[1] < -0.003, "{name}: {into:?}");
    }
}

#[test]
fn a_pathology_is_reached_without_touching_the_wall() {
    for (name, scene) in scenes() {
        let hand = scene.hand("polyp").unwrap_or_else(|| panic!("{name}: no hand reaches it"));
        assert_eq!(hand.target, Some(1), "{name}");
        for step in 0..=50 {
            let pose = hand.pose_at(hand.period_s * f64::from(step) / 100.0);
            assert!(touched(&scene, &pose).iter().all(|object| *object == 1), "{name}: {pose:?}");
        }
        assert!(!touches(&scene, &hand.way[0], 1) && touches(&scene, hand.way.last().unwrap(), 1), "{name}");
    }
}

#[test]
fn exploring_touches_nothing() {
    for (name, scene) in scenes() {
        let hand = scene.hand("explore").unwrap();
        for step in 0..=100 {
            let pose = hand.pose_at(hand.period_s * f64::from(step) / 200.0);
            assert_eq!(touched(&scene, &pose), Vec::<usize>::new(), "{name}: {pose:?}");
        }
    }
}

#[test]
fn the_binary_and_the_folder_give_the_same_content() {
    let from_disk = load(&folder().join("default.toml")).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(from_disk.hash, scene().hash);
    assert_eq!(from_disk.objects, scene().objects);
}
