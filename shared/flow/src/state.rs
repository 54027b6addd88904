//! The state as a message: one flat block of plain data, written in place and checked on reading.
//!
//! Layout, native byte order, offsets from [`Offsets`]: header, then f32 arrays u, v, w (m/s, on the low faces of each cell), pressure
//! (Pa, mean 0, to be added to the cavity's), dye and density (volume fraction), x fastest, then y, then z; then the particles,
//! the parcels of gas, and one byte per cell of the case's mask. Promise: [`Solver::load`] of what [`Solver::store`] wrote continues with the same bits; any
//! other bytes are refused with a typed error and leave the solver as it was.

use bytemuck::Zeroable;

use crate::blood::{BloodState, Particle};
use crate::bubbles::{BubbleState, MAX_BUBBLES};
use crate::error::FlowError;
use crate::field::Field;
use crate::grid::Grid;
use crate::inputs::MAX_SPEED_M_S;
use crate::pump::PumpState;
use crate::solver::Solver;

const MAGIC: u64 = 0x6879_7374_666c_6f77; // "hystflow"
const VERSION: u32 = 3;
/// No beat is larger, ml: a stroke is at most 100 ml, and a beat half of that.
const MOST_BEAT_ML: f32 = 50.0;
/// Fields of f32 per cell.
const FIELDS: usize = 6;
const NAMES: [&str; FIELDS] = ["u", "v", "w", "pressure", "dye", "density"];

#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Header {
    magic: u64,
    checksum: u64,
    bytes: u64,
    version: u32,
    capacity: u32,
    cells: [u32; 3],
    spacing_m: [f32; 3],
    origin_m: [f32; 3],
    /// The roller's beat, ml; 0 in a state of an engine that knew of none.
    beat_ml: f32,
    step: u64,
    time_s: f64,
    pressure_pa: f64,
    pump: PumpState,
    blood: BloodState,
    gas: BubbleState,
}

/// Where the parts of a block begin, bytes.
struct Offsets {
    cells: usize,
    particles: usize,
    bubbles: usize,
    mask: usize,
    total: usize,
}

impl Offsets {
    fn new(grid: &Grid, capacity: usize) -> Self {
        let cells = grid.cell_count();
        let particles = (size_of::<Header>() + FIELDS * 4 * cells).next_multiple_of(8);
        let bubbles = particles + capacity * size_of::<Particle>();
        let mask = bubbles + MAX_BUBBLES * size_of::<Particle>();
        Self { cells, particles, bubbles, mask, total: (mask + cells).next_multiple_of(8) }
    }
    fn field(&self, index: usize) -> std::ops::Range<usize> {
        let from = size_of::<Header>() + index * 4 * self.cells;
        from..from + 4 * self.cells
    }
}

/// Length of a state block, bytes, for a grid and a particle capacity.
pub fn state_bytes(grid: &Grid, capacity: usize) -> usize {
    Offsets::new(grid, capacity).total
}

/// Four interleaved multiply-xor chains over 64-bit words (after FNV-1a), with the checksum's own word taken as 0.
fn checksum(bytes: &[u8]) -> u64 {
    const PRIME: u64 = 0x0000_0100_0000_01b3;
    let mut chains = [0xcbf2_9ce4_8422_2325u64, 1, 2, 3];
    for (block, chunk) in bytes.chunks(32).enumerate() {
        let mut words = [0u64; 4];
        for (word, part) in words.iter_mut().zip(chunk.chunks_exact(8)) {
            *word = bytemuck::pod_read_unaligned(part);
        }
        if block == 0 {
            words[1] = 0;
        }
        for (chain, word) in chains.iter_mut().zip(words) {
            *chain = (*chain ^ word).wrapping_mul(PRIME).rotate_left(29);
        }
    }
    chains.iter().fold(bytes.len() as u64, |all, chain| (all ^ chain).wrapping_mul(PRIME).rotate_left(31))
}

/// A view of a state block, for consumers such as rendering: checked in whole by [`StateView::new`], or in form by [`StateView::framed`].
#[derive(Clone, Copy)]
pub struct StateView<'a> {
    header: &'a Header,
    bytes: &'a [u8],
    grid: Grid,
}

