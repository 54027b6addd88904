//! Forces, diffusion and self-advection: the first three stages of a step (Stam 1999; MacCormack after Selle et al. 2008).
//!
//! Advection carries each component along the frozen velocity of the step in as many sweeps as keep the displacement under one cell.
//! Promise: a sweep makes no new extremes (the correction is clamped to the values it interpolates), so it cannot explode.

use crate::error::FlowError;
use crate::field::Read;
use crate::grid::MAX_AXIS;
use crate::kernels::{Star, wide};
use crate::plan::Plan;
use crate::rows;
use crate::sample::{backward, forward, nine};
use crate::solver::Solver;
use crate::spans::Spans;

impl Solver {
    /// Phase Diffuse: v + ν·dt·∇²v + dt·force, then the jets of the inflow and the drag of wires.
    pub(crate) fn diffuse_band(&self, band: usize) -> Result<(), FlowError> {
        let plan = self.plan()?;
        let layout = &*self.layout;
        let spans = self.hierarchy.levels[0].spans()?;
        let fluid = self.fluid.read()?;
        let weights = plan.diffusion;
        let keep = 1.0 - 2.0 * (weights[0] + weights[1] + weights[2]);
        let mut sums = self.sums(band)?;
        sums.iter_mut().for_each(|sum| sum.given = Default::default());
        for component in 0..3 {
            let from = self.velocity[plan.roles.now][component].read()?;
            let held = self.held[component].read()?;
            let mut to = self.velocity[plan.roles.next][component].write(band)?;
            let push = plan.impulse_m_s[component];
            for (sum, kk) in sums.iter_mut().zip(layout.own(band)) {
                let out = to.layer(kk);
                wide(
                    #[inline(always)]
                    || {
                        for (o, n) in spans.open.of(kk) {
                            let star = Star::new(from.three(kk), o, layout.stride, n);
                            rows::diffuse(&mut out[o..o + n], &star, keep, weights, push);
                        }
                    },
                );
                jets(&plan, component, kk, layout.stride, out);
                for drag in plan.drags.iter().filter(|drag| drag.component == component && drag.kk == kk) {
                    let before_m_s = out[drag.at];
                    drag.pull(&mut out[drag.at]);
                    self.give(&mut sum.given, drag, out[drag.at] - before_m_s, &fluid);
                }
                hold_plane(&spans, &fluid, &held, component, kk, layout.stride, out);
                self.mirrors.plane(layout, component, out);
            }
            self.mirrors.layers(layout, component, band, &mut to);
        }
        Ok(())
    }

    /// Phase AdvectForward: the value at the departure point of each face that the way back reads.
    pub(crate) fn advect_forward_band(&self, band: usize) -> Result<(), FlowError> {
        let plan = self.plan()?;
        let layout = &*self.layout;
        let spans = self.hierarchy.levels[0].spans()?;
        let carrier = self.read_velocity(plan.roles.carrier)?;
        let mut shift = [[0.0f32; MAX_AXIS]; 3];
        for component in 0..3 {
            let from = self.velocity[plan.roles.now][component].read()?;
            let mut to = self.velocity[plan.roles.forward][component].write(band)?;
            for kk in layout.own(band) {
                let out = to.layer(kk);
                wide(
                    #[inline(always)]
                    || {
                        for (o, n) in spans.near.of(kk) {
                            displacement(&carrier, component, kk, o, layout.stride, n, plan.courant, &mut shift);
                            let rows = nine(from.three(kk), o, layout.stride, n);
                            forward(&mut out[o..o + n], &rows, shift.each_ref().map(|s| &s[..n]));
                        }
                    },
                );
                self.mirrors.plane(layout, component, out);
            }
            self.mirrors.layers(layout, component, band, &mut to);
        }
        Ok(())
    }

    /// Phase AdvectBack: goes back along the flow, takes half of what was lost as correction, clamps it, holds solid faces.
    pub(crate) fn advect_back_band(&self, band: usize) -> Result<(), FlowError> {
        let plan = self.plan()?;
        let layout = &*self.layout;
        let spans = self.hierarchy.levels[0].spans()?;
        let carrier = self.read_velocity(plan.roles.carrier)?;
        let fluid = self.fluid.read()?;
        let mut shift = [[0.0f32; MAX_AXIS]; 3];
        for component in 0..3 {
            let from = self.velocity[plan.roles.now][component].read()?;
            let half = self.velocity[plan.roles.forward][component].read()?;
            let held = self.held[component].read()?;
            let mut to = self.velocity[plan.roles.next][component].write(band)?;
            for kk in layout.own(band) {
                let out = to.layer(kk);
                let is_free = spans.is_free_layer(component, kk);
                wide(
                    #[inline(always)]
                    || {
                        for (o, n) in spans.open.of(kk) {
                            displacement(&carrier, component, kk, o, layout.stride, n, plan.courant, &mut shift);
                            let before = nine(from.three(kk), o, layout.stride, n);
                            let after = nine(half.three(kk), o, layout.stride, n);
                            let row = &mut out[o..o + n];
                            backward(row, &before, &after, shift.each_ref().map(|s| &s[..n]));
                            if !is_free {
                                hold_solid(&fluid, &held, component, kk, o, layout.stride, row);
                            }
                        }
                    },
                );
                hold_gaps(&spans, &held, kk, out);
                self.mirrors.plane(layout, component, out);
            }
            self.mirrors.layers(layout, component, band, &mut to);
        }
        Ok(())
    }

