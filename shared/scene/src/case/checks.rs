//! What the text of a case alone can show to be wrong: figures out of range, names of nothing, goals that the rest of the case rules out.

use super::brief::{MAX_PRESSURE_PA, deficit_limit_ml};
use super::file::{Alarm, Case, Goal, Held, Place, Rules, Score, Stop, Survey, Vary, Visit, Warning};
use super::metrics::METRIC_KEYS;
use crate::error::{SceneError, SceneErrorKind as Kind};
use crate::file::Hand;
use crate::validate::{Checked, coordinate, one_of, range};
use std::collections::BTreeMap;

/// Most entries of each list: each is looked at in every tick of a session.
const MAX_ENTRIES: usize = 32;
/// Longest task, and longest other text, in bytes: they are shown on one page.
const MAX_TASK_BYTES: usize = 2_000;
const MAX_WORDS_BYTES: usize = 160;
/// Least volume, ml, and longest time, s.
const LEAST_ML: f64 = 1e-4;
const DAY_S: f64 = 86_400.0;

pub(crate) fn wrong(kind: Kind, key: impl Into<String>, what: impl Into<String>, cure: &str) -> Checked {
    Err(SceneError::new(kind, key, what, cure))
}

/// What the text alone can show.
pub(crate) fn alone(case: &Case) -> Checked {
    words("name", &case.name, MAX_WORDS_BYTES)?;
    words("task", &case.task, MAX_TASK_BYTES)?;
    if case.scene.trim().is_empty() {
        return wrong(Kind::Incomplete, "scene", "is empty", "name a scene (.toml) or a mesh");
    }
    let counts =
        [("vary", case.vary.len()), ("place", case.place.len()), ("goal", case.goal.len()), ("warning", case.warning.len())];
    for (key, count) in counts {
        range(key, count as f64, 0.0, MAX_ENTRIES as f64, "entries")?;
    }
    if case.goal.is_empty() {
        return wrong(
            Kind::Incomplete,
            "goal",
            "the case has no goal",
            "add a [[goal]] table, for example removed = { percent = 90 }",
        );
    }
    case.vary.iter().enumerate().try_for_each(|(index, vary)| variation(vary, &format!("vary[{index}]")))?;
    if let Some((index, _)) = case.vary.iter().enumerate().filter(|(_, vary)| vary.object.is_none()).nth(1) {
        return wrong(
            Kind::Name,
            format!("vary[{index}]"),
            "is the second without an object",
            "put both into one [[vary]] table",
        );
    }
    rules(&case.rules)?;
    end(case)?;
    case.place.iter().enumerate().try_for_each(|(index, one)| place(case, one, index))?;
    case.goal.iter().enumerate().try_for_each(|(index, one)| goal(case, one, &format!("goal[{index}]")))?;
    case.warning.iter().enumerate().try_for_each(|(index, one)| warning(case, one, &format!("warning[{index}]")))?;
    case.hand.iter().try_for_each(|(name, hand)| waiting(case, hand, &format!("hand.{name}")))?;
    scores(&case.score)
}

fn words(key: &str, text: &str, most: usize) -> Checked {
    let bad = text.trim().is_empty() || text.len() > most || text.chars().any(|letter| letter.is_control() && letter != '\n');
    if bad {
        return wrong(Kind::Name, key, format!("a text has 1 to {most} bytes and no control characters"), "write it shorter");
    }
    Ok(())
}

