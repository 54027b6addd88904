//! Where medium enters and leaves the grid in a step, and how much of it in each cell: through the ports, out of open vessels and into them, through a hole,
//! past the sheath.
//!
//! Promise: each has a share of the list of its own, so that a large one takes nothing from the others, however fine the grid; a port with an open valve and
//! without a cell is counted. What all give together and does not leave widens the cavity evenly ([`crate::pressure`]), as it does where one finds no cell.

use crate::coordinator::Coordinator;
use crate::error::FlowError;
use crate::field::Read;
use crate::grid::Layout;
use crate::inputs::{MAX_PORTS, MAX_SOURCES, MAX_SPEED_M_S, Port, Way};
use crate::plan::{Exit, Plan, Source};
use crate::ports;
use crate::solver::Solver;

/// Cells of a port at most. A scope's ports, balls of 3 mm, have 3 400 in cells of 0.27 × 0.28 × 0.44 mm; in finer ones they become smaller.
const MOST_PORT_CELLS: usize = 4_096;
/// Cells of a vessel, of the hole and of the leak at most.
const MOST_CELLS: usize = 256;
/// A fully open vessel bleeds within so much of its place, m: half of what lies between two of them; of several in one place as much more as their area.
const VESSEL_M: f32 = 2e-3;

/// Cells of all sources at most, in a grid of so many.
pub(crate) fn most_cells(cells: usize) -> usize {
    // A vessel bleeds and takes medium in.
    MAX_PORTS * MOST_PORT_CELLS.min(cells) + (2 * MAX_SOURCES + 2) * MOST_CELLS.min(cells)
}

/// A place through which medium comes or goes.
#[derive(Default)]
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
    /// What leaves does not come back.
    is_lost: bool,
    /// Whether drops and gas leave here too.
    exit: Exit,
}

/// Index of a source's cell, without ghosts.
fn index_of(layout: &Layout, source: &Source) -> usize {
    let (j, i) = (source.at / layout.stride - 1, source.at % layout.stride - 1);
    ((source.kk - 1) * layout.n[1] + j) * layout.n[0] + i
}

impl Solver {
    /// Spreads what comes and goes over cells. Returns how many cells the fastest jet crosses per second.
    pub(crate) fn place_sources(&self, c: &mut Coordinator, plan: &mut Plan) -> Result<f32, FlowError> {
        for source in &plan.sources {
            plan.exits[index_of(&self.layout, source)] = Exit::Shut;
        }
        plan.sources.clear();
        c.largest_rate_per_s = 0.0;
        let fluid = self.fluid.read()?;
        let fastest = self.place_ports(&fluid, c, plan);
        self.place_vessels(&fluid, c, plan);
        let (hole, leak) = (plan.inputs.hole, plan.inputs.leak);
        self.place_way(hole, MAX_PORTS, plan.pump.perforation_ml_s, &fluid, c, plan);
        self.place_way(leak, MAX_PORTS + 1, plan.pump.leak_ml_s, &fluid, c, plan);
        plan.order_sources();
        Ok(fastest)
    }

    /// Spreads the pump's flow over the cells of the ports. Returns how many cells the fastest jet crosses per second.
    fn place_ports(&self, fluid: &Read<'_>, c: &mut Coordinator, plan: &mut Plan) -> f32 {
        let mut fastest = 0.0f32;
        let ports = plan.inputs.ports;
        for (number, port) in ports.iter().enumerate().filter(|(_, port)| port.share > 0.0) {
            let mouth = self.mouth_of(port, number, plan);
            let pump = &plan.inputs.pump;
            let valve = if port.inflow { pump.inflow_valve } else { pump.outflow_valve };
            if valve <= 0.0 && mouth.flow_m3_s == 0.0 {
                continue;
            }
            if !self.place_mouth(&mouth, fluid, c, plan) {
                c.report.blind_ports += 1; // it lies in a solid: its flow widens or narrows the cavity but drives nothing
                continue;
            }
            for (v, h) in mouth.jet_m_s.iter().flatten().zip(self.model.grid.spacing_m()) {
                fastest = fastest.max(v.abs() / h);
            }
        }
        fastest
    }