impl<'a> StateView<'a> {
    /// Checks header, sizes, checksum and values.
    ///
    /// # Errors
    /// [`FlowError::Alignment`], [`FlowError::Length`], [`FlowError::State`] or [`FlowError::StateValue`].
    pub fn new(bytes: &'a [u8]) -> Result<Self, FlowError> {
        let view = Self::framed(bytes)?;
        expect("checksum", view.header.checksum, checksum(bytes))?;
        view.check_values()?;
        Ok(view)
    }

    /// Checks header and sizes alone, in a time that does not grow with the grid: for who looks at some cells in each picture and judges every number
    /// that he reads, for the arrays may hold anything, NaN too.
    ///
    /// # Errors
    /// [`FlowError::Alignment`], [`FlowError::Length`], [`FlowError::State`], [`FlowError::GridSize`], [`FlowError::GridGeometry`] or
    /// [`FlowError::StateValue`].
    pub fn framed(bytes: &'a [u8]) -> Result<Self, FlowError> {
        let head = size_of::<Header>();
        let Some(first) = bytes.get(..head) else {
            return Err(FlowError::Length { what: "the flow state", got: bytes.len(), want: head });
        };
        let header: &Header = bytemuck::try_from_bytes(first).map_err(|_| FlowError::Alignment)?;
        expect("magic", header.magic, MAGIC)?;
        expect("version", header.version.into(), VERSION.into())?;
        let cells = header.cells.map(|n| n as usize);
        let grid = Grid::new(cells, header.spacing_m, header.origin_m)?;
        if !(1..=65_536).contains(&header.capacity) {
            return Err(FlowError::StateValue { field: "capacity", index: 0 });
        }
        let want = state_bytes(&grid, header.capacity as usize);
        if bytes.len() != want {
            return Err(FlowError::Length { what: "the flow state", got: bytes.len(), want });
        }
        expect("length", header.bytes, want as u64)?;
        Ok(Self { header, bytes, grid })
    }

    fn check_values(&self) -> Result<(), FlowError> {
        let limits = [2.0 * MAX_SPEED_M_S, 2.0 * MAX_SPEED_M_S, 2.0 * MAX_SPEED_M_S, 1e30, 1e30, 1e30];
        for (index, limit) in limits.into_iter().enumerate() {
            if let Some(at) = self.field(index).iter().position(|x| !(-limit..=limit).contains(x)) {
                return Err(FlowError::StateValue { field: NAMES[index], index: at });
            }
        }
        let good = |p: &Particle| p.position_m.iter().all(|x| x.abs() <= 1e4) && (0.0..=1e6).contains(&p.volume_ml);
        if let Some(index) = self.particles().iter().position(|p| !good(p)) {
            return Err(FlowError::StateValue { field: "particles", index });
        }
        if let Some(index) = self.bubbles().iter().position(|p| !good(p)) {
            return Err(FlowError::StateValue { field: "bubbles", index });
        }
        if !(-MOST_BEAT_ML..=MOST_BEAT_ML).contains(&self.header.beat_ml) {
            return Err(FlowError::StateValue { field: "beat", index: 0 });
        }
        let (p, b, g) = (&self.header.pump, &self.header.blood, &self.header.gas);
        let pump = [p.cavity_ml, p.in_ml, p.out_ml, p.intravasated_ml, p.leaked_ml, p.perforated_ml, p.bled_ml];
        let blood = [b.emitted_ml, b.entered_ml, b.washed_ml, b.buried_ml, b.lost_ml];
        let clock = [self.header.time_s, self.header.pressure_pa.abs()];
        let gas = [g.made_ml, g.vented_ml, g.dissolved_ml];
        let counters = pump.into_iter().chain(blood).chain(clock).chain(gas).chain(b.pending_ml).chain(g.pending_ml);
        for (index, x) in counters.enumerate() {
            // A counter of what waits may be a rounding error below 0.
            if !(-1e-3..=1e15).contains(&x) {
                return Err(FlowError::StateValue { field: "counters", index });
            }
        }
        Ok(())
    }

