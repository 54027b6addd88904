//! What a case and its scene together show to be wrong: objects that are not there, places out of reach, goals that need another medium.

use super::brief::{deficit_limit_ml, middle_m, misfit};
use super::checks::wrong;
use super::conflicts::compatible;
use super::file::{Case, Goal, Mirror, Place, Vary};
use super::reach::{is_visited, reachable};
use crate::electrode::electrode;
use crate::error::{SceneError, SceneErrorKind as Kind};
use crate::file::{Deformable, DeformableKind, Scene};
use crate::fluid::PA_PER_MMHG;
use crate::loaded::LoadedScene;
use crate::mirror;
use crate::validate::{Checked, hand, range, validate};

/// The least that the pump is set to, Pa: 15 mmHg (WOM's manual, as the hand's controls have it).
const LEAST_SET_PA: f64 = 15.0 * PA_PER_MMHG;

/// What the case and its scene show together.
pub(crate) fn together(case: &Case, scene: &Scene) -> Checked {
    variations(case, scene)?;
    for (index, place) in case.place.iter().enumerate() {
        if let Some(name) = &place.object {
            find(scene, format!("place[{index}].object"), name)?;
        }
        if is_visited(case, &place.name) {
            inserted(place, index, scene)?;
        }
    }
    goals(case, scene)?;
    case.hand.iter().try_for_each(|(name, script)| hand(script, &format!("hand.{name}"), scene))?;
    mirrored(case, scene)?;
    let limit_ml = deficit_limit_ml(case.rules.medium.unwrap_or(scene.fluid.medium));
    range("rules.max_deficit_ml", case.rules.max_deficit_ml.unwrap_or(limit_ml), 1.0, limit_ml, "ml")
}

/// What a case that was never played has to show beyond that: its goals go together with each other, its warnings and its end, the scope comes to its places, its
/// current works where a goal needs the loop, jaws find something free where one needs them, and what is to be staunched bleeds.
pub(crate) fn playable(case: &Case, scene: &Scene) -> Checked {
    let medium = case.rules.medium.unwrap_or(scene.fluid.medium);
    compatible(case, medium)?;
    // Where objects are is known once they are drawn.
    reachable(case, scene, |place| place.centre_m)?;
    bleeds(case, scene)?;
    if scene.rigid.first().is_some_and(|rigid| rigid.jaws.is_some()) {
        return brought_out(case, scene);
    }
    let Some([_, what, cure]) = misfit(case.rules.energy, medium) else {
        return Ok(());
    };
    match case.goal.iter().enumerate().find_map(|(index, goal)| Some((index, cutting(goal)?))) {
        Some((index, name)) => wrong(Kind::Contradiction, format!("goal[{index}].{name}"), what, cure),
        None => Ok(()),
    }
}

/// Whether jaws can do what goals ask for: they bring out what is free, cut nothing, and need no current.
fn brought_out(case: &Case, scene: &Scene) -> Checked {
    let is_free = |object: &Deformable| {
        let is_on_bed = object.region.iter().any(|region| region.bed_n_m4.is_some_and(|bed_n_m4| bed_n_m4 > 0.0));
        object.attach_to.is_none() && object.fixed.as_ref().is_some_and(Vec::is_empty) && !is_on_bed
    };
    let any_free = scene.deformable.iter().any(|object| object.kind == DeformableKind::Pathology && is_free(object));
    let fault = |goal: &Goal| match cutting(goal)? {
        "removed" if any_free => None,
        "removed" => {
            let cure = "give the instrument a loop in their place, or the scene a pathology with fixed = [], attached to nothing";
            Some(("removed", "the jaws bring out what is free, and no pathology is", cure))
        }
        name => Some((name, "the jaws cut no piece", "give the instrument a loop in their place, or remove the goal")),
    };
    match case.goal.iter().enumerate().find_map(|(index, goal)| Some((index, fault(goal)?))) {
        Some((index, (name, what, cure))) => wrong(Kind::Contradiction, format!("goal[{index}].{name}"), what, cure),
        None => Ok(()),
    }
}

/// Whether a goal's bleeding comes about, whatever of the vessels a seed draws.
fn bleeds(case: &Case, scene: &Scene) -> Checked {
    let Some(index) = case.goal.iter().position(|goal| goal.staunch.is_some()) else { return Ok(()) };
    let least = |drawn: fn(&Vary) -> Option<[f64; 2]>, of_scene: f64| {
        case.vary.iter().find_map(drawn).map_or(of_scene, |[least, _]| least)
    };
    let pressure_pa = least(|vary| vary.vessel_pressure_pa, scene.vessels.pressure_pa);
    let conductance_ml_s_pa = least(|vary| vary.vessel_conductance_ml_s_pa, scene.vessels.conductance_ml_s_pa);
    let (what, cure) = if conductance_ml_s_pa <= 0.0 {
        ("nothing comes out of vessels whose conductance may be 0".to_owned(), "let it be more, in [vessels] or in [[vary]]")
    } else if pressure_pa <= LEAST_SET_PA {
        let what = format!("vessels of {pressure_pa} Pa never bleed: the pump's least pressure is {LEAST_SET_PA:.0} Pa");
        (what, "let their pressure be higher, in [vessels] or in [[vary]]")
    } else {
        return Ok(());
    };
    wrong(Kind::Contradiction, format!("goal[{index}].staunch"), what, cure)
}

