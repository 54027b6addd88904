//! What the words of a Meeting Point between processes mean, and in which order they are written: each decision as a function of the words that
//! were read, taken by the processes and by their model in `tests/model` alike, which follow the same orders.

/// The words that a seat is given with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeatWord {
    /// The release that last named the seat.
    Release,
    /// The member in it.
    Member,
}

/// In this order, so that a newcomer never takes a release that named its predecessor for its own.
pub const SEATING: [SeatWord; 2] = [SeatWord::Release, SeatWord::Member];

/// The words that a group is released with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReleaseWord {
    /// Each seat's.
    Seats,
    /// The release itself, which wakes.
    Release,
}

/// In this order, so that whoever wakes finds itself named.
pub const RELEASING: [ReleaseWord; 2] = [ReleaseWord::Seats, ReleaseWord::Release];

/// The words that a member joins with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JoinWord {
    /// The coordinator that is answered.
    Of,
    /// The release, which wakes.
    Release,
}

/// In this order, so that a join is never read as one of a coordinator before.
pub const JOINING: [JoinWord; 2] = [JoinWord::Of, JoinWord::Release];

/// Number of the release after `newest`. Zero is what a fresh page holds, so it is never a release.
pub fn next_release(newest: u32) -> u32 {
    newest.wrapping_add(1).max(1)
}

/// Whether a member whose join words these are has joined a release of a coordinator.
pub fn is_joined(join: u32, join_of: u32, release: u32, coordinator: u32) -> bool {
    join == release && join_of == coordinator
}

/// Whether the release that last named a seat is one that its member has not seen yet.
pub fn is_fresh(named: u32, seen: u32) -> bool {
    named != 0 && named != seen
}

/// Whether a release is over: a newer one has begun since. A seat's word is written before the release word, so it may be ahead of it.
pub fn is_over(newest: u32, named: u32) -> bool {
    (newest.wrapping_sub(named) as i32) > 0
}
