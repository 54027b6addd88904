//! What a case file can say. Each type is one table of the TOML; a missing key takes the default that its comment names.
//!
//! Frame and units are those of a scene: metres, origin at the pivot in the cervix, +z into the uterus. A case names a scene and says what the trainee is
//! to do in it, by which rules, when it is over, and what the scores weigh.

use crate::file::Hand;
use crate::fluid::Medium;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A case: a scene whose anatomy is drawn from a seed, a task in words, and how it is judged.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Case {
    /// Version of this format: 1.
    pub version: u32,
    /// Name of the case, as shown to the trainee.
    pub name: String,
    /// Rung of the ladder.
    pub rung: Rung,
    /// The task in words, as the trainee reads it.
    pub task: String,
    /// The scene (.toml) or mesh, relative to this file's folder.
    pub scene: String,
    /// What the anatomy is drawn from. Default: 0; `--set seed=N` takes another one.
    #[serde(default)]
    pub seed: u32,
    /// What differs from seed to seed. Default: nothing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub vary: Vec<Vary>,
    /// Medium, energy, and how far pressure and deficit may go.
    #[serde(default)]
    pub rules: Rules,
    /// Places that goals name.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub place: Vec<Place>,
    /// What is to be reached: at least one.
    #[serde(default)]
    pub goal: Vec<Goal>,
    /// What ends the session.
    #[serde(default)]
    pub end: End,
    /// What the trainee is warned of, beside the rules.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warning: Vec<Warning>,
    /// Metrics whose weight or scale is another one than the default, by their key in a report (`hystation report --json`).
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub score: BTreeMap<String, Score>,
    /// Scripted hands by name, beside those of the scene: trainees who do the task, well or badly.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub hand: BTreeMap<String, Hand>,
}

/// The rungs of the ladder, and the complications.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Rung {
    /// Distend gently, enter, come back.
    Access,
    /// Hold the pressure.
    Distension,
    /// Bring the tip to places.
    Navigation,
    /// Take a piece.
    Biopsy,
    /// Remove a polyp.
    Polyp,
    /// Bring out what was cut off.
    Retrieval,
    /// Remove a myoma.
    Myoma,
    /// Divide a septum.
    Septum,
    /// A complication: the wall is pierced.
    Perforation,
    /// A complication: it bleeds more than it should.
    Bleeding,
    /// A complication: medium enters the vessels.
    FluidOverload,
}

/// What is drawn from the seed: a lowest and a highest value each, between which all are as likely. With `object` its size, shift and stiffness, without
/// it the vessels, and whether the whole anatomy is mirrored.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Vary {
    /// A deformable of the scene.
    pub object: Option<String>,
    /// Factor of its size about its root in the wall, 0.5 to 2; of an attached object alone.
    pub size: Option<[f64; 2]>,
    /// How far it sits from where the scene has it, along the wall, in a direction that is drawn too: 0 to 20 mm; of an attached object alone.
    pub shift_m: Option<[f64; 2]>,
    /// Factor of its Young's modulus, 0.1 to 10.
    pub stiffness: Option<[f64; 2]>,
    /// Pressure in the vessels, 0 to 40 kPa.
    pub vessel_pressure_pa: Option<[f64; 2]>,
    /// Edge of the cubes with one vessel each, 0.5 to 50 mm: small ones make it dense.
    pub vessel_spacing_m: Option<[f64; 2]>,
    /// Flow out of the widest vessel for each Pa, 0 to 1e-3 ml/(s·Pa).
    pub vessel_conductance_ml_s_pa: Option<[f64; 2]>,
    /// Ways in which every second seed mirrors the scene, organ, pathology, places and scripted hands together. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub mirror: Vec<Mirror>,
}

/// A way in which a scene is mirrored, about a plane through its pivot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Mirror {
    /// Left for right: what hangs on one side of the patient hangs on the other.
    Side,
    /// Anterior for posterior. The scripted hands are rolled by half a turn, so none that moves by itself may roll to both sides.
    Wall,
}

/// Current in the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Energy {
    /// Both poles in the loop: the current flows through the medium between them, so it needs saline.
    #[default]
    Bipolar,
    /// The other pole is a plate on the skin: saline conducts it away, so it needs a medium without salt.
    Monopolar,
}

