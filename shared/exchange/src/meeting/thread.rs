//! The Meeting Point between threads of one process: one lock, two conditions, and two counts by which a waiter sees without the lock that there is news.

use super::spin::Spin;
use super::{Coordinator, Group, MAX_MEMBERS, Member, Outcome, Release, members};
use crate::system;
use parking_lot::{Condvar, Mutex};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

#[derive(Debug, Default)]
struct State {
    number: u32,
    released: Group,
    joined: Group,
    gone: Group,
    excluded: Group,
    /// Newest release that each member has joined.
    caught_up: [u32; MAX_MEMBERS],
    /// Newest release that named each member.
    named: [u32; MAX_MEMBERS],
    closed: bool,
}

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    release: Condvar,
    join: Condvar,
    /// Releases, and the end of them.
    releases: AtomicU32,
    /// Joins and deaths.
    joins: AtomicU32,
}

impl Shared {
    fn tell_members(&self) {
        self.releases.fetch_add(1, Ordering::Release);
        self.release.notify_all();
    }
    fn tell_coordinator(&self) {
        self.joins.fetch_add(1, Ordering::Release);
        self.join.notify_one();
    }
}

/// The side that releases; dropping it ends the members' waits.
#[derive(Debug)]
pub struct ThreadCoordinator {
    shared: Arc<Shared>,
    spin: Spin,
}

/// One member; dropping it (a panic of its thread, say) counts as its death, and no release waits for it again.
#[derive(Debug)]
pub struct ThreadMember {
    shared: Arc<Shared>,
    index: usize,
    seen: u32,
    /// Releases that it has looked at.
    looked: u32,
    spin: Spin,
}

/// A Meeting Point of `count` threads (at most [`MAX_MEMBERS`]).
pub fn threads(count: usize) -> (ThreadCoordinator, Vec<ThreadMember>) {
    let shared = Arc::new(Shared::default());
    let member = |index| ThreadMember { shared: Arc::clone(&shared), index, seen: 0, looked: 0, spin: Spin::default() };
    let members = (0..count.min(MAX_MEMBERS)).map(member).collect();
    (ThreadCoordinator { shared, spin: Spin::default() }, members)
}

fn instant(deadline_ns: u64) -> Instant {
    // A deadline beyond an hour is as good as none and would overflow nothing.
    Instant::now() + Duration::from_nanos(deadline_ns.saturating_sub(system::now_ns()).min(3_600_000_000_000))
}

impl ThreadCoordinator {
    /// Ends the members' waits for good.
    fn close(&self) {
        self.shared.state.lock().closed = true;
        self.shared.tell_members();
    }
}

/// A release that has begun and not yet ended.
#[derive(Clone, Copy, Debug)]
pub struct Begun {
    group: Group,
    asked: Group,
    /// The count of joins before it.
    joins: u32,
}

impl ThreadCoordinator {
    /// Releases one group and returns at once.
    pub fn begin(&mut self, group: Group) -> Begun {
        let mut state = self.shared.state.lock();
        state.number = state.number.wrapping_add(1);
        let number = state.number;
        let caught_up = members(state.excluded).filter(|&index| state.caught_up[index] == state.named[index]);
        let back = caught_up.fold(0, |mask, index| mask | 1 << index);
        state.excluded &= !back;
        let asked = group & !state.gone & !state.excluded;
        state.released = asked;
        state.joined = 0;
        for index in members(asked) {
            state.named[index] = number;
        }
        let joins = self.shared.joins.load(Ordering::Relaxed);
        drop(state);
        self.shared.tell_members();
        Begun { group, asked, joins }
    }

    /// Waits for the members of a release that has begun, until the deadline.
    pub fn finish(&mut self, begun: Begun, deadline_ns: u64) -> Outcome {
        let until = instant(deadline_ns);
        let Begun { group, asked, joins } = begun;
        let all = joins.wrapping_add(asked.count_ones());
        // Whoever dies or comes late is counted too: then this ends a little early or late, and the lock knows better.
        self.spin.until(deadline_ns, || self.shared.joins.load(Ordering::Acquire).wrapping_sub(all) < u32::MAX / 2);
        let mut state = self.shared.state.lock();
        // Bounded by the deadline; a member that dies wakes the coordinator.
        while asked & !state.gone & !state.joined != 0 {
            if self.shared.join.wait_until(&mut state, until).timed_out() {
                break;
            }
        }
        let joined = asked & state.joined;
        state.excluded |= asked & !joined & !state.gone;
        state.released = 0;
        Outcome { joined, missing: group & !joined }
    }
}

impl Coordinator for ThreadCoordinator {
    fn release(&mut self, groups: &[Group], deadline_ns: u64) -> Outcome {
        let mut outcome = Outcome::default();
        for &group in groups {
            // A group whose time is up before it begins is missing, but not to blame: it is neither released nor excluded.
            if system::now_ns() >= deadline_ns {
                outcome.missing |= group;
                continue;
            }
            let begun = self.begin(group);
            let ended = self.finish(begun, deadline_ns);
            outcome.joined |= ended.joined;
            outcome.missing |= ended.missing;
        }
        outcome
    }
}

impl Drop for ThreadCoordinator {
    fn drop(&mut self) {
        self.close();
    }
}

impl ThreadMember {
    /// Whether the coordinator has gone, so that no release will come.
    pub fn is_closed(&self) -> bool {
        self.shared.state.lock().closed
    }
}