    pub(crate) fn read_velocity(&self, buffer: usize) -> Result<[Read<'_>; 3], FlowError> {
        let [u, v, w] = &self.velocity[buffer];
        Ok([u.read()?, v.read()?, w.read()?])
    }
}

/// Displacement in cells during one sweep at the faces of a component in row `o` of layer `kk`, each within −1..1.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // one inner loop, kept in registers
fn displacement(
    carrier: &[Read<'_>; 3],
    component: usize,
    kk: usize,
    o: usize,
    stride: usize,
    n: usize,
    courant: [f32; 3],
    shift: &mut [[f32; MAX_AXIS]; 3],
) {
    let row = |plane: usize, axis: usize, at: usize| &carrier[axis].layer(plane)[at..at + n];
    for axis in 0..3 {
        let out = &mut shift[axis][..n];
        let c = courant[axis];
        if axis == component {
            rows::shift_own(out, row(kk, axis, o), c);
            continue;
        }
        // The four faces of `axis` around this face: one step along `axis`, one step back along `component`.
        let (k1, at1) = step(axis, kk, o, stride, true);
        let (k2, at2) = step(component, kk, o, stride, false);
        let (k3, at3) = step(component, k1, at1, stride, false);
        rows::shift_mean(out, [row(kk, axis, o), row(k1, axis, at1), row(k2, axis, at2), row(k3, axis, at3)], c);
    }
}

/// The layer and the offset of the cell, or face, one step along an axis.
#[inline(always)]
pub(crate) fn step(axis: usize, kk: usize, at: usize, stride: usize, up: bool) -> (usize, usize) {
    match (axis, up) {
        (0, true) => (kk, at + 1),
        (0, false) => (kk, at - 1),
        (1, true) => (kk, at + stride),
        (1, false) => (kk, at - stride),
        (_, true) => (kk + 1, at),
        (_, false) => (kk - 1, at),
    }
}

/// Holds the faces of a plane that touch a solid cell.
fn hold_plane(spans: &Spans, fluid: &Read<'_>, held: &Read<'_>, component: usize, kk: usize, stride: usize, out: &mut [f32]) {
    if !spans.is_free_layer(component, kk) {
        wide(
            #[inline(always)]
            || {
                for (o, n) in spans.open.of(kk) {
                    hold_solid(fluid, held, component, kk, o, stride, &mut out[o..o + n]);
                }
            },
        );
        hold_gaps(spans, held, kk, out);
    }
}

/// Holds the faces between the parts that are computed: each touches a solid cell.
fn hold_gaps(spans: &Spans, held: &Read<'_>, kk: usize, out: &mut [f32]) {
    for (o, n) in spans.gaps.of(kk) {
        out[o..o + n].copy_from_slice(&held.layer(kk)[o..o + n]);
    }
}

/// Faces that touch a solid cell take what phase Mirror made for them.
#[inline(always)]
pub(crate) fn hold_solid(
    fluid: &Read<'_>,
    held: &Read<'_>,
    component: usize,
    kk: usize,
    o: usize,
    stride: usize,
    row: &mut [f32],
) {
    let n = row.len();
    let (k_back, at_back) = step(component, kk, o, stride, false);
    let here = &fluid.layer(kk)[o..o + n];
    let back = &fluid.layer(k_back)[at_back..at_back + n];
    rows::hold(row, here, back, &held.layer(kk)[o..o + n]);
}

/// Sets the faces of inflow cells to the velocity of the jet.
fn jets(plan: &Plan, component: usize, kk: usize, stride: usize, plane: &mut [f32]) {
    for source in plan.sources_of(kk).iter().filter(|source| source.has_jet) {
        let v = source.jet_m_s[component];
        plane[source.at] = v;
        match component {
            0 => plane[source.at + 1] = v,
            1 => plane[source.at + stride] = v,
            _ => {}
        }
    }
    // The upper face of a cell lies in the layer above.
    for source in plan.sources_of(kk - 1).iter().filter(|source| component == 2 && source.has_jet) {
        plane[source.at] = source.jet_m_s[component];
    }
}
