//! What happens between the phases: which phase is next, sums over layers in fixed order, pump, sources, components, blood.

use crate::blood::{BloodState, Particle, bleed};
use crate::bubbles::{BubbleState, MAX_BUBBLES};
use crate::components::Components;
use crate::error::FlowError;
use crate::grid::Layout;
use crate::inputs::{FlowInputs, MAX_TOOLS};
use crate::plan::{LayerSums, MAX_COMPONENTS, Plan, Roles};
use crate::pump::{MOST_PA, PumpReport, PumpState};
use crate::solver::{Phase, Solver};
use crate::traction::Load;

/// Transport sweeps per step at most: 16 cells per step is 0.6 m/s at 40 Hz and 1 mm; faster flow is slowed and counted.
pub const MAX_SWEEPS: u32 = 16;

/// What a step did.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StepReport {
    /// Steps since the solver was new.
    pub step: u64,
    /// Simulated time, s.
    pub time_s: f64,
    /// Input values that were not finite or out of range and were replaced.
    pub neutralised: u32,
    /// Velocities beyond any real speed that were set to 0.
    pub wild: u32,
    /// True if the flow was too fast for the sweeps allowed and was slowed in transport.
    pub slowed: bool,
    /// Ports with an open valve and without a cell: what flows there widens or narrows the cavity and moves nothing.
    pub blind_ports: u32,
    /// Sweeps of advection.
    pub sweeps: u32,
    /// Sweeps of the dye.
    pub dye_sweeps: u32,
    /// Connected parts of the fluid.
    pub components: u32,
    /// Conjugate-gradient iterations.
    pub iterations: u32,
    /// ‖residual‖₂ / ‖right side‖₂ at the end (0 where there was nothing to solve).
    pub residual_relative: f64,
    /// The iterations ended before that was as small as the model asks.
    pub unconverged: bool,
    /// Largest speed along an axis, m/s.
    pub speed_m_s: f32,
    /// What the medium does to each tool.
    pub tools: [Load; MAX_TOOLS],
    /// What it does to all wires.
    pub wires: Load,
    /// Pump and cavity.
    pub pump: PumpReport,
}

pub(crate) struct Coordinator {
    pub last: Option<Phase>,
    pub running: bool,
    pub built: bool,
    /// What is solid is left out. Tests compute everything, and compare.
    pub skips: bool,
    /// Solid cells have come or gone, and the pressure's operator is to be made anew.
    pub is_changed: bool,
    /// Faces in solids show what is mirrored in them.
    pub is_held: bool,
    pub pump: PumpState,
    /// What the cavity holds beyond that, ml: the roller's beat.
    pub beat_ml: f32,
    pub blood: BloodState,
    pub gas: BubbleState,
    /// The ring of parcels of gas.
    pub bubbles: Vec<Particle>,
    pub report: StepReport,
    pub components: Components,
    pub sizes: [u32; MAX_COMPONENTS],
    pub diffuse_left: u32,
    pub advect_left: u32,
    dye_left: u32,
    spare_buffers: [usize; 2],
    pub largest_rate_per_s: f32,
    rz: f64,
    bb: f64,
    pub rest_residual2: f64,
}

impl Coordinator {
    pub fn new(layout: &Layout) -> Self {
        Self {
            last: None,
            running: false,
            built: false,
            skips: true,
            is_changed: false,
            is_held: false,
            pump: PumpState::default(),
            beat_ml: 0.0,
            blood: BloodState::default(),
            gas: BubbleState::default(),
            bubbles: vec![Particle::default(); MAX_BUBBLES],
            report: StepReport::default(),
            components: Components::new(layout),
            sizes: [0; MAX_COMPONENTS],
            diffuse_left: 0,
            advect_left: 0,
            dye_left: 0,
            spare_buffers: [0; 2],
            largest_rate_per_s: 0.0,
            rz: 0.0,
            bb: 0.0,
            rest_residual2: 0.0,
        }
    }
}

impl Solver {
    /// Begins a step: neutralises the inputs and moves pump and cavity by `dt_s`. A `dt_s` of 0 is a step without phases.
    ///
    /// # Errors
    /// [`FlowError::PhaseConflict`] during a phase.
    pub fn begin(&self, inputs: &FlowInputs) -> Result<(), FlowError> {
        let mut guard = self.coordinator.try_lock().ok_or(FlowError::PhaseConflict)?;
        let c = &mut *guard;
        let mut plan = self.plan.try_write().ok_or(FlowError::PhaseConflict)?;
        let (inputs, neutralised) = inputs.neutralised();
        let neutralised = neutralised + u32::from(self.model.pump.is_asked_for_more(&inputs.pump));
        let dt_s = f64::from(inputs.dt_s);
        (plan.inputs, plan.step) = (inputs, c.report.step);
        let bled_ml = bleed(&self.model.blood, &self.model.pump, &inputs, c.pump.cavity_ml, dt_s, &mut c.blood);
        plan.bled_ml_s = if dt_s > 0.0 { bled_ml / dt_s } else { 0.0 };
        let from = c.pump;
        let mean = self.model.pump.step(&mut c.pump, &inputs.pump, self.model.medium.isotonic, bled_ml, dt_s);
        let beat = self.model.pump.beat(&mut c.beat_ml, &inputs.pump, &from, &c.pump, dt_s);
        plan.pump = PumpReport { pressure_pa: (mean.pressure_pa + beat.pressure_pa).clamp(0.0, MOST_PA), beat, ..mean };
        let report = &c.report;
        c.report = StepReport { step: report.step, time_s: report.time_s, neutralised, pump: plan.pump, ..Default::default() };
        c.last = None;
        c.running = inputs.dt_s > 0.0;
        plan.dt_by_density = inputs.dt_s / self.model.medium.density_kg_m3;
        Ok(())
    }

