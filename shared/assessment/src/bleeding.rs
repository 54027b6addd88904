//! How fast it bleeds: from the blood that has come into the cavity in the statuses of the last second. What it keeps is plain data, so a judge hands it on.

use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Time over which the rate is taken, and between two points of it, ticks.
const RATE_TICKS: u64 = 1_000;
const RATE_POINT_TICKS: u64 = 50;

/// The blood of the last second: ticks and ml, the oldest first.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Bleeding(VecDeque<(u64, f64)>);

impl Bleeding {
    /// Takes how much blood there was at a tick, ml; one that is nearer to the one before than a point of the rate is left out.
    pub(crate) fn take(&mut self, tick: u64, bled_ml: f64) {
        if self.0.back().is_some_and(|(newest, _)| tick < newest.saturating_add(RATE_POINT_TICKS)) {
            return;
        }
        self.0.push_back((tick, bled_ml));
        // One of the future was handed on by whoever knows no better.
        while self.0.get(1).is_some_and(|(second, _)| *second > tick || tick - second >= RATE_TICKS) {
            self.0.pop_front();
        }
    }

    /// How fast it bleeds, ml/min; `None` before half a second of it is known.
    pub(crate) fn rate_ml_min(&self) -> Option<f64> {
        let ((first, least_ml), (last, most_ml)) = (self.0.front()?, self.0.back()?);
        let ticks = last.saturating_sub(*first);
        (ticks >= RATE_TICKS / 2).then(|| (most_ml - least_ml) / ticks as f64 * 60_000.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_that_of_the_last_second_and_unknown_before_half_of_one() {
        let mut bleeding = Bleeding::default();
        assert_eq!(bleeding.rate_ml_min(), None);
        // 0.01 ml a tenth of a second for 2 s, then nothing.
        let mut rates = Vec::new();
        for tick in (0..4_000_u64).step_by(100) {
            bleeding.take(tick, 1e-4 * tick.min(2_000) as f64);
            rates.push(bleeding.rate_ml_min().map(|rate_ml_min| rate_ml_min.round()));
        }
        assert_eq!((rates[4], rates[5], rates[20], rates[25], rates[30]), (None, Some(6.0), Some(6.0), Some(3.0), Some(0.0)));
        bleeding.take(3_910, 9.0);
        assert_eq!(bleeding.rate_ml_min(), Some(0.0), "it is no point yet");
        assert!(bleeding.0.len() <= 12, "{}", bleeding.0.len());
        let kept = serde_json::to_string(&bleeding).unwrap();
        assert_eq!(serde_json::from_str::<Bleeding>(&kept).unwrap(), bleeding);
    }
}
