//! The allocator of every engine: it counts, for each thread, how often the system's allocator is entered, and gives a real-time thread
//! small blocks from a pool of its own, so that such a thread stays out of the system's allocator.
//!
//! iceoryx2 0.10 counts the handle of each loan on the heap: one block of 104 bytes from the loan to the send. The system's allocator
//! may take a lock there that an ordinary thread holds, or ask the kernel for memory. A pool's block costs one look at a word of free blocks
//! and one change of it, whoever gives it back: no lock, no loop, no wait. What is larger than a block, or comes when all blocks are
//! lent, goes to the system's allocator as any other thread's does, and is counted.
//!
//! Lists that are made anew again and again do not fit a pool. For these the system's allocator is told to keep what it gets back ([`keep_what_is_freed`]).

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::{Cell, UnsafeCell};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// Bytes of a block, and its alignment: twice what a handle of the link takes, so that it may grow with the library.
pub const BLOCK_BYTES: usize = 256;
/// Blocks of a pool: many times the loans that a thread has at once ([`crate::stream::MAX_LOANS`] for each of its streams).
pub const BLOCKS: usize = 64;
/// Pools of a process, one for each of its real-time threads: enough for a process that runs all engines as threads.
pub const POOLS: usize = 16;

/// Length of the block that is the system's allocator's example, bytes: glibc takes none of 32 MiB or more for one (mallopt(3), `M_MMAP_THRESHOLD`).
const EXAMPLE_BYTES: usize = 31 << 20;

thread_local! {
    static ENTRIES: Cell<u64> = const { Cell::new(0) };
    static LENT: Cell<u64> = const { Cell::new(0) };
    /// Pool of the thread plus one; 0 if it has none.
    static OWN_POOL: Cell<usize> = const { Cell::new(0) };
}

/// The allocator.
#[derive(Debug)]
pub struct Counting;

/// How often the calling thread has entered the system's allocator so far, to ask for memory or to give it back.
pub fn of_this_thread() -> u64 {
    ENTRIES.try_with(Cell::get).unwrap_or(0)
}

/// How many blocks of its pool the calling thread has taken so far.
pub fn blocks_of_this_thread() -> u64 {
    LENT.try_with(Cell::get).unwrap_or(0)
}

/// Gives the calling thread a pool, and touches all of it; part of becoming real time. False if all pools have been given: then the thread
/// is served as before. A pool stays with its thread for good.
#[allow(unsafe_code)]
pub fn give_this_thread_a_pool() -> bool {
    if OWN_POOL.get() != 0 {
        return true;
    }
    let index = NEXT_POOL.fetch_add(1, Ordering::Relaxed);
    let Some(pool) = POOL.get(index) else { return false };
    // SAFETY: the counter gave this index to this thread alone, and no block is handed out before `OWN_POOL` names it, so nobody else has a
    // pointer into the memory; it is as long as its type says.
    unsafe { pool.memory.0.get().write_bytes(1, 1) };
    OWN_POOL.set(index + 1);
    true
}

/// Has the system's allocator keep what it is given back, for whoever asks next: up to 62 MiB of each of its heaps. glibc hands large blocks, at first those of
/// 128 KiB, back to the kernel one by one, and each page of the next costs a fault, some 0.25 µs. A block that was so large it takes for an example: those
/// up to its length it cuts from its heaps from then on, and it trims these from twice the length on. So one is asked for and given back, which is never
/// touched. Where it is refused, or the allocator is another one, nothing changes.
pub fn keep_what_is_freed() {
    let mut example = Vec::<u8>::new();
    let _ = example.try_reserve_exact(EXAMPLE_BYTES); // where it is refused pages are fetched as before
    drop(std::hint::black_box(example));
}

#[repr(align(256))]
struct Memory(UnsafeCell<[[u8; BLOCK_BYTES]; BLOCKS]>);

// SAFETY: the memory is only reached through the pointers that `Pool::take` gives, each to one block and to one holder at a time.
#[allow(unsafe_code)]
unsafe impl Sync for Memory {}

struct Pool {
    /// One bit for each block that is lent. Its owner alone sets bits; whoever holds a block clears that block's.
    lent: AtomicU64,
    memory: Memory,
}

