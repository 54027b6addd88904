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
    /// What was joined.
    Joined,
    /// The bell, which wakes: bumped, for the release of another coordinator may have the same number.
    Bell,
}

/// In this order, so that whoever wakes finds the join.
pub const JOINING: [JoinWord; 2] = [JoinWord::Joined, JoinWord::Bell];

/// What a member says that has joined a release of a coordinator.
pub fn joined_word(coordinator: u32, release: u32) -> u64 {
    (coordinator as u64) << 32 | release as u64
}

/// Number of the release after `newest`. Zero is what a fresh page holds, so it is never a release.
pub fn next_release(newest: u32) -> u32 {
    newest.wrapping_add(1).max(1)
}

/// Whether a member whose word this is has joined a release of a coordinator.
pub fn is_joined(joined: u64, release: u32, coordinator: u32) -> bool {
    joined == joined_word(coordinator, release)
}

/// Whether the release that last named a seat is one that its member has not seen yet.
pub fn is_fresh(named: u32, seen: u32) -> bool {
    named != 0 && named != seen
}

/// Whether a release is over: a newer one has begun since. A seat's word is written before the release word, so it may be ahead of it.
pub fn is_over(newest: u32, named: u32) -> bool {
    (newest.wrapping_sub(named) as i32) > 0
}

/// The rest after the second miss, ns; each further one doubles it.
const FIRST_REST_NS: u64 = 4_000_000;
/// Doublings at most: a member that is slow for good costs a deadline in 32 ms, and is asked often enough to be charged with it without a pause.
const MOST_DOUBLINGS: u32 = 3;

/// How long a member that has missed so often, one less for each join in time, is not asked although it has caught up. The first miss costs it nothing more: the host stalls everybody
/// now and then. One that is late at each release would cost the deadline of every second one.
pub fn rest_ns(misses: u32) -> u64 {
    match misses {
        0 | 1 => 0,
        more => FIRST_REST_NS << (more - 2).min(MOST_DOUBLINGS),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rest_doubles_up_to_a_bound() {
        let rests: Vec<u64> = (0..5).map(rest_ns).collect();
        assert_eq!(rests, [0, 0, FIRST_REST_NS, 2 * FIRST_REST_NS, 4 * FIRST_REST_NS]);
        assert_eq!((rest_ns(5), rest_ns(6), rest_ns(u32::MAX)), (32_000_000, 32_000_000, 32_000_000));
    }
}
