//! The fluid of a scene: its figures and its grid, the vessels that a cut opens, and what a scripted hand does with valves and pressure.

use crate::error::{SceneError, SceneErrorKind as Kind};
use crate::signal::{self, Signal};
use crate::validate::{Checked, range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Pascal per millimetre of mercury.
pub const PA_PER_MMHG: f64 = 133.322;
/// Most cells of the fluid's grid: four million cells are 0.3 GB of fields.
const MAX_CELLS: u64 = 4_000_000;
/// What a container holds where the scene says nothing, ml: a bag of 3 l.
const CONTAINER_ML: f64 = 3_000.0;
/// Least rate, Hz: the solver takes no step that is longer than its period.
const LEAST_RATE_HZ: f64 = 4.0;
/// Most changes of the pump in a scene.
const MAX_CHANGES: usize = 1_000;

/// What fills the cavity. Monopolar cutting does not work in saline, which conducts, and bipolar cutting in nothing else.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Medium {
    /// Isotonic saline.
    Saline,
    /// Glycine 1.5 %, hypotonic.
    Glycine,
    /// Sorbitol and mannitol, hypotonic.
    Sorbitol,
}

/// The fluid and its grid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Fluid {
    /// Cells along x, y and z: 4 to 512 each, at most 4 million in all. Default: 32 × 32 × 18.
    pub grid: [u32; 3],
    /// Steps per second, 4 to 1 000.
    pub rate_hz: f64,
    /// The medium.
    pub medium: Medium,
    /// Set pressure of the pump, 0 to 20 kPa (150 mmHg). Default: 9.3 kPa (70 mmHg).
    pub set_pressure_pa: f64,
    /// Pressure in the cavity at which the walls have the shape of their meshes, 0 to 20 kPa. Default: the scene's set pressure, whatever a case sets.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rest_pressure_pa: Option<f64>,
    /// What a container of medium holds, 100 to 20 000 ml; the pump says when it is to be changed. Default: 3 000 ml.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub container_ml: Option<f64>,
    /// The pump, its tubes and the sheath.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pump: Option<Pump>,
    /// How the cavity gives way.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cavity: Option<CavityCurve>,
    /// Dynamic viscosity.
    pub viscosity_pa_s: f64,
    /// Density.
    pub density_kg_m3: f64,
    /// Lowest corner of the grid. Default: around the hollow of the first organ, or around the space before it.
    pub box_min_m: Option<[f64; 3]>,
    /// Highest corner of the grid; both corners or none.
    pub box_max_m: Option<[f64; 3]>,
    /// Added on each side of a box that was found from the geometry.
    pub margin_m: f64,
    /// What a scripted hand sets at the pump and the valves, in the order of its time.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub change: Vec<PumpChange>,
}

impl Default for Fluid {
    fn default() -> Self {
        Fluid {
            grid: [32, 32, 18],
            rate_hz: 30.0,
            medium: Medium::Saline,
            set_pressure_pa: 9_333.0,
            rest_pressure_pa: None,
            container_ml: None,
            pump: None,
            cavity: None,
            viscosity_pa_s: 1.0e-3,
            density_kg_m3: 1_000.0,
            box_min_m: None,
            box_max_m: None,
            margin_m: 0.002,
            change: Vec::new(),
        }
    }
}

/// The pump, its tubes and the sheath.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Pump {
    /// Most that the roller delivers, 0 to 3 000 ml/min. Default: 800 ml/min.
    pub max_flow_ml_min: f64,
    /// Flow through the fully open inflow for each Pa, 0 to 0.01 ml/(s·Pa). Default: 5e-4.
    pub inflow_ml_s_pa: f64,
    /// Flow through the fully open outflow for each Pa, 0 to 0.01 ml/(s·Pa): a wider sheath has more. Default: 5e-4.
    pub outflow_ml_s_pa: f64,
    /// Suction at the outflow, 0 to 50 kPa below the atmosphere. Default: none.
    pub suction_pa: f64,
    /// Leak past the sheath through the cervix for each Pa, 0 to 0.01 ml/(s·Pa). Default: none.
    pub leak_ml_s_pa: f64,
}

impl Default for Pump {
    fn default() -> Self {
        Pump { max_flow_ml_min: 800.0, inflow_ml_s_pa: 5e-4, outflow_ml_s_pa: 5e-4, suction_pa: 0.0, leak_ml_s_pa: 0.0 }
    }
}

