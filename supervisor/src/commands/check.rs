//! `hystation check`, and the check that `run` makes before anything starts.

use super::bench::{beside, not_started};
use crate::case::{self, RunCase};
use crate::cli::{RunArgs, StationArgs};
use crate::plan::Plan;
use crate::settings::Refusal;
use hyst_engine::Settings;
use hyst_exchange::Station;
use hyst_messages::Role;
use hyst_scene::{LoadedHand, LoadedScene};
use std::path::Path;
use std::process::{Command, Stdio};

/// A scene that can be run.
pub struct Admitted {
    /// Hash of its content.
    pub hash: u64,
    /// Bytes of its tissue's state: the nodes, and the vertices of the surfaces that are drawn.
    pub state_bytes: u64,
    /// The hand draws the loop under current; of one that is no script nobody knows, and it may.
    pub may_cut: bool,
    /// Its pivot, m.
    pub pivot_m: [f32; 3],
    /// How much of it is to be removed, ml.
    pub pathology_ml: f64,
}

/// Loads the scene of a run as the engines will, so that a station is never half-started. What was repaired is said on stderr.
pub fn admit(settings: &Settings, plan: &Plan, case: Option<&RunCase>) -> Result<Admitted, Refusal> {
    let (loaded, path) = match case {
        Some(case) => (case.settled.scene.clone(), Some(&case.beside)),
        None => (load(settings.scene.as_deref())?, settings.scene.as_ref()),
    };
    if let Some(path) = path {
        let has_tissue = plan.slots().iter().any(|slot| slot.role() == Role::Tissue);
        let isa = settings.set.get("isa").map(String::as_str);
        // On a virtual clock, and with steps that were asked for, the machine may be as slow as it likes.
        let timed = !settings.lockstep && !settings.set.contains_key("tissue_step_ticks");
        let notes = if has_tissue { model(&plan.binary(Role::Tissue), Some(path), isa, timed)? } else { Vec::new() };
        for note in loaded.drawn.iter().chain(&loaded.notes).chain(&notes) {
            eprintln!("hystation: {note}");
        }
    }
    if let Some(name) = settings.hand.strip_prefix("script:")
        && name != "idle"
        && loaded.hand(name).is_none()
    {
        let known: Vec<&str> = loaded.hands.iter().map(|hand| hand.name.as_str()).collect();
        return Err(Refusal::input(format!(
            "--hand script:{name}: this scene has no such hand; it has idle, {}",
            known.join(", ")
        )));
    }
    let bytes = |object: &hyst_scene::LoadedDeformable| object.mesh.positions_m.len() * 24 + object.bindings.len() * 12;
    let state_bytes = loaded.objects.iter().map(bytes).sum::<usize>() as u64;
    let (hash, pivot_m, may_cut) = (loaded.hash, loaded.workspace.pivot_m, may_cut(&settings.hand, &loaded));
    Ok(Admitted { hash, state_bytes, may_cut, pivot_m, pathology_ml: loaded.pathology_ml() })
}

fn may_cut(hand: &str, loaded: &LoadedScene) -> bool {
    let Some(name) = hand.strip_prefix("script:") else { return hand != "idle" };
    // Where no way was found along a polyp, a hand of that name has no legs, and touches it under current.
    let cuts = |hand: &LoadedHand| hand.legs.iter().any(|leg| leg.is_energized) || name == "polyp" && hand.legs.is_empty();
    loaded.hand(name).is_some_and(cuts)
}

/// What the Main Loop says of the model that it would make of a scene, one sentence each. It alone knows, and this program links no simulation.
fn model(tissue: &Path, scene: Option<&Path>, isa: Option<&str>, timed: bool) -> Result<Vec<String>, Refusal> {
    let mut command = Command::new(tissue);
    command.arg("check").args(scene).stdin(Stdio::null());
    if let Some(isa) = isa {
        command.args(["--isa", isa]);
    }
    if timed {
        command.arg("--timed");
    }
    let said = command.output().map_err(|error| not_started(tissue, &error))?;
    let lines = |bytes: &[u8]| String::from_utf8_lossy(bytes).lines().map(str::to_owned).collect::<Vec<_>>();
    if said.status.success() { Ok(lines(&said.stdout)) } else { Err(Refusal::input(lines(&said.stderr).join("\n"))) }
}

