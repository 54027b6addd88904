//! Checkpoints: the last finished state of a role, kept outside of any engine's own memory, for the case that incumbent and spare die
//! together. Each slot of the role has one file of its own in the station's root; a writer that dies in the middle leaves a wrong
//! checksum there, and the other slot's checkpoint, at most one interval older, serves.

use crate::page::{self, OwnedPage, PageError, ReadPage};
use crate::station::Station;
use hyst_messages::fnv_words;
use hyst_messages::page::header;
use hyst_messages::{Role, Slot};

const WRITTEN: usize = header::END;
const EPOCH: usize = header::END + 1;
const TICK: usize = header::END + 2;
const BYTES: usize = header::END + 3;
const CHECKSUM: usize = header::END + 4;
const DATA: usize = header::END + 5;

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

fn path(station: &Station, slot: Slot) -> std::path::PathBuf {
    station.root().join(format!("pages/checkpoint-{}.page", slot.number()))
}

fn words_for(bytes: usize) -> usize {
    DATA + bytes.div_ceil(8)
}

/// The writer of one slot's checkpoint.
#[derive(Debug)]
pub struct CheckpointWriter {
    page: OwnedPage,
    bytes: usize,
}

impl CheckpointWriter {
    /// Opens the slot's checkpoint for messages of at most `bytes`, or makes it.
    pub fn open(station: &Station, slot: Slot, bytes: usize) -> Result<CheckpointWriter, PageError> {
        let path = path(station, slot);
        let page = match OwnedPage::open(&path, words_for(bytes)) {
            Ok(page) => page,
            Err(_) => {
                let _ = std::fs::remove_file(&path); // absent, or of another size: made anew
                page::create(&path, words_for(bytes), slot.number(), 0)?
            }
        };
        Ok(CheckpointWriter { page, bytes })
    }

    /// Writes a state; one that is too long is refused.
    pub fn write(&self, epoch: u32, tick: u64, message: &[u8]) -> bool {
        if message.len() > self.bytes {
            return false;
        }
        self.page.store64(WRITTEN, 0);
        let mut checksum = fnv_words(tick, [epoch as u64, message.len() as u64]);
        for (index, chunk) in message.chunks(8).enumerate() {
            let mut word = [0u8; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            let word = u64::from_ne_bytes(word);
            checksum = fnv_words(checksum, [word]);
            self.page.store64(DATA + index, word);
        }
        self.page.store64(EPOCH, epoch as u64);
        self.page.store64(TICK, tick);
        self.page.store64(BYTES, message.len() as u64);
        self.page.store64(CHECKSUM, checksum);
        self.page.store64(WRITTEN, 1);
        true
    }
}

fn read(station: &Station, slot: Slot, bytes: usize) -> Option<Checkpoint> {
    let page = ReadPage::open(&path(station, slot), words_for(bytes)).ok()?;
    let length = page.load64(BYTES) as usize;
    if page.load64(WRITTEN) != 1 || length > bytes {
        return None;
    }
    let (epoch, tick) = (page.load64(EPOCH), page.load64(TICK));
    let mut words = vec![0u64; length.div_ceil(8)];
    page.load64s(DATA, &mut words);
    let start = fnv_words(tick, [epoch, length as u64]);
    let checksum = words.iter().fold(start, |checksum, word| fnv_words(checksum, [*word]));
    (checksum == page.load64(CHECKSUM)).then_some(Checkpoint { epoch: epoch as u32, tick, words })
}

/// The newest whole checkpoint of a role, whose messages have at most `bytes`.
pub fn newest(station: &Station, role: Role, bytes: usize) -> Option<Checkpoint> {
    let slots = (0..role.slots().1).filter_map(|index| Slot::new(role, index));
    slots.filter_map(|slot| read(station, slot, bytes)).max_by_key(|checkpoint| (checkpoint.epoch, checkpoint.tick))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_whole_checkpoint_is_found_and_a_damaged_one_is_not() {
        let station = Station::named(&format!("t{}-check", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let slots = [Slot::new(Role::Tissue, 0).unwrap(), Slot::new(Role::Tissue, 1).unwrap()];
        let writers = slots.map(|slot| CheckpointWriter::open(&station, slot, 24).unwrap());
        assert_eq!(newest(&station, Role::Tissue, 24), None);
        assert!(writers[0].write(1, 100, &[1; 20]));
        assert!(writers[1].write(1, 200, &[2; 24]));
        assert!(!writers[0].write(1, 300, &[3; 25]), "too long");
        assert_eq!(newest(&station, Role::Tissue, 24).map(|found| (found.epoch, found.tick)), Some((1, 200)));
        writers[1].page.store64(DATA + 1, 77);
        let found = newest(&station, Role::Tissue, 24).unwrap();
        assert_eq!((found.tick, bytemuck::cast_slice::<u64, u8>(&found.words)[..20].to_vec()), (100, vec![1; 20]));
        station.wipe();
    }
}