/// How the cavity gives way: little until its walls part, and from there on in proportion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CavityCurve {
    /// What it holds at 20 kPa (150 mmHg), 0.6 to 50 ml (measured: 0.6 to 11.4). Default: 8 ml.
    pub volume_ml: f64,
    /// Pressure at which the walls part, 0 to 15 kPa. Default: 5 333 Pa (40 mmHg).
    pub parting_pa: f64,
    /// Volume over which the pressure rises to that, 0.01 to 10 ml. Default: 0.5 ml.
    pub parting_ml: f64,
}

impl Default for CavityCurve {
    fn default() -> Self {
        CavityCurve { volume_ml: 8.0, parting_pa: 40.0 * PA_PER_MMHG, parting_ml: 0.5 }
    }
}

/// What a scripted hand sets at one time, or so long after what it waits for; what is not named stays as it is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PumpChange {
    /// Time since the hand began, or since what it waits for came, 0 to 86 400 s.
    pub at_s: f64,
    /// Set pressure of the pump, 0 to 20 kPa.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub set_pressure_pa: Option<f64>,
    /// Inflow valve, 0 shut to 1 open.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub inflow_valve: Option<f64>,
    /// Outflow valve, 0 shut to 1 open.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outflow_valve: Option<f64>,
    /// What it waits for. Default: nothing, it is done at its time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub after: Option<Signal>,
}

/// The vessels of the tissue: one in each cube of it, of a calibre that is drawn for each, and open as far as a wound reaches into the cube.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Vessels {
    /// Edge of the cubes, 0.5 to 50 mm. Default: 4 mm.
    pub spacing_m: f64,
    /// Pressure in them, 0 to 40 kPa: under it in the cavity they bleed. Default: 12 kPa, a mean arterial pressure of 90 mmHg.
    pub pressure_pa: f64,
    /// Flow out of the widest for each Pa that the pressure in the cavity is lower, 0 (nothing bleeds) to 1e-3 ml/(s·Pa). Default: 1e-5.
    pub conductance_ml_s_pa: f64,
    /// What the calibres are drawn from.
    pub seed: u64,
}

impl Default for Vessels {
    fn default() -> Self {
        Vessels { spacing_m: 0.004, pressure_pa: 12_000.0, conductance_ml_s_pa: 1e-5, seed: 1 }
    }
}

/// The fluid's grid and figures.
#[derive(Debug, Clone, PartialEq)]
pub struct LoadedFluid {
    /// Cells along x, y and z.
    pub grid: [u32; 3],
    /// Lowest corner of the grid.
    pub box_min_m: [f32; 3],
    /// Highest corner of the grid.
    pub box_max_m: [f32; 3],
    /// Steps per second.
    pub rate_hz: f32,
    /// The medium.
    pub medium: Medium,
    /// Set pressure of the pump.
    pub set_pressure_pa: f32,
    /// Pressure at which the walls have the shape of their meshes.
    pub rest_pressure_pa: f32,
    /// What a container of medium holds, ml.
    pub container_ml: f32,
    /// Deficit at which the pump gives alarm, ml: what a case allows; `None` is the pump's own for the medium.
    pub deficit_alarm_ml: Option<f64>,
    /// The pump, its tubes and the sheath.
    pub pump: Pump,
    /// How the cavity gives way.
    pub cavity: CavityCurve,
    /// Dynamic viscosity.
    pub viscosity_pa_s: f32,
    /// Density.
    pub density_kg_m3: f32,
    /// The vessels.
    pub vessels: Vessels,
    /// What a scripted hand sets, in the order of its time.
    pub changes: Vec<PumpChange>,
}

impl LoadedFluid {
    /// The figures of a fluid in a box.
    pub(crate) fn new(fluid: &Fluid, vessels: &Vessels, [box_min_m, box_max_m]: [[f32; 3]; 2]) -> LoadedFluid {
        LoadedFluid {
            grid: fluid.grid,
            box_min_m,
            box_max_m,
            rate_hz: fluid.rate_hz as f32,
            medium: fluid.medium,
            set_pressure_pa: fluid.set_pressure_pa as f32,
            rest_pressure_pa: fluid.rest_pressure_pa.unwrap_or(fluid.set_pressure_pa) as f32,
            container_ml: fluid.container_ml.unwrap_or(CONTAINER_ML) as f32,
            deficit_alarm_ml: None,
            pump: fluid.pump.unwrap_or_default(),
            cavity: fluid.cavity.unwrap_or_default(),
            viscosity_pa_s: fluid.viscosity_pa_s as f32,
            density_kg_m3: fluid.density_kg_m3 as f32,
            vessels: vessels.clone(),
            changes: fluid.change.clone(),
        }
    }

    /// Ticks of 1 ms from one step to the next.
    pub fn period_ticks(&self) -> u64 {
        (1_000.0 / self.rate_hz).round().max(1.0) as u64
    }
}

