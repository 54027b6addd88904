//! The cases that come with the station, and what their seeds draw: no two need be the same, and each is found again to the bit.
#![allow(missing_docs)]

use hyst_scene::{Aim, Case, DeformableKind, LoadedScene, SettledCase, find_case, load};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/cases")
}

fn settled(name: &str, seed: Option<u32>) -> SettledCase {
    let path = folder().join(format!("{name}.toml"));
    find_case(&path, seed).unwrap_or_else(|error| panic!("{error}")).unwrap()
}

fn names() -> Vec<String> {
    let entries = std::fs::read_dir(folder()).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// The nodes of an object that lie in its host.
fn rooted(scene: &LoadedScene, name: &str) -> usize {
    let object = scene.objects.iter().find(|object| object.name == name).unwrap();
    object.attach.as_ref().map_or(0, |attach| attach.nodes.len())
}

#[test]
fn the_ladder_has_its_rungs_and_each_case_loads_with_goals_and_an_end() {
    let ladder = [
        "access",
        "biopsy",
        "bleeding",
        "distension",
        "fluid-overload",
        "myoma",
        "navigation",
        "perforation",
        "polyp",
        "retrieval",
        "septum",
    ];
    assert_eq!(names(), ladder);
    for name in ladder {
        let case = settled(name, None);
        assert!(!case.brief.goals.is_empty() && !case.brief.end.words().is_empty(), "{name}");
        assert!(!case.brief.drawn.is_empty(), "{name}: nothing differs from seed to seed");
        let rung = serde_json::to_value(case.brief.rung).unwrap();
        assert_eq!(rung.as_str().unwrap().replace('_', "-"), name);
    }
}

#[test]
fn one_seed_is_one_anatomy_to_the_bit_and_others_are_others() {
    for name in names() {
        let first = settled(&name, Some(5));
        assert_eq!(first, settled(&name, Some(5)), "{name}");
        let hashes: BTreeSet<u64> = (5..9).map(|seed| settled(&name, Some(seed)).scene.hash).collect();
        assert_eq!(hashes.len(), 4, "{name}: two of four seeds drew the same");
    }
}

/// The hash of a scene changes with a stiffness, which nobody sees: of two seeds, neither or both of which mirror it, nodes lie elsewhere.
#[test]
fn but_for_distension_and_the_septum_no_two_seeds_draw_the_same_shape() {
    for name in names() {
        let mut shapes: BTreeMap<Vec<String>, Vec<Vec<[u32; 3]>>> = BTreeMap::new();
        for seed in 5..11 {
            let SettledCase { brief, scene, .. } = settled(&name, Some(seed));
            let mirrored: Vec<String> = brief.drawn.into_iter().filter(|drawn| drawn.starts_with("mirrored")).collect();
            let nodes = scene.objects.iter().flat_map(|object| &object.mesh.positions_m).map(|node| node.map(f32::to_bits));
            shapes.entry(mirrored).or_default().push(nodes.collect());
        }
        let is_varied = !["distension", "septum"].contains(&name.as_str());
        for alike in shapes.into_values() {
            let (seeds, different) = (alike.len(), alike.into_iter().collect::<BTreeSet<_>>().len());
            assert_eq!(different, if is_varied { seeds } else { 1 }, "{name}");
        }
    }
}

#[test]
fn the_settled_text_is_a_case_that_draws_the_same_wherever_it_lies() {
    let path = std::env::temp_dir().join(format!("hyst-{}-settled.toml", std::process::id()));
    for (name, seed) in [("polyp", 11), ("polyp", 4), ("myoma", 7), ("navigation", 900_000), ("fluid-overload", 2)] {
        let case = settled(name, Some(seed));
        std::fs::write(&path, &case.text).unwrap();
        let again = find_case(&path, None).unwrap().unwrap();
        let by_an_engine = load(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        assert_eq!((again.scene.hash, &again.text, &again.brief), (case.scene.hash, &case.text, &case.brief), "{name}");
        let alarm_ml = (name == "myoma").then_some(1_000.0);
        assert_eq!(by_an_engine.fluid.deficit_alarm_ml, alarm_ml, "{name}: the pump gives alarm where the case warns");
        assert_eq!(by_an_engine, case.scene, "{name}");
    }
}

#[test]
fn what_is_drawn_keeps_within_the_case_and_stays_rooted_in_the_wall() {
    let home = load(&folder().join("../scenes/default.toml")).unwrap();
    let volume = |scene: &LoadedScene| hyst_mesh::check(&scene.objects[1].mesh).volume_m3;
    let (mut volumes, mut moduli, mut places) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 0..24 {
        let scene = settled("polyp", Some(seed)).scene;
        let polyp = &scene.objects[1];
        assert_eq!(polyp.kind, DeformableKind::Pathology);
        let factor = (volume(&scene) / volume(&home)).cbrt();
        assert!((0.849..1.101).contains(&factor), "seed {seed}: {factor}");
        let stiffness = polyp.material.youngs_modulus_pa / home.objects[1].material.youngs_modulus_pa;
        assert!((0.7..=1.5).contains(&stiffness), "seed {seed}: {stiffness}");
        let (now, before) = (rooted(&scene, "polyp"), rooted(&home, "polyp"));
        assert!((before / 2..=2 * before).contains(&now), "seed {seed}: {now} nodes in the wall, {before} at home");
        let pressure_pa = scene.fluid.vessels.pressure_pa;
        assert!((10_000.0..=13_000.0).contains(&pressure_pa), "seed {seed}: {pressure_pa}");
        volumes.push(factor);
        moduli.push(stiffness);
        places.push(polyp.mesh.positions_m[0]);
    }
    let spread =
        |values: &[f64]| values.iter().copied().fold(f64::MIN, f64::max) - values.iter().copied().fold(f64::MAX, f64::min);
    assert!(spread(&volumes) > 0.15 && spread(&moduli) > 0.5, "{volumes:?} {moduli:?}");
    let across: Vec<f64> = places.iter().map(|place| f64::from(place[1])).collect();
    assert!(spread(&across) > 0.001, "{across:?}");
}

#[test]
fn the_surface_and_the_root_follow_the_tets_that_were_moved() {
    for seed in 0..6 {
        let scene = settled("myoma", Some(seed)).scene;
        let object = &scene.objects[1];
        let mut bound_m = vec![[0.0; 3]; object.bindings.len()];
        hyst_mesh::evaluate(&object.bindings, &object.mesh.tets, &object.mesh.positions_m, &mut bound_m);
        for (bound, drawn) in bound_m.iter().zip(&object.surface.positions_m) {
            assert!(glam::Vec3::from(*bound).distance(glam::Vec3::from(*drawn)) < 1e-6, "seed {seed}");
        }
        assert!(hyst_mesh::check(&object.mesh).inverted.is_empty());
    }
}

/// Who never touches the camera head has nothing to learn of it where the horizon is kept for him.
#[test]
fn from_navigation_on_the_camera_head_is_the_trainees_and_engines_know_it() {
    let path = std::env::temp_dir().join(format!("hyst-{}-head.toml", std::process::id()));
    let free = ["biopsy", "myoma", "navigation", "polyp", "retrieval", "septum"];
    for name in names() {
        let case = settled(&name, None);
        std::fs::write(&path, &case.text).unwrap();
        let by_an_engine = load(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        let is_free = free.contains(&name.as_str());
        assert_eq!((case.scene.is_head_free, by_an_engine.is_head_free), (is_free, is_free), "{name}");
    }
    assert!(!load(&folder().join("../scenes/default.toml")).unwrap().is_head_free, "a scene by itself keeps it");
}

/// The pump holds its set pressure from before anybody moves: half of the goals of `access` came by themselves.
#[test]
fn no_pressure_that_a_goal_asks_for_is_the_one_that_the_pump_begins_with() {
    let mut asked = 0;
    for name in names() {
        let case = settled(&name, None);
        let set_pa = f64::from(case.scene.fluid.set_pressure_pa);
        for goal in &case.brief.goals {
            let Aim::Pressure { band_pa: [from_pa, to_pa], .. } = goal.is else { continue };
            assert!(!(from_pa..=to_pa).contains(&set_pa), "{name}: {}, and {set_pa} Pa are set", goal.words);
            asked += 1;
        }
    }
    assert!(asked >= 2, "{asked} goals ask for a pressure");
}

/// The operator's page called “at most” what a notice on the way there names: 50 ml of `fluid-overload`, whose task says 100.
#[test]
fn the_deficit_that_is_allowed_is_the_least_that_rules_stops_and_ends_name_and_no_notice_lowers_it() {
    let allowed = [
        ("access", 2_500.0),
        ("distension", 1_000.0),
        ("fluid-overload", 100.0),
        ("myoma", 1_000.0),
        ("perforation", 1_500.0),
        ("polyp", 2_500.0),
        ("septum", 2_500.0),
    ];
    for (name, ml) in allowed {
        assert_eq!(settled(name, None).brief.deficit_allowed_ml(), Some(ml), "{name}");
    }
    let mut brief = settled("fluid-overload", None).brief;
    brief.goals.clear();
    assert_eq!(brief.deficit_allowed_ml(), Some(400.0), "its end");
    brief.end.deficit_ml = None;
    assert_eq!(brief.deficit_allowed_ml(), Some(1_000.0), "the pump's of glycine, which stands first");
    brief.warnings.clear();
    assert_eq!(brief.deficit_allowed_ml(), None);
}

/// Forceps leave the polyp on its wall: who has brought the piece out has removed all that is to be removed, not a sixth of it.
#[test]
fn of_a_scene_with_jaws_what_lies_free_is_to_be_removed_and_of_any_other_all_pathology() {
    for (name, seed) in [("retrieval", 1), ("retrieval", 4), ("polyp", 3), ("septum", 2)] {
        let case = settled(name, Some(seed));
        let of = |is_asked: fn(&str) -> bool| -> f64 {
            let asked = case.scene.objects.iter().filter(|object| is_asked(&object.name));
            asked.map(|object| 1e6 * hyst_mesh::check(&object.mesh).volume_m3).sum()
        };
        let asked_ml = if name == "retrieval" { of(|name| name == "piece") } else { of(|name| name != "uterus") };
        assert!(asked_ml > 0.05 && (case.brief.pathology_ml - asked_ml).abs() < 1e-9, "{name}: {asked_ml} ml");
        for goal in &case.brief.goals {
            let Aim::Removed(ml) = goal.is else { continue };
            assert!(ml > 0.0 && ml < asked_ml, "{name}: {ml} of {asked_ml} ml");
        }
    }
}

/// At 30 mmHg the walls are not as they are at 70.
#[test]
fn a_case_that_sets_another_pressure_has_the_walls_of_its_scene() {
    let home = load(&folder().join("../scenes/default.toml")).unwrap().fluid;
    assert_eq!(home.rest_pressure_pa, home.set_pressure_pa);
    for name in ["access", "distension", "bleeding"] {
        let fluid = settled(name, None).scene.fluid;
        assert_eq!(fluid.rest_pressure_pa, home.rest_pressure_pa, "{name}");
        assert!(fluid.set_pressure_pa < home.set_pressure_pa - 2_000.0, "{name}: {} Pa", fluid.set_pressure_pa);
    }
}

#[test]
fn septum_myoma_and_the_complications_have_trainees_of_their_own_who_use_the_loop() {
    let trainees = [
        ("septum", &["divide"][..]),
        ("myoma", &["slices"]),
        ("perforation", &["goes-on", "stops"]),
        ("bleeding", &["looks-on", "staunches"]),
        ("fluid-overload", &["looks-on", "watches"]),
    ];
    for (case, names) in trainees {
        let scene = settled(case, None).scene;
        for name in names {
            let hand = scene.hand(name).unwrap_or_else(|| panic!("{case}: no hand {name}: {:?}", scene.notes));
            assert!(hand.legs.iter().any(|leg| leg.is_energized && leg.is_extended), "{case} {name}");
        }
    }
    let [handles, looks_on] = ["staunches", "looks-on"].map(|name| settled("bleeding", None).scene.hand(name).unwrap().clone());
    let found = settled("bleeding", None).scene.hand("polyp").unwrap().clone();
    assert_eq!((&handles.legs, &looks_on.legs), (&found.legs, &found.legs), "they move like the one that is found");
    let watches = settled("fluid-overload", None).scene.hand("watches").unwrap().clone();
    assert!(watches.changes.iter().any(|change| change.after.is_some()), "who watches acts upon what the pump shows");
    assert!(handles.is_once && !handles.changes.is_empty() && looks_on.changes.is_empty() && !found.is_once);
}

#[test]
fn the_septum_divides_the_cavity_and_is_rooted_in_both_walls_and_the_fundus() {
    let scene = load(&folder().join("../scenes/septum.toml")).unwrap();
    let septum = &scene.objects[1];
    assert_eq!(septum.kind, DeformableKind::Pathology);
    let rooted: Vec<[f32; 3]> =
        septum.attach.as_ref().unwrap().nodes.iter().map(|node| septum.mesh.positions_m[node.node as usize]).collect();
    let of = |is: fn(&[f32; 3]) -> bool| rooted.iter().filter(|place| is(place)).count();
    assert!(of(|place| place[1] > 0.004) >= 10 && of(|place| place[1] < -0.004) >= 10 && of(|place| place[2] > 0.052) >= 10);
    let lowest = septum.mesh.positions_m.iter().map(|place| place[2]).fold(f32::MAX, f32::min);
    // The cavity ends 52 mm from the pivot.
    assert!((0.052 - lowest - 0.018).abs() < 0.000_5, "{lowest}");
}

/// +x is the patient's right, which is on the picture's left: places and polyps were named for the other side.
#[test]
fn what_is_named_for_a_side_of_the_patient_lies_there() {
    let mut named = 0;
    let mut look = |name: &str, x_m: f64| {
        let has = |side: &str| name.split(' ').any(|word| word == side);
        if has("left") || has("right") {
            assert_eq!(x_m > 0.0, has("right"), "{name}: {x_m} m");
            named += 1;
        }
    };
    for name in names() {
        let text = std::fs::read_to_string(folder().join(format!("{name}.toml"))).unwrap();
        let case = Case::parse(&text, &name).unwrap_or_else(|error| panic!("{error}"));
        let placed = case.place.iter().filter_map(|place| Some((place.name.as_str(), place.centre_m?[0])));
        placed.for_each(|(name, x_m)| look(name, x_m));
    }
    for object in load(&folder().join("../scenes/three-polyps.toml")).unwrap().objects {
        let mean_m = object.mesh.positions_m.iter().map(|point| f64::from(point[0])).sum::<f64>();
        look(&object.name, mean_m / object.mesh.positions_m.len() as f64);
    }
    assert_eq!(named, 4, "two horns, two polyps");
}

#[test]
fn a_scripted_hand_cuts_the_polyp_of_most_seeds() {
    let cuts = |seed: &u32| settled("polyp", Some(*seed)).scene.hand("polyp").is_some_and(|hand| !hand.legs.is_empty());
    let with_room = (0..12).filter(cuts).count();
    assert!(with_room >= 8, "{with_room} of 12");
    assert!(cuts(&1), "the shipped seed");
}

/// What a class would be given was to be seen only once a station ran.
#[test]
fn a_check_of_another_seed_shows_what_that_one_draws() {
    let path = folder().join("polyp.toml");
    let [own, other] = [None, Some(7)].map(|seed| hyst_scene::check_drawn(Some(&path), seed));
    assert_eq!(own, hyst_scene::check(Some(&path)));
    let drawn = settled("polyp", Some(7));
    assert!(other.runnable && other.hash != own.hash, "{other}");
    assert_eq!((other.hash, other.origin), (format!("{:016x}", drawn.scene.hash), own.origin));
    assert_eq!(other.case, Some(drawn.brief));
}

/// A teacher tries the case's own seed, and the class is given another one.
#[test]
fn a_check_names_the_seeds_with_which_a_case_would_be_refused() {
    let own = folder().join("polyp.toml");
    let told = |path: &Path| {
        let report = hyst_scene::check(Some(path));
        assert!(report.runnable, "{report}");
        report.notes.into_iter().find(|note| note.contains("it is refused with"))
    };
    assert_eq!(told(&own), None);
    // As large a chip as the whole polyp of the own seed: every seed that draws a smaller one cannot give it.
    let asked_ml = (0.999e6 * settled("polyp", None).brief.pathology_ml).floor() / 1e6;
    let scene = folder().join("../scenes/default.toml").display().to_string();
    let text = std::fs::read_to_string(&own).unwrap().replace("../scenes/default.toml", &scene);
    let (from, to) = ("at_least_ml = 0.005", format!("at_least_ml = {asked_ml}"));
    assert!(text.contains(from));
    let path = std::env::temp_dir().join(format!("hyst-{}-seeds.toml", std::process::id()));
    std::fs::write(&path, text.replace(from, &to)).unwrap();
    let note = told(&path);
    std::fs::remove_file(&path).unwrap();
    let note = note.expect("some seeds draw a smaller polyp");
    let (_, seeds) = note.split_once("it is refused with ").unwrap();
    let (seeds, why) = seeds.split_once("; ").unwrap();
    let seeds: Vec<u32> = seeds.split(", ").map(|seed| seed.parse().unwrap()).collect();
    let smaller: Vec<u32> = (1..=12).filter(|seed| settled("polyp", Some(*seed)).brief.pathology_ml < asked_ml).collect();
    assert_eq!(seeds, smaller);
    assert!(!seeds.contains(&1) && why.contains("goal[1].biopsy.at_least_ml"), "{note}");
}
