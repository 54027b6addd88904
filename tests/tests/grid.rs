//! A grid of the flow that is too fine for the machine: the station starts all the same, computes the flow more rarely or on fewer cells and says so, and whoever
//! comes to the role computes it on the same ones. Nothing else of the station is touched.

use serde_json::Value;
use station_tests::{Folder, Station, hystation, run, wait_for};
use std::path::PathBuf;
use std::time::Duration;

/// Dry steps of some hundred milliseconds each, on a machine that is busy.
const LIMIT: Duration = Duration::from_secs(90);
/// Cells that no core of today computes 30 times a second.
const FINE: &str = "grid = [128, 128, 128]";

/// The steps of the flow that is live, once there are some.
fn steps(station: &Station) -> Value {
    let found = wait_for(LIMIT, || {
        let active = station.processes("fluid").into_iter().find(|process| process["active"] == true)?;
        Some(active["steps"].clone()).filter(|steps| !steps.is_null() && station.has_fluid_spoken())
    });
    found.unwrap_or_else(|| panic!("no flow: {}\n{}", station.status(), station.said()))
}

#[test]
fn a_grid_that_is_too_fine_is_computed_as_the_machine_affords_and_the_same_after_a_death() {
    let folder = Folder::new("grid");
    let scenes = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes");
    let text = std::fs::read_to_string(scenes.join("default.toml")).unwrap();
    let text = text.replace("../meshes", scenes.join("../meshes").to_str().unwrap());
    assert!(text.contains("grid = [32, 18, 32]"));
    let scene = folder.write("scene.toml", &text.replace("grid = [32, 18, 32]", FINE));
    let station = Station::start("grid", &[&scene, "--test-mode"]);
    let first = steps(&station);
    println!("{first}");
    let number = |steps: &Value, key: &str| steps[key].as_u64().unwrap();
    let (ms, scene_ms, halvings) = (number(&first, "ms"), number(&first, "scene_ms"), number(&first, "halvings"));
    assert!(scene_ms == 33 && (ms > scene_ms || halvings > 0), "{first}");
    let (_, said, _) = run(hystation().args(["--name", station.name(), "status"]));
    assert!(said.contains("this machine is too slow"), "{said}");
    assert_eq!(
        (said.contains("the flow is computed every"), said.contains("the scene's cells")),
        (ms > scene_ms, halvings > 0),
        "{said}"
    );

    station.recover();
    let (deficit_ml, _) = station.deficit();
    for _ in 0..2 {
        station.kill("fluid", true);
        station.recover();
        assert_eq!(steps(&station), first);
    }
    let gone_on = wait_for(LIMIT, || Some(station.deficit()).filter(|now| now.0 >= deficit_ml));
    assert!(gone_on.is_some(), "{deficit_ml} ml before, {:?}", station.deficit());
    let ended = station.stop();
    ended.assert_clean();
    let unasked = ended.died_unasked();
    assert!(unasked.iter().all(|fault| fault["target"].as_str().is_none_or(|target| target.starts_with("fluid"))), "{unasked:?}");
}
