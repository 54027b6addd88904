//! What a scene file can say. Each type is one table of the TOML; a missing key takes the default that its comment names.
//!
//! Frame of every position: metres, origin at the pivot in the cervix, +z along the canal into the uterus, +y anterior, +x to the
//! patient's right, which is on the picture's left. Angles are in degrees here and in radians everywhere after loading.

use crate::fluid::{Fluid, PumpChange, Vessels};
use crate::instrument::Rigid;
use crate::region::MaterialRegion;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A scene: the organs, the instruments, the fluid, the view, and the movements of the scripted hands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Version of this format: 1.
    pub version: u32,
    /// Name of the scene, as shown to the operator.
    pub name: String,
    /// What deforms: at least one, the first is the cavity or the organ that the instrument meets.
    #[serde(default)]
    pub deformable: Vec<Deformable>,
    /// Instruments: exactly one, which the hand holds.
    #[serde(default)]
    pub rigid: Vec<Rigid>,
    /// The pivot and the limits of the hand.
    #[serde(default)]
    pub workspace: Workspace,
    /// The fluid in the cavity.
    #[serde(default)]
    pub fluid: Fluid,
    /// The vessels of the tissue.
    #[serde(default)]
    pub vessels: Vessels,
    /// Optic and light.
    #[serde(default)]
    pub view: View,
    /// Scripted hands by name; `press`, `explore` and `polyp` are found from the geometry when they are missing.
    #[serde(default)]
    pub hand: BTreeMap<String, Hand>,
}

/// What a deformable object is to the trainee.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, Default)]
#[serde(rename_all = "snake_case")]
pub enum DeformableKind {
    /// An organ: it stays.
    #[default]
    Organ,
    /// What is to be removed: a polyp, a myoma.
    Pathology,
}

/// How an object comes to its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// As `scale_to_m`, `rotate_deg` and `translate_m` say.
    Given,
    /// Scaled by its guessed unit and moved so that it lies in front of the scope, on its axis.
    Auto,
}

/// A deformable object: tets for physics and collision, a finer surface bound to them for the eye.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Deformable {
    /// Name, different from that of any other object.
    pub name: String,
    /// Organ (default) or pathology.
    #[serde(default)]
    pub kind: DeformableKind,
    /// File of the tets, relative to the scene's folder; `builtin:uterus.msh` and `builtin:polyp.msh` are always there.
    pub mesh: String,
    /// File of the surface, in the same frame and unit as the tets. Default: the boundary of the tets.
    pub surface: Option<String>,
    /// Metres per unit of the file. Default: 1 where placed as given, the guessed unit where placed by itself.
    pub scale_to_m: Option<f64>,
    /// Rotation about x, then y, then z, before the translation. Default: none.
    pub rotate_deg: Option<[f64; 3]>,
    /// Translation after scale and rotation, in metres. Default: none.
    pub translate_m: Option<[f64; 3]>,
    /// `given` or `auto`. Default: `auto` if neither scale, rotation nor translation is given.
    pub place: Option<Place>,
    /// Name of the deformable in which this one is rooted: nodes that lie in the other's tets follow them.
    pub attach_to: Option<String>,
    /// What it is made of. Default: uterine tissue ex vivo, soft end.
    #[serde(default)]
    pub material: Material,
    /// Parts of it that are made of something else, or that are held by what is around them. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub region: Vec<MaterialRegion>,
    /// Nodes that do not move. Default: none for an object that is attached or of which a region is on a bed; else the outer shell of a hollow organ, or the
    /// part of the organ that is farthest from the scope. A pathology with an empty list, attached to nothing, floats from the beginning.
    pub fixed: Option<Vec<Fixed>>,
    /// How it looks. Default: by its kind.
    pub look: Option<Look>,
}

/// How an object looks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Look {
    /// Base colour, linear RGB, 0 to 1 each.
    pub colour: [f64; 3],
    /// Roughness of the wet surface, 0 (a mirror) to 1 (matt). Default: 0.35.
    #[serde(default = "roughness")]
    pub roughness: f64,
    /// A pathology is a myoma: large vessels run over its capsule, and what is cut of it is pale and whorled. Default: false.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub myoma: bool,
}

fn roughness() -> f64 {
    0.35
}

/// What a deformable object is made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Material {
    /// Young's modulus, 1 to 1e9 Pa.
    pub youngs_modulus_pa: f64,
    /// Poisson ratio, 0 to 0.49.
    pub poisson_ratio: f64,
    /// Density, 100 to 20 000 kg/m³.
    pub density_kg_m3: f64,
    /// Share of the velocity lost per second, 0 to 1e4.
    pub damping_per_s: f64,
    /// Where the figures come from.
    pub source: String,
}

