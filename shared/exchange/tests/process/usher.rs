//! The usher: what arrives of newcomers, of those who die in their start-up, and of successors.

use crate::support::*;
use hyst_exchange::usher::{Arrival, Departure, Inbox, Port, Wanted, usher};
use hyst_exchange::{Links, OwnedPage, Station, Subscriber, system};
use hyst_messages::mischief::{Mischief, Request, Thread};
use hyst_messages::page::{header, station as layout};
use hyst_messages::{Kind, Role, Slot};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::os::fd::AsRawFd;

const KIND: Kind = Kind::TissueState;
const ME: u32 = 99;

struct House {
    station: Station,
    links: Links,
    keeper: OwnedPage,
    inbox: Inbox,
    markers: u32,
}

fn house(station: &Station) -> House {
    let links = Links::join(station, "supervisor").unwrap();
    let ushers = Links::join(station, "usher").unwrap();
    let interests = vec![(Role::Tissue, Wanted::Page), (Role::Tissue, Wanted::Stream(KIND)), (Role::Fluid, Wanted::Page)];
    let inbox = usher(station, Some(ushers), ME, interests).unwrap();
    House { station: station.clone(), links, keeper: station.open_for_keeping().unwrap(), inbox, markers: 0 }
}

impl House {
    fn next(&mut self) -> Arrival {
        until(|| self.inbox.take())
    }
    /// Starts a tissue, as the supervisor does.
    fn newcomer(&self, incarnation: u32, fate: &str) -> (Partner, hyst_exchange::stream::HeldService) {
        let service = self.links.create_service(Role::Tissue, incarnation, KIND).unwrap();
        drop(self.station.create_slot(slot(Role::Tissue), incarnation).unwrap());
        announce(&self.keeper, slot(Role::Tissue), incarnation);
        (Partner::start(&self.station, "newcomer", incarnation, fate, 0), service)
    }
    /// A page without a process, whose arrival shows that the usher has looked at everything announced before it.
    fn marker(&mut self, index: usize) -> Vec<Arrival> {
        let slot = Slot::new(Role::Fluid, index).unwrap();
        self.markers += 1;
        let incarnation = 200 + self.markers;
        drop(self.station.create_slot(slot, incarnation).unwrap());
        announce(&self.keeper, slot, incarnation);
        let mut before = Vec::new();
        loop {
            let arrival = self.next();
            if arrival.incarnation == incarnation {
                return before;
            }
            before.push(arrival);
        }
    }
}

fn stream_of(arrival: Arrival) -> Subscriber {
    match arrival.port {
        Port::Stream(KIND, subscriber) => subscriber,
        other => panic!("a stream was expected: {other:?}"),
    }
}

#[test]
fn pages_and_streams_of_a_newcomer_and_of_its_successor_arrive_ready_for_use() {
    isolated(pages_and_streams_of_a_newcomer_and_of_its_successor_arrive_ready_for_use, |station| {
        let mut house = house(station);
        for incarnation in [3, 4, 5] {
            let (mut partner, _service) = house.newcomer(incarnation, "live");
            let arrival = house.next();
            assert_eq!((arrival.slot, arrival.incarnation), (slot(Role::Tissue), incarnation));
            let Port::Page(page) = arrival.port else { panic!("the page is first: {:?}", arrival.port) };
            assert_eq!(page.incarnation(), incarnation);
            partner.expect("open");
            let arrival = house.next();
            assert_eq!(arrival.incarnation, incarnation);
            let subscriber = stream_of(arrival);
            partner.tell("send");
            partner.expect("sent");
            let held = subscriber.newest().unwrap().expect("what the newcomer sent");
            assert_eq!(held.bytes(), [incarnation as u8; 64]);
            partner.kill();
            declare_dead(&house.keeper, slot(Role::Tissue));
            assert_eq!(held.bytes(), [incarnation as u8; 64], "its last message outlives it");
            for departure in [Departure::Page(page), Departure::Message(held), Departure::Stream(subscriber)] {
                assert!(house.inbox.retire(departure));
            }
        }
        assert!(house.inbox.take().is_none());
    });
}

