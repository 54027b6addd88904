//! What a step is told from outside, and how values that no station should send are made harmless.
//!
//! Promise: after [`FlowInputs::neutralised`] every number is finite and in range; what was replaced is counted, never obeyed.

use crate::blood::BloodSource;
use crate::bubbles::GasSource;
use crate::pump::PumpInput;

/// Solid tools at most: a scope, and room to spare.
pub const MAX_TOOLS: usize = 4;
/// Straight pieces of wire at most: a loop in sixteen.
pub const MAX_WIRES: usize = 16;
/// Inflow and outflow ports at most.
pub const MAX_PORTS: usize = 8;
/// Bleeding points at most.
pub const MAX_SOURCES: usize = 16;
/// No fluid, tool or jet is faster; the fastest jet out of a 3 mm sheath at 800 ml/min is 2 m/s.
pub const MAX_SPEED_M_S: f32 = 20.0;
/// The longest step, s. A longer one is cut to this length and counted.
pub const MAX_STEP_S: f32 = 0.25;

/// A moving obstacle: all points within `radius_m` of the segment from `a_m` to `b_m`; velocity is linear between its ends.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Capsule {
    /// One end, m, station frame.
    pub a_m: [f32; 3],
    /// The other end, m.
    pub b_m: [f32; 3],
    /// Radius, m; 0 switches the capsule off.
    pub radius_m: f32,
    /// Velocity of the end `a_m`, m/s.
    pub velocity_a_m_s: [f32; 3],
    /// Velocity of the end `b_m`, m/s.
    pub velocity_b_m_s: [f32; 3],
}

/// A ball of cells where medium enters or leaves. Ports of one kind share the pump's flow by `share`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Port {
    /// Centre, m, station frame.
    pub centre_m: [f32; 3],
    /// Fluid cells whose centre is within this distance take part (at least the nearest one within two cells), m.
    pub radius_m: f32,
    /// Unit direction of the jet at an inflow; zero for an inflow without momentum and for outflows.
    pub direction: [f32; 3],
    /// Share of the pump's flow, ≥ 0; 0 switches the port off.
    pub share: f32,
    /// True where medium enters.
    pub inflow: bool,
    /// Volume fraction of dye in what enters, 0..1.
    pub dye: f32,
}

/// A way that medium takes out of the cavity and not back: a hole in the wall, or past the sheath. It leaves from the fluid that is nearest.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Way {
    /// Its middle, m, station frame.
    pub centre_m: [f32; 3],
    /// Fluid cells whose centre is within this distance take part, m; 0: nobody knows where it is, and what leaves by it takes nothing along.
    pub radius_m: f32,
}

/// Everything a step is told. Plain data; unused entries are left at their default.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FlowInputs {
    /// Length of the step, s.
    pub dt_s: f32,
    /// Moving obstacles that fill cells.
    pub tools: [Capsule; MAX_TOOLS],
    /// Moving obstacles that are thinner than a cell: they fill none, and the medium across them drags.
    pub wires: [Capsule; MAX_WIRES],
    /// Where the pump's flow enters and leaves the grid.
    pub ports: [Port; MAX_PORTS],
    /// Where vessels are open.
    pub blood: [BloodSource; MAX_SOURCES],
    /// The hole that [`PumpInput::perforation`] is the size of.
    pub hole: Way,
    /// Where the medium leaks past the sheath.
    pub leak: Way,
    /// Where gas comes into being.
    pub gas: GasSource,
    /// Settings of the pump.
    pub pump: PumpInput,
    /// Acceleration of the medium, m/s² (zero in the paper: gravity is balanced by the hydrostatic pressure).
    pub acceleration_m_s2: [f32; 3],
}

/// Replaces a number that is not finite or outside `low..=high` and counts it.
pub(crate) fn tame(value: &mut f32, low: f32, high: f32, otherwise: f32, count: &mut u32) {
    if !value.is_finite() {
        *value = otherwise;
        *count += 1;
    } else if *value < low || *value > high {
        *value = value.clamp(low, high);
        *count += 1;
    }
}

/// The same of a place, m: nothing of a station is a kilometre away.
pub(crate) fn tame_place(place_m: &mut [f32; 3], count: &mut u32) {
    for coordinate_m in place_m {
        tame(coordinate_m, -1e3, 1e3, 0.0, count);
    }
}

impl FlowInputs {
    /// The same inputs with every number finite and in range, and how many were replaced.
    pub fn neutralised(&self) -> (Self, u32) {
        let mut inputs = *self;
        let mut count = 0;
        tame(&mut inputs.dt_s, 0.0, MAX_STEP_S, 0.0, &mut count);
        for a in &mut inputs.acceleration_m_s2 {
            tame(a, -100.0, 100.0, 0.0, &mut count);
        }
        for tool in inputs.tools.iter_mut().chain(&mut inputs.wires) {
            let before = count;
            tame_place(&mut tool.a_m, &mut count);
            tame_place(&mut tool.b_m, &mut count);
            tame(&mut tool.radius_m, 0.0, 1.0, 0.0, &mut count);
            if count > before {
                tool.radius_m = 0.0; // a capsule at a place that nobody named is no obstacle
            }
            for v in tool.velocity_a_m_s.iter_mut().chain(&mut tool.velocity_b_m_s) {
                tame(v, -MAX_SPEED_M_S, MAX_SPEED_M_S, 0.0, &mut count);
            }
        }
        for port in &mut inputs.ports {
            count += port.tame();
        }
        for source in &mut inputs.blood {
            count += source.tame();
        }
        count += inputs.hole.tame() + inputs.leak.tame();
        count += inputs.gas.tame() + inputs.pump.tame();
        (inputs, count)
    }
}

impl Way {
    fn tame(&mut self) -> u32 {
        let mut count = 0;
        tame_place(&mut self.centre_m, &mut count);
        tame(&mut self.radius_m, 0.0, 1.0, 0.0, &mut count);
        if count > 0 {
            self.radius_m = 0.0;
        }
        count
    }
}

impl Port {
    fn tame(&mut self) -> u32 {
        let mut count = 0;
        tame_place(&mut self.centre_m, &mut count);
        tame(&mut self.radius_m, 0.0, 1.0, 0.0, &mut count);
        tame(&mut self.share, 0.0, 1e3, 0.0, &mut count);
        if count > 0 {
            self.share = 0.0;
        }
        for d in &mut self.direction {
            tame(d, -1.0, 1.0, 0.0, &mut count);
        }
        tame(&mut self.dye, 0.0, 1.0, 0.0, &mut count);
        count
    }
}
