//! Checkpoints: finished states of a role, kept outside of any engine's own memory, for the case that incumbent and spare die together. Each
//! slot of the role has one file of its own in the station's root, with several generations: the newest state, one of some seconds ago, one of
//! some tens. A state may kill whoever goes on from it; then an older one serves.
//!
//! Promise: each generation has two copies that take turns, so that a writer that dies in the middle, or a bit that flips, costs one copy: it
//! has a wrong checksum and is not found; one in the file's header costs nothing. A generation is at most two of its intervals old, and its older
//! copy at least one.

use crate::page::{self, OwnedPage, PageError, ReadPage};
use crate::station::Station;
use hyst_messages::fnv_words;
use hyst_messages::page::{WORDS32, header};
use hyst_messages::{Role, Slot};
use std::collections::BTreeSet;
use std::fs::File;
use std::os::unix::fs::FileExt;

/// Ticks between two states of a generation; 0: each state that is given.
pub const INTERVAL_TICKS: [u64; 3] = [0, 1_000, 10_000];
/// Copies of a generation.
const COPIES: usize = 2;
/// Where the header says how long the messages may be, of a page whose owner makes no steps; and the longest that is believed.
const ROOM: usize = header::STEPS;
const MOST_ROOM_BYTES: u64 = 1 << 30;

const WRITTEN: usize = 0;
const EPOCH: usize = 1;
const TICK: usize = 2;
const BYTES: usize = 3;
const CHECKSUM: usize = 4;
const DATA: usize = 5;

/// A state that was read back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Checkpoint {
    /// Epoch of the owner that made it.
    pub epoch: u32,
    /// Tick of the state.
    pub tick: u64,
    /// The message, padded to whole words.
    pub words: Vec<u64>,
}

/// The file of a slot's checkpoints.
pub fn path(station: &Station, slot: Slot) -> std::path::PathBuf {
    station.root().join(format!("pages/checkpoint-{}.page", slot.number()))
}

/// First word of a copy.
fn start(generation: usize, copy: usize, bytes: usize) -> usize {
    header::END + (generation * COPIES + copy) * (DATA + bytes.div_ceil(8))
}

fn words_for(bytes: usize) -> usize {
    start(INTERVAL_TICKS.len(), 0, bytes)
}

/// The writer of one slot's checkpoints.
#[derive(Debug)]
pub struct CheckpointWriter {
    page: OwnedPage,
    bytes: usize,
}

impl CheckpointWriter {
    /// Opens the slot's checkpoints for messages of at most `bytes`, or makes them: where there are none, or for messages of another size.
    ///
    /// # Errors
    /// The system refuses the file; what is in it stays.
    pub fn open(station: &Station, slot: Slot, bytes: usize) -> Result<CheckpointWriter, PageError> {
        let path = path(station, slot);
        let page = match OwnedPage::open_damaged(&path, words_for(bytes)) {
            Ok(page) => {
                page.store64(header::MAGIC, page::magic()); // each copy says itself whether it is whole
                page
            }
            Err(error) if is_absent(&error) || matches!(error, PageError::Foreign { .. }) => {
                let _ = std::fs::remove_file(&path); // what stands in the way is told by the next line
                page::create(&path, words_for(bytes), slot.number(), 0)?
            }
            Err(error) => return Err(error),
        };
        page.store64(ROOM, bytes as u64);
        Ok(CheckpointWriter { page, bytes })
    }

    /// Writes a state into the newest generation and, if its maker has `lasted`, into each older one that is due; one that is too long is refused.
    pub fn write(&self, epoch: u32, tick: u64, message: &[u8], lasted: bool) -> bool {
        if message.len() > self.bytes {
            return false;
        }
        let generations = if lasted { INTERVAL_TICKS.len() } else { 1 };
        for (generation, interval_ticks) in INTERVAL_TICKS.into_iter().enumerate().take(generations) {
            let at = |copy: usize| start(generation, copy, self.bytes);
            // A tick that is still to come is a bit that flipped: that copy is the next to be written.
            let written = |copy: usize| {
                let kept = self.page.load64(at(copy) + TICK);
                if self.page.load64(at(copy) + WRITTEN) == 1 && kept <= tick { kept } else { 0 }
            };
            let (older, newer) = if written(0) <= written(1) { (0, 1) } else { (1, 0) };
            if written(newer) == 0 || tick - written(newer) >= interval_ticks {
                self.write_copy(at(older), epoch, tick, message);
            }
        }
        true
    }

