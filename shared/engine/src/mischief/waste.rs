//! What an engine wastes on request: memory or files at a rate, or all the memory that it may have at once. An ordinary thread does it, which a
//! process has in test mode alone, so that the real-time thread stays as it is and still the whole process pays.
//!
//! Promise: what was taken at a rate is given back when the request ends, and is never more than [`MOST_BYTES`] and [`MOST_FILES`].

use super::asked;
use crate::life::Life;
use hyst_exchange::system;
use hyst_messages::mischief::{Mischief, Request};
use hyst_messages::page::header;
use std::fs::File;
use std::sync::Arc;

/// A leak of memory ends here: well beyond the bound of any role (`supervisor/src/growth.rs`), well below what a machine has.
const MOST_BYTES: usize = 2 << 30;
/// A leak of files ends here, or where the system refuses. In a test before the others of its process have none left: many a machine gives a process 1024.
const MOST_FILES: usize = if cfg!(test) { 64 } else { 4_096 };
/// Memory is leaked in blocks of so many bytes; each is written, or it would not be resident.
const BLOCK_BYTES: usize = 256 << 10;
/// Blocks that are tried one after the other until none can be had, down to what the smallest allocation of an engine takes.
const LAST_BLOCKS_BYTES: [usize; 4] = [1 << 20, 64 << 10, 4 << 10, 64];
/// Between two helpings of a leak, ns.
const HELPING_NS: u64 = 20_000_000;
/// Between two looks while nothing is asked, ns; the supervisor rings the bell of the slots when it asks.
const IDLE_NS: u64 = 1_000_000_000;
/// Stack of the thread, bytes: a real-time process has it locked in memory.
const STACK_BYTES: usize = 128 << 10;

/// Starts the thread that does what is asked of this process; none outside of test mode.
pub(crate) fn attend(life: &Life) {
    if !life.clock.test_mode() {
        return;
    }
    let Ok(clock) = life.station.open() else { return };
    let (page, slot, incarnation) = (Arc::clone(&life.page), life.slot, life.incarnation);
    let body = move || {
        let mut waste = Waste::default();
        while !clock.stop_requested() {
            let seen = clock.changes();
            let request = asked(&clock, slot, |words| Request::from_words(words, incarnation));
            let Some(request) = request.filter(|request| request.what.is_waste()) else {
                waste = Waste::default();
                clock.wait_for_change(seen, system::now_ns() + IDLE_NS);
                continue;
            };
            page.fetch_add64(header::MISCHIEF, 1);
            waste.take(&request, system::now_ns());
            system::sleep_ns(HELPING_NS);
        }
    };
    let thread = std::thread::Builder::new().name("waste".into()).stack_size(STACK_BYTES).spawn(body);
    if let Err(error) = thread {
        life.say(&format!("no thread to waste memory and files on request: {error}"));
    }
}

/// What was taken for a request.
#[derive(Default)]
struct Waste {
    since_ns: Option<u64>,
    memory: Vec<Vec<u8>>,
    files: Vec<File>,
}

impl Waste {
    /// Takes what is due at this time.
    fn take(&mut self, request: &Request, now_ns: u64) {
        let since_ns = *self.since_ns.get_or_insert(now_ns);
        let due = |each: u64| (request.rate_per_s as u64 * (now_ns - since_ns) / 1_000_000_000 / each) as usize;
        match request.what {
            Mischief::LeakMemory => {
                let blocks = due(BLOCK_BYTES as u64 >> 10).min(MOST_BYTES / BLOCK_BYTES);
                self.memory.extend((self.memory.len()..blocks).map(|_| vec![1; BLOCK_BYTES]));
            }
            Mischief::LeakFiles => {
                let files = due(1).min(MOST_FILES);
                self.files.extend((self.files.len()..files).map_while(|_| File::open("/dev/null").ok()));
            }
            Mischief::Exhaust => exhaust(),
            _ => {}
        }
    }
}

/// Takes memory until none is left, and then once more: the allocator ends the process. Gives everything back if there is no end to it.
fn exhaust() {
    let mut taken: Vec<Vec<u8>> = Vec::new();
    let mut bytes = 0;
    for block in LAST_BLOCKS_BYTES {
        while bytes < MOST_BYTES {
            let mut next = Vec::new();
            if next.try_reserve_exact(block).is_err() {
                break;
            }
            bytes += block;
            taken.push(next);
        }
    }
    if bytes < MOST_BYTES {
        let last = vec![1u8; BLOCK_BYTES];
        std::hint::black_box((&last, &taken));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(what: Mischief, rate_per_s: u32) -> Request {
        Request { rate_per_s, ..Request::of(what, 1) }
    }

    #[test]
    fn a_leak_takes_its_rate_and_no_more_than_its_bound() {
        let mut waste = Waste::default();
        let begin_ns = 5_000_000_000;
        let mut taken = |what: Mischief, rate_per_s: u32, after_ns: u64| {
            waste.take(&request(what, rate_per_s), begin_ns + after_ns);
            (waste.memory.len() * BLOCK_BYTES, waste.files.len())
        };
        assert_eq!(taken(Mischief::LeakMemory, 2_048, 0), (0, 0));
        assert_eq!(taken(Mischief::LeakMemory, 2_048, 1_000_000_000), (2 << 20, 0), "2 MiB/s");
        assert_eq!(taken(Mischief::LeakMemory, 2_048, 1_500_000_000), (3 << 20, 0));
        assert_eq!(taken(Mischief::LeakFiles, 4, 2_000_000_000), (3 << 20, 8), "4 files/s since the beginning");
        let (_, files) = taken(Mischief::LeakFiles, u32::MAX, 3_000_000_000);
        assert!((9..=MOST_FILES).contains(&files));
    }
}
