//! Priority inversion and starvation: what is less important costs the real-time roles nothing.

use rustix::process::Signal;
use station_tests::Station;
use station_tests::windows::{Spinners, compare};

/// Entries into the system's allocator that a change of holder may cost in a run of more than 12 000 messages. None were seen in 8 runs of 10 to 12 s
/// with 0 to 4 changes (`hystation run --headless --workers 2 --report`, load average 11 to 15 on a 2-core VM, 2026-11-21).
const MOST_AT_CHANGES: f64 = 4.0;

/// Blocks that a process may take before it counts its steps.
const WARM_UP_BLOCKS: f64 = 8.0;

#[test]
fn ordinary_processes_that_spin_on_every_core_cost_the_hand_nothing() {
    let station = Station::start("spin", &["--hand", "script:press"]);
    let mut spinners = None;
    let cell = std::cell::RefCell::new(&mut spinners);
    compare("spinning processes", &station, |_| **cell.borrow_mut() = Some(Spinners::start(4)), |_| **cell.borrow_mut() = None);
    let ended = station.stop();
    ended.assert_clean();
    // The way from hand to force: none at all, and it has no pool that could hide one. Tissue and workers send messages: none for those beyond the
    // block of the link for each; a change of holder, which a stall of the machine may bring about, was seen to cost single ones.
    let real_time = [("hardware", 0.0), ("device", 0.0), ("haptic:0", 0.0), ("haptic:1", 0.0)];
    let senders = ["tissue:0", "tissue:1", "collision-worker:0", "collision-worker:1"].map(|name| (name, MOST_AT_CHANGES));
    for (process, most) in real_time.into_iter().chain(senders) {
        let allocations = ended.number(&format!("processes.{process}.allocations"));
        println!("{process}: {allocations} entries into the allocator");
        assert!(
            allocations <= most,
            "{process}: {allocations} entries into the system's allocator of the real-time thread since it became one"
        );
        // A tissue's step sends a state and a job, a worker's its share, and now and then one more where a stall of the machine came in between; one
        // more at each step is what nobody may take.
        let messages = match process.split(':').next() {
            Some("tissue") => 2.5,
            Some("collision-worker") => 1.5,
            _ => 0.0,
        };
        let blocks = ended.number(&format!("processes.{process}.pool_blocks"));
        let steps = ended.number(&format!("processes.{process}.steps"));
        println!("{process}: {blocks} blocks of its pool in {steps} steps");
        assert!(blocks <= messages * steps + WARM_UP_BLOCKS, "{process}: {blocks} blocks of its pool in {steps} steps");
    }
}

/// Rendering reads the tissue's state and holds samples of it; stopped, it is a stalled reader and a client that never fetches its answer.
#[test]
fn a_stalled_reader_and_client_costs_the_hand_nothing() {
    let station = Station::start("stall", &["--hand", "script:press"]);
    let stop = |station: &Station| station.signal(station.pid("rendering", true), Signal::STOP);
    let go_on = |station: &Station| {
        station.signal(station.pid("rendering", true), Signal::CONT);
        station.recover();
    };
    compare("a stalled reader", &station, stop, go_on);
    station.stop().assert_clean();
}
