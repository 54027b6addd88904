//! Gas in the medium: what a loop under current makes, and the air that comes in with a new container. It rises against gravity, is carried by the
//! flow, slowed by the walls, gathers under the ceiling, and leaves through the outflow.
//!
//! A parcel in a ring of fixed size stands for equal bubbles; it takes no room and drives no flow. Promise: made = in the ring + vented + dissolved,
//! in ml; no parcel enters a solid cell; the scatter is a function of the seed and of the parcels made so far, so that a spare makes the same ones.

use crate::blood::{Particle, drawn, velocity_at};
use crate::coordinator::{Coordinator, MAX_SWEEPS};
use crate::error::FlowError;
use crate::inputs::{FlowInputs, tame, tame_place};
use crate::model::range;
use crate::plan::Plan;
use crate::room::{LEAP_CELLS, Room};
use crate::solver::Solver;

/// Parcels in the ring. When it is full the oldest dissolves.
pub const MAX_BUBBLES: usize = 256;
/// Parcels that one source makes in one step at most; what is more makes them larger.
const MADE_PER_STEP: usize = 16;
/// Standard gravity, m/s².
const GRAVITY_M_S2: f64 = 9.806_65;
/// Under a ceiling made of cells a slope is a staircase; steps of up to so many cells are slid along.
const STEP_CELLS: usize = 4;
/// Faxén 1922, leading term: along a wall at the distance s a sphere of radius a is slower by this times a/s.
const FAXEN: f32 = 9.0 / 16.0;
/// Apart from the numbers of the blood's particles, so that gas and blood are not scattered alike.
const OWN_NUMBERS: u64 = 1 << 40;
/// The first place of this ring, after those of the blood's, which are no more.
const OWN_PLACES: usize = 1 << 16;

/// The gas in the cavity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BubbleModel {
    /// Against gravity, a unit vector. +y: the patient lies on her back.
    pub up: [f32; 3],
    /// Diameter of a bubble, m.
    pub diameter_m: f32,
    /// Volume that one parcel stands for, ml. 1e-3: fifteen bubbles of 0.5 mm.
    pub parcel_ml: f32,
    /// Air that comes in with each new container, ml (assumed).
    pub change_ml: f64,
}

impl Default for BubbleModel {
    fn default() -> Self {
        Self { up: [0.0, 1.0, 0.0], diameter_m: 5e-4, parcel_ml: 1e-3, change_ml: 0.05 }
    }
}

impl BubbleModel {
    pub(crate) fn check(&self) -> Result<(), FlowError> {
        let length2: f32 = self.up.iter().map(|x| x * x).sum();
        range("bubbles.up", length2.into(), 0.999, 1.001, "of length 1")?;
        range("bubbles.diameter_m", self.diameter_m.into(), 1e-5, 5e-3, "1e-5 to 5e-3")?;
        range("bubbles.parcel_ml", self.parcel_ml.into(), 1e-6, 1.0, "1e-6 to 1")?;
        range("bubbles.change_ml", self.change_ml, 0.0, 1.0, "0 to 1")
    }

    /// Speed at which a bubble rises in a medium at rest, far from walls, m/s: a smooth sphere (Ferguson and Church 2004, C₁ = 18, C₂ = 0.4) that
    /// weighs nothing; surfactants in body fluids make bubbles of this size as rigid as that.
    pub fn rise_m_s(&self, viscosity_m2_s: f32) -> f32 {
        let diameter_m = f64::from(self.diameter_m);
        let drive = GRAVITY_M_S2 * diameter_m * diameter_m;
        (drive / (18.0 * f64::from(viscosity_m2_s) + (0.75 * 0.4 * drive * diameter_m).sqrt())) as f32
    }
}

/// Where gas comes into being.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GasSource {
    /// Where, m, station frame.
    pub position_m: [f32; 3],
    /// How much, ml/s; 0 switches it off.
    pub flow_ml_s: f32,
}

impl GasSource {
    pub(crate) fn tame(&mut self) -> u32 {
        let mut count = 0;
        tame_place(&mut self.position_m, &mut count);
        tame(&mut self.flow_ml_s, 0.0, 10.0, 0.0, &mut count);
        if count > 0 {
            self.flow_ml_s = 0.0;
        }
        count
    }
}

/// Counters of the gas, and the ring's place.
#[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct BubbleState {
    /// Parcels made so far; modulo the ring's size it is the next place in it.
    pub made: u64,
    /// Containers that have been emptied.
    pub containers: u64,
    /// Gas that came into the cavity as parcels, ml.
    pub made_ml: f64,
    /// Gas that left through outflow ports, a hole or past the sheath, ml.
    pub vented_ml: f64,
    /// Gas that the ring could not hold, ml.
    pub dissolved_ml: f64,
    /// Not yet a whole parcel, of the source and of the inflow, ml.
    pub pending_ml: [f64; 2],
}

/// How a bubble rises among solids.
struct Ceiling<'a> {
    room: Room<'a>,
    /// Along which axis, and whether to its high end, gravity pushes gas most.
    up: (usize, bool),
}

