//! A station page: one file of fixed size on tmpfs, mapped shared, read-write by its one owner and read-only by everyone else.
//! Layout in `hyst_messages::page`.
//!
//! Who waits for a word of another's page waits on a second mapping of the 32-bit words, which the kernel could write: to find a word that it could not, it
//! takes the lock of the process's memory map each time, and whoever is real time stood there for up to 100 ms while an ordinary thread of its own mapped
//! a newcomer's stream (2-core VM, 2026-11-23). Nothing here writes through that mapping.
//!
//! Promise: a page is reserved in full when it is made, so that a full /dev/shm is an error here and never a SIGBUS later; it is
//! refused if its magic, layout or length is another; a reader cannot write it.

use crate::cell;
use crate::latch;
use crate::system;
use bytemuck::Pod;
use hyst_messages::page::{CellAt, ProcessState, RingAt, WORDS32, header};
use hyst_messages::{bucket_of_ns, layout_hash};
use rustix::fs::{FallocateFlags, Mode, OFlags};
use rustix::mm::{MapFlags, ProtFlags};
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

/// First word of every page that is ready: "HYSTPAGE" mixed with the layout.
pub fn magic() -> u64 {
    u64::from_be_bytes(*b"HYSTPAGE") ^ layout_hash()
}

/// Why a page cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// The file system refused.
    #[error("station page {path}: {reason}; look at `df /dev/shm` and at the rights of that folder")]
    Refused {
        /// The page's file.
        path: PathBuf,
        /// What the system said.
        reason: rustix::io::Errno,
    },
    /// Length, magic or layout is another.
    #[error("station page {path} is of another version or damaged; stop the station and rebuild all binaries from one source")]
    Foreign {
        /// The page's file.
        path: PathBuf,
    },
}

impl PageError {
    /// Whether it is for want of a file descriptor of this process, and not for anything about the page.
    pub fn is_want_of_files(&self) -> bool {
        matches!(self, PageError::Refused { reason: rustix::io::Errno::MFILE, .. })
    }
}

/// How a page is mapped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Loads only.
    Read,
    /// Loads and stores.
    Write,
}

#[derive(Debug)]
struct Mapping {
    start: NonNull<u8>,
    bytes: usize,
}

// SAFETY: the mapping is only ever viewed as atomics, which may be used from any thread.
#[allow(unsafe_code)]
unsafe impl Send for Mapping {}
// SAFETY: as above.
#[allow(unsafe_code)]
unsafe impl Sync for Mapping {}

impl Mapping {
    #[allow(unsafe_code)]
    fn new(file: &rustix::fd::OwnedFd, bytes: usize, access: Access) -> Result<Mapping, rustix::io::Errno> {
        let protection = match access {
            Access::Read => ProtFlags::READ,
            Access::Write => ProtFlags::READ | ProtFlags::WRITE,
        };
        // SAFETY: a null hint lets the kernel choose a free range, so nothing that is mapped is replaced; the length was checked
        // against the file and the file is never truncated while a station lives.
        let start =
            unsafe { rustix::mm::mmap(std::ptr::null_mut(), bytes, protection, MapFlags::SHARED | MapFlags::POPULATE, file, 0)? };
        let start = NonNull::new(start.cast::<u8>()).ok_or(rustix::io::Errno::NOMEM)?;
        Ok(Mapping { start, bytes })
    }

    #[allow(unsafe_code)]
    fn words32(&self) -> &[AtomicU32] {
        // SAFETY: mmap returns page-aligned memory of at least 4 KiB + 8 (checked at creation); the first WORDS32 words are only ever
        // viewed as AtomicU32, by every process; the memory lives as long as self. Stores through a read-only mapping are kept
        // out by the types: `ReadPage` has none.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr().cast(), WORDS32) }
    }

    #[allow(unsafe_code)]
    fn words64(&self) -> &[AtomicU64] {
        let words = (self.bytes - 4 * WORDS32) / 8;
        // SAFETY: as above; this range begins after the 32-bit words, at an offset that is a multiple of 8, and is only ever viewed as
        // AtomicU64.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr().add(4 * WORDS32).cast(), words) }
    }
}

impl Drop for Mapping {
    #[allow(unsafe_code)]
    fn drop(&mut self) {
        // SAFETY: the range was returned by mmap with this length, and no reference into it outlives self.
        let _ = unsafe { rustix::mm::munmap(self.start.as_ptr().cast(), self.bytes) };
    }
}

