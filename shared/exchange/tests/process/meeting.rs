//! The Meeting Point between processes when a member or the coordinator dies or stands.

use crate::support::*;
use hyst_exchange::meeting::{Coordinator, Member, Outcome, ProcessCoordinator, ProcessMember};
use hyst_exchange::{Station, system};
use hyst_messages::Role;
use hyst_messages::page::header;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// What a release with a dead member pays once, ns; the living join well within it even on a busy machine.
const PAID_NS: u64 = 3_000_000_000;
/// What a release pays if nobody who could join is asked, ns.
const SHORT_NS: u64 = 20_000_000;

fn coordinator(station: &Station, incarnation: u32) -> ProcessCoordinator {
    ProcessCoordinator::new(Arc::new(station.create_slot(slot(Role::Tissue), incarnation).unwrap()))
}

/// A member process of coordinator 1, not yet seated.
fn member(station: &Station, incarnation: u32, fate: &str) -> Partner {
    drop(station.create_slot(slot(Role::CollisionWorker), incarnation).unwrap());
    let mut partner = Partner::start(station, "member", incarnation, fate, 1);
    partner.expect("following");
    partner
}

/// A member in this process.
fn own_member(station: &Station, incarnation: u32, coordinator: u32) -> ProcessMember {
    let page = station.create_slot(slot(Role::CollisionWorker), incarnation).unwrap();
    let mut member = ProcessMember::new(Arc::new(page));
    member.follow(station.read_slot(slot(Role::Tissue), coordinator).unwrap());
    member
}

fn seat(station: &Station, coordinator: &mut ProcessCoordinator, index: usize, incarnation: u32) {
    coordinator.seat(index, station.read_slot(slot(Role::CollisionWorker), incarnation).unwrap());
}

/// The release that a member has joined last.
fn joined(station: &Station, incarnation: u32) -> u32 {
    station.read_slot(slot(Role::CollisionWorker), incarnation).unwrap().load64(header::JOINED) as u32
}

/// Releases with a deadline far away and asserts that it was not paid.
fn release_unpaid(coordinator: &mut ProcessCoordinator, groups: &[u32]) -> Outcome {
    let deadline_ns = far_ns();
    let outcome = coordinator.release(groups, deadline_ns);
    assert!(system::now_ns() < deadline_ns, "the release paid its deadline: {outcome:?}");
    outcome
}

/// Releases with a short deadline, which the first group misses; again where it was over before anybody was asked, because this process was not let run.
fn release_missed(coordinator: &mut ProcessCoordinator, groups: &[u32]) -> Outcome {
    until(|| {
        let outcome = coordinator.release(groups, system::now_ns() + SHORT_NS);
        (coordinator.present() & groups[0] == 0).then_some(outcome)
    })
}

#[test]
fn a_member_killed_at_any_point_costs_one_deadline_and_its_replacement_joins_the_next_release() {
    isolated(a_member_killed_at_any_point_costs_one_deadline_and_its_replacement_joins_the_next_release, |station| {
        let mut coordinator = coordinator(station, 1);
        let _other = member(station, 9, "live");
        seat(station, &mut coordinator, 1, 9);
        let points = ["kill@before-release", "kill@before-join", "abort@before-join", "kill@after-join"];
        for (incarnation, fate) in (10..).step_by(2).zip(points) {
            let mut mortal = member(station, incarnation, fate);
            seat(station, &mut coordinator, 0, incarnation);
            if fate == "kill@before-release" {
                mortal.kill();
            }
            if fate == "kill@after-join" {
                assert_eq!(release_unpaid(&mut coordinator, &[0b11]), Outcome { joined: 0b11, missing: 0 });
                mortal.await_death();
            }
            let paid = coordinator.release(&[0b11], system::now_ns() + PAID_NS);
            assert_eq!(paid, Outcome { joined: 0b10, missing: 0b01 }, "{fate}");
            mortal.kill();
            for _ in 0..20 {
                let unpaid = release_unpaid(&mut coordinator, &[0b11]);
                assert_eq!(unpaid, Outcome { joined: 0b10, missing: 0b01 }, "{fate}: excluded after the first miss");
            }
            let _replacement = member(station, incarnation + 1, "live");
            seat(station, &mut coordinator, 0, incarnation + 1);
            assert_eq!(release_unpaid(&mut coordinator, &[0b11]), Outcome { joined: 0b11, missing: 0 }, "{fate}");
        }
    });
}

