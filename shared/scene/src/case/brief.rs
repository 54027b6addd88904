//! A case as it is judged: names are places, percents have their millilitres, defaults are figures. A station and its recording carry it, so whoever judges
//! a session needs neither the file nor a mesh.

use super::file::{Alarm, Case, End, Energy, Goal, Rung, Score, Stop, Survey, Warning};
use crate::error::{SceneError, SceneErrorKind as Kind};
use crate::file::{DeformableKind, View};
use crate::fluid::{Medium, PA_PER_MMHG};
use crate::loaded::{LoadedDeformable, LoadedScene};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Highest pressure where a case says nothing, Pa: 100 mmHg, a mean arterial pressure, below which to stay (ACOG Committee Opinion 800).
pub(crate) const MAX_PRESSURE_PA: f64 = 13_332.2;
/// Pathology counts as in view from no farther than this, m: what rigid optics are designed for, as of a landmark where a case says nothing.
const IN_VIEW_M: f64 = 0.025;

/// What the pump allows to be missing of a medium, ml (ACOG Committee Opinion 800).
pub(crate) fn deficit_limit_ml(medium: Medium) -> f64 {
    match medium {
        Medium::Saline => 2_500.0,
        Medium::Glycine | Medium::Sorbitol => 1_000.0,
    }
}

/// Where a current does not work in a medium: what the trainee is warned of, what is wrong with a goal that needs the loop, and what to do.
pub(crate) fn misfit(energy: Energy, medium: Medium) -> Option<[&'static str; 3]> {
    match (energy, medium) {
        (Energy::Bipolar, Medium::Saline) | (Energy::Monopolar, Medium::Glycine | Medium::Sorbitol) => None,
        (Energy::Monopolar, Medium::Saline) => Some([
            "monopolar current in saline: it conducts",
            "needs another medium: saline conducts monopolar current away",
            "set rules.energy = \"bipolar\", or rules.medium = \"glycine\"",
        ]),
        (Energy::Bipolar, Medium::Glycine | Medium::Sorbitol) => Some([
            "bipolar current in a medium without salt: it does not conduct",
            "needs another medium: bipolar current flows through saline alone",
            "set rules.energy = \"monopolar\", or rules.medium = \"saline\"",
        ]),
    }
}

/// A case with the anatomy of one seed, ready to be judged by.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Brief {
    /// Name of the case.
    pub name: String,
    /// Rung of the ladder.
    pub rung: Rung,
    /// The task in words.
    pub task: String,
    /// What the anatomy was drawn from.
    pub seed: u32,
    /// What was drawn, a sentence each.
    pub drawn: Vec<String>,
    /// Volume of what is to be removed at the beginning, ml: [`LoadedScene::pathology_ml`].
    pub pathology_ml: f64,
    /// Middles of all pathology at the beginning, m; none in a recording of before they were noted.
    #[serde(default)]
    pub pathologies_m: Vec<[f64; 3]>,
    /// What of it counts as in view.
    #[serde(default)]
    pub pathology_sight: Sight,
    /// Goals, in the file's order.
    pub goals: Vec<Asked>,
    /// What ends the session.
    pub end: End,
    /// Warnings: those of the rules, then the file's.
    pub warnings: Vec<Warned>,
    /// Weights and scales of metrics.
    pub score: BTreeMap<String, Score>,
}

impl Brief {
    /// The deficit that is allowed, ml: of what the rules warn of, what calls for a stop, and what ends the session, the least. What else is warned of on the
    /// way there, or only told, limits nothing.
    pub fn deficit_allowed_ml(&self) -> Option<f64> {
        let above = |cause: &Cause| if let Cause::DeficitAbove(ml) = cause { Some(*ml) } else { None };
        let of_rules = self.warnings.iter().find_map(|warning| above(&warning.is)); // theirs come first
        let stops = self.goals.iter().filter_map(|goal| if let Aim::Stop { after, .. } = &goal.is { above(after) } else { None });
        stops.chain(of_rules).chain(self.end.deficit_ml).reduce(f64::min)
    }
}

/// Something with its words.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Named<T> {
    /// As the trainee reads it.
    pub words: String,
    /// What it is.
    pub is: T,
}