fn page_bytes(words: usize) -> usize {
    (4 * WORDS32 + 8 * words).div_ceil(4096) * 4096
}

/// A page of somebody else: loads only.
#[derive(Debug)]
pub struct ReadPage {
    mapping: Mapping,
    /// Its 32-bit words once more, to be waited on; without it they are waited on where they are read.
    waiting: Option<Mapping>,
}

/// A page that this process may write.
#[derive(Debug)]
pub struct OwnedPage {
    mapping: Mapping,
}

/// Makes a page for a slot's incarnation; reserves its memory and writes its header. Fails if the file exists.
pub fn create(path: &Path, words: usize, slot: usize, incarnation: u32) -> Result<OwnedPage, PageError> {
    let refused = |reason| PageError::Refused { path: path.to_path_buf(), reason };
    let flags = OFlags::RDWR | OFlags::CREATE | OFlags::EXCL | OFlags::CLOEXEC;
    let file = rustix::fs::open(path, flags, Mode::RUSR | Mode::WUSR).map_err(refused)?;
    let bytes = page_bytes(words);
    let made = rustix::fs::fallocate(&file, FallocateFlags::empty(), 0, bytes as u64)
        .and_then(|()| Mapping::new(&file, bytes, Access::Write));
    let mapping = match made {
        Ok(mapping) => mapping,
        Err(reason) => {
            let _ = rustix::fs::unlink(path); // nothing half-made stays
            return Err(refused(reason));
        }
    };
    let page = OwnedPage { mapping };
    page.mend_header(slot, incarnation);
    Ok(page)
}

/// The words of a header that never change, and what they say: whose page it is, of which life, and last that it is ready.
fn lasting_words(slot: usize, incarnation: u32) -> [(usize, u64); 3] {
    [(header::SLOT, slot as u64), (header::INCARNATION, u64::from(incarnation)), (header::MAGIC, magic())]
}

fn open(path: &Path, words: usize, access: Access) -> Result<Mapping, PageError> {
    let mapping = open_any(path, words, access)?;
    if mapping.words64()[header::MAGIC].load(Ordering::Acquire) != magic() {
        return Err(PageError::Foreign { path: path.to_path_buf() });
    }
    Ok(mapping)
}

/// A page of that size, whatever its header says.
fn open_any(path: &Path, words: usize, access: Access) -> Result<Mapping, PageError> {
    let refused = |reason| PageError::Refused { path: path.to_path_buf(), reason };
    let flags = match access {
        Access::Read => OFlags::RDONLY,
        Access::Write => OFlags::RDWR,
    };
    let file = rustix::fs::open(path, flags | OFlags::CLOEXEC, Mode::empty()).map_err(refused)?;
    let bytes = page_bytes(words);
    let found = rustix::fs::fstat(&file).map_err(refused)?.st_size;
    if found != bytes as i64 {
        return Err(PageError::Foreign { path: path.to_path_buf() });
    }
    Mapping::new(&file, bytes, access).map_err(refused)
}

/// The 32-bit words of a page, in a mapping that may be written.
fn words_to_wait_on(path: &Path) -> Option<Mapping> {
    let file = rustix::fs::open(path, OFlags::RDWR | OFlags::CLOEXEC, Mode::empty()).ok()?;
    let mapping = Mapping::new(&file, 4 * WORDS32, Access::Write).ok()?;
    mapping.words32()[WORDS32 - 1].fetch_or(0, Ordering::Relaxed); // the kernel makes the page writable at the first write; nothing is changed
    Some(mapping)
}

