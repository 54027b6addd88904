//! The session as an MCAP file: JSON channels with JSON schemas, three of them those that Foxglove publishes. `tests/tests/reader.rs` reads one with
//! PyPI's `mcap` package, to the bit, and with Foxglove's reader for Node, and holds it against what other programs take; those were not started.
//!
//! A recording is a head (magic, header, metadata `station`), then blocks, then `station` once more and a summary. A block is one compressed chunk with its
//! own schemas, channels and checksum, followed by its message indexes, and is appended by one write. Promise: a file that is cut at any byte
//! is readable to its last whole block, without a summary; a damaged block is found by its checksum, named, and costs no other block;
//! a [`Writer`] that comes after one that died goes on in the same file, each tick once. Nothing outside causes a panic.
//!
//! Times in the file are station time: tick × 1 ms in ns, from the start of tick 0. Format: <https://mcap.dev/spec>.

mod again;
mod ahead;
mod before;
mod block;
pub mod channels;
mod checkpoint;
mod continuity;
mod decode;
mod error;
mod facts;
mod fluid;
mod frame;
mod judged;
mod messages;
mod outline;
mod picture;
mod playback;
mod process;
mod reader;
mod recover;
mod scan;
mod scene;
mod schema;
pub mod sequence;
mod summary;
mod sync;
mod tail;
mod tissue;
mod unpack;
mod writer;

pub use before::Before;
pub use block::{Block, Event, Level, SAID, STATED, TickRange};
pub use checkpoint::{Checkpoint, checkpoints};
pub use continuity::Continuity;
pub use error::{ReadError, WriteError};
pub use judged::Judged;
pub use outline::{Outline, outline};
pub use picture::{Picture, jpeg};
pub use playback::{Moment, Playback};
pub use process::ProcessSpell;
pub use reader::{Damage, Ending, Reader, Recording, open_file};
pub use scene::{SceneFile, scene_files};
pub use sequence::{Collector, History, Taken};
pub use sync::Disk;
pub use tail::Tail;
pub use writer::{Closed, Writer};

/// Session facts by name: the metadata record `station` of a file, which has a checksum of them and stands at its head, before its second block and at its end.
/// `session` must be there; it tells one session from another.
pub type Session = std::collections::BTreeMap<String, String>;

/// Version of channels and framing; a file of another version is not continued.
pub const FORMAT: &str = "5";

/// Versions that are read. One of version 1 has no inputs and no steps, so that it can be reported and not replayed; one of version 2 has no checkpoints, so
/// that a replay of it begins at its beginning; one of version 3 has no pictures and no scene; one of version 4 has its facts once and
/// without a checksum, and nothing of what its referee had judged.
pub const READ_FORMATS: [&str; 5] = ["1", "2", "3", "4", FORMAT];