fn variation(vary: &Vary, key: &str) -> Checked {
    let of_object = [
        ("size", vary.size, 0.5, 2.0, ""),
        ("shift_m", vary.shift_m, 0.0, 0.02, "m"),
        ("stiffness", vary.stiffness, 0.1, 10.0, ""),
    ];
    let of_vessels = [
        ("vessel_pressure_pa", vary.vessel_pressure_pa, 0.0, 40_000.0, "Pa"),
        ("vessel_spacing_m", vary.vessel_spacing_m, 5e-4, 0.05, "m"),
        ("vessel_conductance_ml_s_pa", vary.vessel_conductance_ml_s_pa, 0.0, 1e-3, "ml/(s·Pa)"),
    ];
    let (mine, others, form) = match vary.object {
        Some(_) => (of_object, of_vessels, "size, shift_m and stiffness"),
        None => (of_vessels, of_object, "mirror, vessel_pressure_pa, vessel_spacing_m and vessel_conductance_ml_s_pa"),
    };
    let who = if vary.object.is_some() { "with an object" } else { "without an object" };
    if let Some((name, ..)) = others.iter().find(|(_, limits, ..)| limits.is_some()) {
        return wrong(Kind::Range, format!("{key}.{name}"), format!("does not vary {who}"), &format!("{who} there are {form}"));
    }
    if vary.object.is_some() && !vary.mirror.is_empty() {
        let what = "an object is not mirrored by itself, but with the whole anatomy";
        return wrong(Kind::Range, format!("{key}.mirror"), what, "put it into the [[vary]] table without an object");
    }
    if mine.iter().all(|(_, limits, ..)| limits.is_none()) && vary.mirror.is_empty() {
        return wrong(Kind::Incomplete, key, "varies nothing", &format!("{who} give one of {form}"));
    }
    for (name, limits, low, high, unit) in mine {
        let Some([least, most]) = limits else { continue };
        ordered(&format!("{key}.{name}"), [least, most], [low, high], unit)?;
    }
    Ok(())
}

/// Two values in a range, the lower first; they may be equal.
fn ordered(key: &str, [least, most]: [f64; 2], [low, high]: [f64; 2], unit: &str) -> Checked {
    range(key, least, low, high, unit)?;
    range(key, most, low, high, unit)?;
    if least > most {
        return wrong(
            Kind::Range,
            key,
            format!("the lower value {least} is above the upper value {most}"),
            "write [lowest, highest]",
        );
    }
    Ok(())
}

fn rules(rules: &Rules) -> Checked {
    range("rules.set_pressure_pa", rules.set_pressure_pa.unwrap_or(0.0), 0.0, 20_000.0, "Pa")?;
    range("rules.max_pressure_pa", rules.max_pressure_pa.unwrap_or(MAX_PRESSURE_PA), 1_000.0, 20_000.0, "Pa")?;
    let most_pa = rules.max_pressure_pa.unwrap_or(MAX_PRESSURE_PA);
    if let Some(set_pa) = rules.set_pressure_pa.filter(|set_pa| *set_pa > most_pa) {
        let what = format!("{set_pa} Pa is above the highest pressure of the rules, {most_pa} Pa");
        return wrong(Kind::Contradiction, "rules.set_pressure_pa", what, "set a lower pressure, or allow a higher one");
    }
    let limit_ml = rules.medium.map_or(2_500.0, deficit_limit_ml);
    range("rules.max_deficit_ml", rules.max_deficit_ml.unwrap_or(limit_ml), 1.0, limit_ml, "ml")
}

fn place(case: &Case, place: &Place, index: usize) -> Checked {
    let key = format!("place[{index}]");
    words(&format!("{key}.name"), &place.name, MAX_WORDS_BYTES)?;
    if case.place[..index].iter().any(|before| before.name == place.name) {
        return wrong(Kind::Name, format!("{key}.name"), format!("two places are named “{}”", place.name), "rename one of them");
    }
    one_of(
        &key,
        &[
            ("centre_m", place.centre_m.is_some()),
            ("object", place.object.is_some()),
            ("insertion_m", place.insertion_m.is_some()),
        ],
    )?;
    for (name, length, of, is_of) in [
        ("radius_m", place.radius_m, "centre_m", place.centre_m.is_some()),
        ("within_m", place.within_m, "object", place.object.is_some()),
    ] {
        match length {
            Some(length_m) if is_of => range(format!("{key}.{name}"), length_m, 0.000_5, 0.05, "m")?,
            Some(_) => return wrong(Kind::Range, format!("{key}.{name}"), format!("goes with {of} alone"), "remove it"),
            None if is_of => return wrong(Kind::Incomplete, key, format!("{of} needs {name}"), "give both"),
            None => {}
        }
    }
    for centre_m in place.centre_m.into_iter().flatten() {
        coordinate(format!("{key}.centre_m"), centre_m)?;
    }
    place.insertion_m.map_or(Ok(()), |limits| ordered(&format!("{key}.insertion_m"), limits, [0.0, 0.5], "m"))
}

