//! The drain: an ordinary thread of the servo's process that publishes the device's force and tool records as a stream, so that the way from
//! hand to force touches no stream. Both replicas publish; a reader takes each tick once.

use hyst_engine::{Failure, Helper, Liar, Life};
use hyst_exchange::usher::{Departure, Port, Wanted, usher};
use hyst_exchange::{Links, Publisher, ReadPage, Rounds, system};
use hyst_messages::mischief::{Outlet, Thread};
use hyst_messages::page::device as layout;
use hyst_messages::stream::message_bytes;
use hyst_messages::{AppliedRecord, Kind, MessageMut, Role, StreamHeader};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Time between two messages, ns.
const INTERVAL_NS: u64 = 20_000_000;
/// Records in one message: what comes together in one interval, and enough to catch up after a stall.
const BATCH: usize = 256;

/// Messages in a row for which no block could be had, after which the process ends: a second, and there will never be one again.
const MOST_REFUSED: u32 = 50;

/// Ends the drain's thread when dropped.
pub struct Drain {
    stop: Arc<AtomicBool>,
    rounds: Rounds,
    usher: Rounds,
    handle: Option<std::thread::JoinHandle<()>>,
}

impl Drain {
    /// The drain and its own usher, as the servo watches them.
    pub fn helpers(&self) -> [Helper; 2] {
        [Helper::new(Thread::Drain, self.rounds.clone()), Helper::usher(self.usher.clone())]
    }
}

impl Drop for Drain {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(handle) = self.handle.take() {
            let _ = handle.join(); // it has nothing to say at its end
        }
    }
}

/// Starts the drain.
pub fn start(life: &Life, links: Links) -> Result<Drain, Failure> {
    let bytes = message_bytes(&[BATCH * size_of::<AppliedRecord>()]);
    let publisher = links.publisher(Role::Haptic, life.incarnation, Kind::Force, bytes)?;
    let mut inbox = usher(&life.station, Some(links), life.incarnation, vec![(Role::Device, Wanted::Page)])?;
    let stop = Arc::new(AtomicBool::new(false));
    let stopped = Arc::clone(&stop);
    let (rounds, usher) = (Rounds::default(), inbox.rounds());
    let passed = rounds.clone();
    let incarnation = life.incarnation;
    let (loses_a_loan, mut lies) = (life.loan_loser()?, life.liar(Outlet::Force, bytes)?);
    let stalls = life.staller(Thread::Drain)?;
    let body = move || {
        system::demote(0); // a servo is real time while it starts
        let mut device: Option<ReadPage> = None;
        let (mut next, mut refused) = (0, 0);
        while !stopped.load(Ordering::Acquire) {
            passed.pass();
            stalls(&stopped);
            while let Some(arrival) = inbox.take() {
                let Port::Page(page) = arrival.port else { continue };
                if let Some(before) = device.replace(page) {
                    inbox.retire(Departure::Page(before));
                }
            }
            if loses_a_loan() {
                publisher.lose(bytes);
            }
            if let Some(device) = &device {
                let published = publish(&publisher, device, next, incarnation, &mut lies);
                refused = if published.is_none() { refused + 1 } else { 0 };
                assert!(refused < MOST_REFUSED, "no block of the force stream can be had any more");
                next = published.unwrap_or(next);
            }
            system::sleep_ns(INTERVAL_NS);
        }
    };
    let handle = std::thread::Builder::new().name("drain".into()).spawn(body)?;
    Ok(Drain { stop, rounds, usher, handle: Some(handle) })
}

/// Publishes the records from `next` on; gives the tick after the last one, `None` if there was no block to write into. What cannot be sent is sent
/// again with the next.
fn publish(publisher: &Publisher, device: &ReadPage, next: u64, incarnation: u32, lies: &mut Liar) -> Option<u64> {
    let end = device.ring_end(layout::APPLIED);
    let first = next.max(end.saturating_sub(BATCH as u64));
    if end <= first {
        return Some(next);
    }
    let count = (end - first) as usize;
    let sections = [count * size_of::<AppliedRecord>()];
    let mut loan = publisher.loan(message_bytes(&sections)).ok()?;
    let header = StreamHeader { tick: first, incarnation, ..Default::default() };
    let Ok(mut message) = MessageMut::format(loan.bytes_mut(), Kind::Force, header, &sections) else { return Some(next) };
    let Ok(records) = message.section::<AppliedRecord>(0) else { return Some(next) };
    for (record, tick) in records.iter_mut().zip(first..) {
        // A tick that the device skipped stays zero, with tick 0, and is skipped by the reader.
        *record = device.ring(layout::APPLIED, tick).unwrap_or_default();
    }
    lies.tell(loan.bytes_mut());
    Some(if loan.send().is_ok() { end } else { next })
}
