//! What waits for somebody else: Meeting Point and wake-up of a waiter. Measured on a real-time thread where the machine grants one.

use crate::Failure;
use crate::crews::{BareCrew, ProcessCrew, ThreadCrew};
use crate::measure::{Arm, Budget, Row, in_turns, timed};
use crate::partner::{PATIENCE_NS, Site, bare_page, take_place};
use hyst_exchange::system::{now_ns, sleep_ns};
use hyst_exchange::{OwnedPage, ReadPage};
use hyst_messages::page::header;
use rustix::thread::futex;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

const BLOCKS: usize = 40;
const MEETINGS: usize = 200;
const WAKES: usize = 50;
/// Core of the side that releases and wakes.
const COORDINATOR_CORE: u32 = 0;
/// Long enough for a woken waiter to sleep again, ns.
const REST_NS: u64 = 100_000;
/// Number of the page of the waiter; those of the bare barriers are their sizes.
const WAKE_PAGE: u32 = 100;

/// Adds the rows; says whether real time was granted.
pub fn rows(site: &Site, budget: &Budget, rows: &mut Vec<Row>) -> Result<bool, Failure> {
    std::thread::scope(|scope| {
        let body = || -> Result<bool, Failure> {
            // Both sides of every comparison are started from here, so that partners live as long as this thread.
            let granted = take_place(COORDINATOR_CORE);
            let mut coordinator = ProcessCrew::coordinator(site)?;
            for (first, count) in [(100, 1), (200, 2), (300, 4)] {
                let mut own = ProcessCrew::start(site, coordinator, first, count)?;
                let mut bare = BareCrew::start(site, count)?;
                let mut thread = ThreadCrew::start(site, count)?;
                warm_up(&mut own)?;
                let arms: [Arm; 3] =
                    [&mut || timed(|| own.meet()), &mut || timed(|| bare.meet()), &mut || timed(|| thread.meet())];
                let [own_samples, bare_samples, thread_samples] = in_turns(budget, BLOCKS, MEETINGS, arms)?;
                let name = format!("meeting point, {count} processes");
                rows.push(Row::new(name.clone(), "bare futex barrier", &own_samples, &bare_samples, Some(1.25)));
                rows.push(Row::new(name, "its thread form", &own_samples, &thread_samples, None));
                coordinator = own.into_coordinator();
            }
            rows.push(wake_row(site, budget)?);
            Ok(granted)
        };
        let handle = std::thread::Builder::new().name("waits".into()).spawn_scoped(scope, body)?;
        handle.join().map_err(|_| "the real-time thread panicked")?
    })
}

/// Meets until all members have come: they take some milliseconds to start.
fn warm_up(crew: &mut ProcessCrew) -> Result<(), Failure> {
    let end_ns = now_ns() + 5 * PATIENCE_NS;
    while crew.meet().is_err() {
        if now_ns() >= end_ns {
            return Err("the members did not come within 5 s".into());
        }
    }
    Ok(())
}

const TURN: usize = 8;
const SENT_NS: usize = header::END - 1;
const TAKEN_NS: usize = header::END - 2;

/// The waiter of another process, until it is killed: says how long its wake-up took, plus one so that it is never zero.
pub fn woken(own: &OwnedPage, read: &ReadPage) -> Result<(), Failure> {
    let mut seen = 0;
    own.store64(TAKEN_NS, 1);
    loop {
        while read.load32(TURN) == seen {
            read.wait(TURN, seen, now_ns() + PATIENCE_NS);
        }
        let taken_ns = now_ns() - own.load64(SENT_NS);
        seen = read.load32(TURN);
        own.store64(TAKEN_NS, taken_ns + 1);
    }
}

/// Waits for the waiter's word, and takes it.
fn taken(look: impl Fn() -> u64) -> Result<f64, Failure> {
    let end_ns = now_ns() + 5 * PATIENCE_NS;
    while look() == 0 {
        if now_ns() >= end_ns {
            return Err("the waiter was not woken within 5 s".into());
        }
        sleep_ns(REST_NS);
    }
    sleep_ns(REST_NS);
    Ok((look() - 1) as f64)
}

#[derive(Default)]
struct Plain {
    turn: AtomicU32,
    sent_ns: AtomicU64,
    taken_ns: AtomicU64,
}

/// The waiter in a thread of this process, by the plain system call.
fn woken_plainly(plain: &Plain, core: u32) {
    take_place(core);
    let mut seen = 0;
    loop {
        while plain.turn.load(Ordering::Acquire) == seen {
            let _ = futex::wait(&plain.turn, futex::Flags::PRIVATE, seen, None); // any outcome: look again
        }
        let taken_ns = now_ns() - plain.sent_ns.load(Ordering::Acquire);
        seen = plain.turn.load(Ordering::Acquire);
        if seen == u32::MAX {
            return;
        }
        plain.taken_ns.store(taken_ns + 1, Ordering::Release);
    }
}

fn wake_row(site: &Site, budget: &Budget) -> Result<Row, Failure> {
    let (own, _) = bare_page(&site.station, WAKE_PAGE)?;
    let _waiter = site.partner("woken", &[WAKE_PAGE, site.core_of(0)])?;
    taken(|| own.load64(TAKEN_NS))?;
    let plain = Arc::new(Plain::default());
    let (waiter, core) = (Arc::clone(&plain), site.core_of(0));
    let handle = std::thread::Builder::new().name("woken".into()).spawn(move || woken_plainly(&waiter, core))?;
    let mut page_turn = || {
        own.store64(TAKEN_NS, 0);
        own.store64(SENT_NS, now_ns());
        own.bump_and_wake(TURN);
        taken(|| own.load64(TAKEN_NS))
    };
    let mut plain_turn = || {
        plain.taken_ns.store(0, Ordering::Release);
        plain.sent_ns.store(now_ns(), Ordering::Release);
        plain.turn.fetch_add(1, Ordering::Release);
        futex::wake(&plain.turn, futex::Flags::PRIVATE, 1)?;
        taken(|| plain.taken_ns.load(Ordering::Acquire))
    };
    let samples = in_turns(budget, BLOCKS, WAKES, [&mut page_turn, &mut plain_turn]);
    plain.turn.store(u32::MAX, Ordering::Release);
    futex::wake(&plain.turn, futex::Flags::PRIVATE, 1)?;
    handle.join().map_err(|_| "the waiter panicked")?;
    let [page, plain] = samples?;
    Ok(Row::new("wake-up by a word of a page".into(), "private futex of threads", &page, &plain, None))
}
