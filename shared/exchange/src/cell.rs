//! Cells and rings over words: the latest value, and the last values by key, with one writer and any number of readers.
//!
//! A cell holds two copies. Write number n goes into copy n mod 2 while the other stays whole, so a reader always finds a whole
//! value unless the writer laps it twice during one read, and a writer that dies in the middle leaves the value before. A ring
//! has one copy for each entry: an entry that its writer died in reads as absent.
//!
//! Layout of a copy: stamp, checksum, record. Stamp 2n − 1 means "being written", 2n "whole". The ordering argument:
//! writer: stamp odd (relaxed), release fence, record (relaxed), stamp even (release).
//! reader: stamp (acquire), record (relaxed), acquire fence, stamp again (relaxed), equal.
//! If a reader sees any word of write n, then by the fences its second stamp load sees at least 2n − 1, so a mix of two writes never has
//! equal stamps. The loom test at the end of this file runs every interleaving of this code itself. The checksum is for a damaged page,
//! not for the protocol.

use bytemuck::Pod;
use hyst_messages::fnv_words;
use hyst_messages::page::{CellAt, RingAt};
use std::sync::atomic::{AtomicU64, Ordering, fence};

/// A word that cells are made of: the standard atomic, or loom's in the model.
pub trait Word {
    /// Atomic load.
    fn load(&self, order: Ordering) -> u64;
    /// Atomic store.
    fn store(&self, value: u64, order: Ordering);
    /// Fence of the same memory model.
    fn fence(order: Ordering);
}

impl Word for AtomicU64 {
    fn load(&self, order: Ordering) -> u64 {
        AtomicU64::load(self, order)
    }
    fn store(&self, value: u64, order: Ordering) {
        AtomicU64::store(self, value, order);
    }
    fn fence(order: Ordering) {
        fence(order);
    }
}

/// Reads give up after this many laps; a writer would have to complete two writes during each.
pub const READ_ATTEMPTS: usize = 4;
/// Longest record in words.
pub const MAX_RECORD_WORDS: usize = 128;

fn write_copy<W: Word>(copy: &[W], stamp: u64, record: &[u64]) {
    copy[0].store(stamp - 1, Ordering::Relaxed);
    W::fence(Ordering::Release); // the odd stamp is visible before any word of the record
    copy[1].store(fnv_words(stamp, record.iter().copied()), Ordering::Relaxed);
    for (word, value) in copy[2..].iter().zip(record) {
        word.store(*value, Ordering::Relaxed);
    }
    copy[0].store(stamp, Ordering::Release); // the record is visible before the even stamp
}

/// Whether a record is what its writer wrote, by stamp and checksum.
fn is_undamaged(stamp: u64, checksum: u64, record: &[u64]) -> bool {
    checksum == fnv_words(stamp, record.iter().copied())
}

/// Reads the copy if it is whole and has exactly `stamp`; `is_sound` is asked only then, for stamp, checksum and record.
fn read_copy<W: Word>(copy: &[W], stamp: u64, record: &mut [u64], is_sound: impl Fn(u64, u64, &[u64]) -> bool) -> bool {
    let checksum = copy[1].load(Ordering::Relaxed);
    for (value, word) in record.iter_mut().zip(&copy[2..]) {
        *value = word.load(Ordering::Relaxed);
    }
    W::fence(Ordering::Acquire); // if any word above was of a later write, the load below sees its odd stamp
    copy[0].load(Ordering::Relaxed) == stamp && is_sound(stamp, checksum, record)
}

/// Writes a record into a cell. Only the cell's one writer may call this.
pub fn write_cell<W: Word>(cell: &[W], record: &[u64]) {
    let copy_words = 2 + record.len();
    let (first, second) = cell[..2 * copy_words].split_at(copy_words);
    // Own earlier stores. An odd stamp is what a writer that died leaves; its copy is written again, the whole one stays.
    let newest = first[0].load(Ordering::Relaxed).max(second[0].load(Ordering::Relaxed));
    let number = newest / 2 + 1;
    let copy = if number % 2 == 0 { first } else { second };
    write_copy(copy, 2 * number, record);
}

/// Reads the newest whole record; gives its number (from 1). `None` if none was ever written, or the page is damaged.
pub fn read_cell<W: Word>(cell: &[W], record: &mut [u64]) -> Option<u64> {
    read_cell_if(cell, record, READ_ATTEMPTS, is_undamaged)
}