/// A goal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Asked {
    /// As the trainee reads it.
    pub words: String,
    /// What it asks for.
    pub is: Aim,
    /// What it counts beside the others; 1 in a recording of before they had weights.
    #[serde(default = "one")]
    pub weight: f64,
}

fn one() -> f64 {
    1.0
}

/// Something that is warned of, or only told.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Warned {
    /// As the trainee reads it.
    pub words: String,
    /// What calls for it.
    pub is: Cause,
    /// Whether the case has it as a notice; none in a recording of before there were any.
    #[serde(default)]
    pub notice: bool,
}

/// What a goal asks for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Aim {
    /// So much pathology removed, ml.
    Removed(f64),
    /// A piece of so much that comes free, ml.
    Piece(f64),
    /// The pressure within two values, Pa, for so long, ticks.
    Pressure {
        /// Lowest and highest.
        band_pa: [f64; 2],
        /// Ticks without a break.
        ticks: u64,
    },
    /// The tip in places, in order.
    Visit {
        /// The places.
        places: Vec<Named<Region>>,
        /// Ticks in each without a break.
        stay_ticks: u64,
    },
    /// Landmarks in the inner part of the picture, in any order.
    Look {
        /// Where they are, m.
        landmarks: Vec<Named<[f64; 3]>>,
        /// What counts as seen.
        sight: Sight,
        /// Ticks for each without a break.
        ticks: u64,
    },
    /// Inflow and current off so soon after a trigger, ticks.
    Stop {
        /// What calls for it.
        after: Cause,
        /// Ticks.
        ticks: u64,
    },
    /// A bleeding below a rate, ml/min, for so long, after so much.
    Staunch {
        /// Blood before it counts.
        after_ml: f64,
        /// Fastest bleeding.
        below_ml_min: f64,
        /// Ticks without a break.
        ticks: u64,
    },
}

/// What counts as seen through the scope.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Sight {
    /// Angle between the scope's axis and the line of sight, towards the scope's +y, rad.
    pub optic_rad: f64,
    /// Largest angle to the line of sight, rad.
    pub within_rad: f64,
    /// Largest distance from the tip, m.
    pub within_m: f64,
}

/// Where the tip is to be.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Region {
    /// A ball: centre and radius, m.
    Ball([f64; 3], f64),
    /// A range of the insertion, m.
    Insertion([f64; 2]),
}

/// What calls for a warning.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// Pressure above this, Pa.
    PressureAbove(f64),
    /// Pressure below this, Pa.
    PressureBelow(f64),
    /// Deficit above this, ml.
    DeficitAbove(f64),
    /// More blood lost than this, ml.
    BledAbove(f64),
    /// Force above this, N.
    ForceAbove(f64),
    /// More time passed than this, ticks.
    TimeAbove(u64),
    /// An alarm of the pump.
    Alarm(Alarm),
    /// Current in the loop, of a kind that is wrong in the medium.
    Current,
    /// Current in the loop while the middle of its ring is there.
    CurrentIn(Region),
}

impl Warned {
    /// A warning of the rules.
    fn of(words: String, is: Cause) -> Warned {
        Warned { words, is, notice: false }
    }

    /// Whether it counts in no score: a notice, or that time has passed, which has a score of its own.
    pub fn is_notice(&self) -> bool {
        self.notice || matches!(self.is, Cause::TimeAbove(_))
    }

    /// What it is, in a word.
    pub fn kind(&self) -> &'static str {
        if self.is_notice() { "notice" } else { "warning" }
    }
}

fn ticks(seconds: f64) -> u64 {
    (seconds * 1e3).round() as u64
}

fn mmhg(pa: f64) -> f64 {
    pa / PA_PER_MMHG
}

