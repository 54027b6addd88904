//! Seeds of the shipped cases that draw the mirror image of their scene: it is that image, with its hands and its places, and the first seed is none.
#![allow(missing_docs)]

use hyst_scene::{Aim, LoadedScene, Pose, Region, SettledCase, find_case};
use std::path::Path;

/// The cases with a side, and with a seed that mirrors them about the planes of x and y.
const MIRRORED: [(&str, u32, [f32; 2]); 13] = [
    ("access", 4, [-1.0, 1.0]),
    ("biopsy", 4, [-1.0, 1.0]),
    ("bleeding", 4, [-1.0, 1.0]),
    ("distension", 4, [-1.0, 1.0]),
    ("fluid-overload", 4, [-1.0, 1.0]),
    ("myoma", 3, [1.0, -1.0]),
    ("myoma", 4, [-1.0, 1.0]),
    ("myoma", 7, [-1.0, -1.0]),
    ("navigation", 4, [-1.0, 1.0]),
    ("perforation", 4, [-1.0, 1.0]),
    ("polyp", 4, [-1.0, 1.0]),
    ("polyp", 7, [-1.0, 1.0]),
    ("retrieval", 4, [-1.0, 1.0]),
];

fn settled(name: &str, seed: u32) -> SettledCase {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../assets/cases/{name}.toml"));
    find_case(&path, Some(seed)).unwrap_or_else(|error| panic!("{error}")).unwrap()
}

/// What the same case draws from the same seed where nothing is mirrored.
fn never_mirrored(name: &str, seed: u32, of: &str) -> SettledCase {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let text = std::fs::read_to_string(assets.join(format!("cases/{name}.toml"))).unwrap();
    let (mirrors, others): (Vec<&str>, Vec<&str>) = text.lines().partition(|line| line.starts_with("mirror = "));
    assert_eq!(mirrors.len(), 1, "{name}: {mirrors:?}");
    // A table that only mirrors would vary nothing.
    let without = others.join("\n").replace("[[vary]]\n\n", "");
    let path = std::env::temp_dir().join(format!("hyst-{}-{of}-{name}-{seed}.toml", std::process::id()));
    std::fs::write(&path, without.replace("../scenes", &assets.join("scenes").display().to_string())).unwrap();
    let found = find_case(&path, Some(seed));
    std::fs::remove_file(&path).unwrap();
    found.unwrap_or_else(|error| panic!("{error}")).unwrap()
}

fn assert_near(is: [f64; 3], should: [f64; 3], who: &str) {
    assert!(is.iter().zip(should).all(|(is, should)| (is - should).abs() < 1e-6), "{who}: {is:?} is not {should:?}");
}

fn wide(point: [f32; 3]) -> [f64; 3] {
    point.map(f64::from)
}

/// Hands are written, and tasks put in words, for the first seed.
#[test]
fn the_first_seed_draws_what_it_drew_before_anything_was_mirrored() {
    for (name, ..) in MIRRORED.iter().filter(|(name, seed, _)| (*name, *seed) != ("myoma", 3) && *seed != 7) {
        let [with, without] = [settled(name, 1), never_mirrored(name, 1, "first")];
        assert_eq!((with.scene.hash, &with.brief), (without.scene.hash, &without.brief), "{name}");
        assert!(!with.brief.drawn.iter().any(|drawn| drawn.starts_with("mirrored")), "{name}");
    }
}

