//! What the text of a scene alone can show to be wrong: ranges, names, attachments.

use crate::error::{SceneError, SceneErrorKind as Kind};
use crate::file::{Deformable, Fixed, Hand, HandPose, Material, Scene, View, Workspace};
use crate::instrument::Rigid;
use crate::names::{attachments, names};
use crate::{fluid, region};

/// Most objects of each kind and most hands in a scene: each costs time at every tick or at every start.
const MAX_OBJECTS: usize = 64;
/// Farthest that a coordinate is from the scene's origin, and largest radius, m: what is farther is in another unit.
const FARTHEST_M: f64 = 10.0;

pub(crate) type Checked = Result<(), SceneError>;

/// Checks everything that needs no mesh. The key of an error is the full path in the text.
pub(crate) fn validate(scene: &Scene) -> Checked {
    if scene.deformable.is_empty() {
        let cure = "add a [[deformable]] table with a name and a mesh";
        return Err(SceneError::new(Kind::Incomplete, "deformable", "the scene has no deformable object", cure));
    }
    if scene.rigid.is_empty() {
        let cure = "add a [[rigid]] table with a name, for example `name = \"hysteroscope\"`";
        return Err(SceneError::new(Kind::Incomplete, "rigid", "the scene has no rigid object", cure));
    }
    if let [_, second, ..] = &scene.rigid[..] {
        let what = format!("“{}” would be a second instrument, and the hand holds one", second.name);
        return Err(SceneError::new(Kind::Range, "rigid[1]", what, "keep one [[rigid]] table"));
    }
    for (key, count) in [("deformable", scene.deformable.len()), ("rigid", scene.rigid.len()), ("hand", scene.hand.len())] {
        range(key, count as f64, 0.0, MAX_OBJECTS as f64, "entries")?;
    }
    names(scene)?;
    attachments(scene)?;
    for (index, object) in scene.deformable.iter().enumerate() {
        deformable(object, &format!("deformable[{index}]"))?;
    }
    for (index, object) in scene.rigid.iter().enumerate() {
        rigid(object, &format!("rigid[{index}]"))?;
    }
    workspace(&scene.workspace)?;
    fluid::validate(&scene.fluid)?;
    fluid::validate_vessels(&scene.vessels)?;
    view(&scene.view)?;
    for (name, script) in &scene.hand {
        hand(script, &format!("hand.{name}"), scene)?;
    }
    Ok(())
}

pub(crate) fn range(key: impl Into<String>, value: f64, low: f64, high: f64, unit: &str) -> Checked {
    if value >= low && value <= high {
        return Ok(());
    }
    let what = format!("is {value} {unit}, allowed is {low} to {high} {unit}").replace(" ,", ",");
    Err(SceneError::new(Kind::Range, key, what.trim_end().to_owned(), "give a value in this range, in SI units"))
}

/// A coordinate, m.
pub(crate) fn coordinate(key: impl Into<String>, coordinate_m: f64) -> Checked {
    range(key, coordinate_m, -FARTHEST_M, FARTHEST_M, "m")
}

/// The radius of a sphere of nodes or tets, by the key of the list's entry.
pub(crate) fn sphere(key: &str, radius_m: f64) -> Checked {
    range(format!("{key}.sphere.radius_m"), radius_m, 1e-6, FARTHEST_M, "m")
}

/// Exactly one of these is given.
pub(crate) fn one_of(key: &str, given: &[(&str, bool)]) -> Checked {
    let names: Vec<&str> = given.iter().map(|(name, _)| *name).collect();
    let cure = format!("give one of {}", names.join(", "));
    let there: Vec<&str> = given.iter().filter(|(_, is)| *is).map(|(name, _)| *name).collect();
    match there[..] {
        [_] => Ok(()),
        [] => Err(SceneError::new(Kind::Incomplete, key, "says nothing", cure)),
        [_, second, ..] => Err(SceneError::new(Kind::Range, format!("{key}.{second}"), "is one too many", cure)),
    }
}

fn ordered(key: String, limits: [f64; 2], low: f64, high: f64, unit: &str) -> Checked {
    range(key.clone(), limits[0], low, high, unit)?;
    range(key.clone(), limits[1], low, high, unit)?;
    if limits[0] < limits[1] {
        return Ok(());
    }
    let what = format!("the lower limit {} is not below the upper limit {}", limits[0], limits[1]);
    Err(SceneError::new(Kind::Range, key, what, "write [lowest, highest]"))
}

