//! Meshes that nobody here made: those of a folder that `HYSTATION_MESHES` names, which lies outside of the project, for its files have licences of their own.
//! Each is refused with one line, or repaired, run as the organ of a scene with the tool pressed into it, and cut. Without the variable none of them is tried,
//! and that is said; what is always tried are those of [`made`].

mod made;

use super::knife;
use super::press::{Press, Record};
use glam::Vec3;
use hyst_mesh::{TetMesh, check, read_tets, repair};
use hyst_scene::{LoadedHand, LoadedScene, Pose};
use hyst_tissue::{Isa, Material, Model, Options, Scratch, StateMut, StateRef, StepInput, step};
use std::io::Write;
use std::path::PathBuf;

/// The folder with the meshes.
const MESHES: &str = "HYSTATION_MESHES";
/// The file in which `./station test` collects what was not shown.
const NOT_SHOWN: &str = "HYSTATION_NOT_SHOWN";
/// Largest extent that each organ is given, m.
const EXTENT_M: f32 = 0.06;
/// Steps of a press, there and back.
const STEPS: usize = 300;
/// Where the tool comes from and how deep it goes where the scene has found no hand that presses, from the nearest vertex on, m.
const FROM_M: f32 = -0.003;
const INTO_M: f32 = 0.002;
/// No node goes farther than so many times the way that the tip makes from where it meets the organ: with it, and as far again what swings on. No point of
/// the instrument makes a longer way than its tip, for they turn about the pivot.
const FARTHEST: f32 = 2.0;
/// And by how far parts that lie in each other at rest come apart, m: as deep as they push each other.
const APART_M: f32 = 0.003;
/// The tissue stores no more than the hand has done. That is summed here from the force after each step, when contacts have given way already, and so comes
/// out too small: by little where most is stored, by more when the tip has only just met the organ.
const STORED: f64 = 1.5;
const STORED_AT_FIRST: f64 = 3.0;
/// No sweep changes the volume by a larger share, beside what it burns: as the tests of the cuts have it (`shared/tissue/tests/common/cuts.rs`).
const ASTRAY: f64 = 2e-6;

/// A folder with meshes, in which scenes are written beside them; of those that somebody named a copy.
struct Copied(PathBuf);

impl Copied {
    /// An empty one for a test.
    fn empty(test: &str) -> Copied {
        let to = std::env::temp_dir().join(format!("hyst-tissue-{}-{}", std::process::id(), test.replace(' ', "-")));
        std::fs::create_dir_all(&to).unwrap();
        Copied(to)
    }
}