pub(crate) fn validate(fluid: &Fluid) -> Checked {
    for cells in fluid.grid {
        range("fluid.grid", f64::from(cells), 4.0, 512.0, "cells")?;
    }
    let cells: u64 = fluid.grid.iter().map(|&n| u64::from(n)).product();
    range("fluid.grid", cells as f64, 64.0, MAX_CELLS as f64, "cells in all")?;
    range("fluid.rate_hz", fluid.rate_hz, LEAST_RATE_HZ, 1_000.0, "Hz")?;
    range("fluid.set_pressure_pa", fluid.set_pressure_pa, 0.0, 20_000.0, "Pa")?;
    range("fluid.rest_pressure_pa", fluid.rest_pressure_pa.unwrap_or(0.0), 0.0, 20_000.0, "Pa")?;
    range("fluid.container_ml", fluid.container_ml.unwrap_or(CONTAINER_ML), 100.0, 20_000.0, "ml")?;
    validate_pump(&fluid.pump.unwrap_or_default(), &fluid.cavity.unwrap_or_default())?;
    range("fluid.viscosity_pa_s", fluid.viscosity_pa_s, 1e-5, 1.0, "Pa·s")?;
    range("fluid.density_kg_m3", fluid.density_kg_m3, 100.0, 5_000.0, "kg/m³")?;
    range("fluid.margin_m", fluid.margin_m, 0.0, 0.1, "m")?;
    validate_changes("fluid.change", &fluid.change)?;
    match (&fluid.box_min_m, &fluid.box_max_m) {
        (Some(min_m), Some(max_m)) => crate::validate::corners("fluid.box_min_m", min_m, max_m),
        (None, None) => Ok(()),
        _ => {
            let what = "only one of box_min_m and box_max_m is given";
            Err(SceneError::new(Kind::Incomplete, "fluid", what, "give both, or none to have the box found"))
        }
    }
}

fn validate_pump(pump: &Pump, cavity: &CavityCurve) -> Checked {
    range("fluid.pump.max_flow_ml_min", pump.max_flow_ml_min, 0.0, 3_000.0, "ml/min")?;
    range("fluid.pump.inflow_ml_s_pa", pump.inflow_ml_s_pa, 0.0, 0.01, "ml/(s·Pa)")?;
    range("fluid.pump.outflow_ml_s_pa", pump.outflow_ml_s_pa, 0.0, 0.01, "ml/(s·Pa)")?;
    range("fluid.pump.suction_pa", pump.suction_pa, 0.0, 50_000.0, "Pa")?;
    range("fluid.pump.leak_ml_s_pa", pump.leak_ml_s_pa, 0.0, 0.01, "ml/(s·Pa)")?;
    range("fluid.cavity.volume_ml", cavity.volume_ml, 0.6, 50.0, "ml")?;
    range("fluid.cavity.parting_pa", cavity.parting_pa, 0.0, 15_000.0, "Pa")?;
    range("fluid.cavity.parting_ml", cavity.parting_ml, 0.01, 10.0, "ml")
}

pub(crate) fn validate_changes(key: &str, changes: &[PumpChange]) -> Checked {
    range(key, changes.len() as f64, 0.0, MAX_CHANGES as f64, "entries")?;
    let mut before_s = 0.0;
    for (index, change) in changes.iter().enumerate() {
        let key = |name: &str| format!("{key}[{index}].{name}");
        // What waits for something has its own time: it stands in no order with the others.
        let least_s = if change.after.is_some() { 0.0 } else { before_s };
        range(key("at_s"), change.at_s, least_s, 86_400.0, "s")?;
        range(key("set_pressure_pa"), change.set_pressure_pa.unwrap_or(0.0), 0.0, 20_000.0, "Pa")?;
        range(key("inflow_valve"), change.inflow_valve.unwrap_or(0.0), 0.0, 1.0, "")?;
        range(key("outflow_valve"), change.outflow_valve.unwrap_or(0.0), 0.0, 1.0, "")?;
        match &change.after {
            Some(after) => signal::validate(after, &key("after"))?,
            None => before_s = change.at_s,
        }
    }
    Ok(())
}

pub(crate) fn validate_vessels(vessels: &Vessels) -> Checked {
    range("vessels.spacing_m", vessels.spacing_m, 5e-4, 0.05, "m")?;
    range("vessels.pressure_pa", vessels.pressure_pa, 0.0, 40_000.0, "Pa")?;
    range("vessels.conductance_ml_s_pa", vessels.conductance_ml_s_pa, 0.0, 1e-3, "ml/(s·Pa)")
}