fn deformable(object: &Deformable, key: &str) -> Checked {
    if object.mesh.trim().is_empty() {
        return Err(SceneError::new(Kind::Incomplete, format!("{key}.mesh"), "is empty", "name a mesh file"));
    }
    if let Some(scale) = object.scale_to_m {
        range(format!("{key}.scale_to_m"), scale, 1e-6, 1e3, "")?;
    }
    for angle in object.rotate_deg.into_iter().flatten() {
        range(format!("{key}.rotate_deg"), angle, -360.0, 360.0, "°")?;
    }
    for shift in object.translate_m.into_iter().flatten() {
        coordinate(format!("{key}.translate_m"), shift)?;
    }
    if let Some(look) = &object.look {
        for share in look.colour.into_iter().chain([look.roughness]) {
            range(format!("{key}.look"), share, 0.0, 1.0, "")?;
        }
    }
    stuff(&object.material, &format!("{key}.material"))?;
    region::validate(object, key)?;
    for (index, shape) in object.fixed.iter().flatten().enumerate() {
        fixed(shape, &format!("{key}.fixed[{index}]"))?;
    }
    Ok(())
}

/// The figures of a material, whose keys are in the table of this key.
pub(crate) fn stuff(material: &Material, key: &str) -> Checked {
    range(format!("{key}.youngs_modulus_pa"), material.youngs_modulus_pa, 1.0, 1e9, "Pa")?;
    range(format!("{key}.poisson_ratio"), material.poisson_ratio, 0.0, 0.49, "")?;
    range(format!("{key}.density_kg_m3"), material.density_kg_m3, 100.0, 20_000.0, "kg/m³")?;
    range(format!("{key}.damping_per_s"), material.damping_per_s, 0.0, 1e4, "1/s")
}

fn fixed(shape: &Fixed, key: &str) -> Checked {
    match shape {
        Fixed::Sphere { radius_m, .. } => sphere(key, *radius_m),
        Fixed::Box { min_m, max_m } => corners(&format!("{key}.box.min_m"), min_m, max_m),
        Fixed::BelowZM(z) => coordinate(format!("{key}.below_z_m"), *z),
        Fixed::AboveZM(z) => coordinate(format!("{key}.above_z_m"), *z),
        Fixed::OuterShell(share) => range(format!("{key}.outer_shell"), *share, 0.0, 0.5, ""),
    }
}

/// The corners of a box of nodes or tets.
pub(crate) fn corners(key: &str, min_m: &[f64; 3], max_m: &[f64; 3]) -> Checked {
    for axis in 0..3 {
        coordinate(key, min_m[axis])?;
        coordinate(key, max_m[axis])?;
        if min_m[axis] >= max_m[axis] {
            let what = format!("the lower corner {min_m:?} is not below the upper corner {max_m:?} on every axis");
            return Err(SceneError::new(Kind::Range, key, what, "exchange the coordinates"));
        }
    }
    Ok(())
}

fn rigid(object: &Rigid, key: &str) -> Checked {
    range(format!("{key}.diameter_m"), object.diameter_m, 0.0005, 0.02, "m")?;
    range(format!("{key}.collision_length_m"), object.collision_length_m, object.diameter_m, 0.5, "m")?;
    range(format!("{key}.length_m"), object.length_m, object.collision_length_m, 1.0, "m")?;
    range(format!("{key}.points"), f64::from(object.points), 16.0, 5_000.0, "points")?;
    let electrode = &object.electrode;
    range(format!("{key}.loop.wire_m"), electrode.wire_m, 0.000_05, 0.002, "m")?;
    range(format!("{key}.loop.reach_m"), electrode.reach_m, 0.0, 0.05, "m")?;
    electrode.radius_m.map_or(Ok(()), |radius_m| range(format!("{key}.loop.radius_m"), radius_m, electrode.wire_m, 0.02, "m"))?;
    range(format!("{key}.scale_to_m"), object.scale_to_m, 1e-6, 1e3, "")?;
    let Some(jaws) = &object.jaws else { return Ok(()) };
    range(format!("{key}.jaws.scale_to_m"), jaws.scale_to_m, 1e-6, 1e3, "")?;
    range(format!("{key}.jaws.opening_m"), jaws.opening_m, 0.001, 0.03, "m")?;
    range(format!("{key}.jaws.points"), f64::from(jaws.points), 16.0, 1_000.0, "points")
}

