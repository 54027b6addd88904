//! What a recorder on probation has written: the ticks that can be read of its file, held against those that the device's ring has. Its page is its own word.

use hyst_messages::AppliedRecord;
use hyst_recording::sequence::RING_TICKS;
use std::collections::BTreeMap;

/// The ticks that were read, and how many of the device's are not among them as they should be.
#[derive(Debug, Default)]
pub(super) struct Written {
    last_tick: Option<u64>,
    /// How often something was read.
    parts: u32,
    /// Ticks of the ring that are not in the file, which has one before them and one behind.
    missing: u64,
    /// Ticks that are in both, and not alike.
    unlike: u64,
}

impl Written {
    /// Counting begins behind this tick; where none is known, with the first one that is read.
    pub(super) fn behind(last_tick: Option<u64>) -> Written {
        Written { last_tick, ..Written::default() }
    }

    /// Takes what was read of the file; `newest`: the device's newest tick by now; `made`: what its rings have of a tick. What is newer is not the device's,
    /// and what they no longer have is compared with nothing.
    pub(super) fn take(&mut self, records: &[AppliedRecord], newest: u64, made: impl Fn(u64) -> Option<AppliedRecord>) {
        let of_device = records.iter().filter(|record| record.tick <= newest);
        let read: BTreeMap<u64, &AppliedRecord> = of_device.map(|record| (record.tick, record)).collect();
        let (Some((first, _)), Some((last, _))) = (read.first_key_value(), read.last_key_value()) else { return };
        self.parts += 1;
        let first = self.last_tick.map_or(*first, |before| before.saturating_add(1));
        for tick in first.max(last.saturating_sub(RING_TICKS))..=*last {
            match (made(tick), read.get(&tick)) {
                (Some(_), None) => self.missing += 1,
                (Some(in_ring), Some(in_file)) if !are_alike(&in_ring, in_file) => self.unlike += 1,
                _ => {}
            }
        }
        self.last_tick = self.last_tick.max(Some(*last));
    }

    /// Whether something was read twice: who is judged has written some of it, for all that is of the one before it was there when it was read first.
    pub(super) fn has_begun(&self) -> bool {
        self.parts > 1
    }

    /// The newest tick that was read, or behind which counting begins.
    pub(super) fn last_tick(&self) -> Option<u64> {
        self.last_tick
    }

    /// What is wrong with the ticks that were read: that stays wrong, whatever comes behind them.
    pub(super) fn flaw(&self) -> Option<String> {
        match (self.missing, self.unlike) {
            (0, 0) => None,
            (0, unlike) => Some(format!("its file has {unlike} of the device's ticks otherwise than they were made")),
            (missing, _) => Some(format!("its file leaves out {missing} of the device's ticks")),
        }
    }
}