fn goal(case: &Case, goal: &Goal, key: &str) -> Checked {
    goal.words.as_ref().map_or(Ok(()), |text| words(&format!("{key}.words"), text, MAX_WORDS_BYTES))?;
    one_of(
        key,
        &[
            ("removed", goal.removed.is_some()),
            ("biopsy", goal.biopsy.is_some()),
            ("pressure", goal.pressure.is_some()),
            ("visit", goal.visit.is_some()),
            ("look", goal.look.is_some()),
            ("stop", goal.stop.is_some()),
            ("staunch", goal.staunch.is_some()),
        ],
    )?;
    let within = |name: &str, value: f64, low: f64, high: f64, unit: &str| range(format!("{key}.{name}"), value, low, high, unit);
    within("weight", goal.weight.unwrap_or(1.0), 0.1, 100.0, "")?;
    if let Some(removed) = &goal.removed {
        within("removed.percent", removed.percent, 0.1, 100.0, "%")?;
    }
    if let Some(biopsy) = &goal.biopsy {
        within("biopsy.at_least_ml", biopsy.at_least_ml, LEAST_ML, 1_000.0, "ml")?;
    }
    if let Some(held) = &goal.pressure {
        holding(case, held, &format!("{key}.pressure"))?;
    }
    if let Some(visit) = &goal.visit {
        visiting(case, visit, &format!("{key}.visit"))?;
    }
    if let Some(survey) = &goal.look {
        surveying(case, survey, &format!("{key}.look"))?;
    }
    if let Some(stop) = &goal.stop {
        stopping(case, stop, &format!("{key}.stop"))?;
    }
    staunching(case, goal, key)
}

fn holding(case: &Case, held: &Held, key: &str) -> Checked {
    range(format!("{key}.from_pa"), held.from_pa, 0.0, 20_000.0, "Pa")?;
    range(format!("{key}.to_pa"), held.to_pa, 0.0, 20_000.0, "Pa")?;
    range(format!("{key}.for_s"), held.for_s, 0.1, 3_600.0, "s")?;
    if held.from_pa >= held.to_pa {
        let what = format!("the lower pressure {} Pa is not below the upper one, {} Pa", held.from_pa, held.to_pa);
        return wrong(Kind::Contradiction, format!("{key}.from_pa"), what, "exchange them, or widen the band");
    }
    let most_pa = case.rules.max_pressure_pa.unwrap_or(MAX_PRESSURE_PA);
    if held.to_pa > most_pa {
        let what = format!("{} Pa is above the highest pressure of the rules, {most_pa} Pa", held.to_pa);
        return wrong(Kind::Contradiction, format!("{key}.to_pa"), what, "lower the band, or set rules.max_pressure_pa");
    }
    in_time(case, &format!("{key}.for_s"), held.for_s)
}

fn visiting(case: &Case, visit: &Visit, key: &str) -> Checked {
    range(format!("{key}.places"), visit.places.len() as f64, 1.0, MAX_ENTRIES as f64, "places")?;
    range(format!("{key}.stay_s"), visit.stay_s, 0.0, 60.0, "s")?;
    visit.places.iter().try_for_each(|name| is_placed(case, &format!("{key}.places"), name))?;
    in_time(case, &format!("{key}.stay_s"), visit.stay_s * visit.places.len() as f64)
}

fn surveying(case: &Case, survey: &Survey, key: &str) -> Checked {
    let places = &survey.places;
    range(format!("{key}.places"), places.len() as f64, 1.0, MAX_ENTRIES as f64, "places")?;
    range(format!("{key}.for_s"), survey.for_s, 0.0, 60.0, "s")?;
    range(format!("{key}.within_m"), survey.within_m, 0.001, 0.1, "m")?;
    let key_of_places = format!("{key}.places");
    for (index, name) in places.iter().enumerate() {
        is_placed(case, &key_of_places, name)?;
        if places[..index].contains(name) {
            return wrong(Kind::Name, key_of_places, format!("“{name}” is looked at twice"), "name each landmark once");
        }
        if case.place.iter().any(|place| place.name == *name && place.insertion_m.is_some()) {
            let what = format!("“{name}” is a range of the insertion and has no middle to look at");
            return wrong(Kind::Range, key_of_places, what, "name a place with centre_m or object");
        }
    }
    in_time(case, &format!("{key}.for_s"), survey.for_s)
}

