//! The scripted hand `polyp` resects: what its loop sweeps while there is current in it parts a chip from the pathology, and leaves all else as it was.
//! The hand is the one that holds the device; the tissue is held at rest.

use hyst_coupling::{BUTTON_ENERGIZED, DofLimits, HandModel, HandState, Leg, Pose4, hand_along, hand_dynamics};
use hyst_mesh::{TetMesh, component_count, component_of_each_tet, signed_volume};
use hyst_scene::{HandLeg, LoadedHand, LoadedScene, Pose, find_case, load};
use hyst_tissue::{CutOptions, Cuttable, cut, join};
use std::path::{Path, PathBuf};

/// From one cut to the next, ms: as often as a state is made, and less often.
const EVERY_MS: [u32; 2] = [20, 1];
/// How far the tissue may lie beside its place, m: a fifth of what the ring bites.
const BESIDE_M: f32 = 0.000_3;

/// Each object of a scene, all in one tissue as the Main Loop has them; its region is its index.
fn cuttable(scene: &LoadedScene) -> Cuttable {
    let meshes: Vec<&TetMesh> = scene.objects.iter().map(|object| &object.mesh).collect();
    let (mut mesh, _) = join(&meshes).unwrap();
    let region = |(index, mesh): (usize, &&TetMesh)| std::iter::repeat_n(index as u32, mesh.tets.len());
    mesh.regions = meshes.iter().enumerate().flat_map(region).collect();
    let fixed = scene.objects.iter().flat_map(|object| object.fixed.iter().copied()).collect();
    Cuttable { fixed, ..Cuttable::at_rest(mesh) }
}

/// Object, volume in mm³ and number of tets of each part that hangs together.
fn parts(tissue: &Cuttable) -> Vec<(u32, f64, usize)> {
    let part = component_of_each_tet(&tissue.rest);
    let mut parts = vec![(0, 0.0, 0); component_count(&part)];
    for ((tet, region), part) in tissue.rest.tets.iter().zip(&tissue.rest.regions).zip(part) {
        let corners = tet.map(|node| glam::DVec3::from_array(tissue.rest.positions_m[node as usize].map(f64::from)));
        let (object, volume_mm3, tets) = &mut parts[part as usize];
        (*object, *tets) = (*region, *tets + 1);
        *volume_mm3 += 1e9 * signed_volume(corners);
    }
    parts
}

fn pose4(pose: &Pose) -> Pose4 {
    Pose4 { pitch_rad: pose.pitch_rad, yaw_rad: pose.yaw_rad, roll_rad: pose.roll_rad, insertion_m: pose.insertion_m }
}

fn leg(leg: &HandLeg) -> Leg {
    let buttons = if leg.is_energized { BUTTON_ENERGIZED } else { 0 };
    Leg { to: pose4(&leg.to), time_s: leg.time_s, buttons, is_rinsing: leg.is_rinsing }
}

/// One round of the hand; gives the volume that was burnt, mm³.
fn resect(scene: &LoadedScene, hand: &LoadedHand, tissue: &mut Cuttable, every_ms: u32) -> f64 {
    let electrode = scene.rigid[0].electrode.as_ref().unwrap();
    let legs: Vec<Leg> = hand.legs.iter().map(leg).collect();
    let insertion_m = scene.workspace.insertion_m;
    let limits =
        DofLimits { min_insertion_m: insertion_m[0].max(0.001), max_insertion_m: insertion_m[1], ..DofLimits::default() };
    let model = HandModel { pivot_m: scene.workspace.pivot_m, limits, ..HandModel::default() };
    let mut state = HandState::at_rest(&model, &hand_along(&legs, 0.0).pose);
    let mut burnt_mm3 = 0.0;
    for ms in 0..(hand.period_s * 1e3) as u32 {
        let wanted = hand_along(&legs, f64::from(ms) * 1e-3);
        state = hand_dynamics(&model, &state, &wanted.pose, [0.0; 3], 1e-3);
        if ms % every_ms != 0 {
            continue;
        }
        if wanted.buttons & BUTTON_ENERGIZED == 0 {
            tissue.end_stroke();
            continue;
        }
        let (tip, turn) = (glam::Vec3::from(state.tip_m), glam::Quat::from_array(state.orientation));
        let wire: Vec<[f32; 3]> =
            electrode.wire_at(electrode.reach_m).map(|point| (tip + turn * glam::Vec3::from(point)).to_array()).collect();
        let report = cut(tissue, &wire, &CutOptions::default()).unwrap();
        burnt_mm3 += 1e9 * report.burnt_m3;
    }
    burnt_mm3
}

