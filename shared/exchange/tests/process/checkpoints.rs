//! Checkpoints whose writer is killed with SIGKILL while it writes without a pause.

use crate::support::*;
use hyst_exchange::checkpoint::newest;
use hyst_exchange::system;
use hyst_messages::Role;

const LIVES: u32 = 100;
/// The kill comes this long after the first write at most, ns.
const LONGEST_LIFE_NS: u64 = 500_000;
/// Bytes of a state, as the partner has it.
const BYTES: usize = 4_096;

#[test]
fn a_writer_killed_a_hundred_times_leaves_a_whole_newest_checkpoint_and_older_ones() {
    isolated(a_writer_killed_a_hundred_times_leaves_a_whole_newest_checkpoint_and_older_ones, |station| {
        let mut seeded = Seeded(1977);
        let (mut last, mut checked) = (0, 0);
        for life in 0..LIVES {
            let mut writer = Partner::start(station, "checkpoint", 1, "live", 0);
            writer.expect("writing");
            let end_ns = system::now_ns() + seeded.below(LONGEST_LIFE_NS);
            until(|| (system::now_ns() >= end_ns).then_some(()));
            writer.kill();
            let (found, damaged) = newest(station, Role::Tissue, BYTES, u64::MAX, |_| true);
            let found = found.unwrap_or_else(|| panic!("life {life}: nothing is left"));
            assert!(found.words.len() == BYTES / 8 && found.words.iter().all(|word| *word == found.tick), "life {life}: torn");
            assert!(found.tick > last, "life {life}: from {last} to {}", found.tick);
            assert_eq!(damaged, 0, "life {life}: one that is not whole is no checkpoint");
            last = found.tick;
            // An older one, for the case that the newest kills whoever goes on from it.
            if last > 2_500 {
                let (older, _) = newest(station, Role::Tissue, BYTES, last - 1, |_| true);
                let is_whole = older.is_some_and(|older| older.tick < last && older.words.iter().all(|word| *word == older.tick));
                assert!(is_whole, "life {life}: nothing is older than the newest");
                checked += 1;
            }
        }
        assert!(last > u64::from(LIVES) && checked > 0, "{last} {checked}");
    });
}
