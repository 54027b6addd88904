//! What the real-time settings cost in truth: the force that the hand feels (all that acts on the tool, and what the planes for the servo tell of it) and the
//! displacement of the tissue, beside the solution that is converged in time on the same mesh, whole or cut, with the same tool in the same places. There steps are shorter, and with them the contacts are looked for more
//! often, and nowhere is mass added. And what the contact gives way by itself, which both have alike: beside the same short steps with a contact many times
//! as stiff.

use super::press::{Press, Record};
use crate::world::Otherwise;
use hyst_scene::LoadedScene;
use hyst_tissue::Isa;

/// Ticks between two looks at the displacement.
const LOOK: usize = 20;

/// How far two solutions are apart, as shares of the largest figure of the converged one; no numbers where the hand meets nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Apart {
    /// Of the force on the tool.
    pub force: f64,
    /// Of the force that the hand is told, at the tip.
    pub told: f64,
    /// Of the displacement of a node.
    pub displacement: f64,
    /// Largest force, N.
    pub most_n: f64,
    /// Largest force that the hand is told, N.
    pub most_told_n: f64,
    /// Largest displacement, m.
    pub most_m: f64,
}

/// How far two places, or forces, are apart.
pub fn distance(a: [f32; 3], b: [f32; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt()
}

/// The same of the two of some places that are farthest apart.
pub fn farthest(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    a.iter().zip(b).map(|(a, b)| distance(*a, *b)).fold(0.0, f64::max)
}

/// So many ticks of the scene's hand with the settings of the station, and `finer` times as fine.
pub fn apart(scene: &LoadedScene, finer: [u32; 2], ticks: usize) -> Result<Apart, String> {
    between(scene, finer.map(|finer| Otherwise { finer, ..Otherwise::default() }), ticks)
}

/// The same, both `finer` times as fine, with the contacts of the station, and with such as are `stiffer` times as stiff.
pub fn softness(scene: &LoadedScene, finer: u32, stiffer: f32, ticks: usize) -> Result<Apart, String> {
    between(scene, [1.0, stiffer].map(|stiffer| Otherwise { finer, stiffer, ..Otherwise::default() }), ticks)
}

/// How far the first of two runs is from the second.
fn between(scene: &LoadedScene, otherwise: [Otherwise; 2], ticks: usize) -> Result<Apart, String> {
    let [first, second] = otherwise.map(|otherwise| Press::with(scene, Isa::detect(), 1, otherwise));
    pressed([first?, second?], ticks)
}

/// The same of two that are at rest.
fn pressed(press: [Press; 2], ticks: usize) -> Result<Apart, String> {
    pressed_beside(press, ticks, |_, _| ())
}

/// The same with something else after each tick.
fn pressed_beside(press: [Press; 2], ticks: usize, mut each: impl FnMut(usize, &[(Press, Record); 2])) -> Result<Apart, String> {
    let mut press = press.map(|press| (press, Record::default()));
    let mut apart = Apart::default();
    for tick in 0..ticks {
        for (press, record) in &mut press {
            press.tick(tick, record)?;
        }
        each(tick, &press);
        let [(coarse, felt), (fine, right)] = &press;
        apart.told = apart.told.max(distance(felt.told_n, right.told_n));
        apart.most_told_n = apart.most_told_n.max(distance(right.told_n, [0.0; 3]));
        // The tissue of a longer step is where the tool's place at its beginning brings it.
        if !(coarse.has_step(tick) && fine.has_step(tick)) {
            continue;
        }
        apart.force = apart.force.max(distance(felt.force_n, right.force_n));
        apart.most_n = apart.most_n.max(distance(right.force_n, [0.0; 3]));
        if tick % LOOK == 0 {
            let (coarse_m, fine_m) = (coarse.positions_m(), fine.positions_m());
            apart.displacement = apart.displacement.max(farthest(&coarse_m, &fine_m));
            apart.most_m = apart.most_m.max(farthest(&fine_m, fine.rest_m()));
        }
    }
    // Of a hand that meets nothing nothing is shown.
    let is_met = apart.most_n > 0.0 && apart.most_m > 0.0;
    let [most_n, most_told_n, most_m] = if is_met { [apart.most_n, apart.most_told_n, apart.most_m] } else { [f64::NAN; 3] };
    apart.force /= most_n;
    apart.told /= most_told_n;
    apart.displacement /= most_m;
    Ok(apart)
}

#[cfg(test)]
mod tests {
    mod told;

    use super::*;
    use crate::bench;
    use crate::body::Body;
    use crate::knife::tests::drawn;
    use crate::world::Workshop;
    use glam::Vec3;
    use hyst_mesh::check;
    use hyst_scene::DeformableKind;
    use serde_json::{Value, json};
    use std::path::Path;

    /// What is allowed, as a share of the largest figure of the converged solution.
    const MOST: f64 = 0.05;
    /// Ticks of the hand, and what it has pressed with by then, N, at the least.
    const TICKS: usize = 1_000;
    const LEAST_N: f64 = 1.0;

    /// Ticks between two looks at what a servo makes of the planes.
    const SERVED: usize = 100;

    /// Two that are pressed alike, while a servo makes of the planes what they say.
    fn compared(what: &str, press: [Press; 2]) -> Apart {
        let look = |tick: usize, runs: &[(Press, Record); 2]| {
            if (tick + 1).is_multiple_of(SERVED) {
                runs.iter().for_each(|run| told::assert_felt(what, tick, run));
            }
        };
        pressed_beside(press, TICKS, look).unwrap()
    }

    fn assert_near(name: &str, finer: u32) -> Apart {
        assert_pressed(name, finer, LEAST_N)
    }

    fn assert_pressed(name: &str, finer: u32, least_n: f64) -> Apart {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/scenes").join(format!("{name}.toml"));
        let scene = hyst_scene::load(&path).unwrap();
        let press = |finer: u32| Press::with(&scene, Isa::detect(), 1, Otherwise { finer, ..Otherwise::default() });
        let apart = compared(name, [press(1).unwrap(), press(finer).unwrap()]);
        println!("{name}, beside {finer} times as fine: {apart:?}");
        assert!(apart.most_n > least_n && apart.most_m > 1e-3, "{name}: the hand hardly touches: {apart:?}");
        assert_apart(name, &apart);
        apart
    }

    /// What the hand is told is that of the planes, without friction and damping, and felt at the tip, near which the wall is met: most of what acts.
    fn assert_apart(what: &str, apart: &Apart) {
        assert!(apart.force < MOST && apart.displacement < MOST && apart.told < MOST, "{what}: {apart:?}");
        assert!(apart.force > 0.0 && apart.told > 0.0, "{what}: the two are one");
        assert!(apart.most_told_n > 0.5 * apart.most_n, "{what}: {apart:?}");
    }

    #[test]
    fn force_and_displacement_of_the_default_scene_are_near_the_converged_ones_and_so_is_what_the_hand_is_told() {
        assert_near("default", 8);
    }

    #[test]
    fn those_of_the_myoma_are() {
        assert_near("myoma", 8);
    }

    #[test]
    fn those_of_the_medium_polyp_are() {
        assert_near("polyp-medium", 8);
    }

    #[test]
    fn those_of_three_polyps_are() {
        assert_near("three-polyps", 4);
    }

    #[test]
    fn those_of_a_uterus_of_several_tissues_on_beds_are() {
        assert_pressed("regions", 8, 0.8); // its beds are soft
    }

    #[test]
    fn those_of_the_septum_are() {
        assert_near("septum", 8);
    }

    /// The scene with a loose piece, and jaws for a loop; `rinsing` has the tissue and the instrument of the default scene.
    #[test]
    fn those_of_the_grasper_are() {
        assert_near("grasper", 8);
    }

    /// Way of a wire from one sweep to the next, m: it cuts in each.
    const SWEEP_M: f32 = 0.6e-3;
    /// Radius of the default instrument, and how far its hand `press` comes before it touches, as a share of its way.
    const RADIUS_M: f32 = 2.5e-3;
    const TOUCHES: f32 = 0.43;
    /// How far the slit begins above the wall, and ends in it, and half of its length, m.
    const SLIT_M: f32 = 2e-3;
    const HALF_SLIT_M: f32 = 5e-3;
    /// How many times as fine the steps are that a cut mesh is tried with: the first with which no mass has to be added.
    const FINER_OF_CUT: [u32; 3] = [8, 16, 32];

    /// The body that a straight wire leaves of a scene, whose middle goes from one place to another; from there to its end it is `half`.
    fn cut(scene: &LoadedScene, [from, to]: [Vec3; 2], half: Vec3) -> Body {
        let steps = (from.distance(to) / SWEEP_M).ceil();
        let wire = |step: u32| {
            let middle = from.lerp(to, step as f32 / steps);
            [middle - half, middle, middle + half].map(|place| place.to_array())
        };
        let wires: Vec<[[f32; 3]; 3]> = (0..=steps as u32).map(wire).collect();
        let (mut workshop, world) = Workshop::open(scene, Isa::detect()).unwrap();
        let (tets, objects) = (world.body.rest.tets.len(), world.objects.len());
        let (world, sweeps) = drawn(&mut workshop, world, &wires, |_| ());
        println!("{sweeps} sweeps make {} tets of {tets}", world.body.rest.tets.len());
        assert!(sweeps > 2 && world.body.rest.tets.len() > tets + 10, "{sweeps} sweeps: hardly anything is cut");
        assert_eq!(world.objects.len(), objects, "nothing comes free");
        world.body
    }

    /// A body of a scene, at rest, in steps so many times as fine; its model's mass, kg, and substeps of such a step.
    fn press_of(scene: &LoadedScene, body: &Body, finer: u32) -> Result<(Press, f64, u32), String> {
        let otherwise = Otherwise { finer, ..Otherwise::default() };
        let (mut workshop, _) = Workshop::open_other(scene, Isa::detect(), otherwise).map_err(|error| error.to_string())?;
        let world = workshop.make(body.clone()).map_err(|error| error.to_string())?;
        let mass_kg = world.model.mass_kg().iter().map(|mass_kg| f64::from(*mass_kg)).sum();
        let substeps = world.model.substeps(1e-3 / f64::from(finer));
        Ok((Press::of(world, scene, 1, otherwise)?, mass_kg, substeps))
    }

    /// Of a body that was cut: its model has the mass that thin tets ask for, and the frequency at rest of the mesh before.
    fn assert_cut_near(what: &str, scene: &LoadedScene, body: &Body) {
        let (coarse, with_added_kg, substeps) = press_of(scene, body, 1).unwrap();
        let fine = FINER_OF_CUT.into_iter().find_map(|finer| Some((finer, press_of(scene, body, finer).ok()?)));
        let (finer, (fine, own_kg, fine_substeps)) = fine.expect("steps that are short enough");
        let apart = compared(what, [coarse, fine]);
        let added = 100.0 * (with_added_kg / own_kg - 1.0);
        println!("{what}: {substeps} substeps with {added:.3} % of mass added, beside {finer} times {fine_substeps}: {apart:?}");
        assert!(apart.most_n > LEAST_N && apart.most_m > 1e-3, "{what}: the hand hardly touches: {apart:?}");
        assert_apart(what, &apart);
    }

    #[test]
    fn those_of_the_default_scene_are_after_its_polyp_was_cut_half_through() {
        let scene = hyst_scene::load_embedded().unwrap();
        let polyp = scene.objects.iter().find(|object| object.kind == DeformableKind::Pathology).unwrap();
        let found = check(&polyp.mesh);
        let (low, high) = (Vec3::from(found.min_m), Vec3::from(found.max_m));
        let middle = low.midpoint(high);
        let way = [middle.with_z(low.z - SWEEP_M), middle];
        let body = cut(&scene, way, Vec3::Y * (high.y - low.y));
        assert_cut_near("a polyp cut half through", &scene, &body);
    }

    /// There the cut is in what is pressed, and the tissue beside it is thin and has mass added.
    #[test]
    fn those_of_a_wall_are_that_is_pressed_where_it_was_slit() {
        let scene = hyst_scene::load_embedded().unwrap();
        let way = &scene.hand("press").unwrap().way;
        let [from, into] = [0, 1].map(|place| Vec3::from(way[place].tip_m(scene.workspace.pivot_m)));
        let down = (into - from).normalize();
        let wall = from.lerp(into, TOUCHES) + RADIUS_M * down;
        let body = cut(&scene, [wall - SLIT_M * down, wall + SLIT_M * down], HALF_SLIT_M * Vec3::Z);
        assert_cut_near("a wall with a slit", &scene, &body);
    }

    /// Between two steps the hand is told what the planes make of its way. Substeps are as short in longer steps, and what is looked at once a step (contacts, rotations) changes by 11 mm/s of the hand, 44 µm of 2.8 mm.
    #[test]
    fn steps_of_two_and_of_four_ticks_are_near_the_converged_solution_of_the_default_scene() {
        let scene = hyst_scene::load_embedded().unwrap();
        for step_ticks in [2, 4] {
            let long = Otherwise { step_ticks, ..Otherwise::default() };
            let apart = between(&scene, [long, Otherwise { finer: 8, ..Otherwise::default() }], TICKS).unwrap();
            println!("steps of {step_ticks} ms, beside 8 in each ms: {apart:?}");
            assert!(apart.most_n > LEAST_N && apart.most_m > 1e-3, "{step_ticks}: the hand hardly touches: {apart:?}");
            assert_apart(&format!("steps of {step_ticks} ms"), &apart);
        }
    }

    /// A contact that is many times as stiff is met with more force, and does not swing in steps as short as these. Expected of ten times: a fifth to a third
    /// of the force, for a contact of 7.5e7 N/m³ under the tip's circle of 1 to 2 mm is about as soft as tissue of 30 kPa is there.
    #[test]
    fn what_the_contact_itself_gives_way_is_seen_and_is_not_all() {
        let scene = hyst_scene::load_embedded().unwrap();
        let [some, more] = [3.0, 10.0].map(|stiffer| softness(&scene, 4, stiffer, 600).unwrap());
        println!("beside contacts 3 and 10 times as stiff: {some:?} {more:?}");
        for apart in [some, more] {
            assert!((0.01..0.6).contains(&apart.force) && apart.displacement < 0.6, "{apart:?}");
        }
    }

    #[test]
    fn of_a_hand_that_meets_nothing_nothing_is_judged_and_of_another_one_what_it_shows_is() {
        let mut scene = hyst_scene::load_embedded().unwrap();
        scene.hands.clear();
        let row = bench::apart(&scene, "at rest", || apart(&scene, [1, 2], 2 * LOOK)).unwrap();
        assert!(row["force_max_n"] == 0.0, "the hand touches something where it rests: {row}");
        let held = |row: &Value| bench::is_near(row).map(|target| target["held"].clone());
        assert_eq!(held(&row), [Value::Null, Value::Null, Value::Null], "{row}");
        let shown = json!({ "force_apart": 0.5 * MOST, "told_apart": 2.0 * MOST, "displacement_apart": 0.5 * MOST });
        assert_eq!(held(&shown), [json!(true), json!(false), json!(true)]);
    }

    /// What is compared can fail: steps that are longer than the station's are farther from the truth than it allows.
    #[test]
    fn a_coarse_step_is_seen() {
        let scene = hyst_scene::load_embedded().unwrap();
        let [finer, coarser] = [[2, 8], [1, 8]].map(|finer| apart(&scene, finer, 600).unwrap());
        assert!(finer.displacement < coarser.displacement, "{finer:?} {coarser:?}");
    }
}
