//! Deformation engine of the Main Loop: soft tissue as linear tetrahedra, explicit corotational finite elements.
//!
//! An engine is a function, its state is a message: [`step`] reads the state of tick t (positions and velocities, plain slices)
//! and writes the state of t+1. Everything else that it needs is in the immutable [`Model`] or is recomputed, so that a spare
//! which holds the last state computes the same bits. Promises, each with a test:
//! - a step allocates nothing and never panics; no finite or non-finite input makes a NaN in its output;
//! - same model, same input, same instruction set: same bits; AVX2 and AVX-512 agree bit for bit;
//! - the substeps of a step follow from a bound on the largest eigenvalue, contact stiffness included.
//!
//! The frame is the caller's; units are SI. Method: velocity Verlet in substeps. Element rotations are frozen for one step
//! (after Müller and Gross, "Interactive Virtual Materials", 2004) and found as the global maximiser of tr(RᵀF) (Horn 1987),
//! which is a rotation for inverted and flat elements too. The pressure is clamped, so that the stiffness of an element never
//! exceeds its bound. Tissue that hardly gives way to pressure, of a Poisson's ratio above 0.45, holds its volume at the nodes. Objects that hold each other ([`Attachment`]) are joined into one model ([`join`]).
//! Cutting is a function of the same kind: [`cut()`] changes a [`Cuttable`], from which a [`ModelMaker`] makes a new model.

mod bed;
mod bound;
mod build;
mod bulk;
mod check;
mod cut;
mod equilibrium;
mod forces;
mod isa;
mod kernel;
mod lanes;
#[cfg(target_arch = "x86_64")]
mod lanes_x86;
mod layout;
mod links;
mod material;
mod model;
mod peak;
mod polar;
mod pressure;
mod spectrum;
mod state;
mod step;

pub use build::ModelMaker;
pub use cut::{
    BoundSkin, Changed, Cut, CutError, CutOptions, CutReport, Cuttable, LooseSkin, MAX_WIRE_POINTS, Objects, Seat, Skin, cut,
    cut_and_bind, keep_momentum,
};
pub use equilibrium::holding_forces;
pub use forces::{BoundSurface, gather, join, pressure_forces, scatter, surface_update};
pub use isa::Isa;
pub use links::{Attachment, ContactLaw, Hold, PairSpring, PlaneSpring, Push};
pub use material::{Material, MaterialError, POISSON_RATIO_MAX};
pub use model::{Model, ModelError, ModelReport, Options};
pub use peak::{FORCE_OPERATIONS, ROTATION_OPERATIONS, busy, operations};
pub use pressure::Pressure;
pub use state::{StateMut, StateRef, StepError, StepInput, StepReport};
pub use step::{Scratch, step};