/// The case as it is judged in a scene that was drawn for it.
pub(crate) fn brief(case: &Case, scene: &LoadedScene) -> Result<Brief, SceneError> {
    let pathologies = || scene.objects.iter().filter(|object| object.kind == DeformableKind::Pathology);
    let pathology_ml = scene.pathology_ml();
    let goal = |(index, goal): (usize, &Goal)| aim(case, index, goal, scene, pathology_ml);
    let goals = case.goal.iter().enumerate().map(goal).collect::<Result<_, _>>()?;
    let medium = scene.fluid.medium;
    let rules = &case.rules;
    let pressure_pa = rules.max_pressure_pa.unwrap_or(MAX_PRESSURE_PA);
    let deficit_ml = rules.max_deficit_ml.unwrap_or(deficit_limit_ml(medium));
    let mut warnings = vec![
        Warned::of(format!("pressure above {:.0} mmHg", mmhg(pressure_pa)), Cause::PressureAbove(pressure_pa)),
        Warned::of(format!("more than {deficit_ml} ml of medium are missing"), Cause::DeficitAbove(deficit_ml)),
    ];
    if let Some([words, ..]) = misfit(rules.energy, medium) {
        warnings.push(Warned::of(words.to_owned(), Cause::Current));
    }
    warnings.extend(case.warning.iter().filter_map(|one| warning(one, case, scene)));
    Ok(Brief {
        name: case.name.clone(),
        rung: case.rung,
        task: case.task.clone(),
        seed: case.seed,
        drawn: scene.drawn.clone(),
        pathology_ml,
        pathologies_m: pathologies().map(mean_m).collect(),
        pathology_sight: in_picture(&scene.scene.view),
        goals,
        end: case.end.clone(),
        warnings,
        score: case.score.clone(),
    })
}

fn aim(case: &Case, index: usize, goal: &Goal, scene: &LoadedScene, pathology_ml: f64) -> Result<Asked, SceneError> {
    let (words, is) = if let Some(removed) = &goal.removed {
        let words = format!("remove {} % of the pathology", removed.percent);
        (words, Aim::Removed(pathology_ml * removed.percent / 100.0))
    } else if let Some(biopsy) = &goal.biopsy {
        if biopsy.at_least_ml > pathology_ml {
            let what = format!("asks for {} ml, “{}” has {pathology_ml:.3} ml", biopsy.at_least_ml, biopsy.object);
            let key = format!("goal[{index}].biopsy.at_least_ml");
            return Err(SceneError::new(Kind::Contradiction, key, what, "ask for less than the object has at its smallest"));
        }
        (format!("cut a piece of {} ml from the {}", biopsy.at_least_ml, biopsy.object), Aim::Piece(biopsy.at_least_ml))
    } else if let Some(held) = &goal.pressure {
        let words = format!("hold {:.0} to {:.0} mmHg for {} s", mmhg(held.from_pa), mmhg(held.to_pa), held.for_s);
        (words, Aim::Pressure { band_pa: [held.from_pa, held.to_pa], ticks: ticks(held.for_s) })
    } else if let Some(visit) = &goal.visit {
        let places = visit.places.iter().map(|name| region(case, name, scene)).collect();
        (format!("bring the tip to: {}", visit.places.join(", ")), Aim::Visit { places, stay_ticks: ticks(visit.stay_s) })
    } else if let Some(survey) = &goal.look {
        (format!("look at: {}", survey.places.join(", ")), look(case, survey, scene))
    } else if let Some(stop) = &goal.stop {
        let (when, after) = trigger(stop);
        (
            format!("stop inflow and current within {} s of {when}", stop.within_s),
            Aim::Stop { after, ticks: ticks(stop.within_s) },
        )
    } else {
        let staunch = goal.staunch.clone().unwrap_or(super::file::Staunch { after_ml: 0.0, below_ml_min: 0.0, for_s: 0.0 });
        let words = format!("staunch the bleeding: below {} ml/min for {} s", staunch.below_ml_min, staunch.for_s);
        let (after_ml, below_ml_min) = (staunch.after_ml, staunch.below_ml_min);
        (words, Aim::Staunch { after_ml, below_ml_min, ticks: ticks(staunch.for_s) })
    };
    Ok(Asked { words: goal.words.clone().unwrap_or(words), is, weight: goal.weight.unwrap_or(one()) })
}

/// What is seen in the inner half of the picture, no farther than so much, m. That is what is within half of the half angle of view: the lens draws that larger
/// than half, if it distorts at all.
pub(crate) fn sight(view: &View, within_m: f64) -> Sight {
    let [optic_rad, within_rad] = [view.optic_angle_deg, 0.25 * view.field_of_view_deg].map(f64::to_radians);
    Sight { optic_rad, within_rad, within_m }
}

