//! The model: what does not change while a case runs. Medium, walls, pump, vessels, accuracy. The state is another type.

use crate::bubbles::BubbleModel;
use crate::error::FlowError;
use crate::grid::Grid;
use crate::pump::PumpModel;

/// What bounds the grid on one side. Solid cells inside the grid are always no-slip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wall {
    /// The medium sticks to the wall, which moves with this tangential velocity, m/s (the normal component is ignored).
    NoSlip([f32; 3]),
    /// The medium slides freely along the wall.
    Slip,
}

/// The distension medium.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Medium {
    /// Density, kg/m³.
    pub density_kg_m3: f32,
    /// Kinematic viscosity, m²/s.
    pub viscosity_m2_s: f32,
    /// Isotonic (saline) or hypotonic (glycine, sorbitol): decides the deficit limit, ACOG Committee Opinion 800.
    pub isotonic: bool,
}

impl Medium {
    /// Physiological saline at 37 °C: 1 000 kg/m³ and 0.7 mm²/s (water: 0.695 mm²/s).
    pub const SALINE: Self = Self { density_kg_m3: 1_000.0, viscosity_m2_s: 0.7e-6, isotonic: true };
    /// Glycine 1.5 %: near water, hypotonic.
    pub const GLYCINE: Self = Self { density_kg_m3: 1_004.0, viscosity_m2_s: 0.72e-6, isotonic: false };
}

/// How blood is emitted and seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BloodModel {
    /// Massless particles in the ring. When it is full the oldest dissolves into the dye field.
    pub capacity: usize,
    /// Volume that one particle stands for, ml.
    pub particle_ml: f32,
    /// Flow out of a fully open vessel point per pressure difference, ml/(s·Pa). 1e-5: 0.1 ml/s at 10 kPa.
    pub conductance_ml_s_pa: f64,
    /// Pressure in the bleeding vessels, Pa. 12 kPa: a mean arterial pressure of 90 mmHg.
    pub vessel_pa: f64,
    /// Seed of the scatter of emitted particles.
    pub seed: u64,
}

impl Default for BloodModel {
    fn default() -> Self {
        Self { capacity: 2_048, particle_ml: 1e-3, conductance_ml_s_pa: 1e-5, vessel_pa: 12_000.0, seed: 1 }
    }
}

/// Everything that does not change from step to step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlowModel {
    /// The grid.
    pub grid: Grid,
    /// The medium.
    pub medium: Medium,
    /// Low x, high x, low y, high y, low z, high z.
    pub walls: [Wall; 6],
    /// The pressure solve ends at ‖residual‖₂ ≤ this × ‖right side‖₂. 1e-4 is the station's figure.
    pub residual_relative: f32,
    /// Conjugate-gradient iterations at most; a solve that needs more says so in its report. 60: eight times the usual.
    pub max_iterations: u32,
    /// Pump and cavity.
    pub pump: PumpModel,
    /// Bleeding.
    pub blood: BloodModel,
    /// Gas.
    pub bubbles: BubbleModel,
}

impl FlowModel {
    /// Saline, no-slip walls, default pump, residual 1e-4.
    pub fn new(grid: Grid) -> Self {
        Self {
            grid,
            medium: Medium::SALINE,
            walls: [Wall::NoSlip([0.0; 3]); 6],
            residual_relative: 1e-4,
            max_iterations: 60,
            pump: PumpModel::default(),
            blood: BloodModel::default(),
            bubbles: BubbleModel::default(),
        }
    }

    /// Checks every parameter.
    ///
    /// # Errors
    /// [`FlowError::Parameter`] names the first one out of range.
    pub fn check(&self) -> Result<(), FlowError> {
        range("medium.density_kg_m3", self.medium.density_kg_m3.into(), 1.0, 1e5, "1 to 1e5")?;
        range("medium.viscosity_m2_s", self.medium.viscosity_m2_s.into(), 0.0, 1.0, "0 to 1")?;
        range("residual_relative", self.residual_relative.into(), 1e-6, 0.5, "1e-6 to 0.5")?;
        range("max_iterations", self.max_iterations.into(), 1.0, 1e3, "1 to 1000")?;
        range("blood.capacity", self.blood.capacity as f64, 1.0, 65_536.0, "1 to 65536")?;
        range("blood.particle_ml", self.blood.particle_ml.into(), 1e-6, 1.0, "1e-6 to 1")?;
        range("blood.conductance_ml_s_pa", self.blood.conductance_ml_s_pa, 0.0, 1.0, "0 to 1")?;
        range("blood.vessel_pa", self.blood.vessel_pa, 0.0, 1e5, "0 to 1e5")?;
        for wall in &self.walls {
            if let Wall::NoSlip(v) = wall {
                for &c in v {
                    range("walls", c.into(), -20.0, 20.0, "-20 to 20 m/s")?;
                }
            }
        }
        self.bubbles.check()?;
        self.pump.check()
    }
}

pub(crate) fn range(name: &'static str, value: f64, low: f64, high: f64, range: &'static str) -> Result<(), FlowError> {
    if (low..=high).contains(&value) { Ok(()) } else { Err(FlowError::Parameter { name, value, range }) }
}
