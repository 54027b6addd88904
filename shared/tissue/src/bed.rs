//! What holds nodes at their places at rest from outside of all models: ligaments, and the tissue around an organ, as a bed of springs.
//!
//! Promise: the bed's stiffness is a part of the model's bound, so that explicit integration is as stable with it as without: where a bed is too stiff for
//! the step, mass is added as for stiff tissue. Held nodes have none.

/// What holds a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bed {
    pub node: u32,
    /// N/m.
    pub stiffness_n_m: f32,
}

/// Adds the forces at `position` to `force`.
pub(crate) fn add_forces(beds: &[Bed], rest_m: &[[f32; 3]], position: &[[f32; 4]], force: &mut [[f32; 4]]) {
    for bed in beds {
        let node = bed.node as usize;
        for axis in 0..3 {
            force[node][axis] += bed.stiffness_n_m * (rest_m[node][axis] - position[node][axis]);
        }
    }
}
