//! The JSON schemas of the channels. Promise: every message fits the one of its channel; a mask says what each of its bits means, from the constants that
//! set it; and a field has one type, because Foxglove shows nothing of a channel that has another.

use crate::block::Level;
use crate::channels::Channel;
use hyst_messages::{Applied, BUTTONS, FLOW_FLAWS, PUMP_ALARMS, SLOTS, Slot};
use serde_json::{Value, json};
use std::fmt::Display;

/// The dialect of the schemas.
const DIALECT: &str = "https://json-schema.org/draft/2020-12/schema";
/// What every schema says of its numbers.
const LEFT_OUT: &str = "A number that is not finite is left out.";

impl Channel {
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
                let mut fields = json!({"force_n": xyz, "motor_n": xyz, "kind": coded("one of", KINDS)});
                let words = ["tick", "force_tick", "source_incarnation", "device_incarnation", "model_tick", "model_epoch"];
                add(&mut fields, "integer", &words);
                add(&mut fields, "integer", &["model_incarnation", "medium_tick", "medium_epoch"]);
                fields
            }
            Channel::Controls => {
                let mut fields = json!({"buttons": coded("bits", BUTTONS)});
                add(&mut fields, "integer", &["tick"]);
                let turned = ["inflow_valve", "outflow_valve", "set_pressure_pa", "light", "loop_extension_m", "focus_m"];
                add(&mut fields, "number", &turned);
                fields
            }
            Channel::Events => {
                let mut fields = json!({"timestamp": time, "level": coded("one of", LEVELS)});
                add(&mut fields, "integer", &["line", "tick", "incarnation"]);
                add(&mut fields, "string", &["message", "name", "file", "kind"]);
                fields
            }
            Channel::Tissue => tissue_properties(),
            Channel::Fluid => fluid_properties(),
            Channel::Input => {
                let piece = json!({"type": "object", "properties": {"object": {"type": "integer"}, "velocity_m_s": xyz}});
                let limits = vector_schema(&["max_force_n", "max_stiffness_n_m", "max_damping_n_s_m"]);
                let mut origin = json!({});
                add(&mut origin, "integer", &["tick", "servo", "from_tick", "from_servo"]);
                let origin = json!({"type": "object", "properties": origin});
                let mut fields = json!({"before_n": xyz, "device_limits": limits, "pieces": {"type": "array", "items": piece}});
                fields["on_scope_n"] = xyz;
                fields["origins"] = json!({"type": "array", "items": origin});
                add(&mut fields, "integer", &["tick", "lag", "followed"]);
                add(&mut fields, "number", &["pressure_pa"]);
                fields
            }
            Channel::Processes => process_properties(),
            Channel::Checkpoints => checkpoint_properties(),
            Channel::Pictures => picture_properties(),
            Channel::Scene => scene_properties(),
            Channel::Judged => {
                let mut fields = json!({"judge": {"type": "string"}});
                add(&mut fields, "integer", &["tick", "tissue_tick"]);
                fields
            }
            Channel::Steps => {
                let mut fields = json!({"state_hash": {"type": "string"}});
                let numbers = ["tick", "input_tick", "from_tick", "from_incarnation", "epoch", "incarnation", "step_ticks"];
                add(&mut fields, "integer", &numbers);
                fields
            }
        };
        json!({"$schema": DIALECT, "title": self.schema_name(), "description": LEFT_OUT, "type": "object", "properties": properties})
    }
}

/// The kinds of a force in words.
const KINDS: [(u32, &str); 4] = [
    (Applied::Fresh as u32, "fresh"),
    (Applied::Held as u32, "held"),
    (Applied::Ramped as u32, "ramped"),
    (Applied::Zero as u32, "zero"),
];
/// The levels of an event in words.
const LEVELS: [(u32, &str); 3] =
    [(Level::Info as u32, "info"), (Level::Warning as u32, "warning"), (Level::Error as u32, "error")];