/// Whether two records of a tick have the same force, place and input, to the bit. A number that is none is not written, and read as another that is none.
fn are_alike(in_ring: &AppliedRecord, in_file: &AppliedRecord) -> bool {
    let numbers = |record: &AppliedRecord| {
        let AppliedRecord { before_n, on_scope_n, pressure_pa, limits, .. } = *record;
        let limits = [limits.max_force_n, limits.max_stiffness_n_m, limits.max_damping_n_s_m];
        [record.command.force_n, record.sample.pose.position_m, before_n, on_scope_n, limits, [pressure_pa; 3]]
    };
    let is_same = |(a, b): (&f32, &f32)| a.to_bits() == b.to_bits() || !(a.is_finite() || b.is_finite());
    let [ring, file] = [in_ring, in_file].map(numbers);
    let followed = |record: &AppliedRecord| (record.lag, record.followed);
    ring.iter().flatten().zip(file.iter().flatten()).all(is_same) && followed(in_ring) == followed(in_file)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ops::RangeInclusive;

    fn made(tick: u64) -> AppliedRecord {
        let mut record = AppliedRecord { tick, ..AppliedRecord::default() };
        record.command.force_n = [tick as f32, -0.0, f32::INFINITY];
        record
    }

    fn ticks(ticks: RangeInclusive<u64>) -> Vec<AppliedRecord> {
        ticks.map(made).collect()
    }

    /// What is wrong with a file that has these, part by part, if the device's newest tick is 10 000.
    fn flaw(parts: &[Vec<AppliedRecord>]) -> Option<String> {
        let mut written = Written::default();
        // It made none in the 3000s.
        let ring = |tick: u64| Some(made(tick)).filter(|_| !(3_000..4_000).contains(&tick));
        parts.iter().for_each(|part| written.take(part, 10_000, ring));
        written.flaw()
    }

    #[test]
    fn a_file_with_each_tick_as_the_device_made_it_is_right_and_no_tick_is_looked_for_that_was_not_made() {
        assert_eq!(flaw(&[]), None);
        assert_eq!(flaw(&[ticks(500..=600), Vec::new(), ticks(601..=2_999), ticks(4_000..=4_100)]), None);
        assert_eq!(flaw(&[ticks(500..=600), ticks(500..=600), ticks(550..=700)]), None, "twice the same");
        let mut none = made(500);
        none.command.force_n[2] = f32::NAN;
        assert_eq!(flaw(&[vec![none]]), None, "what is no number is written as none");
    }

    #[test]
    fn a_tick_that_is_left_out_or_is_another_one_is_found_and_stays_found() {
        let left_out = Some("its file leaves out 1 of the device's ticks".to_string());
        assert_eq!(flaw(&[ticks(500..=600), ticks(602..=700)]), left_out, "between two parts");
        assert_eq!(flaw(&[[ticks(500..=600), ticks(602..=700)].concat(), ticks(701..=900)]), left_out);
        let mut parts = [ticks(500..=600), ticks(601..=700)];
        parts[1][50].sample.pose.position_m[2] = 1e-9;
        assert_eq!(flaw(&parts), Some("its file has 1 of the device's ticks otherwise than they were made".into()));
        parts[1][50] = made(651);
        parts[0][7].command.force_n[1] = 0.0;
        assert!(flaw(&parts).is_some_and(|flaw| flaw.contains("otherwise")), "a zero with another sign is another number");
    }

    /// Without its inputs a session cannot be done again.
    #[test]
    fn a_tick_with_another_input_is_another_one() {
        let other = |change: fn(&mut AppliedRecord)| {
            let mut parts = [ticks(500..=600)];
            change(&mut parts[0][50]);
            flaw(&parts).is_some()
        };
        assert!(!other(|record| record.before_n[0] = 0.0) && other(|record| record.before_n[0] = -0.0));
        assert!(other(|record| record.lag = 4) && other(|record| record.followed = 2));
        assert!(other(|record| record.pressure_pa = 9_000.0) && other(|record| record.on_scope_n[2] = 0.1));
        assert!(other(|record| record.limits.max_stiffness_n_m = 800.0));
    }

    #[test]
    fn what_lies_behind_the_last_tick_of_the_one_before_is_asked_for_if_that_is_known() {
        let flaw_behind = |last_tick: Option<u64>| {
            let mut written = Written::behind(last_tick);
            let began = [ticks(480..=500), ticks(511..=600)].map(|part| {
                written.take(&part, 10_000, |tick| Some(made(tick)));
                written.has_begun()
            });
            assert_eq!(began, [false, true]);
            written.flaw()
        };
        let left_out = Some("its file leaves out 10 of the device's ticks".to_string());
        for last_tick in [Some(500), Some(490), None] {
            assert_eq!(flaw_behind(last_tick), left_out);
        }
        assert_eq!(flaw_behind(Some(510)), None);
    }

    #[test]
    fn a_tick_that_the_device_has_not_made_yet_is_none_and_the_newest_never_goes_back() {
        let mut written = Written::default();
        written.take(&[ticks(500..=600), ticks(10_001..=10_002), vec![made(u64::MAX)]].concat(), 10_000, |tick| Some(made(tick)));
        assert_eq!((written.last_tick(), written.flaw()), (Some(600), None));
        written.take(&ticks(10..=20), 10_000, |tick| Some(made(tick)));
        assert_eq!((written.last_tick(), written.flaw()), (Some(600), None));
    }

    #[test]
    fn what_the_ring_no_longer_has_is_compared_with_nothing() {
        let mut written = Written::default();
        let ring = |tick: u64| Some(made(tick)).filter(|_| tick + RING_TICKS > 10_000);
        written.take(&ticks(500..=510), 10_000, ring);
        written.take(&ticks(10_001 - RING_TICKS..=9_000), 10_000, ring);
        assert_eq!(written.flaw(), None, "what lies between was overwritten");
        written.take(&ticks(9_002..=9_010), 10_000, ring);
        assert!(written.flaw().is_some());
    }
}