static NEXT_POOL: AtomicUsize = AtomicUsize::new(0);
static POOL: [Pool; POOLS] =
    [const { Pool { lent: AtomicU64::new(0), memory: Memory(UnsafeCell::new([[0; BLOCK_BYTES]; BLOCKS])) } }; POOLS];
const _: () = assert!(BLOCKS == u64::BITS as usize && align_of::<Memory>() == BLOCK_BYTES);

impl Pool {
    /// A block that nobody holds. Called by the pool's owner alone.
    fn take(&self) -> Option<*mut u8> {
        // Acquire: what the last holder did with a block, on whichever thread, lies before its bit was cleared (Release in `give_back`; the
        // changes in between are read-modify-writes and go on with that release).
        let block = (!self.lent.load(Ordering::Acquire)).trailing_zeros() as usize;
        if block >= BLOCKS {
            return None;
        }
        // Nobody but this thread sets bits, so the block that was free at the look above still is.
        self.lent.fetch_or(1 << block, Ordering::Relaxed);
        Some(self.memory.0.get().cast::<u8>().wrapping_add(block * BLOCK_BYTES))
    }

    fn give_back(&self, block: usize) {
        self.lent.fetch_and(!(1 << block), Ordering::Release);
    }
}

/// The pool and the block in it that a pointer is of; `None` if it came from the system.
fn place_of(pointer: *mut u8) -> Option<(&'static Pool, usize)> {
    let offset = pointer.addr().wrapping_sub((&raw const POOL).addr());
    let pool = POOL.get(offset / size_of::<Pool>())?;
    let into = pointer.addr().wrapping_sub(pool.memory.0.get().addr());
    Some((pool, into / BLOCK_BYTES))
}

fn from_pool(layout: Layout) -> Option<*mut u8> {
    if layout.size() > BLOCK_BYTES || layout.align() > BLOCK_BYTES {
        return None;
    }
    // A thread that is being torn down has neither pool nor counter any more.
    let own = OWN_POOL.try_with(Cell::get).unwrap_or(0);
    let block = POOL.get(own.wrapping_sub(1))?.take()?;
    let _ = LENT.try_with(|counter| counter.set(counter.get() + 1));
    Some(block)
}

fn count() {
    let _ = ENTRIES.try_with(|counter| counter.set(counter.get() + 1));
}

// SAFETY: what is not a pool's is forwarded unchanged to `System`, which fulfils the contract. A pool's block is at least as long and as
// aligned as was asked (`from_pool`), is one holder's until that holder gives it back (`Pool::take`), lies in a static, and is told from
// the system's memory by its address (`place_of`), which no memory of the system's shares. Nothing here allocates or unwinds: the
// thread-locals are const-initialised integers without a destructor, and every index is looked up with `get`.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if let Some(block) = from_pool(layout) {
            return block;
        }
        count();
        // SAFETY: forwarded.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        if let Some((pool, block)) = place_of(pointer) {
            return pool.give_back(block);
        }
        count();
        // SAFETY: forwarded; the pointer is no pool's, so it came from `System`.
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if let Some((pool, block)) = place_of(pointer) {
            if size <= BLOCK_BYTES {
                return pointer;
            }
            // SAFETY: the caller promises a size that is not zero and makes a layout with this alignment.
            let new = unsafe { self.alloc(Layout::from_size_align_unchecked(size, layout.align())) };
            if !new.is_null() {
                // SAFETY: the caller holds `layout.size()` readable bytes at `pointer`, fewer than `size`, which `new` has; `new` was just
                // made, so the two do not overlap.
                unsafe { pointer.copy_to_nonoverlapping(new, layout.size()) };
                pool.give_back(block);
            }
            return new;
        }
        count();
        // SAFETY: forwarded; the pointer is no pool's, so it came from `System`.
        unsafe { System.realloc(pointer, layout, size) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if let Some(block) = from_pool(layout) {
            // SAFETY: the block was just lent, and has at least the layout's length.
            unsafe { block.write_bytes(0, layout.size()) };
            return block;
        }
        count();
        // SAFETY: forwarded.
        unsafe { System.alloc_zeroed(layout) }
    }
}