    /// A port, the one of this number, with what the pump moves through it.
    fn mouth_of(&self, port: &Port, number: usize, plan: &Plan) -> Mouth {
        let total: f32 = plan.inputs.ports.iter().filter(|other| other.inflow == port.inflow).map(|other| other.share).sum();
        // With the roller's beat, which turns no flow but by what was rounded.
        let (pump, beat) = (&plan.pump, &plan.pump.beat);
        let (in_ml_s, out_ml_s) = ((pump.in_ml_s + beat.in_ml_s).max(0.0), (pump.out_ml_s + beat.out_ml_s).max(0.0));
        let flow_ml_s = if port.inflow { in_ml_s } else { -out_ml_s };
        let flow_m3_s = flow_ml_s * 1e-6 * f64::from(port.share / total);
        let jet_m_s = if flow_m3_s > 0.0 { ports::jet_m_s(&self.model.grid, port, flow_m3_s) } else { None };
        let jet_m_s = jet_m_s.map(|jet_m_s| jet_m_s.map(|v| v.clamp(-MAX_SPEED_M_S, MAX_SPEED_M_S)));
        let exit = if port.inflow { Exit::Shut } else { Exit::Outflow(number as u8) };
        let (centre_m, radius_m, dye) = (port.centre_m, port.radius_m, port.dye);
        Mouth { centre_m, radius_m, flow_m3_s, dye, jet_m_s, most: MOST_PORT_CELLS, is_lost: false, exit }
    }

    /// Open vessels: each bleeds, and takes medium in, as its share of all that are open. What bleeds is in the drops; here it takes its room alone. A drop
    /// is not taken in at once by the vessel that it comes from.
    fn place_vessels(&self, fluid: &Read<'_>, c: &mut Coordinator, plan: &mut Plan) {
        let vessels = plan.inputs.blood;
        let open: f64 = vessels.iter().map(|vessel| f64::from(vessel.opening)).sum();
        let flows_ml_s = [plan.bled_ml_s, -plan.pump.intravasation_ml_s];
        for vessel in vessels.iter().filter(|vessel| vessel.opening > 0.0) {
            let share = f64::from(vessel.opening) / open;
            for flow_ml_s in flows_ml_s.into_iter().filter(|flow_ml_s| *flow_ml_s != 0.0) {
                let mouth = Mouth {
                    centre_m: vessel.position_m,
                    radius_m: VESSEL_M * vessel.opening.sqrt(),
                    flow_m3_s: flow_ml_s * 1e-6 * share,
                    most: MOST_CELLS,
                    is_lost: true,
                    ..Mouth::default()
                };
                self.place_mouth(&mouth, fluid, c, plan);
            }
        }
    }

    /// A hole or the leak, the mouth of this number, from the fluid that is nearest.
    fn place_way(&self, way: Way, number: usize, flow_ml_s: f64, fluid: &Read<'_>, c: &mut Coordinator, plan: &mut Plan) {
        if way.radius_m <= 0.0 || flow_ml_s <= 0.0 {
            return;
        }
        let mut mouth = Mouth {
            centre_m: way.centre_m,
            radius_m: way.radius_m,
            flow_m3_s: -flow_ml_s * 1e-6,
            most: MOST_CELLS,
            is_lost: true,
            exit: Exit::Lost(number as u8),
            ..Mouth::default()
        };
        if self.place_mouth(&mouth, fluid, c, plan) {
            return;
        }
        let nearest_m = ports::nearest_m(&self.model.grid, &self.layout, way.centre_m, |kk, at| fluid.layer(kk)[at] > 0.0);
        if let Some(centre_m) = nearest_m {
            mouth.centre_m = centre_m;
            self.place_mouth(&mouth, fluid, c, plan);
        }
    }

    /// Puts a mouth's cells into the list, if something flows. Whether it has any.
    fn place_mouth(&self, mouth: &Mouth, fluid: &Read<'_>, c: &mut Coordinator, plan: &mut Plan) -> bool {
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
            (source.rate_per_s, source.dye, source.is_lost) = (rate_per_s, mouth.dye, mouth.is_lost);
            (source.has_jet, source.jet_m_s) = (mouth.jet_m_s.is_some(), mouth.jet_m_s.unwrap_or_default());
            if mouth.exit != Exit::Shut {
                plan.exits[index_of(layout, source)] = mouth.exit;
            }
        }
        if let Exit::Outflow(number) | Exit::Lost(number) = mouth.exit {
            plan.exit_rates_per_s[usize::from(number)] = -rate_per_s;
        }
        true
    }
}
