//! The channels of a recording: topic, id and JSON schema of each.

use hyst_messages::TICK_NS;
use serde_json::{Value, json};

/// A channel. The discriminant is its id, and its schema's, in every recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u16)]
pub enum Channel {
    /// Pose and velocity of the scope, each tick. A Foxglove PoseInFrame with more fields.
    Tool = 1,
    /// Force handed to the hardware, each tick.
    Force = 2,
    /// Buttons and valves: on change, and once in each block.
    Controls = 3,
    /// What happened to processes and data. A Foxglove Log with more fields.
    Events = 4,
    /// Status of the tissue, as often as the recorder looks.
    Tissue = 5,
    /// Status of the fluid, as often as the recorder looks.
    Fluid = 6,
    /// What the tick's input says of the medium: on change, once in each block, and where a servo or a device did not go on from the tick before.
    Input = 7,
    /// Every step of the tissue: what it was made from, and the hash of what came of it.
    Steps = 8,
    /// The whole state of tissue and fluid, every five seconds: what a replay begins with that does not begin at the beginning.
    Checkpoints = 9,
    /// What each process did in the last second.
    Processes = 10,
    /// What was seen when something happened. A Foxglove CompressedImage with more fields.
    Pictures = 11,
    /// The files of the scene, once.
    Scene = 12,
}

impl Channel {
    /// All channels in the order of their ids.
    pub const ALL: [Channel; 12] = [
        Channel::Tool,
        Channel::Force,
        Channel::Controls,
        Channel::Events,
        Channel::Tissue,
        Channel::Fluid,
        Channel::Input,
        Channel::Steps,
        Channel::Checkpoints,
        Channel::Processes,
        Channel::Pictures,
        Channel::Scene,
    ];

