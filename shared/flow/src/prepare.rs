//! Between Mask and the first sweep: the connected parts of the fluid, and the numbers of sweeps.

use crate::coordinator::{Coordinator, MAX_SWEEPS};
use crate::error::FlowError;
use crate::plan::{Plan, Roles};
use crate::solver::{Phase, Solver};

impl Solver {
    /// After Mask: connected parts, sources, and how many sweeps the step needs.
    pub(crate) fn after_mask(&self, c: &mut Coordinator, plan: &mut Plan) -> Result<Phase, FlowError> {
        let total = self.total()?;
        let changed = total.count > 0 || !c.built;
        if changed {
            self.label(c, plan)?;
            self.push_dye(plan.dye, &mut c.blood)?;
            c.built = true;
        }
        c.report.components = plan.components as u32;
        let jet = self.place_sources(c, plan)?;
        self.set_floor(c, total.top, jet);
        let h = self.model.grid.spacing_m();
        let dt_s = plan.inputs.dt_s;
        let courant = dt_s * total.top.max(jet);
        c.report.sweeps = (courant.ceil() as u32).clamp(1, MAX_SWEEPS);
        c.report.slowed = courant > MAX_SWEEPS as f32;
        c.advect_left = c.report.sweeps;
        plan.courant = h.map(|h| dt_s / (c.report.sweeps as f32 * h));
        let viscosity = self.model.medium.viscosity_m2_s;
        let number = 2.0 * viscosity * dt_s * self.weights.iter().sum::<f32>();
        c.diffuse_left = (number.ceil() as u32).clamp(1, MAX_SWEEPS);
        c.report.slowed |= number > MAX_SWEEPS as f32;
        let part = dt_s / c.diffuse_left as f32 * (MAX_SWEEPS as f32 / number.max(f32::MIN_POSITIVE)).min(1.0);
        plan.diffusion = self.weights.map(|w| viscosity * part * w);
        plan.impulse_m_s = plan.inputs.acceleration_m_s2.map(|a| a * dt_s / c.diffuse_left as f32);
        let now = plan.roles.now;
        plan.roles = Roles { now, next: (now + 1) % 4, ..Default::default() };
        c.is_changed = changed;
        c.is_held = false;
        self.place_wires(plan)?;
        Ok(Phase::Mirror)
    }

    fn label(&self, c: &mut Coordinator, plan: &mut Plan) -> Result<(), FlowError> {
        let layout = &*self.layout;
        let fluid = self.fluid.read()?;
        let (parts, sizes, pockets) = c.components.label(layout, |kk| fluid.layer(kk), &mut plan.labels);
        drop(fluid);
        plan.components = parts;
        c.sizes = sizes;
        if pockets {
            let [nx, ny, _] = layout.n;
            for band in 0..self.bands {
                let mut fluid = self.fluid.write(band)?;
                for kk in layout.own(band) {
                    let plane = fluid.layer(kk);
                    for (cell, label) in plan.labels[(kk - 1) * nx * ny..kk * nx * ny].iter_mut().enumerate() {
                        if *label == u8::MAX {
                            plane[layout.row(cell / nx) + cell % nx] = 0.0;
                            *label = 0;
                        }
                    }
                }
            }
        }
        self.mark(&c.components, c.skips)
    }

    /// Below this the residual is what single precision leaves of the speeds at hand.
    fn set_floor(&self, c: &mut Coordinator, rate_per_s: f32, jet_per_s: f32) {
        let floor = 1e-7 * f64::from(rate_per_s.max(jet_per_s));
        c.rest_residual2 = floor * floor * self.layout.cell_count() as f64;
    }
}