impl Member for ThreadMember {
    fn await_release(&mut self, deadline_ns: u64) -> Option<Release> {
        let until = instant(deadline_ns);
        self.spin.until(deadline_ns, || self.shared.releases.load(Ordering::Acquire) != self.looked);
        let mut state = self.shared.state.lock();
        loop {
            // Under the lock: what is told after this is seen by the next look.
            self.looked = self.shared.releases.load(Ordering::Acquire);
            if state.closed {
                return None;
            }
            let named = state.named[self.index];
            if named != self.seen {
                self.seen = named;
                if state.released & (1 << self.index) != 0 {
                    return Some(Release { number: named, coordinator: 0, index: self.index });
                }
                state.caught_up[self.index] = named; // slept through it: no work, but caught up
            }
            if self.shared.release.wait_until(&mut state, until).timed_out() {
                return None;
            }
        }
    }

    fn join(&mut self, release: Release) {
        let mut state = self.shared.state.lock();
        state.caught_up[self.index] = release.number;
        if state.number == release.number {
            state.joined |= 1 << self.index;
            drop(state);
            self.shared.tell_coordinator();
        }
    }
}

impl Drop for ThreadMember {
    fn drop(&mut self) {
        self.shared.state.lock().gone |= 1 << self.index;
        self.shared.tell_coordinator();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    const FAR: u64 = u64::MAX / 2;
    const SOON_NS: u64 = 30_000_000;

    #[test]
    fn groups_run_in_sequence_each_after_the_last_of_the_one_before() {
        let (mut coordinator, members) = threads(5);
        let running_first = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for mut member in members {
                let running_first = &running_first;
                scope.spawn(move || {
                    while let Some(release) = member.await_release(FAR) {
                        if member.index < 3 {
                            running_first.fetch_add(1, Ordering::SeqCst);
                        } else {
                            assert_eq!(
                                running_first.load(Ordering::SeqCst) % 3,
                                0,
                                "the second group began before the first had ended"
                            );
                        }
                        member.join(release);
                    }
                });
            }
            for _ in 0..500 {
                assert_eq!(coordinator.release(&[0b00111, 0b11000], FAR), Outcome { joined: 0b11111, missing: 0 });
            }
            drop(coordinator);
        });
        assert_eq!(running_first.load(Ordering::SeqCst), 1_500);
    }

    /// The partner dies before it is released, between release and join, and after the join.
    #[test]
    fn a_member_that_dies_at_any_point_is_missing_and_never_a_hang() {
        for point in 0..3 {
            let (mut coordinator, mut members) = threads(2);
            let (mut mortal, mut other) = (members.remove(0), members.remove(0));
            std::thread::scope(|scope| {
                scope.spawn(move || {
                    if point == 0 {
                        return;
                    }
                    let release = mortal.await_release(FAR).unwrap();
                    if point == 2 {
                        mortal.join(release);
                    }
                });
                scope.spawn(move || {
                    while let Some(release) = other.await_release(FAR) {
                        other.join(release);
                    }
                });
                let first = coordinator.release(&[0b11], FAR);
                assert_eq!(first.joined | first.missing, 0b11);
                assert_eq!(first.joined & 1, u32::from(point == 2));
                let mut outcome = first;
                while outcome.missing == 0 {
                    outcome = coordinator.release(&[0b11], FAR); // the death may come after the second release
                }
                assert_eq!(outcome, Outcome { joined: 0b10, missing: 0b01 });
                drop(coordinator);
            });
        }
    }

    /// One release names the member while nobody runs it; the next does not.
    #[test]
    fn a_member_that_slept_through_a_release_does_no_work_for_it_and_is_back() {
        let (mut coordinator, mut members) = threads(2);
        let mut sleeper = members.remove(0);
        assert_eq!(coordinator.release(&[0b01], system::now_ns() + 1_000_000).missing, 0b01);
        assert_eq!(sleeper.await_release(system::now_ns()), None, "the release is over");
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let release = sleeper.await_release(FAR).unwrap();
                sleeper.join(release);
            });
            assert_eq!(coordinator.release(&[0b01], FAR), Outcome { joined: 0b01, missing: 0 });
        });
    }

    #[test]
    fn a_group_whose_time_is_up_before_it_begins_is_missing_but_not_excluded() {
        let (mut coordinator, mut members) = threads(2);
        let mut second = members.remove(1);
        let first_hangs = coordinator.release(&[0b01, 0b10], system::now_ns() + 1_000_000);
        assert_eq!(first_hangs, Outcome { joined: 0, missing: 0b11 });
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let release = second.await_release(FAR).unwrap();
                second.join(release);
            });
            assert_eq!(coordinator.release(&[0b10], FAR), Outcome { joined: 0b10, missing: 0 });
        });
    }

    #[test]
    fn a_member_that_hangs_costs_one_deadline_and_is_back_when_it_has_caught_up() {
        let (mut coordinator, mut members) = threads(1);
        let mut member = members.remove(0);
        let release = std::thread::scope(|scope| {
            let waiting = scope.spawn(|| member.await_release(FAR));
            let begun = coordinator.begin(1);
            let release = waiting.join().unwrap();
            assert_eq!(coordinator.finish(begun, system::now_ns() + SOON_NS).missing, 1);
            release
        });
        assert_eq!(
            coordinator.release(&[1], FAR),
            Outcome { joined: 0, missing: 1 },
            "excluded: no wait although the deadline is far"
        );
        member.join(release.unwrap());
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let release = member.await_release(FAR).unwrap();
                member.join(release);
            });
            assert_eq!(coordinator.release(&[1], FAR).joined, 1);
        });
    }
}