    /// The next phase of the step, or `None` at its end. Call it after every band of the last phase has run.
    ///
    /// # Errors
    /// [`FlowError::PhaseConflict`] if a band is still running.
    pub fn next_phase(&self) -> Result<Option<Phase>, FlowError> {
        let mut guard = self.coordinator.try_lock().ok_or(FlowError::PhaseConflict)?;
        let c = &mut *guard;
        if !c.running {
            return Ok(None);
        }
        let mut plan = self.plan.try_write().ok_or(FlowError::PhaseConflict)?;
        let next = self.after(c, &mut plan)?;
        if next.is_none() {
            c.running = false;
        }
        c.last = next;
        Ok(next)
    }

    /// A whole step on the calling thread.
    ///
    /// # Errors
    /// [`FlowError::PhaseConflict`] if another thread runs phases of this solver.
    pub fn step_serial(&self, inputs: &FlowInputs) -> Result<StepReport, FlowError> {
        self.begin(inputs)?;
        while let Some(phase) = self.next_phase()? {
            for band in 0..self.bands {
                self.run_phase(phase, band)?;
            }
        }
        self.report()
    }

    /// What the last finished step did.
    ///
    /// # Errors
    /// [`FlowError::PhaseConflict`] while the coordinator is between phases on another thread.
    pub fn report(&self) -> Result<StepReport, FlowError> {
        Ok(self.coordinator.try_lock().ok_or(FlowError::PhaseConflict)?.report)
    }

    /// Counters of pump and blood.
    ///
    /// # Errors
    /// As [`Self::report`].
    pub fn counters(&self) -> Result<(PumpState, BloodState), FlowError> {
        let c = self.coordinator.try_lock().ok_or(FlowError::PhaseConflict)?;
        Ok((c.pump, c.blood))
    }

    /// Counters of the gas.
    ///
    /// # Errors
    /// As [`Self::report`].
    pub fn gas(&self) -> Result<BubbleState, FlowError> {
        Ok(self.coordinator.try_lock().ok_or(FlowError::PhaseConflict)?.gas)
    }

    fn after(&self, c: &mut Coordinator, plan: &mut Plan) -> Result<Option<Phase>, FlowError> {
        let serial_from = self.hierarchy.serial_from as u8;
        let coarsen = |l: u8| {
            if l < serial_from { Phase::Coarsen(l) } else { Phase::CoarsenRest }
        };
        let Some(last) = c.last else {
            return Ok(Some(Phase::Mask));
        };
        Ok(Some(match last {
            Phase::Mask => self.after_mask(c, plan)?,
            Phase::Mirror if !std::mem::replace(&mut c.is_held, true) => Phase::Hold,
            Phase::Mirror | Phase::Hold if std::mem::take(&mut c.is_changed) => Phase::Operator,
            Phase::Mirror | Phase::Hold => Phase::Diffuse,
            Phase::Operator => coarsen(1),
            Phase::Coarsen(l) => Phase::CoarsenDiagonal(l),
            Phase::CoarsenDiagonal(l) => coarsen(l + 1),
            Phase::CoarsenRest => Phase::Diffuse,
            Phase::Diffuse => {
                self.take_wires(c, plan)?;
                after_diffuse(c, plan)
            }
            Phase::AdvectForward => Phase::AdvectBack,
            Phase::AdvectBack => after_advect(c, plan),
            Phase::Centre => self.after_centre(c, plan)?,
            Phase::Dye => {
                let total = self.total()?;
                let cell_ml = self.model.grid.cell_volume_m3() * 1e6;
                c.blood.washed_ml += total.a * cell_ml;
                c.blood.entered_ml += total.b * cell_ml;
                c.blood.lost_ml += total.c * cell_ml;
                plan.dye = 1 - plan.dye;
                c.dye_left -= 1;
                if c.dye_left > 0 { Phase::Dye } else { Phase::Particles }
            }
            Phase::Particles => {
                self.settle_blood(plan, &mut c.blood)?;
                self.settle_bubbles(c, plan)?;
                c.report.tools = self.loads(plan)?;
                Phase::Rest
            }
            Phase::Rest => {
                c.report.step += 1;
                c.report.time_s += f64::from(plan.inputs.dt_s);
                return Ok(None);
            }
            pressure => self.after_pressure(pressure, c, plan)?,
        }))
    }