/// A whole number that is to be looked up: `how: 1 this, 2 that`.
fn coded(how: &str, codes: impl IntoIterator<Item = (u32, impl Display)>) -> Value {
    let codes: Vec<String> = codes.into_iter().map(|(code, what)| format!("{code} {what}")).collect();
    json!({"type": "integer", "description": format!("{how}: {}", codes.join(", "))})
}

fn tissue_properties() -> Value {
    let phases = vector_schema(&["deformation", "collision", "response", "surface"]);
    let slots = (0..SLOTS).filter_map(Slot::from_number).map(|slot| (1u32 << slot.number(), slot));
    let cutting = coded("one of", [(0, "no"), (1, "while a stroke is under way")]);
    let (force, engines) = (vector_schema(&["x", "y", "z"]), coded("bits", slots));
    let mut fields = json!({"tool_force_n": force, "phase_us": phases, "engines": engines, "is_cutting": cutting});
    add(&mut fields, "string", &["state_hash"]);
    add(&mut fields, "integer", &["tick", "contact_count", "shares_missing", "objects", "step_ticks"]);
    add(&mut fields, "integer", &["cuts", "topology_version", "washed_out", "held", "taken_out", "cut_limits", "substeps"]);
    add(&mut fields, "integer", &["corrections", "hits_dropped"]);
    add(&mut fields, "number", &["removed_volume_ml", "washed_out_ml", "taken_out_ml"]);
    add(&mut fields, "number", &["hold_m", "cavity_pressure_pa", "largest_piece_ml", "healthy_removed_ml"]);
    fields
}

