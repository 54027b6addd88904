//! Blood as massless particles in a ring of fixed capacity (against numerical dissipation, as in Zátonyi et al. 2005).
//!
//! Promise: emitted = in particles + dissolved + washed out + lost + buried, in ml; the scatter is a function of the seed and of the
//! number of particles emitted so far, so that a spare emits the same ones. In the cells of an outflow a particle leaves as fast as the medium there, as dye
//! does: when, is drawn from the seed by its place in the ring and the number of the step.

use crate::coordinator::MAX_SWEEPS;
use crate::error::FlowError;
use crate::field::Read;
use crate::grid::{Grid, Layout};
use crate::inputs::{FlowInputs, MAX_SOURCES, tame, tame_place};
use crate::kernels::wide;
use crate::model::BloodModel;
use crate::plan::{Exit, Plan};
use crate::pump::PumpModel;
use crate::room::Room;
use crate::solver::Solver;

/// Particles that one source emits in one step at most; what is more makes them larger.
const EMITTED_PER_STEP: usize = 16;
/// Share of a cell that a particle goes in one stride.
const STRIDE_CELLS: f32 = 0.5;
/// Strides in one step at most: twice the cells that the sweeps of a step can carry the medium. What is faster stays behind.
const MOST_STRIDES: usize = 4 * MAX_SWEEPS as usize;

/// Places of both rings, the blood's and then the gas's, at most.
const MOST_PLACES: u64 = 1 << 20;

/// So many fully open vessels one source stands for at most: with sixteen of them a wound of some 160 cm².
pub const MOST_OPENING: f32 = 64.0;

/// An open vessel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BloodSource {
    /// Where it opens into the cavity, m, station frame.
    pub position_m: [f32; 3],
    /// 0 shut to 1 fully open; of several vessels that have one place the sum of theirs, up to [`MOST_OPENING`].
    pub opening: f32,
}

impl BloodSource {
    pub(crate) fn tame(&mut self) -> u32 {
        let mut count = 0;
        tame_place(&mut self.position_m, &mut count);
        tame(&mut self.opening, 0.0, MOST_OPENING, 0.0, &mut count);
        if count > 0 {
            self.opening = 0.0;
        }
        count
    }
}

/// A droplet of blood that moves with the medium, or a parcel of gas in it. Volume 0: the place in the ring is free.
#[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Particle {
    /// Position, m, station frame.
    pub position_m: [f32; 3],
    /// Volume of blood or gas that it stands for, ml.
    pub volume_ml: f32,
}

/// Counters of the blood, ml, and the ring's place.
#[derive(Debug, Clone, Copy, PartialEq, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct BloodState {
    /// Particles emitted so far; modulo the capacity it is the next place in the ring.
    pub emitted: u64,
    /// Blood emitted as particles.
    pub emitted_ml: f64,
    /// Dye that came in through inflow ports.
    pub entered_ml: f64,
    /// Particles and dye that left through outflow ports.
    pub washed_ml: f64,
    /// Blood that a solid closed in and that no fluid cell beside it could take.
    pub buried_ml: f64,
    /// Dye that left into vessels, and particles and dye that left through a hole or past the sheath.
    pub lost_ml: f64,
    /// Bled but not yet a whole particle, per source.
    pub pending_ml: [f64; MAX_SOURCES],
}

/// Blood that flows from all sources during `dt_s` into a cavity of a volume, ml; adds it to what waits to become particles. However wide a wound, it brings the
/// pressure up to that of the vessels and no further.
pub(crate) fn bleed(
    model: &BloodModel,
    pump: &PumpModel,
    inputs: &FlowInputs,
    cavity_ml: f64,
    dt_s: f64,
    state: &mut BloodState,
) -> f64 {
    let displaced_ml = inputs.pump.displaced_ml;
    let drive_pa = (model.vessel_pa - pump.distended_pa(cavity_ml, displaced_ml)).max(0.0);
    let of = |source: &BloodSource| f64::from(source.opening) * model.conductance_ml_s_pa * drive_pa * dt_s;
    let wanted: f64 = inputs.blood.iter().map(of).sum();
    let room_ml = if wanted > 0.0 { pump.room_ml(cavity_ml, displaced_ml, model.vessel_pa) } else { 0.0 };
    let share = if wanted > room_ml { room_ml / wanted } else { 1.0 };
    let mut total = 0.0;
    for (source, pending) in inputs.blood.iter().zip(&mut state.pending_ml) {
        let volume = share * of(source);
        *pending += volume;
        total += volume;
    }
    total
}