impl ReadPage {
    /// Opens a page for reading.
    pub fn open(path: &Path, words: usize) -> Result<ReadPage, PageError> {
        let mapping = open(path, words, Access::Read)?;
        Ok(ReadPage { mapping, waiting: words_to_wait_on(path) })
    }
    /// Opens one whose header may be damaged, and whose content says itself whether it is whole.
    pub(crate) fn open_damaged(path: &Path, words: usize) -> Result<ReadPage, PageError> {
        open_any(path, words, Access::Read).map(|mapping| ReadPage { mapping, waiting: None })
    }
    /// A 32-bit word.
    pub fn load32(&self, index: usize) -> u32 {
        self.mapping.words32()[index].load(Ordering::Acquire)
    }
    /// A 64-bit word.
    pub fn load64(&self, index: usize) -> u64 {
        self.mapping.words64()[index].load(Ordering::Acquire)
    }
    /// Some 64-bit words from `index` on.
    pub fn load64s(&self, index: usize, out: &mut [u64]) {
        for (value, word) in out.iter_mut().zip(&self.mapping.words64()[index..]) {
            *value = word.load(Ordering::Relaxed);
        }
    }
    /// Newest value of a cell with its number.
    pub fn cell<T: Pod>(&self, at: CellAt<T>) -> Option<(u64, T)> {
        cell::read_cell_at(self.mapping.words64(), at)
    }
    /// Number of the newest value of a cell.
    pub fn cell_number<T: Pod>(&self, at: CellAt<T>) -> u64 {
        cell::cell_number(&self.mapping.words64()[at.word..at.end()], CellAt::<T>::RECORD_WORDS)
    }
    /// An entry of a ring.
    pub fn ring<T: Pod>(&self, at: RingAt<T>, key: u64) -> Option<T> {
        cell::read_ring_at(self.mapping.words64(), at, key)
    }
    /// Key after the newest entry of a ring.
    pub fn ring_end<T: Pod>(&self, at: RingAt<T>) -> u64 {
        cell::ring_end(self.mapping.words64(), at)
    }
    /// Waits until a 32-bit word differs from `expected` or the deadline has passed; may return early.
    pub fn wait(&self, index: usize, expected: u32, deadline_ns: u64) {
        self.wait_as(index, expected, deadline_ns, NonZeroU32::MAX);
    }
    /// The same of one that is woken with others of its kind alone ([`system::wait_word`]).
    pub fn wait_as(&self, index: usize, expected: u32, deadline_ns: u64, as_one_of: NonZeroU32) {
        let mapping = self.waiting.as_ref().unwrap_or(&self.mapping);
        system::wait_word(&mapping.words32()[index], expected, deadline_ns, as_one_of);
    }
    /// Whether the header says what it said when the page was made for a slot's incarnation.
    pub fn has_header(&self, slot: usize, incarnation: u32) -> bool {
        lasting_words(slot, incarnation).into_iter().all(|(index, value)| self.load64(index) == value)
    }
    /// State of the owner.
    pub fn state(&self) -> ProcessState {
        ProcessState::from_word(self.load32(header::STATE))
    }
    /// Incarnation of the owner.
    pub fn incarnation(&self) -> u32 {
        self.load64(header::INCARNATION) as u32
    }
    /// Whether the thread that held the owner's latch has died.
    pub fn latch_is_open(&self) -> bool {
        latch::is_open(self.load64(header::LATCH))
    }
    /// What the owner last said before it died.
    pub fn last_words(&self) -> String {
        let mut words = [0u64; header::LAST_WORDS_WORDS];
        self.load64s(header::LAST_WORDS, &mut words);
        let bytes: &[u8] = bytemuck::cast_slice(&words);
        let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
        String::from_utf8_lossy(&bytes[..end]).into_owned()
    }
}