/// Whether a place of the case has this name.
fn is_placed(case: &Case, key: &str, name: &str) -> Checked {
    if case.place.iter().any(|place| place.name == name) {
        return Ok(());
    }
    let known: Vec<&str> = case.place.iter().map(|place| place.name.as_str()).collect();
    wrong(Kind::Name, key, format!("no [[place]] is named “{name}”; there are: {}", known.join(", ")), "name one of these")
}

fn staunching(case: &Case, goal: &Goal, key: &str) -> Checked {
    let Some(staunch) = &goal.staunch else { return Ok(()) };
    range(format!("{key}.staunch.after_ml"), staunch.after_ml, LEAST_ML, 5_000.0, "ml")?;
    range(format!("{key}.staunch.below_ml_min"), staunch.below_ml_min, 0.0, 1_000.0, "ml/min")?;
    range(format!("{key}.staunch.for_s"), staunch.for_s, 1.0, 600.0, "s")?;
    ruled_out(&format!("{key}.staunch.after_ml"), staunch.after_ml, "bled_ml", case.end.bled_ml)?;
    in_time(case, &format!("{key}.staunch.for_s"), staunch.for_s)
}

fn stopping(case: &Case, stop: &Stop, key: &str) -> Checked {
    one_of(
        key,
        &[("alarm", stop.alarm.is_some()), ("deficit_ml", stop.deficit_ml.is_some()), ("bled_ml", stop.bled_ml.is_some())],
    )?;
    range(format!("{key}.within_s"), stop.within_s, 0.1, 600.0, "s")?;
    if let Some(deficit_ml) = stop.deficit_ml {
        range(format!("{key}.deficit_ml"), deficit_ml, LEAST_ML, 5_000.0, "ml")?;
        ruled_out(&format!("{key}.deficit_ml"), deficit_ml, "deficit_ml", case.end.deficit_ml)?;
    }
    if let Some(bled_ml) = stop.bled_ml {
        range(format!("{key}.bled_ml"), bled_ml, LEAST_ML, 5_000.0, "ml")?;
        ruled_out(&format!("{key}.bled_ml"), bled_ml, "bled_ml", case.end.bled_ml)?;
    }
    if stop.alarm == Some(Alarm::Perforation) && case.end.perforation {
        let what = "the session ends with the perforation that it waits for";
        return wrong(Kind::Contradiction, format!("{key}.alarm"), what, "set end.perforation = false, or remove the goal");
    }
    Ok(())
}

/// What a goal waits for does not come if the session ends before.
fn ruled_out(key: &str, value: f64, end: &str, limit: Option<f64>) -> Checked {
    match limit {
        Some(limit) if value >= limit => {
            let what = format!("{value} ml is not reached: the session ends at end.{end} = {limit}");
            wrong(Kind::Contradiction, key, what, "give less, or let the session end later")
        }
        _ => Ok(()),
    }
}

/// Goals that take longer than the session may last are never reached.
fn in_time(case: &Case, key: &str, for_s: f64) -> Checked {
    match case.end.time_s {
        Some(time_s) if for_s >= time_s => {
            let what = format!("takes {for_s} s, and the session ends after end.time_s = {time_s}");
            wrong(Kind::Contradiction, key, what, "ask for less time, or let the session end later")
        }
        _ => Ok(()),
    }
}

/// What a trainee waits for comes before the session ends.
fn waiting(case: &Case, hand: &Hand, key: &str) -> Checked {
    for (index, change) in hand.change.iter().enumerate() {
        let Some(after) = &change.after else { continue };
        let key = format!("{key}.change[{index}].after");
        let (deficit_ml, bled_ml) = (after.deficit_above_ml, after.bled_above_ml);
        deficit_ml.map_or(Ok(()), |ml| ruled_out(&format!("{key}.deficit_above_ml"), ml, "deficit_ml", case.end.deficit_ml))?;
        bled_ml.map_or(Ok(()), |ml| ruled_out(&format!("{key}.bled_above_ml"), ml, "bled_ml", case.end.bled_ml))?;
        if after.alarm == Some(Alarm::Perforation) && case.end.perforation {
            let what = "the session ends with the perforation that it waits for";
            return wrong(Kind::Contradiction, format!("{key}.alarm"), what, "set end.perforation = false");
        }
    }
    Ok(())
}

