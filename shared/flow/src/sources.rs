//! Where medium enters and leaves the grid in a step, and how much of it in each cell.
//!
//! Promise: each port has a share of the list of its own, so that a large one takes nothing from the others, however fine the grid; a port with an open valve
//! and without a cell is counted.

use crate::coordinator::Coordinator;
use crate::error::FlowError;
use crate::field::Read;
use crate::grid::Layout;
use crate::inputs::{MAX_PORTS, MAX_SPEED_M_S, Port};
use crate::plan::{Plan, Source};
use crate::ports;
use crate::solver::Solver;

/// Cells of a port at most. A scope's ports, balls of 3 mm, have 3 400 in cells of 0.27 × 0.28 × 0.44 mm; in finer ones they become smaller.
const MOST_PORT_CELLS: usize = 4_096;

/// Cells of all sources at most, in a grid of so many.
pub(crate) fn most_cells(cells: usize) -> usize {
    MAX_PORTS * MOST_PORT_CELLS.min(cells)
}

/// A place through which medium comes or goes.
struct Mouth {
    centre_m: [f32; 3],
    radius_m: f32,
    /// Into the grid, m³/s; below 0 out of it.
    flow_m3_s: f64,
    /// Dye fraction of what enters.
    dye: f32,
    jet_m_s: Option<[f32; 3]>,
    /// Cells at most.
    most: usize,
}

/// Index of a source's cell, without ghosts.
fn index_of(layout: &Layout, source: &Source) -> usize {
    let (j, i) = (source.at / layout.stride - 1, source.at % layout.stride - 1);
    ((source.kk - 1) * layout.n[1] + j) * layout.n[0] + i
}

impl Solver {
    /// Spreads the pump's flow over the cells of the ports. Returns how many cells the fastest jet crosses per second.
    pub(crate) fn place_sources(&self, c: &mut Coordinator, plan: &mut Plan) -> Result<f32, FlowError> {
        for source in &plan.sources {
            plan.sinks[index_of(&self.layout, source)] = false;
        }
        plan.sources.clear();
        c.largest_rate_per_s = 0.0;
        let mut fastest = 0.0f32;
        let fluid = self.fluid.read()?;
        let ports = plan.inputs.ports;
        for port in ports.iter().filter(|port| port.share > 0.0) {
            let mouth = self.mouth_of(port, plan);
            let pump = &plan.inputs.pump;
            let valve = if port.inflow { pump.inflow_valve } else { pump.outflow_valve };
            if valve <= 0.0 && mouth.flow_m3_s == 0.0 {
                continue;
            }
            if !self.place(&mouth, &fluid, c, plan) {
                c.report.blind_ports += 1; // it lies in a solid: its flow widens or narrows the cavity but drives nothing
                continue;
            }
            for (v, h) in mouth.jet_m_s.iter().flatten().zip(self.model.grid.spacing_m()) {
                fastest = fastest.max(v.abs() / h);
            }
        }
        plan.order_sources();
        Ok(fastest)
    }

    /// A port with what the pump moves through it.
    fn mouth_of(&self, port: &Port, plan: &Plan) -> Mouth {
        let total: f32 = plan.inputs.ports.iter().filter(|other| other.inflow == port.inflow).map(|other| other.share).sum();
        let flow_ml_s = if port.inflow { plan.pump.in_ml_s } else { -plan.pump.out_ml_s };
        let flow_m3_s = flow_ml_s * 1e-6 * f64::from(port.share / total);
        let jet_m_s = if flow_m3_s > 0.0 { ports::jet_m_s(&self.model.grid, port, flow_m3_s) } else { None };
        let jet_m_s = jet_m_s.map(|jet_m_s| jet_m_s.map(|v| v.clamp(-MAX_SPEED_M_S, MAX_SPEED_M_S)));
        Mouth { centre_m: port.centre_m, radius_m: port.radius_m, flow_m3_s, dye: port.dye, jet_m_s, most: MOST_PORT_CELLS }
    }

    /// Puts a mouth's cells into the list, if something flows. Whether it has any.
    fn place(&self, mouth: &Mouth, fluid: &Read<'_>, c: &mut Coordinator, plan: &mut Plan) -> bool {
        let (grid, layout) = (&self.model.grid, &*self.layout);
        let is_fluid = |kk: usize, at: usize| fluid.layer(kk)[at] > 0.0;
        let reach_m = ports::reach_m(grid, layout, mouth.centre_m, mouth.radius_m, mouth.most, is_fluid);
        let Some(reach_m) = reach_m else { return false };
        if mouth.flow_m3_s == 0.0 {
            return true;
        }
        let from = plan.sources.len();
        ports::within(grid, layout, mouth.centre_m, reach_m, |kk, at| {
            let order = plan.sources.len();
            if is_fluid(kk, at) && order < from + mouth.most {
                plan.sources.push(Source { kk, at, order: order as u32, ..Default::default() });
            }
        });
        let cells = plan.sources.len() - from;
        let rate_per_s = (mouth.flow_m3_s / (grid.cell_volume_m3() * cells as f64)) as f32;
        c.largest_rate_per_s = c.largest_rate_per_s.max(-rate_per_s);
        for source in &mut plan.sources[from..] {
            (source.rate_per_s, source.dye) = (rate_per_s, mouth.dye);
            (source.has_jet, source.jet_m_s) = (mouth.jet_m_s.is_some(), mouth.jet_m_s.unwrap_or_default());
            plan.sinks[index_of(layout, source)] = rate_per_s < 0.0;
        }
        true
    }
}
