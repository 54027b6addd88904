//! The cases that come with the station: what their scores ask for in full can be had by who does what their goals ask for.
#![allow(missing_docs)]

use hyst_assessment::{METRICS, Scale};
use hyst_scene::{Case, Goal};
use std::path::{Path, PathBuf};

/// The cases by their names.
fn cases() -> Vec<(String, Case)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/cases");
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    assert!(paths.len() >= 11, "{paths:?}");
    let read = |path: PathBuf| {
        let text = std::fs::read_to_string(&path).unwrap();
        let case = Case::parse(&text, &path.display().to_string()).unwrap_or_else(|error| panic!("{error}"));
        (path.file_stem().unwrap().to_string_lossy().into_owned(), case)
    };
    paths.into_iter().map(read).collect()
}

/// How a case scores a metric; `None` where it weighs nothing, or is only shown.
fn scale(case: &Case, key: &str) -> Option<Scale> {
    let default = METRICS.iter().find(|metric| metric.key == key).unwrap().scale;
    let own = case.score.get(key).copied().unwrap_or_default();
    let weight = own.weight.or(default.map(|scale| scale.weight)).unwrap_or(1.0);
    let ends = own.full.zip(own.none).or(default.map(|scale| (scale.full, scale.none)));
    ends.filter(|_| weight > 0.0).map(|(full, none)| Scale { full, none, weight })
}

/// The largest of what goals ask for, of those that ask for it.
fn most(case: &Case, of: impl Fn(&Goal) -> Option<f64>) -> Option<f64> {
    case.goal.iter().filter_map(of).reduce(f64::max)
}

/// Seconds for which a goal has something held.
fn held_s(goal: &Goal) -> f64 {
    let pressure_s = goal.pressure.as_ref().map_or(0.0, |held| held.for_s);
    let visit_s = goal.visit.as_ref().map_or(0.0, |visit| visit.stay_s * visit.places.len() as f64);
    let look_s = goal.look.as_ref().map_or(0.0, |survey| survey.for_s * survey.places.len() as f64);
    pressure_s + visit_s + look_s + goal.staunch.as_ref().map_or(0.0, |staunch| staunch.for_s)
}

/// A session ends with its goals: who does more than they ask for is not let do it.
#[test]
fn what_is_scored_in_full_is_no_more_than_what_the_goals_ask_for() {
    for (name, case) in cases() {
        assert!(case.end.goals, "{name}");
        if let Some(pathology) = scale(&case, "pathology") {
            let percent = most(&case, |goal| goal.removed.as_ref().map(|removed| removed.percent));
            assert!(percent.is_some_and(|percent| pathology.full <= percent), "{name}: {pathology:?}, of the goals {percent:?}");
        }
        if let Some(time) = scale(&case, "time") {
            let held_s: f64 = case.goal.iter().map(held_s).sum();
            assert!(held_s < time.full && case.end.time_s.is_some_and(|end_s| time.none <= end_s), "{name}: {time:?}");
        }
        let deficit_ml = most(&case, |goal| goal.stop.as_ref().and_then(|stop| stop.deficit_ml));
        let bled_ml = most(&case, |goal| {
            let stop_ml = goal.stop.as_ref().and_then(|stop| stop.bled_ml);
            stop_ml.or(goal.staunch.as_ref().map(|staunch| staunch.after_ml))
        });
        for (key, asked_ml) in [("deficit", deficit_ml), ("bled", bled_ml)] {
            let Some((scale, asked_ml)) = scale(&case, key).zip(asked_ml) else { continue };
            assert!(asked_ml <= scale.full, "{name}: {key}: {scale:?}, and what a goal waits for is {asked_ml} ml");
        }
    }
}

/// What a way through the cavity spans, m: the diagonal of the box from the canal to before the fundus and to both sides (assumed; economy is that by the path).
const SPAN_M: f64 = 0.042;

/// The economy of a path is what it spans by its length: one that is scored in full is to have it scored in full, and one that is not short has some of it left.
#[test]
fn who_has_a_path_that_is_scored_in_full_has_the_economy_for_it() {
    let mut both = 0;
    for (name, case) in cases() {
        let Some((path, economy)) = scale(&case, "path").zip(scale(&case, "economy")) else { continue };
        let percent = |path_m: f64| 100.0 * SPAN_M / path_m;
        assert!(
            economy.full <= percent(path.full) + 1e-9,
            "{name}: {economy:?}, of a path of {} m {}",
            path.full,
            percent(path.full)
        );
        assert!(
            economy.none <= percent(path.none) + 1e-9,
            "{name}: {economy:?}, of a path of {} m {}",
            path.none,
            percent(path.none)
        );
        both += 1;
    }
    assert!(both >= 9, "{both} cases weigh both");
}

/// Who takes a chip and goes home has less than who has taken half of it off.
#[test]
fn the_resection_weighs_more_than_all_that_comes_before_it() {
    for (name, case) in cases().into_iter().filter(|(name, _)| ["polyp", "myoma", "septum"].contains(&name.as_str())) {
        let weight = |is_removed: bool| -> f64 {
            let goals = case.goal.iter().filter(|goal| goal.removed.is_some() == is_removed);
            goals.map(|goal| goal.weight.unwrap_or(1.0)).sum()
        };
        let (removed, others) = (weight(true), weight(false));
        assert!(removed > others, "{name}: {removed} of the resection, {others} of the rest");
    }
}
