//! What a scene file can say of an instrument. A missing key takes the default that its comment names.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What an instrument is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, Default)]
#[serde(rename_all = "snake_case")]
pub enum RigidKind {
    /// A rigid hysteroscope in its sheath.
    #[default]
    Hysteroscope,
}

/// Form of an instrument's tip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, Default)]
#[serde(rename_all = "snake_case")]
pub enum Tip {
    /// A hemisphere.
    #[default]
    Round,
    /// A flat end.
    Flat,
}

/// A rigid instrument. Its own frame: tip at the origin, shaft along −z.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rigid {
    /// Name, different from that of any other object.
    pub name: String,
    /// What it is. Default: a hysteroscope.
    #[serde(default)]
    pub kind: RigidKind,
    /// Outer diameter, 0.5 to 20 mm. Default: 5 mm, a diagnostic sheath.
    #[serde(default = "diameter_m")]
    pub diameter_m: f64,
    /// Length that is drawn, at least the collision length and at most 1 m. Default: 0.3 m.
    #[serde(default = "length_m")]
    pub length_m: f64,
    /// Length behind the tip that can touch. Default: 35 mm.
    #[serde(default = "collision_length_m")]
    pub collision_length_m: f64,
    /// Form of the tip. Default: round.
    #[serde(default)]
    pub tip: Tip,
    /// Number of collision points, 16 to 5 000. Default: 400.
    #[serde(default = "points")]
    pub points: u32,
    /// File of its surface in its own frame, relative to the scene's folder: its points lie on that, instead of on a rod with a tip of that form, and
    /// it is what is drawn. Default: the rod.
    pub mesh: Option<String>,
    /// Metres per unit of that file. Default: 1.
    #[serde(default = "one")]
    pub scale_to_m: f64,
    /// The loop electrode. Default: one that fits the shaft.
    #[serde(default, rename = "loop")]
    pub electrode: Electrode,
    /// Jaws that grasp, instead of a loop. Default: none.
    pub jaws: Option<Jaws>,
}

/// Two jaws before the tip that open and close about a hinge at the tip's middle, along the instrument's y axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Jaws {
    /// File of one jaw's surface, relative to the scene's folder: hinge at the origin, jaw along +z, the closing face in the plane x = 0 and the jaw on
    /// its +x side. The other jaw is its mirror image.
    pub mesh: String,
    /// Metres per unit of that file. Default: 1.
    #[serde(default = "one")]
    pub scale_to_m: f64,
    /// How far their tips are apart when they are open, 1 to 30 mm and at most 1.6 times their length. Default: 8 mm.
    #[serde(default = "opening_m")]
    pub opening_m: f64,
    /// Number of collision points on each, 16 to 1 000. Default: 80.
    #[serde(default = "points_of_jaw")]
    pub points: u32,
}

/// A loop electrode: a half ring of wire on two arms, which goes out before the tip. It stands across the shaft, its middle to the side to which a
/// fore-oblique optic looks (the instrument's +y).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Electrode {
    /// Radius of the half ring, to the middle of the wire, from the wire's diameter to 20 mm. Default: the shaft's radius less the wire's diameter; a shaft
    /// that is too thin for that has no loop.
    pub radius_m: Option<f64>,
    /// Diameter of the wire, 0.05 to 2 mm. Default: 0.3 mm.
    pub wire_m: f64,
    /// How far it goes out before the tip, 0 (there is no loop) to 50 mm. Default: 12 mm.
    pub reach_m: f64,
}

impl Default for Electrode {
    fn default() -> Self {
        Electrode { radius_m: None, wire_m: 0.000_3, reach_m: 0.012 }
    }
}

fn diameter_m() -> f64 {
    0.005
}

fn length_m() -> f64 {
    0.3
}

fn collision_length_m() -> f64 {
    0.035
}

fn points() -> u32 {
    400
}

fn one() -> f64 {
    1.0
}

fn opening_m() -> f64 {
    0.008
}

fn points_of_jaw() -> u32 {
    80
}
