//! What the medium does to the tools: pressure and friction on the faces between their cells and its own; and to the wires, what these gave it, turned round.
//!
//! Pressure counts beyond the mean of its part of the medium, so that a tool that leaves the grid feels no thrust of the cavity's. It is that of the cell
//! beside the face, and friction is the flux of the solver's own diffusion into the tool: in a steady slow flow the medium so loses to the solids what its pressure
//! gives, to the accuracy of the solve. Of the half cell between the two the body force is counted, and its inertia is not: a tool that is thrust in is as heavy
//! as if half a cell of medium clung to it. Promise: one thread, in the order of the cells: the same bits for any number of bands.

use crate::coordinator::Coordinator;
use crate::error::FlowError;
use crate::field::Read;
use crate::grid::{Grid, Layout};
use crate::inputs::MAX_TOOLS;
use crate::obstacles::Tool;
use crate::plan::Plan;
use crate::solver::Solver;
use crate::transport::step;
use crate::wires::Drag;

/// What the medium does to an obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Load {
    /// Force, N.
    pub force_n: [f32; 3],
    /// Torque about the origin of the station's frame, N·m.
    pub torque_nm: [f32; 3],
    /// Cells of a tool that were visited; 0 of wires.
    pub cells: u32,
    /// Its faces beside the medium; 0 of wires.
    pub faces: u32,
}

/// A sum of forces, N, or of momenta, N·s, at places, and what they turn about the origin.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Pull {
    along: [f64; 3],
    about: [f64; 3],
}

impl Pull {
    /// Adds one along an axis at a place.
    pub fn add(&mut self, axis: usize, size: f64, place_m: [f32; 3]) {
        let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
        self.along[axis] += size;
        self.about[next] += f64::from(place_m[last]) * size;
        self.about[last] -= f64::from(place_m[next]) * size;
    }

    /// Adds another sum.
    pub fn join(&mut self, other: &Pull) {
        for axis in 0..3 {
            self.along[axis] += other.along[axis];
            self.about[axis] += other.about[axis];
        }
    }

    /// So many times the sum; what is no number is 0.
    fn load(&self, times: f64) -> Load {
        let number = |x: f64| Some((x * times) as f32).filter(|x| x.is_finite()).unwrap_or(0.0);
        Load { force_n: self.along.map(number), torque_nm: self.about.map(number), ..Load::default() }
    }
}

impl Solver {
    /// After the first sweep of Diffuse: what the wires gave the medium, and so what it does to them.
    pub(crate) fn take_wires(&self, c: &mut Coordinator, plan: &Plan) -> Result<(), FlowError> {
        if !plan.drags.is_empty() {
            c.report.wires = self.total()?.given.load(-1.0 / f64::from(plan.inputs.dt_s));
        }
        Ok(())
    }

    /// Adds what a wire gave a face of the medium by making it so much faster; one at a solid is held, and is given nothing.
    pub(crate) fn give(&self, given: &mut Pull, drag: &Drag, gained_m_s: f32, fluid: &Read<'_>) {
        let (grid, stride) = (&self.model.grid, self.layout.stride);
        let (kk, at) = (drag.kk, drag.at);
        let (back_kk, back_at) = step(drag.component, kk, at, stride, false);
        if fluid.layer(kk)[at] * fluid.layer(back_kk)[back_at] > 0.0 {
            let mut place_m = grid.centre_m([at % stride - 1, at / stride - 1, kk - 1]);
            place_m[drag.component] -= 0.5 * grid.spacing_m()[drag.component];
            let mass_kg = f64::from(self.model.medium.density_kg_m3) * grid.cell_volume_m3();
            given.add(drag.component, mass_kg * f64::from(gained_m_s), place_m);
        }
    }

