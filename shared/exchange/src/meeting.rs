//! The Meeting Point: a coordinator releases groups of members in sequence, each group as soon as the last of the group before has
//! joined (Tuchschmid et al. 2006, section 3). Two forms with one interface: threads (parking_lot) and processes (futex words in the
//! station pages).
//!
//! Guarantees. Every wait has a deadline and ends in `joined + missing`, never in a hang. A member that misses is excluded until it has
//! caught up or been replaced, so that one release pays the deadline and no later one. A replacement is released the next time. A join
//! names the coordinator's incarnation and the release, so the late join of a zombie counts for nothing.

mod process;
pub mod rules;
mod spin;
mod thread;

pub use process::{ProcessCoordinator, ProcessMember};
pub use thread::{Begun, ThreadCoordinator, ThreadMember, threads};

/// Most members of one Meeting Point: the bits of a group.
pub const MAX_MEMBERS: usize = hyst_messages::MAX_WORKERS;

/// A set of members, one bit for each.
pub type Group = u32;

/// How a release ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Who joined.
    pub joined: Group,
    /// Who was asked for and did not join: dead, late, excluded, or not there.
    pub missing: Group,
}

/// What a member was released for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Release {
    /// Number of the release, unique for its coordinator.
    pub number: u32,
    /// Incarnation of the coordinator.
    pub coordinator: u32,
    /// Index of the member.
    pub index: usize,
}

/// The side that releases.
pub trait Coordinator {
    /// Releases the groups one after another and waits for each; ends at the deadline (CLOCK_MONOTONIC ns) at the latest.
    fn release(&mut self, groups: &[Group], deadline_ns: u64) -> Outcome;
}

/// The side that is released.
pub trait Member {
    /// Waits for a release that names this member; `None` at the deadline.
    fn await_release(&mut self, deadline_ns: u64) -> Option<Release>;
    /// Says that the work of the release is done.
    fn join(&mut self, release: Release);
}

/// Members of a group, in order.
pub fn members(group: Group) -> impl Iterator<Item = usize> {
    (0..MAX_MEMBERS).filter(move |index| group & (1 << index) != 0)
}