fn load(path: Option<&Path>) -> Result<LoadedScene, Refusal> {
    hyst_scene::load_or_embedded(path).map_err(|error| Refusal::input(error.to_string()))
}

/// The seed that a check is of; whatever else a station can be set to is not looked at.
fn seed_of(set: &[String]) -> Result<Option<u32>, Refusal> {
    match set.iter().find(|pair| !pair.starts_with("seed=")) {
        Some(other) => Err(Refusal::input(format!("--set {other}: a check takes the seed of a case alone, --set seed=7"))),
        None => case::seed(set),
    }
}

/// Prints what was found in a scene, a case or a mesh, the default scene where none is named, and what will be done about it; exit code 2 if the station
/// cannot run it.
pub fn check(station: &Station, file: Option<&Path>, set: &[String], json: bool) -> Result<u8, Refusal> {
    let seed = seed_of(set)?;
    let mut report = hyst_scene::check_drawn(file, seed);
    if report.runnable {
        // The Main Loop draws what its file says: it is given one that says this seed.
        let station_args = StationArgs { set: set.to_vec(), ..StationArgs::default() };
        let args = RunArgs { scene: file.map(Path::to_path_buf), station: station_args, ..RunArgs::default() };
        let drawn = if seed.is_some() { RunCase::of(station, &args)? } else { None };
        match model(&beside("tissue")?, drawn.as_ref().map_or(file, |case| Some(case.beside.as_path())), None, true) {
            Ok(notes) => report.notes.extend(notes),
            Err(refusal) => report.refuse(refusal.message),
        }
    }
    if json {
        println!("{}", serde_json::to_string_pretty(&report).map_err(|error| Refusal::failed(error.to_string()))?);
    } else if report.objects.is_empty() {
        return Err(Refusal::input(report.error.unwrap_or_default())); // nothing was found that could be told
    } else {
        println!("{}", report.to_string().trim_end());
    }
    Ok(if report.runnable { 0 } else { 2 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_check_takes_a_seed_and_no_other_setting() {
        let of = |words: &[&str]| {
            let set: Vec<String> = words.iter().map(ToString::to_string).collect();
            seed_of(&set).map_err(|refusal| refusal.code)
        };
        assert_eq!([of(&[]), of(&["seed=7"]), of(&["seed=7", "seed=8"])], [Ok(None), Ok(Some(7)), Ok(Some(8))]);
        assert_eq!([of(&["view=external"]), of(&["seed=x"]), of(&["seed=7", "seed"])], [Err(2), Err(2), Err(2)]);
    }

    /// A case's own hand was told that it cuts nothing, because it was not called polyp.
    #[test]
    fn a_hand_cuts_if_one_of_its_legs_does_whatever_its_name_is() {
        let mut scene = hyst_scene::load_embedded().unwrap();
        let found = |scene: &LoadedScene| {
            ["script:polyp", "script:press", "script:idle", "idle", "mouse"].map(|hand| may_cut(hand, scene))
        };
        assert_eq!(found(&scene), [true, false, false, false, true]);
        let polyp = scene.hand("polyp").unwrap().clone();
        for hand in &mut scene.hands {
            match hand.name.as_str() {
                "press" => hand.legs = polyp.legs.clone(),
                "polyp" => hand.legs.iter_mut().for_each(|leg| leg.is_energized = false),
                _ => {}
            }
        }
        assert!(!polyp.legs.is_empty());
        assert_eq!(found(&scene), [false, true, false, false, true]);
    }
}