    fn field(&self, index: usize) -> &'a [f32] {
        let at = Offsets::new(&self.grid, self.header.capacity as usize).field(index);
        bytemuck::cast_slice(&self.bytes[at])
    }
    /// The grid that the state was computed on.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }
    /// Velocity along x, y or z (0, 1, 2) on the low face of each cell, m/s; where a solid touches it, the solid's. The high face of the last cell is on the
    /// wall: 0.
    pub fn velocity_m_s(&self, axis: usize) -> &'a [f32] {
        self.field(axis.min(2))
    }
    /// What leaves a cell of the grid beyond what comes into it, in volumes of the cell per second: the divergence of the velocity on its six faces.
    pub fn divergence_per_s(&self, cell: usize) -> f64 {
        let ([nx, ny, nz], spacing_m) = (self.grid.cells(), self.grid.spacing_m());
        let (at, strides) = ([cell % nx, cell / nx % ny, cell / (nx * ny)], [1, nx, nx * ny]);
        let along = |axis: usize| {
            let (faces, is_last) = (self.velocity_m_s(axis), at[axis] + 1 == [nx, ny, nz][axis]);
            let high = if is_last { 0.0 } else { faces[cell + strides[axis]] };
            f64::from(high - faces[cell]) / f64::from(spacing_m[axis])
        };
        along(0) + along(1) + along(2)
    }
    /// Pressure in the flow, Pa, with mean 0: added to the cavity's.
    pub fn pressure_pa(&self) -> &'a [f32] {
        self.field(3)
    }
    /// Dissolved blood, volume fraction.
    pub fn dye(&self) -> &'a [f32] {
        self.field(4)
    }
    /// Blood to show (dye and particles), volume fraction.
    pub fn density(&self) -> &'a [f32] {
        self.field(5)
    }
    /// The ring of particles; those of volume 0 are free places.
    pub fn particles(&self) -> &'a [Particle] {
        let at = Offsets::new(&self.grid, self.header.capacity as usize);
        bytemuck::cast_slice(&self.bytes[at.particles..at.bubbles])
    }
    /// The ring of parcels of gas; those of volume 0 are free places.
    pub fn bubbles(&self) -> &'a [Particle] {
        let at = Offsets::new(&self.grid, self.header.capacity as usize);
        bytemuck::cast_slice(&self.bytes[at.bubbles..at.mask])
    }
    /// The case's mask, 0 = fluid.
    pub fn mask(&self) -> &'a [u8] {
        let at = Offsets::new(&self.grid, self.header.capacity as usize);
        &self.bytes[at.mask..at.mask + at.cells]
    }
    /// Counters of the pump, ml.
    pub fn pump(&self) -> &'a PumpState {
        &self.header.pump
    }
    /// What the cavity holds beyond its counter by the roller's beat, ml.
    pub fn beat_ml(&self) -> f32 {
        self.header.beat_ml
    }
    /// Counters of the blood, ml.
    pub fn blood(&self) -> &'a BloodState {
        &self.header.blood
    }
    /// Counters of the gas.
    pub fn gas(&self) -> &'a BubbleState {
        &self.header.gas
    }
    /// Steps and simulated time, s.
    pub fn time(&self) -> (u64, f64) {
        (self.header.step, self.header.time_s)
    }
}

fn expect(field: &'static str, got: u64, want: u64) -> Result<(), FlowError> {
    if got == want { Ok(()) } else { Err(FlowError::State { field, got, want }) }
}

impl Solver {
    /// Length of this solver's state block, bytes.
    pub fn state_bytes(&self) -> usize {
        state_bytes(&self.model.grid, self.model.blood.capacity)
    }

