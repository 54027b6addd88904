//! The watching thread. It polls the pidfds of all engines and looks at their heartbeats; on a death it says so in the station page at
//! once, because spares and ushers wait for that word, and only then tells the rest of the supervisor. It stands above all engines
//! (SCHED_FIFO where granted), so that an engine that spins can be demoted and killed; therefore it does nothing else.

use crate::policy;
use crate::proc;
use hyst_engine::realtime::WATCH_PRIORITY;
use hyst_exchange::{OwnedPage, ReadPage, system};
use hyst_messages::page::{ProcessState, header, station as layout};
use hyst_messages::{Role, Slot};
use rustix::event::{EventfdFlags, PollFd, PollFlags, Timespec};
use rustix::fd::OwnedFd;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};

/// Between two looks at the heartbeats: a twentieth of the shortest bound, and a load of less than a thousandth.
const LOOK_NS: u64 = 5_000_000;
/// When the thread itself was this much late, the host stalled and nobody else is blamed.
const OWN_STALL_NS: u64 = 10_000_000;

/// An incarnation that is watched.
#[derive(Debug)]
pub struct Ward {
    /// Where.
    pub slot: Slot,
    /// Who.
    pub incarnation: u32,
    /// Process id.
    pub pid: u32,
    pidfd: OwnedFd,
    page: ReadPage,
    spawned_ns: u64,
    ready: bool,
    blamed: bool,
}

impl Ward {
    /// A ward whose process and page are open.
    pub fn new(slot: Slot, incarnation: u32, pid: u32, pidfd: OwnedFd, page: ReadPage, spawned_ns: u64) -> Ward {
        Ward { slot, incarnation, pid, pidfd, page, spawned_ns, ready: false, blamed: false }
    }
}

/// What the thread has seen.
#[derive(Clone, Debug)]
pub enum Notice {
    /// An incarnation died; the station page says so already.
    Died {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
        /// Process id, to be reaped.
        pid: u32,
        /// When it was seen, ns.
        at_ns: u64,
        /// Its last heartbeat, ns.
        beat_ns: u64,
    },
    /// An incarnation hangs and was killed.
    Late {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
        /// When it was seen, ns.
        at_ns: u64,
        /// Its last heartbeat, ns.
        beat_ns: u64,
    },
    /// An incarnation became warm or live.
    Ready {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
        /// When it was seen, ns.
        at_ns: u64,
    },
}

/// The way to the thread.
#[derive(Debug)]
pub struct Watch {
    wards: Sender<Ward>,
    bell: Arc<OwnedFd>,
}

impl Watch {
    /// Starts the thread; notices go to `tell`.
    pub fn start(page: Arc<OwnedPage>, real_time: bool, tell: impl Fn(Notice) + Send + 'static) -> std::io::Result<Watch> {
        let (wards, arrivals) = channel();
        let bell = Arc::new(rustix::event::eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)?);
        let own_bell = Arc::clone(&bell);
        std::thread::Builder::new().name("watch".into()).spawn(move || {
            if real_time {
                system::become_fifo(WATCH_PRIORITY); // refused without rights: then it watches at the ordinary priority
            }
            body(&page, &own_bell, &arrivals, &tell);
        })?;
        Ok(Watch { wards, bell })
    }

    /// Watches one more incarnation.
    pub fn add(&self, ward: Ward) {
        let _ = self.wards.send(ward); // the thread ends with the process
        let _ = rustix::io::write(&*self.bell, &1u64.to_ne_bytes());
    }
}

fn body(page: &OwnedPage, bell: &OwnedFd, arrivals: &Receiver<Ward>, tell: &dyn Fn(Notice)) {
    let mut wards: Vec<Ward> = Vec::new();
    let mut awake_since_ns = system::now_ns();
    let mut last_look_ns = awake_since_ns;
    let timeout = Timespec { tv_sec: 0, tv_nsec: LOOK_NS as i64 };
    loop {
        let gone: Vec<bool> = {
            let mut polled: Vec<PollFd<'_>> = Vec::with_capacity(wards.len() + 1);
            polled.push(PollFd::new(bell, PollFlags::IN));
            polled.extend(wards.iter().map(|ward| PollFd::new(&ward.pidfd, PollFlags::IN)));
            let _ = rustix::event::poll(&mut polled, Some(&timeout)); // interrupted: look anyway
            polled[1..].iter().map(|fd| !fd.revents().is_empty()).collect()
        };
        let now_ns = system::now_ns();
        let mut dead = gone.iter();
        wards.retain(|ward| {
            let is_dead = dead.next().copied().unwrap_or(false);
            if is_dead {
                mark_dead(page, ward);
                let beat_ns = ward.page.load64(header::HEARTBEAT_NS);
                tell(Notice::Died { slot: ward.slot, incarnation: ward.incarnation, pid: ward.pid, at_ns: now_ns, beat_ns });
            }
            !is_dead
        });
        if now_ns.saturating_sub(last_look_ns) > LOOK_NS + OWN_STALL_NS {
            awake_since_ns = now_ns;
        }
        last_look_ns = now_ns;
        // An engine that is asked to stop no longer beats; who bounds its stopping is the guardian.
        let stopping = page.load32(layout::STOP) != 0;
        for ward in wards.iter_mut().filter(|_| !stopping) {
            look(ward, now_ns, awake_since_ns, tell);
        }
        let _ = rustix::io::read(bell, &mut [0u8; 8]);
        wards.extend(arrivals.try_iter());
    }
}

fn mark_dead(page: &OwnedPage, ward: &Ward) {
    let at = ward.slot.number();
    if page.load32(layout::SLOT_INCARNATION + at) == ward.incarnation {
        page.store32(layout::SLOT_DEAD + at, 1);
        page.bump_and_wake(layout::CHANGES);
    }
}

fn look(ward: &mut Ward, now_ns: u64, awake_since_ns: u64, tell: &dyn Fn(Notice)) {
    let state = ward.page.state();
    if !ward.ready && matches!(state, ProcessState::Warm | ProcessState::Live) {
        ward.ready = true;
        tell(Notice::Ready { slot: ward.slot, incarnation: ward.incarnation, at_ns: now_ns });
    }
    let beat_ns = ward.page.load64(header::HEARTBEAT_NS);
    if !ward.blamed && policy::is_late(ward.slot.role(), state, now_ns, ward.spawned_ns, beat_ns, awake_since_ns) {
        ward.blamed = true;
        // The hardware stands for a thing outside of the station: it is reported, but not killed for being late.
        if ward.slot.role() != Role::Hardware {
            proc::demote_and_kill(ward.pid);
        }
        tell(Notice::Late { slot: ward.slot, incarnation: ward.incarnation, at_ns: now_ns, beat_ns });
    }
}
