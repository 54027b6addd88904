//! Everything that crosses a process border: fixed-size `#[repr(C)]` records, the layout of the station pages, and the framing
//! of stream messages. Nothing here touches memory that is shared; `hyst-exchange` does.
//!
//! Promise: what is read is checked. A record from another version, of another length or with an offset out of range gives
//! a [`WireError`], never a panic and never a value.

mod admission;
pub mod contents;
pub mod controls;
mod fluid;
pub mod latency;
mod looks;
mod mean;
pub mod mischief;
mod object;
pub mod page;
pub mod record;
mod refusal;
pub mod replay;
pub mod role;
pub mod statement;
pub mod status;
pub mod stream;
mod tissue;
pub mod tolerance;
mod topology;

pub use admission::Admission;
pub use controls::{PA_PER_MMHG, Switch};
pub use fluid::{FLOW_FLAWS, FluidStatus, MAX_FLUID_STEP_TICKS, MAX_SEALS, PUMP_ALARMS, PUMP_NOTICES, SAMPLE_KEPT, SealRecord};
pub use fluid::{WALLS_KEPT, WALLS_OPEN, WALLS_REPLACED};
pub use latency::{LATENCY_BUCKETS, bucket_of_ns, counted_since, percentile_ns};
pub use mean::{MEAN_TICKS, Shown, mean_after};
pub use record::*;
pub use refusal::{REFUSED_WORDS, Refusal, RefusedState};
pub use replay::{FROM_NOTHING, FROM_OTHER, FROM_OWN, OriginRecord, ReplayRecord, Replayed, StepRecord};
pub use role::{MAX_WORKERS, Role, SLOTS, Slot};
pub use statement::{DeviceLimits, DeviceStatement, STATEMENT_VERSION, statement_text};
pub use status::*;
pub use stream::{Kind, Message, MessageMut, StreamHeader, WireError, kinds_of};
pub use tissue::{CUT_LIMIT, TissueStatus};
pub use topology::topology_is_sound;

#[cfg(test)]
extern crate self as hyst_messages; // so do the tests of other crates name what they have in common with those here

/// One tick of the station, 1 ms, in nanoseconds.
pub const TICK_NS: u64 = 1_000_000;

/// Version of every layout in this crate. It is part of each page's magic and of each stream's name.
pub const LAYOUT_VERSION: u32 = 23;

/// Version of what an engine does beside its layouts: its command line, its life, when it reads and writes what. Raised by hand.
pub const INTERFACE_VERSION: u32 = 2;

/// FNV-1a over 64-bit words: the checksum of cells and the hash of traces. Not cryptographic; it finds torn and foreign data.
pub fn fnv_words(seed: u64, words: impl IntoIterator<Item = u64>) -> u64 {
    words.into_iter().fold(seed ^ FNV_START, fnv_next)
}

const FNV_START: u64 = 0xcbf2_9ce4_8422_2325;
const FNV_PRIME: u64 = 0x0000_0100_0000_01b3;

fn fnv_next(hash: u64, word: u64) -> u64 {
    (hash ^ word).wrapping_mul(FNV_PRIME).rotate_left(23)
}

/// Which points a collision job is about, as its answers name it: the hash of their coordinates, as bits. Four chains of two coordinates at a time, which do
/// not wait for each other, and [`fnv_words`] of their ends, of what is left over and of the number of words: it is made beside each share and again when the
/// share is there.
pub fn job_hash(words: &[u32]) -> u64 {
    let (blocks, rest) = words.as_chunks::<8>();
    let mut chains = [0, 1, 2, 3].map(|chain: u64| chain ^ FNV_START);
    for block in blocks {
        for (lane, chain) in chains.iter_mut().enumerate() {
            *chain = fnv_next(*chain, u64::from(block[2 * lane]) | u64::from(block[2 * lane + 1]) << 32);
        }
    }
    fnv_words(words.len() as u64, chains.into_iter().chain(rest.iter().map(|word| u64::from(*word))))
}

/// In the place of the count of shares, where a worker has found more hits than there is room for: nobody's fault, and the coordinator computes the share.
pub const TOO_MANY_HITS: u32 = u32::MAX;

/// Version and hash of the layout in one word, as a recording has it: states of one name can be read by who is built with the same.
pub fn layout_name() -> String {
    format!("{LAYOUT_VERSION}/{:016x}", layout_hash())
}

/// The roll of all layouts: sizes of every record that crosses a border. Two binaries with different values never exchange data.
pub const fn layout_hash() -> u64 {
    let sizes = [
        size_of::<InputRecord>(),
        size_of::<ForceRecord>(),
        size_of::<ForceCommand>(),
        size_of::<AppliedRecord>(),
        size_of::<StepRecord>(),
        size_of::<OriginRecord>(),
        size_of::<ReplayRecord>(),
        size_of::<HardwareSample>(),
        size_of::<DeviceStatement>(),
        size_of::<LedgerEntry>(),
        size_of::<ContactModel>(),
        size_of::<TissueStatus>(),
        size_of::<FluidStatus>(),
        size_of::<PointerRecord>(),
        size_of::<RecorderStatus>(),
        size_of::<RenderingStatus>(),
        size_of::<StreamHeader>(),
        size_of::<SealRecord>(),
    ];
    let mut hash = FNV_START ^ LAYOUT_VERSION as u64;
    let mut i = 0;
    while i < sizes.len() {
        hash = (hash ^ sizes[i] as u64).wrapping_mul(FNV_PRIME);
        i += 1;
    }
    hash
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_is_known_by_each_bit_of_each_word_and_by_their_order_and_number() {
        for length in [0, 1, 7, 8, 9, 16, 23, 300] {
            let words: Vec<u32> = (0..length).map(|word: u32| word.wrapping_mul(2_654_435_761)).collect();
            let hash = job_hash(&words);
            assert_eq!(job_hash(&words), hash);
            for at in 0..words.len() {
                for bit in [0, 13, 31] {
                    let mut other = words.clone();
                    other[at] ^= 1 << bit;
                    assert_ne!(job_hash(&other), hash, "bit {bit} of word {at} of {length}");
                }
                let mut other = words.clone();
                other.rotate_left(at);
                assert!(at == 0 || job_hash(&other) != hash, "{length} words, turned by {at}");
            }
            assert_ne!(job_hash(&[&words[..], &[0]].concat()), hash, "a zero more than {length} words");
        }
    }

    /// Cells, traces and the hashes of recorded states are made of it.
    #[test]
    fn the_hash_of_words_has_the_value_that_recordings_have() {
        let plain = |seed: u64, words: &[u64]| {
            let mut hash = seed ^ 0xcbf2_9ce4_8422_2325;
            for word in words {
                hash = (hash ^ word).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(23);
            }
            hash
        };
        for words in [&[1u64][..], &[u64::MAX, 0, 7, 0x0123_4567_89ab_cdef], &[]] {
            assert_eq!(fnv_words(9, words.iter().copied()), plain(9, words));
        }
    }
}
