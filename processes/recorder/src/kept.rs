//! The states of tissue and fluid, every five seconds, from the checkpoints that their keepers write: what a replay begins with that does not begin at the
//! beginning. Promise: both are of about one time, and those of a role take no more of the disk than [`MOST_BYTES_PER_TICK`]; so large ones come more seldom.

use hyst_exchange::{Station, checkpoint};
use hyst_messages::Role;
use hyst_messages::stream::bytes_of_words;
use hyst_recording::Checkpoint;

/// Ticks between two checkpoints of the recording: what a replay computes at most before it shows what it was asked for, unless the states are large.
const INTERVAL_TICKS: u64 = 5_000;
/// Most that the states of a role take, bytes for each tick: 0.25 MB/s, a quarter of what a recording may take in all. In the file they have as many bytes, or
/// some percent more: the fields of a flow hardly become shorter, and base64 costs what zstd takes back.
const MOST_BYTES_PER_TICK: u64 = 250;
/// A state that is longer is not kept: in its JSON it would be longer than what any reader takes at once. The largest scenes' have some megabytes.
pub const MOST_BYTES: usize = 24 << 20;

/// What has been kept.
#[derive(Default)]
pub struct Kept {
    /// The tick with which the newest round began, and of which roles there is a state in it.
    begun_tick: Option<u64>,
    has_state: [bool; Role::STATEFUL.len()],
    /// Length of the longest so far.
    longest_bytes: usize,
}

impl Kept {
    /// The newest states, if it is time for them.
    pub fn take(&mut self, station: &Station, tick: u64) -> Vec<Checkpoint> {
        if self.begun_tick.is_some_and(|begun| tick >= begun + interval_ticks(self.longest_bytes)) {
            (self.begun_tick, self.has_state) = Default::default();
        }
        let mut found = Vec::new();
        for (role, has_state) in Role::STATEFUL.into_iter().zip(&mut self.has_state).filter(|(_, has_state)| !**has_state) {
            let Some(kept) = checkpoint::latest(station, role) else { continue };
            *has_state = true;
            self.begun_tick.get_or_insert(tick);
            let state = bytes_of_words(&kept.words);
            if state.len() <= MOST_BYTES {
                self.longest_bytes = self.longest_bytes.max(state.len());
                found.push(Checkpoint { role, tick: kept.tick, state: state.to_vec() });
            }
        }
        found
    }
}

/// Ticks between two rounds of states of which the longest has so many bytes.
fn interval_ticks(longest_bytes: usize) -> u64 {
    INTERVAL_TICKS.max((longest_bytes as u64).div_ceil(MOST_BYTES_PER_TICK))
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_exchange::checkpoint::CheckpointWriter;
    use hyst_messages::Slot;

    #[test]
    fn the_newest_states_are_kept_every_five_seconds() {
        let station = Station::named(&format!("t{}-kept", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let mut kept = Kept::default();
        assert_eq!(kept.take(&station, 10), [], "nobody has a state yet");
        let tissue = [0, 1].map(|index| CheckpointWriter::open(&station, Slot::new(Role::Tissue, index).unwrap(), 100).unwrap());
        let fluid = CheckpointWriter::open(&station, Slot::new(Role::Fluid, 1).unwrap(), 5_000).unwrap();
        assert!(tissue[0].write(1, 90, &[1; 20], true) && tissue[1].write(1, 100, &[2; 24], true));
        let ticks = |found: Vec<Checkpoint>| found.iter().map(|kept| (kept.role, kept.tick, kept.state[0])).collect::<Vec<_>>();
        assert_eq!(ticks(kept.take(&station, 120)), [(Role::Tissue, 100, 2)]);
        assert!(fluid.write(1, 196, &[3; 16], true));
        assert_eq!(ticks(kept.take(&station, 220)), [(Role::Fluid, 196, 3)], "as soon as it is there");
        assert_eq!(kept.take(&station, 5_119), []);
        assert_eq!((kept.take(&station, 5_120).len(), kept.take(&station, 5_220)), (2, Vec::new()), "from now on together");
        station.wipe();
    }

    /// A flow on a fine grid alone would have taken some megabytes a second.
    #[test]
    fn large_states_are_kept_more_seldom_both_of_them() {
        let station = Station::named(&format!("t{}-large", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let writer = |role: Role, bytes: usize| CheckpointWriter::open(&station, Slot::first(role), bytes).unwrap();
        let (tissue, fluid) = (writer(Role::Tissue, 100), writer(Role::Fluid, 1_500_000));
        assert!(tissue.write(1, 90, &[1; 24], true) && fluid.write(1, 96, &[2u8].repeat(1_500_000), true));
        let mut kept = Kept::default();
        let counts = [100, 5_100, 6_099, 6_100, 12_099, 12_100].map(|tick| kept.take(&station, tick).len());
        assert_eq!(counts, [2, 0, 0, 2, 0, 2]);
        assert_eq!([0, 1_250_000, 1_250_001, MOST_BYTES].map(interval_ticks), [5_000, 5_000, 5_001, 100_664]);
        station.wipe();
    }
}
