//! What a real-time thread does with a stream: sending and receiving allocate nothing. A loan costs one small allocation inside
//! iceoryx2 0.10 (the handle of the sample is counted on the heap, in the single-threaded variant too); the count here is exact, so that
//! a release of the library that does without is noticed.

use hyst_exchange::{Links, Station, allocation};
use hyst_messages::{Kind, Role};

#[global_allocator]
static ALLOCATOR: allocation::Counting = allocation::Counting;

#[test]
fn send_and_receive_allocate_nothing_and_a_loan_once() {
    let station = Station::named(&format!("t{}-alloc", std::process::id())).unwrap();
    station.wipe();
    station.found().unwrap();
    {
        let links = Links::join(&station, "allocation").unwrap();
        let _service = links.create_service(Role::Tissue, 1, Kind::TissueState).unwrap();
        let publisher = links.publisher(Role::Tissue, 1, Kind::TissueState, 4096).unwrap();
        let subscriber = links.subscriber(Role::Tissue, 1, Kind::TissueState).unwrap();
        subscriber.connect().unwrap();
        let mut held = None;
        let mut counts = [0; 3];
        for round in 0..200 {
            let before = allocation::of_this_thread();
            let mut loan = publisher.loan(4096).unwrap();
            let loaned = allocation::of_this_thread();
            loan.bytes_mut()[0] = round;
            loan.send().unwrap();
            let sent = allocation::of_this_thread();
            held = subscriber.newest().unwrap();
            let received = allocation::of_this_thread();
            if round >= 100 {
                counts = [counts[0] + loaned - before, counts[1] + sent - loaned, counts[2] + received - sent];
            }
        }
        assert!(held.is_some());
        assert_eq!(counts, [100, 0, 0], "allocations of 100 loans, sends and receives");
    }
    station.wipe();
}
