//! The usher: a thread beside an engine's real-time thread that opens, maps and touches the pages and streams of newcomers, and hands the finished
//! ports to the real-time thread through a wait-free queue; what the real-time thread has done with comes back to be unmapped here.
//!
//! Promise: the real-time thread never connects, maps, unmaps or cleans up. A page comes as soon as its process is announced; a stream when
//! its writer is there. If a queue is full, what does not fit waits with the usher.

use crate::mappings::Touched;
use crate::page::ReadPage;
use crate::rendezvous::ProcessClient;
use crate::rounds::Rounds;
use crate::stall::stall;
use crate::station::{Station, StationError, StationPage};
use crate::stream::{Held, Links, Subscriber};
use crate::system;
use hyst_messages::mischief::Thread;
use hyst_messages::page::header;
use hyst_messages::{Kind, Role, SLOTS, Slot};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Ports on their way in either direction.
const QUEUE: usize = 256;
/// How often the usher looks while somebody is warming up, ns.
const EAGER_NS: u64 = 1_000_000;
/// Stack of a thread that opens nothing but pages, bytes: locked memory is brought in whole, and a device that starts has no time for more.
const PAGES_STACK: usize = 256 << 10;
/// How often it looks otherwise, ns; a change of the slots wakes it at once.
const IDLE_NS: u64 = 20_000_000;

/// Steps that it stands ahead of its process's other ordinary threads: it runs rarely, and until it did nobody hears what a newcomer says.
const AHEAD: i32 = 10;

/// What an engine wants of every process of a role.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// Its page.
    Page,
    /// One of its streams.
    Stream(Kind),
    /// A client of one of its rendezvous.
    Client(Kind),
}

/// A port that is ready for use.
#[derive(Debug)]
pub enum Port {
    /// A page.
    Page(ReadPage),
    /// A stream.
    Stream(Kind, Subscriber),
    /// A rendezvous.
    Client(Kind, ProcessClient),
}

/// What the usher hands over.
#[derive(Debug)]
pub struct Arrival {
    /// Whose.
    pub slot: Slot,
    /// Which life of it.
    pub incarnation: u32,
    /// The port.
    pub port: Port,
}

/// What the real-time thread hands back.
#[derive(Debug)]
pub enum Departure {
    /// A page that is no longer read.
    Page(ReadPage),
    /// A stream that is no longer read.
    Stream(Subscriber),
    /// A message that need not be held any longer, but whose segment may have to be unmapped.
    Message(Held),
}

/// A page that has arrived, for processes that read pages alone.
#[derive(Debug)]
pub struct PageArrival {
    /// Whose.
    pub slot: Slot,
    /// Which life of it.
    pub incarnation: u32,
    /// The page.
    pub page: ReadPage,
}

/// The real-time thread's end for a process that reads pages alone; nothing of the stream library is linked for it.
pub type PageInbox = Inbox<PageArrival, ReadPage>;

/// The real-time thread's end.
#[derive(Debug)]
pub struct Inbox<A = Arrival, D = Departure> {
    arrivals: rtrb::Consumer<A>,
    departures: rtrb::Producer<D>,
    stop: Arc<AtomicBool>,
    rounds: Rounds,
    handle: Option<std::thread::JoinHandle<()>>,
}

impl<A, D> Inbox<A, D> {
    /// How often the usher has got on: with each guest that it looks after, and at least every 20 ms.
    pub fn rounds(&self) -> Rounds {
        self.rounds.clone()
    }
    /// The next port, if one has come.
    pub fn take(&mut self) -> Option<A> {
        self.arrivals.pop().ok()
    }
    /// Hands a port back. If the queue is full, it is dropped here: an unmapping on this thread, said by the return value.
    pub fn retire(&mut self, departure: D) -> bool {
        self.departures.push(departure).is_ok()
    }
}

impl<A, D> Drop for Inbox<A, D> {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(handle) = self.handle.take() {
            let _ = handle.join(); // the usher has nothing to say at its end
        }
    }
}

struct Guest {
    slot: Slot,
    incarnation: u32,
    wanted: Wanted,
    page: Option<ReadPage>,
    tries: u32,
}

