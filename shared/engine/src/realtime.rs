//! Real-time set-up, after the warm-up: memory locked, SCHED_FIFO, core. What the machine refuses is said once and done without.
//!
//! The order of importance on two cores (design): device > haptic > spare of tissue > tissue > collision-worker > the rest, which is
//! ordinary. The supervisor's watch stands above all, so that it can demote one that spins.

use crate::life::{Failure, Life};
use hyst_exchange::system::{self, RealTime};
use hyst_messages::page::header;
use hyst_messages::{Role, Slot};

/// Priority of the supervisor's watch: it must be able to demote any engine that spins.
pub const WATCH_PRIORITY: i32 = 90;
/// Priority of the spare of a stateful role above its incumbent: a spare below could not take over from one that spins.
pub const SPARE_ABOVE: i32 = 2;

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

/// The core of a slot: the replicas of a role lie on different cores. `None` leaves the choice to the kernel.
pub fn core(slot: Slot, cores: usize) -> Option<usize> {
    if cores < 2 {
        return None;
    }
    match slot.role() {
        Role::Haptic => Some(slot.index() % cores),
        Role::Tissue if cores >= 8 => Some(2 + slot.index()),
        Role::Tissue => Some((slot.index() + 1) % cores),
        Role::CollisionWorker if cores >= 8 => Some(4 + slot.index() % (cores - 4)),
        Role::CollisionWorker => Some((slot.index() + 1) % cores),
        _ => None,
    }
}

/// Makes the calling thread real time, as its role and the settings say, and leaves in the page what was granted.
pub fn go(life: &Life) -> Result<RealTime, Failure> {
    let mut granted = RealTime::default();
    if life.settings.switch("realtime", true)?
        && let Some(priority) = priority(life.slot.role())
    {
        granted.locked = system::lock_memory();
        granted.pinned = core(life.slot, system::cores()).is_some_and(system::pin_to_core);
        granted.fifo = system::become_fifo(priority);
        if !granted.fifo {
            life.say("SCHED_FIFO was refused: running as an ordinary process; `hystation doctor` says how to allow it");
        }
    }
    life.page.store64(header::REAL_TIME, granted.word());
    // Locking the memory may have taken longer than a heartbeat may be late, and whoever calls this is about to be watched.
    life.heartbeat();
    Ok(granted)
}
