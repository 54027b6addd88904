//! The roller's beat: the flow of a roller pump dips each time that a roller leaves the tube, for the tube that it had flattened fills itself again, and the
//! pressure in the cavity goes up and down with it (pump and tube as lumped elements, as McIntyre et al. 2020 have them, arXiv 2011.13167).
//!
//! Where the roller head stands follows from what it has delivered, [`PumpState::in_ml`]: with each stroke a roller passes. [`PumpModel::step`] moves the mean;
//! the beat is what is beyond it, to first order. Of the dip it is the first harmonic, which the tube's compliance and the resistance of the way in damp as
//! a low pass (its lag is left out); the cavity takes it with the stiffness of its mean volume. It leaves by the outflow, and the pump, which
//! regulates by an average of the pressure, takes out what is slower than that, by delivering less. Promise: means are what they are without it; it turns
//! no flow, for a roller does not run backwards: what would go out where nothing comes in stays in the cavity; what it brings in and takes
//! out is there, to rounding, and what the roller displaces in a step is exact, so that no step is too long for it; a state that
//! knows of no beat goes on with none in the cavity, from where its roller head stands.

use crate::pump::{PumpInput, PumpModel, PumpState};
use std::f64::consts::{PI, TAU};

/// Over so long the pump averages the pressure that it regulates, s (assumed: some beats at usual flows).
const AVERAGE_S: f64 = 1.0;
/// Less is no beat, ml: a cavity as stiff as one that is nearly empty shows 1e-5 Pa of it.
const LEAST_ML: f64 = 1e-9;

/// What the beat adds.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Beat {
    /// To the pressure in the cavity at the end of a step, Pa; the sum of mean and beat is 0 where it would be below.
    pub pressure_pa: f64,
    /// To the mean flow in during the step, ml/s.
    pub in_ml_s: f64,
    /// To the mean flow out during the step, ml/s.
    pub out_ml_s: f64,
}

impl PumpModel {
    /// Where the roller head stands when it has delivered so much, in parts of the way from one roller to the next, 0 to 1: at 0 a roller is half way off the tube.
    pub fn roller_phase(&self, in_ml: f64) -> f64 {
        (in_ml / self.stroke_ml).fract()
    }

    /// Moves the beat over a step of `dt_s`, of which [`Self::step`] has made the mean `from` a state to the next. `beat_ml` is what the cavity holds
    /// beyond [`PumpState::cavity_ml`]: all of the beat's state beside the counters.
    pub fn beat(&self, beat_ml: &mut f32, input: &PumpInput, from: &PumpState, state: &PumpState, dt_s: f64) -> Beat {
        let stiffness_pa_ml = self.stiffness_pa_ml(state.cavity_ml, input.displaced_ml);
        if dt_s <= 0.0 {
            return Beat { pressure_pa: stiffness_pa_ml * f64::from(*beat_ml), ..Beat::default() };
        }
        let [mean_in_ml, mean_out_ml] = [state.in_ml - from.in_ml, state.out_ml - from.out_ml];
        let rolled_ml = self.roller_ml(state.in_ml) - self.roller_ml(from.in_ml);
        let pressed_ml = rolled_ml * self.passes_the_tube(input, mean_in_ml / dt_s);
        let drained_per_s = stiffness_pa_ml * f64::from(input.outflow_valve) * self.outflow_ml_s_pa;
        let is_regulating = input.inflow_valve > 0.0 && input.flow_limit_ml_min > 0.0;
        let rate_per_s = drained_per_s + if is_regulating { 1.0 / AVERAGE_S } else { 0.0 };
        // What is pressed in comes evenly over the step: the exact solution of dy/dt = pressed/dt − rate·y.
        let times = rate_per_s * dt_s;
        let decayed = -(-times).exp_m1();
        let share_kept = if times > 0.0 { decayed / times } else { 1.0 };
        let was_ml = f64::from(*beat_ml);
        *beat_ml = self.kept_ml((1.0 - decayed) * was_ml + share_kept * pressed_ml);
        let left_ml = was_ml + pressed_ml - f64::from(*beat_ml);
        let mut out_ml = if rate_per_s > 0.0 { left_ml * drained_per_s / rate_per_s } else { 0.0 };
        let in_ml = f64::from(*beat_ml) - was_ml + out_ml;
        if in_ml < -mean_in_ml || out_ml < -mean_out_ml {
            out_ml = out_ml.max(-mean_out_ml);
            *beat_ml = self.kept_ml(was_ml + in_ml.max(-mean_in_ml) - out_ml);
        }
        let is_ml = f64::from(*beat_ml);
        Beat { pressure_pa: stiffness_pa_ml * is_ml, in_ml_s: (is_ml - was_ml + out_ml) / dt_s, out_ml_s: out_ml / dt_s }
    }

    /// What is kept of so much: no more than a roller displaces, and nothing where it is next to nothing.
    fn kept_ml(&self, beat_ml: f64) -> f32 {
        let beat_ml = beat_ml.clamp(-self.lift_ml, self.lift_ml);
        if beat_ml.abs() < LEAST_ML { 0.0 } else { beat_ml as f32 }
    }

    /// What the roller head has delivered beyond its mean when that is so much, ml: the integral of the first harmonic of a dip that is much shorter than a pass.
    fn roller_ml(&self, in_ml: f64) -> f64 {
        -self.lift_ml / PI * (TAU * self.roller_phase(in_ml)).sin()
    }

    /// Which share of the beat comes through tube and inflow valve at a mean flow.
    fn passes_the_tube(&self, input: &PumpInput, flow_ml_s: f64) -> f64 {
        let way_ml_s_pa = f64::from(input.inflow_valve) * self.inflow_ml_s_pa;
        let tube_ml_s_pa = TAU * flow_ml_s / self.stroke_ml * self.tube_ml_pa;
        let both_ml_s_pa = (way_ml_s_pa * way_ml_s_pa + tube_ml_s_pa * tube_ml_s_pa).sqrt();
        // Both are 0 where nothing can come through, or so little that its square is.
        if both_ml_s_pa > 0.0 { way_ml_s_pa / both_ml_s_pa } else { 0.0 }
    }
}
