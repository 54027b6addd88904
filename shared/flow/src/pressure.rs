//! Mass conservation: the pressure whose gradient makes the velocity free of divergence, by preconditioned conjugate gradients.
//!
//! Solved: A·φ = s − ∇·v with φ = p·dt/ρ, s the sources, and the mean of each connected part taken off: what enters and does not
//! leave widens the cavity evenly. Promise: ends at the model's relative residual or at its bound of iterations, and says which.

use crate::error::FlowError;
use crate::field::Read;
use crate::grid::MAX_AXIS;
use crate::inputs::MAX_SPEED_M_S;
use crate::kernels::{Dot, Star, dot, larger, max_abs, max_abs_where, wide};
use crate::rows;
use crate::solver::Solver;
use crate::transport::hold_solid;

/// Slower is at rest: keeps decaying flows out of the range of denormal numbers, which cost a hundred cycles each.
const REST_M_S: f32 = 1e-12;

impl Solver {
    /// Phase RightSide: r = s − ∇·v in fluid cells, φ from the last pressure, and the sums of r by component.
    pub(crate) fn right_side_band(&self, band: usize) -> Result<(), FlowError> {
        let plan = self.plan()?;
        let layout = &*self.layout;
        let velocity = self.read_velocity(plan.roles.now)?;
        let fluid = self.fluid.read()?;
        let level = &self.hierarchy.levels[0];
        let spans = level.spans()?;
        let (mut r, mut pressure) = (level.r.write(band)?, self.pressure.write(band)?);
        let per_m = self.model.grid.spacing_m().map(|h| 1.0 / h);
        let n = layout.n[0];
        let mut sums = self.sums(band)?;
        for (sum, kk) in sums.iter_mut().zip(layout.own(band)) {
            let (out, phi) = (r.layer(kk), pressure.layer(kk));
            wide(
                #[inline(always)]
                || {
                    for j in 0..layout.n[1] {
                        let o = layout.row(j);
                        let m = &fluid.layer(kk)[o..o + n];
                        rows::scale_masked(&mut phi[o..o + n], m, plan.dt_by_density);
                        // Without fluid r is 0 since the operator was made.
                        if !spans.row(kk, j).is_empty() {
                            rows::convergence(&mut out[o..o + n], m, faces(&velocity, kk, o, layout.stride), per_m);
                        }
                    }
                },
            );
            for source in plan.sources_of(kk) {
                out[source.at] += source.rate_per_s;
            }
            sum.by_component = Default::default();
            wide(
                #[inline(always)]
                || plan.component_sums(layout, &spans, kk, out, &mut sum.by_component),
            );
        }
        Ok(())
    }

    /// Phase Residual: b = r − mean, r = b − A·φ; partial sums b·b and r·r.
    pub(crate) fn residual_band(&self, band: usize) -> Result<(), FlowError> {
        let plan = self.plan()?;
        let layout = &*self.layout;
        let level = &self.hierarchy.levels[0];
        let spans = level.spans()?;
        let (phi, diagonal, fluid) = (self.pressure.read()?, level.diagonal.read()?, self.fluid.read()?);
        let mut r = level.r.write(band)?;
        let n = layout.n[0];
        let (mut t, mut mean) = ([0.0f32; MAX_AXIS], [0.0f32; MAX_AXIS]);
        let mut sums = self.sums(band)?;
        for (sum, kk) in sums.iter_mut().zip(layout.own(band)) {
            let r = r.layer(kk);
            (sum.a, sum.b) = wide(
                #[inline(always)]
                || {
                    let (mut bb, mut rr) = (0.0, 0.0);
                    for j in 0..layout.n[1] {
                        let span = spans.row(kk, j);
                        if span.is_empty() {
                            continue;
                        }
                        let o = layout.row(j);
                        let cells = o + span.start..o + span.end;
                        let t = &mut t[..span.len()];
                        let star = Star::new(phi.three(kk), cells.start, layout.stride, span.len());
                        rows::fine_operator(t, &diagonal.layer(kk)[cells.clone()], &star, self.weights);
                        plan.fill_means(layout, kk, j, &mut mean[..n]);
                        rows::subtract_masked(&mut r[cells.clone()], &fluid.layer(kk)[cells.clone()], &mean[span]);
                        // The whole row, so that each cell stays in its lane.
                        let row = o..o + n;
                        bb += dot(&r[row.clone()], &r[row.clone()]);
                        rows::reduce(&mut r[cells], t, 1.0);
                        rr += dot(&r[row.clone()], &r[row]);
                    }
                    (bb, rr)
                },
            );
        }
        Ok(())
    }