fn read_cell_if<W: Word>(
    cell: &[W],
    record: &mut [u64],
    attempts: usize,
    is_sound: impl Fn(u64, u64, &[u64]) -> bool,
) -> Option<u64> {
    let copy_words = 2 + record.len();
    let (first, second) = cell[..2 * copy_words].split_at(copy_words);
    for _ in 0..attempts {
        let stamps = [first[0].load(Ordering::Acquire), second[0].load(Ordering::Acquire)];
        let whole = |stamp: u64| if stamp.is_multiple_of(2) { stamp } else { 0 };
        let order = if whole(stamps[0]) > whole(stamps[1]) { [0, 1] } else { [1, 0] };
        for index in order {
            let stamp = whole(stamps[index]);
            if stamp != 0 && read_copy([first, second][index], stamp, record, &is_sound) {
                return Some(stamp / 2);
            }
        }
        if stamps == [0, 0] {
            return None;
        }
    }
    None
}

/// Number of the newest write of a cell without reading it; 0 if none.
pub fn cell_number<W: Word>(cell: &[W], record_words: usize) -> u64 {
    let whole = |stamp: u64| stamp / 2;
    whole(cell[0].load(Ordering::Acquire)).max(whole(cell[2 + record_words].load(Ordering::Acquire)))
}

/// Writes entry `key` of a ring; keys grow by one in the usual case. Only the ring's one writer may call this.
pub fn write_ring<W: Word>(ring: &[W], entries: usize, key: u64, record: &[u64]) {
    let entry_words = 2 + record.len();
    let at = 1 + (key % entries as u64) as usize * entry_words;
    write_copy(&ring[at..at + entry_words], 2 * (key + 1), record);
    ring[0].store(key + 1, Ordering::Release);
}

/// Reads entry `key` of a ring: `None` if it was not written, was overwritten, or is being written.
pub fn read_ring<W: Word>(ring: &[W], entries: usize, key: u64, record: &mut [u64]) -> Option<()> {
    let entry_words = 2 + record.len();
    let at = 1 + (key % entries as u64) as usize * entry_words;
    let entry = &ring[at..at + entry_words];
    let stamp = key.checked_add(1)?.checked_mul(2)?; // whoever names a later key lies, or its page is damaged
    (entry[0].load(Ordering::Acquire) == stamp && read_copy(entry, stamp, record, is_undamaged)).then_some(())
}

/// Typed access to cells and rings of a page's 64-bit words.
pub fn write_cell_at<T: Pod>(words: &[AtomicU64], at: CellAt<T>, value: &T) {
    with_words(value, |record| write_cell(&words[at.word..at.end()], record));
}

/// The newest value of a cell and its number.
pub fn read_cell_at<T: Pod>(words: &[AtomicU64], at: CellAt<T>) -> Option<(u64, T)> {
    let mut buffer = [0u64; MAX_RECORD_WORDS];
    let record = &mut buffer[..CellAt::<T>::RECORD_WORDS];
    let number = read_cell(&words[at.word..at.end()], record)?;
    Some((number, bytemuck::pod_read_unaligned(bytemuck::cast_slice(record))))
}

/// Writes an entry of a ring.
pub fn write_ring_at<T: Pod>(words: &[AtomicU64], at: RingAt<T>, key: u64, value: &T) {
    with_words(value, |record| write_ring(&words[at.word..at.end()], at.entries, key, record));
}

/// Reads an entry of a ring.
pub fn read_ring_at<T: Pod>(words: &[AtomicU64], at: RingAt<T>, key: u64) -> Option<T> {
    let mut buffer = [0u64; MAX_RECORD_WORDS];
    let record = &mut buffer[..RingAt::<T>::RECORD_WORDS];
    read_ring(&words[at.word..at.end()], at.entries, key, record)?;
    Some(bytemuck::pod_read_unaligned(bytemuck::cast_slice(record)))
}

/// Key after the newest entry of a ring; 0 if none was written.
pub fn ring_end<T: Pod>(words: &[AtomicU64], at: RingAt<T>) -> u64 {
    end_of_ring(&words[at.word..at.end()], at.entries, RingAt::<T>::RECORD_WORDS)
}