/// A number in −½..½ from seed, counter and axis (the finalizer of splitmix64, Steele et al. 2014).
fn scatter(seed: u64, counter: u64, axis: u64) -> f32 {
    let mut x = seed ^ counter.wrapping_mul(3).wrapping_add(axis).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^= x >> 31;
    (x >> 40) as f32 / (1u64 << 24) as f32 - 0.5
}

/// A number in 0..1 for a place of a ring in a step.
pub(crate) fn drawn(seed: u64, step: u64, place: usize) -> f32 {
    scatter(!seed, step.wrapping_mul(MOST_PLACES).wrapping_add(place as u64), 0) + 0.5
}

/// Whether a solid cell of a plane holds dye; without a branch, for there is none in most steps.
#[inline(always)]
fn holds_in_solid(dye: &[f32], fluid: &[f32]) -> bool {
    dye.iter().zip(fluid).fold(false, |any, (dye, fluid)| any | ((*dye > 0.0) & (*fluid == 0.0)))
}

/// The cell of a position, clamped into the grid: offset in the plane and padded layer, and the index without ghosts.
fn cell_of(grid: &Grid, layout: &Layout, position_m: [f32; 3]) -> (usize, usize, usize) {
    let p = grid.to_cells(position_m);
    let [i, j, k]: [usize; 3] = std::array::from_fn(|a| (p[a].max(0.0) as usize).min(layout.n[a] - 1));
    (layout.row(j) + i, k + 1, (k * layout.n[1] + j) * layout.n[0] + i)
}

/// The lowest of the eight faces of a component around a point in cells, in the padded grid, and how far the point is from it along each axis: faces of the
/// own axis sit at whole numbers, everything else at halves; one ghost cell before.
#[inline(always)]
pub(crate) fn faces_around(layout: &Layout, component: usize, p: [f32; 3]) -> ([usize; 3], [f32; 3]) {
    let mut base = [0usize; 3];
    let mut t = [0.0f32; 3];
    for a in 0..3 {
        let x = if a == component { p[a] + 1.0 } else { p[a] + 0.5 };
        base[a] = (x as usize).min(layout.n[a]);
        t[a] = x - base[a] as f32;
    }
    (base, t)
}

/// Velocity at a point in cells (inside the grid), m/s: trilinear on the staggered components.
pub(crate) fn velocity_at(velocity: &[Read<'_>; 3], layout: &Layout, p: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|component| {
        let (base, t) = faces_around(layout, component, p);
        let at = base[1] * layout.stride + base[0];
        let sheet = |kk: usize| {
            let plane = velocity[component].layer(kk);
            let line = |at: usize| plane[at] + t[0] * (plane[at + 1] - plane[at]);
            let low = line(at);
            low + t[1] * (line(at + layout.stride) - low)
        };
        let low = sheet(base[2]);
        low + t[2] * (sheet(base[2] + 1) - low)
    })
}

impl Solver {
    /// Phase Particles: carries this band's share of the ring (midpoint rule), half a cell at a time; one that leaves by an exit is marked (volume < 0).
    pub(crate) fn particles_band(&self, band: usize) -> Result<(), FlowError> {
        let plan = self.plan()?;
        let layout = &*self.layout;
        let grid = &self.model.grid;
        let velocity = self.read_velocity(plan.roles.now)?;
        let (h, low) = (grid.spacing_m(), grid.origin_m());
        let room = Room { layout, fluid: self.fluid.read()?, spacing_m: h, radius_m: 0.0 };
        let mut share = self.particles[band].try_write().ok_or(FlowError::PhaseConflict)?;
        let inside = |p: [f32; 3]| -> [f32; 3] { std::array::from_fn(|a| p[a].clamp(0.0, layout.n[a] as f32 - 1e-3)) };
        let flow = |p: [f32; 3]| -> [f32; 3] {
            let v = velocity_at(&velocity, layout, inside(p));
            std::array::from_fn(|a| v[a] / h[a])
        };
        for (place, particle) in (self.share_start(band)..).zip(share.iter_mut()).filter(|(_, p)| p.volume_ml > 0.0) {
            let mut p = room.freed(inside(grid.to_cells(particle.position_m)));
            let (mut left_s, mut drained) = (plan.inputs.dt_s, 0.0f32);
            for _ in 0..MOST_STRIDES {
                let Some(cell) = room.open(p).filter(|_| left_s > 0.0) else { break };
                let v = flow(p);
                let fastest = v.iter().fold(0.0f32, |most, v| most.max(v.abs()));
                let dt_s = if fastest * left_s > STRIDE_CELLS { STRIDE_CELLS / fastest } else { left_s };
                let leaving_per_s = plan.leaving_per_s(room.index(cell));
                if leaving_per_s > 0.0 {
                    drained += leaving_per_s * dt_s;
                    if drained > drawn(self.model.blood.seed, plan.step, place) {
                        particle.volume_ml = -particle.volume_ml;
                        break;
                    }
                }
                let v = flow(std::array::from_fn(|a| p[a] + 0.5 * dt_s * v[a]));
                p = room.moved(p, v.map(|v| dt_s * v));
                left_s -= dt_s;
            }
            particle.position_m = std::array::from_fn(|a| low[a] + p[a] * h[a]);
        }
        Ok(())
    }