fn fluid_properties() -> Value {
    let (alarms, flaws) = (coded("bits", PUMP_ALARMS), coded("bits", FLOW_FLAWS));
    let mut fields = json!({"state_hash": {"type": "string"}, "alarms": alarms, "flaws": flaws});
    fields["on_scope_n"] = vector_schema(&["x", "y", "z"]);
    add(&mut fields, "integer", &["tick", "step_ticks", "scene_step_ticks", "halvings", "open_vessels", "sealed_vessels"]);
    add(&mut fields, "number", &["deficit_ml", "cavity_volume_ml", "bled_ml", "pressure_pa"]);
    add(&mut fields, "number", &["inflow_ml_min", "outflow_ml_min", "transmittance"]);
    fields
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ProcessSpell;
    use crate::again::{Input, Origin};
    use crate::fluid::Fluid;
    use crate::messages::{ControlsMessage, Force, Tool};
    use crate::process::Process;
    use crate::tissue::Tissue;
    use hyst_messages::{
        AppliedRecord, BUTTON_COAGULATING, BUTTON_ENERGIZED, BUTTON_EXTENDED, Controls, DeviceLimits, FluidStatus, ForceCommand,
        HardwareSample, OriginRecord, PieceFlow, Pose, Role, TissueStatus,
    };
    use std::collections::BTreeSet;

    /// Records in which every number is this one.
    fn records(x: f32) -> (AppliedRecord, TissueStatus, FluidStatus, ProcessSpell) {
        let wide = f64::from(x);
        let pose = Pose {
            position_m: [x; 3],
            pitch_rad: x,
            orientation: [x; 4],
            yaw_rad: x,
            roll_rad: x,
            insertion_m: x,
            camera_roll_rad: x,
        };
        let controls = Controls {
            buttons: 3,
            inflow_valve: x,
            outflow_valve: x,
            set_pressure_pa: x,
            light: x,
            loop_extension_m: x,
            focus_m: x,
        };
        let applied = AppliedRecord {
            command: ForceCommand { force_n: [x; 3], ..ForceCommand::default() },
            sample: HardwareSample { pose, velocity_m_s: [x; 3], force_n: [x; 3], controls, ..HardwareSample::default() },
            before_n: [x; 3],
            pieces: [PieceFlow { object: 3, velocity_m_s: [x; 3] }; hyst_messages::MAX_PIECES],
            pressure_pa: x,
            limits: DeviceLimits { max_force_n: x, max_stiffness_n_m: x, max_damping_n_s_m: x },
            on_scope_n: [x; 3],
            followed: 2,
            ..AppliedRecord::default()
        };
        let tissue = TissueStatus {
            removed_volume_ml: wide,
            largest_piece_ml: wide,
            healthy_removed_ml: wide,
            cavity_pressure_pa: x,
            tool_force_n: [x; 3],
            phase_us: [x; 4],
            washed_out_ml: x,
            hold_m: x,
            taken_out_ml: x,
            ..TissueStatus::default()
        };
        let fluid = FluidStatus {
            deficit_ml: wide,
            cavity_volume_ml: wide,
            bled_ml: wide,
            pressure_pa: x,
            inflow_ml_min: x,
            outflow_ml_min: x,
            on_scope_n: [x; 3],
            transmittance: x,
            ..FluidStatus::default()
        };
        let spell = ProcessSpell {
            tick: 1_000,
            process: "haptic:1".into(),
            incarnation: 3,
            ticks: 1_000,
            steps: 999,
            overruns: 1,
            wakeup_p99_us: x,
            loop_p50_us: x,
            loop_p99_us: x,
        };
        (applied, tissue, fluid, spell)
    }

    /// The messages of those channels that have numbers.
    fn messages(x: f32) -> [(Channel, Value); 7] {
        let (applied, tissue, fluid, spell) = records(x);
        let mut input = Input::of(&applied, None).unwrap();
        input.origins = vec![Origin::of(&OriginRecord { tick: 9, from_tick: 8, servo: 1, from_servo: 0 })];
        [
            (Channel::Tool, serde_json::to_value(Tool::of(&applied)).unwrap()),
            (Channel::Force, serde_json::to_value(Force::of(&applied)).unwrap()),
            (Channel::Controls, serde_json::to_value(ControlsMessage::of(7, &applied.sample.controls)).unwrap()),
            (Channel::Input, serde_json::to_value(input).unwrap()),
            (Channel::Tissue, serde_json::to_value(Tissue::of(&tissue)).unwrap()),
            (Channel::Fluid, serde_json::to_value(Fluid::of(&fluid)).unwrap()),
            (Channel::Processes, serde_json::to_value(Process::of(&spell)).unwrap()),
        ]
    }

    /// Fails if a value is not as its schema says; notes the numbers in it. A field has one type, because Foxglove's reader refuses others.
    fn fits(schema: &Value, value: &Value, at: &str, numbers: &mut BTreeSet<String>) {
        match schema["type"].as_str().unwrap_or_else(|| panic!("{at}: {schema}")) {
            "object" => {
                for (name, value) in value.as_object().unwrap_or_else(|| panic!("{at}: {value}")) {
                    let of_it = schema["properties"].get(name).unwrap_or_else(|| panic!("{at}.{name} is not in the schema"));
                    fits(of_it, value, &format!("{at}.{name}"), numbers);
                }
            }
            "array" => {
                let items = value.as_array().unwrap_or_else(|| panic!("{at}: {value}"));
                items.iter().for_each(|item| fits(&schema["items"], item, &format!("{at}[]"), numbers));
            }
            "integer" => assert!(value.is_u64(), "{at}: {value}"),
            "string" => assert!(value.is_string(), "{at}: {value}"),
            "number" => {
                assert!(value.is_number(), "{at}: {value}");
                numbers.insert(at.into());
            }
            other => panic!("{at} is of type {other}"),
        }
    }

    /// The numbers that a schema has.
    fn numbers_of(schema: &Value, at: &str, numbers: &mut BTreeSet<String>) {
        let fields = schema["properties"].as_object().into_iter().flatten();
        fields.for_each(|(name, of_it)| numbers_of(of_it, &format!("{at}.{name}"), numbers));
        if schema["type"] == "array" {
            numbers_of(&schema["items"], &format!("{at}[]"), numbers);
        }
        if schema["type"] == "number" {
            numbers.insert(at.into());
        }
    }

    #[test]
    fn a_number_that_json_does_not_have_is_left_out_and_every_message_fits_its_schema() {
        for x in [0.25, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for (channel, message) in messages(x) {
                let (mut found, mut known) = (BTreeSet::new(), BTreeSet::new());
                fits(&channel.schema(), &message, channel.topic(), &mut found);
                numbers_of(&channel.schema(), channel.topic(), &mut known);
                assert!(!known.is_empty(), "{channel:?}");
                assert_eq!(found, if x.is_finite() { known } else { BTreeSet::new() }, "{channel:?} of {x}");
            }
        }
    }

    #[test]
    fn a_number_that_was_left_out_or_is_null_is_none_when_it_is_read() {
        let (applied, tissue, fluid, _) = records(f32::NAN);
        let again: Tissue = serde_json::from_value(serde_json::to_value(Tissue::of(&tissue)).unwrap()).unwrap();
        let status = again.status();
        assert!(status.removed_volume_ml.is_nan() && status.cavity_pressure_pa.is_nan() && status.hold_m.is_nan(), "{status:?}");
        assert!(status.tool_force_n.iter().chain(&status.phase_us).all(|x| x.is_nan()), "{status:?}");
        let mut message = serde_json::to_value(Fluid::of(&fluid)).unwrap();
        (message["deficit_ml"], message["pressure_pa"]) = (Value::Null, Value::Null); // as older recorders wrote it
        let status = serde_json::from_value::<Fluid>(message).unwrap().status();
        assert!(status.deficit_ml.is_nan() && status.bled_ml.is_nan(), "{status:?}");
        assert!(status.pressure_pa.is_nan() && status.outflow_ml_min.is_nan(), "{status:?}");
        let force: Force = serde_json::from_value(serde_json::to_value(Force::of(&applied)).unwrap()).unwrap();
        let tool: Tool = serde_json::from_value(serde_json::to_value(Tool::of(&applied)).unwrap()).unwrap();
        let again = crate::messages::applied(&tool, &force, Controls::default());
        let pose = &again.sample.pose;
        assert!(pose.position_m.iter().chain(&pose.orientation).all(|x| x.is_nan()) && pose.roll_rad.is_nan(), "{again:?}");
        assert!(again.command.force_n.iter().chain(&again.sample.velocity_m_s).all(|x| x.is_nan()), "{again:?}");
    }

    #[test]
    fn whoever_looks_at_a_mask_finds_in_its_schema_what_each_bit_says() {
        let said = |channel: Channel, field: &str| {
            let description = channel.schema()["properties"][field]["description"].as_str().map(str::to_string);
            description.unwrap_or_else(|| panic!("{field} says nothing"))
        };
        let buttons = "bits: 1 current that cuts, 2 loop out or jaws open, 4 current that coagulates";
        assert_eq!(said(Channel::Controls, "buttons"), buttons);
        assert_eq!((BUTTON_ENERGIZED, BUTTON_EXTENDED, BUTTON_COAGULATING), (1, 2, 4));
        let alarms = said(Channel::Fluid, "alarms");
        assert!(alarms.starts_with("bits: 1 pressure, 2 deficit") && alarms.ends_with("16 container change"), "{alarms}");
        let flaws = said(Channel::Fluid, "flaws");
        assert!(flaws.starts_with("bits: 1 input replaced") && flaws.contains(", 8 not converged, "), "{flaws}");
        // A bit for each slot that there is.
        let engines = said(Channel::Tissue, "engines");
        let words: Vec<&str> = engines.trim_start_matches("bits: ").split(", ").collect();
        assert_eq!(words.len(), Role::ALL.iter().map(|role| role.slots().1).sum::<usize>());
        assert!(words.contains(&"1 hardware") && words.contains(&"8 haptic:1"), "{engines}");
        assert_eq!(said(Channel::Force, "kind"), "one of: 0 fresh, 1 held, 2 ramped, 3 zero");
        assert_eq!(said(Channel::Events, "level"), "one of: 2 info, 3 warning, 4 error");
    }
}
