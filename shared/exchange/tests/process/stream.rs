//! Streams whose writer or reader is killed or stands at every point.

use crate::support::*;
use hyst_exchange::stream::{MAX_HELD, READER_BUFFER};
use hyst_exchange::{Held, LinkError, Links, Station, system};
use hyst_messages::{Kind, Role, layout_hash};
use iceoryx2::prelude::*;

const KIND: Kind = Kind::TissueState;

fn assert_filled(held: &Held, number: u8) {
    assert!(
        !held.bytes().is_empty() && held.bytes().iter().all(|byte| *byte == number),
        "half a message, or another than {number}"
    );
}

fn join(station: &Station) -> Links {
    Links::join(station, "test").unwrap()
}

#[test]
fn a_writer_killed_at_any_point_leaves_whole_messages_that_stay_readable() {
    isolated(a_writer_killed_at_any_point_leaves_whole_messages_that_stay_readable, |station| {
        let links = join(station);
        let mut kept = Vec::new();
        let points = ["kill@before-loan:2", "kill@in-loan:2", "abort@in-loan:2", "kill@before-send:2", "kill@after-send:2"];
        for (incarnation, fate) in (1..).zip(points) {
            let service = links.create_service(Role::Tissue, incarnation, KIND).unwrap();
            let subscriber = links.subscriber(Role::Tissue, incarnation, KIND).unwrap();
            let mut writer = Partner::start(station, "publish", incarnation, fate, 0);
            writer.expect("open");
            subscriber.connect().unwrap();
            writer.tell("send");
            writer.expect("sent 1");
            let first = subscriber.newest().unwrap().expect("the first message");
            writer.tell("send");
            writer.await_death();
            let second = subscriber.newest().unwrap();
            assert_eq!(second.is_some(), fate == "kill@after-send:2", "{fate}: sent is there, unsent is not");
            links.clean_up_dead();
            drop((service, subscriber)); // nothing but the messages holds the segment now
            kept.push((first, 1));
            kept.extend(second.map(|second| (second, 2)));
            for (held, number) in &kept {
                assert_filled(held, *number);
            }
        }
    });
}

#[test]
fn readers_that_are_killed_or_stand_while_they_hold_messages_never_block_the_writer() {
    isolated(readers_that_are_killed_or_stand_while_they_hold_messages_never_block_the_writer, |station| {
        let links = join(station);
        let _service = links.create_service(Role::Tissue, 1, KIND).unwrap();
        let publisher = links.publisher(Role::Tissue, 1, KIND, 4096).unwrap();
        let healthy = links.subscriber(Role::Tissue, 1, KIND).unwrap();
        let mut readers: Vec<Partner> = (0..3).map(|_| Partner::start(station, "hold", 1, "live", 0)).collect();
        let send = |number: u8| {
            let mut loan = publisher.loan(4096).unwrap();
            loan.bytes_mut().fill(number);
            loan.send().unwrap();
        };
        for reader in &mut readers {
            reader.expect("open");
            send(1);
            reader.tell("take");
            reader.expect("holding 1");
        }
        readers[0].stop();
        readers[1].kill();
        for number in 2..200 {
            send(number);
            assert_filled(&healthy.newest().unwrap().expect("what was just sent"), number);
            if number == 100 {
                links.clean_up_dead();
            }
        }
        readers[0].go_on();
        for at in [0, 2] {
            readers[at].tell("take");
            readers[at].expect("holding 2");
        }
    });
}

/// Of two messages the first was received and dropped with the failure to receive the second: its reader went on from the one before.
#[test]
fn a_message_that_was_received_is_not_lost_when_the_next_one_cannot_be() {
    isolated(a_message_that_was_received_is_not_lost_when_the_next_one_cannot_be, |station| {
        let links = join(station);
        let _service = links.create_service(Role::Tissue, 1, KIND).unwrap();
        let publisher = links.publisher(Role::Tissue, 1, KIND, 4096).unwrap();
        let subscriber = links.subscriber(Role::Tissue, 1, KIND).unwrap();
        subscriber.connect().unwrap();
        let send = |number: u8| {
            let mut loan = publisher.loan(4096).unwrap();
            loan.bytes_mut().fill(number);
            loan.send().unwrap();
        };
        let mut held = Vec::new();
        for number in 1..MAX_HELD as u8 {
            send(number);
            held.push(subscriber.newest().unwrap().expect("what was just sent"));
        }
        let next = MAX_HELD as u8;
        (next..next + READER_BUFFER as u8).for_each(send);
        let last = subscriber.newest().unwrap().expect("the only one for which there was room");
        assert_filled(&last, next);
        assert!(matches!(subscriber.newest(), Err(LinkError::Use { .. })), "all that may be held are");
        held.clear();
        assert_filled(&subscriber.newest().unwrap().expect("the other one"), next + READER_BUFFER as u8 - 1);
    });
}