    /// After Particles: counts what has left, emits what bled, dissolves what the ring cannot hold, and writes the density.
    pub(crate) fn settle_blood(&self, plan: &Plan, state: &mut BloodState) -> Result<(), FlowError> {
        let (capacity, dye) = (self.model.blood.capacity, plan.dye);
        let fluid = self.fluid.read()?;
        for band in 0..self.bands {
            let mut share = self.particles[band].try_write().ok_or(FlowError::PhaseConflict)?;
            for particle in share.iter_mut().filter(|p| p.volume_ml != 0.0) {
                let (at, kk, cell) = cell_of(&self.model.grid, &self.layout, particle.position_m);
                if particle.volume_ml < 0.0 {
                    let is_lost = matches!(plan.exits[cell], Exit::Lost(_));
                    let gone_ml = if is_lost { &mut state.lost_ml } else { &mut state.washed_ml };
                    *gone_ml -= f64::from(particle.volume_ml);
                } else if fluid.layer(kk)[at] == 0.0 {
                    state.buried_ml += f64::from(particle.volume_ml);
                } else {
                    continue;
                }
                *particle = Particle::default();
            }
        }
        for (n, source) in plan.inputs.blood.iter().enumerate() {
            let unit_ml = f64::from(self.model.blood.particle_ml);
            let whole = (state.pending_ml[n] / unit_ml).floor();
            let count = whole.min(EMITTED_PER_STEP as f64);
            for _ in 0..count as usize {
                let volume_ml = (whole * unit_ml / count) as f32;
                let particle = Particle { position_m: self.place(source.position_m, state.emitted)?, volume_ml };
                let place = (state.emitted % capacity as u64) as usize;
                let old = self.exchange(place, particle)?;
                self.dissolve(old, dye, state)?;
                state.emitted += 1;
                state.emitted_ml += f64::from(volume_ml);
                state.pending_ml[n] -= f64::from(volume_ml);
            }
        }
        self.deposit(dye)
    }

    /// A scattered point around a source, in a fluid cell if there is one next to it.
    pub(crate) fn place(&self, at_m: [f32; 3], counter: u64) -> Result<[f32; 3], FlowError> {
        let (grid, layout) = (&self.model.grid, &*self.layout);
        let fluid = self.fluid.read()?;
        let h = grid.spacing_m();
        let mut point = at_m;
        for attempt in 0..8u64 {
            let number = counter.wrapping_mul(8).wrapping_add(attempt);
            let reach = 1.0 + attempt as f32 * 0.25; // each attempt looks a little further
            point = std::array::from_fn(|a| at_m[a] + reach * h[a] * scatter(self.model.blood.seed, number, a as u64));
            let (at, kk, _) = cell_of(grid, layout, point);
            if fluid.layer(kk)[at] > 0.0 {
                break;
            }
        }
        let p = grid.to_cells(point);
        let low = grid.origin_m();
        Ok(std::array::from_fn(|a| low[a] + p[a].clamp(0.0, layout.n[a] as f32 - 1e-3) * h[a]))
    }

    fn exchange(&self, place: usize, particle: Particle) -> Result<Particle, FlowError> {
        let band = (0..self.bands).rfind(|&b| self.share_start(b) <= place).unwrap_or(0);
        let mut share = self.particles[band].try_write().ok_or(FlowError::PhaseConflict)?;
        Ok(std::mem::replace(&mut share[place - self.share_start(band)], particle))
    }