impl OwnedPage {
    /// Opens a page that was made for this process.
    pub fn open(path: &Path, words: usize) -> Result<OwnedPage, PageError> {
        open(path, words, Access::Write).map(|mapping| OwnedPage { mapping })
    }
    /// Opens one whose header may be damaged, to mend it.
    pub(crate) fn open_damaged(path: &Path, words: usize) -> Result<OwnedPage, PageError> {
        open_any(path, words, Access::Write).map(|mapping| OwnedPage { mapping })
    }
    /// Writes anew what the header of a life's page says for good and does not say now, so that newcomers can map it; true if that was anything.
    pub fn mend_header(&self, slot: usize, incarnation: u32) -> bool {
        let words = lasting_words(slot, incarnation).into_iter();
        words.fold(false, |mended, (index, value)| self.mend_word(index, value) || mended)
    }
    /// The same of the magic alone: what comes after it in the pages of the station is other than in that of a life.
    pub fn mend_magic(&self) -> bool {
        self.mend_word(header::MAGIC, magic())
    }
    fn mend_word(&self, index: usize, value: u64) -> bool {
        let damaged = self.load64(index) != value;
        if damaged {
            self.store64(index, value);
        }
        damaged
    }
    /// Holds the latch for as long as the calling thread lives; false where the system refuses. The page has to stay mapped as long.
    pub fn hold_latch(&self) -> bool {
        self.mapping.words64()[header::LATCH..].first_chunk().is_some_and(latch::hold)
    }
    /// A 32-bit word.
    pub fn load32(&self, index: usize) -> u32 {
        self.mapping.words32()[index].load(Ordering::Acquire)
    }
    /// A 64-bit word.
    pub fn load64(&self, index: usize) -> u64 {
        self.mapping.words64()[index].load(Ordering::Acquire)
    }
    /// Stores a 32-bit word.
    pub fn store32(&self, index: usize, value: u32) {
        self.mapping.words32()[index].store(value, Ordering::Release);
    }
    /// Stores a 32-bit word and wakes who waits on it.
    pub fn store32_and_wake(&self, index: usize, value: u32) {
        self.store32_and_wake_as(index, value, NonZeroU32::MAX);
    }
    /// The same, and wakes these alone, and who waits for any.
    pub fn store32_and_wake_as(&self, index: usize, value: u32, whom: NonZeroU32) {
        self.store32(index, value);
        system::wake_word(&self.mapping.words32()[index], whom);
    }
    /// Adds one to a 32-bit word and wakes who waits on it.
    pub fn bump_and_wake(&self, index: usize) {
        self.mapping.words32()[index].fetch_add(1, Ordering::Release);
        system::wake_word(&self.mapping.words32()[index], NonZeroU32::MAX);
    }
    /// Stores a 64-bit word.
    pub fn store64(&self, index: usize, value: u64) {
        self.mapping.words64()[index].store(value, Ordering::Release);
    }
    /// Adds to a 64-bit word that only this thread writes.
    pub fn add64(&self, index: usize, value: u64) {
        let word = &self.mapping.words64()[index];
        word.store(word.load(Ordering::Relaxed).wrapping_add(value), Ordering::Release);
    }
    /// Adds to a 64-bit word that others may write too; gives the value before.
    pub fn fetch_add64(&self, index: usize, value: u64) -> u64 {
        self.mapping.words64()[index].fetch_add(value, Ordering::AcqRel)
    }
    /// Compare-and-swap of a 64-bit word; the value found on failure.
    pub fn swap64(&self, index: usize, current: u64, new: u64) -> Result<(), u64> {
        self.mapping.words64()[index].compare_exchange(current, new, Ordering::AcqRel, Ordering::Acquire).map(|_| ())
    }
    /// Writes a cell.
    pub fn write<T: Pod>(&self, at: CellAt<T>, value: &T) {
        cell::write_cell_at(self.mapping.words64(), at, value);
    }
    /// Reads a cell of the own page.
    pub fn cell<T: Pod>(&self, at: CellAt<T>) -> Option<(u64, T)> {
        cell::read_cell_at(self.mapping.words64(), at)
    }
    /// Writes an entry of a ring.
    pub fn push<T: Pod>(&self, at: RingAt<T>, key: u64, value: &T) {
        cell::write_ring_at(self.mapping.words64(), at, key, value);
    }
    /// Reads an entry of a ring of the own page.
    pub fn ring<T: Pod>(&self, at: RingAt<T>, key: u64) -> Option<T> {
        cell::read_ring_at(self.mapping.words64(), at, key)
    }
    /// Key after the newest entry of a ring of the own page.
    pub fn ring_end<T: Pod>(&self, at: RingAt<T>) -> u64 {
        cell::ring_end(self.mapping.words64(), at)
    }
    /// Waits until a 32-bit word of the own page differs from `expected` or the deadline has passed; may return early.
    pub fn wait(&self, index: usize, expected: u32, deadline_ns: u64) {
        system::wait_word(&self.mapping.words32()[index], expected, deadline_ns, NonZeroU32::MAX);
    }
    /// Counts a latency in one of the histograms ([`header::WAKEUP`] or [`header::LOOP`]).
    pub fn count_latency(&self, histogram: usize, latency_ns: u64) {
        self.add64(histogram + bucket_of_ns(latency_ns), 1);
    }
    /// Says in which state the process is.
    pub fn set_state(&self, state: ProcessState) {
        self.store32_and_wake(header::STATE, state as u32);
    }
    /// Incarnation of this process.
    pub fn incarnation(&self) -> u32 {
        self.load64(header::INCARNATION) as u32
    }
    /// Leaves last words, cut to what fits; allocates nothing.
    pub fn last_words(&self, text: &str) {
        let bytes = text.as_bytes();
        for index in 0..header::LAST_WORDS_WORDS {
            let mut word = [0u8; 8];
            for (offset, byte) in word.iter_mut().enumerate() {
                *byte = bytes.get(8 * index + offset).copied().unwrap_or(0);
            }
            self.store64(header::LAST_WORDS + index, u64::from_ne_bytes(word));
        }
    }
}

#[cfg(test)]
mod tests;
