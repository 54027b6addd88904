//! What the link asks of the allocator: sending and receiving nothing, a loan one small block inside iceoryx2 0.10 (the handle of the
//! sample is counted on the heap, in the single-threaded variant too). A thread with a pool gets that block without the system's
//! allocator. The counts are exact, so that a release of the library that does without is noticed.

use hyst_exchange::allocation::{self, BLOCK_BYTES, BLOCKS};
use hyst_exchange::{Links, Publisher, Station, Subscriber};
use hyst_messages::{Kind, Role};

#[global_allocator]
static ALLOCATOR: allocation::Counting = allocation::Counting;

/// Runs on a thread that has a pool.
fn with_pool<T: Send>(body: impl FnOnce() -> T + Send) -> T {
    std::thread::scope(|scope| {
        let on_thread = || {
            assert!(allocation::give_this_thread_a_pool() && allocation::give_this_thread_a_pool());
            body()
        };
        scope.spawn(on_thread).join().unwrap()
    })
}

/// Entries into the system's allocator of 100 loans, sends and receives, after as many that are not counted.
fn entries(publisher: &Publisher, subscriber: &Subscriber) -> [u64; 3] {
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
    assert_eq!(held.unwrap().bytes()[0], 199);
    counts
}

/// What this process has in memory, bytes.
fn resident_bytes() -> usize {
    let text = std::fs::read_to_string("/proc/self/statm").unwrap();
    let pages: usize = text.split_whitespace().nth(1).unwrap().parse().unwrap();
    pages * rustix::param::page_size()
}

#[test]
fn what_is_given_back_stays_with_the_process_once_that_is_asked_for() {
    const LIST_BYTES: usize = 16 << 20;
    allocation::keep_what_is_freed();
    let before = resident_bytes();
    drop(std::hint::black_box(vec![1u8; LIST_BYTES]));
    let more = resident_bytes().saturating_sub(before);
    assert!(more > LIST_BYTES / 2, "of a list of {LIST_BYTES} bytes {more} have stayed");
}

#[test]
fn a_message_enters_the_system_allocator_twice_and_never_on_a_thread_with_a_pool() {
    let station = Station::named(&format!("t{}-alloc", std::process::id())).unwrap();
    station.wipe();
    station.found().unwrap();
    {
        let links = Links::join(&station, "allocation").unwrap();
        let _service = links.create_service(Role::Tissue, 1, Kind::TissueState).unwrap();
        let publisher = links.publisher(Role::Tissue, 1, Kind::TissueState, 4096).unwrap();
        let subscriber = links.subscriber(Role::Tissue, 1, Kind::TissueState).unwrap();
        subscriber.connect().unwrap();
        assert_eq!(entries(&publisher, &subscriber), [100, 100, 0], "one block, made by the loan and freed by the send");
        assert_eq!(with_pool(|| entries(&publisher, &subscriber)), [0, 0, 0]);
    }
    station.wipe();
}

#[test]
fn what_a_pool_cannot_give_comes_from_the_system_and_is_counted() {
    let counted = with_pool(|| {
        let before = allocation::of_this_thread();
        let mut held: [Option<Box<[u8; BLOCK_BYTES]>>; BLOCKS] = [const { None }; BLOCKS];
        for (index, place) in held.iter_mut().enumerate() {
            *place = std::hint::black_box(Some(Box::new([index as u8; BLOCK_BYTES])));
        }
        let full = allocation::of_this_thread() - before;
        let more = std::hint::black_box(Box::new(7u8));
        let beyond = allocation::of_this_thread() - before;
        let are_whole =
            held.iter().enumerate().all(|(index, block)| block.as_ref().unwrap().iter().all(|byte| *byte == index as u8));
        drop((more, held));
        let mut growing = vec![5u8; BLOCK_BYTES];
        let given_back = allocation::of_this_thread() - before;
        growing.push(6);
        let grown = allocation::of_this_thread() - before;
        let is_kept = growing[..BLOCK_BYTES].iter().all(|byte| *byte == 5) && growing[BLOCK_BYTES] == 6;
        let zeroed = std::hint::black_box(vec![0u8; BLOCK_BYTES]);
        (full, beyond, given_back, grown, are_whole && is_kept && zeroed.iter().all(|byte| *byte == 0))
    });
    assert_eq!(counted, (0, 1, 2, 3, true));
    let blocks = with_pool(|| {
        let before = allocation::blocks_of_this_thread();
        let small = std::hint::black_box(Box::new(7u8));
        let large = std::hint::black_box(Box::new([7u8; 2 * BLOCK_BYTES]));
        drop((small, large));
        allocation::blocks_of_this_thread() - before
    });
    assert_eq!((blocks, allocation::blocks_of_this_thread()), (1, 0), "a block is counted where it is taken");
}

/// A real-time thread hands used messages to the usher, which drops them.
#[test]
fn a_block_that_another_thread_gives_back_serves_again() {
    const ROUNDS: u64 = 100_000;
    let (sender, receiver) = std::sync::mpsc::sync_channel::<Box<[u64; 8]>>(16);
    let freer =
        std::thread::spawn(move || receiver.into_iter().map(|block| u64::from(block.iter().any(|word| *word != block[0]))).sum());
    let counted = with_pool(move || {
        let before = allocation::of_this_thread();
        for round in 0..ROUNDS {
            let block = Box::new([round; 8]);
            sender.send(block).unwrap();
        }
        allocation::of_this_thread() - before
    });
    let torn: u64 = freer.join().unwrap();
    assert_eq!(torn, 0, "blocks that two held at once");
    assert!(
        counted < ROUNDS / 2,
        "{counted} of {ROUNDS} blocks came from the system: those that were given back are not lent again"
    );
}
