//! The three scenes of the framework's paper (Tuchschmid et al. 2006, table 2), each with what it is to reach.

use super::press::{INTERSECTION, Press};
use super::{Make, RUN_NS, THREADS, US, beside_peer, complete, cuts, cuts_by_loop, speedup, time_ns, with_many_points};
use hyst_engine::bench::{spread, target, usual_ns};
use hyst_scene::LoadedScene;
use hyst_tissue::Isa;
use serde_json::{Value, json};
use std::path::PathBuf;

/// A scene, the longest step that it may take, ms, and how often 1 000 points are to be tested, Hz.
struct Aim {
    file: &'static str,
    step_ms: f64,
    test_hz: f64,
}

static AIMS: [Aim; 3] = [
    Aim { file: "myoma.toml", step_ms: 1.0, test_hz: 10e3 },
    Aim { file: "polyp-medium.toml", step_ms: 1.5, test_hz: 8e3 },
    Aim { file: "three-polyps.toml", step_ms: 2.5, test_hz: 5e3 },
];
/// Where strokes go through the first pathology of each, as shares of its width, and how far the loop is turned in its own, degrees.
const PLACES: [f32; 2] = [0.4, 0.6];
const TURNS_DEG: [f32; 2] = [-10.0, 10.0];
/// Share of what independent copies reach that the speed-up of the test is to have, with the largest of the scenes.
const LEAST_SPEEDUP: f64 = 0.9;
/// A machine of so many cores has room for several threads whatever else runs, and is to make the test so many times as fast with this many.
const MANY_CORES: usize = 16;
const SEVERAL: usize = 4;
const LEAST_OF_SEVERAL: f64 = 3.8;

/// A test: the key of its speed-ups, what it is called, and how a run of it is made.
type Test = (&'static str, &'static str, Make);
/// That of the station, and one that remembers nothing: the paper's.
const TESTS: [Test; 2] =
    [("speedup", "the test", Press::new), ("speedup_of_search", "a search through all tets", Press::searching)];

/// Where the scenes are: under the folder that the benchmark is called in, or beside the target folder of its build.
fn folder() -> Option<PathBuf> {
    let of_build = std::env::current_exe().ok().and_then(|exe| Some(exe.parent()?.join("../../assets/scenes")));
    let folders = [Some(PathBuf::from("assets/scenes")), of_build];
    let found = folders.into_iter().flatten().find(|folder| folder.join(AIMS[0].file).is_file());
    if found.is_none() {
        eprintln!("tissue bench: the paper's scenes are left out: no assets/scenes here; call it in the checkout");
    }
    found
}

fn scenes() -> Result<Vec<(&'static Aim, LoadedScene)>, String> {
    let Some(folder) = folder() else { return Ok(Vec::new()) };
    let load = |aim: &'static Aim| -> Result<(&'static Aim, LoadedScene), String> {
        let scene = crate::world::load_scene(Some(&folder.join(aim.file))).map_err(|error| error.to_string())?;
        Ok((aim, scene))
    };
    AIMS.iter().map(load).collect()
}

/// A whole step of each scene with two threads and cuts in it, by a straight wire and by the station's loop, and whether they are short enough: a cut has the
/// time of a step for itself.
pub fn steps() -> Result<Vec<Value>, String> {
    let (mut rows, mut targets) = (Vec::new(), Vec::new());
    for (aim, scene) in scenes()? {
        let mut press = Press::new(&scene, Isa::detect(), THREADS)?;
        let record = press.run(RUN_NS)?;
        let mut row = json!({ "method": format!("the paper's scene, {THREADS} threads"), "substeps": record.substeps });
        complete(&mut row, &scene, &press, &record, |_| true);
        let step_ms = usual_ns(&mut record.steps_ns(|_| true)) / 1e6;
        let name = format!("step of {} tets with {THREADS} threads, ms", press.tets());
        targets.push(target(&name, step_ms, aim.step_ms, false));
        let (cut, of_cuts) = cuts(&scene, &PLACES, aim.step_ms, false)?;
        row["cut"] = cut;
        targets.extend(of_cuts);
        if let Some((cut, of_cuts)) = cuts_by_loop(&scene, &TURNS_DEG, aim.step_ms, None)? {
            row["cut_by_loop"] = cut;
            targets.extend(of_cuts);
        }
        rows.push(row);
    }
    rows.extend(targets);
    Ok(rows)
}

/// The test of 1 000 points in each scene: how often on one core (the paper's R) beside its peer, and how many times as often on two (its Γ), of which the
/// largest scene's is judged; the latter also of a search through all tets.
pub fn intersections() -> Result<Vec<Value>, String> {
    let (mut rows, mut targets) = (Vec::new(), Vec::new());
    for (aim, scene) in scenes()? {
        let scene = with_many_points(scene);
        let mut press = Press::new(&scene, Isa::detect(), 1)?;
        let record = press.run(RUN_NS)?;
        let mut tests_ns = record.steps_ns(|phase| phase <= INTERSECTION);
        let test_ns = usual_ns(&mut tests_ns);
        let mut row = json!({ "method": "the paper's scene", "test_us": spread(&mut tests_ns, US), "test_hz": 1e9 / test_ns });
        complete(&mut row, &scene, &press, &record, |phase| phase <= INTERSECTION);
        let (tets, ratio) = (press.tets(), beside_peer(&mut row, &scene, test_ns)?);
        targets.push(target(&format!("test of 1 000 points against {tets} tets, Hz"), 1e9 / test_ns, aim.test_hz, true));
        targets.push(target(&format!("parry's BVH over that test, {tets} tets"), ratio, super::LEAST_RATIO, true));
        for (key, what, make) in TESTS {
            row[key] = speedup(&scene, make, |phase| phase == INTERSECTION)?;
            if aim.file == AIMS[AIMS.len() - 1].file {
                let of = |times: &str| row[key][times].as_f64().unwrap_or(f64::NAN);
                let share = of("2") / of("2_independent_copies");
                let name = format!("speed-up of {what} on 2 threads over 2 independent copies, {tets} tets");
                targets.push(target(&name, share, LEAST_SPEEDUP, true));
                targets.extend(on_several(&scene, &mut row, (key, what, make))?);
            }
        }
        rows.push(row);
    }
    rows.extend(targets);
    Ok(rows)
}

/// What several threads bring to a test of a scene, in its row and as a target; nothing on a machine of fewer than [`MANY_CORES`].
fn on_several(scene: &LoadedScene, row: &mut Value, (key, what, make): Test) -> Result<Option<Value>, String> {
    if std::thread::available_parallelism().map_or(1, usize::from) < MANY_CORES {
        return Ok(None);
    }
    let is_test = |phase: usize| phase == INTERSECTION;
    let times = time_ns(scene, make, 1, is_test)? / time_ns(scene, make, SEVERAL, is_test)?;
    row[key][SEVERAL.to_string()] = json!(times);
    let name = format!("speed-up of {what} on {SEVERAL} threads of a machine of {MANY_CORES} cores or more");
    Ok(Some(target(&name, times, LEAST_OF_SEVERAL, true)))
}
