//! The Flow Engine's mathematics: distension medium in the cavity, pump, blood, and gas.
//!
//! Incompressible Navier–Stokes on a staggered grid with solid cells and moving tools, in the order of the paper (Stam 1999; Zátonyi
//! et al., MedIA 2005): forces with in- and outflow, diffusion, self-advection, mass conservation. No threads, no clock, no files here.
//!
//! - [`FlowModel`] is what does not change; [`Solver`] holds the fields; [`Solver::store`] writes the state as a message, and
//!   [`Solver::load`] makes a spare continue with the same bits.
//! - [`Solver::step_serial`] computes a step on one thread; [`Solver::begin`], [`Solver::next_phase`] and [`Solver::run_phase`] let
//!   several threads compute bands of layers with the same result, bit for bit.

mod alarms;
mod blood;
mod bubbles;
mod coarsen;
mod coarsest;
mod components;
mod coordinator;
mod curve;
mod dye;
mod error;
mod field;
mod grid;
mod hold;
mod initial;
mod inputs;
mod kernels;
mod model;
mod multigrid;
mod obstacles;
mod plan;
mod planes;
mod ports;
mod prepare;
mod pressure;
mod pump;
mod roller;
mod room;
mod rows;
mod sample;
mod sight;
mod solver;
mod sources;
mod spans;
mod state;
mod traction;
mod transport;
mod walls;
mod wires;

pub use alarms::Alarms;
pub use blood::{BloodSource, BloodState, MOST_OPENING, Particle};
pub use bubbles::{BubbleModel, BubbleState, GasSource, MAX_BUBBLES};
pub use coordinator::{MAX_SWEEPS, StepReport};
pub use error::FlowError;
pub use grid::{Grid, MAX_AXIS, MAX_BANDS, MAX_CELLS};
pub use inputs::{Capsule, FlowInputs, MAX_PORTS, MAX_SOURCES, MAX_SPEED_M_S, MAX_STEP_S, MAX_TOOLS, MAX_WIRES, Port, Way};
pub use model::{BloodModel, FlowModel, Medium, Wall};
pub use pump::{PA_PER_MMHG, PumpInput, PumpModel, PumpReport, PumpState};
pub use roller::Beat;
pub use sight::{EXTINCTION_PER_M, SIGHT_M, transmittance};
pub use solver::{Phase, Solver};
pub use state::{StateView, state_bytes};
pub use traction::Load;
