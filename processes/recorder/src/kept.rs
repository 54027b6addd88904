//! The states of tissue and fluid, every five seconds, from the checkpoints that their keepers write: what a replay begins with that does not begin at the
//! beginning.

use hyst_exchange::{Station, checkpoint};
use hyst_messages::Role;
use hyst_messages::stream::bytes_of_words;
use hyst_recording::Checkpoint;

/// Ticks between two checkpoints of the recording: what a replay computes at most before it shows what it was asked for.
const INTERVAL_TICKS: u64 = 5_000;
/// A state that is longer is not kept: in its JSON it would be longer than what any reader takes at once. The largest scenes' have some megabytes.
pub const MOST_BYTES: usize = 24 << 20;

/// What has been kept.
#[derive(Default)]
pub struct Kept {
    /// For each role the tick from which on its next state is.
    next_ticks: [u64; Role::STATEFUL.len()],
}

impl Kept {
    /// The newest states, if it is time for them.
    pub fn take(&mut self, station: &Station, tick: u64) -> Vec<Checkpoint> {
        let mut found = Vec::new();
        for (role, next_tick) in Role::STATEFUL.into_iter().zip(&mut self.next_ticks).filter(|(_, next_tick)| tick >= **next_tick)
        {
            let Some(kept) = checkpoint::latest(station, role) else { continue };
            *next_tick = tick + INTERVAL_TICKS;
            let state = bytes_of_words(&kept.words);
            if state.len() <= MOST_BYTES {
                found.push(Checkpoint { role, tick: kept.tick, state: state.to_vec() });
            }
        }
        found
    }
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
        assert_eq!((kept.take(&station, 5_120).len(), kept.take(&station, 5_220).len()), (1, 1));
        station.wipe();
    }
}