    /// Phase Direction: d = z + β·d and q = A·z + β·q (so A·d without a second pass); partial sums d·q.
    pub(crate) fn direction_band(&self, band: usize) -> Result<(), FlowError> {
        let plan = self.plan()?;
        let layout = &*self.layout;
        let level = &self.hierarchy.levels[0];
        let spans = level.spans()?;
        let (z, diagonal) = (level.z.read()?, level.diagonal.read()?);
        let (mut d, mut q) = (self.direction.write(band)?, self.image.write(band)?);
        let mut sums = self.sums(band)?;
        for (sum, kk) in sums.iter_mut().zip(layout.own(band)) {
            let (d, q) = (d.layer(kk), q.layer(kk));
            sum.a = wide(
                #[inline(always)]
                || {
                    let mut dq = Dot::default();
                    for (o, n) in spans.lanes.of(kk) {
                        let star = Star::new(z.three(kk), o, layout.stride, n);
                        let diagonal = &diagonal.layer(kk)[o..o + n];
                        let (d, q) = (&mut d[o..o + n], &mut q[o..o + n]);
                        if plan.first_direction {
                            d.copy_from_slice(star.c);
                            rows::fine_operator(q, diagonal, &star, self.weights);
                        } else {
                            rows::fine_direction(d, q, diagonal, &star, self.weights, plan.beta);
                        }
                        dq.add(layout.run_of(o), d, q);
                    }
                    dq.total()
                },
            );
        }
        Ok(())
    }

    /// Phase Update: φ += α·d, r −= α·q; partial sums r·r.
    pub(crate) fn update_band(&self, band: usize) -> Result<(), FlowError> {
        let plan = self.plan()?;
        let layout = &*self.layout;
        let level = &self.hierarchy.levels[0];
        let spans = level.spans()?;
        let (d, q) = (self.direction.read()?, self.image.read()?);
        let (mut phi, mut r) = (self.pressure.write(band)?, level.r.write(band)?);
        let mut sums = self.sums(band)?;
        for (sum, kk) in sums.iter_mut().zip(layout.own(band)) {
            let (phi, r) = (phi.layer(kk), r.layer(kk));
            sum.b = wide(
                #[inline(always)]
                || {
                    let mut rr = Dot::default();
                    for (o, n) in spans.lanes.of(kk) {
                        let (d, q, r) = (&d.layer(kk)[o..o + n], &q.layer(kk)[o..o + n], &mut r[o..o + n]);
                        rows::add_scaled(&mut phi[o..o + n], d, plan.alpha);
                        rows::reduce(r, q, plan.alpha);
                        rr.add(layout.run_of(o), r, r);
                    }
                    rr.total()
                },
            );
        }
        Ok(())
    }

