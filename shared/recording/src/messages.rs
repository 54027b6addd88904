//! The JSON messages of the channels, and the way from a record to its messages and back. World frame and units of `hyst-messages`.
//! A number comes back bit for bit. JSON has none that is not finite: such a one is left out of its message, and NaN when read. It is not written as `null`,
//! because of a channel whose schema allows both (`"type": ["number", "null"]`) Foxglove shows nothing: its reader refuses a field of two types
//! (foxglove/studio `packages/mcap-support/src/parseJsonSchema.ts`).

mod scanned;

use crate::block::{Event, Level};
use crate::channels::time_of_ns;
use hyst_messages::{AppliedRecord, Controls, ForceCommand, HardwareSample, Pose};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::borrow::Cow;

/// A number that may be NaN: not there in JSON, or `null` as older recorders wrote it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Number(pub(crate) f32);

impl Number {
    /// Whether there is nothing to write.
    pub(crate) fn is_none(&self) -> bool {
        !self.0.is_finite()
    }
}

impl Default for Number {
    fn default() -> Number {
        Number(f32::NAN)
    }
}

impl Serialize for Number {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_f32(self.0)
    }
}
impl<'de> Deserialize<'de> for Number {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Number, D::Error> {
        Ok(Number(Option::<f32>::deserialize(deserializer)?.unwrap_or(f32::NAN)))
    }
}

#[derive(Default, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Xyz {
    #[serde(skip_serializing_if = "Number::is_none")]
    x: Number,
    #[serde(skip_serializing_if = "Number::is_none")]
    y: Number,
    #[serde(skip_serializing_if = "Number::is_none")]
    z: Number,
}

impl Xyz {
    pub(crate) fn of([x, y, z]: [f32; 3]) -> Xyz {
        Xyz { x: Number(x), y: Number(y), z: Number(z) }
    }
    pub(crate) fn array(&self) -> [f32; 3] {
        [self.x.0, self.y.0, self.z.0]
    }
}

#[derive(Default, Serialize, Deserialize)]
#[serde(default)]
struct Xyzw {
    #[serde(skip_serializing_if = "Number::is_none")]
    x: Number,
    #[serde(skip_serializing_if = "Number::is_none")]
    y: Number,
    #[serde(skip_serializing_if = "Number::is_none")]
    z: Number,
    #[serde(skip_serializing_if = "Number::is_none")]
    w: Number,
}

#[derive(Serialize, Deserialize)]
pub(crate) struct Time {
    sec: u64,
    nsec: u64,
}

impl Time {
    pub(crate) fn of(tick: u64) -> Time {
        let time_ns = time_of_ns(tick);
        Time { sec: time_ns / 1_000_000_000, nsec: time_ns % 1_000_000_000 }
    }
}

#[derive(Serialize, Deserialize)]
struct PoseMessage {
    position: Xyz,
    orientation: Xyzw,
}

/// The frame of what a tool's message says.
const WORLD: Cow<'static, str> = Cow::Borrowed("world");

/// Message of `/tool`.
#[derive(Serialize, Deserialize)]
pub(crate) struct Tool {
    timestamp: Time,
    frame_id: Cow<'static, str>,
    pose: PoseMessage,
    pub(crate) tick: u64,
    hardware_tick: u64,
    time_ns: u64,
    #[serde(default, skip_serializing_if = "Number::is_none")]
    pitch_rad: Number,
    #[serde(default, skip_serializing_if = "Number::is_none")]
    yaw_rad: Number,
    #[serde(default, skip_serializing_if = "Number::is_none")]
    roll_rad: Number,
    #[serde(default, skip_serializing_if = "Number::is_none")]
    insertion_m: Number,
    #[serde(default, skip_serializing_if = "Number::is_none")]
    camera_roll_rad: Number,
    velocity_m_s: Xyz,
}

impl Tool {
    pub(crate) fn of(record: &AppliedRecord) -> Tool {
        let (sample, pose) = (&record.sample, &record.sample.pose);
        let [x, y, z, w] = pose.orientation.map(Number);
        Tool {
            timestamp: Time::of(record.tick),
            frame_id: WORLD,
            pose: PoseMessage { position: Xyz::of(pose.position_m), orientation: Xyzw { x, y, z, w } },
            tick: record.tick,
            hardware_tick: sample.hardware_tick,
            time_ns: sample.time_ns,
            pitch_rad: Number(pose.pitch_rad),
            yaw_rad: Number(pose.yaw_rad),
            roll_rad: Number(pose.roll_rad),
            insertion_m: Number(pose.insertion_m),
            camera_roll_rad: Number(pose.camera_roll_rad),
            velocity_m_s: Xyz::of(sample.velocity_m_s),
        }
    }
}

/// Message of `/force`.
#[derive(Serialize, Deserialize)]
pub(crate) struct Force {
    pub(crate) tick: u64,
    force_n: Xyz,
    motor_n: Xyz,
    kind: u32,
    force_tick: u64,
    source_incarnation: u32,
    device_incarnation: u32,
    model_tick: u64,
    model_epoch: u32,
    model_incarnation: u32,
    #[serde(default)]
    medium_tick: u64,
    #[serde(default)]
    medium_epoch: u32,
}