fn end(case: &Case) -> Checked {
    let end = &case.end;
    range("end.time_s", end.time_s.unwrap_or(1.0), 1.0, DAY_S, "s")?;
    range("end.deficit_ml", end.deficit_ml.unwrap_or(1.0), LEAST_ML, 5_000.0, "ml")?;
    range("end.bled_ml", end.bled_ml.unwrap_or(1.0), LEAST_ML, 5_000.0, "ml")
}

fn warning(case: &Case, warning: &Warning, key: &str) -> Checked {
    warning.words.as_ref().map_or(Ok(()), |text| words(&format!("{key}.words"), text, MAX_WORDS_BYTES))?;
    let end = &case.end;
    let figures = [
        ("pressure_above_pa", warning.pressure_above_pa, 0.0, 20_000.0, "Pa", None),
        ("pressure_below_pa", warning.pressure_below_pa, 0.0, 20_000.0, "Pa", None),
        ("deficit_above_ml", warning.deficit_above_ml, LEAST_ML, 5_000.0, "ml", end.deficit_ml),
        ("bled_above_ml", warning.bled_above_ml, LEAST_ML, 5_000.0, "ml", end.bled_ml),
        ("force_above_n", warning.force_above_n, 0.01, 20.0, "N", None),
        ("time_above_s", warning.time_above_s, 1.0, DAY_S, "s", end.time_s),
    ];
    let given = figures.iter().map(|(name, value, ..)| (*name, value.is_some()));
    let others = [("alarm", warning.alarm.is_some()), ("current_in", warning.current_in.is_some())];
    one_of(key, &given.chain(others).collect::<Vec<_>>())?;
    warning.current_in.as_ref().map_or(Ok(()), |name| is_placed(case, &format!("{key}.current_in"), name))?;
    for (name, value, low, high, unit, ends_at) in figures {
        let Some(value) = value else { continue };
        range(format!("{key}.{name}"), value, low, high, unit)?;
        if let Some(ends_at) = ends_at.filter(|ends_at| value >= *ends_at) {
            let what = format!("the session ends before, at {ends_at} {unit}");
            return wrong(Kind::Contradiction, format!("{key}.{name}"), what, "warn earlier, or let the session end later");
        }
    }
    Ok(())
}

fn scores(scores: &BTreeMap<String, Score>) -> Checked {
    for (name, score) in scores {
        let key = format!("score.{name}");
        let Some((_, has_scale)) = METRIC_KEYS.iter().find(|(known, _)| known == name) else {
            let known: Vec<&str> = METRIC_KEYS.iter().map(|(known, _)| *known).collect();
            return wrong(
                Kind::UnknownKey,
                key,
                format!("no metric has this key; there are: {}", known.join(", ")),
                "name one of these",
            );
        };
        range(format!("{key}.weight"), score.weight.unwrap_or(1.0), 0.0, 100.0, "")?;
        match (score.full, score.none) {
            (Some(full), Some(none)) if full == none => {
                return wrong(Kind::Contradiction, format!("{key}.full"), "full and none are the same value", "set them apart");
            }
            (Some(full), Some(none)) => {
                range(format!("{key}.full"), full, -1e9, 1e9, "")?;
                range(format!("{key}.none"), none, -1e9, 1e9, "")?;
            }
            (None, None) if *has_scale => {}
            (None, None) => return wrong(Kind::Incomplete, key, "this metric has no scale by default", "give full and none"),
            _ => return wrong(Kind::Incomplete, key, "only one of full and none is given", "give both, or none for the default"),
        }
    }
    let weighs = |(name, _): &(&str, bool)| scores.get(*name).and_then(|score| score.weight).is_none_or(|weight| weight > 0.0);
    if !METRIC_KEYS.iter().filter(|(_, has_scale)| *has_scale).any(weighs) {
        return wrong(Kind::Contradiction, "score", "no metric weighs anything", "give one a weight above 0");
    }
    Ok(())
}
