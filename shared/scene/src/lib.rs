//! Scenes: what the station simulates, read from a TOML file, checked, and made ready to run.
//!
//! [`load`] takes the path of a scene, or of a mesh alone, and returns a [`LoadedScene`]: tets and surfaces in metres in the scene's
//! frame, sound and bound, with fixed and attached nodes, the instrument's points, the fluid's box and the scripted hands. What a
//! scene leaves out is found from its geometry, and every repair and assumption is named in the notes. [`load_embedded`] gives the
//! default scene from the binary itself. [`find_case`] reads a case: what a trainee is to do in a scene whose anatomy is drawn from a
//! seed, and what a session is judged by; wherever a scene is loaded, a case does as well.
//!
//! Promise: no file makes anything here panic, wait for ever, or take more memory than a fixed multiple of the file; an error says
//! which file, line and key, what is wrong and what to do; the same files give the same bits and the same hash.
//!
//! The division into a deformable and a rigid kind, tets for physics with a finer surface bound to them, and points for the
//! instrument follows Tuchschmid et al., “A Flexible Framework for Highly-Modular Surgical Simulation Systems” (ISBMS 2006).
#![deny(unsafe_code)]

pub mod bounded;

mod case;
mod electrode;
mod embedded;
mod error;
mod file;
mod fixed;
mod fluid;
mod hands;
mod hash;
mod instrument;
mod jaws;
mod layer;
mod load;
mod loaded;
mod locate;
mod mirror;
mod names;
mod object;
mod parse;
mod parts;
mod place;
mod pose;
mod region;
mod report;
mod resection;
mod rigid;
mod rinse;
mod signal;
mod source;
mod sources;
mod spread;
mod validate;
mod wrap;

pub use case::{
    Aim, Alarm, Asked, Biopsy, Brief, CameraHead, Case, Cause, End, Energy, Goal, Held, LOOKS_FROM_PA, METRIC_KEYS, Mirror,
    Named, Place as CasePlace, Reach, Region, Removed, Rules, Rung, Score, SettledCase, Sight, Staunch, Stop, Survey, Vary,
    Visit, Warned, Warning, case_schema_json, find_case, find_played_case,
};
pub use electrode::LoadedLoop;
pub use error::{SceneError, SceneErrorKind};
pub use file::{
    Deformable, DeformableKind, Fixed, Hand, HandPose, Look, LoopUse, Material, Place, Scene, ScriptLeg, View, Workspace,
};
pub use fluid::{CavityCurve, Fluid, LoadedFluid, Medium, PA_PER_MMHG, Pump, PumpChange, Vessels};
pub use instrument::{Electrode, Jaws, Rigid, RigidKind, Tip};
pub use jaws::LoadedJaws;
pub use load::{load, load_embedded, load_or_embedded};
pub use loaded::{Attach, AttachedNode, LoadedDeformable, LoadedScene, LoadedWorkspace};
pub use object::{MAX_TETS, MAX_TRIANGLES};
pub use parse::MAX_SCENE_BYTES;
pub use parts::LEAST_PART_M3;
pub use pose::{HandLeg, LoadedHand, Pose};
pub use region::{LoadedRegion, MaterialRegion, Part};
pub use report::{CheckReport, ObjectReport, check, check_drawn};
pub use rigid::{LoadedRigid, OUTFLOW_RADII, collision_points};
pub use signal::Signal;
pub use source::MAX_MESH_BYTES;
pub use sources::{SourceFile, sources, unpack};

/// The JSON schema of a scene file, derived from the types that read it.
pub fn schema_json() -> String {
    let schema = schemars::schema_for!(Scene);
    let mut text = serde_json::to_string_pretty(&schema).unwrap_or_default(); // a schema always serializes
    text.push('\n');
    text
}