    /// At the end of a step, when the pressure is in pascal: what the medium does to each tool.
    pub(crate) fn loads(&self, plan: &Plan) -> Result<[Load; MAX_TOOLS], FlowError> {
        let grid = &self.model.grid;
        let tools = Tool::all(grid, &plan.inputs.tools);
        let density_kg_m3 = self.model.medium.density_kg_m3;
        let about = About {
            grid,
            layout: &self.layout,
            fluid: self.fluid.read()?,
            pressure: self.pressure.read()?,
            velocity: self.read_velocity(plan.roles.now)?,
            viscosity_pa_s: density_kg_m3 * self.model.medium.viscosity_m2_s,
            body_pa_m: plan.inputs.acceleration_m_s2.map(|a| density_kg_m3 * a),
        };
        let mut loads = [Load::default(); MAX_TOOLS];
        for (index, load) in loads.iter_mut().enumerate() {
            let Some(tool) = &tools[index] else { continue };
            let (mut pull, mut cells, mut faces) = (Pull::default(), 0, 0);
            for k in tool.low[2]..tool.high[2] {
                for j in tool.low[1]..tool.high[1] {
                    tool.carve(grid, j, k, |i, own_m_s| {
                        let centre_m = grid.centre_m([i, j, k]);
                        // A cell of two tools moves with the later one, and is that one's.
                        if tools[index + 1..].iter().flatten().all(|later| later.velocity_at(centre_m).is_none()) {
                            cells += 1;
                            faces += about.act([i, j, k], own_m_s, &mut pull);
                        }
                    });
                }
            }
            *load = Load { cells, faces, ..pull.load(1.0) };
        }
        Ok(loads)
    }
}

/// A cell, or the face on its low side: its padded layer, and where it is in that.
type Place = (usize, usize);

/// The medium about the tools.
struct About<'a> {
    grid: &'a Grid,
    layout: &'a Layout,
    fluid: Read<'a>,
    pressure: Read<'a>,
    velocity: [Read<'a>; 3],
    viscosity_pa_s: f32,
    /// The body force, N/m³.
    body_pa_m: [f32; 3],
}

impl About<'_> {
    fn is_fluid(&self, (kk, at): Place) -> bool {
        self.fluid.layer(kk)[at] > 0.0
    }

    fn speed(&self, component: usize, (kk, at): Place) -> f32 {
        self.velocity[component].layer(kk)[at]
    }

    fn beside(&self, (kk, at): Place, axis: usize, up: bool) -> Place {
        step(axis, kk, at, self.layout.stride, up)
    }

    /// Adds what acts on a cell of a tool, which moves with `own_m_s`; gives how many of its faces are beside the medium.
    fn act(&self, cell: [usize; 3], own_m_s: [f32; 3], pull: &mut Pull) -> u32 {
        let h = self.grid.spacing_m();
        let here = (cell[2] + 1, self.layout.row(cell[1]) + cell[0]);
        let mut faces = 0;
        for side in 0..6usize {
            let (axis, up) = (side / 2, side % 2 == 1);
            let next = self.beside(here, axis, up);
            if !self.is_fluid(next) {
                continue;
            }
            faces += 1;
            let mut place_m = self.grid.centre_m(cell);
            place_m[axis] += if up { 0.5 * h[axis] } else { -0.5 * h[axis] };
            let area_m2 = h[(axis + 1) % 3] * h[(axis + 2) % 3];
            for (component, own_m_s) in own_m_s.into_iter().enumerate() {
                let stress_pa = if component == axis {
                    self.normal_pa(axis, up, here, next)
                } else {
                    self.shear_pa(axis, component, next, own_m_s)
                };
                pull.add(component, f64::from(stress_pa * area_m2), place_m);
            }
        }
        faces
    }

    /// What pushes along an axis on the face between a tool's cell and the medium's cell `next` beyond it: its pressure, and what it is stretched by.
    fn normal_pa(&self, axis: usize, up: bool, here: Place, next: Place) -> f32 {
        let h = self.grid.spacing_m()[axis];
        let sign = if up { 1.0 } else { -1.0 };
        let pressure_pa = self.pressure.layer(next.0)[next.1] - 0.5 * sign * h * self.body_pa_m[axis];
        // The faces on both sides of the medium's cell: the tool's own, and the one after it.
        let (own, after) = if up { (next, self.beside(next, axis, true)) } else { (here, next) };
        let is_open = self.is_fluid(self.beside(next, axis, up));
        let stretched_per_s = if is_open { (self.speed(axis, after) - self.speed(axis, own)) / h } else { 0.0 };
        self.viscosity_pa_s * stretched_per_s - sign * pressure_pa
    }

    /// What drags along `component` on a face across `axis`, of which the medium's cell is `next`: by the two faces of that cell that medium goes through. Each is
    /// half a cell from the tool, and of each half the area is this face's.
    fn shear_pa(&self, axis: usize, component: usize, next: Place, own_m_s: f32) -> f32 {
        let high = self.beside(next, component, true);
        let mut past_m_s = 0.0;
        for (face, beyond) in [(next, self.beside(next, component, false)), (high, high)] {
            if self.is_fluid(beyond) {
                past_m_s += self.speed(component, face) - own_m_s;
            }
        }
        self.viscosity_pa_s * past_m_s / self.grid.spacing_m()[axis]
    }
}
