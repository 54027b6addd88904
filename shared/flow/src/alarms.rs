//! When the pump gives alarm, and when an alarm ends.
//!
//! Limits: WOM's manual (which alarms there are), ACOG Committee Opinion 800 (the deficit); the figures are [`PumpModel`]'s. Promise: an alarm begins in the step
//! in which its limit is passed, and ends only farther on the right side of it, so that what swings about a limit by less than that is one alarm. How far is
//! assumed, and never more than half of the limit.

use crate::pump::{PA_PER_MMHG, PumpInput, PumpModel, PumpReport, PumpState};

/// An alarm of the pressure ends so far below its limit, Pa (3 mmHg): as far as a warning of it in a session that is judged.
const PRESSURE_CLEAR_PA: f64 = 3.0 * PA_PER_MMHG;
/// An alarm of a loss, or of a hole, ends at this share of its limit: a pressure that goes by a tenth to either side changes what is lost by as much.
const LOSS_CLEAR_SHARE: f64 = 0.8;

/// Alarms of the pump.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Alarms {
    /// Pressure above the set pressure by the model's margin.
    pub pressure: bool,
    /// Deficit at its limit: the model's, or the medium's.
    pub deficit: bool,
    /// Much medium disappears, wherever to: into vessels, past the sheath, through a hole.
    pub abnormal_loss: bool,
    /// More disappears than vessels and the sheath's leak can take at this pressure, were every vein open: only a hole explains it.
    pub perforation: bool,
    /// The container is nearly empty and is to be changed. The next one flows without a pause (two hang side by side).
    pub container: bool,
}

impl PumpReport {
    /// The alarms after a step before which these stood: those whose limit is passed, and those that have not ended.
    pub fn alarms_after(&self, stood: &Alarms) -> Alarms {
        let (is, lasts) = (&self.alarms, &self.lasting);
        Alarms {
            pressure: is.pressure || stood.pressure && lasts.pressure,
            deficit: is.deficit || stood.deficit && lasts.deficit,
            abnormal_loss: is.abnormal_loss || stood.abnormal_loss && lasts.abnormal_loss,
            perforation: is.perforation || stood.perforation && lasts.perforation,
            container: is.container || stood.container && lasts.container,
        }
    }
}

impl PumpModel {
    /// The alarms at the end of a step in which so much was lost, with the pressures at its begin and end; and those that have not ended if they stood.
    pub(crate) fn alarms(
        &self,
        state: &PumpState,
        input: &PumpInput,
        isotonic: bool,
        lost_ml_s: f64,
        [before_pa, pressure_pa]: [f64; 2],
    ) -> [Alarms; 2] {
        let set_pa = self.set_pa(input);
        let deficit_ml = self.deficit_alarm_ml.unwrap_or(if isotonic { 2_500.0 } else { 1_000.0 });
        // At the higher pressure of the two, so that a pressure that falls does not make a hole of what went into veins.
        let highest_pa = before_pa.max(pressure_pa);
        let veins_ml_s = self.intravasation_ml_s_pa * (highest_pa - self.venous_pa).max(0.0);
        let explained_ml_s = veins_ml_s + self.leak_ml_s_pa * highest_pa;
        let beyond = |clear_pa: f64, clear_ml: f64, share: f64| Alarms {
            pressure: pressure_pa > set_pa + self.pressure_alarm_pa - clear_pa,
            deficit: state.deficit_ml() >= deficit_ml - clear_ml,
            abnormal_loss: lost_ml_s > share * self.loss_alarm_ml_s,
            perforation: lost_ml_s > explained_ml_s + share * self.hole_alarm_ml_s,
            // What is left falls until the next one hangs: it passes its limit once.
            container: self.container_left_ml(state) <= self.container_alarm_ml,
        };
        // What the cavity holds comes back when it is emptied, and goes missing again when it is filled.
        let clear_ml = self.volume_150_mmhg_ml.min(0.5 * deficit_ml);
        let clear_pa = PRESSURE_CLEAR_PA.min(0.5 * self.pressure_alarm_pa);
        [beyond(0.0, 0.0, 1.0), beyond(clear_pa, clear_ml, LOSS_CLEAR_SHARE)]
    }
}
