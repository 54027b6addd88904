//! Which samples of a device count. One that cannot be, of a device that states this of itself, or that is farther from the one before than a hand can have
//! moved the tip, is refused, and the one before stays. Where the tip goes on from there for long enough, it is believed to be there.
//!
//! Promise: a function of the samples and of their own ticks alone. Whoever looks at each of them, as `device` does, and whoever looks now and then, as the
//! fluid does, believe a tip that has jumped at the same tick of the hardware, but for the time between two looks.

use crate::record::HardwareSample;
use crate::statement::DeviceStatement;

/// For so long a tip goes on from where it has jumped to until it is believed, s. By then `device` has let the force go, which takes it 32 ms: 10 ticks without
/// a sample that counts, 2 in which it is held, 20 of a ramp.
const MOVED_S: f32 = 0.04;

/// What is known of the samples of one life of the hardware.
#[derive(Clone, Copy, Debug, Default)]
pub struct Admission {
    /// The newest that counted.
    counted: Option<HardwareSample>,
    /// Stamp of the newest, whether it counted or not, ns.
    heard_ns: u64,
    /// The newest that was refused for where it was, and the tick since which such ones go on from each other.
    strayed: Option<(HardwareSample, u64)>,
}

impl Admission {
    /// Whether a sample counts. Asked once for each that is looked at, in their order.
    pub fn admit(&mut self, stated: &DeviceStatement, sample: &HardwareSample) -> bool {
        // A hand has the time since the device spoke last: one that jumps and speaks on is not believed because time passes.
        let heard_ns = std::mem::replace(&mut self.heard_ns, sample.time_ns);
        if stated.admits(sample).is_err() {
            self.strayed = None;
            return false;
        }
        let before = self.counted.map(|counted| HardwareSample { time_ns: heard_ns, ..counted });
        if before.is_some_and(|before| !sample.goes_on_from(&before)) {
            let strayed = self.strayed.filter(|(strayed, _)| sample.goes_on_from(strayed));
            let since = strayed.map_or(sample.hardware_tick, |(_, since)| since);
            self.strayed = Some((*sample, since));
            if sample.hardware_tick.saturating_sub(since) < moved_ticks(stated) {
                return false;
            }
        }
        (self.counted, self.strayed) = (Some(*sample), None);
        true
    }
}

/// [`MOVED_S`] in ticks of the hardware, each of which is a sample: a device gives 500 to 10 000 of them in a second.
fn moved_ticks(stated: &DeviceStatement) -> u64 {
    (MOVED_S * stated.rate_hz).round() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pose;
    use crate::statement::stated::stated;

    /// A device of a rate, Hz.
    fn of_rate(rate_hz: f32) -> DeviceStatement {
        DeviceStatement { rate_hz, ..stated() }
    }

    /// At rest, so deep, in a tick of a device of 1 000 samples a second.
    fn at(tick: u64, insertion_m: f32) -> HardwareSample {
        at_rate(1_000.0, tick, insertion_m)
    }

    fn at_rate(rate_hz: f32, tick: u64, insertion_m: f32) -> HardwareSample {
        let pose =
            Pose { position_m: [0.0, 0.0, insertion_m], orientation: [0.0, 0.0, 0.0, 1.0], insertion_m, ..Pose::default() };
        let time_ns = (tick as f64 * 1e9 / f64::from(rate_hz)) as u64;
        HardwareSample { hardware_tick: tick, time_ns, pose, ..HardwareSample::default() }
    }

    #[test]
    fn what_cannot_be_is_refused_and_what_comes_after_it_counts() {
        let mut admission = Admission::default();
        assert!(admission.admit(&stated(), &at(1, 0.05)), "the first");
        assert!(!admission.admit(&stated(), &at(2, f32::NAN)));
        assert!(!admission.admit(&stated(), &at(3, 0.09)), "4 cm in 2 ms");
        assert!(admission.admit(&stated(), &at(4, 0.051)));
        assert!(!admission.admit(&stated(), &at(4, 0.051)), "no newer than the one that counted");
    }

    /// The force is gone after 32 ms; a fluid that counted samples of a device at 10 kHz believed it after 4.
    #[test]
    fn a_tip_that_has_jumped_is_believed_after_40_ms_there_at_any_rate_and_however_often_it_is_looked_at() {
        for (rate_hz, each) in [(500.0, 1), (1_000.0, 1), (1_000.0, 10), (999.98, 20), (10_000.0, 1), (10_000.0, 200)] {
            let (stated, mut admission) = (of_rate(rate_hz), Admission::default());
            assert!(admission.admit(&stated, &at_rate(rate_hz, 1, 0.02)));
            let looks = (0..).map(|look: u64| 2 + look * each);
            let mut refused = looks.take_while(|tick| !admission.admit(&stated, &at_rate(rate_hz, *tick, 0.09)));
            let (first, last) = (refused.next().expect("it has jumped"), refused.last());
            let believed_ms = (last.unwrap_or(first) + each - first) as f32 * 1e3 / rate_hz;
            let look_ms = each as f32 * 1e3 / rate_hz;
            assert!((39.9..40.1 + look_ms).contains(&believed_ms), "{believed_ms} ms at {rate_hz} Hz, each {each}");
        }
    }

    #[test]
    fn a_way_elsewhere_that_breaks_off_begins_anew_and_a_tip_that_comes_back_counts_at_once() {
        let mut admission = Admission::default();
        let mut admit = |tick: u64, insertion_m: f32| admission.admit(&stated(), &at(tick, insertion_m));
        assert!(admit(1, 0.02));
        assert!((2..=30).all(|tick| !admit(tick, 0.09)));
        assert!(!admit(31, 0.06), "a third place");
        assert!((32..=70).all(|tick| !admit(tick, 0.06)));
        assert!(!admit(71, f32::NAN), "it would have been believed");
        assert!((72..=111).all(|tick| !admit(tick, 0.06)));
        assert!(admit(112, 0.06) && admit(113, 0.061) && !admit(114, 0.02));
        assert!(admit(115, 0.061), "back where it was");
    }
}
