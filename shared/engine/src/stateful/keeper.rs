//! The keeper: an ordinary thread that writes a checkpoint of the own stream's newest state every 100 ms.
//!
//! Promise: holders that die one after the other soon after they took the role leave the older generations as they were, and so does a role that is
//! held still: there is a state from before the trouble as long as it lasts.

use crate::helpers::Helper;
use crate::life::{Failure, Life};
use hyst_exchange::checkpoint::CheckpointWriter;
use hyst_exchange::{Roster, Rounds, Subscriber, system};
use hyst_messages::Message;
use hyst_messages::mischief::Thread;
use hyst_messages::stream::kind_of;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Time between two checkpoints: what is lost at most if all replicas of a role die at once.
pub const INTERVAL_NS: u64 = 100_000_000;
/// States in a row that a process keeps as its newest alone, before they count as lasting: a holder that is doomed dies within half a second, and
/// 2 s are that on a machine that gives it a quarter of its time.
const TRIAL: u32 = 20;

/// Ends the keeper's thread when dropped.
pub struct Keeper {
    stop: Arc<AtomicBool>,
    rounds: Rounds,
    handle: Option<std::thread::JoinHandle<()>>,
}

impl Keeper {
    /// The keeper as its engine watches it.
    pub fn helper(&self) -> Helper {
        Helper::new(Thread::Keeper, self.rounds.clone())
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Release);
        if let Some(handle) = self.handle.take() {
            let _ = handle.join(); // it has nothing to say at its end
        }
    }
}

/// Starts the keeper of this process's stream.
pub fn keep(life: &Life, stream: Subscriber, bytes: usize) -> Result<Keeper, Failure> {
    let writer = CheckpointWriter::open(&life.station, life.slot, bytes)?;
    let stop = Arc::new(AtomicBool::new(false));
    let stopped = Arc::clone(&stop);
    let rounds = Rounds::default();
    let passed = rounds.clone();
    let (clock, roster) = (life.station.open()?, Roster::open(&life.station)?);
    let (role, incarnation) = (life.slot.role(), life.incarnation);
    let (mut kept, stalls) = (0, life.staller(Thread::Keeper)?);
    let body = move || {
        while !stopped.load(Ordering::Acquire) {
            system::sleep_ns(INTERVAL_NS);
            passed.pass();
            stalls(&stopped);
            let Ok(Some(held)) = stream.newest() else { continue };
            if clock.is_held(role) {
                kept = 0;
                continue;
            }
            // Its substitutes are no tenure of its own.
            if roster.holder(role).incarnation != incarnation {
                kept = 0;
            }
            let Some(kind) = kind_of(held.bytes()) else { continue };
            // What is computed beside the role is no state to begin from.
            if let Ok(message) = Message::parse(held.bytes(), kind)
                && !message.header().is_shadow()
            {
                writer.write(message.header().epoch, message.header().tick, held.bytes(), kept >= TRIAL);
                kept += 1;
            }
        }
    };
    let handle = std::thread::Builder::new().name("keeper".into()).spawn(body)?;
    Ok(Keeper { stop, rounds, handle: Some(handle) })
}
