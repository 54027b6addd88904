//! What a scripted hand waits for before it sets something: an alarm of the pump, or what the pump shows of deficit, blood and pressure.

use crate::case::Alarm;
use crate::validate::{Checked, one_of, range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Least volume, and largest, ml; those that a case may warn of.
const VOLUMES_ML: [f64; 2] = [1e-4, 5_000.0];
/// What a pump can set, Pa.
const PRESSURES_PA: [f64; 2] = [0.0, 20_000.0];

/// What a scripted hand waits for: one of the conditions below. Once it was there it counts as come, also if it goes again.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Signal {
    /// The pump gives this alarm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alarm: Option<Alarm>,
    /// More medium is missing than this, above 0 ml.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub deficit_above_ml: Option<f64>,
    /// More blood was lost than this, above 0 ml.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bled_above_ml: Option<f64>,
    /// The pressure in the cavity is above this, 0 to 20 kPa.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure_above_pa: Option<f64>,
    /// The pressure in the cavity is below this, 0 to 20 kPa; so it is at the beginning.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure_below_pa: Option<f64>,
}

/// Checks that it names one condition, in its range.
pub(crate) fn validate(signal: &Signal, key: &str) -> Checked {
    let figures = [
        ("deficit_above_ml", signal.deficit_above_ml, VOLUMES_ML, "ml"),
        ("bled_above_ml", signal.bled_above_ml, VOLUMES_ML, "ml"),
        ("pressure_above_pa", signal.pressure_above_pa, PRESSURES_PA, "Pa"),
        ("pressure_below_pa", signal.pressure_below_pa, PRESSURES_PA, "Pa"),
    ];
    let given = figures.iter().map(|(name, value, ..)| (*name, value.is_some()));
    one_of(key, &std::iter::once(("alarm", signal.alarm.is_some())).chain(given).collect::<Vec<_>>())?;
    for (name, value, [low, high], unit) in figures {
        value.map_or(Ok(()), |value| range(format!("{key}.{name}"), value, low, high, unit))?;
    }
    Ok(())
}
