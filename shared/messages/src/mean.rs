//! The mean over a second of the pressure that the fluid says, as a pump's display shows it: the roller's beat in it is neither anybody's doing nor his to
//! mend. The flows that it says are without a beat. Promise: a first-order average by the station's ticks, which a status that is seen twice leaves as it is;
//! after a second of which nothing is known it begins anew.

use crate::fluid::FluidStatus;

/// Over so long is averaged, ticks: as long as the pump averages the pressure that it regulates. Of what was longer ago nothing is known.
pub const MEAN_TICKS: u64 = 1_000;

/// The mean after a value of this tick, from the mean before it and its tick.
pub fn mean_after(before: Option<(u64, f64)>, tick: u64, value: f64) -> f64 {
    let Some((at, was)) = before.filter(|(at, was)| was.is_finite() && tick.abs_diff(*at) <= MEAN_TICKS) else { return value };
    let passed = tick.saturating_sub(at);
    was + (value - was) * passed as f64 / (passed as f64 + MEAN_TICKS as f64)
}

/// What is shown of a fluid's statuses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shown {
    /// Tick and mean of the pressure.
    before: Option<(u64, f64)>,
}

impl Shown {
    /// The newest status with the pressure as the mean over a second. What is no number stays none, and is forgotten with the next.
    pub fn show(&mut self, status: &FluidStatus) -> FluidStatus {
        let mean_pa = mean_after(self.before, status.state_tick, f64::from(status.pressure_pa));
        self.before = Some((status.state_tick, mean_pa));
        FluidStatus { pressure_pa: mean_pa as f32, ..*status }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(state_tick: u64, pressure_pa: f32) -> FluidStatus {
        FluidStatus { state_tick, pressure_pa, inflow_ml_min: 0.1 * pressure_pa, deficit_ml: 5.0, ..FluidStatus::default() }
    }

    #[test]
    fn the_pressure_is_shown_as_a_mean_and_nothing_else_is_changed() {
        let mut shown = Shown::default();
        assert_eq!(shown.show(&status(500, 8_000.0)), status(500, 8_000.0), "the first as it is");
        // Half a second later a third of what is new: 500/(500 + 1000).
        let second = FluidStatus { pressure_pa: 8_500.0, ..status(1_000, 9_500.0) };
        assert_eq!(shown.show(&status(1_000, 9_500.0)), second);
        assert_eq!(shown.show(&status(1_000, 9_500.0)), second, "asked once more");
        assert_eq!(shown.show(&status(2_001, 6_000.0)), status(2_001, 6_000.0), "nobody knows what was between");
        assert!(shown.show(&status(2_100, f32::NAN)).pressure_pa.is_nan());
        assert_eq!(shown.show(&status(2_200, 7_000.0)), status(2_200, 7_000.0));
        assert_eq!(shown.show(&status(100, 7_500.0)), status(100, 7_500.0), "a session that begins anew");
    }

    /// A beat of 1.3 mmHg every 2.2 s: by hand 1/√(1 + (2π/2.2)²) = 0.331 of it, 0.43 mmHg, is left where it is asked often.
    #[test]
    fn a_third_of_the_rollers_beat_is_left() {
        let mut shown = Shown::default();
        let beats = (0..20_000u64).step_by(20).map(|tick| {
            let mmhg = 70.0 + 1.3 * (std::f64::consts::TAU * tick as f64 / 2_200.0).sin();
            (tick, f64::from(shown.show(&status(tick, mmhg as f32)).pressure_pa))
        });
        let settled: Vec<f64> = beats.filter(|(tick, _)| *tick > 10_000).map(|(_, mmhg)| mmhg).collect();
        let (low, high) = settled.iter().fold((f64::MAX, f64::MIN), |(low, high), mmhg| (low.min(*mmhg), high.max(*mmhg)));
        assert!((0.5 * (high - low) - 0.43).abs() < 0.02 && (0.5 * (high + low) - 70.0).abs() < 0.02, "{low} to {high} mmHg");
    }
}