/// What is seen in the whole picture, near enough to be worked on.
fn in_picture(view: &View) -> Sight {
    Sight { within_rad: (0.5 * view.field_of_view_deg).to_radians(), ..sight(view, IN_VIEW_M) }
}

/// Landmarks that the checks have shown to have a middle.
fn look(case: &Case, survey: &Survey, scene: &LoadedScene) -> Aim {
    let middle = |name: &String| match region(case, name, scene) {
        Named { words, is: Region::Ball(centre_m, _) } => Named { words, is: centre_m },
        Named { words, is: Region::Insertion(_) } => Named { words, is: [f64::NAN; 3] },
    };
    let sight = sight(&scene.scene.view, survey.within_m);
    Aim::Look { landmarks: survey.places.iter().map(middle).collect(), sight, ticks: ticks(survey.for_s) }
}

/// A place that the checks have shown to be there.
fn region(case: &Case, name: &str, scene: &LoadedScene) -> Named<Region> {
    let place = case.place.iter().find(|place| place.name == name);
    let is = place.map_or(Region::Insertion([0.0; 2]), |place| match (place.insertion_m, &place.object) {
        (Some(insertion_m), _) => Region::Insertion(insertion_m),
        (None, Some(object)) => Region::Ball(middle_m(scene, object), place.within_m.unwrap_or_default()),
        (None, None) => Region::Ball(place.centre_m.unwrap_or_default(), place.radius_m.unwrap_or_default()),
    });
    Named { words: name.to_owned(), is }
}

/// Where the middle of an object is.
pub(crate) fn middle_m(scene: &LoadedScene, name: &str) -> [f64; 3] {
    scene.objects.iter().find(|object| object.name == name).map_or([0.0; 3], mean_m)
}

/// Mean of an object's nodes.
fn mean_m(object: &LoadedDeformable) -> [f64; 3] {
    let nodes = &object.mesh.positions_m;
    let mut sum_m = [0.0; 3];
    for node in nodes {
        for (sum, coordinate) in sum_m.iter_mut().zip(node) {
            *sum += f64::from(*coordinate);
        }
    }
    sum_m.map(|sum| sum / nodes.len().max(1) as f64)
}

fn trigger(stop: &Stop) -> (String, Cause) {
    match (stop.alarm, stop.deficit_ml) {
        (Some(alarm), _) => (format!("the pump's alarm “{}”", alarm.name()), Cause::Alarm(alarm)),
        (None, Some(deficit_ml)) => (format!("a deficit of {deficit_ml} ml"), Cause::DeficitAbove(deficit_ml)),
        (None, None) => {
            let bled_ml = stop.bled_ml.unwrap_or_default();
            (format!("{bled_ml} ml of blood"), Cause::BledAbove(bled_ml))
        }
    }
}

/// A warning that the checks have shown to have one condition.
fn warning(warning: &Warning, case: &Case, scene: &LoadedScene) -> Option<Warned> {
    let made = [
        warning.pressure_above_pa.map(|pa| (format!("pressure above {:.0} mmHg", mmhg(pa)), Cause::PressureAbove(pa))),
        warning.pressure_below_pa.map(|pa| (format!("pressure below {:.0} mmHg", mmhg(pa)), Cause::PressureBelow(pa))),
        warning.deficit_above_ml.map(|ml| (format!("more than {ml} ml of medium are missing"), Cause::DeficitAbove(ml))),
        warning.bled_above_ml.map(|ml| (format!("more than {ml} ml of blood were lost"), Cause::BledAbove(ml))),
        warning.force_above_n.map(|n| (format!("force above {n} N"), Cause::ForceAbove(n))),
        warning.time_above_s.map(|s| (format!("{s} s have passed"), Cause::TimeAbove(ticks(s)))),
        warning.alarm.map(|alarm| (format!("the pump's alarm “{}”", alarm.name()), Cause::Alarm(alarm))),
        warning.current_in.as_ref().map(|name| (format!("current in: {name}"), Cause::CurrentIn(region(case, name, scene).is))),
    ];
    let (words, is) = made.into_iter().flatten().next()?;
    Some(Warned { words: warning.words.clone().unwrap_or(words), is, notice: warning.notice })
}