/// The same of its places at objects, where the seed has drawn these.
pub(crate) fn playable_as_drawn(case: &Case, scene: &LoadedScene) -> Checked {
    reachable(case, &scene.scene, |place| place.object.as_ref().map(|name| middle_m(scene, name)))
}

fn find<'a>(scene: &'a Scene, key: String, name: &str) -> Result<&'a Deformable, SceneError> {
    scene.deformable.iter().find(|object| object.name == name).ok_or_else(|| {
        let known: Vec<&str> = scene.deformable.iter().map(|object| object.name.as_str()).collect();
        let what = format!("the scene has no object “{name}”; there are: {}", known.join(", "));
        SceneError::new(Kind::Name, key, what, "name one of these")
    })
}

fn variations(case: &Case, scene: &Scene) -> Checked {
    for (index, vary) in case.vary.iter().enumerate() {
        let Some(name) = &vary.object else { continue };
        let key = format!("vary[{index}].object");
        let object = find(scene, key.clone(), name)?;
        if case.vary[..index].iter().any(|before| before.object.as_ref() == Some(name)) {
            return wrong(Kind::Name, key, format!("“{name}” varies twice"), "put both into one [[vary]] table");
        }
        if scene.deformable.iter().any(|other| other.attach_to.as_ref() == Some(name))
            && (vary.size.is_some() || vary.shift_m.is_some())
        {
            return wrong(
                Kind::Contradiction,
                key,
                format!("another object is attached to “{name}”"),
                "vary its stiffness alone",
            );
        }
        let moves = [("size", vary.size.is_some()), ("shift_m", vary.shift_m.is_some())];
        if let (None, Some((what, _))) = (&object.attach_to, moves.iter().find(|(_, is)| *is)) {
            let key = format!("vary[{index}].{what}");
            return wrong(
                Kind::Contradiction,
                key,
                format!("“{name}” sits on no wall"),
                "vary what is attached, or stiffness alone",
            );
        }
    }
    Ok(())
}

/// What a seed may mirror keeps within its limits then, whatever the seed.
fn mirrored(case: &Case, scene: &Scene) -> Checked {
    let mut whole = scene.clone();
    whole.hand.extend(case.hand.clone());
    for (index, vary) in case.vary.iter().enumerate() {
        let allowed = [Mirror::Side, Mirror::Wall].map(|side| vary.mirror.contains(&side));
        let ways = [[true, false], [false, true], [true, true]];
        for planes in ways.into_iter().filter(|planes| (0..2).all(|axis| allowed[axis] || !planes[axis])) {
            let mut image = whole.clone();
            mirror::scene(&mut image, planes);
            validate(&image).map_err(|error| {
                let what = format!("in the mirror {} {}", error.key, error.what);
                let cure = "let it keep within its limits there, too, or take this way out of `mirror`";
                SceneError::new(Kind::Contradiction, format!("vary[{index}].mirror"), what, cure)
            })?;
        }
    }
    Ok(())
}

fn goals(case: &Case, scene: &Scene) -> Checked {
    let pathologies: Vec<&str> = scene
        .deformable
        .iter()
        .filter(|object| object.kind == DeformableKind::Pathology)
        .map(|object| object.name.as_str())
        .collect();
    for (index, goal) in case.goal.iter().enumerate() {
        if let Some(biopsy) = &goal.biopsy {
            let key = format!("goal[{index}].biopsy.object");
            find(scene, key.clone(), &biopsy.object)?;
            if pathologies != [biopsy.object.as_str()] {
                let what = format!(
                    "“{}” is not the only pathology of the scene, and what is removed is counted together",
                    biopsy.object
                );
                return wrong(Kind::Contradiction, key, what, "take a scene with this one pathology");
            }
        }
        if let Some(name) = cutting(goal) {
            cuttable(scene, pathologies.is_empty(), &format!("goal[{index}].{name}"))?;
        }
    }
    Ok(())
}

/// What a goal that needs the loop asks for.
fn cutting(goal: &Goal) -> Option<&'static str> {
    let cutting = [("removed", goal.removed.is_some()), ("biopsy", goal.biopsy.is_some())];
    cutting.into_iter().find(|(_, is)| *is).map(|(name, _)| name)
}

