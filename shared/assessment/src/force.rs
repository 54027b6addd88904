//! The force on the hand: how much, how long. Promise: percentiles are at most 0.005 N too high, from a table of fixed size.

use crate::conduct::Peak;
use crate::motion::{difference, finite};
use hyst_messages::AppliedRecord;

/// From here on the tool counts as touching, N: as much as a fault may add to the force's step, which nobody feels.
pub const TOUCH_N: f64 = 0.05;
/// The force that is to be kept below, N: half of the most that the station commands (3.3 N, which the Touch makes); perforation takes 20 N and more
/// (Goldstuck 2014), which no such device can show.
pub const LIMIT_N: f64 = 1.65;
/// Width of a bin of the distribution, N, and how many there are: to 20 N, six times the most that is commanded; the last takes what is above.
const BIN_N: f64 = 0.005;
const BINS: usize = 4_000;

/// The forces so far.
#[derive(Clone, Debug, PartialEq)]
pub struct Force {
    counts: Vec<u64>,
    /// Ticks whose force is a number.
    pub ticks: u64,
    /// Ticks in which the tool touches.
    pub touching_ticks: u64,
    /// Ticks above [`LIMIT_N`].
    pub above_ticks: u64,
    /// The largest force, N.
    pub peak: Option<Peak>,
}

impl Default for Force {
    fn default() -> Force {
        Force { counts: vec![0; BINS], ticks: 0, touching_ticks: 0, above_ticks: 0, peak: None }
    }
}

impl Force {
    /// Takes the force of one tick, in which the tool may touch.
    pub fn tick(&mut self, tick: u64, force_n: f64, is_touching: bool) {
        let bin = (force_n / BIN_N) as usize; // saturates
        self.counts[bin.min(BINS - 1)] += 1;
        self.ticks += 1;
        self.touching_ticks += u64::from(is_touching);
        self.above_ticks += u64::from(force_n > LIMIT_N);
        Peak::raise(&mut self.peak, force_n, tick);
    }

    /// The force that this share of the ticks does not exceed, N.
    pub fn percentile_n(&self, share: f64) -> Option<f64> {
        let peak_n = self.peak?.value;
        let rank = ((share * self.ticks as f64).ceil() as u64).max(1);
        let mut below = 0;
        for (bin, count) in self.counts.iter().take(BINS - 1).enumerate() {
            below += count;
            if below >= rank {
                return Some((BIN_N * (bin + 1) as f64).min(peak_n));
            }
        }
        Some(peak_n)
    }
}

/// Whether the tool touches in a tick: by a force that is there, and that the medium alone does not make. (An older recording has none of the medium.)
pub(crate) fn touches(record: &AppliedRecord) -> bool {
    let Some(force_n) = finite(record.command.force_n) else { return false };
    let medium_n = finite(record.on_scope_n).unwrap_or_default();
    length(force_n) >= TOUCH_N && length(difference(force_n, medium_n)) >= TOUCH_N
}

/// Length of a vector.
pub(crate) fn length(vector: [f64; 3]) -> f64 {
    vector.iter().map(|part| part * part).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hundred_ticks_by_hand() {
        let mut force = Force::default();
        // 94 ticks of 0, four of 1 N, one of 2 N, one of 50 N.
        for tick in 0..94 {
            force.tick(tick, 0.0, false);
        }
        [1.0, 1.0, 1.0, 1.0, 2.0, 50.0].iter().zip(94..).for_each(|(force_n, tick)| force.tick(tick, *force_n, true));
        assert_eq!((force.ticks, force.touching_ticks, force.above_ticks), (100, 6, 2));
        assert_eq!(force.peak, Some(Peak { value: 50.0, tick: 99 }));
        let of = |share| force.percentile_n(share).unwrap();
        let is_near = |value: f64, exact: f64| (0.0..1.01 * BIN_N).contains(&(value - exact));
        assert!(is_near(of(0.5), 0.0) && is_near(of(0.95), 1.0) && is_near(of(0.99), 2.0));
        assert_eq!(of(1.0), 50.0);
        assert_eq!(Force::default().percentile_n(0.95), None);
    }
}