/// The word that says the end has no checksum. So the entry that it names must have been written by then, which its writer does first; a reader that believed a
/// later end would wait there for good. A word that is damaged is passed over, and the stamps of all entries are asked instead.
fn end_of_ring<W: Word>(ring: &[W], entries: usize, record_words: usize) -> u64 {
    let stamp_at = |key: u64| ring[1 + (key % entries as u64) as usize * (2 + record_words)].load(Ordering::Acquire);
    let said = ring[0].load(Ordering::Acquire);
    let Some(newest) = said.checked_sub(1) else { return 0 };
    // Half of a stamp is the key after its entry; odd while it is written, of this key once more or of one a lap later.
    if stamp_at(newest).div_ceil(2) >= said {
        return said;
    }
    let ends = (0..entries as u64).map(stamp_at).filter(|stamp| stamp.is_multiple_of(2)).map(|stamp| stamp / 2);
    ends.filter(|end| *end <= said).max().unwrap_or(0)
}

/// The words of a record, for a hash of it. `T` is a whole number of words.
pub fn words_of<T: Pod>(value: &T) -> impl Iterator<Item = u64> {
    bytemuck::bytes_of(value).chunks_exact(8).map(|chunk| {
        let mut word = [0u8; 8];
        word.copy_from_slice(chunk);
        u64::from_ne_bytes(word)
    })
}

