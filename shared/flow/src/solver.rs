//! The solver: fields in bands of horizontal layers, and the phases in which several threads may compute them.
//!
//! Protocol: `begin`, then again and again `next_phase` by one coordinator and `run_phase(phase, band)` for every band by anyone,
//! each phase ending before the next begins. Promise: the result is the same, bit for bit, for any number of bands and threads.

use std::sync::Arc;

use parking_lot::{Mutex, MutexGuard, RwLock, RwLockReadGuard};

use crate::coordinator::Coordinator;
use crate::error::FlowError;
use crate::field::Field;
use crate::grid::{Layout, MAX_BANDS};
use crate::inputs::FlowInputs;
use crate::model::FlowModel;
use crate::multigrid::Hierarchy;
use crate::obstacles::Walls;
use crate::plan::{Exit, LayerSums, MAX_EXITS, Plan, Roles, Share};
use crate::sources::most_cells;
use crate::walls::Mirrors;
use crate::wires::MAX_DRAGS;

/// One stage of a step. All bands of a phase may run at the same time; two phases may not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Phase {
    /// Solid and fluid cells, solid faces, largest speed.
    Mask,
    /// What the faces in and on solids show, so that the medium sticks to them.
    Mirror,
    /// They show it.
    Hold,
    /// Pressure operator of the grid.
    Operator,
    /// Pressure operator of a coarser level.
    Coarsen(u8),
    /// Its diagonal.
    CoarsenDiagonal(u8),
    /// Operators of all smaller levels (band 0 alone).
    CoarsenRest,
    /// Forces and diffusion.
    Diffuse,
    /// Self-advection, forward.
    AdvectForward,
    /// Self-advection, back and correction.
    AdvectBack,
    /// Divergence and sources.
    RightSide,
    /// Residual of the pressure.
    Residual,
    /// Residual to the next coarser level.
    Restrict(u8),
    /// The cycle on all smaller levels (band 0 alone).
    Coarse,
    /// Correction of a level by the next coarser one, and its smoothing.
    Smooth(u8),
    /// Search direction and its image.
    Direction,
    /// Pressure and residual along it.
    Update,
    /// Pressure gradient off the velocity.
    Project,
    /// Pressure in pascal with mean 0, largest outflow of a cell.
    Centre,
    /// Dye.
    Dye,
    /// Blood particles.
    Particles,
    /// The faces in and on solids show the solid's own velocity again.
    Rest,
}

/// The Flow Engine's mathematics: model and state of one grid.
pub struct Solver {
    pub(crate) model: FlowModel,
    pub(crate) bands: usize,
    pub(crate) layout: Arc<Layout>,
    pub(crate) mirrors: Mirrors,
    /// 1/h² per axis.
    pub(crate) weights: [f32; 3],
    pub(crate) base: RwLock<Walls>,
    pub(crate) fluid: Field,
    /// Velocity of the solid at each face that touches one.
    pub(crate) face: [Field; 3],
    /// What such a face is to show.
    pub(crate) held: [Field; 3],
    pub(crate) velocity: [[Field; 3]; 4],
    pub(crate) pressure: Field,
    pub(crate) direction: Field,
    pub(crate) image: Field,
    pub(crate) dye: [Field; 2],
    pub(crate) density: Field,
    pub(crate) particles: Vec<RwLock<Share>>,
    pub(crate) hierarchy: Hierarchy,
    pub(crate) plan: RwLock<Plan>,
    pub(crate) coordinator: Mutex<Coordinator>,
    pub(crate) sums: Vec<Mutex<Vec<LayerSums>>>,
}

impl Solver {
    /// Fluid at rest in an empty grid (no solid cells, empty cavity), in `bands` groups of layers.
    ///
    /// # Errors
    /// [`FlowError::Bands`] or [`FlowError::Parameter`].
    pub fn new(model: FlowModel, bands: usize) -> Result<Self, FlowError> {
        model.check()?;
        let n = model.grid.cells();
        let most = MAX_BANDS.min(n[2]);
        if !(1..=most).contains(&bands) {
            return Err(FlowError::Bands { bands, layers: n[2], most });
        }
        let layout = Arc::new(Layout::new(n, bands));
        let cells = layout.cell_count();
        let field = || Field::new(&layout);
        let three = || [field(), field(), field()];
        let share = |b: usize| (b + 1) * model.blood.capacity / bands - b * model.blood.capacity / bands;
        let plan = Plan {
            inputs: FlowInputs::default(),
            roles: Roles::default(),
            courant: [0.0; 3],
            diffusion: [0.0; 3],
            impulse_m_s: [0.0; 3],
            dt_by_density: 1.0,
            alpha: 0.0,
            beta: 0.0,
            first_direction: true,
            is_unsigned: false,
            components: 1,
            means: Default::default(),
            labels: vec![0; cells],
            sources: Vec::with_capacity(most_cells(cells)),
            layers: vec![0; n[2] + 3],
            drags: Vec::with_capacity(MAX_DRAGS),
            exits: vec![Exit::Shut; cells],
            exit_rates_per_s: [0.0; MAX_EXITS],
            step: 0,
            dye: 0,
            dye_dt_s: 0.0,
            particle_sweeps: 1,
            pump: Default::default(),
            bled_ml_s: 0.0,
        };
        let solver = Self {
            bands,
            mirrors: Mirrors::new(&model.walls),
            weights: model.grid.spacing_m().map(|h| 1.0 / (h * h)),
            base: RwLock::new(Walls::new(cells)),
            fluid: field(),
            face: three(),
            held: three(),
            velocity: [three(), three(), three(), three()],
            pressure: field(),
            direction: field(),
            image: field(),
            dye: [field(), field()],
            density: field(),
            particles: (0..bands).map(|b| RwLock::new(vec![Default::default(); share(b)])).collect(),
            hierarchy: Hierarchy::new(&layout, model.grid.spacing_m()),
            plan: RwLock::new(plan),
            coordinator: Mutex::new(Coordinator::new(&layout)),
            sums: (0..bands).map(|b| Mutex::new(vec![LayerSums::default(); layout.own(b).len()])).collect(),
            layout,
            model,
        };
        solver.fill_ghosts()?;
        Ok(solver)
    }