#[test]
fn a_member_that_stands_at_any_point_costs_one_deadline_and_is_back_when_it_goes_on() {
    isolated(a_member_that_stands_at_any_point_costs_one_deadline_and_is_back_when_it_goes_on, |station| {
        let mut coordinator = coordinator(station, 1);
        let _other = member(station, 9, "live");
        seat(station, &mut coordinator, 1, 9);
        for (incarnation, fate) in (10..).zip(["live", "stop@before-join", "stop@after-join"]) {
            let standing = member(station, incarnation, fate);
            seat(station, &mut coordinator, 0, incarnation);
            if fate == "live" {
                standing.stop();
            }
            if fate == "stop@after-join" {
                assert_eq!(release_unpaid(&mut coordinator, &[0b11]), Outcome { joined: 0b11, missing: 0 });
                standing.await_stop();
            }
            let paid = coordinator.release(&[0b11], system::now_ns() + PAID_NS);
            assert_eq!(paid, Outcome { joined: 0b10, missing: 0b01 }, "{fate}");
            standing.await_stop();
            for _ in 0..20 {
                let unpaid = release_unpaid(&mut coordinator, &[0b11]);
                assert_eq!(unpaid, Outcome { joined: 0b10, missing: 0b01 }, "{fate}: excluded after the first miss");
            }
            standing.go_on();
            until(|| (release_unpaid(&mut coordinator, &[0b11]).missing == 0).then_some(()));
        }
    });
}

#[test]
fn a_member_that_stood_is_back_once_it_has_joined_late() {
    isolated(a_member_that_stood_is_back_once_it_has_joined_late, |station| {
        let mut coordinator = coordinator(station, 1);
        let slow = member(station, 10, "stop@before-join");
        seat(station, &mut coordinator, 0, 10);
        assert_eq!(release_missed(&mut coordinator, &[1]), Outcome { joined: 0, missing: 1 });
        slow.await_stop();
        assert_eq!(release_unpaid(&mut coordinator, &[1]), Outcome { joined: 0, missing: 1 });
        slow.go_on();
        until(|| (joined(station, 10) != 0).then_some(()));
        assert_eq!(release_unpaid(&mut coordinator, &[1]), Outcome { joined: 1, missing: 0 });
    });
}

/// A member that comes when nobody waits for it any longer: each time it is asked it costs the deadline.
fn ask_in_vain(coordinator: &mut ProcessCoordinator, slow: &mut ProcessMember) {
    until(|| {
        coordinator.release(&[1], system::now_ns() + 100_000);
        let release = slow.await_release(system::now_ns())?;
        slow.join(release);
        Some(())
    });
}

#[test]
fn a_member_that_is_late_each_time_is_asked_ever_more_rarely_until_it_is_in_time() {
    isolated(a_member_that_is_late_each_time_is_asked_ever_more_rarely_until_it_is_in_time, |station| {
        let mut coordinator = coordinator(station, 1);
        let mut slow = own_member(station, 10, 1);
        seat(station, &mut coordinator, 0, 10);
        let begun_ns = system::now_ns();
        for misses in 1..=6 {
            let asked_ns = system::now_ns();
            ask_in_vain(&mut coordinator, &mut slow);
            let rest_ns = hyst_exchange::meeting::rules::rest_ns(misses);
            assert!(coordinator.resting() == 1 || system::now_ns() - asked_ns >= rest_ns, "{misses} misses");
            // Whoever asks sooner has not let it rest. The last rest is not over yet.
            let rested_ns: u64 = (1..misses).map(hyst_exchange::meeting::rules::rest_ns).sum();
            assert!(system::now_ns() - begun_ns >= rested_ns, "{misses} misses");
        }
        let forgiven = 6; // as often as it has missed
        std::thread::scope(|scope| {
            let slow = &mut slow;
            scope.spawn(move || {
                for _ in 0..forgiven {
                    let release = slow.await_release(far_ns()).unwrap();
                    slow.join(release);
                }
            });
            let mut joined = 0;
            until(|| {
                joined += release_unpaid(&mut coordinator, &[1]).joined;
                (joined == forgiven).then_some(())
            });
        });
        ask_in_vain(&mut coordinator, &mut slow);
        coordinator.readmit();
        assert_eq!(coordinator.present(), 1, "its first miss again");
    });
}

#[test]
fn the_late_join_of_a_zombie_counts_for_nothing() {
    isolated(the_late_join_of_a_zombie_counts_for_nothing, |station| {
        let mut coordinator = coordinator(station, 1);
        let zombie = member(station, 10, "stop@before-join");
        seat(station, &mut coordinator, 0, 10);
        assert_eq!(release_missed(&mut coordinator, &[1]).missing, 1);
        zombie.await_stop();
        let replacement = member(station, 11, "stop@before-join");
        seat(station, &mut coordinator, 0, 11);
        let ended = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let releasing = scope.spawn(|| {
                let outcome = release_unpaid(&mut coordinator, &[1]);
                ended.store(true, Ordering::SeqCst);
                outcome
            });
            replacement.await_stop();
            zombie.go_on();
            until(|| (joined(station, 10) != 0).then_some(()));
            assert!(!ended.load(Ordering::SeqCst), "the zombie's join ended the release");
            replacement.go_on();
            assert_eq!(releasing.join().unwrap(), Outcome { joined: 1, missing: 0 });
        });
    });
}