    /// Writes the state into `bytes` (8-aligned, [`Self::state_bytes`] long). Between steps only.
    ///
    /// # Errors
    /// [`FlowError::Length`], [`FlowError::Alignment`], or [`FlowError::PhaseConflict`] during a phase.
    pub fn store(&self, bytes: &mut [u8]) -> Result<(), FlowError> {
        let at = Offsets::new(&self.model.grid, self.model.blood.capacity);
        if bytes.len() != at.total {
            return Err(FlowError::Length { what: "the block for the flow state", got: bytes.len(), want: at.total });
        }
        if bytemuck::try_from_bytes::<Header>(&bytes[..size_of::<Header>()]).is_err() {
            return Err(FlowError::Alignment);
        }
        let c = self.coordinator.try_lock().ok_or(FlowError::PhaseConflict)?;
        bytes[at.field(FIELDS - 1).end..at.particles].fill(0);
        bytes[at.mask + at.cells..].fill(0);
        for (index, field) in self.stored_fields()?.into_iter().enumerate() {
            self.copy_out(field, bytemuck::cast_slice_mut(&mut bytes[at.field(index)]))?;
        }
        let ring: &mut [Particle] = bytemuck::cast_slice_mut(&mut bytes[at.particles..at.bubbles]);
        for band in 0..self.bands {
            let share = self.particles[band].try_read().ok_or(FlowError::PhaseConflict)?;
            ring[self.share_start(band)..][..share.len()].copy_from_slice(&share);
        }
        bytes[at.bubbles..at.mask].copy_from_slice(bytemuck::cast_slice(&c.bubbles));
        bytes[at.mask..at.mask + at.cells].copy_from_slice(&self.base.try_read().ok_or(FlowError::PhaseConflict)?.solid);
        let grid = &self.model.grid;
        let mut header = Header {
            magic: MAGIC,
            bytes: at.total as u64,
            version: VERSION,
            capacity: self.model.blood.capacity as u32,
            cells: grid.cells().map(|n| n as u32),
            spacing_m: grid.spacing_m(),
            origin_m: grid.origin_m(),
            step: c.report.step,
            time_s: c.report.time_s,
            pressure_pa: c.report.pump.pressure_pa,
            beat_ml: c.beat_ml,
            pump: c.pump,
            blood: c.blood,
            gas: c.gas,
            ..Header::zeroed()
        };
        bytes[..size_of::<Header>()].copy_from_slice(bytemuck::bytes_of(&header));
        header.checksum = checksum(bytes);
        bytes[..size_of::<Header>()].copy_from_slice(bytemuck::bytes_of(&header));
        Ok(())
    }

    /// Takes over a state. On an error the solver keeps its own.
    ///
    /// # Errors
    /// As [`StateView::new`], and [`FlowError::State`] if grid or capacity differ from this solver's model.
    pub fn load(&self, bytes: &[u8]) -> Result<(), FlowError> {
        let view = StateView::new(bytes)?;
        let grid = &self.model.grid;
        for axis in 0..3 {
            expect("cells", view.grid.cells()[axis] as u64, grid.cells()[axis] as u64)?;
            expect("spacing", view.grid.spacing_m()[axis].to_bits().into(), grid.spacing_m()[axis].to_bits().into())?;
            expect("origin", view.grid.origin_m()[axis].to_bits().into(), grid.origin_m()[axis].to_bits().into())?;
        }
        expect("capacity", view.header.capacity.into(), self.model.blood.capacity as u64)?;
        let mut c = self.coordinator.try_lock().ok_or(FlowError::PhaseConflict)?;
        for (index, field) in self.stored_fields()?.into_iter().enumerate() {
            self.copy_in(field, view.field(index))?;
        }
        for band in 0..self.bands {
            let mut share = self.particles[band].try_write().ok_or(FlowError::PhaseConflict)?;
            let len = share.len();
            share.copy_from_slice(&view.particles()[self.share_start(band)..][..len]);
        }
        self.set_mask(view.mask())?;
        (c.pump, c.blood, c.gas) = (view.header.pump, view.header.blood, view.header.gas);
        c.beat_ml = view.header.beat_ml;
        c.bubbles.copy_from_slice(view.bubbles());
        c.report = Default::default();
        (c.report.step, c.report.time_s) = view.time();
        c.report.pump.pressure_pa = view.header.pressure_pa;
        c.running = false;
        drop(c);
        self.fill_ghosts()
    }

    fn stored_fields(&self) -> Result<[&Field; FIELDS], FlowError> {
        let plan = self.plan()?;
        let [u, v, w] = &self.velocity[plan.roles.now];
        Ok([u, v, w, &self.pressure, &self.dye[plan.dye], &self.density])
    }
}
