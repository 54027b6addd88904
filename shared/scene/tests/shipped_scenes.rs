//! The scenes that come with the station: what they hold, that they can be run, and that binary and folder give the same.
#![allow(missing_docs)]

use glam::{Vec3, Vec3Swizzles};
use hyst_scene::{DeformableKind, LoadedDeformable, LoadedScene, OUTFLOW_RADII, Pose, load, load_embedded, sources, unpack};
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
    is_any_in(scene, pose, object, scene.rigid[0].points_m.iter().copied())
}

/// Whether the ring of the loop does, so far out.
fn ring_touches(scene: &LoadedScene, pose: &Pose, extension_m: f32, object: usize) -> bool {
    scene.rigid[0].electrode.as_ref().is_some_and(|electrode| is_any_in(scene, pose, object, electrode.wire_at(extension_m)))
}

fn is_any_in(scene: &LoadedScene, pose: &Pose, object: usize, points_m: impl Iterator<Item = [f32; 3]>) -> bool {
    let mesh = &scene.objects[object].mesh;
    let points: Vec<glam::Vec3> = points_m.map(|point| pose.place(scene.workspace.pivot_m, point).into()).collect();
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
fn a_copy_of_every_scene_s_files_is_the_same_scene() {
    let copies = std::env::temp_dir().join(format!("hyst-scene-copies-{}", std::process::id()));
    let copied = |name: &str, path: Option<&Path>| {
        let files = sources(path).unwrap_or_else(|error| panic!("{name}: {error}"));
        let copy = unpack(&files, &copies.join(name)).unwrap();
        (files.len(), load(&copy).unwrap_or_else(|error| panic!("{name}: {error}")).hash)
    };
    for (name, scene) in scenes() {
        let (files, hash) = copied(&name, Some(&folder().join(format!("{name}.toml"))));
        assert!(files >= 2 && hash == scene.hash, "{name}: {files} files");
    }
    assert_eq!(copied("embedded", None), (5, scene().hash), "the scene and its four meshes");
    let mesh = folder().join("../meshes/uterus.msh");
    assert_eq!(copied("mesh", Some(&mesh)), (1, load(&mesh).unwrap().hash), "a mesh alone");
    let case = sources(Some(&folder().join("../cases/retrieval.toml"))).unwrap();
    assert_eq!(case, sources(Some(&folder().join("grasper.toml"))).unwrap(), "of a case its scene's");
    std::fs::remove_dir_all(&copies).unwrap();
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

/// About its waist nothing holds the uterus: it lies deeper under the hull there than what its scene fixes.
#[test]
fn the_outside_of_the_uterus_is_told_from_its_cavity_also_where_it_bends_inwards() {
    let scene = scene();
    let uterus = &scene.objects[0];
    let at = |node: &u32| Vec3::from(uterus.mesh.positions_m[*node as usize]);
    let waist = uterus.outside();
    assert!(waist.len() > 40, "{} triangles", waist.len());
    assert!(waist.as_flattened().iter().all(|node| at(node).xy().length() > 0.010), "{waist:?}");
    let is_in_cavity = |place: Vec3| place.x.abs() < 0.010 && place.y.abs() < 0.006 && (0.005..0.050).contains(&place.z);
    let all = LoadedDeformable { fixed: vec![false; uterus.fixed.len()], ..uterus.clone() }.outside();
    assert!((550..700).contains(&all.len()), "{} triangles", all.len());
    assert!(!all.as_flattened().iter().any(|node| is_in_cavity(at(node))));
    assert!(scene.objects[1].outside().is_empty(), "the polyp has no cavity");
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

/// Those whose instrument has a loop.
fn scenes_with_a_loop() -> Vec<(String, LoadedScene)> {
    scenes().into_iter().filter(|(_, scene)| scene.rigid[0].electrode.is_some()).collect()
}

#[test]
fn a_scene_with_jaws_has_no_loop_and_a_hand_of_its_own() {
    let (_, scene) = scenes().into_iter().find(|(_, scene)| scene.rigid[0].jaws.is_some()).expect("one has jaws");
    let jaws = scene.rigid[0].jaws.as_ref().unwrap();
    assert!(scene.rigid[0].electrode.is_none() && scene.hand("fetch").is_some() && scene.notes.is_empty(), "{:?}", scene.notes);
    assert!((jaws.length_m - 0.009).abs() < 1e-6 && scene.rigid[0].element_m() == jaws.opening_m);
    let tip = jaws.turn(jaws.opening_m) * Vec3::from(jaws.points_m[0]);
    assert!((2.0 * tip.x - jaws.opening_m).abs() < 1e-5, "{tip}: half of the opening");
    assert!(jaws.points_m.iter().all(|point| point[0] >= 0.0) && jaws.pads_m.iter().all(|pad| pad[0] == 0.0));
}

#[test]
fn the_loop_cuts_into_a_pathology_and_neither_it_nor_the_shaft_touches_anything_else() {
    for (name, scene) in scenes_with_a_loop() {
        let hand = scene.hand("polyp").unwrap_or_else(|| panic!("{name}: no hand reaches it"));
        let reach_m = scene.rigid[0].electrode.as_ref().unwrap().reach_m;
        assert_eq!(hand.target, Some(1), "{name}");
        let (mut cutting, mut from, mut was_extended) = (0, hand.way[0], false);
        for (index, leg) in hand.legs.iter().enumerate() {
            for step in 0..=20u8 {
                let share = f32::from(step) / 20.0;
                let pose = from.towards(&leg.to, share);
                assert_eq!(touched(&scene, &pose), Vec::<usize>::new(), "{name}, leg {index}: the shaft touches at {pose:?}");
                // While the hand rests the loop may be anywhere on its way out or in.
                let extension_m = match (leg.is_extended || was_extended, from == leg.to) {
                    (true, true) => share * reach_m,
                    (true, false) => reach_m,
                    (false, _) => 0.0,
                };
                let objects = 0..scene.objects.len();
                let ringed: Vec<usize> = objects.filter(|&object| ring_touches(&scene, &pose, extension_m, object)).collect();
                assert!(ringed.is_empty() || (ringed == [1] && leg.is_energized), "{name}, leg {index}: {ringed:?} at {pose:?}");
                cutting += ringed.len();
            }
            (from, was_extended) = (leg.to, leg.is_extended);
        }
        assert!(cutting > 10 && from == hand.way[0], "{name}: the ring is in the pathology in {cutting} poses");
    }
}

/// Where the outflow is in a pose, and where the ring when it is out.
fn outflow_and_ring_m(scene: &LoadedScene, pose: &Pose) -> [Vec3; 2] {
    let (rigid, pivot_m) = (&scene.rigid[0], scene.workspace.pivot_m);
    let ahead = [-OUTFLOW_RADII[0] * rigid.radius_m, rigid.electrode.as_ref().unwrap().reach_m];
    ahead.map(|ahead_m| pose.place(pivot_m, [0.0, 0.0, ahead_m]).into())
}

#[test]
fn the_hand_that_has_cut_waits_with_the_outflow_open_over_what_it_has_cut() {
    for (name, scene) in scenes_with_a_loop() {
        let hand = scene.hand("polyp").unwrap();
        let cut = hand.legs.iter().rposition(|leg| leg.is_energized).unwrap();
        let [before_m, chip_m] = outflow_and_ring_m(&scene, &hand.legs[cut].to);
        let waits =
            hand.legs.windows(2).find(|legs| legs[1].is_rinsing && legs[0].to == legs[1].to).unwrap_or_else(|| panic!("{name}"));
        let [over_m, _] = outflow_and_ring_m(&scene, &waits[1].to);
        let (along_m, was_m) = ((over_m - chip_m).xz().length(), (before_m - chip_m).xz().length());
        println!("{name}: the outflow is {along_m} m beside the place below the chip, it was {was_m} m; {:?}", waits[1].to);
        assert!(along_m < 0.5 * was_m && over_m.y < chip_m.y + 1e-3, "{name}: {over_m} over {chip_m}");
        let after = &hand.legs[cut + 1..];
        assert!(hand.legs[..=cut].iter().all(|leg| !leg.is_rinsing) && after.iter().all(|leg| !leg.is_energized), "{name}");
        assert!(after.iter().all(|leg| !(leg.is_rinsing && leg.is_extended)), "{name}: the loop is in");
    }
}

/// A scene of the assets with another loop, in a file that bears the name of its test.
fn with_loop(test: &str, name: &str, electrode: &str) -> LoadedScene {
    let text = std::fs::read_to_string(folder().join(format!("{name}.toml"))).unwrap();
    let meshes = format!("\"{}", folder().join("../meshes").display());
    let text = text.replace("\"../meshes", &meshes).replace("points = 400", &format!("loop = {{ {electrode} }}"));
    let path = std::env::temp_dir().join(format!("hyst-scene-{}-{test}-{name}-{}.toml", std::process::id(), electrode.len()));
    std::fs::write(&path, text).unwrap();
    let scene = load(&path).unwrap_or_else(|error| panic!("{error}"));
    std::fs::remove_file(&path).unwrap();
    scene
}

#[test]
fn without_a_loop_a_pathology_is_reached_without_touching_the_wall() {
    for (name, _) in scenes() {
        let scene = with_loop("reached", &name, "reach_m = 0.0");
        assert_eq!(scene.notes, Vec::<String>::new(), "{name}");
        let hand = scene.hand("polyp").unwrap_or_else(|| panic!("{name}: no hand reaches it"));
        assert_eq!((hand.target, hand.legs.len()), (Some(1), 0), "{name}");
        for step in 0..=50 {
            let pose = hand.pose_at(hand.period_s * f64::from(step) / 100.0);
            assert!(touched(&scene, &pose).iter().all(|object| *object == 1), "{name}: {pose:?}");
        }
        assert!(!touches(&scene, &hand.way[0], 1) && touches(&scene, hand.way.last().unwrap(), 1), "{name}");
    }
}

#[test]
fn where_there_is_no_room_to_draw_the_loop_the_hand_does_what_it_does_without_one_and_a_note_says_so() {
    let [roomless, without] = ["radius_m = 0.015", "reach_m = 0.0"].map(|electrode| with_loop("roomless", "default", electrode));
    assert_eq!(roomless.hand("polyp"), without.hand("polyp"));
    assert!(roomless.notes.len() == 1 && roomless.notes[0].contains("no room to draw the loop"), "{:?}", roomless.notes);
    assert_ne!(roomless.hash, without.hash);
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
