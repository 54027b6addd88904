//! What a tissue says of itself in its page.

use bytemuck::{Pod, Zeroable};

/// What is said of [`TissueStatus::cut_limits`].
pub const CUT_LIMIT: &str = "the loop cuts no finer here: the mesh has reached its limit";

/// What tissue says of itself each step.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct TissueStatus {
    /// Tick of the newest state.
    pub state_tick: u64,
    /// Hash of the newest state.
    pub state_hash: u64,
    /// Volume of pathology removed so far, ml: what nothing holds any more, and what was burnt of it; nothing of other tissue.
    pub removed_volume_ml: f64,
    /// Volume of the largest piece of it that has come free so far, ml; of those that the same cut parted the sum. No number in a recording of before it
    /// was told.
    pub largest_piece_ml: f64,
    /// Volume of other tissue that was taken off so far, ml: what of the organ nothing holds any more, and what was burnt of it. No number in a recording of
    /// before it was told.
    pub healthy_removed_ml: f64,
    /// Pressure of the medium in the cavity, Pa, as used in the step.
    pub cavity_pressure_pa: f32,
    /// Contacts found in the step.
    pub contact_count: u32,
    /// Force of the tissue on the tool in the step, N: the sum of all, wherever they act, with friction and damping.
    pub tool_force_n: [f32; 3],
    /// Shares of the intersection test that the coordinator had to compute itself, so far.
    pub shares_missing: u32,
    /// Time of each part of the last step, µs: deformation, collision, response, surface.
    pub phase_us: [f32; 4],
    /// Objects that are registered with the Site Manager.
    pub objects: u32,
    /// Engines that are registered with the Site Manager, a bit for each slot.
    pub engines: u32,
    /// Length of a step, ticks.
    pub step_ticks: u32,
    /// Sweeps of the electrode that changed the mesh, so far.
    pub cuts: u32,
    /// 1 while a stroke is under way.
    pub is_cutting: u32,
    /// Version of the mesh.
    pub topology_version: u32,
    /// Pieces that have left through the outflow, so far.
    pub washed_out: u32,
    /// Their volume, ml. Of what is to be removed it is in `removed_volume_ml` too, since it came free.
    pub washed_out_ml: f32,
    /// Points of tissue that the jaws hold.
    pub held: u32,
    /// How far the jaws were apart when they took hold, m, and are at least until they have opened so far again; 0 of such that have.
    pub hold_m: f32,
    /// Pieces that were taken out in the jaws, so far.
    pub taken_out: u32,
    /// Their volume, ml, likewise.
    pub taken_out_ml: f32,
    /// Sweeps of the electrode that cut coarser than was asked for, because the mesh has reached its limit, or that were refused, so far.
    pub cut_limits: u32,
    /// Substeps of the last step.
    pub substeps: u32,
    /// What the steps had to mend so far: nodes that were put back, stood at the greatest speed or came with a number that is none. 0 in a healthy session.
    pub corrections: u32,
    /// Hits of the intersection test that found no room, so far.
    pub hits_dropped: u32,
}