/// What the camera head does when the scope turns about its axis in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CameraHead {
    /// The horizon is kept: the head stays upright by itself.
    #[default]
    Held,
    /// It goes along with the scope, and the picture turns, until whoever has mouse, keys or pad turns it back. A script's horizon is kept, and a driver has a
    /// camera head of its own, or one that is kept level.
    Free,
}

/// Medium and energy, the camera head, and how far pressure and deficit may go. Whoever goes further is warned.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Rules {
    /// The medium. Default: the scene's.
    pub medium: Option<Medium>,
    /// The current. Default: bipolar. Monopolar current in saline and bipolar current in any other medium are wrong: they are warned of, and no goal may need them.
    pub energy: Energy,
    /// The camera head. Default: held.
    pub camera: CameraHead,
    /// Set pressure of the pump at the beginning, 0 to 20 kPa. Default: the scene's.
    pub set_pressure_pa: Option<f64>,
    /// Highest pressure in the cavity, 1 to 20 kPa. Default: 13.3 kPa (100 mmHg), a mean arterial pressure.
    pub max_pressure_pa: Option<f64>,
    /// Largest deficit: at most what the pump allows for the medium, which is the default: 1 000 ml of hypotonic, 2 500 ml of isotonic medium.
    pub max_deficit_ml: Option<f64>,
}

/// A named place: a ball (`centre_m` and `radius_m`), the neighbourhood of an object (`object` and `within_m`), or a range of the insertion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Place {
    /// Its name.
    pub name: String,
    /// Centre of a ball.
    pub centre_m: Option<[f64; 3]>,
    /// Its radius, 0.5 to 50 mm.
    pub radius_m: Option<f64>,
    /// A deformable of the scene, where it is drawn to be.
    pub object: Option<String>,
    /// Largest distance of the tip from the middle of the object, 0.5 to 50 mm.
    pub within_m: Option<f64>,
    /// Shortest and longest insertion, pivot to tip.
    pub insertion_m: Option<[f64; 2]>,
}

/// What is to be reached: one of the tables below, and what it counts.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Goal {
    /// In words. Default: made from the figures.
    pub words: Option<String>,
    /// So much of the pathology is removed.
    pub removed: Option<Removed>,
    /// A piece is cut from an object.
    pub biopsy: Option<Biopsy>,
    /// The pressure is held.
    pub pressure: Option<Held>,
    /// The tip is brought to places.
    pub visit: Option<Visit>,
    /// Landmarks are looked at.
    pub look: Option<Survey>,
    /// Inflow and current are stopped when something goes wrong.
    pub stop: Option<Stop>,
    /// A bleeding is staunched.
    pub staunch: Option<Staunch>,
    /// What it counts beside the other goals, 0.1 to 100. Default: 1.
    pub weight: Option<f64>,
}

/// So much of what is to be removed is removed: of all pathology of the scene, cut free or burnt by the loop; where the instrument has jaws, which cut nothing,
/// of what of it lies free from the beginning, brought out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Removed {
    /// Share of its volume at the beginning, above 0 to 100 %.
    pub percent: f64,
}

/// A piece of at least so much comes free. What the loop burns is no piece, nor is a loose one that is brought out. A recording counts what is removed of all
/// pathology together, so the object is the only one of its scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Biopsy {
    /// The pathology from which it is cut.
    pub object: String,
    /// Least volume of the piece, above 0 ml.
    pub at_least_ml: f64,
}

/// The pressure in the cavity stays within two values for a time, without a break.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Held {
    /// Lowest pressure, 0 to 20 kPa.
    pub from_pa: f64,
    /// Highest pressure, above the lowest and at most the highest that the rules allow.
    pub to_pa: f64,
    /// For so long, 0.1 to 3 600 s.
    pub for_s: f64,
}

/// The tip is brought to places, one after the other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Visit {
    /// Names of places, in their order: 1 to 32.
    pub places: Vec<String>,
    /// It stays in each for so long without a break, 0 to 60 s. Default: 0, it passes.
    #[serde(default)]
    pub stay_s: f64,
}

