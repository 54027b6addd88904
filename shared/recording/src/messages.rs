//! The JSON messages of the channels, and the way from a record to its messages and back. World frame and units of `hyst-messages`.
//! An f32 comes back bit for bit; one that is not finite is `null` in the file and NaN when read.

use crate::block::{Event, Level};
use crate::channels::time_of_ns;
use hyst_messages::{AppliedRecord, Controls, ForceCommand, HardwareSample, Pose, TissueStatus};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A number that may be NaN: `null` in JSON.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Number(pub(crate) f32);

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

#[derive(Serialize, Deserialize)]
pub(crate) struct Xyz {
    x: Number,
    y: Number,
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

#[derive(Serialize, Deserialize)]
struct Xyzw {
    x: Number,
    y: Number,
    z: Number,
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

/// Message of `/tool`.
#[derive(Serialize, Deserialize)]
pub(crate) struct Tool {
    timestamp: Time,
    frame_id: String,
    pose: PoseMessage,
    pub(crate) tick: u64,
    hardware_tick: u64,
    time_ns: u64,
    pitch_rad: Number,
    yaw_rad: Number,
    roll_rad: Number,
    insertion_m: Number,
    camera_roll_rad: Number,
    velocity_m_s: Xyz,
}

impl Tool {
    pub(crate) fn of(record: &AppliedRecord) -> Tool {
        let (sample, pose) = (&record.sample, &record.sample.pose);
        let [x, y, z, w] = pose.orientation.map(Number);
        Tool {
            timestamp: Time::of(record.tick),
            frame_id: "world".into(),
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
    inflow_valve: Number,
    outflow_valve: Number,
    set_pressure_pa: Number,
    light: Number,
    loop_extension_m: Number,
    #[serde(default = "not_stated")]
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

#[derive(Serialize, Deserialize)]
struct Phases {
    deformation: Number,
    collision: Number,
    response: Number,
    surface: Number,
}

/// Message of `/tissue`.
#[derive(Serialize, Deserialize)]
pub(crate) struct Tissue {
    tick: u64,
    /// Hexadecimal, because readers in JavaScript have 53 bits.
    state_hash: String,
    #[serde(deserialize_with = "number")]
    removed_volume_ml: f64,
    cavity_pressure_pa: Number,
    contact_count: u32,
    tool_force_n: Xyz,
    shares_missing: u32,
    phase_us: Phases,
    #[serde(default)]
    objects: u32,
    /// A bit for each slot.
    #[serde(default)]
    engines: u32,
    #[serde(default)]
    step_ticks: u32,
    #[serde(default)]
    cuts: u32,
    #[serde(default)]
    is_cutting: u32,
    #[serde(default)]
    topology_version: u32,
    #[serde(default)]
    washed_out: u32,
    #[serde(default)]
    washed_out_ml: f32,
    #[serde(default)]
    held: u32,
    #[serde(default)]
    hold_m: f32,
    #[serde(default)]
    taken_out: u32,
    #[serde(default)]
    taken_out_ml: f32,
}

impl Tissue {
    pub(crate) fn of(status: &TissueStatus) -> Tissue {
        let [deformation, collision, response, surface] = status.phase_us.map(Number);
        Tissue {
            tick: status.state_tick,
            state_hash: format!("{:016x}", status.state_hash),
            removed_volume_ml: status.removed_volume_ml,
            cavity_pressure_pa: Number(status.cavity_pressure_pa),
            contact_count: status.contact_count,
            tool_force_n: Xyz::of(status.tool_force_n),
            shares_missing: status.shares_missing,
            phase_us: Phases { deformation, collision, response, surface },
            objects: status.objects,
            engines: status.engines,
            step_ticks: status.step_ticks,
            cuts: status.cuts,
            is_cutting: status.is_cutting,
            topology_version: status.topology_version,
            washed_out: status.washed_out,
            washed_out_ml: status.washed_out_ml,
            held: status.held,
            hold_m: status.hold_m,
            taken_out: status.taken_out,
            taken_out_ml: status.taken_out_ml,
        }
    }
    pub(crate) fn status(&self) -> TissueStatus {
        let phases = &self.phase_us;
        TissueStatus {
            state_tick: self.tick,
            state_hash: u64::from_str_radix(&self.state_hash, 16).unwrap_or(0),
            removed_volume_ml: self.removed_volume_ml,
            cavity_pressure_pa: self.cavity_pressure_pa.0,
            contact_count: self.contact_count,
            tool_force_n: self.tool_force_n.array(),
            shares_missing: self.shares_missing,
            phase_us: [phases.deformation.0, phases.collision.0, phases.response.0, phases.surface.0],
            objects: self.objects,
            engines: self.engines,
            step_ticks: self.step_ticks,
            cuts: self.cuts,
            is_cutting: self.is_cutting,
            topology_version: self.topology_version,
            washed_out: self.washed_out,
            washed_out_ml: self.washed_out_ml,
            held: self.held,
            hold_m: self.hold_m,
            taken_out: self.taken_out,
            taken_out_ml: self.taken_out_ml,
        }
    }
}

pub(crate) fn number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
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
