//! Real-time set-up, after the warm-up: memory locked, SCHED_FIFO, core. What the machine refuses is said once and done without.
//!
//! The order of importance: hardware > device > haptic > spare of tissue > tissue > collision-worker > the rest, which is
//! ordinary. The supervisor's watch stands above all, so that it can demote one that spins. Workers above the tissues (64) were tried (2026-11-22): they
//! come by a full core sooner, but a holder that waits for a slow one on its own core does not wake at its deadline.

use crate::life::{Failure, Life};
use hyst_exchange::allocation;
use hyst_exchange::system::{self, RealTime};
use hyst_messages::page::header;
use hyst_messages::{Role, Slot};

/// Priority of the supervisor's watch: it must be able to demote any engine that spins.
pub const WATCH_PRIORITY: i32 = 90;
/// Priority of the supervisor, and of a servo while it starts: below all engines that are real time, above whoever is not. While one servo starts, the
/// other has nobody beside it.
pub const SUPERVISOR_PRIORITY: i32 = 5;
/// Priority of what is left of a device that dies, of the supervisor while it starts another, of that one until it is ready, and of the threads that map
/// its page in servos and hardware: above tissues and workers, below the servos. Nobody does its work, and the hardware ramps the force to zero within 20 ms; what a tissue computes meanwhile no hand feels.
pub const DEVICE_RETURNS_PRIORITY: i32 = 65;
/// Priority of the canaries of the hardware: above the hardware, below the supervisor's watch, which works for microseconds.
pub const CANARY_PRIORITY: i32 = 88;
/// Priority of the spare of a stateful role above its incumbent: a spare below could not take over from one that spins.
pub const SPARE_ABOVE: i32 = 2;

/// Priority of a newcomer on trial below the incumbent, while it has not the role: below the workers, which the incumbent waits for.
pub const GUEST_BELOW: i32 = 10;

/// The core of the device and of its hardware. Rendering is kept off it: it maps the driver's libraries when it starts and unmaps its memory when it
/// dies, and in a kernel that does not preempt itself whoever is woken there waits for that, real time or not.
const DEVICE_CORE: usize = 0;

/// On so many cores the replicas of a role are tied apart without real time, too: on more the kernel finds one that is idle.
const TIED_ANYWAY: usize = 2;

/// SCHED_FIFO priority of a role; `None` for ordinary ones.
pub fn priority(role: Role) -> Option<i32> {
    match role {
        Role::Hardware => Some(86),
        Role::Device => Some(84),
        Role::Haptic => Some(80),
        Role::Tissue => Some(60),
        Role::CollisionWorker => Some(55),
        _ => None,
    }
}

/// The core of a slot, by its index among so many: the replicas of a role lie on different cores where there are two, and from four cores on a tissue on none
/// of the hand's. `None` leaves the choice to the kernel.
pub fn core(slot: Slot, cores: usize) -> Option<usize> {
    let cores = cores.max(1);
    match slot.role() {
        Role::Hardware | Role::Device => Some(DEVICE_CORE),
        Role::Haptic => Some(slot.index() % cores),
        Role::Tissue if cores >= 4 => Some(2 + slot.index() % (cores - 2)),
        Role::Tissue => Some(slot.index() % cores),
        // Servos and device take little of theirs.
        Role::CollisionWorker if cores >= 6 => Some(4 + slot.index() % (cores - 4)),
        Role::CollisionWorker if cores >= 4 => Some((slot.index() + 1) % 2),
        Role::CollisionWorker => Some((slot.index() + 1) % cores),
        _ => None,
    }
}

/// Niceness of who will be real time until it is, and of its other threads. At 0, beside four flows of two stations, a newborn got 5 ms in 5 s, and died
/// of it (2-core VM, 2026-11-23).
const WARMING: i32 = -10;

/// Whether the core of a slot is one that the hand's own threads are on too.
pub fn shares_core_with_hand(slot: Slot, cores: usize) -> bool {
    let hand = [Slot::first(Role::Device)].into_iter().chain((0..2).filter_map(|index| Slot::new(Role::Haptic, index)));
    core(slot, cores).is_some_and(|own| hand.into_iter().any(|other| core(other, cores) == Some(own)))
}

/// Priority of the thread that maps pages in a process which reads pages alone; `None` where the settings want no real time.
pub fn pages_priority(life: &Life) -> Option<i32> {
    life.settings.switch("realtime", true).unwrap_or(false).then_some(DEVICE_RETURNS_PRIORITY)
}

