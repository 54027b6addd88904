//! Crews that meet: the Meeting Point in both forms, and a bare futex barrier of the same processes. The bare barrier is the plainest
//! that does the job: a generation word, a counter, and one wake by the last to arrive; no deadline, no exclusion, no replacement.

use crate::Failure;
use crate::partner::{COORDINATOR, PATIENCE_NS, Partner, Site, bare_page, take_place};
use hyst_exchange::meeting::{Coordinator, Group, Member, ProcessCoordinator, ThreadCoordinator, threads};
use hyst_exchange::system::now_ns;
use hyst_exchange::{OwnedPage, ReadPage};
use hyst_messages::page::header;
use hyst_messages::{Role, Slot};
use std::sync::Arc;

/// 64-bit words of a bare page.
pub const BARE_WORDS: usize = header::END;
const GENERATION: usize = 8;
const DONE: usize = 9;
const ARRIVED: usize = header::END - 1;

/// A member of the bare barrier, until it is killed.
pub fn bare_member(own: &OwnedPage, read: &ReadPage, count: u32) -> Result<(), Failure> {
    let mut seen = 0;
    loop {
        while read.load32(GENERATION) == seen {
            read.wait(GENERATION, seen, now_ns() + PATIENCE_NS);
        }
        seen = read.load32(GENERATION);
        if (own.fetch_add64(ARRIVED, 1) + 1).is_multiple_of(u64::from(count)) {
            own.store32_and_wake(DONE, seen);
        }
    }
}

/// The bare barrier and its members.
pub struct BareCrew {
    own: OwnedPage,
    read: ReadPage,
    generation: u32,
    deadline_ns: u64,
    _members: Vec<Partner>,
}

impl BareCrew {
    /// Starts the members.
    pub fn start(site: &Site, count: u32) -> Result<BareCrew, Failure> {
        let (own, read) = bare_page(&site.station, count)?;
        let members = (0..count)
            .map(|index| site.partner("bare-member", &[count, count, site.core_of(index)]))
            .collect::<Result<_, _>>()?;
        // Far behind the end of the run; computed once, for the barrier has no deadlines.
        Ok(BareCrew { own, read, generation: 0, deadline_ns: now_ns() + 60 * PATIENCE_NS, _members: members })
    }
    /// Releases all and waits for all.
    pub fn meet(&mut self) -> Result<(), Failure> {
        self.generation += 1;
        self.own.store32_and_wake(GENERATION, self.generation);
        let mut waited = false;
        loop {
            let done = self.read.load32(DONE);
            if done == self.generation {
                return Ok(());
            }
            // The benchmark must end; a healthy barrier never looks at the clock, for it is done after its first wait.
            if waited && now_ns() >= self.deadline_ns {
                return Err("a member of the bare barrier died".into());
            }
            self.read.wait(DONE, done, self.deadline_ns);
            waited = true;
        }
    }
}

/// The Meeting Point of processes.
pub struct ProcessCrew {
    coordinator: ProcessCoordinator,
    group: Group,
    _members: Vec<Partner>,
}

impl ProcessCrew {
    /// Seats the coordinator that all crews of the run share, with no member.
    pub fn coordinator(site: &Site) -> Result<ProcessCoordinator, Failure> {
        Ok(ProcessCoordinator::new(Arc::new(site.station.create_slot(Slot::first(Role::Tissue), COORDINATOR)?)))
    }
    /// Starts and seats the members; their incarnations begin at `first`.
    pub fn start(site: &Site, mut coordinator: ProcessCoordinator, first: u32, count: u32) -> Result<ProcessCrew, Failure> {
        let slot = Slot::first(Role::CollisionWorker);
        let mut members = Vec::new();
        for index in 0..count {
            let incarnation = first + index;
            drop(site.station.create_slot(slot, incarnation)?);
            members.push(site.partner("member", &[incarnation, site.core_of(index)])?);
            coordinator.seat(index as usize, site.station.read_slot(slot, incarnation)?);
        }
        Ok(ProcessCrew { coordinator, group: (1 << count) - 1, _members: members })
    }
    /// Releases all and waits for all.
    pub fn meet(&mut self) -> Result<(), Failure> {
        let outcome = self.coordinator.release(&[self.group], now_ns() + PATIENCE_NS);
        if outcome.missing == 0 { Ok(()) } else { Err(format!("members missing: {:b}", outcome.missing).into()) }
    }
    /// The coordinator, for the next crew.
    pub fn into_coordinator(self) -> ProcessCoordinator {
        self.coordinator
    }
}

/// The Meeting Point of threads. Its members end when it is dropped.
pub struct ThreadCrew {
    coordinator: ThreadCoordinator,
    group: Group,
}

impl ThreadCrew {
    /// Starts the members.
    pub fn start(site: &Site, count: u32) -> Result<ThreadCrew, Failure> {
        let (coordinator, members) = threads(count as usize);
        for (index, mut member) in members.into_iter().enumerate() {
            let core = site.core_of(index as u32);
            let body = move || {
                take_place(core);
                while let Some(release) = member.await_release(u64::MAX / 2) {
                    member.join(release);
                }
            };
            std::thread::Builder::new().name("member".into()).spawn(body)?;
        }
        Ok(ThreadCrew { coordinator, group: (1 << count) - 1 })
    }
    /// Releases all and waits for all.
    pub fn meet(&mut self) -> Result<(), Failure> {
        let outcome = self.coordinator.release(&[self.group], now_ns() + PATIENCE_NS);
        if outcome.missing == 0 { Ok(()) } else { Err(format!("threads missing: {:b}", outcome.missing).into()) }
    }
}