/// Tries to connect to a newcomer at every eager look: about 20 s. Then it is looked for as rarely as if nobody were awaited, and never given up while its slot
/// names it: one that was not let run for so long comes all the same.
const EAGER_TRIES: u32 = 20_000;

struct Desk {
    station: Station,
    me: u32,
    interests: Vec<(Role, Wanted)>,
    known: Vec<(Slot, u32, Wanted)>,
    waiting: Vec<Guest>,
    rounds: Rounds,
}

/// Makes the port of a guest whose page is open; `Ok(None)` if it is not ready for it, or there is no room, `Err` if it never will be.
fn connect_port(guest: &mut Guest, links: Option<&Links>) -> Result<Option<Arrival>, ()> {
    let Some(page) = &guest.page else { return Ok(None) };
    let (slot, incarnation, role) = (guest.slot, guest.incarnation, guest.slot.role());
    let port = match guest.wanted {
        Wanted::Page => guest.page.take().map(Port::Page),
        _ if page.load32(header::PORTS_OPEN) == 0 => None,
        Wanted::Stream(kind) => {
            let subscriber = links.ok_or(())?.subscriber(role, incarnation, kind).ok();
            subscriber.filter(|subscriber| subscriber.connect().is_ok()).map(|subscriber| Port::Stream(kind, subscriber))
        }
        Wanted::Client(kind) => links.ok_or(())?.client(role, incarnation, kind).ok().map(|client| Port::Client(kind, client)),
    };
    Ok(port.map(|port| Arrival { slot, incarnation, port }))
}

impl Desk {
    fn notice(&mut self, page: &StationPage) {
        // What the dead have not opened they never will; their pages stay readable.
        let is_over = |slot: Slot, wanted: Wanted| wanted != Wanted::Page && page.is_dead(slot);
        let known = &mut self.known;
        self.waiting.retain(|guest| {
            let is_over = is_over(guest.slot, guest.wanted);
            if is_over {
                // If it is not dead after all, it is met like a newcomer.
                known.retain(|key| *key != (guest.slot, guest.incarnation, guest.wanted));
            }
            !is_over
        });
        for &(role, wanted) in &self.interests {
            for (slot, incarnation) in page.occupied(role) {
                let key = (slot, incarnation, wanted);
                if incarnation == self.me || self.known.contains(&key) || is_over(slot, wanted) {
                    continue;
                }
                self.known.retain(|(s, _, w)| (*s, *w) != (slot, wanted));
                self.known.push(key);
                self.waiting.retain(|guest| (guest.slot, guest.wanted) != (slot, wanted));
                self.waiting.push(Guest { slot, incarnation, wanted, page: None, tries: 0 });
            }
        }
    }

    /// In test mode, as long as it is asked to.
    fn stand_still(&self, page: &StationPage, stop: &AtomicBool) {
        let mut slots = (0..SLOTS).filter_map(Slot::from_number);
        if page.test_mode()
            && let Some(slot) = slots.find(|slot| page.incarnation(*slot) == self.me)
        {
            stall(page, slot, self.me, Thread::Usher, stop, || {
                // It counts in the page of its process; without one nobody is told.
                if let Ok(own) = self.station.own_slot(slot, self.me) {
                    own.fetch_add64(header::MISCHIEF, 1);
                }
            });
        }
    }

    fn seat<A>(&mut self, arrivals: &mut rtrb::Producer<A>, mut connect: impl FnMut(&mut Guest) -> Result<Option<A>, ()>) {
        let mut at = 0;
        while at < self.waiting.len() {
            if arrivals.is_full() {
                return;
            }
            self.rounds.pass();
            let guest = &mut self.waiting[at];
            guest.tries = guest.tries.saturating_add(1);
            if guest.page.is_none() {
                // Not there yet, already gone again, or no descriptor left: each is seen at the next look, and the last is told.
                let opened = self.station.read_slot(guest.slot, guest.incarnation);
                if opened.as_ref().is_err_and(|error| error.is_want_of_files()) {
                    self.rounds.want_file(system::now_ns());
                }
                guest.page = opened.ok();
            }
            match connect(guest) {
                Ok(None) => at += 1,
                Err(()) => drop(self.waiting.remove(at)),
                Ok(Some(arrival)) => {
                    self.waiting.remove(at);
                    // The queue was seen not to be full, and nobody else fills it.
                    let _ = arrivals.push(arrival);
                }
            }
        }
    }
}