impl Force {
    pub(crate) fn of(record: &AppliedRecord) -> Force {
        Force {
            tick: record.tick,
            force_n: Xyz::of(record.command.force_n),
            motor_n: Xyz::of(record.sample.force_n),
            kind: record.command.kind,
            force_tick: record.command.force_tick,
            source_incarnation: record.command.source_incarnation,
            device_incarnation: record.command.device_incarnation,
            model_tick: record.model_tick,
            model_epoch: record.model_epoch,
            model_incarnation: record.model_incarnation,
            medium_tick: record.medium_tick,
            medium_epoch: record.medium_epoch,
        }
    }
}

/// The record of a tick from its messages, but for what its input says; the command's tick is the record's.
pub(crate) fn applied(tool: &Tool, force: &Force, controls: Controls) -> AppliedRecord {
    let Xyzw { x, y, z, w } = &tool.pose.orientation;
    let pose = Pose {
        position_m: tool.pose.position.array(),
        pitch_rad: tool.pitch_rad.0,
        orientation: [x.0, y.0, z.0, w.0],
        yaw_rad: tool.yaw_rad.0,
        roll_rad: tool.roll_rad.0,
        insertion_m: tool.insertion_m.0,
        camera_roll_rad: tool.camera_roll_rad.0,
    };
    AppliedRecord {
        tick: tool.tick,
        command: ForceCommand {
            tick: force.tick,
            force_tick: force.force_tick,
            force_n: force.force_n.array(),
            kind: force.kind,
            source_incarnation: force.source_incarnation,
            device_incarnation: force.device_incarnation,
        },
        sample: HardwareSample {
            hardware_tick: tool.hardware_tick,
            time_ns: tool.time_ns,
            pose,
            velocity_m_s: tool.velocity_m_s.array(),
            force_n: force.motor_n.array(),
            controls,
            ..HardwareSample::default()
        },
        model_tick: force.model_tick,
        model_epoch: force.model_epoch,
        model_incarnation: force.model_incarnation,
        medium_tick: force.medium_tick,
        medium_epoch: force.medium_epoch,
        ..AppliedRecord::default()
    }
}

/// Message of `/controls`.
#[derive(Serialize, Deserialize)]
pub(crate) struct ControlsMessage {
    pub(crate) tick: u64,
    buttons: u32,
    #[serde(default, skip_serializing_if = "Number::is_none")]
    inflow_valve: Number,
    #[serde(default, skip_serializing_if = "Number::is_none")]
    outflow_valve: Number,
    #[serde(default, skip_serializing_if = "Number::is_none")]
    set_pressure_pa: Number,
    #[serde(default, skip_serializing_if = "Number::is_none")]
    light: Number,
    #[serde(default, skip_serializing_if = "Number::is_none")]
    loop_extension_m: Number,
    #[serde(default = "not_stated", skip_serializing_if = "Number::is_none")]
    focus_m: Number,
}

/// Recordings from before the focus was the device's have none.
fn not_stated() -> Number {
    Number(0.0)
}

impl ControlsMessage {
    pub(crate) fn of(tick: u64, controls: &Controls) -> ControlsMessage {
        ControlsMessage {
            tick,
            buttons: controls.buttons,
            inflow_valve: Number(controls.inflow_valve),
            outflow_valve: Number(controls.outflow_valve),
            set_pressure_pa: Number(controls.set_pressure_pa),
            light: Number(controls.light),
            loop_extension_m: Number(controls.loop_extension_m),
            focus_m: Number(controls.focus_m),
        }
    }
    pub(crate) fn controls(&self) -> Controls {
        Controls {
            buttons: self.buttons,
            inflow_valve: self.inflow_valve.0,
            outflow_valve: self.outflow_valve.0,
            set_pressure_pa: self.set_pressure_pa.0,
            light: self.light.0,
            loop_extension_m: self.loop_extension_m.0,
            focus_m: self.focus_m.0,
        }
    }
}

/// Message of `/events`.
#[derive(Serialize, Deserialize)]
pub(crate) struct EventMessage {
    timestamp: Time,
    level: u32,
    message: String,
    name: String,
    file: String,
    line: u32,
    tick: u64,
    kind: String,
    incarnation: u32,
}

impl EventMessage {
    pub(crate) fn of(event: &Event) -> EventMessage {
        EventMessage {
            timestamp: Time::of(event.tick),
            level: event.level as u32,
            message: event.text.clone(),
            name: event.process.clone(),
            file: String::new(),
            line: 0,
            tick: event.tick,
            kind: event.kind.clone(),
            incarnation: event.incarnation,
        }
    }
    pub(crate) fn event(self) -> Event {
        let level = Level::from_number(self.level);
        Event { tick: self.tick, level, kind: self.kind, process: self.name, incarnation: self.incarnation, text: self.message }
    }
}

/// A number of 64 bits that may be NaN, likewise.
pub(crate) fn number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

/// What is not there.
pub(crate) fn unknown() -> f64 {
    f64::NAN
}

/// Whether there is nothing to write.
pub(crate) fn is_unknown(number: &f64) -> bool {
    !number.is_finite()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_focus_is_recorded_and_none_is_stated_where_a_recording_is_older() {
        let controls = Controls { light: 0.7, focus_m: 0.008, ..Controls::default() };
        let mut message = serde_json::to_value(ControlsMessage::of(7, &controls)).unwrap();
        let read = |message: &serde_json::Value| serde_json::from_value::<ControlsMessage>(message.clone()).unwrap().controls();
        assert_eq!(read(&message), controls);
        assert!(message.as_object_mut().unwrap().remove("focus_m").is_some());
        assert_eq!(read(&message), Controls { focus_m: 0.0, ..controls });
    }
}
