//! The force of a contact on a point of an instrument, as the deformation found it.

use bytemuck::{Pod, Zeroable};

/// The force on one point. Plain old data.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
pub struct ContactForce {
    /// Index of the point.
    pub point: u32,
    /// Its object.
    pub owner: u32,
    /// Where it is, metres.
    pub place_m: [f32; 3],
    /// Unit vector out of the tissue.
    pub direction: [f32; 3],
    /// Force on the point along the direction, N, at least 0, without friction.
    pub normal_n: f32,
    /// Change of the normal force with depth, N/m.
    pub stiffness_n_m: f32,
    /// Change of the normal force with the speed of entering, N·s/m.
    pub damping_n_s_m: f32,
}