/// Landmarks are brought into the inner half of the picture, in any order: near enough, with light, and the walls apart. What is between the lens and a
/// landmark is not looked at.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Survey {
    /// Names of places with a middle (`centre_m` or `object`), each once: 1 to 32.
    pub places: Vec<String>,
    /// Each is looked at for so long without a break, 0 to 60 s. Default: 0.5 s.
    #[serde(default = "look_s")]
    pub for_s: f64,
    /// From no farther than this, 1 to 100 mm. Default: 25 mm, for which rigid optics are designed.
    #[serde(default = "look_within_m")]
    pub within_m: f64,
}

fn look_s() -> f64 {
    0.5
}

fn look_within_m() -> f64 {
    0.025
}

/// After an alarm of the pump, or a deficit, or a loss of blood, the inflow is shut and the current is off, within a time. One trigger, which ends the goals that are open.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Stop {
    /// An alarm of the pump.
    pub alarm: Option<Alarm>,
    /// A deficit, above 0 ml.
    pub deficit_ml: Option<f64>,
    /// Blood in the cavity, above 0 ml.
    pub bled_ml: Option<f64>,
    /// So soon after it, 0.1 to 600 s.
    pub within_s: f64,
}

/// After so much blood, it bleeds no faster than this for a time without a break.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Staunch {
    /// So much has bled before it counts, above 0 ml.
    pub after_ml: f64,
    /// It bleeds no faster than this, 0 to 1 000 ml/min.
    pub below_ml_min: f64,
    /// For so long, 1 to 600 s.
    pub for_s: f64,
}

/// The pump's alarms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Alarm {
    /// The pressure is above the set one.
    Pressure,
    /// More medium is missing than may be.
    Deficit,
    /// Much of it goes where it should not.
    AbnormalLoss,
    /// More is lost than vessels and sheath take.
    Perforation,
    /// The container is to be changed.
    ContainerChange,
}

/// What ends the session: what comes first. What comes after it counts for nothing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct End {
    /// All goals are reached. Default: true.
    pub goals: bool,
    /// So much time has passed, 1 to 86 400 s. Default: time does not end it.
    pub time_s: Option<f64>,
    /// So much medium is missing, above 0 ml. Default: it does not end it.
    pub deficit_ml: Option<f64>,
    /// So much blood was lost, above 0 ml. Default: it does not end it.
    pub bled_ml: Option<f64>,
    /// The pump says that the wall is pierced. Default: false.
    pub perforation: bool,
}

impl Default for End {
    fn default() -> End {
        End { goals: true, time_s: None, deficit_ml: None, bled_ml: None, perforation: false }
    }
}

/// What the trainee is warned of: one of the conditions below.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Warning {
    /// In words. Default: made from the figures.
    pub words: Option<String>,
    /// The pressure in the cavity is above this, 0 to 20 kPa.
    pub pressure_above_pa: Option<f64>,
    /// The pressure in the cavity is below this, 0 to 20 kPa: the walls close, and it bleeds.
    pub pressure_below_pa: Option<f64>,
    /// More medium is missing than this, above 0 ml.
    pub deficit_above_ml: Option<f64>,
    /// More blood was lost than this, above 0 ml.
    pub bled_above_ml: Option<f64>,
    /// The force on the hand is above this, above 0 to 20 N.
    pub force_above_n: Option<f64>,
    /// More time has passed than this, 1 to 86 400 s.
    pub time_above_s: Option<f64>,
    /// The pump gives this alarm.
    pub alarm: Option<Alarm>,
    /// There is current in the loop while the middle of its ring is in this place.
    pub current_in: Option<String>,
    /// It is told, and counts in no score: who does all that is asked for comes to it, too. That time has passed counts in none anyway. Default: false.
    #[serde(default)]
    pub notice: bool,
}

/// How a metric is scored. What is missing is the report's default.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Score {
    /// What it weighs in its group and in the whole, 0 (nothing) to 100.
    pub weight: Option<f64>,
    /// From this value on the score is 100 %; with `none`.
    pub full: Option<f64>,
    /// From this value on it is 0; with `full`.
    pub none: Option<f64>,
}