fn workspace(limits: &Workspace) -> Checked {
    for pivot in limits.pivot_m {
        coordinate("workspace.pivot_m", pivot)?;
    }
    ordered("workspace.pitch_deg".to_owned(), limits.pitch_deg, -80.0, 80.0, "°")?;
    ordered("workspace.yaw_deg".to_owned(), limits.yaw_deg, -80.0, 80.0, "°")?;
    ordered("workspace.roll_deg".to_owned(), limits.roll_deg, -360.0, 360.0, "°")?;
    ordered("workspace.insertion_m".to_owned(), limits.insertion_m, 0.0, 0.5, "m")
}

fn view(view: &View) -> Checked {
    range("view.optic_angle_deg", view.optic_angle_deg, 0.0, 90.0, "°")?;
    range("view.field_of_view_deg", view.field_of_view_deg, 20.0, 150.0, "°")?;
    range("view.periphery_ratio", view.periphery_ratio, 0.2, 1.0, "")?;
    range("view.light", view.light, 0.0, 10.0, "")
}

pub(crate) fn hand(script: &Hand, key: &str, scene: &Scene) -> Checked {
    movement(script, key)?;
    range(format!("{key}.period_s"), script.period_s.unwrap_or(1.0), 0.1, 600.0, "s")?;
    range(format!("{key}.through"), script.through.len() as f64, 0.0, 1_000.0, "poses")?;
    range(format!("{key}.leg"), script.leg.len() as f64, 0.0, 1_000.0, "legs")?;
    for (name, end) in [("from", &script.from), ("into", &script.into)] {
        end.as_ref().map_or(Ok(()), |end| pose(end, &format!("{key}.{name}"), &scene.workspace))?;
    }
    for (index, passed) in script.through.iter().enumerate() {
        pose(passed, &format!("{key}.through[{index}]"), &scene.workspace)?;
    }
    for (index, leg) in script.leg.iter().enumerate() {
        pose(&leg.to, &format!("{key}.leg[{index}].to"), &scene.workspace)?;
        range(format!("{key}.leg[{index}].time_s"), leg.time_s, 0.01, 600.0, "s")?;
    }
    crate::fluid::validate_changes(&format!("{key}.change"), &script.change)?;
    match &script.target {
        Some(name) if !scene.deformable.iter().any(|object| object.name == *name) => {
            let what = format!("no deformable is named “{name}”");
            Err(SceneError::new(Kind::Name, format!("{key}.target"), what, "name a deformable of this scene"))
        }
        _ => Ok(()),
    }
}

/// It moves in one way, and wholly.
fn movement(script: &Hand, key: &str) -> Checked {
    let has_way = script.from.is_some() || script.into.is_some() || script.period_s.is_some() || !script.through.is_empty();
    let is_whole = script.from.is_some() && script.into.is_some() && script.period_s.is_some();
    let ways = [has_way, !script.leg.is_empty(), script.like.is_some()];
    let (kind, what) = match ways.iter().filter(|is| **is).count() {
        1 if has_way && !is_whole => (Kind::Incomplete, "a way has from, into and period_s"),
        1 => return Ok(()),
        0 => (Kind::Incomplete, "does not say how it moves"),
        _ => (Kind::Contradiction, "moves in more than one way"),
    };
    Err(SceneError::new(kind, key, what, "give from, into and period_s, or leg, or like"))
}

fn pose(pose: &HandPose, key: &str, limits: &Workspace) -> Checked {
    range(format!("{key}.pitch_deg"), pose.pitch_deg, limits.pitch_deg[0], limits.pitch_deg[1], "°")?;
    range(format!("{key}.yaw_deg"), pose.yaw_deg, limits.yaw_deg[0], limits.yaw_deg[1], "°")?;
    range(format!("{key}.roll_deg"), pose.roll_deg, limits.roll_deg[0], limits.roll_deg[1], "°")?;
    range(format!("{key}.insertion_m"), pose.insertion_m, limits.insertion_m[0], limits.insertion_m[1], "m")
}