impl Drop for Copied {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The copy, and the names of the files in it that may be meshes, in their order; `None` if no folder is named.
fn meshes(test: &str) -> Option<(Copied, Vec<String>)> {
    let Some(from) = std::env::var_os(MESHES).map(PathBuf::from) else {
        let what = format!("whether {test}: {MESHES} names no folder of meshes, and nothing was tried");
        println!("NOT SHOWN: {what}");
        if let Some(path) = std::env::var_os(NOT_SHOWN) {
            let file = std::fs::File::options().append(true).create(true).open(path);
            let _ = file.and_then(|mut file| writeln!(file, "{what}")); // it was printed
        }
        return None;
    };
    let copied = Copied::empty(test);
    let mut names = Vec::new();
    for entry in std::fs::read_dir(&from).unwrap_or_else(|error| panic!("{MESHES}={}: {error}", from.display())) {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_file() {
            std::fs::write(copied.0.join(&name), std::fs::read(&path).unwrap()).unwrap();
            names.push(name);
        }
    }
    let is_mesh = |name: &String| {
        let extension = name.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
        ["msh", "vtk", "vtu", "mesh", "node", "obj"].contains(&extension.as_str())
    };
    names.retain(is_mesh);
    names.sort();
    assert!(!names.is_empty(), "{MESHES}={}: no mesh is in it", from.display());
    Some((copied, names))
}

/// What brings a mesh to the extent that is wanted, as a line of its scene; none where its file alone is no mesh of tets.
fn scale(name: &str, bytes: &[u8]) -> String {
    let Ok(mesh) = read_tets(name, bytes) else { return String::new() };
    let found = check(&mesh);
    let extent = (0..3).map(|axis| found.max_m[axis] - found.min_m[axis]).fold(0.0, f32::max);
    format!("scale_to_m = {:.9}\n", EXTENT_M / extent)
}

/// The scene with a mesh as its organ; or why there is none.
fn scene(copied: &Copied, name: &str) -> Result<LoadedScene, String> {
    let bytes = std::fs::read(copied.0.join(name)).map_err(|error| error.to_string())?;
    scene_of(copied, name, &format!("place = \"auto\"\n{}", scale(name, &bytes)))
}

/// The same with more lines about the organ.
fn scene_of(copied: &Copied, name: &str, more: &str) -> Result<LoadedScene, String> {
    let text = format!(
        "version = 1\nname = \"x\"\n[[deformable]]\nname = \"organ\"\nmesh = {name:?}\n{more}[[rigid]]\nname = \"scope\"\n"
    );
    let path = copied.0.join("scene.toml");
    std::fs::write(&path, text).unwrap();
    hyst_scene::load(&path).map_err(|error| error.to_string())
}

/// A hand that goes to the vertex that is nearest to the pivot, and on from there.
fn towards_nearest(scene: &LoadedScene) -> Option<LoadedHand> {
    let pivot_m = scene.workspace.pivot_m;
    let away_m = |place: &[f32; 3]| Vec3::from(*place).distance(Vec3::from(pivot_m));
    let nearest = scene.objects.first()?.surface.positions_m.iter().min_by(|a, b| away_m(a).total_cmp(&away_m(b)))?;
    let at = Pose::aim(pivot_m, *nearest)?;
    let way = [FROM_M, INTO_M].map(|way_m| Pose { insertion_m: at.insertion_m + way_m, ..at }).to_vec();
    Some(LoadedHand { name: "press".to_owned(), way, ..LoadedHand::default() })
}

/// What a press has come to.
#[derive(Default)]
struct Pressed {
    /// In words.
    said: String,
    /// How far the tip went from where it met the organ, and a node from its place, at most, m.
    deep_m: f32,
    most_m: f32,
}

/// Presses the tool in and takes it back; what was seen, or why the model is refused.
fn pressed(mut scene: LoadedScene) -> Result<Pressed, String> {
    let found = scene.hand("press").cloned();
    let is_found = found.is_some();
    let Some(hand) = found.or_else(|| towards_nearest(&scene)) else {
        return Ok(Pressed { said: "nothing to press".to_owned(), ..Pressed::default() });
    };
    let hand = LoadedHand { period_s: 1e-3 * STEPS as f64, ..hand };
    let tip = |tick: usize| Vec3::from(hand.pose_at(1e-3 * tick as f64).tip_m(scene.workspace.pivot_m));
    let tips: Vec<Vec3> = (0..=STEPS).map(tip).collect();
    scene.hands = vec![hand];
    let mut press = Press::new(&scene, Isa::detect(), 1)?;
    let (mut record, mut work_j) = (Record::default(), 1e-6);
    let (mut most_n, mut most_m, mut most_j, mut done_j) = (0.0f32, 0.0f32, 0.0f64, work_j);
    let (mut met_at, mut deep_m) = (None, 0.0f32);
    for tick in 0..=STEPS {
        press.tick(tick, &mut record).unwrap_or_else(|error| panic!("tick {tick}: {error}"));
        let (force_n, way_m) = (Vec3::from(record.force_n), tips[tick].distance(tips[tick.saturating_sub(1)]));
        let now_m = press.positions_m();
        assert!(force_n.is_finite() && now_m.as_flattened().iter().all(|coordinate| coordinate.is_finite()), "tick {tick}");
        let moved_m = now_m.iter().zip(press.rest_m()).map(|(now, rest)| Vec3::from(*now).distance(Vec3::from(*rest)));
        most_m = moved_m.fold(most_m, f32::max);
        most_n = most_n.max(force_n.length());
        work_j += f64::from(force_n.length() * way_m);
        if record.contacts > 0 {
            // It met it in the way to this tick.
            let met_m = *met_at.get_or_insert(tips[tick.saturating_sub(1)]);
            deep_m = deep_m.max(met_m.distance(tips[tick]));
        }
        if record.energy_j > most_j {
            (most_j, done_j) = (record.energy_j, work_j);
        }
        let stored_j = record.energy_j;
        assert!(stored_j <= STORED_AT_FIRST * work_j, "tick {tick}: {stored_j} J in the tissue, the hand did {work_j} J");
    }
    let far_m = FARTHEST * deep_m + APART_M;
    println!("a node went {most_m} m of {far_m} m, {most_j} J of {done_j} J were stored");
    assert!(most_m < far_m, "a node went {most_m} m, the tip {deep_m} m from where it met the organ");
    assert!(most_j <= STORED * done_j, "{most_j} J in the tissue, the hand did {done_j} J");
    assert!(record.contacts > 0 || !is_found, "a hand that is meant to press has touched nothing");
    let said = format!(
        "pressed ({}): {} contacts, {most_n:.2} N, {:.2} mm, {:.1} mJ at most and {:.1} mJ at the end",
        if is_found { "the scene's hand" } else { "to the nearest vertex" },
        record.contacts,
        1e3 * most_m,
        1e3 * most_j,
        1e3 * record.energy_j
    );
    Ok(Pressed { said, deep_m, most_m })
}

/// Cuts the organ of a scene in two; says what became of it.
fn cut_in_two(name: &str, scene: &LoadedScene) -> String {
    let knife = knife::draw(scene, Isa::detect()).unwrap_or_else(|error| panic!("{name}: cut: {error}"));
    let ([tets, tets_after], [parts, parts_after], cuts) = (knife.tets, knife.parts, knife.model_ns.len());
    let said = format!("cut in {cuts} ticks: {tets} tets became {tets_after}, {parts} parts {parts_after}");
    assert!(tets_after > 0 && parts_after > parts && cuts > 0, "{name}: the wire has not cut it in two: {said}");
    assert!(knife.astray <= ASTRAY, "{name}: a sweep has changed the volume by {} of it", knife.astray);
    said
}

#[test]
fn each_mesh_is_refused_with_one_line_or_is_pressed_and_cut() {
    let Some((copied, names)) = meshes("meshes that nobody here made are pressed and cut") else { return };
    for name in names {
        let tried = scene(&copied, &name).and_then(|scene| {
            let pressed = pressed(scene.clone())?;
            Ok((scene, pressed.said))
        });
        match tried {
            Ok((scene, said)) => {
                println!("{name}: {}\n    {said}", scene.notes.join("; "));
                println!("    {}", cut_in_two(&name, &scene));
            }
            Err(why) => {
                println!("{name}: refused: {why}");
                assert!(!why.is_empty() && why.lines().count() == 1, "{name} is not refused with one line: {why:?}");
            }
        }
    }
}

/// Sides of the bars in the files' unit: length, width, height; and what the length is made, m.
const BAR: [f64; 3] = [10.0, 0.5, 1.0];
const BAR_M: f64 = 0.06;

/// Timoshenko's deflection of a bar of these sides under a load at its tip along its height, m.
fn timoshenko_m(load_n: f64, [length_m, width_m, height_m]: [f64; 3], young_pa: f64, nu: f64) -> f64 {
    let (area_m2, inertia_m4) = (width_m * height_m, width_m * height_m.powi(3) / 12.0);
    let (shear_pa, share) = (young_pa / (2.0 * (1.0 + nu)), 10.0 * (1.0 + nu) / (12.0 + 11.0 * nu));
    load_n * length_m.powi(3) / (3.0 * young_pa * inertia_m4) + load_n * length_m / (share * area_m2 * shear_pa)
}

/// How far a bar that is held at x = 0 bends at its other end, over what theory says, less 1.
fn beside_theory(mesh: &TetMesh) -> f64 {
    let (young_pa, nu, load_n) = (100_000.0, 0.3, 7.5e-5);
    // The first mode of theory has 17/s: what is damped twice as fast is at rest soon.
    let material = Material::new(young_pa, nu, 1000.0, 34.0).unwrap();
    let fixed: Vec<bool> = mesh.positions_m.iter().map(|place| place[0] < 1e-6).collect();
    let options = Options { max_substeps: 250, ..Options::default() };
    let (model, _) = Model::new(mesh, &fixed, &material, options).unwrap();
    let tip: Vec<usize> = (0..fixed.len()).filter(|node| mesh.positions_m[*node][0] > BAR_M as f32 - 1e-6).collect();
    let mut force_n = vec![[0.0; 3]; fixed.len()];
    tip.iter().for_each(|node| force_n[*node][2] = (load_n / tip.len() as f64) as f32);
    let (mut scratch, still) = (Scratch::new(&model), vec![[0.0; 3]; fixed.len()]);
    let (mut now_m, mut now_m_s, mut next_m, mut next_m_s) = (mesh.positions_m.clone(), still.clone(), still.clone(), still);
    for _ in 0..800 {
        let input = StepInput { external_force_n: &force_n, ..StepInput::default() };
        let to = StateMut { position_m: &mut next_m, velocity_m_s: &mut next_m_s };
        step(&model, &mut scratch, StateRef { position_m: &now_m, velocity_m_s: &now_m_s }, &input, to).unwrap();
        std::mem::swap(&mut now_m, &mut next_m);
        std::mem::swap(&mut now_m_s, &mut next_m_s);
    }
    let bent_m = tip.iter().map(|node| f64::from(now_m[*node][2] - mesh.positions_m[*node][2])).sum::<f64>() / tip.len() as f64;
    bent_m / timoshenko_m(load_n, BAR.map(|side| side * BAR_M / BAR[0]), young_pa, nu) - 1.0
}

/// Linear tets are too stiff, with one of them across the height several times, and ever less the finer they are.
#[test]
fn a_series_of_bars_that_nobody_here_made_converges_to_beam_theory() {
    let Some((copied, names)) = meshes("bars that nobody here made converge to beam theory") else { return };
    let mut bars = Vec::new();
    for name in names.iter().filter(|name| name.starts_with("bar-")) {
        let mesh = read_tets(name, &std::fs::read(copied.0.join(name)).unwrap()).unwrap();
        let mut mesh = repair(mesh).unwrap().mesh;
        mesh.scale_to_m((BAR_M / BAR[0]) as f32);
        bars.push(mesh);
    }
    if bars.len() < 3 {
        return println!("NOT SHOWN: the folder has {} meshes of a bar: no series", bars.len());
    }
    bars.sort_by_key(|mesh| mesh.tets.len());
    let errors: Vec<(usize, f64)> = bars.iter().map(|mesh| (mesh.tets.len(), beside_theory(mesh))).collect();
    println!("bars: {errors:.4?}");
    assert!(errors.windows(2).all(|pair| pair[0].1 < pair[1].1) && errors.iter().all(|error| error.1 < 0.01), "{errors:?}");
    assert!(errors.last().is_some_and(|finest| finest.1 > -0.25), "{errors:?}");
}