    fn write_copy(&self, at: usize, epoch: u32, tick: u64, message: &[u8]) {
        self.page.store64(at + WRITTEN, 0);
        let mut checksum = fnv_words(tick, [epoch as u64, message.len() as u64]);
        for (index, chunk) in message.chunks(8).enumerate() {
            let mut word = [0u8; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            let word = u64::from_ne_bytes(word);
            checksum = fnv_words(checksum, [word]);
            self.page.store64(at + DATA + index, word);
        }
        self.page.store64(at + EPOCH, epoch as u64);
        self.page.store64(at + TICK, tick);
        self.page.store64(at + BYTES, message.len() as u64);
        self.page.store64(at + CHECKSUM, checksum);
        self.page.store64(at + WRITTEN, 1);
    }
}

fn is_absent(error: &PageError) -> bool {
    matches!(error, PageError::Refused { reason: rustix::io::Errno::NOENT, .. })
}

fn read(page: &ReadPage, at: usize, bytes: usize) -> Option<Checkpoint> {
    let length = page.load64(at + BYTES) as usize;
    if page.load64(at + WRITTEN) != 1 || length > bytes {
        return None;
    }
    let (epoch, tick) = (page.load64(at + EPOCH), page.load64(at + TICK));
    let mut words = vec![0u64; length.div_ceil(8)];
    page.load64s(at + DATA, &mut words);
    let start = fnv_words(tick, [epoch, length as u64]);
    let checksum = words.iter().fold(start, |checksum, word| fnv_words(checksum, [*word]));
    (checksum == page.load64(at + CHECKSUM)).then_some(Checkpoint { epoch: epoch as u32, tick, words })
}

/// The newest whole checkpoint of a role up to a tick that is accepted, whose messages have at most `bytes`: of the last epoch that has one, whatever
/// a writer that lost the role may have kept since. And how many copies were damaged, or held what nobody can go on from. A file that cannot be
/// read counts as one.
pub fn newest(
    station: &Station,
    role: Role,
    bytes: usize,
    up_to_tick: u64,
    accepts: impl Fn(&Checkpoint) -> bool,
) -> (Option<Checkpoint>, usize) {
    let (mut newest, mut damaged) = (None::<Checkpoint>, 0);
    for slot in (0..role.slots().1).filter_map(|index| Slot::new(role, index)) {
        let page = match ReadPage::open_damaged(&path(station, slot), words_for(bytes)) {
            Ok(page) => page,
            Err(error) => {
                damaged += usize::from(!is_absent(&error));
                continue;
            }
        };
        for copy in 0..INTERVAL_TICKS.len() * COPIES {
            let at = start(copy / COPIES, copy % COPIES, bytes);
            let tick = page.load64(at + TICK);
            if page.load64(at + WRITTEN) == 0 || tick > up_to_tick {
                continue;
            }
            match read(&page, at, bytes) {
                None => damaged += 1,
                Some(found) if newest.as_ref().is_some_and(|known| (known.epoch, known.tick) >= (found.epoch, found.tick)) => {}
                Some(found) if !accepts(&found) => damaged += 1,
                Some(found) => newest = Some(found),
            }
        }
    }
    (newest, damaged)
}

/// The newest whole checkpoint of a role, for who does not know how long its messages may be.
pub fn latest(station: &Station, role: Role) -> Option<Checkpoint> {
    let room = |slot: Slot| {
        let mut word = [0; 8];
        // As a page lies in its file: the words of 32 bits, then those of 64.
        File::open(path(station, slot)).ok()?.read_exact_at(&mut word, (4 * WORDS32 + 8 * ROOM) as u64).ok()?;
        Some(u64::from_ne_bytes(word)).filter(|bytes| *bytes <= MOST_ROOM_BYTES)
    };
    let rooms: BTreeSet<u64> = (0..role.slots().1).filter_map(|index| Slot::new(role, index)).filter_map(room).collect();
    // Each as it is said: by one that is damaged no file is found whole, and by another's its file is.
    let found = rooms.into_iter().filter_map(|bytes| newest(station, role, bytes as usize, u64::MAX, |_| true).0);
    found.max_by_key(|kept| (kept.epoch, kept.tick))
}

/// The file of a state that a role begins with instead of its first one.
fn first_path(station: &Station, role: Role) -> std::path::PathBuf {
    station.root().join(format!("first-{}", role.name()))
}

/// Lays down the state, as a message, that a role of a station which begins later begins with.
pub fn lay_first(station: &Station, role: Role, message: &[u8]) -> std::io::Result<()> {
    std::fs::write(first_path(station, role), message)
}

/// The state that was laid down for a role, padded to whole words; `None` without one.
pub fn first(station: &Station, role: Role) -> Option<Vec<u64>> {
    let bytes = std::fs::read(first_path(station, role)).ok()?;
    let word = |chunk: &[u8]| {
        let mut word = [0; 8];
        word[..chunk.len()].copy_from_slice(chunk);
        u64::from_ne_bytes(word)
    };
    Some(bytes.chunks(8).map(word).collect())
}

/// Discards the checkpoints of a role that are younger than a tick: who was sent back behind them has found nobody to survive them, and they
/// would serve again in the next trouble.
pub fn discard_after(station: &Station, role: Role, bytes: usize, tick: u64) {
    for slot in (0..role.slots().1).filter_map(|index| Slot::new(role, index)) {
        let Ok(page) = OwnedPage::open_damaged(&path(station, slot), words_for(bytes)) else { continue };
        for copy in 0..INTERVAL_TICKS.len() * COPIES {
            let at = start(copy / COPIES, copy % COPIES, bytes);
            if page.load64(at + TICK) > tick {
                page.store64(at + WRITTEN, 0); // a zombie that writes this very copy loses at most its own state
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn founded(name: &str) -> Station {
        let station = Station::named(&format!("t{}-{name}", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        station
    }

    #[test]
    fn the_newest_whole_checkpoint_is_found_and_a_damaged_one_is_not() {
        let station = founded("check");
        let slots = [Slot::new(Role::Tissue, 0).unwrap(), Slot::new(Role::Tissue, 1).unwrap()];
        let writers = slots.map(|slot| CheckpointWriter::open(&station, slot, 24).unwrap());
        assert_eq!(newest(&station, Role::Tissue, 24, u64::MAX, |_| true), (None, 0));
        assert!(writers[0].write(1, 100, &[1; 20], true));
        assert!(writers[1].write(1, 200, &[2; 24], true));
        assert!(!writers[0].write(1, 300, &[3; 25], true), "too long");
        let (found, damaged) = newest(&station, Role::Tissue, 24, u64::MAX, |_| true);
        assert_eq!((found.map(|found| (found.epoch, found.tick)), damaged), (Some((1, 200)), 0));
        let other = CheckpointWriter::open(&station, Slot::guest(Role::Tissue).unwrap(), 24).unwrap();
        assert!(other.write(2, 150, &[4; 24], true));
        let (found, _) = newest(&station, Role::Tissue, 24, u64::MAX, |_| true);
        assert_eq!(found.map(|found| (found.epoch, found.tick)), Some((2, 150)), "who lost the role keeps nothing that counts");
        std::fs::remove_file(path(&station, Slot::guest(Role::Tissue).unwrap())).unwrap();
        // One bit of each copy of the newer state.
        for generation in 0..INTERVAL_TICKS.len() {
            let at = start(generation, 0, 24) + DATA + 1;
            writers[1].page.store64(at, writers[1].page.load64(at) ^ 1 << 17);
        }
        let (found, damaged) = newest(&station, Role::Tissue, 24, u64::MAX, |_| true);
        let found = found.unwrap();
        assert_eq!((found.tick, bytemuck::cast_slice::<u64, u8>(&found.words)[..20].to_vec()), (100, vec![1; 20]));
        assert_eq!(damaged, INTERVAL_TICKS.len());
        station.wipe();
    }

    /// The header says nothing that the copies do not say themselves.
    #[test]
    fn a_bit_that_flips_in_the_header_costs_no_generation_and_another_size_makes_the_file_anew() {
        let station = founded("magic");
        let slot = Slot::first(Role::Tissue);
        let writer = CheckpointWriter::open(&station, slot, 24).unwrap();
        assert!(writer.write(1, 100, &[1; 20], true));
        writer.page.store64(header::MAGIC, page::magic() ^ 1 << 5);
        let tick = |bytes: usize| {
            let (found, damaged) = newest(&station, Role::Tissue, bytes, u64::MAX, |_| true);
            (found.map(|found| found.tick), damaged)
        };
        assert_eq!(tick(24), (Some(100), 0));
        let writer = CheckpointWriter::open(&station, slot, 24).unwrap();
        assert_eq!((tick(24), writer.page.load64(header::MAGIC)), ((Some(100), 0), page::magic()));
        assert_eq!(tick(8_000), (None, 1), "a file of another size is no checkpoint, and told");
        let larger = CheckpointWriter::open(&station, slot, 8_000).unwrap();
        assert_eq!(tick(8_000), (None, 0));
        assert!(larger.write(2, 200, &[2; 8_000], true));
        assert_eq!(tick(8_000), (Some(200), 0));
        // What the system refuses is an error, and nothing is lost of it.
        std::fs::remove_file(path(&station, slot)).unwrap();
        std::fs::create_dir(path(&station, slot)).unwrap();
        assert!(CheckpointWriter::open(&station, slot, 24).is_err() && path(&station, slot).is_dir());
        station.wipe();
    }

    /// A flipped bit must not make a copy the newest for ever, and a whole state that nobody can go on from must not hide the one before it.
    #[test]
    fn a_tick_from_the_future_is_written_over_and_what_is_not_accepted_gives_way_to_an_older_one() {
        let station = founded("future");
        let writer = CheckpointWriter::open(&station, Slot::first(Role::Fluid), 8).unwrap();
        for tick in [100, 200] {
            assert!(writer.write(1, tick, &tick.to_le_bytes(), true));
        }
        for copy in 0..COPIES {
            for bit in [40, 63] {
                let at = start(0, copy, 8) + TICK;
                writer.page.store64(at, writer.page.load64(at) ^ 1 << bit);
                assert!(writer.write(1, 300 + bit, &bit.to_le_bytes(), true));
                assert!(writer.write(1, 301 + bit, &bit.to_le_bytes(), true));
                let (found, damaged) = newest(&station, Role::Fluid, 8, u64::MAX, |_| true);
                assert_eq!((found.unwrap().tick, damaged), (301 + bit, 0), "copy {copy}, bit {bit}");
            }
        }
        let (found, refused) = newest(&station, Role::Fluid, 8, u64::MAX, |kept| kept.tick < 300);
        assert_eq!((found.map(|found| found.tick), refused), (Some(100), 2));
        station.wipe();
    }

    #[test]
    fn an_older_generation_is_there_when_the_newest_must_not_be_used() {
        let station = founded("older");
        let writer = CheckpointWriter::open(&station, Slot::first(Role::Fluid), 8).unwrap();
        for tick in (100..60_000).step_by(100) {
            assert!(writer.write(1, tick, &tick.to_le_bytes(), true));
            for (generation, back) in [(1, 1_000), (2, 10_000)] {
                let Some(limit) = tick.checked_sub(back).filter(|limit| *limit > 100) else { continue };
                let found = newest(&station, Role::Fluid, 8, limit, |_| true).0.map_or(0, |found| found.tick);
                let oldest = tick.saturating_sub(2 * INTERVAL_TICKS[generation] + 100).max(100);
                assert!((oldest..=limit).contains(&found), "at {tick}, {back} back: {found}");
            }
        }
        // Makers that have not lasted leave the older generations as they are.
        for tick in (60_000..90_000).step_by(100) {
            assert!(writer.write(2, tick, &tick.to_le_bytes(), false));
        }
        for back in [1_000, 10_000] {
            let found = newest(&station, Role::Fluid, 8, 59_900 - back, |_| true).0.unwrap().tick;
            assert!((59_900 - 2 * back - 100..=59_900 - back).contains(&found), "{back} back: {found}");
        }
        for tick in [90_000, 90_100] {
            assert!(writer.write(2, tick, &tick.to_le_bytes(), true));
        }
        // A writer that dies in the middle of the newest copy leaves the one before.
        let newest_copy = (0..COPIES).max_by_key(|copy| writer.page.load64(start(0, *copy, 8) + TICK)).unwrap();
        writer.page.store64(start(0, newest_copy, 8) + WRITTEN, 0);
        assert_eq!(newest(&station, Role::Fluid, 8, u64::MAX, |_| true).0.unwrap().tick, 90_000);
        discard_after(&station, Role::Fluid, 8, 60_000);
        let found = newest(&station, Role::Fluid, 8, u64::MAX, |_| true).0.unwrap().tick;
        assert!((57_900..=60_000).contains(&found), "what is younger is gone, what is older is not: {found}");
        station.wipe();
    }

    /// The largest word was believed, and a flipped bit in one file's hid the states of all.
    #[test]
    fn a_damaged_word_of_how_long_messages_may_be_hides_no_state() {
        let station = founded("said-room");
        let slots = [0, 1].map(|index| Slot::new(Role::Tissue, index).unwrap());
        let writers = slots.map(|slot| CheckpointWriter::open(&station, slot, 24).unwrap());
        assert!(writers[0].write(1, 100, &[1; 20], true) && writers[1].write(1, 200, &[2; 24], true));
        for said in [24, 24 ^ 1, 24 ^ 1 << 20, 24 ^ 1 << 4, u64::MAX] {
            writers[1].page.store64(ROOM, said);
            assert_eq!(latest(&station, Role::Tissue).map(|kept| kept.tick), Some(200), "{said}");
        }
        station.wipe();
    }
}