/// A member that looked at the newest release alone would see none that named it, and never be readmitted.
#[test]
fn a_member_that_slept_through_its_release_does_no_work_for_it_and_is_back() {
    isolated(a_member_that_slept_through_its_release_does_no_work_for_it_and_is_back, |station| {
        let mut coordinator = coordinator(station, 1);
        let _other = member(station, 9, "live");
        seat(station, &mut coordinator, 1, 9);
        let mut sleeper = member(station, 10, "kill@before-join"); // any work that it does is its last
        seat(station, &mut coordinator, 0, 10);
        sleeper.stop();
        assert_eq!(release_missed(&mut coordinator, &[0b01]).missing, 0b01);
        assert_eq!(release_unpaid(&mut coordinator, &[0b10]).joined, 0b10);
        sleeper.go_on();
        until(|| (joined(station, 10) != 0).then_some(()));
        assert_eq!(coordinator.release(&[0b01], system::now_ns() + PAID_NS).missing, 0b01, "it was asked again");
        sleeper.await_death();
    });
}

/// A newcomer that looked at the mask of the release in force would take what named its predecessor for its own.
#[test]
fn a_replacement_does_not_take_the_release_of_its_predecessor() {
    isolated(a_replacement_does_not_take_the_release_of_its_predecessor, |station| {
        let mut coordinator = coordinator(station, 1);
        let predecessor = own_member(station, 10, 1);
        seat(station, &mut coordinator, 0, 10);
        assert_eq!(release_missed(&mut coordinator, &[1]).missing, 1);
        drop(predecessor);
        let mut replacement = own_member(station, 11, 1);
        seat(station, &mut coordinator, 0, 11);
        assert_eq!(replacement.await_release(system::now_ns()), None);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let release = replacement.await_release(far_ns()).unwrap();
                replacement.join(release);
            });
            assert_eq!(release_unpaid(&mut coordinator, &[1]).joined, 1);
        });
    });
}

#[test]
fn groups_run_in_sequence_and_one_whose_time_is_up_is_not_excluded() {
    isolated(groups_run_in_sequence_and_one_whose_time_is_up_is_not_excluded, |station| {
        let mut coordinator = coordinator(station, 1);
        for (index, incarnation) in [(0, 10), (1, 11)] {
            drop(own_member(station, incarnation, 1)); // its page stays
            seat(station, &mut coordinator, index, incarnation);
        }
        assert_eq!(release_missed(&mut coordinator, &[0b01, 0b10]), Outcome { joined: 0, missing: 0b11 });
        assert_eq!(coordinator.present(), 0b10, "the second group could do nothing about the first");
        seat(station, &mut coordinator, 0, 10);
        let open = |incarnation| {
            let page = station.own_slot(slot(Role::CollisionWorker), incarnation).unwrap();
            let mut member = ProcessMember::new(Arc::new(page));
            member.follow(station.read_slot(slot(Role::Tissue), 1).unwrap());
            member
        };
        let (mut first, mut second) = (open(10), open(11));
        std::thread::scope(|scope| {
            scope.spawn(move || {
                for _ in 0..500 {
                    let release = first.await_release(far_ns()).unwrap();
                    first.join(release);
                }
            });
            let before = station.read_slot(slot(Role::CollisionWorker), 10).unwrap();
            scope.spawn(move || {
                for _ in 0..500 {
                    let release = second.await_release(far_ns()).unwrap();
                    assert_eq!(
                        before.load64(header::JOINED) as u32,
                        release.number - 1,
                        "the second group began before the first had ended"
                    );
                    second.join(release);
                }
            });
            for _ in 0..500 {
                assert_eq!(release_unpaid(&mut coordinator, &[0b01, 0b10]), Outcome { joined: 0b11, missing: 0 });
            }
        });
    });
}

/// The coordinator dies or stands before it releases, between release and join, and after the join.
#[test]
fn members_of_a_coordinator_that_is_gone_time_out_and_follow_the_next() {
    isolated(members_of_a_coordinator_that_is_gone_time_out_and_follow_the_next, |station| {
        let mut member = ProcessMember::new(Arc::new(station.create_slot(slot(Role::CollisionWorker), 50).unwrap()));
        let mut gone = Vec::new();
        for (incarnation, (point, stands)) in (1..).zip([(0, false), (1, false), (2, false), (0, true), (1, true), (2, true)]) {
            drop(station.create_slot(slot(Role::Tissue), incarnation).unwrap());
            let mut coordinator = Partner::start(station, "coordinate", incarnation, "live", 50);
            coordinator.expect("seated");
            member.follow(station.read_slot(slot(Role::Tissue), incarnation).unwrap());
            assert_eq!(member.follows(), incarnation);
            for _ in 0..3 {
                coordinator.tell("release");
                let release = member.await_release(far_ns()).unwrap();
                assert_eq!(release.coordinator, incarnation);
                member.join(release);
                coordinator.expect("joined 1");
            }
            let end = |coordinator: &mut Partner| if stands { coordinator.stop() } else { coordinator.kill() };
            if point == 0 {
                end(&mut coordinator);
            } else {
                coordinator.tell("release");
                let release = member.await_release(far_ns()).unwrap();
                if point == 2 {
                    member.join(release);
                    coordinator.expect("joined 1");
                    end(&mut coordinator);
                } else {
                    end(&mut coordinator);
                    member.join(release);
                }
            }
            assert_eq!(member.await_release(system::now_ns() + SHORT_NS), None, "a release by nobody");
            gone.push(coordinator);
        }
    });
}