#[test]
fn a_mirrored_seed_draws_the_image_of_what_it_draws_otherwise_to_the_bit_and_says_so() {
    for (name, seed, signs) in MIRRORED {
        let [with, without] = [settled(name, seed), never_mirrored(name, seed, "image")];
        let who = format!("{name}, seed {seed}");
        assert_ne!(with.scene.hash, without.scene.hash, "{who}");
        let said = with.brief.drawn.iter().filter(|drawn| drawn.starts_with("mirrored")).count();
        assert_eq!(said, signs.iter().filter(|sign| **sign < 0.0).count(), "{who}: {:?}", with.brief.drawn);
        let image = |[x, y, z]: [f32; 3]| [signs[0] * x, signs[1] * y, z];
        for (now, before) in with.scene.objects.iter().zip(&without.scene.objects) {
            let mirrored = |points: &[[f32; 3]]| points.iter().copied().map(image).collect::<Vec<_>>();
            assert_eq!(now.mesh.positions_m, mirrored(&before.mesh.positions_m), "{who}: {}", now.name);
            assert_eq!(now.surface.positions_m, mirrored(&before.surface.positions_m), "{who}: {}", now.name);
            let (found, was) = (hyst_mesh::check(&now.mesh), hyst_mesh::check(&before.mesh));
            assert!(found.inverted.is_empty() && (found.volume_m3 / was.volume_m3 - 1.0).abs() < 1e-9, "{who}: {}", now.name);
            let rooted = |object: &hyst_scene::LoadedDeformable| object.attach.as_ref().map_or(0, |attach| attach.nodes.len());
            // A node that lies on a face of its host, up to rounding, may come to lie beside it.
            assert!(rooted(now).abs_diff(rooted(before)) <= 2, "{who}: {} rooted, {}", rooted(now), rooted(before));
        }
        let middles = with.brief.pathologies_m.iter().zip(&without.brief.pathologies_m);
        let wide_image = |[x, y, z]: [f64; 3]| [f64::from(signs[0]) * x, f64::from(signs[1]) * y, z];
        middles.for_each(|(now, before)| assert_near(*now, wide_image(*before), &who));
        assert_hands(&with.scene, &without.scene, signs, &who);
        assert_places(&with, &without, signs, &who);
    }
}

/// The hands of the files, not those that are found from the geometry anew.
fn assert_hands(with: &LoadedScene, without: &LoadedScene, signs: [f32; 2], who: &str) {
    for (name, _) in with.scene.hand.iter().filter(|(_, hand)| hand.like.is_none()) {
        let (now, before) = (with.hand(name).unwrap(), without.hand(name).unwrap());
        assert_eq!((now.legs.len(), now.target, now.is_once), (before.legs.len(), before.target, before.is_once), "{who} {name}");
        for (leg, was) in now.legs.iter().zip(&before.legs) {
            assert_eq!((leg.time_s, leg.is_extended, leg.is_energized), (was.time_s, was.is_extended, was.is_energized));
            // Tip and middle of the loop, in the plane of the instrument in which it is its own image.
            for point_m in [[0.0; 3], [0.0, 0.0022, 0.012]] {
                let place = |pose: &Pose| pose.place([0.0; 3], point_m);
                let [x, y, z] = place(&was.to);
                assert_near(wide(place(&leg.to)), wide([signs[0] * x, signs[1] * y, z]), &format!("{who} {name}"));
            }
        }
    }
}

fn assert_places(with: &SettledCase, without: &SettledCase, signs: [f32; 2], who: &str) {
    let balls = |case: &SettledCase| -> Vec<[f64; 3]> {
        let mut all = Vec::new();
        for goal in &case.brief.goals {
            match &goal.is {
                Aim::Visit { places, .. } => all.extend(places.iter().filter_map(|place| match place.is {
                    Region::Ball(centre_m, _) => Some(centre_m),
                    Region::Insertion(_) => None,
                })),
                Aim::Look { landmarks, .. } => all.extend(landmarks.iter().map(|landmark| landmark.is)),
                _ => {}
            }
        }
        all
    };
    let (now, before) = (balls(with), balls(without));
    assert_eq!(now.len(), before.len(), "{who}");
    for (now, [x, y, z]) in now.into_iter().zip(before) {
        assert_near(now, [f64::from(signs[0]) * x, f64::from(signs[1]) * y, z], who);
    }
}

/// Of eleven seeds seven have the polyp on the patient's left; the hand that is found goes there.
#[test]
fn the_polyp_hangs_on_either_side_and_the_hand_that_is_found_goes_where_it_hangs() {
    let (mut left, mut cut) = (0, 0);
    for seed in 0..=10 {
        let case = settled("polyp", seed);
        let [x_m, ..] = case.brief.pathologies_m[0];
        let is_mirrored = case.brief.drawn.iter().any(|drawn| drawn.starts_with("mirrored"));
        assert_eq!(x_m < 0.0, is_mirrored, "seed {seed}: {x_m} m");
        left += u32::from(is_mirrored);
        // Of some seeds there is no room to draw the loop along it.
        let hand = case.scene.hand("polyp");
        let Some(leg) = hand.and_then(|hand| hand.legs.iter().find(|leg| leg.is_energized)) else { continue };
        let ring_m = leg.to.place([0.0; 3], [0.0, 0.0022, 0.012]);
        assert!(f64::from(ring_m[0]) * x_m > 0.0, "seed {seed}: the loop is at {ring_m:?}, the polyp at {x_m} m");
        cut += 1;
    }
    assert_eq!(left, 7);
    assert!(cut >= 6, "{cut} of 11");
}