    /// The model.
    pub fn model(&self) -> &FlowModel {
        &self.model
    }

    /// Number of bands that each phase is cut into.
    pub fn bands(&self) -> usize {
        self.bands
    }

    /// Cells of a level of the pressure solve; level 0 is the grid itself. 0 for a level that does not exist.
    pub fn level_cells(&self, level: u8) -> usize {
        self.hierarchy.levels.get(usize::from(level)).map_or(0, |level| level.layout.cell_count())
    }

    /// True if only band 0 has work in this phase: the coordinator may run it itself.
    pub fn is_serial(&self, phase: Phase) -> bool {
        matches!(phase, Phase::CoarsenRest | Phase::Coarse)
    }

    /// Computes one band of a phase. Every band of the phase must be run once before the next phase is asked for.
    ///
    /// # Errors
    /// [`FlowError::PhaseConflict`] if the protocol was broken; the state is then undefined until the next [`Self::load`].
    pub fn run_phase(&self, phase: Phase, band: usize) -> Result<(), FlowError> {
        if band >= self.bands || (band > 0 && self.is_serial(phase)) {
            return Ok(());
        }
        match phase {
            Phase::Mask => self.mask_band(band),
            Phase::Mirror => self.mirror_band(band),
            Phase::Hold => self.hold_band(band),
            Phase::Operator => self.operator_band(band),
            Phase::Coarsen(l) => self.coarsen_band(l.into(), band),
            Phase::CoarsenDiagonal(l) => self.coarsen_diagonal_band(l.into(), band),
            Phase::CoarsenRest => self.coarsen_rest(),
            Phase::Diffuse => self.diffuse_band(band),
            Phase::AdvectForward => self.advect_forward_band(band),
            Phase::AdvectBack => self.advect_back_band(band),
            Phase::RightSide => self.right_side_band(band),
            Phase::Residual => self.residual_band(band),
            Phase::Restrict(l) => self.restrict_band(l.into(), band),
            Phase::Coarse => self.coarse_cycle(),
            Phase::Smooth(l) => self.smooth_band(l.into(), band),
            Phase::Direction => self.direction_band(band),
            Phase::Update => self.update_band(band),
            Phase::Project => self.project_band(band),
            Phase::Centre => self.centre_band(band),
            Phase::Dye => self.dye_band(band),
            Phase::Particles => self.particles_band(band),
            Phase::Rest => self.rest_band(band),
        }
    }

    fn coarsen_rest(&self) -> Result<(), FlowError> {
        for l in self.hierarchy.serial_from..self.hierarchy.levels.len() {
            self.coarsen_band(l, 0)?;
            self.coarsen_diagonal_band(l, 0)?;
        }
        match self.hierarchy.levels.last() {
            Some(last) => self.hierarchy.coarsest.factor(last),
            None => Ok(()),
        }
    }

    pub(crate) fn plan(&self) -> Result<RwLockReadGuard<'_, Plan>, FlowError> {
        self.plan.try_read().ok_or(FlowError::PhaseConflict)
    }

    pub(crate) fn sums(&self, band: usize) -> Result<MutexGuard<'_, Vec<LayerSums>>, FlowError> {
        self.sums[band].try_lock().ok_or(FlowError::PhaseConflict)
    }

    /// Fills the ghosts of the newest velocity, after its inside was set.
    pub(crate) fn fill_ghosts(&self) -> Result<(), FlowError> {
        let now = self.plan()?.roles.now;
        for component in 0..3 {
            for band in 0..self.bands {
                let mut field = self.velocity[now][component].write(band)?;
                for kk in self.layout.own(band) {
                    self.mirrors.plane(&self.layout, component, field.layer(kk));
                }
                self.mirrors.layers(&self.layout, component, band, &mut field);
            }
        }
        Ok(())
    }
}