impl Default for Material {
    fn default() -> Self {
        Material {
            youngs_modulus_pa: 30e3,
            poisson_ratio: 0.45,
            density_kg_m3: 1050.0,
            damping_per_s: 8.0,
            source: "default: uterus ex vivo, soft end (Kiss 2006)".to_owned(),
        }
    }
}

/// A set of nodes that do not move, in the scene's frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Fixed {
    /// Nodes within a sphere.
    Sphere {
        /// Its centre.
        centre_m: [f64; 3],
        /// Its radius.
        radius_m: f64,
    },
    /// Nodes within a box.
    Box {
        /// Its lowest corner.
        min_m: [f64; 3],
        /// Its highest corner.
        max_m: [f64; 3],
    },
    /// Nodes with a z at or below this.
    BelowZM(f64),
    /// Nodes with a z at or above this.
    AboveZM(f64),
    /// Boundary nodes no deeper under the object's convex hull than this share of its thinnest extent, 0 to 0.5.
    OuterShell(f64),
}

/// The pivot in the cervix and the limits of the hand's four degrees of freedom.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Workspace {
    /// The pivot.
    pub pivot_m: [f64; 3],
    /// Lowest and highest pitch (about x; positive lowers the tip towards −y).
    pub pitch_deg: [f64; 2],
    /// Lowest and highest yaw (about y; positive moves the tip towards +x).
    pub yaw_deg: [f64; 2],
    /// Lowest and highest roll (about the scope's axis).
    pub roll_deg: [f64; 2],
    /// Shortest and longest insertion, from pivot to tip.
    pub insertion_m: [f64; 2],
}

impl Default for Workspace {
    fn default() -> Self {
        let (tilt, roll) = (35.0, 180.0);
        Workspace {
            pivot_m: [0.0; 3],
            pitch_deg: [-tilt, tilt],
            yaw_deg: [-tilt, tilt],
            roll_deg: [-roll, roll],
            insertion_m: [0.0, 0.09],
        }
    }
}

/// Optic and light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct View {
    /// Angle between the scope's axis and the middle of the view: 0, 12, 15, 30 or 70 are made. Default: 30.
    pub optic_angle_deg: f64,
    /// Full angle of view, 20 to 150. Default: 90.
    pub field_of_view_deg: f64,
    /// Size of the picture's periphery relative to its centre (barrel distortion), 0.2 to 1. Default: 0.52.
    pub periphery_ratio: f64,
    /// Brightness of the light at the tip relative to the default, 0 to 10.
    pub light: f64,
}

impl Default for View {
    fn default() -> Self {
        View { optic_angle_deg: 30.0, field_of_view_deg: 90.0, periphery_ratio: 0.52, light: 1.0 }
    }
}

/// A pose of the hand about the pivot.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HandPose {
    /// About x; positive lowers the tip towards −y.
    #[serde(default)]
    pub pitch_deg: f64,
    /// About y; positive moves the tip towards +x.
    #[serde(default)]
    pub yaw_deg: f64,
    /// About the scope's axis.
    #[serde(default)]
    pub roll_deg: f64,
    /// From pivot to tip.
    pub insertion_m: f64,
}

/// A scripted hand, which moves in one of three ways: from `from` through `through` into `into` and back the same way in `period_s`; along `leg`, with the
/// loop; or `like` another one.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Hand {
    /// Where it starts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<HandPose>,
    /// What it passes on the way.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub through: Vec<HandPose>,
    /// Where it turns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub into: Option<HandPose>,
    /// Time there and back, 0.1 to 600 s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub period_s: Option<f64>,
    /// Name of the object that it is meant to touch.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target: Option<String>,
    /// What it does one after the other, from where the last one ends.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub leg: Vec<ScriptLeg>,
    /// The hand whose movement it makes: `press`, `explore` or `polyp`, which are found from the geometry, or one that moves by itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub like: Option<String>,
    /// It moves once and then rests where it began. Default: again and again.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub once: bool,
    /// What it sets at the pump and the valves, in the order of its time, or once the pump says what it waits for; instead of the scene's `fluid.change`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub change: Vec<PumpChange>,
}

/// A part of what a scripted hand does.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScriptLeg {
    /// Where it ends.
    pub to: HandPose,
    /// Time that it takes, 0.01 to 600 s.
    pub time_s: f64,
    /// What the loop does meanwhile, or jaws, which are open where a loop is out. Default: it is in.
    #[serde(default, rename = "loop")]
    pub electrode: LoopUse,
}

/// What a scripted hand does with the loop.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LoopUse {
    /// It is in, or goes in.
    #[default]
    In,
    /// It is out, or goes out, cold.
    Out,
    /// It is out, with the current that cuts.
    Cut,
    /// It is out, with the current that coagulates.
    Coagulate,
}