fn with_words<T: Pod>(value: &T, write: impl FnOnce(&[u64])) {
    let mut buffer = [0u64; MAX_RECORD_WORDS];
    let bytes = bytemuck::bytes_of(value);
    bytemuck::cast_slice_mut(&mut buffer)[..bytes.len()].copy_from_slice(bytes);
    write(&buffer[..bytes.len() / 8]);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(count: usize) -> Vec<AtomicU64> {
        (0..count).map(|_| AtomicU64::new(0)).collect()
    }

    #[test]
    fn the_newest_value_is_read_and_none_before_the_first() {
        let cell = words(2 * (2 + 3));
        let mut record = [0; 3];
        assert_eq!(read_cell(&cell, &mut record), None);
        for n in 1..6u64 {
            write_cell(&cell, &[n, n * 2, n * 3]);
            assert_eq!(read_cell(&cell, &mut record), Some(n));
            assert_eq!(record, [n, n * 2, n * 3]);
            assert_eq!(cell_number(&cell, 3), n);
        }
    }

    /// A word whose writer dies after so many stores.
    struct Mortal(AtomicU64);
    thread_local!(static LIVES: std::cell::Cell<usize> = const { std::cell::Cell::new(usize::MAX) });
    impl Word for Mortal {
        fn load(&self, order: Ordering) -> u64 {
            self.0.load(order)
        }
        fn store(&self, value: u64, order: Ordering) {
            let left = LIVES.get();
            if left > 0 {
                LIVES.set(left - 1);
                self.0.store(value, order);
            }
        }
        fn fence(_: Ordering) {}
    }

    #[test]
    fn an_entry_of_a_ring_whose_writer_died_in_it_is_absent_and_the_others_are_there() {
        let stores = 1 + 1 + 2 + 1 + 1; // stamp, checksum, two words, stamp; the ring's end
        for killed_after in 0..=stores {
            let ring: Vec<Mortal> = (0..1 + 4 * (2 + 2)).map(|_| Mortal(AtomicU64::new(0))).collect();
            let mut record = [0; 2];
            LIVES.set(usize::MAX);
            (0..6).for_each(|key| write_ring(&ring, 4, key, &[key, !key]));
            LIVES.set(killed_after);
            write_ring(&ring, 4, 6, &[6, !6]);
            LIVES.set(usize::MAX);
            let found = read_ring(&ring, 4, 6, &mut record).is_some();
            assert_eq!(found, killed_after >= stores - 1, "killed after {killed_after} stores");
            assert_eq!(read_ring(&ring, 4, 2, &mut record).is_some(), killed_after == 0, "the entry that is overwritten");
            for key in 3..6 {
                assert_eq!(read_ring(&ring, 4, key, &mut record), Some(()), "killed after {killed_after} stores");
                assert_eq!(record, [key, !key]);
            }
            assert_eq!(
                end_of_ring(&ring, 4, 2),
                if killed_after == stores { 7 } else { 6 },
                "killed after {killed_after} stores"
            );
            // Its successor writes the entry again.
            write_ring(&ring, 4, 6, &[6, !6]);
            assert_eq!(read_ring(&ring, 4, 6, &mut record), Some(()));
        }
    }

    #[test]
    fn a_key_that_no_writer_can_come_to_names_no_entry() {
        let ring = words(1 + 4 * (2 + 2));
        write_ring(&ring, 4, 3, &[3, !3]);
        for key in [u64::MAX, u64::MAX - 1, u64::MAX / 2] {
            assert_eq!(read_ring(&ring, 4, key, &mut [0; 2]), None, "{key}");
        }
    }

    /// Runs the writer up to its k-th store and then "kills" it; the reader must see the value before.
    #[test]
    fn a_writer_killed_at_any_store_leaves_the_value_before() {
        let stores = 1 + 1 + 3 + 1;
        for killed_after in 0..=stores {
            let cell: Vec<Mortal> = (0..10).map(|_| Mortal(AtomicU64::new(0))).collect();
            let mut record = [0; 3];
            LIVES.set(usize::MAX);
            write_cell(&cell, &[1, 1, 1]);
            write_cell(&cell, &[2, 2, 2]);
            LIVES.set(killed_after);
            write_cell(&cell, &[3, 3, 3]);
            let expected = if killed_after == stores { 3 } else { 2 };
            assert_eq!(read_cell(&cell, &mut record), Some(expected), "killed after {killed_after} stores");
            assert_eq!(record, [expected; 3]);
        }
    }

    #[test]
    fn a_flipped_bit_in_both_copies_reads_as_no_value() {
        let cell = words(10);
        let mut record = [0; 3];
        write_cell(&cell, &[1, 2, 3]);
        write_cell(&cell, &[4, 5, 6]);
        cell[3].store(cell[3].load(Ordering::Relaxed) ^ 1, Ordering::Relaxed);
        assert_eq!(read_cell(&cell, &mut record), Some(1), "the copy that is whole serves");
        cell[8].store(cell[8].load(Ordering::Relaxed) ^ 1 << 40, Ordering::Relaxed);
        assert_eq!(read_cell(&cell, &mut record), None);
    }

    #[test]
    fn a_ring_gives_each_key_until_it_is_overwritten() {
        let ring = words(1 + 4 * (2 + 2));
        let mut record = [0; 2];
        for key in 0..10 {
            write_ring(&ring, 4, key, &[key, !key]);
        }
        for key in 0..12 {
            let found = read_ring(&ring, 4, key, &mut record).is_some();
            assert_eq!(found, (6..10).contains(&key), "{key}");
            if found {
                assert_eq!(record, [key, !key]);
            }
        }
    }

    /// A reader that has gone on from a key far ahead reads nothing more of that ring.
    #[test]
    fn a_flipped_bit_in_the_end_of_a_ring_leads_nobody_beyond_its_newest_entry() {
        let ring = words(1 + 4 * (2 + 2));
        assert_eq!(end_of_ring(&ring, 4, 2), 0);
        (0..10).for_each(|key| write_ring(&ring, 4, key, &[key, !key]));
        assert_eq!(end_of_ring(&ring, 4, 2), 10);
        for bit in 0..64 {
            let said = 10u64 ^ 1 << bit;
            ring[0].store(said, Ordering::Relaxed);
            assert_eq!(end_of_ring(&ring, 4, 2), said.min(10), "bit {bit}");
        }
        write_ring(&ring, 4, 10, &[10, !10]);
        assert_eq!(end_of_ring(&ring, 4, 2), 11, "its writer has written the word anew");
    }

    mod model {
        use super::super::*;
        use loom::sync::atomic::AtomicU64 as LoomU64;
        use std::sync::Arc;

        impl Word for LoomU64 {
            fn load(&self, order: Ordering) -> u64 {
                LoomU64::load(self, order)
            }
            fn store(&self, value: u64, order: Ordering) {
                LoomU64::store(self, value, order);
            }
            fn fence(order: Ordering) {
                loom::sync::atomic::fence(order);
            }
        }

        /// Every interleaving and every permitted reordering of two writes with one read: a whole value, and never an older one
        /// after a newer one.
        #[test]
        fn no_interleaving_gives_a_torn_value() {
            let mut builder = loom::model::Builder::new();
            builder.preemption_bound = None;
            builder.check(|| {
                let cell: Arc<Vec<LoomU64>> = Arc::new((0..8).map(|_| LoomU64::new(0)).collect());
                write_cell(&cell, &[1, 10]);
                let writer = Arc::clone(&cell);
                let handle = loom::thread::spawn(move || {
                    write_cell(&writer, &[2, 20]);
                    write_cell(&writer, &[3, 30]);
                });
                let mut record = [0; 2];
                let mut last = 0;
                for _ in 0..2 {
                    // One attempt of the reader itself; the checksum, which would hide a torn value from the model, holds for any.
                    if let Some(number) = read_cell_if(&cell, &mut record, 1, |_, _, _| true) {
                        assert_eq!(record, [number, number * 10], "torn");
                        assert!(number >= last, "went back");
                        last = number;
                    }
                }
                handle.join().unwrap();
            });
        }
    }
}