    /// The topic.
    pub const fn topic(self) -> &'static str {
        match self {
            Channel::Tool => "/tool",
            Channel::Force => "/force",
            Channel::Controls => "/controls",
            Channel::Events => "/events",
            Channel::Tissue => "/tissue",
            Channel::Fluid => "/fluid",
            Channel::Input => "/input",
            Channel::Steps => "/steps",
            Channel::Checkpoints => "/checkpoints",
            Channel::Processes => "/processes",
            Channel::Pictures => "/pictures",
            Channel::Scene => "/scene",
        }
    }

    /// Name of the schema; the three that Foxglove knows bear its names.
    pub const fn schema_name(self) -> &'static str {
        match self {
            Channel::Tool => "foxglove.PoseInFrame",
            Channel::Force => "hyst.Force",
            Channel::Controls => "hyst.Controls",
            Channel::Events => "foxglove.Log",
            Channel::Tissue => "hyst.Tissue",
            Channel::Fluid => "hyst.Fluid",
            Channel::Input => "hyst.Input",
            Channel::Steps => "hyst.Step",
            Channel::Checkpoints => "hyst.Checkpoint",
            Channel::Processes => "hyst.Process",
            Channel::Pictures => "foxglove.CompressedImage",
            Channel::Scene => "hyst.SceneFile",
        }
    }

    /// The channel with this id.
    pub fn from_id(id: u16) -> Option<Channel> {
        Channel::ALL.into_iter().find(|channel| *channel as u16 == id)
    }

    /// The JSON schema.
    pub fn schema(self) -> Value {
        let (time, xyz) = (time_schema(), vector_schema(&["x", "y", "z"]));
        let properties = match self {
            Channel::Tool => {
                let pose = json!({"type": "object", "properties": {"position": xyz, "orientation": vector_schema(&["x", "y", "z", "w"])}});
                let mut fields = json!({"timestamp": time, "frame_id": {"type": "string"}, "pose": pose, "velocity_m_s": xyz});
                add(&mut fields, "integer", &["tick", "hardware_tick", "time_ns"]);
                add(&mut fields, "number", &["pitch_rad", "yaw_rad", "roll_rad", "insertion_m", "camera_roll_rad"]);
                fields
            }
            Channel::Force => {
                let kind = json!({"type": "integer", "description": "0 fresh, 1 held, 2 ramped, 3 zero"});
                let mut fields = json!({"force_n": xyz, "motor_n": xyz, "kind": kind});
                let words = ["tick", "force_tick", "source_incarnation", "device_incarnation", "model_tick", "model_epoch"];
                add(&mut fields, "integer", &words);
                add(&mut fields, "integer", &["model_incarnation", "medium_tick", "medium_epoch"]);
                fields
            }
            Channel::Controls => {
                let mut fields = json!({});
                add(&mut fields, "integer", &["tick", "buttons"]);
                let turned = ["inflow_valve", "outflow_valve", "set_pressure_pa", "light", "loop_extension_m", "focus_m"];
                add(&mut fields, "number", &turned);
                fields
            }
            Channel::Events => {
                let mut fields = json!({"timestamp": time});
                add(&mut fields, "integer", &["level", "line", "tick", "incarnation"]);
                add(&mut fields, "string", &["message", "name", "file", "kind"]);
                fields
            }
            Channel::Tissue => {
                let phases = vector_schema(&["deformation", "collision", "response", "surface"]);
                let mut fields = json!({"tool_force_n": xyz, "phase_us": phases, "state_hash": {"type": "string"}});
                add(&mut fields, "integer", &["tick", "contact_count", "shares_missing", "objects", "engines", "step_ticks"]);
                add(&mut fields, "integer", &["cuts", "is_cutting", "topology_version", "washed_out", "held", "taken_out"]);
                add(&mut fields, "number", &["removed_volume_ml", "washed_out_ml", "taken_out_ml"]);
                add(&mut fields, "number", &["hold_m", "cavity_pressure_pa"]);
                fields
            }
            Channel::Fluid => {
                let mut fields = json!({"state_hash": {"type": "string"}});
                add(&mut fields, "integer", &["tick", "alarms", "flaws", "step_ticks", "scene_step_ticks", "halvings"]);
                add(&mut fields, "number", &["deficit_ml", "cavity_volume_ml", "bled_ml", "pressure_pa"]);
                add(&mut fields, "number", &["inflow_ml_min", "outflow_ml_min"]);
                fields
            }
            Channel::Input => {
                let piece = json!({"type": "object", "properties": {"object": {"type": "integer"}, "velocity_m_s": xyz}});
                let limits = vector_schema(&["max_force_n", "max_stiffness_n_m", "max_damping_n_s_m"]);
                let mut fields = json!({"before_n": xyz, "device_limits": limits, "pieces": {"type": "array", "items": piece}});
                add(&mut fields, "integer", &["tick", "lag"]);
                add(&mut fields, "number", &["pressure_pa"]);
                fields
            }
            Channel::Processes => process_properties(),
            Channel::Checkpoints => checkpoint_properties(),
            Channel::Pictures => picture_properties(),
            Channel::Scene => scene_properties(),
            Channel::Steps => {
                let mut fields = json!({"state_hash": {"type": "string"}});
                let numbers = ["tick", "input_tick", "from_tick", "from_incarnation", "epoch", "incarnation", "step_ticks"];
                add(&mut fields, "integer", &numbers);
                fields
            }
        };
        json!({"$schema": "https://json-schema.org/draft/2020-12/schema", "title": self.schema_name(), "type": "object", "properties": properties})
    }
}

fn process_properties() -> Value {
    let mut fields = json!({"process": {"type": "string"}});
    add(&mut fields, "integer", &["tick", "incarnation", "ticks", "steps", "overruns"]);
    add(&mut fields, "number", &["wakeup_p99_us", "loop_p50_us", "loop_p99_us"]);
    fields
}

fn checkpoint_properties() -> Value {
    let state = json!({"type": "string", "contentEncoding": "base64"});
    let mut fields = json!({"state": state, "role": {"type": "string"}});
    add(&mut fields, "integer", &["tick"]);
    fields
}

fn picture_properties() -> Value {
    let data = json!({"type": "string", "contentEncoding": "base64"});
    let mut fields = json!({"timestamp": time_schema(), "data": data});
    add(&mut fields, "string", &["frame_id", "format", "words"]);
    add(&mut fields, "integer", &["tick", "event_tick"]);
    fields
}

fn scene_properties() -> Value {
    let mut fields = json!({"name": {"type": "string"}, "data": {"type": "string", "contentEncoding": "base64"}});
    add(&mut fields, "integer", &["index", "count"]);
    fields
}

fn time_schema() -> Value {
    json!({"type": "object", "title": "time", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}})
}

fn vector_schema(names: &[&str]) -> Value {
    let mut fields = json!({});
    add(&mut fields, "number", names);
    json!({"type": "object", "properties": fields})
}

fn add(fields: &mut Value, kind: &str, names: &[&str]) {
    for name in names {
        fields[*name] = json!({"type": kind});
    }
}

/// Station time of a tick, ns.
pub fn time_of_ns(tick: u64) -> u64 {
    tick.saturating_mul(TICK_NS)
}
