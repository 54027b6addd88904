//! When a look comes, whose time counts, and who is said to be dead.

use super::*;
use crate::faults::tests::{begin, book};
use rustix::process::{PidfdFlags, getpid, pidfd_open};
use std::cell::RefCell;

#[test]
fn a_look_comes_at_its_phase_and_not_a_rounded_millisecond_later_and_news_end_the_wait() {
    let set = epoll::create(epoll::CreateFlags::CLOEXEC).unwrap();
    let bell = rustix::event::eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK).unwrap();
    epoll::add(&set, &bell, epoll::EventData::new_u64(BELL), epoll::EventFlags::IN).unwrap();
    let mut ready = Vec::with_capacity(SLOTS);
    let mut waited_ns = || {
        let begun_ns = system::now_ns();
        wait(&set, begun_ns - PHASE_NS + LOOK_NS / 5, &mut ready);
        (system::now_ns() - begun_ns, ready.len())
    };
    // The shortest of many: the machine may be busy.
    let (shortest_ns, news) = (0..100).map(|_| waited_ns()).min().unwrap();
    assert!((LOOK_NS / 5..LOOK_NS).contains(&shortest_ns) && news == 0, "{shortest_ns} ns");
    rustix::io::write(&bell, &1u64.to_ne_bytes()).unwrap();
    assert_eq!(waited_ns().1, 1);
}

#[test]
fn time_counts_while_another_moves_and_for_the_device_while_the_hardware_does() {
    for (role, others, moving, hardware_stands, expected) in [
        (Role::Tissue, 0, 0, false, true),
        (Role::Tissue, 3, 1, true, true),
        (Role::Tissue, 3, 0, false, false),
        (Role::Device, 3, 2, false, true),
        (Role::Device, 3, 2, true, false),
    ] {
        assert_eq!(counts(role, others, moving, hardware_stands), expected, "{role:?} {others} {moving} {hardware_stands}");
    }
}

/// By a flipped bit one who lives was nobody's holder, reader or victim for as long as it lived.
#[test]
fn who_lives_is_said_to_be_dead_until_the_next_look_and_who_dies_from_the_next_one_on() {
    let (station, _faults) = book("said-dead");
    let page = station.open_for_keeping().unwrap();
    let slot = Slot::first(Role::Rendering);
    let own = begin(&station, &page, slot, 7);
    let (word, now_ns) = (layout::SLOT_DEAD + slot.number(), system::now_ns());
    let pidfd = pidfd_open(getpid(), PidfdFlags::empty()).unwrap();
    let mut wards = [Ward::new(slot, 7, std::process::id(), pidfd, station.read_slot(slot, 7).unwrap(), now_ns)];
    let told = RefCell::new(Vec::new());
    let mut looked = || {
        let look = Look { number: 1, now_ns, passed_ns: LOOK_NS, stood_ns: 0, is_lockstep: false };
        look_at_all(&page, &mut wards, look, &|notice| told.borrow_mut().push(notice));
        let said: Vec<Notice> = told.take();
        (page.load32(word), said.len(), said.iter().all(|notice| matches!(notice, Notice::SaidDead { slot: of } if *of == slot)))
    };
    assert_eq!(looked(), (0, 0, true));
    page.store32(word, 1 << 20);
    assert_eq!([looked(), looked()], [(0, 1, true), (0, 0, true)], "taken back, and told once");
    std::thread::scope(|scope| assert!(scope.spawn(|| own.hold_latch()).join().unwrap()));
    assert_eq!([looked(), looked()], [(1, 0, true); 2], "who dies");
}