    /// Phase Project: v −= ∇φ on open faces; a value beyond any real speed becomes 0 and is counted; sums of φ by component.
    pub(crate) fn project_band(&self, band: usize) -> Result<(), FlowError> {
        let plan = self.plan()?;
        let layout = &*self.layout;
        let spans = self.hierarchy.levels[0].spans()?;
        let (phi, fluid) = (self.pressure.read()?, self.fluid.read()?);
        let mut sums = self.sums(band)?;
        for (sum, kk) in sums.iter_mut().zip(layout.own(band)) {
            (sum.count, sum.top) = (0, 0.0);
            sum.by_component = Default::default();
            wide(
                #[inline(always)]
                || plan.component_sums(layout, &spans, kk, phi.layer(kk), &mut sum.by_component),
            );
        }
        for component in 0..3 {
            let inverse_h = 1.0 / self.model.grid.spacing_m()[component];
            let held = self.held[component].read()?;
            let mut velocity = self.velocity[plan.roles.now][component].write(band)?;
            for (sum, kk) in sums.iter_mut().zip(layout.own(band)) {
                let plane = velocity.layer(kk);
                wide(
                    #[inline(always)]
                    || {
                        for j in 0..layout.n[1] {
                            // Far from the fluid there is no pressure, and the faces are held since AdvectBack.
                            let near = spans.near_row(kk, j);
                            if near.is_empty() {
                                continue;
                            }
                            let (o, n) = (layout.row(j) + near.start, near.len());
                            let star = Star::new(phi.three(kk), o, layout.stride, n);
                            let back = [star.xm, star.ym, star.zm][component];
                            let row = &mut plane[o..o + n];
                            sum.count += rows::project(row, star.c, back, inverse_h, 2.0 * MAX_SPEED_M_S, REST_M_S);
                            hold_solid(&fluid, &held, component, kk, o, layout.stride, row);
                            sum.top = larger(sum.top, max_abs_where(row, &fluid.layer(kk)[o..o + n]));
                        }
                    },
                );
                self.mirrors.plane(layout, component, plane);
            }
            self.mirrors.layers(layout, component, band, &mut velocity);
        }
        Ok(())
    }

    /// Phase Centre: pressure in pascal with mean 0 in each part of the fluid; largest outflow of a cell, 1/s.
    pub(crate) fn centre_band(&self, band: usize) -> Result<(), FlowError> {
        let plan = self.plan()?;
        let layout = &*self.layout;
        let spans = self.hierarchy.levels[0].spans()?;
        let velocity = self.read_velocity(plan.roles.now)?;
        let fluid = self.fluid.read()?;
        let mut pressure = self.pressure.write(band)?;
        let per_m = self.model.grid.spacing_m().map(|h| 1.0 / h);
        let scale = 1.0 / plan.dt_by_density;
        let n = layout.n[0];
        let (mut mean, mut out) = ([0.0f32; MAX_AXIS], [0.0f32; MAX_AXIS]);
        let mut sums = self.sums(band)?;
        for (sum, kk) in sums.iter_mut().zip(layout.own(band)) {
            let phi = pressure.layer(kk);
            sum.top = wide(
                #[inline(always)]
                || {
                    let mut top = 0.0;
                    for j in 0..layout.n[1] {
                        let o = layout.row(j);
                        plan.fill_means(layout, kk, j, &mut mean[..n]);
                        let (row, m) = (&mut phi[o..o + n], &fluid.layer(kk)[o..o + n]);
                        if plan.is_unsigned {
                            rows::unsign(row, m);
                        }
                        rows::centre(row, m, &mean[..n], scale);
                        let span = spans.row(kk, j);
                        let out = &mut out[..span.len()];
                        rows::outflow(out, &m[span.clone()], faces(&velocity, kk, o + span.start, layout.stride), per_m);
                        top = larger(top, max_abs(out));
                    }
                    top
                },
            );
        }
        Ok(())
    }
}

/// Low and high faces of the cells of a row along x, y, z.
#[inline(always)]
fn faces<'a>(velocity: &'a [Read<'_>; 3], kk: usize, o: usize, stride: usize) -> [&'a [f32]; 6] {
    let [u, v, w] = velocity;
    let (u, v) = (u.layer(kk), v.layer(kk));
    [&u[o..], &u[o + 1..], &v[o..], &v[o + stride..], &w.layer(kk)[o..], &w.layer(kk + 1)[o..]]
}
