//! A thread beside the steps that waits because it was asked to: in test mode alone, and until it is to stop at the latest. Who is helped by it is not asked, and
//! nothing of its own says that it waits: that is what is tried.

use crate::{StationPage, system};
use hyst_messages::mischief::{Mischief, Request, Thread};
use hyst_messages::page::station as layout;
use hyst_messages::{Slot, TICK_NS};
use std::sync::atomic::{AtomicBool, Ordering};

/// Called in each round of such a thread of a process: waits as long as it is asked to, and calls `own_up` once if it is.
pub fn stall(page: &StationPage, slot: Slot, incarnation: u32, thread: Thread, stop: &AtomicBool, own_up: impl FnOnce()) {
    if !is_asked(page, slot, incarnation, thread) {
        return;
    }
    own_up();
    while is_asked(page, slot, incarnation, thread) && !stop.load(Ordering::Acquire) && !page.stop_requested() {
        system::sleep_ns(TICK_NS);
    }
}

fn is_asked(page: &StationPage, slot: Slot, incarnation: u32, thread: Thread) -> bool {
    let (page, at) = (page.page(), slot.number());
    if page.load32(layout::TEST_MODE) == 0 {
        return false;
    }
    let words = [layout::MISCHIEF, layout::MISCHIEF_UNTIL_NS, layout::MISCHIEF_EXTENT].map(|word| page.load64(word + at));
    let request = Request::from_words(words, incarnation).filter(|request| request.what == Mischief::Block);
    request.is_some_and(|request| request.thread == thread && (request.until_ns == 0 || system::now_ns() < request.until_ns))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Station;
    use hyst_messages::Role;

    #[test]
    fn a_thread_waits_if_it_is_the_one_that_was_asked_and_not_longer_than_its_process_lives() {
        let station = Station::named(&format!("t{}-stall", std::process::id())).unwrap();
        station.wipe();
        station.found().unwrap();
        let (page, keeping, slot) = (station.open().unwrap(), station.open_for_keeping().unwrap(), Slot::first(Role::Haptic));
        let ask = |request: Request| {
            let places = [layout::MISCHIEF, layout::MISCHIEF_UNTIL_NS, layout::MISCHIEF_EXTENT];
            places.into_iter().zip(request.words()).for_each(|(place, word)| keeping.store64(place + slot.number(), word));
        };
        // One that is to stop does not wait, and has owned up all the same.
        let stop = AtomicBool::new(true);
        let owns_up = |incarnation: u32, thread: Thread| {
            let mut has = false;
            stall(&page, slot, incarnation, thread, &stop, || has = true);
            has
        };
        let drain = Request { thread: Thread::Drain, ..Request::of(Mischief::Block, 4) };
        ask(drain);
        assert!(!owns_up(4, Thread::Drain), "outside of test mode");
        keeping.store32(layout::TEST_MODE, 1);
        assert!(owns_up(4, Thread::Drain));
        assert!(!owns_up(4, Thread::Usher) && !owns_up(5, Thread::Drain), "another thread, another life");
        ask(Request { until_ns: 1, ..drain });
        assert!(!owns_up(4, Thread::Drain), "it is over");
        ask(Request::of(Mischief::Block, 4));
        assert!(!owns_up(4, Thread::Drain), "its steps are asked");
        station.wipe();
    }
}
