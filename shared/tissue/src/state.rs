//! What goes into a step and what comes out of it: plain slices, so that they may lie in shared memory.

use crate::links::{Attachment, ContactLaw, Hold, PairSpring, PlaneSpring};
use crate::pressure::Pressure;

/// The state at one tick, one entry per node, in the caller's frame.
#[derive(Debug, Clone, Copy)]
pub struct StateRef<'a> {
    /// Positions, m.
    pub position_m: &'a [[f32; 3]],
    /// Velocities, m/s.
    pub velocity_m_s: &'a [[f32; 3]],
}

/// Where the next state is written; every entry is.
#[derive(Debug)]
pub struct StateMut<'a> {
    /// Positions, m.
    pub position_m: &'a mut [[f32; 3]],
    /// Velocities, m/s.
    pub velocity_m_s: &'a mut [[f32; 3]],
}

/// What acts on the object during the step.
#[derive(Debug, Clone, Copy)]
pub struct StepInput<'a> {
    /// Force on each node, N, constant over the step; or empty. What follows the tissue belongs into the other fields, not here.
    pub external_force_n: &'a [[f32; 3]],
    /// Where held nodes are at the end of the step, m, one per node (those of free nodes are not read); or empty: they stay.
    pub targets_m: &'a [[f32; 3]],
    /// Contacts of this step with what is not of this model.
    pub springs: &'a [PlaneSpring],
    /// Contacts of this step within the model.
    pub pairs: &'a [PairSpring],
    /// What is held from outside of the model in this step.
    pub holds: &'a [Hold],
    /// Attachments that hold in this step.
    pub attachments: &'a [Attachment],
    /// What presses on its boundary.
    pub pressure: Pressure<'a>,
    /// How contacts answer.
    pub law: ContactLaw,
    /// Step, s.
    pub dt_s: f32,
}

impl Default for StepInput<'_> {
    /// Nothing acts, for 1 ms.
    fn default() -> Self {
        StepInput {
            external_force_n: &[],
            targets_m: &[],
            springs: &[],
            pairs: &[],
            holds: &[],
            attachments: &[],
            pressure: Pressure::default(),
            law: ContactLaw::default(),
            dt_s: 1e-3,
        }
    }
}

/// What the step did.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct StepReport {
    /// Substeps taken.
    pub substeps: u32,
    /// Elastic energy of the state read, J.
    pub elastic_energy_j: f64,
    /// Tets that are inverted in the state read.
    pub inverted_tets: u32,
    /// Positions, velocities, forces or targets that were not finite or out of reach, and were replaced.
    pub neutralised_inputs: u32,
    /// Nodes whose velocity stands at the cap in the state written.
    pub capped_nodes: u32,
    /// Nodes that came out not finite or out of reach and were put back to where they were, at rest.
    pub recovered_nodes: u32,
    /// Springs and attachments that were softened to the contact stiffness of the model.
    pub softened_springs: u32,
    /// Springs and attachments that were ignored: index out of range, weight outside 0 to 1, no unit normal, not finite.
    pub ignored_springs: u32,
}

impl StepReport {
    /// What the watchdog mended: 0 in a healthy step.
    pub fn corrections(&self) -> u32 {
        self.neutralised_inputs.saturating_add(self.capped_nodes).saturating_add(self.recovered_nodes)
    }
}

/// Why a step could not be taken; nothing was written.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum StepError {
    /// An array of the wrong length.
    #[error("{what} has {found} entries, the model has {expected} nodes; the state belongs to another model")]
    Length {
        /// Which array.
        what: &'static str,
        /// Number of nodes.
        expected: usize,
        /// Its length.
        found: usize,
    },
    /// The step is not a number from just above 0 to 20 ms.
    #[error("dt_s is {0}: give a step above 0 and up to 0.02 s")]
    Step(f32),
    /// The step needs too many substeps.
    #[error("a step of {dt_s} s needs {substeps} substeps, more than 256; take a shorter step")]
    Substeps {
        /// The step, s.
        dt_s: f32,
        /// Substeps that it needs.
        substeps: u32,
    },
}
