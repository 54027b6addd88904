//! What a tissue says of itself as a message of its channel, and back.

use crate::messages::{Number, Xyz, is_unknown, number, unknown};
use hyst_messages::TissueStatus;
use serde::{Deserialize, Serialize};

#[derive(Default, Serialize, Deserialize)]
#[serde(default)]
struct Phases {
    #[serde(skip_serializing_if = "Number::is_none")]
    deformation: Number,
    #[serde(skip_serializing_if = "Number::is_none")]
    collision: Number,
    #[serde(skip_serializing_if = "Number::is_none")]
    response: Number,
    #[serde(skip_serializing_if = "Number::is_none")]
    surface: Number,
}

/// Message of `/tissue`.
#[derive(Serialize, Deserialize)]
pub(crate) struct Tissue {
    tick: u64,
    /// Hexadecimal, because readers in JavaScript have 53 bits.
    state_hash: String,
    #[serde(default = "unknown", skip_serializing_if = "is_unknown", deserialize_with = "number")]
    removed_volume_ml: f64,
    /// Older recordings do not have it: no number then.
    #[serde(default = "unknown", skip_serializing_if = "is_unknown", deserialize_with = "number")]
    largest_piece_ml: f64,
    /// Likewise.
    #[serde(default = "unknown", skip_serializing_if = "is_unknown", deserialize_with = "number")]
    healthy_removed_ml: f64,
    #[serde(default, skip_serializing_if = "Number::is_none")]
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
    /// Likewise.
    #[serde(default, skip_serializing_if = "Number::is_none")]
    washed_out_ml: Number,
    #[serde(default)]
    held: u32,
    /// Likewise.
    #[serde(default, skip_serializing_if = "Number::is_none")]
    hold_m: Number,
    #[serde(default)]
    taken_out: u32,
    /// Likewise.
    #[serde(default, skip_serializing_if = "Number::is_none")]
    taken_out_ml: Number,
    #[serde(default)]
    cut_limits: u32,
    #[serde(default)]
    substeps: u32,
    #[serde(default)]
    corrections: u32,
    #[serde(default)]
    hits_dropped: u32,
}

impl Tissue {
    pub(crate) fn of(status: &TissueStatus) -> Tissue {
        let [deformation, collision, response, surface] = status.phase_us.map(Number);
        Tissue {
            tick: status.state_tick,
            state_hash: format!("{:016x}", status.state_hash),
            removed_volume_ml: status.removed_volume_ml,
            largest_piece_ml: status.largest_piece_ml,
            healthy_removed_ml: status.healthy_removed_ml,
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
            washed_out_ml: Number(status.washed_out_ml),
            held: status.held,
            hold_m: Number(status.hold_m),
            taken_out: status.taken_out,
            taken_out_ml: Number(status.taken_out_ml),
            cut_limits: status.cut_limits,
            substeps: status.substeps,
            corrections: status.corrections,
            hits_dropped: status.hits_dropped,
        }
    }
    pub(crate) fn status(&self) -> TissueStatus {
        let phases = &self.phase_us;
        TissueStatus {
            state_tick: self.tick,
            state_hash: u64::from_str_radix(&self.state_hash, 16).unwrap_or(0),
            removed_volume_ml: self.removed_volume_ml,
            largest_piece_ml: self.largest_piece_ml,
            healthy_removed_ml: self.healthy_removed_ml,
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
            washed_out_ml: self.washed_out_ml.0,
            held: self.held,
            hold_m: self.hold_m.0,
            taken_out: self.taken_out,
            taken_out_ml: self.taken_out_ml.0,
            cut_limits: self.cut_limits,
            substeps: self.substeps,
            corrections: self.corrections,
            hits_dropped: self.hits_dropped,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_an_older_recorder_did_not_count_is_none_and_what_this_one_counts_comes_back() {
        let known = TissueStatus { cuts: 5, ..TissueStatus::default() };
        let counts = TissueStatus { cut_limits: 2, substeps: 8, corrections: 3, hits_dropped: 1, ..known };
        let mut message = serde_json::to_value(Tissue::of(&counts)).unwrap();
        let read = |message: &serde_json::Value| serde_json::from_value::<Tissue>(message.clone()).unwrap().status();
        assert_eq!(read(&message), counts);
        for key in ["cut_limits", "substeps", "corrections", "hits_dropped"] {
            assert!(message.as_object_mut().unwrap().remove(key).is_some(), "{key}");
        }
        assert_eq!(read(&message), known);
    }

    #[test]
    fn healthy_tissue_that_an_older_recorder_knew_nothing_of_is_no_number() {
        let status = TissueStatus { healthy_removed_ml: 0.125, ..TissueStatus::default() };
        let mut message = serde_json::to_value(Tissue::of(&status)).unwrap();
        let read = |message: &serde_json::Value| serde_json::from_value::<Tissue>(message.clone()).unwrap().status();
        assert_eq!(read(&message), status);
        assert!(message.as_object_mut().unwrap().remove("healthy_removed_ml").is_some());
        let old = read(&message);
        assert!(old.healthy_removed_ml.is_nan() && old.removed_volume_ml == 0.0, "{old:?}");
    }
}