/// Whether a goal that needs the loop can be reached.
fn cuttable(scene: &Scene, no_pathology: bool, key: &str) -> Checked {
    if no_pathology {
        return wrong(
            Kind::Contradiction,
            key,
            "the scene has no pathology",
            "mark one with kind = \"pathology\", or remove the goal",
        );
    }
    if scene.rigid.first().and_then(electrode).is_none() {
        return wrong(Kind::Contradiction, key, "the instrument has no loop to cut with", "give the scene's [[rigid]] one");
    }
    Ok(())
}

/// A range of the insertion that the tip comes into.
fn inserted(place: &Place, index: usize, scene: &Scene) -> Checked {
    let [shortest_m, longest_m] = scene.workspace.insertion_m;
    match place.insertion_m {
        Some([least_m, most_m]) if least_m > longest_m || most_m < shortest_m => {
            let what = format!("the insertion is {shortest_m} to {longest_m} m in this scene");
            let cure = "move it, or widen the scene's workspace";
            wrong(Kind::Contradiction, format!("place[{index}].insertion_m"), what, cure)
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case(goal: &str, more: &str) -> Case {
        let head = "version = 1\nname = \"x\"\nrung = \"bleeding\"\ntask = \"x\"\nscene = \"x\"";
        toml::from_str(&format!("{head}\n[[goal]]\n{goal}\n{more}\n")).unwrap()
    }

    /// Goals that asked jaws to cut were accepted, and no session could reach them.
    #[test]
    fn with_jaws_goals_ask_for_what_lies_free_and_need_no_current() {
        let mut scene = Scene::embedded_default().unwrap();
        let (removed, biopsy) = ("removed = { percent = 95.0 }", "biopsy = { object = \"polyp\", at_least_ml = 0.01 }");
        let found = |goal: &str, rules: &str, scene: &Scene| playable(&case(goal, rules), scene).map_err(|error| error.key);
        for goal in [removed, biopsy] {
            assert_eq!(found(goal, "", &scene), Ok(()), "a loop cuts what is held");
        }
        let monopolar = "[rules]\nenergy = \"monopolar\"";
        assert_eq!(found(removed, monopolar, &scene), Err("goal[0].removed".to_owned()), "in saline");
        scene.rigid[0] = toml::from_str("name = \"forceps\"\njaws = { mesh = \"jaw.obj\" }").unwrap();
        for (goal, key) in [(removed, "goal[0].removed"), (biopsy, "goal[0].biopsy")] {
            assert_eq!(found(goal, "", &scene), Err(key.to_owned()), "the polyp hangs on its wall");
        }
        let polyp = scene.deformable.iter_mut().find(|object| object.kind == DeformableKind::Pathology).unwrap();
        (polyp.attach_to, polyp.fixed) = (None, Some(Vec::new()));
        assert_eq!(found(removed, monopolar, &scene), Ok(()), "what is free is brought out without current");
        assert_eq!(found(biopsy, "", &scene), Err("goal[0].biopsy".to_owned()));
    }

    /// A goal that asked for it was accepted, and no session could reach it.
    #[test]
    fn a_bleeding_is_staunched_only_where_vessels_can_bleed_whatever_is_drawn() {
        let staunch = "staunch = { after_ml = 0.2, below_ml_min = 1.0, for_s = 5.0 }";
        let mut scene = Scene::embedded_default().unwrap();
        let mut found = |vary: &str, pressure_pa: f64, conductance_ml_s_pa: f64| {
            (scene.vessels.pressure_pa, scene.vessels.conductance_ml_s_pa) = (pressure_pa, conductance_ml_s_pa);
            let vary = format!("[[vary]]\n{vary}");
            assert_eq!(playable(&case("removed = { percent = 5.0 }", &vary), &scene), Ok(()), "no other goal needs vessels");
            playable(&case(staunch, &vary), &scene).map_err(|error| error.key)
        };
        let refused = Err("goal[0].staunch".to_owned());
        let of_scene = "vessel_spacing_m = [0.003, 0.004]";
        assert_eq!(found(of_scene, 12_000.0, 1e-5), Ok(()));
        assert_eq!([found(of_scene, 12_000.0, 0.0), found(of_scene, 1_900.0, 1e-5)], [refused.clone(), refused.clone()]);
        assert_eq!(found("vessel_pressure_pa = [1e3, 12e3]", 12_000.0, 1e-5), refused, "by some of its seeds");
        assert_eq!(found("vessel_conductance_ml_s_pa = [0.0, 1e-5]", 12_000.0, 1e-5), refused);
        let drawn = "vessel_conductance_ml_s_pa = [1e-6, 1e-5]\nvessel_pressure_pa = [11e3, 12e3]";
        assert_eq!(found(drawn, 0.0, 0.0), Ok(()), "what is drawn counts, not what the scene has");
    }
}