fn scenes() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes");
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| !path.ends_with("grasper.toml")); // nothing cuts there
    paths.sort();
    paths
}

/// Volumes of the parts of an object, the least first, mm³.
fn volumes_mm3(parts: &[(u32, f64, usize)], object: u32) -> Vec<f64> {
    let mut volumes: Vec<f64> = parts.iter().filter(|part| part.0 == object).map(|part| part.1).collect();
    volumes.sort_by(f64::total_cmp);
    volumes
}

#[test]
fn a_round_of_the_hand_parts_a_chip_from_the_pathology_and_leaves_all_else_as_it_was() {
    for (path, every_ms) in scenes().iter().flat_map(|path| EVERY_MS.map(|every_ms| (path, every_ms))) {
        let scene = load(path).unwrap();
        let what = format!("{}, every {every_ms} ms", path.file_stem().unwrap().to_string_lossy());
        let hand = scene.hand("polyp").unwrap();
        let target = hand.target.unwrap() as u32;
        let mut tissue = cuttable(&scene);
        let before = parts(&tissue);
        assert_eq!(before.len(), scene.objects.len(), "{what}: each object is one part");
        let burnt_mm3 = resect(&scene, hand, &mut tissue, every_ms);
        let after = parts(&tissue);
        println!("{what}: {before:.2?} became {after:.2?}, {burnt_mm3:.2} mm³ burnt");
        let of_others = |parts: &[(u32, f64, usize)]| parts.iter().copied().filter(|part| part.0 != target).collect::<Vec<_>>();
        assert_eq!(of_others(&before), of_others(&after), "{what}: only the pathology is cut");
        let mut volumes_mm3 = volumes_mm3(&after, target);
        let stays_mm3 = volumes_mm3.pop().unwrap();
        let chips_mm3: f64 = volumes_mm3.iter().sum();
        assert!(chips_mm3 > 1.0, "{what}: chips of {volumes_mm3:?} mm³ from {stays_mm3} mm³");
        assert!(chips_mm3 < 0.1 * stays_mm3 && burnt_mm3 < 1.0, "{what}: {volumes_mm3:?} of {stays_mm3} mm³, {burnt_mm3} burnt");
    }
}

#[test]
fn a_chip_comes_off_also_where_the_tissue_is_a_little_beside_its_place() {
    // A septum is no piece that hangs free: its case's own hand takes it down by many slices, and a slice of it may hold beside its place.
    for path in scenes().into_iter().filter(|path| !path.ends_with("septum.toml")) {
        let scene = load(&path).unwrap();
        let hand = scene.hand("polyp").unwrap();
        for axis in 0..3 {
            for shift_m in [-BESIDE_M, BESIDE_M] {
                let mut tissue = cuttable(&scene);
                tissue.position_m.iter_mut().for_each(|point| point[axis] += shift_m);
                resect(&scene, hand, &mut tissue, EVERY_MS[0]);
                let volumes_mm3 = volumes_mm3(&parts(&tissue), hand.target.unwrap() as u32);
                assert!(
                    volumes_mm3.len() > 1 && volumes_mm3[0] > 1.0,
                    "{}, {shift_m} m on axis {axis}: {volumes_mm3:?}",
                    path.display()
                );
            }
        }
    }
}

#[test]
fn half_of_the_myoma_is_sliced_off_layer_by_layer() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/cases/myoma.toml");
    let scene = find_case(&path, None).unwrap().expect("it is a case").scene;
    let hand = scene.hand("slices").unwrap();
    let target = hand.target.unwrap() as u32;
    let mut tissue = cuttable(&scene);
    let whole_mm3: f64 = volumes_mm3(&parts(&tissue), target).iter().sum();
    let burnt_mm3 = resect(&scene, hand, &mut tissue, EVERY_MS[0]);
    let volumes_mm3 = volumes_mm3(&parts(&tissue), target);
    let stays_mm3 = volumes_mm3.last().unwrap();
    println!("{} chips of {whole_mm3:.0} mm³ leave {stays_mm3:.0} mm³, {burnt_mm3:.1} mm³ burnt", volumes_mm3.len() - 1);
    assert!(*stays_mm3 < 0.5 * whole_mm3, "{stays_mm3} of {whole_mm3} mm³ hang together");
}