impl Ceiling<'_> {
    /// How fast a bubble rises in this cell, in parts of its speed far from walls.
    fn slowed(&self, cell: [usize; 3], place: [f32; 3]) -> f32 {
        let (spacing_m, radius_m) = (self.room.spacing_m, self.room.radius_m);
        let mut nearest_m = f32::INFINITY;
        for axis in 0..3 {
            let low_m = (place[axis] - cell[axis] as f32) * spacing_m[axis];
            for (to_high, distance_m) in [(false, low_m), (true, spacing_m[axis] - low_m)] {
                if self.room.beside(cell, axis, to_high).is_none() {
                    nearest_m = nearest_m.min(distance_m);
                }
            }
        }
        1.0 - FAXEN * radius_m / nearest_m.max(radius_m)
    }

    /// Whether a bubble under a ceiling slides along an axis, and to which end: to where the way up is open, the nearest first.
    fn slope(&self, cell: [usize; 3]) -> Option<(usize, bool)> {
        let ((up, to_high), room) = (self.up, &self.room);
        if room.beside(cell, up, to_high).is_some() {
            return None;
        }
        let steps = |axis: usize, side: bool| {
            let row =
                std::iter::successors(room.beside(cell, axis, side), |next| room.beside(*next, axis, side)).take(STEP_CELLS);
            row.enumerate().find(|(_, next)| room.beside(*next, up, to_high).is_some()).map(|(steps, _)| steps)
        };
        let ways = (0..3).filter(|axis| *axis != up).flat_map(|axis| [(axis, false), (axis, true)]);
        let open = ways.filter_map(|(axis, side)| Some((steps(axis, side)?, axis, side)));
        open.min_by_key(|(steps, ..)| *steps).map(|(_, axis, side)| (axis, side))
    }
}

impl Solver {
    /// After Particles: carries the gas, counts what has left, and makes what has come in.
    pub(crate) fn settle_bubbles(&self, c: &mut Coordinator, plan: &Plan) -> Result<(), FlowError> {
        if c.bubbles.iter().any(|bubble| bubble.volume_ml > 0.0) {
            self.carry_bubbles(c, plan)?;
        }
        self.make_bubbles(c, &plan.inputs)
    }

    fn carry_bubbles(&self, c: &mut Coordinator, plan: &Plan) -> Result<(), FlowError> {
        let (grid, layout, model) = (&self.model.grid, &*self.layout, &self.model.bubbles);
        let velocity = self.read_velocity(plan.roles.now)?;
        let (h, low, up) = (grid.spacing_m(), grid.origin_m(), model.up);
        let steepest = (0..3).max_by(|a, b| up[*a].abs().total_cmp(&up[*b].abs())).unwrap_or(1);
        let room = Room { layout, fluid: self.fluid.read()?, spacing_m: h, radius_m: 0.5 * model.diameter_m };
        let ceiling = Ceiling { room, up: (steepest, up[steepest] > 0.0) };
        let room = &ceiling.room;
        let rise_m_s = model.rise_m_s(self.model.medium.viscosity_m2_s);
        let least_m = h[0].min(h[1]).min(h[2]);
        let risen_cells = rise_m_s * plan.inputs.dt_s / (LEAP_CELLS * least_m);
        let sweeps = (risen_cells.ceil() as usize).max(plan.particle_sweeps).min(MAX_SWEEPS as usize);
        let dt_s = plan.inputs.dt_s / sweeps as f32;
        for (number, bubble) in c.bubbles.iter_mut().enumerate().filter(|(_, bubble)| bubble.volume_ml > 0.0) {
            let mut place = room.freed(grid.to_cells(bubble.position_m));
            let mut drained = 0.0f32;
            for _ in 0..sweeps {
                let Some(cell) = room.open(place) else { break };
                // As blood does, with the medium there.
                drained += plan.leaving_per_s(room.index(cell)) * dt_s;
                if drained > 0.0 && drained > drawn(self.model.blood.seed, plan.step, OWN_PLACES + number) {
                    c.gas.vented_ml += f64::from(bubble.volume_ml);
                    *bubble = Particle::default();
                    break;
                }
                let rise_m_s = rise_m_s * ceiling.slowed(cell, place);
                let mut v = velocity_at(&velocity, layout, place);
                (0..3).for_each(|a| v[a] += rise_m_s * up[a]);
                if let Some((axis, to_high)) = ceiling.slope(cell) {
                    v[axis] += if to_high { rise_m_s } else { -rise_m_s };
                }
                place = room.moved(place, std::array::from_fn(|a| v[a] * dt_s / h[a]));
            }
            if bubble.volume_ml > 0.0 {
                bubble.position_m = std::array::from_fn(|a| low[a] + place[a] * h[a]);
            }
        }
        Ok(())
    }

    fn make_bubbles(&self, c: &mut Coordinator, inputs: &FlowInputs) -> Result<(), FlowError> {
        let emptied = (c.pump.in_ml / self.model.pump.container_ml) as u64;
        c.gas.pending_ml[0] += f64::from(inputs.gas.flow_ml_s) * f64::from(inputs.dt_s);
        c.gas.pending_ml[1] += emptied.saturating_sub(c.gas.containers) as f64 * self.model.bubbles.change_ml;
        c.gas.containers = emptied;
        let inflow = inputs.ports.iter().find(|port| port.inflow && port.share > 0.0);
        let places = [Some(inputs.gas.position_m), inflow.map(|port| port.centre_m)];
        let unit_ml = f64::from(self.model.bubbles.parcel_ml);
        for (n, place_m) in places.into_iter().enumerate() {
            let Some(place_m) = place_m else { continue };
            let whole = (c.gas.pending_ml[n] / unit_ml).floor();
            let count = whole.min(MADE_PER_STEP as f64);
            for _ in 0..count as usize {
                let volume_ml = (whole * unit_ml / count) as f32;
                let position_m = self.place(place_m, OWN_NUMBERS + c.gas.made)?;
                let next = (c.gas.made % MAX_BUBBLES as u64) as usize;
                let old = std::mem::replace(&mut c.bubbles[next], Particle { position_m, volume_ml });
                c.gas.dissolved_ml += f64::from(old.volume_ml);
                c.gas.made += 1;
                c.gas.made_ml += f64::from(volume_ml);
                c.gas.pending_ml[n] -= f64::from(volume_ml);
            }
        }
        Ok(())
    }
}
