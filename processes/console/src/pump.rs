//! The pump, as the operator's page shows it: what the fluid says of it, and the hardware of how it is set. Promise: a figure that nobody computes any more is not
//! shown as if it were measured.

use hyst_messages::{FluidStatus, HardwareSample, PUMP_ALARMS, PUMP_NOTICES};
use serde::Serialize;

/// What the fluid said longer ago is not known any more, ticks: with a holder and a spare gone another one is there by then, and the slowest flow has made eight steps.
const FRESH_TICKS: u64 = 2_000;
/// Valves below this are shut, of 0 to 1, as in the picture and in a report.
const SHUT: f32 = 0.05;
/// 1 mmHg, Pa.
const MMHG_PA: f64 = 133.322;

/// The pump.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Pump {
    /// Pressure in the cavity, mmHg, as it is read at the table: of a [`Shown`](hyst_messages::Shown) status the mean over a second.
    pub pressure_mmhg: f64,
    /// Pressure that is set, mmHg; `None` if the hardware says nothing.
    pub set_mmhg: Option<f64>,
    /// Flow into the cavity, ml/min.
    pub inflow_ml_min: f64,
    /// Flow out of it, ml/min.
    pub outflow_ml_min: f64,
    /// Whether the valves of inflow and outflow are shut; not where the hardware says nothing.
    pub shut: [bool; 2],
    /// Volume in minus volume out, ml.
    pub deficit_ml: f64,
    /// Volume of the cavity, ml.
    pub cavity_ml: f64,
    /// Blood that has come into it, ml.
    pub bled_ml: f64,
    /// Share of the light that comes through it before the lens, above 0 to 1; `None` if that is not said.
    pub transmittance: Option<f64>,
    /// Vessels that bleed into it, or take medium in.
    pub open_vessels: u32,
    /// Vessels that are coagulated.
    pub sealed_vessels: u32,
    /// Alarms.
    pub alarms: Vec<String>,
    /// What it says that asks for nothing.
    pub notices: Vec<String>,
    /// Step of the flow, and the one that the scene asks for, ms.
    pub step_ms: u32,
    /// See `step_ms`.
    pub scene_step_ms: u32,
    /// How many times the scene's grid is halved along each axis.
    pub halvings: u32,
}

impl Pump {
    /// From what a fluid says that is [sound](FluidStatus::is_sound), and the hardware, at a tick; `None` if it is too old.
    pub fn new(status: &FluidStatus, sample: Option<&HardwareSample>, tick: u64) -> Option<Pump> {
        if tick > status.state_tick.saturating_add(FRESH_TICKS) {
            return None;
        }
        let set_pa = sample.map(|sample| f64::from(sample.controls.obeyed_pressure_pa())).filter(|set_pa| set_pa.is_finite());
        let valves = sample.map(|sample| [sample.controls.inflow_valve, sample.controls.outflow_valve]);
        Some(Pump {
            pressure_mmhg: f64::from(status.pressure_pa) / MMHG_PA,
            set_mmhg: set_pa.map(|set_pa| set_pa / MMHG_PA),
            inflow_ml_min: f64::from(status.inflow_ml_min),
            outflow_ml_min: f64::from(status.outflow_ml_min),
            shut: valves.map_or([false; 2], |valves| valves.map(|valve| valve < SHUT)),
            deficit_ml: status.deficit_ml,
            cavity_ml: status.cavity_volume_ml,
            bled_ml: status.bled_ml,
            transmittance: status.told_transmittance().map(f64::from),
            open_vessels: status.open_vessels,
            sealed_vessels: status.sealed_vessels,
            alarms: names(status.alarms & !PUMP_NOTICES),
            notices: names(status.alarms & PUMP_NOTICES),
            step_ms: status.step_ticks,
            scene_step_ms: status.scene_step_ticks,
            halvings: status.halvings,
        })
    }
}

/// What some bits of [`FluidStatus::alarms`] say; a bit that has no name here is an alarm all the same.
fn names(bits: u32) -> Vec<String> {
    let said = |bit: &u32| PUMP_ALARMS.iter().find(|(known, _)| known == bit).map(|(_, name)| name.to_string());
    let set = (0..u32::BITS).map(|place| 1u32 << place).filter(|bit| bits & bit != 0);
    set.map(|bit| said(&bit).unwrap_or_else(|| format!("unknown ({bit:#x})"))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pump_is_shown_in_the_units_of_the_table_with_its_alarms() {
        let alarms = 1 | 4 | 16 | 64;
        let status = FluidStatus { pressure_pa: 9_332.54, deficit_ml: 12.5, bled_ml: 1.5, alarms, ..FluidStatus::default() };
        let mut sample = HardwareSample::default();
        (sample.controls.set_pressure_pa, sample.controls.inflow_valve) = (13_332.2, 0.3);
        let pump = Pump::new(&status, Some(&sample), 0).unwrap();
        assert_eq!(pump.transmittance, None, "nothing is said of the view");
        assert_eq!(Pump::new(&FluidStatus { transmittance: 0.25, ..status }, None, 0).unwrap().transmittance, Some(0.25));
        assert!((pump.pressure_mmhg - 70.0).abs() < 1e-3 && (pump.set_mmhg.unwrap() - 100.0).abs() < 1e-3, "{pump:?}");
        assert_eq!(
            (pump.deficit_ml, pump.bled_ml, pump.alarms.join(", ")),
            (12.5, 1.5, "pressure, abnormal loss, unknown (0x40)".to_string())
        );
        assert_eq!(pump.notices, ["container change"], "it asks for nothing, so it is no alarm");
        assert_eq!(pump.shut, [false, true]);
        let unset = Pump::new(&status, None, 0).unwrap();
        assert_eq!((unset.set_mmhg, unset.shut), (None, [false; 2]), "nobody says how it is set");
    }

    /// Of two fluids that had died the pressure stood on the page as if it were measured.
    #[test]
    fn what_no_fluid_has_said_for_two_seconds_is_not_known() {
        let at = |tick| Pump::new(&FluidStatus { state_tick: 500, ..FluidStatus::default() }, None, tick).is_some();
        assert_eq!([400, 2_500, 2_501].map(at), [true, true, false]);
    }
}
