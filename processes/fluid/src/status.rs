//! What a fluid says of itself: the first section of its states, and the status in it, which its page has too.

use bytemuck::{Pod, Zeroable};
use hyst_flow::{Alarms, Grid, PumpState, StepReport};
use hyst_messages::{FLOW_FLAWS, FluidStatus, Kind, Message, PUMP_ALARMS, StreamHeader, fnv_words};

/// First section of a fluid state.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct Head {
    /// What the page says too.
    pub status: FluidStatus,
    /// Lowest corner of the grid, m.
    pub origin_m: [f32; 3],
    /// Edges of a cell, m.
    pub spacing_m: [f32; 3],
    /// Cells along x, y, z.
    pub cells: [u32; 3],
    /// Padding, zero.
    pub reserved: u32,
}

impl Head {
    /// Of a status and the grid that the state is on.
    pub fn of(status: FluidStatus, grid: &Grid) -> Head {
        let cells = grid.cells().map(|count| count as u32);
        Head { status, origin_m: grid.origin_m(), spacing_m: grid.spacing_m(), cells, reserved: 0 }
    }
}

/// What the page says of a step.
pub fn status_of(report: &StepReport, pump: &PumpState) -> FluidStatus {
    // What is kept of walls and sample, and whether the walls are open, the engine knows.
    let mended = [report.neutralised > 0, report.wild > 0, false, false];
    let as_they_were = [report.slowed, report.unconverged, report.blind_ports > 0, false];
    let alarms = &report.pump.alarms;
    let is_on = [alarms.pressure, alarms.deficit, alarms.abnormal_loss, alarms.perforation, alarms.container];
    FluidStatus {
        deficit_ml: pump.deficit_ml(),
        cavity_volume_ml: pump.cavity_ml,
        bled_ml: pump.bled_ml,
        pressure_pa: report.pump.pressure_pa as f32,
        inflow_ml_min: (report.pump.in_ml_s * 60.0) as f32,
        outflow_ml_min: (report.pump.out_ml_s * 60.0) as f32,
        alarms: bits(&PUMP_ALARMS, &is_on),
        flaws: bits(&FLOW_FLAWS[..4], &mended) | bits(&FLOW_FLAWS[4..], &as_they_were),
        ..FluidStatus::default()
    }
}

/// The alarms that stand in a status.
pub(crate) fn alarms_of(status: &FluidStatus) -> Alarms {
    let [pressure, deficit, abnormal_loss, perforation, container] = PUMP_ALARMS.map(|(bit, _)| status.alarms & bit != 0);
    Alarms { pressure, deficit, abnormal_loss, perforation, container }
}

/// The bits that are set.
fn bits(names: &[(u32, &str)], is_set: &[bool]) -> u32 {
    names.iter().zip(is_set).map(|((bit, _), is_set)| if *is_set { *bit } else { 0 }).sum()
}

/// Hash of the solver's block in a state; 0 of what is no state.
pub(crate) fn hash_of(state: &[u8]) -> u64 {
    let message = Message::parse(state, Kind::FluidState);
    let word = |chunk: &[u8]| chunk.iter().rev().fold(0, |word, byte| word << 8 | u64::from(*byte));
    message.and_then(|message| message.section::<u8>(1)).map_or(0, |block| fnv_words(0, block.chunks(8).map(word)))
}

/// Whether the numbers of a status can be.
pub(crate) fn is_sane(status: &FluidStatus) -> bool {
    let numbers = [status.deficit_ml, status.cavity_volume_ml, status.bled_ml, status.pressure_pa as f64];
    let is_share = (0.0..=1.0).contains(&status.transmittance);
    is_share && numbers.iter().all(|value| value.is_finite()) && status.on_scope_n.iter().all(|force| force.is_finite())
}

/// Whether a status is of the state that it stands in: one that stands still while its stamp goes on is not. A state that founds the role was computed for
/// another tick, and says so by a step of 0.
pub(crate) fn is_of(status: &FluidStatus, header: &StreamHeader) -> bool {
    status.state_tick == header.tick || header.step_ticks == 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::{SealRecord, contents};

    #[test]
    fn the_records_of_a_state_are_those_that_the_documents_say() {
        let records = [size_of::<Head>(), 1, size_of::<f32>(), size_of::<hyst_flow::Particle>(), size_of::<SealRecord>()];
        assert_eq!(contents::record_bytes(Kind::FluidState), records);
    }
}
