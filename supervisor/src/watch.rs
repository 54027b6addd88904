//! The watching thread. It polls the pidfds of all engines and looks at their latches and heartbeats once in a tick; on a death it says so in the
//! station page at once, because spares and ushers wait for that word, and only then tells the rest of the supervisor. Who is a suspect and who is
//! guilty is decided by [`crate::suspicion`]. It stands above all engines (SCHED_FIFO where granted), so that an engine that spins can be
//! demoted and killed; therefore it does nothing else.

mod doing;
mod words;

use crate::proc::{self, ThreadFiles};
use crate::suspicion::{Gauge, Opinion, is_real_time};
use crate::toil::Toil;
pub use doing::doing;
use hyst_engine::Silence;
use hyst_engine::realtime::{DEVICE_RETURNS_PRIORITY, WATCH_PRIORITY};
use hyst_exchange::{OwnedPage, ReadPage, system};
use hyst_messages::page::{ProcessState, hardware, header, station as layout};
use hyst_messages::{Role, SLOTS, Slot, TICK_NS};
use rustix::event::{EventfdFlags, PollFd, PollFlags, Timespec, epoll, poll};
use rustix::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use words::{mark_dead, mark_suspect, take_back_death};

/// Between two looks at the heartbeats: one tick. It costs 2 % of a core (2-core EPYC VM, 2026-11-21, /proc/PID/task/*/schedstat of a whole
/// station on a busy machine).
const LOOK_NS: u64 = TICK_NS;
/// The bell's number in the set of descriptors; the others' are their incarnations, which begin at 1.
const BELL: u64 = 0;
/// Phase of a look within the tick: by then a healthy servo, device and tissue have beaten in this tick.
const PHASE_NS: u64 = 700_000;
/// Looks within which another real-time engine must have beaten, or time does not count.
const PEERS_LOOKS: u64 = 2;
/// Looks for which hardware that stands still is taken for a host that does: the longest stalls were of 34 ms.
const STALL_LOOKS: u64 = 50;
/// A start-up that takes longer hangs.
const LATE_START_NS: u64 = 30_000_000_000;
/// The same for an ordinary process: graphics in software compile their shaders, which took 40 s beside twenty busy processes on two cores.
const LATE_ORDINARY_START_NS: u64 = 180_000_000_000;
/// A process that is on its way out and takes longer hangs.
const LATE_END_NS: u64 = 2_000_000_000;
/// A watching thread that has not looked for so long hangs: a thousand looks.
const SILENT_NS: u64 = 1_000 * LOOK_NS;
/// Most of it that counts between two questions, ns: the reader asks more often, unless it was not let run itself.
const MOST_PASSED_NS: u64 = 10_000_000;

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
    /// The set of descriptors does not have it: it is asked about at each look.
    apart: bool,
    page: ReadPage,
    spawned_ns: u64,
    ready: bool,
    serves: bool,
    blamed: bool,
    gauge: Gauge,
    toil: Toil,
    thread: Option<ThreadFiles>,
    /// Number of the look at which it was last seen to have beaten.
    moved: u64,
    beat_ns: u64,
    /// When its latch was first seen open, ns: it dies, and what is left of it is in the kernel's hands.
    open_ns: Option<u64>,
}