/// Otherwise the usher looks for its ports a thousand times per second, for about 20 s.
#[test]
fn a_process_that_dies_in_its_start_up_is_given_up_and_its_successor_arrives() {
    isolated(a_process_that_dies_in_its_start_up_is_given_up_and_its_successor_arrives, |station| {
        let mut house = house(station);
        for (index, fate) in [(0, "kill@before-ports"), (1, "kill@after-ports")] {
            let incarnation = 2 + index as u32;
            let (mut partner, _service) = house.newcomer(incarnation, fate);
            assert!(matches!(house.next().port, Port::Page(_)));
            partner.await_death();
            declare_dead(&house.keeper, slot(Role::Tissue));
            // Were it still waited for, this would make its stream arrive.
            assert!(house.marker(0).is_empty(), "{fate}");
            station.own_slot(slot(Role::Tissue), incarnation).unwrap().store32(header::PORTS_OPEN, 1);
            assert!(house.marker(1).is_empty(), "{fate}: a port of the dead");
        }

        let (mut successor, _service) = house.newcomer(4, "live");
        successor.expect("open");
        for _ in 0..2 {
            assert_eq!(house.next().incarnation, 4);
        }
    });
}

#[test]
fn one_that_stands_in_its_start_up_holds_up_nobody_and_arrives_when_it_goes_on() {
    isolated(one_that_stands_in_its_start_up_holds_up_nobody_and_arrives_when_it_goes_on, |station| {
        let mut house = house(station);
        let (mut partner, _service) = house.newcomer(3, "stop@before-ports");
        assert!(matches!(house.next().port, Port::Page(_)));
        partner.await_stop();
        assert!(house.marker(0).is_empty());
        partner.go_on();
        partner.expect("open");
        assert_eq!(stream_of(house.next()).incarnation(), 3);
    });
}

/// By a flipped bit one that was on its way was known, and was never met.
#[test]
fn one_that_is_said_to_be_dead_for_a_moment_arrives_all_the_same() {
    isolated(one_that_is_said_to_be_dead_for_a_moment_arrives_all_the_same, |station| {
        let mut house = house(station);
        let (mut partner, _service) = house.newcomer(3, "stop@before-ports");
        assert!(matches!(house.next().port, Port::Page(_)));
        partner.await_stop();
        declare_dead(&house.keeper, slot(Role::Tissue));
        assert!(house.marker(0).is_empty());
        announce(&house.keeper, slot(Role::Tissue), 3);
        partner.go_on();
        partner.expect("open");
        assert_eq!(stream_of(house.next()).incarnation(), 3);
    });
}

/// By that its engine finds one that stands still, with nobody to meet.
#[test]
fn an_usher_gets_on_again_and_again_unless_it_stands_still() {
    isolated(an_usher_gets_on_again_and_again_unless_it_stands_still, |station| {
        let house = house(station);
        let (mine, rounds) = (slot(Role::Recorder), house.inbox.rounds());
        let own = station.create_slot(mine, ME).unwrap();
        announce(&house.keeper, mine, ME);
        let gets_on = || {
            let before = rounds.count();
            until(|| (rounds.count() > before + 2).then_some(()));
        };
        gets_on();
        house.keeper.store32(layout::TEST_MODE, 1);
        let request = Request { thread: Thread::Usher, ..Request::of(Mischief::Block, ME) };
        let [what, _, thread] = request.words();
        house.keeper.store64(layout::MISCHIEF_EXTENT + mine.number(), thread);
        house.keeper.store64(layout::MISCHIEF + mine.number(), what);
        house.keeper.bump_and_wake(layout::CHANGES);
        until(|| (own.load64(header::MISCHIEF) > 0).then_some(()));
        let stood = rounds.count();
        system::sleep_ns(50_000_000); // in which it would get on at least twice
        assert_eq!(rounds.count(), stood);
        house.keeper.store64(layout::MISCHIEF + mine.number(), 0);
        gets_on();
    });
}

/// A fault that leaves an engine without files proved nothing: whether it had met anybody whom it was to open was told by nobody.
#[test]
fn who_has_no_descriptor_left_for_a_newcomer_says_when_and_meets_it_later() {
    isolated(who_has_no_descriptor_left_for_a_newcomer_says_when_and_meets_it_later, |station| {
        let mut house = house(station);
        assert!(house.marker(0).is_empty());
        let rounds = house.inbox.rounds();
        assert_eq!(rounds.without_file_ns(), 0);
        drop(station.create_slot(slot(Role::Tissue), 3).unwrap());
        let begun = getrlimit(Resource::Nofile);
        // The lowest that is free, and is again once this is closed.
        let free = std::fs::File::open("/dev/null").unwrap().as_raw_fd() as u64;
        setrlimit(Resource::Nofile, Rlimit { current: Some(free), ..begun }).unwrap();
        let begun_ns = system::now_ns();
        announce(&house.keeper, slot(Role::Tissue), 3);
        until(|| (rounds.without_file_ns() >= begun_ns).then_some(()));
        assert!(house.inbox.take().is_none());
        setrlimit(Resource::Nofile, begun).unwrap();
        assert_eq!(house.next().incarnation, 3);
    });
}
