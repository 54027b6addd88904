//! What the coordinator tells the bands between two phases, and what they tell it back: scalars, never fields.

use crate::blood::Particle;
use crate::grid::Layout;
use crate::inputs::{FlowInputs, MAX_PORTS};
use crate::pump::PumpReport;
use crate::spans::Spans;
use crate::traction::Pull;
use crate::wires::Drag;

/// Parts of the fluid that do not touch each other: each has its own pressure level. Smaller parts beyond these become solid.
pub(crate) const MAX_COMPONENTS: usize = 8;

/// Mouths by which drops and gas can leave: the ports, in their order, a hole, and the leak past the sheath.
pub(crate) const MAX_EXITS: usize = MAX_PORTS + 2;

/// One cell in which medium enters (rate > 0) or leaves.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Source {
    /// Padded layer.
    pub kk: usize,
    /// Offset in the plane.
    pub at: usize,
    /// Its place among those of a layer.
    pub order: u32,
    /// Volume per cell volume, 1/s.
    pub rate_per_s: f32,
    /// Velocity of the jet, m/s.
    pub jet_m_s: [f32; 3],
    pub has_jet: bool,
    /// Dye fraction of what enters.
    pub dye: f32,
    /// What leaves here does not come back through an outflow.
    pub is_lost: bool,
}

/// What becomes of a drop or of a parcel of gas in a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Exit {
    /// It floats on.
    #[default]
    Shut,
    /// It leaves through an outflow, the mouth of this number.
    Outflow(u8),
    /// It leaves through a hole or past the sheath.
    Lost(u8),
}

/// Which velocity buffers play which part; a sweep never writes what it reads.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Roles {
    /// The newest velocity.
    pub now: usize,
    /// The buffer that the next sweep writes.
    pub next: usize,
    /// Carries the others during advection.
    pub carrier: usize,
    /// Result of the forward half of a sweep.
    pub forward: usize,
}

pub(crate) struct Plan {
    pub inputs: FlowInputs,
    pub roles: Roles,
    /// dt/(sweeps·h) per axis, s/m.
    pub courant: [f32; 3],
    /// ν·dt/(sweeps·h²) per axis.
    pub diffusion: [f32; 3],
    /// Change of velocity by body forces per diffusion sweep, m/s.
    pub impulse_m_s: [f32; 3],
    /// dt/ρ: the pressure in pascal times this is the potential whose gradient corrects the velocity.
    pub dt_by_density: f32,
    pub alpha: f32,
    pub beta: f32,
    pub first_direction: bool,
    /// An iteration has added +0 to the pressure of the solid cells, so that −0 is there no more.
    pub is_unsigned: bool,
    pub components: usize,
    pub means: [f32; MAX_COMPONENTS],
    /// Component of each cell (only filled when there is more than one).
    pub labels: Vec<u8>,
    /// By layer.
    pub sources: Vec<Source>,
    /// Where those of each padded layer begin, and at last where they end.
    pub layers: Vec<usize>,
    /// What wires do to the faces around them, in the first sweep of Diffuse.
    pub drags: Vec<Drag>,
    /// Of each cell.
    pub exits: Vec<Exit>,
    /// Share of the medium in a cell of each mouth that leaves by it, 1/s.
    pub exit_rates_per_s: [f32; MAX_EXITS],
    /// Steps before this one.
    pub step: u64,
    /// Index of the dye field that is read; the other one is written.
    pub dye: usize,
    /// dt/(dye sweeps), s.
    pub dye_dt_s: f32,
    pub particle_sweeps: usize,
    pub pump: PumpReport,
    /// Blood that comes out of the vessels, ml/s.
    pub bled_ml_s: f64,
}

/// Partial results of one layer; the coordinator adds them in the order of the layers, whoever computed them.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct LayerSums {
    pub a: f64,
    pub b: f64,
    pub c: f64,
    pub top: f32,
    pub count: u32,
    pub by_component: [f64; MAX_COMPONENTS],
    /// Momentum that the wires gave the medium, N·s.
    pub given: Pull,
}

impl Plan {
    /// Orders the sources by layer, so that a layer finds its own.
    pub fn order_sources(&mut self) {
        self.sources.sort_unstable_by_key(|source| (source.kk, source.order));
        let mut next = 0;
        for (kk, from) in self.layers.iter_mut().enumerate() {
            next += self.sources[next..].iter().take_while(|source| source.kk < kk).count();
            *from = next;
        }
    }
    /// Share of the medium in a cell that leaves by an exit there, 1/s.
    pub fn leaving_per_s(&self, cell: usize) -> f32 {
        match self.exits[cell] {
            Exit::Shut => 0.0,
            Exit::Outflow(mouth) | Exit::Lost(mouth) => self.exit_rates_per_s[usize::from(mouth)],
        }
    }
    /// The sources in padded layer `kk`.
    pub fn sources_of(&self, kk: usize) -> &[Source] {
        &self.sources[self.layers[kk]..self.layers[kk + 1]]
    }
    /// Sum of a plane's inside by component; solid cells hold ±0, which adds nothing.
    #[inline(always)]
    pub fn component_sums(&self, layout: &Layout, spans: &Spans, kk: usize, plane: &[f32], into: &mut [f64; MAX_COMPONENTS]) {
        for j in 0..layout.n[1] {
            let (o, span) = (layout.row(j), spans.row(kk, j));
            if span.is_empty() {
                continue;
            }
            if self.components <= 1 {
                // The whole row, so that each cell stays in its lane.
                into[0] += crate::kernels::sum(&plane[o..o + layout.n[0]]);
            } else {
                let first = ((kk - 1) * layout.n[1] + j) * layout.n[0] + span.start;
                for (x, &label) in plane[o + span.start..o + span.end].iter().zip(&self.labels[first..]) {
                    into[usize::from(label)] += f64::from(*x);
                }
            }
        }
    }
    /// Mean of the component of cell `i` of row `j`.
    #[inline(always)]
    pub fn fill_means(&self, layout: &Layout, kk: usize, j: usize, row: &mut [f32]) {
        if self.components <= 1 {
            row.fill(self.means[0]);
        } else {
            let first = ((kk - 1) * layout.n[1] + j) * layout.n[0];
            for (m, &label) in row.iter_mut().zip(&self.labels[first..]) {
                *m = self.means[usize::from(label)];
            }
        }
    }
}

/// A share of the particle ring.
pub(crate) type Share = Vec<Particle>;