/// Starts an usher for the process with incarnation `me`. `links` is needed if any stream or rendezvous is wanted.
pub fn usher(station: &Station, links: Option<Links>, me: u32, interests: Vec<(Role, Wanted)>) -> Result<Inbox, StationError> {
    let (segments, mut touched) = (station.prefix(), Touched::default());
    start(station, me, interests, Manner::default(), move |guest| {
        let arrival = connect_port(guest, links.as_ref());
        if matches!(&arrival, Ok(Some(Arrival { port: Port::Stream(..), .. }))) {
            touched.touch_new(&segments, ".data");
        }
        arrival
    })
}

/// Starts an usher for a process that reads pages alone, which are on the way from hand to force: an ordinary thread may have to wait for a core, and a
/// device that returns waits for all who map its page. So the caller, who is not real time yet, opens those of all who live by then himself, and the thread
/// gets a SCHED_FIFO priority, if there is one for it; it runs for some tenths of a millisecond when somebody comes or goes.
pub fn page_usher(station: &Station, me: u32, roles: &[Role], priority: Option<i32>) -> Result<PageInbox, StationError> {
    let interests = roles.iter().map(|role| (*role, Wanted::Page)).collect();
    start(station, me, interests, Manner { pages_alone: true, priority }, |guest| {
        Ok(guest.page.take().map(|page| PageArrival { slot: guest.slot, incarnation: guest.incarnation, page }))
    })
}

/// How an usher works.
#[derive(Clone, Copy, Default)]
struct Manner {
    /// It maps pages and nothing else.
    pages_alone: bool,
    priority: Option<i32>,
}

impl Manner {
    /// The calling thread's class; without rights it waits like any other thread.
    fn take_class(self) {
        if !self.priority.is_some_and(system::become_fifo) {
            system::demote(0); // of a device or a servo that is real time while it starts
            system::be_nice(-AHEAD);
        }
    }
}

fn start<A: Send + 'static, D: Send + 'static>(
    station: &Station,
    me: u32,
    interests: Vec<(Role, Wanted)>,
    manner: Manner,
    mut connect: impl FnMut(&mut Guest) -> Result<Option<A>, ()> + Send + 'static,
) -> Result<Inbox<A, D>, StationError> {
    let (mut arrivals, inbox_arrivals) = rtrb::RingBuffer::new(QUEUE);
    let (inbox_departures, mut departures) = rtrb::RingBuffer::<D>::new(QUEUE);
    let page = station.open()?;
    let stop = Arc::new(AtomicBool::new(false));
    let stopped = Arc::clone(&stop);
    let rounds = Rounds::default();
    let passed = rounds.clone();
    let mut desk = Desk { station: station.clone(), me, interests, known: Vec::new(), waiting: Vec::new(), rounds: passed };
    if manner.pages_alone {
        desk.notice(&page);
        desk.seat(&mut arrivals, &mut connect);
    }
    let body = move || {
        manner.take_class();
        while !stopped.load(Ordering::Acquire) {
            desk.rounds.pass();
            let seen = page.changes();
            desk.stand_still(&page, &stopped);
            while departures.pop().is_ok() {}
            desk.notice(&page);
            desk.seat(&mut arrivals, &mut connect);
            let pause = if desk.waiting.iter().all(|guest| guest.tries > EAGER_TRIES) { IDLE_NS } else { EAGER_NS };
            page.wait_for_change(seen, system::now_ns() + pause);
        }
    };
    let builder = std::thread::Builder::new().name("usher".into());
    let handle = if manner.pages_alone { builder.stack_size(PAGES_STACK) } else { builder }
        .spawn(body)
        .map_err(|source| StationError::Root { path: station.root().to_path_buf(), source })?;
    Ok(Inbox { arrivals: inbox_arrivals, departures: inbox_departures, stop, rounds, handle: Some(handle) })
}
