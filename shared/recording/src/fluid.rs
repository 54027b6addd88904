//! What a fluid says of itself as a message of its channel, and back.

use crate::messages::{Number, Xyz, is_unknown, number, unknown};
use hyst_messages::FluidStatus;
use serde::{Deserialize, Serialize};

/// Message of `/fluid`.
#[derive(Serialize, Deserialize)]
pub(crate) struct Fluid {
    tick: u64,
    #[serde(default = "unknown", skip_serializing_if = "is_unknown", deserialize_with = "number")]
    deficit_ml: f64,
    #[serde(default = "unknown", skip_serializing_if = "is_unknown", deserialize_with = "number")]
    cavity_volume_ml: f64,
    #[serde(default, skip_serializing_if = "Number::is_none")]
    pressure_pa: Number,
    #[serde(default, skip_serializing_if = "Number::is_none")]
    inflow_ml_min: Number,
    #[serde(default, skip_serializing_if = "Number::is_none")]
    outflow_ml_min: Number,
    alarms: u32,
    /// Older recordings do not have it: no number then.
    #[serde(default = "unknown", skip_serializing_if = "is_unknown", deserialize_with = "number")]
    bled_ml: f64,
    #[serde(default)]
    step_ticks: u32,
    #[serde(default)]
    scene_step_ticks: u32,
    #[serde(default)]
    halvings: u32,
    /// Hexadecimal, because readers in JavaScript have 53 bits.
    #[serde(default)]
    state_hash: String,
    #[serde(default)]
    flaws: u32,
    #[serde(default)]
    open_vessels: u32,
    /// In older recordings the loop could seal none.
    #[serde(default)]
    sealed_vessels: u32,
    /// Older recordings do not have it: no numbers then.
    #[serde(default)]
    on_scope_n: Xyz,
    /// Likewise: no number then.
    #[serde(default, skip_serializing_if = "Number::is_none")]
    transmittance: Number,
}

impl Fluid {
    pub(crate) fn of(status: &FluidStatus) -> Fluid {
        Fluid {
            tick: status.state_tick,
            deficit_ml: status.deficit_ml,
            cavity_volume_ml: status.cavity_volume_ml,
            pressure_pa: Number(status.pressure_pa),
            inflow_ml_min: Number(status.inflow_ml_min),
            outflow_ml_min: Number(status.outflow_ml_min),
            alarms: status.alarms,
            bled_ml: status.bled_ml,
            step_ticks: status.step_ticks,
            scene_step_ticks: status.scene_step_ticks,
            halvings: status.halvings,
            state_hash: format!("{:016x}", status.state_hash),
            flaws: status.flaws,
            open_vessels: status.open_vessels,
            sealed_vessels: status.sealed_vessels,
            on_scope_n: Xyz::of(status.on_scope_n),
            transmittance: Number(status.transmittance),
        }
    }
    pub(crate) fn status(&self) -> FluidStatus {
        FluidStatus {
            state_tick: self.tick,
            deficit_ml: self.deficit_ml,
            cavity_volume_ml: self.cavity_volume_ml,
            pressure_pa: self.pressure_pa.0,
            inflow_ml_min: self.inflow_ml_min.0,
            outflow_ml_min: self.outflow_ml_min.0,
            alarms: self.alarms,
            bled_ml: self.bled_ml,
            step_ticks: self.step_ticks,
            scene_step_ticks: self.scene_step_ticks,
            halvings: self.halvings,
            state_hash: u64::from_str_radix(&self.state_hash, 16).unwrap_or(0),
            flaws: self.flaws,
            open_vessels: self.open_vessels,
            sealed_vessels: self.sealed_vessels,
            on_scope_n: self.on_scope_n.array(),
            transmittance: self.transmittance.0,
            ..FluidStatus::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_recording_from_before_it_was_recorded_says_of_blood_scope_and_view_is_no_number_and_no_vessel_was_sealed_then() {
        let status = FluidStatus {
            state_tick: 33,
            deficit_ml: 12.5,
            bled_ml: 0.75,
            open_vessels: 5,
            sealed_vessels: 2,
            on_scope_n: [0.02, -0.0, 1.0 / 3.0],
            transmittance: 1.0 / 3.0,
            ..FluidStatus::default()
        };
        let mut json = serde_json::to_value(Fluid::of(&status)).unwrap();
        let read = |json: &serde_json::Value| serde_json::from_value::<Fluid>(json.clone()).unwrap().status();
        assert_eq!(read(&json), status);
        for name in ["bled_ml", "open_vessels", "sealed_vessels", "on_scope_n", "transmittance"] {
            json.as_object_mut().unwrap().remove(name).unwrap();
        }
        let old = read(&json);
        assert!(old.bled_ml.is_nan() && old.deficit_ml == 12.5 && old.sealed_vessels == 0, "{old:?}");
        assert!(old.on_scope_n.iter().all(|force| force.is_nan()), "{old:?}");
        assert!(old.transmittance.is_nan() && old.told_transmittance().is_none(), "{old:?}");
    }
}