#[test]
fn a_zombie_writes_where_nobody_reads() {
    isolated(a_zombie_writes_where_nobody_reads, |station| {
        let links = join(station);
        let _services = [1, 2].map(|incarnation| links.create_service(Role::Tissue, incarnation, KIND).unwrap());
        let mut zombie = Partner::start(station, "publish", 1, "stop@in-loan", 0);
        zombie.expect("open");
        zombie.tell("send");
        zombie.await_stop();
        let mut successor = Partner::start(station, "publish", 2, "live", 0);
        successor.expect("open");
        let subscriber = links.subscriber(Role::Tissue, 2, KIND).unwrap();
        subscriber.connect().unwrap();
        successor.tell("send");
        successor.expect("sent 1");
        assert_filled(&subscriber.newest().unwrap().expect("the successor's message"), 1);
        zombie.go_on();
        zombie.expect("sent 1");
        assert!(subscriber.newest().unwrap().is_none(), "a message of the zombie");
        let second = links.publisher(Role::Tissue, 2, KIND, 64);
        assert!(matches!(second, Err(LinkError::Service { .. })), "a second writer of one service");
    });
}

#[test]
fn a_service_of_another_layout_or_type_is_not_opened() {
    isolated(a_service_of_another_layout_or_type_is_not_opened, |station| {
        let links = join(station);
        let node = NodeBuilder::new().create::<ipc_threadsafe::Service>().unwrap(); // the process's configuration is the station's
        let foreign = links.service_name(Role::Tissue, 1, KIND).replace(&format!("{:016x}", layout_hash()), "0123456789abcdef");
        let foreign = foreign.as_str().try_into().unwrap();
        let _other_layout = node.service_builder(&foreign).publish_subscribe::<[u8]>().create().unwrap();
        assert!(matches!(links.subscriber(Role::Tissue, 1, KIND), Err(LinkError::Service { .. })));
        let own = links.service_name(Role::Tissue, 2, KIND);
        let _other_type = node.service_builder(&own.as_str().try_into().unwrap()).publish_subscribe::<u64>().create().unwrap();
        assert!(matches!(links.subscriber(Role::Tissue, 2, KIND), Err(LinkError::Service { .. })));
        assert!(matches!(links.publisher(Role::Tissue, 2, KIND, 64), Err(LinkError::Service { .. })));
    });
}

/// The library would give a second station of a process the configuration of the first, without a word.
#[test]
fn a_process_joins_one_station_only() {
    isolated(a_process_joins_one_station_only, |station| {
        let _links = join(station);
        let other = Station::named(&format!("{}-2", station.name())).unwrap();
        other.found().unwrap();
        let refused = Links::join(&other, "test");
        other.wipe();
        assert!(matches!(refused, Err(LinkError::Configuration { .. })));
        assert_eq!(other.leftovers(), Vec::<std::path::PathBuf>::new());
    });
}

/// Its supervisor was killed before a newborn tissue had opened the second of its services: it was gone with the first one's opening, which had cleaned up after the
/// dead, and the newborn ended.
#[test]
fn services_whose_creator_was_killed_are_there_for_whoever_opens_them_one_after_the_other() {
    isolated(services_whose_creator_was_killed_are_there_for_whoever_opens_them_one_after_the_other, |station| {
        let mut creator = Partner::start(station, "found", 1, "live", 0);
        creator.expect("created");
        creator.kill();
        let links = join(station);
        let _state = links.publisher(Role::Tissue, 1, Kind::TissueState, 64).unwrap();
        let job = links.publisher(Role::Tissue, 1, Kind::CollisionJob, 64);
        assert!(job.is_ok(), "{:?}", job.err());
        links.clean_up_dead();
    });
}

/// Who touches memory that there is not dies of it, and it would be whoever connects while others fill it.
#[test]
fn where_shared_memory_is_full_nobody_begins_to_read_or_to_ask_and_where_it_is_free_again_everybody_may() {
    const FILLED: &str = "/dev/shm/others";
    isolated_in(
        where_shared_memory_is_full_nobody_begins_to_read_or_to_ask_and_where_it_is_free_again_everybody_may,
        64,
        |station| {
            let links = join(station);
            let _stream = links.create_service(Role::Tissue, 1, KIND).unwrap();
            let _rendezvous = links.create_rendezvous(Role::Tissue, 1, Kind::Appearance).unwrap();
            let _writer = links.publisher(Role::Tissue, 1, KIND, 64).unwrap();
            let _server = links.server(Role::Tissue, 1, Kind::Appearance).unwrap();
            let refused = || {
                let reader = links.subscriber(Role::Tissue, 1, KIND).err();
                [reader, links.client(Role::Tissue, 1, Kind::Appearance).err()].map(|error| error.map(|error| error.to_string()))
            };
            assert_eq!(refused(), [None, None]);
            let free = system::free_bytes(station.root()).unwrap();
            let others = std::fs::File::create(FILLED).unwrap();
            let half_mib = 1 << 19;
            rustix::fs::fallocate(&others, rustix::fs::FallocateFlags::empty(), 0, free - half_mib).unwrap();
            for (said, kind) in refused().into_iter().zip([KIND, Kind::Appearance]) {
                let name = links.service_name(Role::Tissue, 1, kind);
                assert_eq!(said, Some(format!("{name}: /dev/shm has 512 KiB free, and it takes 1024; look at `df /dev/shm`")));
            }
            std::fs::remove_file(FILLED).unwrap();
            drop(others);
            assert_eq!(refused(), [None, None]);
        },
    );
}