/// Niceness of rendering once it draws.
const DRAWING: i32 = 5;

/// How ordinary processes give way to each other: the operator's page before anything else, then pictures, then the flow, the recorder last: it takes a
/// hundredth of a core, and what it has not read within 4 s is lost; who will be real time counts as much as the flow while it warms up, and so do pictures
/// until there is one ([`draw`]). Where that is refused they are alike. Called before a process has threads of its own, which inherit it.
pub fn give_way(life: &Life) {
    let nice = match life.slot.role() {
        Role::Recorder => -15,
        Role::Fluid => -10,
        Role::Console => 10,
        _ => WARMING,
    };
    let real_time = life.settings.switch("realtime", true).unwrap_or(false);
    if real_time && life.slot.role() == Role::Rendering {
        system::keep_off(DEVICE_CORE);
    }
    if nice > 0 || real_time {
        system::be_nice(nice);
    }
}

/// Gives way as who draws does, with all threads that there are: called when the first picture is there. Whoever looks has none until then, and a driver that
/// starts beside a flow which is ahead of it takes seconds instead of half of one.
pub fn draw(life: &Life) {
    if !system::set_niceness(DRAWING) {
        life.say("its threads could not be listed: it does not give way to the flow");
    }
}

/// Whether a role's real-time thread sends messages, for each of which the link makes one small allocation.
fn sends_messages(role: Role) -> bool {
    matches!(role, Role::Tissue | Role::Fluid | Role::CollisionWorker)
}

/// Makes the calling thread real time, as its role and the settings say, and leaves in the page what was granted.
pub fn go(life: &Life) -> Result<RealTime, Failure> {
    // Before the memory is locked, so that it is locked too; a process has one such thread, and there are more pools than that. Who sends no
    // messages gets none: whatever he allocates enters the system's allocator, and is counted.
    if sends_messages(life.slot.role()) && !allocation::give_this_thread_a_pool() {
        life.say("more real-time threads than pools of small blocks: this one asks the system's allocator");
    }
    let mut granted = RealTime::default();
    if life.settings.switch("realtime", true)?
        && let Some(priority) = priority(life.slot.role())
    {
        let cores = system::places();
        granted.locked = system::lock_memory();
        granted.pinned = core(life.slot, cores).is_some_and(system::pin_to_core);
        granted.fifo = system::become_fifo(priority);
        if !granted.fifo {
            // An ordinary thread that is tied to a core waits for whoever runs there, while others are idle.
            granted.pinned &= !(cores > TIED_ANYWAY && system::unpin());
            life.say("SCHED_FIFO was refused: running as an ordinary process; `hystation doctor` says how to allow it");
        }
    }
    life.page.store64(header::REAL_TIME, granted.word());
    // Locking the memory may have taken longer than a heartbeat may be late, and whoever calls this is about to be watched.
    life.heartbeat();
    Ok(granted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use hyst_messages::SLOTS;

    fn core_of(role: Role, index: usize, cores: usize) -> usize {
        core(Slot::new(role, index).unwrap(), cores).unwrap()
    }

    #[test]
    fn on_any_number_of_cores_each_thread_has_one_that_there_is_and_replicas_lie_apart() {
        for cores in 1..=256 {
            for slot in (0..SLOTS).filter_map(Slot::from_number).filter(|slot| priority(slot.role()).is_some()) {
                assert!(core(slot, cores).is_some_and(|own| own < cores), "{slot} of {cores}");
            }
            for role in [Role::Haptic, Role::Tissue, Role::CollisionWorker] {
                let [one, other] = [0, 1].map(|index| core_of(role, index, cores));
                assert_eq!(one == other, cores == 1, "{role:?} of {cores}");
            }
        }
        assert_eq!(core(Slot::first(Role::Fluid), 64), None);
    }

    /// With four to seven cores both tissues lay on those of the hand, and other cores were idle.
    #[test]
    fn from_four_cores_on_no_tissue_shares_a_core_with_the_hand_and_no_worker_one_with_the_replicas() {
        let tissue = |index: usize| Slot::new(Role::Tissue, index).unwrap();
        for cores in 1..=64 {
            for index in 0..2 {
                assert_eq!(shares_core_with_hand(tissue(index), cores), cores < 4, "tissue:{index} of {cores}");
                let own = core(tissue(index), cores);
                let is_beside = (0..2).any(|worker| Some(core_of(Role::CollisionWorker, worker, cores)) == own);
                assert!(!is_beside || cores < 4, "tissue:{index} of {cores}");
            }
        }
    }
}