    /// First place of the ring that belongs to `band`.
    pub(crate) fn share_start(&self, band: usize) -> usize {
        band * self.model.blood.capacity / self.bands
    }

    fn dissolve(&self, particle: Particle, dye: usize, state: &mut BloodState) -> Result<(), FlowError> {
        if particle.volume_ml <= 0.0 {
            return Ok(());
        }
        let (at, kk, _) = cell_of(&self.model.grid, &self.layout, particle.position_m);
        if self.fluid.read()?.layer(kk)[at] > 0.0 {
            let cell_ml = self.model.grid.cell_volume_m3() * 1e6;
            self.dye[dye].write(self.layout.band_of(kk))?.layer(kk)[at] += (f64::from(particle.volume_ml) / cell_ml) as f32;
        } else {
            state.buried_ml += f64::from(particle.volume_ml);
        }
        Ok(())
    }

    /// Density of blood per cell (volume fraction) = dye + particles, spread trilinearly.
    fn deposit(&self, dye: usize) -> Result<(), FlowError> {
        let (grid, layout) = (&self.model.grid, &*self.layout);
        let dye = self.dye[dye].read()?;
        let mut density: [Option<crate::field::Write<'_>>; crate::grid::MAX_BANDS] = [const { None }; crate::grid::MAX_BANDS];
        for (band, slot) in density.iter_mut().enumerate().take(self.bands) {
            let mut field = self.density.write(band)?;
            for kk in layout.stored(band) {
                field.layer(kk).copy_from_slice(dye.layer(kk));
            }
            *slot = Some(field);
        }
        let per_cell = (1e-6 / grid.cell_volume_m3()) as f32;
        for band in 0..self.bands {
            let share = self.particles[band].try_read().ok_or(FlowError::PhaseConflict)?;
            for particle in share.iter().filter(|p| p.volume_ml > 0.0) {
                let p = grid.to_cells(particle.position_m).map(|x| x + 0.5);
                let base: [usize; 3] = std::array::from_fn(|a| (p[a].max(0.0) as usize).min(layout.n[a]));
                let t: [f32; 3] = std::array::from_fn(|a| (p[a] - base[a] as f32).clamp(0.0, 1.0));
                let amount = particle.volume_ml * per_cell;
                for corner in 0..8usize {
                    let bit = [corner & 1, corner >> 1 & 1, corner >> 2];
                    let weight: f32 = (0..3).map(|a| if bit[a] == 1 { t[a] } else { 1.0 - t[a] }).product();
                    let kk = base[2] + bit[2];
                    if let Some(field) = &mut density[layout.band_of(kk)] {
                        field.layer(kk)[(base[1] + bit[1]) * layout.stride + base[0] + bit[0]] += amount * weight;
                    }
                }
            }
        }
        Ok(())
    }

    /// Dye in cells that a solid has taken moves to a fluid cell beside them, else it is buried.
    pub(crate) fn push_dye(&self, dye: usize, state: &mut BloodState) -> Result<(), FlowError> {
        let layout = &*self.layout;
        let fluid = self.fluid.read()?;
        let s = layout.stride;
        for kk in 1..=layout.n[2] {
            let dye_now = self.dye[dye].read()?;
            let is_closed_in = wide(
                #[inline(always)]
                || holds_in_solid(dye_now.layer(kk), fluid.layer(kk)),
            );
            drop(dye_now);
            if !is_closed_in {
                continue;
            }
            for j in 0..layout.n[1] {
                for at in layout.row(j)..layout.row(j) + layout.n[0] {
                    if fluid.layer(kk)[at] > 0.0 {
                        continue;
                    }
                    let amount = std::mem::take(&mut self.dye[dye].write(layout.band_of(kk))?.layer(kk)[at]);
                    if amount <= 0.0 {
                        continue;
                    }
                    let beside = [(kk, at - 1), (kk, at + 1), (kk, at - s), (kk, at + s), (kk - 1, at), (kk + 1, at)];
                    match beside.into_iter().find(|&(kk, at)| fluid.layer(kk)[at] > 0.0) {
                        Some((kk, at)) => self.dye[dye].write(layout.band_of(kk))?.layer(kk)[at] += amount,
                        None => state.buried_ml += f64::from(amount) * self.model.grid.cell_volume_m3() * 1e6,
                    }
                }
            }
        }
        Ok(())
    }
}