impl Ward {
    /// A ward whose process and page are open.
    pub fn new(slot: Slot, incarnation: u32, pid: u32, pidfd: OwnedFd, page: ReadPage, spawned_ns: u64) -> Ward {
        let gauge = Gauge::new(slot.role());
        let thread = ThreadFiles::open(pid);
        Ward {
            slot,
            incarnation,
            pid,
            pidfd,
            apart: false,
            page,
            spawned_ns,
            ready: false,
            serves: false,
            blamed: false,
            gauge,
            toil: Toil::default(),
            thread,
            moved: 0,
            beat_ns: 0,
            open_ns: None,
        }
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
        /// When its latch was seen open, ns; none if that was not before.
        open_ns: Option<u64>,
        /// Its last heartbeat, ns.
        beat_ns: u64,
    },
    /// An incarnation has missed three periods and is to blame for it as far as can be known.
    Suspected {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
        /// When it was seen, ns.
        at_ns: u64,
    },
    /// A suspect beats again.
    Cleared {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
        /// Most guilt of which this incarnation was cleared, ns.
        guilt_ns: u64,
    },
    /// An incarnation hangs, or goes on and is too slow to be in time, and was killed.
    Late {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
        /// When it was seen, ns.
        at_ns: u64,
        /// Its last heartbeat, ns.
        beat_ns: u64,
        /// It goes on.
        is_slow: bool,
        /// What it did, in words.
        doing: String,
    },
    /// The station page said of one who lives that it is dead, and does not any more.
    SaidDead {
        /// Where.
        slot: Slot,
    },
    /// A servo has left its shadow: what it makes may be used.
    Serves {
        /// Where.
        slot: Slot,
        /// Who.
        incarnation: u32,
        /// When it was seen, ns.
        at_ns: u64,
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

impl Notice {
    /// Whether the hand has nobody from now on.
    pub fn is_end_of_device(&self) -> bool {
        matches!(self, Notice::Died { slot, .. } if slot.role() == Role::Device)
    }
}

/// The way to the thread.
#[derive(Debug)]
pub struct Watch {
    wards: Sender<Ward>,
    bell: Arc<OwnedFd>,
    looks: Arc<AtomicU64>,
    silence: Silence,
}

impl Watch {
    /// Starts the thread; notices go to `tell`.
    pub fn start(page: Arc<OwnedPage>, real_time: bool, tell: impl Fn(Notice) + Send + 'static) -> std::io::Result<Watch> {
        let (wards, arrivals) = channel();
        let bell = Arc::new(rustix::event::eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK)?);
        let own_bell = Arc::clone(&bell);
        let set = epoll::create(epoll::CreateFlags::CLOEXEC)?;
        epoll::add(&set, &*bell, epoll::EventData::new_u64(BELL), epoll::EventFlags::IN)?;
        let looks = Arc::new(AtomicU64::new(0));
        let own_looks = Arc::clone(&looks);
        std::thread::Builder::new().name("watch".into()).spawn(move || {
            if real_time {
                system::become_fifo(WATCH_PRIORITY); // refused without rights: then it watches at the ordinary priority
            }
            body(&page, &set, &own_bell, &arrivals, &own_looks, &tell);
        })?;
        Ok(Watch { wards, bell, looks, silence: Silence::new(system::now_ns(), MOST_PASSED_NS) })
    }

    /// Whether the thread hangs, and nobody would see an engine die; to be asked all the time.
    pub fn hangs(&mut self, now_ns: u64) -> bool {
        self.silence.look(now_ns, self.looks.load(Ordering::Relaxed)) > SILENT_NS
    }

    /// Watches one more incarnation.
    pub fn add(&self, ward: Ward) {
        let _ = self.wards.send(ward); // the thread ends with the process
        let _ = rustix::io::write(&*self.bell, &1u64.to_ne_bytes());
    }
}

fn body(page: &OwnedPage, set: &OwnedFd, bell: &OwnedFd, arrivals: &Receiver<Ward>, looks: &AtomicU64, tell: &dyn Fn(Notice)) {
    let mut wards: Vec<Ward> = Vec::new();
    let mut last_look_ns = system::now_ns();
    let mut look = 0;
    let t0_ns = page.load64(layout::T0_NS);
    let mut ready = Vec::with_capacity(SLOTS);
    loop {
        wait(set, t0_ns, &mut ready);
        let now_ns = system::now_ns();
        // A dead one's descriptor leaves the set when it is closed with the ward.
        wards.retain(|ward| {
            let is_dead = ready.iter().any(|event| event.data.u64() == ward.incarnation as u64)
                || ward.apart && proc::has_ended(&ward.pidfd);
            if is_dead {
                mark_dead(page, ward);
                let Ward { slot, incarnation, pid, open_ns, .. } = *ward;
                let beat_ns = ward.page.load64(header::HEARTBEAT_NS);
                tell(Notice::Died { slot, incarnation, pid, at_ns: now_ns, open_ns, beat_ns });
                // Of one that was adopted, too, which others reap: whoever lives under that number by now is somebody else.
                if system::process_start(pid).is_none() {
                    proc::end_group(pid);
                }
            }
            !is_dead
        });
        let passed_ns = now_ns.saturating_sub(last_look_ns).min(LOOK_NS);
        last_look_ns = now_ns;
        look += 1;
        looks.store(look, Ordering::Relaxed);
        // An engine that is asked to stop no longer beats; who bounds its stopping is the guardian.
        if page.load32(layout::STOP) == 0 {
            let is_lockstep = page.load32(layout::LOCKSTEP) != 0;
            let look = Look { number: look, now_ns, passed_ns, stood_ns: stood_ns(&wards), is_lockstep };
            look_at_all(page, &mut wards, look, tell);
        }
        if ready.iter().any(|event| event.data.u64() == BELL) {
            let _ = rustix::io::read(bell, &mut [0u8; 8]);
            for mut ward in arrivals.try_iter() {
                let data = epoll::EventData::new_u64(ward.incarnation as u64);
                ward.apart = epoll::add(set, &ward.pidfd, data, epoll::EventFlags::IN).is_err(); // without memory
                mark_suspect(page, &ward, false); // a supervisor that died may have left its opinion
                if page.load32(layout::LOCKSTEP) != 0 {
                    ward.gauge = Gauge::in_lockstep(ward.slot.role());
                }
                wards.push(ward);
            }
        }
    }
}

/// Waits for a death, a newcomer or the time of the next look; `ready` has what happened. The set itself is polled, because its own wait may round the time
/// up to milliseconds: looks that came every 1.03 ms kept step with an engine that slept for one at a time, saw it awake, and took 78 ms to find that it hung.
fn wait(set: &OwnedFd, t0_ns: u64, ready: &mut Vec<epoll::Event>) {
    let into_tick_ns = (system::now_ns() + LOOK_NS - PHASE_NS).saturating_sub(t0_ns) % LOOK_NS;
    let timeout = Timespec { tv_sec: 0, tv_nsec: (LOOK_NS - into_tick_ns) as i64 };
    ready.clear();
    let news = poll(&mut [PollFd::new(set, PollFlags::IN)], Some(&timeout)); // interrupted: look anyway
    if news != Ok(0) {
        let _ = epoll::wait(set, rustix::buffer::spare_capacity(ready), Some(&Timespec::default()));
    }
}

/// One look at everybody.
#[derive(Clone, Copy, Debug)]
struct Look {
    number: u64,
    now_ns: u64,
    /// Time since the look before, at most the time between two looks, ns.
    passed_ns: u64,
    /// For how long the host has stood still in all, as the hardware's canaries saw it, ns.
    stood_ns: u64,
    /// Nothing of a lock-step station is real time.
    is_lockstep: bool,
}

fn look_at_all(page: &OwnedPage, wards: &mut [Ward], look: Look, tell: &dyn Fn(Notice)) {
    for ward in wards.iter_mut() {
        // In lock-step no time is lost: whoever is missing is so when nothing of him is left.
        if !look.is_lockstep && ward.open_ns.is_none() && ward.page.latch_is_open() {
            ward.open_ns = Some(look.now_ns);
            mark_dead(page, ward);
            if ward.slot.role() == Role::Device {
                proc::hasten(ward.pid, DEVICE_RETURNS_PRIORITY);
            }
        }
        if ward.open_ns.is_none() && take_back_death(page, ward) {
            tell(Notice::SaidDead { slot: ward.slot });
        }
        let beat_ns = ward.page.load64(header::HEARTBEAT_NS);
        if std::mem::replace(&mut ward.beat_ns, beat_ns) != beat_ns {
            ward.moved = look.number;
        }
    }
    let is_peer = |ward: &Ward| ward.ready && is_real_time(ward.slot.role());
    let moves = |ward: &Ward| look.number - ward.moved <= PEERS_LOOKS;
    let peers = wards.iter().filter(|ward| is_peer(ward)).count();
    let moving = wards.iter().filter(|ward| is_peer(ward) && moves(ward)).count();
    let stalls = |ward: &Ward| !moves(ward) && look.number - ward.moved <= STALL_LOOKS;
    let hardware_stands = wards.iter().any(|ward| ward.slot.role() == Role::Hardware && is_peer(ward) && stalls(ward));
    for ward in wards.iter_mut() {
        let others = peers - usize::from(is_peer(ward));
        let others_moving = moving - usize::from(is_peer(ward) && moves(ward));
        let passed_ns = if counts(ward.slot.role(), others, others_moving, hardware_stands) { look.passed_ns } else { 0 };
        look_at(page, ward, look, passed_ns, tell);
    }
}

/// For how long the host has stood still, ns; 0 where nobody looks.
fn stood_ns(wards: &[Ward]) -> u64 {
    let hardware = wards.iter().find(|ward| ward.slot.role() == Role::Hardware);
    hardware.map_or(0, |ward| ward.page.load64(hardware::TOTALS + hardware::Total::Stood as usize))
}

/// Whether time counts for an engine: another real-time one has moved, or it is alone; and of a device, of which nobody waits long, whether the hardware has, too:
/// a host that let neither run for 9 ms, beside four spinning processes and a compiler, is no fault of the device.
fn counts(role: Role, others: usize, others_moving: usize, hardware_stands: bool) -> bool {
    (others == 0 || others_moving > 0) && !(role == Role::Device && hardware_stands)
}

fn look_at(page: &OwnedPage, ward: &mut Ward, look: Look, counted_ns: u64, tell: &dyn Fn(Notice)) {
    let now_ns = look.now_ns;
    let (slot, incarnation, beat_ns) = (ward.slot, ward.incarnation, ward.beat_ns);
    let state = ward.page.state();
    if !ward.ready && state.is_ready() {
        ward.ready = true;
        tell(Notice::Ready { slot, incarnation, at_ns: now_ns });
    }
    if !ward.serves && slot.role() == Role::Haptic && state == ProcessState::Live {
        ward.serves = true;
        tell(Notice::Serves { slot, incarnation, at_ns: now_ns });
    }
    let late =
        |since_ns: u64, bound_ns: u64| if now_ns.saturating_sub(since_ns) > bound_ns { Opinion::Guilty } else { Opinion::Same };
    let opinion = match (state, ward.open_ns) {
        _ if ward.blamed => Opinion::Same,
        // It dies. One that does not has a bit in its page that flipped.
        (_, Some(open_ns)) => late(open_ns, LATE_END_NS),
        (ProcessState::Empty | ProcessState::Warming, None) => {
            late(ward.spawned_ns, if is_real_time(slot.role()) { LATE_START_NS } else { LATE_ORDINARY_START_NS })
        }
        (ProcessState::Stopping | ProcessState::Failed, None) => late(beat_ns, LATE_END_NS),
        (ProcessState::Warm | ProcessState::Live, None) => {
            let thread = ward.thread.as_ref();
            let has_deadlines = ward.gauge.is_real_time();
            let ask = if has_deadlines { ThreadFiles::state } else { ThreadFiles::state_of_process };
            let is_device = has_deadlines && slot.role() == Role::Device;
            let ran_ns = thread.filter(|_| is_device).and_then(ThreadFiles::ran_and_waited_ns).map(|(ran_ns, _)| ran_ns);
            match ward.toil.look(counted_ns, ran_ns, look.stood_ns) {
                true => Opinion::Slow,
                false => ward.gauge.look(beat_ns, counted_ns, || thread.and_then(ask)),
            }
        }
    };
    if opinion != Opinion::Same {
        mark_suspect(page, ward, opinion != Opinion::Cleared);
    }
    match opinion {
        Opinion::Same => {}
        Opinion::Suspected => tell(Notice::Suspected { slot, incarnation, at_ns: now_ns }),
        Opinion::Cleared => tell(Notice::Cleared { slot, incarnation, guilt_ns: ward.gauge.most_cleared_ns }),
        Opinion::Guilty | Opinion::Slow => {
            ward.blamed = true;
            let is_slow = opinion == Opinion::Slow;
            let doing = if is_slow { String::new() } else { doing::doing(ward.pid) };
            // The hardware stands for a thing outside of the station: it is reported, but not killed for being late.
            if slot.role() != Role::Hardware {
                proc::end_held(slot.role(), ward.pid, &ward.pidfd);
            }
            tell(Notice::Late { slot, incarnation, at_ns: now_ns, beat_ns, is_slow, doing });
        }
    }
}

#[cfg(test)]
mod tests;
