//! Everything that crosses a process border: fixed-size `#[repr(C)]` records, the layout of the station pages, and the framing
//! of stream messages. Nothing here touches memory that is shared; `hyst-exchange` does.
//!
//! Promise: what is read is checked. A record from another version, of another length or with an offset out of range gives
//! a [`WireError`], never a panic and never a value.

pub mod controls;
mod fluid;
pub mod latency;
mod looks;
pub mod mischief;
mod object;
pub mod page;
pub mod record;
pub mod replay;
pub mod role;
pub mod statement;
pub mod status;
pub mod stream;
pub mod tolerance;

pub use controls::Switch;
pub use fluid::{FLOW_FLAWS, FluidStatus, PUMP_ALARMS, PUMP_NOTICES, SAMPLE_KEPT, WALLS_KEPT, WALLS_OPEN, WALLS_REPLACED};
pub use latency::{LATENCY_BUCKETS, bucket_of_ns, counted_since, percentile_ns};
pub use record::*;
pub use replay::{ReplayRecord, StepRecord};
pub use role::{MAX_WORKERS, Role, SLOTS, Slot};
pub use statement::{DeviceLimits, DeviceStatement, STATEMENT_VERSION, statement_text};
pub use status::*;
pub use stream::{Kind, Message, MessageMut, StreamHeader, WireError, kinds_of};

/// One tick of the station, 1 ms, in nanoseconds.
pub const TICK_NS: u64 = 1_000_000;

/// Version of every layout in this crate. It is part of each page's magic and of each stream's name.
pub const LAYOUT_VERSION: u32 = 19;

/// Version of what an engine does beside its layouts: its command line, its life, when it reads and writes what. Raised by hand.
pub const INTERFACE_VERSION: u32 = 1;

/// FNV-1a over 64-bit words: the checksum of cells and the hash of traces. Not cryptographic; it finds torn and foreign data.
pub fn fnv_words(seed: u64, words: impl IntoIterator<Item = u64>) -> u64 {
    const PRIME: u64 = 0x0000_0100_0000_01b3;
    words.into_iter().fold(seed ^ 0xcbf2_9ce4_8422_2325, |hash, word| (hash ^ word).wrapping_mul(PRIME).rotate_left(23))
}

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
    ];
    let mut hash = 0xcbf2_9ce4_8422_2325u64 ^ LAYOUT_VERSION as u64;
    let mut i = 0;
    while i < sizes.len() {
        hash = (hash ^ sizes[i] as u64).wrapping_mul(0x0000_0100_0000_01b3);
        i += 1;
    }
    hash
}
