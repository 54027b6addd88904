//! `hystation check`, and the check that `run` makes before anything starts.

use crate::settings::Refusal;
use hyst_engine::Settings;
use hyst_scene::LoadedScene;
use std::path::Path;

/// Loads the scene of a run as the engines will, so that a station is never half-started; gives the scene's hash. What was repaired is
/// said on stderr.
pub fn admit(settings: &Settings) -> Result<u64, Refusal> {
    let loaded = load(settings.scene.as_deref())?;
    if settings.scene.is_some() {
        for note in &loaded.notes {
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
    Ok(loaded.hash)
}

fn load(path: Option<&Path>) -> Result<LoadedScene, Refusal> {
    hyst_scene::load_or_embedded(path).map_err(|error| Refusal::input(error.to_string()))
}

/// Prints what was found in a scene or mesh and what will be done about it; exit code 2 if the station cannot run it.
pub fn check(file: Option<&Path>, json: bool) -> Result<u8, Refusal> {
    let Some(path) = file else {
        return embedded(json);
    };
    let report = hyst_scene::check(path).map_err(|error| Refusal::input(error.to_string()))?;
    if json {
        println!("{}", serde_json::to_string_pretty(&report).map_err(|error| Refusal::failed(error.to_string()))?);
    } else {
        println!("{}", report.to_string().trim_end());
    }
    Ok(if report.runnable { 0 } else { 2 })
}

fn embedded(json: bool) -> Result<u8, Refusal> {
    let loaded = load(None)?;
    let objects: Vec<serde_json::Value> = loaded
        .objects
        .iter()
        .map(|object| {
            let (nodes, tets, triangles) =
                (object.mesh.positions_m.len(), object.mesh.tets.len(), object.surface.triangles.len());
            serde_json::json!({ "name": object.name, "nodes": nodes, "tets": tets, "surface_triangles": triangles })
        })
        .collect();
    let hands: Vec<&str> = loaded.hands.iter().map(|hand| hand.name.as_str()).collect();
    if json {
        let hash = format!("{:016x}", loaded.hash);
        let value = serde_json::json!({ "origin": loaded.origin, "name": loaded.scene.name, "runnable": true, "objects": objects,
            "hands": hands, "notes": loaded.notes, "hash": hash });
        println!("{value:#}");
        return Ok(0);
    }
    println!("{} ({}): runnable, hash {:016x}", loaded.scene.name, loaded.origin, loaded.hash);
    for object in &objects {
        println!(
            "  {}: {} nodes, {} tets, drawn as {} triangles",
            object["name"], object["nodes"], object["tets"], object["surface_triangles"]
        );
    }
    println!("  hands: idle, {}", hands.join(", "));
    for note in &loaded.notes {
        println!("  note: {note}");
    }
    Ok(0)
}
