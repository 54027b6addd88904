//! When a look comes, and whose time counts.

use super::*;

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
