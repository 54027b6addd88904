//! What every page starts with, in its 64-bit words, and what stands in its 32-bit words.

use super::WORDS32;
use crate::{LATENCY_BUCKETS, MAX_WORKERS, REFUSED_WORDS};

/// Magic and layout.
pub const MAGIC: usize = 0;
/// Slot number.
pub const SLOT: usize = 1;
/// Incarnation.
pub const INCARNATION: usize = 2;
/// Process id of the owner.
pub const PID: usize = 3;
/// Newest heartbeat, CLOCK_MONOTONIC ns.
pub const HEARTBEAT_NS: usize = 4;
/// Newest tick of the owner.
pub const TICK: usize = 5;
/// Steps so far.
pub const STEPS: usize = 6;
/// Overruns so far: steps that ended after the next had to start.
pub const OVERRUNS: usize = 7;
/// When the owner's newest value was written, ns.
pub const VALUE_NS: usize = 8;
/// Who holds the owner's role as far as it knows, as the roster has it: `epoch << 32 | incarnation`; 0 before it has looked. One word, so that no
/// reader pairs the epoch of one holder with another's name.
pub const TENURE: usize = 9;
/// Values refused because they were not valid.
pub const INVALID: usize = 10;
/// Values refused because they were stale or fenced.
pub const STALE: usize = 11;
/// Steps computed as a substitute for another owner.
pub const SUBSTITUTES: usize = 12;
/// Promotions of the owner.
pub const PROMOTIONS: usize = 13;
/// Entries of the real-time thread into the system's allocator since it became real time.
pub const ALLOCATIONS: usize = 14;
/// Real-time set-up: bit 0 SCHED_FIFO, bit 1 memory locked, bit 2 pinned.
pub const REAL_TIME: usize = 15;
/// Bytes written into streams, and bytes copied beyond the one write.
pub const STREAM_BYTES: usize = 16;
/// Bytes copied beyond the one write into the loan.
pub const COPIED_BYTES: usize = 17;
/// Values refused because their writer stood still while its input changed.
pub const FROZEN: usize = 18;
/// Steps in which the owner did wrong because it was asked to, in test mode.
pub const MISCHIEF: usize = 19;
/// Incarnations that the owner distrusts: entries of three words: `why << 32 | incarnation` (a [`super::device::Distrust`]), since when, and
/// when last, ns. One that names the owner itself says which thread that helps it stands still ([`crate::mischief::Thread::standstill`]).
pub const DISTRUSTED: usize = 20;
/// Words of an entry of [`DISTRUSTED`].
pub const DISTRUSTED_ENTRY_WORDS: usize = 3;
/// Entries of [`DISTRUSTED`]: the other replica and the workers of a small station; the oldest gives way.
pub const DISTRUSTED_ENTRIES: usize = 4;
/// First word of an entry of [`DISTRUSTED`].
pub const fn distrusted(index: usize) -> usize {
    DISTRUSTED + DISTRUSTED_ENTRY_WORDS * index
}
/// The state of its own role that the owner has refused last ([`crate::RefusedState`]), 3 words; 0 if it has refused none.
pub const REFUSED: usize = distrusted(DISTRUSTED_ENTRIES);
const _: () = assert!(REFUSED + REFUSED_WORDS <= POOL_BLOCKS);
/// Small blocks that the real-time thread has taken from its own pool since it became real time.
pub const POOL_BLOCKS: usize = 40;
/// Tick at which the owner began a role's state anew, from a checkpoint or from the scene, and not from its predecessor's; 0 if it never did.
pub const FOUNDED_TICK: usize = 41;
/// Periods that a real-time thread left to ordinary threads of its core.
pub const LEFT: usize = 42;
/// What the owner has joined last, as a member: `incarnation of the coordinator << 32 | release`. One word: the coordinators of a role count
/// alike, and no reader may pair the release of one with another's name.
pub const JOINED: usize = 43;
/// The life latch of the owner's main thread, 8 words.
pub const LATCH: usize = 44;
/// When the owner last looked for a newcomer's page and had no file descriptor left to open it with, CLOCK_MONOTONIC ns; 0 if that never was.
pub const UNOPENED_NS: usize = LATCH + 8;
const _: () = assert!(UNOPENED_NS < WAKEUP);
/// Histogram of wake-up latencies.
pub const WAKEUP: usize = 64;
/// Histogram of loop latencies.
pub const LOOP: usize = WAKEUP + LATENCY_BUCKETS;
/// Last words, UTF-8, zero-padded.
pub const LAST_WORDS: usize = LOOP + LATENCY_BUCKETS;
/// Words of the last words.
pub const LAST_WORDS_WORDS: usize = 64;
/// First word that belongs to the role.
pub const END: usize = 512;
const _: () = assert!(LAST_WORDS + LAST_WORDS_WORDS <= END);

/// 32-bit words: state of the process.
pub const STATE: usize = 0;
/// 32-bit words: release of the Meeting Point that the owner co-ordinates; waited on by its members.
pub const RELEASE: usize = 1;
/// 32-bit words: bumped when the owner has written a new value; waited on by its readers.
pub const NEWS: usize = 2;
/// 32-bit words: bumped when the owner has joined a release, as a member; waited on by its coordinator.
pub const JOIN: usize = 3;
/// 32-bit words: 1 once the owner's ports are open, so that others may connect to them while it still warms up.
pub const PORTS_OPEN: usize = 4;
/// 32-bit words: incarnation of the member that computes share i.
pub const SHARE_MEMBER: usize = 16;
/// 32-bit words: the newest release that named share i. A member looks at its own seat's word alone, so it is never released by the mask of
/// another group, and one that slept through a release finds out and catches up.
pub const SHARE_RELEASE: usize = SHARE_MEMBER + MAX_WORKERS;
const _: () = assert!(SHARE_RELEASE + MAX_WORKERS <= WORDS32);