    /// The next phase within mass conservation.
    fn after_pressure(&self, last: Phase, c: &mut Coordinator, plan: &mut Plan) -> Result<Phase, FlowError> {
        let serial_from = self.hierarchy.serial_from as u8;
        let down = |l: u8| {
            if l + 1 < serial_from { Phase::Restrict(l) } else { Phase::Coarse }
        };
        Ok(match last {
            Phase::RightSide => {
                self.take_means(c, plan)?;
                Phase::Residual
            }
            Phase::Residual => {
                let total = self.total()?;
                c.bb = total.a;
                (plan.first_direction, plan.is_unsigned) = (true, false);
                self.after_residual(c, total.b, down(0))
            }
            Phase::Restrict(l) => down(l + 1),
            Phase::Coarse => Phase::Smooth(serial_from - 1),
            Phase::Smooth(0) => {
                let rz = self.total()?.a;
                plan.beta = if plan.first_direction { 0.0 } else { finite(rz / c.rz) };
                c.rz = rz;
                Phase::Direction
            }
            Phase::Smooth(l) => Phase::Smooth(l - 1),
            Phase::Direction => {
                plan.alpha = finite(c.rz / self.total()?.a);
                Phase::Update
            }
            Phase::Update => {
                c.report.iterations += 1;
                plan.first_direction = false;
                plan.is_unsigned |= plan.alpha.is_sign_positive();
                self.after_residual(c, self.total()?.b, down(0))
            }
            Phase::Project => {
                let total = self.total()?;
                (c.report.wild, c.report.speed_m_s) = (total.count, total.top);
                self.take_means(c, plan)?;
                Phase::Centre
            }
            _ => unreachable!("the phases outside mass conservation are handled by the caller"),
        })
    }

    /// Sums of all layers, added from the lowest to the highest.
    pub(crate) fn total(&self) -> Result<LayerSums, FlowError> {
        let mut total = LayerSums::default();
        for band in 0..self.bands {
            for layer in self.sums(band)?.iter() {
                total.a += layer.a;
                total.b += layer.b;
                total.c += layer.c;
                total.count = total.count.saturating_add(layer.count);
                total.top = total.top.max(layer.top);
                for (t, l) in total.by_component.iter_mut().zip(&layer.by_component) {
                    *t += l;
                }
                total.given.join(&layer.given);
            }
        }
        Ok(total)
    }

    fn take_means(&self, c: &Coordinator, plan: &mut Plan) -> Result<(), FlowError> {
        let total = self.total()?;
        for ((mean, sum), &cells) in plan.means.iter_mut().zip(total.by_component).zip(&c.sizes) {
            *mean = if cells > 0 { (sum / f64::from(cells)) as f32 } else { 0.0 };
        }
        Ok(())
    }

    fn after_residual(&self, c: &mut Coordinator, rr: f64, cycle: Phase) -> Phase {
        let tolerance = f64::from(self.model.residual_relative);
        c.report.residual_relative = if c.bb > 0.0 { (rr / c.bb).sqrt() } else { 0.0 };
        let good = rr <= tolerance * tolerance * c.bb || rr <= c.rest_residual2;
        c.report.unconverged = !good;
        if good || !rr.is_finite() || c.report.iterations >= self.model.max_iterations { Phase::Project } else { cycle }
    }

    fn after_centre(&self, c: &mut Coordinator, plan: &mut Plan) -> Result<Phase, FlowError> {
        let dt_s = plan.inputs.dt_s;
        let courant = dt_s * (self.total()?.top + c.largest_rate_per_s);
        c.report.dye_sweeps = (courant.ceil() as u32).clamp(1, MAX_SWEEPS);
        c.report.slowed |= courant > MAX_SWEEPS as f32;
        c.dye_left = c.report.dye_sweeps;
        plan.dye_dt_s = dt_s / courant.max(c.report.dye_sweeps as f32);
        plan.particle_sweeps = c.report.dye_sweeps.min(4) as usize;
        Ok(Phase::Dye)
    }
}

fn after_diffuse(c: &mut Coordinator, plan: &mut Plan) -> Phase {
    let roles = &mut plan.roles;
    std::mem::swap(&mut roles.now, &mut roles.next);
    plan.drags.clear();
    c.diffuse_left -= 1;
    if c.diffuse_left > 0 {
        return Phase::Mirror;
    }
    let others = [1, 2, 3].map(|n| (roles.now + n) % 4);
    *roles = Roles { now: roles.now, next: others[1], carrier: roles.now, forward: others[0] };
    c.spare_buffers = [others[2], others[1]];
    Phase::AdvectForward
}

fn after_advect(c: &mut Coordinator, plan: &mut Plan) -> Phase {
    plan.roles.now = plan.roles.next;
    plan.roles.next = c.spare_buffers[0];
    c.spare_buffers.swap(0, 1);
    c.advect_left -= 1;
    if c.advect_left > 0 { Phase::AdvectForward } else { Phase::RightSide }
}

/// A quotient of sums, or 0 where it has no meaning.
fn finite(x: f64) -> f32 {
    let x = x as f32;
    if x.is_finite() { x } else { 0.0 }
}
